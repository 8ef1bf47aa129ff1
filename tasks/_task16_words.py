"""Lab 16 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    if p.Q:
        first = text("The continuous filter becomes the low-pass κ/(s + κ) with κ = {rate:3} 1/s, and its variance tends to {limit:4} m².", rate=answer["gain_steady_continuous"], limit=answer["variance_steady_continuous"])
        second = text("The discrete filter's variance swings between {prior:4} and {posterior:4} m² about this limit, which is the geometric mean of the two ({fig:sawtooth}).", prior=answer["prior_variance_steady"], posterior=answer["posterior_variance_steady"])
    else:
        first = "Without process noise neither filter becomes time-invariant: variance and gain tend to 0."
        second = text("At the instants of measurement both have the same variance ({fig:sawtooth}).")
    return [first, second, text("In the experiment the RMS error of the discrete filter at the end was {measured}, where theory has {sd:3} m.", measured=measured, sd=sd)]


def discussion(r, p):
    """What the experiment adds to the theory."""
    if p.Q:
        r.says("**One number decides.** The product $QR$ fixes the variance and the ratio $Q/R$ the speed. The period enters through $x = \\kappa\\,dt$ only: {fig:limits} is the same curve for all $Q$ and $R$, in units of $P_\\infty$ and $1/\\kappa$. As long as a period is a small part of the time constant, sampling costs a fraction $x/2$ of the variance right before a measurement and gains as much right after it. (The gain is that of a measurement of $x(t_i)$ itself; an average over the period has none, see {part:b}.)")
        r.says("**Two settling times.** Both filters settle at the rate at which an error of the variance is forgotten, which is twice that of an error of the estimate. The numbers differ since the discrete one counts whole measurements and has another limit.")
    r.says("**Points outside a band.** The error after a measurement contains the fraction $1 - K$ of the one before. With a short period this is nearly all of it, and points of {fig:ensemble} that lie outside a band of 95 % come in groups as long as the memory of the filter; the tests of {app:chance} are about the largest of them.")
    r.says("**White noise.** A continuous measurement in white noise is an idealisation: no record of it exists. What exists is its average over a period ({eq:average}).", " A filter that is fed with such averages, but takes them for values of $x(t_i)$, differs from the continuous one by what is left out there." if p.Q else "")


def answers(p):
    """Each item of the sheet in a sentence."""
    return {
        "a": "The filter is {eq:filter}, with the variance of {eq:variance}; its gain tends to κ from any start, and the transfer function is {eq:transfer}." if p.Q
             else "The filter is {eq:filter}; without process noise its gain tends to 0, and it does not become time-invariant.",
        "b": "The model is {eq:sampled}, the filter {eq:prediction} and {eq:update}; the steady state is {eq:steady}, the transfer function {eq:pulse}.",
        "c": "The experiments are those of {fig:record} and {fig:ensemble}; the settling times follow from {eq:settling}." if p.Q
             else "The experiments are those of {fig:record} and {fig:ensemble}; without process noise neither filter settles.",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = []
    if p.Q:
        lines.append(text(
            "The continuous filter tends to the low-pass κ/(s + κ) with κ = {rate:4} 1/s, its variance to {limit:4} m². $P_0 = {P0}$ m² is {where}.",
            rate=answer["gain_steady_continuous"], limit=answer["variance_steady_continuous"], P0=p.P0,
            where="the limit itself, so that P(t) is constant" if math.isclose(p.P0, answer["variance_steady_continuous"], rel_tol=1e-12)
            else "above the limit, so that P(t) falls; it decides only how the limit is approached" if p.P0 > answer["variance_steady_continuous"] else "below the limit, so that P(t) rises; it decides only how the limit is approached"))
        spread = answer["prior_variance_steady"] / answer["posterior_variance_steady"]
        lines.append(text(
            "The discrete filter with dt = {dt} s swings between {prior:4} m² before and {posterior:4} m² after a measurement, a ratio of {spread:3}; the continuous limit is their geometric mean. The period is {share:3} times the time constant 1/κ = {tau:3} s, so {words}.",
            dt=p.dt, prior=answer["prior_variance_steady"], posterior=answer["posterior_variance_steady"], spread=spread,
            share=p.dt * answer["gain_steady_continuous"], tau=1 / answer["gain_steady_continuous"],
            words="it is nearly the continuous filter" if spread < 1.2 else "sampling is felt but the filter still averages several measurements" if spread < 4 else "the filter relies almost on the last measurement alone"))
        lines.append("As dt → 0 the bounds and the gain approach the continuous values like dt, the mean of the bounds and the pole like dt² ({tab:limits}).")
    else:
        lines.append(
            "Without process noise both filters learn x exactly, like 1/t, and their gains fall to 0; there is no time-invariant filter in the limit."
            if p.P0
            else "x is known from the start and does not change: the gain is 0 all the time, in both filters."
        )
    when, step = answer["settling_time"], answer["settling_step"]
    if when == 0 and p.Q:
        lines.append("$P_0$ is within 1 % of the continuous limit, so the continuous filter has settled from the start.")
    if when is not None and p.Q:
        lines.append(text("The variance settles within 1 % at {when:4} s in continuous time and at measurement {step} ({time} s) in discrete time, each to its own limit.",
                          when=when, step=step, time=step * p.dt))
    lines.append(largest(r))
    r.items(lines)
