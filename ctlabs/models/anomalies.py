"""Measurements that fail, or are exact, for a while."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ctlabs.models.linear import DiscreteModel


@dataclass(frozen=True, slots=True)
class Anomaly:
    """Another variance of a measurement (index ``measurement``) from instant ``k`` to ``last`` (``k`` alone, if None):
    ``R`` = inf (it fails, and the filter knows) or 0 (it is exact for once); any other variance is allowed.
    """

    k: int
    measurement: int = 0
    R: float = math.inf
    last: int | None = None

    def check(self) -> None:
        """Refuse in one line what no anomaly can be."""
        for name, value in (("k", self.k), ("last", self.last), ("measurement", self.measurement)):
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 0):
                msg = f"anomaly.{name}: expected a whole number >= 0, received {value!r:.60}"
                raise ValueError(msg)
        if self.last is not None and self.last < self.k:
            msg = f"anomaly.last: expected an instant from {self.k} on, received {self.last}"
            raise ValueError(msg)
        if not self.R >= 0:
            msg = f"anomaly.R: expected a variance >= 0 (or inf: not measured), received {self.R!r}"
            raise ValueError(msg)


def anomalous(model: DiscreteModel, anomalies: Sequence[Anomaly], steps: int) -> DiscreteModel:
    """The model with other variances at some instants: R becomes (steps+1, m, m).

    Raises
    ------
    ValueError
        A model with N, which belongs to one R; an instant or a measurement that is not there.

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[4]], x0=[0], P0=[[1]])
    >>> anomalous(walk, [Anomaly(2, 0, 0.0)], 3).R[:, 0, 0]
    array([4., 4., 0., 4.])
    """
    if not anomalies:
        return model
    if model.N is not None:
        msg = "anomaly: expected a model whose two noises are independent, received one with N (it belongs to one R)"
        raise ValueError(msg)
    R = np.array(np.broadcast_to(model.R, (steps + 1, model.m, model.m)))
    for anomaly in anomalies:
        i, last = anomaly.measurement, anomaly.k if anomaly.last is None else anomaly.last
        if i >= model.m or last > steps:
            name, most, got = ("measurement", model.m - 1, i) if i >= model.m else ("k", steps, last)
            msg = f"anomaly.{name}: expected a whole number from 0 to {most}, received {got}"
            raise ValueError(msg)
        at = slice(anomaly.k, last + 1)
        R[at, i, :] = R[at, :, i] = 0.0
        R[at, i, i] = anomaly.R
    return dataclasses.replace(model, R=R)
