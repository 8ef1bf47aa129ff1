"""Lab 10 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks.answers import task10 as by_hand

from ctlabs.labs.portrait import largest
from ctlabs.text import text

#: The letters of the given periods.
NAMES = {"bad": "d_1", "good": "d_2"}


def quality(dt):
    """A reciprocal condition number in words: 1 at best, at π/2."""
    condition = by_hand.reciprocal_condition(dt)
    if not condition:
        return "lost"
    return "well conditioned" if condition > 0.3 else "fair" if condition > 0.1 else "ill conditioned"


def result(p, measured, sd):
    """The lab in three sentences."""
    floor = by_hand.conditional(p.P0)
    first = text("Samples taken every half cycle, or a multiple of it, show the oscillator in one phase only: they lose its velocity, whose variance never falls below the {floor:4} m²/s² that the initial correlation leaves." if floor else "Samples taken every half cycle, or a multiple of it, show the oscillator in one phase only: they lose its velocity, of which here the initial covariance alone tells.", floor=floor)
    second = text("Near such a period the velocity is observable and yet poorly observed, elsewhere it becomes known ({fig:periods}).")
    third = text("In the experiment the RMS error of the velocity was {bad} m/s at $d_1$ and {good} m/s at $d_2$, where theory has {one:3} and {two:3} m/s.", bad=measured[0], good=measured[2], one=sd[0], two=sd[2])
    return [first, second, third]


def discussion(r):
    """What the experiment adds to the theory."""
    r.says("**Rank and quality.** Observability is a statement, yes or no, about exact arithmetic and unlimited time. A filter has neither: near a losing period the velocity is the slope of a line through points that are almost one point, and {eq:slope} says how many measurements its accuracy takes. That is why a period should be chosen by the condition number and not by the rank.")
    r.says("**Points outside a band.** No noise drives the oscillator, so the error after a measurement is the error before it with one more measurement averaged in. Neighbouring points of an ensemble are nearly one and the same number; a whole row of them on one side of theory is a single coincidence. The tests of {app:chance} judge the largest deviation and take the number of instants into account.")
    r.says("**What would help.** One measurement at another phase brings the velocity into view: a second period, instants that are not regular, or a sensor for the velocity itself.")


def answers(answer):
    """Each item of the sheet in a sentence."""
    return {
        "a": "The estimate of the velocity is predicted by {eq:prediction} and updated by {eq:update}. The gains can be computed beforehand, and {eq:all} gives all covariances at once; with the data six multiplications per measurement remain.",
        "b": "At $d = k\\pi$ only the (1,1) element of the inverse covariance grows ({eq:grows}); the velocity is lost, and its variance ends at {eq:floor}. The general rule is {eq:rule}, with its proof." if answer["observability_rank_bad"] == 1
             else "At $d = k\\pi$ only the (1,1) element of the inverse covariance grows ({eq:grows}); the velocity is lost there, at the given $d_1$ it is not. The general rule is {eq:rule}, with its proof.",
        "c": "The ensembles at three periods agree with theory ({fig:ensemble}, {tab:ensemble}); {fig:bad_errors} shows single runs at $d_1$.",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines, floor, prior = [], by_hand.conditional(p.P0), p.P0[1][1]
    if not any(map(any, p.P0)):
        lines.append("The state is known from the start ($P_0 = 0$): whatever the period, the gains are 0 and all variances stay 0.")
    for name, dt in (("bad", p.dt_bad), ("good", p.dt_good)):
        last = answer[f"velocity_variance_{name}"][-1]
        if not by_hand.loses(dt):
            line = "${name} = {dt}$ s keeps the oscillator observable (rank 2, {quality}: ratio of singular values {condition:3}; {offset:3} s from a multiple of π). The variance of the velocity tends to 0; after {steps} measurements it is {last:4} m²/s², from {prior} at the start."
        elif floor == 0 and prior > 0:
            line = "${name} = {dt}$ s loses the velocity (rank 1), but $P_0$ is singular and ties it to the position, so its variance tends to 0 all the same: after {steps} measurements it is {last:4} m²/s², from {prior} at the start."
        elif floor < prior:
            line = "${name} = {dt}$ s loses the velocity (rank 1): only the position is seen. The variance of the velocity falls from {prior} towards {floor} m²/s², which the initial correlation allows, and no number of measurements brings it below that; after {steps} it is {last:4} m²/s²."
        elif prior:
            line = "${name} = {dt}$ s loses the velocity (rank 1): without an initial correlation with the position its variance stays at {prior} m²/s² for ever."
        else:
            line = "${name} = {dt}$ s loses the velocity (rank 1), which does no harm here: it is known from the start."
        lines.append(text(line, name=NAMES[name], dt=dt, quality=quality(dt), condition=by_hand.reciprocal_condition(dt), offset=by_hand.offset(dt), steps=p.steps, last=last, prior=prior, floor=floor))
    if p.dt_bad == p.dt_good:
        lines.append("Both periods are the same.")
    elif by_hand.loses(p.dt_bad) != by_hand.loses(p.dt_good):
        lines.append(text("Of the given periods ${name}$ is the bad one.", name=NAMES["bad" if by_hand.loses(p.dt_bad) else "good"]))
    else:
        lines.append("Both given periods are bad ones." if by_hand.loses(p.dt_bad) else "Neither of the given periods is a bad one in the strict sense.")
    lines.append("A period near a bad one keeps the rank but not the quality: the number of measurements needed grows like $\\varepsilon^{-2/3}$ with the offset ε. The period should be judged by the condition number and not by the rank.")
    lines.append(largest(r))
    r.items(lines)
