"""What labs 3 and 4 share: a coordinate whose velocity, or acceleration, is a random constant plus Brownian motion.

The two sheets ask the same questions of n = 2 and n = 3 integrators in a row. A lab states its parameters, the closed
forms of its sheet and the steady gain in its own terms; :func:`answer_sheet` does the rest.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import sympy
from ctlabs.tasks._kinematics_experiment import constant, part_d, plan, sweeps, wrong_start
from ctlabs.tasks._kinematics_model import (
    CURVE,
    QUANTITY,
    Lab,
    continuous,
    definition,
    factors,
    growth,
    listed,
    named,
    sampled,
    squared,
)
from ctlabs.tasks._kinematics_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import kinematics as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, settling_step, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import kinematics, observability, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import latex, number, prose, text

SIGMA, TAU = sympy.symbols("sigma_w tau", positive=True)
#: New units of length (m) and time (s) in which everything is computed again; no simple powers of each other.
METRE, SECOND = 3.7, 0.23
#: Periods after which the covariance without measurements is given.
PERIODS = 20
MIXED = "SI"
MISPRINT = {
    2: "The sheet prints $x$ for the constant; the method notes write $c_x$.",
    3: "The sheet prints $x(t)$ for the acceleration, and $a$ for its constant part.",
}


class KinematicParameters(LabParameters):
    """What may be changed in both labs."""

    tau: Positive = given(1.0, unit="s", meaning="period of the measurements", draw=one_of(0.5, 1, 2))
    R: Variance = given(1.0, unit="m²", meaning="variance of the measurement error", draw=span(0.2, 4, 0.2))
    steps: Count = given(10, unit="1", meaning="number of measurements in the lists", symbol="N")


def part_a(r, lab):
    """The model of the sheet with uncorrelated noises."""
    p, words = lab.p, {"quantity": QUANTITY[lab.n], "last": lab.system.states[-1]}
    r.section("a", "The discrete model with a unit lower triangular noise matrix")
    r.says("The {quantity} is a random constant plus a Brownian motion, ${last}(t) = c + \\beta(t)$ with $\\beta(t_0) = 0$. The derivative of β is white noise w of strength $\\sigma_w^2$ (a diffusion, not a variance), and the constant is the initial value of ${last}$: {n} integrators in a row, of which the first is measured. {misprint}", n=lab.n, misprint=MISPRINT[lab.n], **words)
    r.math(r"\dot x(t) = Fx(t) + Gw(t), \qquad E[w(t)w(t')] = \sigma_w^2\,\delta(t - t'), \qquad z(t_i) = Hx(t_i) + v(t_i), \qquad E[v(t_i)v(t_j)] = R\,\delta_{ij}")
    equations = lab.chain.latex()
    for equation in equations[:4]:
        r.math(equation)
    r.says("The noise $w_d$ of covariance $Q_d$ becomes $G_d\\bar{w}_d$ with uncorrelated components: $\\bar{Q}_d$ is diagonal, $G_d$ unit lower triangular. Column by column, $d_1 = q_{11}$, $g_{i1} = q_{i1}/d_1$, and the same for what is left, $Q_d - d_1g_1g_1^T$:")
    for equation in equations[4:6]:
        r.math(equation)
    r.math(r"x(t_{i+1}) = \Phi x(t_i) + G_d\bar w_d(t_i)")
    r.says("This is the way from a continuous model to a discrete one of {ref:maybeck, section 4.9}. With the given numbers it is")
    r.model(lab.system)
    lower, variances, _factor = factors(p)
    routes = ("matrix exponential by doubling", "closed form")
    r.value("Phi", lab.system.Phi, MIXED, agrees=lab.answer, routes=routes, kind=EXACT)
    r.value("Qd", lab.system.Qd, MIXED, agrees=lab.answer, routes=routes, kind=EXACT)
    routes = ("LDLᵀ in floating point", "closed form")
    r.value("unit_lower_factor", lower, MIXED, agrees=lab.answer, routes=routes, kind=EXACT)
    r.value("diagonal_noise_variances", variances, MIXED, agrees=lab.answer, routes=routes, kind=EXACT)
    if p.sigma_w2:
        numbers = lab.chain.evaluate(sigma_w=math.sqrt(p.sigma_w2), tau=p.tau)
        r.check("Q_d of the chain", numbers.Qd, lab.system.Qd, ("symbolic chain", "matrix exponential by doubling"), EXACT)
    else:
        r.says("For $\\sigma_w^2 = 0$ there is no noise and $Q_d = 0$; $G_d$ is the one that holds for every $\\sigma_w^2$.")


def part_b(r, lab):
    """Standardised noises, and the units of everything."""
    r.section("b", "Standardised noises, and units")
    r.says("With $\\tilde{Q}_d = \\mathrm{diag}(\\sqrt{d_1}, \\dots)$ the noise is $\\bar{G}_d\\bar{w}$, whose independent components have variance 1: $Q_d = \\bar{G}_d\\bar{G}_d^T$. This lower triangular factor is Cholesky's.")
    r.math(lab.chain.latex()[6])
    r.math(r"x(t_{i+1}) = \Phi x(t_i) + \bar G_d\bar w(t_i), \qquad E[\bar w(t_i)\bar w^T(t_j)] = I\,\delta_{ij}")
    r.says("The last example of section 4.3 of the method notes {ref:semushin} drops $\\sigma_w$: its factor is that for $\\sigma_w = 1$. In section 4.4 $G_dQ_dG_d^T$ stands for $G_d\\bar{Q}_dG_d^T$, which is $Q_d$: the factor is applied once.")
    routes = ("Cholesky factor in floating point", "closed form")
    r.value("standardised_noise_factor", factors(lab.p)[2], MIXED, agrees=lab.answer, routes=routes, kind=EXACT)
    table = kinematics.units(continuous(lab.p))
    shown = [
        ("t, τ", "time, period", "t"), ("x", "state", "x"), ("w", "white noise of the model", "w"), ("Q", "its strength, the diffusion of β", "Q"),
        ("F", "system matrix", "F"), ("G", "noise input", "G"), ("H", "measurement matrix", "H"), ("x̄₀", "initial mean", "x0"), ("$P_0$", "initial covariance", "P0"),
        ("Φ", "transition matrix", "Phi"), ("$Q_d$", "covariance of the discrete noise", "Qd"), ("$\\bar w_d$ of (a)", "uncorrelated noises", "w_diagonal"), ("$G_d$", "their matrix", "Gd"),
        ("$\\bar Q_d$", "their variances, the diagonal", "Qd_diagonal"), ("w̄ of (b)", "standardised noises", "w_standardised"), ("$\\bar G_d$", "their matrix", "Gd_standardised"),
        ("z, v", "measurement and its error", "z"), ("R, S", "variance of the error, of the innovation", "R"), ("P", "error covariance", "P"), ("K", "gain", "K"),
    ]
    r.says("{tab:units} has the units of everything in the model.")
    r.table("units", ["quantity", "meaning", "SI unit, element by element"], [(symbol, meaning, plain_units(table[name])) for symbol, meaning, name in shown],
            "Units of all constants and variables; an element that is 0 has the unit of its place. $\\sigma_w^2$ is a diffusion, not a variance: the δ function in $E[ww']$ is 1/s.")
    rescaling(r, lab, table)


def plain_units(unit):
    """A unit, or a matrix of them, as words."""
    return str(unit) if isinstance(unit, kinematics.Unit) else [plain_units(element) for element in unit]


def rescaling(r, lab, table):
    """Dimensional analysis by numbers: the same model in other units of length and time."""
    r.says("**Check of the units.** All numbers are written in other units, {metre} m for the length and {second} s for the time, and everything is computed again from them. A quantity with the unit $\\mathrm{m}^a\\mathrm{s}^b$ must come out divided by ${metre}^a\\,{second}^b$, element by element: any other exponent, or a formula that adds unlike quantities, would show.", metre=METRE, second=SECOND)
    p, other = lab.p, kinematics.rescaled(continuous(lab.p), METRE, SECOND)
    tau, R = kinematics.converted(p.tau, table["t"], METRE, SECOND), kinematics.converted([[p.R]], table["R"], METRE, SECOND)
    changed = discretise(other, float(tau), R)
    q = p.model_copy(update={"sigma_w2": float(other.Q[0, 0]), "tau": float(tau)})
    for names, here, there in (
        (("Phi", "Qd"), (lab.system.Phi, lab.system.Qd), (changed.Phi, changed.Qd)),
        (("Gd", "Qd_diagonal", "Gd_standardised"), factors(p), factors(q)),
        (("P", "K"), *((s.P_plus[-1], s.K[-1]) for s in (covariances(lab.system, p.steps), covariances(changed, p.steps)))),
    ):
        for name, value, again in zip(names, here, there, strict=True):
            r.check(text("unit of {name}", name=name), again, kinematics.converted(value, table[name], METRE, SECOND), ("computed in other units", "converted by its unit"))


def part_c(r, lab, experiment):
    """The explicit solution, and the variances from a deterministic start."""
    p, n = lab.p, lab.n
    r.section("c", "Explicit solution; variances from a deterministic start")
    r.says("From $x(t_k) = \\Phi^kx(t_0) + \\sum_{m=0}^{k-1}\\Phi^mG_d\\bar{w}_d(t_{k-1-m})$ with $\\Phi^m = \\Phi(m\\tau)$, component by component; the part before the sum is that of the initial conditions, $\\bar{w}_j$ stands for $\\bar{w}_{d,j}(t_{k-1-m})$:")
    for equation in explicit_solution(lab):
        r.math(equation)
    r.says("For a deterministic start only the sum is random. Its terms are independent, and $\\Phi^mG_d\\bar{Q}_dG_d^T(\\Phi^m)^T$ is what the noise between $m\\tau$ and $(m+1)\\tau$ before the end contributes; the sum over m is therefore one integral, without τ. At any time t after t0:")
    r.math(rf"E\bigl[(x - Ex)(x - Ex)^T\bigr] = {sympy.latex(lab.chain.Qd.subs(TAU, sympy.Symbol('t', positive=True)))}", "growth")
    alone = replace(lab.system, R=[[math.inf]], P0=np.zeros((n, n)), dt=1.0)
    grown = covariances(alone, PERIODS)
    r.value("open_loop_covariance", grown.P_minus[-1], MIXED, agrees=lab.answer, routes=("recursion without measurements", "integral, closed form"))
    by_sum = by_hand.spread_by_sum(lab.answer["Phi"], lab.answer["unit_lower_factor"], lab.answer["diagonal_noise_variances"], PERIODS)
    r.check("sum over the noises w̄", by_sum, lab.answer["open_loop_covariance"], ("explicit solution", "integral, closed form"))
    stats = experiment.statistics(alone, steps=PERIODS, stream=1)
    agreement(r, "without measurements", stats, grown.P_plus, consistent=False)
    rows = [(k, k * p.tau, *np.sqrt(np.diag(by_hand.spread(n, p.sigma_w2, k * p.tau))), *(rms(stats, k, j) for j in range(n))) for k in (1, 2, 5, 10, PERIODS)]
    labels = named(lab)
    if not p.sigma_w2:
        r.says("Without noise the state follows its initial values exactly: all these variances are 0.")
        return
    r.table("open_loop", ["k", "t, s", *(text("σ of {state}", state=s) for s in labels), *(text("ensemble: {state}", state=s) for s in labels)], rows, "Standard deviations of the state from a deterministic start, theory and ensemble.")
    i = np.arange(1, PERIODS + 1)
    points = {"_" * j + "ensemble": (i, stats.rms[1:, j]) for j in range(n)}
    figure = plots.lines(i, {f"{s}": grown.sd_plus[1:, j] for j, s in enumerate(labels)}, xlabel="number of periods k", ylabel=text("σ of the state ({units})", units=", ".join(lab.system.units)), points=points, log="xy")
    r.figure("open_loop", figure, "Growth of the state's standard deviations from a deterministic start: straight lines on both logarithmic axes, from √t for the last state to the power {power} of t for x.", power=n - 0.5)
    r.says("{fig:open_loop} and {tab:open_loop} show the growth: each integration makes the growth steeper by one power of t, so that the state farthest from the noise grows fastest in the end.")


def explicit_solution(lab):
    """The components of the explicit solution in LaTeX."""
    m, k = sympy.symbols("m k")
    start = [sympy.Symbol(f"{name[0]}_{{{name[2:]}0}}") for name in lab.system.states]
    initial = lab.chain.Phi.subs(TAU, k * TAU)
    kernel = (lab.chain.Phi.subs(TAU, m * TAU) * lab.chain.unit_lower).applyfunc(lambda e: sympy.Poly(sympy.expand(e), m).as_expr())
    found = []
    for i, name in enumerate(lab.system.states):
        terms = [(sympy.latex(kernel[i, j]), f"\\bar w_{j + 1}") for j in range(lab.n) if kernel[i, j] != 0]
        inside = " + ".join(noise if factor == "1" else rf"\Bigl({factor}\Bigr){noise}" if " + " in factor else rf"{factor}\,{noise}" for factor, noise in terms)
        before = " + ".join(sympy.latex(initial[i, j] * start[j]) for j in range(i, lab.n))
        found.append(rf"{name}(t_k) = {before} + \sum_{{m=0}}^{{k-1}}\Bigl[{inside}\Bigr]")
    return found


def existence(r, lab):
    """The filter, and why its errors stay bounded."""
    p, n = lab.p, lab.n
    r.section("d", "The filter, and why its error variances are bounded")
    r.says("The filter {ref:maybeck, section 5.3} predicts and updates,")
    r.math(r"\hat x(t_i^-) = \Phi\hat x(t_{i-1}^+), \qquad P(t_i^-) = \Phi P(t_{i-1}^+)\Phi^T + Q_d, \qquad \hat x(t_0^+) = \bar x_0, \quad P(t_0^+) = P_0")
    r.math(r"K_j(t_i) = \frac{P_{j1}(t_i^-)}{P_{11}(t_i^-) + R}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - \hat x_1(t_i^-)], \qquad P(t_i^+) = [I - K(t_i)H]P(t_i^-),", "filter")
    r.says("where the gain is $P^-H^T(HP^-H^T + R)^{-1}$ (the method notes omit the transpose), and the updates begin at $t_1$, as $P(t_0^+)$ is given.")
    seen, unit = observability.analyse(lab.system), sampled(p.model_copy(update={"sigma_w2": 1.0}))
    r.says("**Observability.** n measurements in a row determine the state: the matrix of the rows $H, H\\Phi, \\dots, H\\Phi^{n-1}$ has the determinant $\\tau^{n(n-1)/2} \\ne 0$ for every period. The rank found numerically is {rank} of {n}.", rank=seen.rank, n=n)
    gramian = observability.gramian(lab.system, n)
    r.check("determinant of the observability Gramian of n samples", np.linalg.det(gramian), p.tau ** (n * (n - 1)), ("Gramian", "τ^(n(n−1))"))
    r.says("**Controllability by the noise.** $\\det Q_d = \\prod d_j > 0$ for $\\sigma_w^2 > 0$: the noise reaches every direction of the state within one period. Both properties together give one limit of the error covariance for every $P_0$, and a filter that forgets its start; this is the theorem of {ref:anderson_moore, section 4.4}, see also {ref:maybeck, section 5.8}.")
    r.check("determinant of Q_d for σ_w² = 1", np.linalg.det(unit.Qd), float(np.prod(factors(p.model_copy(update={"sigma_w2": 1.0}))[1])), ("determinant", "product of the variances in Q̄_d"))
    r.value("verdict_d", bool(seen.ok))
    r.says("For bounded error variances it is enough that every mode that does not decay is observed. Here all modes have λ = 1, and all are observed.")
    deadbeat = backward_gain(n, p.tau)
    bound = sensitivity.fixed_gain(replace(lab.system, P0=np.zeros((n, n))), deadbeat, n).P_plus[n]
    r.says("**Bounds, without the theorem.** Put {curve} through the last {n} measurements: an estimate that uses nothing older, so that its error comes from the errors of these measurements and from the noise of the periods between them. It is the filter with the constant gain $K_* = ({gain})^T$, all of whose poles are 0, and its error variances are, in the order of the states, {bound}. The optimal filter, which uses all measurements and $P_0$, has no larger ones from measurement {n} on, whatever $P_0$. So they are bounded, while those of the state ($\\sigma_w^2 > 0$) grow without bound, that of x like {growth}. ∎",
           curve=CURVE[n], n=n, gain=", ".join(latex(float(k)) for k in deadbeat[:, 0]), bound=listed(f"{prose(float(b))} {u}" for b, u in zip(np.diag(bound), squared(lab), strict=True)), growth=growth(n))
    r.check("error covariance of the backward differences", bound, by_hand.backward_differences(n, p.sigma_w2, p.tau, p.R), ("filter with poles at 0", "polynomial through n measurements"))
    variances = np.diagonal(covariances(lab.system, max(p.steps, n + 10)).P_plus, axis1=1, axis2=2)[n:]
    scale = np.where(np.diag(bound) > 0, np.diag(bound), 1.0)
    r.holds("P⁺ ≤ that of the last n measurements", (np.diag(bound) - variances) / scale, ("recursion", "bound proved"), size=1.0)


def backward_gain(n, tau):
    """The gain that puts all poles at z = 0: the polynomial of degree n − 1 through the last n measurements."""
    return np.array({2: [1.0, 1.0], 3: [1.0, 1.5, 1.0]}[n])[:, None] / tau ** np.arange(n)[:, None]


def limits(r, lab):
    """Lists over the measurements, limits and settling."""
    p = lab.p
    schedule, at = covariances(lab.system, p.steps), [i * p.tau for i in range(1, p.steps + 1)]
    routes = ("recursion", "square-root arrays")
    r.value("gain", schedule.K[1:, :, 0], MIXED, at=at, agrees=lab.answer, routes=routes)
    r.value("posterior_covariance", schedule.P_plus[1:], MIXED, at=at, agrees=lab.answer, routes=routes)
    if p.R:
        k = min(p.steps, 12)
        whole = by_hand.least_squares(lab.answer["Phi"], lab.answer["standardised_noise_factor"], p.R, p.P0, k)[0]
        r.check(text("P⁺ at measurement {k}", k=k), schedule.P_plus[k], whole, ("recursion", "least squares over the trajectory"))
    closed(r, lab)
    routes = ("Riccati equation", "spectral factorisation")
    r.value("prior_covariance_steady", lab.limit.P_minus, MIXED, agrees=lab.answer, routes=routes)
    r.value("posterior_covariance_steady", lab.limit.P_plus, MIXED, agrees=lab.answer, routes=routes)
    r.value("gain_steady", lab.limit.K[:, 0], MIXED, agrees=lab.answer, routes=routes)
    table_of_limits(r, lab)
    r.value("settling_step", lab.settled, agrees=lab.answer, routes=("recursion", "square-root arrays"), reason="the limits are 0, and a variance that tends to 0 like a power of 1/i never stays within 1 % of it")
    invariance(r, lab)


#: By n: the difference that is taken, its spectrum's two terms, and the values of the B-spline at whole lags.
SPECTRUM = {
    2: ("second", r"u^2", r"1 - \frac u6", r"$\tfrac23$ and $\tfrac16$"),
    3: ("third", r"u^3", r"1 - \frac u4 + \frac{u^2}{120}", r"$\tfrac{66}{120}$, $\tfrac{26}{120}$ and $\tfrac1{120}$"),
}
GAINS = {
    2: r"u = \frac\rho{12} \pm \sqrt{\frac{\rho^2}{144} - \rho}, \quad z_j + z_j^{-1} = 2 - u_j, \qquad \bar K_1 = 1 - z_1z_2, \qquad \bar K_2\tau = (1 - z_1)(1 - z_2)",
    3: r"\bar K_1 = 1 - z_1z_2z_3, \qquad \bar K_3\tau^2 = (1 - z_1)(1 - z_2)(1 - z_3), \qquad \bar K_2\tau = 3 - (z_1 + z_2 + z_3) - \bar K_1 - \tfrac12\bar K_3\tau^2",
}


def closed(r, lab):
    """The steady gains from the zeros of a spectrum."""
    n, p = lab.n, lab.p
    order, noise, state, values = SPECTRUM[n]
    r.says("**The limit in closed form.** Take the {order} difference of the measurements. That of the position is a sum of pieces of the noise w, each weighted by a B-spline; its covariances at lag 0 and at the following lags are {values}, in units of {unit}. With $u = 2 - z - z^{-1}$, the spectrum of a first difference of white noise, and {ratio}, the spectrum of the differenced measurements is therefore",
           order=order, unit=f"$\\sigma_w^2\\tau^{2 * n - 1}$", values=values, ratio=f"${definition(n)}$")
    r.math(rf"R\,\Bigl[{noise} + \rho\,\Bigl({state}\Bigr)\Bigr].", "spectrum")
    r.says("In the steady state the same sequence is a moving average of the innovations, which are white; its coefficients are those of $A(z) = \\det(zI - (I - \\bar KH)\\Phi)$ {ref:anderson_moore, chapter 9}. So the zeros of {eq:spectrum} inside the unit circle are the poles $z_j$ of the filter. The determinant of $(I - \\bar KH)\\Phi$ is $1 - \\bar K_1$; with its trace and the value of A at $z = 1$ the gains follow:")
    r.math(GAINS[n], "gains")
    if 0 < lab.ratio < math.inf:
        z = 1 - np.array(by_hand.poles(n, p.sigma_w2 * p.tau ** (2 * n - 1), p.R), dtype=complex)
        r.says("Here $\\rho = {ratio}$ and the poles are {poles}.", ratio=lab.ratio, poles=listed(complex_number(x) for x in z))


def complex_number(x):
    """A pole in words."""
    return number(x.real) if abs(x.imag) < 1e-12 * abs(x) else f"{number(x.real)} {'+' if x.imag > 0 else '−'} {number(abs(x.imag))}i"


def table_of_limits(r, lab):
    """Each state's limits, and when its variance alone has settled."""
    variances = np.diagonal(covariances(lab.system, (lab.settled or 0) + 1).P_plus, axis1=1, axis2=2)
    rows = []
    for j, (name, unit, square) in enumerate(zip(lab.system.states, lab.system.units, squared(lab), strict=True)):
        before, after = lab.limit.P_minus[j, j], lab.limit.P_plus[j, j]
        alone = None if lab.settled is None else settling_step(variances[:, j : j + 1], [after])
        rows.append((f"${name}$, {unit}", f"{prose(before)} {square}", f"{prose(after)} {square}", math.sqrt(after), alone or "—", "—" if alone is None else alone * lab.p.tau))
    r.says("{tab:limits} has the limits of the error variances, which $P(t_i^-)$ and $P(t_i^+)$ approach from any $P_0$, and the time in which they do so from the given one.")
    r.table("limits", ["state", "variance before an update", "variance after it", "σ after it", "settled at measurement", "settled at, s"], rows,
            "Limits of the error variances and the time to reach them (within 1 %, state by state; the filter has settled when the last of them has).")


def invariance(r, lab):
    """In units of the period and of R everything depends on one ratio."""
    p, n = lab.p, lab.n
    r.says("**One ratio.** With τ as the unit of time and √R as that of length the filter has a single parameter, ρ: the gains $\\bar{K}_1, \\bar{K}_2\\tau, \\dots$ depend on ρ alone.")
    tau, R = 2.5 * p.tau, 7 * p.R
    other = steady.solve(sampled(p.model_copy(update={"tau": tau, "R": R, "sigma_w2": p.sigma_w2 * 7 / 2.5 ** (2 * n - 1)})))
    powers = np.arange(n)
    r.check("scaled steady gain, period 2.5 and R 7 times larger at the same ρ", other.K[:, 0] * tau**powers, lab.limit.K[:, 0] * p.tau**powers, ("scaled system", "given system"))
    ratios = np.logspace(-6, 6, 121)
    gains = np.array([by_hand.steady_state(n, ratio, 1.0, 1.0)[2] for ratio in ratios])
    labels = ["$\\bar{K}_1$", "$\\bar{K}_2\\tau$", "$\\bar{K}_3\\tau^2$"][:n]
    shown = {"given": ([lab.ratio] * n, lab.limit.K[:, 0] * p.tau**powers)} if 0 < lab.ratio < math.inf else None
    figure = plots.lines(ratios, dict(zip(labels, gains.T, strict=True)), xlabel=text("ratio {ratio}", ratio=f"${definition(n)}$"), ylabel="scaled steady gain", points=shown, log="xy")
    r.figure("gains", figure, "Steady gains in units of the period against ρ.")
    r.says("{fig:gains} shows them. Towards small ρ they fall like powers of {root}, along straight lines on these axes: the filter averages many measurements. For large ρ they stay finite: the last few measurements decide.", root=rf"$\rho^{{1/{2 * n}}}$")


def skeleton(closed_form: Callable[[Report, Lab], None]) -> Skeleton:
    """The parts of the report; ``closed_form`` adds what the lab knows of its steady gain."""
    return Skeleton(
        result=result,
        key="bounded",
        analysis=(part_a, part_b, part_c, existence, limits, closed_form),
        plan=plan,
        experiment=(part_d, sweeps, wrong_start, constant),
        discussion=discussion,
        answers=answers,
        conclusions=conclusions,
    )


def answer_sheet(meta: Mapping[str, Any], p: Any, answer: Mapping[str, Any], experiment: Experiment, parts: Skeleton) -> Report:
    """The report of one of the two labs."""
    system = sampled(p)
    F, G = np.eye(system.n, k=1, dtype=int), np.eye(system.n, dtype=int)[:, -1:]
    lab = Lab(p, answer, symbolic.chain(F, G, [[SIGMA**2]], TAU), system, steady.solve(system), settling(system))
    return parts.report(meta, p, experiment, lab=lab)
