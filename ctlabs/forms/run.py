"""One record through any form: the driver, the reference, the cost, and all of them side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ctlabs import _check, contradictions, kalman
from ctlabs._check import Array
from ctlabs.contradictions import Contradiction
from ctlabs.forms import (
    array,
    beginning,
    carlson,
    contract,
    conventional,
    extended_array,
    information,
    joseph,
    ld,
    potter,
    sequential,
    srif,
    steady,
    ud,
)
from ctlabs.forms.beginning import Beginning, Start
from ctlabs.forms.contract import Counted, Form, Noise, Numbers
from ctlabs.models import DiscreteModel, at
from ctlabs.text import moment

#: Every form by its name.
FORMS: dict[str, Form] = {
    "conventional": conventional,
    "joseph": joseph,
    "information": information,
    "sequential": sequential,
    "potter": potter,
    "carlson": carlson,
    "array": array,
    "extended_array": extended_array,
    "ud": ud,
    "ld": ld,
    "srif": srif,
    "steady": steady,
}
#: Digits of the reference.
DIGITS = 50
#: Rows of a record that is timed twice.
SHORT = 200


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """One record, or an ensemble of records, filtered by one form, rounded to doubles.

    ``t`` (steps+1,) s · ``x_minus``, ``x_plus`` (steps+1, n[, runs]), estimates given the measurements before k and up
    to k · ``P_minus``, ``P_plus`` (steps+1, n, n), the covariances of their errors · ``innovation`` (steps+1, m[, runs])
    and ``S`` (steps+1, m, m), its covariance; NaN, and ``inf`` on the diagonal, where an element does not enter the
    update · ``nis`` (steps+1,[ runs]), νᵀS⁻¹ν, NaN where nothing is measured · ``log_likelihood`` (a number or (runs,)),
    −½Σ(νᵀS⁻¹ν + ln det S + m ln 2π), NaN where rounding has left S indefinite, −∞ where there is a contradiction ·
    ``used`` (steps+1, m), whether the element enters the update · ``log_likelihood_diffuse``, see below · ``start``,
    what the smoother needs of the first instants after a vague start, or ``None`` · ``contradictions``, the perfect
    measurements that disagree with what is known exactly (:mod:`ctlabs.contradictions`); the filter goes on without them.

    A state of which nothing is known (``inf`` in P0) has the estimate NaN and the variance ``inf``, with zeros beside it; an
    instant at which something unknown is measured has no ``nis``. ``log_likelihood`` is then the density of what is measured
    after something is known of every state, given what was measured before. ``log_likelihood_diffuse`` counts every
    measurement, one that determines something unknown by −½ ln 2π − ½ ln α² (Durbin & Koopman, section 7.2.2): constants of
    the model on which α depends have their greatest likelihood by this one. From a finite P0 both are the same.
    """

    t: Array
    x_minus: Array
    x_plus: Array
    P_minus: Array
    P_plus: Array
    innovation: Array
    S: Array
    nis: Array
    log_likelihood: Any
    used: NDArray[np.bool_]
    log_likelihood_diffuse: Any
    start: Start | None = None
    contradictions: tuple[Contradiction, ...] = ()


class Comparison(NamedTuple):
    """One form on one record, against the filter with 50 digits on the same doubles.

    ``flops`` per step (one prediction and one update, dense matrices; a square root is one operation) · ``error_P``, the
    largest ‖P⁺ − P_ref‖/‖P_ref‖ (Frobenius) · ``error_variance`` (n,), the largest relative error of each variance of P⁺
    (of one that should be 0: the standard deviation left, as a fraction of the largest) · ``error_x`` (n,), the largest
    error of each estimate · ``seconds`` per step of prediction and update, as measured: never the same twice ·
    ``failed``: why the form refused or gave up, its numbers being ``None`` then; otherwise empty
    """

    name: str
    flops: int | None
    error_P: float | None
    error_variance: Array | None
    error_x: Array | None
    seconds: float | None
    failed: str


def run(
    model: DiscreteModel,
    z: ArrayLike,
    form: str,
    first: int = 1,
    *,
    P0: ArrayLike | None = None,
    own_start: bool = False,
) -> Filtered:
    """Filter a record with one form, in double precision; an ensemble of records in one pass.

    From a P0 of which a part is unknown, or very large beside the noises, the form takes over when that part is known about as well
    as the noises allow (:mod:`ctlabs.forms.vague`): from such a P0 itself most forms lose digits.

    Parameters
    ----------
    model : discrete; N and a correlated R are allowed
    z : (steps+1, m) or (steps+1, m, runs); NaN = not measured, for all runs alike. With ``first=1`` row 0 is not used.
    form : a name of :data:`FORMS`
    first : 1 (first measurement at t1) or 0 (at t0)
    P0 : (n, n), in place of ``model.P0``; ``inf`` on its diagonal means that nothing is known of that state
    own_start : the form starts from a finite P0 itself, however large, as :func:`compare` lets it: to see what it loses

    Raises
    ------
    ValueError
        A form of another name; z of another shape; what the form cannot do ("form NAME: expected …, received …").
    FloatingPointError
        A covariance overflows, or a matrix becomes singular by rounding: the step is in the message.

    Source: the docstring of each form's module.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> run(m, [[0.0], [1.0], [2.0]], "ud").P_plus[1:, 0, 0].round(6)
    array([0.916667, 0.657143])
    """
    return _run(model, z, form, first, float, P0, own_start)[0]


def reference(model: DiscreteModel, z: ArrayLike, first: int = 1) -> Filtered:
    """The same filter computed with 50 digits from the same doubles, and rounded once at the end."""
    import mpmath

    with mpmath.workdps(DIGITS):
        return _run(model, z, "joseph", first, mpmath.mpf, None)[0]


def flops(model: DiscreteModel, form: str) -> int:
    """Additions, multiplications, divisions and square roots of one step, counted while it is done.

    A step is one prediction and one update with all measured elements. What depends on no data and is the same at
    every step of a constant model (factors of Qd and R, the matrices with N) is not counted.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> flops(m, "conventional") < flops(m, "joseph")
    True
    """
    how = _form(form)
    first = 1 if model.N is None else 0  # what a measurement tells of the next disturbance belongs to a step
    record = Record(model, np.zeros((2, model.m, 1)), first, Counted)
    known = np.isfinite(model.P0).all()
    P0 = np.eye(model.n) + 0.1 if not known or contract.definite(model.P0) else model.P0
    state = how.start(model, contract.numbers(P0, Counted))
    if record.used[0].any():
        state = how.update(state, *_tame(record, 0, P0))[0]
    Phi, c, Q = record.motion(0)
    ahead = contract.doubles(Phi) @ P0 @ contract.doubles(Phi).T + contract.doubles(Q.matrix)
    measured = _tame(record, 1, ahead) if record.used[1].any() else None
    Counted.total = 0
    state = how.predict(state, Phi, c, Q)
    if measured is not None:
        how.update(state, *measured)
    return Counted.total


def _tame(record: Record, k: int, P: Array) -> tuple[Numbers, Numbers, Noise]:
    """A measurement of the same shape, without the rounding that makes a form give up: a regular R of the size of HPHᵀ.

    What is counted are dense matrices, not their values; whether R is singular or correlated stays as it is.
    """
    z, H, R = record.measurement(k)
    if R.singular:
        return z, H, R
    rows = contract.doubles(H)
    sd = np.sqrt(np.diag(rows @ P @ rows.T) + np.diag(contract.doubles(R.matrix)))
    correlations = np.where(contract.doubles(R.matrix) != 0, 0.5 / len(sd), 0.0)
    np.fill_diagonal(correlations, 1.0)
    return z, H, Noise(contract.numbers(correlations * np.outer(sd, sd), Counted))


def compare(
    model: DiscreteModel,
    z: ArrayLike,
    forms: Sequence[str] | None = None,
    first: int = 1,
    *,
    exact: Filtered | None = None,
) -> tuple[Comparison, ...]:
    """Several forms (all by default) on one record: errors by rounding, and cost.

    Each starts from P0 itself, if that is finite. A form that refuses the model, or gives up on the way, stays in the list and
    says why. ``exact`` is the record's
    :func:`reference`, where it is at hand already: it takes most of the time.

    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1e-14]], x0=[0], P0=[[1]])
    >>> [c.error_P > 1e-4 for c in compare(m, [[0.0], [1.0]], ["conventional", "joseph", "potter", "ud"])]
    [True, False, False, False]
    >>> compare(m, [[0.0], [np.nan], [1.0]], ["steady"])[0].failed[:12]
    'form steady:'
    """
    names = list(FORMS) if forms is None else list(forms)
    for name in names:
        _form(name)
    known = reference(model, z, first) if exact is None else exact
    return tuple(_compared(model, z, name, first, known) for name in names)


def _compared(model: DiscreteModel, z: ArrayLike, name: str, first: int, exact: Filtered) -> Comparison:
    try:
        own, seconds = _run(model, z, name, first, float, None)
        if len(own.t) <= SHORT:  # the first step of a process takes longer than all others: once more
            seconds = min(seconds, _run(model, z, name, first, float, None)[1])
        count = flops(model, name)
    except (ValueError, FloatingPointError) as error:
        return Comparison(name, None, None, None, None, None, str(error))
    difference, size = (np.linalg.norm(P, axis=(1, 2)) for P in (own.P_plus - exact.P_plus, exact.P_plus))
    variances, wanted = (np.diagonal(P, axis1=1, axis2=2) for P in (own.P_plus, exact.P_plus))
    return Comparison(
        name,
        count,
        float(_relative(difference, size).max()),
        _relative(np.abs(variances - wanted), wanted).max(axis=0),
        np.abs(own.x_plus - exact.x_plus).reshape(len(exact.t), model.n, -1).max(axis=(0, 2)),
        seconds,
        "",
    )


def _relative(difference: Array, size: Array) -> Array:
    """difference/size; where the size is 0 the standard deviation left, as a fraction of the largest one."""
    left = np.sqrt(difference / (size.max() or np.finfo(float).tiny))
    return np.where(size > 0, difference / np.where(size > 0, size, 1.0), left)


def _form(name: str) -> Form:
    if name not in FORMS:
        msg = f"form: expected one of {', '.join(FORMS)}, received {name!r}"
        raise ValueError(msg)
    return FORMS[name]


# The driver -----------------------------------------------------------------------------------------------------------


class Record:
    """A model with data, instant by instant, as the forms take it: in one kind of number, only what is measured.

    ``used`` (steps+1, m): which elements enter the updates. Perfect ones that are known already do not (it is told by
    :mod:`ctlabs.kalman`'s recursion), nor do absent ones.
    """

    def __init__(
        self, model: DiscreteModel, z: Array, first: int, kind: Any, used: NDArray[np.bool_] | None = None
    ) -> None:
        self.model, self.z, self.kind = model, z, kind
        self.used = _used(model, z, first) if used is None else used
        self._kept: dict[Any, Any] = {}

    def motion(self, k: int) -> tuple[Numbers, Numbers | None, Noise]:
        """Φ, c and Q from k to k+1; with N ≠ 0 what z_k tells of w_k is in them: Φ−NR⁺H, Qd−NR⁺Nᵀ, c + NR⁺z."""
        model, used = self.model, self.used[k]
        coupled = model.N is not None and bool(used.any())
        matrices = (model.Phi, model.Qd, model.H, model.R) if coupled else (model.Phi, model.Qd)
        key = ("motion", used.tobytes() if coupled else b"")
        Phi, Q, M = self._keep(key, matrices, lambda: self._motion(k, coupled))
        c = None
        if model.offset is not None:
            offset = model.offset[..., None]
            c = self._keep(("offset",), (offset,), lambda: contract.numbers(at(offset, k, 2), self.kind))
        if M is not None:
            told = M @ contract.numbers(self.z[k, used], self.kind)
            c = told if c is None else c + told
        return Phi, c, Q

    def measurement(self, k: int) -> tuple[Numbers, Numbers, Noise]:
        """z, H and R of the elements used at k."""
        model, used = self.model, self.used[k]
        place = used.tobytes()
        H = self._keep(("H", place), (model.H,), lambda: contract.numbers(at(model.H, k, 2)[used], self.kind))
        R = self._keep(("R", place), (model.R,), lambda: self._noise(at(model.R, k, 2)[np.ix_(used, used)]))
        return contract.numbers(self.z[k, used], self.kind), H, R

    def _keep(self, key: Any, matrices: tuple[Array, ...], make: Callable[[], Any]) -> Any:
        """What is made of constant matrices is made once."""
        if any(matrix.ndim == 3 for matrix in matrices):
            return make()
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _noise(self, matrix: Array) -> Noise:
        return Noise(contract.numbers(matrix, self.kind))

    def _motion(self, k: int, coupled: bool) -> tuple[Numbers, Noise, Numbers | None]:
        model, used = self.model, self.used[k]
        if not coupled or self.kind in (float, Counted):
            Phi, Qd, M = kalman._motion(model, k, used)
            own = None if M is None else contract.numbers(M, self.kind)
            return contract.numbers(Phi, self.kind), self._noise(Qd), own
        # The same in this kind of number; any generalised inverse of R serves, as N has nothing outside R's range.
        rounded = kalman._motion(model, k, used)[1]
        assert model.N is not None
        Phi, Qd, H, N, R = (
            contract.numbers(part, self.kind)
            for part in (
                at(model.Phi, k, 2),
                at(model.Qd, k, 2),
                at(model.H, k, 2)[used],
                model.N[:, used],
                at(model.R, k, 2)[np.ix_(used, used)],
            )
        )
        noise = Noise(R)
        inverse = np.array([1 / d if d else d for d in noise.d], dtype=object)
        rows = contract.substituted(noise.L, N.T) * inverse[:, None]
        M = contract.substituted_back(noise.L.T, rows).T
        left = Qd - M @ N.T
        left[rounded == 0] = contract.like(0.0, left)
        return Phi - M @ H, Noise(left), M


def _used(model: DiscreteModel, z: Array, first: int) -> NDArray[np.bool_]:
    """Which elements enter the updates, (steps+1, m)."""
    steps, gaps = kalman._horizon(model, len(z) - 1, first), kalman._gaps(z)
    matrices = model.R[: steps + 1] if model.R.ndim == 3 else model.R[None]
    if any(kalman._perfect(R).any() for R in matrices):
        return kalman._covariances(model, steps, first, gaps).measured
    used = np.isfinite(np.diagonal(matrices, axis1=1, axis2=2)) & ~gaps
    used[:first] = False
    return used


def _record(model: DiscreteModel, z: ArrayLike) -> tuple[Array, bool]:
    """The data as (steps+1, m, runs), and whether they were given without runs."""
    _check.instance("model", model, DiscreteModel)
    data = np.array(z, dtype=np.float64)
    single = data.ndim == 2
    data = data[:, :, None] if single else data
    if data.ndim != 3 or data.shape[1] != model.m or len(data) < 2 or not data.shape[2]:
        msg = f"z: expected shape (steps+1, {model.m}[, runs]), received {np.shape(z)}"
        raise ValueError(msg)
    return data, single


def started(model: DiscreteModel, P0: ArrayLike | None) -> DiscreteModel:
    """The model with the P0 to start from, if one is given."""
    return model if P0 is None else replace(model, P0=_check.measurement_covariance("P0", P0, (model.n, model.n)))


def _run(
    model: DiscreteModel, z: ArrayLike, form: str, first: int, kind: Any, P0: ArrayLike | None, own_start: bool = True
) -> tuple[Filtered, float]:
    """One form in one kind of number, rounded to doubles; and the seconds per step of prediction and update."""
    how = _form(form)
    data, single = _record(model, z)
    model = started(model, P0)
    given = model.P0
    record = Record(model, data, first, kind)
    steps, runs = len(data) - 1, data.shape[2]
    begun = None if form == "steady" else beginning.begin(record, contract.numbers(given, kind))
    own = None if own_start and np.isfinite(given).all() else begun
    out = _Histories(steps, model.n, model.m, runs)
    seconds, begin, k = 0.0, 0, 0
    if own is not None:
        begin = out.begin(own)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # overflows are reported below, with their time
        try:
            if own is None:
                state = how.start(model, contract.numbers(given, kind))
            elif own.x is not None and own.P is not None:
                state = taken_over(how, model, own.x, own.P)
            for k in range(begin, steps + 1):
                if k > begin:
                    motion, before = record.motion(k - 1), perf_counter()
                    state = how.predict(state, *motion)
                    seconds += perf_counter() - before
                x, P = how.mean(state), how.covariance(state)
                out.x_minus[k], out.P_minus[k] = contract.doubles(x), contract.doubles(P)
                if not (used := record.used[k]).any():
                    out.x_plus[k], out.P_plus[k] = out.x_minus[k], out.P_minus[k]
                    continue
                measured, before = record.measurement(k), perf_counter()
                state, told = how.update(state, *measured)
                seconds += perf_counter() - before
                out.innovation[k, used], out.S[k][np.ix_(used, used)] = innovation(x, P, *measured)
                out.x_plus[k], out.P_plus[k] = contract.doubles(how.mean(state)), contract.doubles(how.covariance(state))
                if np.isfinite(out.S[k, used, used]).all():
                    out.nis[k] = contract.doubles(told.nis)
                    out.log_likelihood += contract.doubles(told.log_likelihood)
        except np.linalg.LinAlgError as error:
            _finite(form, given, model.dt, out.x_minus[: k + 1], out.P_minus[: k + 1])
            msg = f"form {form}: expected matrices with an inverse, received one singular by rounding at step {k}"
            raise FloatingPointError(msg) from error
    _finite(form, given, model.dt, out.x_minus, out.P_minus)
    _finite(form, given, model.dt, out.x_plus, out.P_plus)
    P_minus, P_plus = (0.5 * (P + P.transpose(0, 2, 1)) for P in (out.P_minus, out.P_plus))
    found = Filtered(
        t=np.arange(steps + 1) * model.dt,
        x_minus=out.x_minus,
        x_plus=out.x_plus,
        P_minus=P_minus,
        P_plus=P_plus,
        innovation=out.innovation,
        S=out.S,
        nis=out.nis,
        log_likelihood=out.log_likelihood + (0.0 if own is None else own.ordinary),
        used=record.used,
        log_likelihood_diffuse=out.log_likelihood + (0.0 if own is None else own.diffuse),
        start=None if begun is None else begun.start,
    )
    found = contradictions.judged(model, data, found, first)
    return (without_runs(found) if single else found), seconds / steps


class _Histories:
    """What a run leaves, to be filled."""

    def __init__(self, steps: int, n: int, m: int, runs: int) -> None:
        self.x_minus, self.x_plus = np.empty((2, steps + 1, n, runs))
        self.P_minus, self.P_plus = np.empty((2, steps + 1, n, n))
        self.innovation, self.S = np.full((steps + 1, m, runs), np.nan), np.zeros((steps + 1, m, m))
        self.S[:, range(m), range(m)] = np.inf
        self.nis, self.log_likelihood = np.full((steps + 1, runs), np.nan), np.zeros(runs)

    def begin(self, own: Beginning) -> int:
        """Fill in the first instants; their number."""
        for name in ("x_minus", "x_plus", "P_minus", "P_plus", "innovation", "S", "nis"):
            getattr(self, name)[: own.rows] = getattr(own, name)
        return own.rows


def taken_over(how: Form, model: DiscreteModel, x: Numbers, P: Numbers) -> Any:
    """The form's state of an estimate x (n, runs) with the covariance P."""
    there = replace(model, x0=np.zeros(model.n), P0=contract.doubles(P))
    nothing = Noise(contract.zeros(P.shape, P))
    return how.predict(how.start(there, P), contract.identity(model.n, P), x, nothing)


def innovation(x: Numbers, P: Numbers, z: Numbers, H: Numbers, R: Noise) -> tuple[Array, Array]:
    """ν and S in doubles."""
    return contract.doubles(z - H @ x), contract.doubles(H @ P @ H.T + R.matrix)


def _finite(form: str, P0: Array, dt: float, x: Array, P: Array) -> None:
    """An overflow is refused at its first step; after a start from zero information NaN and inf have their meaning."""
    free = np.isposinf(np.diagonal(P, axis1=1, axis2=2)) & (not np.isfinite(P0).all())
    own = free[:, :, None] & np.eye(len(P0), dtype=bool)
    wrong = ~((np.isfinite(P) | own).all(axis=(1, 2)) & (np.isfinite(x) | free[:, :, None]).all(axis=(1, 2)))
    if wrong.any():
        k = int(np.argmax(wrong))
        msg = f"form {form}: expected finite covariances, received an overflow at step {k} (t = {moment(k * dt)} s)"
        raise FloatingPointError(msg)


def without_runs(found: Filtered) -> Filtered:
    """The histories of one record without the last axis."""
    return replace(
        found,
        x_minus=found.x_minus[..., 0],
        x_plus=found.x_plus[..., 0],
        innovation=found.innovation[..., 0],
        nis=found.nis[..., 0],
        log_likelihood=float(found.log_likelihood[0]),
        log_likelihood_diffuse=float(found.log_likelihood_diffuse[0]),
    )
