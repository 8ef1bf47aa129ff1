r"""Lab 13. The altitude channel of an autopilot: continuous and sampled measurements of the altitude.

Source: Semushin & Tsyganova 2001, task 13. The altitude h follows the commanded one through
0.3(s + 0.01)/(s² + 0.006s + 0.003); the command is an unknown constant h_c0 plus white noise of strength N_c, and the
altitude is measured in white noise of strength N_m. The sheet asks for the equations of the optimal estimate in scalar
form and how their coefficients are found, the same for measurements once a second, and a comparative experiment with an
explanation.

Expected answer: three equations of the estimate, six scalar Riccati equations. The algebraic Riccati equation of the
three states has no stabilising solution, for no noise drives h_c0: gains by integration from P0, their limit from the
two states that noise drives (P11 → 850.12, K1 → 0.12957), P33 → (N_c + N_m)/(t − t*), K3 → 0. At 300 s P11 is still 3 %
above its limit. Sampling once a second costs little, since the filter's time constants are 9.6 and 31.7 s.
"""

import math
from dataclasses import replace

import control
import mpmath
import numpy as np
from ctlabs.tasks._task13_coefficients import TIME, coefficients, scalar, transient
from ctlabs.tasks._task13_experiment import ensembles, plan
from ctlabs.tasks._task13_words import answers, conclusions, discussion, explanation, result
from ctlabs.tasks.answers import task13 as by_hand
from ctlabs.tasks.answers.task13 import A0, A1, B0, B1

from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import interop, observability, shaping
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of
from ctlabs.reporting.params import Count, LabParameters, Positive, Real, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import latex_number, text

META = {
    "name": "task13",
    "title": "Autopilot: the altitude from continuous and from sampled measurements",
    "source": "Semushin & Tsyganova 2001, task 13",
    "parts": ["a", "b", "c"],
}

#: The data as printed, and as they read if "²" is a unit that lost its letter: N_c, N_m, variance of h_c0.
PRINTED = (36.0**2, 81.0**2, 22500.0**2)
UNITS = (36.0, 81.0, 22500.0)


class Parameters(LabParameters):
    """What may be changed."""

    N_c: Variance = given(1296.0, unit="m²·s", meaning="strength of the noise of the command", draw=one_of(*(k**2 for k in range(24, 50, 2))))
    N_m: Positive = given(6561.0, unit="m²·s", meaning="strength of the noise of the measured altitude", draw=one_of(*(k**2 for k in range(63, 100, 3))))
    var_hc0: Variance = given(506250000.0, unit="m²", meaning="variance of the commanded constant", symbol=r"\mathrm{var}\,h_{c0}", draw=one_of(*((1000 * k) ** 2 for k in range(15, 31))))
    mean_hc0: Real = given(3000.0, unit="m", meaning="mean of the commanded constant", symbol=r"\bar h_{c0}")
    dt: Positive = given(1.0, unit="s", meaning="period of the sampled measurements", draw=one_of(0.5, 1, 2))
    steps: Count = given(300, unit="1", meaning="sampled measurements in the experiment", symbol="N")


def plant(N_c, N_m):
    """Altitude and the second state of the observable form, the command without its noise's mean."""
    return interop.from_control(control.tf([B1, B0], [1, A1, A0]), Q=[[N_c]], Rc=[[N_m]], P0=np.zeros((2, 2)),
                                realisation="observable", states=["h", "x2"], units=["m", "m/s"], measurements=["h_m"])


def model(N_c, N_m, var, mean):
    """The plant with the command, h_c = h_c0 + white noise, at its input; settled flight at t = 0."""
    two = plant(N_c, N_m)
    command = replace(shaping.bias(var, name="h_c0", unit="m"), Rc=np.array([[N_c]]))
    q = np.append(-np.linalg.solve(two.F, two.G[:, 0]), 1.0)
    return replace(shaping.augment(two, command), P0=var * np.outer(q, q), x0=mean * q)


def part_a(r, p, answer, two, three):
    """The equations, and how their coefficients are found."""
    r.section("a", "Continuous measurements: the equations of the estimate and their coefficients")
    r.says("**The model.** The transfer function becomes a state space in observable form, whose first state is the altitude itself:")
    r.math(r"\dot h = -a_1h + x_2 + b_1h_c, \quad \dot x_2 = -a_0h + b_0h_c, \qquad \frac{h(s)}{h_c(s)} = \frac{b_1s + b_0}{s^2 + a_1s + a_0}", "plant")
    r.says("with $b_1 = {b1}$, $b_0 = {b0}$, $a_1 = {a1}$, $a_0 = {a0}$. The transfer function is strictly proper, so the noise of the command enters the states and not the output, and the results for the altitude do not depend on the choice of states. The command $h_c = h_{c0} + \\delta h_c$ adds a third state, $\\dot{h}_{c0} = 0$:",
           b1=B1, b0=B0, a1=A1, a0=A0)
    r.model(three)
    r.says("The second column of $G$ belongs to the constant, which nothing drives. The sheet gives no statistics of $h$ and $x_2$ at $t = 0$. Settled flight at the commanded altitude is assumed: $(h, x_2, h_{c0}) = q\\,h_{c0}$ with the equilibrium $q = (1, {q2}, 1)$, hence $P_0 = \\mathrm{var}(h_{c0})\\,qq^T$, a singular matrix, and the mean $\\bar{h}_{c0}\\,q$.",
           q2=float(three.P0[1, 2] / three.P0[2, 2]) if p.var_hc0 else A1 - B1)
    scalar(r)
    coefficients(r, answer, two, three)
    transient(r, p, answer, three)


def part_b(r, p, answer, pair, sampled):
    """Sampled measurements."""
    r.section("b", "Measurements once per period")
    r.says("For the measurement in white noise of the strength $N_m$ stands one measurement in each period Δt with the variance $R_d = N_m/\\Delta t = {R}$ m², which carries the same information per second; at $\\Delta t = 1$ s it is the same number as the sheet's intensity. The states are those of (a); over a period they move by",
           R=float(sampled.R[0, 0]))
    r.model(sampled)
    f, c = sampled.Phi, sampled.offset
    r.says("**Prediction** in scalar form:")
    for i, name in enumerate((r"\hat h", r"\hat x_2", r"\hat h_{c0}")):
        terms = " ".join(
            f"{signed(f[i, j])}\\,{other}^+(t_k)"
            for j, other in enumerate((r"\hat h", r"\hat x_2", r"\hat h_{c0}"))
            if f[i, j]
        ).lstrip("+ ")
        r.math(f"{name}^-(t_{{k+1}}) = " + terms, "" if i else "prediction")
    r.says("**Update** with the innovation $\\nu = h_m - \\hat{h}^-$ ({ref:maybeck, section 5.3}), and the covariance in six scalars, $i \\le j$, with the elements $\\varphi_{ij}$ of $\\Phi$ and $q_{ij}$ of $Q_d$:")
    r.math(r"\hat h^+ = \hat h^- + K_1\nu, \quad \hat x_2^+ = \hat x_2^- + K_2\nu, \quad \hat h_{c0}^+ = \hat h_{c0}^- + K_3\nu, \qquad K_i = \frac{P_{1i}^-}{P_{11}^- + R_d}", "update")
    r.math(r"P_{ij}^-(t_{k+1}) = \sum_{l,m}\varphi_{il}\varphi_{jm}P_{lm}^+(t_k) + q_{ij}, \qquad P_{ij}^+ = P_{ij}^- - K_iP_{1j}^-", "recursion")
    r.says("The gains come from this recursion, run beforehand from $P_0$. For the same reason as in (a) the three-state equation has no stabilising solution, and the limits are those of the two driven states.")
    if c is not None:
        r.math(r"c = {c}", c=c)
    sampled_limit(r, p, answer, pair, sampled)


def sampled_limit(r, p, answer, pair, sampled):
    """The limit of the sampled filter, and its way there."""
    limit, routes = steady.solve(pair), ("Riccati equation", "spectral factorisation")
    r.value("altitude_variance_prior_steady", limit.P_minus[0, 0], "m²", symbol=r"\bar P_{11}^-", agrees=answer, routes=routes)
    r.value("altitude_variance_posterior_steady", limit.P_plus[0, 0], "m²", symbol=r"\bar P_{11}^+", agrees=answer, routes=routes)
    r.value("altitude_gain_steady", limit.K[0, 0], "1", symbol=r"\bar K_1", agrees=answer, routes=routes)
    whole = steady.solve(sampled)
    r.check("limit of the three-state filter", whole.P_plus[:2, :2], limit.P_plus,
            ("three states without the undriven mode", "two states"))
    shown = covariances(sampled, p.steps)
    entered = np.maximum.accumulate(np.abs(shown.P_minus).max(axis=(1, 2)))
    routes = ("recursion", "power of the linear map, with many digits")
    for k in sorted({1, math.ceil(p.steps / 10), p.steps}):
        if by_hand.digits(p, k) <= 2000:
            # The recursion rounds relative to the largest covariance that has gone through it.
            r.check(text("P⁺ at measurement {k}", k=k), shown.P_plus[k], by_hand.sampled_covariance(p, k), routes, EXACT,
                    scale=float(entered[k]) or 1.0)
    P = shown.P_minus[-1]
    r.check("gains at the last measurement", shown.K[-1, :, 0], P[:, 0] / (P[0, 0] + p.N_m / p.dt),
            ("filter", "scalar form"), EXACT)
    first, second = np.abs(limit.poles)
    r.says("In the limit $P_{11}^- = {prior}$ m² before and $P_{11}^+ = {posterior}$ m² after a measurement, $K_1 = {gain}$; the poles of the two-state filter have the moduli {first} and {second}.",
           prior=limit.P_minus[0, 0], posterior=limit.P_plus[0, 0], gain=limit.K[0, 0], first=float(max(first, second)), second=float(min(first, second)))
    loss = observability.loss_by_sampling(plant(p.N_c, p.N_m), p.dt)
    if loss.lost:
        r.says("With this period the samples see only {rank} of the two states: the period is a multiple of half the autopilot's own period, {lost} s.",
               rank=loss.rank, lost=loss.losing_periods[0])


def signed(value):
    """A coefficient with its sign, as a term of a sum."""
    size = abs(float(value))
    return f"{'-' if value < 0 else '+'} " + ("" if size == 1 else latex_number(size))


def data_sets(r, p):
    """The data as printed, and without the squares, beside the given ones."""
    r.says("**The data.** The sheet prints $22500^2$, $36^2$ and $81^2$. They are taken as they stand, but more likely the letter m of a unit is lost in each: 22500 m², 36 m²·s, 81 m²·s. Read literally, the standard deviation of the commanded altitude is 22.5 km about a mean of 3 km; in plain units it is 150 m. {tab:data} has both readings. The ratio $N_c/N_m$, on which the gains depend, is {printed:2} in the one and {plain:2} in the other, so the two filters are alike; the lengths differ by a factor of about ten.",
           printed=PRINTED[0] / PRINTED[1], plain=UNITS[0] / UNITS[1])
    own = (p.N_c, p.N_m, p.var_hc0)
    sets = {"as printed": PRINTED, "in plain units": UNITS}
    if own not in sets.values():
        sets = {"given parameters": own} | sets
    rows = []
    for name, (N_c, N_m, var) in sets.items():
        two, three = plant(N_c, N_m), model(N_c, N_m, var, p.mean_hc0)
        limit, discrete = bucy.steady(two), steady.solve(discretise(two, p.dt))
        last = bucy.transient(three, [300.0]).P[0]
        mark = own == (N_c, N_m, var)
        with mpmath.workdps(60):
            hand = by_hand.two_state_limit(N_c, N_m)[2]
        r.check(text("P11 in the limit, {name}", name=name), limit.P[0, 0], float(hand[0, 0]),
                ("Riccati equation", "spectral factorisation"))
        r.check(text("P⁻, P⁺, K in the limit, {name}", name=name),
                [discrete.P_minus[0, 0], discrete.P_plus[0, 0], discrete.K[0, 0]], by_hand.sampled_limit(N_c, N_m, p.dt),
                ("Riccati equation", "spectral factorisation"))
        rows.append((text("{name} (the given ones)" if mark else "{name}", name=name), N_c, N_m, var, limit.P[0, 0], limit.K[0, 0],
                     discrete.P_minus[0, 0], discrete.P_plus[0, 0], discrete.K[0, 0], last[0, 0],
                     100 * (last[0, 0] / limit.P[0, 0] - 1) if N_c else None, math.sqrt(last[2, 2])))
    quantities = ("$N_c$, m²·s", "$N_m$, m²·s", "variance of $h_{c0}$, m²", "$P_{11}(\\infty)$, m²", "$K_1(\\infty)$, 1/s", "$\\bar P_{11}^-$, m²", "$\\bar P_{11}^+$, m²", "$\\bar K_1$", "$P_{11}$ at 300 s, m²", "above its limit, %", "σ of $h_{c0}$ at 300 s, m")
    names, *columns = zip(*rows, strict=True)
    r.table("data", ["quantity", *names], [(quantity, *values) for quantity, values in zip(quantities, columns, strict=True)],
            "Two readings of the data: the limits of both filters, and what is reached at 300 s.")


def part_c(r, p, answer, three, sampled):
    """Variances and gains of both filters."""
    r.section("c", "Comparison of both filters")
    plan_b = covariances(sampled, p.steps)
    end = float(plan_b.t[-1])
    # Half of the instants for the logarithmic axes, half for the linear ones.
    start = min(0.1, 0.1 * p.dt) if p.steps > 1 else 0.1 * p.dt
    t = np.unique(np.concatenate([np.geomspace(start, end, 80), np.linspace(end / 80, end, 80)]))
    continuous = bucy.transient(three, t)
    top = max(plan_b.P_minus[-1, 0, 0], continuous.P[-1, 0, 0])
    label = text("Δt = {dt} s", dt=p.dt)
    if top > 0:
        figure = plots.sampled({label: plan_b}, t, continuous.P[:, 0, 0], xlabel=TIME, ylabel="$P_{11}$, m²",
                               limit=answer["altitude_variance_steady_continuous"], ylim=(0.0, 2 * top))
        r.figure("teeth", figure, "Variance of the altitude: $P_{11}(t)$ of the continuous filter, and that of the sampled filter before and after each measurement. The start is above the picture." if p.var_hc0 else "Variance of the altitude: $P_{11}(t)$ of the continuous filter, and that of the sampled filter before and after each measurement.")
        r.says("In {fig:teeth} the continuous variance runs between the teeth of the sampled one: a measurement lowers the variance at once, and until the next one it grows by what the altitude does meanwhile.",
               " Both are still on their way to their limits, as the command is still being learnt." if p.var_hc0 and p.N_c else "")
    else:
        r.says("The altitude is known without error from the start, so that there is no variance to draw.")
    shown = continuous.P[:, 0, 0] > 0
    log = "xy" if shown.any() and p.var_hc0 else "x"
    figure = plots.gains(t, continuous.K, plan_b,
                         names=["|$K_1$|", "|$K_2$|", "|$K_3$|"] if log == "xy" else ["$K_1$", "$K_2$", "$K_3$"],
                         units=["1/s", "1/s²", "1/s"], xlabel=TIME, log=log)
    r.figure("gains", figure, "Gains of the continuous filter (lines), and those of the sampled filter divided by its period (points).")
    r.says("{fig:gains} shows the gains; $K_1$ is proportional to $P_{11}$. A measurement of the sampled filter does in one step what the continuous filter does within a period, so that its gain divided by the period is close to the continuous one. The points lie on the lines or, while much is corrected in one period, below them.",
           " $K_3$ falls to 0 with the variance of the command: the filter stops learning the constant, and later drifts of the command would not be followed." if p.var_hc0 else "")
    compared(r, p, three, plan_b)


def compared(r, p, three, plan_b):
    """Both filters at some instants."""
    rows = [
        (
            k,
            plan_b.t[k],
            plan_b.P_minus[k, 0, 0],
            plan_b.P_plus[k, 0, 0],
            bucy.transient(three, [plan_b.t[k]]).P[0, 0, 0],
            math.sqrt(plan_b.P_plus[k, 2, 2]),
        )
        for k in sorted({1, math.ceil(p.steps / 30), math.ceil(p.steps / 5), p.steps})
    ]
    r.table("compare", ["measurement", "t, s", "$P_{11}^-$, m²", "$P_{11}^+$, m²", "$P_{11}(t)$, m²", "$\\sqrt{P_{33}^+}$, m"], rows,
            "Both filters at the same times.")
    r.says("{tab:compare} has the numbers at some of the measurements.")
    span = 1 / float(np.abs(bucy.steady(plant(p.N_c, p.N_m)).poles).max())
    target, counts = float(bucy.transient(three, [span]).P[0, 0, 0]), (40, 80, 160)
    ends = [float(covariances(discretise(three, span / n), n).P_plus[-1, 0, 0]) for n in counts]
    if p.N_c:
        r.order("P11⁺ at the shortest time constant, towards P11(t) as dt → 0", [target - P for P in ends], 1.0,
                ("recursion", "Riccati equation, integrated"))


PARTS = Skeleton(
    result=result,
    key="variances",
    analysis=(part_a, part_b, data_sets),
    plan=plan,
    experiment=(part_c, ensembles, explanation),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    two, three = plant(p.N_c, p.N_m), model(p.N_c, p.N_m, p.var_hc0, p.mean_hc0)
    own = (p.N_c, p.N_m, p.var_hc0)
    names = ("in plain units", "as printed") if own == UNITS else ("as printed" if own == PRINTED else "as given", "in plain units")
    other = PRINTED if own == UNITS else UNITS
    second = (plant(*other[:2]), model(*other, p.mean_hc0))
    return PARTS.report(META, p, experiment, names=names, second=second, answer=by_hand.analytic(p), two=two, three=three,
                        pair=discretise(two, p.dt), sampled=discretise(three, p.dt))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
