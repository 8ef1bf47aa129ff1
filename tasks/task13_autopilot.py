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
from ctlabs.tasks._task13_coefficients import TIME, coefficients, constants, scalar, transient
from ctlabs.tasks._task13_experiment import ensembles, plan
from ctlabs.tasks.answers import task13 as by_hand
from ctlabs.tasks.answers.task13 import A0, A1, B0, B1

from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import largest
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import interop, observability, shaping
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, LabParameters, Positive, Real, Variance, given
from ctlabs.reporting.report import EXACT, SOLVER, Report
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

    N_c: Variance = given(1296.0, unit="m²·s", meaning="strength of the noise of the command")
    N_m: Positive = given(6561.0, unit="m²·s", meaning="strength of the noise of the measured altitude")
    var_hc0: Variance = given(506250000.0, unit="m²", meaning="variance of the commanded constant")
    mean_hc0: Real = given(3000.0, unit="m", meaning="mean of the commanded constant")
    dt: Positive = given(1.0, unit="s", meaning="period of the sampled measurements")
    steps: Count = given(300, unit="1", meaning="sampled measurements in the experiment")


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
    r.math(r"\dot h = -a_1h + x_2 + b_1h_c, \quad \dot x_2 = -a_0h + b_0h_c, \qquad \frac{h(s)}{h_c(s)} = \frac{b_1s + b_0}{s^2 + a_1s + a_0}")
    r.says("with $b_1 = {b1}$, $b_0 = {b0}$, $a_1 = {a1}$, $a_0 = {a0}$. The transfer function is strictly proper, so the noise of the command enters the states and not the output, and the results for the altitude do not depend on the choice of states. The command $h_c = h_{c0} + \\delta h_c$ adds a third state, $\\dot{h}_{c0} = 0$:",
           b1=B1, b0=B0, a1=A1, a0=A0)
    r.model(three)
    r.says("(The second column of G belongs to the constant, which nothing drives.) The sheet gives no statistics of h and $x_2$ at t = 0. Settled flight at the commanded altitude is assumed: $(h, x_2, h_{c0}) = q\\,h_{c0}$ with the equilibrium $q = (1, {q2}, 1)$, hence $P_0 = \\mathrm{var}(h_{c0})\\,qq^T$, a singular matrix, and the mean $\\bar{h}_{c0}\\,q$.",
           q2=float(three.P0[1, 2] / three.P0[2, 2]) if p.var_hc0 else A1 - B1)
    scalar(r)
    coefficients(r, p, answer, two, three)
    transient(r, p, answer, three)


def part_b(r, p, answer, pair, sampled):
    """Sampled measurements."""
    r.section("b", "Measurements once per period")
    r.says('A measurement with the white noise of strength $N_m$ once per dt is taken as one with the variance $R_d = N_m/dt = {R}$ m² (the sheet\'s "intensity", at dt = 1 s the same number). The states are those of (a); over a period',
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
        r.math(f"{name}^-(t_{{k+1}}) = " + terms)
    r.says("**Update** with the innovation $\\nu = h_m - \\hat{h}^-$, and the covariance in six scalars, $i \\le j$, with $\\Phi$ and $Q_d$ of above:")
    r.math(r"\hat h^+ = \hat h^- + K_1\nu, \quad \hat x_2^+ = \hat x_2^- + K_2\nu, \quad \hat h_{c0}^+ = \hat h_{c0}^- + K_3\nu, \qquad K_i = \frac{P_{1i}^-}{P_{11}^- + R_d}")
    r.math(r"P_{ij}^-(t_{k+1}) = \sum_{l,m}\varphi_{il}\varphi_{jm}P_{lm}^+(t_k) + q_{ij}, \qquad P_{ij}^+ = P_{ij}^- - K_iP_{1j}^-")
    r.says("The gains come from this recursion, run beforehand from $P_0$. For the same reason as in (a) the three-state equation has no stabilising solution, and the limits are those of the two driven states.")
    if c is not None:
        r.math(r"c = {c}", c=c)
    sampled_limit(r, p, answer, pair, sampled)


def sampled_limit(r, p, answer, pair, sampled):
    """The limit of the sampled filter, and its way there."""
    limit, routes = steady.solve(pair), ("Riccati equation", "spectral factorisation")
    r.value("altitude_variance_prior_steady", limit.P_minus[0, 0], "m²", agrees=answer, routes=routes)
    r.value("altitude_variance_posterior_steady", limit.P_plus[0, 0], "m²", agrees=answer, routes=routes)
    r.value("altitude_gain_steady", limit.K[0, 0], "1", agrees=answer, routes=routes)
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
    r.says('**The data.** The sheet prints 22500², 36² and 81². They are taken as they stand, yet such numbers are more likely units that lost their letter, "22500 m²" and so on; both readings are computed:')
    own = (p.N_c, p.N_m, p.var_hc0)
    sets = {"as printed": PRINTED, "without the squares": UNITS}
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
                     100 * (last[0, 0] / limit.P[0, 0] - 1) if N_c else None, last[2, 2]))
    r.table("data", ["data", "N_c", "N_m", "var h_c0, m²", "P11(∞), m²", "K1(∞), 1/s", "P⁻(∞), m²", "P⁺(∞), m²", "K(∞)", "P11(300 s), m²", "above its limit, %", "P33(300 s), m²"], rows,
            "Two readings of the data.")


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
    label = text("dt = {dt} s", dt=p.dt)
    if top > 0:
        figure = plots.sampled({label: plan_b}, t, continuous.P[:, 0, 0], xlabel=TIME, ylabel="$P_{11}$, m²", log="xy")
        r.figure("sawtooth", figure,
                 "Variance of the altitude from the start, both axes logarithmic: the continuous P(t) and the sawtooth of the sampled filter.")
        figure = plots.sampled({label: plan_b}, t, continuous.P[:, 0, 0], xlabel=TIME, ylabel="$P_{11}$, m²",
                               limit=answer["altitude_variance_steady_continuous"], ylim=(0.0, 2 * top))
        r.figure(
            "sawtooth_late",
            figure,
            "The same on a linear scale: P(t) runs between the teeth, both towards limits that they have not reached while the command is still being learnt."
            if p.var_hc0
            else "The same on a linear scale: P(t) runs between the teeth.",
        )
    shown = continuous.P[:, 0, 0] > 0
    log = "xy" if shown.any() and p.var_hc0 else "x"
    figure = plots.gains(t, continuous.K, plan_b,
                         names=["|$K_1$|", "|$K_2$|", "|$K_3$|"] if log == "xy" else ["$K_1$", "$K_2$", "$K_3$"],
                         units=["1/s", "1/s²", "1/s"], xlabel=TIME, log=log)
    r.figure("gains", figure, "Gains of the continuous filter, and those of the sampled filter divided by its period.")
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
    r.table("compare", ["measurement", "t, s", "P11⁻, m²", "P11⁺, m²", "P11(t), m²", "√P33⁺, m"], rows,
            "Both filters at the same times.")
    span = 1 / float(np.abs(bucy.steady(plant(p.N_c, p.N_m)).poles).max())
    target, counts = float(bucy.transient(three, [span]).P[0, 0, 0]), (40, 80, 160)
    ends = [float(covariances(discretise(three, span / n), n).P_plus[-1, 0, 0]) for n in counts]
    if p.N_c:
        r.order("P11⁺ at the shortest time constant, towards P11(t) as dt → 0", [target - P for P in ends], 1.0,
                ("recursion", "Riccati equation, integrated"))


def explanation(r, p, answer):
    """Why sampling costs what it does."""
    prior, posterior, limit = (
        answer[f"altitude_variance_{name}"] for name in ("prior_steady", "posterior_steady", "steady_continuous")
    )
    if not limit:
        r.says("**Explanation.** Without noise in the command both filters learn the flight exactly, and the period makes no difference to the limit.")
        return
    found = [
        r.values[f"altitude_variance_{name}"].value
        for name in ("prior_steady", "posterior_steady", "steady_continuous")
    ]
    cost = 100 * (0.5 * (found[0] + found[1]) / found[2] - 1)
    r.value("sampling_cost", cost, "%")
    r.check("cost of sampling", cost, 100 * (0.5 * (prior + posterior) / limit - 1),
            ("Riccati equations", "spectral factorisation"), SOLVER, scale=100.0)
    r.says("**Explanation.** The steady filter has {constants}, the period is {dt} s. {words} Over a period the variance swings between {posterior} and {prior} m², and the mean of the two, {mean} m², is {cost} % above the continuous limit {limit} m². What the sampled filter loses is only what the altitude does between two measurements; their information is the same, for $R_d\\,dt = N_m$.",
           constants=constants(answer), dt=p.dt, posterior=posterior, prior=prior, mean=0.5 * (prior + posterior),
           cost=round(cost, 4), limit=limit, words=slowness(p, answer))


def slowness(p, answer):
    """Whether the filter is slow beside the period."""
    shortest = min(1 / math.hypot(*pole) for pole in answer["filter_poles_continuous"])
    if p.dt <= 0.2 * shortest:
        return text("It averages over some {n} measurements, so it matters little when exactly they come.",
                    n=round(shortest / p.dt))
    if p.dt <= shortest:
        return "It averages over a few measurements only, and sampling is felt."
    return "The period is longer than the filter's memory: each measurement stands almost alone, and sampling is felt strongly."


def conclusions(r, p, answer):
    """What the numbers say."""
    limit, lines = answer["altitude_variance_steady_continuous"], []
    if limit:
        lines.append(text("The continuous filter estimates the altitude with a variance that tends to {P} m² (σ = {sd} m) and the gain {K} 1/s; it has {constants}.",
                          P=limit, sd=math.sqrt(limit), K=answer["altitude_gain_steady_continuous"], constants=constants(answer)))
    else:
        lines.append("Without noise in the command the variance of the altitude tends to 0, like that of the command: in the end the model alone tells the altitude.")
    lines.append("The gains cannot be had from an algebraic Riccati equation of the three states, since nothing drives the constant command; they are integrated from P0.")
    if p.var_hc0:
        lines.append(text("The commanded constant becomes known like (N_c + N_m)/(t − t*), t* = {origin} s: σ = {sd} m at 300 s. Its gain K3 tends to 0.",
                          origin=answer["command_time_origin"], sd=math.sqrt(answer["command_variance_continuous"][3])))
    else:
        lines.append("The command is known from the start, and only the noise of the command and of the measurements counts.")
    above = r.values["altitude_excess_300s"].value
    if above is not None and abs(above) > 1:
        lines.append(text("At 300 s the variance of the altitude is {above} % above its limit: the filter has not settled by the 1 % criterion.",
                          above=above))
    elif above is not None:
        lines.append(text("At 300 s the variance of the altitude is within 1 % of its limit ({above} %).", above=above))
    if limit:
        cost = r.values["sampling_cost"].value
        word = "nearly as good as" if cost < 5 else "worse than"
        lines.append(text("Measurements every {dt} s are {word} continuous ones: the variance swings between {posterior} and {prior} m², on average {cost} % above the continuous limit.",
                          dt=p.dt, word=word, posterior=answer["altitude_variance_posterior_steady"], prior=answer["altitude_variance_prior_steady"], cost=round(cost, 4)))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_a, part_b, data_sets),
    plan=plan,
    experiment=(part_c, ensembles, explanation),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    two, three = plant(p.N_c, p.N_m), model(p.N_c, p.N_m, p.var_hc0, p.mean_hc0)
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), two=two, three=three,
                        pair=discretise(two, p.dt), sampled=discretise(three, p.dt))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
