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
from ctlabs.tasks.answers import task10 as by_hand

from ctlabs.filtering import settling_step, steady, update
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, largest, portrait
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, observability
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, Covariance, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.text import text

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

    P0: Covariance(2) = given(((4, 1), (1, 2)), unit="m², m²/s, m²/s²", meaning="covariance of y(0), ẏ(0)")
    R: Variance = given(1.0, unit="m²", meaning="variance of the measurement error v")
    dt_bad: Positive = given(2 * math.pi, unit="s", meaning="a sampling period that should be bad")
    dt_good: Positive = given(math.pi / 2, unit="s", meaning="a sampling period that should be good")
    steps: Count = given(10, unit="1", meaning="measurements in the lists")


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
    r.says("The velocity cannot be estimated without the position, so both are the state. The exact discrete model is a turn by the phase $d$ (the angular frequency is 1/s, so $d$ is also the period in seconds):")
    r.math(r"F = \begin{bmatrix} 0 & 1 \\ -1 & 0 \end{bmatrix}, \qquad \Phi = e^{Fd} = \begin{bmatrix} \cos d & \sin d \\ -\sin d & \cos d \end{bmatrix}, \qquad Q_d = 0, \qquad H = \begin{bmatrix} 1 & 0 \end{bmatrix}, \qquad R = {R}, \qquad P_0 = {P0}",
           R=p.R, P0=np.array(p.P0))
    r.says("With $c = \\cos d$, $s = \\sin d$ and zero initial means, for $i = 1, 2, \\dots$, first the prediction (arguments $t_{i-1}^+$ on the right):")
    r.math(r"\hat y^- = c\,\hat y + s\,\hat{\dot y}, \qquad \hat{\dot y}{}^- = -s\,\hat y + c\,\hat{\dot y}")
    r.math(r"P_{11}^- = c^2P_{11} + 2csP_{12} + s^2P_{22}, \quad P_{12}^- = cs(P_{22} - P_{11}) + (c^2 - s^2)P_{12}, \quad P_{22}^- = s^2P_{11} - 2csP_{12} + c^2P_{22}")
    r.says("then the update:")
    r.math(r"K_1 = \frac{P_{11}^-}{P_{11}^- + R}, \qquad K_2 = \frac{P_{12}^-}{P_{11}^- + R}, \qquad \hat{\dot y}{}^+ = \hat{\dot y}{}^- + K_2(z - \hat y^-), \qquad \hat y^+ = \hat y^- + K_1(z - \hat y^-)")
    r.math(r"P_{11}^+ = RK_1, \qquad P_{12}^+ = RK_2, \qquad P_{22}^+ = P_{22}^- - K_2P_{12}^-")
    r.says("**What the computation consists of.** Neither $P$ nor $K$ depends on the data: $K_2(t_i)$ is a table computed before any measurement. With the data only the two lines of the estimates remain, six multiplications per measurement. Without process noise there is also a formula for all measurements at once: with $h_j = [\\cos jd, \\; \\sin jd]$ and $G_i = \\sum_{j \\le i} h_j^Th_j$ the initial state has after $i$ measurements the covariance")
    r.math(r"\mathcal P_i = \frac{R\,[R\,P_0 + |P_0|\,\text{adj}\,G_i]}{R^2 + R\,\text{tr}\,P_0G_i + |P_0|\,|G_i|}, \qquad |G_i| = \sum_{m=1}^{i-1}(i-m)\sin^2md, \qquad P(t_i^+) = \Phi^i\,\mathcal P_i\,\Phi^{iT}")
    at = list(range(1, p.steps + 1))
    # The recursion knows P⁻ up to rounding of P0, and K divides by an innovation variance as small as R.
    known = max(1.0, 1e-8 * float(np.trace(p.P0)) / p.R) if p.R else 1.0
    for name, system in (("bad", bad), ("good", good)):
        schedule = covariances(system, p.steps)
        K, P_minus = schedule.K[1:, :, 0], schedule.P_minus[1:]
        r.value(f"gain_{name}", K, at=at)
        r.check(text("covariances, dt = {dt} s", dt=system.dt), schedule.P_plus[1:], by_hand.posterior(p.P0, p.R, system.dt, p.steps), ("recursion", "all measurements at once"))
        r.check(text("P⁺ = (I − KH)P⁻, dt = {dt} s", dt=system.dt), schedule.P_plus[1:], P_minus - K[:, :, None] * P_minus[:, :1], ("Joseph form", "short form"), scale=max(np.abs(P_minus).max(), 1e-300))
        if p.R:
            r.check(text("gains, dt = {dt} s", dt=system.dt), K, by_hand.gains(p.P0, p.R, system.dt, p.steps), ("recursion", "all measurements at once"), SOLVER, scale=known)
            some = experiment.histories(system, steps=p.steps)
            whole = by_hand.all_at_once(some.z[1:, 0], p.P0, p.R, system.dt)
            r.check(text("estimates of 25 records, dt = {dt} s", dt=system.dt), some.x_plus[-1], whole, ("filter", "all measurements at once"), SOLVER, scale=known * max(np.abs(whole).max(), 1.0))


def part_b(r, p, answer, bad, good):
    """Why 2π is bad, from the inverse covariance."""
    r.section("b", "Why 2π is a bad period")
    r.says("**From the inverse of the covariance.** Without process noise the prediction only turns it, and the update adds to it:")
    r.math(r"P^{-1}(t_i^-) = \Phi^{-T}P^{-1}(t_{i-1}^+)\Phi^{-1}, \qquad P^{-1}(t_i^+) = P^{-1}(t_i^-) + \frac1R\begin{bmatrix} 1 & 0 \\ 0 & 0 \end{bmatrix}")
    r.says("At $d = 2\\pi$ (and at any $d = k\\pi$) $\\Phi = \\pm I$ turns nothing, so only the (1,1) element grows:")
    r.math(r"P^{-1}(t_N^+) = P_0^{-1} + \frac NR\begin{bmatrix} 1 & 0 \\ 0 & 0 \end{bmatrix} \quad\Rightarrow\quad P_{11} = \frac{RP_{11}(0)}{R + NP_{11}(0)}, \quad P_{12} = \frac{RP_{12}(0)}{R + NP_{11}(0)}, \quad P_{22} = P_{22}(0) - \frac{NP_{12}^2(0)}{R + NP_{11}(0)}")
    (a, b), (_b, c) = p.P0
    r.says("(the right-hand formulas hold for a singular $P_0$ too). With the given numbers $P_{11} = {top}/({R} + {a}N)$, $P_{12} = {mid}/({R} + {a}N)$ and $P_{22} = {c} - {square} \\cdot N/({R} + {a}N)$. The position's variance tends to zero; that of the velocity stays above",
           top=p.R * a, mid=p.R * b, R=p.R, a=a, c=c, square=b * b)
    r.math(r"\lim_{N\to\infty} P_{22} = P_{22}(0) - \frac{P_{12}^2(0)}{P_{11}(0)} = {floor} \; \text{m}^2/\text{s}^2,", floor=by_hand.conditional(p.P0))
    r.says("the variance of $\\dot y(0)$ once $y(0)$ is known: the measurements tell of the velocity only what the initial correlation lets them. ∎",
           " (Here the position is known from the start, and the velocity keeps its variance.)" if not a else "")
    at, routes = list(range(1, p.steps + 1)), ("recursion", "all measurements at once")
    few, many = covariances(bad, p.steps).P_plus[1:], covariances(good, p.steps).P_plus[1:]
    r.table("variances", ["N", "P11 at dt_bad, m²", "P12 at dt_bad, m²/s", "P22 at dt_bad, m²/s²", "P22 at dt_good, m²/s²"],
            [(i, P[0, 0], P[0, 1], P[1, 1], other[1, 1]) for i, P, other in zip(at, few, many, strict=True)],
            "Filtering covariance with measurements every {bad} s and every {good} s.", bad=p.dt_bad, good=p.dt_good)
    r.value("position_variance_bad", few[:, 0, 0], "m²", at=at, agrees=answer, routes=routes)
    r.value("velocity_variance_bad", few[:, 1, 1], "m²/s²", at=at, agrees=answer, routes=routes)
    r.value("velocity_variance_good", many[:, 1, 1], "m²/s²", at=at, agrees=answer, routes=routes)
    lost = answer["observability_rank_bad"] == 1
    left = update(p.P0, bad.H, [[0.0]]).P_plus[1, 1] if lost else steady.solve(bad).P_plus[1, 1]
    r.value("velocity_variance_floor", left, "m²/s²", agrees=answer, routes=("perfect measurement of y(0)" if lost else "steady state", "limit of the formula"))
    if p.R and np.linalg.cond(np.array(p.P0)) < 1e6:
        r.check("P⁻¹ at dt_bad", np.linalg.inv(few), by_hand.inverse(p.P0, p.R, p.dt_bad, p.steps), ("recursion, inverted", "sum of information"))
    settled = answer["velocity_settling_step_bad"]
    found = settling_step(covariances(bad, max(settled, 2) + 1).P_plus[1:, 1, 1:], [left]) if settled and settled < 1e4 else None
    r.value("velocity_settling_step_bad", settled if found is None else found + 1,
            reason="" if settled else "ẏ is observable, or determined by y: its variance tends to 0 and never stays within 1 % of that")
    if found is not None:
        r.check("settling of the velocity", found + 1, settled, ("recursion", "closed form"))
    if not lost:
        r.says("**The given** dt_bad = {dt} s **is no such period**: there $\\sin d = {sine}$ and the turn brings the velocity into view, so that its variance tends to 0, not to the value above.", dt=p.dt_bad, sine=math.sin(p.dt_bad))


def sampling(r, p, answer):
    """Why 2π is bad, from observability; the general rule."""
    losses = {name: observability.loss_by_sampling(model(p), dt) for name, dt in (("bad", p.dt_bad), ("good", p.dt_good))}
    r.says("**From observability.** Two measurements determine the state when the matrix")
    r.math(r"\begin{bmatrix} H \\ H\Phi \end{bmatrix} = \begin{bmatrix} 1 & 0 \\ \cos d & \sin d \end{bmatrix}, \qquad \det = \sin d")
    r.says("is regular. Hence the pair (Φ, H) is not observable exactly when $d = k\\pi$: not only 2π but π, too, is a bad period, as $\\Phi = -I$ shows the position again, with the other sign. The component that is lost is the velocity $\\dot y$, the direction $[0, 1]^T$; continuous measurement would see both (rank {rank}).", rank=losses["bad"].rank_continuous)
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
    r.says("**Stroboscopic** is the word for it (the sheet prints “stereoscopic”): a flash lamp that fires once per revolution shows a wheel at rest. Here every measurement finds the oscillator in the same phase, at $d = 2\\pi$ after a full cycle, at $d = \\pi$ in its mirror image; it has moved in between, but nothing shows how fast.")
    r.says("**In general** a model that is observable with continuous measurements stays so with samples every $d$ unless two of its eigenvalues come together in $e^{\\lambda d}$, that is unless")
    r.math(r"\text{Re}\,\lambda_i = \text{Re}\,\lambda_j \quad\text{and}\quad \text{Im}(\lambda_i - \lambda_j) = \frac{2\pi k}{d}, \qquad k = \pm1, \pm2, \dots")
    r.says("With a single measurement two modes that have come together cannot be told apart; several measurements may still do it. Real or differently damped eigenvalues never meet. To be safe it is enough that $d < 2\\pi/\\max|\\text{Im}(\\lambda_i - \\lambda_j)|$. Here $\\lambda = \\pm i$, the difference is $2i$, the bad periods are $d = k\\pi$, and more than two measurements per cycle are safe. The same condition preserves controllability by inputs that are held between the samples.")
    for name, loss in losses.items():
        nearest = loss.losing_periods[0]
        if loss.lost:
            r.says("{name} = {dt} s meets it: the eigenvalues −i and i come together in {value}, and the rank falls to {rank}.", name=f"dt_{name}", dt=loss.dt,
                   value=round(math.cos(loss.dt)), rank=loss.rank)
        else:
            r.says("{name} = {dt} s does not: the nearest losing period is {nearest} s, {percent} % away, and the rank is {rank}. The smallest singular value of [H; HΦ] is {condition} of the largest ({verdict}).", name=f"dt_{name}", dt=loss.dt,
                   nearest=nearest, percent=100 * loss.distance, rank=loss.rank, condition=by_hand.reciprocal_condition(loss.dt), verdict=quality(loss.dt))
    r.check("nearest losing periods", [loss.losing_periods[0] for loss in losses.values()], [math.pi * max(1, round(loss.dt / math.pi)) for loss in losses.values()],
            ("differences of eigenvalues", "zeros of sin d"))


def quality(dt):
    """A reciprocal condition number in words: 1 at best, at π/2."""
    condition = by_hand.reciprocal_condition(dt)
    if not condition:
        return "lost"
    return "well conditioned" if condition > 0.3 else "fair" if condition > 0.1 else "ill conditioned"


def near(r, p):
    """Near a loss: as a number."""
    r.says("**Near a loss** the rank is 2, and says nothing of how good the observation is. With $d = k\\pi + \\varepsilon$ the measurements show $\\pm[y + j\\varepsilon\\,\\dot y]$, a straight line whose slope must be found: for small $N\\varepsilon$")
    r.math(r"|G_N| = \sum_{m=1}^{N-1}(N-m)\sin^2m\varepsilon \approx \frac{\varepsilon^2N^2(N^2-1)}{12}, \qquad \text{information on } \dot y \approx \frac{\varepsilon^2N^3}{12R}")
    N = max(p.steps, 2)
    dets = [float(np.linalg.det(observability.gramian(discretise(model(p), 2 * math.pi + 0.1 / N / 2**j, R=[[1.0]]), N))) for j in range(3)]
    r.order("determinant of the Gramian as ε → 0", dets, 2, ("Gramian", "leading term"))
    floor = by_hand.conditional(p.P0)
    periods = {"dt_bad": p.dt_bad, "dt_good": p.dt_good, "π/2": math.pi / 2, "π": math.pi, "2π": 2 * math.pi}
    periods |= {f"2π + {share} %": 2 * math.pi * (1 + share / 100) for share in (3, 1, 0.1, 0.01)}
    rows = []
    for name, dt in periods.items():
        loss, schedule = observability.loss_by_sampling(model(p), dt), covariances(sampled(p, dt), max(SEARCHED, p.steps))
        below = np.flatnonzero(schedule.P_plus[1:, 1, 1] <= 0.5 * floor) if floor else []
        rows.append((name, dt, loss.rank, 100 * loss.distance, by_hand.reciprocal_condition(dt), quality(dt), schedule.P_plus[p.steps, 1, 1], int(below[0]) + 1 if len(below) else None))
    r.table("periods", ["period", "d, s", "rank", "from a losing period, %", "σ_min/σ_max of [H; HΦ]", "in words", text("P22 after {n}, m²/s²", n=p.steps), "measurements to halve the floor"], rows,
            "Rank against quality (in words: above 0.3 well conditioned, above 0.1 fair). The last column is the number of measurements until P22 is at most half of {floor} m²/s², the floor at d = kπ (— : not within {most}).", floor=floor, most=max(SEARCHED, p.steps))
    grid = np.union1d(np.linspace(0.05, 2.1 * math.pi, 120), [math.pi, 2 * math.pi])
    n = min(p.steps, 20)
    found = [covariances(sampled(p, dt), n).P_plus[n, 1, 1] for dt in grid]
    r.check(text("P22 after {n} measurements against the period", n=n), found, [by_hand.posterior(p.P0, p.R, dt, n)[-1, 1, 1] for dt in grid], ("recursion", "all measurements at once"))
    marks = {f"{name} = {dt:.5g} s": ([dt % (2 * math.pi) or dt], [by_hand.posterior(p.P0, p.R, dt, n)[-1, 1, 1]]) for name, dt in (("dt_bad", p.dt_bad), ("dt_good", p.dt_good))}
    figure = plots.lines(
        grid, {text("after {n} measurements", n=n): found}, xlabel="sampling period d, s", ylabel="variance of ẏ, m²/s²",
        points=marks, straight={"floor at d = kπ": ([grid[0], grid[-1]], [floor, floor])}, ylim=(0.0, 1.1 * max(*found, floor) or 1.0),
    )
    r.figure("periods", figure, "Variance of the velocity after {n} measurements against the sampling period (the points: the given periods, less full cycles). At π and 2π it stays at the floor, however many measurements there are; with more of them the peaks become narrower, not lower.", n=n)


def plan(r, p, experiment):
    """Every number chosen."""
    steps = max(p.steps, SIMULATED)
    r.says("Part (c) simulates three periods with the same initial states and measurement errors: both given ones, and one 1.2 % above the losing period nearest to dt_bad, where the rank is full but the condition bad. Each ensemble is compared with the covariances of (a).")
    r.table("plan", ["quantity", "value", "why"], [
        ["periods, s", [p.dt_bad, nearby(p), p.dt_good], "bad, nearly bad, good"],
        ["measurements", steps, "enough to see the floor of the velocity's variance"],
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
    systems = {"dt_bad": bad, "1.2 % off a loss": close, "dt_good": good}
    schedules = {name: covariances(system, steps) for name, system in systems.items()}
    floors = [by_hand.conditional(p.P0) if by_hand.loses(system.dt) else 0.0 for system in systems.values()]
    titles = {text("{name}: {dt} s", name=name, dt=systems[name].dt): replace(s, t=np.arange(steps + 1.0)) for name, s in schedules.items()}
    r.figure("velocity", plots.sawtooth(titles, xlabel=STEP, ylabel="variance of ẏ, m²/s²", state=1, limits=[(x, x) for x in floors]),
             "Variance of the velocity before and after each measurement at the three periods. Dotted: its limit.")
    ensembles = {"dt_bad": portrait(r, experiment, bad, steps, prefix="bad_", xlabel=TIME, state=1, limits=(floors[0], floors[0]))}
    ensembles["dt_good"] = portrait(r, experiment, good, steps, prefix="good_", xlabel=TIME, state=1, limits=(floors[2], floors[2]))
    ensembles["1.2 % off a loss"] = experiment.statistics(close, steps=steps)
    agreement(r, "1.2 % off a loss", ensembles["1.2 % off a loss"], schedules["1.2 % off a loss"].P_plus)
    rows = []
    for name, system in systems.items():
        stats, sd = ensembles[name], schedules[name].sd_plus
        rows.append((name, system.dt, quality(system.dt), sd[-1, 0], stats.rms[-1, 0], sd[-1, 1], stats.rms[-1, 1], stats.bias[-1, 1], known(stats.nees[-1]), known(stats.nis[-1])))
    r.table("ensemble", ["period", "d, s", "condition", "σ of y, m", "RMS of y, m", "σ of ẏ, m/s", "RMS of ẏ, m/s", "mean error of ẏ, m/s", "NEES", "NIS"], rows,
            "The three periods after {steps} measurements: theory (σ) and ensemble. NEES is 2 in theory (1 where one combination of the states is known exactly), NIS 1.", steps=steps)
    r.value("rms_velocity", [float(row[6]) for row in rows], "m/s")
    r.says("After {steps} measurements the velocity's RMS error is {bad} m/s at dt_bad, {close} m/s at 1.2 % off a loss and {good} m/s at dt_good; that of the position {ybad}, {yclose} and {ygood} m.", steps=steps,
           bad=rows[0][6], close=rows[1][6], good=rows[2][6], ybad=rows[0][4], yclose=rows[1][4], ygood=rows[2][4])


def known(x):
    """A number, or None for one that does not exist."""
    return None if math.isnan(x) else x


def conclusions(r, p, answer):
    """What the numbers say."""
    lines, floor, prior = [], by_hand.conditional(p.P0), p.P0[1][1]
    if not any(map(any, p.P0)):
        lines.append("The state is known from the start (P0 = 0): whatever the period, the gains are 0 and all variances stay 0.")
    for name, dt in (("dt_bad", p.dt_bad), ("dt_good", p.dt_good)):
        last = answer["velocity_variance_bad" if name == "dt_bad" else "velocity_variance_good"][-1]
        if not by_hand.loses(dt):
            line = "{name} = {dt} s keeps the oscillator observable (rank 2, {quality}: σ_min/σ_max = {condition}; {offset} s from a multiple of π). The velocity's variance tends to 0; after {steps} measurements it is {last} m²/s², from {prior} at the start."
        elif floor == 0 and prior > 0:
            line = "{name} = {dt} s loses the velocity (rank 1), but P0 is singular and ties it to the position, so its variance tends to 0 all the same: after {steps} measurements it is {last} m²/s², from {prior} at the start."
        elif floor < prior:
            line = "{name} = {dt} s loses the velocity (rank 1): only the position is seen. Its variance falls from {prior} towards {floor} m²/s², which the initial correlation allows, and no number of measurements goes below; after {steps} it is {last}."
        elif prior:
            line = "{name} = {dt} s loses the velocity (rank 1): without an initial correlation with the position its variance stays at {prior} m²/s² for ever."
        else:
            line = "{name} = {dt} s loses the velocity (rank 1), which does no harm here: it is known from the start."
        lines.append(text(line, name=name, dt=dt, quality=quality(dt), condition=by_hand.reciprocal_condition(dt), offset=by_hand.offset(dt), steps=p.steps, last=last, prior=prior, floor=floor))
    if p.dt_bad == p.dt_good:
        lines.append("Both periods are the same.")
    elif by_hand.loses(p.dt_bad) != by_hand.loses(p.dt_good):
        lines.append(text("Of the given periods {name} is the bad one.", name="dt_bad" if by_hand.loses(p.dt_bad) else "dt_good"))
    else:
        lines.append("Both given periods are bad ones." if by_hand.loses(p.dt_bad) else "Neither of the given periods is a bad one in the strict sense.")
    lines.append("A period near a bad one keeps the rank but not the quality: the number of measurements needed grows like ε^(−2/3) with the offset ε. The condition number, not the rank, should be asked.")
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(part_a, part_b, sampling, near),
    plan=plan,
    experiment=(part_c,),
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
