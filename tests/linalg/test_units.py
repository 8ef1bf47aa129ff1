"""Units that make a matrix even, of any scales."""

import numpy as np
import pytest

from ctlabs.linalg.units import even


@pytest.mark.parametrize("decades", [0, 10, 25, 60])
def test_what_was_even_is_found_again_in_any_units(decades):
    """Powers of two round nothing; rows and columns differ by a factor of about two at most, however wide the units were."""
    rng = np.random.default_rng(decades)
    A, units = rng.normal(size=(5, 5)), np.exp2(rng.integers(-3 * decades, 3 * decades + 1, 5))
    found, D = even(A * units / units[:, None])
    assert (np.frexp(D)[0] == 0.5).all()
    assert np.array_equal(found * D[:, None] / D, A * units / units[:, None])
    off = np.abs(found - np.diag(np.diag(found)))
    ratio = off.sum(axis=0) / off.sum(axis=1)
    assert (ratio < 4).all()
    assert (ratio > 0.25).all()
