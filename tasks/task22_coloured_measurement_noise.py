r"""Lab 22. An integrator measured in coloured noise: the derived measurement, continuous and discrete reduced filters.

Source: Semushin & Tsyganova 2001, task 22. x1' = w1 is measured in x2' = −a x2 + w2 alone, z = x1 + x2. The sheet asks for the
optimal continuous estimate of x1 and its limit for t → ∞ (to be shown: a time-invariant filter with the given transfer
function), for the discrete model and filter with its steady state, for the filter reduced by a change of basis, and for an
experiment that shows the bounds of the error covariance and how fast the steady state is reached.

Expected answer: P' = Q1 − (aP + Q1)²/(Q1+Q2) from P(0⁺) = σ1²σ2²/(σ1²+σ2²), P∞ = [√(Q1(Q1+Q2)) − Q1]/a,
x̂1/z = c1(s+a)/(s + a c1), c1 = √(Q1/(Q1+Q2)); for the sheet's reading a = 2, Q1 = 1, Q2 = 3: P∞ = 0.5, c1 = 0.5; sampled every
0.1 s the variance tends to 0.500416 with the gain 0.524356 and the pole 0.904950.
"""

import math

import numpy as np
from ctlabs.tasks._task22_bounds import NO_LIMIT, TIME, bounds, time_scale, white
from ctlabs.tasks._task22_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task22 as by_hand
from ctlabs.tasks.answers.task22 import WITHIN
from pydantic import model_validator

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bucy, reduced, settling, steady
from ctlabs.labs.comparison import same_as_whole, same_estimates
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task22",
    "title": "An integrator in coloured measurement noise: continuous and discrete reduced filters",
    "source": "Semushin & Tsyganova 2001, task 22",
    "parts": ["a", "b", "c", "d"],
}


class Parameters(LabParameters):
    """What may be changed."""

    a: Variance = given(2.0, unit="1/s", meaning="pole of the noise's shaping filter 1/(s + a)", draw=span(1, 4, 0.25))
    Q1: Variance = given(1.0, unit="m²/s", meaning="strength of w1", draw=span(0.5, 3, 0.25))
    Q2: Variance = given(3.0, unit="m²/s", meaning="strength of w2", draw=span(1, 6, 0.5))
    sigma1_2: Variance = given(1.0, unit="m²", meaning="variance of x1(t0)", symbol=r"\sigma_1^2", draw=span(0.5, 2, 0.25))
    sigma2_2: Variance = given(0.75, unit="m²", meaning="variance of x2(t0)", symbol=r"\sigma_2^2", draw=span(0.5, 2, 0.25))
    dt: Positive = given(0.1, unit="s", meaning="period of the discrete measurements", draw=one_of(0.05, 0.1, 0.2))
    steps: Count = given(20, unit="1", meaning="measurements after t0 in the list", symbol="N")

    @model_validator(mode="after")
    def _driven(self):
        if self.Q1 + self.Q2 == 0:
            msg = "expected Q1 + Q2 > 0 (without noise z is known from its beginning), received Q1 = Q2 = 0"
            raise ValueError(msg)
        return self


def model(p, **change):
    """Object and shaping filter; there is no white noise in the measurement."""
    q = p.model_copy(update=change)
    return ContinuousModel(F=[[0, 0], [0, -q.a]], G=np.eye(2), Q=np.diag([q.Q1, q.Q2]), H=[[1, 1]],
                           P0=np.diag([q.sigma1_2, q.sigma2_2]), states=["x1", "x2"], measurements=["z"],
                           units=["m", "m"])


def part_a(r, p, answer, system, small):
    """The continuous filter."""
    r.section("a", "The continuous filter and its limit")
    nodes = {
        "w1": Node((0, 1), "$w_1$", "signal"), "F": Node((1.4, 1), r"$\dfrac{1}{s}$"), "w2": Node((0, 0), "$w_2$", "signal"),
        "N": Node((1.4, 0), r"$\dfrac{1}{s+a}$"), "+": Node((3.0, 1), "", "sum"), "z": Node((4.4, 1), "$z(t)$", "signal"),
    }
    arrows = [Arrow("w1", "F"), Arrow("F", "+", "$x_1$", "+"), Arrow("w2", "N"), Arrow("N", "+", "$x_2$", "+"), Arrow("+", "z")]
    r.says("{fig:diagram} is the system; in state space it reads")
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The system (figure 5 of the sheet): the position of an integrator, and exponentially correlated noise, of which only the sum is measured.")
    r.model(system)
    r.says("**No white noise.** The Kalman–Bucy filter divides by the strength of the measurement noise, which is zero here. Instead, $z$ is known exactly, so $\\hat{x}_2 = z - \\hat{x}_1$ and only $x_1$ has to be estimated. What $z$ tells of it at each moment is in its derivative; with $\\dot{z} = w_1 - ax_2 + w_2$ and $x_2 = z - x_1$ (the idea is that of {ref:bryson_johansen}; see {ref:maybeck, section 5.10})")
    r.math(r"\dot z + az = a\,x_1 + (w_1 + w_2), \qquad \dot x_1 = w_1", "derived")
    r.says("is a measurement of $x_1$ with white noise of strength $Q_1 + Q_2$ that correlates with the process noise, $N = Q_1$. The filter for correlated noises {ref:maybeck, section 5.9} gives for {eq:derived}")
    r.math(r"\dot{\hat x}_1 = k\,(\dot z + az - a\hat x_1), \qquad k(t) = \frac{aP + Q_1}{Q_1 + Q_2}, \qquad \dot P = Q_1 - \frac{(aP + Q_1)^2}{Q_1 + Q_2}", "filter")
    r.says("**The start.** At $t_0$ the value $z(t_0)$ comes without noise: $E\\{z^2(t_0)\\} = \\sigma_z^2 = \\sigma_1^2 + \\sigma_2^2$ and $E\\{z(t_0)x_1(t_0)\\} = \\sigma_1^2$ give")
    r.math(r"\hat x_1(t_0^+) = \frac{\sigma_1^2}{\sigma_z^2}z(t_0), \qquad P(t_0^+) = \sigma_1^2 - \frac{\sigma_1^4}{\sigma_z^2} = \frac{\sigma_1^2\sigma_2^2}{\sigma_1^2 + \sigma_2^2}", "start")
    r.says("**Without differentiation.** Put $\\hat{x}_1 = \\xi + kz$. Then $k\\dot{z}$ cancels, and what has to be built is")
    r.math(r"\dot\xi = -ak\,\xi + [ak(1-k) - \dot k]\,z, \qquad \hat x_1 = \xi + kz, \qquad \xi(t_0) = \hat x_1(t_0^+) - k(t_0)z(t_0)", "built")
    nodes = {
        "z": Node((0, 1), "$z$", "signal"), "o": Node((0.8, 1), "", "branch"), "B": Node((2.0, 1), "$ak(1-k)$"), "+": Node((3.3, 1), "", "sum"), "I": Node((4.5, 1), r"$\dfrac{1}{s}$"),
        "p": Node((5.5, 1), "", "branch"), "*": Node((6.5, 1), "", "sum"), "x": Node((7.5, 1), r"$\hat{x}_1$", "signal"), "K": Node((4.5, 2), "$k$"), "A": Node((4.5, 0), "$ak$"),
    }
    arrows = [Arrow("z", "o"), Arrow("o", "B"), Arrow("B", "+", "", "+"), Arrow("+", "I"), Arrow("I", "p", r"$\xi$"), Arrow("p", "*", "", "+"), Arrow("*", "x"), Arrow("o", "K", turn="along"),
              Arrow("K", "*", "", "+"), Arrow("p", "A", turn="along"), Arrow("A", "+", "", "−")]
    r.says("{fig:filter} shows this filter with a constant gain: z reaches the estimate directly through k and, more slowly, through one integrator; nothing is differentiated.")
    r.figure("filter", plots.block_diagram(nodes, arrows), "The filter of {eq:built} with a constant gain k.")
    r.says("**The limit.** With $u = aP + Q_1$ and $u_\\infty = \\sqrt{Q_1(Q_1+Q_2)}$ the equation is $\\dot{u} = a(u_\\infty^2 - u^2)/(Q_1+Q_2)$, so that $(u - u_\\infty)/(u + u_\\infty)$ decays like $e^{-2ac_1t}$ from any $P \\ge 0$ (for $a > 0$, $Q_1 > 0$). Hence, for a > 0, $u \\to u_\\infty$,")
    r.math(r"P_\infty = \frac{\sqrt{Q_1(Q_1+Q_2)} - Q_1}{a}, \qquad k_\infty = \frac{u_\infty}{Q_1+Q_2} = \sqrt{\frac{Q_1}{Q_1+Q_2}} = c_1", "limit")
    r.says("and with the constant gain the transfer function from z is $c_1 + ac_1(1-c_1)/(s + ac_1)$, that is")
    r.math(r"\frac{\hat x_1(s)}{z(s)} = \frac{c_1(s+a)}{s + ac_1}, \qquad c_1 = \sqrt{\frac{Q_1}{Q_1+Q_2}}", "transfer")
    r.says("a time-invariant filter. ∎ Its zero at −a cancels the colour of the noise; slow changes of z pass with gain 1, fast ones with gain $c_1$.")
    filter_a(r, p, answer, small)


def filter_a(r, p, answer, small):
    """The limit and the transfer function of the continuous filter."""
    routes, settles = ("Riccati equation", "closed form"), answer["variance_steady_continuous"] is not None
    begin = reduced.transient(small, [0.0])
    r.value("variance_after_first_measurement", begin[0, 0, 0], "m²", symbol="P(t_0^+)", agrees=answer, routes=("perfect update", "by hand"), kind=EXACT)
    if settles:
        r.value("c1", bucy.steady(small.model).K[0, 0], symbol="c_1", agrees=answer, routes=routes)
        r.value("variance_steady_continuous", reduced.steady(small).P[0, 0], "m²", symbol=r"P_\infty", agrees=answer, routes=routes)
        transfer = list(reduced.transfer_function(small))
    else:
        k = float(bucy.transient(small.model, [1.0]).K[0, 0, 0])  # with a = 0 the gain is constant
        r.value("c1", math.sqrt(k), symbol="c_1", agrees=answer, routes=routes)
        r.value("variance_steady_continuous", None, reason=NO_LIMIT, agrees=answer, routes=routes)
        transfer = [[k, 0.0], [1.0, 0.0]]
        r.says("Here $a = 0$ and there is no limit: {reason}, $P(t) = P(0^+) + Q_1Q_2t/(Q_1+Q_2)$. The gain is constant all the same, $k = Q_1/(Q_1+Q_2) = c_1^2$ (not $c_1$), and the filter is $\\hat{x}_1 = kz + $ const.", reason=NO_LIMIT)
    r.value("filter_transfer_function", transfer, agrees=answer, routes=("reduced model", "closed form"))
    invariant = bool(settles and p.Q1 > 0)
    r.value("verdict_a", invariant)
    if settles:
        r.says("So the filter becomes time-invariant: its gain tends to the constant $c_1 = {c1}$, with which it is stable." if invariant else "Here $Q_1 = 0$, so $c_1 = 0$: the gain tends to zero and the pole of the filter to the origin. The filter does not become a stable time-invariant one; it goes to sleep.", c1=answer["c1"])
    end = 5 * time_scale(p)
    t = np.linspace(0.0, end, 201)
    curve = reduced.transient(small, t)[:, 0, 0]
    start = answer["variance_after_first_measurement"]
    closed = [by_hand.variance(p.a, p.Q1, p.Q2, start, x) for x in t]
    r.check("P(t) at 201 times", curve, closed, ("Riccati equation, integrated", "closed form"))
    r.says("In closed form {eq:filter} has the solution")
    r.math(r"P(t) = \frac{P(0^+)(1 - \beta\tau) + \alpha\tau}{1 + [\beta + \gamma P(0^+)]\,\tau}, \quad \tau = \frac{\tanh ac_1t}{ac_1}, \qquad \alpha = \frac{Q_1Q_2}{Q_1+Q_2}, \quad \beta = \frac{aQ_1}{Q_1+Q_2}, \quad \gamma = \frac{a^2}{Q_1+Q_2}", "variance")
    if p.a and p.Q1 * p.Q2:
        r.says("As $a \\to 0$ the noise, too, becomes a Wiener process: β and γ vanish, τ becomes t, and $P(t) = P(0^+) + \\alpha t$ has no limit. One sees it beforehand: with $a = 0$ both states have the eigenvalue 0, $HF = 0$, and how z is divided leaves no trace in it; the model is not observable.")


def part_b(r, p, answer, discrete):
    """The discrete filter and its steady state."""
    r.section("b", "The discrete filter and its steady state")
    r.says("Sampled exactly, with the period Δt, signal and noise are")
    r.math(r"x(t_{i+1}) = \begin{bmatrix} 1 & 0 \\ 0 & b \end{bmatrix}x(t_i) + w_d(t_i), \quad z(t_i) = \begin{bmatrix} 1 & 1 \end{bmatrix}x(t_i), \qquad b = e^{-a\Delta t}, \quad q_1 = Q_1\Delta t, \quad q_2 = \frac{Q_2(1-b^2)}{2a}", "sampled")
    r.model(discrete)
    _b, _apart, q1, q2 = by_hand.sampled(p.a, p.dt, p.Q1, p.Q2)
    r.check("Q_d", discrete.Qd, np.diag([q1, q2]), ("doubling of the short interval", "by hand"))
    r.says("(The sheet calls the measurement $z_1(t_i)$; it is the z of part (a), sampled.) The filter predicts and updates with $R = 0$, beginning with $z(t_0)$; since $\\hat{x}_1 + \\hat{x}_2 = z$ after every update, the covariance has one free element, p, and")
    r.math(r"\hat x_1^- = \hat x_1^+(t_{i-1}), \quad \hat x_2^- = b\,\hat x_2^+(t_{i-1}), \qquad P^- = \begin{bmatrix} p_{i-1} + q_1 & -b\,p_{i-1} \\ -b\,p_{i-1} & b^2p_{i-1} + q_2 \end{bmatrix}, \qquad \hat x^+ = \hat x^- + K(z_i - \hat x_1^- - \hat x_2^-)", "prediction")
    r.math(r"K_1 = \frac{(1-b)\,p_{i-1} + q_1}{(1-b)^2p_{i-1} + q_1 + q_2}, \quad K_2 = 1 - K_1, \qquad P^+ = p_i\begin{bmatrix} 1 & -1 \\ -1 & 1 \end{bmatrix}, \qquad p_i = \frac{(q_2 + b^2q_1)\,p_{i-1} + q_1q_2}{(1-b)^2p_{i-1} + q_1 + q_2}", "update")
    plan, routes = covariances(discrete, p.steps, first=0), ("recursion of matrices", "power of the fraction's matrix")
    r.value("posterior_variance", plan.P_plus[:, 0, 0], "m²", at=plan.t, agrees=answer, routes=routes)
    form = plan.P_plus[:, 0, 0, None, None] * np.array([[1, -1], [-1, 1]])
    r.check("P⁺ = p[[1, −1], [−1, 1]]", plan.P_plus, form, ("recursion of matrices", "proof"), EXACT, scale=float(plan.P_minus.max()))
    r.says("**Steady state.** For a > 0 the variance tends to the positive root of $(1-b)^2p^2 + q_1(1-b^2)\\,p - q_1q_2 = 0$, the gain follows from {eq:update}, and the pole is $1 - (1-b)K_1$.")
    limited = answer["posterior_variance_steady"] is not None
    found = steady.solve(discrete) if limited else None
    routes = ("Riccati equation", "root of the quadratic")
    r.value("posterior_variance_steady", found.P_plus[0, 0] if found else None, "m²", reason=NO_LIMIT, symbol=r"p_\infty", agrees=answer, routes=routes)
    r.value("gain_steady", found.K[0, 0] if found else plan.K[-1, 0, 0], symbol="K_1", agrees=answer, routes=routes)
    if found:
        r.says("Here $p_\\infty = {limit}$ m², $K_1 = {gain}$, $K_2 = {other}$; before an update the variance of $x_1$ is {prior} m². The continuous filter has {continuous} m²: it is never worse, as it has all of z between the samples.",
               limit=float(found.P_plus[0, 0]), gain=float(found.K[0, 0]), other=float(found.K[1, 0]), prior=float(found.P_minus[0, 0]), continuous=answer["variance_steady_continuous"])


def part_c(r, p, answer, discrete):
    """The basis (z, x1) and the reduced filter."""
    r.section("c", "The basis (z, x₁) and the reduced filter")
    r.says("The sum z, which is known, is taken for a state:")
    r.math(r"x^* = \begin{bmatrix} z \\ x_1 \end{bmatrix} = Tx, \quad T = \begin{bmatrix} 1 & 1 \\ 1 & 0 \end{bmatrix}, \qquad \Phi^* = \begin{bmatrix} b & 1-b \\ 0 & 1 \end{bmatrix}, \quad Q_d^* = \begin{bmatrix} q_1+q_2 & q_1 \\ q_1 & q_1 \end{bmatrix}, \quad H^* = \begin{bmatrix} 1 & 0 \end{bmatrix}, \qquad P^{*+} = \begin{bmatrix} 0 & 0 \\ 0 & p_i \end{bmatrix}", "basis")
    r.says("The first state is known after each update. The other is measured by the difference $z_i - bz_{i-1} = (1-b)x_1(t_{i-1}) + w_{d1} + w_{d2}$, the discrete counterpart of $\\dot{z} + az$, and the reduced filter is")
    r.math(r"\hat x_1(t_i^+) = \hat x_1(t_{i-1}^+) + K_{1,i}\,[z_i - b\,z_{i-1} - (1-b)\,\hat x_1(t_{i-1}^+)], \qquad \hat x_1(t_0^+) = \frac{\sigma_1^2}{\sigma_1^2+\sigma_2^2}z_0, \qquad \frac{\hat x_1}{z} = K_1\frac{1 - b\,z^{-1}}{1 - [1 - (1-b)K_1]\,z^{-1}}", "reduced")
    small = reduced.discrete(discrete, keep=["x1"], first=0)
    full = same_as_whole(r, small, discrete, p.steps, answer["posterior_variance"])
    if answer["posterior_variance_steady"] is None:
        g = full.K[-1, 0, 0]
        pole = small.model.Phi[0, 0] - g * small.model.H[0, 0]
        transfer = [[g, small.B_y[0, 0] - g * small.A_0[0, 0]], [1.0, -pole]]
    else:
        pole, transfer = float(reduced.steady(small).poles[0].real), list(reduced.transfer_function(small))
    r.value("filter_pole", pole, symbol="1 - (1-b)K_1", agrees=answer, routes=("reduced model", "by hand"))
    r.value("filter_z_transfer_function", transfer, agrees=answer, routes=("reduced model", "by hand"))
    if p.a and p.Q1:
        rate = p.a * answer["c1"]
        num, den = answer["filter_transfer_function"]
        figure = plots.bode({"continuous": (num, den), text("discrete, Δt = {dt} s", dt=p.dt): (*transfer, p.dt)}, np.geomspace(rate / 30, max(30 * p.a, 3 / p.dt), 400), marks={"$ac_1$": rate, "$a$": p.a})
        r.says("In {fig:bode} slow changes of z pass with gain 1, since noise of the pole a dies out and what remains must be the object; fast ones pass with the gain $c_1$ only, whose square is the object's share $Q_1/(Q_1 + Q_2)$ in their power. The phase lags, most between the corners. The discrete filter follows the continuous one up to frequencies near its Nyquist frequency.")
        r.figure("bode", figure, "Frequency responses of the steady filters of {eq:transfer} and {eq:reduced}; dotted: the corners.")


def sets(p):
    """Parameter sets of part (d): name, changes."""
    found = {}
    for name, shown, factors in (("a", "a = {value} 1/s", (0.25, 4.0)), ("Q1", "Q₁ = {value} m²/s", (0.1, 10.0)), ("Q2", "Q₂ = {value} m²/s", (0.1, 10.0))):
        for factor in factors:
            value = getattr(p, name) * factor
            if value:
                found[text(shown, value=value)] = {name: value}
    return {"given": {}, **found}


def visible(p, steps):
    """Steps, or fewer where an error variance that tends to 0 reaches the rounding of the simulated states."""
    found = steps
    for change in sets(p).values():
        q = p.model_copy(update=change)
        curve = by_hand.variances(q.a, q.dt, q.Q1, q.Q2, by_hand.first_variance(q.sigma1_2, q.sigma2_2), steps)
        found = min([found, *(i - 1 for i, x in enumerate(curve) if 0 < x < 1e-9 * max(curve))])
    return max(found, 1)


def plan(r, p, experiment, answer, discrete):
    """Every number chosen."""
    settled = settling(discrete, first=0) if answer["posterior_variance_steady"] else None
    steps = visible(p, max(p.steps, min(80, 2 * (settled or 20)), 10))
    r.says("{tab:plan} lists what was chosen. The continuous filter is shown by its equations, the discrete one by simulation: the ensemble against the recursion for the given numbers and for sets in which one parameter is changed, the reduced filter on the same records, and a filter that takes the noise for white.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period, s", p.dt, "given"],
        ["measurements after t0", steps, "twice the settling time, 10 at least and 80 at most, and the length of the list; fewer where the error sinks into the rounding of the states"],
        ["parameter sets", "; ".join(list(sets(p))[1:]), "a quarter and four times a, a tenth and ten times Q₁ and Q₂ (of those that are not zero)"],
        ["settling", "1 %", "the variance stays within this fraction of its limit from then on"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "another stream of random numbers for each set"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_d(r, p, experiment, answer, small, discrete, steps):
    """Bounds, settling, ensembles."""
    r.section("d", "Bounds and settling for several parameter sets")
    bounds(r, p, answer, small, discrete)
    table(r, p)
    if p.a and p.Q1 * p.Q2:
        order(r, p)
    r.says("**Simulated records.** {fig:ensemble} compares {runs} runs of the given parameters with theory, state by state. The errors of $\\hat{x}_1$ and $\\hat{x}_2$ are equal and opposite, since their sum is known; so the two rows of panels are one test, and NEES has one degree of freedom.", runs=experiment.runs)
    stats = portrait(r, experiment, discrete, steps, xlabel=TIME, first=0, figures={
        "ensemble": "The RMS goes to its limit; points outside the band come in groups, as successive errors are correlated."})
    same_estimates(r, experiment, reduced.discrete(discrete, keep=["x1"], first=0), discrete, steps)
    rows = []
    for i, (name, change) in enumerate(list(sets(p).items())[1:], start=1):
        truth = discretise(model(p, **change), p.dt, R=[[0]])
        own, best = covariances(truth, steps, first=0), experiment.statistics(truth, steps=steps, stream=i, first=0)
        agreement(r, name, best, own.P_plus)
        actual, wrong = sensitivity.actual(truth, discrete, steps, first=0), experiment.statistics(truth, discrete, steps=steps, stream=i, first=0)
        agreement(r, text("{name}, given filter", name=name), wrong, actual.P_plus, consistent=False)
        rows.append((name, own.sd_plus[-1, 0], rms(best), math.sqrt(actual.P_plus[-1, 0, 0]), rms(wrong)))
    r.says("{tab:ensembles} has the changed sets. The filter that was designed for the given parameters is nowhere better than the one that knows the true ones; how much it loses shows which parameter has to be known well.")
    r.table("ensembles", ["truth", "σ of theory, m", "RMS, m", "σ of the given filter, m", "its RMS, m"], rows,
            "The error of x₁ at the last measurement: the filter that knows the parameters, and the one designed for the given ones, on the same data.")
    white(r, p, experiment, answer, discrete, steps)
    own = covariances(discrete, steps, first=0)
    return {"measured": rms(stats, unit="m"), "sd": float(own.sd_plus[-1, 0]), "when": float(own.t[-1])}


def table(r, p):
    """Bounds and settling by parameter set."""
    rows, curves = [], {}
    t = np.linspace(0.0, 3 * time_scale(p), 101)
    for name, change in sets(p).items():
        q = p.model_copy(update=change)
        start, end = by_hand.first_variance(q.sigma1_2, q.sigma2_2), by_hand.limit(q.a, q.Q1, q.Q2)
        small, discrete = reduced.continuous(model(q), keep=["x1"]), discretise(model(q), q.dt, R=[[0]])
        curves[name] = reduced.transient(small, t)[:, 0, 0]
        if end is None:
            rows.append((name, start, None, None, None, None, None))
            continue
        found = reduced.steady(small)
        r.check(text("P∞, {name}", name=name), found.P[0, 0], end, ("Riccati equation", "closed form"))
        when, expected = bucy.settling_time(small.model, WITHIN), by_hand.settling_time(q.a, q.Q1, q.Q2, start)
        r.check(text("settling time, {name}", name=name), when, expected, ("search along P(t)", "closed form"))
        sampled_ = steady.solve(discrete).P_plus[0, 0]
        r.check(text("discrete limit, {name}", name=name), sampled_, by_hand.discrete_limit(q.a, q.dt, q.Q1, q.Q2), ("Riccati equation", "root of the quadratic"))
        rows.append((name, start, end, sampled_, math.sqrt(q.Q1 / (q.Q1 + q.Q2)), when, settling(discrete, WITHIN, first=0)))
    if p.a:
        r.says("{tab:sets} has the bounds and the settling times of all sets, {fig:sets} the curves. ", "Each curve goes from its $P(0^+)$ to its limit at the rate $2ac_1$, so a faster noise (larger a) and a livelier object (larger $Q_1$) shorten the transient, while a stronger noise (larger $Q_2$) raises the limit." if p.Q1 and p.Q2 else "The variance tends to zero wherever the object stands still or the noise is not driven.")
        r.table("sets", ["set", "P(0⁺), m²", "P∞, m²", "p∞ sampled, m²", "c₁", "settled, s", "settled at i"], rows,
                "Bounds of the error variance of x₁ and settling within 1 %; no settling where the limit is 0.")
    else:
        r.says("None of the sets changes a = 0, so none has a limit: in {fig:sets} every curve rises without end, the faster, the larger $Q_1Q_2/(Q_1+Q_2)$." if p.Q1 and p.Q2 else "None of the sets changes a = 0; {fig:sets} has their curves.")
    figure = plots.lines(t, curves, xlabel=TIME, ylabel="P(t), m²", straight={text("limit of the given set"): (t[[0, -1]], [by_hand.limit(p.a, p.Q1, p.Q2)] * 2)} if p.a else None)
    r.figure("sets", figure, "P(t) of {eq:variance} for the parameter sets.")


def order(r, p):
    """Δt → 0."""
    periods = [0.2 / p.a / 2**i for i in range(4)]
    errors = [discretised(p, dt) - by_hand.limit(p.a, p.Q1, p.Q2) for dt in periods]
    r.order("p∞ → P∞ as Δt → 0", errors, 2.0, ("discrete Riccati equation", "continuous closed form"))
    r.says("As Δt → 0 the sampled variance approaches the continuous one at second order: at a period of {dt} s it is {first} % above it, at half of it {second} %.",
           dt=periods[0], first=100 * errors[0] / by_hand.limit(p.a, p.Q1, p.Q2), second=100 * errors[1] / by_hand.limit(p.a, p.Q1, p.Q2))


def discretised(p, dt):
    """p∞ for another period."""
    return float(steady.solve(discretise(model(p), dt, R=[[0]])).P_plus[0, 0])


PARTS = Skeleton(
    result=result,
    key="sampled",
    analysis=(part_a, part_b, part_c),
    plan=plan,
    experiment=(part_d,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model(p)
    small, discrete = reduced.continuous(system, keep=["x1"]), discretise(system, p.dt, R=[[0]])
    return PARTS.report(META, p, experiment, answer=answer, system=system, small=small, discrete=discrete)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
