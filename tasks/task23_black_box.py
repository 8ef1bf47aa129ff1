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

import control
import numpy as np
from ctlabs.tasks.answers import task23 as by_hand
from pydantic import model_validator

from ctlabs.filtering import reduced, settling, steady
from ctlabs.labs.comparison import same_as_whole, same_estimates, taken_for_white
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, DiscreteModel, shaping, spectra
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task23",
    "title": "The engineer's black box: spectral factorisation, Wiener and Kalman filter",
    "source": "Semushin & Tsyganova 2001, task 23",
    "parts": ["a", "b", "c", "d"],
}

#: The printed spectra of the test, for N = 1: input and output.
TEST_INPUT, TEST_OUTPUT = "10/(w^2+25)", "5/2*(w^2+16)/((w^2+4)*(w^2+25))"
TIME, FREQUENCY = "t, s", "frequency ω, rad/s"


class Parameters(LabParameters):
    """What may be changed; the box itself is fixed by the printed spectra."""

    signal_power: Variance = given(5 / 12, unit="V²/s", meaning="numerator of S_s = signal_power/(ω² + signal_pole²)")
    signal_pole: Positive = given(2.0, unit="1/s", meaning="pole of the signal's spectrum")
    noise_power: Variance = given(7 / 12, unit="V²/s", meaning="numerator of S_n = noise_power/(ω² + noise_pole²)")
    noise_pole: Positive = given(4.0, unit="1/s", meaning="pole of the noise's spectrum")
    test_pole: Positive = given(5.0, unit="1/s", meaning="p of the test input 2pN/(ω² + p²) in part (b)")
    dt: Positive = given(0.1, unit="s", meaning="period of the discrete measurements")
    steps: Count = given(20, unit="1", meaning="measurements after t0 in the list")

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


def with_boxes(system, boxes):
    """The model with filters attached to z, one state each, and for each the row that gives its error ŝ − s."""
    n = system.n + len(boxes)
    F, rows = np.zeros((n, n)), []
    F[:2, :2] = system.F
    for i, (num, den) in enumerate(boxes, start=2):
        A, B, C, D = (np.asarray(m) for m in control.ssdata(control.tf2ss(num, den)))
        row, F[i, i] = np.zeros(n), -den[1]
        row[:2] = D[0, 0] * system.H[0] - [1, 0]
        if A.size:  # a filter that is zero has no state
            F[i, i], F[i, :2], row[i] = A[0, 0], B[0, 0] * system.H[0], C[0, 0]
        rows.append(row)
    G, H = np.vstack([system.G, np.zeros((len(boxes), 2))]), np.hstack([system.H, np.zeros((1, len(boxes)))])
    joint = ContinuousModel(F, G, system.Q, rows, P0=np.zeros((n, n)))
    P0 = shaping.stationary_covariance(joint)
    names = ["s", "n", *(f"ξ{i + 1}" for i in range(len(boxes)))]
    return ContinuousModel(F, G, system.Q, H, P0=P0, states=names, units=["V"] * n), np.array(rows)


def part_a(r, answer):
    """What the test says."""
    r.section("a", "What the test of the box says")
    r.says("The spectrum of the test input is the Fourier transform of its autocorrelation; what the box does with it is the ratio of the spectra:")
    r.math(r"\Psi_{nn}(\omega) = \int Ne^{-5|\tau|}e^{-j\omega\tau}d\tau = \frac{10N}{\omega^2+25}, \qquad |H(j\omega)|^2 = \frac{\Psi_{yy}}{\Psi_{nn}} = \frac{\omega^2+16}{4(\omega^2+4)}")
    given_, ask = spectra.exponentials([(1.0, 5.0)]), spectra.parse(TEST_INPUT)
    w = np.array([0.0, 1.0, 2.0, 4.0, 10.0, 100.0])
    r.check("spectrum of the test input", given_(w), ask(w), ("transform of the autocorrelation", "by hand"), EXACT)
    ratio = spectra.parse(f"({TEST_OUTPUT})/({TEST_INPUT})")
    num, den = spectra.factor(ratio)
    r.says("**Factorisation.** In s, with $\\omega^2 = -s^2$, $|H|^2$ becomes $H(s)H(-s)$ with zeros at ±4 and poles at ±2. Four functions have this product:")
    r.math(r"\frac{s\pm4}{2(s\pm2)}, \qquad \text{stable: } \frac{s+4}{2(s+2)} \text{ and } \frac{s-4}{2(s+2)}")
    r.says("A box that works is stable, so its pole is −2. Its zero is not identified: the two stable ones differ by the all-pass $(s-4)/(s+4)$, which no power spectrum shows (the cross-spectrum of input and output would), and each by its sign. The minimum-phase one is the only candidate for an optimal filter, which passes slow signals without reversing them:")
    r.math(r"H(s) = \frac{s+4}{2(s+2)}")
    r.value("black_box_transfer_function", [num, den], agrees=answer, routes=("spectral factorisation", "by hand"))
    printed, found = spectra.parse(TEST_OUTPUT), ask.through(num, den)
    r.check("output of the box in the test", found(w), printed(w), ("|H|² times the input's spectrum", "printed spectrum"))
    mirrored = ask.through([0.5, -2.0], [1, 2])
    r.check("the zero at +4 gives the same output", mirrored(w), printed(w), ("|H|² times the input's spectrum", "printed spectrum"))
    direct = float(num[0]) if len(num) == len(den) else 0.0
    r.value("verdict_a", direct == 0)
    r.says("**Competence.** Nothing in the test speaks against the engineer: the box is stable, causal and time-invariant. But it is not what one expects under the name: $H(\\infty) = {direct}$, so half of the fastest noise appears in the output. A Kalman filter for measurements with white noise is strictly proper, $H(s) = C(sI - F + KH)^{-1}K \\to 0$: with a direct term it would let infinite power through. The box may be a Kalman filter only if the measurement has no white noise at all. (Criterion of `verdict_a`, whether it can be one for measurements with white noise: $H(\\infty) = 0$.)", direct=direct)
    figure = plots.bode({"zero at −4": (num, den), "zero at +4": ([0.5, -2.0], [1, 2])}, np.geomspace(0.05, 200, 300))
    r.figure("candidates", figure, "The two stable candidates: equal magnitude, different phase. The test measures the magnitude only.")
    return {"box": (num, den)}


def part_b(r, p, answer, system, small, box):
    """The optimum by two routes, and the comparison."""
    r.section("b", "The optimal filter, its test, and a criticism of the box")
    r.math(r"S_s = \frac{\sigma}{\omega^2+a^2}, \quad S_n = \frac{\nu}{\omega^2+b^2}, \qquad S_s + S_n = q\,\frac{\omega^2+c^2}{(\omega^2+a^2)(\omega^2+b^2)}, \quad q = \sigma + \nu, \quad c^2 = \frac{\sigma b^2+\nu a^2}{q}")
    r.says("with $a = {a}$, $b = {b}$, $\\sigma = {power}$, $\\nu = {noise}$. **Route 1, Wiener.** With the factor $\\Psi = \\sqrt{q}\\,(s+c)/((s+a)(s+b))$",
           a=p.signal_pole, b=p.noise_pole, power=p.signal_power, noise=p.noise_power)
    r.math(r"\frac{S_s}{\Psi(-s)} = \frac{\sigma\,(b-s)}{\sqrt q\,(s+a)(c-s)}, \qquad \left[\cdot\right]_+ = \frac{\sigma(a+b)}{\sqrt q\,(a+c)}\,\frac1{s+a} \quad (\text{the residue at } -a)")
    r.math(r"H_{opt} = \frac1\Psi\left[\frac{S_s}{\Psi(-s)}\right]_+ = g\,\frac{s+b}{s+c}, \qquad g = \frac{\sigma}{q}\,\frac{a+b}{a+c}")
    r.says("**Route 2, state space.** Both processes are first-order states, $\\dot{s} = -as + w_1$, $\\dot{n} = -bn + w_2$, and $z = s + n$ is a perfect measurement. Its derivative gives one with white noise, correlated with $w_1$:")
    r.math(r"\dot z + bz = (b-a)\,s + (w_1+w_2), \qquad \dot{\hat s} = -a\hat s + k\,[\dot z + bz - (b-a)\hat s], \qquad k = \frac{(b-a)P+\sigma}{q}, \qquad \dot P = -2aP + \sigma - k^2q")
    r.says("The steady $k$ is $g$ of route 1, the pole is $a + (b-a)g = c$, and $\\hat{s} = \\xi + gz$ needs no derivative: $\\dot{\\xi} = -c\\,\\xi + g(b-c)z$. ∎")
    r.model(small.model)
    found = spectra.wiener(spectra.Spectrum([p.signal_power], [1, p.signal_pole**2]), spectra.Spectrum([p.noise_power], [1, p.noise_pole**2]))
    num, den = reduced.transfer_function(small)
    r.value("optimal_transfer_function", [num, den], agrees=answer, routes=("state space", "by hand"))
    w = 1j * np.array([0.1, 1.0, 3.0, 10.0, 100.0])
    wiener_, space = (np.polyval(x, w) / np.polyval(y, w) for x, y in ((found.num, found.den), (num, den)))
    for name, pick in (("real part", np.real), ("imaginary part", np.imag)):
        r.check(text("Wiener and Kalman filter, {name}", name=name), pick(wiener_), pick(space), ("spectral factorisation", "state space"), scale=1.0)
    P = float(reduced.steady(small).P[0, 0])
    r.value("optimal_variance", P, "V²")
    scale = max(P, float(system.P0.max()) * 1e-3)  # a much smaller error is the difference of larger numbers
    r.check("optimal variance", P, answer["optimal_variance"], ("Riccati equation", "by hand"), scale=scale)
    r.check("mean square error of the Wiener filter", found.mse, P, ("integral over the spectra", "Riccati equation"), scale=scale)
    comparison(r, p, answer, system, box, (num, den))


def comparison(r, p, answer, system, box, best):
    """The box, the optimum and a constant gain: in the problem, and in the test."""
    signal, noise = spectra.Spectrum([p.signal_power], [1, p.signal_pole**2]), spectra.Spectrum([p.noise_power], [1, p.noise_pole**2])
    r.says("**Mean square errors.** For any stable filter $\\overline{e^2} = \\frac{1}{2\\pi}\\int(|1-H|^2S_s + |H|^2S_n)\\,d\\omega$. With $1 - H = s/(2(s+2))$ the box has")
    r.math(r"\overline{e^2} = \frac{\sigma}{8(a+2)} + \frac{\nu\,(b+8)}{8b(b+2)}, \qquad \text{constant gain } \frac{\sigma_s^2}{\sigma_s^2+\sigma_n^2}: \; \overline{e^2} = \frac{\sigma_s^2\sigma_n^2}{\sigma_s^2+\sigma_n^2}, \quad \sigma_s^2 = \frac{\sigma}{2a}, \; \sigma_n^2 = \frac{\nu}{2b}")
    routes = ("Lyapunov equation", "by hand")
    r.value("black_box_variance", spectra.mean_square_error(*box, signal, noise), "V²", agrees=answer, routes=routes)
    gain = system.P0[0, 0] / np.trace(system.P0)
    r.value("constant_gain_variance", spectra.mean_square_error([gain], [1.0], signal, noise), "V²", agrees=answer, routes=routes)
    joint, rows = with_boxes(system, [box, best])
    scale = float(joint.P0[0, 0] + joint.P0[1, 1])
    mean_squares = np.einsum("ij,jk,ik->i", rows, joint.P0, rows)
    for name, value, (top, bottom) in (("box", mean_squares[0], box), ("optimum", mean_squares[1], best)):
        r.check(text("mean square error, {name}", name=name), value, by_hand.quadrature(p, top, bottom), ("state space of python-control and Lyapunov equation", "quadrature over the frequency"), scale=scale)
    optimal, boxed, constant = answer["optimal_variance"], answer["black_box_variance"], answer["constant_gain_variance"]
    half = spectra.mean_square_error([0.5], [1.0], signal, noise)
    r.table("errors", ["filter", "transfer function", "mean square error, V²", "over the optimum, %"], [
        [name, form, value, 100 * (value / optimal - 1) if optimal else None]
        for name, form, value in (
            ("optimal", text("({g} s + {gb})/(s + {c})", g=best[0][0], gb=best[0][1], c=best[1][1]), optimal),
            ("box", "(0.5 s + 2)/(s + 2)", boxed), ("best constant gain", text("{g}", g=float(gain)), constant), ("constant gain ½", "0.5", half),
        )
    ], "The box against the optimum and against no dynamics at all.")
    r.holds("the optimum is the least", min(boxed, constant, half) - optimal, ("by hand", "optimality"), size=scale)
    worse = bool(boxed > constant)
    r.value("verdict_b", worse)
    r.says("Criterion of `verdict_b`: whether the box is worse than the best constant gain. It {is_}: {box} against {constant} V².", is_="is" if worse else "is not", box=boxed, constant=constant)
    criticism(r, p, optimal, boxed)
    diagram(r)
    tests(r, p, answer, box, best)


def criticism(r, p, optimal, boxed):
    """Where the designer went wrong."""
    g, c = by_hand.optimum(p)
    matches = math.isclose(p.signal_pole, 2) and math.isclose(p.noise_pole, 4) and math.isclose(g, 0.5)
    r.says("**Where the box goes wrong.** Write the filter of route 2 as prediction plus gain times innovation. Without the last term of the innovation, $-(b-a)\\hat{s}$, that is with the gain on $\\dot{z} + bz$ alone, it becomes $g(s+b)/(s+a)$: the pole stays that of the signal.")
    if matches:
        r.says("That is exactly the box: its gain {gain} and its zero at −{b} are the optimal ones, its pole is the signal's −{a} instead of −{c}. The engineer solved the Riccati equation rightly and forgot the feedback: his estimate is driven by the measurement, not by the innovation, and slow components of z pass with the gain {slow} where the optimum has {right}. The price is {percent} % more mean square error.",
               gain=g, b=p.noise_pole, a=p.signal_pole, c=c, slow=1.0, right=g * p.noise_pole / c, percent=100 * (boxed / optimal - 1))
    else:
        r.says("For the printed spectra that is exactly the box. For the present parameters that mistake would give $({g}s + {gb})/(s + {a})$, which is not the box; the optimum is $({g}s + {gb})/(s + {c})$. The box remains the filter of another problem.", g=g, gb=g * p.noise_pole, a=p.signal_pole, c=c)
    wrong = spectra.mean_square_error([g, g * p.noise_pole], [1.0, p.signal_pole], spectra.Spectrum([p.signal_power], [1, p.signal_pole**2]), spectra.Spectrum([p.noise_power], [1, p.noise_pole**2]))
    r.check("mean square error without the feedback", wrong, by_hand.quadrature(p, [g, g * p.noise_pole], [1.0, p.signal_pole]), ("Lyapunov equation", "quadrature over the frequency"), scale=max(wrong, 1e-300))


def diagram(r):
    """The filter with its feedback."""
    nodes = {
        "z": Node((0, 1), "$z$", "signal"), "B": Node((1.2, 1), "$s+b$"), "+": Node((2.5, 1), "", "sum"), "K": Node((3.7, 1), "$g$"), "*": Node((4.9, 1), "", "sum"), "I": Node((6.0, 1), r"$\dfrac{1}{s}$"),
        "o": Node((7.0, 1), "", "branch"), "s": Node((7.8, 1), r"$\hat{s}$", "signal"), "a": Node((6.0, 0), "$a$"), "f": Node((3.7, -0.9), "$b-a$"), "o2": Node((7.0, 0), "", "branch"),
    }
    arrows = [Arrow("z", "B"), Arrow("B", "+", "", "+"), Arrow("+", "K"), Arrow("K", "*", "", "+"), Arrow("*", "I"), Arrow("I", "o"), Arrow("o", "s"), Arrow("o", "o2"), Arrow("o2", "a"),
              Arrow("a", "*", "", "−"), Arrow("o2", "f", turn="along"), Arrow("f", "+", "", "−")]
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The optimal filter as derived. The loop through b − a feeds the innovation back; for the printed spectra the box is the same without this loop.")


def tests(r, p, answer, box, best):
    """Both in the engineer's test."""
    test = spectra.Spectrum([2 * p.test_pole], [1, p.test_pole**2])
    outputs = {"box": test.through(*box), "optimum": test.through(*best)}
    routes = ("Lyapunov equation", "by hand")
    powers = [S.power for S in outputs.values()]
    r.says("**The test.** With the input $2pN/(\\omega^2+p^2)$, $p = {p}$, of power N, the outputs have the power", p=p.test_pole)
    r.math(r"\frac{\overline{y^2}}{N} = g^2\left[1 + \frac{b^2-c^2}{c\,(c+p)}\right] \text{ (optimum)}, \qquad \frac14\left[1 + \frac{12}{2\,(2+p)}\right] \text{ (box)}")
    r.value("optimal_test_output_power", powers[1], agrees=answer, routes=routes)
    r.value("black_box_test_output_power", powers[0], agrees=answer, routes=routes)
    slow = best[0][1] / best[1][1]
    r.says("The box lets {box} of the test noise through, the optimum {optimum}: {compared}, at low frequency by the factor {ratio} in the density. At high frequency the densities have the ratio {fast}.",
           box=powers[0], optimum=powers[1], compared="the box more" if powers[0] > powers[1] * (1 + 1e-9) else "the box no more",
           ratio=1 / slow**2 if slow else math.inf, fast=(box[0][0] / best[0][0]) ** 2 if best[0][0] else math.inf)
    w = np.geomspace(0.05, 200, 300)
    curves = {"test input": test(w), **{text("output of the {name}", name=name): S(w) for name, S in outputs.items() if S.num.any()}}
    figure = plots.lines(w, curves, xlabel=FREQUENCY, ylabel="density for N = 1, V²·s", log="xy")
    r.figure("tests", figure, "The test of both filters: spectra of input and outputs.")
    if best[0][0]:
        figure = plots.bode({"box": box, "optimum": best}, w)
        r.figure("bode", figure, "Box and optimum: they agree for fast changes if their gains do, and differ for slow ones.")


def part_c(r, p, answer, discrete):
    """The discrete problem."""
    r.section("c", "The equivalent discrete problem and its reduced filter")
    r.math(r"x(t_{i+1}) = \begin{bmatrix} \alpha & 0 \\ 0 & \beta \end{bmatrix}x(t_i) + w_d(t_i), \quad z = \begin{bmatrix} 1 & 1 \end{bmatrix}x, \qquad \alpha = e^{-a\Delta t}, \; \beta = e^{-b\Delta t}, \quad q_1 = \sigma_s^2(1-\alpha^2), \; q_2 = \sigma_n^2(1-\beta^2)")
    r.model(discrete)
    _a, _b, _apart, q1, q2 = by_hand.sampled(p)
    r.check("Q_d", discrete.Qd, np.diag([q1, q2]), ("doubling of the short interval", "by hand"))
    r.says("Both processes are stationary from the beginning, and $z(t_0)$ is processed. After an update $\\hat{s} + \\hat{n} = z$, so $P^+ = p_i[[1, -1], [-1, 1]]$; in the basis $(z, s)$ it is diag(0, p), and the filter shrinks to one state:")
    r.math(r"\hat s_i = \alpha\hat s_{i-1} + K_i\,[z_i - \beta z_{i-1} - (\alpha-\beta)\,\hat s_{i-1}], \qquad \hat n_i = z_i - \hat s_i, \qquad \hat s_0 = \frac{\sigma_s^2}{\sigma_s^2+\sigma_n^2}z_0")
    r.math(r"K_i = \frac{\alpha(\alpha-\beta)\,p_{i-1} + q_1}{(\alpha-\beta)^2p_{i-1} + q_1 + q_2}, \qquad p_i = \frac{(\alpha^2q_2 + \beta^2q_1)\,p_{i-1} + q_1q_2}{(\alpha-\beta)^2p_{i-1} + q_1 + q_2}, \qquad p_0 = \frac{\sigma_s^2\sigma_n^2}{\sigma_s^2+\sigma_n^2}")
    shown, small = covariances(discrete, p.steps, first=0), reduced.discrete(discrete, keep=["s"], first=0)
    r.value("posterior_variance", shown.P_plus[:, 0, 0], "V²", at=shown.t, agrees=answer, routes=("recursion of matrices", "power of the fraction's matrix"))
    same_as_whole(r, small, discrete, p.steps, answer["posterior_variance"])
    r.says("**Steady state**: $p_\\infty$ is the positive root of $(\\alpha-\\beta)^2p^2 + [q_1(1-\\beta^2) + q_2(1-\\alpha^2)]p - q_1q_2 = 0$; the pole is $\\alpha - (\\alpha-\\beta)K$.")
    limit, routes = steady.solve(discrete), ("Riccati equation", "root of the quadratic")
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "V²", agrees=answer, routes=routes)
    r.value("gain_steady", limit.K[0, 0], agrees=answer, routes=routes)
    r.value("filter_pole", float(reduced.steady(small).poles[0].real), agrees=answer, routes=("reduced model", "by hand"))
    num, den = reduced.transfer_function(small)
    _a, b, *_rest = by_hand.sampled(p)
    g, pole = answer["gain_steady"], answer["filter_pole"]
    r.value("filter_z_transfer_function", [num, den])
    r.check("z-transfer function", [num, den], [[g, -g * b], [1.0, -pole]], ("reduced model", "by hand"))
    r.says("Here $p_\\infty = {limit}$ V², $K = {gain}$ and the pole is {pole}, which a continuous filter with the pole {s} 1/s would have over one period.",
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
    r.says("The discrete filter is simulated. The box and the continuous optimum run on the same paths of s and n: they are joined to the model as states and the whole is sampled exactly, so that nothing of them is approximated. Filters that are wrong in another way are followed by sensitivity analysis.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period, s", p.dt, "given"],
        ["measurements after t0", steps, "twice the settling time, 10 at least and 60 at most, and the length of the list; fewer where the error sinks into the rounding of s and n"],
        ["initial state", "stationary", "the sheet gives spectra; box and optimum have been running for long"],
        ["periods of the sweep", "dt/4, dt/2, dt, 2 dt, 4 dt", "from much shorter to longer than the time constants"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
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
    t = np.linspace(0.0, shown.t[-1], 201)
    curve = reduced.transient(small, t)[:, 0, 0]
    figure = plots.sampled({text("dt = {dt} s", dt=p.dt): shown}, t, curve, xlabel=TIME, ylabel="variance of s, V²", limit=optimal)
    r.figure("variances", figure, "Error variance of the signal: the discrete filter over the continuous one, and the limit of part (b).")
    curves = {"discrete, after each measurement": variance, "continuous, at the same times": reduced.transient(small, shown.t)[:, 0, 0]}
    figure = plots.lines(shown.t, curves, xlabel=TIME, ylabel="variance of s, V²", marker=".", straight={"limit of part (b)": ([0, shown.t[-1]], [optimal, optimal])})
    r.figure("falling", figure, "The same without the predictions: both fall from the error of the best constant gain to their limits.")
    r.holds("p(i) ≥ P(t_i)", variance - reduced.transient(small, shown.t)[:, 0, 0], ("recursion of matrices", "Riccati equation, integrated"), size=100 * scale)
    sweep(r, p, optimal)
    agrees = bool(abs(answer["posterior_variance_steady"] - optimal) <= 0.05 * optimal)
    r.value("verdict_d", agrees)
    r.says("Criterion of `verdict_d`, whether the experiment agrees with part (b): the steady variance at the given period is within 5 % of the continuous one. It is {above} % above: {yes}.",
           above=100 * (answer["posterior_variance_steady"] / optimal - 1) if optimal else 0.0, yes="it agrees" if agrees else "it does not, since the period is too long")
    limit = steady.solve(discrete)
    portrait(r, experiment, discrete, steps, xlabel=TIME, first=0, limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]))
    same_estimates(r, experiment, reduced.discrete(discrete, keep=["s"], first=0), discrete, steps)
    boxes(r, p, experiment, answer, system, box, steps)
    white(r, p, experiment, answer, discrete, steps)


def sweep(r, p, optimal):
    """Over the period."""
    rows = []
    for factor in (0.25, 0.5, 1.0, 2.0, 4.0):
        q = p.model_copy(update={"dt": factor * p.dt})
        found = steady.solve(discretise(model(q), q.dt, R=[[0]]))
        r.check(text("p∞, dt = {dt} s", dt=q.dt), found.P_plus[0, 0], by_hand.discrete_limit(q), ("Riccati equation", "root of the quadratic"), scale=max(optimal, 1e-300))
        rows.append((q.dt, found.P_plus[0, 0], 100 * (found.P_plus[0, 0] / optimal - 1) if optimal else None, found.K[0, 0]))
    r.table("periods", ["period, s", "p∞, V²", "above the continuous optimum, %", "K"], rows, "The steady variance over the period: the longer it is, the nearer to the best constant gain.")
    if p.signal_pole == p.noise_pole or not optimal:
        r.says("Here the period makes no difference: the filter is static or the error zero.")
        return
    shortest = 0.1 / max(p.signal_pole, p.noise_pole)
    periods = [shortest / 2**i for i in range(3)]
    errors = [float(steady.solve(discretise(model(p), dt, R=[[0]])).P_plus[0, 0]) - optimal for dt in periods]
    if min(errors) > 1e-9 * optimal:
        r.order("p∞ → P as dt → 0", errors, 2.0, ("discrete Riccati equation", "continuous, by hand"))


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
        table.append((name, expected, float((error**2).mean())))
    table.append(("discrete optimum, last measurement", by_hand.variances(p, steps)[-1], float((own[-1] ** 2).mean())))
    r.table("ensembles", ["filter", "theory, V²", "ensemble, V²"], table, "Mean square errors on the same paths; those of box and continuous optimum are averaged over time as well.")
    figure = plots.lines(some.t, {"box": (errors[0] ** 2).mean(axis=1), "continuous optimum": (errors[1] ** 2).mean(axis=1), "discrete optimum": (own**2).mean(axis=1)}, xlabel=TIME, ylabel="mean square error, V²", marker=".",
                         straight={name: ([0, some.t[-1]], [value, value]) for name, value in (("theory: box", theory["box"]), ("theory: optimum", answer["optimal_variance"]))})
    r.figure("boxes", figure, "Mean square errors of the ensemble on the same paths.")
    s, n = some.truth[:, 0, 0], some.truth[:, 1, 0]
    figure = plots.lines(some.t, {"signal": s, "measurement": s + n, "box": s + errors[0, :, 0], "continuous optimum": s + errors[1, :, 0]}, xlabel=TIME, ylabel="s, V")
    r.figure("paths", figure, "One path with the estimates of both filters.")


def white(r, p, experiment, answer, discrete, steps):
    """The filter that takes the noise for white."""
    noise, best = p.noise_power / (2 * p.noise_pole), answer["posterior_variance_steady"]
    if not (p.signal_power and noise):
        return
    a, _b, _apart, q1, _q2 = by_hand.sampled(p)
    design = DiscreteModel([[a]], [[q1]], [[1]], [[noise]], x0=[0], P0=discrete.P0[:1, :1], dt=p.dt, states=["s"], units=["V"])
    found = taken_for_white(r, experiment, discrete, design, steps, best=best, size=noise,
                            by_hand=lambda K: by_hand.white_variance(p, K))
    r.says("**A filter that takes the noise for white** of the same variance claims {claimed} V² and has {true} V², the optimum {best} V²: the samples are too close for their noises to be independent.",
           claimed=found.claimed, true=found.true, best=best)


def conclusions(r, p, answer):
    """What the numbers say."""
    g, c = by_hand.optimum(p)
    optimal, boxed, constant = answer["optimal_variance"], answer["black_box_variance"], answer["constant_gain_variance"]
    lines = ["The test shows a stable causal filter (s + 4)/(2(s + 2)), up to an all-pass; its direct term excludes a Kalman filter for measurements with white noise."]
    if optimal:
        lines.append(text("The optimal filter is ({g} s + {gb})/(s + {c}) with the mean square error {optimal} V²; the box has {boxed} V², {percent} % more, {than} the best constant gain ({constant} V²).",
                          g=g, gb=g * p.noise_pole, c=c, optimal=optimal, boxed=boxed, percent=100 * (boxed / optimal - 1), than="worse than" if boxed > constant else "better than", constant=constant))
    else:
        lines.append(text("One of the two processes is absent: the optimal filter has no error; the box has {boxed} V².", boxed=boxed))
    if math.isclose(p.signal_pole, 2) and math.isclose(p.noise_pole, 4) and math.isclose(g, 0.5):
        lines.append("The engineer's gain is right, but his filter does not feed the innovation back: it keeps the pole of the signal.")
    elif p.signal_pole == p.noise_pole:
        lines.append("Signal and noise have spectra of one shape: no dynamics help, and the optimum is a constant gain.")
    start, end = answer["posterior_variance"][0], answer["posterior_variance_steady"]
    if start > end * (1 + 1e-9):
        lines.append(text("Sampled every {dt} s the error variance falls monotonically from {start} to {end} V².", dt=p.dt, start=start, end=end))
    else:
        lines.append(text("Sampled every {dt} s the error variance is {end} V² from the first measurement on.", dt=p.dt, end=end))
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_a, part_b, part_c),
    plan=plan,
    experiment=(part_d,),
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
