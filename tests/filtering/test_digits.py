"""Estimates of which doubles hold too few digits are said to be so, and no others."""

import numpy as np
import pytest

from ctlabs import DiscreteModel, kalman_filter, smooth

pytestmark = pytest.mark.numerical


def clock(sd: float, unit: float = 1.0) -> DiscreteModel:
    """Seconds since 1970, measured with σ = ``sd``."""
    return DiscreteModel([[1]], [[0]], [[1]], [[(sd * unit) ** 2]], x0=[1.7e9 * unit], P0=[[(1e4 * unit) ** 2]], states=["clock"])


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e9])
@pytest.mark.parametrize("verb", [kalman_filter, smooth])
def test_digits_that_doubles_do_not_have_are_missed_in_every_unit(verb, unit):
    """σ of a nanosecond beside 1.7e9 s: 119 ns is the half of the last digit."""
    found = verb(clock(1e-9, unit), [1.7e9 * unit])
    assert len(found.remarks) == 1
    assert "clock" in found.remarks[0]
    assert "rounding is at least 1e+02 of it" in found.remarks[0] or "rounding is at least 100 of it" in found.remarks[0]


def test_what_doubles_hold_is_not_complained_of():
    """σ of minutes; and a state that a perfect sensor determines, whose variance is rounding."""
    assert kalman_filter(clock(100.0), [1.7e9]).remarks == ()
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    exact = DiscreteModel(turn, np.diag([0.0, 1e-3]), [[0.3, 0.7]], [[0.0]], x0=[1, 2], P0=np.eye(2))
    assert smooth(exact, [0.1, 0.2, 0.3, 0.4]).remarks == ()
