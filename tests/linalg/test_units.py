"""Units that make a matrix even, of any scales."""

import numpy as np
import pytest

from ctlabs.linalg.units import even


@pytest.mark.parametrize("decades", [0, 10, 25, 60])
def test_what_was_even_is_found_again_in_any_units(decades):
    """Powers of two round nothing; rows and columns differ little, however wide the units were.

    LAPACK scales no further where a factor of two lessens the norms c and r by less than a twentieth: 2c + r/2 ≥ 0.95(c + r).
    """
    rng = np.random.default_rng(decades)
    A, units = rng.normal(size=(5, 5)), np.exp2(rng.integers(-3 * decades, 3 * decades + 1, 5))
    found, D = even(A * units / units[:, None])
    assert (np.frexp(D)[0] == 0.5).all()
    assert np.array_equal(found * D[:, None] / D, A * units / units[:, None])
    c, r = (np.linalg.norm(found, axis=axis) for axis in (0, 1))
    assert (2 * np.minimum(c, r) + np.maximum(c, r) / 2 >= 0.95 * (c + r)).all()
