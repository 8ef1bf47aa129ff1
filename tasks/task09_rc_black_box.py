r"""Lab 9. The RC "black box": a voltage that cannot be reached, from one that can.

Source: Semushin & Tsyganova 2001, task 9. White noise u drives a circuit of two resistors and two capacitors; the voltage
U1 on the first capacitor is to be watched, the output voltage U0 is measured every half second. The sheet asks for the
optimal estimate of U1 from discharged capacitors, the plot of its error variance over two seconds, with perfect
measurements (a) and with noise of variance R = 0.2b² (b).

Expected answer (two-section ladder, in units of b²): P⁺ has rank 1 after a perfect measurement, K = (P12⁻/P22⁻, 1);
the variance of U1 is 0.45607 before and 0.17456 after the first perfect measurement.
"""

import math

import mpmath
import numpy as np
from ctlabs.tasks._task09_alarm import alarm
from ctlabs.tasks._task09_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task09 as by_hand
from ctlabs.tasks.answers.task09 import DIGITS, STRENGTH

from ctlabs.filtering import settling, steady
from ctlabs.filtering.between import between
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, shaping
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.draws import one_of, span
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
TIME = "t, s"


class Parameters(LabParameters):
    """What may be changed."""

    R1: Positive = given(1.0, unit="Ω", meaning="first resistor", draw=one_of(0.5, 1, 1.5, 2))
    R2: Positive = given(1.0, unit="Ω", meaning="second resistor", draw=one_of(0.5, 1, 1.5, 2))
    C1: Positive = given(1.0, unit="F", meaning="first capacitor", draw=one_of(0.5, 1, 1.5, 2))
    C2: Positive = given(1.0, unit="F", meaning="second capacitor", draw=one_of(0.5, 1, 1.5, 2))
    dt: Positive = given(0.5, unit="s", meaning="period of the measurements", draw=one_of(0.25, 0.5, 0.75, 1))
    steps: Count = given(4, unit="1", meaning="number of measurements", symbol="N")
    R_over_b2: VarianceOrInf = given(0.2, unit="1", meaning="variance of the measurement noise in part (b), over b²", symbol="R/b^2", draw=span(0.1, 0.5, 0.05))


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
    r.says("The sheet's figure is missing. The most plausible circuit with these parts and a voltage $U_1$ on $C_1$ is a ladder of two RC sections with the output $U_0$ on $C_2$; {fig:circuit} shows it, and it is taken here. What two other circuits would give is in {tab:circuits}.")
    r.figure("circuit", plots.ladder([("$R_1$", "$C_1$", "$U_1$"), ("$R_2$", "$C_2$", "")], source="$u$", output="$U_0$", enclosure="black box"), "The circuit assumed: only $u$ and $U_0$ lead out of the box.")
    r.says("The currents into the two nodes give")
    r.math(r"C_1\dot U_1 = \frac{u-U_1}{R_1} - \frac{U_1-U_0}{R_2}, \qquad C_2\dot U_0 = \frac{U_1-U_0}{R_2}")
    r.says("With the state $x = (U_1, U_0)^T$ this is $\\dot x = Fx + Gu$, where")
    r.math(r"F = \begin{bmatrix} -\frac1{R_1C_1}-\frac1{R_2C_1} & \frac1{R_2C_1} \\ \frac1{R_2C_2} & -\frac1{R_2C_2} \end{bmatrix}, \quad G = \begin{bmatrix} \frac1{R_1C_1} \\ 0 \end{bmatrix}, \quad Q = 2b^2, \quad H = \begin{bmatrix} 0 & 1 \end{bmatrix}, \quad P_0 = 0")
    nodes = {
        "u": Node((0, 0), "$u$", "signal"), "1": Node((1.1, 0), "", "sum"), "a": Node((2.4, 0), r"$\frac{1/R_1C_1}{s+f_1}$"),
        "b": Node((5.0, 0), r"$\frac{f_2}{s+f_2}$"), "b2": Node((6.2, 0), "", "branch"), "s": Node((7.1, 0), r"$\Delta t$", "sampler"), "2": Node((8.0, 0), "", "sum"),
        "v": Node((8.0, 0.8), "$v$", "signal"), "z": Node((8.9, 0), "$z$", "signal"), "k": Node((3.8, -1.0), "$R_1/R_2$"),
    }
    arrows = [Arrow("u", "1"), Arrow("1", "a"), Arrow("a", "b", "$U_1$"), Arrow("b", "b2"), Arrow("b2", "s", "$U_0$"), Arrow("s", "2"), Arrow("v", "2"),
              Arrow("2", "z"), Arrow("b2", "k", turn="along"), Arrow("k", "1")]
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The circuit as a block diagram, with $f_1 = 1/R_1C_1 + 1/R_2C_1$ and $f_2 = 1/R_2C_2$. The second section loads the first, which is the feedback; v is zero in part (a).")
    r.says("{fig:diagram} shows what the loading does: the output voltage acts back on $U_1$. So $U_0$ is $U_1$ smoothed by a first-order lag with the time constant $R_2C_2$, and the filter has to undo that lag.")
    r.says("The matrices of one period follow from $F$, $G$ and $Q$ as in {ref:maybeck, section 4.9}. All variances below are in units of $b^2$ (V²), voltages in units of $b$; a strength of white noise is in V²s, so that the factor 2 in $Q = 2b^2$ stands for 2 s. For the given parts, sampled every {dt} s:", dt=p.dt)
    r.model(perfect)
    routes = ("doubling of the short interval", "divided differences and Lyapunov's equation")
    r.value("Phi", perfect.Phi, agrees=answer, routes=routes)
    r.value("Qd", perfect.Qd, "b²", agrees=answer, routes=routes)
    r.says("**After a perfect measurement** $z = U_0$. With $h = H^T$ the update {ref:maybeck, section 5.3} is $P^+ = P^- - P^-hh^TP^-/(h^TP^-h)$, so that $P^+h = 0$: $P^+$ has rank 1, and $U_0$ is known exactly. ∎ The inverse covariance form {ref:maybeck, section 5.7} cannot be used here, as $P^+$ has no inverse. Written out, with $p_i = P_{11}(t_i^+)$ and $p_0 = 0$:")
    r.math(r"P_{11}^- = \Phi_{11}^2p_{i-1} + q_{11}, \quad P_{12}^- = \Phi_{11}\Phi_{21}p_{i-1} + q_{12}, \quad P_{22}^- = \Phi_{21}^2p_{i-1} + q_{22}, \qquad K = \begin{bmatrix} P_{12}^-/P_{22}^- \\ 1 \end{bmatrix}, \qquad P^+ = \begin{bmatrix} p_i & 0 \\ 0 & 0 \end{bmatrix}")
    r.math(r"p_i = P_{11}^- - \frac{(P_{12}^-)^2}{P_{22}^-} = \frac{(q_{11}\Phi_{21}^2 + q_{22}\Phi_{11}^2 - 2q_{12}\Phi_{11}\Phi_{21})\,p_{i-1} + q_{11}q_{22} - q_{12}^2}{\Phi_{21}^2\,p_{i-1} + q_{22}}", "fraction")
    r.says("and the optimal estimate, which uses the last two measurements and the estimate before ($z_0 = 0$, $\\hat{U}_1(t_0) = 0$):")
    r.math(r"\hat U_1(t_i^+) = \Phi_{11}\hat U_1(t_{i-1}^+) + \Phi_{12}z_{i-1} + \frac{P_{12}^-}{P_{22}^-}\left[z_i - \Phi_{21}\hat U_1(t_{i-1}^+) - \Phi_{22}z_{i-1}\right], \qquad \hat U_0(t_i^+) = z_i", "estimate")
    schedule = covariances(perfect, p.steps)
    results(r, p, answer, schedule, "perfect")
    r.check("P11⁺ after perfect measurements", schedule.P_plus[1:, 0, 0], by_hand.perfect_powers(p), ("recursion", "power of the fraction's matrix"))
    r.check("P12⁺, P22⁺ after perfect measurements", schedule.P_plus[1:, 1, :], np.zeros((p.steps, 2)), ("recursion", "proof of rank 1"), EXACT, scale=float(schedule.P_minus[1:].max()))
    limit = steady.solve(perfect)
    r.value("posterior_steady_perfect", limit.P_plus[0, 0], "b²", symbol=r"\bar p", agrees=answer, routes=("Riccati equation", "fixed point of the fraction"))
    r.says("The limit is the positive fixed point of {eq:fraction}, $\\bar p = {limit}\\,b^2$. Knowing $U_0$ exactly at the samples does not tell $U_1$ exactly, because the input between the samples is unknown: $q_{11}q_{22} - q_{12}^2 > 0$, so even $p_{i-1} = 0$ gives $p_i > 0$.", limit=limit.P_plus[0, 0])


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
    r.says("On the right of a prediction the superscript + means the instant before; in an update the superscript − means the same instant. The estimate follows the same pattern:")
    r.math(r"\hat U_1^- = \Phi_{11}\hat U_1^+ + \Phi_{12}\hat U_0^+, \quad \hat U_0^- = \Phi_{21}\hat U_1^+ + \Phi_{22}\hat U_0^+, \qquad \hat U_1^+ = \hat U_1^- + \frac{P_{12}^-}S(z-\hat U_0^-), \quad \hat U_0^+ = \hat U_0^- + \frac{P_{22}^-}S(z-\hat U_0^-)", "noisy")
    r.says("With $R = 0$ these are the equations of part (a). For $R > 0$ the correction of $U_1$ is smaller by the factor $P_{22}^-/(P_{22}^- + R)$, so what counts is the size of R beside $P_{22}^-$, the variance with which $U_0$ is predicted.")
    if p.R_over_b2 == 0:
        r.says("Here $R = 0$ is given, so part (b) repeats part (a).")
    elif math.isinf(p.R_over_b2):
        r.says("Here $R = \\infty$ is given: nothing is measured, the gain is 0, and the estimate stays 0.")
    results(r, p, answer, covariances(noisy, p.steps), "noisy")


def plan(r, p, experiment, filters):
    """Every number chosen."""
    settled = max(settling(filters[name]) or 1 for name in ("perfect", "noisy"))
    steps = max(p.steps, min(100, 2 * settled))
    r.says("{tab:plan} lists what was chosen. The curves of the error variance need no random numbers; the simulation tests them, and counts the moments that an alarm misses.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in the plot", p.steps, text("{seconds} s, one every {dt} s", seconds=p.steps * p.dt, dt=p.dt)],
        ["points of P(t) in an interval", POINTS, "a smooth curve"],
        ["measurements simulated", steps, text("at least twice the settling time ({settled} measurements), up to 100", settled=settled)],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same circuit and input for both filters"],
        ["start", 0, "discharged capacitors, both voltages known to be 0"],
    ], "Plan of the experiment. The strength b = 1 V is chosen for the simulation; all results scale with b.")
    return {"steps": steps}


def plot(r, p, answer, box, filters):
    """The plot of the sheet."""
    r.part = "b"  # what follows is about both parts
    r.subsection("The error variance in time", "curve")
    schedules = {name: covariances(model, p.steps) for name, model in filters.items()}
    curves = {name: between(box, schedule, POINTS) for name, schedule in schedules.items()}
    labels = {"unmeasured": "no measurements", "noisy": text("(b) R = {R} b²", R=p.R_over_b2), "perfect": "(a) R = 0"}
    figure = plots.transient(curves["perfect"].t, {label: curves[name].P[:, 0, 0] for name, label in labels.items()}, ylabel="error variance of $U_1$, b²")
    r.figure("variance", figure, "Variance of the error of $\\hat{U}_1$, in units of b². Each measurement lowers it at once; between measurements it returns towards the curve without measurements.")
    r.says("{fig:variance} is the plot that both parts ask for, {tab:variance} has its numbers. Up to the first measurement all three curves coincide. Then each measurement lowers the variance at once, the perfect one more than the noisy one, and in between the unknown input raises it again.")
    r.value("U1_variance_unmeasured", schedules["unmeasured"].P_minus[1:, 0, 0], "b²", at=schedules["noisy"].t[1:], agrees=answer, routes=("recursion", "closed form"))
    for name in ("perfect", "noisy"):
        half = curves[name].P[:-1, 0, 0].reshape(p.steps, POINTS + 1)[:, POINTS // 2]
        r.check(text("variance of U1 in the middle of the intervals, {name}", name=name), half, answer[f"middle_{name}"], ("doubling of the short interval", "closed form"))
    rows = [(schedules["noisy"].t[i], schedules["unmeasured"].P_minus[i, 0, 0], *(x for name in ("perfect", "noisy") for s in [schedules[name]] for x in (s.P_minus[i, 0, 0], s.P_plus[i, 0, 0], s.K[i, 0, 0]))) for i in range(1, p.steps + 1)]
    r.table("variance", [TIME, "no measurements", "(a) before", "(a) after", "(a) K₁", "(b) before", "(b) after", "(b) K₁"], rows,
            "Error variance of $U_1$ before and after each measurement, in units of b², and its gain.")
    r.holds("a noisy measurement is worth less than a perfect one, and more than none",
            np.minimum(schedules["noisy"].P_plus - schedules["perfect"].P_plus, schedules["unmeasured"].P_plus - schedules["noisy"].P_plus)[:, 0, 0],
            ("recursion with R", "recursions with R = 0 and R = ∞"), size=float(schedules["unmeasured"].P_minus[-1, 0, 0]))


def other_circuits(r, p):
    """What two other readings of the missing figure would give."""
    r.subsection("Other circuits and other voltmeters", "circuits")
    r.says("**Other circuits.** The figure of the sheet being lost, {tab:circuits} gives two other readings. If an amplifier of unit gain stood between the sections (a buffered cascade), the second would not load the first; if the output were taken across $R_2$, the difference of the voltages would be measured. Their matrices are")
    r.math(r"F = \begin{bmatrix} -\frac1{R_1C_1} & 0 \\ \frac1{R_2C_2} & -\frac1{R_2C_2} \end{bmatrix} \;\text{(buffered)}, \qquad H = \begin{bmatrix} 1 & -1 \end{bmatrix} \;\text{(output across } R_2\text{)}.")
    names = {"ladder": "ladder (assumed)", "buffered": "buffered cascade", "across": "ladder, output across R₂"}
    rows, found, wanted = [], [], []
    for kind, label in names.items():
        box = system(p, kind)
        with mpmath.workdps(DIGITS):
            exact = [by_hand.scalar_equations(*by_hand.circuit(p, kind), p.dt, R, p.steps) for R in (0.0, p.R_over_b2)]
        own = [covariances(discretise(box, p.dt, R=[[R]]), p.steps) for R in (0.0, p.R_over_b2)]
        rows += [(label, part, s.P_minus[1, 0, 0], s.P_plus[1, 0, 0], s.P_minus[-1, 0, 0], s.P_plus[-1, 0, 0]) for part, s in zip("ab", own, strict=True)]
        found += [(s.P_minus[1:, 0, 0], s.P_plus[1:, 0, 0]) for s in own]
        wanted += [(s["U1_variance_prior"], s["U1_variance_posterior"]) for s in exact]
    r.table("circuits", ["circuit", "part", "before t₁", "after t₁", "before the last", "after the last"], rows,
            "Error variance of $U_1$, in units of b², at the first and the last of {steps} measurements.", steps=p.steps)
    r.check("variances of U1 in all circuits", found, wanted, ("recursion of matrices", "scalar equations"))


def noises(r, p, box):
    """The steady variance against R."""
    levels = sorted({0.0, 0.02, 0.2, 2.0, math.inf, p.R_over_b2})
    limits = [steady.solve(discretise(box, p.dt, R=[[R]])) for R in levels]
    before, after = ([getattr(s, name)[0, 0] for s in limits] for name in ("P_minus", "P_plus"))
    r.says("**The noise of the voltmeter.** {tab:noises} shows how the steady variance goes from that of part (a) to that of no measurements, $R = \\infty$. Before a measurement it is bounded from below by its value at $R = 0$, which only a shorter period could lower.")
    r.table("noises", ["R, b²", "before, b²", "after, b²"], zip(levels, before, after, strict=True),
            "Steady error variance of $U_1$ before and after a measurement, against the variance of the measurement noise.")
    r.holds("the steady variance grows with R", np.diff(after), ("Riccati equation with R", "with a larger R"), size=after[-1])
    r.check("steady variance for R = ∞", after[-1], shaping.stationary_covariance(box)[0, 0], ("limit of the filter", "Lyapunov equation of the circuit"), SOLVER)


def ensembles(r, experiment, filters, steps):
    """Ensemble against theory, for both filters."""
    r.subsection("Simulation", "simulation")
    r.says("{fig:records} shows one run of the circuit and the errors that both filters make in it. About two errors in three should lie between the dashed lines of their own colour, of which those of part (a) are never wider apart than those of part (b).")
    shown = {"(a)": "perfect", "(b)": "noisy"}
    some = {name: experiment.histories(filters[name], steps=steps) for name in shown.values()}
    t = some["noisy"].t
    curves = [Curve("$U_1$", t, some["noisy"].truth[:, 0, 0], "blue")]
    for (part, name), colour in zip(shown.items(), ("green", "orange"), strict=True):  # as in the plot of the sheet
        sd = some[name].sd_plus[:, 0]
        curves += [Curve(text("{part} error", part=part), t, some[name].error("plus")[:, 0, 0], colour), Curve(text("{part} ±σ", part=part), t, sd, colour, "dash", width=1.0),
                   Curve("", t, -sd, colour, "dash", width=1.0, quiet=True)]
    r.figure("records", Drawing("One run", TIME, (Panel("voltage and errors, b", tuple(curves)),)),
             "One run: the voltage and the errors $\\hat{U}_1 - U_1$ of both filters after each measurement, with ± the standard deviations of theory (dashed).")
    limit = steady.solve(filters["noisy"])
    own = portrait(r, experiment, filters["noisy"], steps, prefix="noisy_", xlabel=TIME, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]), figures={
        "ensemble": "Part (b): the points lie about the curves of theory; about one in twenty is expected outside the bands."})
    stats = experiment.statistics(filters["perfect"], steps=steps)
    agreement(r, "perfect", stats, covariances(filters["perfect"], steps).P_plus)
    measured = {"perfect": rms(stats, unit="b"), "noisy": rms(own, unit="b")}
    theory = {name: float(covariances(filters[name], steps).sd_plus[-1, 0]) for name in measured}
    r.says("{fig:noisy_ensemble} compares the errors of all {runs} runs with theory. After the last measurement the RMS error of $\\hat{U}_1$ is {a} in part (a), where theory has {sd_a:4} b, and {b} in part (b), where theory has {sd_b:4} b.",
           runs=experiment.runs, a=measured["perfect"], b=measured["noisy"], sd_a=theory["perfect"], sd_b=theory["noisy"])
    return {"measured": measured}


PARTS = Skeleton(
    result=result,
    key="variance",
    analysis=(part_a, part_b),
    plan=plan,
    experiment=(plot, other_circuits, noises, ensembles, alarm),
    discussion=discussion,
    answers=answers,
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
