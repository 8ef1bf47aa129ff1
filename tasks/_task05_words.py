"""Lab 5 in words: whether variant 2 is worth while, the result, the answers to the sheet, and what it comes to."""

import math

import numpy as np

from ctlabs.labs.portrait import largest
from ctlabs.text import text

#: A ratio of steady variances from which variant 2 can be called worth while.
WORTH = 1.02
#: A NEES of four states from which the errors are no longer what P says.
BELIEVED = 5.0


def verdict(r, sensor):
    """Worth while if the linear theory promises enough and the true sensor does not contradict it."""
    ratio = float(np.max(r.values["variance_ratio_steady"].value))
    worth = bool(ratio >= WORTH and not sensor["worse"])
    r.value("verdict_g", worth)
    r.says("**Verdict.** Variant 2 is called worth while if some steady variance falls by a factor of {limit} at least at fixed geometry, and if with the true sensor no state is clearly worse. {reason}",
           limit=WORTH, reason=reason(ratio, sensor))
    return {"worth": worth, "gain": ratio}


def reason(ratio, sensor):
    """Why the verdict is what it is."""
    if sensor["worse"]:
        return text("With the true sensor some state is clearly worse, so variant 2 is not worth while here: it trusts the small error along the radius, and the curvature of the circle of constant range, which the first order leaves out, is not small beside that.")
    if ratio < WORTH:
        return text("The largest factor is {ratio:4}, so variant 2 is not worth while here.", ratio=ratio)
    if sensor["better"]:
        return text("The largest factor is {ratio:4}, and with the true sensor variant 2 is clearly better in some states and clearly worse in none: it is worth while.", ratio=ratio)
    return text("The largest factor is {ratio:4}, and with the true sensor no state is clearly worse; that none is clearly better either means that so many runs cannot show so small a gain. Variant 2 is called worth while on the strength of the theory.", ratio=ratio)


def reliable(sensor):
    """What the NEES says of the filters, in a sentence."""
    bad = [text("{name} up to {nees:3}", name=text(name), nees=float(nees)) for name, nees in zip(("variant 1", "variant 2", "the extended filter"), sensor["nees"], strict=True) if not nees <= BELIEVED]
    if not bad:
        return text("No filter has a NEES above {limit:2} on any trajectory of the true sensor, where a consistent filter has 4: the variances that the filters claim can be believed.", limit=BELIEVED)
    return text("On some trajectory of the true sensor the NEES exceeds {limit:2}, where a consistent filter has 4: {filters}. The variances that are claimed there are too small.", limit=BELIEVED, filters="; ".join(bad))


def result(r, worth, gain, sensor):
    """The lab in three sentences."""
    rho = r.values["correlation_coefficient"].value
    first = (text("The errors of the two pseudo-measurements have the correlation coefficient {rho:3}; a filter that knows it (variant 2) has steady variances that are up to {percent:2} % below those of one that does not.", rho=rho, percent=100 * (1 - 1 / gain))
             if gain > 1 + 1e-9 else text("The errors of the two pseudo-measurements are uncorrelated at the given geometry, so that both variants are the same filter there."))
    if sensor["worse"]:
        second = text("That is the theory of a fixed geometry; with the true sensor variant 2 is clearly worse in some states, and is not worth while.")
    elif worth:
        second = text("With the true sensor variant 2 is clearly better in some states and clearly worse in none, and so it is worth while; {fig:crossing} shows one of the trajectories." if sensor["better"]
                      else "With the true sensor no state is clearly worse, and so variant 2 is worth while; {fig:crossing} shows one of the trajectories.")
    else:
        second = text("With the true sensor no state is clearly worse ({fig:crossing}), but the gain is too small to be worth while.")
    return [first, second, reliable(sensor)]


def discussion(r, p, sensor):
    """What the experiment adds to the theory."""
    index = p.D * p.sigma_theta**2 / 2 / p.sigma_D
    r.says("**Where the theory ends.** The set of all points with the measured range is a circle. The first order replaces it by its tangent, and at the distance $D\\sigma_\\theta$ from the point of contact the two are $D\\sigma_\\theta^2/2$ apart, {bias:3} m, which is {index:2} times $\\sigma_D$. Variant 2 is the filter that trusts the direction of the tangent; variant 1 has a rounder ellipse and notices the difference less. So the longer the ellipse, the more there is to gain in {fig:by_ratio}, and the sooner the gain is lost again.",
           bias=index * p.sigma_D, index=index)
    if sensor["extended"] and not sensor["not_extended"]:
        r.says("**The extended filter** takes range and bearing as they are. It is clearly better than variant 2 in some states and clearly worse in none ({tab:true_ratios}): it is to be preferred here.")
    elif sensor["not_extended"] and not sensor["extended"]:
        r.says("**The extended filter** takes range and bearing as they are. It is clearly worse than variant 2 in some states and clearly better in none ({tab:true_ratios}): to linearise about a poor prediction is no better than to convert.")
    elif sensor["extended"]:
        r.says("**The extended filter** takes range and bearing as they are. It is clearly better than variant 2 in some states and clearly worse in others ({tab:true_ratios}).")
    else:
        r.says("**The extended filter** takes range and bearing as they are. It does not differ clearly from variant 2 in any state ({tab:true_ratios}): to first order the two are the same filter.")
    r.says("**Another cure** is to convert, to subtract the mean of the exact moments and to use their covariance (compare {tab:moments}); such filters are treated in {ref:bar_shalom, chapter 10}.")
    r.says("**Points outside the bands.** One point in twenty is expected outside the bands of {fig:ensemble}; they come in groups, because the errors of neighbouring instants are correlated. {app:chance} allows for that.")


def answers(r, worth, gain, sensor):
    """Each item of the sheet in a sentence."""
    independent = r.values["verdict_b_independent"].value
    return {
        "a": "To first order they are {eq:errors}. Both are made of the same $e_D$ and $e_\\theta$ and are not independent, as the sheet calls them.",
        "b": "The elements are those of {eq:covariance}; here $R_{12} = 0$." if independent else "The elements are those of {eq:covariance}; {fig:ellipse} shows the ellipse of the errors.",
        "c": "The variances that variant 1 claims are its true ones, the zero covariance of x and y is not; the influence of the factors is in {tab:factors}." if not independent else "With $R_{12} = 0$ variant 1 neglects nothing; the influence of the factors is in {tab:factors}.",
        "d": "The factors are those of {eq:factors}; $d_1$ and $d_2$ are positive as long as both errors exist.",
        "e": "$z' = L^{-1}z$ as in {eq:decorrelated}, where the matrix H is multiplied as well.",
        "f": "The ensembles agree with the theory of fixed geometry ({fig:ensemble}). {fig:loss} shows what variant 1 loses beside variant 2, {tab:factors} and {tab:factor_ratios} what the factors do.",
        "g": text("Yes: at fixed geometry a variance falls by up to the factor {gain:4}, and with the true sensor no state is clearly worse ({tab:true_ratios}).", gain=gain) if worth
             else "No: with the true sensor some state is clearly worse ({tab:true_ratios})." if sensor["worse"]
             else "No: the theory promises too little.",
    }


def conclusions(r, p, sensor):
    """What the numbers say."""
    values = {name: value.value for name, value in r.values.items()}
    rho, ratio, lines = values["correlation_coefficient"], np.array(values["variance_ratio_steady"]), []
    if values["verdict_b_independent"]:
        why = "the radius lies along an axis" if abs(math.sin(2 * p.theta)) < 1e-9 else "the errors along and across the radius are equal"
        lines.append(text("$R_{12} = 0$, because {why}: the pseudo-measurements are uncorrelated, variant 2 is variant 1, and all ratios are 1.", why=why))
        lines.append("Where the point moves away from this geometry $R_{12}$ appears along the way, as on the crossing trajectory, unless $\\sigma_D = D\\sigma_\\theta$ stays true.")
    else:
        lines.append(text("The errors of the pseudo-measurements have the correlation coefficient {rho:3}; they are not independent, as the sheet calls them.", rho=rho))
        lines.append(text("At fixed geometry neglecting it raises the steady variances by the factors {x:4} (x), {vx:4} ($v_x$), {y:4} (y) and {vy:4} ($v_y$), up to {percent:2} % in σ, and nothing in the P of variant 1 warns of it: its own variances are right there.",
                          **dict(zip(("x", "vx", "y", "vy"), ratio, strict=True)), percent=100 * (math.sqrt(ratio.max()) - 1)))
    lines.append(reason(float(ratio.max()), sensor))
    lines.append(reliable(sensor))
    lines.append("The errors of both filters are bounded, although the motion is not.")
    cost = values["cost_of_update"]
    lines.append(text("Variant 2 costs {two} operations per update, variant 1 {one} as two small filters, the full R at once {both}: decorrelating first is {word} than inverting S.", two=cost[2], one=cost[0], both=cost[3], word="cheaper" if cost[2] < cost[3] else "not cheaper"))
    lines.append(largest(r))
    r.items(lines)
