"""Lab 6 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    last, useful = answer["posterior_variance"][-1], [x for x in p.R if x < math.inf]
    if p.P0 == 0:
        first = text("With $P_0 = 0$ the sequence is known from the start, and no measurement changes that.")
    elif not useful:
        first = text("All given measurements are lost, and the variance stays at $P_0$.")
    elif last == 0:
        first = text("The given list has a perfect measurement: from it on the sequence is known, and only its sign changes.")
    else:
        first = text("Each measurement adds $1/R(t_i)$ to the information $1/P$, so that the variance falls from {P0} to {last:4} m² after {n} measurements.", P0=p.P0, last=last, n=len(p.R))
    third = (text("In the experiment the RMS error after the last measurement was {measured}, where theory has {sd:4} m.", measured=measured, sd=sd) if measured is not None
             else text("In the experiment the error after the last measurement was 0, as in theory."))
    return [first, text("{fig:extremes} shows the two extremes: a lost measurement adds nothing, a perfect one ends the filtering."), third]


def discussion(r):
    """What the experiment adds to the theory."""
    r.says("**Information adds, variance does not.** The variance that a measurement takes away depends on what is known already: $P - P^+ = P^2/(P+R)$. The information that it brings is $1/R$ in any case. So the order of the measurements does not matter in the end, and {fig:information} is easier to read than a curve of variances.")
    r.says("**Why it never settles.** There is no process noise, so nothing that was learnt is ever lost, and the weight of a new measurement falls with what is known. With a constant R the variance goes to 0 like $R/i$: a hundredth of it takes a hundred times as many measurements.")
    r.says("**What a variance of zero means.** A filter with $P = 0$ takes no further notice of measurements. If the one that was called perfect was not, or if the model is not quite true, the filter cannot find out: its gain is 0 for ever. In practice one gives R a small value and the model a little process noise {ref:jazwinski, chapter 8}.")
    r.says("**Points outside the bands.** One point in twenty is expected outside the bands of {fig:ensemble}. The error after a measurement contains most of the error before it, so that such points come in groups; {app:chance} takes all instants at once.")


def answers(p, start, both):
    """Each item of the sheet in a sentence."""
    return {
        "a": "The filter predicts by {eq:prediction} and updates by {eq:update}; least squares gives the same estimate, {eq:squares}.",
        "b": "All three are proved, with {eq:information}: a finite positive R adds information, an infinite one adds none, and $R = 0$ leaves no variance ({fig:extremes}).",
        "c": "All tests agree with theory ({tab:ensemble}, {fig:ensemble}); where the variance is 0 the error is 0." if (start, both) == (p.P0, p.R)
             else "All tests agree with theory ({tab:ensemble}, {fig:ensemble}, {fig:extremes_ensemble}), and after a perfect measurement the error is 0.",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    posterior, lines = answer["posterior_variance"], []
    useful = [x for x in p.R if x < math.inf]
    lost, perfect = len(p.R) - len(useful), p.R.index(0) + 1 if 0 in p.R else None
    if p.P0 == 0:
        lines.append("With $P_0 = 0$ the sequence is known from the start: all gains are 0 and measurements change nothing.")
    elif not useful:
        lines.append(text("All measurements are lost: the gain is 0 and the variance stays at {P0} m² to the end.", P0=p.P0))
    elif perfect:
        lines.append(text("The measurement at i = {perfect} is perfect: from it on the variance is 0, the estimate is the truth and only changes its sign. The number of measurements after it, {later}, does not matter.",
                          perfect=perfect, later=len(p.R) - perfect))
        before = posterior[perfect - 2] if perfect > 1 else p.P0
        if before < 0.999 * p.P0:
            lines.append(text("Just before it the variance was {before:4} m², down from {P0} m² at the start.", before=before, P0=p.P0))
        else:
            lines.append(text("The measurements before it left the variance at {P0} m², or nearly so.", P0=p.P0) if perfect > 1 else text("It is the first of all, and before it no more was known than $P_0$ says."))
    else:
        lines.append(text("Each of the {useful} useful measurements adds its $1/R(t_i)$ to the information, which grows from {start:4} to {end:4} 1/m². The variance falls from {P0} to {last:4} m², and the share {left:3} of an initial error is left.",
                          useful=len(useful), start=1 / p.P0, end=answer["posterior_information"][-1], P0=p.P0, last=posterior[-1], left=posterior[-1] / p.P0))
        lines.append("The filter has no other steady state than the variance 0, which it approaches like $R/i$ with measurements of a constant R.")
    if p.P0 > 0 and lost and useful:
        lines.append(text("Lost measurements ($R = \\infty$): {lost} of {all}; the filter drops them by itself.", lost=lost, all=len(p.R)))
    lines.append("The alternating sign costs nothing: $\\Phi^2 = 1$, so the variances are those of a constant.")
    lines.append(largest(r))
    r.items(lines)
