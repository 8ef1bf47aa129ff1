r"""The Kalman–Bucy observer with coloured plant noise.

Source: a textbook section on the observer for coloured plant noise, with its example 10.25 (the formulas are lost in the scan
and rebuilt here from the text). The plant ẋ = Ax + Bu + Gw is driven by noise w that is not white but the output of a shaping
filter ẇ = A_w w + v0; y = Cx + v. The augmented state (x, w) has white noises only, so the observer is that of the augmented
model: it contains a model of the plant and one of the shaping filter.

Expected answer: in blocks K1 = P1CᵀR⁻¹, K2 = P12ᵀCᵀR⁻¹ and three equations for P1, P12, P2. Example: K(τ) = D e^(−α|τ|) has the
spectrum 2Dα/(ω²+α²) and the shaping filter √(2Dα)/(s+α); for a = −1, b = 1, α = 2, D = 1, r = 0.5 the variance of x tends to
0.226862. A filter that takes w for white noise claims 0.366025 and has 0.232051.
"""

import math
from dataclasses import replace

import numpy as np
import sympy
from ctlabs.tasks._coloured_plant_observer import blocks, part_observer
from ctlabs.tasks.answers import coloured_plant as by_hand
from ctlabs.tasks.answers.coloured_plant import TIMES

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bucy
from ctlabs.filtering import steady as steady_state
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, shaping, spectra, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.params import LabParameters, Positive, Real, Variance, given
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.text import text

META = {
    "name": "coloured_plant",
    "title": "The Kalman–Bucy observer with coloured plant noise",
    "source": "Textbook section on the Kalman–Bucy observer, example 10.25",
    "parts": ["model", "observer", "example", "white"],
}

#: Damping of the second-order shaping filter, and correlation of v0 with v, in what goes beyond the example.
DAMPING, CORRELATION = 0.5, 0.5
TIME, FREQUENCY = "t, s", "frequency ω, rad/s"


class Parameters(LabParameters):
    """What may be changed."""

    a: Real = given(-1.0, unit="1/s", meaning="the plant ẋ = ax + bw; positive is unstable")
    b: Real = given(1.0, unit="1", meaning="how w enters the plant")
    alpha: Positive = given(2.0, unit="1/s", meaning="α of the correlation function K(τ) = D e^(−α|τ|) of w")
    D: Variance = given(1.0, unit="m²/s²", meaning="variance of w")
    r: Positive = given(0.5, unit="m²·s", meaning="strength of the measurement noise v")
    p0: Variance = given(1.0, unit="m²", meaning="variance of x(0)")


def plant(p):
    """ẋ = ax + bw, y = x + v; the strength of its noise input is replaced by the shaping filter."""
    return ContinuousModel([[p.a]], [[p.b]], [[0]], [[1]], Rc=[[p.r]], P0=[[p.p0]], states=["x"], measurements=["y"], units=["m"])


def models(p):
    """The augmented models: of the example, with correlated noises, and with a second-order shaping filter."""
    block = spectra.shaping_filter(spectra.exponentials([(p.D, p.alpha)]), name="w", unit="m/s")
    example = shaping.augment(plant(p), block)
    return {
        "example": example,
        "correlated": replace(example, N=[[CORRELATION * math.sqrt(p.r)]]),
        "second": shaping.augment(plant(p), shaping.second_order(p.D, p.alpha, DAMPING, name="w", unit="m/s")),
    }


def part_model(r, p, answer, systems):
    """From the spectrum to the augmented model."""
    r.section("model", "From the correlation function to the augmented model")
    r.math(r"\dot x = Ax + Bu + Gw, \quad y = Cx + v, \qquad \dot w = A_ww + v_0, \qquad E[vv^T] = R\,\delta, \quad E[v_0v_0^T] = Q_0\,\delta")
    r.says("Only v and v0 are white. (The source writes the plant noise without a matrix; G, the identity there, lets it enter where it does.) The second equation is the shaping filter. With the state $(x, w)$ all noises are white:")
    r.math(r"\frac{d}{dt}\begin{bmatrix} x \\ w \end{bmatrix} = \begin{bmatrix} A & G \\ 0 & A_w \end{bmatrix}\begin{bmatrix} x \\ w \end{bmatrix} + \begin{bmatrix} B \\ 0 \end{bmatrix}u + \begin{bmatrix} 0 \\ I \end{bmatrix}v_0, \qquad y = \begin{bmatrix} C & 0 \end{bmatrix}\begin{bmatrix} x \\ w \end{bmatrix} + v")
    r.says("**The example.** $\\dot{x} = ax + bw$, $y = x + v$, where w is stationary with the correlation function $K(\\tau) = De^{-\\alpha|\\tau|}$. Its Fourier transform is factorised:")
    r.math(r"S(\omega) = \int De^{-\alpha|\tau|}e^{-j\omega\tau}d\tau = \frac{2D\alpha}{\omega^2+\alpha^2} = \frac{\sqrt{2D\alpha}}{\alpha+j\omega}\cdot\frac{\sqrt{2D\alpha}}{\alpha-j\omega}, \qquad W(s) = \frac{\sqrt{2D\alpha}}{s+\alpha}, \qquad \dot w = -\alpha w + \sqrt{2D\alpha}\,v_1")
    r.says("with white $v_1$ of unit strength and $w(0)$ of variance D. The factor with its pole in the left half-plane is taken: the other is not stable.")
    S = spectra.exponentials([(p.D, p.alpha)])
    num, den = spectra.factor(S)
    r.value("shaping_filter", [num, den])
    for name, found, expected in zip(("numerator", "denominator"), (num, den), answer["shaping_filter"], strict=True):
        r.check(text("shaping filter, {part}", part=name), found, expected, ("spectral factorisation", "by hand"))
    example = systems["example"]
    r.model(example)
    w = np.geomspace(0.02 * p.alpha, 50 * p.alpha, 200)
    block = spectra.shaping_filter(S, name="w")
    r.check("spectrum of the shaping filter's output", shaping.psd(block, w), 2 * p.D * p.alpha / (w**2 + p.alpha**2), ("state space", "transform of the correlation function"))
    tau = np.linspace(0, 3 / p.alpha, 31)
    r.check("its autocorrelation", shaping.autocorrelation(block, tau), p.D * np.exp(-p.alpha * tau), ("Lyapunov equation and matrix exponential", "given function"), scale=max(p.D, 1e-300))
    second = shaping.second_order(p.D, p.alpha, DAMPING, name="w")
    r.says("**Beyond the example**: a noise with a resonance, of the same variance, from the shaping filter of second order $\\ddot{w} + 2\\zeta\\alpha\\dot{w} + \\alpha^2w = \\sqrt{4\\zeta\\alpha^3D}\\,v_1$ with ζ = {damping}. Here $A_w$ is 2×2 and the augmented state has three elements.", damping=DAMPING)
    r.check("spectrum of the second-order filter", shaping.psd(second, w), 4 * DAMPING * p.alpha**3 * p.D / ((p.alpha**2 - w**2) ** 2 + (2 * DAMPING * p.alpha * w) ** 2), ("state space", "by hand"))
    if p.D:
        figure = plots.lines(w, {"first order": S(w), "second order": shaping.psd(second, w), "white, S(0)": np.full(len(w), float(S(0.0)))}, xlabel=FREQUENCY, ylabel="S(ω), m²/s", log="xy")
        r.figure("spectra", figure, "Spectra of the noises of equal variance, and the white noise that has the first one's density at low frequency.")


def part_example(r, p, answer, systems):
    """The example's scalar equations and their closed form."""
    r.section("example", "Example 10.25: scalar equations, steady state, transient")
    a, b = sympy.symbols("a b", real=True)
    alpha, D, strength = sympy.symbols("alpha D r", positive=True)
    equations = symbolic.scalar_equations(symbolic.SymbolicModel([[a, b], [0, -alpha]], [[0], [sympy.sqrt(2 * D * alpha)]], [[1]], [[1, 0]], [[strength]], states=("x", "w"))).latex()
    r.says("The observer, its gains, and the variance equation in scalar form, using the symmetry of P:")
    for kind in ("estimate", "gain", "riccati"):
        for line in equations[kind]:
            r.math(line.replace("+ z", "+ y"))
    r.math(r"\hat x(0) = E[x(0)], \quad \hat w(0) = 0, \qquad P_{11}(0) = p_0, \quad P_{12}(0) = 0, \quad P_{22}(0) = D")
    r.says("**Steady state in closed form.** The filter's polynomial $\\Delta(s) = \\det(sI - F + KH) = s^2 + c_1s + c_0$ is a spectral factor,")
    r.math(r"\Delta(s)\Delta(-s) = (a^2-s^2)(\alpha^2-s^2) + \frac{2D\alpha b^2}{r} \;\Rightarrow\; c_0 = \sqrt{a^2\alpha^2 + \frac{2D\alpha b^2}{r}}, \quad c_1 = \sqrt{a^2+\alpha^2+2c_0}")
    r.says("and comparing coefficients, $\\Delta(s) = s^2 + (K_1+\\alpha-a)s + \\alpha(K_1-a) + bK_2$, gives the gains and, with $P_{11} = rK_1$, $P_{12} = rK_2$ and the third variance equation, the covariance:")
    r.math(r"K_1 = c_1 - \alpha + a, \qquad K_2 = \frac{c_0 - \alpha(c_1-\alpha)}{b} = \frac{2D\alpha b/r}{c_0+\alpha^2+\alpha c_1}, \qquad P_{22} = D - \frac{P_{12}^2}{2\alpha r}")
    example, routes = systems["example"], ("Riccati equation", "closed form")
    found = bucy.steady(example)
    polynomial = np.real(np.poly(example.F - found.K @ example.H))
    r.value("covariance_steady", found.P, "m², m²/s, m²/s²", agrees=answer, routes=routes)
    r.value("gain_steady", found.K[:, 0], "1/s, 1/s²", agrees=answer, routes=routes)
    r.value("filter_polynomial", polynomial, "1, 1/s, 1/s²", agrees=answer, routes=routes)
    transient = bucy.transient(example, TIMES)
    r.value("covariance_continuous", transient.P, "m², m²/s, m²/s²", at=TIMES, agrees=answer, routes=("Riccati equation, integrated", "closed form about the limit"))
    P = np.asarray(answer["covariance_steady"])
    r.says("The deviation from the limit has the closed form $P - P_\\infty = e^{At}\\Delta(I + M\\Delta)^{-1}e^{A^Tt}$ with $\\Delta = P(0) - P_\\infty$, $A = F - KH$ and $M = \\int_0^te^{A^Ts}H^Tr^{-1}He^{As}ds$, which is the second route of the check.")
    r.says("Here $P_{11} = {P11}$, $P_{12} = {P12}$, $P_{22} = {P22}$; of the variance D = {D} of the noise the observer removes {share} %. Filter poles: {poles}.",
           P11=P[0, 0], P12=P[0, 1], P22=P[1, 1], D=p.D, share=100 * (1 - P[1, 1] / p.D) if p.D else 0.0, poles=", ".join(text("{x}", x=pole if abs(pole.imag) > 1e-12 else pole.real) for pole in found.poles.tolist()))
    t = np.linspace(0.0, horizon(p), 201)
    curves = bucy.transient(example, t).P
    shown = {"P11, m²": (0, 0), "P12, m²/s": (0, 1), "P22, m²/s²": (1, 1)}
    figure = plots.transient(t, {name: curves[(slice(None), *ij)] for name, ij in shown.items()}, ylabel="element of P, units in the legend", xlabel=TIME, limits={name: P[ij] for name, ij in shown.items()})
    r.figure("transient", figure, "The covariance from P(0) = diag(p0, D) to its limits. P12 begins at zero: only as x is observed does it become correlated with w.")
    variants(r, p, systems)


def variants(r, p, systems):
    """Second-order filter and correlated noises in the steady state."""
    r.says("**Beyond.** The same plant with a second-order shaping filter, and with v0 and v correlated ({rho} and −{rho}). The second route: at the limit every block equation is zero; for a stable plant the filter's polynomial is also the spectral factor of the density of y, $S_y = r\\,|\\Delta(j\\omega)|^2/|\\det(j\\omega I - F)|^2$.", rho=CORRELATION)
    cases = {"example": systems["example"], text("correlation {rho}", rho=CORRELATION): systems["correlated"],
             text("correlation −{rho}", rho=CORRELATION): replace(systems["correlated"], N=-systems["correlated"].N), "second order": systems["second"]}
    rows = []
    for name, system in cases.items():
        found = bucy.steady(system)
        flow = np.concatenate([part.ravel() for key, part in blocks(system, found.P).items() if key.startswith("P")])
        scale = float(np.abs(system.F @ found.P).max() + np.abs(system.G @ system.Q @ system.G.T).max()) or 1.0
        r.check(text("block equations at the limit, {model}", model=name), flow, np.zeros(flow.size), ("block equations", "steady state"), SOLVER, scale=scale)
        if p.a < 0:
            top, _den = spectra.factor(spectra.of(system))
            polynomial = np.real(np.poly(system.F - found.K @ system.H))
            r.check(text("filter polynomial, {model}", model=name), polynomial, top / top[0], ("Riccati equation", "spectral factorisation of S_y"), SOLVER)
        rows.append((name, found.P[0, 0], found.P[1, 1], found.K[0, 0], found.K[1, 0]))
    r.table("variants", ["model", "P1, m²", "variance of w, m²/s²", "K1, 1/s", "K2, 1/s²"], rows, "Steady state of the variants. The sign of the correlation between v0 and v matters: one helps the estimate of x, the other harms it.")


def part_white(r, p, answer):
    """The filter that takes w for white noise."""
    r.section("white", "What the filter for white noise claims, and what it has")
    r.says("**The simplification.** A filter of order one that takes w for white noise of the strength $S(0) = 2D/\\alpha$:")
    r.math(r"2aP_w + b^2S(0) - \frac{P_w^2}{r} = 0, \qquad P_w = r\,(a+\lambda), \quad k = a+\lambda, \quad \lambda = \sqrt{a^2 + \frac{b^2S(0)}{r}}")
    r.says("Its error $e = \\hat{x} - x$ obeys $\\dot{e} = -\\lambda e - bw + kv$ with the coloured w, so that, with $m = E[ew]$, $0 = -(\\lambda+\\alpha)m - bD$ and")
    r.math(r"0 = -2\lambda\,E[e^2] - 2bm + k^2r \quad\Rightarrow\quad E[e^2] = \frac{k^2r}{2\lambda} + \frac{b^2D}{\lambda(\lambda+\alpha)}, \qquad P_w = \frac{k^2r}{2\lambda} + \frac{b^2D}{\lambda\alpha}")
    r.says("The claim exceeds the truth by $b^2D/[\\alpha(\\lambda+\\alpha)]$: the density of w is nowhere larger than S(0), and what is missing at high frequency never reaches the error. And the optimum, which uses the colour, is at least as good: $P_{11} \\le E[e^2] \\le P_w$. ∎")
    claimed = bucy.steady(replace(plant(p), Q=[[2 * p.D / p.alpha]]))
    r.value("white_claimed_variance", claimed.P[0, 0], "m²", agrees=answer, routes=("Riccati equation", "closed form"))
    expected = answer["white_actual_variance"]
    reason = "nothing drives x and the filter's gain tends to 0: its error keeps what P(0) left"
    actual = None if expected is None else lyapunov(p, claimed.K[0, 0])
    r.value("white_actual_variance", actual, "m²", reason=reason, agrees=answer, routes=("Lyapunov equation", "closed form"))
    if expected is None:
        r.says("Here there is no such variance: {reason}.", reason=reason)
        return
    optimum = float(by_hand.limit(p)[0][0, 0])
    size = max(float(claimed.P[0, 0]), 1e-300)
    r.holds("claimed ≥ true", claimed.P[0, 0] - actual, ("Riccati equation", "Lyapunov equation"), size=size)
    r.holds("true ≥ optimal", actual - optimum, ("Lyapunov equation", "closed form"), size=size)
    r.value("verdict_white", bool(claimed.P[0, 0] > actual * (1 + 1e-9) and actual > optimum * (1 + 1e-9)))
    r.says("Criterion of `verdict_white`: the filter claims more than its true variance and that is more than the optimum: {claimed} against {actual} and {optimum} m². Its pole is −{pole} 1/s.", claimed=float(claimed.P[0, 0]), actual=actual, optimum=optimum, pole=by_hand.wide(p))
    if not (p.b and p.D):
        r.says("Nothing drives the plant here, and the three coincide.")
        return
    white_by_correlation_time(r, p)


def white_by_correlation_time(r, p):
    """Over the correlation time of the noise, at a constant density S(0)."""
    factors, rows = np.geomspace(0.1, 30, 40), []
    for factor in (0.25, 1.0, 4.0, 16.0):
        q = p.model_copy(update={"alpha": factor * p.alpha, "D": factor * p.D})
        best = bucy.steady(models(q)["example"]).P[0, 0]
        r.check(text("optimum, α = {alpha}", alpha=q.alpha), best, by_hand.limit(q)[0][0, 0], ("Riccati equation", "closed form"))
        rows.append((q.alpha, best, by_hand.white_actual(q), q.r * (q.a + by_hand.wide(q)), 100 * (by_hand.white_actual(q) / best - 1)))
    r.table("factors", ["α, 1/s", "optimal, m²", "true, m²", "claimed, m²", "loss, %"], rows,
            "The same density S(0) with another correlation time 1/α (D changes with α). For α much larger than λ the noise is white to the filter.")
    curves = {"optimal": [], "white noise assumed: true": [], "white noise assumed: claimed": []}
    for factor in factors:
        q = p.model_copy(update={"alpha": factor * p.alpha, "D": factor * p.D})
        for name, value in zip(curves, (by_hand.limit(q)[0][0, 0], by_hand.white_actual(q), q.r * (q.a + by_hand.wide(q))), strict=True):
            curves[name].append(value)
    figure = plots.lines(factors * p.alpha, curves, xlabel="α, 1/s", ylabel="variance of x, m²", log="x")
    r.figure("factors", figure, "Variances over α at a constant density S(0): as the noise becomes white, claim, truth and optimum meet.")


def lyapunov(p, k):
    """The variance of the error of a filter with the gain k, from the joint model of (e, w)."""
    joint = ContinuousModel(
        [[p.a - k, -p.b], [0, -p.alpha]], [[0, k], [math.sqrt(2 * p.D * p.alpha), 0]], np.diag([1.0, p.r]), [[1, 0]], P0=np.eye(2)
    )
    return float(shaping.stationary_covariance(joint)[0, 0])


def horizon(p):
    """Five time constants of the slower filter pole, s, but no longer than an unstable x stays of the size of its error."""
    polynomial = by_hand.limit(p)[1]
    slow = float(np.abs(np.roots(polynomial).real).min())
    end = 5 / slow if slow > 1e-9 * p.alpha else 10 / p.alpha
    return min(end, 12 / p.a) if p.a > 0 else end


def plan(r, p, experiment, answer):
    """Every number chosen."""
    fast = max(float(np.abs(np.roots(answer["filter_polynomial"])).max()), p.alpha, by_hand.wide(p))
    steps = int(min(max(math.ceil(horizon(p) * fast * 10), 40), 300))
    dt = min(0.1 / fast, horizon(p) / 40)
    r.says("White noise has no values, so the continuous filter is represented by the discrete one with a period δ much shorter than every time constant, on averages of y over δ, whose noise has the variance r/δ. The model is sampled exactly. The variance of this filter differs from the continuous one by O(δ); against its own theory it is tested without that difference.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period δ, s", dt, "a tenth of the fastest time constant, or a fortieth of the horizon if that is shorter"],
        ["steps", steps, "five time constants of the filter, 40 at least and 300 at most; shorter for an unstable plant"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "the same random numbers for both filters"],
        ["input u", 0, "a known input adds the same to x and to its estimate"],
    ], "Plan of the experiment.")
    return {"dt": dt, "steps": steps}


def experiment_example(r, p, experiment, answer, system, dt, steps):
    """The observer on simulated data."""
    r.section("example", "The observer on simulated data")
    sampled, P = discretise(system, dt), np.asarray(answer["covariance_steady"])
    limited = steady_state.solve(sampled)
    portrait(r, experiment, sampled, steps, xlabel=TIME, limits=(limited.P_minus[0, 0], limited.P_plus[0, 0]))
    some = experiment.histories(sampled, steps=steps)
    figure = plots.record(some, xlabel=TIME, ylabel="w, m/s", state=1, measurement=None)
    r.figure("noise", figure, "The plant noise w of the same run and its estimate: the observer follows its slow part.")
    schedule, t = covariances(sampled, steps), np.arange(steps + 1) * dt
    count = min(steps, 20)
    P_minus, K = by_hand.discrete(p, dt, count)
    routes = ("discrete recursion", "power of one matrix")
    r.check("P⁻ of the discrete filter", schedule.P_minus[1 : count + 1], P_minus, routes)
    r.check("gain of the discrete filter", schedule.K[1 : count + 1], K, routes)
    curve = bucy.transient(system, t).P[:, 0, 0]
    figure = plots.lines(t, {"continuous P11": curve, "discrete P11⁻": schedule.P_minus[:, 0, 0], "discrete P11⁺": schedule.P_plus[:, 0, 0]}, xlabel=TIME, ylabel="variance of x, m²")
    r.figure("sampled", figure, "The variance of the discrete filter around that of the continuous one.")
    if p.b and p.D:
        errors = [float(np.abs(steady_state.solve(discretise(system, dt / 2**i)).P_plus - P).max()) for i in range(3)]
        r.order("P⁺ → P as δ → 0", errors, 1.0, ("discrete Riccati equation", "closed form"))


def experiment_white(r, p, experiment, answer, system, dt, steps):
    """The filter for white noise on the same data."""
    r.section("white", "The filter for white noise on the same data")
    truth, design = discretise(system, dt), discretise(replace(plant(p), Q=[[2 * p.D / p.alpha]]), dt)
    C = [[1.0, 0.0]]
    actual, stats = sensitivity.actual(truth, design, steps, compare=C), experiment.statistics(truth, design, steps=steps, compare=C)
    own = experiment.statistics(truth, steps=steps)
    agreement(r, "filter for white noise", stats, actual.P_plus, consistent=False)
    if answer["white_actual_variance"] is not None and p.b and p.D:
        expected = answer["white_actual_variance"]
        period = dt / 16
        found = sensitivity.steady(discretise(system, period), discretise(replace(plant(p), Q=[[2 * p.D / p.alpha]]), period), compare=C).P_plus[0, 0]
        # One period changes a variance by its fraction δ·(rate of the filter) at most; twice that is allowed.
        bound = 2 * period * max(by_hand.wide(p), p.alpha, p.a + by_hand.wide(p)) * answer["white_claimed_variance"]
        r.holds("true variance for a short period within O(δ) of the Lyapunov equation", bound - abs(found - expected), ("discrete sensitivity analysis", "continuous closed form"), size=expected)
    optimal = covariances(truth, steps)
    figure = plots.lines(optimal.t, {"optimal": optimal.P_plus[:, 0, 0], "white noise assumed: true": actual.P_plus[:, 0, 0], "white noise assumed: claimed": actual.claimed.P_plus[:, 0, 0]},
                         xlabel=TIME, ylabel="variance of x, m²", points={"ensemble": (stats.t[:: max(steps // 40, 1)], stats.rms[:: max(steps // 40, 1), 0] ** 2)})
    r.figure("white", figure, "What the filter for white noise claims and has, with the ensemble, and the optimum.")
    r.table("ensembles", ["filter", "claimed σ, m", "true σ, m", "RMS of the ensemble, m"], [
        ("optimal", optimal.sd_plus[-1, 0], optimal.sd_plus[-1, 0], own.rms[-1, 0]),
        ("white noise assumed", actual.claimed.sd_plus[-1, 0], math.sqrt(actual.P_plus[-1, 0, 0]), stats.rms[-1, 0]),
    ], "The error of x at the last step, on the same data.")


def conclusions(r, p, answer):
    """What the numbers say."""
    P, lines = np.asarray(answer["covariance_steady"]), []
    lines.append("A coloured plant noise costs a model of its shaping filter in the observer; nothing else changes. The block equations are the augmented Riccati equation.")
    claimed, actual = answer["white_claimed_variance"], answer["white_actual_variance"]
    if p.b and p.D:
        lines.append(text("The variance of x tends to {P11} m² and that of w to {P22} m²/s², {share} % below D.", P11=P[0, 0], P22=P[1, 1], share=100 * (1 - P[1, 1] / p.D)))
        lines.append(text("The filter that takes w for white noise of the strength S(0) claims {claimed} m² and has {actual} m²: it is {loss} % worse than the optimum and believes itself {over} % worse than it is.",
                          claimed=claimed, actual=actual, loss=100 * (actual / P[0, 0] - 1), over=100 * (claimed / actual - 1)))
    elif p.a > 0:
        lines.append(text("Nothing drives the plant, but it is unstable: the variance of x tends to 2ar = {P11} m², whether the noise is taken for white or not.", P11=P[0, 0]))
    else:
        lines.append("Nothing drives the plant: x becomes known, and the colour of the noise does not matter.")
    if p.a > 0:
        lines.append("The plant is unstable; the observer is stable all the same.")
    elif p.a == -p.alpha:
        lines.append("Plant and shaping filter have the same pole; the closed forms need no exception for that.")
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_model, part_observer, part_example, part_white),
    plan=plan,
    experiment=(experiment_example, experiment_white),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """The section, then its example, then what the white-noise filter loses."""
    answer, systems = by_hand.analytic(p), models(p)
    return PARTS.report(META, p, experiment, answer=answer, systems=systems, system=systems["example"])


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
