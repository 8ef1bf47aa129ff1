"""Lab 16, part (c): P(t) between the teeth of the sawtooth, and the limit dt → 0."""

import math

import numpy as np
from ctlabs.tasks.answers import task16 as by_hand

from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import covariances
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.report import SOLVER
from ctlabs.text import text

TIME = "t, s"


def time_scale(p):
    """The time in which the continuous filter forgets, s; without process noise that in which P(t) halves."""
    if p.Q:
        return math.sqrt(p.R / p.Q)
    return p.R / p.P0 if p.P0 else 10 * p.dt


def overlay(r, p, answer, system, sampled):
    """P(t) between P⁻ and P⁺."""
    r.says("**P(t) lies between the teeth.** Over one period the continuous filter gains $Q\\,dt$ and loses by measuring at the same time. If the whole gain comes first and the whole loss after it (the discrete filter from $t_{i-1}^+$ to $t_i^+$), the loss $\\dot{P} = -P^2/R$ acts on larger variances, so it ends lower; if the loss comes first (from $t_{i-1}^-$ to $t_i^-$), higher. Both maps increase with $P$, and they begin with $P^+ = P_0$ and, after one period, $P^- = P_0 + Q\\,dt \\ge P(t_1)$. By induction $P(t_i^+) \\le P(t_i) \\le P(t_i^-)$ for every period and every $i \\ge 1$. ∎ {fig:sawtooth} shows it.")
    count = min(max(math.ceil(4 * time_scale(p) / p.dt), 8), 200)
    shown = covariances(sampled, count)
    between = bucy.transient(system, shown.t).P[:, 0, 0]
    routes = ("recursion", "Riccati equation, integrated")
    size = float(shown.P_minus.max()) or 1.0
    r.holds("P⁺ ≤ P(t)", between[1:] - shown.P_plus[1:, 0, 0], routes, size=size)
    r.holds("P(t) ≤ P⁻", shown.P_minus[1:, 0, 0] - between[1:], routes, size=size)
    closed = [by_hand.posterior_variance(p.Q, p.R, p.P0, p.dt, k) for k in range(count + 1)]
    r.check("P⁺ along the measurements", shown.P_plus[:, 0, 0], closed, ("recursion", "power of the step's matrix"),
            SOLVER)
    r.check("gain along the measurements", shown.K[1:, 0, 0], [P * p.dt / p.R for P in closed[1:]],
            ("recursion", "power of the step's matrix"), SOLVER)
    half = covariances(discretise(system, p.dt / 4), 4 * count)
    t = np.linspace(0.0, shown.t[-1], 401)
    figure = plots.sampled({text("dt = {dt} s", dt=p.dt): shown, text("dt = {dt} s", dt=p.dt / 4): half}, t,
                           bucy.transient(system, t).P[:, 0, 0], xlabel=TIME, ylabel="variance, m²",
                           limit=answer["variance_steady_continuous"])
    r.figure("sawtooth", figure,
             "The sawtooth of the discrete filter over the variance of the continuous one, for the given period and a quarter of it.")
    r.says("In {fig:sawtooth} the teeth of a quarter of the period are a quarter as high, and $P(t)$ stays between them: the bounds $P^-$ and $P^+$ close in on it from both sides." if p.Q else "In {fig:sawtooth} nothing is lost between the measurements, and $P(t)$ passes through the steps at their ends.")


def limits(r, p, answer, system):
    """dt → 0."""
    if not p.Q:
        r.says("**dt → 0.** Without process noise the discrete filter agrees with the continuous one at the instants of measurement for every period: $1/P(t_i^+) = 1/P_0 + i\\,dt/R = 1/P(t_i)$. The information of the measurements does not depend on how it is divided.")
        coarse = covariances(discretise(system, p.dt), 20)
        r.check("P⁺ = P(t) without process noise", coarse.P_plus[:, 0, 0],
                [by_hand.variance(p.Q, p.R, p.P0, t) for t in coarse.t], ("recursion", "closed form"), SOLVER)
        return
    r.says("**dt → 0.** With $x = \\kappa\\,dt$ the steady state of (b) is $P^\\mp = P_\\infty(\\sqrt{1 + x^2/4} \\pm x/2)$. Expanded in x:")
    r.math(r"P^\mp = P_\infty\Bigl(1 \pm \frac{x}{2} + \frac{x^2}{8} + \dots\Bigr), \qquad \frac{P^- + P^+}{2} = P_\infty\Bigl(1 + \frac{x^2}{8} + \dots\Bigr)", "orders")
    r.math(r"\frac{K}{dt} = \kappa\Bigl(1 - \frac x2 + \dots\Bigr), \qquad \frac{\ln(1-K)}{dt} = -\frac{2}{dt}\,\mathrm{arsinh}\frac x2 = -\kappa\Bigl(1 - \frac{x^2}{24} + \dots\Bigr)")
    r.says("So the bounds and the gain approach the continuous filter at first order, the mean of the bounds and the pole at second. {tab:limits} and {fig:limits} show it; $P^+$ at $t = 1/\\kappa$ is on the way from $P_0$.")
    scale, rate = time_scale(p), math.sqrt(p.Q / p.R)
    periods = [scale / n for n in (8, 16, 32, 64)]
    systems = [discretise(system, dt) for dt in periods]
    found, exact = [steady.solve(s) for s in systems], bucy.steady(system)
    target, midway = float(exact.P[0, 0]), float(bucy.transient(system, [scale]).P[0, 0, 0])
    bounds = [(float(s.P_minus[0, 0]), float(s.P_plus[0, 0])) for s in found]
    at = [
        s.P_plus[-1, 0, 0]
        for s in (covariances(system, n) for system, n in zip(systems, (8, 16, 32, 64), strict=True))
    ]
    errors = {
        "P⁻": [minus - target for minus, plus in bounds],
        "P⁺": [target - plus for minus, plus in bounds],
        "mean of P⁻ and P⁺": [0.5 * (minus + plus) - target for minus, plus in bounds],
        "gain K/dt": [float(exact.K[0, 0] - s.K[0, 0] / dt) for s, dt in zip(found, periods, strict=True)],
        "pole ln(1−K)/dt": [
            math.log(plus / minus) / dt + rate for (minus, plus), dt in zip(bounds, periods, strict=True)
        ],
        "P⁺ at t = 1/κ": [midway - value for value in at],
    }
    omega = [rate]
    continuous = plots.response(bucy.filter_system(system), omega)[0]
    errors["transfer function at ω = κ"] = [
        float(abs(plots.response((*steady.transfer_function(s), dt), omega)[0] - continuous))
        for s, dt in zip(systems, periods, strict=True)
    ]
    orders(r, p, answer, system, scale, periods, target, errors)


def orders(r, p, answer, system, scale, periods, target, errors):
    """How fast the discrete filter approaches the continuous one."""
    second = {"mean of P⁻ and P⁺", "pole ln(1−K)/dt"}
    for name, values in errors.items():
        r.order(text("order of {name}", name=name), np.abs(values), 2.0 if name in second else 1.0,
                ("discrete filter", "continuous filter"))
    r.table("limits", ["dt, s", *errors], [(dt, *(values[i] for values in errors.values())) for i, dt in enumerate(periods)],
            "Differences from the continuous filter (variances in m², gain and pole in 1/s): halved with the period, or quartered where the order is 2.")
    grid = np.geomspace(min(scale / 100, p.dt / 4), max(10 * scale, p.dt * 4), 25)
    solved = [steady.solve(discretise(system, float(dt))) for dt in grid]
    minus, plus = np.array([s.P_minus[0, 0] for s in solved]), np.array([s.P_plus[0, 0] for s in solved])
    curves = {
        "$P^- - P_\\infty$": minus - target,
        "$P_\\infty - P^+$": target - plus,
        "mean $- P_\\infty$": 0.5 * (minus + plus) - target,
    }
    figure = plots.lines(
        grid, {name: np.abs(values) for name, values in curves.items()}, xlabel="period dt, s", ylabel="difference from $P_\\infty$, m²", log="xy",
        straight={"slope 1, slope 2": (grid, target * grid / (2 * scale)), "_slope2": (grid, target * (grid / scale) ** 2 / 8)},
        points={"the given dt": ([p.dt] * 3, [answer["prior_variance_steady"] - target, target - answer["posterior_variance_steady"], 0.5 * (answer["prior_variance_steady"] + answer["posterior_variance_steady"]) - target])},
    )
    r.figure("limits", figure,
             "How the steady variances of the discrete filter approach that of the continuous one as the period is shortened; dashed, the slopes of {eq:orders}.")
