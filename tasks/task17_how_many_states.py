r"""Lab 17. How many states? Two Wiener processes of which only the sum is measured.

Source: Semushin & Tsyganova 2001, task 17. The model is given by a figure, which is lost. It is read as x1' = w1,
x2' = w2, x3 = x1 + x2, z = x3 + v with independent w1, w2, v, x1(0), x2(0) of zero mean and strengths q1, q2, R,
variances P01, P02. The sheet asks for the optimal estimate of x3 ("how many states are needed?"), its limit for
t → ∞, the discrete filter, an experiment, and whether a steady state is reached.

Expected answer: one state, x3' = w with Q = q1 + q2 and P0 = P01 + P02. Then P' = Q − P²/R, P∞ = √(QR) = 2,
K = √(Q/R) = 1, x̂3/z = 1/(s + 1); with Q_d = Q dt, R_d = R/dt a steady state is reached. With the two states x1, x2
the model has rank 1 and is not detectable: P11 grows like q1q2 t/(q1+q2), while P11 + 2P12 + P22 is P exactly.
"""

import math

import numpy as np
from ctlabs.tasks import task16_wiener_process as lab16
from ctlabs.tasks._task17_trap import TIME, scale, trap
from ctlabs.tasks._task17_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task17 as by_hand
from ctlabs.tasks.answers.task17 import SUM, TIMES

from ctlabs.filtering import bucy, settling, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Variance, given
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task17",
    "title": "How many states? Two Wiener processes, one measurement of their sum",
    "source": "Semushin & Tsyganova 2001, task 17",
    "parts": ["a", "b"],
}


class Parameters(LabParameters):
    """What may be changed."""

    q1: Variance = given(1.0, unit="m²/s", meaning="strength of the noise w1", draw=span(0.5, 3, 0.25))
    q2: Variance = given(1.0, unit="m²/s", meaning="strength of the noise w2", draw=span(0.5, 3, 0.25))
    R: Positive = given(2.0, unit="m²·s", meaning="strength of the measurement noise v", draw=span(1, 6, 0.25))
    P01: Variance = given(1.0, unit="m²", meaning="variance of x1(0)", draw=span(0.5, 4, 0.5))
    P02: Variance = given(2.0, unit="m²", meaning="variance of x2(0)", draw=span(0.5, 4, 0.5))
    dt: Positive = given(1.0, unit="s", meaning="period of the discrete measurements", symbol="dt", draw=one_of(0.5, 1, 1.5, 2))


def model(p):
    """x3' = w, z = x3 + v."""
    return ContinuousModel(F=[[0]], G=[[1]], Q=[[p.q1 + p.q2]], H=[[1]], Rc=[[p.R]], P0=[[p.P01 + p.P02]],
                           states=["x3"], measurements=["z"], units=["m"])


def unreduced(p):
    """The same with the states x1, x2."""
    return ContinuousModel(F=np.zeros((2, 2)), G=np.eye(2), Q=np.diag([p.q1, p.q2]), H=SUM, Rc=[[p.R]],
                           P0=np.diag([p.P01, p.P02]), states=["x1", "x2"], measurements=["z"], units=["m", "m"])


def readings(p):
    """The other readings of the figure: words, model, and x3 as a combination of its states."""
    noise = np.diag([p.q1, p.q2])
    return [
        ("blocks 1/(s+1) in place of both 1/s", ContinuousModel(F=[[-1]], G=[[1, 1]], Q=noise, H=[[1]], Rc=[[p.R]], P0=[[p.P01 + p.P02]], states=["x3"]), [1.0]),
        ("blocks 1/(s+1) and 1/(s+2)", ContinuousModel(F=np.diag([-1, -2]), G=np.eye(2), Q=noise, H=SUM, Rc=[[p.R]], P0=np.diag([p.P01, p.P02])), SUM[0]),
        ("blocks 1/s, and an integrator after the sum", ContinuousModel(F=[[0, 1], [0, 0]], G=[[0, 0], [1, 1]], Q=noise, H=[[1, 0]], Rc=[[p.R]], P0=np.diag([0, p.P01 + p.P02]), states=["x3", "x1+x2"]), [1.0, 0.0]),
    ]


def part_a(r, p, answer, system):
    """One state, its continuous filter and the limit."""
    r.section("a", "The number of states, the continuous filter and its limit")
    r.says("**The reading.** The sheet describes the system by a figure that is lost. The text names $x_1(0)$, $x_2(0)$, two noises and the output $x_3$; the simplest figure with these names is taken, {fig:diagram}: two integrators whose outputs are added. Other readings follow in {tab:readings}, with their numbers.")
    nodes = {
        "w1": Node((0, 1), "$w_1$", "signal"), "I1": Node((1.4, 1), r"$\dfrac{1}{s}$"), "w2": Node((0, 0), "$w_2$", "signal"),
        "I2": Node((1.4, 0), r"$\dfrac{1}{s}$"), "+": Node((3.0, 1), "", "sum"), "v": Node((4.8, 0.2), "$v$", "signal"), "m": Node((4.8, 1), "", "sum"), "z": Node((6.0, 1), "$z(t)$", "signal"),
    }
    arrows = [Arrow("w1", "I1"), Arrow("w2", "I2"), Arrow("I1", "+", "$x_1$", "+"), Arrow("I2", "+", "$x_2$", "+"), Arrow("+", "m", "$x_3(t)$", "+"), Arrow("v", "m", "", "+"), Arrow("m", "z")]
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The reading taken: $x_3 = x_1 + x_2$ is estimated from $z = x_3 + v$.")
    r.says("**One state.** Differentiate $x_3 = x_1 + x_2$:")
    r.math(r"\dot x_3 = w_1 + w_2 = w, \qquad E[w(t)w(t+\tau)] = (q_1 + q_2)\,\delta(\tau), \qquad E[x_3^2(0)] = P_{01} + P_{02}", "one")
    r.says("$w_1$ and $w_2$ are independent, so $w$ is white; it is independent of $x_3(0)$ and $v$. The past of $x_3$ therefore tells of its future only by its present value, and neither $z$ nor the quantity wanted contains $x_1$ or $x_2$ alone. One state describes the system, with $Q = q_1 + q_2 = {Q}$ m²/s and $P_0 = P_{01} + P_{02} = {P0}$ m². ∎",
           Q=p.q1 + p.q2, P0=p.P01 + p.P02)
    r.model(system)
    r.value("states_required", observability.analyse(unreduced(p)).rank, symbol="n", agrees=answer, routes=("staircase of the two-state model", "rank of the Hankel matrix of w → z"), kind=EXACT)
    r.says("The second route of the check is the order of the transfer function from $(w_1, w_2)$ to $z$, which is $(1/s, 1/s)$: both inputs act through the same pole.")
    r.says("**The filter**, with $\\hat{x}_3(0) = 0$ and $P(0) = P_0$, is that of a Wiener process (lab 16; {ref:kalman_bucy}):")
    r.math(r"\dot{\hat x}_3 = K\,(z - \hat x_3), \qquad K(t) = \frac{P(t)}{R}, \qquad \dot P = q_1 + q_2 - \frac{P^2}{R}", "filter")
    limit, routes = bucy.steady(system), ("Riccati equation", "closed form")
    invariant = bool(limit.poles[0].real < 0)
    if invariant:
        r.math(r"P(t) = P_\infty\,\frac{P_0 + P_\infty\tanh\kappa t}{P_\infty + P_0\tanh\kappa t}, \qquad P_\infty = \sqrt{(q_1+q_2)R}, \quad \kappa = \sqrt{\frac{q_1+q_2}{R}}")
        r.says("**The limit.** $\\tanh\\kappa t \\to 1$, hence $P(t) \\to P_\\infty$ and $K(t) \\to \\kappa$ for every $P_0$. The filter for $t \\to \\infty$ is")
        r.math(r"\dot{\hat x}_3 = \kappa\,(z - \hat x_3), \qquad \frac{\hat x_3(s)}{z(s)} = \frac{\kappa}{s + \kappa}", "limit")
    else:
        r.says("Without process noise $1/P(t) = 1/P_0 + t/R$: variance and gain tend to zero, and for $t \\to \\infty$ the filter takes no notice of the measurements.")
    r.value("variance_steady_continuous", limit.P[0, 0], "m²", symbol=r"P_\infty", agrees=answer, routes=routes)
    r.value("gain_steady_continuous", limit.K[0, 0], "1/s", symbol=r"K_\infty", agrees=answer, routes=routes)
    num, den = bucy.transfer_function(system)
    r.value("filter_transfer_function", [num, den])
    for name, found, expected in zip(("numerator", "denominator"), (num, den), answer["filter_transfer_function"], strict=True):
        r.check(text("transfer function, {part}", part=name), found, expected, routes)
    routes = ("Riccati equation, integrated", "closed form")
    r.value("variance_continuous", bucy.transient(system, TIMES).P[:, 0, 0], "m²", at=TIMES, agrees=answer, routes=routes)
    if invariant:
        r.says("Here $P_\\infty = {P}$ m², $\\kappa = {K}$ 1/s: a low-pass with the time constant {tau} s.", P=limit.P[0, 0], K=limit.K[0, 0], tau=1 / answer["gain_steady_continuous"])


def figure_lost(r, p, answer):
    """Other readings of the figure."""
    r.says("**Other readings of the figure.** With blocks $1/(s+1)$ in both branches one state suffices again, since the poles are equal; with different poles, or an integrator after the sum, two are needed. The error variance of $x_3$ in the limit is then, in this order (the second for $1/(s+1)$ and $1/(s+2)$),")
    r.math(r"R\Bigl(\sqrt{1+\tfrac{q_1+q_2}{R}}-1\Bigr), \qquad R\Bigl(\sqrt{5+\tfrac{q_1+q_2}{R}+2\sqrt{4+\tfrac{4q_1+q_2}{R}}}-3\Bigr), \qquad \sqrt2\,R\Bigl(\tfrac{q_1+q_2}{R}\Bigr)^{1/4}")
    r.says("These come from the spectra alone: $P_\\infty$ is $R$ times the sum of the poles of the filter less that of the plant, taken positive, where the poles of the filter are the stable zeros of $1 + S_{x_3}(s)/R$.")
    cases = readings(p)
    found = [bucy.steady(case).P for _name, case, _c in cases]
    limits = [float(np.array(c) @ P @ np.array(c)) for P, (_name, _case, c) in zip(found, cases, strict=True)]
    r.check("limits of the other readings", limits, answer["other_readings"], ("Riccati equation", "spectral factorisation"))
    rows = [("two integrators, added (taken)", 1, answer["variance_steady_continuous"], answer["gain_steady_continuous"])]
    rows += [(name, case.n, limit, limit / p.R) for (name, case, _c), limit in zip(cases, limits, strict=True)]
    r.table("readings", ["reading", "states", "$P_\\infty$, m²", "gain of $x_3$, 1/s"], rows, "The same question for other readings of the lost figure.")


def part_b(r, p, answer, system, double):
    """The discrete filter and its steady state."""
    r.section("b", "The discrete filter; is a steady state reached?")
    sampled, Q = discretise(system, p.dt), p.q1 + p.q2
    r.says("Over a period $x_3$ changes by the integral of $w$; a measurement equivalent to the continuous one over a period has the variance $R/dt$ (lab 16 says what is left out):")
    r.math(r"x_3(t_{i+1}) = x_3(t_i) + w_d(t_i), \quad z(t_i) = x_3(t_i) + v_d(t_i), \qquad Q_d = (q_1+q_2)\,dt, \quad R_d = \frac R{dt}")
    r.model(sampled)
    r.check("Q_d", sampled.Qd, [[Q * p.dt]], ("integral of ΦGQGᵀΦᵀ", "by hand"), EXACT)
    r.check("R_d", sampled.R, [[p.R / p.dt]], ("model", "by hand"), EXACT)
    r.math(r"\hat x_3(t_i^-) = \hat x_3(t_{i-1}^+), \quad P(t_i^-) = P(t_{i-1}^+) + Q_d, \quad K(t_i) = \frac{P(t_i^-)}{P(t_i^-)+R_d}, \quad P(t_i^+) = K(t_i)R_d", "discrete")
    r.math(r"\hat x_3(t_i^+) = \hat x_3(t_i^-) + K(t_i)\,[z(t_i) - \hat x_3(t_i^-)], \qquad \hat x_3(t_0^+) = 0, \quad P(t_0^+) = P_{01} + P_{02}")
    r.says("In a steady state $P^-P^+ = Q_dR_d$ and $P^- - P^+ = Q_d$, hence")
    r.math(r"P^\mp = \pm\frac{Q_d}2 + \sqrt{Q_dR_d + \frac{Q_d^2}4}, \qquad K = \frac{P^+}{R_d}, \qquad 1-K = \frac{P^+}{P^-}", "steady")
    limit, routes = steady.solve(sampled), ("Riccati equation", "closed form")
    r.value("prior_variance_steady", limit.P_minus[0, 0], "m²", symbol=r"\bar P^-", agrees=answer, routes=routes)
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "m²", symbol=r"\bar P^+", agrees=answer, routes=routes)
    r.value("gain_steady", limit.K[0, 0], symbol=r"\bar K", agrees=answer, routes=routes)
    reached = bool(abs(limit.poles[0]) < 1)
    r.value("verdict_b", reached)
    step = answer["settling_step"]
    r.value("settling_step", step, reason="the limit is 0, and a variance that decays to 0 never stays within 1 % of it")
    settled(r, p, answer)
    r.says("**Is it reached?** A steady state is reached if the gain tends to a constant with which the filter is stable, that is, with its pole inside the unit circle.")
    if reached:
        r.says("Yes: $P^- = {prior}$ m², $P^+ = {posterior}$ m², $K = {gain}$, and the pole is $1 - K = {pole}$. $P^+$ is within 1 % of its limit from measurement {step} on.",
               prior=limit.P_minus[0, 0], posterior=limit.P_plus[0, 0], gain=limit.K[0, 0], pole=limit.poles[0].real, step=step)
        if answer["growth_rate_x1"]:
            r.says("For the two-state filter the answer would be no: its $P_{11}$ and $P_{22}$ have no limit, in discrete time either, although the part of it that matters is this very filter.")
        lab16.frequency(r, twin(p), system, sampled, limit)
    else:
        r.says("No: without process noise the gain tends to 0 and the pole to 1; the limit is no filter at all. {words}",
               words="Here even $x_3(0)$ is known, so the gain is 0 from the start." if not p.P01 + p.P02 else "The variance falls like 1/t for ever.")
    many = covariances(discretise(double, p.dt), 40)
    few = covariances(sampled, 40)
    size = float(np.abs(many.P_minus).max()) or 1.0
    for name, two, one in (("P⁻", many.P_minus, few.P_minus), ("P⁺", many.P_plus, few.P_plus)):
        r.check(text("{name} of the sum", name=name), two.sum(axis=(1, 2)), one[:, 0, 0], ("two-state recursion", "one-state recursion"), EXACT, scale=size)


def settled(r, p, answer):
    """The settling step, seen from both sides."""
    step, limit = answer["settling_step"], answer["posterior_variance_steady"]
    found = settling(discretise(model(p), p.dt))
    if found is not None or step is None:
        r.check("settling step", found, step, ("recursion", "closed form"), EXACT)
        return
    routes, Q, P0 = ("power of the step's matrix", "definition"), p.q1 + p.q2, p.P01 + p.P02
    outside = [abs(lab16.by_hand.posterior_variance(Q, p.R, P0, p.dt, k) / limit - 1) - lab16.by_hand.WITHIN for k in (step - 1, step)]
    r.holds("P⁺ is outside the band before the settling step, and inside from it", [outside[0], -outside[1]], routes, size=1.0)


def twin(p):
    """The parameters of lab 16 with the same single state."""
    return lab16.Parameters(Q=p.q1 + p.q2, R=p.R, P0=p.P01 + p.P02, x0_mean=0.0, dt=p.dt)


def plan(r, p, experiment):
    """Every number chosen."""
    tau = scale(p)
    steps = min(max(math.ceil(10 * tau / p.dt), 20), 300)
    fine = 600
    r.says("{tab:plan} lists what was chosen. The truth is simulated with both states, as in {fig:diagram}: $x_1$ and $x_2$ with noises of their own. The one-state filter sees only $z$. If one state did not suffice, its errors would contradict its own variance.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period dt, s", p.dt, "given"],
        ["measurements", steps, "ten time constants, but 20 at least and 300 at most"],
        ["period δ in place of continuous time, s", tau / 100, "a hundredth of the time constant; measurements of variance $R/\\delta$"],
        ["steps of length δ", fine, "six time constants"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each ensemble"],
    ], "Plan of the experiment.")
    return {"steps": steps, "fine": fine}


def experiment_b(r, p, answer, experiment, system, double, steps, fine):
    """The filters on simulated data."""
    sampled, truth = discretise(system, p.dt), discretise(double, p.dt)
    lab16.overlay(r, twin(p), answer, system, sampled)
    stats = portrait(r, experiment, sampled, steps, prefix="discrete_", figures={"ensemble": "The data are those of the one-state model."})
    r.says("**The discrete filter.** {fig:discrete_ensemble} compares the one-state filter with theory on data of its own model.")
    r.says("**One state on two-state data.** The data now come from $x_1$ and $x_2$; the error is $\\hat{x}_3 - (x_1 + x_2)$. Beside it in {tab:ensemble} are the two-state filter on the same data, and the filter with the period δ for the continuous one.")
    quick, half = discretise(double, scale(p) / 100), discretise(system, scale(p) / 100)
    rows = []
    for stream, (name, data, design, compare, count) in enumerate((
        ("one state", truth, sampled, SUM, steps),
        ("two states", truth, truth, None, steps),
        ("one state, period δ", quick, half, SUM, fine),
    )):
        own = experiment.statistics(data, design, steps=count, stream=1 + stream // 2, compare=compare)
        theory = covariances(design, count)
        agreement(r, name, own, theory.P_plus)
        rows.append((name, f"${design.states[0][0]}_{design.states[0][1]}$", theory.t[-1], theory.sd_plus[-1, 0], rms(own)))
    r.table("ensemble", ["filter", "error of", "to t, s", "σ of theory, m", "RMS error, m"], rows, "The ensembles at the last instant, with standard errors.")
    one, two = (experiment.histories(truth, design, steps=steps, stream=1) for design in (sampled, truth))
    size = float(np.abs(one.x_plus).max()) or 1.0
    r.check("x̂1 + x̂2 = x̂3, run by run", two.x_plus.sum(axis=1), one.x_plus[:, 0], ("two-state filter", "one-state filter"), scale=size)
    tracks = {"one state: $x_3$": (one.t, one.x_plus[:, 0, 0], one.sd_plus[:, 0]), "two states: $x_1$ alone": (two.t, two.x_plus[:, 0, 0], two.sd_plus[:, 0])}
    figure = plots.estimates((one.t, one.truth[:, :, 0].sum(axis=1)), tracks, xlabel=TIME, ylabel="$x_3$ and $x_1$, m", measurements=(one.t[1:], one.z[1:, 0, 0]))
    r.figure("record", figure, "One run: $x_3$, its measurements and its estimate, and the estimate of $x_1$ alone by the two-state filter.")
    r.says("In {fig:record} the estimate of $x_3$ follows its path, while the band of $x_1$ alone grows wider: nothing in the data says how the sum is shared. The sum of the two estimates of the two-state filter is the estimate of $x_3$, run by run." if answer["growth_rate_x1"] else "In {fig:record} the estimate of $x_3$ follows its path; the sum of the two estimates of the two-state filter is the estimate of $x_3$, run by run.")
    return {"measured": rms(stats, unit="m"), "sd": float(covariances(sampled, steps).sd_plus[-1, 0])}


PARTS = Skeleton(
    result=result,
    key="two_states",
    analysis=(part_a, trap, figure_lost),
    plan=plan,
    experiment=(part_b, experiment_b),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system, double = by_hand.analytic(p), model(p), unreduced(p)
    return PARTS.report(META, p, experiment, answer=answer, system=system, double=double)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
