r"""From a model file to the models of the library.

A continuous file is discretised over every interval of its own, exactly where F, G and Q are constant. Where they vary
with t, the interval is cut into pieces on which they are frozen at the middle; the error of that has even powers of
the pieces' length only, so that repeated halving with extrapolation converges fast. An interval on which it does not, or on
which the matrices are not smooth (a kink, as of ``abs``; many periods of a sine), is cut in two, again and again. Every piece
is solved by :func:`ctlabs.models.discretisation.interval`: stiffness does no harm.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.files.modelfile.errors import ModelFileError, Problem
from ctlabs.files.modelfile.values import Instant, Instants, Regressors, Values
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import interval, intervals
from ctlabs.text import moment

#: Intervals that differ by less than this fraction are one.
UNIFORM = 1e-9
#: How far an instant of a discrete file may be off its grid, in periods.
JITTER = 0.01
#: Relative tolerance of varying matrices, the most often an interval is cut in two, and halvings of the extrapolation.
TOLERANCE, CUTS, HALVINGS = 1e-11, 48, 4
#: A matrix counts as smooth where a polynomial through these nodes has last coefficients below this fraction of it, or where
#: so many cuts have made the interval so short that nothing depends on it.
NODES, SMOOTH, TINY = np.cos(np.pi * np.arange(13) / 12), 1e-9, 34
TAIL = np.linalg.inv(np.polynomial.chebyshev.chebvander(NODES, 12))[-3:]


class Moved(NamedTuple):
    """What an interval does: x(end) = Phi x(start) + c + noise of covariance Qd."""

    Phi: Array
    Qd: Array
    c: Array

    def then(self, other: Moved) -> Moved:
        """The interval and another after it, as one."""
        return Moved(other.Phi @ self.Phi, other.Phi @ self.Qd @ other.Phi.T + other.Qd, other.Phi @ self.c + other.c)


#: F, GQGᵀ and Bu at a time.
System = Callable[[float], tuple[Array, Array, Array]]


def continuous(found: Values) -> ContinuousModel:
    """The model of a continuous file whose matrices do not vary."""
    if found.document.kind != "continuous":
        raise found.error(
            ("kind",), 'expected "continuous" (a discrete file has no continuous model), received "discrete"'
        )
    for name in ("F", "G", "Q", "B", "H", "D", "measurement_offset", "Rc"):
        for index, cell in found.cells(name) if found.given(name) else ():
            if regressors := found.named(cell):
                raise found.without_record(("model", name, *index), min(regressors))
            if not cell.constant:
                where = ("model", name, *index)
                raise found.error(
                    where, f"expected a constant (a ContinuousModel does not vary with time), received {cell.text}"
                )
    return _built(
        found,
        ContinuousModel,
        {name: _matrix(found, name) for name in ("F", "G", "Q", "H", "B", "D", "measurement_offset", "Rc", "N", "x0", "P0")},
    )


def _matrix(found: Values, name: str) -> Array | None:
    return found.constant(name) if found.given(name) else None


def discrete(
    found: Values,
    steps: int | None = None,
    times: ArrayLike | None = None,
    inputs: Array | None = None,
    regressors: Regressors | None = None,
) -> DiscreteModel:
    """The discrete model of a file, for ``steps`` periods dt from t0 or for given instants.

    ``inputs`` (steps+1, r) are the known inputs of a record in place of u (of the last instant only D asks), ``regressors`` its columns.
    """
    instants, gaps = _grid(found, steps, times)
    if regressors is not None:
        found = dataclasses.replace(found, regressors=regressors)
        _moves(found, len(instants))
    if inputs is not None:
        _takes(found, inputs, len(instants))
    x0 = _matrix(found, "x0")
    try:
        moves = (
            _discrete(found, instants, inputs)
            if found.document.kind == "discrete"
            else _sampled(found, instants, gaps, inputs)
        )
        R = _measured(found, "R", instants) if found.given("R") else _equivalent(found, instants, gaps)
        parts = {
            "x0": np.zeros(found.sizes.n) if x0 is None else x0,
            "P0": found.constant("P0"),
            "H": _measured(found, "H", instants),
            "R": R if regressors is None else _used(found, R, len(instants)),
            "measurement_offset": _added(found, instants, inputs),
            "dt": found.dt if found.document.kind == "discrete" else float(gaps.mean()),
        }
    except ValueError as error:
        raise _told(found, error) from None
    return _built(found, DiscreteModel, parts | moves)


def _built(found: Values, kind: Any, parts: dict[str, Any]) -> Any:
    """A model; what it refuses is told with its place in the file."""
    model = found.document.model
    labels = {"states": model.states, "units": model.units, "measurements": model.measurements}
    try:
        return kind(**parts, **labels)
    except ValueError as error:
        raise _told(found, error) from None


def _told(found: Values, error: ValueError) -> ModelFileError:
    """What the library says about a matrix, with its place in the file."""
    if isinstance(error, ModelFileError):
        return error
    name, _, message = str(error).partition(": ")
    if name in type(found.document.model).model_fields:
        return found.error(("model", name), message)
    return found.error(("model",), str(error))


def _grid(found: Values, steps: int | None, times: ArrayLike | None) -> tuple[Instants, Array]:
    """The instants and the intervals between them; intervals that are equal up to rounding are made equal."""
    if not 0 < found.dt < math.inf:
        raise found.error(("model", "dt"), f"expected a period > 0, s, received {found.dt:g}")
    if times is None:
        count = found.document.experiment.steps if steps is None else checks.count("steps", steps)
        return Instants(found.t0 + np.arange(count + 1) * found.dt), np.full(count, found.dt)
    t = checks.shaped("times", times, ("steps+1",))
    if len(t) < 2 or (steps is not None and len(t) != steps + 1):
        raise ValueError(
            f"times: expected {'2 or more' if steps is None else steps + 1} instants, t0 first, received {len(t)}"
        )
    gaps = np.diff(t)
    if (gaps <= 0).any():
        k = int(np.argmax(gaps <= 0)) + 1
        raise ValueError(f"times[{k}]: expected a time after {moment(t[k - 1], t[k])} s, received {moment(t[k], t[k - 1])} s")
    if found.document.kind == "discrete":
        _on_grid(found, t)
    mean = (t[-1] - t[0]) / len(gaps)
    if (np.abs(gaps - mean) <= UNIFORM * mean + 4 * np.spacing(np.abs(t).max())).all():
        gaps = np.full(len(gaps), mean)
    return Instants(t), gaps


def _on_grid(found: Values, t: Array) -> None:
    """A discrete file moves by its own period, and by nothing else."""
    grid = t[0] + found.dt * np.arange(len(t))
    off = np.abs(t - grid) > JITTER * found.dt
    if off.any():
        k = int(np.argmax(off))
        message = (
            f"expected {moment(grid[k], t[k])} s (a discrete model moves dt = {moment(found.dt)} s from row to row), "
            f"received {moment(t[k], grid[k])} s"
        )
        raise ModelFileError(Problem(f"times[{k}]", message), found.file)


def _measured(found: Values, name: str, instants: Sequence[Instant]) -> Array:
    """H or R at every instant; where it has no value at t0 and nothing is measured there, H of t1 and R = ∞ stand in."""
    if not found.varies(name):
        return found.constant(name)
    try:
        return found.stack(name, instants)
    except ModelFileError:
        if found.document.experiment.first == 0:
            raise
    rest = found.stack(name, instants[1:])
    at_start = np.diag(np.full(len(rest[0]), math.inf)) if name == "R" else rest[0]
    return np.concatenate([at_start[None], rest])


def _used(found: Values, R: Array, count: int) -> Array:
    """R with ``inf`` for what cannot be used, as a regressor beside it has no value; a row that is no covariance is named."""
    absent = found.absent(count)
    if absent.any():
        R = np.array(np.broadcast_to(R, (count, *R.shape[-2:])))
        R[absent[:, :, None] | absent[:, None, :]] = 0.0
        at, i = np.nonzero(absent)
        R[at, i, i] = math.inf
    if found.by_row("R"):
        try:
            checks.measurement_covariance("R", R, R.shape)
        except ValueError:
            for k, each in enumerate(R):
                _covariance(found, each, k)
    return R


def _covariance(found: Values, R: Array, k: int) -> None:
    """Refuse what is no covariance of the measurements of a row."""
    try:
        checks.measurement_covariance("R", R, R.shape)
    except ValueError as error:
        assert found.regressors is not None
        raise found.error(("model", "R"), f"{found.regressors.place(k)}: {str(error).removeprefix('R: ')}") from None


def _moves(found: Values, count: int) -> None:
    """Refuse a row without a regressor that B names: the state moves by it until the next row."""
    for index, cell in found.cells("B") if found.by_row("B") else ():
        for name in sorted(found.named(cell)):
            assert found.regressors is not None
            lacks = np.isnan(found.regressors.values[name][: count - 1])
            if lacks.any():
                where = found.regressors.place(int(lacks.argmax()))
                text = f"{where}: expected {name} at every instant (B moves the state by it until the next), received none"
                raise found.error(("model", "B", *index), text)


def _added(found: Values, instants: Sequence[Instant], inputs: Array | None) -> Array | None:
    """What is known of the measurements: Du and the offset, (m,) or (steps+1, m)."""
    parts = [_measured(found, "measurement_offset", instants)] if found.given("measurement_offset") else []
    if found.given("D") and (inputs is not None or found.given("u")):
        u = _measured(found, "u", instants) if inputs is None else inputs
        parts.append(np.einsum("...ij,...j->...i", _measured(found, "D", instants), u))
    return sum(parts[1:], parts[0]) if parts else None


def _takes(found: Values, inputs: Array, count: int) -> None:
    """Refuse inputs of a record that the file has no place for."""
    if not (found.given("B") or found.given("D")):
        raise found.error(("model", "B"), "expected B or D beside the inputs of a record, received neither")
    if len(inputs) != count:
        raise ValueError(f"inputs: expected {count}, one for each instant, received {len(inputs)}")
    if inputs.shape[1] != found.sizes.r:
        raise found.error(("model", "B"), f"expected {inputs.shape[1]} columns, one for each input of the record, received {found.sizes.r}")


def _discrete(found: Values, instants: Sequence[Instant], inputs: Array | None) -> dict[str, Any]:
    """The parts of a discrete file that move the state; entry k moves k → k+1."""
    parts: dict[str, Any] = {
        name: found.stack(name, instants[:-1]) if found.varies(name) else found.constant(name) for name in ("Phi", "Qd")
    }
    offset = (
        (found.stack("offset", instants[:-1]) if found.varies("offset") else found.constant("offset"))
        if found.given("offset")
        else None
    )
    if _is_driven(found, inputs):
        driven = _driven(found, instants, inputs)
        offset = driven if offset is None else offset + driven
    return {**parts, "offset": offset, "N": _matrix(found, "N")}


def _is_driven(found: Values, inputs: Array | None) -> bool:
    """Whether a known input moves the state."""
    return found.given("B") and (found.given("u") or inputs is not None)


def _driven(found: Values, instants: Sequence[Instant], inputs: Array | None) -> Array:
    """Bu, (n,) or (steps, n)."""
    if inputs is not None:
        B = found.stack("B", instants[:-1]) if found.varies("B") else found.constant("B")
        return np.einsum("...ij,...j->...i", B, inputs[:-1])
    if not (found.varies("B") or found.varies("u")):
        return found.constant("B") @ found.constant("u")
    return np.einsum("kij,kj->ki", found.stack("B", instants[:-1]), found.stack("u", instants[:-1]))


def _sampled(found: Values, instants: Sequence[Instant], gaps: Array, inputs: Array | None) -> dict[str, Any]:
    """Φ, Qd, offset and N of a continuous file between the instants."""
    if any(found.in_time(name) for name in ("F", "G", "Q", "B")):
        Phi, Qd, offset = _integrated(found, instants, gaps, inputs)
    else:
        Phi, Qd, offset = _exact(found, instants, gaps, inputs)
    N = _cross(found, gaps) if found.given("N") else None
    return {"Phi": Phi, "Qd": Qd, "offset": offset if _is_driven(found, inputs) else None, "N": N}


def _exact(found: Values, instants: Sequence[Instant], gaps: Array, inputs: Array | None) -> Moved:
    """With constant matrices: every length of an interval once."""
    F, G, Q = found.constant("F"), found.constant("G"), checks.covariance("Q", found.constant("Q"), found.shape("Q"))
    _, first, which = np.unique(np.round(gaps / gaps.mean(), 12), return_index=True, return_inverse=True)
    Phi, Qd, Gamma = intervals(F, G @ Q @ G.T, gaps[first])
    one = len(first) == 1
    if not _is_driven(found, inputs):
        offset = np.zeros(len(F))
    elif one:
        offset = _driven(found, instants, inputs) @ Gamma[0].T
    else:
        offset = np.einsum("kij,kj->ki", Gamma[which], np.broadcast_to(_driven(found, instants, inputs), (len(gaps), len(F))))
    return Moved(Phi[0], Qd[0], offset) if one else Moved(Phi[which], Qd[which], offset)


def _cross(found: Values, gaps: Array) -> Array:
    """N of the equivalent measurements, as :func:`ctlabs.models.discretisation.discretise` has it."""
    if (gaps != gaps[0]).any():
        raise found.error(
            ("model", "N"), "expected equal intervals beside N, received times that are not equally spaced"
        )
    F = found.constant("F")
    return interval(F, np.zeros_like(F), gaps[0]).Gamma @ found.constant("G") @ found.constant("N") / gaps[0]


def _equivalent(found: Values, instants: Sequence[Instant], gaps: Array) -> Array:
    """R = Rc/dt of the interval that follows; the last instant has the interval before it."""
    Rc = found.stack("Rc", instants) if found.varies("Rc") else found.constant("Rc")
    Rc = checks.covariance("Rc", Rc, Rc.shape)
    if Rc.ndim == 2 and (gaps == gaps[0]).all():
        return Rc / gaps[0]
    return Rc / np.append(gaps, gaps[-1])[:, None, None]


# --- matrices that vary within an interval -----------------------------------------------------------------------------


def _integrated(found: Values, instants: Sequence[Instant], gaps: Array, inputs: Array | None) -> Moved:
    F, G, W = found.function("F"), found.function("G"), _strength(found)
    B = found.function("B") if _is_driven(found, inputs) else None
    u = found.function("u") if found.given("u") else None
    moves = []
    for i, (instant, h) in enumerate(zip(instants, gaps, strict=False)):
        held = np.zeros(0) if u is None else u(instant)  # over the interval
        held = held if inputs is None else inputs[i]

        def system(t: float, k: int = instant.k, held: Array = held) -> tuple[Array, Array, Array]:
            now = Instant(k, t)
            input_matrix = np.zeros((found.sizes.n, 0)) if B is None else B(now)
            return F(now), G(now) @ W(now) @ G(now).T, input_matrix @ held

        moves.append(moved(system, instant.t, float(h)))
    return Moved(*(np.array(parts) for parts in zip(*moves, strict=True)))


def _strength(found: Values) -> Callable[[Instant], Array]:
    """Q as a function of the time, a covariance at every time."""
    Q, shape = found.function("Q"), found.shape("Q")
    if found.varies("Q"):
        return lambda instant: checks.covariance("Q", Q(instant), shape)
    constant = checks.covariance("Q", found.constant("Q"), shape)
    return lambda _: constant


def moved(system: System, start: float, h: float, after: Array | None = None, bounds: Bounds | None = None) -> Moved:
    """What an interval does whose matrices vary.

    ``after`` is what the rest of a larger interval makes of its end, and ``bounds`` what errors are compared with there: an
    error that dies out before the end does not count.
    """
    samples = _sampled_at(system, start + 0.5 * h * (1 + NODES))
    n = len(system(start + 0.5 * h)[0])
    after, cuts = np.eye(n) if after is None else after, CUTS if bounds is None else bounds.cuts
    level = np.maximum(np.abs(samples).max(axis=0), 0.0 if bounds is None else bounds.level)
    smooth = cuts <= CUTS - TINY or bool((np.abs(TAIL @ samples) <= SMOOTH * level).all())
    best, error = _extrapolated(system, start, h, after)
    size = np.maximum(_scale(_carried(best, after)), 0.0 if bounds is None else bounds.size)
    if smooth and (error <= TOLERANCE * size).all():
        return best
    if not cuts:
        interval = f"t = {moment(start, start + h)} s to {moment(start + h, start)} s"
        msg = f"F: expected matrices that can be integrated from {interval}, received a singularity"
        raise ValueError(msg)
    bounds = Bounds(size, level, cuts - 1)
    right = moved(system, start + 0.5 * h, 0.5 * h, after, bounds)
    return moved(system, start, 0.5 * h, after @ right.Phi, bounds).then(right)


class Bounds(NamedTuple):
    """The size of the results and of the matrices over a whole interval, and how often it may still be cut."""

    size: Array
    level: Array
    cuts: int


def _sampled_at(system: System, times: Array) -> Array:
    return np.array([np.concatenate([part.ravel() for part in system(float(t))]) for t in times])


def _extrapolated(system: System, start: float, h: float, after: Array) -> tuple[Moved, Array]:
    """The limit for pieces of no length, and how far it moved at the last halving, seen from the end."""
    n, table = len(after), [_packed(_pieces(system, start, h, 1))]
    for halving in range(1, HALVINGS + 1):
        row = [_packed(_pieces(system, start, h, 2**halving))]
        for i, before in enumerate(table, start=1):
            row.append(row[-1] + (row[-1] - before) / (4**i - 1))
        best = _unpacked(row[-1], n)
        error = np.abs(_packed(_carried(_unpacked(row[-1] - table[-1], n), after)))
        if (error <= TOLERANCE * _scale(_carried(best, after))).all():
            break
        table = row
    return best, error


def _pieces(system: System, start: float, h: float, count: int) -> Moved:
    """The interval in equal pieces, on each of which the system is frozen at the middle."""
    step, whole = h / count, None
    for i in range(count):
        F, W, b = system(start + (i + 0.5) * step)
        Phi, Qd, Gamma = interval(F, W, step)
        piece = Moved(Phi, Qd, Gamma @ b)
        whole = piece if whole is None else whole.then(piece)
    assert whole is not None  # count is positive
    return whole


def _packed(move: Moved) -> Array:
    return np.concatenate([part.ravel() for part in move])


def _unpacked(packed: Array, n: int) -> Moved:
    Qd = packed[n * n : 2 * n * n].reshape(n, n)
    return Moved(packed[: n * n].reshape(n, n), 0.5 * (Qd + Qd.T), packed[2 * n * n :])


def _carried(move: Moved, after: Array) -> Moved:
    """A result, or a difference of results, at the end of what follows."""
    return Moved(after @ move.Phi, after @ move.Qd @ after.T, after @ move.c)


def _scale(move: Moved) -> Array:
    """The size of what is computed, element by element; of a covariance, by its standard deviations."""
    n, sd = len(move.c), np.sqrt(np.abs(np.diag(move.Qd)))
    return np.concatenate([
        np.full(n * n, np.abs(move.Phi).max()), np.outer(sd, sd).ravel(), np.full(n, np.abs(move.c).max()),
    ])  # fmt: skip
