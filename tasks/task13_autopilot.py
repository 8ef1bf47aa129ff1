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
import sympy
from ctlabs.tasks.answers import task13 as by_hand
from ctlabs.tasks.answers.task13 import A0, A1, B0, B1, TIMES

from ctlabs.filtering import bucy, steady
from ctlabs.labs.comparison import fine
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import largest, tested
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, interop, observability, shaping, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
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
TIME = "t, s"


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


def scalar(r):
    """Three estimate equations, three gains, six Riccati equations."""
    letters = sympy.symbols("a_1 a_0 b_1 b_0 N_c N_m", positive=True)
    a1, a0, b1, b0, N_c, N_m = letters
    equations = symbolic.scalar_equations(symbolic.SymbolicModel([[-a1, 1, b1], [-a0, 0, b0], [0, 0, 0]],
                                                  [[b1], [b0], [0]], [[N_c]], [[1, 0, 0]], [[N_m]],
                                                  states=("h", "x_2", "h_c0"))).latex()
    r.says("**The estimate** in scalar form (z is the measured altitude $h_m$):")
    for line in equations["estimate"]:
        r.math(line)
    r.says("**The gains** and the **six scalar Riccati equations** of their covariance:")
    r.math(r", \qquad ".join(equations["gain"]))
    for line in equations["riccati"]:
        r.math(line)


def coefficients(r, p, answer, two, three):
    """Why the gains come from integration, and what they tend to."""
    r.says("**The coefficients.** $a$, $b$ come from the transfer function. The gains need P(t), and P(t) needs $N_c$, $N_m$ and $P_0$, but no measurement: the six equations are integrated beforehand, from $P_0$, and $K_i(t) = P_{1i}(t)/N_m$. It is tempting to take the constant gains of the algebraic Riccati equation instead. It does not give them:")
    dual = ContinuousModel(
        F=three.F.T, G=np.eye(3), Q=np.zeros((3, 3)), H=(three.G @ three.Q).T, P0=np.zeros((3, 3)), states=three.states
    )
    undriven = observability.analyse(dual).undetectable_modes
    limit = bucy.steady(three)
    r.items([
        "No noise drives the mode with the {mode}: it neither decays nor is disturbed.",
        "So the Hamiltonian matrix of the equation has {zeros} eigenvalues on the imaginary axis (at 0) where a stabilising solution needs none.",
        "The covariance does have a limit, $P_{33} \\to 0$ and with it $K_3 \\to 0$, but with the limit gains the filter has the poles {poles} 1/s: the one at 0 means that an error of $\\hat{h}_{c0}$ would never be corrected. The constant gain is optimal only when nothing is left to estimate.",
    ], mode=undriven[0], zeros=2 * len(undriven), poles=", ".join(latex_number(float(z.real)) if not z.imag else f"{latex_number(float(z.real))} ± {latex_number(abs(float(z.imag)))}i" for z in limit.poles if z.imag >= 0))
    stabilising = bool((limit.poles.real < -observability.MARGIN * np.abs(limit.poles).max()).all())
    r.value("verdict_a", stabilising)
    r.says("(The value `verdict_a` says whether the algebraic equation of the three states has a stabilising solution; the criterion is that every pole of the filter with the limit gains has a negative real part.)")
    r.check("eigenvalues at 0 of the Hamiltonian matrix", 2 * len(undriven), by_hand.zero_roots(),
            ("undriven modes that do not decay, twice", "characteristic polynomial by sympy"), EXACT)
    two_state_limit(r, p, answer, two, limit)


def two_state_limit(r, p, answer, two, limit):
    """The limit that the two driven states have, and its filter."""
    r.says("**The limit** is that of the two states which the noise drives, with a command that is known. Its Riccati equation has a stabilising solution; by hand it comes from spectral factorisation, where $d(s) = s^2 + d_1s + d_0$ is the polynomial of the filter:")
    r.math(r"d(s)d(-s) = a(s)a(-s) + \frac{N_c}{N_m}b(s)b(-s) \;\Rightarrow\; d_0 = \sqrt{a_0^2 + \frac{N_c}{N_m}b_0^2}, \quad d_1 = \sqrt{a_1^2 - 2a_0 + \frac{N_c}{N_m}b_1^2 + 2d_0}")
    r.math(r"K_1 = d_1 - a_1, \qquad K_2 = d_0 - a_0, \qquad P_{11} = N_mK_1")
    found, routes = bucy.steady(two), ("Riccati equation", "spectral factorisation")
    r.value("altitude_variance_steady_continuous", found.P[0, 0], "m²", agrees=answer, routes=routes)
    r.value("altitude_gain_steady_continuous", found.K[0, 0], "1/s", agrees=answer, routes=routes)
    r.value("filter_polynomial", bucy.transfer_function(two)[1], "1", agrees=answer, routes=routes)
    poles = [[float(z.real), float(z.imag)] for z in np.sort_complex(found.poles)]
    r.value("filter_poles_continuous", poles, "1/s", agrees=answer, routes=routes)
    r.check("limit of the three-state covariance", limit.P[:2, :2], answer["steady_covariance"],
            ("Riccati equation without the undriven mode", "spectral factorisation"))
    r.check("limit of P33", limit.P[2, 2], 0.0, ("Riccati equation without the undriven mode", "proved"), EXACT)
    r.says("Here $P_{11} \\to {P}$ m², $K_1 \\to {K1}$ 1/s, $K_2 \\to {K2}$ 1/s², and the filter has {poles}.",
           P=found.P[0, 0], K1=found.K[0, 0], K2=found.K[1, 0], poles=constants(answer))
    omega = np.geomspace(1e-4, 10 * max(1.0, float(np.abs(found.poles).max())), 500)
    own = control.tf([B1, B0], [1, A1, A0])
    if p.N_c:
        figure = plots.bode({"filter, $\\hat{h}/h_m$": bucy.transfer_function(two), "autopilot, $h/h_c$": own}, omega)
        r.figure("bode", figure,
                 "Bode plot of the steady filter from the measured to the estimated altitude, and of the autopilot from the commanded altitude to the altitude.")
    else:
        r.says("Without noise in the command the altitude becomes known from the model alone: the steady filter is zero, and there is nothing to plot.")
    figure = plots.poles({"filter": found.poles, "autopilot": own})
    r.figure("poles", figure, "Poles of the steady filter, and the lightly damped poles and the zero of the autopilot.")


def constants(answer):
    """The time constants of the filter in words."""
    first, second = answer["filter_poles_continuous"]
    if first[1]:
        return text("an oscillation of {rate} rad/s that decays with the time constant {tau} s", rate=abs(first[1]),
                    tau=-1 / first[0])
    return text("the time constants {fast} s and {slow} s", fast=-1 / first[0], slow=-1 / second[0])


def transient(r, p, answer, three):
    """P(t) and its approach to the limit."""
    found = bucy.transient(three, (*TIMES, answer["far"]))
    P, routes = found.P, ("Riccati equation, integrated", "closed form, 60 digits")
    r.value("altitude_variance_continuous", P[:4, 0, 0], "m²", at=TIMES, agrees=answer, routes=routes)
    r.value("command_variance_continuous", P[:4, 2, 2], "m²", at=TIMES, agrees=answer, routes=routes)
    r.check("whole covariance at these times", P[:4], answer["covariance_continuous"], routes)
    six = by_hand.scalar_equations(p.N_c, p.N_m, answer["covariance_continuous"][0], TIMES)
    upper = [covariance[np.triu_indices(3)] for covariance in P[1:4]]
    r.check("the six scalar equations from 1 s on", upper, six,
            ("Riccati equation, integrated", "scalar equations by LSODA"))
    origin = None
    if p.var_hc0:
        r.says("**The command.** If $h_{c0}$ were known, two states would be left, whose filter starts from P = 0 and settles. An error of $h_{c0}$ by 1 m shifts its innovations by S(t), which tends to $a_0/d_0$. So the measurements inform on $h_{c0}$ at the rate $S^2/N_m$:")
        r.math(r"\frac1{P_{33}(t)} = \frac1{\mathrm{var}(h_{c0})} + \int_0^t\frac{S^2(\tau)}{N_m}d\tau, \qquad \frac{S^2}{N_m} \to \frac{a_0^2}{d_0^2N_m} = \frac1{N_c + N_m}")
        r.says("(here $b_0 = a_0$: the autopilot holds a constant command without error.) A constant can be told from slow noise only through noise of both kinds, $N_c + N_m$, and its variance falls like one over time, from an origin t* that the beginning decides:")
        r.math(r"P_{33} \to \frac{N_c + N_m}{t - t^*}, \qquad P_{11} \to P_{11}(\infty) + \frac{N_m}{t - t^*}, \qquad K_3 \to \frac{\sqrt{1 + N_c/N_m}}{t - t^*} \to 0")
        r.says("The second follows since the altitude's error is that with the command known plus S times that of the command. ∎")
        origin, far = answer["far"] - (p.N_c + p.N_m) / P[4, 2, 2], answer["far"]
        r.value("command_time_origin", origin, "s")
        # t* is what is left of the late time t when (N_c + N_m)/P33 is taken from it.
        r.check("command time origin", origin, answer["command_time_origin"], routes, SOLVER, scale=far + abs(origin))
        late = far - origin
        excess = P[4, 0, 0] - answer["altitude_variance_steady_continuous"]
        r.check(text("P11 − P11(∞) at {t} s", t=far), excess, p.N_m / late, ("Riccati equation, integrated", "asymptote"), SOLVER,
                scale=float(P[4, 0, 0]))
        r.check(text("K3(t − t*) at {t} s", t=far), found.K[4, 2, 0] * late, math.sqrt(1 + p.N_c / p.N_m),
                ("Riccati equation, integrated", "asymptote"))
    else:
        r.value("command_time_origin", None, "s", reason="the command is known from the start")
        r.says("**The command** is known from the start (its variance is 0), so $P_{33} = 0$ and $K_3 = 0$ all the time, and only two states are estimated.")
    transient_table(r, p, answer, three, found, P, origin)


def transient_table(r, p, answer, three, found, P, origin):
    """Variances and gains in time."""
    asymptote = [(p.N_c + p.N_m) / (t - origin) if origin is not None and t > origin else None for t in found.t]
    above = [100 * (C[0, 0] / answer["altitude_variance_steady_continuous"] - 1) if p.N_c else None for C in P]
    rows = [
        (t, C[0, 0], a, C[2, 2], s, *K[:, 0])
        for t, C, a, s, K in zip(found.t, P, above, asymptote, found.K, strict=True)
    ]
    r.table("transient", ["t, s", "P11, m²", "above its limit, %", "P33, m²", "(N_c + N_m)/(t − t*), m²", "K1, 1/s", "K2, 1/s²", "K3, 1/s"], rows,
            "Variances and gains of the continuous filter; the last row is at 30 times its longest time constant.")
    if P[2, 0, 0] > P[1, 0, 0] and p.var_hc0:
        r.says("P11 need not fall all the time: it is the sum of the variance with the command known, which rises from 0 to the limit, and of $S^2P_{33}$, which falls. Here it rises from {early} m² at 10 s to {late} m² at 60 s.",
               early=P[1, 0, 0], late=P[2, 0, 0])
    settled(r, p, answer, above[3], origin)
    figures(r, p, answer, three, origin)


def settled(r, p, answer, above, origin):
    """Whether the filter has settled at 300 s."""
    if above is None:
        r.value("altitude_excess_300s", None, "%", reason="the limit is 0")
        r.says("Without noise in the command $P_{11}$ tends to 0 and never stays within a fraction of its limit: there is no settling.")
        return
    r.value("altitude_excess_300s", above, "%")
    hand = 100 * (answer["altitude_variance_continuous"][3] / answer["altitude_variance_steady_continuous"] - 1)
    r.check("excess of P11 at 300 s", above, hand, ("Riccati equation, integrated", "closed form, 60 digits"), SOLVER,
            scale=100.0)
    if abs(above) <= 1:
        r.says("At 300 s $P_{11}$ is {above} % from its limit: by the 1 % criterion the altitude has settled, while $P_{33}$ goes on falling.",
               above=above)
    else:
        words = (
            text(
                "By the asymptote the 1 % band is reached at about {t} s.",
                t=origin + 100 * p.N_m / answer["altitude_variance_steady_continuous"],
            )
            if origin is not None
            else ""
        )
        r.says("At 300 s $P_{11}$ is still {above} % from its limit: by the 1 % criterion it has **not settled**, for what is left of the command's error is in it. {words}",
               above=above, words=words)


def figures(r, p, answer, three, origin):
    """P11(t), P33(t)."""
    t = np.geomspace(0.1, max(1000.0, p.steps * p.dt), 121)
    curve = bucy.transient(three, t).P
    variances = {"$P_{11}$, altitude": curve[:, 0, 0], "$P_{33}$, command": curve[:, 2, 2]}
    limits = {"$P_{11}$, altitude": answer["altitude_variance_steady_continuous"]} if p.N_c else {}
    if origin is not None:
        late = t > max(1.2 * origin, origin + 10)
        variances["$(N_c + N_m)/(t - t^*)$"] = np.where(late, (p.N_c + p.N_m) / np.where(late, t - origin, 1.0), np.nan)
    shown = {name: np.where(values > 0, values, np.nan) for name, values in variances.items() if (values > 0).any()}
    if shown:
        figure = plots.transient(t, shown, xlabel=TIME, ylabel="variance, m²", log="xy",
                                 limits={name: value for name, value in limits.items() if name in shown})
        r.figure("variances", figure,
                 "Variances of the continuous filter: the altitude tends to a limit, the command falls for ever along its asymptote.")
    else:
        r.says("All variances are zero: nothing is unknown, and there is nothing to plot.")


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


def plan(r, p, experiment, two, three):
    """Every number chosen."""
    fastest = float(np.abs(bucy.steady(two).poles).max())
    close = fine(three, p.dt, p.steps, 1 / fastest)
    r.says("White noise has no values, so the continuous filter is simulated by the discrete one with a period δ much shorter than the filter's time constants and measurements of the variance $N_m/\\delta$. The states move by the exact transition over δ; only the measurements are replaced, and the filter's variance differs from P(t) by O(δ), as stated with the results. In the pictures of single runs both filters watch the same flight.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period of the sampled measurements dt, s", p.dt, "given"],
        ["sampled measurements", p.steps, "given"],
        ["period δ in place of continuous time, s", close.model.dt, text("a hundredth of 1/|fastest pole| = {tau} s or dt if that is shorter; a whole number in dt", tau=1 / fastest)],
        ["steps of length δ", close.steps, "the same horizon, 4000 steps at most"],
        ["initial state", "settled flight", "the sheet gives none: $P_0$ of (a), by which the first innovations are of the order of 10⁴ m with the printed data" if p.var_hc0 > 1e8 else "the sheet gives none: $P_0$ of (a)"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each ensemble"],
    ], "Plan of the experiment.")
    return {"close": close}


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


def one_flight(r, p, experiment, sampled, close):
    """Both filters in one flight."""
    seen, ratio = close.one_path(experiment, sampled), close.ratio
    runs = dict(zip(("continuous filter", "sampled filter"), zip(seen.values(), (1, ratio), strict=False), strict=False))
    last, cut = list(seen.values())[-1], slice(ratio, None, ratio)
    for i, key, name, caption in (
        (0, "altitude", "altitude, m", "One flight: the altitude h, the sampled measurements $h_m$, and the estimates of both filters with their ±σ bands, from the first measurement on."),
        (2, "command", "commanded altitude $h_{c0}$, m", "The estimate of the command in the same flight, with ±√P33."),
    ):
        if i == 2 and not p.var_hc0:
            continue
        # The altitude from the first sampled measurement on: what precedes it is off the scale.
        begin = ratio if i == 0 and ratio < close.steps else 1
        tracks = {}
        for who, (e, step) in runs.items():
            shown = slice(max(begin, step), None, step)
            tracks[who] = (e.t[shown], e.x_plus[shown, i, 0], e.sd_plus[shown, i])
        measured = (last.t[cut], last.z[cut, 0, 0]) if i == 0 and len(runs) == 2 else None
        figure = plots.estimates((last.t[begin:], last.truth[begin:, i, 0]), tracks, xlabel=TIME, ylabel=name,
                                 measurements=measured, log="x" if i else "")
        r.figure(key, figure, caption)


def ensembles(r, p, answer, experiment, three, sampled, close):
    """Both filters on simulated data."""
    one_flight(r, p, experiment, sampled, close)
    # What the noise has brought in must stand above the rounding of what the filter began with.
    regular = answer["altitude_variance_steady_continuous"] > 1e3 * np.finfo(float).eps * three.P0.max()
    if not regular:
        r.says("The NEES is not tested: with so little noise in the command the errors of the three states are multiples of one another, and other directions of the covariance hold nothing but rounding.")
    rows = [
        ensemble(r, experiment, three, "continuous (period δ)", "ensemble_continuous", close.model, close.steps, 2, regular),
        ensemble(r, experiment, three, "sampled", "ensemble", sampled, p.steps, 3, regular),
    ]
    r.table("ensemble", ["filter", "to t, s", "σ of h in theory, m", "RMS of h, m", "mean error of h, m", "σ of h_c0 in theory, m", "RMS of h_c0, m", "P11⁺ from P11(t), % at most", "largest deviation, σ"], rows,
            "The ensembles at the last instant. The deviation of P11⁺ from the continuous P11(t) is that of theory, over the whole horizon; the last column is over all instants and tests.")
    r.says("With the period δ in place of continuous time the variance of the altitude differs from P(t) by {percent} % at most: to that accuracy the ensemble shows the continuous filter.",
           percent=rows[0][7])


def ensemble(r, experiment, three, name, key, system, steps, stream, regular):
    """One of the filters against theory; the row of it."""
    stats, theory = experiment.statistics(system, steps=steps, stream=stream), covariances(system, steps)
    worst = tested(r, name, {
        "mean error": chance.bias(stats, theory.P_plus), "error variance": chance.variance(stats, theory.P_plus),
        "NIS": chance.nis(stats), **({"NEES": chance.nees(stats)} if regular else {}),
    })
    some = np.unique(np.geomspace(1, steps, 150).astype(int))
    continuous, discrete = bucy.transient(three, theory.t[some]).P[:, 0, 0], theory.P_plus[some, 0, 0]
    apart = np.abs(discrete / np.where(continuous > 0, continuous, 1.0) - 1)[continuous > 0]
    figure = plots.ensemble_log(stats, theory.P_plus, xlabel=TIME, units=["m", "m/s", "m"],
                                names=["h", "x2", "h_c0"], log="xy")
    r.figure(key, figure,
             "Ensemble against theory, {name} filter: RMS on a logarithmic scale and mean error in units of σ, with the bands of 95 % of ensembles; NEES and NIS averaged over the runs.",
             name=name)
    return (name, theory.t[-1], theory.sd_plus[-1, 0], stats.rms[-1, 0], stats.bias[-1, 0], theory.sd_plus[-1, 2],
            stats.rms[-1, 2], 100 * float(apart.max(initial=0.0)), worst)


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
