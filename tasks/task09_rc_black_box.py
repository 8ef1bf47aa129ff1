r"""Lab 9. The RC "black box": a voltage that cannot be reached, from one that can.

Source: Semushin & Tsyganova 2001, task 9. White noise u drives a circuit of two resistors and two capacitors; the voltage
U1 on the first capacitor is to be watched, the output voltage U0 is measured every half second. The sheet asks for the
optimal estimate of U1 from discharged capacitors, the plot of its error variance over two seconds, with perfect
measurements (a) and with noise of variance R = 0.2b² (b).

Expected answer (two-section ladder, in units of b²): P⁺ has rank 1 after a perfect measurement, K = (P12⁻/P22⁻, 1);
the variance of U1 is 0.45607 before and 0.17456 after the first perfect measurement.
"""

import math
from dataclasses import replace

import mpmath
import numpy as np
from ctlabs.tasks.answers import task09 as by_hand
from ctlabs.tasks.answers.task09 import DIGITS, STRENGTH
from scipy.special import ndtr

from ctlabs.filtering import settling, steady
from ctlabs.filtering.between import between
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, shaping
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, LabParameters, Positive, VarianceOrInf, given
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.text import text

META = {
    "name": "task09",
    "title": "The RC black box: watching a voltage that cannot be measured",
    "source": "Semushin & Tsyganova 2001, task 9",
    "parts": ["a", "b"],
}

#: Parts of an interval in the plot of P(t).
POINTS = 60
#: Margins of the alarm rule, and limits, in standard deviations of the error and of the voltage.
FACTORS, LIMITS = (0, 1, 2, 3), (2, 3)
TIME = "t, s"


class Parameters(LabParameters):
    """What may be changed."""

    R1: Positive = given(1.0, unit="Ω", meaning="first resistor")
    R2: Positive = given(1.0, unit="Ω", meaning="second resistor")
    C1: Positive = given(1.0, unit="F", meaning="first capacitor")
    C2: Positive = given(1.0, unit="F", meaning="second capacitor")
    dt: Positive = given(0.5, unit="s", meaning="period of the measurements")
    steps: Count = given(4, unit="1", meaning="number of measurements")
    R_over_b2: VarianceOrInf = given(0.2, unit="1", meaning="variance of the measurement noise in part (b), over b²")


def system(p, kind="ladder"):
    """The circuit with the state (U1, U0) and the input u, in units of b."""
    one, two = 1 / (p.R1 * p.C1), 1 / (p.R2 * p.C2)
    load = 0.0 if kind == "buffered" else 1 / (p.R2 * p.C1)
    H = [[1, -1]] if kind == "across" else [[0, 1]]
    return ContinuousModel([[-one - load, load], [two, -two]], [[one], [0]], [[STRENGTH]], H, P0=np.zeros((2, 2)),
                           states=["U1", "U0"], measurements=["z"], units=["b", "b"])


def part_a(r, p, answer, perfect):
    """The model, and perfect measurements."""
    r.section("a", "Perfect measurements: the optimal estimate")
    r.says("The sheet's figure is missing. The most plausible circuit with these parts and a voltage $U_1$ on $C_1$ is a ladder of two RC sections with the output $U_0$ on $C_2$; it is taken here. What two other circuits would give stands in part II.")
    r.figure("circuit", plots.ladder([("$R_1$", "$C_1$", "$U_1$"), ("$R_2$", "$C_2$", "")], source="$u$", output="$U_0$", enclosure="black box"), "The circuit assumed: only $u$ and $U_0$ lead out of the box.")
    r.says("The currents into the two nodes give")
    r.math(r"C_1\dot U_1 = \frac{u-U_1}{R_1} - \frac{U_1-U_0}{R_2}, \qquad C_2\dot U_0 = \frac{U_1-U_0}{R_2}")
    r.math(r"F = \begin{bmatrix} -\frac1{R_1C_1}-\frac1{R_2C_1} & \frac1{R_2C_1} \\ \frac1{R_2C_2} & -\frac1{R_2C_2} \end{bmatrix}, \quad G = \begin{bmatrix} \frac1{R_1C_1} \\ 0 \end{bmatrix}, \quad Q = 2b^2, \quad H = \begin{bmatrix} 0 & 1 \end{bmatrix}, \quad P_0 = 0")
    nodes = {
        "u": Node((0, 0), "$u$", "signal"), "1": Node((1.1, 0), "", "sum"), "a": Node((2.4, 0), r"$\frac{1/R_1C_1}{s+f_1}$"),
        "b": Node((5.0, 0), r"$\frac{f_2}{s+f_2}$"), "b2": Node((6.2, 0), "", "branch"), "s": Node((7.1, 0), r"$\Delta t$", "sampler"), "2": Node((8.0, 0), "", "sum"),
        "v": Node((8.0, 0.8), "$v$", "signal"), "z": Node((8.9, 0), "$z$", "signal"), "k": Node((3.8, -1.0), "$R_1/R_2$"),
    }
    arrows = [Arrow("u", "1"), Arrow("1", "a"), Arrow("a", "b", "$U_1$"), Arrow("b", "b2"), Arrow("b2", "s", "$U_0$"), Arrow("s", "2"), Arrow("v", "2"),
              Arrow("2", "z"), Arrow("b2", "k", turn="along"), Arrow("k", "1")]
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The same as a block diagram, with $f_1 = 1/R_1C_1 + 1/R_2C_1$ and $f_2 = 1/R_2C_2$. The second section loads the first, which is the feedback; v is zero in part (a).")
    r.says("All variances below are in units of $b^2$ (V²), voltages in units of $b$. For the given parts, sampled every {dt} s:", dt=p.dt)
    r.model(perfect)
    routes = ("doubling of the short interval", "divided differences and Lyapunov's equation")
    r.value("Phi", perfect.Phi, agrees=answer, routes=routes)
    r.value("Qd", perfect.Qd, "b²", agrees=answer, routes=routes)
    r.says("**After a perfect measurement** $z = U_0$. With $h = H^T$ the update is $P^+ = P^- - P^-hh^TP^-/(h^TP^-h)$, so that $P^+h = 0$: $P^+$ has rank 1, and $U_0$ is known exactly. ∎ (The information form cannot hold it: $P^+$ has no inverse.) Written out, with $p_i = P_{11}(t_i^+)$ and $p_0 = 0$:")
    r.math(r"P_{11}^- = \Phi_{11}^2p_{i-1} + q_{11}, \quad P_{12}^- = \Phi_{11}\Phi_{21}p_{i-1} + q_{12}, \quad P_{22}^- = \Phi_{21}^2p_{i-1} + q_{22}, \qquad K = \begin{bmatrix} P_{12}^-/P_{22}^- \\ 1 \end{bmatrix}, \qquad P^+ = \begin{bmatrix} p_i & 0 \\ 0 & 0 \end{bmatrix}")
    r.math(r"p_i = P_{11}^- - \frac{(P_{12}^-)^2}{P_{22}^-} = \frac{(q_{11}\Phi_{21}^2 + q_{22}\Phi_{11}^2 - 2q_{12}\Phi_{11}\Phi_{21})\,p_{i-1} + q_{11}q_{22} - q_{12}^2}{\Phi_{21}^2\,p_{i-1} + q_{22}}")
    r.says("and the optimal estimate, which uses the last two measurements and the estimate before ($z_0 = 0$, $\\hat{U}_1(t_0) = 0$):")
    r.math(r"\hat U_1(t_i^+) = \Phi_{11}\hat U_1(t_{i-1}^+) + \Phi_{12}z_{i-1} + \frac{P_{12}^-}{P_{22}^-}\left[z_i - \Phi_{21}\hat U_1(t_{i-1}^+) - \Phi_{22}z_{i-1}\right], \qquad \hat U_0(t_i^+) = z_i")
    schedule = covariances(perfect, p.steps)
    results(r, p, answer, schedule, "perfect")
    r.check("P11⁺ after perfect measurements", schedule.P_plus[1:, 0, 0], by_hand.perfect_powers(p), ("recursion", "power of the fraction's matrix"))
    r.check("P12⁺, P22⁺ after perfect measurements", schedule.P_plus[1:, 1, :], np.zeros((p.steps, 2)), ("recursion", "proof of rank 1"), EXACT, scale=float(schedule.P_minus[1:].max()))
    limit = steady.solve(perfect)
    r.value("posterior_steady_perfect", limit.P_plus[0, 0], "b²", agrees=answer, routes=("Riccati equation", "fixed point of the fraction"))
    r.says("The limit is the fixed point of the fraction, $p = {limit}\\,b^2$: knowing $U_0$ exactly at the samples does not tell $U_1$ exactly, because the input between them is unknown.", limit=limit.P_plus[0, 0])


def results(r, p, answer, schedule, name):
    """The lists of one filter, each by the scalar equations as well, and the posterior by the dense route."""
    at, routes = schedule.t[1:], ("recursion of matrices", "scalar equations")
    r.value(f"U1_variance_prior_{name}", schedule.P_minus[1:, 0, 0], "b²", at=at, agrees=answer, routes=routes)
    r.value(f"U1_variance_posterior_{name}", schedule.P_plus[1:, 0, 0], "b²", at=at, agrees=answer, routes=routes)
    r.value(f"gain_{name}", schedule.K[1:, :, 0], at=at, agrees=answer, routes=routes)
    together = by_hand.dense(p, 0.0 if name == "perfect" else p.R_over_b2)
    r.check(text("variance of U1, {name}", name=name), schedule.P_plus[1 : len(together) + 1, 0, 0], together, ("recursion", "joint Gaussian distribution"))


def part_b(r, p, answer, noisy):
    """Noisy measurements."""
    r.section("b", "Noisy measurements")
    r.says("Now $z_i = U_0(t_i) + v_i$ with the variance $R = {R}\\,b^2$. The innovation has the variance $S = P_{22}^- + R$, and", R=p.R_over_b2)
    r.math(r"P_{11}^- = \Phi_{11}^2P_{11}^+ + 2\Phi_{11}\Phi_{12}P_{12}^+ + \Phi_{12}^2P_{22}^+ + q_{11}, \qquad P_{22}^- = \Phi_{21}^2P_{11}^+ + 2\Phi_{21}\Phi_{22}P_{12}^+ + \Phi_{22}^2P_{22}^+ + q_{22}")
    r.math(r"P_{12}^- = \Phi_{11}\Phi_{21}P_{11}^+ + (\Phi_{11}\Phi_{22}+\Phi_{12}\Phi_{21})P_{12}^+ + \Phi_{12}\Phi_{22}P_{22}^+ + q_{12}, \qquad K = \begin{bmatrix} P_{12}^-/S \\ P_{22}^-/S \end{bmatrix}")
    r.math(r"P_{11}^+ = P_{11}^- - \frac{(P_{12}^-)^2}S, \qquad P_{12}^+ = \frac RS P_{12}^-, \qquad P_{22}^+ = \frac RS P_{22}^-")
    r.math(r"\hat U_1^- = \Phi_{11}\hat U_1^+ + \Phi_{12}\hat U_0^+, \quad \hat U_0^- = \Phi_{21}\hat U_1^+ + \Phi_{22}\hat U_0^+, \qquad \hat U_1^+ = \hat U_1^- + \frac{P_{12}^-}S(z-\hat U_0^-), \quad \hat U_0^+ = \hat U_0^- + \frac{P_{22}^-}S(z-\hat U_0^-)")
    r.says("With $R = 0$ these are the equations of part (a).")
    if p.R_over_b2 == 0:
        r.says("Here $R = 0$ is given, so part (b) repeats part (a).")
    elif math.isinf(p.R_over_b2):
        r.says("Here $R = \\infty$ is given: nothing is measured, the gain is 0, and the estimate stays 0.")
    results(r, p, answer, covariances(noisy, p.steps), "noisy")


def plan(r, p, experiment, filters):
    """Every number chosen."""
    settled = max(settling(filters[name]) or 1 for name in ("perfect", "noisy"))
    steps = max(p.steps, min(100, 2 * settled))
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in the plot", p.steps, text("{seconds} s, one every {dt} s", seconds=p.steps * p.dt, dt=p.dt)],
        ["points of P(t) in an interval", POINTS, "a smooth curve"],
        ["measurements simulated", steps, text("at least twice the settling time ({settled} measurements), up to 100", settled=settled)],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same circuit and input for both filters"],
        ["start", 0, "discharged capacitors, both known to be 0"],
    ], "Plan of the experiment. b = 1 V is chosen for the simulation; all results scale with b.")
    return {"steps": steps}


def plot(r, p, answer, box, filters):
    """The plot of the sheet."""
    schedules = {name: covariances(model, p.steps) for name, model in filters.items()}
    curves = {name: between(box, schedule, POINTS) for name, schedule in schedules.items()}
    labels = {"unmeasured": "no measurements", "noisy": text("(b) R = {R} b²", R=p.R_over_b2), "perfect": "(a) R = 0"}
    figure = plots.transient(curves["perfect"].t, {label: curves[name].P[:, 0, 0] for name, label in labels.items()}, ylabel="error variance of $U_1$, b²")
    r.figure("variance", figure, "Variance of the error of $\\hat{U}_1$ over time, in units of b². Between measurements it returns towards the variance without measurements; each measurement lowers it at once.")
    r.value("U1_variance_unmeasured", schedules["unmeasured"].P_minus[1:, 0, 0], "b²", at=schedules["noisy"].t[1:], agrees=answer, routes=("recursion", "closed form"))
    for name in ("perfect", "noisy"):
        half = curves[name].P[:-1, 0, 0].reshape(p.steps, POINTS + 1)[:, POINTS // 2]
        r.check(text("variance of U1 in the middle of the intervals, {name}", name=name), half, answer[f"middle_{name}"], ("doubling of the short interval", "closed form"))
    rows = [(schedules["noisy"].t[i], schedules["unmeasured"].P_minus[i, 0, 0], *(x for name in ("perfect", "noisy") for s in [schedules[name]] for x in (s.P_minus[i, 0, 0], s.P_plus[i, 0, 0], s.K[i, 0, 0]))) for i in range(1, p.steps + 1)]
    r.table("variance", [TIME, "no measurements", "(a) before", "(a) after", "(a) K1", "(b) before", "(b) after", "(b) K1"], rows,
            "Error variance of U1 at the measurements, in units of b², and the gain for it.")
    r.holds("a noisy measurement is worth less than a perfect one, and more than none",
            np.minimum(schedules["noisy"].P_plus - schedules["perfect"].P_plus, schedules["unmeasured"].P_plus - schedules["noisy"].P_plus)[:, 0, 0],
            ("recursion with R", "recursions with R = 0 and R = ∞"), size=float(schedules["unmeasured"].P_minus[-1, 0, 0]))


def other_circuits(r, p):
    """What two other readings of the missing figure would give."""
    r.says("**Other circuits.** If an amplifier of unit gain stood between the sections (a buffered cascade), $F = [[-1/R_1C_1, 0], [1/R_2C_2, -1/R_2C_2]]$; if the output were taken across $R_2$, $H = [1, -1]$ with the ladder's $F$.")
    names = {"ladder": "ladder (assumed)", "buffered": "buffered cascade", "across": "ladder, output across R2"}
    rows, found, wanted = [], [], []
    for kind, label in names.items():
        box = system(p, kind)
        with mpmath.workdps(DIGITS):
            exact = [by_hand.scalar_equations(*by_hand.circuit(p, kind), p.dt, R, p.steps) for R in (0.0, p.R_over_b2)]
        own = [covariances(discretise(box, p.dt, R=[[R]]), p.steps) for R in (0.0, p.R_over_b2)]
        rows += [(label, part, s.P_minus[1, 0, 0], s.P_plus[1, 0, 0], s.P_minus[-1, 0, 0], s.P_plus[-1, 0, 0]) for part, s in zip("ab", own, strict=True)]
        found += [(s.P_minus[1:, 0, 0], s.P_plus[1:, 0, 0]) for s in own]
        wanted += [(s["U1_variance_prior"], s["U1_variance_posterior"]) for s in exact]
    r.figure("buffered", plots.ladder([("$R_1$", "$C_1$", "$U_1$"), ("$R_2$", "$C_2$", "")], source="$u$", output="$U_0$", enclosure="black box", followers=True), "The buffered cascade: the second section does not load the first.")
    r.table("circuits", ["circuit", "part", "before t1", "after t1", "before the last", "after the last"], rows,
            "Error variance of U1, in units of b², at the first and the last of {steps} measurements.", steps=p.steps)
    r.check("variances of U1 in all circuits", found, wanted, ("recursion of matrices", "scalar equations"))


def noises(r, p, box):
    """The steady variance against R."""
    levels = sorted({0.0, 0.02, 0.2, 2.0, math.inf, p.R_over_b2})
    limits = [steady.solve(discretise(box, p.dt, R=[[R]])) for R in levels]
    before, after = ([getattr(s, name)[0, 0] for s in limits] for name in ("P_minus", "P_plus"))
    r.table("noises", ["R, b²", "before, b²", "after, b²"], zip(levels, before, after, strict=True),
            "Steady error variance of U1 before and after a measurement, against the variance of the measurement noise.")
    r.holds("the steady variance grows with R", np.diff(after), ("Riccati equation with R", "with a larger R"), size=after[-1])
    r.check("steady variance for R = ∞", after[-1], shaping.stationary_covariance(box)[0, 0], ("limit of the filter", "Lyapunov equation of the circuit"), SOLVER)


def ensembles(r, experiment, filters, steps):
    """Ensemble against theory, for both filters."""
    r.says("**Simulation** of part (b), and after it of part (a). What is measured is $U_0$, which follows $U_1$ with a delay.")
    limit = steady.solve(filters["noisy"])
    portrait(r, experiment, filters["noisy"], steps, prefix="noisy_", xlabel=TIME, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]))
    some = experiment.histories(filters["perfect"], steps=steps)
    r.figure("perfect_record", plots.record(some, xlabel=TIME, ylabel="$U_1$, b"), "One run of part (a): $U_1$, its estimate, and the measurements, which are exact values of $U_0$.")
    agreement(r, "perfect", experiment.statistics(filters["perfect"], steps=steps), covariances(filters["perfect"], steps).P_plus)


def alarm(r, p, experiment, filters, steps):
    """The alarm rule: what a margin promises, of all moments and of the dangerous ones."""
    r.says("**Alarm rule.** $C_1$ breaks down when $U_1$ exceeds a limit $U_{max}$. With a margin of $k$ standard deviations,")
    r.math(r"\text{alarm when} \quad \hat U_1(t) + k\,\sigma(t) \ge U_{max}, \qquad \sigma^2(t) = P_{11}(t),")
    r.says("the voltage can be above the limit without an alarm only if the error is below $-k\\sigma$, so in at most the share $N(-k)$ of all moments (one in 740 for $k = 3$). Since σ(t) is known beforehand, so is the margin; between measurements it grows, and it is largest just before a measurement.")
    r.says("That is not the share of the *dangerous* moments that are missed. The error of an optimal estimate is orthogonal to the estimate and not to the voltage: with $V = \\mathrm{Var}\\,U_1$ the mean of $\\hat{U}_1$ at a voltage u is $(1 - \\sigma^2/V)u$, drawn towards 0, just where the voltage is large. With $\\hat{U}_1 \\sim N(0, V - \\sigma^2)$ and $U_1 \\sim N(\\hat{U}_1, \\sigma^2)$ given the estimate,")
    r.math(r"P(\text{dangerous, no alarm}) = \int_{U_{max}}^\infty p(u)\,N\!\left(\frac{U_{max} - k\sigma - (1-\sigma^2/V)u}{\sigma\sqrt{1-\sigma^2/V}}\right)du = \int_{-\infty}^{U_{max}-k\sigma} p(\hat u)\,N\!\left(\frac{\hat u - U_{max}}\sigma\right)d\hat u")
    V = covariances(filters["unmeasured"], p.steps).P_plus[-1, 0, 0]
    left = {name: covariances(filters[name], p.steps).P_plus[-1, 0, 0] / V for name in ("perfect", "noisy")}
    cases = [(name, limit, k) for name in left for limit in LIMITS for k in FACTORS]
    joint = [by_hand.unannounced(left[name], limit, k) for name, limit, k in cases]
    again = [by_hand.by_estimate(left[name], limit, k) for name, limit, k in cases]
    shape = (len(left), len(LIMITS), len(FACTORS))
    missed = [x / ndtr(-limit) for x, (_name, limit, _k) in zip(joint, cases, strict=True)]
    r.value("alarm_joint", np.reshape(joint, shape).tolist())
    r.value("alarm_missed_of_dangerous", np.reshape(missed, shape).tolist())
    r.check("dangerous and unannounced", joint, again, ("integral over the voltage", "integral over the estimate"), SOLVER, scale=np.maximum(again, 1e-12))
    seen = {name: simulated(experiment, filters[name], steps) for name in left}
    rows = []
    for (name, limit, k), x, share in zip(cases, joint, missed, strict=True):
        if k == FACTORS[0]:
            needed = by_hand.margin(left[name], limit)
        counted = f"{seen[name][k][0]} / {seen[name][k][1]}" if limit == LIMITS[0] else "—"
        rows.append(("(a)" if name == "perfect" else "(b)", limit, k, x, share, counted, needed if k == FACTORS[-1] else "—"))
    columns = ["filter", "limit, σ of U1", "margin k", "dangerous and unannounced", "share of the dangerous moments missed", "simulated", "k for a share of 1 %"]
    r.table("alarm", columns, rows, "The alarm rule after the last measurement of the plot, U1 having the standard deviation {sd} b. Simulated: moments missed of those dangerous, all runs and measurements together; the standard deviations are those of each moment.", sd=math.sqrt(V))


def simulated(experiment, system, steps):
    """Moments missed and dangerous moments of all runs, at the limit of LIMITS[0] standard deviations of each moment, by k."""
    some = experiment.histories(system, steps=steps, runs=experiment.runs)
    sd = np.sqrt(np.diagonal(covariances(replace(system, R=[[math.inf]]), steps).P_plus, axis1=1, axis2=2))[1:, :1]
    dangerous = some.truth[1:, 0] >= LIMITS[0] * sd
    own = some.sd_plus[1:, :1]
    return {k: (int((dangerous & (some.x_plus[1:, 0] + k * own < LIMITS[0] * sd)).sum()), int(dangerous.sum())) for k in FACTORS}


def conclusions(r, p, filters):
    """What the numbers say."""
    last = {name: covariances(model, p.steps) for name, model in filters.items()}
    open_, perfect, noisy = (last[name].P_plus[-1, 0, 0] for name in ("unmeasured", "perfect", "noisy"))
    lines = [text("At t = {t} s the variance of U1 is {open} b² without measurements; perfect measurements of U0 leave {perfect} b² after the last one, {percent} % of it.",
                  t=p.steps * p.dt, open=open_, perfect=perfect, percent=round(100 * perfect / open_, 1))]
    if p.R_over_b2 == 0:
        lines.append("The measurements of part (b) are given without noise, so it is part (a) again.")
    elif math.isinf(p.R_over_b2):
        lines.append("In part (b) nothing is measured: its variance is that without measurements.")
    else:
        lines.append(text("Noise of variance {R} b² raises this to {noisy} b², {factor} times as much.", R=p.R_over_b2, noisy=noisy, factor=noisy / perfect))
    before = last["perfect"].P_minus[-1, 0, 0]
    if before >= noisy:
        lines.append(text("However exact the voltmeter, the variance returns from {after} to {before} b² before the next measurement: the margin of an alarm is set by the period, {dt} s, more than by the voltmeter.", after=perfect, before=before, dt=p.dt))
    elif not math.isinf(p.R_over_b2):
        lines.append(text("The noise of the voltmeter costs more than the wait between measurements: between two perfect ones the variance rises from {after} to {before} b² only.", after=perfect, before=before))
    most = max(limit[-1] for limit in r.values["alarm_missed_of_dangerous"].value[1])
    lines.append(text("With three standard deviations as a margin the voltage is dangerous and unannounced in at most one moment in 740. Of the dangerous moments themselves part (b) misses up to {percent} %: an estimate is drawn towards 0 just where the voltage is large.", percent=round(100 * most, 2)))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_a, part_b),
    plan=plan,
    experiment=(plot, other_circuits, noises, ensembles, alarm),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, box = by_hand.analytic(p), system(p)
    filters = {name: discretise(box, p.dt, R=[[R]]) for name, R in (("unmeasured", math.inf), ("perfect", 0.0), ("noisy", p.R_over_b2))}
    return PARTS.report(META, p, experiment, answer=answer, perfect=filters["perfect"], noisy=filters["noisy"], filters=filters, box=box)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
