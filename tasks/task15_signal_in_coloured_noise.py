r"""Lab 15. A signal in coloured noise, without white noise: the reduced filter.

Source: Semushin & Tsyganova 2001, task 15. A first-order signal s(t) is measured at discrete times in exponentially correlated
noise n(t) alone, z = s + n. The sheet asks for the recursion of the signal's error variance, for a change of basis after which
one element of the covariance obeys a recursion of its own, with the equations of the filter reduced by it, and for the
influence of three factors, one at a time.

Expected answer: with a = e^(−w0 dt), b = e^(−wn dt) the covariance after an update is p[[1, −1], [−1, 1]],
p' = [(a²q2 + b²q1)p + q1q2]/[(a−b)²p + q1 + q2]; in the basis (z, s) it is diag(0, p); for the sheet's numbers p falls from 1/3
to 0.196772 and the gain tends to 0.768596; with w0 = wn the filter is static, p = Q1Q2/((Q1+Q2)2w).
"""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks._task15_words import NO_LIMIT, answers, conclusions, discussion, result, variants
from ctlabs.tasks.answers import task15 as by_hand
from pydantic import model_validator

from ctlabs.analysis import sensitivity
from ctlabs.filtering import reduced, settling, steady
from ctlabs.labs.comparison import same_as_whole, same_estimates
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import observability, shaping
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task15",
    "title": "A signal in coloured noise: the reduced filter",
    "source": "Semushin & Tsyganova 2001, task 15",
    "parts": ["a", "b", "c"],
}

STEP = "measurement number i"


class Parameters(LabParameters):
    """What may be changed."""

    w0: Variance = given(1.0, unit="1/s", meaning="pole of the signal's model; 0 makes it an integrator", draw=span(0.5, 2, 0.1))
    wn: Variance = given(2.0, unit="1/s", meaning="pole of the noise's shaping filter", symbol="w_n", draw=span(1.5, 4, 0.1))
    dt: Positive = given(0.5, unit="s", meaning="period of the measurements", draw=one_of(0.25, 0.5, 0.75, 1))
    Q1: Variance = given(2.0, unit="V²/s", meaning="strength of the white noise w1 that drives the signal", draw=span(1, 4, 0.25))
    Q2: Variance = given(1.0, unit="V²/s", meaning="strength of the white noise w2 that drives the noise", draw=span(0.5, 3, 0.25))
    Es2: Variance = given(1.0, unit="V²", meaning="variance of s(t0)", symbol=r"E\,s^2(t_0)", draw=span(0.5, 2, 0.25))
    En2: Variance = given(0.5, unit="V²", meaning="variance of n(t0)", symbol=r"E\,n^2(t_0)", draw=span(0.25, 1.5, 0.25))
    steps: Count = given(10, unit="1", meaning="measurements after t0 in the lists", symbol="N")

    @model_validator(mode="after")
    def _driven(self):
        if self.Q1 + self.Q2 == 0:
            msg = "expected Q1 + Q2 > 0 (after two measurements nothing is left to estimate), received Q1 = Q2 = 0"
            raise ValueError(msg)
        return self


def model(p, **change):
    """The discrete model; there is no white noise in its measurement."""
    q = p.model_copy(update=change)
    return discretise(continuous(q.w0, q.wn, q.Q1, q.Q2, q.Es2, q.En2), q.dt, R=[[0]])


def continuous(w0, wn, Q1, Q2, Es2, En2):
    """Signal and coloured noise as two states."""
    signal = replace(shaping.gauss_markov(1.0, 1.0, name="s", unit="V"), F=[[-w0]], Q=[[Q1]], P0=[[Es2]], measurements=["z"])
    noise = replace(shaping.gauss_markov(1.0, 1.0, name="n", unit="V"), F=[[-wn]], Q=[[Q2]], P0=[[En2]])
    return shaping.augment_measurement(signal, noise)


def part_a(r, p, answer, system):
    """The recursion for p."""
    r.section("a", "The recursion of the signal's error variance")
    nodes = {
        "w1": Node((0, 1), "$w_1$", "signal"), "F": Node((1.4, 1), r"$\dfrac{1}{s+w_0}$"), "w2": Node((0, 0), "$w_2$", "signal"),
        "N": Node((1.4, 0), r"$\dfrac{1}{s+w_n}$"), "+": Node((3.0, 1), "", "sum"), "S": Node((4.2, 1), r"$\Delta t$", "sampler"), "z": Node((5.6, 1), "$z(t_i)$", "signal"),
    }
    arrows = [Arrow("w1", "F"), Arrow("F", "+", "$s(t)$", "+"), Arrow("w2", "N"), Arrow("N", "+", "$n(t)$", "+"), Arrow("+", "S", "$z(t)$"), Arrow("S", "z")]
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The system (figure 3 of the sheet): the noise in the measurement is coloured, and no white noise is added.")
    r.says("In {fig:diagram} nothing but the sum of signal and noise is measured. The noise becomes a state {ref:maybeck, section 5.10}, $x = (s, n)$, and what is left of the measurement has no noise at all, $R = 0$. Sampled exactly,")
    r.math(r"x(t_{i+1}) = \begin{bmatrix} a & 0 \\ 0 & b \end{bmatrix}x(t_i) + w_d(t_i), \quad z(t_i) = \begin{bmatrix} 1 & 1 \end{bmatrix}x(t_i), \qquad a = e^{-w_0\Delta t}, \; b = e^{-w_n\Delta t},", "model")
    r.math(r"Q_d = \begin{bmatrix} q_1 & 0 \\ 0 & q_2 \end{bmatrix}, \qquad q_1 = \frac{Q_1(1-a^2)}{2w_0}, \quad q_2 = \frac{Q_2(1-b^2)}{2w_n} \qquad (q = Q\Delta t \text{ at a zero frequency})")
    r.model(system)
    *_unused, q1, q2 = by_hand.sampled(p.w0, p.wn, p.dt, p.Q1, p.Q2)
    r.check("Q_d", system.Qd, np.diag([q1, q2]), ("doubling of the short interval", "by hand"))
    r.says("(The sheet prints $2\\delta(t)$ for the autocorrelation of $w_1$; $2\\delta(\\tau)$ is meant.) The first measurement is at $t_0$. Since it is perfect, every filtered estimate satisfies $\\hat{s} + \\hat{n} = z = s + n$: the errors of $\\hat{s}$ and $\\hat{n}$ are opposite, and the covariance after an update has one free element, $p_i$,")
    r.math(r"P(t_i^+) = p_i\begin{bmatrix} 1 & -1 \\ -1 & 1 \end{bmatrix}, \qquad P(t_i^-) = \begin{bmatrix} a^2p_{i-1} + q_1 & -ab\,p_{i-1} \\ -ab\,p_{i-1} & b^2p_{i-1} + q_2 \end{bmatrix}.", "form")
    r.says("The update with $R = 0$ leaves the determinant of $P^-$ over the variance of z,")
    r.math(r"p_i = \frac{P_{11}^-P_{22}^- - (P_{12}^-)^2}{P_{11}^- + 2P_{12}^- + P_{22}^-} = \frac{(a^2q_2 + b^2q_1)\,p_{i-1} + q_1q_2}{(a-b)^2\,p_{i-1} + q_1 + q_2}, \qquad p_0 = \frac{E s^2(t_0)\,E n^2(t_0)}{E s^2(t_0) + E n^2(t_0)},", "recursion")
    r.math(r"K_{s,i} = \frac{a(a-b)\,p_{i-1} + q_1}{(a-b)^2\,p_{i-1} + q_1 + q_2}, \qquad K_n = 1 - K_s, \qquad K_{s,0} = \frac{E s^2(t_0)}{E s^2(t_0) + E n^2(t_0)}.", "gain")
    plan, at = covariances(system, p.steps, first=0), range(p.steps + 1)
    routes = ("recursion of matrices", "power of the fraction's matrix")
    r.value("signal_variance", plan.P_plus[:, 0, 0], "V²", at=plan.t, agrees=answer, routes=routes)
    r.value("gain", plan.K[:, 0, 0], at=plan.t, agrees=answer, routes=routes)
    form = plan.P_plus[:, 0, 0, None, None] * np.array([[1, -1], [-1, 1]])
    r.check("P⁺ = p[[1, −1], [−1, 1]]", plan.P_plus, form, ("recursion of matrices", "proof"), EXACT, scale=float(plan.P_minus.max()))
    r.table("recursion", ["i", "p, V²", "Kₛ", "variance of the prediction of s, V²"], [(i, plan.P_plus[i, 0, 0], plan.K[i, 0, 0], plan.P_minus[i, 0, 0]) for i in at],
            "The recursion of {eq:recursion} for the given numbers.")
    r.says("{tab:recursion} has the numbers. A perfect measurement of the sum does not make the signal known; the last column is the variance that it meets, of which p is left.")
    r.says("**Steady state.** The fixed point of {eq:recursion} is the positive root of")
    r.math(r"(a-b)^2p^2 + [q_1(1-b^2) + q_2(1-a^2)]\,p - q_1q_2 = 0.", "steady")
    limit = answer["signal_variance_steady"]
    found = None if limit is None else steady.solve(system)
    r.value("signal_variance_steady", None if found is None else found.P_plus[0, 0], "V²", reason=NO_LIMIT, symbol=r"p_\infty", agrees=answer, routes=("Riccati equation", "root of the quadratic"))
    gain = plan.K[-1, 0, 0] if found is None else found.K[0, 0]  # equal poles: the gain is the same from t1 on
    r.value("gain_steady", gain, symbol="K_s", agrees=answer, routes=("Riccati equation" if found else "recursion of matrices", "closed form"))
    if found is None:
        r.says("Here there is no such root: {reason}. The gain is constant from $t_1$ on, {gain}.", reason=NO_LIMIT, gain=float(gain))
    else:
        r.says("Here $p_\\infty = {limit}$ V² and $K_s = {gain}$: the best estimate of the signal has the standard deviation {sd} V.", limit=limit, gain=float(gain), sd=math.sqrt(limit))


def part_b(r, p, answer, system, small):
    """The basis (z, s) and the reduced filter."""
    r.section("b", "The basis (z, s) and the reduced filter")
    r.says("In the basis $x^* = (z, s) = Tx$ the measurement is the first state, which is known exactly after each update, and")
    r.math(r"T = \begin{bmatrix} 1 & 1 \\ 1 & 0 \end{bmatrix}, \quad \Phi^* = T\Phi T^{-1} = \begin{bmatrix} b & a-b \\ 0 & a \end{bmatrix}, \quad Q_d^* = \begin{bmatrix} q_1+q_2 & q_1 \\ q_1 & q_1 \end{bmatrix}, \quad H^* = \begin{bmatrix} 1 & 0 \end{bmatrix}, \qquad P^*(t_i^+) = TP(t_i^+)T^T = \begin{bmatrix} 0 & 0 \\ 0 & p_i \end{bmatrix}.", "basis")
    r.says("The element $P_{22}^* = p_i$ obeys the recursion of part (a), in which nothing but its own last value appears; the first row and column are zero. So only $\\hat{s}$ has to be computed. What $z(t_i)$ adds to $z(t_{i-1})$ is a measurement of the signal one step before. With $w_d = (w_{d1}, w_{d2})$ its noise contains that of the signal itself, $w_{d1}$, and so is correlated with it ({ref:maybeck, section 5.9}),")
    r.math(r"z_i - b\,z_{i-1} = (a-b)\,s_{i-1} + (w_{d1} + w_{d2}), \qquad s_i = a\,s_{i-1} + w_{d1}.", "derived")
    r.says("The reduced filter, complete, is")
    r.math(r"\hat s_0 = K_{s,0}\,z_0, \qquad \hat s_i = a\,\hat s_{i-1} + K_{s,i}\,[z_i - b\,z_{i-1} - (a-b)\,\hat s_{i-1}], \qquad \hat n_i = z_i - \hat s_i,", "reduced")
    r.says("with $p_i$ and $K_{s,i}$ as in {part:a}: one state and one scalar recursion instead of two states and three elements of a covariance. {fig:reduced} shows how it is built: the delay on the left takes the colour out of the measurement, the loop through $a - b$ subtracts what the last estimate lets one expect of the rest.")
    nodes = {
        "z": Node((0, 1), "$z_i$", "signal"), "z1": Node((0.9, 1), "", "branch"), "+": Node((2.6, 1), "", "sum"), "K": Node((4.0, 1), "$K_{s,i}$"), "*": Node((5.4, 1), "", "sum"), "o": Node((6.4, 1), "", "branch"),
        "s": Node((7.3, 1), r"$\hat{s}_i$", "signal"), "b": Node((0.9, -0.2), r"$b\,z^{-1}$"), "a": Node((5.4, -0.2), "$a\\,z^{-1}$"), "f": Node((4.0, -1.2), "$(a-b)\\,z^{-1}$"), "d": Node((2.6, -0.2), "", "sum"),
        "o2": Node((6.4, -0.2), "", "branch"),
    }
    arrows = [Arrow("z", "z1"), Arrow("z1", "+"), Arrow("z1", "b"), Arrow("b", "d", "", "+"), Arrow("+", "K"), Arrow("K", "*"), Arrow("*", "o"), Arrow("o", "s"), Arrow("o", "o2"), Arrow("o2", "a"), Arrow("a", "*"),
              Arrow("o2", "f", turn="along"), Arrow("f", "d", "", "+"), Arrow("d", "+", "", "−")]
    r.figure("reduced", plots.block_diagram(nodes, arrows), "The reduced filter, {eq:reduced}: the measurement is differenced, and one state is left.")
    full = same_as_whole(r, small, system, p.steps, answer["signal_variance"])
    r.says("**The steady filter.** With $K_s$ constant its transfer function has one pole and one zero; the zero cancels the colour of the noise:")
    r.math(r"\frac{\hat S(z)}{Z(z)} = K_s\,\frac{1 - b\,z^{-1}}{1 - [a - (a-b)K_s]\,z^{-1}}.", "transfer")
    if answer["signal_variance_steady"] is None:
        b, g = small.model, full.K[-1, 0, 0]
        pole = b.Phi[0, 0] - g * b.H[0, 0]
        transfer = [[g, small.B_y[0, 0] - g * small.A_0[0, 0]], [1.0, -pole]]
    else:
        pole, transfer = float(reduced.steady(small).poles[0].real), list(reduced.transfer_function(small))
    routes = ("reduced model", "by hand")
    r.value("filter_pole", pole, symbol="a - (a-b)K_s", agrees=answer, routes=routes)
    r.value("filter_z_transfer_function", transfer, agrees=answer, routes=routes)
    num, den = answer["filter_z_transfer_function"]
    if p.w0 == p.wn:
        r.says("Here $w_0 = w_n$: zero and pole coincide at {pole} and cancel; the filter is the constant {gain} once the initial condition is forgotten.", pole=pole, gain=num[0])
    else:
        r.says("Here the zero is at {zero} and the pole at {pole}; a constant measurement is passed with the factor {static}, a sudden change with the factor {gain} at first.",
               zero=-num[1] / num[0] if num[0] else 0.0, pole=pole, static=sum(num) / sum(den) if sum(den) else math.inf, gain=num[0])


def analysis_c(r, p, answer):
    """One factor at a time, by covariance analysis."""
    r.section("c", "Three factors, one at a time: analysis")
    r.says("**Strength of $w_1$.** p does not decrease where $q_1$ increases: the covariance of a Riccati recursion is monotone in its noises ({ref:anderson_moore, chapter 4}). It increases where the noise is driven, $q_2 > 0$. The gain increases as well, since a change of z is then more probably one of the signal. **Initial noise variance.** $p_0$ increases with $E n^2(t_0)$, but neither a, b nor q contain it: the steady state stays, and the difference dies out. **Equal frequencies.** With $a = b$ the difference $z_i - bz_{i-1}$ contains no signal: the pair $(\\Phi, H)$ is unobservable, and {eq:recursion} is linear,")
    r.math(r"p_i = a^2p_{i-1} + \frac{q_1q_2}{q_1+q_2}, \qquad p_\infty = \frac{q_1q_2}{(q_1+q_2)(1-a^2)} = \frac{Q_1Q_2}{(Q_1+Q_2)\,2w}, \qquad K_s = \frac{Q_1}{Q_1+Q_2},", "equal")
    r.says("and the filter is static: signal and noise have spectra of one shape, so that no frequency tells more than another. For a positive common frequency the hidden difference decays by itself (the model is detectable) and the filter is stable with the pole a.")
    rows = []
    for name, change in variants(p):
        q = p.model_copy(update=change)
        system = model(q)
        p0 = covariances(system, 1, first=0).P_plus[0, 0, 0]
        limit = by_hand.variance_limit(q.w0, q.wn, q.dt, q.Q1, q.Q2)
        if limit is None:
            rows.append((name, p0, None, None, None, None, observability.analyse(system).rank))
            continue
        found, settled = steady.solve(system), settling(system, first=0)
        pole = float(reduced.steady(reduced.discrete(system, keep=["s"])).poles[0].real)
        r.check(text("steady variance, {name}", name=name), found.P_plus[0, 0], limit, ("Riccati equation", "root of the quadratic"))
        rows.append((name, p0, found.P_plus[0, 0], found.K[0, 0], pole, settled, observability.analyse(system).rank))
    r.table("factors", ["factor", "p₀, V²", "p∞, V²", "Kₛ", "filter pole", "settled at i", "rank of observability"], rows,
            "One factor changed at a time. Settled: p stays within 1 % of its limit; no number where the limit is 0 or absent.")
    equal = answer["signal_variance_steady_equal_frequencies"]
    found = None if equal is None else steady.solve(model(p, wn=p.w0)).P_plus[0, 0]
    r.value("signal_variance_steady_equal_frequencies", found, "V²", symbol=r"p_\infty\;(w_n = w_0)", reason=NO_LIMIT, agrees=answer, routes=("Riccati equation", "closed form"))
    seen = observability.analyse(model(p))
    r.value("verdict_c", bool(seen.ok))
    r.says("The given pair $(\\Phi, H)$ is observable (rank {rank} of 2)." if seen.ok else "The given pair $(\\Phi, H)$ is not observable (rank {rank} of 2), but detectable, which is what the filter needs." if seen.detectable else "The given pair $(\\Phi, H)$ is neither observable (rank {rank} of 2) nor detectable.", rank=seen.rank)
    curves = {name: covariances(model(p, **change), max(p.steps, 8), first=0).P_plus[:, 0, 0] for name, change in variants(p)}
    figure = plots.lines(range(max(p.steps, 8) + 1), curves, xlabel=STEP, ylabel="p, V²", marker=".", steps=True)
    r.says("{fig:factors} and {tab:factors} show each factor. The curves with another variance of $n(t_0)$ begin apart and join the given one; those with another strength of $w_1$ begin together and go to limits of their own." if answer["signal_variance_steady"] else "{fig:factors} and {tab:factors} show each factor. For the given numbers p does not tend to a positive limit, so that all that can be compared is how the curves begin.")
    r.figure("factors", figure, "The error variance of the signal after each measurement, from $t_0$ on, for each factor.")
    wrong_filters(r, p)


def wrong_filters(r, p):
    """The given filter on other truths."""
    r.says("**The filter that does not know.** The filter designed for the given numbers runs on each changed truth. It claims its own p; its true variance follows from covariance analysis, and by hand, since only the signal's error matters, with the gain K of the design,")
    r.math(r"e_i = [a - (a-b)K]\,e_{i-1} - (1-K)w_{d1} + K w_{d2} \quad\Rightarrow\quad p = \frac{(1-K)^2q_1 + K^2q_2}{1 - [a - (a-b)K]^2}.", "wrong")
    design, rows = model(p), []
    if by_hand.variance_limit(p.w0, p.wn, p.dt, p.Q1, p.Q2) is None:
        r.says("Here it has no steady state to compare: {reason}.", reason=NO_LIMIT)
        return
    a, _b, apart, _q1, _q2 = by_hand.sampled(p.w0, p.wn, p.dt, p.Q1, p.Q2)
    gain = float(steady.solve(design).K[0, 0])
    for name, change in variants(p)[1:]:
        if "Q1" not in change:
            continue
        truth, q = model(p, **change), by_hand.sampled(p.w0, p.wn, p.dt, change["Q1"], p.Q2)
        if abs(a - apart * gain) >= 1 - 1e-12:
            r.says("With {name} its pole is on the unit circle and its error grows without bound.", name=name)
            continue
        found = sensitivity.steady(truth, design)
        expected = ((1 - gain) ** 2 * q[3] + gain**2 * q[4]) / (1 - (a - apart * gain) ** 2)
        r.check(text("true variance of the given filter, {name}", name=name), found.P_plus[0, 0], expected, ("sensitivity analysis", "by hand"))
        best = steady.solve(truth).P_plus[0, 0]
        r.holds(text("not better than the optimal filter, {name}", name=name), found.P_plus[0, 0] - best, ("sensitivity analysis", "Riccati equation"), size=max(best, 1e-300))
        rows.append((name, steady.solve(design).P_plus[0, 0], found.P_plus[0, 0], best, found.P_plus[0, 0] / best if best else None))
    if not rows:
        return
    r.table("wrong", ["truth", "claimed, V²", "true, V²", "optimal, V²", "true over optimal"], rows,
            "The given filter in steady state on other truths.")
    r.says("In {tab:wrong} the claim stays what it was, whatever the truth is. A wrong strength is not forgotten; a wrong initial variance is, so that it has no row there.")


def plan(r, p, experiment, answer, system):
    """Every number chosen."""
    settled = settling(system, first=0) if answer["signal_variance_steady"] else None
    steps = visible(p, max(p.steps, min(60, 3 * (settled or 10)), 8))
    r.says("{tab:plan} lists what was chosen. Part (c) is repeated by simulation: the full filter, the reduced one on the same records, and the given filter on data of the changed truths.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period, s", p.dt, "given"],
        ["measurements after t0", steps, "three settling times, 8 at least and 60 at most, and the length of the lists; fewer where the error sinks into the rounding of s and n"],
        ["first measurement", "t0", "the sheet's recursion begins with it"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "another stream of random numbers for each truth"],
        ["factors", "; ".join(name for name, _change in variants(p)[1:]), "the sheet's: half and one and a half of Q₁, double and fourfold variance of n(t0), equal frequencies"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def visible(p, steps):
    """Steps, or fewer where an error variance that tends to 0 reaches the rounding of the simulated signal and noise."""
    found = steps
    for _name, change in variants(p):
        q = p.model_copy(update=change)
        curve = by_hand.variances(q.w0, q.wn, q.dt, q.Q1, q.Q2, q.Es2, q.En2, steps)
        found = min([found, *(i - 1 for i, x in enumerate(curve) if 0 < x < 1e-9 * max(curve))])
    return max(found, 1)


def experiment_c(r, p, experiment, system, small, steps):
    """Ensembles against theory."""
    r.section("c", "Three factors, one at a time: experiment")
    r.says("**The given numbers.** {fig:errors} shows 25 runs, {fig:ensemble} the statistics of all {runs}. The errors of signal and noise are equal and opposite, since their sum is known, so that the two rows of panels are one test and NEES has one degree of freedom.", runs=experiment.runs)
    stats = portrait(r, experiment, system, steps, xlabel="t, s", first=0, figures={
        "errors": "A measurement narrows the band of the prediction, but not to zero, although it is perfect: how it divides into signal and noise remains uncertain.",
        "ensemble": "About one point in twenty lies outside the band."})
    same_estimates(r, experiment, small, system, steps)
    rows = []
    for i, (name, change) in enumerate(variants(p)[1:], start=1):
        truth = model(p, **change)
        own = covariances(truth, steps, first=0)
        best = experiment.statistics(truth, steps=steps, stream=i, first=0)
        agreement(r, name, best, own.P_plus)
        actual = sensitivity.actual(truth, system, steps, first=0)
        wrong = experiment.statistics(truth, system, steps=steps, stream=i, first=0)
        agreement(r, text("{name}, given filter", name=name), wrong, actual.P_plus, consistent=False)
        rows.append((name, own.sd_plus[-1, 0], rms(best), math.sqrt(actual.P_plus[-1, 0, 0]), rms(wrong)))
    r.says("**The changed truths.** In {tab:ensembles} the filter that knows the truth and the given one run on the same data. Where only the variance of $n(t_0)$ was changed they end together, as (c) has it; with another strength or frequency the given filter is not better, and mostly worse.")
    r.table("ensembles", ["truth", "σ of theory, V", "RMS, V", "σ of the given filter, V", "its RMS, V"], rows,
            "The signal's error at the last measurement: the filter that knows the truth and the given one, on the same data.")
    own = covariances(system, steps, first=0)
    return {"measured": rms(stats, unit="V"), "sd": float(own.sd_plus[-1, 0]), "when": float(own.t[-1])}


PARTS = Skeleton(
    result=result,
    key="factors",
    analysis=(part_a, part_b, analysis_c),
    plan=plan,
    experiment=(experiment_c,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model(p)
    small = reduced.discrete(system, keep=["s"], first=0)
    return PARTS.report(META, p, experiment, answer=answer, system=system, small=small)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
