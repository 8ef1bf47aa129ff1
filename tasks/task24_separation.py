r"""Lab 24. Separation: what not knowing the state costs.

Source: Åström 1970, chapter 8. For x(k+1) = Φx(k) + bu(k) + w(k), z(k) = x(k) + v(k) and the cost
E(Q_x x² + Q_u u²) per step the sheet asks for the feedback of a known state, that of an estimate, the proof that the
two are designed apart, limits, a finite horizon, a wrong model, and an experiment.

Expected answer: b²S² + [Q_u(1 − Φ²) − Q_x b²]S − Q_x Q_u = 0, L = bΦS/(Q_u + b²S); the filter's variance P⁻ is the root of
the same equation with b = 1, Q_x → Q, Q_u → R; J = SQ + L²(Q_u + b²S)P with P = P⁺ for the current and P⁻ for the
delayed regulator. The loop bears true factors below 1 + KbL/[1 − (1 − K)(Φ − bL)].
"""

from dataclasses import replace

import numpy as np
from ctlabs.tasks._task24_experiment import part_g, plan
from ctlabs.tasks._task24_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task24 as by_hand

from ctlabs.filtering import steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import Cost, DiscreteModel
from ctlabs.regulation import lqr, regulator, tradeoff
from ctlabs.regulation.closed import closed
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task24",
    "title": "Separation: what not knowing the state costs",
    "source": "Åström 1970, chapter 8",
    "parts": ["a", "b", "c", "d", "e", "f", "g"],
    "extension": True,
}


class Parameters(LabParameters):
    """What may be changed."""

    Phi: Positive = given(1.1, unit="1", meaning="factor Φ of the plant", draw=one_of(*(k / 100 for k in (*range(80, 97, 2), *range(104, 122, 2)))))
    b: Positive = given(0.5, unit="1", meaning="what a unit of the input adds to the next state", symbol="b", draw=one_of(0.4, 0.5, 0.6, 0.8, 1.2))
    Q: Positive = given(1.0, unit="m²", meaning="variance of the process noise w", draw=span(0.5, 2, 0.1))
    R: Variance = given(2.0, unit="m²", meaning="variance of the measurement noise v", draw=span(0.5, 4, 0.25))
    Qx: Positive = given(1.0, unit="1", meaning="weight of the state", symbol="Q_x")
    Qu: Variance = given(0.25, unit="1", meaning="weight of the input", symbol="Q_u", draw=span(0.1, 0.8, 0.05))
    P0: Variance = given(4.0, unit="m²", meaning="variance of x0")
    L_star: Positive = given(1.0, unit="1", meaning="another gain of the regulator, part (c)", symbol="L_*", draw=one_of(0.5, 0.6, 0.7, 0.8, 0.9))
    steps: Count = given(10, unit="1", meaning="steps of the finite task, part (e)", symbol="N")
    Phi_true: Positive = given(1.2, unit="1", meaning="true factor of the plant, part (f)", symbol=r"\Phi_t", draw=one_of(0.9, 0.95, 1.05, 1.15, 1.22))


def model(p, Phi=None, R=None):
    """x(k+1) = Φx(k) + bu(k) + w(k), z(k) = x(k) + v(k)."""
    return DiscreteModel(Phi=[[p.Phi if Phi is None else Phi]], B=[[p.b]], Qd=[[p.Q]], H=[[1]], R=[[p.R if R is None else R]], x0=[0], P0=[[p.P0]],
                         dt=1, states=["x"], measurements=["z"], units=["m"])


def designs(p):
    """The current and the delayed regulator."""
    return {kind: regulator(model(p), Cost([[p.Qx]], [[p.Qu]]), kind=kind) for kind in ("current", "delayed")}


def part_a(r, p, answer, system):
    """The state known."""
    r.section("a", "The state is known")
    r.says("The plant and its cost are")
    r.math(r"x_{k+1} = \Phi x_k + bu_k + w_k, \qquad z_k = x_k + v_k, \qquad J = E(Q_xx_k^2 + Q_uu_k^2)", "plant")
    r.model(system)
    r.says("Let $Sx^2$ be what the rest of a task without noise costs from the state $x$ on. One step later it is $S(\\Phi x + bu)^2$, so $u$ has to make $Q_xx^2 + Q_uu^2 + S(\\Phi x + bu)^2$ as small as possible. Completing the square,")
    r.math(r"Q_xx^2 + Q_uu^2 + S(\Phi x + bu)^2 = Sx^2 + W(u + Lx)^2, \qquad W = Q_u + b^2S, \qquad L = \frac{b\Phi S}{W}", "square")
    r.says("which holds for all $x$ and $u$ if $S = \\Phi^2S + Q_x - L^2W$, that is, if $S$ is the positive root of")
    r.math(r"b^2S^2 + [Q_u(1 - \Phi^2) - Q_xb^2]\,S - Q_xQ_u = 0", "riccati")
    r.says("The best input is $u = -Lx$; the closed loop has the pole $\\Phi - bL = \\Phi Q_u/W$. It is not larger than Φ, and $\\Phi(\\Phi - bL) = 1 - Q_x/S < 1$ by {eq:riccati}, so that it is below 1 for every Φ. The noise is not known when the input acts: it adds $Sw_k^2$ to the cost of the rest, whatever $u_k$ is, and the mean cost per step is $J = SQ$ ({ref:kwakernaak_sivan, section 6.4}).")
    found, routes = lqr(system, Cost([[p.Qx]], [[p.Qu]])), ("Riccati equation", "closed form")
    r.value("cost_to_go", found.S[0, 0], symbol="S", agrees=answer, routes=routes)
    r.value("feedback_gain", found.L[0, 0], symbol="L", agrees=answer, routes=routes)
    r.value("regulator_pole", float(found.poles[0].real), symbol=r"\Phi - bL", agrees=answer, routes=("eigenvalue", "closed form"))
    r.value("cost_known", found.S[0, 0] * p.Q, "m²", symbol=r"J_\text{known}", agrees=answer, routes=routes)
    r.says("Here $S = {S}$, $L = {L}$, the pole is {pole}, and the cost is {J} m² per step.", S=found.S[0, 0], L=found.L[0, 0], pole=answer["regulator_pole"], J=answer["cost_known"])


def part_b(r, answer, system, both):
    """The state estimated."""
    r.section("b", "The state is estimated: the separation theorem")
    r.says("Sum {eq:square} over the steps of a long task, with $w$: the terms $Sx^2$ cancel in pairs, and for **any** input that depends on the past and keeps the mean square of the state bounded")
    r.math(r"J = SQ + W\,E(u_k + Lx_k)^2", "whole")
    r.says("Only the second term can be influenced. What is known of $x_k$ has the conditional mean $\\hat x_k$ and the error variance $P$, and the input moves the mean in a known way without changing the error. So $E(u_k + Lx_k)^2 = E(u_k + L\\hat x_k)^2 + L^2P$; the best input makes the first term zero ({ref:astrom, chapter 8}):")
    r.math(r"u_k = -L\hat x_k, \qquad J = SQ + L^2W\,P, \qquad P = \begin{cases}P^+ & \text{current}\\ P^- & \text{delayed}\end{cases}", "separation")
    r.says("The filter does not feel the input, which it knows. Its limit satisfies {eq:riccati} with $b = 1$, $Q$ for $Q_x$ and $R$ for $Q_u$, as filter and regulator are dual:")
    r.math(r"(P^-)^2 + [R(1 - \Phi^2) - Q]\,P^- - QR = 0, \qquad K = \frac{P^-}{P^- + R}, \qquad P^+ = (1 - K)P^-", "filter")
    limit, routes = steady.solve(system), ("Riccati equation", "closed form")
    r.value("prior_variance_steady", limit.P_minus[0, 0], "m²", symbol="P^-", agrees=answer, routes=routes)
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "m²", symbol="P^+", agrees=answer, routes=routes)
    r.value("gain_steady", limit.K[0, 0], symbol="K", agrees=answer, routes=routes)
    for kind, found in both.items():
        name = f"cost_{kind}"
        r.value(name, found.cost.value, "m²", symbol=rf"J_\text{{{kind}}}", agrees=answer, routes=("separation", "closed form"))
        for route in ("closed loop", "innovations"):
            r.check(name.replace("_", " "), found.cost.routes[route], answer[name], (route, "closed form"))
    steady_loop = both["current"].closed.steady()
    r.value("state_variance", steady_loop.x.P[0, 0], "m²", symbol=r"E x^2", agrees=answer, routes=("Lyapunov equation", "closed form"))
    r.value("input_variance", steady_loop.u.P[0, 0], "m²", symbol=r"E u^2", agrees=answer, routes=("Lyapunov equation", "closed form"))
    _budget(r, answer)


def _budget(r, answer):
    """What is paid for what."""
    known, current, delayed = (answer[f"cost_{name}"] for name in ("known", "current", "delayed"))
    r.table("budget", ["regulator", "disturbance SQ, m²", "not knowing the state, m²", "cost, m²", "share of not knowing, %"], [
        ["state known", known, 0, known, 0],
        ["current: $z_k$ is used at once", known, current - known, current, 100 * (1 - known / current)],
        ["delayed: $z_k$ is used a step later", known, delayed - known, delayed, 100 * (1 - known / delayed)],
    ], "What the cost per step is made of.")
    r.says("{tab:budget} has the two terms. No regulator avoids the first one; the second is the price of the sensor, and {late:3} m² of it are the price of answering a step late.", late=delayed - current)


def with_gain(found, L):
    """The loop of a scalar current regulator with another gain of the feedback."""
    plant, K = found.plant, found.K
    gain, move = np.array([[L]]), plant.Phi - plant.B * L
    return closed(plant, replace(found.machine, A=move @ (1 - K), B=move @ K, C=-gain @ (1 - K), D=-gain @ K))


def part_c(r, p, answer, system, both):
    """Each half for itself."""
    r.section("c", "Each half is designed for itself")
    r.says("**The feedback.** With a constant gain $L_*$ on the optimal estimate, $\\hat x_{k+1} = (\\Phi - bL_*)\\hat x_k + K\\nu_{k+1}$, and the innovations are white with $K^2E\\nu^2 = P^- - P^+$. The error of the estimate does not correlate with it, so that")
    r.math(r"J(L_*) = Q_xP^+ + (P^- - P^+)\,\frac{Q_x + Q_uL_*^2}{1 - (\Phi - bL_*)^2}, \qquad |\Phi - bL_*| < 1", "other")
    r.says("The sensor enters through $P^+$ and $P^- - P^+$ alone, and these do not depend on $L_*$: the fraction has its minimum at the same $L_* = L$ for all $R$, as if the state were known.")
    r.says("**The estimator.** With the feedback $L$ and any other gain of the estimator, {eq:whole} reads $J = SQ + L^2W\\,E(\\hat x_k - x_k)^2$: the filter that makes the error smallest makes the cost smallest, whatever $Q_x$ and $Q_u$ are. {fig:gains} shows the one, {fig:estimators} the other.")
    halves(r, p, answer, both)
    value = answer["cost_other_gain"]
    loop = with_gain(both["current"], p.L_star)
    found = None
    if value is not None:
        limit = loop.steady()
        found = p.Qx * limit.x.P[0, 0] + p.Qu * limit.u.P[0, 0]
    else:
        r.check("modulus of the pole with the other gain", np.abs(loop.poles).max(), max(abs(p.Phi - p.b * p.L_star), (1 - answer["gain_steady"]) * p.Phi), ("eigenvalues", "closed form"))
    r.value("cost_other_gain", found, "m²", symbol="J(L_*)", reason="" if value is not None else "this gain does not hold the plant", agrees=answer, routes=("Lyapunov equation", "closed form"))
    if value is None:
        r.says("The gain $L_* = {gain}$ gives the pole {pole:3}, which is not inside the unit circle: it does not hold the plant.", gain=p.L_star, pole=p.Phi - p.b * p.L_star)
    else:
        r.says("The gain $L_* = {gain}$ costs {cost:4} m², the best one {best:4} m²: {percent:2} % more.", gain=p.L_star, cost=value, best=answer["cost_current"], percent=100 * (value / answer["cost_current"] - 1))
    trade_off(r, p, answer, system)


def halves(r, p, answer, both):
    """Cost against the gain of the feedback for some R, and against that of the estimator for some Qu."""
    L, scale = answer["feedback_gain"], p.R or p.Q
    gains = np.linspace(max(0.0, (p.Phi - 1) / p.b), min(2 * L, (p.Phi + 1) / p.b), 201)
    feedback = []
    for R, colour in ((0.0, "green"), (scale, "blue"), (4 * scale, "orange")):
        J = [by_hand.cost_of_gain(p, g, R) for g in gains]
        feedback.append(Curve(text("R = {R} m²", R=R), gains, [np.nan if x is None else x for x in J], colour))
    best = [by_hand.cost_of_gain(p, L, R) for R in (0.0, scale, 4 * scale)]
    feedback.append(Curve("the gain L of (a)", [L] * 3, best, "black", "points", size=5.0))
    r.check("cost at the best gain", with_gain(both["current"], L).steady().u.P[0, 0], answer["input_variance"], ("loop with that gain", "closed form"))
    K = np.linspace(0, 1, 201)
    estimator = []
    weight = p.Qu or p.Qx
    for Qu, colour in ((weight / 4, "green"), (weight, "blue"), (4 * weight, "orange")):
        other = p.model_copy(update={"Qu": Qu})
        J = [by_hand.cost_of_estimator(other, k) for k in K]
        estimator.append(Curve(text("$Q_u$ = {Qu}", Qu=Qu), K, [np.nan if x is None else x for x in J], colour))
        estimator.append(Curve("the filter's gain K", [answer["gain_steady"]], [by_hand.cost_of_estimator(other, answer["gain_steady"])], "black", "points", size=5.0, quiet=Qu != weight))
    panels = Drawing("Feedback", "gain of the feedback $L_*$", (Panel("cost per step J, m²", tuple(feedback), kind="count", reach=(0.0, 2.2 * max(best))),))
    r.figure("gains", panels, "Cost of a constant gain on the optimal estimate, for three sensors. The three minima lie at one gain, that of the known state; the sensor only lifts the curve.")
    top = 2.2 * max(float(c.y[0]) for c in estimator if c.style == "points")
    right = Drawing("Estimator", "gain of the estimator", (Panel("cost per step J, m²", tuple(estimator), kind="count", reach=(0.0, top)),))
    r.figure("estimators", right, "Cost of the optimal feedback of an estimate with a constant gain, for three weights of the input. The three minima lie at the filter's gain, whatever the input costs.")
    r.says("In {fig:gains} the measurement noise rises from the lowest curve to the highest, in {fig:estimators} the weight of the input does. The position of the minimum does not move.")


def trade_off(r, p, answer, system):
    """σ of x and u that can be had."""
    weights = (p.Qu or p.Qx) * np.geomspace(1e-3, 1e3, 121)
    found = np.array([by_hand.trade(p, w) for w in weights])
    curves = [Curve(name, found[:, i, 1], found[:, i, 0], colour) for i, (name, colour) in enumerate((("state known", "green"), ("current", "blue"), ("delayed", "orange")))]
    own = np.array(by_hand.trade(p, p.Qu)) if p.Qu else np.array(by_hand.trade(p, 0.0))
    curves.append(Curve("the given $Q_u$", own[:, 1], own[:, 0], "black", "points", size=5.0))
    r.figure("tradeoff", Drawing("Trade-off", "standard deviation of the input u, m", (Panel("standard deviation of the state x, m", tuple(curves), kind="count"),), reach=(0.0, 1.05 * float(found[:, :, 1].max()))),
             "What can be had: each point of a curve is one weight of the input. Points below a curve are out of reach of any regulator with that information.")
    r.says("Every $Q_u$ gives a point of {fig:tradeoff}. A cheaper input moves it to the right, where the state is held better; better information moves the whole curve down and to the left.",
           " The unstable plant needs an input: no curve reaches the left edge." if p.Phi > 1 else "")
    r.check("standard deviations of the trade-off", own[1], [answer["state_variance"] ** 0.5, answer["input_variance"] ** 0.5], ("formula of the trade-off", "formulas of (b)"), EXACT)
    if p.Qu:
        factors = [0.1, 10.0]
        members = tradeoff(system, Cost([[p.Qx]], [[p.Qu]]), factors)
        r.check("trade-off for two other weights", np.hstack([members.x_rms, members.u_rms]), [by_hand.trade(p, p.Qu * each)[1] for each in factors], ("covariances of the closed loop", "closed form"))


def part_d(r, p, answer, system):
    """Limits."""
    r.section("d", "Limits")
    stable = p.Phi < 1
    r.items([
        "**A perfect sensor**, $R \\to 0$: $P^+ \\to 0$ and $P^- \\to Q$. The current regulator costs $SQ$, no more than with the state known; the delayed one $(S + L^2W)Q$.",
        "**No sensor**, $R \\to \\infty$: for $\\Phi < 1$ the variance tends to $Q/(1 - \\Phi^2)$, that of the free plant, and so does the cost to $Q_xQ/(1 - \\Phi^2)$, as $L^2W = Q_x - (1 - \\Phi^2)S$. For $\\Phi = 1$ it grows like $\\sqrt{QR}$, for $\\Phi > 1$ like $P^- \\to (\\Phi^2 - 1)R$, and the cost in proportion to it: an unstable plant must be seen.",
        "**A free input**, $Q_u \\to 0$: $S \\to Q_x$, $L \\to \\Phi/b$, the pole tends to 0. The input cancels the prediction of the next state, and the current regulator leaves $J = Q_xP^-$: the state is as uncertain as its prediction. This is minimum variance ({ref:astrom, chapter 6}).",
        "**An expensive input**, $Q_u \\to \\infty$: for $\\Phi \\le 1$ it is best to do nothing in the limit, $L \\to 0$. For $\\Phi > 1$ something must be done: $S/Q_u \\to (\\Phi^2 - 1)/b^2$, $L \\to (\\Phi^2 - 1)/(\\Phi b)$, and the pole tends to $1/\\Phi$, the mirror image of the plant's, not to 1. The input has then the least mean square with which the plant can be held,",
    ])
    r.math(r"\min E u^2 = \frac{\Phi^2 - 1}{b^2}\,(P^- - P^+) \qquad (\Phi > 1)", "least")
    perfect = model(p, R=0.0)
    cost = Cost([[p.Qx]], [[p.Qu]])
    r.check("cost with a perfect sensor", regulator(perfect, cost).cost.value, answer["cost_known"], ("closed loop for R = 0", "closed form"))
    r.value("cost_perfect_delayed", regulator(perfect, cost, kind="delayed").cost.value, "m²", symbol=r"J_\text{delayed}(R = 0)", agrees=answer, routes=("separation", "closed form"))
    r.value("cost_free_input", regulator(system, Cost([[p.Qx]], [[0.0]])).cost.closed_loop, "m²", symbol=r"J_\text{current}(Q_u = 0)", agrees=answer, routes=("Lyapunov equation", "closed form"))
    least = regulator(system, Cost([[0.0]], [[1.0]]), stabilise=True).closed.steady().u.P[0, 0] if p.Phi != 1 else 0.0
    r.value("least_input_variance", least, "m²", symbol=r"\min E u^2", agrees=answer, routes=("regulator of the least effort", "closed form"))
    free = DiscreteModel([[p.Phi]], [[p.Q]], [[1]], [[1]], x0=[0], P0=[[p.P0]])
    worst = p.Qx * float(covariances_of_free(free)) if stable else None
    r.value("cost_unmeasured", worst, "m²", symbol=r"J(R = \infty)", reason="" if stable else "without measurements nothing holds the plant", agrees=answer, routes=("Lyapunov equation", "closed form"))
    against_noise(r, p, answer)


def covariances_of_free(free):
    """The variance of the plant without input."""
    from ctlabs.analysis import sensitivity

    return sensitivity.steady(free, free, K=[[0.0]]).P_plus[0, 0]


def against_noise(r, p, answer):
    """Cost against the noise of the sensor."""
    R = p.Q * np.geomspace(1e-3, 1e4, 141)
    S, L, W, _ = by_hand.regulator(p.Phi, p.b, p.Qx, p.Qu)
    found = np.array([by_hand.estimator(p.Phi, p.Q, each)[:2] for each in R])
    J = S * p.Q + L**2 * W * found
    curves = [Curve("state known", R, np.full_like(R, S * p.Q), "green"), Curve("current", R, J[:, 1], "blue"), Curve("delayed", R, J[:, 0], "orange")]
    if p.R:
        curves.append(Curve("the given sensor", [p.R] * 2, [answer["cost_current"], answer["cost_delayed"]], "black", "points", size=5.0))
    levels = (Mark("no sensor", answer["cost_unmeasured"], style="dot"),) if p.Phi < 1 else ()
    r.figure("noise", Drawing("Cost", "variance R of the measurement noise, m²", (Panel("cost per step J, m²", tuple(curves), kind="log", levels=levels),), log=True),
             "Cost against the noise of the sensor. The distance from the lowest line is what not knowing the state costs.")
    r.says("In {fig:noise} the current regulator begins at the cost of the known state; the delayed one keeps its distance even with a perfect sensor, because the last disturbance is never seen in time.",
           " Both end at the cost of the plant that is left alone." if p.Phi < 1 else " Both rise without bound." if p.Phi == 1 else " Both rise without bound, in the end in proportion to R.")


def part_e(r, p, answer, system):
    """A finite horizon."""
    r.section("e", "A task of finite length")
    r.says("Backwards from the last state, whose cost is $S_N = Q_x$, {eq:square} gives the gains of each step; forwards from $P_0^+ = P_0$ the filter gives its own. The separation is the same, term by term:")
    r.math(r"S_k = \Phi^2S_{k+1} + Q_x - L_k^2W_k, \qquad W_k = Q_u + b^2S_{k+1}, \qquad L_k = \frac{b\Phi S_{k+1}}{W_k}", "backwards")
    r.math(r"J_N = S_0P_0 + \sum_{k=0}^{N-1}\left(S_{k+1}Q + L_k^2W_kP_k^+\right)", "finite")
    found = regulator(system, Cost([[p.Qx]], [[p.Qu]], Qf=[[p.Qx]], horizon=p.steps), first=1)
    routes, N = ("recursion", "power of the step's matrix"), p.steps
    r.value("cost_to_go_horizon", found.feedback.S[:, 0, 0], at=range(N + 1), agrees=answer, routes=routes)
    r.value("feedback_gain_horizon", found.L[:, 0, 0], at=range(N), agrees=answer, routes=routes)
    own = covariances(system, N)
    r.value("gain_horizon", own.K[1:, 0, 0], at=range(1, N + 1), agrees=answer, routes=("filter", "power of the step's matrix"))
    r.check("gains of the regulator's filter", found.K[1:, 0, 0], answer["gain_horizon"], routes)
    r.value("cost_horizon", found.cost.value, "m²", symbol="J_N", agrees=answer, routes=("separation", "closed form"))
    r.check("cost of the whole task", found.cost.closed_loop, answer["cost_horizon"], ("covariances of the closed loop", "closed form"))
    r.value("cost_horizon_unknown", found.cost.estimation, "m²", agrees=answer, routes=("separation", "closed form"))
    k = np.arange(N)
    both = Drawing("Schedule", "step number k", (
        Panel("gain of the regulator", (Curve("$L_k$", k, found.L[:, 0, 0], "blue", "points"),), kind="count", levels=(Mark("L", answer["feedback_gain"]),)),
        Panel("gain of the filter", (Curve("$K_k$", k + 1, own.K[1:, 0, 0], "orange", "points"),), kind="count", levels=(Mark("K", answer["gain_steady"]),)),
    ), whole=True)
    r.figure("schedule", both, "Gains of the regulator and of the filter over a task of {n} steps. Dashed: their limits.", n=N)
    r.says("In {fig:schedule} the filter settles from the beginning, where it forgets $P_0$, and the regulator from the end, where nothing that it could still save lies ahead. The whole costs {J:5} m²; {unknown:4} m² of it are due to not knowing the state.",
           J=answer["cost_horizon"], unknown=answer["cost_horizon_unknown"])


def part_f(r, p, answer, both):
    """Another truth."""
    r.section("f", "The plant is not the model")
    r.says("If the plant has the factor $a$ in truth, the estimator still predicts with Φ, and the errors do not separate any more. State and estimate obey together")
    r.math(r"x_{k+1} = ax_k - bL\hat x_k + w_k, \qquad \hat x_{k+1} = m\,\hat x_k + K(x_{k+1} + v_{k+1}), \qquad m = (1 - K)(\Phi - bL)", "loop")
    r.math(r"\lambda^2 - (a + m - KbL)\,\lambda + am = 0", "characteristic")
    r.says("Both roots lie inside the unit circle if and only if $|a + m - KbL| < 1 + am$ and $|am| < 1$: of the positive factors the loop bears")
    r.math(r"\frac{KbL}{1 + m} - 1 < a < \min\left(1 + \frac{KbL}{1 - m},\ \frac1m\right)", "bounds")
    low, high = answer["true_factor_limits"]
    current = both["current"]
    edges = [float(np.abs(current.loop(model(p, Phi=edge)).poles).max()) for edge in (low, high) if edge]
    r.check("modulus of a pole at the bounds", edges, [1.0] * len(edges), ("eigenvalues of the closed loop", "bounds of the factor"))
    r.value("true_factor_limits", [low, high], symbol=r"a_\text{min}, a_\text{max}")
    cost = answer["cost_actual"]
    truth = model(p, Phi=p.Phi_true)
    loop = current.loop(truth)
    found = current.actual_cost(truth) if cost is not None else None
    r.value("cost_actual", found, "m²", symbol=r"J(\Phi_t)", reason="" if cost is not None else "the loop is not stable", agrees=answer, routes=("Lyapunov equation", "three linear equations"))
    ideal = regulator(truth, Cost([[p.Qx]], [[p.Qu]])).cost.value
    if cost is None:
        r.check("modulus of the pole with the true factor", np.abs(loop.poles).max(), np.abs(np.roots([1, -(p.Phi_true + _m(answer) - answer["gain_steady"] * p.b * answer["feedback_gain"]), p.Phi_true * _m(answer)])).max(), ("eigenvalues of the closed loop", "characteristic equation"))
        r.says("The true factor $\\Phi_t = {a}$ lies outside: the regulator does not hold this plant.", a=p.Phi_true)
    else:
        r.says("At $\\Phi_t = {a}$ the regulator costs {cost:4} m². One designed for the true plant would cost {ideal:4} m²: the wrong model costs {more:2} %.", a=p.Phi_true, cost=cost, ideal=ideal, more=100 * (cost / ideal - 1))
    against_truth(r, p, answer)


def _m(answer):
    return (1 - answer["gain_steady"]) * answer["regulator_pole"]


def against_truth(r, p, answer):
    """Cost against the true factor."""
    low, high = answer["true_factor_limits"]
    shown = np.linspace(max(low, p.Phi - 2 * (high - p.Phi), 1e-3), high, 162)[1:-1]
    ours = [by_hand.actual_cost(p, a) for a in shown]
    best = [by_hand.current(p, a) for a in shown]
    curves = (Curve("designed for Φ", shown, [np.nan if x is None else x for x in ours], "blue"), Curve("designed for the true factor", shown, best, "green", "dash"),
              Curve("the given Φ", [p.Phi], [answer["cost_current"]], "black", "points", size=5.0))
    r.figure("truth", Drawing("Truth", "true factor of the plant", (Panel("cost per step J, m²", curves, kind="count", reach=(0.0, 4 * max(best))),), marks=(Mark("bound", high),)),
             "Cost of the regulator designed for Φ against the true factor of the plant, and of the regulator that knows it. The curves touch at Φ; at the bound the loop loses its stability.")
    r.says("In {fig:truth} the two curves touch at Φ without crossing, so that a small error of the model costs in proportion to its square. Towards the bound {high:4} of {eq:bounds} the cost grows without limit.", high=high)


PARTS = Skeleton(
    result=result,
    key="noise",
    analysis=(part_a, part_b, part_c, part_d, part_e, part_f),
    plan=plan,
    experiment=(part_g,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), system=model(p), both=designs(p), truth=model(p, Phi=p.Phi_true))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
