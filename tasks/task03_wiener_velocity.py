r"""Lab 3. A velocity that is a random constant plus Brownian motion.

Source: Semushin & Tsyganova 2001, task 3. v_x(t) = c + β(t), the position is measured every τ. The sheet asks for (a) the
discrete model with a unit lower triangular noise matrix, (b) the model with standardised noises and the SI unit of every
quantity, (c) the explicit solution and the variances from a deterministic start, (d) an experiment on the initial state,
the disturbance and the measurement errors, the limits of the error variances and the time to reach them, and in words
which motion this is and what is estimated.

Expected answer: Q_d = σ_w²[τ³/3, τ²/2; τ²/2, τ], g21 = 3/(2τ); Var x = σ_w²t³/3 and Var v = σ_w²t grow without bound, the
error variances do not. With α = K̄1 and β = K̄2τ: β²/(1−α) = σ_w²τ³/R and α² + αβ + β²/6 − 2β = 0.
"""


from ctlabs.tasks import _kinematics
from ctlabs.tasks.answers import task03 as by_hand

from ctlabs.reporting.draws import diagonal, one_of, span
from ctlabs.reporting.params import Covariance, Variance, Vector, given
from ctlabs.reporting.report import SOLVER

META = {
    "name": "task03",
    "title": "A velocity that is a random constant plus Brownian motion",
    "source": "Semushin & Tsyganova 2001, task 3",
    "parts": ["a", "b", "c", "d"],
}


class Parameters(_kinematics.KinematicParameters):
    """What may be changed."""

    sigma_w2: Variance = given(1.0, unit="m²/s³", meaning="diffusion of the velocity", draw=span(0.2, 3, 0.1))
    P0: Covariance(2) = given(((100, 0), (0, 10)), unit="m², m²/s, m²/s²", meaning="covariance of (x, v) at t0", draw=diagonal(one_of(40, 60, 80, 100, 120), one_of(4, 6, 8, 10, 12)))
    x0_mean: Vector(2) = given((0, 0), unit="m, m/s", meaning="mean of (x, v) at t0", symbol=r"\bar x_0")


def closed_form(r, lab):
    """The gain of the α–β tracker."""
    r.says("**The α–β filter.** The steady filter is the α–β tracker {ref:bar_shalom, chapter 6} with $\\alpha = \\bar{K}_1$, $\\beta = \\bar{K}_2\\tau$. In $\\bar{P}^- = \\Phi\\bar{P}^+\\Phi^T + Q_d$ with $\\bar{P}^-_{j1} = \\bar{K}_jR/(1-\\alpha)$ and $\\bar{P}^+_{j1} = \\bar{K}_jR$ the element (2,2) gives the first equation below, the element (1,2) gives $\\bar{P}^+_{22}$, and then (1,1) gives the second:")
    r.math(r"\frac{\beta^2}{1 - \alpha} = \frac{\sigma_w^2\tau^3}{R} = \rho, \qquad \alpha^2 + \alpha\beta + \frac{\beta^2}6 - 2\beta = 0, \qquad \bar P^+ = \begin{bmatrix} \alpha R & \beta R/\tau \\ \beta R/\tau & \sigma_w^2\tau\,\bigl(\tfrac\alpha\beta - \tfrac12\bigr) \end{bmatrix}", "alphabeta")
    found = [lab.limit.K[0, 0], lab.limit.K[1, 0] * lab.p.tau]
    r.value("alpha_beta", found, "1", symbol=r"(\alpha, \beta)", agrees=lab.answer, routes=("Riccati equation", "the two equations, root bracketed"), kind=SOLVER)
    alpha, beta = lab.answer["alpha_beta"]
    if beta:
        r.check("P̄⁺ of the velocity", lab.limit.P_plus[1, 1], lab.p.sigma_w2 * lab.p.tau * (alpha / beta - 0.5), ("Riccati equation", "closed form in α, β"))


PARTS = _kinematics.skeleton(closed_form)


def report(p, experiment):
    """Answer the sheet, item by item."""
    return _kinematics.answer_sheet(META, p, by_hand.analytic(p), experiment, PARTS)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
