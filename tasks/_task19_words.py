"""Lab 19 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.tasks.answers import task19 as by_hand

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd, when):
    """The lab in three sentences."""
    if p.beta > 0:
        first = "One state is enough, whatever the zero α is, and the optimal filter is least squares for x(0) carried on in time; its error variance falls exponentially ({eq:variance}, {fig:variance})."
    elif p.beta == 0:
        first = "One state is enough, whatever the zero α is, and the optimal filter is the mean of what was measured; its error variance is $1/(1 + t)$ ({eq:variance}, {fig:variance})."
    else:
        first = text("One state is enough, whatever the zero α is, and the optimal filter is least squares for x(0) carried on in time; its error variance tends to 2|β| = {limit:4} m² ({eq:variance}, {fig:variance}).", limit=answer["variance_limit"])
    return [
        first,
        "The discrete filter of equivalent measurements agrees with it: its variance differs by a term proportional to the period, of the sign of β ({eq:difference})." if p.beta
        else "The discrete filter of equivalent measurements has the same variance at its instants, whatever the period is ({eq:closed}).",
        "No record is simulated, since x grows too much within one period." if measured is None
        else text("In the experiment the RMS error at {when:4} s was {measured}, where theory has {sd:4} m.", when=when, measured=measured, sd=sd),
    ]


def discussion(r, p, steps):
    """What the numbers mean together."""
    r.says("**Least squares.** There is no process noise, so x(0) is the only thing that is not known, and every measurement is a measurement of x(0), of weight $e^{-\\beta t}$ ({eq:written}). For β > 0 the signal fades and late measurements say nothing more; for β = 0 all count alike; for β < 0 late ones say nearly everything, and the first are soon of no account.")
    if p.beta > 0:
        r.says("**A small error is no merit of the filter here.** The error variance falls like that of x itself. Measured by the variance of x, $e^{-2\\beta t}$, what the measurements achieve in the end is the factor $2\\beta/(2\\beta + 1)$, here {share:4}; where the mode is fast, the estimate 0 would be nearly as good.", share=2 * p.beta / (2 * p.beta + 1))
    elif p.beta < 0:
        r.says("**The error does not vanish, but beside x it does.** x grows without bound while the error keeps the variance 2|β|: in relation to what is estimated the estimate becomes as good as one likes.")
    else:
        r.says("**The slowest way to certainty.** With β = 0 the estimate is the mean of the measurements, with the prior mean 0 counted as one measurement that lasted 1 s; to halve the RMS error one has to measure four times as long.")
    r.says("**What a wrong model would do.** The gain does not know whether the model is right. For β ≥ 0 it tends to zero, and a filter that no longer listens follows its own model: the smallest neglected process noise makes its error grow beyond its claim. For β < 0 the gain stays at 2|β|, and the filter goes on correcting itself.")
    if steps:
        r.says("**Points outside the band.** In {fig:ensemble} one point in twenty lies outside on average. The error at an instant is the error of the estimate of x(0), carried on, and changes little from one measurement to the next; so such points come in long runs on one side. The tests of {app:chance} take this into account.")


def answers(steps):
    """Each item of the sheet in a sentence or two."""
    words = "the statistics of the simulated filter agree with its variances ({fig:ensemble})." if steps else "no record can be simulated in double precision."
    return {
        "a": "The filter is that of {eq:filter}, its variance that of {eq:variance}; written out, the estimate is {eq:written}. The hint is true ({eq:hint}).",
        "b": "The discrete filter is that of {eq:discrete}, its variance that of {eq:closed}.",
        "c": text("Yes: the difference between the variances is proportional to the period ({tab:limit}, {fig:overlay}), and ", words),
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = ["One state suffices, and α is of no consequence: with w ≡ 0 only the pole and x(0) are left."]
    limit = answer["variance_limit"]
    if p.beta > 0:
        lines.append(text("x dies out by itself and P(t) falls like $e^{-2\\beta t}$, at the rate {rate} 1/s, measured or not; in the end the measurements only add the constant factor 2β/(2β + 1) = {share}. The gain goes to 0, and the filter never settles.", rate=2 * p.beta, share=2 * p.beta / (2 * p.beta + 1)))
    elif p.beta == 0:
        lines.append("x is a constant and the filter its average: P(t) = 1/(1 + t), the gain goes to 0 like 1/t, and the filter never settles. The discrete filter has the same variance at its instants for every period.")
    else:
        lines.append(text("x grows and its error with it; the measurements hold the variance at 2|β| = {limit} m², and the gain stays at {limit} 1/s. P(t) is within 1 % of this from {when} s on; the discrete filter's P⁺ tends to {other} m².", limit=limit, when=answer["settling_time"], other=answer["posterior_variance_limit"]))
    if p.beta:
        k = by_hand.last(p.dt)
        variance = by_hand.variance(p.beta, k * p.dt)
        ratio = answer["posterior_variance_at_1s"] / variance if variance else math.nan
        if k and math.isfinite(ratio):
            lines.append(text("At {t} s the discrete filter's P⁺ is {ratio} times P(t); the difference tends to 0 with the period, from {side}.", t=k * p.dt, ratio=ratio, side="above (β > 0)" if p.beta > 0 else "below (β < 0)"))
    lines.append(largest(r))
    r.items(lines)
