"""Lab 20 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def label(R):
    """The name of a curve."""
    return text("R = {R} m²·s", R=R)


def result(p, answer, measured, sd, when):
    """The lab in three sentences."""
    end, pole = answer["variance_steady_continuous"][0], answer["filter_pole"][0]
    return [
        text("The error variance of the unstable plant tends to $R(1 + \\sqrt{1 + Q/R})$, that is {end:4} m² for {R}, from whatever P(0) it starts ({eq:limit}).", end=end, R=label(p.R_values[0])),
        text("The filter is uniformly and exponentially stable although the plant is not: its pole tends to {pole:4} 1/s where the plant's is at +1 1/s, and V = y²/P proves it ({fig:lyapunov}).", pole=pole),
        "No record was simulated, since x grows too much within one period; the variances of the discrete filter enclose P(t) at every instant ({fig:sawtooth})." if measured is None
        else text("The variances of the discrete filter enclose P(t) at every instant, and in the experiment with {R} the RMS error at {when:3} s was {measured}, where theory has {sd:4} m.", R=label(p.R_values[0]), when=when, measured=measured, sd=sd),
    ]


def discussion(r, p, answer, steps):
    """What the numbers mean together."""
    kappa = -answer["filter_pole"][0]
    r.says("**Stable filter, unstable plant.** Observability is what counts: whatever grows is seen in z, so that it can be subtracted. The filter is a copy of the plant with a feedback $-K\\hat{x}$ that moves its pole from +1 to $-\\kappa$ ({eq:limit}). As Q/R → 0 the pole tends to −1, the mirror image of the plant's: the least effort that makes an unstable mode stable reflects it. (This is the dual of the cheapest regulator; compare {ref:anderson_moore, chapter 4}.)")
    r.says("**Why V and not y².** P(t) is a measure of how uncertain the filter is, and V measures an error by it. While the filter is still learning, an error may grow, but it grows more slowly than the uncertainty that the filter allows for ({eq:lyapunov}, {fig:lyapunov}).")
    r.says("**The dangerous approximation.** 1 + Δt differs from $e^{\\Delta t}$ by a quantity of second order in each step. For a stable plant this costs a bounded error of first order in the estimate; here it costs a fraction of first order *of x*, and x grows without bound ({eq:multiple}, {fig:approximation}). A larger process noise in the model of the filter would make that fraction smaller, but only the right Φ makes it zero.")
    if steps:
        factor = math.exp(p.dt) * answer["posterior_variance_steady"][0] / answer["prior_variance_steady"][0]
        r.says("**Points outside the band.** An error is carried to the next instant with the factor $(1 - \\bar K)e^{\\Delta t} = {factor:3}$, so neighbouring points of {fig:ensemble} tell nearly the same: with the memory of about $1/\\kappa = {memory:2}$ s an excursion of the mean error lasts about as long, and then many points in a row lie on one side, some of them outside. Over the whole figure one in twenty is expected; {app:chance} has the tests that take the correlation into account.",
               factor=factor, memory=1 / kappa)


def answers(p, steps):
    """Each item of the sheet in a sentence or two."""
    R = p.R_values[0]
    ends = {
        "d": "P(t) lies between P⁺ and P⁻ at every instant (proved with {eq:order}, seen in {fig:sawtooth} and {fig:gap}), and both tend to it with the period ({tab:convergence}).",
    }
    if steps:
        ends["d"] = "P(t) lies between P⁺ and P⁻ at every instant (proved with {eq:order}, seen in {fig:sawtooth} and {fig:gap}), both tend to it with the period ({tab:convergence}), and the simulated errors agree with them ({fig:ensemble})."
    return {
        "a": "The solution is {eq:variance}, its limit {eq:limit}; {fig:variance} draws it.",
        "b": text("Proved by {eq:lyapunov} and {eq:bound}: asymptotically, even uniformly and exponentially stable. So initial and rounding errors die out although x grows. The numbers belong to the given values of R, beginning with {R} m²·s.", R=R),
        "c": "The model is {eq:sampled}, the filter {eq:prediction} and {eq:update}; Φ must not be replaced by 1 + Δt ({fig:approximation}).",
        **ends,
    }


def conclusions(r, p, answer, steps):
    """What the numbers say."""
    lines = []
    for i, R in enumerate(p.R_values):
        end, prior, posterior = (answer[name][i] for name in ("variance_steady_continuous", "prior_variance_steady", "posterior_variance_steady"))
        still = math.isclose(p.P0, end, rel_tol=1e-12)
        words = "stays" if still else "rises" if p.P0 < end else "falls"
        lines.append(text("With {name} the variance {words} from $P_0 = {P0}$ m² to {end:4} m² and the filter's pole is {pole:4} 1/s; the discrete filter swings between {prior:4} and {posterior:4} m²." if not still
                          else "With {name} the variance {words} at {end:4} m² and the filter's pole is {pole:4} 1/s; the discrete filter swings between {prior:4} and {posterior:4} m².",
                          name=label(R), P0=p.P0, words=words, end=end, pole=answer["filter_pole"][i], prior=prior, posterior=posterior))
    lines.append("The plant is unstable with the pole +1 1/s, its filter uniformly and exponentially stable with a pole at −1 1/s or beyond: measurements hold the error, not the state.")
    share = max(abs(c) for c in answer["error_of_the_approximation"])
    lines.append(text("An unstable plant does not forgive an error of the model: with 1 + Δt in place of $e^{\\Delta t}$ the error tends to {percent:3} % of x (the largest over R) and grows with it.", percent=100 * share))
    spread = max(a / b for a, b in zip(answer["prior_variance_steady"], answer["posterior_variance_steady"], strict=True))
    lines.append("At this period the discrete filters are nearly the continuous ones." if spread < 1.2 else
                 text("At this period P⁻ is up to {spread:3} times P⁺, so sampling is felt.", spread=spread) if spread < 4 else
                 text("At this period P⁻ is up to {spread:3} times P⁺: the filter relies almost on the last measurement alone.", spread=spread))
    lines.append(largest(r) if steps else "No ensemble was run, for the period is too long for the growth of x.")
    r.items(lines)
