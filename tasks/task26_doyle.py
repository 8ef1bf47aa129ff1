r"""Lab 26. Doyle's plant: optimal and fragile.

Source: Doyle 1978. For ẋ1 = x1 + x2 + w, ẋ2 = x2 + u + w, z = x1 + v and the cost q(x1 + x2)² + u² the
sheet asks for the optimal regulator, the errors of the input's gain that its loop bears, what such an error costs, how
the margins depend on q and σ, a remedy with its price, and an experiment.

Expected answer: L = f[1 1], K = d[1 1]ᵀ with f² = 4f + q, d² = 4d + σ; J = 5fd(f + d − 4); the loop is stable for
1 + c[2D + c − √((2D + c)² + 16D)]/(8fd) < m < 1 + 1/(fd), D = (f − 2)(d − 2), c = f + d − 4. For q = σ = 60 these are
0.930 and 1.010. With noise μ at the input in the design K = (a + 2, a + c + 1), c² = 1 + μ, a² = 2 + σ + 2c.
"""

import numpy as np
from ctlabs.tasks._task26_experiment import part_f, plan
from ctlabs.tasks._task26_figures import against_gain, against_weights, nyquist, recovery
from ctlabs.tasks._task26_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task26 as by_hand
from pydantic import field_validator

from ctlabs.labs.experiment import Experiment
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel, Cost
from ctlabs.regulation import margins, regulator
from ctlabs.reporting.draws import one_of
from ctlabs.reporting.params import LabParameters, Positive, Variance, given
from ctlabs.reporting.report import Report
from ctlabs.text import text

META = {
    "name": "task26",
    "title": "Doyle's plant: optimal and fragile",
    "source": "Doyle 1978",
    "parts": ["a", "b", "c", "d", "e", "f"],
    "extension": True,
}

#: Larger weights and noises leave margins too near to 1 for half the digits of a double.
LARGEST, MOST = 1e4, 1e6


class Parameters(LabParameters):
    """What may be changed."""

    q: Positive = given(60.0, unit="1", meaning="weight of x1 + x2", symbol="q", draw=one_of(12, 21, 32, 45, 77, 96))
    sigma: Positive = given(60.0, unit="1", meaning="strength of the process noise w", symbol=r"\sigma", draw=one_of(12, 21, 32, 45, 77, 96))
    m: Positive = given(1.008, unit="1", meaning="true strength of the input as a part of the believed one", symbol="m", draw=one_of(0.97, 0.98, 0.99, 1.004, 1.005, 1.006, 1.008))
    mu: Variance = given(100.0, unit="1", meaning="strength of the noise at the input that the filter of part (e) believes in", symbol=r"\mu", draw=one_of(20, 50, 100, 150, 200, 300, 500))

    @field_validator("q", "sigma", "mu")
    @classmethod
    def _distinguishable(cls, value, info):
        """The margins are one part in the product of two gains."""
        if value > (most := MOST if info.field_name == "mu" else LARGEST):
            raise ValueError(f"expected at most {most:g}, received {value:.15g}")
        return value


def plant(p, m=1.0, mu=0.0):
    """Doyle's plant, whose input acts m times as strongly and has noise of strength mu."""
    return ContinuousModel(F=[[1, 1], [0, 1]], B=[[0], [m]], G=[[1, 0], [1, 1]], Q=[[p.sigma, 0], [0, mu]], H=[[1, 0]], Rc=[[1]],
                           P0=np.zeros((2, 2)), states=["x1", "x2"], measurements=["z"])


def wanted(p):
    """q(x1 + x2)² + u²."""
    return Cost(p.q * np.ones((2, 2)), [[1]])


def part_a(r, p, answer, optimal):
    """The optimal regulator."""
    r.section("a", "The optimal regulator")
    r.model(plant(p))
    r.says("The second column of $G$ is the input's, with noise only in part (e). The feedback's equation $A^TS + SA + Q_x - L^TL = 0$, $L = B^TS = (S_{12}, S_{22})$, reads element by element")
    r.math(r"2S_{11} + q - S_{12}^2 = 0, \qquad S_{11} + 2S_{12} + q - S_{12}S_{22} = 0, \qquad 2S_{12} + 2S_{22} + q - S_{22}^2 = 0")
    r.says("With $S_{12} = S_{22} = f$ the last two are $f^2 = 4f + q$, if $S_{11} = 2f$, and so is the first. The filter's equation is the same with the states exchanged and σ for $q$:")
    r.math(r"L = f\begin{bmatrix}1 & 1\end{bmatrix}, \quad K = d\begin{bmatrix}1\\ 1\end{bmatrix}, \qquad f = 2 + \sqrt{4 + q}, \quad d = 2 + \sqrt{4 + \sigma}", "gains")
    r.math(r"S = f\begin{bmatrix}2 & 1\\ 1 & 1\end{bmatrix}, \qquad P = d\begin{bmatrix}1 & 1\\ 1 & 2\end{bmatrix}")
    r.says("By the separation theorem (lab 24) the cost is $\\mathrm{tr}\\,SW + LPL^T$, with the covariance $W$ of the noise per second all of whose elements are σ:")
    r.math(r"J = 5f\sigma + 5f^2d = 5fd\,(f + d - 4)", "cost")
    routes = ("Riccati equation", "closed form")
    r.value("feedback_gain", optimal.L[0], symbol="L", agrees=answer, routes=routes)
    r.value("filter_gain", optimal.K[:, 0], symbol="K", agrees=answer, routes=routes)
    r.value("cost_to_go", optimal.feedback.S, agrees=answer, routes=routes)
    r.value("error_covariance", optimal.P, agrees=answer, routes=routes)
    r.value("cost", optimal.cost.value, symbol="J", agrees=answer, routes=("separation", "closed form"))
    for route in ("closed loop", "innovations"):
        r.check("least cost", optimal.cost.routes[route], answer["cost"], (route, "closed form"))
    r.value("cost_known", optimal.cost.regulation, symbol=r"J_\text{known}", agrees=answer, routes=("separation", "closed form"))
    r.says("Here $f = {f}$, $d = {d}$ and $J = {J}$, of which {share:3} % are due to not knowing the state.",
           f=answer["feedback_gain"][0], d=answer["filter_gain"][0], J=answer["cost"], share=100 * (1 - answer["cost_known"] / answer["cost"]))


def part_b(r, answer, optimal, own):
    """The margins."""
    r.section("b", "What the loop bears")
    f = answer["feedback_gain"][0]
    r.says("**The state known.** With $u = -Lx$ and an input that is $m$ times as strong the loop has the polynomial $s^2 + (mf - 2)s + 1$. It is stable for")
    r.math(r"m > \frac2f", "known")
    r.says("and as $f > 4$, from less than one half on up to any gain. The open loop $\\ell = fs/(s - 1)^2$ has the magnitude 1 at two frequencies. Its phase may be wrong by $\\arccos(2/f)$, which is more than 60°, or the input come late by $\\arccos(2/f)/\\omega_1$ with the higher of them, $\\omega_1 = (f + \\sqrt{f^2 - 4})/2$; and $|1 + \\ell| \\ge 1$ at every frequency. Half the gain, 60° and the distance 1 from −1 are what every optimal feedback of a known state with one input bears ({ref:anderson_moore_lq, chapter 5}). Here these two are {phase:3}° and {delay:3} s. (A delay is the phase divided by the frequency, so that a fast loop bears only a short one.)",
           phase=float(np.degrees(by_hand.known_phase(f))), delay=by_hand.known_delay(f))
    r.says("**The state estimated.** From the measurement to $-u$ the regulator is")
    r.math(r"C(s) = L(sI - A + BL + KH)^{-1}K = \frac{fd\,(2s - 1)}{s^2 + (f + d - 2)s + 1 + fd}", "compensator")
    r.says("and the plant from the input to the measurement is $m/(s - 1)^2$, so that the loop has the polynomial")
    r.math(r"s^4 + c\,s^3 + (D + 2)\,s^2 + [c + 2(m-1)fd]\,s + 1 - (m-1)fd, \qquad c = f + d - 4, \quad D = (f - 2)(d - 2)", "polynomial")
    r.says("Its last two coefficients must be positive, as {ref:doyle} remarks: $-c/(2fd) < m - 1 < 1/(fd)$. Hurwitz's condition makes the lower bound narrower and leaves the upper one. With $\\varepsilon = m - 1$ it is $4f^2d^2\\varepsilon^2 - fdc\\,(2D + c)\\,\\varepsilon - c^2D < 0$, so the loop is stable if and only if")
    r.math(r"\frac{c}{8fd}\left[(2D + c) - \sqrt{(2D + c)^2 + 16D}\right] < m - 1 < \frac1{fd}", "bounds")
    routes = ("python-control", "polynomials")
    r.value("loop_polynomial", np.poly(optimal.poles).real, agrees=answer, routes=("eigenvalues of the closed loop", "polynomials"))
    r.value("gain_margins", own.gain, symbol=r"m_\text{min}, m_\text{max}", agrees=answer, routes=("poles of the closed loop", "closed form"))
    r.check("bounds of the gain", by_hand.gain_margins(f, answer["filter_gain"]), answer["gain_margins"], ("Hurwitz's condition in numbers", "closed form"))
    r.value("known_state_margin", 2 / optimal.L[0, 0], symbol=r"m_\text{min, known}", agrees=answer, routes=("Riccati equation", "closed form"))
    r.value("phase_margin", own.phase, "rad", symbol=r"\varphi", agrees=answer, routes=routes)
    r.value("delay_margin", own.delay, "s", symbol=r"\tau", agrees=answer, routes=routes)
    r.value("modulus_margin", own.modulus, symbol=r"\min|1 + \ell|", agrees=answer, routes=routes)
    r.value("disk_margin", own.disk, symbol=r"\alpha", agrees=answer, routes=routes)
    low, high = answer["gain_margins"]
    r.says("Here the loop bears factors from {low:5} to {high:5}: an input that is {up:3} % too strong or {down:3} % too weak destroys it. It bears {phase:3}° of phase or a delay of {delay:3} s, and the frequency response ℓ of the open loop comes to within {near:3} of −1, where that of a known state keeps a distance of 1. In gain and phase at once it bears every factor $(2 + \\alpha\\delta)/(2 - \\alpha\\delta)$, δ complex and $|\\delta| < 1$, with $\\alpha = \\min 2|1 + \\ell|/|1 - \\ell|$ = {disk:3}.",
           low=low, high=high, up=100 * (high - 1), down=100 * (1 - low), phase=float(np.degrees(answer["phase_margin"])), delay=answer["delay_margin"], near=answer["modulus_margin"], disk=answer["disk_margin"])
    nyquist(r, answer)


def part_c(r, p, answer, optimal):
    """What a wrong gain costs."""
    r.section("c", "The optimal regulator of a plant that is a little different")
    r.says("The cost with another $m$ follows from the transfer functions from $w$ and $v$ to $x_1 + x_2$ and $u$, all over the polynomial {eq:polynomial}, as integrals of their squares ({ref:astrom, chapter 5}).")
    value = answer["cost_actual"]
    truth = plant(p, m=p.m)
    found = optimal.actual_cost(truth) if value is not None else None
    r.value("cost_actual", found, symbol="J(m)", reason="" if value is not None else "the loop is not stable", agrees=answer, routes=("Lyapunov equation", "integrals of the closed loop"))
    poles = optimal.loop(truth).poles
    f, d = answer["feedback_gain"][0], answer["filter_gain"]
    size = by_hand.characteristic(f, d, 1.0) + abs(p.m - 1) * f * d[0] * np.array([0, 0, 0, 2, 1])  # the last two may vanish
    r.check("polynomial of the loop with the true gain", np.poly(poles).real, by_hand.characteristic(f, d, p.m), ("eigenvalues of the closed loop", "polynomials"), scale=size)
    against_gain(r, p, answer)
    if value is None:
        r.says("With $m = {m}$ the loop is not stable: its fastest growing motion has the exponent {rate:3}.", m=p.m, rate=float(poles.real.max()))
    else:
        r.says("With $m = {m}$ the regulator costs {J:5}, which differs by {percent:3} % from its cost on the plant for which it was made.", m=p.m, J=value, percent=100 * (value / answer["cost"] - 1))


def part_d(r, p):
    """The margins against the weights."""
    r.section("d", "Margins as small as one likes")
    r.says("For large $q$ and σ the product $fd$ grows like $\\sqrt{q\\sigma}$, and the upper bound of {eq:bounds} comes as near to 1 as one likes. The lower one is less than $c/(2fd)$ away from 1, and so less than the mean of $1/f$ and $1/d$: it comes as near as one likes where both grow. The known state's bound {eq:known} moves the other way. Doyle's abstract, on guaranteed margins of such regulators, is: there are none.")
    grid = [1.0, 10.0, 100.0, 1000.0, 10000.0]
    rows, both = [], []
    for weight in grid:
        f = by_hand.gain(weight)
        found = margins(_regulator(p.model_copy(update={"q": weight, "sigma": weight}))).inputs["u"]
        exact = by_hand.closed_margins(f, f)
        both.append((found.gain, exact))
        rows.append((weight, f, exact[0], exact[1], 2 / f, found.modulus))
    r.check("bounds of the gain for five weights", [each[0] for each in both], [each[1] for each in both], ("poles of the closed loop", "closed form"))
    r.table("weights", ["q = σ", "f = d", "lower bound of m", "upper bound of m", "lower bound, state known", "least distance from −1"], rows,
            "The margins for five pairs of equal weight and noise. A regulator that is asked for more bears less.")
    against_weights(r)


def _regulator(p, mu=0.0):
    return regulator(plant(p, mu=mu), wanted(p))


def part_e(r, p, answer, recovered):
    """Fictitious noise at the input."""
    r.section("e", "A remedy: noise at the input that is not there")
    r.says("Let the filter believe in noise of strength μ at the input besides. Its poles are the stable roots of $(s^2 - 1)^2 - \\sigma s^2 + \\mu$, whose stable factor $s^2 + as + c$ has")
    r.math(r"c = \sqrt{1 + \mu}, \qquad a = \sqrt{2 + \sigma + 2c}, \qquad K = \begin{bmatrix}a + 2\\ a + c + 1\end{bmatrix}", "recovered")
    r.says("For $\\mu \\to \\infty$ the loop at the input tends to that of the known state, as the plant has no zeros in the right half plane ({ref:doyle_stein}). The noise does not exist, so that the filter is no longer the best one, and the cost rises: it is that of the true plant under the other gain.")
    routes = ("Riccati equation", "spectral factorisation")
    own = margins(recovered, plant(p)).inputs["u"]
    r.value("recovered_filter_gain", recovered.K[:, 0], symbol=r"K_\mu", agrees=answer, routes=routes)
    r.value("recovered_cost", recovered.actual_cost(plant(p)), symbol=r"J_\mu", agrees=answer, routes=("Lyapunov equation", "integrals of the closed loop"))
    r.value("recovered_gain_margins", own.gain, symbol=r"m_\text{min}, m_\text{max}\ (\mu)", agrees=answer, routes=("poles of the closed loop", "Hurwitz's condition"))
    r.value("recovered_modulus", own.modulus, symbol=r"\min|1 + \ell|\ (\mu)", agrees=answer, routes=("python-control", "polynomials"))
    low, high = answer["recovered_gain_margins"]
    r.says("With $\\mu = {mu}$ the loop bears factors from {low:4} to {high:4}, where the optimal one bears {least:5} to {most:5}; it costs {percent:3} % more on the plant for which the other is optimal.",
           mu=p.mu, low=low, high=high, least=answer["gain_margins"][0], most=answer["gain_margins"][1], percent=by_hand.price(answer))
    recovery(r, p, answer)


PARTS = Skeleton(
    result=result,
    key="gain",
    analysis=(part_a, part_b, part_c, part_d, part_e),
    plan=plan,
    experiment=(part_f,),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    optimal = _regulator(p)
    truths = {text("m = {m}", m=m): plant(p, m=m) for m in (1.0, p.m)}
    beyond = plant(p, m=2 * by_hand.closed_margins(by_hand.gain(p.q), by_hand.gain(p.sigma))[1] - 1)
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), optimal=optimal, own=margins(optimal).inputs["u"],
                        recovered=_regulator(p, mu=p.mu), truths=truths, beyond=beyond)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
