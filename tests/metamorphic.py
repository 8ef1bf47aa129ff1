"""Changes of a problem that must change its answer in a known way, and every verb that they are tried on.

A change of units or of basis writes the states as Tx, the measurements as Zz and time as t·c. Every answer then changes
like what it is made of: P becomes TPTᵀ, K becomes TKZ⁻¹, a probability stays. A verb says of what its answer is made, in one
line of a table; strategies and comparison are common.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import hypothesis.strategies as st
import numpy as np

from ctlabs.analysis import diagnosis, sensitivity
from ctlabs.filtering import bucy, covariances, kalman_filter, smooth, steady
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.online import Filter
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel, observability
from ctlabs.models.cost import Cost
from ctlabs.models.discretisation import discretise
from ctlabs.models.shaping import stationary_covariance
from ctlabs.regulation import lqr, regulator, sample
from tests.strategies import covariance, seeds

STEPS = 12


@dataclass(frozen=True)
class Change:
    """States Tx, measurements Zz, time in units of which the old one is ``c``."""

    T: Array
    Z: Array
    c: float = 1.0

    def model(self, model: Any) -> Any:
        """The model in the new words."""
        back = np.linalg.inv(self.T)
        H, x0, P0 = self.Z @ model.H @ back, self.T @ model.x0, _both(self.T, model.P0)
        names = {"states": None, "units": None, "measurements": None}
        if isinstance(model, ContinuousModel):
            F, G = self.T @ model.F @ back / self.c, self.T @ model.G / self.c
            Rc = None if model.Rc is None else self.c * _both(self.Z, model.Rc)
            N = None if model.N is None else self.c * model.N @ self.Z.T
            return ContinuousModel(F, G, self.c * model.Q, H, Rc=Rc, N=N, x0=x0, P0=P0, **names)
        N = None if model.N is None else self.T @ model.N @ self.Z.T
        offset = None if model.offset is None else model.offset @ self.T.T
        return DiscreteModel(
            self.T @ model.Phi @ back, _both(self.T, model.Qd), H, _both(self.Z, model.R), x0=x0, P0=P0, dt=model.dt * self.c,
            N=N, offset=offset, **names,
        )  # fmt: skip

    def record(self, z: Array) -> Array:
        """The measurements in the new words; Z takes one to one."""
        missing = np.isnan(z).astype(float) @ (self.Z.T != 0) > 0
        return np.where(missing, np.nan, np.nan_to_num(z) @ self.Z.T)

    def answer(self, value: Any, made: str, measured: Array) -> Any:
        """What becomes of an answer that is made of ``made``: a letter of each axis (x, z, and their inverses X, Z)."""
        if made == "log":  # of a density of so many ``measured`` values (m,)
            return value - measured @ np.log(np.abs(self.Z).sum(axis=0))
        matrices = {"x": self.T, "z": self.Z, "X": np.linalg.inv(self.T).T, "Z": np.linalg.inv(self.Z).T}
        value = np.asarray(value)
        for axis, letter in enumerate(reversed(made.replace("t", "").replace("/", "")), start=1):
            value = np.moveaxis(np.moveaxis(value, -axis, -1) @ matrices[letter].T, -1, -axis)
        return value * self.c if "t" in made else value / self.c if "/" in made else value


@dataclass(frozen=True)
class Verb:
    """A verb, how it is called with a model and a record, and what each of its answers is made of."""

    name: str
    call: Callable[[Any, Array], Any]
    made: dict[str, str]


#: What a row of a filter is made of.
ROW = {"x_minus": "x", "x_plus": "x", "P_minus": "xx", "P_plus": "xx", "K": "xZ", "S": "zz", "nis": ""}


def _online(model: DiscreteModel, z: Array) -> Any:
    filter_ = Filter(model)
    rows = [filter_.step(row) for row in z]
    return {name: np.array([getattr(row, name) for row in rows]) for name in ROW}


FILTERED = {"x_minus": "x", "x_plus": "x", "P_minus": "xx", "P_plus": "xx", "S": "zz", "nis": "", "log_likelihood": "log"}

PLANNED = {"P_minus": "xx", "P_plus": "xx", "K": "xZ", "S": "zz"}

#: What kalman_filter goes by.
ALGORITHMS = ["auto", "filterpy", *(name for name in FORMS if name != "steady")]

#: What a loop's answers are made of: its inputs have units of their own.
LOOP = {"L": "X", "u": "", "cost": ""}

#: The verbs of discrete models. A new one is one line.
DISCRETE = [
    Verb("steady.solve", lambda m, z: steady.solve(m), {"P_minus": "xx", "P_plus": "xx", "K": "xZ", "K_pred": "xZ", "S": "zz"}),
    *(Verb(f"covariances.{name}", lambda m, z, name=name: covariances(m, STEPS, algorithm=name), PLANNED) for name in ("auto", "filterpy")),
    *(Verb(f"kalman_filter.{name}", lambda m, z, name=name: kalman_filter(m, z, algorithm=name), FILTERED) for name in ALGORITHMS),
    Verb("smooth", smooth, {"x": "x", "P": "xx", "lag_one": "xx"}),
    Verb("smooth.lag", lambda m, z: smooth(m, z, lag=2), {"x": "x", "P": "xx"}),
    Verb("Filter", _online, ROW),
    Verb("sensitivity.actual", lambda m, z: sensitivity.actual(replace(m, Qd=2 * m.Qd), m, STEPS), {"P_minus": "xx", "P_plus": "xx"}),
    Verb("sensitivity.steady", lambda m, z: sensitivity.steady(replace(m, Qd=2 * m.Qd), m), {"P_minus": "xx", "P_plus": "xx"}),
    Verb("observability.gramian", lambda m, z: {"W": observability.gramian(_unit(m), 5)}, {"W": "XX"}),
    Verb("observability.analyse", lambda m, z: {"rank": observability.analyse(m).rank}, {"rank": ""}),
    Verb("diagnosis.innovations", lambda m, z: _diagnosed(m, z), {"nis_p": ""}),
    Verb("lqr", lambda m, z: lqr(_driven(m), _cost(m)), {"L": "X", "S": "XX", "L_w": "X"}),
    Verb("regulator.current", lambda m, z: _regulated(regulator(_driven(m), _cost(m))), LOOP),
    Verb("regulator.delayed", lambda m, z: _regulated(regulator(_driven(m), _cost(m), kind="delayed")), LOOP),
]

#: The verbs of continuous models, which need no record.
CONTINUOUS = [
    Verb("bucy.steady", lambda m, z: bucy.steady(m), {"P": "xx", "K": "xZ/"}),
    Verb("bucy.transient", lambda m, z: bucy.transient(m, rate(m) * np.array([0.3, 1.0, 4.0])), {"P": "xx"}),
    Verb("discretise", lambda m, z: discretise(m, 0.5 * rate(m)), {"Qd": "xx"}),
    Verb("lqr.continuous", lambda m, z: _per_time(lqr(_driven(m), _cost(m)), rate(m)), {"L": "X", "S": "XX"}),
    Verb("regulator.continuous", lambda m, z: _regulated(regulator(_driven(m), _cost(m))), LOOP),
    Verb("sample", lambda m, z: _sampled(sample(_driven(m), _cost(m), 0.5 * rate(m))), {"Qx": "XX", "N": "X", "Qu": "", "constant": ""}),
    Verb("regulator.sampled", lambda m, z: _regulated(regulator(_driven(m), _cost(m), dt=0.5 * rate(m), delay=0.0)), LOOP),
    Verb("shaping.stationary_covariance", lambda m, z: {"P": stationary_covariance(m)}, {"P": "xx"}),
]


def _driven(model: Any) -> Any:
    """The model with inputs that move it in directions of its own."""
    A = model.F if isinstance(model, ContinuousModel) else model.Phi
    return replace(model, B=(A @ model.x0)[:, None])


def _cost(model: Any) -> Cost:
    """Weights that belong to the model."""
    noise = model.Rc if isinstance(model, ContinuousModel) else model.R
    time = rate(model) if isinstance(model, ContinuousModel) else 1.0
    return Cost(time * model.H.T @ np.linalg.solve(noise, model.H), [[0.7]])


def _regulated(found: Any) -> Any:
    return {"L": found.L, "u": found.closed.steady().u.P, "cost": found.cost.value}


def _per_time(found: Any, time: float) -> Any:
    return {"L": found.L, "S": found.S / time}


def _sampled(found: Any) -> Any:
    cost, dt = found.cost, found.model.dt
    return {"Qx": cost.Qx / dt, "N": cost.N.T / dt, "Qu": cost.Qu / dt, "constant": cost.constant / dt}


def rate(model: ContinuousModel) -> float:
    """A time of the model's own."""
    return float(1 / np.abs(np.linalg.eigvals(model.F)).max())


def _unit(model: DiscreteModel) -> DiscreteModel:
    """Measurements in units of their noise, without which a Gramian means nothing."""
    root = np.linalg.inv(np.linalg.cholesky(model.R))
    return replace(model, H=root @ model.H, R=np.eye(model.m), N=None)


def _diagnosed(model: DiscreteModel, z: Array) -> Any:
    return {"nis_p": diagnosis.diagnose(model, z).nis_p}


def _both(T: Array, P: Array) -> Array:
    moved = T @ P @ T.T
    return 0.5 * (moved + moved.T)


# Strategies -----------------------------------------------------------------------------------------------------------


@st.composite
def problems(draw: st.DrawFn, continuous: bool = False, correlated: bool = False) -> tuple[Any, Array]:
    """A stable, driven model with a record of its measurements, one value missing; ``correlated``: perhaps with N."""
    n, m, rng = draw(st.integers(1, 3)), draw(st.integers(1, 2)), np.random.default_rng(draw(seeds))
    A = rng.normal(size=(n, n))
    H, x0 = rng.normal(size=(m, n)), rng.normal(size=n)
    z = rng.normal(size=(STEPS + 1, m))[1:]
    z[3, 0] = np.nan
    if continuous:
        F = A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
        return ContinuousModel(F, np.eye(n), covariance(rng, n), H, Rc=covariance(rng, m), x0=x0, P0=covariance(rng, n)), z
    Phi = 0.9 * A / np.abs(np.linalg.eigvals(A)).max()
    joint = covariance(rng, n + m)
    N = joint[:n, n:] if correlated and draw(st.booleans()) else None
    return DiscreteModel(Phi, joint[:n, :n], H, joint[n:, n:], x0=x0, P0=covariance(rng, n), N=N), z


@st.composite
def changes(draw: st.DrawFn, n: int, m: int, kind: str) -> Change:
    """Other units, another order, or another basis."""
    rng = np.random.default_rng(draw(seeds))
    if kind == "units":
        powers = 10.0 ** rng.integers(-9, 10, size=n + m)
        return Change(np.diag(powers[:n]), np.diag(powers[n:]), 10.0 ** int(rng.integers(-6, 7)))
    if kind == "order":
        return Change(np.eye(n)[rng.permutation(n)], np.eye(m)[rng.permutation(m)])
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0] @ np.diag(2.0 ** rng.integers(-2, 3, size=n))
    return Change(basis, np.diag(2.0 ** rng.integers(-2, 3, size=m)))


def field(found: Any, name: str) -> Any:
    """An answer's entry, of an object or of a dict."""
    return found[name] if isinstance(found, dict) else getattr(found, name)
