"""The Kalman–Bucy observer with coloured plant noise: the augmented model, its steady state, and a filter for white noise."""

import math

import numpy as np

from ctlabs import ContinuousModel, augment, covariances, steady_state

a, b, alpha, D, r, p0 = -1.0, 1.0, 2.0, 1.0, 0.5, 1.0

# (model): K(τ) = D exp(−α|τ|) has the shaping filter √(2Dα)/(s + α), of variance D; it drives the plant
shaping = ContinuousModel(F=[[-alpha]], G=[[math.sqrt(2 * D * alpha)]], Q=[[1]], H=[[1]], P0=[[D]], states=["w"])
plant = ContinuousModel(F=[[a]], G=[[b]], Q=[[0]], H=[[1]], Rc=[[r]], P0=[[p0]], states=["x"])
model = augment(plant, shaping)

# (example): the steady observer, its polynomial, and the way there
limit = steady_state(model)
covariance_steady, gain_steady = limit.P, limit.K[:, 0]
filter_polynomial = np.real(np.poly(model.F - limit.K @ model.H))
covariance_continuous = covariances(model, [0.25, 0.5, 1.0, 2.0]).P

# (white): the claim of a filter for white noise of the strength S(0) = 2D/α, and its true variance
white = steady_state(ContinuousModel(F=[[a]], G=[[b]], Q=[[2 * D / alpha]], H=[[1]], Rc=[[r]], P0=[[p0]]))
white_claimed_variance, gain = white.P[0, 0], white.K[0, 0]
rate = gain - a
white_actual_variance = gain**2 * r / (2 * rate) + b**2 * D / (rate * (rate + alpha))

print("P:", covariance_steady, "K:", gain_steady, "polynomial:", filter_polynomial, sep="\n")
print(f"white noise assumed: claimed {white_claimed_variance:.6f} m², true {white_actual_variance:.6f} m², optimum {limit.P[0, 0]:.6f} m²")
