r"""A regulator as a machine that is fed measurements: a few matrices and the state that it carries.

.. math:: u_k = C\xi_k + Dz_k + Fr_k + f, \qquad \xi_{k+1} = A\xi_k + Bz_k + Gr_k + g

ξ is the estimate before the measurement, with the integrals and the inputs on their way where there are any. An element of z that is
missing is replaced by what is expected of it, :math:`\hat z = \hat H\xi + \hat d + \hat Du`: it tells nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.online import files
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import at

#: The axes of each matrix where it does not vary.
AXES = {"A": 2, "B": 2, "C": 2, "D": 2, "F": 2, "G": 2, "f": 1, "g": 1, "H_hat": 2, "d_hat": 1, "D_hat": 2}


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """The matrices of the module's equations; each may have a time axis. ``xi0`` (q,), the state at t0 · names, for labels."""

    A: Array
    B: Array
    C: Array
    D: Array
    F: Array
    G: Array
    f: Array
    g: Array
    H_hat: Array
    d_hat: Array
    D_hat: Array
    xi0: Array
    dt: float
    states: tuple[str, ...]
    measurements: tuple[str, ...]
    set_points: tuple[str, ...]

    @property
    def steps(self) -> int | None:
        """Instants it is given for; ``None``: for ever."""
        lengths = [len(M) for name, axes in AXES.items() if (M := getattr(self, name)).ndim > axes]
        return min(lengths, default=None)

    def at(self, k: int) -> dict[str, Array]:
        """The matrices of one instant."""
        return {name: at(getattr(self, name), k, axes) for name, axes in AXES.items()}


class ContinuousMachine(NamedTuple):
    r"""The controller: :math:`u = C\xi + Dz + F_rr,\ \dot\xi = A\xi + Bz + G_rr`; D acts on measurements without noise only."""

    A: Array
    B: Array
    C: Array
    D: Array
    F: Array
    G: Array
    xi0: Array
    states: tuple[str, ...]
    set_points: tuple[str, ...]


class Controller:
    """A regulator at work: it remembers what it has seen.

    >>> one = np.ones((1, 1))
    >>> none, zero = np.zeros((1, 0)), np.zeros(1)
    >>> machine = Machine(0.5 * one, one, -one, 0 * one, none, none, zero, zero, one, zero, 0 * one, zero, 1.0, ("x",), ("z",), ())
    >>> controller = Controller(machine)
    >>> [controller.step(z).item() for z in (1.0, 0.0, None)]
    [0.0, -1.0, -0.5]
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.k = 0
        self.xi = np.array(machine.xi0)

    def step(self, z: ArrayLike | None, set_point: ArrayLike | None = None) -> Array:
        """The input that answers a measurement, (r,).

        Parameters
        ----------
        z : (m,), or a number where m = 1; NaN or ``None`` marks a missing element, ``None`` alone an instant without a measurement
        set_point : (p,), what the tracked outputs shall be, zero by default

        Raises
        ------
        ValueError
            Infinite values, other sizes; an instant after the last for which scheduled gains are given.
        """
        machine, m = self.machine, len(self.machine.measurements)
        if machine.steps is not None and self.k >= machine.steps:
            msg = f"step: expected at most {machine.steps} steps, for which the gains are given, received one more"
            raise ValueError(msg)
        data = np.full(m, np.nan) if z is None else np.array(z, dtype=np.float64).reshape(-1)
        if data.shape != (m,) or np.isinf(data).any():
            msg = f"z: expected {m} finite numbers (NaN: not measured), received {z!r}"
            raise ValueError(msg)
        p = len(machine.set_points)
        r = np.zeros(p) if set_point is None else checks.shaped("set_point", np.atleast_1d(np.asarray(set_point, dtype=np.float64)), (p,))
        M, xi = machine.at(self.k), self.xi
        missing = np.isnan(data)
        u = M["C"] @ xi + M["F"] @ r + M["f"]  # the measurement's share comes below; where D_hat counts it has none
        data = np.where(missing, M["H_hat"] @ xi + M["d_hat"] + M["D_hat"] @ u, data)
        u = u + M["D"] @ data
        self.xi = M["A"] @ xi + M["B"] @ data + M["G"] @ r + M["g"]
        self.k += 1
        return np.asarray(u)

    def restart(self) -> None:
        """Back to t0."""
        self.k, self.xi = 0, np.array(self.machine.xi0)

    def save(self, path: str | Path) -> Path:
        """The whole controller in a file, from which :meth:`load` goes on to the bit."""
        target = Path(path)
        labels = {name: list(getattr(self.machine, name)) for name in ("states", "measurements", "set_points")}
        arrays = {name: getattr(self.machine, name) for name in (*AXES, "xi0")}
        files.write(target, {"controller": labels, "k": self.k, "dt": self.machine.dt.hex()}, {**arrays, "xi": self.xi})
        return target

    @classmethod
    def load(cls, path: str | Path) -> Controller:
        """The controller that was saved."""

        def restore(header: dict[str, Any], arrays: dict[str, Array]) -> Controller:
            names: dict[str, Any] = {name: tuple(labels) for name, labels in header["controller"].items()}
            matrices: dict[str, Any] = {name: arrays[name] for name in (*AXES, "xi0")}
            found = cls(Machine(**matrices, dt=float.fromhex(header["dt"]), **names))
            found.k, found.xi = header["k"], np.array(arrays["xi"])
            return found

        return files.read(Path(path), restore)

