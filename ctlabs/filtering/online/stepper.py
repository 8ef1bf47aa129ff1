"""One instant of an online filter from the one before: predicted, then updated with its data."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite, isnan
from typing import Any, NoReturn

import numpy as np
from scipy.linalg import lapack

from ctlabs.filtering import contradictions, gathered, measured
from ctlabs.filtering.algorithms import contract, vague
from ctlabs.filtering.algorithms.catalogue import form
from ctlabs.filtering.algorithms.contract import RootState
from ctlabs.filtering.engines.compiled import beyond
from ctlabs.filtering.engines.driver import innovation, taken_over
from ctlabs.filtering.online.plants import Given, Periodic, Sampled, Snapshot
from ctlabs.filtering.results import Contradiction, FilteredRow, LeftOut, Mask, gains
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import symmetric
from ctlabs.text import moment

#: Its recursion tells which perfect measurements are known already.
JOSEPH = form("joseph")
#: The form that has compiled loops.
ROOTS = form("array")
#: Overflows are reported, with their time.
QUIET = np.errstate(over="ignore", invalid="ignore", divide="ignore")
#: An instant's own data, as a form takes them: z (m, 1), H and R of the elements used.
Own = tuple[Array, Array, contract.Noise]


class Stepper:
    """What takes an online filter of a ``plant`` by an ``algorithm`` from instant to instant; it keeps nothing of the data.

    ``first``: 0 or 1, the first instant that is measured, from which contradictions count their rows
    """

    def __init__(self, plant: Periodic | Sampled, algorithm: str, first: int) -> None:
        self.form, self._plant, self._algorithm, self._first = form(algorithm, "auto", "filterpy"), plant, algorithm, first
        m = plant.model.m
        self._zeros = np.zeros((plant.model.n, 1))
        self._nan, self._all = np.full(m, np.nan), np.ones(m, dtype=bool)
        self._none = np.zeros(m)  # z·0 is NaN where an element is missing
        self._unmeasured = np.diag(np.full(m, np.inf))
        self._loops: Any = None  # of the square roots, which tell by themselves what is known and when they have too few digits
        if self.form is ROOTS:
            from ctlabs.filtering.engines import instant  # costs 0.3 s to import: here rather than in a step

            self._loops = instant
        self._gained: tuple[Any, Any] = None, None  # S of the last update by the loop, and its K
        self._seen: list[tuple[Any, Array, Array]] = []  # what the last two states mean

    def begun(self, u: Array) -> Snapshot:
        """The instant t0."""
        plant, m = self._plant, self._plant.model.m
        vaguely = self._algorithm != "steady" and vague.needed(plant.model, plant.P0)
        state: Any = vague.start(plant.model, plant.P0) if vaguely else None
        if state is None or state.settled:
            state = self.form.start(plant.model, plant.P0)
        perfect = plant.perfect and not isinstance(state, vague.State)
        known = JOSEPH.start(plant.model, plant.P0) if perfect and self._loops is None else None
        exact = gathered.begun(plant.model.x0, plant.P0) if perfect else None
        told: tuple[Any, ...] = (self._nan, self._unmeasured, np.nan, 0.0, 0.0, exact, exact, self._nan, self._nan)
        H, R = plant.measured(0)
        nobody = np.zeros(m, dtype=bool)
        return Snapshot(0, plant.t0, u, self._nan, np.zeros(m), H, R, nobody, state, state, known, known, *told)

    def stepped(self, last: Snapshot, given: Given) -> Snapshot:
        """The next instant with its data."""
        return self.updated(self._predicted(last, given), given.z)

    def updated(self, instant: Snapshot, z: Array) -> Snapshot:
        """The instant with the data z: from its state before to that after."""
        if self._regular(instant, z):
            return self._plainly(instant, z)
        vaguely = isinstance(instant.before, vague.State)
        if instant.approaching is None and not vaguely and measured.perfect(instant.R).any():
            x, P = self._values(instant.before)
            ahead = None if self._loops is not None else taken_over(JOSEPH, self._plant.model, x, P)
            instant = instant._replace(ahead=ahead, approaching=gathered.begun(x[:, 0], P))
        return self._partly(instant, z, vaguely=vaguely)

    def _predicted(self, last: Snapshot, given: Given) -> Snapshot:
        """The next instant before its data."""
        plant = self._plant
        if plant.given.B is not None and np.isnan(last.u).any():
            msg = "u0: expected the known input from t0 to the first measurement (the model has B), received None"
            raise ValueError(msg)
        motion, state, ahead, exact = plant.motion(last, given), last.after, last.known, last.gathered
        if self._in_loops(state):
            before = self._moved(given.t, state, *motion)
            if exact is not None:
                exact = self._gathered(exact, state, motion)
        else:
            before, ahead, exact = self._ahead(state, ahead, exact, motion)
        k = last.k + 1
        H, R = plant.measured(k)
        H, R = H if given.H is None else given.H, R if given.R is None else given.R
        seen = plant.seen(k, given.u)
        return Snapshot(
            k, given.t, given.u, last.z, seen, H, R, last.used, before, before, ahead, ahead, *last[12:17], exact, exact, *last[19:]
        )

    def _regular(self, instant: Snapshot, z: Array) -> bool:
        """Whether all elements enter, with the plant's regular R, and the form has taken over."""
        if self._plant.regular is None or isnan(z.dot(self._none)):
            return False
        if isinstance(instant.before, vague.State) or instant.approaching is not None:
            return False
        return instant.R is self._plant.own_R or np.array_equal(instant.R, self._plant.own_R)

    def row(self, now: Snapshot, left_out: tuple[LeftOut, ...] = ()) -> FilteredRow:
        """What an instant says, in arrays of its own."""
        (x_minus, P_minus), (x_plus, P_plus) = self._values(now.before), self._values(now.after)
        return FilteredRow(
            t=now.t,
            x_minus=x_minus[:, 0].copy(),
            x_plus=x_plus[:, 0].copy(),
            P_minus=self._symmetric(now.before, P_minus),
            P_plus=self._symmetric(now.after, P_plus),
            K=self._gain(now, P_minus),
            S=now.S.copy(),
            used=now.used.copy(),
            innovation=now.innovation.copy(),
            nis=now.nis,
            contradictions=self._contradictions(now),
            left_out=left_out,
        )

    # What is measured -----------------------------------------------------------------------------------------------------

    def _plainly(self, instant: Snapshot, z: Array) -> Snapshot:
        """The instant after all of its elements, of a constant and regular R."""
        assert self._plant.regular is not None
        state, none = instant.before, self._nan
        if self._in_loops(state):
            after, nu, S, nis, log = self._looped(instant, z, self._all)
        else:
            after, nu, S, nis, log = self._by_form(instant, z - instant.seen, instant.H, self._plant.regular)
        return Snapshot(
            *instant[:3], z, *instant[4:7], self._all, state, after, None, None, nu, S, nis, log, log, None, None, none, none
        )

    @QUIET
    def _by_form(self, instant: Snapshot, data: Array, H: Array, R: contract.Noise) -> tuple[Any, Array, Array, float, float]:
        """State, ν, S, νᵀS⁻¹ν and log-likelihood of the form's update with these data, all finite."""
        state = instant.before
        after, told = self.form.update(state, data[:, None], H, R)
        nu, S = innovation(*self._values(state), data[:, None], H, R)
        self._finite(instant.t, after, S.diagonal())
        return after, nu[:, 0], S, float(told.nis[0]), float(told.log_likelihood[0])

    def _in_loops(self, state: Any) -> bool:
        """Whether the compiled loops take it on."""
        return self._loops is not None and not isinstance(state, vague.State)

    def _looped(self, instant: Snapshot, z: Array, used: Mask) -> tuple[Any, Array, Array, float, float]:
        """The same by the compiled loop, of the elements ``used``, from which it takes out perfect ones that are known."""
        state, (m, n) = instant.before, instant.H.shape
        after, P = RootState(np.empty((n, 1)), np.empty((n, n))), np.empty((n, n))
        nu, S, K = np.empty(m), np.empty((m, m)), np.empty((n, m))
        before = _own(state.x), _own(state.root), _own(self._values(state)[1])
        own = z - instant.seen, _own(instant.H), _own(instant.R), used
        end, nis, log = self._loops.updated(*before, *own, *after, P, nu, S, K)
        if end == self._loops.INDEFINITE:
            raise FloatingPointError(beyond(f"at t = {moment(instant.t)} s"))
        self._kept(end, instant.t, after, P)
        self._gained = S, K
        return after, nu, S, nis, log

    def _moved(self, t: float, state: Any, Phi: Array, c: Array | None, Q: contract.Noise) -> Any:
        """One step ahead, to the time t, by the compiled loop."""
        n = len(Phi)
        ahead, P = RootState(np.empty((n, 1)), np.empty((n, n))), np.empty((n, n))
        given = _own(state.x), _own(state.root), _own(Phi), self._zeros if c is None else _own(c), _own(Q.matrix)
        self._kept(self._loops.predicted(*given, *ahead, P), t, ahead, P)
        return ahead

    def _kept(self, end: int, t: float, state: RootState, P: Array) -> None:
        """Keep what a loop has found of a state, or refuse it: it is finite."""
        finite = isfinite(np.vdot(state.x, state.x)) or np.isfinite(state.x).all()  # the square of a number may overflow, where it does not
        if end == self._loops.OVERFLOW or not finite:
            self._overflow(t)
        self._seen = [*self._seen[-1:], (state, state.x, P)]

    def _gathered(self, exact: Any, state: Any, motion: tuple[Array, Array | None, contract.Noise]) -> Any:
        """What rounding has gathered, one step ahead."""
        Phi, c, Q = motion
        return gathered.predicted(exact, *self._values(state), Phi, c, Q.matrix, self._plant.model.m)

    @QUIET
    def _ahead(self, state: Any, known: Any, exact: Any, motion: tuple[Array, Array | None, contract.Noise]) -> tuple[Any, Any, Any]:
        """One step ahead by the form: its state, and the other one with what rounding has gathered."""
        model = self._plant.model
        if isinstance(state, vague.State):
            before = vague.predict(state, *motion)
            if not before.settled:
                return before, known, exact
            x, P = before.x, before.P
            if self._plant.perfect:
                exact = gathered.begun(x[:, 0], P)
            if self._loops is not None:
                return RootState(x, before.L), None, exact
            if self._plant.perfect:
                known = taken_over(JOSEPH, model, x, P)
            return taken_over(self.form, model, x, P), known, exact
        if known is not None:
            known, exact = JOSEPH.predict(known, *motion), self._gathered(exact, state, motion)
        return self.form.predict(state, *motion), known, exact

    @QUIET
    def _partly(self, instant: Snapshot, z: Array, *, vaguely: bool) -> Snapshot:
        """The instant after those of its elements that enter, by the form."""
        H, R, state = instant.H, instant.R, instant.before
        used = np.isfinite(R.diagonal()) & ~np.isnan(z)
        if instant.ahead is not None:
            used = measured.informative(instant.ahead.P, H, measured.without(R, ~used))
        nu, S, none = self._nan.copy(), self._unmeasured.copy(), self._nan
        told: tuple[Any, ...] = (nu, S, np.nan, 0.0, 0.0, instant.approaching, instant.gathered, none, none)
        changed = Snapshot(*instant[:3], z, *instant[4:7], used, state, state, instant.ahead, instant.ahead, *told)
        if used.any() and self._in_loops(state):
            after, nu, S, nis, log = self._looped(changed, z, used)
            changed = changed._replace(after=after, innovation=nu, S=S, nis=nis, log_likelihood=log, diffuse=log)
        elif used.any():
            own = ((z - instant.seen)[used, None], H[used], self._plant.noise(R, used))
            changed = self._vaguely(changed, own) if vaguely else self._told(changed, own)
        self._finite(instant.t, changed.after, changed.S.diagonal()[changed.used])
        if changed.approaching is not None:
            changed = self._compared(changed, H, R)
        if self._contradictions(changed):
            changed = changed._replace(log_likelihood=-np.inf, diffuse=-np.inf)
        return changed

    def _told(self, instant: Snapshot, own: Own) -> Snapshot:
        """The instant after its elements used, once the form has taken over."""
        data, H, R = own
        known = None if instant.ahead is None else JOSEPH.update(instant.ahead, *own)[0]  # whose own recursion tells what is known
        nu, S, used = instant.innovation, instant.S, instant.used
        after, nu[used], S[np.ix_(used, used)], nis, log = self._by_form(instant, data[:, 0], H, R)
        return instant._replace(after=after, known=known, nis=nis, log_likelihood=log, diffuse=log)

    def _vaguely(self, instant: Snapshot, own: Own) -> Snapshot:
        """The instant after its elements used, before the form takes over."""
        before, nu, S, used = instant.before, instant.innovation, instant.S, instant.used.copy()
        after, told = vague.update(before, *own)
        values, variances = vague.innovation(before, *own)
        used[used] = told.used
        nu[used, None], S[np.ix_(used, used)] = values[told.used], variances[np.ix_(told.used, told.used)]
        excess, terms = self._nan.copy(), self._nan.copy()
        excess[instant.used], terms[instant.used] = told.excess[:, 0], told.terms
        allowed = contradictions.vaguely(terms + 2 * np.abs(instant.seen), len(before.P), instant.k)
        changed = instant._replace(after=after, used=used, diffuse=float(told.log_likelihood[0]), excess=excess, allowed=allowed)
        if before.unknown == 0:
            changed = changed._replace(log_likelihood=changed.diffuse)
        finite = used.any() and np.isfinite(S.diagonal()[used]).all()
        return changed._replace(nis=float(told.nis[0]) if finite else np.nan)

    def _compared(self, instant: Snapshot, H: Array, R: Array) -> Snapshot:
        """The instant with what its measurements say of what was known already."""
        x, P = zip(*map(self._values, (instant.before, instant.after)), strict=True)
        found = gathered.updated(instant.approaching, instant.z - instant.seen, instant.seen, H, R, x, P, instant.used)
        return instant._replace(gathered=found[0], excess=found[1], allowed=found[2])

    # What is read of it ---------------------------------------------------------------------------------------------------

    def _values(self, state: Any) -> tuple[Array, Array]:
        """Estimate (n, 1) and covariance (n, n) of a state, which some forms have to compute."""
        for known, x, P in self._seen:
            if known is state:
                return x, P
        x, P = state.mean, state.covariance
        self._seen = [*self._seen[-1:], (state, x, P)]
        return x, P

    def _finite(self, t: float, state: Any, variances: Array) -> None:
        """An overflow is refused; from a start without information NaN and inf have their meaning."""
        x, P = self._values(state)
        if isfinite(np.vdot(x, x) + np.vdot(P, P) + np.vdot(variances, variances)):
            return
        start = not np.isfinite(self._plant.P0).all()
        free = np.isposinf(P.diagonal()) & start
        finite = (np.isfinite(P) | np.diag(free)).all() and (np.isfinite(x[:, 0]) | free).all()
        if not (finite and (np.isfinite(variances) | start).all()):
            self._overflow(t)

    def _overflow(self, t: float) -> NoReturn:
        msg = f"form {self._algorithm}: expected finite covariances, received an overflow at t = {moment(t)} s"
        raise FloatingPointError(msg)

    def _gain(self, now: Snapshot, P_minus: Array) -> Array:
        """K = P⁻HᵀS⁻¹, 0 where an element does not enter."""
        if now.S is not self._gained[0]:
            if self._in_loops(now.before) and now.used.any():
                self._looped(now, now.z, now.used.copy())
            elif self._regular(now, now.z):
                _, K, info = lapack.dposv(now.S, now.H.dot(P_minus))
                return gains(P_minus[None], now.H, now.S[None], now.used[None])[0] if info else np.asarray(K.T)
            else:
                return gains(P_minus[None], now.H, now.S[None], now.used[None])[0]
        return np.array(self._gained[1])

    def _symmetric(self, state: Any, P: Array) -> Array:
        """A copy of P, the covariance of a state, symmetric to the bit."""
        return P.copy() if self._in_loops(state) else symmetric(P)

    def _contradictions(self, instant: Snapshot) -> tuple[Contradiction, ...]:
        """The elements of an instant that disagree with what was known."""
        if instant.excess is self._nan:
            return ()
        wrong = np.flatnonzero(np.abs(instant.excess) > instant.allowed)
        return tuple(
            Contradiction(instant.k - self._first, int(i), float(instant.excess[i]), float(instant.allowed[i])) for i in wrong.tolist()
        )


def _own(a: Array) -> Array:
    """The array, as compiled loops know it: contiguous, and not of the kind that cannot be written."""
    return a if a.flags.carray else np.array(a, order="C")


def gated(row: FilteredRow, now: Snapshot, data: Array, gate: float, first: int) -> tuple[Array, tuple[LeftOut, ...]]:
    """The data within the gate, and the others, at an instant ``now`` that was predicted as ``row`` says."""
    x, P = row.x_plus, row.P_plus
    unknown = np.abs(now.H) @ np.isinf(P.diagonal()) > 0
    nu = data - now.seen - now.H @ np.where(np.isfinite(x), x, 0.0)
    sd = np.sqrt(((now.H @ np.where(np.isfinite(P), P, 0.0)) * now.H).sum(axis=1) + now.R.diagonal())
    with np.errstate(divide="ignore", invalid="ignore"):
        away = np.abs(nu) / sd
    beyond: Mask = ~np.isnan(nu) & ~unknown & (sd > 0) & (away > gate)
    k = now.k - first
    left = tuple(LeftOut(k, i, float(data[i]), float(nu[i]), float(away[i])) for i in np.flatnonzero(beyond).tolist())
    return np.where(beyond, np.nan, data), left


def columns(state: Any) -> int | None:
    """How many columns a state has before the form takes over; ``None`` after that."""
    return state.A.shape[1] if isinstance(state, vague.State) else None


def template(
    stepper: Stepper, start: Snapshot, plant: Periodic | Sampled, columns: Iterable[int | None], exact: Iterable[bool]
) -> Snapshot:
    """An instant of the right shapes: how many ``columns`` its states have before the form takes over, and whether rounding is being
    gathered (``exact``), before and after the update; a form without loops then has a second state, which tells what is known exactly.
    """
    n = plant.model.n
    own = taken_over(stepper.form, plant.model, np.zeros((n, 1)), np.eye(n))
    known = None if stepper.form is ROOTS else taken_over(JOSEPH, plant.model, np.zeros((n, 1)), np.eye(n))
    begun = gathered.begun(np.zeros(n), np.eye(n))
    vague_ = start.after if isinstance(start.after, vague.State) else vague.start(plant.model, plant.P0)
    before, after = (own if d is None else vague_._replace(A=np.zeros((n, d))) for d in columns)
    ahead, there = exact
    return start._replace(
        before=before,
        after=after,
        ahead=known if ahead else None,
        known=known if there else None,
        approaching=begun if ahead else None,
        gathered=begun if there else None,
    )
