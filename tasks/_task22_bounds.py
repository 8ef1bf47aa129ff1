"""Lab 22, part (d): the bounds, and the filter that takes the noise for white."""

import math

import numpy as np
from ctlabs.tasks.answers import task22 as by_hand
from ctlabs.tasks.answers.task22 import WITHIN

from ctlabs.filtering import bucy, reduced, settling
from ctlabs.labs.comparison import taken_for_white
from ctlabs.labs.experiment import covariances
from ctlabs.models import DiscreteModel
from ctlabs.reporting import plots
from ctlabs.text import text

TIME = "t, s"
NO_LIMIT = "with a = 0 both states are integrators, their difference is never seen, and its variance grows without bound"
TO_ZERO = "the limit is 0, and a variance that decays to 0 never stays within 1 % of it"


def time_scale(p):
    """The time in which the continuous filter forgets, s."""
    rate = p.a * math.sqrt(p.Q1 / (p.Q1 + p.Q2))
    return 1 / rate if rate else max(1 / p.a if p.a else 0.0, 10 * p.dt)


def bounds(r, p, answer, small, discrete):
    """Monotone between the start and the limit; below the variance of z itself."""
    if answer["variance_steady_continuous"] is None:
        r.says("**Bounds.** With a = 0 there are none but the start: $P(t) = P(0^+) + Q_1Q_2t/(Q_1+Q_2)$ rises without end, since nothing in z tells the two integrators apart. The samples are part of the record, so $p_i \\ge P(t_i)$ for every period.")
    else:
        r.says("**Bounds.** In {part:a} the ratio $(u - u_\\infty)/(u + u_\\infty)$ keeps its sign, so P(t) goes from $P(0^+)$ to $P_\\infty$ without turning back and stays between them: its bounds are these two numbers. The limit itself is bounded by what two simple estimates reach,")
        r.math(r"P_\infty = \frac{\sqrt{Q_1}}{\sqrt{Q_1+Q_2}+\sqrt{Q_1}}\,\frac{Q_2}{a} \le \min\Bigl(\frac{Q_2}{2a},\; \frac{\sqrt{Q_1Q_2}}{a}\Bigr)", "bounds")
        r.says("The first is the stationary variance of $x_2$, the error of $\\hat{x}_1 = z$, approached when the object moves much (large $Q_1$); the second is the error of a filter for white noise of the strength $Q_2/a^2$ that $x_2$ has at low frequency, approached when it moves little. ∎ The samples are part of the record, so $p_i \\ge P(t_i)$ for every period.")
    start, end = answer["variance_after_first_measurement"], answer["variance_steady_continuous"]
    t = np.linspace(0.0, 5 * time_scale(p), 201)
    curve = reduced.transient(small, t)[:, 0, 0]
    size = float(curve.max()) or 1.0
    routes = ("Riccati equation, integrated", "bound proved")
    if end is not None:
        low, high = min(start, end), max(start, end)
        r.holds("P(t) between P(0⁺) and P∞", np.minimum(curve - low, high - curve), routes, size=size * 100)
        r.holds("P∞ ≤ Q2/(2a), √(Q1Q2)/a", min(p.Q2 / (2 * p.a), math.sqrt(p.Q1 * p.Q2) / p.a) - end, ("closed form", "bound proved"), size=size)
    sampled_ = covariances(discrete, min(max(p.steps, 8), 200), first=0)
    r.holds("p(i) ≥ P(t_i)", sampled_.P_plus[:, 0, 0] - reduced.transient(small, sampled_.t)[:, 0, 0], ("discrete recursion", "Riccati equation, integrated"), size=size * 100)
    fine = np.linspace(0.0, sampled_.t[-1], 201)
    figure = plots.sampled({text("Δt = {dt} s", dt=p.dt): sampled_}, fine, reduced.transient(small, fine)[:, 0, 0], xlabel=TIME, ylabel="variance of x1, m²", limit=end)
    r.says("{fig:sampled} shows the given parameters: P⁺ runs above P(t), so closely that the two can hardly be told apart where the period is short, and every prediction adds the noise of a period, from which the next measurement takes the variance down to P⁺ again.")
    r.figure("sampled", figure, "Error variance of x₁: the discrete filter before and after each measurement over the continuous P(t).")
    settled = settling(discrete, WITHIN, first=0) if answer["posterior_variance_steady"] is not None else None
    when = bucy.settling_time(small.model, WITHIN) if end is not None else None
    reason = NO_LIMIT if end is None else TO_ZERO
    r.value("settling_time", when, "s", symbol=r"t_{1\%}", reason=reason, agrees=answer, routes=("search along P(t)", "closed form"))
    r.value("settling_step", settled, symbol=r"i_{1\%}", reason=reason)
    if settled is not None:
        curve = np.abs(np.array(by_hand.variances(p.a, p.dt, p.Q1, p.Q2, start, settled)) / answer["posterior_variance_steady"] - 1)
        routes = ("power of the fraction's matrix", "search along the recursion")
        r.holds("in the band at the settling step", WITHIN - curve[-1], routes, size=1.0)
        if settled:
            r.holds("outside one step earlier", curve[-2] - WITHIN, routes, size=1.0)


def white(r, p, experiment, answer, discrete, steps):
    """The filter that takes x2 for white noise."""
    if not (p.a and p.Q1 and p.Q2):
        return
    noise, best = p.Q2 / (2 * p.a), answer["posterior_variance_steady"]
    design = DiscreteModel([[1]], [[p.Q1 * p.dt]], [[1]], [[noise]], x0=[0], P0=[[p.sigma1_2]], dt=p.dt, states=["x1"], units=["m"])
    found = taken_for_white(r, experiment, discrete, design, steps, best=best, size=best,
                            by_hand=lambda K: by_hand.white_variance(p.a, p.dt, p.Q1, p.Q2, K))
    r.says("**A filter that takes $x_2$ for white noise** of the same variance $Q_2/2a$ has one state and the gain {K}. It claims {claimed} m² and has {true} m², where the optimal filter has {best} m². {fig:white} shows it in time: the true variance lies above what the filter claims, because neighbouring samples carry nearly the same noise, and averaging them does not remove it." if found.true > 1.01 * found.claimed else "**A filter that takes $x_2$ for white noise** of the same variance $Q_2/2a$ has one state and the gain {K}. It claims {claimed} m² and has {true} m², where the optimal filter has {best} m² ({fig:white}): at this period neighbouring samples carry nearly independent noise, and little is lost.",
           K=found.gain, claimed=found.claimed, true=found.true, best=best)
    own = covariances(discrete, steps, first=0)
    figure = plots.lines(own.t, {"optimal": own.P_plus[:, 0, 0], "white noise assumed: claimed": found.actual.claimed.P_plus[:, 0, 0], "white noise assumed: true": found.actual.P_plus[:, 0, 0]},
                         xlabel=TIME, ylabel="variance of x1, m²", points={"ensemble": (found.statistics.t, found.statistics.rms[:, 0] ** 2)})
    r.figure("white", figure, "What the filter for white noise claims and what it has, and the optimal one; dots: the ensemble of the former.")
