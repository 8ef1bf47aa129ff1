"""Lab 12, part (c): both readings of the sine, extended filters and the exact posterior."""

import math

import numpy as np

from ctlabs.filtering import pointmass, relinearised, updates
from ctlabs.labs.portrait import mean_error
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT
from ctlabs.text import Uncertain, text

#: Sensor of z1 and variance of v1.
H1, R1 = 2.0, 1.0
#: Points of the exact filter's grid, at most.
POINTS = 4000
#: Prior variances of the experiment with the literal reading, in P⁻.
LEVELS = (0.1, 1.0, 10.0)
#: Standard errors from which a difference of two ensembles is called one in the words of the report.
CLEAR = 5.0
ESTIMATE = "x (a pure number)"


def second(t):
    """Sensor and noise of z2 in the linear reading at time t: sin t and cos²t; a cosine at rounding level is zero."""
    sine, cosine = np.sin(t), np.cos(t)
    return sine, np.where(np.abs(cosine) <= 1e-15 * np.maximum(1.0, np.abs(t)), 0.0, cosine) ** 2


def sensor(x):
    """The literal reading."""
    return np.array([H1 * x[0], np.sin(x[0])])


def slope(x):
    """Its derivative."""
    return np.array([np.full_like(x[0], H1), np.cos(x[0])])[:, None]


def part_c(r, p, answer):
    """Sequential and simultaneous, both readings."""
    r.section("c", "Sequential and simultaneous updates agree")
    r.says("**Thinking first.** With independent noises the likelihood is a product, so that")
    r.math(r"p(x \mid Z_{i-1}, z_1, z_2) \propto p(x \mid Z_{i-1})\,p(z_1 \mid x)\,p(z_2 \mid x)", "product")
    r.says("and it does not matter whether the factors are multiplied at once or one after another. For linear sensors all factors are Gaussian; for positive variances exponents add up: $1/P^+ = 1/P^- + h_1^2/R_1 + h_2^2/R_2$.")
    r.says("**Explicitly**, also for $R_2 = 0$. With $P = P(t_i^-)$, $\\nu_j = z_j - h_j\\hat{x}(t_i^-)$, after $z_1$:")
    r.math(r"P_1 = \frac{PR_1}{R_1 + h_1^2P}, \qquad \hat x_1 = \hat x^- + \frac{Ph_1}{R_1 + h_1^2P}\,\nu_1")
    r.says("Then $z_2$ with $P_1$, $\\hat{x}_1$ and the innovation $z_2 - h_2\\hat{x}_1$; clearing fractions,")
    r.math(r"P^+ = \frac{P_1R_2}{R_2 + h_2^2P_1} = \frac{PR_1R_2}{\Delta}, \qquad \hat x^+ = \hat x^- + \frac P\Delta\,(h_1R_2\nu_1 + h_2R_1\nu_2), \qquad \Delta = R_1R_2 + P(h_1^2R_2 + h_2^2R_1)", "sequential")
    r.says("Simultaneously, Δ is the determinant of $S = HPH^T + R$ and Cramer's rule gives")
    r.math(r"K = PH^TS^{-1} = \frac P\Delta\begin{bmatrix} h_1 & h_2 \end{bmatrix}\begin{bmatrix} h_2^2P + R_2 & -h_1h_2P \\ -h_1h_2P & h_1^2P + R_1 \end{bmatrix} = \frac P\Delta\begin{bmatrix} h_1R_2 & h_2R_1 \end{bmatrix}, \qquad P^+ = (1 - KH)P = \frac{PR_1R_2}\Delta", "joint")
    r.says("These are the same expressions. They are symmetric in the two measurements, so the order does not matter either. ∎")
    prior, R2 = answer["prior"], float(second(p.t)[1])
    R = np.diag([R1, R2])
    x, P, z = [prior[0]], [[prior[1]]], [p.z1, p.z2]
    first = updates.joint(x, P, z[:1], [[H1]], [[R1]])
    r.value("after_z1", pair(first), agrees=answer, routes=("filter", "formula"), kind=EXACT)
    H = np.array([[H1], [float(second(p.t)[0])]])
    r.says("**First reading.** The printed $\\sin x(t_i)$ is most probably $(\\sin t_i)\\,x(t_i)$: the sheet gives the variance as a function of time too, $\\cos^2t_i$, and asks for exact agreement, which needs a linear sensor. At $t = {t}$ s $h = (2, {h2})$ and $R = \\mathrm{diag}(1, {R2})$.", t=p.t, h2=H[1, 0], R2=R2)
    if R2 == 0:
        r.says("Here $\\cos t = 0$ (at the rounding of $t$): $z_2$ is a perfect measurement, and both ways end with the variance 0.")
    routes = ("updates by the filter", "closed form, P·R1·R2/Δ")
    one, other = updates.sequential(x, P, z, H, R), updates.joint(x, P, z, H, R)
    r.value("linear_sequential", pair(one), agrees=answer, routes=("one after another", routes[1]))
    r.value("linear_joint", pair(other), agrees=answer, routes=("both at once", routes[1]))
    r.check("linear: sequential = joint", pair(one), pair(other), ("one after another", "both at once"))
    r.check("linear: z2 first", pair(updates.sequential(x, P, z[::-1], H[::-1], R[::-1, ::-1])), pair(other), ("one after another, z2 first", "both at once"))
    extended(r, p, answer, x, P, z, R)


def pair(estimate):
    """[estimate, variance]."""
    return [float(estimate.x[0]), float(estimate.P[0, 0])]


def extended(r, p, answer, x, P, z, R):
    """The literal reading, with the exact posterior as the judge."""
    r.says("**Second reading, literally** ({ref:jazwinski, chapter 8}) $z_2 = \\sin(x(t_i)) + v_2$. The extended filter replaces the sine by a straight line, $\\sin x \\approx \\sin\\xi + \\cos\\xi\\,(x - \\xi)$. For one straight line the proof above holds, so sequential and simultaneous agree **if the point ξ is the same**, $\\xi = \\hat{x}^-$; the second innovation is then $z_2 - \\sin\\hat{x}^- - \\cos\\hat{x}^-(\\hat{x}_1 - \\hat{x}^-)$. The ordinary sequential filter takes the newest estimate, $\\xi = \\hat{x}_1$, which is another line and gives another result.")
    found = {order: relinearised.extended(x, P, z, sensor, slope_at, R, order) for order in relinearised.ORDERS}
    r.value("ekf_joint", pair(found["joint"]), agrees=answer, routes=("both at once", "closed form, P·R1·R2/Δ"))
    r.value("ekf_sequential_fixed", pair(found["fixed"]), agrees=answer, routes=("one after another, line at x̂⁻", "closed form, P·R1·R2/Δ"))
    r.check("extended: sequential with a fixed line = joint", pair(found["fixed"]), pair(found["joint"]), ("one after another", "both at once"))
    r.value("ekf_sequential_relinearised", pair(found["relinearised"]), agrees=answer, routes=("one after another, line at x̂1", "two scalar updates by hand"))
    reverse = relinearised.extended(x, P, z[::-1], lambda y: sensor(y)[::-1], lambda y: slope_at(y)[::-1], R[::-1, ::-1], "relinearised")
    judge = exact(answer["after_z1"], p.z2, R[1, 1])
    r.value("exact_posterior", judge)
    # A variance far below the square of the mean is the difference of two moments in the second route, and has their rounding.
    r.check("exact posterior", judge, answer["exact_posterior"],
            ("Gauss–Legendre panels" if not perfect(p.z2, R[1, 1]) else "weights of the roots of sin x = z2", "double exponential quadrature"),
            scale=[abs(judge[0]), max(judge[1], 1e-6 * judge[0] ** 2)])
    r.says("The judge is the exact posterior, $p(x) \\propto N(x; \\hat{x}_1, P_1)\\exp[-(z_2 - \\sin x)^2/(2R_2)]$ by quadrature: $z_1$ enters exactly, as its sensor is linear.")
    if perfect(p.z2, R[1, 1]):
        r.says("With $R_2 = {R2}$ it is discrete: the posterior sits on the solutions of $\\sin x = z_2$, each with the weight of $N(x; \\hat{x}_1, P_1)$ there (the slope $|\\cos x|$ is the same at all of them; where $|z_2| > 1$, the points nearest to a solution). An extended filter claims certainty about one point of its straight line.", R2=R[1, 1])
    rows = [
        ("after $z_1$", *answer["after_z1"]), ("extended, both at once (or one after another, fixed line)", *pair(found["joint"])),
        ("extended, $z_1$ then $z_2$ relinearised", *pair(found["relinearised"])), ("extended, $z_2$ then $z_1$ (which is linear, so that the line is at $\\hat x^-$ again)", *pair(reverse)), ("exact posterior", *judge),
    ]
    sd = math.sqrt(judge[1])
    r.table("readings", ["literal reading", "estimate", "variance", "distance from the exact mean, in exact σ"],
            [(*row, abs(row[1] - judge[0]) / sd if sd > 1e-9 else None) for row in rows], "The literal reading: what each way of updating gives.")
    r.says("{tab:readings} has the results of all ways.")
    densities(r, answer, found, p.z2, R[1, 1])


def slope_at(x):
    """∂h/∂x (2, 1) at one point."""
    return np.array([[H1], [math.cos(x[0])]])


def solutions(m, P, z2):
    """Where sin x = z2 (or comes nearest to it) around m."""
    angle, reach = math.asin(max(-1.0, min(1.0, z2))), 12 * math.sqrt(P) + 2 * math.pi
    k = np.arange(-2, 3 + 2 * int(reach)) - int(reach) + round(m / (2 * math.pi))
    points = np.unique(np.concatenate([angle + 2 * math.pi * k, math.pi - angle + 2 * math.pi * k]).round(14))
    return points[np.abs(points - m) <= reach], (m - reach, m + reach)


def perfect(z2, R2):
    """Whether √R2 is so small that only the solutions of sin x = z2 count; near |z2| = 1 peaks are wider, ∝ R2^(1/4)."""
    return math.sqrt(R2) <= max(1e-10, 1e-7 * (1 - z2**2))


def exact(first, z2, R2):
    """The exact posterior [mean, variance] after z1 and z2."""
    m, P = first
    if P == 0:
        return [m, 0.0]
    points, (low, high) = solutions(m, P, z2)
    if not perfect(z2, R2):
        return pair(pointmass.posterior_by_quadrature(lambda x: log_posterior(x, m, P, z2, R2), [m, *points], low, high))
    logs = -0.5 * (points - m) ** 2 / P
    weights = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    mean = float(weights @ points)
    return [mean, float(weights @ (points - mean) ** 2)]


def log_posterior(x, m, P, z2, R2):
    """log p(x | z1, z2) + constant; sin r − sin x, r the nearest solution, is written so that it keeps its digits."""
    points, _ends = solutions(m, P, z2)
    middle = 0.5 * (points[1:] + points[:-1])
    near = points[np.searchsorted(middle, x)]
    rest, beyond = -2 * np.cos(0.5 * (near + x)) * np.sin(0.5 * (x - near)), z2 - np.clip(z2, -1, 1)
    return -0.5 * (x - m) ** 2 / P - 0.5 * rest * (rest + 2 * beyond) / R2


def densities(r, answer, found, z2, R2):
    """Prior, what z1 leaves, the exact posterior, and what the extended filters believe."""
    (x, P), (m, P1) = answer["prior"], answer["after_z1"]
    if P == 0 or R2 <= 1e-4:
        return
    half = 3.5 * math.sqrt(P)
    grid = np.linspace(min(m - half, x - half), max(m + half, x + half), 1201)

    def normal(mean, variance):
        return np.exp(-0.5 * (grid - mean) ** 2 / variance) / math.sqrt(2 * math.pi * variance)

    judge = np.exp(log_posterior(grid, m, P1, z2, R2))
    curves = {
        "before": normal(x, P), "after $z_1$": normal(m, P1), "exact posterior": judge / (judge.sum() * (grid[1] - grid[0])),
        "both at once": normal(*pair(found["joint"])), "$z_1$, then $z_2$ relinearised": normal(*pair(found["relinearised"])),
    }
    r.figure("densities", plots.lines(grid, curves, xlabel=ESTIMATE, ylabel="probability density"),
             "The literal reading: densities of $x$ before and after the measurements.")
    r.says("The exact posterior of {fig:densities} is not normal. Each extended filter replaces it by a normal density, whose centre and width come from its straight line.")


def one_update(x, P, R2):
    """The literal reading: a single update at t0 from N(x, P); the step that follows is not measured."""
    R = np.stack([np.diag([R1, R2]), np.diag([np.inf, np.inf])])
    return NonlinearModel(f=lambda _k, x, w: x + w, h=lambda _k, x, v: sensor(x) + v, F=lambda _k, _x: np.ones((1, 1)),
                          H=lambda _k, x: slope(x), Qd=[[P]], R=R, x0=[x], P0=[[P]])


def literal(r, p, answer, experiment):
    """The literal reading in an ensemble."""
    r.says("**The literal reading**, one update from $N(\\hat{x}^-, P^-)$. The extended filters are not linear and their errors not Gaussian, so nothing exact is known of their mean squares: these are given with standard errors from fourth moments. Exactly known is the distribution of the innovations: put through the predicted distribution of the exact filter and the normal quantile they are independent N(0, 1), which the ensemble is tested against.")
    x, P = answer["prior"]
    R2 = float(second(p.t)[1])
    if P == 0:
        r.says("With $P^- = 0$ the state is known and no measurement changes anything.")
        return
    rows = []
    for level in LEVELS:
        system = one_update(x, level * P, R2)
        grid = points(x, level * P, R2)
        designs = {"both at once": system, "$z_1$, then $z_2$ relinearised": lambda s=system: relinearised.SequentialExtended(s)}
        if grid is not None:
            designs["exact posterior mean"] = lambda s=system, g=grid: pointmass.PointMass(s, g)
        first = level * P / (1 + H1**2 * level * P)
        for name, design in designs.items():
            stats = experiment.statistics(system, design, steps=1, first=0, stream=1)
            if name == "exact posterior mean":
                r.chance(text("Gaussianised innovations, P⁻ = {P}", P=level * P), chance.nis(stats), ("ensemble", "exact distribution of Bayes' rule"))
            rows.append((level * P, name, Uncertain(float(stats.rms[0, 0]), float(stats.rms_se[0, 0])), mean_error(stats, 0), float(stats.nees[0]) if stats.nees_dof[0] else None, math.sqrt(first)))
    r.table("literal", ["$P^-$", "filter", "RMS error", "mean error", "NEES", "σ after $z_1$ alone"], rows,
            "The literal reading at $t = {t}$ s: errors over {runs} runs on the same data, with standard errors. NEES is 1 for a filter whose variance is right on average; a dash where it claims to be certain.", t=p.t, runs=experiment.runs)
    if len(rows) < 3 * len(LEVELS):
        r.says("Where $\\sqrt{R_2}$ is too narrow for a grid of {count} points the exact filter is left out; its posterior sits near the solutions of $\\sin x = z_2$.", count=POINTS)
    r.says("{tab:literal} compares the ways for three prior variances; a difference counts as clear if it exceeds {clear:2} standard errors.", clear=CLEAR)
    r.items([compared([row for row in rows if row[0] == level * P]) for level in LEVELS])


def points(x, P, R2):
    """A grid for the exact filter, or None where it would be too fine."""
    width = min(math.sqrt(R2), math.sqrt(P / (1 + H1**2 * P)))
    count = math.ceil(18 * math.sqrt(P) / (0.5 * width)) + 1 if width else POINTS + 1
    return np.linspace(x - 9 * math.sqrt(P), x + 9 * math.sqrt(P), max(count, 3)) if count <= POINTS else None


def compared(rows):
    """A sentence on the mean squares for one prior variance."""
    (_joint, again), P = rows[:2], rows[0][0]
    gap = _joint[2].value - again[2].value
    clear = abs(gap) > CLEAR * math.hypot(_joint[2].error, again[2].error)
    words = "relinearising is clearly better" if clear and gap > 0 else "relinearising is clearly worse" if clear else "the two extended filters do not differ clearly"
    line = "For $P^- = {P}$ {words} (RMS {again} against {joint})"
    return text(line, "; the exact mean has {best}." if len(rows) > 2 else ".", P=P, words=words, again=again[2], joint=_joint[2], best=rows[-1][2])
