"""What of a truth reaches the error of a filter for ever: its constants and stable modes, or nothing that has a limit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import mode

#: A mode of the truth is on the unit circle when Φ − λI is singular to this accuracy for a λ of modulus 1.
UNIT = 1e-12


class Reaching(NamedTuple):
    """What of the truth reaches the error: x = from_y y + from_s s + (the rest); y constant, s stable.

    ``to_y``, ``to_s`` give y and s of x (as rows), ``from_y``, ``from_s`` their directions as the error sees them.
    """

    to_y: Array
    to_s: Array
    from_y: Array
    from_s: Array


def reaching(truth: DiscreteModel, coupling: Array) -> Reaching:
    """The smallest part of the truth that drives the error through ``coupling``: its constants and stable modes."""
    V = _rows(coupling)
    while len(wider := _rows(np.vstack([V, V @ truth.Phi]))) > len(V):
        V = wider
    one = np.eye(len(V))
    Phi = V @ truth.Phi @ V.T
    lasting = _lasting(Phi)
    to_y = _fixed(Phi.T).T if lasting else np.zeros((0, len(V)))
    if len(to_y) != len(lasting) or _moves(to_y @ V, truth):
        states = ", ".join(name for name, column in zip(truth.states, V.T, strict=True) if np.abs(column).max() > 1e-9)
        msg = (
            f"steady: expected stable modes and constants of the truth to drive the error, received the mode "
            f"{mode(max(lasting, key=abs))} of the states {states}, which grows or wanders: there is no limit"
        )
        raise ValueError(msg)
    from_y, S = np.zeros((len(V), 0)), one
    if lasting:
        from_y, S = _fixed(Phi), scipy.linalg.null_space(to_y)
        from_y = from_y @ np.linalg.inv(to_y @ from_y)
    # S spans an invariant subspace of Phi: s = Sᵀ(I − from_y to_y)Vx moves by SᵀΦS.
    return Reaching(to_y @ V, S.T @ (one - from_y @ to_y) @ V, V.T @ from_y, V.T @ S)


def _moves(to_y: Array, truth: DiscreteModel) -> bool:
    """Whether noise or a known input enters the combinations ``to_y`` of the truth."""
    to_y = np.where(np.abs(to_y) > 1e-12 * np.abs(to_y).max(axis=1, keepdims=True), to_y, 0.0)
    inputs = np.column_stack([truth.Qd, np.zeros(truth.n) if truth.offset is None else truth.offset])
    return bool((np.abs(to_y @ inputs) > 1e-12 * np.abs(to_y) @ np.abs(inputs)).any())


def _rows(matrix: Array) -> Array:
    """Orthonormal basis (as rows) of the row space; rows of different units count alike."""
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    rows = matrix[size[:, 0] > 0] / size[size[:, 0] > 0]
    return scipy.linalg.orth(rows.T, rcond=1e-10).T if len(rows) else np.zeros((0, matrix.shape[1]))


def _fixed(Phi: Array) -> Array:
    """Orthonormal basis (as columns) of the vectors with Φx = x, to the accuracy of :func:`_lasting`."""
    _, sigma, rows = np.linalg.svd(Phi - np.eye(len(Phi)))
    return rows[sigma <= _unit(Phi)].T


def _lasting(Phi: Array) -> list[complex]:
    """The eigenvalues on or outside the unit circle.

    One of multiplicity j is computed with an error of the order eps^(1/j): a ramp's 1 may come out as 1 − 1e-8.
    """
    values = np.linalg.eigvals(Phi)
    found = []
    for value in values:
        short = 1 - abs(value)
        nearest = value / abs(value) if value else 1.0
        several = int((np.abs(values - nearest) <= 3 * short).sum())
        singular = np.linalg.svd(Phi - nearest * np.eye(len(Phi)), compute_uv=False)[-1] <= _unit(Phi)
        if short < 0 or (singular and short ** max(several, 1) <= 1e-14):
            found.append(complex(value))
    return found


def _unit(Phi: Array) -> float:
    return UNIT * max(1.0, np.abs(Phi).max())
