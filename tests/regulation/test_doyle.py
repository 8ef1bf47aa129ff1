"""Doyle's plant, whose margins are closed formulas and as small as one likes."""

import numpy as np
import pytest

from ctlabs import ContinuousModel, Cost, regulator
from ctlabs.regulation import margins

pytestmark = pytest.mark.numerical


@pytest.mark.parametrize(("q", "sigma"), [(60.0, 60.0), (1.0, 5.0), (1e4, 1e2), (0.01, 1e3)])
def test_the_margins_of_doyles_plant(q, sigma):
    """J. C. Doyle, IEEE Trans. AC-23 (1978), 756: gains f, d; with p = df the loop bears less than 1/p; at rest −1 is 1/(1 + p) away."""
    plant = ContinuousModel([[1, 1], [0, 1]], [[1], [1]], [[sigma]], [[1, 0]], B=[[0], [1]], Rc=[[1]], P0=np.zeros((2, 2)))
    found = regulator(plant, Cost(q * np.ones((2, 2)), [[1]]))
    f, d = 2 + np.sqrt(4 + q), 2 + np.sqrt(4 + sigma)
    p, D, c = f * d, (f - 2) * (d - 2), f + d - 4
    np.testing.assert_allclose(found.L, [[f, f]], rtol=1e-12)
    np.testing.assert_allclose(found.K, [[d], [d]], rtol=1e-12)
    assert found.cost.value == pytest.approx(5 * p * c, rel=1e-12)
    own = margins(found).inputs["u"]
    low = 1 + c * (2 * D + c - np.sqrt((2 * D + c) ** 2 + 16 * D)) / (8 * p)  # Hurwitz
    np.testing.assert_allclose(own.gain, [low, 1 + 1 / p], rtol=1e-9)
    assert own.modulus == pytest.approx(1 / (1 + p), rel=1e-9)
    assert own.disk == pytest.approx(2 / (1 + 2 * p), rel=1e-9)
