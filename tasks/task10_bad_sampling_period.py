r"""Lab 10. An oscillator measured with a bad sampling period.

Source: Semushin & Tsyganova 2001, task 10. ÿ + y = 0 with random y(0), ẏ(0), measured every d seconds as z = y + v. The
sheet asks for (a) the equations of the estimate of ẏ and what their computation consists of; (b) why d = 2π is a bad period,
from the covariance (or its inverse) and from observability, which component is lost, why the effect is called stroboscopic (the
sheet prints "stereoscopic"), and the general rule; (c) a simulation.

Expected answer: at d = kπ only the (1,1) element of P⁻¹ grows. With P0 = [[4, 1], [1, 2]], R = 1 and N measurements
P11 = 4/(1+4N), P12 = 1/(1+4N), P22 = 2 − N/(1+4N) → 7/4; det[H; HΦ] = sin d, so that ẏ is lost at d = π as well.
In general sampling loses what it sees only where Re λi = Re λj and Im(λi − λj) = 2πk/d.
"""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks._task10_words import NAMES, answers, conclusions, discussion, quality, result
from ctlabs.tasks.answers import task10 as by_hand

from ctlabs.filtering import settling_step, steady, update
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, mean_error, portrait, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import Count, Covariance, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.text import latex_number, text

META = {
    "name": "task10",
    "title": "An oscillator measured with a bad sampling period",
    "source": "Semushin & Tsyganova 2001, task 10",
    "parts": ["a", "b", "c"],
}

STEP = "measurement number i"
TIME = "t, s"
#: Measurements simulated in part (c), if the lists are shorter.
SIMULATED = 30
#: How far the search for a halved variance goes.
SEARCHED = 400


class Parameters(LabParameters):
    """What may be changed."""

    P0: Covariance(2) = given(((4, 1), (1, 2)), unit="m², m²/s, m²/s²", meaning="covariance of y(0), ẏ(0)", draw=one_of(*(((a, b), (b, c)) for a in (3, 4, 5, 6) for c in (2, 3, 4) for b in (0.5, 1, 1.5, 2))))
    R: Variance = given(1.0, unit="m²", meaning="variance of the measurement error v", draw=span(0.5, 3, 0.25))
    dt_bad: Positive = given(2 * math.pi, unit="s", meaning="a sampling period that should be bad", symbol="d_1", draw=one_of(math.pi, 2 * math.pi, 3 * math.pi, 4 * math.pi))
    dt_good: Positive = given(math.pi / 2, unit="s", meaning="a sampling period that should be good", symbol="d_2", draw=one_of(math.pi / 6, math.pi / 4, math.pi / 3, math.pi / 2))
    steps: Count = given(10, unit="1", meaning="measurements in the lists", symbol="N")


def model(p):
    """y and ẏ as the state; no noise drives them."""
    return ContinuousModel(F=[[0, 1], [-1, 0]], G=[[0], [1]], Q=[[0]], H=[[1, 0]], P0=p.P0, states=["y", "ẏ"],
                           measurements=["z"], units=["m", "m/s"])


def sampled(p, dt):
    """The model sampled every dt.

    In double precision sin 2π is −2.4e-16. With very small R this rounding would be taken for a view of ẏ, so at a period
    that loses it Φ is written as what it is, ±I.
    """
    system = discretise(model(p), dt, R=[[p.R]])
    return replace(system, Phi=np.round(system.Phi) + 0.0) if observability.loss_by_sampling(model(p), dt).lost else system


def part_a(r, p, bad, good, experiment):
    """The recursion for the velocity."""
    r.section("a", "Equations of the estimate of ẏ")
    r.says("The velocity cannot be estimated without the position, so the state consists of both. The exact discrete model is a rotation by the phase $d$ (the angular frequency is 1/s, so $d$ is also the period in seconds):")
    r.math(r"F = \begin{bmatrix} 0 & 1 \\ -1 & 0 \end{bmatrix}, \qquad \Phi = e^{Fd} = \begin{bmatrix} \cos d & \sin d \\ -\sin d & \cos d \end{bmatrix}, \qquad Q_d = 0, \qquad H = \begin{bmatrix} 1 & 0 \end{bmatrix}, \qquad R = {R}, \qquad P_0 = {P0}",
           R=p.R, P0=np.array(p.P0))
    r.says("With $c = \\cos d$, $s = \\sin d$ and zero initial means, for $i = 1, 2, \\dots$, first the prediction ({ref:maybeck, section 5.3}; arguments $t_{i-1}^+$ on the right):")
    r.math(r"\hat y^- = c\,\hat y + s\,\hat{\dot y}, \qquad \hat{\dot y}{}^- = -s\,\hat y + c\,\hat{\dot y}", "prediction")
    r.math(r"P_{11}^- = c^2P_{11} + 2csP_{12} + s^2P_{22}, \quad P_{12}^- = cs(P_{22} - P_{11}) + (c^2 - s^2)P_{12}, \quad P_{22}^- = s^2P_{11} - 2csP_{12} + c^2P_{22}")
    r.says("then the update:")
    r.math(r"K_1 = \frac{P_{11}^-}{P_{11}^- + R}, \qquad K_2 = \frac{P_{12}^-}{P_{11}^- + R}, \qquad \hat{\dot y}{}^+ = \hat{\dot y}{}^- + K_2(z - \hat y^-), \qquad \hat y^+ = \hat y^- + K_1(z - \hat y^-)", "update")
    r.math(r"P_{11}^+ = RK_1, \qquad P_{12}^+ = RK_2, \qquad P_{22}^+ = P_{22}^- - K_2P_{12}^-")
    r.says("**What the computation consists of.** Neither $P$ nor $K$ depends on the data: $K_2(t_i)$ is a table computed before any measurement. With the data only the two lines of the estimates remain, six multiplications per measurement. Without process noise there is also a formula for all measurements at once: with $h_j = [\\cos jd, \\; \\sin jd]$ and $G_i = \\sum_{j \\le i} h_j^Th_j$ the initial state has after $i$ measurements the covariance")
    r.math(r"\mathcal P_i = \frac{R\,[R\,P_0 + |P_0|\,\text{adj}\,G_i]}{R^2 + R\,\text{tr}\,P_0G_i + |P_0|\,|G_i|}, \qquad |G_i| = \sum_{m=1}^{i-1}(i-m)\sin^2md, \qquad P(t_i^+) = \Phi^i\,\mathcal P_i\,\Phi^{iT}", "all")
    at = list(range(1, p.steps + 1))
    # The recursion knows P⁻ up to rounding of P0, and K divides by an innovation variance as small as R.
    known = max(1.0, 1e-8 * float(np.trace(p.P0)) / p.R) if p.R else 1.0
    for name, system in (("bad", bad), ("good", good)):
        schedule = covariances(system, p.steps)
        K, P_minus = schedule.K[1:, :, 0], schedule.P_minus[1:]
        r.value(f"gain_{name}", K, at=at)
        whole = by_hand.posterior(p.P0, p.R, system.dt, p.steps)
        sd = np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 1e-300))
        r.check(text("covariances, dt = {dt} s", dt=system.dt), schedule.P_plus[1:], whole, ("recursion", "all measurements at once"), scale=sd[:, :, None] * sd[:, None, :])
        r.check(text("P⁺ = (I − KH)P⁻, dt = {dt} s", dt=system.dt), schedule.P_plus[1:], P_minus - K[:, :, None] * P_minus[:, :1], ("Joseph form", "short form"), scale=max(np.abs(P_minus).max(), 1e-300))
        if p.R:
            r.check(text("gains, dt = {dt} s", dt=system.dt), K, by_hand.gains(p.P0, p.R, system.dt, p.steps), ("recursion", "all measurements at once"), SOLVER, scale=known)
            some = experiment.histories(system, steps=p.steps)
            whole = by_hand.all_at_once(some.z[1:, 0], p.P0, p.R, system.dt)
            r.check(text("estimates of 25 records, dt = {dt} s", dt=system.dt), some.x_plus[-1], whole, ("filter", "all measurements at once"), SOLVER, scale=known * max(np.abs(whole).max(), 1.0))


def of_N(factor):
    """So many times N inside an equation."""
    return "N" if factor == 1 else f"{latex_number(factor)}N"


def part_b(r, p, answer, bad, good):
    """Why 2π is bad, from the inverse covariance."""
    r.section("b", "Why 2π is a bad period")
    r.says("**From the inverse of the covariance.** Without process noise the prediction only turns it, and the update adds to it ({ref:maybeck, section 5.7}):")
    r.math(r"P^{-1}(t_i^-) = \Phi^{-T}P^{-1}(t_{i-1}^+)\Phi^{-1}, \qquad P^{-1}(t_i^+) = P^{-1}(t_i^-) + \frac1R\begin{bmatrix} 1 & 0 \\ 0 & 0 \end{bmatrix}")
    r.says("At $d = 2\\pi$ (and at any $d = k\\pi$) $\\Phi = \\pm I$ leaves every covariance as it is, so only the (1,1) element grows:")
    r.math(r"P^{-1}(t_N^+) = P_0^{-1} + \frac NR\begin{bmatrix} 1 & 0 \\ 0 & 0 \end{bmatrix} \quad\Rightarrow\quad P_{11} = \frac{RP_{11}(0)}{R + NP_{11}(0)}, \quad P_{12} = \frac{RP_{12}(0)}{R + NP_{11}(0)}, \quad P_{22} = P_{22}(0) - \frac{NP_{12}^2(0)}{R + NP_{11}(0)}", "grows")
    (a, b), (_b, c) = p.P0
    r.says("The formulas on the right hold for a singular $P_0$ too. With the given numbers $P_{11} = {top}/({R} + {some})$, $P_{12} = {mid}/({R} + {some})$ and $P_{22} = {c} - {square}/({R} + {some})$. The variance of the position tends to zero; that of the velocity stays above",
           top=p.R * a, mid=p.R * b, R=p.R, c=c, some=of_N(a), square=of_N(b * b))
    r.math(r"\lim_{N\to\infty} P_{22} = P_{22}(0) - \frac{P_{12}^2(0)}{P_{11}(0)} = {floor} \; \text{m}^2/\text{s}^2,", "floor", floor=by_hand.conditional(p.P0))
    r.says("the variance of $\\dot y(0)$ once $y(0)$ is known: the measurements inform on the velocity only through the initial correlation. ∎",
           " (Here the position is known from the start, and the velocity keeps its variance.)" if not a else "")
    at, routes = list(range(1, p.steps + 1)), ("recursion", "all measurements at once")
    few, many = covariances(bad, p.steps).P_plus[1:], covariances(good, p.steps).P_plus[1:]
    r.table("variances", ["$N$", "$P_{11}$ at $d_1$, m²", "$P_{12}$ at $d_1$, m²/s", "$P_{22}$ at $d_1$, m²/s²", "$P_{22}$ at $d_2$, m²/s²"],
            [(i, P[0, 0], P[0, 1], P[1, 1], other[1, 1]) for i, P, other in zip(at, few, many, strict=True)],
            "Filtering covariance with measurements every {bad} s and every {good} s.", bad=p.dt_bad, good=p.dt_good)
    r.says("{tab:variances} has the covariances at both given periods.")
    r.value("position_variance_bad", few[:, 0, 0], "m²", at=at, agrees=answer, routes=routes)
    r.value("velocity_variance_bad", few[:, 1, 1], "m²/s²", at=at, agrees=answer, routes=routes)
    r.value("velocity_variance_good", many[:, 1, 1], "m²/s²", at=at, agrees=answer, routes=routes)
    lost = answer["observability_rank_bad"] == 1
    left = update(p.P0, bad.H, [[0.0]]).P_plus[1, 1] if lost else steady.solve(bad).P_plus[1, 1]
    r.value("velocity_variance_floor", left, "m²/s²", symbol="P_{22}(\\infty)", agrees=answer, routes=("perfect measurement of y(0)" if lost else "steady state", "limit of the formula"))
    if p.R and np.linalg.cond(np.array(p.P0)) < 1e6:
        r.check("P⁻¹ at d₁", np.linalg.inv(few), by_hand.inverse(p.P0, p.R, p.dt_bad, p.steps), ("recursion, inverted", "sum of information"))
    settled = answer["velocity_settling_step_bad"]
    found = settling_step(covariances(bad, max(settled, 2) + 1).P_plus[1:, 1, 1:], [left]) if settled and settled < 1e4 else None
    r.value("velocity_settling_step_bad", settled if found is None else found + 1,
            reason="" if settled else "ẏ is observable, or determined by y: its variance tends to 0 and never stays within 1 % of that")
    if found is not None:
        r.check("settling of the velocity", found + 1, settled, ("recursion", "closed form"))
    if not lost:
        r.says("**The given** $d_1 = {dt}$ s **is no such period**: there $\\sin d = {sine}$ and the turn brings the velocity into view, so that its variance tends to 0, not to the value above.", dt=p.dt_bad, sine=math.sin(p.dt_bad))


def sampling(r, p, answer):
    """Why 2π is bad, from observability; the general rule."""
    losses = {name: observability.loss_by_sampling(model(p), dt) for name, dt in (("bad", p.dt_bad), ("good", p.dt_good))}
    strobe(r, p)
    r.says("**From observability.** Two measurements determine the state when the matrix")
    r.math(r"\begin{bmatrix} H \\ H\Phi \end{bmatrix} = \begin{bmatrix} 1 & 0 \\ \cos d & \sin d \end{bmatrix}, \qquad \det = \sin d", "det")
    r.says("is regular. Hence the pair $(\\Phi, H)$ is not observable exactly when $d = k\\pi$: not only 2π but π, too, is a bad period, as $\\Phi = -I$ shows the position again, with the other sign. The component that is lost is the velocity $\\dot y$, the direction $(0, 1)^T$; continuous measurement would see both (rank {rank}).", rank=losses["bad"].rank_continuous)
    for name, loss in losses.items():
        system = sampled(p, loss.dt)
        r.value(f"observability_rank_{name}", loss.rank, agrees=answer, routes=("sampled model", "sine of the phase"))
        matrix = np.vstack([system.H, system.H @ system.Phi])
        r.check(text("det [H; HΦ], dt = {dt} s", dt=loss.dt), np.linalg.det(matrix), 0.0 if by_hand.loses(loss.dt) else math.sin(loss.dt), ("determinant", "sine of the phase"), scale=1.0)
        sigma = np.linalg.svd(matrix, compute_uv=False)
        r.value(f"reciprocal_condition_{name}", sigma[1] / sigma[0])
        r.check(text("reciprocal condition of [H; HΦ], dt = {dt} s", dt=loss.dt), sigma[1] / sigma[0], answer[f"reciprocal_condition_{name}"], ("singular values", "tangent of half the offset"), scale=1.0)
    bad = losses["bad"]
    r.value("unobservable_direction", bad.sampled.unobservable[:, 0] if bad.lost else None, agrees=answer, routes=("staircase", "null vector by hand"),
            reason="" if bad.lost else "the sampled model is observable")
    r.value("verdict_b", bad.lost)
    r.says("**Stroboscopic** is the word for it (the sheet prints “stereoscopic”): a flash lamp that fires once per revolution shows a wheel at rest. Here every measurement finds the oscillator in the same phase, at $d = 2\\pi$ after a full cycle, at $d = \\pi$ in its mirror image; it has moved in between, but nothing shows how fast ({fig:strobe}).")
    return {"losses": losses}


def strobe(r, p):
    """Two motions that no sample tells apart."""
    d = math.pi * max(1, round(p.dt_bad / math.pi))
    t, at = np.linspace(0, 4 * d, 801), d * np.arange(5)
    curves = (Curve("y(0) = 1 m, ẏ(0) = 0", t, np.cos(t), "blue"), Curve("y(0) = 1 m, ẏ(0) = 1.5 m/s", t, np.cos(t) + 1.5 * np.sin(t), "orange"),
              Curve("samples of either", at, np.cos(at), "black", "points", size=6.0))
    r.figure("strobe", Drawing("Stroboscope", TIME, (Panel("y, m", curves),)), "Two motions that start at the same place with different velocities. Their samples every {d:4} s, the losing period nearest to $d_1$, are the same.", d=d)


def rule(r, losses):
    """The general rule, with its proof, and the given periods."""
    r.says("**In general** (Kalman, Ho and Narendra; {ref:kalman_ho_narendra}) a model that is observable with continuous measurements stays so with samples every $d$ unless two of its eigenvalues come together in $e^{\\lambda d}$, that is, unless for some $\\lambda_i \\ne \\lambda_j$")
    r.math(r"\text{Re}\,\lambda_i = \text{Re}\,\lambda_j \quad\text{and}\quad \text{Im}(\lambda_i - \lambda_j) = \frac{2\pi k}{d}, \qquad k = \pm1, \pm2, \dots", "rule")
    r.says("*Proof.* A pair $(F, H)$ is observable if and only if no eigenvector $x$ of $F$ has $Hx = 0$. Let $\\Phi x = \\mu x$ with $Hx = 0$, $x \\ne 0$. As the eigenvalues of $\\Phi = e^{Fd}$ are the numbers $e^{\\lambda d}$, there is an eigenvalue λ of $F$ with $e^{\\lambda d} = \\mu$, by assumption only one. The function $f(s) = e^{sd} - \\mu$ has at λ a simple zero, for $f'(\\lambda) = d\\mu \\ne 0$, and no zero at the other eigenvalues of $F$; so $f(s) = (s - \\lambda)g(s)$ with an entire $g$ that vanishes at no eigenvalue. Hence $\\Phi - \\mu I = f(F) = g(F)(F - \\lambda I)$ with a regular $g(F)$, and $(\\Phi - \\mu I)x = 0$ gives $Fx = \\lambda x$: an eigenvector of $F$ with $Hx = 0$, which a model that is observable does not have. ∎")
    r.says("With a single measurement the condition is necessary as well: if $\\lambda_i \\ne \\lambda_j$ come together in µ, all combinations of their two eigenvectors are eigenvectors of Φ for µ, and one of them is in the null space of the row $H$. Several measurements may still tell the two modes apart. Real or differently damped eigenvalues never meet. To be safe it is enough that $d < 2\\pi/\\max|\\text{Im}(\\lambda_i - \\lambda_j)|$. Here $\\lambda = \\pm i$, the difference is $2i$, the bad periods are $d = k\\pi$, and more than two measurements per cycle are safe. The same condition preserves controllability by inputs that are held between the samples.")
    for name, loss in losses.items():
        nearest = loss.losing_periods[0]
        if loss.lost:
            r.says("The period ${name} = {dt}$ s meets it: the eigenvalues $-i$ and $i$ come together in {value}, and the rank falls to {rank}.", name=NAMES[name], dt=loss.dt,
                   value=round(math.cos(loss.dt)), rank=loss.rank)
        else:
            r.says("The period ${name} = {dt}$ s does not: the nearest losing period is {nearest:4} s, {percent:2} % away, and the rank is {rank}. The ratio of the smallest to the largest singular value of the matrix in {eq:det} is {condition:3} ({verdict}).", name=NAMES[name], dt=loss.dt,
                   nearest=nearest, percent=100 * loss.distance, rank=loss.rank, condition=by_hand.reciprocal_condition(loss.dt), verdict=quality(loss.dt))
    r.check("nearest losing periods", [loss.losing_periods[0] for loss in losses.values()], [math.pi * max(1, round(loss.dt / math.pi)) for loss in losses.values()],
            ("differences of eigenvalues", "zeros of sin d"))


def near(r, p):
    """Near a loss: as a number."""
    r.says("**Near a losing period** the rank is 2, which says nothing of how good the observation is. With $d = k\\pi + \\varepsilon$ the measurements show $\\pm[y + j\\varepsilon\\,\\dot y]$, a straight line whose slope must be found: for small $N\\varepsilon$")
    r.math(r"|G_N| = \sum_{m=1}^{N-1}(N-m)\sin^2m\varepsilon \approx \frac{\varepsilon^2N^2(N^2-1)}{12}, \qquad \text{information on } \dot y \approx \frac{\varepsilon^2N^3}{12R}", "slope")
    N = max(p.steps, 2)
    dets = [float(np.linalg.det(observability.gramian(discretise(model(p), 2 * math.pi + 0.1 / N / 2**j, R=[[1.0]]), N))) for j in range(3)]
    r.order("determinant of the Gramian as ε → 0", dets, 2, ("Gramian", "leading term"))
    floor = by_hand.conditional(p.P0)
    periods = {"$d_1$": p.dt_bad, "$d_2$": p.dt_good, "π/2": math.pi / 2, "π": math.pi, "2π": 2 * math.pi}
    periods |= {f"2π + {share} %": 2 * math.pi * (1 + share / 100) for share in (3, 1, 0.1, 0.01)}
    given_too = ("π/2", "π", "2π")  # left out where a given period is the same
    periods = {name: dt for name, dt in periods.items() if name not in given_too or min(abs(dt - p.dt_bad), abs(dt - p.dt_good)) > 1e-9}
    rows = []
    for name, dt in periods.items():
        loss, schedule = observability.loss_by_sampling(model(p), dt), covariances(sampled(p, dt), max(SEARCHED, p.steps))
        below = np.flatnonzero(schedule.P_plus[1:, 1, 1] <= 0.5 * floor) if floor else []
        rows.append((name, dt, loss.rank, 100 * loss.distance, by_hand.reciprocal_condition(dt), quality(dt), schedule.P_plus[p.steps, 1, 1], int(below[0]) + 1 if len(below) else None))
    r.table("periods", ["period", "$d$, s", "rank", "from a losing period, %", "ratio of singular values", "in words", text("$P_{22}$ after {n}, m²/s²", n=p.steps), "measurements to halve the floor"], rows,
            "Rank against quality: the ratio of the smallest to the largest singular value of the matrix in {eq:det}, well conditioned above 0.3, fair above 0.1. The last column is the number of measurements until $P_{22}$ is at most half of {floor} m²/s², the floor at $d = k\\pi$; a dash: not within {most}.", floor=floor, most=max(SEARCHED, p.steps))
    grid = np.union1d(np.linspace(0.05, 2.1 * math.pi, 120), [math.pi, 2 * math.pi])
    n = min(p.steps, 20)
    found = [covariances(sampled(p, dt), n).P_plus[n, 1, 1] for dt in grid]
    r.check(text("P22 after {n} measurements against the period", n=n), found, [by_hand.posterior(p.P0, p.R, dt, n)[-1, 1, 1] for dt in grid], ("recursion", "all measurements at once"))
    given = tuple(
        Curve(text("{name} = {dt:4} s", name=f"${NAMES[name]}$", dt=dt), [dt % (2 * math.pi) or dt], [by_hand.posterior(p.P0, p.R, dt, n)[-1, 1, 1]], colour, style, size=7.0)
        for name, dt, colour, style in (("bad", p.dt_bad, "orange", "points"), ("good", p.dt_good, "green", "square")))
    panel = Panel("variance of ẏ, m²/s²", (Curve(text("after {n} measurements", n=n), grid, found), *given), kind="count", levels=(Mark("floor at $d = k\\pi$", floor),))
    r.figure("periods", Drawing("Periods", "sampling period d, s", (panel,)),
             "Variance of the velocity after {n} measurements against the sampling period; the points are the given periods, less full cycles.", n=n)
    r.says("In {fig:periods} the variance stays above its floor (dashed) at π and 2π, however many measurements there are. Elsewhere it is small, except towards $d = 0$, where the measurements follow one another too quickly to show the motion. With more measurements the peaks become narrower, not lower: by {eq:slope} their width falls like $N^{-3/2}$. {tab:periods} compares rank and quality: near a losing period the rank is full and the quality poor.")
    gains(r, p)


def gains(r, p):
    """Gains at both given periods."""
    k, panels = np.arange(1, p.steps + 1), ([], [])
    for name, dt, colour, style in (("bad", p.dt_bad, "orange", "points"), ("good", p.dt_good, "blue", "square")):
        K = covariances(sampled(p, dt), p.steps).K[1:, :, 0]
        for i, panel in enumerate(panels):
            panel.append(Curve(text("{name} = {dt:4} s", name=f"${NAMES[name]}$", dt=dt), k, K[:, i], colour, style))
    r.figure("gains", Drawing("Gains", STEP, (Panel("gain of y, $K_1$", tuple(panels[0])), Panel("gain of ẏ, $K_2$, 1/s", tuple(panels[1]))), whole=True, height=6.0),
             "Gains of position and velocity at both given periods.")
    r.says("{fig:gains} has the gains of {eq:update}.", " At the losing period $K_2 = P_{12}/(P_{11} + R)$ comes from the initial correlation alone and tends to 0 with it; at the other period the velocity is corrected by what each turn of the oscillator shows." if by_hand.loses(p.dt_bad) != by_hand.loses(p.dt_good) else "")


def plan(r, p, experiment):
    """Every number chosen."""
    steps = max(p.steps, SIMULATED)
    r.says("{tab:plan} lists what was chosen. Part (c) simulates three periods with the same initial states and measurement errors: both given ones, and one 1.2 % above the losing period nearest to $d_1$, where the rank is full but the condition bad. Each ensemble is compared with the covariances of (a).")
    r.table("plan", ["quantity", "value", "why"], [
        ["periods, s", [p.dt_bad, nearby(p), p.dt_good], "bad, nearly bad, good"],
        ["measurements", steps, "enough to see the floor of the variance of the velocity"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "common to the three periods: they are compared on the same numbers"],
        ["initial mean", [0, 0], "the sheet's"],
    ], "Plan of the experiment.")
    return {"steps": steps}


def nearby(p):
    """A period 1.2 % above the losing one nearest to dt_bad, s."""
    return 1.012 * math.pi * max(1, round(p.dt_bad / math.pi))


def part_c(r, p, bad, good, experiment, steps):
    """Ensembles at three periods."""
    r.section("c", "Simulation at a bad, a nearly bad and a good period")
    close = sampled(p, nearby(p))
    systems = {"$d_1$": bad, "1.2 % off a loss": close, "$d_2$": good}
    schedules = {name: covariances(system, steps) for name, system in systems.items()}
    ensembles = {"$d_1$": portrait(r, experiment, bad, steps, prefix="bad_", xlabel=TIME, state=1, figures={
        "errors": "The period is the first one; the innovations are those of the position, the errors those of the velocity." })}
    ensembles["$d_2$"] = portrait(r, experiment, good, steps, prefix="good_", state=1, figures={})
    ensembles["1.2 % off a loss"] = experiment.statistics(close, steps=steps)
    agreement(r, "1.2 % off a loss", ensembles["1.2 % off a loss"], schedules["1.2 % off a loss"].P_plus)
    rows, panels, k = [], ([], []), np.arange(1, steps + 1)
    for (name, system), (colour, style) in zip(systems.items(), (("orange", "points"), ("black", "triangle"), ("blue", "square")), strict=True):
        stats, sd = ensembles[name], schedules[name].sd_plus
        rows.append((name, system.dt, quality(system.dt), sd[-1, 0], rms(stats), sd[-1, 1], rms(stats, state=1), mean_error(stats, state=1), known(stats.nees[-1]), known(stats.nis[-1])))
        for i, panel in enumerate(panels):
            panel += [Curve(text("theory, {name}", name=name), k, positive(sd[1:, i]), colour), Curve(text("ensemble, {name}", name=name), k, positive(stats.rms[1:, i]), colour, style, size=3.0)]
    shown = tuple(Panel(label, drawn, kind="log") for label, panel in zip(("RMS error of y, m", "RMS error of ẏ, m/s"), panels, strict=True)
                  if (drawn := tuple(curve for curve in panel if np.isfinite(curve.y).any())))
    if shown:
        r.figure("ensemble", Drawing("Ensembles", STEP, shown, whole=True, height=6.6),
                 "RMS errors of position and velocity after each measurement at the three periods: theory (lines) and {runs} runs (points).", runs=experiment.runs)
        r.says("{fig:ensemble} and {tab:ensemble} give the answer in numbers. At each period the position becomes known, its error falling about like $1/\\sqrt N$. The velocity becomes known only where the period brings it into view, and near a losing period that takes many measurements.")
    r.table("ensemble", ["period", "$d$, s", "condition", "σ of y, m", "RMS of y, m", "σ of ẏ, m/s", "RMS of ẏ, m/s", "mean error of ẏ, m/s", "NEES", "NIS"], rows,
            "The three periods after {steps} measurements: theory (σ) and ensemble. NEES is 2 in theory (1 where one combination of the states is known exactly), NIS 1.", steps=steps)
    r.value("rms_velocity", [float(row[6].value) for row in rows], "m/s")
    r.says("{fig:bad_errors} shows 25 runs at the first period.", " Each run keeps the error of the velocity that it had after the first measurements, for the samples tell nothing more of it." if by_hand.loses(p.dt_bad) else "")
    return {"measured": [row[6] for row in rows], "sd": [row[5] for row in rows]}


def positive(values):
    """What a logarithmic axis can show."""
    return np.where(values > 0, values, np.nan)


def known(x):
    """A number, or None for one that does not exist."""
    return None if math.isnan(x) else x


PARTS = Skeleton(
    result=result,
    key="periods",
    analysis=(part_a, part_b, sampling, rule, near),
    plan=plan,
    experiment=(part_c,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer = by_hand.analytic(p)
    bad, good = sampled(p, p.dt_bad), sampled(p, p.dt_good)
    return PARTS.report(META, p, experiment, bad=bad, good=good, answer=answer)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
