"""Lab 8 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text

#: A claim is honest when it is off by no more than this fraction.
HONEST = 0.05
#: Two variances differ essentially when they differ by more than this fraction of the optimal one.
ESSENTIAL = 0.05


def result(p, found, measured, sd):
    """The lab in three sentences."""
    here, (_variants, simplified), steady = found
    if not p.R:
        first = "With perfect measurements every filter takes x from the measurement, and no model of the input makes a difference at the samples."
    else:
        first = text("With white noise in place of the correlated input the error variance is {steady:5} times the optimal one in the steady state, and at most {most:5} times on the way there (for the worse of the two variants).", steady=1 + max(steady, 0.0), most=1 + simplified)
    return [
        first,
        text("What the simplified filters claim is another matter ({fig:ways}): in the steady state variant 1 claims {one:4} m² and has {true1:4} m², variant 2 claims {two:4} m² and has {true2:4} m².", one=here["claimed_variant1"], two=here["claimed_variant2"], true1=here["true_variant1"], true2=here["true_variant2"]),
        text("In the experiment the RMS error of variant 2 was {measured}, where the sensitivity analysis has {sd:3} m.", measured=measured, sd=sd),
    ]


def discussion(r, p):
    """What the experiment adds to the theory."""
    r.says("**Two questions, two answers.** How good a simplified filter is and how well it knows how good it is are different things. The first depends on its gain only, which near the optimum has a small effect (the variance has a minimum there); the second on the intensity $Q$ itself, in which the variants differ by the factor $1 + aT$.")
    if p.R:
        r.says("**The right time scale.** The period Δt is not what the correlation time has to be compared with. A filter that averages many measurements sees only the density of the input within its own narrow band; {fig:memory} shows its loss against $T/\\tau$ for periods that differ by a factor of 100.")
    r.says("**Why the short form fails first.** $P^+ = (1 - K)P^-$ is a difference of two numbers that are nearly equal when a measurement is far better than the prediction. The digits lost are those of $P^-/P^+$; the forms that keep a root or factors of $P$ form no such difference ({tab:forms}).")
    r.says("**Theory and experiment.** The points of {fig:ensemble} are correlated in time over the memory of the filter, so that those outside the band come in groups; the tests of {app:chance} take account of it.")


def answers(p, found):
    """Each item of the sheet in a sentence."""
    verdicts = found[1]
    apart = "differ essentially" if verdicts[0] > ESSENTIAL else "do not differ essentially"
    worse = "differs essentially" if verdicts[1] > ESSENTIAL else "does not differ essentially"
    return {
        "a": "The true model has the two states $x$ and $y$ of {fig:diagram}, with the matrices of this part.",
        "b": "A suitable intensity is $2\\sigma_y^2T$, the density {eq:density} at low frequency. It is adequate for $aT \\ll 1$ and $T \\ll \\Delta t$; the second condition may be replaced by the weaker $T \\ll \\tau$ with the memory {eq:memory} of the filter.",
        "c": "Both are shown: $Q = 2\\sigma_y^2T$ and $Q = 2\\sigma_y^2T/(1 + aT)$.",
        "d": "The simplified filters are {eq:simplified}; that of the true model is {eq:full} with the equations below it.",
        "e": "The joint covariance of truth and filter shrinks to the two scalars of {eq:two} and of its update.",
        "f": text("For the given parameters the two variants {apart} from each other, and the worse of them {worse} from the exact filter ({fig:over_time}). {tab:several} and {fig:memory} show it for other parameters.", apart=apart, worse=worse) if p.R else "Without measurement noise there is no difference at the samples ({tab:over_time}, {tab:several}).",
        "g": "Both ways agree ({fig:ways}, {tab:ways}). The numerical forms differ in their cost, and in accuracy where a sensor is very precise ({tab:forms}); the advice is among the conclusions.",
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
        lines.append(text("The true variances of the two variants differ by at most {found:2} of the optimal one.", found=variants))
        lines.append(advice(r, here, simplified, steady))
    if lost:
        lines.append(text("Not every numerical form serves here: fewer than 8 digits of the variance are kept by {names}. Use UD or Joseph's form.", names=lost))
    else:
        lines.append(text("Any numerical form of the filter that can start here serves for the given sensor; of those that compute the gain as they go the {cheapest} one costs least. Where a sensor is far more precise than the prediction, Joseph's form, a square root or UD is worth its operations.", cheapest=cheapest))
    lines.append(largest(r))
    r.items(lines)


def advice(r, here, simplified, steady):
    """Which filter to use."""
    cost = round(100 * r.values["flops_simplified"].value[1] / r.values["flops_true_model"].value[1])
    if steady > HONEST:
        return text("Practical advice: model the input as a state. The simplified filter needs {cost} % of the operations of the exact one (Joseph's form), but its steady variance is {times:3} times the optimal one.", cost=cost, times=1 + steady)
    better = 2 if abs(here["claimed_variant2"] - here["true_variant2"]) <= abs(here["claimed_variant1"] - here["true_variant1"]) else 1
    kept = text("Practical advice: the simplified filter will do. It needs {cost} % of the operations of the exact one (Joseph's form), and its steady variance is {steady:5} times the optimal one; variant {n} also claims most nearly what it has.", cost=cost, steady=1 + max(steady, 0.0), n=better)
    if simplified > HONEST:
        return kept + text(" At the first measurements the variance is up to {most:3} times the optimal one: where the start matters, model the input as a state.", most=1 + simplified)
    return kept
