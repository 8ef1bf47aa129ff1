"""Lab 25's autopilot: the altitude of lab 13 with a regulator, continuous, sampled, and late."""

import numpy as np
import scipy.linalg
from ctlabs.tasks.answers import task25 as by_hand
from ctlabs.tasks.answers.task25 import A0, A1, B0, B1

from ctlabs.analysis import sensitivity
from ctlabs.models import ContinuousModel, Cost, DiscreteModel, discretise, observability
from ctlabs.regulation import cost_budget, periods, regulator
from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel


def autopilot(p):
    """Altitude about the commanded one and the second state, whose command has noise and a correction; it has long been left alone."""
    F, B = np.array([[-A1, 1.0], [-A0, 0.0]]), np.array([[B1], [B0]])
    P0 = scipy.linalg.solve_continuous_lyapunov(F, -p.N_c * B @ B.T)
    return ContinuousModel(F, B, [[p.N_c]], [[1, 0]], B=B, Rc=[[p.N_m]], P0=0.5 * (P0 + P0.T), states=["h", "x2"], measurements=["h_m"], units=["m", "m/s"])


def cost_of(p):
    """h² + ρ_a u²."""
    return Cost([[1, 0], [0, 0]], [[p.Qu_a]])


def part_e(r, p, answer, aircraft):
    """The autopilot regulated."""
    r.section("e", "The autopilot with a regulator")
    r.says("With the states of lab 13, in deviations from the commanded altitude, the correction enters where the noise of the command does:")
    r.model(aircraft)
    r.says("Left alone, the altitude has the variance $N_c(b_1^2a_0 + b_0^2)/(2a_0a_1)$: the autopilot is hardly damped, and the noise of the command rocks it. **Continuously**, the closed poles of the feedback are the stable roots of $d(s)d(-s) + n(s)n(-s)/\\rho_a$, and those of the filter the stable roots of $d(s)d(-s) + n(s)n(-s)N_c/N_m$, with $n$ and $d$ the numerator and denominator of the autopilot ({ref:kwakernaak_sivan, chapters 3 and 5}).")
    free = discretise(aircraft, p.dt_a)
    still = sensitivity.steady(_alone(free), _alone(free), K=np.zeros((2, 1)))
    r.value("altitude_variance_free", still.P_plus[0, 0], "m²", symbol=r"E h^2_\text{free}", agrees=answer, routes=("Lyapunov equation", "integral of the spectrum"))
    best = regulator(aircraft, cost_of(p))
    routes = ("Riccati equation", "spectral factorisation")
    r.value("autopilot_gain", best.L[0], "1, s", symbol="L", agrees=answer, routes=routes)
    r.value("autopilot_filter_gain", best.K[:, 0], "1/s, 1/s²", symbol="K", agrees=answer, routes=routes)
    r.value("autopilot_cost_continuous", best.cost.value, "m²", symbol=r"J_\text{cont}", agrees=answer, routes=("separation", "integrals of the closed loop"))
    r.value("altitude_variance", best.closed.steady().x.P[0, 0], "m²", symbol="E h^2", agrees=answer, routes=("Lyapunov equation", "integrals of the closed loop"))
    budget = cost_budget(best)
    r.check("cost by its sources", sum(budget.sources.values()), answer["autopilot_cost_continuous"], ("sum over the noises", "integrals of the closed loop"))
    r.says("The regulator brings the standard deviation of the altitude from {free:3} m down to {held:3} m. Of its cost of {J:4} m² the noise of the command makes {w:4} m² and that of the sensor {v:4} m².",
           free=answer["altitude_variance_free"] ** 0.5, held=answer["altitude_variance"] ** 0.5, J=answer["autopilot_cost_continuous"], w=next(iter(budget.sources.values())), v=list(budget.sources.values())[-1])
    sampled(r, p, answer, aircraft)


def _alone(free):
    """The aircraft without an input."""
    return DiscreteModel(free.Phi, free.Qd, free.H, free.R, P0=free.P0, dt=free.dt)


def sampled(r, p, answer, aircraft):
    """The period and the delay."""
    found = regulator(aircraft, cost_of(p), dt=p.dt_a)
    routes = ("doubling and Riccati equation", "matrix exponential and quadrature")
    r.value("autopilot_gain_sampled", found.L[0], "1, s", symbol=r"L\ (h_a)", agrees=answer, routes=routes)
    r.value("autopilot_cost", found.cost.value, "m²", symbol=r"J(h_a)", agrees=answer, routes=routes)
    r.check("cost of the sampled autopilot", found.cost.closed_loop, answer["autopilot_cost"], ("covariances of the closed loop", "matrix exponential and quadrature"))
    late = regulator(aircraft, cost_of(p), dt=p.dt_a, delay=p.dt_a)
    r.value("autopilot_cost_delayed", late.cost.value, "m²", symbol=r"J(h_a,\ \tau = h_a)", agrees=answer, routes=("inputs on their way as states", "prediction of one period"))
    r.value("losing_period", observability.loss_by_sampling(aircraft, 30.0).losing_periods[0], "s", symbol=r"h_\text{lost}", agrees=answer, routes=("eigenvalues", "closed form"))
    r.says("**Sampled**, with the exact cost between the samples, the regulator costs {J:4} m² at the period {h} s, {more:3} % more than the continuous one. If its answer is a whole period late it costs {late:4} m²: the state that counts is then a prediction of one period.",
           J=answer["autopilot_cost"], h=p.dt_a, more=100 * (answer["autopilot_cost"] / answer["autopilot_cost_continuous"] - 1), late=answer["autopilot_cost_delayed"])
    lost = answer["losing_period"]
    h = lost * np.linspace(0.01, 2.4, 121)
    on_time, half = (np.array([by_hand.sampled(p, each, late * each)[0] for each in h]) for late in (0, 0.5))
    some = np.array([0.3, 0.99, 1.5, 2.2]) * lost
    r.check("cost against the period", periods(aircraft, cost_of(p), some).cost, [by_hand.sampled(p, each)[0] for each in some], routes)
    each = float(some[1])
    r.check("cost with a delay of half a period", regulator(aircraft, cost_of(p), dt=each, delay=each / 2).cost.value, by_hand.sampled(p, each, each / 2)[0], ("inputs on their way as states", "prediction of half a period"))
    curves = (Curve("on time", h, on_time, "blue"), Curve("half a period late", h, half, "orange", "dash"),
              Curve("the given period", [p.dt_a], [answer["autopilot_cost"]], "black", "points", size=5.0))
    levels = (Mark("left alone", answer["altitude_variance_free"], style="dot"), Mark("continuous", answer["autopilot_cost_continuous"], colour="green", style="dot"))
    r.figure("autopilot", Drawing("Autopilot", "period of the regulator, s", (Panel("cost J, m²", curves, kind="count", levels=levels),), marks=(Mark("half the period of the oscillation", lost),)),
             "Cost of the autopilot's regulator against its period. Near half the period of the oscillation it is hardly better than none.")
    on, behind = (by_hand.sampled(p, lost, late * lost)[0] for late in (0, 0.5))
    r.says("{fig:autopilot} has a peak at {lost:3} s, half the period of the autopilot's own oscillation: the samples then see, and the held input moves, only one of its two phases. The same happens at the multiples of that period. At the peak the regulator costs {on:4} m², where the aircraft left alone has {free:4} m². The dashed curve has a lower peak: with an answer that comes half a period late the regulator costs {behind:4} m² there.",
           lost=lost, on=on, free=answer["altitude_variance_free"], behind=behind)
