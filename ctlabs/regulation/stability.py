r"""How far a plant may differ from its model before the loop loses its stability: gain, phase, delay, disk.

The loop is opened at one input, all others closed: :math:`\ell(s) = K(s)P(s)`. An optimal feedback of a known state tolerates gains from ½
to ∞ and 60° of phase; with an estimator nothing is guaranteed (Doyle 1978).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models.interop import state_space
from ctlabs.models.linear import ContinuousModel, DiscreteModel, input_names
from ctlabs.regulation.closed import unstable
from ctlabs.regulation.continuous import ContinuousRegulator
from ctlabs.regulation.design import Regulator


class Margin(NamedTuple):
    r"""The margins of one loop.

    ``gain`` (low, high), factors of the loop's gain between which it stays stable (0 and inf: none within a million times) ·
    ``phase``, rad, and ``delay``, s, that it bears · ``modulus``, the least distance of its frequency response from −1, 1/‖S‖∞ ·
    ``disk``, α of the balanced disk: gain and phase may vary together by
    :math:`(1+\alpha\delta/2)/(1-\alpha\delta/2), |\delta| \le 1` · ``crossover``, rad/s, where the phase margin is (nan: nowhere)
    """

    gain: tuple[float, float]
    phase: float
    delay: float
    modulus: float
    disk: float
    crossover: float

    @property
    def disk_gain(self) -> tuple[float, float]:
        """Gains that the disk allows, with its phases at the same time."""
        half = 0.5 * self.disk
        return (1 - half) / (1 + half), (1 + half) / (1 - half) if half < 1 else np.inf

    @property
    def disk_phase(self) -> float:
        """Phase that the disk allows, rad."""
        return 2 * float(np.arctan(0.5 * self.disk))


@dataclass(frozen=True, slots=True, eq=False)
class Margins:
    """Margins of the loop opened at each input, by name, and ``together``, α for all inputs at once (a lower bound)."""

    inputs: dict[str, Margin]
    together: float


def margins(regulator: Regulator | ContinuousRegulator, truth: ContinuousModel | DiscreteModel | None = None) -> Margins:
    """The margins of a regulator's loop, by python-control.

    Parameters
    ----------
    regulator : steady; of a sampled plant the loop is that of the samples
    truth : the plant, by default that of the design

    Raises
    ------
    ValueError
        Scheduled gains; a loop that is not stable: the mode is named.

    Source: Doyle (1978), IEEE Trans. AC-23, 756; disks: Seiler, Packard & Gahinet (2020), IEEE Control Systems 40.

    >>> from ctlabs import Cost, DiscreteModel, regulator
    >>> plant = DiscreteModel([[1]], [[1]], [[1]], [[0.01]], P0=[[1]], B=[[1]])
    >>> found = margins(regulator(plant, Cost([[1]], [[1]]))).inputs["u"]
    >>> [round(value, 3) for value in found.gain]
    [0.0, 3.28]
    """
    if isinstance(regulator, Regulator) and regulator.steps is not None:
        msg = "margins are those of constant gains, and these are scheduled over a horizon"
        raise ValueError(msg)
    loop = regulator.closed if truth is None else regulator.loop(truth)  # type: ignore[arg-type]  # each kind takes a truth of its own
    M, r = loop.machine, loop.truth.r
    names = input_names(r)
    loads = {regulator.plant.states[i] for i in regulator.loads}  # a load stays as it is, whatever u does
    rest = [i for i, name in enumerate(loop.truth.states) if name not in loads]
    whole = _open(loop.truth, rest, M.A, M.B, -M.C, -M.D)
    closed = whole.closed(1.0)
    states = (*(loop.truth.states[i] for i in rest), *(f"{name} (controller)" for name in M.states))
    if reason := unstable(closed, (*states[len(rest) :], *states[: len(rest)]), continuous=not whole.dt):
        msg = f"margins: expected a loop whose every mode decays, received {reason}"
        raise ValueError(msg)
    omega = _frequencies(whole, np.linalg.eigvals(closed))
    found = {name: _margin(_opened(whole, i), omega) for i, name in enumerate(names)}
    return Margins(found, _least(lambda w: _together(whole, w), omega) if r > 1 else found["u"].disk)


class _Loop(NamedTuple):
    """An open loop from the plant's inputs back to them, −u = ℓ u; dt 0 in continuous time."""

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float

    def response(self, omega: Array) -> Array:
        """ℓ at frequencies (k,), (k, r, r)."""
        s = 1j * omega if not self.dt else np.exp(1j * omega * self.dt)
        resolvent = np.linalg.solve(s[:, None, None] * np.eye(len(self.A)) - self.A, np.broadcast_to(self.B, (len(s), *self.B.shape)))
        return np.asarray(self.C @ resolvent + self.D)

    def closed(self, gain: float) -> Array:
        """What moves the states of the loop with another gain."""
        return np.asarray(self.A - self.B @ np.linalg.solve(np.eye(len(self.D)) + gain * self.D, gain * self.C))

    def stable(self, gain: float) -> float:
        """How far the loop with another gain is from the boundary of stability; negative: stable."""
        values = np.linalg.eigvals(self.closed(gain))
        return float(np.abs(values).max(initial=0.0) - 1 if self.dt else values.real.max(initial=-np.inf))


def _open(plant: ContinuousModel | DiscreteModel, rest: list[int], A: Array, B: Array, C: Array, D: Array) -> _Loop:
    """Some states of a plant and the compensator in series, by python-control: its states come first."""
    assert plant.B is not None
    through = np.zeros((plant.m, plant.r)) if plant.D is None else plant.D
    dt = plant.dt if isinstance(plant, DiscreteModel) else 0.0
    moves = plant.Phi if isinstance(plant, DiscreteModel) else plant.F
    whole = state_space(A, B, C, D, dt) * state_space(moves[np.ix_(rest, rest)], plant.B[rest], plant.H[:, rest], through, dt)
    return _Loop(np.asarray(whole.A), np.asarray(whole.B), np.asarray(whole.C), np.asarray(whole.D), dt)


def _opened(loop: _Loop, i: int) -> _Loop:
    """The loop at one input, the others closed."""
    others = [j for j in range(len(loop.D)) if j != i]
    if not others:
        return loop
    closing = np.linalg.solve(np.eye(len(others)) + loop.D[np.ix_(others, others)], np.hstack([loop.C[others], loop.D[others][:, [i]]]))
    to_x, to_u = closing[:, :-1], closing[:, -1:]
    B, D = loop.B[:, others], loop.D[np.ix_([i], others)]
    return _Loop(loop.A - B @ to_x, loop.B[:, [i]] - B @ to_u, loop.C[[i]] - D @ to_x, loop.D[np.ix_([i], [i])] - D @ to_u, loop.dt)


def _frequencies(loop: _Loop, poles: Array) -> Array:
    """A grid that misses none of the loop's resonances, rad/s."""
    own = np.concatenate([np.linalg.eigvals(loop.A), poles])
    if loop.dt:
        own = np.log(own[np.abs(own) > 0].astype(complex)) / loop.dt
    sizes = np.abs(own)
    sizes = sizes[sizes > 0] if (sizes > 0).any() else np.ones(1)
    low = sizes.min() * 1e-3
    high = np.pi / loop.dt if loop.dt else sizes.max() * 1e3
    grid = np.geomspace(min(low, 0.5 * high), high, 2000)
    # A sharp resonance has points of its own, as many widths around it as count.
    peaks = own[(own.imag > 0) & (np.abs(own.real) < own.imag)]
    near = [w.imag + np.abs(w.real) * np.linspace(-5, 5, 41) for w in peaks]
    every = np.unique(np.concatenate([grid, *near]))
    return np.asarray(every[(every > 0) & (every <= high)])


def _margin(loop: _Loop, omega: Array) -> Margin:
    """The margins of a loop with one input."""
    response = loop.response(omega)[:, 0, 0]
    phase, delay, crossover = _phase(loop, omega, np.abs(response))
    modulus = _least(lambda w: np.abs(1 + loop.response(w)[:, 0, 0]), omega)
    return Margin(_gain(loop, omega, response), phase, delay, modulus, _least(lambda w: _disk(loop, w), omega), crossover)


def _disk(loop: _Loop, omega: Array) -> Array:
    """α at each frequency: 1/σ̄(½(S − T)), S = (1 + ℓ)⁻¹, T = 1 − S."""
    response = loop.response(omega)
    one = np.eye(len(loop.D))
    half = 0.5 * np.linalg.solve(one + response, one - response)
    return np.asarray(1 / np.maximum(np.linalg.norm(half, 2, axis=(1, 2)), np.finfo(float).tiny))


def _together(loop: _Loop, omega: Array) -> Array:
    """α for all inputs at once, a lower bound: the inputs in units that balance them, which are those of no user."""
    response = loop.response(omega)
    one = np.eye(len(loop.D))
    half = 0.5 * np.linalg.solve(one + response, one - response)
    size = np.abs(half) ** 2 * (1 - one)
    d = np.ones(half.shape[:2])
    for _ in range(20):  # Osborne's balancing of d_i m_ij / d_j, one input after the other
        for i in range(len(one)):
            row = (size[:, i] / d**2).sum(axis=1) * d[:, i] ** 2
            column = (size[:, :, i] * d**2).sum(axis=1) / d[:, i] ** 2
            known = (row > 0) & (column > 0)
            d[:, i] *= np.where(known, np.where(known, column, 1.0) / np.where(known, row, 1.0), 1.0) ** 0.25
    scaled = half * d[:, :, None] / d[:, None, :]
    return np.asarray(1 / np.maximum(np.linalg.norm(scaled, 2, axis=(1, 2)), np.finfo(float).tiny))


def _least(f: Callable[[Array], Array], omega: Array) -> float:
    """The least value of f over the frequencies, refined between the points of the grid."""
    from scipy.optimize import minimize_scalar

    omega = np.concatenate([[1e-4 * omega[0]], omega])  # the least value may be that at 0, which it approaches with ω²
    values = f(omega)
    i = int(values.argmin())
    low, high = np.log(omega[max(i - 1, 0)]), np.log(omega[min(i + 1, len(omega) - 1)])
    found = minimize_scalar(lambda x: float(f(np.exp([x]))[0]), bounds=(low, high), method="bounded", options={"xatol": 1e-9})
    return float(min(found.fun, values[i]))


def _phase(loop: _Loop, omega: Array, size: Array) -> tuple[float, float, float]:
    """The phase that the loop bears, the delay, and where |ℓ| = 1 has the former."""
    from scipy.optimize import brentq

    def above(x: float) -> float:
        return float(np.log(np.abs(loop.response(np.exp([x]))[0, 0, 0])))

    phase, delay, where = np.inf, np.inf, np.nan
    for i in np.flatnonzero((size[:-1] > 1) != (size[1:] > 1)):
        w = float(np.exp(brentq(above, np.log(omega[i]), np.log(omega[i + 1]), xtol=1e-14)))
        lag = float(np.angle(-loop.response(np.array([w]))[0, 0, 0])) % (2 * np.pi)  # what a delay may take before −180°
        if min(lag, 2 * np.pi - lag) < phase:
            phase, where = min(lag, 2 * np.pi - lag), w
        delay = min(delay, lag / w)
    return phase, delay, where


def _gain(loop: _Loop, omega: Array, response: Array) -> tuple[float, float]:
    """The factors between which the loop stays stable: where ℓ crosses the negative real axis, proved by the poles of the loop."""
    from scipy.optimize import brentq

    crossed = np.flatnonzero((response.imag[:-1] > 0) != (response.imag[1:] > 0))
    ends = loop.response(np.array([1e-9 * omega[0], omega[-1]]))[:, 0, 0].real
    places = np.concatenate([0.5 * (response.real[crossed] + response.real[crossed + 1]), ends])
    about = -1 / places[places < 0]
    about = about[(about > 1e-6) & (about < 1e6)]  # farther away is as good as never
    grid = np.unique(np.concatenate([np.geomspace(1e-6, 1e6, 241), *(about * factor for factor in (0.98, 1.02))]))

    def bound(gains: Array, none: float) -> float:
        last = 1.0
        for gain in gains:
            if loop.stable(float(gain)) >= 0:
                return float(brentq(lambda g: loop.stable(float(np.exp(g))), np.log(last), np.log(gain), xtol=1e-13, rtol=1e-14))
            last = float(gain)
        return none

    low, high = bound(grid[grid < 1][::-1], -np.inf), bound(grid[grid > 1], np.inf)
    return (0.0 if low == -np.inf else float(np.exp(low)), np.inf if high == np.inf else float(np.exp(high)))
