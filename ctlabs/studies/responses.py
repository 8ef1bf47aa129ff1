"""What a closed loop does without noise: after a step of a set point, from the initial state, after a kick."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel, at
from ctlabs.regulation.closed import ClosedLoop, LoopCovariances, closed
from ctlabs.text import _, fill


class Response(NamedTuple):
    """One motion of a loop: ``name`` · ``cause``, in words · ``t`` (steps+1,) s · ``x`` (steps+1, n), the plant's states · ``z`` (steps+1, m)
    · ``u`` (steps+1, r) · ``size``, so many
    times the cause.
    """

    name: str
    cause: str
    t: Array
    x: Array
    z: Array
    u: Array
    size: float = 1.0

    def scaled(self, size: float) -> Response:
        """The motion after so many times the cause: the loop is linear."""
        return self._replace(x=size * self.x, z=size * self.z, u=size * self.u, size=size * self.size)

    def settled(self, values: Array, final: float, part: float = 0.02) -> float | None:
        """From when on ``values`` stay within a ``part`` of their way to ``final``, s; ``None``: not within these steps."""
        band = part * abs(final - values[0])
        outside = np.flatnonzero(np.abs(values - final) > band)
        if not len(outside):
            return 0.0
        return None if outside[-1] + 1 >= len(self.t) else float(self.t[outside[-1] + 1])


def steps_of(loop: ClosedLoop, steps: int) -> tuple[Response, ...]:
    """The answer to a step of one unit in each set point, from rest.

    >>> from ctlabs import Cost, regulator
    >>> plant = DiscreteModel([[0.5]], [[1]], [[1]], [[1]], P0=[[1]], B=[[1]], measurements=["level"])
    >>> [found] = steps_of(regulator(plant, Cost([[1]], [[1]]), track=["level"]).closed, 30)
    >>> found.z[-1].round(6)
    array([1.])
    """
    names = loop.machine.set_points
    rest = closed(loop.truth, loop.machine)
    asked = (closed(loop.truth, loop.machine, np.eye(len(names))[i]) for i in range(len(names)))
    return tuple(_difference(each, rest, steps, name) for each, name in zip(asked, names, strict=True))


def _difference(loop: ClosedLoop, rest: ClosedLoop, steps: int, name: str) -> Response:
    """What the set point adds: both loops begin in one state, and what drives them apart from it is the same."""
    zero = np.zeros(loop.model.n)
    n, q, _m, _r = loop.sizes
    zero[n + q :] = loop.model.x0[n + q :] - rest.model.x0[n + q :]
    c, f = _constant(loop) - _constant(rest), _rest(loop) - _rest(rest)
    return _followed(loop, zero, steps, name, fill(_("a step of one unit in the set point of {name}"), name=name), c, f)


def _constant(loop: ClosedLoop) -> Array:
    return np.zeros(loop.model.n) if loop.model.offset is None else loop.model.offset


def _rest(loop: ClosedLoop) -> Array:
    assert loop.model.measurement_offset is not None
    return loop.model.measurement_offset


def start(over: LoopCovariances, truth: DiscreteModel) -> Response:
    """The mean motion from the initial state, which the regulator knows.

    Raises
    ------
    ValueError
        It begins at zero, and stays there.
    """
    if not (over.x.mean.any() or over.u.mean.any()):
        msg = "the plant begins at zero and stays there on average"
        raise ValueError(msg)
    known = ", ".join(f"{name} = {value:g}" for name, value in zip(truth.states, truth.x0, strict=True) if value)
    cause = fill(_("the initial state {known}"), known=known) if known else _("what is known to drive the plant")
    return Response("start", cause, over.t, over.x.mean, over.z.mean, over.u.mean)


def kicks(loop: ClosedLoop, model: ContinuousModel | DiscreteModel, steps: int) -> tuple[Response, ...]:
    r"""The answers to one kick by each source of noise, as large as one σ of it in a period, at t0.

    A noise w of a continuous plant moves the state at once by :math:`Ge_i\sqrt{Q_{ii}h}`, that of a discrete one a state by
    :math:`\sqrt{Q_{d,ii}}`; a measurement is wrong once by :math:`\sqrt{R_{ii}}`.
    """
    return tuple(_followed(loop, s, steps, name, cause) for name, cause, s in _kicked(loop, model))


def _kicked(loop: ClosedLoop, model: ContinuousModel | DiscreteModel) -> Iterator[tuple[str, str, Array]]:
    """Name, cause and the state (x, ξ, z) after each kick."""
    n, q, m, _r = loop.sizes
    truth = loop.truth
    H, R, _N = truth.measurement(0)
    for name, jump in _jumps(model, truth.dt):
        x = np.zeros(n)
        x[: len(jump)] = jump
        yield name, fill(_("one kick of the {name}"), name=name), np.concatenate([x, np.zeros(q), H @ x])
    for j, name in enumerate(truth.measurements):
        if 0 < R[j, j] < math.inf:
            wrong = np.zeros(n + q + m)
            wrong[n + q + j] = math.sqrt(R[j, j])
            yield f"error of {name}", fill(_("one error of {name}"), name=name), wrong


def _jumps(model: ContinuousModel | DiscreteModel, dt: float) -> Iterator[tuple[str, Array]]:
    if isinstance(model, ContinuousModel):
        for i in range(model.s):
            jump = model.G[:, i] * math.sqrt(model.Q[i, i] * dt)
            if jump.any():
                yield f"noise w{i + 1}" if model.s > 1 else "noise w", jump
        return
    for i, variance in enumerate(np.diag(at(model.Qd, 0, 2))):
        if variance:
            yield f"noise on {model.states[i]}", math.sqrt(variance) * np.eye(model.n)[i]


def _followed(
    loop: ClosedLoop, s: Array, steps: int, name: str, cause: str, c: Array | None = None, rest: Array | None = None
) -> Response:
    """The motion of (x, ξ, z) from s with the constant drive c; what is known to drive the plant otherwise is left out."""
    n, _q, m, r = loop.sizes
    found, outputs = [], []
    for k in range(steps + 1):
        found.append(s)
        seen = at(loop.model.H, k, 2) @ s
        outputs.append(seen if rest is None else seen + at(rest, k, 1))
        if k < steps:
            s = loop.model.motion(k)[0] @ s + (0.0 if c is None else at(c, k, 1))
    states, signals = np.array(found), np.array(outputs)
    t = loop.model.dt * np.arange(steps + 1)
    return Response(name, cause, t, states[:, :n], signals[:, :m], signals[:, m : m + r])
