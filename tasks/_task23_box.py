"""Lab 23, part (b): the optimum and the box, and their test."""

import math

import control
import numpy as np
from ctlabs.tasks.answers import task23 as by_hand

from ctlabs.filtering import reduced
from ctlabs.models import ContinuousModel, shaping, spectra
from ctlabs.reporting import plots
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.text import text

TIME, FREQUENCY = "t, s", "frequency ω, rad/s"


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


def part_b(r, p, answer, system, small, box):
    """The optimum by two routes, and the comparison."""
    r.section("b", "The optimal filter, its test, and a criticism of the box")
    r.says("Signal and noise have the spectra")
    r.math(r"S_s = \frac{\sigma}{\omega^2+a^2}, \quad S_n = \frac{\nu}{\omega^2+b^2}, \qquad S_s + S_n = q\,\frac{\omega^2+c^2}{(\omega^2+a^2)(\omega^2+b^2)}, \quad q = \sigma + \nu, \quad c^2 = \frac{\sigma b^2+\nu a^2}{q}", "spectra")
    r.says("with $a = {a}$, $b = {b}$, $\\sigma = {power}$, $\\nu = {noise}$. **Route 1, Wiener** ({ref:wiener}; {ref:maybeck, section 5.12}). The sum has the stable factor $\\Psi = \\sqrt{q}\\,(s+c)/[(s+a)(s+b)]$, whose inverse is causal as well: $z/\\Psi$ is white, and nothing is lost in passing to it. From this white process $S_s/\\Psi(-s)$ would be the best filter, had it the future too; a causal one can use only the part $[\\cdot]_+$ with its poles in the left half-plane,",
           a=p.signal_pole, b=p.noise_pole, power=p.signal_power, noise=p.noise_power)
    r.math(r"\frac{S_s}{\Psi(-s)} = \frac{\sigma\,(b-s)}{\sqrt q\,(s+a)(c-s)}, \qquad \left[\cdot\right]_+ = \frac{\sigma(a+b)}{\sqrt q\,(a+c)}\,\frac1{s+a} \quad (\text{the residue at } -a)")
    r.math(r"H_{opt} = \frac1\Psi\left[\frac{S_s}{\Psi(-s)}\right]_+ = g\,\frac{s+b}{s+c}, \qquad g = \frac{\sigma}{q}\,\frac{a+b}{a+c}", "optimum")
    r.says("**Route 2, state space.** Both processes are first-order states, $\\dot{s} = -as + w_1$, $\\dot{n} = -bn + w_2$, and $z = s + n$ is a perfect measurement. Its derivative gives one with white noise, correlated with $w_1$ (as in lab 22; {ref:bryson_johansen}):")
    r.math(r"\dot z + bz = (b-a)\,s + (w_1+w_2), \qquad \dot{\hat s} = -a\hat s + k\,[\dot z + bz - (b-a)\hat s], \qquad k = \frac{(b-a)P+\sigma}{q}, \qquad \dot P = -2aP + \sigma - k^2q", "state")
    r.says("The steady $k$ is $g$ of route 1, the pole is $a + (b-a)g = c$, and $\\hat{s} = \\xi + gz$ needs no derivative: $\\dot{\\xi} = -c\\,\\xi + g(b-c)z$. ∎")
    found = spectra.wiener(spectra.Spectrum([p.signal_power], [1, p.signal_pole**2]), spectra.Spectrum([p.noise_power], [1, p.noise_pole**2]))
    num, den = reduced.transfer_function(small)
    r.value("optimal_transfer_function", [num, den], agrees=answer, routes=("state space", "by hand"))
    w = 1j * np.array([0.1, 1.0, 3.0, 10.0, 100.0])
    wiener_, space = (np.polyval(x, w) / np.polyval(y, w) for x, y in ((found.num, found.den), (num, den)))
    for name, pick in (("real part", np.real), ("imaginary part", np.imag)):
        r.check(text("Wiener and Kalman filter, {name}", name=name), pick(wiener_), pick(space), ("spectral factorisation", "state space"), scale=1.0)
    P = float(reduced.steady(small).P[0, 0])
    r.value("optimal_variance", P, "V²", symbol=r"\overline{e^2}\;\text{of the optimum}")
    scale = max(P, float(system.P0.max()) * 1e-3)  # a much smaller error is the difference of larger numbers
    r.check("optimal variance", P, answer["optimal_variance"], ("Riccati equation", "by hand"), scale=scale)
    r.check("mean square error of the Wiener filter", found.mse, P, ("integral over the spectra", "Riccati equation"), scale=scale)
    comparison(r, p, answer, system, box, (num, den))


def comparison(r, p, answer, system, box, best):
    """The box, the optimum and a constant gain: in the problem, and in the test."""
    signal, noise = spectra.Spectrum([p.signal_power], [1, p.signal_pole**2]), spectra.Spectrum([p.noise_power], [1, p.noise_pole**2])
    r.says("**Mean square errors.** For any stable filter $\\overline{e^2} = \\frac{1}{2\\pi}\\int(|1-H|^2S_s + |H|^2S_n)\\,d\\omega$. With $1 - H = s/[2(s+2)]$ the box and the best constant gain have")
    r.math(r"\overline{e^2} = \frac{\sigma}{8(a+2)} + \frac{\nu\,(b+8)}{8b(b+2)}, \qquad \text{constant gain } \frac{\sigma_s^2}{\sigma_s^2+\sigma_n^2}: \; \overline{e^2} = \frac{\sigma_s^2\sigma_n^2}{\sigma_s^2+\sigma_n^2}, \quad \sigma_s^2 = \frac{\sigma}{2a}, \; \sigma_n^2 = \frac{\nu}{2b}", "errors")
    routes = ("Lyapunov equation", "by hand")
    r.value("black_box_variance", spectra.mean_square_error(*box, signal, noise), "V²", symbol=r"\text{of the box}", agrees=answer, routes=routes)
    gain = system.P0[0, 0] / np.trace(system.P0)
    r.value("constant_gain_variance", spectra.mean_square_error([gain], [1.0], signal, noise), "V²", symbol=r"\text{of the best constant gain}", agrees=answer, routes=routes)
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
    ], "Mean square errors of the box, of the optimum, and of filters without dynamics.")
    r.holds("the optimum is the least", min(boxed, constant, half) - optimal, ("by hand", "optimality"), size=scale)
    worse = bool(boxed > constant)
    r.value("verdict_b", worse)
    r.says("{tab:errors} compares them. ", "The box is worse even than the best constant gain, {box} against {constant} V²: its dynamics do harm." if worse else "The box is not worse than the best constant gain, {box} against {constant} V².", box=boxed, constant=constant)
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
    r.says("{fig:diagram} shows the optimal filter as it was derived. The loop through b − a feeds the innovation back; without this loop it is, for the printed spectra, the box.")
    r.figure("diagram", plots.block_diagram(nodes, arrows), "The optimal filter of {eq:state} with its steady gain, and the feedback of the innovation.")


def tests(r, p, answer, box, best):
    """Both in the engineer's test."""
    test = spectra.Spectrum([2 * p.test_pole], [1, p.test_pole**2])
    outputs = {"box": test.through(*box), "optimum": test.through(*best)}
    routes = ("Lyapunov equation", "by hand")
    powers = [S.power for S in outputs.values()]
    r.says("**The test.** With the input $2pN/(\\omega^2+p^2)$, $p = {p}$, of power N, the outputs have the power", p=p.test_pole)
    r.math(r"\frac{\overline{y^2}}{N} = g^2\left[1 + \frac{b^2-c^2}{c\,(c+p)}\right] \text{ (optimum)}, \qquad \frac14\left[1 + \frac{12}{2\,(2+p)}\right] \text{ (box)}.", "test")
    r.value("optimal_test_output_power", powers[1], symbol=r"\overline{y^2}/N\;\text{of the optimum}", agrees=answer, routes=routes)
    r.value("black_box_test_output_power", powers[0], symbol=r"\text{of the box}", agrees=answer, routes=routes)
    slow = best[0][1] / best[1][1]
    parts = ["The box lets {box} of the test noise through, the optimum {optimum}. In {fig:tests} this is seen frequency by frequency"]
    if slow and best[0][0]:
        same = math.isclose(box[0][0], best[0][0])
        parts.append(": for slow changes the density behind the box is {ratio:3} times that behind the optimum, for fast ones it is the same." if same
                     else ": for slow changes the density behind the box is {ratio:3} times that behind the optimum, for fast ones {fast:3} times.")
    else:
        parts.append(".")
    r.says(*parts, box=powers[0], optimum=powers[1], ratio=1 / slow**2 if slow else 0.0, fast=(box[0][0] / best[0][0]) ** 2 if best[0][0] else 0.0)
    w = np.geomspace(0.05, 200, 300)
    curves = {"test input": test(w), **{text("output of the {name}", name=name): S(w) for name, S in outputs.items() if S.num.any()}}
    figure = plots.lines(w, curves, xlabel=FREQUENCY, ylabel="density for N = 1, V²·s", log="xy")
    r.figure("tests", figure, "The test of both filters: spectral densities of the input and of the two outputs, for N = 1.")
