"""Lab 6: an alternating constant; a lost and a perfect measurement."""

import numpy as np

from ctlabs import DiscreteModel, covariances, kalman_filter

P0, R = 4.0, [1, 1, 1, 1, 1, 1]


def model(R):
    """x(i+1) = −x(i), measured with the variances R(1), R(2), …; R(0) is not used."""
    return DiscreteModel(Phi=[[-1]], Qd=[[0]], H=[[1]], R=np.reshape([R[0], *R], (-1, 1, 1)), P0=[[P0]])


# (a), (b): gain, variance and information along the given measurements
plan = covariances(model(R), steps=len(R))
gain, posterior_variance = plan.K[1:, 0, 0], plan.P_plus[1:, 0, 0]
posterior_information = 1 / posterior_variance

# a lost measurement and a perfect one: the first is dropped whatever it shows, after the second only the sign changes
found = kalman_filter(model([1, np.inf, 1, 0, 1, 1]), [1.2, 1e9, 0.9, -1.1, 3.0, -7.0])

print("K:", gain, "P⁺:", posterior_variance, "1/P⁺:", posterior_information, sep="\n")
print("with a lost and a perfect measurement:", found.x_plus[1:, 0], found.P_plus[1:, 0, 0], sep="\n")
