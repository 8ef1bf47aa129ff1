"""The lab coloured_plant, part (observer): the observer of the augmented model in blocks."""

import numpy as np
from ctlabs.tasks.answers.coloured_plant import TIMES

from ctlabs.filtering import bucy
from ctlabs.models import observability, symbolic
from ctlabs.reporting import plots
from ctlabs.reporting.plots import Arrow, Node
from ctlabs.reporting.report import EXACT
from ctlabs.text import text


def part_observer(r, systems):
    """Block equations."""
    r.section("observer", "The observer in blocks")
    r.says("The Kalman–Bucy observer of the augmented model is that of {ref:kalman_bucy} with the matrices of {eq:augmented}. Its covariance is divided like the state,")
    r.math(r"P = \begin{bmatrix} P_1 & P_{12} \\ P_{12}^T & P_2 \end{bmatrix}.", "blocks")
    r.says("For uncorrelated noises block multiplication, by computer algebra, gives")
    for line in symbolic.block_equations().latex():
        r.math(line)
    r.says("The first three lines are the filter of the plant with the estimate $G\\hat{w}$ as a known input: the observer predicts the noise. If $v_0$ and v correlate, $E[v_0v^T] = N_0\\delta$, the cross term enters $K_2$ and with it the equations:")
    correlated = symbolic.block_equations(correlated=True)
    for line in correlated.latex()[3:]:
        r.math(line)
    nodes = {
        "y": Node((-0.4, 2), "$y$", "signal"), "e": Node((0.8, 2), "", "sum"), "k": Node((1.6, 2), "", "branch"), "K1": Node((2.6, 2), "$K_1$"), "s1": Node((4.0, 2), "", "sum"), "I1": Node((5.2, 2), r"$\dfrac{1}{s}$"),
        "x": Node((6.3, 2), "", "branch"), "xh": Node((7.4, 2), r"$\hat{x}$", "signal"), "A": Node((5.2, 1.1), "$A$"), "x2": Node((6.3, 1.1), "", "branch"), "C": Node((2.6, 4.0), "$C$"), "u": Node((5.4, 3.0), "$u$", "signal"), "B": Node((4.0, 3.0), "$B$"),
        "K2": Node((2.6, -0.9), "$K_2$"), "s2": Node((4.0, -0.9), "", "sum"), "I2": Node((5.2, -0.9), r"$\dfrac{1}{s}$"), "w": Node((6.3, -0.9), "", "branch"), "wh": Node((7.4, -0.9), r"$\hat{w}$", "signal"), "Aw": Node((5.2, -1.8), "$A_w$"),
        "w2": Node((6.3, 0.1), "", "branch"), "G": Node((5.2, 0.1), "$G$"), "w3": Node((6.3, -1.8), "", "branch"),
    }
    arrows = [Arrow("y", "e", "", "+"), Arrow("e", "k"), Arrow("k", "K1"), Arrow("K1", "s1"), Arrow("s1", "I1"), Arrow("I1", "x"), Arrow("x", "xh"), Arrow("x", "x2"), Arrow("x2", "A"), Arrow("A", "s1"),
              Arrow("x", "C", turn="along"), Arrow("C", "e", "", "−"), Arrow("u", "B"), Arrow("B", "s1"), Arrow("k", "K2", turn="along"), Arrow("K2", "s2"), Arrow("s2", "I2"), Arrow("I2", "w"), Arrow("w", "wh"),
              Arrow("w", "w2"), Arrow("w2", "G"), Arrow("G", "s1"), Arrow("w", "w3"), Arrow("w3", "Aw"), Arrow("Aw", "s2")]
    r.says("{fig:observer} draws it. Above is the model of the plant, below that of the shaping filter; one innovation corrects both, and the estimated noise drives the plant's model.")
    r.figure("observer", plots.block_diagram(nodes, arrows), "The observer with the model of the shaping filter in it (figure 10.8 of the source).")
    r.says("**Block equations and the augmented Riccati equation** are one, and were compared on the covariances of three models on their way to the steady state: the example, one with correlated noises, and one with a shaping filter of second order.")
    for name, title in (("example", "example"), ("correlated", "correlated noises"), ("second", "second-order filter")):
        system = systems[name]
        transient = bucy.transient(system, TIMES)
        for t, P, K in zip(TIMES, transient.P, transient.K, strict=True):
            found = blocks(system, P)
            expected = system.F @ P + P @ system.F.T + system.G @ system.Q @ system.G.T - K @ (system.Rc @ K.T)
            scale = float(np.abs(system.F @ P).max() + np.abs(system.G @ system.Q @ system.G.T).max()) or 1.0
            if t in (TIMES[0], TIMES[-1]):
                assembled = np.block([[found["P1"], found["P12"]], [found["P12"].T, found["P2"]]])
                r.check(text("dP/dt, {model}, t = {t} s", model=title, t=t), assembled, expected, ("block equations", "augmented Riccati equation"), EXACT, scale=scale)
                r.check(text("gain, {model}, t = {t} s", model=title, t=t), np.vstack([found["K1"], found["K2"]]), K, ("block equations", "Kalman–Bucy filter of the augmented model"), EXACT, scale=float(np.abs(K).max()) or 1.0)
    seen = observability.analyse(systems["example"])
    r.value("verdict_observer", bool(seen.detectable))
    r.says("**A steady state** exists if every mode that does not decay is seen in y. ", "It does, since x is measured and the shaping filter is stable." if seen.detectable else "It does not.", " The model is observable, although w is seen through its effect on x only." if seen.ok else " The model is not observable: w is seen through its effect on x only, and here it has none.")


def blocks(system, P):
    """The right-hand sides of the block equations at a covariance P of an augmented model with one plant state."""
    found = {"A": system.F[:1, :1], "G": system.F[:1, 1:], "A_w": system.F[1:, 1:], "C": system.H[:, :1], "Q_0": (system.G @ system.Q @ system.G.T)[1:, 1:],
             "R": system.Rc, "P_1": P[:1, :1], "P_12": P[:1, 1:], "P_2": P[1:, 1:]}
    if system.N is not None:
        found["N_0"] = (system.G @ system.N)[1:]
    return symbolic.block_equations(correlated=system.N is not None).evaluate(**found)
