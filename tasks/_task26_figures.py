"""Lab 26's figures: the loop near −1, cost and margins against gain, weights and fictitious noise."""

import numpy as np
from ctlabs.tasks.answers import task26 as by_hand

from ctlabs.reporting.drawing import Curve, Drawing, Mark, Panel


def response(above, below, omega):
    """A quotient of polynomials at iω."""
    s = 1j * omega
    return np.polyval(above, s) / np.polyval(below, s)


def nyquist(r, answer):
    """The frequency responses of both loops near −1."""
    f, k = answer["feedback_gain"][0], answer["filter_gain"]
    N, D = by_hand.compensator(f, k)
    omega = np.geomspace(1e-3, 1e4, 4000)
    curves = []
    for name, above, below, colour in (("state estimated", N, np.polymul(by_hand.PLANT, D), "orange"), ("state known", f * np.array([1.0, 0.0]), by_hand.PLANT, "blue")):
        found = response(above, below, omega)
        x, y = np.concatenate([found.real, found.real[::-1]]), np.concatenate([found.imag, -found.imag[::-1]])
        near = (np.abs(x + 1) < 1.7) & (np.abs(y) < 1.3)
        curves.append(Curve(name, np.where(near, x, np.nan), np.where(near, y, np.nan), colour, every=True))
    turn = np.linspace(0, 2 * np.pi, 121)
    curves.append(Curve("distance 1 from −1", np.cos(turn) - 1, np.sin(turn), "grey", "dash"))
    curves.append(Curve("−1", [-1.0], [0.0], "black", "cross", size=8.0))
    r.figure("nyquist", Drawing("Frequency responses", "real part (ratio)", (Panel("imaginary part (ratio)", tuple(curves), reach=(-1.3, 1.3)),), square=True, reach=(-2.7, 0.7), height=5.0),
             "Frequency responses of the two open loops near −1. With the state known the curve stays outside the circle; with the estimate it runs through the circle, close by −1.")
    r.says("{fig:nyquist} shows both loops. The plant has two unstable poles, so each curve has to go round −1 twice; the optimal feedback of a known state does so at a distance of at least 1, the optimal regulator with an estimate close by.")


def against_gain(r, p, answer):
    """Cost against the true gain."""
    low, high = answer["gain_margins"]
    d = answer["filter_gain"]
    top = 6.0 * answer["cost"]
    m = np.unique(np.concatenate([low + (1 - low) * np.geomspace(1e-3, 1, 60), high - (high - 1) * np.geomspace(1e-3, 1, 60)]))
    J = [by_hand.cost(p, d, each) for each in m]
    curves = [Curve("optimal regulator", 100 * (m - 1), [np.nan if x is None else x for x in J], "orange"),
              Curve("m = 1", [0.0], [answer["cost"]], "black", "points", size=5.0)]
    wide = np.linspace(low, high, 41)
    other = [by_hand.cost(p, by_hand.estimator(p.sigma, p.mu), each) for each in wide]
    curves.append(Curve("with the filter of (e)", 100 * (wide - 1), [np.nan if x is None else x for x in other], "blue", "dash"))
    marks = (Mark("bounds", 100 * (low - 1)), Mark("", 100 * (high - 1)))
    r.figure("gain", Drawing("Cost", "error of the input's gain, m − 1, %", (Panel("cost J (units of the plant)", tuple(curves), kind="count", reach=(0.0, top)),), marks=marks),
             "Cost against the true strength of the input. The optimal regulator is the best at m = 1 and useless a little way off; that of part (e) costs more and bears the error.")
    r.says("In {fig:gain} the cost of the optimal regulator goes to infinity at both bounds of {eq:bounds}. Nothing at $m = 1$ announces it.")


def against_weights(r):
    """The distances of the bounds from 1."""
    weight = np.geomspace(1e-1, 1e6, 121)
    exact = np.array([by_hand.closed_margins(g, g) for g in map(by_hand.gain, weight)])
    known = np.array([1 - 2 / by_hand.gain(w) for w in weight])
    curves = (
        Curve("too strong by", weight, 100 * (exact[:, 1] - 1), "orange"), Curve("too weak by", weight, 100 * (1 - exact[:, 0]), "blue"),
        Curve("too weak by, state known", weight, 100 * known, "green", "dash"),
    )
    r.figure("margins", Drawing("Margins", "weight and noise, q = σ (ratio)", (Panel("error of the gain that is borne, %", curves, kind="log"),), log=True),
             "Errors of the input's gain that the optimal loop bears. With the state known it bears at least one half, and any gain that is too strong.")
    r.says("{fig:margins} and {tab:weights} show the bounds for equal $q$ and σ: the upper one approaches 1 like $1/q$, the lower one like $1/\\sqrt{q}$.")


def recovery(r, p, answer):
    """Price and margins against the fictitious noise."""
    mu = np.geomspace(1e-1, max(1e5, 10 * p.mu), 81)
    f = answer["feedback_gain"][0]
    gains = [by_hand.estimator(p.sigma, each) for each in mu]
    price = np.array([by_hand.cost(p, k, 1.0) for k in gains]) / answer["cost"]
    bounds = np.array([by_hand.gain_margins(f, k) for k in gains])
    above = Panel("cost J relative to the least", (Curve("price", mu, price, "orange"),), kind="log")
    edges = (Curve("upper bound", mu, bounds[:, 1], "blue"), Curve("lower bound", mu, bounds[:, 0], "green"))
    below = Panel("gains m that are borne", edges, kind="count", levels=(Mark("lower bound, state known", answer["known_state_margin"], style="dot"),))
    marks = (Mark("the given μ", p.mu),) if p.mu >= mu[0] else ()
    r.figure("recovery", Drawing("Recovery", "noise μ at the input that the filter believes in (ratio)", (above, below), log=True, marks=marks),
             "What the remedy costs, and what it buys. The lower bound tends to that of the known state, the upper one has no limit.")
    r.says("In {fig:recovery} the price of the first wider margins is small, and it rises faster than the margins do: where the loop is nearly that of the known state, the filter passes on nearly all of the sensor's noise.")
