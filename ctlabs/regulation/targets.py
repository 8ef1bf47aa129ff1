r"""Where a plant shall come to rest: set points, constant inputs from outside, loads that the filter estimates.

Loads d are states of the model that nothing else moves, :math:`d_{k+1} = A_dd_k + w_d` (a constant: A_d = 1). For each of them the
plant has a motion :math:`x = Xd,\ u = Ud` along which the outputs :math:`y = Cx + C_dd` that are held stay zero:

.. math:: XA_d = \Phi X + BU + E, \qquad CX + C_d = 0

(in continuous time with F, the same), and set points and constants are the case A_d = 1 (A_d = 0 in continuous time). The regulator
works on what differs from that motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import ContinuousModel, DiscreteModel

#: A motion exists when its equations hold to this part of their terms.
HELD = 1e-9


class Target(NamedTuple):
    """The motion of the state and of the inputs: ``X`` (n, q), ``U`` (r, q)."""

    X: Array
    U: Array


def motion(A: Array, B: Array, C: Array, moved: Array, seen: Array, own: Array, name: str) -> Target:
    """X and U with X·own = AX + BU + moved and CX + seen = 0; of several the one with the least X and U in the plant's own units.

    >>> A, B, C = np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]])
    >>> motion(A, B, C, np.zeros((1, 1)), -np.eye(1), np.eye(1), "set point")
    Target(X=array([[1.]]), U=array([[0.5]]))
    """
    n, r, q = len(A), B.shape[1], len(own)
    # vec(AX − X·own + BU) and vec(CX), columns stacked.
    left = np.kron(np.eye(q), A) - np.kron(own.T, np.eye(n))
    whole = np.block([[left, np.kron(np.eye(q), B)], [np.kron(np.eye(q), C), np.zeros((len(C) * q, r * q))]])
    right = -np.concatenate([moved.T.ravel(), seen.T.ravel()])
    # Rows and columns in units of their own: the least solution must not depend on the user's.
    rows = np.abs(whole).max(axis=1, initial=0.0)
    rows = np.where(rows > 0, rows, 1.0)
    columns = np.abs(whole / rows[:, None]).max(axis=0, initial=0.0)
    columns = np.where(columns > 0, columns, 1.0)
    scaled = whole / rows[:, None] / columns
    found = np.linalg.lstsq(scaled, right / rows, rcond=1e-13)[0]
    left_over = np.abs(scaled @ found - right / rows)
    terms = np.abs(scaled) @ np.maximum(np.abs(found), np.abs(found).max(initial=0.0)) + np.abs(right / rows)
    if (left_over > HELD * terms).any():
        msg = (
            f"{name}: expected a plant whose inputs can hold these outputs ({len(C)} outputs, {r} inputs), received one without "
            "such a state of rest (a zero of the plant, or more outputs than inputs)"
        )
        raise ValueError(msg)
    found = found / columns
    return Target(found[: n * q].reshape(q, n).T, found[n * q :].reshape(q, r).T)


def places(name: str, chosen: Sequence[str] | str, known: tuple[str, ...]) -> list[int]:
    """Indices of names.

    >>> places("track", ["b"], ("a", "b"))
    [1]
    """
    names = [chosen] if isinstance(chosen, str) else list(chosen)
    for each in names:
        if each not in known:
            msg = f"{name}: expected names of {', '.join(repr(k) for k in known)}, received {each!r}"
            raise ValueError(msg)
    if len(set(names)) < len(names):
        msg = f"{name}: expected names that differ, received {names}"
        raise ValueError(msg)
    return [known.index(each) for each in names]


def check_loads(model: ContinuousModel | DiscreteModel, loads: list[int]) -> None:
    """Refuse a load that other states or the inputs move."""
    A = model.F if isinstance(model, ContinuousModel) else model.Phi
    rest = [i for i in range(model.n) if i not in loads]
    assert model.B is not None
    for i in loads:
        if A[i, rest].any() or model.B[i].any():
            msg = f"loads: expected a state that neither the inputs nor other states move, received {model.states[i]!r}"
            raise ValueError(msg)


def tracked(
    model: ContinuousModel | DiscreteModel, track: Sequence[str] | Mapping[str, ArrayLike], integrals: list[int], needed: bool
) -> tuple[Array, tuple[str, ...]]:
    """The rows of the outputs that follow set points, (p, n), and their names: integrated ones first.

    Raises
    ------
    ValueError
        Unknown names; more outputs than inputs; none where one is ``needed``.
    """
    if isinstance(track, Mapping):
        rows = [checks.shaped(f"track[{name!r}]", row, (model.n,)) for name, row in track.items()]
        names = list(track)
    else:
        chosen = [i for i in places("track", track, model.measurements) if i not in integrals]
        rows, names = [model.H[i] for i in chosen], [model.measurements[i] for i in chosen]
    names = [model.measurements[i] for i in integrals] + names
    rows = [model.H[i] for i in integrals] + rows
    if needed and not names and model.m == model.r:
        return np.array(model.H), model.measurements
    if needed and not names:
        msg = "track: expected the outputs that a load shall not move, by name, received none"
        raise ValueError(msg)
    if len(names) > model.r:
        msg = f"track: expected at most {model.r} outputs, as many as inputs, received {len(names)}"
        raise ValueError(msg)
    return np.array(rows).reshape(len(names), model.n), tuple(names)


class Tracking(NamedTuple):
    """What is asked of a regulator beside its cost.

    ``integrals``, indices of measurements · ``loads``, of states · ``C`` (p, n) and ``names``, the tracked outputs · ``weights`` of the
    integrals, per unit of time
    """

    integrals: list[int]
    loads: list[int]
    C: Array
    names: tuple[str, ...]
    weights: Array


def asked(
    model: ContinuousModel | DiscreteModel,
    integral: Mapping[str, float],
    loads: Sequence[str],
    track: Sequence[str] | Mapping[str, ArrayLike],
) -> Tracking:
    """The options of :func:`ctlabs.regulation.regulator`, by index.

    Raises
    ------
    ValueError
        Names that the model does not have; more outputs than inputs; integrals beside loads; weights that are not positive.
    """
    chosen = places("integral", list(integral), model.measurements)
    held = places("loads", loads, model.states)
    C, names = tracked(model, track, chosen, bool(held))
    if chosen and held:
        msg = "integral: expected none beside loads (each keeps the outputs free of a load; choose one), received both"
        raise ValueError(msg)
    own = np.array([checks.positive(f"integral[{name!r}]", weight) for name, weight in integral.items()])
    return Tracking(chosen, held, C, names, own)
