r"""Lab 23. The engineer's black box: what a test with coloured noise tells of a filter, and what the optimum would be.

Source: Semushin & Tsyganova 2001, task 23. A box said to hold a steady Kalman filter is tested with noise of the autocorrelation
N e^(−5|τ|); the spectrum of its output is given. The sheet asks what to think of its engineer; then, when he tells the spectra
of signal and noise that he designed for, for the optimal filter, its test, and a criticism of the box; for the equivalent
discrete problem with its reduced filter and steady state; and for an experiment whose covariances are compared with part (b).

Expected answer: |H|² = (ω²+16)/(4(ω²+4)), H = (s+4)/(2(s+2)), stable and causal, but H(∞) = ½; the optimum is
(s+4)/(2(s+3)) with the mean square error 1/24, the box has 19/384 (18.75 % more, worse than a constant gain): the right gain
without feedback of the innovation. Sampled every 0.1 s the error variance falls from 0.042892 to 0.0417008.
"""

import math

import numpy as np
from ctlabs.tasks._task23_box import TIME, part_b, with_boxes
from ctlabs.tasks._task23_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task23 as by_hand
from pydantic import model_validator

from ctlabs.filtering import reduced, settling, steady
from ctlabs.labs.comparison import same_as_whole, same_estimates, taken_for_white
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, DiscreteModel, spectra
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import Uncertain, text

META = {
    "name": "task23",
    "title": "The engineer's black box: spectral factorisation, Wiener and Kalman filter",
    "source": "Semushin & Tsyganova 2001, task 23",
    "parts": ["a", "b", "c", "d"],
}

#: The printed spectra of the test, for N = 1: input and output.
TEST_INPUT, TEST_OUTPUT = "10/(w^2+25)", "5/2*(w^2+16)/((w^2+4)*(w^2+25))"


class Parameters(LabParameters):
    """What may be changed; the box itself is fixed by the printed spectra."""

    signal_power: Variance = given(5 / 12, unit="V²/s", meaning="numerator of the signal's spectrum σ/(ω² + a²)", symbol=r"\sigma", draw=span(0.25, 2, 0.25))
    signal_pole: Positive = given(2.0, unit="1/s", meaning="pole of the signal's spectrum", symbol="a", draw=span(1, 3, 0.25))
    noise_power: Variance = given(7 / 12, unit="V²/s", meaning="numerator of the noise's spectrum ν/(ω² + b²)", symbol=r"\nu", draw=span(0.25, 2, 0.25))
    noise_pole: Positive = given(4.0, unit="1/s", meaning="pole of the noise's spectrum", symbol="b", draw=span(3.5, 8, 0.5))
    test_pole: Positive = given(5.0, unit="1/s", meaning="pole of the test input 2pN/(ω² + p²) in part (b)", symbol="p", draw=span(3, 8, 0.5))
    dt: Positive = given(0.1, unit="s", meaning="period of the discrete measurements", draw=one_of(0.05, 0.1, 0.2))
    steps: Count = given(20, unit="1", meaning="measurements after t0 in the list", symbol=r"i_{\max}")

    @model_validator(mode="after")
    def _present(self):
        if self.signal_power + self.noise_power == 0:
            msg = "expected signal_power + noise_power > 0, received 0 for both"
            raise ValueError(msg)
        return self


def model(p):
    """Signal and noise as two stationary states; z is their sum and has no white noise."""
    return ContinuousModel(
        F=np.diag([-p.signal_pole, -p.noise_pole]), G=np.eye(2), Q=np.diag([p.signal_power, p.noise_power]), H=[[1, 1]],
        P0=np.diag([p.signal_power / (2 * p.signal_pole), p.noise_power / (2 * p.noise_pole)]), states=["s", "n"], measurements=["z"], units=["V", "V"],
    )


def part_a(r, answer):
    """What the test says."""
    r.section("a", "What the test of the box says")
    r.says("The spectrum of the test input is the Fourier transform of its autocorrelation; the squared magnitude of the box is the ratio of the spectra of output and input,")
    r.math(r"\Psi_{nn}(\omega) = \int Ne^{-5|\tau|}e^{-j\omega\tau}d\tau = \frac{10N}{\omega^2+25}, \qquad |H(j\omega)|^2 = \frac{\Psi_{yy}}{\Psi_{nn}} = \frac{\omega^2+16}{4(\omega^2+4)}", "ratio")
    given_, ask = spectra.exponentials([(1.0, 5.0)]), spectra.parse(TEST_INPUT)
    w = np.array([0.0, 1.0, 2.0, 4.0, 10.0, 100.0])
    r.check("spectrum of the test input", given_(w), ask(w), ("transform of the autocorrelation", "by hand"), EXACT)
    ratio = spectra.parse(f"({TEST_OUTPUT})/({TEST_INPUT})")
    num, den = spectra.factor(ratio)
    r.says("**Factorisation.** In s, with $\\omega^2 = -s^2$, $|H|^2$ becomes $H(s)H(-s)$ with zeros at ±4 and poles at ±2. Four functions have this product {ref:maybeck, chapter 4}, two of them stable:")
    r.math(r"\frac{s\pm4}{2(s\pm2)}, \qquad \text{stable: } \frac{s+4}{2(s+2)} \text{ and } \frac{s-4}{2(s+2)}", "candidates")
    r.says("A box that works is stable, so its pole is −2. Its zero is not identified ({fig:candidates}): the two stable ones of {eq:candidates} differ by the all-pass $(s-4)/(s+4)$, which no power spectrum shows (the cross-spectrum of input and output would), and each by its sign. The minimum-phase one is the only candidate for an optimal filter, which passes slow signals without reversing them,")
    r.math(r"H(s) = \frac{s+4}{2(s+2)}.", "box")
    r.value("black_box_transfer_function", [num, den], agrees=answer, routes=("spectral factorisation", "by hand"))
    printed, found = spectra.parse(TEST_OUTPUT), ask.through(num, den)
    r.check("output of the box in the test", found(w), printed(w), ("|H|² times the input's spectrum", "printed spectrum"))
    mirrored = ask.through([0.5, -2.0], [1, 2])
    r.check("the zero at +4 gives the same output", mirrored(w), printed(w), ("|H|² times the input's spectrum", "printed spectrum"))
    direct = float(num[0]) if len(num) == len(den) else 0.0
    r.value("verdict_a", direct == 0)
    r.says("**Competence.** Nothing in the test speaks against the engineer: the box is stable, causal and time-invariant. But it is not what one expects under the name: $H(\\infty) = {direct}$, so half of the fastest noise appears in the output. A Kalman filter for measurements with white noise is strictly proper, $H(s) = C(sI - F + KH)^{-1}K \\to 0$: with a direct term it would let infinite power through. The box may be a Kalman filter only if the measurement has no white noise at all.", direct=direct)
    figure = plots.bode({"zero at −4": (num, den), "zero at +4": ([0.5, -2.0], [1, 2])}, np.geomspace(0.05, 200, 300))
    r.figure("candidates", figure, "The two stable candidates of {eq:candidates}. Their magnitudes are one curve and their phases are not: the test, which measures the magnitude only, cannot tell them apart.")
    return {"box": (num, den)}


def part_c(r, p, answer, discrete):
    """The discrete problem."""
    r.section("c", "The equivalent discrete problem and its reduced filter")
    r.says("Sampled exactly, with the period Δt, signal and noise are")
    r.math(r"x(t_{i+1}) = \begin{bmatrix} \alpha & 0 \\ 0 & \beta \end{bmatrix}x(t_i) + w_d(t_i), \quad z = \begin{bmatrix} 1 & 1 \end{bmatrix}x, \qquad \alpha = e^{-a\Delta t}, \; \beta = e^{-b\Delta t}, \quad q_1 = \sigma_s^2(1-\alpha^2), \; q_2 = \sigma_n^2(1-\beta^2)", "sampled")
    r.model(discrete)
    _a, _b, _apart, q1, q2 = by_hand.sampled(p)
    r.check("Q_d", discrete.Qd, np.diag([q1, q2]), ("doubling of the short interval", "by hand"))
    r.says("Both processes are stationary from the beginning, and $z(t_0)$ is processed. After an update $\\hat{s} + \\hat{n} = z$, so the covariance after an update has one free element. In the basis $(z, s)$ it stands alone,")
    r.math(r"P^+ = p_i\begin{bmatrix} 1 & -1 \\ -1 & 1 \end{bmatrix}, \qquad P^{*+} = \begin{bmatrix} 0 & 0 \\ 0 & p_i \end{bmatrix} \quad \text{for} \quad x^* = \begin{bmatrix} z \\ s \end{bmatrix},", "basis")
    r.says("and the filter shrinks to one state, as in lab 22:")
    r.math(r"\hat s_i = \alpha\hat s_{i-1} + K_i\,[z_i - \beta z_{i-1} - (\alpha-\beta)\,\hat s_{i-1}], \qquad \hat n_i = z_i - \hat s_i, \qquad \hat s_0 = \frac{\sigma_s^2}{\sigma_s^2+\sigma_n^2}z_0", "reduced")
    r.math(r"K_i = \frac{\alpha(\alpha-\beta)\,p_{i-1} + q_1}{(\alpha-\beta)^2p_{i-1} + q_1 + q_2}, \qquad p_i = \frac{(\alpha^2q_2 + \beta^2q_1)\,p_{i-1} + q_1q_2}{(\alpha-\beta)^2p_{i-1} + q_1 + q_2}, \qquad p_0 = \frac{\sigma_s^2\sigma_n^2}{\sigma_s^2+\sigma_n^2}", "variance")
    shown, small = covariances(discrete, p.steps, first=0), reduced.discrete(discrete, keep=["s"], first=0)
    r.value("posterior_variance", shown.P_plus[:, 0, 0], "V²", at=shown.t, agrees=answer, routes=("recursion of matrices", "power of the fraction's matrix"))
    same_as_whole(r, small, discrete, p.steps, answer["posterior_variance"])
    r.says("**Steady state.** $p_\\infty$ is the positive root of $(\\alpha-\\beta)^2p^2 + [q_1(1-\\beta^2) + q_2(1-\\alpha^2)]p - q_1q_2 = 0$; the pole is $\\alpha - (\\alpha-\\beta)K$.")
    limit, routes = steady.solve(discrete), ("Riccati equation", "root of the quadratic")
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "V²", symbol=r"p_\infty", agrees=answer, routes=routes)
    r.value("gain_steady", limit.K[0, 0], symbol="K", agrees=answer, routes=routes)
    r.value("filter_pole", float(reduced.steady(small).poles[0].real), symbol=r"\alpha - (\alpha-\beta)K", agrees=answer, routes=("reduced model", "by hand"))
    num, den = reduced.transfer_function(small)
    _a, b, *_rest = by_hand.sampled(p)
    g, pole = answer["gain_steady"], answer["filter_pole"]
    r.value("filter_z_transfer_function", [num, den])
    r.check("z-transfer function", [num, den], [[g, -g * b], [1.0, -pole]], ("reduced model", "by hand"))
    r.says("Here $p_\\infty = {limit}$ V², $K = {gain}$ and the pole is {pole}", ", which a continuous filter with the pole {s} 1/s would have over one period." if pole > 0 else ".",
           limit=float(limit.P_plus[0, 0]), gain=g, pole=pole, s=math.log(pole) / p.dt if pole > 0 else -math.inf)
    if p.signal_pole == p.noise_pole:
        r.says("The poles are equal: the derived measurement contains no signal, the pair (Φ, H) is unobservable but stable, and the filter is a constant gain.")


def visible(p, steps):
    """Steps, or fewer where an error variance that tends to 0 reaches the rounding of the simulated states."""
    curve = by_hand.variances(p, steps)
    return max(min([steps, *(i - 1 for i, x in enumerate(curve) if 0 < x < 1e-9 * max(curve))]), 1)


def plan(r, p, experiment, discrete):
    """Every number chosen."""
    settled = settling(discrete, first=0) if p.signal_power * p.noise_power else None
    steps = visible(p, max(p.steps, min(60, 2 * (settled or 10)), 10))
    r.says("{tab:plan} lists what was chosen. The discrete filter is simulated. The box and the continuous optimum run on the same paths of s and n: they are joined to the model as states and the whole is sampled exactly, so that nothing of them is approximated. Filters that are wrong in another way are followed by sensitivity analysis.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period, s", p.dt, "given"],
        ["measurements after t0", steps, "twice the settling time, 10 at least and 60 at most, and the length of the list; fewer where the error sinks into the rounding of s and n"],
        ["initial state", "stationary", "the sheet gives spectra; box and optimum have been running for long"],
        ["periods of the sweep", "a quarter of Δt to four times Δt", "from much shorter to longer than the time constants"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent:2} %", percent=100 * math.sqrt(2 / experiment.runs))],
        ["seed", experiment.seed, "another stream of random numbers for each experiment"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def part_d(r, p, experiment, answer, system, small, discrete, box, steps):
    """Covariances in time against part (b), and ensembles."""
    r.section("d", "Covariances in time and the simulated filters")
    r.says("**Monotone.** The processes are stationary, and $p_i$ is the error of the best estimate from $i + 1$ successive samples; the next estimate has one sample more. Hence $p_0 \\ge p_1 \\ge \\dots \\ge p_\\infty$: the variance falls from that of the best constant gain to the steady value. The samples are part of the record, so $p_\\infty \\ge P$ of part (b) for every period. ∎")
    shown = covariances(discrete, max(p.steps, 10), first=0)
    variance, scale = shown.P_plus[:, 0, 0], float(system.P0.max())
    r.holds("p does not rise", -np.diff(variance), ("recursion of matrices", "bound proved"), size=scale)
    r.check("p₀ is the error of the best constant gain", variance[0], answer["constant_gain_variance"], ("recursion of matrices", "by hand"), scale=scale)
    optimal = answer["optimal_variance"]
    r.holds("p∞ ≥ P", answer["posterior_variance_steady"] - optimal, ("discrete", "continuous"), size=scale)
    curves = {"discrete $p_i$": variance, "continuous $P(t_i)$": reduced.transient(small, shown.t)[:, 0, 0]}
    figure = plots.lines(shown.t, curves, xlabel=TIME, ylabel="variance of s, V²", marker=".", straight={"limit of part (b)": ([0, shown.t[-1]], [optimal, optimal])})
    r.says("{fig:falling} shows this: at the first measurement both filters have the error of the best constant gain, for there is no past yet from which more could be learnt; then each falls to its own limit, the discrete one above the other." if optimal and p.signal_pole != p.noise_pole else "In {fig:falling} nothing falls: the filter has no dynamics to be learnt, or no error.")
    r.figure("falling", figure, "Error variance of the signal after each measurement, in the discrete filter and in the continuous one at the same times; dashed: the limit of part (b).")
    r.holds("p(i) ≥ P(t_i)", variance - reduced.transient(small, shown.t)[:, 0, 0], ("recursion of matrices", "Riccati equation, integrated"), size=100 * scale)
    sweep(r, p, optimal)
    agrees = bool(abs(answer["posterior_variance_steady"] - optimal) <= 0.05 * optimal)
    r.value("verdict_d", agrees)
    r.says("Does the experiment agree with part (b)? At the given period the steady variance is {above:3} % above that of the continuous filter. Up to 5 % is called agreement here: ", "it agrees." if agrees else "it does not, as the period is too long.", above=100 * (answer["posterior_variance_steady"] / optimal - 1) if optimal else 0.0)
    r.says("**The simulated filter.** {fig:ensemble} compares {runs} runs with theory. The errors of signal and noise are equal and opposite, as their sum is known, so the two rows of panels are one test.", runs=experiment.runs)
    stats = portrait(r, experiment, discrete, steps, xlabel=TIME, first=0, figures={
        "ensemble": "The RMS begins at the error of the best constant gain; where the points leave the band they do so in groups, as successive errors are correlated."})
    same_estimates(r, experiment, reduced.discrete(discrete, keep=["s"], first=0), discrete, steps)
    boxes(r, p, experiment, answer, system, box, steps)
    white(r, p, experiment, answer, discrete, steps)
    own = covariances(discrete, steps, first=0)
    return {"measured": rms(stats, unit="V"), "sd": float(own.sd_plus[-1, 0]), "when": float(own.t[-1])}


def sweep(r, p, optimal):
    """Over the period."""
    rows = []
    for factor in (0.25, 0.5, 1.0, 2.0, 4.0):
        q = p.model_copy(update={"dt": factor * p.dt})
        found = steady.solve(discretise(model(q), q.dt, R=[[0]]))
        r.check(text("p∞, Δt = {dt} s", dt=q.dt), found.P_plus[0, 0], by_hand.discrete_limit(q), ("Riccati equation", "root of the quadratic"), scale=max(optimal, 1e-300))
        rows.append((q.dt, found.P_plus[0, 0], 100 * (found.P_plus[0, 0] / optimal - 1) if optimal else None, found.K[0, 0]))
    r.says("{tab:periods} has other periods: the shorter the period, the nearer is the steady variance to that of continuous time, at second order; the longer, the nearer to that of the best constant gain.")
    r.table("periods", ["period, s", "p∞, V²", "above the continuous optimum, %", "K"], rows, "The steady variance of the discrete filter for several periods.")
    if p.signal_pole == p.noise_pole or not optimal:
        r.says("Here the period makes no difference: the filter is static or the error zero.")
        return
    shortest = 0.1 / max(p.signal_pole, p.noise_pole)
    periods = [shortest / 2**i for i in range(3)]
    errors = [float(steady.solve(discretise(model(p), dt, R=[[0]])).P_plus[0, 0]) - optimal for dt in periods]
    if min(errors) > 1e-9 * optimal:
        r.order("p∞ → P as Δt → 0", errors, 2.0, ("discrete Riccati equation", "continuous, by hand"))


def boxes(r, p, experiment, answer, system, box, steps):
    """The box and the continuous optimum on simulated paths."""
    best = answer["optimal_transfer_function"]
    joint, rows = with_boxes(system, [box, best])
    sampled_ = discretise(joint, p.dt, R=[[0]])
    some = experiment.histories(sampled_, steps=steps, runs=experiment.runs, stream=1, first=0)
    errors = np.einsum("ij,kjr->ikr", rows, some.truth)
    own = some.x_plus[:, 0] - some.truth[:, 0]
    theory = {"box": answer["black_box_variance"], "continuous optimum": answer["optimal_variance"]}
    table = []
    for (name, expected), error in zip(theory.items(), errors, strict=True):
        if expected > 1e-12 * float(joint.P0[:2, :2].max()):
            r.chance(text("mean square error, {name}", name=name), chance.mean_square(error, np.full(len(error), expected)))
        table.append((name, expected, float((error[-1] ** 2).mean()), float((error**2).mean())))
    table.append(("discrete optimum", by_hand.variances(p, steps)[-1], float((own[-1] ** 2).mean()), None))
    rows = [(name, expected, Uncertain(last, last * math.sqrt(2 / experiment.runs)), mean) for name, expected, last, mean in table]
    r.table("ensembles", ["filter", "theory, V²", "ensemble at the last measurement, V²", "also averaged over time, V²"], rows, "Mean square errors of three filters on the same paths.")
    half = 1.96 * math.sqrt(2 / experiment.runs)
    edges = {name: ([0, some.t[-1]], [value] * 2) for name, value in (("theory: box", theory["box"]), ("theory: optimum", theory["continuous optimum"]))}
    bands = {text("edges of 95 % of ensembles") if i == 0 else "_" * (i + 1): ([0, some.t[-1]], [value * factor] * 2)
             for i, (value, factor) in enumerate((v, f) for v in theory.values() for f in (1 - half, 1 + half))}
    r.says("**Box and optimum.** {fig:boxes} and {tab:ensembles} have the mean square errors of both on the same paths of signal and noise. The curves wander about their theory, mostly inside the band of 95 %: they are averages over the same runs at all times, and an error lasts as long as the time constants of the filter, so that a curve stays on one side for a while.")
    r.figure("boxes", plots.lines(some.t, {"box": (errors[0] ** 2).mean(axis=1), "continuous optimum": (errors[1] ** 2).mean(axis=1)}, xlabel=TIME, ylabel="mean square error, V²", marker=".", straight=bands, points=edges),
             "Mean square errors of {runs} runs; dots at the ends: theory; dashed: the band in which 95 % of ensembles lie at one instant.", runs=experiment.runs)


def white(r, p, experiment, answer, discrete, steps):
    """The filter that takes the noise for white."""
    noise, best = p.noise_power / (2 * p.noise_pole), answer["posterior_variance_steady"]
    if not (p.signal_power and noise):
        return
    a, _b, _apart, q1, _q2 = by_hand.sampled(p)
    design = DiscreteModel([[a]], [[q1]], [[1]], [[noise]], x0=[0], P0=discrete.P0[:1, :1], dt=p.dt, states=["s"], units=["V"])
    found = taken_for_white(r, experiment, discrete, design, steps, best=best, size=noise,
                            by_hand=lambda K: by_hand.white_variance(p, K))
    r.says("**A filter that takes the noise for white** of the same variance claims {claimed} V² and has {true} V², the optimum {best} V²", ": the samples are too close for their noises to be independent." if found.true > 1.01 * found.claimed else "; at this period the noises of neighbouring samples are nearly independent, and little is lost.",
           claimed=found.claimed, true=found.true, best=best)


PARTS = Skeleton(
    result=result,
    key="tests",
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
    small, discrete = reduced.continuous(system, keep=["s"]), discretise(system, p.dt, R=[[0]])
    return PARTS.report(META, p, experiment, answer=answer, system=system, small=small, discrete=discrete)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
