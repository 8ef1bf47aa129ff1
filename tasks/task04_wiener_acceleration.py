r"""Lab 4. An acceleration that is a random constant plus Brownian motion.

Source: Semushin & Tsyganova 2001, task 4: all of lab 3 for a(t) = c + β(t) in place of the velocity. The position is
measured every τ; the sheet asks for (a) the discrete model with a unit lower triangular noise matrix, (b) standardised
noises and units, (c) the explicit solution and the variances from a deterministic start, (d) the experiment.

Expected answer: Q_d = σ_w²[τ⁵/20, τ⁴/8, τ³/6; ·, τ³/3, τ²/2; ·, ·, τ]; Var x = σ_w²t⁵/20, Var v = σ_w²t³/3 and
Var a = σ_w²t grow without bound, the error variances do not. The gains (K̄1, K̄2τ, K̄3τ²) depend on σ_w²τ⁵/R alone.
"""


import numpy as np
from ctlabs.tasks import _kinematics
from ctlabs.tasks.answers import task04 as by_hand

from ctlabs.labs.experiment import covariances
from ctlabs.reporting.draws import diagonal, one_of, span
from ctlabs.reporting.params import Covariance, Variance, Vector, given

META = {
    "name": "task04",
    "title": "An acceleration that is a random constant plus Brownian motion",
    "source": "Semushin & Tsyganova 2001, task 4",
    "parts": ["a", "b", "c", "d"],
}


class Parameters(_kinematics.KinematicParameters):
    """What may be changed."""

    sigma_w2: Variance = given(1.0, unit="m²/s⁵", meaning="diffusion of the acceleration", draw=span(0.2, 3, 0.1))
    P0: Covariance(3) = given(((100, 0, 0), (0, 10, 0), (0, 0, 1)), unit="m², m²/s … m²/s⁴", meaning="covariance of (x, v, a) at t0", draw=diagonal(one_of(40, 60, 80, 100, 120), one_of(4, 6, 8, 10, 12), one_of(0.5, 1, 1.5, 2)))
    x0_mean: Vector(3) = given((0, 0, 0), unit="m, m/s, m/s²", meaning="mean of (x, v, a) at t0", symbol=r"\bar x_0")


def closed_form(r, lab):
    """What takes the place of the α–β equations: the gains by the innovation's variance."""
    r.says("**The α–β–γ filter.** The steady filter is the tracker of that name {ref:bar_shalom, chapter 6}. With $\\alpha = \\bar{K}_1$, $\\beta = \\bar{K}_2\\tau$, $\\gamma = \\bar{K}_3\\tau^2$ the element (3,3) of $\\bar{P}^- = \\Phi\\bar{P}^+\\Phi^T + Q_d$ gives $\\gamma^2/(1-\\alpha) = \\sigma_w^2\\tau^5/R$, the counterpart of the equation for β in lab 3. The other two equations are those of {eq:gains}; the poles, and so all three gains, follow from the cubic {eq:spectrum}.")
    innovation = lab.limit.P_minus[0, 0] + lab.p.R
    r.check("K̄3² S̄ = σ_w²τ", lab.limit.K[2, 0] ** 2 * innovation, lab.p.sigma_w2 * lab.p.tau, ("Riccati equation", "element (3,3) of Q_d"))
    if lab.settled is None:
        return
    limit, variances = np.diag(lab.limit.P_plus), np.diagonal(covariances(lab.system, lab.settled).P_plus, axis1=1, axis2=2)[1:]
    inside = (np.abs(variances - limit) <= 0.01 * limit).all(axis=1)
    entered = int(np.argmax(inside)) + 1
    if entered < lab.settled:
        r.says("The settling is not monotone: all variances are within 1 % of their limits at measurement {entered} already, leave the band again and stay in it from measurement {settled} on.", entered=entered, settled=lab.settled)
    else:
        r.says("Here the variances enter the band of 1 % about their limits at measurement {settled} and stay in it. At other parameters they may pass through the band at first and leave it again.", settled=lab.settled)


PARTS = _kinematics.skeleton(closed_form)


def report(p, experiment):
    """Answer the sheet, item by item."""
    return _kinematics.answer_sheet(META, p, by_hand.analytic(p), experiment, PARTS)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
