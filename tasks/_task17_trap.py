"""Lab 17: what becomes of a model with two states."""

import math

import numpy as np
from ctlabs.tasks import task16_wiener_process as lab16
from ctlabs.tasks.answers import task17 as by_hand

from ctlabs.filtering import bucy, steady
from ctlabs.models import observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT
from ctlabs.text import text

TIME = "t, s"


def two_states(p, t):
    """P11, P12, P22 of the two-state filter, in the coordinates s = x1 + x2 and u = a x1 − b x2, a + b = 1.

    With b = q1/(q1+q2) the noises of s and u are uncorrelated, so that Psu' = −Ps Psu/R, Puu' = q1q2/(q1+q2) − Psu²/R.
    """
    Q, P0 = p.q1 + p.q2, p.P01 + p.P02
    b = p.q1 / Q if Q else 0.5
    a = 1 - b
    start = a * p.P01 - b * p.P02
    if Q:
        limit, x = math.sqrt(Q) * math.sqrt(p.R), math.sqrt(Q / p.R) * t
        share, fading = math.tanh(x), 2 * math.exp(-x) * limit
        cross = start * fading / (limit + P0 + (limit - P0) * math.exp(-2 * x))
        learnt = start**2 * share / (limit + P0 * share)
    else:
        cross, learnt = start * p.R / (p.R + P0 * t), start**2 * t / (p.R + P0 * t)
    Ps, Puu = lab16.by_hand.variance(Q, p.R, P0, t), a**2 * p.P01 + b**2 * p.P02 + by_hand.growth(p) * t - learnt
    return (
        Puu + 2 * b * cross + b**2 * Ps,
        (a - b) * cross + a * b * Ps - Puu,
        Puu - 2 * a * cross + a**2 * Ps,
    )


def scale(p):
    """The time constant of the steady filter, s; without process noise the time in which P(t) halves."""
    twin = lab16.Parameters(Q=p.q1 + p.q2, R=p.R, P0=p.P01 + p.P02, dt=p.dt)
    return lab16.time_scale(twin)


def refusal(solve, system):
    """What a solver says of a model that it cannot solve."""
    try:
        solve(system)
    except ValueError as error:
        return str(error)
    return ""


def trap(r, p, answer, system, double):
    """The two-state model."""
    r.says("**The trap.** With the states $(x_1, x_2)$ that the figure offers, the model is")
    r.model(double)
    seen = observability.analyse(double)
    r.value("observability_rank_two_states", seen.rank, agrees=answer, routes=("staircase", "rank of the observability matrix"), kind=EXACT)
    r.says("Its observability matrix is $\\begin{bmatrix} 1 & 1 \\\\ 0 & 0 \\end{bmatrix}$, of rank {rank}: $x_1 - x_2$ leaves no trace in $z$. The mode that is not seen is that of $x_1 - x_2$, with the eigenvalue 0: it does not decay, so the model is not even detectable, which the theorem of a unique steady state asks for ({ref:anderson_moore, chapter 4}). A program that is asked for the steady covariance must refuse, and this one does:",
           rank=seen.rank)
    said = [refusal(bucy.steady, double), refusal(steady.solve, discretise(double, p.dt))]
    names = ("continuous", "discrete")
    r.items([text("The solver of the {solver} filter says: “{words}”.", solver=name, words=words) for name, words in zip(names, said, strict=True)])
    modes = [observability.analyse(system).undetectable_modes[0] for system in (double, discretise(double, p.dt))]
    named = [float(mode in words) for mode, words in zip(modes, said, strict=True)]
    r.check("both solvers name the mode that is not seen", named, [1.0, 1.0], ("message of the solver", "staircase"), EXACT)
    r.says("**What its covariance does.** In time it is well defined. Put $s = x_1 + x_2$ and $u = ax_1 - bx_2$ with $b = q_1/(q_1+q_2)$, $a = 1 - b$ (any $a$, $b$ with the sum 1 without noise). The noises of $s$ and $u$ are uncorrelated, and $x_1 = u + bs$, $x_2 = as - u$:")
    r.math(r"\dot P_s = q_1 + q_2 - \frac{P_s^2}{R}, \qquad \dot P_{su} = -\frac{P_s}{R}P_{su}, \qquad \dot P_u = \frac{q_1q_2}{q_1+q_2} - \frac{P_{su}^2}{R}", "trap")
    r.says("The first equation is that of the one-state filter with the same initial value, so $P_{11} + 2P_{12} + P_{22} = P_s = P(t)$ exactly. $P_{su}$ dies out, and then $P_u$ grows at the rate $q_1q_2/(q_1+q_2)$ for ever, and with it $P_{11}$, $P_{22}$ and $-P_{12}$. For $q_1 = q_2$ this rate is $(q_1+q_2)/4$. ∎")
    tau, rate = scale(p), answer["growth_rate_x1"]
    times = [0.0, *(tau * np.array([0.5, 1.0, 2.0, 5.0, 20.0, 100.0, 200.0]))]
    found, one = bucy.transient(double, times), bucy.transient(system, times).P[:, 0, 0]
    closed = np.array([two_states(p, t) for t in times])
    elements = found.P[:, [0, 0, 1], [0, 1, 1]]
    size = float(np.abs(found.P).max()) or 1.0
    # An element that is 0 is a difference of numbers of this size: it is known up to their rounding.
    r.check("P11, P12, P22 of the two-state filter", elements, closed, ("Riccati equation, integrated", "closed form"), scale=np.maximum(np.abs(closed), 1e-6 * size))
    total = found.P.sum(axis=(1, 2))
    r.check("P11 + 2P12 + P22 = P(t)", total, one, ("two-state filter", "one-state filter"), EXACT, scale=size)
    slope = (found.P[-1, 0, 0] - found.P[-2, 0, 0]) / (times[-1] - times[-2])
    r.value("growth_rate_x1", rate, "m²/s")
    if p.q1 + p.q2:  # without noise P11 falls like 1/t, and the slope is not yet 0
        r.check("rate at which P11 grows", slope, rate, ("Riccati equation, integrated", "closed form"), scale=max(rate, size / tau))
    r.table("two_states", [TIME, "$P_{11}$, m²", "$P_{22}$, m²", "$P_{12}$, m²", "$P_{11} + 2P_{12} + P_{22}$, m²", "$P$ of one state, m²"],
            [(t, P[0, 0], P[1, 1], P[0, 1], P.sum(), Ps) for t, P, Ps in zip(times, found.P, one, strict=True)],
            "The two-state filter: what it says of $x_1$ and $x_2$, and of their sum.")
    trap_pictures(r, p, answer, double, tau, rate, times, found, closed, total)


def trap_pictures(r, p, answer, double, tau, rate, times, found, closed, total):
    """The variances of the two-state filter in time."""
    t = np.linspace(0.0, 12 * tau, 241)
    rows = bucy.transient(double, t).P
    curves = {"$P_{11}$": rows[:, 0, 0], "$P_{22}$": rows[:, 1, 1], "$P_{11} + 2P_{12} + P_{22} = P(t)$": rows.sum(axis=(1, 2))}
    r.figure("two_states", plots.transient(t, curves, xlabel=TIME, ylabel="error variance, m²"), "The two-state filter: variances of $x_1$ and $x_2$, and of their sum, which is the same as with one state.")
    r.says("{fig:two_states} and {tab:two_states} show it:", " the variance of the sum settles, those of its parts grow along straight lines." if rate else " the variance of the sum and those of its parts have limits, which for the parts depend on the start.")
    gains = found.K[-1, :, 0]
    if p.q1 + p.q2:
        limits = [p.q1 / (p.q1 + p.q2) * answer["gain_steady_continuous"], p.q2 / (p.q1 + p.q2) * answer["gain_steady_continuous"]]
        r.check("gains of the two-state filter in the limit", gains, limits, ("Riccati equation, integrated", "closed form"))
        r.says("The gains converge, to {K1:4} and {K2:4} 1/s, shared like $q_1 : q_2$; the covariance is another matter. The loop has a pole at 0 beside −κ: a rounding error in $\\hat{x}_1 - \\hat{x}_2$ would never be forgotten.", K1=gains[0], K2=gains[1])
    if rate:
        r.says("After {t:4} s $P_{11}$ is {P11:4} m² and grows by {rate:3} m² each second; the sum is known to {total:4} m².", t=times[-1], P11=found.P[-1, 0, 0], rate=rate, total=total[-1])
    else:
        r.says("Here at most one of the noises acts, so nothing feeds the mode that is not seen: $P_{11}$ does not grow for ever; after {t:4} s it is {P11:4} m². Its limit depends on $P_{01}$ and $P_{02}$, so a steady solver that forgets them has to refuse all the same.", t=times[-1], P11=closed[-1, 0])
