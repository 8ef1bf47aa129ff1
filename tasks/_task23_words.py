"""Lab 23 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.tasks.answers import task23 as by_hand

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def printed(p):
    """Whether signal, noise and gain are those for which the box was designed."""
    g, _c = by_hand.optimum(p)
    return math.isclose(p.signal_pole, 2) and math.isclose(p.noise_pole, 4) and math.isclose(g, 0.5)


def result(p, answer, measured, sd, when):
    """The lab in three sentences."""
    g, c = by_hand.optimum(p)
    optimal, boxed = answer["optimal_variance"], answer["black_box_variance"]
    if not optimal:
        second = text("One of the two processes is absent, so that the optimal filter has no error; the box has {boxed:4} V².", boxed=boxed)
    else:
        second = text("The optimum for the given spectra is ({g:4} s + {gb:4})/(s + {c:4}) with the mean square error {optimal:4} V²; that of the box is {percent:3} % larger.", g=g, gb=g * p.noise_pole, c=c, optimal=optimal, percent=100 * (boxed / optimal - 1))
    return [
        text("The test shows a stable filter (s + 4)/[2(s + 2)], which can be a Kalman filter only if its measurement has no white noise ({eq:box}, {fig:tests})."),
        second,
        text("In the experiment the RMS error of the discrete optimum at {at:4} s was {measured}, where theory has {sd:4} V.", at=when, measured=measured, sd=sd),
    ]


def discussion(r, p, answer):
    """What the numbers mean together."""
    r.says("**What a test with noise can tell.** Spectra of power know nothing of phase. Every zero of the box could lie on the other side of the imaginary axis and the test would be the same ({fig:candidates}); the cross-spectrum of input and output would decide. What makes the box unique is a rule of design, minimum phase, and not the test.")
    r.says("**Two routes to one filter.** Wiener's factorisation asks for the stationary optimum at once, the state space for the optimum at every time, and the latter tends to the former ({eq:optimum}, {eq:state}). For stationary processes they are one theory; the state space goes on where a start, a changing parameter or a vector comes in.")
    if printed(p):
        r.says("**The engineer.** He found the right gain, so he could solve the Riccati equation; but a Kalman filter is driven by the *innovation*, and his is driven by the measurement. His mean square error is {percent:3} % larger than need be, and a filter without any dynamics would have been better ({tab:errors}). His test could not warn him: noise of a single colour gives a single number, and no test without the signal shows how far an estimate is from it.",
               percent=100 * (answer["black_box_variance"] / answer["optimal_variance"] - 1))
    else:
        r.says("**The engineer.** With the present parameters the box is the filter of another problem. Driven by the measurement and not by the innovation, it has the pole of its own signal, and it cannot follow a change of the spectra.")
    r.says("**Why the ensembles wander.** An error lasts as long as the time constants of filter and processes. So the averages over runs at neighbouring times are averages over nearly the same numbers, and a curve of {fig:boxes} or a row of points of {fig:ensemble} that lies high stays high for a while: one deviation, and not many. The tests of {app:chance} account for it.")


def answers(p, answer):
    """Each item of the sheet in a sentence or two."""
    worse = answer["black_box_variance"] > answer["constant_gain_variance"]
    criticism = (
        "The gain is right, but the innovation is not fed back; " if printed(p) else "The box has not the pole of the optimum; "
    )
    comparison = "the box is worse than the best constant gain ({tab:errors}, {fig:tests})." if worse else "the box is no worse than the best constant gain ({tab:errors}, {fig:tests})."
    return {
        "a": "The box is stable and causal, {eq:box}, known up to an all-pass. It passes half of the fastest changes, so it is no Kalman filter for a measurement with white noise; without such noise it may be one.",
        "b": text("The optimum is that of {eq:optimum}, by two routes. ", criticism, comparison),
        "c": "The model is {eq:sampled}; in the basis (z, s) of {eq:basis} one state is left, with the filter {eq:reduced}.",
        "d": "The variance never rises, begins at the error of the best constant gain, and ends above the continuous limit by what the period costs ({fig:falling}, {tab:periods}); the simulated errors agree ({fig:ensemble}, {fig:boxes}).",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    g, c = by_hand.optimum(p)
    optimal, boxed, constant = answer["optimal_variance"], answer["black_box_variance"], answer["constant_gain_variance"]
    lines = ["The test shows a stable causal filter (s + 4)/[2(s + 2)], up to an all-pass; its direct term excludes a Kalman filter for measurements with white noise."]
    if optimal:
        lines.append(text("The optimal filter is ({g} s + {gb})/(s + {c}) with the mean square error {optimal} V²; the box has {boxed} V², {percent:4} % more, {than} the best constant gain ({constant} V²).",
                          g=g, gb=g * p.noise_pole, c=c, optimal=optimal, boxed=boxed, percent=100 * (boxed / optimal - 1), than="worse than" if boxed > constant else "better than", constant=constant))
    else:
        lines.append(text("One of the two processes is absent: the optimal filter has no error; the box has {boxed} V².", boxed=boxed))
    if printed(p):
        lines.append("The engineer's gain is right, but his filter does not feed the innovation back: it keeps the pole of the signal.")
    elif p.signal_pole == p.noise_pole:
        lines.append("Signal and noise have spectra of one shape: no dynamics help, and the optimum is a constant gain.")
    start, end = answer["posterior_variance"][0], answer["posterior_variance_steady"]
    if start > end * (1 + 1e-9):
        lines.append(text("Sampled every {dt} s the error variance falls monotonically from {start} to {end} V².", dt=p.dt, start=start, end=end))
    else:
        lines.append(text("Sampled every {dt} s the error variance is {end} V² from the first measurement on.", dt=p.dt, end=end))
    lines.append(largest(r))
    r.items(lines)
