"""Which state of one model stands for which of another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel


def selection(truth: Sequence[str], design: Sequence[str]) -> Array | None:
    """E (d, n) with which each state of the design stands for the truth's of that name; where no name is common, of that place.

    None where some names are common and others not, or the numbers differ.
    """
    if not set(design) & set(truth) and len(design) == len(truth):
        return np.eye(len(truth))
    if not set(design) <= set(truth):
        return None
    return np.array([[float(name == other) for other in truth] for name in design])


def stands_for(truth: DiscreteModel, design: DiscreteModel) -> Array:
    """Which of the truth's states each of the design's stands for, (d, n): ``compare`` of :func:`ctlabs.actual_errors`, by the names.

    Raises
    ------
    ValueError
        A design whose measurements, or some of whose states, are not the truth's.

    >>> truth = DiscreteModel([[1, 1], [0, 1]], [[0, 0], [0, 1]], [[1, 0]], [[1]], P0=[[1, 0], [0, 1]], states=["x", "v"])
    >>> stands_for(truth, DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], states=["x"]))
    array([[1., 0.]])
    """
    common = set(design.measurements) & set(truth.measurements)
    if design.m != truth.m or (common and design.measurements != truth.measurements):
        wanted, found = ", ".join(truth.measurements), ", ".join(design.measurements)
        order = " in this order" if sorted(design.measurements) == sorted(truth.measurements) else ""
        msg = f"design: expected the model's measurements ({wanted}){order}, received {found}"
        raise ValueError(msg)
    E = selection(truth.states, design.states)
    if E is None:
        wanted, found = ", ".join(truth.states), ", ".join(design.states)
        msg = f"design: expected states among the model's ({wanted}), received {found}"
        raise ValueError(msg)
    return E
