"""Lab 0: the method of all labs, worked on one example in symbols and in numbers.

Model → discretisation → filter → plan of the experiment, as in section 4 of the practicum.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ctlabs.filtering import settling, steady
from ctlabs.labs.experiment import covariances
from ctlabs.labs.sheets import bibliography
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots, render
from ctlabs.reporting.markdown import markdown
from ctlabs.reporting.params import LabParameters, Positive, Variance, given
from ctlabs.reporting.report import Picture, Report
from ctlabs.text import _

META = {"name": "lab0", "title": "Lab 0. The method on one example", "source": "Semushin & Tsyganova 2001, section 4", "parts": list("abcd")}
STEPS = 12


class MethodParameters(LabParameters):
    """The numbers of the example."""

    sigma_w2: Variance = given(1.0, unit="m²/s³", meaning="strength of the white noise that drives the velocity")
    tau: Positive = given(1.0, unit="s", meaning="period of the measurements")
    R: Positive = given(4.0, unit="m²", meaning="variance of a measurement")
    P11: Variance = given(100.0, unit="m²", meaning="variance of the position at the start", symbol="p_{11}^0")
    P22: Variance = given(4.0, unit="m²/s²", meaning="variance of the velocity at the start", symbol="p_{22}^0")


def report(p: MethodParameters | None = None) -> Report:
    """The example as a report."""
    p = p or MethodParameters()
    r = Report(META, p, 0, 0, framed=True, bibliography=bibliography(), around={"index": ("index.html", _("All labs"))})
    r.says(
        "Every lab goes the same way: **model, discretisation, filter, plan**. Here it is gone once, for a point that moves along a "
        "line with the velocity $v_x(t) = c_x + \\beta_x(t)$, a random constant and a Brownian motion, whose position is measured with period τ."
    )
    system = ContinuousModel(
        F=[[0, 1], [0, 0]], G=[[0], [1]], Q=[[p.sigma_w2]], H=[[1, 0]], Rc=[[1]], P0=np.diag([p.P11, p.P22]), states=["x", "v_x"]
    )
    _model(r)
    Qd = _discretisation(r, p, system)
    _filter(r, p, system)
    _plan(r, p, Qd)
    return r


def _model(r: Report) -> None:
    r.section("a", "From words to a model")
    r.says("The derivative of a Brownian motion is white noise $w$ of strength $\\sigma_w^2$ {ref:maybeck, section 4.5}. What must be known to go on from an instant is the state, here position and velocity:")
    r.math(r"\dot x = v_x, \qquad \dot v_x = w, \qquad \frac{d}{dt}\begin{bmatrix} x \\ v_x \end{bmatrix} = \begin{bmatrix} 0 & 1 \\ 0 & 0 \end{bmatrix}\begin{bmatrix} x \\ v_x \end{bmatrix} + \begin{bmatrix} 0 \\ 1 \end{bmatrix}w", "model")
    r.says("A measurement reads the position with a white error of variance R, $z(t_i) = Hx(t_i) + v(t_i)$ with $H = [1 \\;\\; 0]$. Mean and covariance of the state at the start complete the model: three lists, **matrices, noises, start**, and nothing else.")


def _discretisation(r: Report, p: MethodParameters, system: ContinuousModel) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    import sympy

    from ctlabs.models.symbolic import chain

    r.section("b", "From continuous to discrete time")
    r.says("Between measurements the state moves by $\\Phi(\\tau) = e^{F\\tau}$, whose Laplace transform is $(sI - F)^{-1}$, and the noise adds a white sequence of covariance $Q_d$. In symbols, for {eq:model}:")
    q, tau = sympy.Symbol("q", positive=True), sympy.Symbol("tau", positive=True)
    symbolic = chain([[0, 1], [0, 0]], [[0], [1]], [[q]], tau)
    for line in symbolic.latex()[1:]:
        r.math(line)
    r.says("with $q = \\sigma_w^2$. The last three lines split $Q_d$: written with $G_d$ the two noises are independent, and with $\\bar G_d$ their variances are one as well, as a simulation wants them. In numbers:")
    numeric, exact = discretise(system, p.tau, R=[[p.R]]), symbolic.evaluate(q=p.sigma_w2, tau=p.tau)
    r.math(r"\Phi = {Phi}, \qquad Q_d = {Qd}, \qquad G_d = {Gd}, \qquad \bar G_d = {Gs}", Phi=numeric.Phi, Qd=numeric.Qd, Gd=exact.unit_lower, Gs=exact.standardised)
    routes = ("matrix exponential", "closed form")
    r.check("Φ", numeric.Phi, exact.Phi, routes)
    r.check("Q_d", numeric.Qd, exact.Qd, routes)
    r.check("Ḡ_d Ḡ_dᵀ", exact.standardised @ exact.standardised.T, numeric.Qd, ("product of factors", "matrix exponential"))
    return numeric.Qd


def _filter(r: Report, p: MethodParameters, system: ContinuousModel) -> None:
    r.section("c", "The filter")
    r.says("Prediction and update follow each other {ref:maybeck, section 5.3}:")
    r.math(r"\hat x(t_i^-) = \Phi\,\hat x(t_{i-1}^+), \qquad P(t_i^-) = \Phi P(t_{i-1}^+)\Phi^T + Q_d", "prediction")
    r.math(r"K(t_i) = P(t_i^-)H^T[HP(t_i^-)H^T + R]^{-1}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - H\hat x(t_i^-)], \qquad P(t_i^+) = [I - K(t_i)H]P(t_i^-)", "update")
    r.says("(In the gain the practicum's notes print $P H$ for $P H^T$.) The first step in numbers, from $P_0 = \\text{diag}(p_{11}^0, p_{22}^0)$:")
    model = discretise(system, p.tau, R=[[p.R]])
    plan, limit = covariances(model, STEPS), steady.solve(model)
    r.math(r"P(t_1^-) = {P}, \qquad K(t_1) = {K}, \qquad P(t_1^+) = {Pp}", P=plan.P_minus[1], K=plan.K[1], Pp=plan.P_plus[1])
    P = model.Phi @ model.P0 @ model.Phi.T + model.Qd
    r.check("P(t1⁺)", plan.P_plus[1], P - np.outer(P[:, 0], P[0]) / (P[0, 0] + p.R), ("recursion", "equations by hand"))
    r.says("{fig:variances} shows twelve steps: covariances and gains need no measurement. They tend to limits, which are reached within 1 % at measurement {settled},", settled=settling(model))
    r.math(r"\bar P^+ = {P}, \qquad \bar K = {K}", P=limit.P_plus, K=limit.K)
    sd = {"σ of x, m": plan.sd_plus[:, 0], "σ of $v_x$, m/s": plan.sd_plus[:, 1]}
    levels = {"limits": ([0, STEPS], [np.sqrt(limit.P_plus[0, 0])] * 2), "_v": ([0, STEPS], [np.sqrt(limit.P_plus[1, 1])] * 2)}
    figure = plots.lines(range(STEPS + 1), sd, xlabel="measurement number i", ylabel="standard deviation σ, m and m/s", log="y", marker=".", steps=True, straight=levels)
    r.figure("variances", figure, "Standard deviations of the errors after each measurement, on their way to the limits (dashed). The first measurement tells of the position, the second of the velocity.")


def _plan(r: Report, p: MethodParameters, Qd: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    r.section("d", "The plan of an experiment")
    r.says("Before a computer is asked, every number is listed with the reason for its choice ({tab:plan}). Then runs are simulated, the filter runs on their measurements, and the statistics of its errors are compared with the variances of (c): the mean with zero, the mean square with P⁺, both with bounds that come from the number of runs.")
    rows: list[list[object]] = [
        ["$F, G, H$", "as in {eq:model}", "the motion and what is measured"],
        ["$\\sigma_w^2$, m²/s³", p.sigma_w2, "given"],
        ["τ, s", p.tau, "given"],
        ["$R$, m²", p.R, "given"],
        ["$p_{11}^0, p_{22}^0$, m² and m²/s²", [p.P11, p.P22], "given: little is known at the start"],
        ["measurements", 3 * STEPS, "several settling times, which (c) tells"],
        ["runs", 1000, "a standard error of a variance of 4.5 %"],
        ["seed", 1, "so that everybody gets the same numbers; the conclusions hold for any"],
    ]
    r.table("plan", ["quantity", "value", "why"], rows, "Plan of the experiment.")
    r.check("signal to noise", Qd[0, 0] / p.R, p.sigma_w2 * p.tau**3 / 3 / p.R, ("discretised model", "closed form"))


def write(out: Path) -> None:
    """``lab0.html`` and ``lab0.md`` in ``out``, with the figure beside them."""
    made = report()
    pictures = {block.name: render.png(block.figure) for block in made.blocks if isinstance(block, Picture)}
    text = markdown(made)
    for name, data in pictures.items():
        (out / f"lab0-{name}.png").write_bytes(data)
        text = text.replace(f"figures/{name}.png", f"lab0-{name}.png")
    render.replace(out / "lab0.md", f"{text}\n{render.MARK}\n")
    render.replace(out / "lab0.html", render.html(made, pictures) + f"{render.MARK}\n")
