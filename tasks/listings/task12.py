"""Lab 12: two measurements at once or one after another."""

import math

import numpy as np

from ctlabs import DiscreteModel, kalman_filter

Phi, b, Q, x, P, z, t, R12 = 0.7, 0.2, 0.01, 4.0, 1.0, [3.0, 1.0], 1.0, 0.3
H, R = np.array([[2.0], [math.sin(t)]]), np.diag([1.0, math.cos(t) ** 2])


def updated(x0, P0, H, R, z):
    """[estimate, variance] after one update at t0."""
    model = DiscreteModel(Phi=[[1]], Qd=[[0]], H=H, R=R, x0=[x0], P0=[[P0]], first=0)
    found = kalman_filter(model, [z])
    return [found.x_plus[0, 0], found.P_plus[0, 0, 0]]


# (a): the prediction
prior = [Phi * x + b, Phi**2 * P + Q]

# (c): the linear reading, both ways
after_z1 = updated(*prior, H[:1], R[:1, :1], z[:1])
linear_sequential = updated(*after_z1, H[1:], R[1:, 1:], z[1:])
linear_joint = updated(*prior, H, R, z)

# (d): correlated noises, at once, ignored, and decorrelated by R = L D Lᵀ
correlated = np.array([[R[0, 0], R12], [R12, R[1, 1]]])
correlated_joint = updated(*prior, H, correlated, z)
correlated_sequential_naive = linear_sequential
L = np.array([[1, 0], [R12 / R[0, 0], 1]])
D, H_new, z_new = np.linalg.solve(L, np.linalg.solve(L, correlated).T), np.linalg.solve(L, H), np.linalg.solve(L, z)
first = updated(*prior, H_new[:1], D[:1, :1], z_new[:1])
correlated_sequential_decorrelated = updated(*first, H_new[1:], D[1:, 1:], z_new[1:])

print("prior:", prior, "after z1:", after_z1)
print("linear, one after another:", linear_sequential, "at once:", linear_joint)
print("correlated, at once:", correlated_joint, "decorrelated:", correlated_sequential_decorrelated)
