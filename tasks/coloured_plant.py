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
from ctlabs.tasks._coloured_plant_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import coloured_plant as by_hand
from ctlabs.tasks.answers.coloured_plant import TIMES

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bucy
from ctlabs.filtering import steady as steady_state
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, shaping, spectra, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import span
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

    a: Real = given(-1.0, unit="1/s", meaning="pole of the plant ẋ = ax + bw; positive is unstable", draw=span(-3, -0.5, 0.25))
    b: Real = given(1.0, unit="1", meaning="how w enters the plant", draw=span(0.5, 2, 0.25))
    alpha: Positive = given(2.0, unit="1/s", meaning="α of the correlation function K(τ) = D e^(−α|τ|) of w", draw=span(1, 4, 0.5))
    D: Variance = given(1.0, unit="m²/s²", meaning="variance of w", draw=span(0.5, 3, 0.5))
    r: Positive = given(0.5, unit="m²·s", meaning="strength of the measurement noise v", draw=span(0.25, 2, 0.25))
    p0: Variance = given(1.0, unit="m²", meaning="variance of x(0)", draw=span(0.5, 3, 0.5))


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
    r.says("The source is a section of a Russian textbook that reached us as a scan without its title page and without its formulas; they are rebuilt here. The plant, its measurement and the shaping filter of the plant noise are")
    r.math(r"\dot x = Ax + Bu + Gw, \quad y = Cx + v, \qquad \dot w = A_ww + v_0, \qquad E[vv^T] = R\,\delta, \quad E[v_0v_0^T] = Q_0\,\delta", "plant")
    r.says("Only v and $v_0$ are white. (The source writes the plant noise without a matrix; G, the identity there, lets it enter where it does.) With the state $(x, w)$ all noises are white {ref:maybeck, section 4.11},")
    r.math(r"\frac{d}{dt}\begin{bmatrix} x \\ w \end{bmatrix} = \begin{bmatrix} A & G \\ 0 & A_w \end{bmatrix}\begin{bmatrix} x \\ w \end{bmatrix} + \begin{bmatrix} B \\ 0 \end{bmatrix}u + \begin{bmatrix} 0 \\ I \end{bmatrix}v_0, \qquad y = \begin{bmatrix} C & 0 \end{bmatrix}\begin{bmatrix} x \\ w \end{bmatrix} + v.", "augmented")
    r.says("**The example.** $\\dot{x} = ax + bw$, $y = x + v$, where w is stationary with the correlation function $K(\\tau) = De^{-\\alpha|\\tau|}$. Its Fourier transform is factorised,")
    r.math(r"S(\omega) = \int De^{-\alpha|\tau|}e^{-j\omega\tau}d\tau = \frac{2D\alpha}{\omega^2+\alpha^2} = \frac{\sqrt{2D\alpha}}{\alpha+j\omega}\cdot\frac{\sqrt{2D\alpha}}{\alpha-j\omega}, \qquad W(s) = \frac{\sqrt{2D\alpha}}{s+\alpha}, \qquad \dot w = -\alpha w + \sqrt{2D\alpha}\,v_1,", "shaping")
    r.says("with white $v_1$ of unit strength and $w(0)$ of variance D. The factor with its pole in the left half-plane is taken, as the other is not stable.")
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
        r.says("{fig:spectra} compares the noises. Up to about α the first one is as good as white; beyond, its density falls like $1/\\omega^2$, and a filter that takes it for white expects there what does not come. The second one has its power about the resonance.")
        r.figure("spectra", figure, "Spectra of the two noises of equal variance, and the white noise that has the first one's density at low frequency.")


def part_example(r, p, answer, systems):
    """The example's scalar equations and their closed form."""
    r.section("example", "Example 10.25: scalar equations, steady state, transient")
    a, b = sympy.symbols("a b", real=True)
    alpha, D, strength = sympy.symbols("alpha D r", positive=True)
    equations = symbolic.scalar_equations(symbolic.SymbolicModel([[a, b], [0, -alpha]], [[0], [sympy.sqrt(2 * D * alpha)]], [[1]], [[1, 0]], [[strength]], states=("x", "w"))).latex()
    r.says("Observer, gains and variance equation in scalar form follow from {part:observer} by computer algebra, the symmetry of P being used:")
    for kind in ("estimate", "gain", "riccati"):
        for line in equations[kind]:
            r.math(line.replace("+ z", "+ y"))
    r.math(r"\hat x(0) = E[x(0)], \quad \hat w(0) = 0, \qquad P_{11}(0) = p_0, \quad P_{12}(0) = 0, \quad P_{22}(0) = D", "start")
    r.says("**Steady state in closed form.** The filter's polynomial $\\Delta(s) = \\det(sI - F + KH) = s^2 + c_1s + c_0$ is a spectral factor ({ref:kalman_bucy}): the innovation is white with the strength r, and y follows from it through $1 + H(sI - F)^{-1}K = \\Delta(s)/\\det(sI - F)$, so that $r\\,\\Delta(s)\\Delta(-s)$ over $\\det(sI - F)\\det(-sI - F)$ is the density of y, which is r plus that of x. Multiplied by the determinants and divided by r (the Riccati equation gives the same line for an unstable plant too) this is")
    r.math(r"\Delta(s)\Delta(-s) = (a^2-s^2)(\alpha^2-s^2) + \frac{2D\alpha b^2}{r} \;\Rightarrow\; c_0 = \sqrt{a^2\alpha^2 + \frac{2D\alpha b^2}{r}}, \quad c_1 = \sqrt{a^2+\alpha^2+2c_0},", "polynomial")
    r.says("and comparing coefficients, $\\Delta(s) = s^2 + (K_1+\\alpha-a)s + \\alpha(K_1-a) + bK_2$, gives the gains and, with $P_{11} = rK_1$, $P_{12} = rK_2$ and the third variance equation, the covariance,")
    r.math(r"K_1 = c_1 - \alpha + a, \qquad K_2 = \frac{c_0 - \alpha(c_1-\alpha)}{b} = \frac{2D\alpha b/r}{c_0+\alpha^2+\alpha c_1}, \qquad P_{22} = D - \frac{P_{12}^2}{2\alpha r}.", "limit")
    example, routes = systems["example"], ("Riccati equation", "closed form")
    found = bucy.steady(example)
    polynomial = np.real(np.poly(example.F - found.K @ example.H))
    r.value("covariance_steady", found.P, "m², m²/s, m²/s²", agrees=answer, routes=routes)
    r.value("gain_steady", found.K[:, 0], "1/s, 1/s²", symbol="(K_1, K_2)", agrees=answer, routes=routes)
    r.value("filter_polynomial", polynomial, "1, 1/s, 1/s²", agrees=answer, routes=routes)
    transient = bucy.transient(example, TIMES)
    r.value("covariance_continuous", transient.P, "m², m²/s, m²/s²", at=TIMES, agrees=answer, routes=("Riccati equation, integrated", "closed form about the limit"))
    P = np.asarray(answer["covariance_steady"])
    r.says("The deviation from the limit has the closed form $P - P_\\infty = e^{At}\\Delta(I + M\\Delta)^{-1}e^{A^Tt}$ with $\\Delta = P(0) - P_\\infty$, $A = F - KH$ and $M = \\int_0^te^{A^Ts}H^Tr^{-1}He^{As}ds$, by which the integrated covariances are checked.")
    first, second = sorted(found.poles.tolist(), key=lambda pole: (pole.real, pole.imag))
    r.says("Here $c_1 = {c1}$ 1/s and $c_0 = {c0}$ 1/s², $P_{11} = {P11}$ m², $P_{12} = {P12}$ m²/s, $P_{22} = {P22}$ m²/s²; of the variance $D = {D}$ m²/s² of the noise the observer removes {share:3} %. ",
           "The poles of the filter are {a} ± {b}i 1/s." if abs(first.imag) > 1e-12 else "The poles of the filter are {a} and {b} 1/s.",
           c1=polynomial[1], c0=polynomial[2], P11=P[0, 0], P12=P[0, 1], P22=P[1, 1], D=p.D, share=100 * (1 - P[1, 1] / p.D) if p.D else 0.0,
           a=first.real, b=abs(first.imag) if abs(first.imag) > 1e-12 else second.real)
    t = np.linspace(0.0, horizon(p), 201)
    curves = bucy.transient(example, t).P
    shown = {"$P_{11}$, m²": (0, 0), "$P_{12}$, m²/s": (0, 1), "$P_{22}$, m²/s²": (1, 1)}
    figure = plots.transient(t, {name: curves[(slice(None), *ij)] for name, ij in shown.items()}, ylabel="element of P, units in the legend", xlabel=TIME, limits={name: P[ij] for name, ij in shown.items()})
    r.says("{fig:transient} shows the way there. $P_{12}$ begins at zero: only as x is observed does its error become correlated with that of w, and only through this correlation does y tell of w at all. All three come to rest within a few time constants of the filter." if p.b and p.D else "{fig:transient} shows the way there.")
    r.figure("transient", figure, "The elements of the covariance from P(0) = diag(p₀, D) to their limits (dashed).")
    variants(r, p, systems)


def variants(r, p, systems):
    """Second-order filter and correlated noises in the steady state."""
    r.says("**Beyond the example.** {tab:variants} has the same plant with a second-order shaping filter, and with $v_0$ and v correlated ({rho} and −{rho}). They are checked twice: at the limit every block equation is zero, and for a stable plant the filter's polynomial is also the spectral factor of the density of y, $S_y = r\\,|\\Delta(j\\omega)|^2/|\\det(j\\omega I - F)|^2$.", rho=CORRELATION)
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
    r.table("variants", ["model", "P₁, m²", "variance of w, m²/s²", "K₁, 1/s", "K₂, 1/s²"], rows, "Steady state of the variants. The sign of the correlation between v₀ and v matters: one helps the estimate of x, the other harms it.")


def part_white(r, p, answer):
    """The filter that takes w for white noise."""
    r.section("white", "What the filter for white noise claims, and what it has")
    r.says("**The simplification.** A filter of order one that takes w for white noise of the strength $S(0) = 2D/\\alpha$ has")
    r.math(r"2aP_w + b^2S(0) - \frac{P_w^2}{r} = 0, \qquad P_w = r\,(a+\lambda), \quad k = a+\lambda, \quad \lambda = \sqrt{a^2 + \frac{b^2S(0)}{r}}.", "claim")
    r.says("Its error $e = \\hat{x} - x$ obeys $\\dot{e} = -\\lambda e - bw + kv$ with the coloured w, so that, with $m = E[ew]$, $0 = -(\\lambda+\\alpha)m - bD$ and")
    r.math(r"0 = -2\lambda\,E[e^2] - 2bm + k^2r \quad\Rightarrow\quad E[e^2] = \frac{k^2r}{2\lambda} + \frac{b^2D}{\lambda(\lambda+\alpha)}, \qquad P_w = \frac{k^2r}{2\lambda} + \frac{b^2D}{\lambda\alpha}.", "true")
    r.says("The claim exceeds the truth by $b^2D/[\\alpha(\\lambda+\\alpha)]$: the density of w is nowhere larger than S(0), and what is missing at high frequency never reaches the error. And the optimum, which uses the colour, is at least as good: $P_{11} \\le E[e^2] \\le P_w$. ∎")
    claimed = bucy.steady(replace(plant(p), Q=[[2 * p.D / p.alpha]]))
    r.value("white_claimed_variance", claimed.P[0, 0], "m²", symbol="P_w", agrees=answer, routes=("Riccati equation", "closed form"))
    expected = answer["white_actual_variance"]
    reason = "nothing drives x and the filter's gain tends to 0: its error keeps what P(0) left"
    actual = None if expected is None else lyapunov(p, claimed.K[0, 0])
    r.value("white_actual_variance", actual, "m²", reason=reason, symbol="E[e^2]", agrees=answer, routes=("Lyapunov equation", "closed form"))
    if expected is None:
        r.says("Here there is no such variance: {reason}.", reason=reason)
        return
    optimum = float(by_hand.limit(p)[0][0, 0])
    size = max(float(claimed.P[0, 0]), 1e-300)
    r.holds("claimed ≥ true", claimed.P[0, 0] - actual, ("Riccati equation", "Lyapunov equation"), size=size)
    r.holds("true ≥ optimal", actual - optimum, ("Lyapunov equation", "closed form"), size=size)
    r.value("verdict_white", bool(claimed.P[0, 0] > actual * (1 + 1e-9) and actual > optimum * (1 + 1e-9)))
    r.says("So the filter for white noise claims {claimed} m² and has {actual} m², where the optimum is {optimum} m²; its pole is −{pole} 1/s.", claimed=float(claimed.P[0, 0]), actual=actual, optimum=optimum, pole=by_hand.wide(p))
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
    r.says("{tab:factors} and {fig:factors} keep the density S(0) and change the correlation time 1/α. Where α is much larger than λ the noise is white to the filter, and the three variances are one; where it is small, claim and truth are far apart.")
    r.table("factors", ["α, 1/s", "optimal, m²", "true, m²", "claimed, m²", "loss, %"], rows,
            "The same density S(0) with another correlation time 1/α (D changes with α).")
    curves = {"optimal": [], "white noise assumed: true": [], "white noise assumed: claimed": []}
    for factor in factors:
        q = p.model_copy(update={"alpha": factor * p.alpha, "D": factor * p.D})
        for name, value in zip(curves, (by_hand.limit(q)[0][0, 0], by_hand.white_actual(q), q.r * (q.a + by_hand.wide(q))), strict=True):
            curves[name].append(value)
    figure = plots.lines(factors * p.alpha, curves, xlabel="α, 1/s", ylabel="variance of x, m²", log="x")
    r.figure("factors", figure, "Steady variances of x over α at a constant density S(0): as the noise becomes white, claim, truth and optimum meet.")


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
    r.says("{tab:plan} lists what was chosen. White noise has no values, so the continuous filter is represented by the discrete one with a period δ much shorter than every time constant, on averages of y over δ, whose noise has the variance r/δ. The model is sampled exactly. The variance of this filter differs from the continuous one by O(δ); against its own theory it is tested without that difference.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period δ, s", dt, "a tenth of the fastest time constant, or a fortieth of the horizon if that is shorter"],
        ["steps", steps, "five time constants of the filter, 40 at least and 300 at most; shorter for an unstable plant"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "the same random numbers for both filters"],
        ["input u", 0, "a known input adds the same to x and to its estimate"],
    ], "Plan of the experiment.")
    return {"dt": dt, "steps": steps}


def experiment_example(r, p, experiment, answer, system, dt, steps):
    """The observer on simulated data."""
    r.section("example", "The observer on simulated data")
    sampled, P = discretise(system, dt), np.asarray(answer["covariance_steady"])
    r.says("{fig:noise} shows one run: the observer is given y only and estimates the plant noise w from it. ", "It follows the slow part of w, and faintly, for its error variance is still {left:3} % of D; what is fast in w has hardly moved x before it is over." if p.D else "Here there is none.", " {fig:ensemble} has the statistics of {runs} runs.", left=100 * P[1, 1] / p.D if p.D else 0.0, runs=experiment.runs)
    some = experiment.histories(sampled, steps=steps)
    r.figure("noise", plots.record(some, xlabel=TIME, ylabel="w, m/s", state=1, measurement=None), "The plant noise w of one run, and its estimate from measurements of x alone.")
    stats = portrait(r, experiment, sampled, steps, xlabel=TIME, figures={
        "ensemble": "Where the RMS or the mean leave the band they do so for a while, as successive errors of so short a period are nearly the same."})
    schedule = covariances(sampled, steps)
    count = min(steps, 20)
    P_minus, K = by_hand.discrete(p, dt, count)
    routes = ("discrete recursion", "power of one matrix")
    nothing = None if p.D else float(np.abs(P_minus).max())  # without noise some elements are zero
    r.check("P⁻ of the discrete filter", schedule.P_minus[1 : count + 1], P_minus, routes, scale=nothing)
    r.check("gain of the discrete filter", schedule.K[1 : count + 1], K, routes)
    if p.b and p.D:
        errors = [float(np.abs(steady_state.solve(discretise(system, dt / 2**i)).P_plus - P).max()) for i in range(3)]
        r.order("P⁺ → P as δ → 0", errors, 1.0, ("discrete Riccati equation", "closed form"))
    return {"measured": rms(stats, unit="m"), "sd": float(schedule.sd_plus[-1, 0]), "when": float(schedule.t[-1])}


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
    r.says("{fig:white} and {tab:ensembles} have both filters on the same data. The filter for white noise is better than it believes, and worse than the optimum; the ensemble scatters about its true variance, not about its claim." if p.b and p.D else "{fig:white} and {tab:ensembles} have both filters on the same data: nothing drives the plant, and they are the same in the end.")
    r.figure("white", figure, "The variance that the filter for white noise claims, the one it has, with its ensemble (dots), and the optimum.")
    r.table("ensembles", ["filter", "claimed σ, m", "true σ, m", "RMS of the ensemble, m"], [
        ("optimal", optimal.sd_plus[-1, 0], optimal.sd_plus[-1, 0], rms(own)),
        ("white noise assumed", actual.claimed.sd_plus[-1, 0], math.sqrt(actual.P_plus[-1, 0, 0]), rms(stats)),
    ], "The error of x at the last step, on the same data.")


PARTS = Skeleton(
    result=result,
    key="white",
    analysis=(part_model, part_observer, part_example, part_white),
    plan=plan,
    experiment=(experiment_example, experiment_white),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """The section, then its example, then what the white-noise filter loses."""
    answer, systems = by_hand.analytic(p), models(p)
    return PARTS.report(META, p, experiment, answer=answer, systems=systems, system=systems["example"])


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
