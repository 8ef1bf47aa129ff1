"""Lab 5, part (g): the true sensor, and what is made of its measurements."""

import math

import numpy as np
from ctlabs.tasks._task05_pseudo import STATES
from ctlabs.tasks.answers import task05 as by_hand

from ctlabs.filtering import updates
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.reporting.report import EXACT
from ctlabs.text import number, text

#: Standard errors from which a difference of mean squares on the same data is called clear in the words of the report.
CLEAR = 4.0


def pseudo(p, x, y):
    """R11, R22, R12, l21, d2 at the position (x, y), which may be arrays: J diag(σ_D², σ_θ²) Jᵀ with J = [[x/D, −y], [y/D, x]]."""
    D = np.hypot(x, y)
    c, s = np.divide(x, D, out=np.ones_like(D), where=D > 0), np.divide(y, D, out=np.zeros_like(D), where=D > 0)
    a, b = p.sigma_D**2, p.sigma_theta**2
    R11, R22, R12 = c**2 * a + y**2 * b, s**2 * a + x**2 * b, c * s * a - x * y * b
    return R11, R22, R12, R12 / R11, a * b * D**2 / R11


def cost(r, answer):
    """Operations of an update."""
    whole, scalar, extra = (updates.flops(4, 2, way) for way in ("joint", "sequential", "decorrelation"))
    counted = [2 * updates.flops(2, 1, "sequential"), scalar, scalar + extra, whole]
    r.value("cost_of_update", counted, "flop", agrees=answer, routes=("counted while it is done", "formula in n"), kind=EXACT)
    r.table("cost", ["update", "additions, multiplications, divisions", "relative"], [
        (name, count, count / counted[2]) for name, count in zip((
            "variant 1 as two filters of two states", "variant 1, four states, element by element",
            "variant 2: decorrelation, then element by element", "the full R, both elements at once"), counted, strict=True)
    ], "Cost of one update of estimate and covariance, dense matrices (n = 4, m = 2). The zeros of H would save more, for all but the first alike.")
    r.says("Decorrelation itself costs little ({extra} operations of {all}). What variant 2 really gives up is that variant 1 falls apart into two small filters; prediction (dense, $\\Phi P\\Phi^T + Q_d$) then takes {four} operations instead of twice {two}.", extra=extra, all=counted[2], four=prediction(4), two=prediction(2))


def prediction(n):
    """Operations of one dense prediction of estimate and covariance."""
    return n * (2 * n - 1) + 2 * n**2 * (2 * n - 1) + n**2


def polar(p, motion):
    """The true system: linear motion, range and bearing with their own noises."""
    return NonlinearModel(
        f=lambda _k, x, w: motion.Phi @ x + w, h=lambda _k, x, v: np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])]) + v,
        Qd=motion.Qd, R=np.diag([p.sigma_D**2, p.sigma_theta**2]), x0=motion.x0, P0=motion.P0, states=STATES, measurements=["D", "θ"],
    )


def converted(p, motion, correlated):
    """A filter of pseudo-measurements with R at the geometry it predicts; ``correlated``: decorrelated there (variant 2)."""
    def geometry(x):
        return pseudo(p, x[0], x[2])

    def difference(z, predicted):  # z − ẑ, with ẑ the predicted position; the conversion is that of the measured D and θ
        e = z[0] * np.array([np.cos(z[1]), np.sin(z[1])]) - predicted
        return np.array([e[0], e[1] - pseudo(p, *predicted)[3] * e[0]]) if correlated else e

    def H(_k, x):
        l21, zero = geometry(x)[3] if correlated else np.zeros_like(x[0]), np.zeros_like(x[0])
        return np.array([[zero + 1, zero, zero, zero], [-l21, zero, zero + 1, zero]])

    def R(_k, x):
        R11, R22, _R12, _l21, d2 = geometry(x)
        zero = np.zeros_like(R11)
        return np.array([[R11, zero], [zero, d2 if correlated else R22]])

    return NonlinearModel(f=lambda _k, x, w: motion.Phi @ x + w, h=lambda _k, x, v: x[[0, 2]] + v, F=lambda _k,
                          _x: motion.Phi, H=H, residual=difference, Qd=lambda _k, _x: motion.Qd, R=R, x0=motion.x0,
                          P0=motion.P0, states=STATES, measurements=["z1'", "z2'"])


def trajectories(p, steps):
    """Name and initial velocity (m/s): at rest, towards the sensor to half of D, across the radius by D."""
    c, s, speed = math.cos(p.theta), math.sin(p.theta), p.D / (steps * p.tau)
    return {"at rest": (0.0, 0.0), "approaching": (-0.5 * speed * c, -0.5 * speed * s), "crossing": (-speed * s, speed * c)}


def small(p, runs, steps):
    """A factor of all noises at which nothing but the linear terms is seen by so many runs, or None where rounding would be."""
    position, velocity = by_hand.spread(p)
    t = steps * p.tau
    away = math.sqrt(position + velocity * t**2 + p.sigma_w2 * t**3 / 3) / p.D
    longer = max(p.D * p.sigma_theta / p.sigma_D, p.sigma_D / (p.D * p.sigma_theta))
    size = min(1.0, 0.01 / (longer**2 * (away + p.sigma_theta + p.sigma_D / p.D) * math.sqrt(runs)))
    return size if size * min(p.sigma_D / p.D, p.sigma_theta, math.sqrt(p.sigma_w2 * p.tau**3) / p.D) > 1e-9 else None


def judge(r, shown):
    """What the true sensor says, in words."""
    lines = []
    for name, (_stats, _P, scores) in shown.items():
        better, worse = (", ".join(STATES[j] for j in np.flatnonzero(sign * scores > CLEAR)) for sign in (1, -1))
        lines.append(text("{name}: variant 2 is clearly better in {better}" if better else "{name}: no state is clearly better in variant 2",
                          "; clearly worse in {worse}" if worse else "", " (standard errors {scores}).",
                          name=name, better=better, worse=worse, scores=[round(float(score), 1) for score in scores]))
    r.says("The two mean squares at the last measurement, compared run by run on the same data, and called clearly different from {count} standard errors on:", count=CLEAR)
    r.items(lines)
    nees = "; ".join(f"{name} {number([float(each.nees[-1]) for each in stats])}" for name, (stats, _P, _scores) in shown.items())
    r.says("NEES at the last measurement, variants 1 and 2: {nees}.", nees=nees)
