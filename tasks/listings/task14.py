"""Lab 14: two map fixes at ten instants; every selection tried with the covariances of the library."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from ctlabs import DiscreteModel, covariances

sigma, high, limit, horizon, fixes = 30.0**2, 90.0**2, 75.0, 10, 2
cases = {"a": (sigma, sigma, sigma, np.inf), "b": (sigma, sigma, sigma, limit), "c": (high, sigma, sigma, limit),
         "d": (sigma, high, sigma, limit), "e": (sigma, sigma, high, limit)}
found, possible = {}, {}
for part, (P0, Qd, R, most) in cases.items():
    model, tried = DiscreteModel(Phi=[[1]], Qd=[[Qd]], H=[[1]], R=[[R]], P0=[[P0]]), []
    for instants in combinations(range(horizon), fixes):
        noise = np.full((horizon + 1, 1, 1), np.inf)  # R = ∞: no fix
        noise[list(instants)] = R
        rms = covariances(replace(model, R=noise), horizon, first=0).sd_minus[:, 0]
        if rms[list(instants)].max() <= most * (1 + 1e-12):
            tried.append((rms[-1], instants))
    found[part], possible[part] = min(tried, default=(None, None)), len(tried)

pairs = possible["a"]
(a_terminal_rms, a_best_pair), (b_terminal_rms, b_best_pair), (e_terminal_rms, e_best_pair) = found["a"], found["b"], found["e"]
b_feasible_pairs, c_feasible_pairs, d_feasible_pairs, e_feasible_pairs = (possible[part] for part in "bcde")

print(f"{pairs} selections")
for part, (rms, instants) in found.items():
    print(f"({part}) {possible[part]:2d} possible:", "none" if rms is None else f"best {instants}, RMS {rms:.3f} m at the end")
