"""The lab coloured_plant in words: its result, what it means, the answers to the sheet, and what it comes to."""

import numpy as np

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd, when):
    """The lab in three sentences."""
    P, claimed, actual = np.asarray(answer["covariance_steady"]), answer["white_claimed_variance"], answer["white_actual_variance"]
    if p.b and p.D:
        first = text("An observer with a model of the coloured plant noise in it brings the error variance of x to {P11:4} m² ({eq:limit}).", P11=P[0, 0])
        second = text("The filter that takes the noise for white claims {claimed:4} m² and has {actual:4} m²: it is worse than the optimum, and better than it believes ({fig:white}).", claimed=claimed, actual=actual)
    else:
        first = text("Nothing drives the plant here, and the error variance of x tends to {P11:4} m² ({eq:limit}).", P11=P[0, 0])
        second = "The filter that takes the noise for white is the same filter in the end ({fig:white})."
    return [first, second, text("In the experiment the RMS error of x at {at:4} s was {measured}, where theory has {sd:4} m.", at=when, measured=measured, sd=sd)]


def discussion(r, p):
    """What the numbers mean together."""
    r.says("**What colour costs.** The Kalman–Bucy filter needs white noises. Coloured plant noise is brought to this form by a larger state ({eq:augmented}), and nothing else has to be derived; the price is one state more for each state of the shaping filter, and a model of the noise that must be known.")
    if p.b and p.D:
        r.says("**Why the simple filter errs on the safe side.** It takes for white a noise whose density at high frequency is smaller than it believes ({fig:spectra}). So its error is smaller than its claim ({eq:true}). With S(0) as the strength this holds for a first-order noise at all parameters; with a resonance, whose density lies above S(0) somewhere, it need not.")
        r.says("**Why it is not the optimum.** The noise keeps its value for about 1/α = {time:3} s. The observer uses this: it has an estimate of w and predicts with it. The simple filter meets each value of w as a surprise ({fig:noise}, {fig:factors}).", time=1 / p.alpha)
    r.says("**Points outside the band.** The experiment stands for continuous time, so its period is much shorter than the time constants, and the ensemble's errors at neighbouring instants are nearly the same numbers. A deviation at the beginning (it is that of the drawn initial states) therefore lasts until the filter has forgotten it: a row of points outside the band of {fig:ensemble} is one event. In {app:chance} all instants are tested with regard to this.")


def answers(answer):
    """Each item of the sheet in a sentence or two."""
    return {
        "model": "The spectrum and its stable factor are those of {eq:shaping}; with the shaping filter as a state all noises are white ({eq:augmented}).",
        "observer": "The equations of the blocks stand in {part:observer}, and are the Riccati equation of {eq:augmented}; {fig:observer} is the block diagram.",
        "example": "The steady state is {eq:limit} with {eq:polynomial}, the way there {fig:transient}.",
        "white": "It claims {eq:claim} and has {eq:true}, never more than it claims and never less than the optimum ({fig:white})." if answer["white_actual_variance"] is not None
                 else "It claims {eq:claim}, which is zero here; its error keeps what P(0) left ({fig:white}).",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    P, lines = np.asarray(answer["covariance_steady"]), []
    lines.append("A coloured plant noise costs a model of its shaping filter in the observer; nothing else changes. The block equations are the augmented Riccati equation.")
    claimed, actual = answer["white_claimed_variance"], answer["white_actual_variance"]
    if p.b and p.D:
        lines.append(text("The variance of x tends to {P11} m² and that of w to {P22} m²/s², {share:4} % below D.", P11=P[0, 0], P22=P[1, 1], share=100 * (1 - P[1, 1] / p.D)))
        lines.append(text("The filter that takes w for white noise of the strength S(0) claims {claimed} m² and has {actual} m²: it is {loss:3} % worse than the optimum and believes itself {over:3} % worse than it is.",
                          claimed=claimed, actual=actual, loss=100 * (actual / P[0, 0] - 1), over=100 * (claimed / actual - 1)))
    elif p.a > 0:
        lines.append(text("Nothing drives the plant, but it is unstable: the variance of x tends to 2ar = {P11} m², whether the noise is taken for white or not.", P11=P[0, 0]))
    else:
        lines.append("Nothing drives the plant: x becomes known, and the colour of the noise does not matter.")
    if p.a > 0:
        lines.append("The plant is unstable; the observer is stable all the same.")
    elif p.a == -p.alpha:
        lines.append("Plant and shaping filter have the same pole; the closed forms need no exception for that.")
    lines.append(largest(r))
    r.items(lines)
