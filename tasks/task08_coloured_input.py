r"""Lab 8. Coloured input: simplified filters and what they really do.

Source: Semushin & Tsyganova 2001, task 8. An exponentially correlated y(t) with the correlation time T passes through
1/(s + a); its output x is measured every dt. The sheet asks for the true model, for the white noise that may replace y (two
variants) and when it may, for the equations of the three filters, for those of the sensitivity analysis, and for a
comparison of the filters by both covariance analysis and simulation.

Expected answer: Q = 2σ²T (variant 1: the same spectral density at low frequency) and Q = 2σ²T/(1 + aT) (variant 2: the same
steady variance of x); adequate for aT ≪ 1 and T ≪ dt. For a = 1, T = 0.1, dt = 0.5, R = 2, σ² = 5 the optimal variance is
0.33647; the simplified filters claim 0.36841 and 0.34255 and have 0.33710 and 0.33675.
"""

import math

import numpy as np
from ctlabs.tasks._task08_forms import FIRST, STEP, part_g, ratio
from ctlabs.tasks._task08_words import ESSENTIAL, answers, conclusions, discussion, result
from ctlabs.tasks.answers import task08 as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import settling, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, shaping
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task08",
    "title": "Coloured input: simplified filters and their sensitivity",
    "source": "Semushin & Tsyganova 2001, task 8",
    "parts": ["a", "b", "c", "d", "e", "f", "g"],
}

#: "Much less" in part (b): at most this fraction.
MUCH_LESS = 0.25
SIX = ("optimal", "claimed_variant1", "true_variant1", "claimed_variant2", "true_variant2")


class Parameters(LabParameters):
    """What may be changed."""

    a: Variance = given(1.0, unit="1/s", meaning="pole of the system 1/(s + a); 0 makes it an integrator", draw=span(0.5, 2, 0.1))
    T: Positive = given(0.1, unit="s", meaning="correlation time of the input y", draw=one_of(0.05, 0.1, 0.15, 0.2, 0.25))
    dt: Positive = given(0.5, unit="s", meaning="period of the measurements", draw=one_of(0.25, 0.5, 0.75, 1))
    R: Variance = given(2.0, unit="m²", meaning="variance of the measurement noise v", draw=span(1, 4, 0.25))
    sigma_y2: Positive = given(5.0, unit="m²/s²", meaning="variance of the input y", symbol=r"\sigma_y^2", draw=span(2, 8, 0.5))
    steps: Count = given(20, unit="1", meaning="measurements in the lists", symbol="N")


def models(a, T, dt, R, s2):
    """The true model and the two simplified ones, sampled."""
    systems = [truth_system(a, T, s2), *(simple_system(a, Q) for Q in by_hand.intensities(a, T, s2))]
    return [discretise(system, dt, R=[[R]]) for system in systems]


def truth_system(a, T, s2):
    """(x, y): ẋ = −ax + y, ẏ = −y/T + w; at rest x(0) = 0, y stationary."""
    plant = ContinuousModel([[-a]], [[1]], [[0]], [[1]], P0=[[0]], states=["x"], measurements=["z"], units=["m"])
    return shaping.augment(plant, shaping.gauss_markov(s2, T, name="y", unit="m/s"))


def simple_system(a, Q):
    """ẋ = −ax + w with white w of strength Q; P(0) = 0."""
    return ContinuousModel([[-a]], [[1]], [[Q]], [[1]], P0=[[0]], states=["x"], measurements=["z"], units=["m"])


def limits(a, T, dt, R, s2):
    """The five steady variances of :func:`steady_variances` from the Riccati and Lyapunov equations."""
    truth, *designs = models(a, T, dt, R, s2)
    found = {"optimal": steady.solve(truth).P_plus[0, 0]}
    for i, design in enumerate(designs, start=1):
        limit = sensitivity.steady(truth, design, compare=FIRST)
        found |= {f"claimed_variant{i}": limit.claimed.P_plus[0, 0], f"true_variant{i}": limit.P_plus[0, 0]}
    return found


def part_a(r, p, answer, truth):
    """The true model."""
    r.section("a", "The true model")
    r.says("The figure of the sheet is missing. From its words it is read as {fig:diagram}: a system that starts at rest, a sampler, and noise added to the samples.")
    nodes = {
        "w": Node((0, 0), "$w$", "signal"), "F": Node((1.3, 0), r"$\frac{1}{s+1/T}$"), "G": Node((3.2, 0), r"$\frac{1}{s+a}$"),
        "S": Node((4.6, 0), r"$\Delta t$", "sampler"), "+": Node((5.7, 0), "", "sum"), "v": Node((5.7, 0.9), "$v(t_i)$", "signal"),
        "z": Node((7.0, 0), "$z(t_i)$", "signal"),
    }
    arrows = [Arrow("w", "F"), Arrow("F", "G", "$y(t)$"), Arrow("G", "S", "$x(t)$"), Arrow("S", "+", "$x(t_i)$"), Arrow("v", "+"), Arrow("+", "z")]
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The system. White noise $w$ of strength $2\\sigma_y^2/T$ through the first block gives the input $y$, exponentially correlated with the time $T$.")
    r.says("The autocorrelation $E[y(t)y(t+\\tau)] = \\sigma_y^2e^{-|\\tau|/T}$ is that of a first-order shaping filter $\\dot{y} = -y/T + w$ in its steady state ({ref:maybeck, chapter 4}). Its variance satisfies $0 = -2\\sigma_y^2/T + Q$, hence $Q = 2\\sigma_y^2/T = {Q}$ m²/s³. With the state $(x, y)$",
           Q=2 * p.sigma_y2 / p.T)
    r.math(r"F = \begin{bmatrix} -a & 1 \\ 0 & -\frac1T \end{bmatrix}, \quad G = \begin{bmatrix} 0 \\ 1 \end{bmatrix}, \quad Q = \frac{2\sigma_y^2}T, \quad H = \begin{bmatrix} 1 & 0 \end{bmatrix}, \quad P_0 = \begin{bmatrix} 0 & 0 \\ 0 & \sigma_y^2 \end{bmatrix}")
    r.says("At rest means $x(0) = 0$; the input is stationary from the beginning, so $P_0$ is not zero. Between samples, with $b = 1/T$,")
    r.math(r"\Phi = \begin{bmatrix} \alpha & \varphi \\ 0 & \beta \end{bmatrix}, \quad \alpha = e^{-a\Delta t}, \quad \beta = e^{-b\Delta t}, \quad \varphi = \frac{\alpha-\beta}{b-a} \quad (\varphi = \Delta t\,e^{-a\Delta t} \;\text{at}\; aT = 1)")
    r.math(r"Q_d = Q\int_0^{\Delta t}\begin{bmatrix} \varphi^2(t) & \varphi(t)\beta(t) \\ \varphi(t)\beta(t) & \beta^2(t) \end{bmatrix}dt, \qquad \int_0^{\Delta t}\varphi^2dt = \frac{J(2a) - 2J(a+b) + J(2b)}{(b-a)^2}, \qquad J(c) = \frac{1-e^{-c\Delta t}}c")
    r.model(truth)
    if p.a * p.T == 1:
        r.says("Here $aT = 1$: the two poles coincide, and the limits of these expressions are used.")
    routes = ("doubling of the short interval", "closed form")
    r.value("Phi_truth", truth.Phi, agrees=answer, routes=routes)
    r.value("Qd_truth", truth.Qd, "m², m²/s, m²/s²", agrees=answer, routes=routes)


def part_b(r, p, answer, truth):
    """Which white noise, and when."""
    r.section("b", "White noise instead of y, and when it is adequate")
    r.says("White noise has the same density at all frequencies and no memory. The input has")
    r.math(r"S_y(\omega) = \int\sigma_y^2e^{-|\tau|/T}e^{-j\omega\tau}d\tau = \frac{2\sigma_y^2T}{1+\omega^2T^2}", "density")
    r.says("A suitable strength is the density that the system sees, about $S_y(0) = 2\\sigma_y^2T$. Before any filter is designed two conditions can be stated.")
    r.items(["$aT \\ll 1$: the density is flat over the bandwidth $a$ of the system, which therefore cannot tell the input from white noise: $S_y(a)/S_y(0) = 1/(1 + a^2T^2)$.",
             "$T \\ll \\Delta t$: what the input adds to $x$ during one interval is hardly correlated with what it adds during the next, as the simplified model assumes."])
    r.says("The second condition in numbers: the disturbances $d_i = x(t_{i+1}) - \\alpha x(t_i)$ of successive intervals have the correlation")
    r.math(r"\rho = \frac{E[d_{i+1}d_i]}{E[d_i^2]} = \frac{\varphi\,(\varphi\beta\sigma_y^2 + Q_{d,12})}{\varphi^2\sigma_y^2 + Q_{d,11}}, \qquad \rho \approx \frac T{2\Delta t} \;\text{for}\; T \ll \Delta t \ll \tfrac1a", "correlation")
    block = shaping.gauss_markov(p.sigma_y2, p.T, name="y", unit="m/s")
    flat = shaping.psd(block, [p.a])[0] / (2 * p.sigma_y2 * p.T)
    r.check("S(a)/S(0)", flat, 1 / (1 + (p.a * p.T) ** 2), ("shaping filter", "closed form"), EXACT)
    phi, beta, Qd = truth.Phi[0, 1], truth.Phi[1, 1], truth.Qd
    correlation = phi * (phi * beta * p.sigma_y2 + Qd[0, 1]) / (phi**2 * p.sigma_y2 + Qd[0, 0])
    r.value("disturbance_correlation", correlation, agrees=answer, routes=("Φ and Qd", "differential equation of the variance"))
    adequate = p.a * p.T <= MUCH_LESS and p.T <= MUCH_LESS * p.dt
    r.value("verdict_b", adequate)
    r.says("**Is the second condition necessary?** No: Δt is the right measure only for a filter that takes each measurement as it is. A steady filter with the gain $K$ forgets by the factor $(1-K)\\alpha$ with each measurement, that is, with the time constant")
    r.math(r"\tau = -\frac{\Delta t}{\ln[(1-K)\alpha]}", "memory")
    r.says("Over this time it sums the disturbances, and in a sum of many the correlation of neighbours matters only through the density at low frequency, which is that of the input. So the condition is that the density is flat over the band of the *filter*, $T \\ll \\tau$. $T \\ll \\Delta t$ asks more than that where the measurements are poor and the filter averages many of them; {part:f} tests both.")
    tau = remembered(models(p.a, p.T, p.dt, p.R, p.sigma_y2)[1])
    r.says("Here $aT = {aT}$ and $T/\\Delta t = {ratio}$, the density at $\\omega = a$ is {flat:4} of that at 0, and $\\rho = {rho:3}$. If \"much less\" means at most {much}, the two conditions that can be stated beforehand {adequate}. ", "The memory of the filter for variant 1 is {tau:3} s, so that $T/\\tau = {share:3}$." if tau else "With perfect measurements the filter has no memory, and the input matters between the samples only.",
           aT=p.a * p.T, ratio=p.T / p.dt, flat=flat, rho=correlation, much=MUCH_LESS, adequate="hold" if adequate else "do not both hold", tau=tau, share=p.T / tau if tau else 0.0)
    spectra(r, p, block, tau)


def spectra(r, p, block, tau):
    """Densities of the input and of the white noises that stand for it."""
    w, levels = np.logspace(-2, 2, 161) / p.T, by_hand.intensities(p.a, p.T, p.sigma_y2)
    curves = [Curve("input y", w, shaping.psd(block, w), "black")] + [
        Curve(text("variant {n}", n=i), w, np.full(len(w), Q), colour, "dash") for i, (Q, colour) in enumerate(zip(levels, ("blue", "orange"), strict=True), start=1)]
    places = {"$a$": p.a, "$\\pi/\\Delta t$": math.pi / p.dt, "$1/\\tau$": 1 / tau if tau else 0.0}
    marks = tuple(Mark(name, at, colour, "dot", 1.6) for (name, at), colour in zip(places.items(), ("green", "purple", "sky"), strict=True) if w[0] <= at <= w[-1])
    r.figure("spectra", Drawing("Spectral density", "ω, rad/s", (Panel("spectral density, m²/s", tuple(curves), kind="log"),), log=True, marks=marks),
             "Spectral density of the input, and of the white noises of part (c). Dotted, where they lie in the range: the pole of the system, half the sampling frequency, and the band of the filter.")
    r.says("In {fig:spectra} the density of the input is flat up to about $\\omega = 1/T = {corner:3}$ rad/s and falls with $\\omega^{-2}$ beyond. White noise is a good substitute where the pole $a$ and the band $1/\\tau$ lie on the flat part.", corner=1 / p.T)


def part_c(r, p, answer):
    """The two variants."""
    r.section("c", "Two meanings of adequate")
    r.says("**Variant 1**, the same density at low frequency. White noise of strength $Q$ has the density $Q$, so $Q = S_y(0) = 2\\sigma_y^2T$; for the sheet's $\\sigma_y^2 = 5$ m²/s² this is $10T$. ∎")
    r.says("**Variant 2**, the same steady variance of $x$. For the simplified model $0 = -2aP + Q$, so $P = Q/(2a)$. For the true one, in the steady state,")
    r.math(r"0 = \frac d{dt}E[xy] = -\left(a+\tfrac1T\right)E[xy] + \sigma_y^2 \;\Rightarrow\; E[xy] = \frac{\sigma_y^2T}{1+aT}, \qquad 0 = \frac d{dt}E[x^2] = -2aE[x^2] + 2E[xy] \;\Rightarrow\; E[x^2] = \frac{\sigma_y^2T}{a(1+aT)}")
    r.says("Equal variances need $Q = 2aE[x^2] = 2\\sigma_y^2T/(1 + aT)$, for the sheet's $\\sigma_y^2$ again $10T/(1 + aT)$. ∎ It is smaller by the factor $1 + aT$, because the system passes less of the band-limited input than of white noise.")
    system = truth_system(p.a, p.T, p.sigma_y2)
    low = float(shaping.psd(shaping.gauss_markov(p.sigma_y2, p.T), [0.0])[0])
    r.value("intensity_variant1", low, "m²/s", symbol="Q_1", agrees=answer, routes=("shaping filter at ω = 0", "closed form"))
    if p.a:
        second, route = 2 * p.a * shaping.stationary_covariance(system)[0, 0], "Lyapunov equation"
    else:
        second, route = low, "shaping filter at ω = 0"
        r.says("Here $a = 0$: $x$ is an integral of the input and has no steady variance. Variant 2 is then the limit $a \\to 0$, in which the variances grow at the same rate $Q$: both variants are one.")
    r.value("intensity_variant2", second, "m²/s", symbol="Q_2", agrees=answer, routes=(route, "closed form"))
    r.says("For the given numbers $Q = {first}$ m²/s (variant 1) and $Q = {second}$ m²/s (variant 2).", first=low, second=second)


def part_d(r, p, answer, systems):
    """The three filters."""
    r.section("d", "The three filters, written out")
    truth, *designs = systems
    r.says("**Simplified filters.** $\\dot{x} = -ax + w$ is sampled: $\\Phi = \\alpha$, $Q_d = Q(1-\\alpha^2)/(2a)$ ($Q\\Delta t$ at $a = 0$). $H = 1$ and $R$ are the sheet's; at rest $\\hat{x}(0) = 0$ and $P(0) = 0$. For $i = 1, 2, \\dots$")
    r.math(r"\hat x_i^- = \alpha\hat x_{i-1}^+, \quad P_i^- = \alpha^2P_{i-1}^+ + Q_d, \quad K_i = \frac{P_i^-}{P_i^-+R}, \quad \hat x_i^+ = \hat x_i^- + K_i(z_i - \hat x_i^-), \quad P_i^+ = (1-K_i)P_i^-", "simplified")
    r.items([text("variant {n}: $\\alpha = {alpha}$, $Q_d = {Qd}$ m²", n=i, alpha=d.Phi[0, 0], Qd=d.Qd[0, 0]) for i, d in enumerate(designs, start=1)])
    r.says("**Filter of the true model.** It estimates the input as well. Its first prediction uses $P_{22}(0) = \\sigma_y^2$, because the input does not start from zero:")
    r.math(r"\hat x_i^- = \alpha\hat x_{i-1}^+ + \varphi\hat y_{i-1}^+, \qquad \hat y_i^- = \beta\hat y_{i-1}^+", "full")
    r.math(r"P_{11}^- = \alpha^2P_{11}^+ + 2\alpha\varphi P_{12}^+ + \varphi^2P_{22}^+ + Q_{d,11}, \qquad P_{12}^- = \beta(\alpha P_{12}^+ + \varphi P_{22}^+) + Q_{d,12}, \qquad P_{22}^- = \beta^2P_{22}^+ + Q_{d,22}")
    r.math(r"K_1 = \frac{P_{11}^-}{P_{11}^-+R}, \quad K_2 = \frac{P_{12}^-}{P_{11}^-+R}, \quad \hat x_i^+ = \hat x_i^- + K_1(z_i-\hat x_i^-), \quad \hat y_i^+ = \hat y_i^- + K_2(z_i-\hat x_i^-)")
    r.math(r"P_{11}^+ = (1-K_1)P_{11}^-, \qquad P_{12}^+ = (1-K_1)P_{12}^-, \qquad P_{22}^+ = P_{22}^- - K_2P_{12}^-")
    at = list(range(1, p.steps + 1))
    r.value("optimal_variance", covariances(truth, p.steps).P_plus[1:, 0, 0], "m²", at=at, agrees=answer, routes=("recursion", "joint Gaussian distribution"))
    for i, design in enumerate(designs, start=1):
        r.value(f"claimed_variance_variant{i}", covariances(design, p.steps).P_plus[1:, 0, 0], "m²", at=at, agrees=answer, routes=("recursion", "power of the step's matrix"))


def part_e(r, p, answer, systems):
    """The equations of the sensitivity analysis."""
    r.section("e", "Sensitivity: the joint covariance of truth and filter")
    nodes = {
        "T": Node((0, 0), "true\nsystem"), "F": Node((3.1, 0), "simplified\nfilter"),
        "+": Node((4.9, 0), "", "sum"), "e": Node((6.1, 0), "$e$", "signal"), "x": Node((0, 1.0), "$x$", "signal"), "K": Node((3.1, -1.0), r"$\alpha,\,Q_d,\,R$"),
    }
    arrows = [Arrow("T", "F", "$z$"), Arrow("F", "+", r"$\hat{x}$", "+"), Arrow("+", "e"), Arrow("T", "x"), Arrow("x", "+", "", "−"), Arrow("K", "F", "$K_i$")]
    r.figure("sensitivity", plots.block_diagram(nodes, arrows), "Sensitivity analysis. The measurements come from the true system; of the filter's own covariance only the gain has an effect.")
    r.says("{fig:sensitivity} shows what is computed ({ref:gelb, chapter 7}; {ref:maybeck, chapter 6}). Let $\\xi = (x, y, \\hat{x})$ and $X = E[\\xi\\xi^T]$. Between samples the truth moves by its own matrices and the estimate by the simplified one; an update touches the estimate only:")
    r.math(r"X_i^- = \begin{bmatrix} \alpha & \varphi & 0 \\ 0 & \beta & 0 \\ 0 & 0 & \alpha \end{bmatrix}X_{i-1}^+{\begin{bmatrix} \alpha & \varphi & 0 \\ 0 & \beta & 0 \\ 0 & 0 & \alpha \end{bmatrix}}^T + \begin{bmatrix} Q_{d,11} & Q_{d,12} & 0 \\ Q_{d,12} & Q_{d,22} & 0 \\ 0 & 0 & 0 \end{bmatrix}")
    r.math(r"X_i^+ = \begin{bmatrix} 1 & 0 & 0 \\ 0 & 1 & 0 \\ K_i & 0 & 1-K_i \end{bmatrix}X_i^-{\begin{bmatrix} 1 & 0 & 0 \\ 0 & 1 & 0 \\ K_i & 0 & 1-K_i \end{bmatrix}}^T + \begin{bmatrix} 0 & 0 & 0 \\ 0 & 0 & 0 \\ 0 & 0 & K_i^2R \end{bmatrix}, \qquad X_0 = \begin{bmatrix} 0 & 0 & 0 \\ 0 & \sigma_y^2 & 0 \\ 0 & 0 & 0 \end{bmatrix}")
    r.says("$K_i$ comes from the filter's own $P_i^-$ of part (d), which otherwise has no meaning here. The true variance is that of $e = \\hat{x} - x$, $V = X_{33} - 2X_{13} + X_{11}$. Since α is the same in both models, $x$ itself drops out of the error, and with $m = E[ey]$ the equations shrink to two scalars, {eq:two} and the update below it:")
    r.math(r"m_i^- = \beta(\alpha m_{i-1}^+ - \varphi\sigma_y^2) - Q_{d,12}, \qquad V_i^- = \alpha^2V_{i-1}^+ - 2\alpha\varphi m_{i-1}^+ + \varphi^2\sigma_y^2 + Q_{d,11}", "two")
    r.math(r"m_i^+ = (1-K_i)m_i^-, \qquad V_i^+ = (1-K_i)^2V_i^- + K_i^2R, \qquad m_0 = V_0 = 0")
    truth, *designs = systems
    actual = [sensitivity.actual(truth, design, p.steps, compare=FIRST) for design in designs]
    routes = ("sensitivity recursion", "weights on all measurements and the autocovariance of x")
    for i, found in enumerate(actual, start=1):
        r.value(f"true_variance_variant{i}", found.P_plus[1:, 0, 0], "m²", at=range(1, p.steps + 1), agrees=answer, routes=routes)
    r.says("The check by a second route needs no recursion: each estimate is a weighted sum of the measurements so far, with the autocovariance of $x$ from $\\frac{d}{dt}E[x^2] = -2aE[x^2] + 2E[xy]$.")
    return {"actual": actual}


def plan(r, p, experiment, truth):
    """Every number chosen."""
    settled = settling(truth) if p.R else None
    steps = max(p.steps, min(100, 2 * (settled or 1)))
    r.says("{tab:plan} lists what was chosen. Part (f) is covariance analysis, without random numbers: over time, in the steady state, and for other $(a, T, \\Delta t)$. Part (g) repeats it by simulation: the three filters get the same data of the true model.")
    r.table("plan", ["quantity", "value", "why"], [
        ["measurements in the lists", p.steps, "the given number"],
        ["measurements simulated", steps, "the given number, or twice the settling time up to 100"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "one stream of random numbers: the filters are compared on the same data"],
        ["essential difference", ESSENTIAL, "criterion of (f), as a fraction of the optimal variance"],
        ["start of the simplified filters", 0, "at rest: $P(0) = 0$"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_f(r, p, answer, systems, actual):
    """Claimed, true and optimal variances."""
    r.section("f", "What the simplified filters claim, and what they do")
    best = covariances(systems[0], p.steps)
    over_time(r, p, best, actual)
    r.table("over_time", ["$i$", "optimal", "claimed 1", "true 1", "claimed 2", "true 2"],
            [(k, best.P_plus[k, 0, 0], *(P[k, 0, 0] for f in actual for P in (f.claimed.P_plus, f.P_plus))) for k in range(min(p.steps, 8) + 1)],
            "The same variances, m², at the first measurements; the system starts at rest, so all begin at 0.")
    names, sets = list(SIX), several(p)
    here, routes = limits(p.a, p.T, p.dt, p.R, p.sigma_y2), ("Riccati and Lyapunov equations", "closed form")
    r.value("optimal_variance_steady", here["optimal"], "m²", symbol=r"\bar P", agrees=answer, routes=("Riccati equation", "spectral factorisation"))
    for i in (1, 2):
        r.value(f"claimed_variance_steady_variant{i}", here[f"claimed_variant{i}"], "m²", agrees=answer, routes=routes)
        r.value(f"true_variance_steady_variant{i}", here[f"true_variant{i}"], "m²", symbol=rf"\bar V_{i}", agrees=answer, routes=routes)
    rows = [limits(*case, p.R, p.sigma_y2) for case in sets]
    wanted = [by_hand.steady_variances(*case, p.R, p.sigma_y2) for case in sets]
    for name in names:
        r.check(text("steady variances of the table, {name}", name=name.replace("_", " ")), [row[name] for row in rows], [row[name] for row in wanted], routes)
    r.table("several", ["a, 1/s", "T, s", "Δt, s", "T/Δt", "optimal, m²", "1: true / optimal", "1: claimed / true", "2: true / optimal", "2: claimed / true"],
            [(*case, case[1] / case[2], row["optimal"], *(share for i in (1, 2) for share in (ratio(row[f"true_variant{i}"], row["optimal"]), ratio(row[f"claimed_variant{i}"], row[f"true_variant{i}"])))) for case, row in zip(sets, rows, strict=True)],
            "Steady variances of $x$ after a measurement for the given parameters (first row) and others, among them $T = \\Delta t$ and $aT = 1$: the optimal one, and for variants 1 and 2 how much larger the true one is, and what is claimed beside it.")
    r.says("{tab:several} has the steady variances for several systems.", " The loss is large where the correlation time is long beside the memory of the filter, as {fig:memory} shows for many more." if p.R else "")
    if p.R:
        memory(r, p)
    verdicts = essential(best, actual, here)
    r.value("verdict_f_variants", verdicts[0] > ESSENTIAL)
    r.value("verdict_f_simplified", verdicts[1] > ESSENTIAL)
    r.says("**Is the difference between the variants essential?** The criterion is that their true variances differ by more than {limit} of the optimal one, at any of the {steps} measurements or in the steady state. The largest difference is {found:2} of it, so the answer is {verdict}.",
           limit=ESSENTIAL, steps=p.steps, found=verdicts[0], verdict="yes" if verdicts[0] > ESSENTIAL else "no")
    r.says("**Between a simplified filter and the exact one?** The same criterion is applied to the worse variant. Its true variance is up to {found} times the optimal one, and {steady} times in the steady state, so the answer is {verdict}.",
           found=1 + verdicts[1], steady=1 + lasting(here), verdict="yes" if verdicts[1] > ESSENTIAL else "no")
    r.holds("no filter is better than the optimal one", np.concatenate([found.P_plus[:, 0, 0] - best.P_plus[:, 0, 0] for found in actual]),
            ("sensitivity recursion", "optimal recursion"), size=float(best.P_minus[:, 0, 0].max()))
    return {"found": (here, verdicts, lasting(here))}


def over_time(r, p, best, actual):
    """Loss and claim of both variants at each measurement."""
    if not p.R:
        r.says("With perfect measurements every variance is 0 right after a measurement, and there is nothing to compare there.")
        return
    k, panels = np.arange(1, p.steps + 1), [[], []]
    for i, (found, colour, style) in enumerate(zip(actual, ("blue", "orange"), ("points", "square"), strict=True), start=1):
        loss = found.P_plus[1:, 0, 0] / best.P_plus[1:, 0, 0] - 1
        panels[0].append(Curve(text("variant {n}", n=i), k, np.where(loss > 1e-12, loss, np.nan), colour, style))
        panels[1].append(Curve(text("variant {n}", n=i), k, found.claimed.P_plus[1:, 0, 0] / found.P_plus[1:, 0, 0], colour, style))
    r.figure("over_time", Drawing("Loss", STEP, (Panel("ratio true/optimal − 1", tuple(panels[0]), kind="log"), Panel("ratio claimed/true", tuple(panels[1]), levels=(Mark("right", 1.0),))), whole=True, height=6.2),
             "What the simplified filters lose and what they claim after each measurement: the fraction by which the true variance exceeds the optimal one, and the claimed variance over the true one.")
    r.says("{fig:over_time} and {tab:over_time} follow the filters from the start. At the first measurements the simplified filters expect too large a variance of $x$, for in a short time from rest a correlated input adds less to $x$ than white noise does. Later the loss settles at its steady value. What a filter claims and what it does are different things.")


def several(p):
    """The given (a, T, Δt), and others around them."""
    a, T, dt = p.a, p.T, p.dt
    cases = [(a, T, dt), (a, T / 10, dt), (a, 10 * T, dt), (a, T, dt / 10), (a, T, 10 * dt), (a / 10, T, dt), (10 * a, T, dt), (a, dt, dt), (a, 20 * dt, dt), (1 / T, T, dt)]
    return list(dict.fromkeys(cases))


def memory(r, p):
    """Loss and claim in the steady state against the correlation time in memories of the filter."""
    panels, within = [[], []], []
    for dt, colour in ((p.dt / 10, "orange"), (p.dt, "blue"), (10 * p.dt, "green")):
        T = np.logspace(-2, 2, 33) * remembered(models(p.a, p.T, dt, p.R, p.sigma_y2)[1])
        rows, x = [limits(p.a, each, dt, p.R, p.sigma_y2) for each in T], T / [remembered(models(p.a, each, dt, p.R, p.sigma_y2)[1]) for each in T]
        loss = np.array([row["true_variant1"] / row["optimal"] - 1 for row in rows])
        within.append(loss[x <= MUCH_LESS].max(initial=0.0))
        panels[0].append(Curve(text("Δt = {dt:3} s", dt=dt), x, np.where(loss > 1e-9, loss, np.nan), colour))
        panels[1].append(Curve(text("Δt = {dt:3} s", dt=dt), x, [row["claimed_variant1"] / row["true_variant1"] for row in rows], colour))
    r.figure("memory", Drawing("Memory", "ratio $T/\\tau$", (Panel("ratio true/optimal − 1", tuple(panels[0]), kind="log"), Panel("ratio claimed/true", tuple(panels[1]), levels=(Mark("right", 1.0),))), log=True, height=6.4),
             "Variant 1 in the steady state, for three periods and many correlation times, against $T/\\tau$ with the memory τ of the filter: by what fraction its variance exceeds the optimal one, and what it claims.")
    r.says("**The time scale.** {fig:memory} confirms what {part:b} says. For a correlation time up to a quarter of the memory τ of the filter its variance is at most {within} times the optimal one, with any of the three periods, although $T/\\Delta t$ differs by a factor of up to 100 among the curves. The variance that the filter claims lies between {low:3} and {high:3} times its true one.", within=1 + max(within),
           low=min(min(curve.y) for curve in panels[1]), high=max(max(curve.y) for curve in panels[1]))


def remembered(design):
    """The time in which the steady filter forgets: −Δt/ln[(1 − K)α]."""
    pole = (1 - float(steady.solve(design).K[0, 0])) * float(design.Phi[0, 0])
    return -design.dt / math.log(max(pole, 1e-300)) if design.R.any() else 0.0


def lasting(here):
    """By what fraction of the optimal variance the worse variant exceeds it in the steady state."""
    return max(ratio(here[f"true_variant{i}"], here["optimal"]) for i in (1, 2)) - 1


def essential(best, actual, here):
    """Largest differences of true variances, in optimal ones: between the variants, and from the optimal filter."""
    optimal_ = np.append(best.P_plus[1:, 0, 0], here["optimal"])
    true = [np.append(found.P_plus[1:, 0, 0], here[f"true_variant{i}"]) for i, found in enumerate(actual, start=1)]
    size = np.where(optimal_ > 0, optimal_, np.inf)  # perfect measurements: no differences at all
    return float((np.abs(true[0] - true[1]) / size).max()), float((np.maximum(*true) / size - (size < np.inf)).max())


PARTS = Skeleton(
    result=result,
    key="ways",
    analysis=(part_a, part_b, part_c, part_d, part_e),
    plan=plan,
    experiment=(part_f, part_g),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, systems = by_hand.analytic(p), models(p.a, p.T, p.dt, p.R, p.sigma_y2)
    return PARTS.report(META, p, experiment, answer=answer, truth=systems[0], systems=systems)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
