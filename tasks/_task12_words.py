"""Lab 12 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.tasks._task12_updates import R1, second

from ctlabs.labs.portrait import largest
from ctlabs.reporting.report import Picture
from ctlabs.text import prose, text


def result(r, measured, sd):
    """The lab in three sentences."""
    values = {name: value.value for name, value in r.values.items()}
    return [
        text("Two measurements with independent noises may be used at once or one after another: with linear sensors both ways give the estimate {x:5} and the variance {P:4}.", x=values["linear_joint"][0], P=values["linear_joint"][1]),
        text("With the sine read literally the ways differ unless they use the same straight line: the estimate is {joint:4} at once and {again:4} relinearised, where the exact posterior has the mean {judge:4}",
             " ({fig:densities})." if any(isinstance(each, Picture) and each.name == "densities" for each in r.blocks) else ".",
             joint=values["ekf_joint"][0], again=values["ekf_sequential_relinearised"][0], judge=values["exact_posterior"][0]),
        text("In the experiment with the linear reading the RMS error at the end was {measured}, where theory has {sd:3} ({fig:ensemble}).", measured=measured, sd=sd),
    ]


def discussion(r):
    """What the experiment adds to the theory."""
    r.says("**What makes both ways equal** is not the filter but the product {eq:product}: an update multiplies by a likelihood, and a product may be formed in any order. The ways differ if the likelihood is no product, as with correlated noises, for which {eq:decorrelate} makes it one; or if a factor is replaced by something else on the way, as by a straight line about a point that moves.")
    r.says("**Why measurements are processed one after another.** A scalar update divides by a number where a joint one inverts a matrix, and a sensor that is late or absent needs no other equations. The price is the factorisation of $R$, once.")
    r.says("**Theory and experiment.** The points of {fig:ensemble} outside a band come in groups where the filter remembers more than one measurement; the tests of {app:chance} judge the largest deviation of all. For the literal reading no exact theory of the mean squares exists, so {tab:literal} gives standard errors instead.")


def answers(r):
    """Each item of the sheet in a sentence."""
    values = {name: value.value for name, value in r.values.items()}
    return {
        "a": text("The prediction is {eq:mean} with the variance {eq:variance}; here $\\hat x(t_i^-) = {x}$ and $P(t_i^-) = {P}$.", x=values["prior"][0], P=values["prior"][1]),
        "b": "No: white concerns one sequence in time, independent concerns the two sequences ({tab:independence}).",
        "c": "By {eq:product} the likelihood is a product, whose factors may be taken in any order; {eq:sequential} and {eq:joint} give the same numbers explicitly.",
        "d": "A diagonal $R$ is sufficient. It is necessary where $PH^T$ has independent columns ({eq:gains}), not in general.",
        "e": "For the linear reading the ensemble agrees with theory ({fig:errors}, {fig:ensemble}); {tab:literal} compares the ways of updating for the literal one." if answerable(values) else "For the linear reading the ensemble agrees with theory ({fig:errors}, {fig:ensemble}); the state is known beforehand, so that the literal reading has nothing to show.",
    }


def answerable(values):
    """Whether anything is unknown before the update."""
    return values["prior"][1] > 0


def conclusions(r, p, answer):
    """What the numbers say."""
    values = {name: value.value for name, value in r.values.items()}
    judge, sd = values["exact_posterior"], math.sqrt(values["exact_posterior"][1])
    lines = [
        text("The prediction has the mean {x:4} and the variance {P:4}; after $z_1$ they are {first:4} and {left:4}.", x=values["prior"][0], P=values["prior"][1], first=values["after_z1"][0], left=values["after_z1"][1]),
        text("Linear reading: one after another and both at once give the same estimate {x:4} with the same variance {P:4}, because the noises are independent.", x=values["linear_joint"][0], P=values["linear_joint"][1]),
    ]
    if answer["prior"][1] == 0:
        lines.append("The state is known beforehand, so no way of updating changes it.")
    else:
        off = {"both at once": values["ekf_joint"], "$z_2$ relinearised after $z_1$": values["ekf_sequential_relinearised"]}
        far = {name: abs(value[0] - judge[0]) for name, value in off.items()}
        near = min(far, key=far.get)
        differ = abs(far["both at once"] - far["$z_2$ relinearised after $z_1$"]) > 1e-9
        lines.append(text("Literal reading: the extended filter gives the estimate {joint:4} with the variance {P:4} at once, and {again:4} with {Q:4} relinearised; the exact posterior has the mean {judge:4} and the variance {exact:4}.{nearer}",
                          joint=values["ekf_joint"][0], P=values["ekf_joint"][1], again=values["ekf_sequential_relinearised"][0], Q=values["ekf_sequential_relinearised"][1], judge=judge[0], exact=judge[1],
                          nearer=text(" For these data the estimate nearer to it is that of “{near}”.", near=near) if differ else ""))
        claims = [value[1] for value in off.values()]
        if max(claims) <= 1e-12 < min(far.values()):
            lines.append(text("With a perfect $z_2$ both extended filters claim certainty, and both are wrong, by {far}: a straight line about a wrong point is believed without reserve.", far=prose(list(far.values()), 3)))
        elif sd > 1e-9 and max(claims) < judge[1]:
            lines.append("Both extended filters claim less variance than the exact posterior has: the straight line makes them overconfident for these data.")
    lines.append("\"Independent\" and \"white\" are two statements: white concerns one noise in time, independent concerns the two noises.")
    if values["correlated_joint"] is None:
        lines.append(text("A correlated pair with $R_{12} = {R12}$ does not exist at this $t$, as $R_{12}^2$ exceeds $R_1R_2 = {product}$.", R12=p.R12, product=R1 * float(second(p.t)[1])))
    elif p.R12 == 0:
        lines.append("With $R_{12} = 0$ the \"correlated\" case is the independent one, and all three ways agree.")
    else:
        lines.append(text("With $R_{12} = {R12}$ a filter that ignores the correlation estimates {x:4} instead of {right:4}; it claims the variance {P:4} and has {true:4}, where {least:4} is possible. After decorrelation by $L^{-1}$ the updates one after another again give what both at once give.",
                          R12=p.R12, x=values["correlated_sequential_naive"][0], P=values["correlated_sequential_naive"][1], right=values["correlated_joint"][0], least=values["correlated_joint"][1], true=values["naive_actual_variance"]))
    lines.append("A diagonal $R$ is sufficient; it is necessary where $PH^T$ has independent columns, and for the sheet's own pair whenever $P^- > 0$, but not in general.")
    lines.append(largest(r))
    r.items(lines)
