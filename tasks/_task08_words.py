"""Lab 8 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text

#: A claim is honest when it is off by no more than this fraction.
HONEST = 0.05


def result(p, found, measured, sd):
    """The lab in three sentences."""
    here, (_variants, simplified), steady = found
    if not p.R:
        first = "With perfect measurements every filter takes x from the measurement, and no model of the input makes a difference at the samples."
    else:
        first = text("White noise in place of the correlated input raises the variance by {steady:2} of the optimal one in the steady state and by {most:2} of it at most on the way there (variant 1 or 2, whichever is worse).", steady=max(steady, 0.0), most=simplified)
    return [
        first,
        text("What the simplified filters claim is another matter ({fig:ways}): in the steady state {one:4} m² with variant 1 and {two:4} m² with variant 2, where they have {true1:4} and {true2:4} m².", one=here["claimed_variant1"], two=here["claimed_variant2"], true1=here["true_variant1"], true2=here["true_variant2"]),
        text("In the experiment the RMS error of variant 2 was {measured}, where the sensitivity analysis has {sd:3} m.", measured=measured, sd=sd),
    ]


def discussion(r, p):
    """What the experiment adds to the theory."""
    r.says("**Two questions, two answers.** How good a simplified filter is and how well it knows how good it is are different things. The first depends on its gain only, which near the optimum has a small effect (the variance has a minimum there); the second on the intensity $Q$ itself, in which the variants differ by the factor $1 + aT$.")
    if p.R:
        r.says("**The right time scale.** The period Δt is not what the correlation time has to be compared with. A filter that averages many measurements sees only the density of the input within its own narrow band; {fig:memory} shows its loss against $T/\\tau$ for periods that differ by a factor of 100.")
    r.says("**Why the short form fails first.** $P^+ = (1 - K)P^-$ is a difference of two numbers that are nearly equal when a measurement is far better than the prediction. The digits lost are those of $P^-/P^+$; the forms that keep a root or factors of $P$ form no such difference ({tab:forms}).")
    r.says("**Theory and experiment.** The points of {fig:ensemble} are correlated in time over the memory of the filter, so that those outside the band come in groups; the tests of {app:chance} take account of it.")


def answers(p):
    """Each item of the sheet in a sentence."""
    return {
        "a": "The two states $x$ and $y$ of {fig:diagram}, with the matrices of this part.",
        "b": "The intensity $2\\sigma_y^2T$, the density at low frequency {eq:density}. It is adequate for $aT \\ll 1$ and $T \\ll \\Delta t$; the second condition may be replaced by the weaker $T \\ll \\tau$ with the memory {eq:memory} of the filter.",
        "c": "Shown: $Q = 2\\sigma_y^2T$ and $Q = 2\\sigma_y^2T/(1 + aT)$.",
        "d": "{eq:simplified} and {eq:full} with the equations below it.",
        "e": "{eq:two} and its update, the two scalars to which the joint covariance shrinks.",
        "f": "{fig:over_time}, {fig:memory} and {tab:several}." if p.R else "{tab:over_time} and {tab:several}: without measurement noise no difference at the samples.",
        "g": "{fig:ways} and {tab:ways} for the two ways, {tab:forms} for the forms.",
    }


def conclusions(r, p, found, lost, cheapest):
    """What the numbers say."""
    here, (variants, simplified), steady = found
    lines = []
    if not p.R:
        lines.append("With perfect measurements every filter takes x from the measurement: no error is left at the samples, and the model matters only between them. At the samples neither model nor filter is needed.")
    else:
        for i in (1, 2):
            share = here[f"claimed_variant{i}"] / here[f"true_variant{i}"]
            word = "cautious" if share > 1 + HONEST else "optimistic: it trusts itself more than it should" if share < 1 - HONEST else "honest within 5 %"
            lines.append(text("Variant {n} claims {claimed:4} m² in the steady state and has {true:4} m² (optimal: {best:4} m²): it is {word}.",
                              n=i, claimed=here[f"claimed_variant{i}"], true=here[f"true_variant{i}"], best=here["optimal"], word=word))
        lines.append(text("The true variances of the two variants differ by {found:2} of the optimal one at most.", found=variants))
        lines.append(advice(r, here, simplified, steady))
    if lost:
        lines.append(text("Not every numerical form serves here: {names} loses more than half of the digits of the variance. Use UD or Joseph's form.", names=lost))
    else:
        lines.append(text("Any numerical form of the filter that can start here serves for the given sensor, the {cheapest} one at the least cost of those that compute the gain as they go; where a sensor is far more precise than the prediction, Joseph's form, a square root or UD is worth its operations.", cheapest=cheapest))
    lines.append(largest(r))
    r.items(lines)


def advice(r, here, simplified, steady):
    """Which filter to use."""
    cost = round(100 * r.values["flops_simplified"].value[1] / r.values["flops_true_model"].value[1])
    if steady > HONEST:
        return text("Practical advice: model the input as a state. The simplified filter needs {cost} % of the operations of the exact one (Joseph's form), but its steady variance is {times:3} times the optimal one.", cost=cost, times=1 + steady)
    better = 2 if abs(here["claimed_variant2"] - here["true_variant2"]) <= abs(here["claimed_variant1"] - here["true_variant1"]) else 1
    kept = text("Practical advice: the simplified filter will do. It needs {cost} % of the operations of the exact one (Joseph's form), and its steady variance exceeds the optimal one by {steady:2} of it; variant {n} also says most nearly how good it is.", cost=cost, steady=max(steady, 0.0), n=better)
    if simplified > HONEST:
        return kept + text(" At the first measurements the loss is larger, up to {most:2} of the optimal variance: where the start matters, model the input as a state.", most=simplified)
    return kept
