"""A random field: the difference scheme, its stability, and the three errors of the printed filter."""

import numpy as np

from ctlabs import DiscreteModel, actual_errors, covariances

alpha = beta = 0.1
sigma_n, sigma_eta, b20, b11, dt, h, N1, m, P0 = 1.0, 3.0, 0.25, 1.0, 0.2, 1.0, 30, 100, 10.0

# the scheme: z_i' = z_i + Δt z*_i, z*_i' = e0 z*_i + e2 z_i − e3 z_(i−1) − e1 z*_(i−1) + e4 η_i; node 0 keeps its values
e0, e1 = 1 - dt * (beta + b11 / h) / b20, -dt * b11 / (h * b20)
e2, e3 = -dt * (alpha * beta + alpha / h) / b20, -dt * alpha / (h * b20)
e4 = dt * np.sqrt(4 * alpha * beta) / b20
N = N1 + 1
inner, left = np.eye(N), np.eye(N, k=-1)
inner[0, 0] = 0.0
first = np.eye(N) - inner
Phi = np.block([[np.eye(N), dt * inner], [e2 * inner - e3 * left, e0 * inner - e1 * left + first]])
Qd = np.zeros((2 * N, 2 * N))
Qd[N:, N:] = (e4 * sigma_eta) ** 2 * inner

# (stability): the eigenvalues of one block, and the factor of the waves of all wave numbers
spectral_radius = abs(np.linalg.eigvals([[1.0, dt], [e2, e0]])).max()
w = np.exp(-1j * np.linspace(0, np.pi, 2001))
mu = [np.roots([b20, beta + b11 * (1 - x) / h, alpha * (beta + (1 - x) / h)]) for x in w]
factor = max(abs(1 + dt * each).max() for each in mu)

# (theory): the field starts from rest, the printed filter believes in P0; the best causal filter knows the start
H, R = np.eye(N, 2 * N), sigma_n**2 * np.eye(N)
truth = DiscreteModel(Phi, Qd, H, R, P0=np.zeros((2 * N, 2 * N)), dt=dt)
design = DiscreteModel(Phi, Qd, H, R, P0=P0 * np.eye(2 * N), dt=dt)
errors, best = actual_errors(truth, design, steps=m), covariances(truth, steps=m)


def root_mean(P):
    """Root of the average variance over all nodes and the given steps."""
    return np.sqrt(np.diagonal(P, axis1=1, axis2=2)[:, :N].mean())


sigma_eps_true, sigma_eps_filter, sigma_eps_bound = root_mean(errors.P_plus), root_mean(errors.claimed.P_plus[1:]), root_mean(best.P_plus)

print(f"largest eigenvalue {spectral_radius:.5f}, largest factor of a wave {factor:.5f}")
print(f"σ_ε: true {sigma_eps_true:.5f}, claimed {sigma_eps_filter:.5f}, least {sigma_eps_bound:.5f} u")
