"""Lab 5, parts (a) to (e): the pseudo-measurements, their covariance and its decorrelation."""

import math

import numpy as np
from ctlabs.tasks._task05_model import SIMULATED
from ctlabs.tasks.answers import task05 as by_hand
from ctlabs.tasks.answers.task05 import LISTED

from ctlabs.analysis import sensitivity
from ctlabs.filtering import kalman_filter, settling, updates
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, rms
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.report import EXACT
from ctlabs.text import Uncertain

#: A correlation coefficient of e_x and e_y below this is rounding of θ.
ROUNDING = 1e-12


def correlation(R):
    """The correlation coefficient of e_x and e_y."""
    return float(R[0, 1] / math.sqrt(R[0, 0] * R[1, 1]))


def part_a(r, p):
    """First-order errors."""
    r.says("**Errors of the pseudo-measurements.** $z_x = D_m\\cos\\theta_m$, $z_y = D_m\\sin\\theta_m$ with $D_m = D + e_D$, $\\theta_m = \\theta + e_\\theta$. To first order in the small errors")
    r.math(r"e_x = \cos\theta\,e_D - D\sin\theta\,e_\theta, \qquad e_y = \sin\theta\,e_D + D\cos\theta\,e_\theta", "errors")
    r.says("The sheet calls $e_x$, $e_y$ independent. They are not, except where $R_{12} = 0$ in (b), for they are made of the same two errors; it is $e_D$ and $e_\\theta$ that are independent.")
    exact, linear, c, s = [], [], math.cos(p.theta), math.sin(p.theta)
    sizes = 0.1 * 0.5 ** np.arange(5)
    for e in sizes:  # e_D = eD and e_θ = e, in units of D
        exact.append([(1 + e) * math.cos(p.theta + e) - c, (1 + e) * math.sin(p.theta + e) - s])
        linear.append([c * e - s * e, s * e + c * e])
    r.order("what the first order leaves out is of the second", list(np.linalg.norm(np.subtract(exact, linear), axis=1)), 2.0, ("exact conversion", "first order"))
    bias, index = p.D * p.sigma_theta**2 / 2, p.D * p.sigma_theta**2 / 2 / p.sigma_D
    r.says("The largest term left out shortens the radius by $D\\sigma_\\theta^2/2 = {bias}$ m on average, which is {index:2} times $\\sigma_D$: the first order is {quality} here.",
           bias=bias, index=index, quality="good" if index < 0.1 else "doubtful" if index < 0.5 else "not good enough")


def part_b(r, p, answer, truth):
    """Covariance of the pseudo-measurements."""
    r.section("b", "Covariance of the pseudo-measurements")
    r.math(r"R_{11} = \sigma_D^2\cos^2\theta + D^2\sigma_\theta^2\sin^2\theta, \qquad R_{22} = \sigma_D^2\sin^2\theta + D^2\sigma_\theta^2\cos^2\theta, \qquad R_{12} = \sin\theta\cos\theta\,(\sigma_D^2 - D^2\sigma_\theta^2)", "covariance")
    r.says("$R_{12} = 0$ on the axes, and where the errors across and along the radius are equal, $D\\sigma_\\theta = \\sigma_D$; here they are {across} m and {along} m. The filter takes D and θ from its prediction, as the true ones are not known.", across=p.D * p.sigma_theta, along=p.sigma_D)
    size = float(np.trace(truth.R))
    routes = ("Jacobian of the conversion", "element by element")
    r.value("pseudo_measurement_covariance", truth.R, "m²")
    r.check("pseudo-measurement covariance", truth.R, answer["pseudo_measurement_covariance"], routes, EXACT, scale=size)
    r.value("correlation_coefficient", correlation(truth.R))
    r.value("verdict_b_independent", bool(abs(correlation(truth.R)) <= ROUNDING))
    rows = [0.2 * 0.5**j for j in range(4)]
    gaps = [np.linalg.norm(by_hand.moments(1.0, p.theta, e / 2, e)[1] - shaped(p.theta, (e / 2) ** 2, e**2)) / e**2 for e in rows]
    r.order("first-order covariance against the exact one, relative", gaps, 2.0, ("exact moments", "first order"))
    mean, exact = by_hand.moments(p.D, p.theta, p.sigma_D, p.sigma_theta)
    again = by_hand.moments_by_quadrature(p.D, p.theta, p.sigma_D, p.sigma_theta)
    r.check("exact covariance of the conversion", exact, again[1], ("closed form", "Gauss–Hermite quadrature"), scale=size)
    r.table("moments", ["moments", "mean of $e_x$, m", "mean of $e_y$, m", "$R_{11}$, m²", "$R_{22}$, m²", "$R_{12}$, m²"], [
        ("first order", 0.0, 0.0, truth.R[0, 0], truth.R[1, 1], truth.R[0, 1]), ("exact", *mean, exact[0, 0], exact[1, 1], exact[0, 1]),
    ], "Moments of the pseudo-measurement errors, to first order and exactly (Gaussian $e_D$, $e_\\theta$).")
    phi = np.linspace(0, 2 * math.pi, 361)
    sd, rho = np.sqrt(np.diag(truth.R)), correlation(truth.R)
    true, believed = sd[1] * (rho * np.cos(phi) + math.sqrt(max(1 - rho**2, 0.0)) * np.sin(phi)), sd[1] * np.sin(phi)
    out = np.array([-1.0, 1.0]) * math.sqrt(size)
    curves = (Curve("true, R", sd[0] * np.cos(phi), true), Curve("believed in by variant 1", sd[0] * np.cos(phi), believed, "orange"),
              Curve("direction of the radius", out * math.cos(p.theta), out * math.sin(p.theta), "grey", "dash"))
    r.figure("ellipse", Drawing("ellipse", "$e_x$, m", (Panel("$e_y$, m", curves),), square=True, height=5.0),
             "One-σ ellipses of the errors of the pseudo-measurements, in one scale on both axes: the true one, and what variant 1 believes.")
    r.says("{fig:ellipse} shows what this means: the true ellipse has its axes along and across the radius, with the half-axes {across:3} m across and {along:3} m along; without $R_{12}$ its axes would be those of x and y. {tab:moments} compares the first order with the exact moments.", across=p.D * p.sigma_theta, along=p.sigma_D)


def shaped(theta, along, across):
    """A covariance with the given variances along and across the direction θ."""
    c, s = math.cos(theta), math.sin(theta)
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([along, across]) @ turn.T


def part_c(r, p, answer, truth, first, experiment, steps):
    """Variant 1."""
    r.section("c", "Variant 1: the covariance of the two errors neglected")
    r.says("With $R_1 = \\mathrm{diag}(R_{11}, R_{22})$ and a diagonal $P_0$ the filter separates into two filters of lab 3, one for x and $v_x$, one for y and $v_y$. Each uses the right variance of its own measurement, so the variances that it claims are its *true* ones. What is false is the zero covariance of x and y in which it believes, and what it gives away is the information of the other measurement.")
    actual, claimed = sensitivity.actual(truth, first, steps), covariances(first, steps)
    routes = ("recursion of truth and filter", "square-root arrays of one coordinate")
    listed = sensitivity.actual(truth, first, LISTED).P_plus
    at = list(range(1, LISTED + 1))
    r.value("posterior_variance_variant1", np.diagonal(listed[1:], axis1=1, axis2=2), "m², m²/s²", at=at, agrees=answer, routes=routes)
    r.check("variances believed in are the true ones", np.diagonal(claimed.P_plus, axis1=1, axis2=2), np.diagonal(actual.P_plus, axis1=1, axis2=2), ("filter's own recursion", "joint covariance of truth and filter"))
    limit = sensitivity.steady(truth, first)
    r.value("posterior_variance_steady_variant1", np.diag(limit.P_plus), "m², m²/s²", agrees=answer, routes=("Lyapunov equation", "spectral factorisation of one coordinate"))
    settled = settling(first)
    r.value("settling_step_variant1", settled, reason="not within 100 000 measurements", agrees=answer, routes=("recursion", "square-root arrays of one coordinate"), kind=EXACT)
    stats = experiment.statistics(truth, first, steps=steps)
    agreement(r, "variant 1", stats, actual.P_plus, consistent=False)
    expected, nees = float(np.trace(np.linalg.solve(claimed.P_plus[-1], actual.P_plus[-1]))), Uncertain(float(stats.nees[-1]), math.sqrt(8 / stats.runs))
    coefficient = actual.P_plus[-1, 0, 2] / math.sqrt(actual.P_plus[-1, 0, 0] * actual.P_plus[-1, 2, 2])
    last = actual.P_plus[-1]
    r.says("At the last of {steps} measurements the RMS errors of x and y are {x} and {y}, in theory {sd_x:4} and {sd_y:4} m.", steps=steps, x=rms(stats, unit="m"), y=rms(stats, state=2, unit="m"), sd_x=math.sqrt(last[0, 0]), sd_y=math.sqrt(last[2, 2]))
    if settled is None:
        r.says("The filter does not settle within 100 000 measurements.")
    else:
        r.says("The filter settles (all variances within 1 % of their limits) at measurement {settled}, after {time} s.", settled=settled, time=settled * p.tau)
    if abs(correlation(truth.R)) > ROUNDING:
        r.says("The errors of x and y really have the correlation coefficient {coefficient:3}, where the filter believes in 0. Its NEES is {nees} on average over the runs at the last measurement and {expected:3} in theory, as for a consistent filter: the average does not see the missing covariance, because each 2×2 block of P is right.",
               coefficient=coefficient, nees=nees, expected=expected)
    else:
        r.says("Here $R_{12} = 0$, so nothing is neglected: the filter is the optimal one, its NEES {nees} on average over the runs at the last measurement and {expected:3} in theory.", nees=nees, expected=expected)
    r.says("While the coordinates themselves wander without bound (their variances grow like $\\sigma_w^2t^3/3$, those of the velocities like $\\sigma_w^2t$), the errors stay bounded: both coordinates are observed, and all noises reach them.")


def part_d(r, answer, truth):
    """LDLᵀ."""
    r.section("d", "LDLᵀ of the covariance")
    r.math(r"R = LDL^T, \qquad L = \begin{bmatrix} 1 & 0 \\ l_{21} & 1 \end{bmatrix}, \qquad l_{21} = \frac{R_{12}}{R_{11}}, \qquad d_1 = R_{11}, \qquad d_2 = R_{22} - \frac{R_{12}^2}{R_{11}} = \frac{\sigma_D^2D^2\sigma_\theta^2}{R_{11}}", "factors")
    r.says("since $\\det R = \\sigma_D^2D^2\\sigma_\\theta^2$ (a rotation does not change it). Both d are positive as long as both errors exist.")
    new = updates.decorrelate(truth.H, truth.R)
    size = math.sqrt(truth.R[1, 1] / truth.R[0, 0])
    routes = ("LDLᵀ in floating point", "closed form")
    r.value("l21", new.L[1, 0])
    r.check("l21", new.L[1, 0], answer["l21"], routes, scale=max(size, 1e-300))
    r.value("diagonal_variances", new.d, "m²", agrees=answer, routes=routes)
    r.check("LDLᵀ = R", new.L @ new.R @ new.L.T, truth.R, ("product of the factors", "Jacobian of the conversion"), EXACT)


def part_e(r, truth, experiment):
    """Decorrelated pseudo-measurements."""
    r.section("e", "Decorrelated pseudo-measurements")
    r.math(r"z' = L^{-1}z = \begin{bmatrix} z_x \\ z_y - l_{21}z_x \end{bmatrix}, \qquad H' = L^{-1}H = \begin{bmatrix} 1 & 0 & 0 & 0 \\ -l_{21} & 0 & 1 & 0 \end{bmatrix}, \qquad E[e'e'^T] = L^{-1}RL^{-T} = \mathrm{diag}(d_1, d_2)", "decorrelated")
    r.says("The sheet speaks of z only; the matrix H must be multiplied too, as $z' = L^{-1}(Hx + e) = H'x + e'$. Now the measurements enter one after another as scalars: $S = h'Ph'^T + d$, and no matrix is inverted {ref:maybeck, chapter 5}. Nothing is lost: the updates are those of all elements at once.")
    new, by = updates.decorrelated(truth)
    r.math(r"H' = {H}, \qquad d = {d}", H=new.H, d=by.d)
    some = experiment.histories(truth, steps=SIMULATED)
    changed = np.stack([by.measurements(z) for z in some.z[1:]])
    apart = kalman_filter(new, changed[:, :, 0], algorithm="sequential")
    error = apart.x_plus - some.x_plus[:, :, 0]
    sizes = np.abs(some.x_plus[:, :, 0]).max(axis=0) + np.sqrt(np.diag(truth.P0))
    r.check("estimates of one record, relative to the largest", 1 + error / sizes, np.ones_like(error), ("z', one element after another", "z, both at once"))
    r.check("covariances of the same", apart.P_plus, some.P_plus, ("z', one element after another", "z, both at once"))
    if abs(correlation(truth.R)) > ROUNDING:
        r.says("With the old H and the new z' the filter would be wrong by $-l_{21}x$ in the second element, {wrong:4} m at $t_0$.", wrong=-by.L[1, 0] * truth.x0[0])
    else:
        r.says("Here $R_{12} = 0$ and $l_{21} = 0$: there is nothing to decorrelate, $z' = z$.")
