r"""Lab 25. Sampled minimum variance: what the period costs.

Source: Åström & Wittenmark 1997, chapter 11. For ẋ = u + w with an input held for a period the sheet asks
for the exact sampled cost, the regulator of least variance, the price of two naive designs, the cost with a weighted
input, a noisy sensor and a delay, the autopilot of lab 13 with a regulator, and an experiment.

Expected answer: the weights h, h²/2, h³/3 and qh²/2; Lh = (3 + √3)/(2 + √3), J = qh(3 + √3)/6; without the cross term
or at the samples only J is 19 % or 6 % larger. J = q√(ρ + h²/12) + √(qR_c + q²h²/4) + qτ in general. The autopilot's
regulator is useless near periods of 57.4 s, half the period of its oscillation.
"""

import math

import numpy as np
from ctlabs.tasks._task25_autopilot import autopilot, part_e
from ctlabs.tasks._task25_experiment import part_f, plan
from ctlabs.tasks._task25_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task25 as by_hand
from pydantic import field_validator

from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, Cost, discretise
from ctlabs.regulation import lqr, periods, regulator, sample
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task25",
    "title": "Sampled minimum variance: what the period costs",
    "source": "Åström & Wittenmark 1997, chapter 11",
    "parts": ["a", "b", "c", "d", "e", "f"],
    "extension": True,
}


#: Longer delays, in periods, and longer periods of the autopilot, s, are refused.
LATEST, SLOWEST = 20, 300


class Parameters(LabParameters):
    """What may be changed."""

    Q: Positive = given(1.0, unit="m²/s", meaning="strength of the noise w of the integrator", symbol="q", draw=span(0.5, 3, 0.1))
    dt: Positive = given(0.5, unit="s", meaning="period", symbol="h", draw=span(0.2, 2, 0.1))
    Qu: Variance = given(0.1, unit="s²", meaning="weight of the input, part (d)", symbol=r"\rho", draw=span(0.05, 0.5, 0.05))
    Rc: Variance = given(0.2, unit="m²·s", meaning="strength of the measurement noise, part (d)", symbol="R_c", draw=span(0.1, 1, 0.1))
    tau: Variance = given(0.25, unit="s", meaning="delay between a measurement and its answer, part (d)", symbol=r"\tau", draw=span(0.05, 0.3, 0.05))
    N_c: Positive = given(1296.0, unit="m²·s", meaning="strength of the noise of the command, part (e)", draw=one_of(*(k**2 for k in range(24, 50, 2))))
    N_m: Positive = given(6561.0, unit="m²·s", meaning="strength of the noise of the measured altitude, part (e)", draw=one_of(*(k**2 for k in range(63, 100, 3))))
    Qu_a: Positive = given(1.0, unit="1", meaning="weight of the correction of the command, part (e)", symbol=r"\rho_a", draw=one_of(0.25, 0.5, 1, 2, 4))
    dt_a: Positive = given(10.0, unit="s", meaning="period of the autopilot's regulator, part (e)", symbol="h_a", draw=one_of(4, 5, 6, 8, 10, 12))


    @field_validator("tau")
    @classmethod
    def _soon(cls, value, info):
        """Each period of delay makes a state of its own."""
        if value > (most := LATEST * info.data.get("dt", math.inf)):
            raise ValueError(f"expected at most {LATEST} periods ({most:.15g} s), received {value:.15g}")
        return value

    @field_validator("dt_a")
    @classmethod
    def _fast(cls, value):
        """Beyond, nothing is regulated."""
        if value > SLOWEST:
            raise ValueError(f"expected at most {SLOWEST} s, received {value:.15g}")
        return value


def integrator(p):
    """ẋ = u + w, measured in noise of strength R_c."""
    return ContinuousModel(F=[[0]], B=[[1]], G=[[1]], Q=[[p.Q]], H=[[1]], Rc=[[p.Rc]], P0=[[p.Q * p.dt]], states=["x"], measurements=["z"], units=["m"])


def designs(p, walk):
    """The three regulators of a state that is measured exactly, and the exact sampled cost."""
    model, cost = sample(walk, Cost([[1]], [[0]]), p.dt, R=[[0]])
    return {
        "least variance": regulator(model, cost),
        "samples only": regulator(model, Cost([[p.dt]], [[0]])),
        "no cross term": regulator(model, Cost(cost.Qx, cost.Qu)),
    }, model, cost


def part_a(r, p, answer, model, cost):
    """The sampled cost."""
    r.section("a", "The plant and its cost, sampled")
    r.says("Within a period $x(kh + s) = x_k + su_k + \\beta(s)$, where β is the Wiener process of the noise since the sample, $E\\beta^2(s) = qs$. At the end of the period")
    r.math(r"x_{k+1} = x_k + hu_k + w_k, \qquad E w_k^2 = qh", "model")
    r.says("The cost of the period is the integral of $E(x_k + su_k)^2 + E\\beta^2(s)$ over $s$, for β does not correlate with what was known at its beginning:")
    r.math(r"\int_0^h E x^2\,ds = E\begin{bmatrix}x_k & u_k\end{bmatrix}\begin{bmatrix}h & h^2/2\\ h^2/2 & h^3/3\end{bmatrix}\begin{bmatrix}x_k\\ u_k\end{bmatrix} + c, \qquad c = \int_0^h qs\,ds = \frac{qh^2}2", "weights")
    r.math(r"\frac ch = \frac{qh}2", "constant")
    r.says("There are a cross term and a weight of the input, although the continuous cost has neither: what the input does within the period counts ({ref:astrom_wittenmark, chapter 11}). The last term, {eq:constant} per second, no regulator influences.")
    found = np.block([[cost.Qx, cost.N], [cost.N.T, cost.Qu]])
    r.value("sampled_weights", found, agrees=answer, routes=("doubling", "integral by hand"), kind=EXACT)
    r.value("cost_between", cost.constant, "m²·s", symbol="c", agrees=answer, routes=("doubling", "integral by hand"), kind=EXACT)
    r.check("variance of w", model.Qd[0, 0], p.Q * p.dt, ("discretisation", "integral by hand"), EXACT)
    r.says("Here the weights of $x_k^2$, $2x_ku_k$ and $u_k^2$ are {xx} s, {xu} s² and {uu:4} s³, and $c = {c}$ m²·s.", xx=p.dt, xu=p.dt**2 / 2, uu=p.dt**3 / 3, c=answer["cost_between"])


def part_b(r, p, answer, found):
    """Least variance."""
    r.section("b", "The regulator of least variance")
    r.says("Let $S = sh$. With the weights of {eq:weights} the square of the regulator's equation is completed by the gain $L = (S + h/2)/(Sh + h^2/3)$, and what must remain is $S$ again:")
    r.math(r"\frac{(S + h/2)^2h^2}{Sh^2 + h^3/3} = h \quad\Longrightarrow\quad \left(s + \tfrac12\right)^2 = s + \tfrac13 \quad\Longrightarrow\quad s = \frac1{2\sqrt3}", "root")
    r.math(r"Lh = \frac{s + 1/2}{s + 1/3} = \frac{3 + \sqrt3}{2 + \sqrt3}, \qquad 1 - Lh = -(2 - \sqrt3), \qquad J = qS + \frac{qh}2 = \frac{3 + \sqrt3}6\,qh", "minimum")
    least = found["least variance"]
    routes = ("Riccati equation", "closed form")
    r.value("gain_times_period", least.L[0, 0] * p.dt, symbol="Lh", agrees=answer, routes=routes, kind=EXACT)
    r.value("feedback_gain", least.L[0, 0], "1/s", symbol="L", agrees=answer, routes=routes, kind=EXACT)
    r.value("regulator_pole", float(least.feedback.poles[0].real), symbol="1 - Lh", agrees=answer, routes=("eigenvalue", "closed form"))
    r.value("cost_minimum", least.cost.value / p.dt, "m²", symbol="J", agrees=answer, routes=("separation", "closed form"), kind=EXACT)
    r.check("least cost", least.cost.closed_loop / p.dt, answer["cost_minimum"], ("covariances of the closed loop", "closed form"))
    r.says("The gain is larger than $1/h$, which would bring the state to zero at the next sample: the best regulator moves it **beyond** zero, by {beyond:3} of its value, because a straight line from $x$ to $-0.268x$ has a smaller mean square than one from $x$ to zero. So the pole is negative. The cost is {J:4} m², in proportion to $h$ and $q$: no regulator with this period holds the integrator better.",
           beyond=2 - math.sqrt(3), J=answer["cost_minimum"])


def true_cost(found, cost, h):
    """The cost per second of a sampled loop under the exact weights."""
    P = found.closed.steady().joint.P
    own = P[np.ix_([0, -1], [0, -1])]
    W = np.block([[cost.Qx, cost.N], [cost.N.T, cost.Qu]])
    return float((W * own).sum() + cost.constant) / h


def part_c(r, p, answer, found, cost):
    """Naive designs."""
    r.section("c", "What naive sampling costs")
    r.says("For any gain $g = Lh$ the state at the samples has the variance $qh/[g(2 - g)]$, since $x_{k+1} = (1 - g)x_k + w_k$, and between them it is")
    r.math(r"\frac{E x^2(kh + s)}{qh} = \frac{(1 - gs/h)^2}{g(2 - g)} + \frac sh, \qquad \frac J{qh} = \frac{1 - g + g^2/3}{g(2 - g)} + \frac12", "gains")
    r.items([
        "**The samples only.** The sum of $hx_k^2$ is least if each input cancels the last sample, $g = 1$: all that is left at a sample is the noise of one period. But between the samples the state is what it is, and $J = \\frac56qh$.",
        "**Without the cross term.** With the weights $h$ and $h^3/3$ alone $s^2 - s = \\frac13$ and $g = s/(s + \\frac13)$: the input seems to cost something and to bring nothing until the next sample, so the gain is too small.",
    ])
    naive = [found["samples only"], found["no cross term"]]
    h = p.dt
    r.value("gains_naive", [each.L[0, 0] for each in naive], "1/s", symbol="L", agrees=answer, routes=("Riccati equation", "closed form"))
    r.value("costs_naive", [true_cost(each, cost, h) for each in naive], "m²", symbol="J", agrees=answer, routes=("covariances of the closed loop", "closed form"))
    r.value("costs_believed", [naive[0].cost.value / h, (naive[1].cost.value + cost.constant) / h], "m²", agrees=answer, routes=("Riccati equation", "closed form"))
    best, J, believed = answer["cost_minimum"], answer["costs_naive"], answer["costs_believed"]
    r.table("naive", ["design", "gain times period", "J, m²", "more than the least, %", "believed, m²"], [
        ["least variance", by_hand.GAIN, best, 0, best],
        ["samples only", 1, J[0], 100 * (J[0] / best - 1), believed[0]],
        ["no cross term", by_hand.NO_CROSS_TERM, J[1], 100 * (J[1] / best - 1), believed[1]],
    ], "Three regulators of one plant, and what the naive ones believe they cost.")
    r.says("{tab:naive} has the numbers. Neither naive design knows its cost: one counts the samples only, the other leaves out that its input also works between them. The percentages do not depend on $h$ and $q$.")
    figures(r, p, answer)


def figures(r, p, answer):
    """Between the samples, and against the gain."""
    gains = {"least variance": (by_hand.GAIN, "blue"), "samples only": (1.0, "orange"), "no cross term": (by_hand.NO_CROSS_TERM, "green")}
    s = np.linspace(0, 1, 41)
    h, unit = p.dt, p.Q * p.dt
    curves = []
    for name, (g, colour) in gains.items():
        one = unit * by_hand.between(g, s)
        curves.append(Curve(name, np.concatenate([h * (k + s) for k in range(3)]), np.tile(one, 3), colour))
    r.figure("between", Drawing("Between", "time since a sample, s", (Panel("variance of x, m²", tuple(curves), kind="count"),)),
             "The variance of the state over three periods. The design for the samples has the least variance at the samples, the best one the least on average.")
    for name, found in (("least variance", by_hand.GAIN), ("samples only", 1.0), ("no cross term", by_hand.NO_CROSS_TERM)):
        simpson = (by_hand.between(found, 0) + 4 * by_hand.between(found, 0.5) + by_hand.between(found, 1)) / 6
        r.check(text("mean over a period, {name}", name=name), simpson, by_hand.cost_of_gain(found), ("Simpson's rule, exact for a parabola", "closed form"), EXACT)
    g = np.linspace(0.3, 1.8, 151)
    points = [Curve(name, [x], [unit * by_hand.cost_of_gain(x)], colour, "points", size=6.0) for name, (x, colour) in gains.items()]
    r.figure("gain", Drawing("Gain", "gain times period Lh", (Panel("cost J, m²", (Curve("cost of the gain", g, unit * by_hand.cost_of_gain(g), "black"), *points), kind="count"),)),
             "Cost against the gain. The minimum lies beyond the gain 1, with which the state would return to zero at the next sample.")
    r.says("In {fig:between} each design begins a period with the variance at the sample; the input first lowers the variance, and the noise raises it again. In {fig:gain} the minimum is flat: the design for the samples loses {one:2} %, that without the cross term {other:2} %.",
           one=100 * (answer["costs_naive"][0] / answer["cost_minimum"] - 1), other=100 * (answer["costs_naive"][1] / answer["cost_minimum"] - 1))


def part_d(r, p, answer, walk):
    """Weight, noise, delay."""
    r.section("d", "A weight of the input, a noisy sensor, a delay")
    r.says("With $\\rho u^2$ in the cost the weight of $u_k^2$ is $h^3/3 + \\rho h$. The equation of (b) becomes")
    r.math(r"\left(Sh + \frac{h^2}2\right)^2 = h\left(Sh^2 + \frac{h^3}3 + \rho h\right) \quad\Longrightarrow\quad S = \sqrt{\rho + \frac{h^2}{12}}, \qquad L = \frac{S + h/2}{Sh + h^2/3 + \rho}", "weighed")
    r.says("in which the mixed terms have cancelled. The filter's equation $(P^+)^2 + qhP^+ = qR_c$ has the root $P^+ = \\sqrt{qR_c + q^2h^2/4} - qh/2$. By the separation theorem (lab 24) an error of variance $P$ at the moment when the input begins to act costs $L^2W\\,P/h$ per second, and by the equation of $S$ the factor $L^2W$ is $h$: it costs just $P$. At that moment the last measurement is τ seconds old and $P = P^+ + q\\tau$. With {eq:constant},")
    r.math(r"J = q\sqrt{\rho + \frac{h^2}{12}} + \sqrt{qR_c + \frac{q^2h^2}4} + q\tau", "whole")
    r.says("which holds for every $h$ and every τ, also beyond a period. The first root is what the disturbance costs although the state is known at the samples, the second what the sensor and the noise since the last sample cost. The weight of the input and the noise of the sensor enter alike, as regulator and filter are dual; so does the period.")
    cost, R = Cost([[1]], [[p.Qu]]), [[p.Rc / p.dt]]
    here = regulator(walk, cost, dt=p.dt, R=R)
    routes = ("separation", "closed form")
    r.value("weighed_gain", here.L[0, 0], "1/s", symbol="L", agrees=answer, routes=("Riccati equation", "closed form"))
    r.value("cost_disturbance", here.cost.regulation, "m²", agrees=answer, routes=routes)
    r.value("cost_sensor", here.cost.estimation + here.cost.between, "m²", agrees=answer, routes=routes)
    late = regulator(walk, cost, dt=p.dt, R=R, delay=p.tau)
    r.value("cost_delay", late.cost.value - here.cost.value, "m²")
    r.check("cost of the delay", late.cost.value - here.cost.value, answer["cost_delay"], routes, scale=answer["cost_sampled"])
    r.value("cost_sampled", late.cost.value, "m²", symbol="J", agrees=answer, routes=routes)
    for route in ("closed loop", "innovations"):
        r.check("cost with noise and delay", late.cost.routes[route], answer["cost_sampled"], (route, "closed form"))
    _filter(r, p, walk)
    limits(r, p, answer, walk, cost)
    against_period(r, p, answer)


def _filter(r, p, walk):
    """The filter's recursion."""
    steps, sampled = 10, discretise(walk, p.dt, R=[[p.Rc / p.dt]])
    r.check("variance of the filter, ten samples", covariances(sampled, steps).P_plus[:, 0, 0], by_hand.variances(p.Q * p.dt, p.Rc / p.dt, p.Q * p.dt, steps), ("recursion", "power of the step's matrix"), scale=p.Q * p.dt)
    r.check("gain of the filter, ten samples", covariances(sampled, steps).K[1:, 0, 0], [P * p.dt / p.Rc if p.Rc else 1.0 for P in by_hand.variances(p.Q * p.dt, p.Rc / p.dt, p.Q * p.dt, steps)[1:]], ("recursion", "power of the step's matrix"))


def limits(r, p, answer, walk, cost):
    """Continuous time, and the period of a tenth."""
    limit = answer["cost_continuous"]
    found = limit if not p.Qu else regulator(walk, cost).cost.value if p.Rc else lqr(walk, cost).S[0, 0] * p.Q
    r.value("cost_continuous", found, "m²", symbol=r"J(h \to 0)")
    if p.Qu:
        r.check("cost of the continuous regulator", found, limit, ("Kalman–Bucy filter and continuous feedback", "limit of the closed form"))
    some = p.dt * np.array([0.5, 2.0, 10.0])
    r.check("cost at three periods", periods(walk, cost, some).cost, [sum(by_hand.parts(p, h)) for h in some], ("separation", "closed form"))
    tenth = answer["period_of_a_tenth"]
    r.value("period_of_a_tenth", tenth, "s", symbol="h_{10}", reason="" if tenth else "the limit is 0: any period costs infinitely more")
    if tenth:
        r.check("cost at the period of a tenth", regulator(walk, cost, dt=tenth, R=[[p.Rc / tenth]]).cost.value, 1.1 * limit, ("separation", "1.1 times the continuous limit"))
        r.says("Without delay the cost tends to that of the continuous regulator, {limit:4} m². It stays within a tenth of it up to the period {tenth:3} s. Where neither ρ nor $R_c$ is zero the excess of a short period is in proportion to $h^2$: sampling twice as fast leaves a quarter of it.", limit=limit, tenth=tenth)
    else:
        r.says("Without delay the cost tends to 0 in proportion to the period: a regulator with a free input and a perfect sensor could hold the state as well as it is fast.")


def against_period(r, p, answer):
    """J against h."""
    top = answer["period_of_a_tenth"] or p.dt
    h = np.geomspace(1e-2 * min(top, p.dt), 30 * max(top, p.dt), 161)
    both = np.array([by_hand.parts(p, each) for each in h])
    curves = (
        Curve("J without delay", h, both.sum(axis=1), "black"), Curve("disturbance and weight of the input", h, both[:, 0], "blue", "dash"),
        Curve("sensor and the noise since the sample", h, both[:, 1], "orange", "dash"),
        Curve("the given h", [p.dt], [sum(by_hand.parts(p, p.dt))], "black", "points", size=5.0),
    )
    levels = (Mark("continuous", answer["cost_continuous"], style="dot"),) if answer["cost_continuous"] else ()
    r.figure("periods", Drawing("Periods", "period h, s", (Panel("cost J, m²", curves, kind="log", levels=levels),), log=True),
             "Cost of the best regulator against its period, and its two roots. A delay would raise the whole curve by qτ.")
    r.says("{fig:periods} shows both roots of {eq:whole}. Long periods cost $qh(3 + \\sqrt{3})/6$, whatever the sensor and the weight: then only the noise between the samples counts.")


PARTS = Skeleton(
    result=result,
    key="periods",
    analysis=(part_a, part_b, part_c, part_d, part_e),
    plan=plan,
    experiment=(part_f,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    walk = integrator(p)
    found, model, cost = designs(p, walk)
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), walk=walk, found=found, model=model, cost=cost, aircraft=autopilot(p))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
