"""The filter that is fed one measurement at a time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import contradictions, gathered, measured
from ctlabs.filtering.algorithms import contract, vague
from ctlabs.filtering.algorithms.catalogue import form
from ctlabs.filtering.engines.driver import innovation, taken_over
from ctlabs.filtering.gate import width
from ctlabs.filtering.measured import begins
from ctlabs.filtering.online import files
from ctlabs.filtering.online.plants import Given, Snapshot, finite_time, plant, short
from ctlabs.filtering.results import Contradiction, FilteredRow, LeftOut, Mask, gains
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.text import moment

#: Its recursion tells which perfect measurements are known already.
JOSEPH = form("joseph")


class Filter:
    """A filter that is fed one measurement at a time; its numbers are those of :func:`ctlabs.kalman_filter`.

    Parameters
    ----------
    model : a DiscreteModel, constant or given for a number of steps; or a ContinuousModel, which may be measured at any
        times and is discretised for each interval
    algorithm : ``"auto"`` (Joseph's form) or a form of :mod:`ctlabs.filtering.algorithms` by name; ``steady`` needs a DiscreteModel,
        measured at every instant
    R : (m, m), covariance of a sampled measurement, unit²: needed with a ContinuousModel (whose Rc is the strength of a
        continuous one), refused with a DiscreteModel
    t0 : time of x0 and P0, s
    first : 1 (the first measurement comes after t0) or 0 (it may come at t0); by default as the model says
    u0 : (r,), the known input from t0 to the first measurement, where that comes later and the model has B
    memory : how many instants before the present one are kept for late measurements
    P0 : (n, n), in place of the model's; ``inf`` on its diagonal means that nothing is known of that state. The algorithm
        takes over when something is known of every state (:mod:`ctlabs.filtering.algorithms.vague`)

    Raises
    ------
    TypeError, ValueError
        R missing or superfluous; an unknown algorithm; what the form cannot do ("form NAME: expected …, received …").

    >>> walk = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[10]])
    >>> online = Filter(walk, algorithm="ud")
    >>> [online.step(z).x_plus.round(6).item() for z in (1.0, None, 2.0)]
    [0.916667, 0.916667, 1.723404]
    """

    def __init__(
        self,
        model: DiscreteModel | ContinuousModel,
        *,
        algorithm: str = "auto",
        R: ArrayLike | None = None,
        first: int | None = None,
        t0: float = 0.0,
        memory: int = 0,
        P0: ArrayLike | None = None,
        u0: ArrayLike | None = None,
    ) -> None:
        algorithm = "joseph" if algorithm in ("auto", "filterpy") else algorithm
        self._form = form(algorithm, "auto", "filterpy")
        self._plant = plant(model, algorithm, R, finite_time("t0", t0), P0)
        self._algorithm, self._first = algorithm, begins(self._plant.model, first)
        self._memory = checks.count("memory", memory, least=0)
        self._before, self._begun = (0.0, 0.0), False  # log-likelihoods of what is forgotten; whether a step was made
        state: Any = vague.start(self._plant.model, self._plant.P0)
        if state.settled or algorithm == "steady":
            state = self._form.start(self._plant.model, self._plant.P0)
        settled = not isinstance(state, vague.State)
        known = JOSEPH.start(self._plant.model, self._plant.P0) if self._plant.perfect and settled else None
        z = np.full(self._plant.model.m, np.nan)
        none, S = np.zeros(len(z), dtype=bool), np.diag(np.full(len(z), np.inf))
        u = np.full(self._plant.given.r, np.nan) if u0 is None else self._plant.input(u0, "u0")
        perfect = self._plant.perfect and settled
        exact = gathered.begun(self._plant.model.x0, self._plant.P0) if perfect else None
        told = (z, S, np.nan, 0.0, 0.0, exact, exact, z, z)
        H, R0 = self._plant.measured(0)
        start = Snapshot(0, self._plant.t0, u, z, np.zeros(len(z)), np.array(H), np.array(R0), none, state, state, known, known, *told)
        self._past = [start]

    def step(
        self,
        z: ArrayLike | None,
        t: float | None = None,
        u: ArrayLike | None = None,
        *,
        H: ArrayLike | None = None,
        R: ArrayLike | None = None,
        gate: float | None = None,
    ) -> FilteredRow:
        """Go to time t and take in what was measured there.

        Parameters
        ----------
        z : (m,), or a number where m = 1; NaN or None marks a missing element, None alone a pure prediction
        t : s; by default the next instant of a DiscreteModel. Instants skipped in between are instants without a
            measurement. An earlier time is that of a late measurement: it fills what was missing at an instant or, with
            a ContinuousModel, makes an instant of its own.
        u : (r,), known input of a model with B or D: it enters this measurement and acts from now until the next one
        H, R : (m, n), (m, m), of this measurement, in place of the model's
        gate : leave out the elements whose innovation is beyond so many standard deviations; not of a late measurement

        Returns
        -------
        The present instant, to which a late measurement contributes without moving it

        Raises
        ------
        TypeError, ValueError
            A time that is not one of a DiscreteModel's instants, or before the memory; an element measured there
            already; an infinite value. What the form cannot do.
        FloatingPointError
            The covariance overflows. After an exception the filter is as it was before the call.
        """
        data, following = self._data(z), self.k + 1 if self._begun or self._first else 0
        time = self._plant.when(t, following)
        late = time < self.t or (time == self.t and self._begun)
        if u is not None and late:
            msg = f"u: expected none with a measurement at {moment(time, self.t)} s (now is {moment(self.t, time)} s), received one"
            raise ValueError(msg)
        model = self._plant.model
        rows = None if H is None else checks.shaped("H", H, (model.m, model.n))
        noise = None if R is None else checks.measurement_covariance("R", R, (model.m, model.m))
        left: tuple[LeftOut, ...] = ()
        if gate is not None:
            if late:
                now = moment(self.t, time)
                msg = f"gate: expected none with a late measurement ({moment(time, self.t)} s, now is {now} s), received one"
                raise ValueError(msg)
            data, left = self._gated(data, width(gate), t, u, H, R)
        try:
            with np.errstate(
                over="ignore", invalid="ignore", divide="ignore"
            ):  # overflows are reported, with their time
                if time > self.t:
                    given = Given(time, self._plant.input(u), data, rows, noise)
                    self._go(self._past, self._plant.way(self._past[-1], given))
                else:
                    self._insert(Given(time, self._past[-1].u if late else self._plant.input(u), data, rows, noise))
        except np.linalg.LinAlgError as error:
            received = f"one singular by rounding (measurement at {moment(time)} s)"
            msg = f"form {self._algorithm}: expected matrices with an inverse, received {received}"
            raise FloatingPointError(msg) from error
        self._begun = True
        return replace(self.estimate, left_out=left)

    def _gated(
        self, data: Array, gate: float, t: float | None, u: ArrayLike | None, H: ArrayLike | None, R: ArrayLike | None
    ) -> tuple[Array, tuple[LeftOut, ...]]:
        """The data within the gate, and the others: of a prediction to that time, which is undone."""
        before = self._past, self._before, self._begun
        try:
            self.step(None, t, u, H=H, R=R)
            now = self._past[-1]
            x, P = _values(now.after)
        finally:
            self._past, self._before, self._begun = before
        unknown = np.abs(now.H) @ np.isinf(P.diagonal()) > 0
        nu = data - now.seen - now.H @ np.where(np.isfinite(x), x, 0.0)
        sd = np.sqrt(((now.H @ np.where(np.isfinite(P), P, 0.0)) * now.H).sum(axis=1) + now.R.diagonal())
        with np.errstate(divide="ignore", invalid="ignore"):
            away = np.abs(nu) / sd
        beyond: Mask = ~np.isnan(nu) & ~unknown & (sd > 0) & (away > gate)
        row = now.k - self._first
        left = tuple(LeftOut(row, i, float(data[i]), float(nu[i]), float(away[i])) for i in np.flatnonzero(beyond).tolist())
        return np.where(beyond, np.nan, data), left

    @property
    def estimate(self) -> FilteredRow:
        """The estimate at the present instant, as :meth:`step` returned it."""
        now = self._past[-1]
        (x_minus, P_minus), (x_plus, P_plus) = _values(now.before), _values(now.after)
        K = gains(P_minus[None], now.H, now.S[None], now.used[None])[0]
        return FilteredRow(
            t=now.t,
            x_minus=x_minus,
            x_plus=x_plus,
            P_minus=P_minus,
            P_plus=P_plus,
            K=K,
            S=now.S.copy(),
            used=now.used.copy(),
            innovation=now.innovation.copy(),
            nis=now.nis,
            contradictions=_contradictions(now, self._first),
        )

    @property
    def t(self) -> float:
        """The present, s."""
        return self._past[-1].t

    @property
    def k(self) -> int:
        """The index of the present instant: 0 at t0, one more at every instant since."""
        return self._past[-1].k

    @property
    def log_likelihood(self) -> float:
        """The logarithm of the joint density of everything measured so far, since something is known of every state.

        It is −∞ after a contradiction.
        """
        total = self._before[0]
        for instant in self._past:  # one by one: the sum must not depend on how many are remembered
            total += instant.log_likelihood
        return total

    @property
    def log_likelihood_diffuse(self) -> float:
        """The same of everything measured, after a start without information (:class:`ctlabs.filtering.Filtered`)."""
        total = self._before[1]
        for instant in self._past:
            total += instant.diffuse
        return total

    def save(self, path: str | Path) -> None:
        """Write the filter to a file (NumPy's .npz, whatever the name), replacing it as a whole.

        The file holds the model, the options and the state; :meth:`load` continues to the bit.
        """
        plant = self._plant
        header, arrays = files.described(plant.given)
        header |= {"algorithm": self._algorithm, "t0": plant.t0, "first": self._first, "memory": self._memory}
        header |= {"begun": self._begun, "before": self._before, "instants": len(self._past)}
        header |= {"columns": [[_columns(each.before), _columns(each.after)] for each in self._past]}
        header |= {"exact": [[each.ahead is not None, each.known is not None] for each in self._past]}
        arrays |= {"option.P0": plant.P0} | ({} if plant.R is None else {"option.R": plant.R})
        for i, instant in enumerate(self._past):
            arrays |= {f"instant.{i}.{j}": np.asarray(leaf) for j, leaf in enumerate(files.leaves(instant))}
        files.write(Path(path), header, arrays)

    @classmethod
    def load(cls, path: str | Path) -> Filter:
        """The filter that :meth:`save` wrote. Nothing in the file is executed, whatever it holds.

        Raises
        ------
        OSError
            The file cannot be read.
        ValueError
            It is no saved filter, is damaged, or was written in another format.
        """
        return files.read(Path(path), cls._restored)

    @classmethod
    def _restored(cls, header: dict[str, Any], arrays: dict[str, Array]) -> Filter:
        """A new filter of the saved model and options, with the saved instants in place of its start."""
        restored = cls(
            files.model(header, arrays),
            algorithm=header["algorithm"],
            R=arrays.get("option.R"),
            t0=header["t0"],
            first=header["first"],
            memory=header["memory"],
            P0=arrays["option.P0"],
        )
        saved, kinds = range(checks.count("instants", header["instants"])), zip(header["columns"], header["exact"], strict=True)
        templates = [restored._template(*columns, *exact) for columns, exact in kinds]
        restored._past = [files.filled(templates[i], (arrays[f"instant.{i}.{j}"] for j in count())) for i in saved]
        own, diffuse = header["before"]
        restored._before, restored._begun = (float(own), float(diffuse)), bool(header["begun"])
        return restored

    def _template(self, before: int | None, after: int | None, ahead: bool, known: bool) -> Snapshot:
        """An instant of the right shapes: how many columns its states have before the form takes over, and whether there is a
        second state that tells what is known exactly, before and after the update.
        """
        start, n = self._past[0], self._plant.model.n
        own = taken_over(self._form, self._plant.model, np.zeros((n, 1)), np.eye(n))
        exact = taken_over(JOSEPH, self._plant.model, np.zeros((n, 1)), np.eye(n))
        begun = gathered.begun(np.zeros(n), np.eye(n))
        form_, vague_ = own, start.after if isinstance(start.after, vague.State) else vague.start(self._plant.model, self._plant.P0)
        states = [form_ if d is None else vague_._replace(A=np.zeros((n, d))) for d in (before, after)]
        first = start._replace(before=states[0], after=states[1], ahead=exact if ahead else None, known=exact if known else None)
        return first._replace(approaching=begun if ahead else None, gathered=begun if known else None)

    # What is measured, in its place ---------------------------------------------------------------------------------

    def _data(self, z: ArrayLike | None) -> Array:
        """A measurement as (m,), NaN where nothing is measured."""
        m = self._plant.model.m
        wanted = f"{m} finite numbers, NaN or None where one is missing" if m > 1 else "a finite number, NaN or None"
        try:
            data = np.full(m, np.nan) if z is None else np.array(z, dtype=np.float64)
        except (TypeError, ValueError):
            msg = f"z: expected {wanted}, received {short(z)}"
            raise TypeError(msg) from None
        data = data.reshape(1) if data.ndim == 0 else data
        if data.shape != (m,) or np.isinf(data).any():
            msg = f"z: expected {wanted}, received {short(z)}"
            raise ValueError(msg)
        return data

    def _insert(self, new: Given) -> None:
        """Put a measurement in its place, and do again what came after it."""
        time = new.t
        if time < self._past[0].t:
            oldest = f"{moment(self._past[0].t, time)} s (now is {moment(self.t)} s, memory {self._memory})"
            msg = f"t: expected a time not before {oldest}, received {moment(time, self._past[0].t)}"
            raise ValueError(msg)
        i = max(i for i, instant in enumerate(self._past) if instant.t <= time)
        there, later = self._past[i], self._past[i + 1 :]
        if there.t < time:
            past, way = self._past[: i + 1], [new._replace(u=there.u)]
        else:
            past, way = [*self._past[:i], self._completed(there, new)], []
        self._go(past, [*way, *(Given(old.t, old.u, old.z, old.H, old.R) for old in later)])

    def _completed(self, instant: Snapshot, given: Given) -> Snapshot:
        """An instant with the data that were missing."""
        data = given.z
        new = ~np.isnan(data)
        if instant.k < self._first and new.any():
            msg = f"t: expected a first measurement after t0 = {moment(instant.t)} s (first=1), received one at t0"
            raise ValueError(msg)
        twice = np.flatnonzero(new & ~np.isnan(instant.z))
        if twice.size:
            i = twice[0]
            msg = f"z[{i}]: expected no second value at {moment(instant.t)} s, received {data[i]:g} after {instant.z[i]:g}"
            raise ValueError(msg)
        if (given.H is not None or given.R is not None) and not np.isnan(instant.z).all():
            msg = f"H, R: expected none where something is measured already ({moment(instant.t)} s), received one"
            raise ValueError(msg)
        if instant.k == 0 and not self._begun:
            instant = instant._replace(u=given.u, seen=self._plant.seen(0, given.u))
        H, R = (own if other is None else other for own, other in ((instant.H, given.H), (instant.R, given.R)))
        return self._updated(instant._replace(H=np.array(H), R=np.array(R)), np.where(new, data, instant.z))

    def _go(self, past: list[Snapshot], way: Iterable[Given]) -> None:
        """Predict and update along the ``way``; nothing changes unless all of it succeeds."""
        past, before = list(past), self._before
        for given in way:
            past.append(self._updated(self._predicted(past[-1], given), given.z))
            if len(past) > self._memory + 1:
                gone = past.pop(0)
                before = (before[0] + gone.log_likelihood, before[1] + gone.diffuse)
        self._past, self._before = past, before

    def _predicted(self, last: Snapshot, given: Given) -> Snapshot:
        """The next instant before its data."""
        if np.isnan(last.u).any() and self._plant.given.B is not None:
            msg = "u0: expected the known input from t0 to the first measurement (the model has B), received None"
            raise ValueError(msg)
        motion, model = self._plant.motion(last, given), self._plant.model
        before, ahead, exact = last.after, last.known, last.gathered
        if isinstance(before, vague.State):
            before = vague.predict(before, *motion)
            if before.settled:
                x, P = before.x, before.P
                before = taken_over(self._form, model, x, P)
                if self._plant.perfect:
                    ahead, exact = taken_over(JOSEPH, model, x, P), gathered.begun(x[:, 0], P)
        else:
            if ahead is not None:
                ahead = JOSEPH.predict(ahead, *motion)
                Phi, c, Q = motion
                exact = gathered.predicted(exact, before.mean, before.covariance, Phi, c, Q.matrix, model.m)
            before = self._form.predict(before, *motion)
        H, R = self._plant.measured(last.k + 1)
        H, R = np.array(H if given.H is None else given.H), np.array(R if given.R is None else given.R)
        new = last._replace(k=last.k + 1, t=given.t, u=given.u, H=H, R=R, before=before, ahead=ahead, approaching=exact)
        return new._replace(seen=self._plant.seen(last.k + 1, given.u))

    def _updated(self, instant: Snapshot, z: Array) -> Snapshot:
        """The instant with the data z: from its state before to that after."""
        H, R, data = instant.H, instant.R, z - instant.seen
        used = np.isfinite(R.diagonal()) & ~np.isnan(z)
        if instant.ahead is None and not isinstance(instant.before, vague.State) and measured.perfect(R).any():
            x, P = instant.before.mean, instant.before.covariance
            instant = instant._replace(ahead=taken_over(JOSEPH, self._plant.model, x, P), approaching=gathered.begun(x[:, 0], P))
        if instant.ahead is not None:
            used = measured.informative(instant.ahead.P, H, measured.without(R, ~used))
        nu, S = np.full(len(z), np.nan), np.diag(np.full(len(z), np.inf))
        changed = instant._replace(z=z, used=used, after=instant.before, known=instant.ahead, innovation=nu, S=S)
        none = np.full(len(z), np.nan)
        changed = changed._replace(nis=np.nan, log_likelihood=0.0, diffuse=0.0, excess=none, allowed=none)
        if used.any():
            own = (data[used, None], H[used], self._plant.noise(R, used))
            changed = self._vaguely(changed, own) if isinstance(instant.before, vague.State) else self._told(changed, own)
        self._finite(instant.t, changed.after, changed.S.diagonal()[changed.used])
        if changed.known is not None:
            changed = self._compared(changed, H, R)
        if _contradictions(changed, self._first):
            changed = changed._replace(log_likelihood=-np.inf, diffuse=-np.inf)
        return changed

    def _told(self, instant: Snapshot, own: tuple[Array, Array, contract.Noise]) -> Snapshot:
        """The instant after its elements used, by the form."""
        after, told = self._form.update(instant.before, *own)
        known = None if instant.ahead is None else JOSEPH.update(instant.ahead, *own)[0]
        nu, S, used = instant.innovation, instant.S, instant.used
        x, P = instant.before.mean, instant.before.covariance
        nu[used, None], S[np.ix_(used, used)] = innovation(x, P, *own)
        both = float(told.nis[0]), float(told.log_likelihood[0])
        return instant._replace(after=after, known=known, nis=both[0], log_likelihood=both[1], diffuse=both[1])

    def _vaguely(self, instant: Snapshot, own: tuple[Array, Array, contract.Noise]) -> Snapshot:
        """The instant after its elements used, before the form takes over."""
        before, nu, S, used = instant.before, instant.innovation, instant.S, instant.used.copy()
        after, told = vague.update(before, *own)
        values, variances = vague.innovation(before, *own)
        used[used] = told.used
        nu[used, None], S[np.ix_(used, used)] = values[told.used], variances[np.ix_(told.used, told.used)]
        excess, terms = np.full(len(used), np.nan), np.full(len(used), np.nan)
        excess[instant.used], terms[instant.used] = told.excess[:, 0], told.terms
        allowed = contradictions.vaguely(terms + 2 * np.abs(instant.seen), len(before.P), instant.k)
        changed = instant._replace(after=after, used=used, diffuse=float(told.log_likelihood[0]), excess=excess, allowed=allowed)
        if before.unknown == 0:
            changed = changed._replace(log_likelihood=changed.diffuse)
        finite = used.any() and np.isfinite(S.diagonal()[used]).all()
        return changed._replace(nis=float(told.nis[0]) if finite else np.nan)

    def _compared(self, instant: Snapshot, H: Array, R: Array) -> Snapshot:
        """The instant with what its measurements say of what was known already."""
        x, P = zip(*((each.mean, each.covariance) for each in (instant.before, instant.after)), strict=True)
        found = gathered.updated(instant.approaching, instant.z - instant.seen, instant.seen, H, R, x, P, instant.used)
        return instant._replace(gathered=found[0], excess=found[1], allowed=found[2])

    def _finite(self, t: float, state: Any, variances: Array) -> None:
        """An overflow is refused; from a start without information NaN and inf have their meaning."""
        x, P = state.mean, state.covariance
        start = not np.isfinite(self._plant.P0).all()
        free = np.isposinf(P.diagonal()) & start
        finite = (np.isfinite(P) | np.diag(free)).all() and (np.isfinite(x[:, 0]) | free).all()
        if not (finite and (np.isfinite(variances) | start).all()):
            msg = f"form {self._algorithm}: expected finite covariances, received an overflow at t = {moment(t)} s"
            raise FloatingPointError(msg)


def _contradictions(instant: Snapshot, first: int) -> tuple[Contradiction, ...]:
    """The elements of an instant that disagree with what was known."""
    wrong = np.flatnonzero(np.abs(instant.excess) > instant.allowed)
    return tuple(
        Contradiction(instant.k - first, int(i), float(instant.excess[i]), float(instant.allowed[i])) for i in wrong.tolist()
    )


def _values(state: Any) -> tuple[Array, Array]:
    """Estimate (n,) and covariance (n, n) of a state, symmetric to the bit."""
    P = state.covariance
    return state.mean[:, 0].copy(), 0.5 * (P + P.T)


def _columns(state: Any) -> int | None:
    """How many columns a state has before the form takes over; ``None`` after that."""
    return state.A.shape[1] if isinstance(state, vague.State) else None
