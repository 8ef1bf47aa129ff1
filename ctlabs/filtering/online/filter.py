"""The filter that is fed one measurement at a time."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count
from math import isinf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.algorithms.catalogue import form
from ctlabs.filtering.gate import width
from ctlabs.filtering.measured import begins
from ctlabs.filtering.online import files
from ctlabs.filtering.online.plants import Given, Snapshot, finite_time, plant, short
from ctlabs.filtering.online.stepper import Stepper, columns, gated, template
from ctlabs.filtering.results import FilteredRow, LeftOut
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.text import moment


class Filter:
    """A filter that is fed one measurement at a time; its numbers are those of :func:`ctlabs.kalman_filter`.

    Parameters
    ----------
    model : a DiscreteModel, constant or given for a number of steps; or a ContinuousModel, which may be measured at any
        times and is discretised for each interval
    algorithm : ``"auto"`` (square roots, the form ``array``, by a compiled loop) or another form of
        :mod:`ctlabs.filtering.algorithms` by name; ``steady`` needs a DiscreteModel, measured at every instant
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
        algorithm = "array" if algorithm in ("auto", "filterpy") else algorithm
        form(algorithm, "auto", "filterpy")
        self._plant = plant(model, algorithm, R, finite_time("t0", t0), P0)
        self._algorithm, self._first = algorithm, begins(self._plant.model, first)
        self._memory = checks.count("memory", memory, least=0)
        self._before, self._begun = (0.0, 0.0), False  # log-likelihoods of what is forgotten; whether a step was made
        self._stepper = Stepper(self._plant, algorithm, self._first)
        u = np.full(self._plant.given.r, np.nan) if u0 is None else self._plant.input(u0, "u0")
        self._past = [self._stepper.begun(u)]

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
        data, now = self._data(z), self._past[-1]
        time = self._plant.when(t, now.k + 1 if self._begun or self._first else 0)
        late = time < now.t or (time == now.t and self._begun)
        if u is not None and late:
            msg = f"u: expected none with a measurement at {moment(time, now.t)} s (now is {moment(now.t, time)} s), received one"
            raise ValueError(msg)
        model = self._plant.model
        rows = None if H is None else np.array(checks.shaped("H", H, (model.m, model.n)))
        noise = None if R is None else checks.measurement_covariance("R", R, (model.m, model.m))
        left: tuple[LeftOut, ...] = ()
        if gate is not None:
            if late:
                present = moment(now.t, time)
                msg = f"gate: expected none with a late measurement ({moment(time, now.t)} s, now is {present} s), received one"
                raise ValueError(msg)
            data, left = self._gated(data, width(gate), t, u, H, R)
        try:
            if time > now.t:
                self._go(self._past, self._plant.way(now, Given(time, self._plant.input(u), data, rows, noise)))
            else:
                self._insert(Given(time, now.u if late else self._plant.input(u), data, rows, noise))
        except np.linalg.LinAlgError as error:
            received = f"one singular by rounding (measurement at {moment(time)} s)"
            msg = f"form {self._algorithm}: expected matrices with an inverse, received {received}"
            raise FloatingPointError(msg) from error
        self._begun = True
        return self._stepper.row(self._past[-1], left)

    def _gated(
        self, data: Array, gate: float, t: float | None, u: ArrayLike | None, H: ArrayLike | None, R: ArrayLike | None
    ) -> tuple[Array, tuple[LeftOut, ...]]:
        """The data within the gate, and the others: of a prediction to that time, which is undone."""
        before = self._past, self._before, self._begun
        try:
            self.step(None, t, u, H=H, R=R)
            return gated(self.estimate, self._past[-1], data, gate, self._first)
        finally:
            self._past, self._before, self._begun = before

    @property
    def estimate(self) -> FilteredRow:
        """The estimate at the present instant, as :meth:`step` returned it."""
        return self._stepper.row(self._past[-1])

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
        header |= {"columns": [[columns(state) for state in (each.before, each.after)] for each in self._past]}
        header |= {"exact": [[each.approaching is not None, each.gathered is not None] for each in self._past]}
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
        templates = [template(restored._stepper, restored._past[0], restored._plant, *kind) for kind in kinds]
        restored._past = [files.filled(templates[i], (arrays[f"instant.{i}.{j}"] for j in count())) for i in saved]
        own, diffuse = header["before"]
        restored._before, restored._begun = (float(own), float(diffuse)), bool(header["begun"])
        return restored

    # What is measured, in its place ---------------------------------------------------------------------------------

    def _data(self, z: ArrayLike | None) -> Array:
        """A measurement as (m,), NaN where nothing is measured."""
        m = self._plant.model.m
        try:
            data = np.full(m, np.nan) if z is None else np.array(z, dtype=np.float64)
        except (TypeError, ValueError):
            raise TypeError(_unreadable(z, m)) from None
        data = data.reshape(1) if data.ndim == 0 else data
        if data.shape != (m,) or any(map(isinf, data.tolist())):
            raise ValueError(_unreadable(z, m))
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
        return self._stepper.updated(instant._replace(H=H, R=R), np.where(new, data, instant.z))

    def _go(self, past: list[Snapshot], way: Iterable[Given]) -> None:
        """Predict and update along the ``way``; nothing changes unless all of it succeeds."""
        past, before = list(past), self._before
        for given in way:
            past.append(self._stepper.stepped(past[-1], given))
            if len(past) > self._memory + 1:
                gone = past.pop(0)
                before = (before[0] + gone.log_likelihood, before[1] + gone.diffuse)
        self._past, self._before = past, before


def _unreadable(z: object, m: int) -> str:
    """What was expected in place of z."""
    wanted = f"{m} finite numbers, NaN or None where one is missing" if m > 1 else "a finite number, NaN or None"
    return f"z: expected {wanted}, received {short(z)}"
