"""A model as an online filter takes it: when it may be measured, and what moves it from instant to instant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering import measured, motion
from ctlabs.filtering.algorithms.contract import Noise
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel, at
from ctlabs.models.discretisation import interval
from ctlabs.text import moment

#: Intervals whose discretisation is kept.
CACHED = 64
#: A time this close to an instant of a discrete model, as a fraction of its period, is that instant.
ON_GRID = 1e-6
#: The known input of a model that has none.
NO_INPUT = np.zeros(0)
#: More instants than these are not skipped: such a time is a mistake of its unit.
SKIPPED = 10**6


class Snapshot(NamedTuple):
    """One instant: the known input from then on, the data with their H and R, and the form's states before and after the update.

    ``seen`` (m,): what known inputs bring into the data.

    Until a vague start is over they are those of :mod:`ctlabs.filtering.algorithms.vague`. ``diffuse`` is the
    log-likelihood of everything measured,
    ``log_likelihood`` that of what is measured when something is known of every state.
    ``known`` is Joseph's state after the update where some measurements are perfect and the form has no loops: it tells which of them are
    known already; ``ahead`` the same before the update. Of those that are, ``excess`` (m,) is the
    innovation and ``allowed`` (m,) what rounding explains of it, from what it may have ``gathered`` in x (and ``approaching``
    the update).
    """

    k: int
    t: float
    u: Array
    z: Array
    seen: Array
    H: Array
    R: Array
    used: Array
    before: Any
    after: Any
    ahead: Any
    known: Any
    innovation: Array
    S: Array
    nis: float
    log_likelihood: float
    diffuse: float
    approaching: Any
    gathered: Any
    excess: Array
    allowed: Array


class Given(NamedTuple):
    """An instant to go to: its time, the known input from then on, its data, and their H and R where they are not the model's."""

    t: float
    u: Array
    z: Array
    H: Array | None = None
    R: Array | None = None


class Plant:
    """What is common to both kinds of models.

    ``given``, the model as it was given · ``model``, the DiscreteModel that a form starts from · ``P0``, the covariance to
    start from · ``perfect``, whether some measurement has no noise of its own · ``R``, as it was given beside the model ·
    ``regular``, the model's R where it is one, regular, and of all elements
    """

    def __init__(
        self, given: DiscreteModel | ContinuousModel, model: DiscreteModel, R: Array | None, t0: float, P0: Any
    ) -> None:
        self.given, self.R, self.t0 = given, R, t0
        self.model = model if P0 is None else replace(model, P0=checks.measurement_covariance("P0", P0, (model.n, model.n)))
        self.P0 = self.model.P0
        self.perfect = measured.any_perfect(model.R)
        self.own_H, self.own_R = (np.array(own) for own in (self.model.H, self.model.R))  # of one kind, for compiled loops
        regular = self.own_R.ndim == 2 and not self.perfect and bool(np.isfinite(self.own_R).all())
        self.regular = Noise(self.own_R) if regular else None
        self.horizon, self._nothing_seen = self.model.horizon, np.zeros(given.m)
        self._kept: dict[Any, Any] = {}

    def input(self, u: ArrayLike | None, name: str = "u") -> Array:
        """The known input, (r,)."""
        r = self.given.r
        if u is not None and not r:
            msg = f"{name}: expected a model with B or D, received one without"
            raise ValueError(msg)
        if u is None and r:
            letter = "B" if self.given.B is not None else "D"
            msg = f"{name}: expected the known input, ({r},), as the model has {letter}; received None"
            raise ValueError(msg)
        return NO_INPUT if u is None else checks.shaped(name, np.atleast_1d(np.asarray(u, dtype=np.float64)), (r,))

    def seen(self, k: int, u: Array) -> Array:
        """Du + d at instant k."""
        given, total = self.given, self._nothing_seen
        if given.D is not None:
            total = total + at(given.D, k, 2) @ u
        return total if given.measurement_offset is None else total + at(given.measurement_offset, k, 1)

    def measured(self, k: int) -> tuple[Array, Array]:
        """H and R at instant k."""
        return at(self.own_H, k, 2), at(self.own_R, k, 2)

    def noise(self, R: Array, used: Array) -> Noise:
        """The covariance of the elements used."""
        return self._keep(("R", R.tobytes(), used.tobytes()), True, lambda: Noise(R[np.ix_(used, used)]))

    def _keep(self, key: Any, constant: bool, make: Callable[[], Any]) -> Any:
        """What was made before of ``constant`` matrices, if it is among the last :data:`CACHED`."""
        if not constant:
            return make()
        if key not in self._kept:
            if len(self._kept) >= CACHED:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = make()
        return self._kept[key]


class Periodic(Plant):
    """A DiscreteModel: instants t0 + k·dt."""

    def __init__(self, given: DiscreteModel, t0: float, P0: Any) -> None:
        super().__init__(given, given, None, t0, P0)
        constant = given.N is None and given.Phi.ndim == given.Qd.ndim == 2
        self._always = (np.array(given.Phi), Noise(np.array(given.Qd)), None) if constant else None

    def when(self, t: float | None, following: int) -> float:
        """The time of a measurement, one of the instants."""
        model, k = self.model, following
        if t is not None:
            time = finite_time("t", t)
            ratio = (time - self.t0) / model.dt
            k = round(ratio) if abs(ratio) < 2**53 else -1
            if abs(self.t0 + k * model.dt - time) > ON_GRID * model.dt + 4 * np.spacing(abs(time)):
                wanted = f"an instant t0 + k*dt (t0 = {moment(self.t0)} s, dt = {model.dt:g} s)"
                msg = f"t: expected {wanted}; a ContinuousModel takes any time; received {time!r}"
                raise ValueError(msg)
        if self.horizon is not None and k > self.horizon:
            msg = f"t: expected at most {self.horizon} steps (the model is given for so many), received step {k}"
            raise ValueError(msg)
        return self.t0 + k * model.dt

    def way(self, last: Snapshot, given: Given) -> Iterator[Given]:
        """The instants after the last one up to the given one, without a measurement before it."""
        time = given.t
        end = round((time - self.t0) / self.model.dt)
        if end == last.k + 1:
            return iter((given._replace(t=self.t0 + end * self.model.dt),))
        if end - last.k > SKIPPED:
            msg = f"t: expected at most {SKIPPED} instants ahead (now is {moment(last.t, time)} s), received {moment(time, last.t)}"
            raise ValueError(msg)
        nothing = np.full(self.model.m, np.nan)
        between = (Given(self.t0 + k * self.model.dt, last.u, nothing) for k in range(last.k + 1, end))
        return chain(between, [given._replace(t=self.t0 + end * self.model.dt)])

    def motion(self, last: Snapshot, given: Given) -> tuple[Array, Array | None, Noise]:
        """Φ, c and Q to the next instant; with N ≠ 0 what the last measurement tells of w is in them."""
        model = self.model
        Phi, Q, M = self._always or self._moved(last)
        c = None if model.offset is None else at(model.offset, last.k, 1)[:, None]
        if model.B is not None:
            moved = (at(model.B, last.k, 2) @ last.u)[:, None]
            c = moved if c is None else c + moved
        if M is not None:
            told = M @ (last.z - last.seen)[last.used, None]
            c = told if c is None else c + told
        return Phi, c, Q

    def _moved(self, last: Snapshot) -> tuple[Array, Noise, Array | None]:
        """Φ, Q and the gain on what was measured last; the same for the same elements, if the model is constant."""
        model, used = self.model, last.used
        coupled = model.N is not None and bool(used.any())
        constant = model.Phi.ndim == model.Qd.ndim == 2
        key = ("motion", *(part.tobytes() for part in (used, last.H, last.R) if coupled))
        return self._keep(key, constant, lambda: self._motion(last))

    def _motion(self, last: Snapshot) -> tuple[Array, Noise, Array | None]:
        Phi, Qd, M = motion.measured(self.model, last.k, last.used, last.H, last.R)
        return Phi, Noise(Qd), M


class Sampled(Plant):
    """A ContinuousModel, measured at any times with noises of the covariance R."""

    def __init__(self, given: ContinuousModel, R: ArrayLike, t0: float, P0: Any) -> None:
        R = checks.measurement_covariance("R", R, (given.m, given.m))
        self._B = np.zeros((given.n, 0)) if given.B is None else given.B
        self._F, self._W = given.F, given.G @ given.Q @ given.G.T
        still = np.eye(given.n), np.zeros((given.n, given.n))  # over no time
        super().__init__(given, DiscreteModel(*still, given.H, R, x0=given.x0, P0=given.P0), R, t0, P0)

    def when(self, t: float | None, following: int) -> float:
        """The time of a measurement."""
        if t is None and following:
            msg = "t: expected the time of the measurement, in s (a ContinuousModel has no period), received None"
            raise ValueError(msg)
        return self.t0 if t is None else finite_time("t", t)

    def way(self, last: Snapshot, given: Given) -> Iterator[Given]:
        """The next instant, whenever it is."""
        return iter([given])

    def motion(self, last: Snapshot, given: Given) -> tuple[Array, Array | None, Noise]:
        """Φ, c and Q over the interval; equal intervals are discretised once."""
        h = given.t - last.t
        Phi, Q, input_ = self._keep(("h", h), True, lambda: self._interval(h))
        return Phi, (input_ @ last.u[:, None] if self._B.shape[1] else None), Q

    def _interval(self, h: float) -> tuple[Array, Noise, Array]:
        Phi, Qd, Gamma = interval(self._F, self._W, h)
        return Phi, Noise(Qd), Gamma @ self._B


def plant(model: object, algorithm: str, R: ArrayLike | None, t0: float, P0: Any) -> Periodic | Sampled:
    """The model as a plant, or why a filter cannot have it."""
    if isinstance(model, ContinuousModel):
        if R is None:
            msg = "R: expected the covariance of a sampled measurement, in unit² (Rc is a strength): pass R; received None"
            raise ValueError(msg)
        if model.N is not None:
            msg = "model: expected no N (it correlates w with a continuous measurement's noise), received one"
            raise ValueError(msg)
        if algorithm == "steady":
            msg = "algorithm: expected a DiscreteModel for steady (irregular times have no limit), received a ContinuousModel"
            raise ValueError(msg)
        return Sampled(model, R, t0, P0)
    if not isinstance(model, DiscreteModel):
        msg = f"model: expected a DiscreteModel or a ContinuousModel, received a {type(model).__name__}"
        raise TypeError(msg)
    if R is not None:
        msg = "R: expected none beside a DiscreteModel, which has its own (step takes another); received one"
        raise ValueError(msg)
    return Periodic(model, t0, P0)


def finite_time(name: str, value: object) -> float:
    """A finite time, s."""
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not np.isfinite(value):  # type: ignore[call-overload]  # a number, as was just seen
        msg = f"{name}: expected a finite time in s, received {short(value)}"
        raise ValueError(msg)
    return float(value)  # type: ignore[arg-type]


def short(value: object) -> str:
    """A value in one line that is not long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."
