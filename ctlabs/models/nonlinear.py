r"""Nonlinear systems in discrete time, by functions over blocks of runs: no loop over runs.

.. math:: x_{k+1} = f(k, x_k, w_k), \quad z_k = h(k, x_k, v_k), \quad x_0 \sim N(\bar x_0, P_0)

Every function takes arrays with the run as the last axis and returns one of the same kind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array

Motion = Callable[[int, Array, Array], Array]
Jacobian = Callable[[int, Array], Array]
Covariance = Array | Callable[[int, Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearModel:
    """A nonlinear system with Gaussian noises, as a truth or as the model of an extended filter.

    Parameters
    ----------
    f : (k, x (n, runs), w (s, runs)) → (n, runs), the state at k+1; for additive noise ``… + w``
    h : (k, x (n, runs), v (q, runs)) → (m, runs), the measurement at k
    Qd : (s, s) or (steps, s, s), covariance of w, unit². For a design also a function (k, x̂) → (n, n[, runs]), the
        covariance that is added to the state's.
    R : (q, q) or (steps+1, q, q), covariance of v, unit²; inf on the diagonal: no measurement (as many noises as
        measurements). For a design also a function (k, x̂⁻) → (m, m[, runs]), the
        covariance that the filter takes for the measurement's, for example at the predicted geometry.
    x0, P0 : (n,), (n, n)
    dt : period, s
    F, H : (k, x̂) → (n, n[, runs]), (m, n[, runs]), the derivatives; by central differences if not given
    residual : (z, ẑ) → z − ẑ, where that needs care (angles); the difference if not given
    first : the index of the first measurement, 1 (a period after t0) or 0 (at t0)
    states, measurements : names

    Raises
    ------
    ValueError, TypeError
        Shapes that do not fit; what the functions return is checked by one trial call.

    >>> from ctlabs import kalman_filter
    >>> def fall(k, x, w):
    ...     return x + w
    >>> def distance(k, x, v):
    ...     return np.hypot(x, 3.0) + v
    >>> model = NonlinearModel(fall, distance, Qd=[[0.1]], R=[[0.01]], x0=[4.0], P0=[[1.0]])
    >>> kalman_filter(model, [5.1, 5.0]).x_plus[:, 0].round(4)
    array([4.    , 4.1232, 4.015 ])
    """

    f: Motion
    h: Motion
    Qd: Covariance
    R: Covariance
    x0: Array
    P0: Array
    dt: float = 1.0
    F: Jacobian | None = None
    H: Jacobian | None = None
    residual: Callable[[Array, Array], Array] | None = None
    first: int = 1
    states: tuple[str, ...] = None  # type: ignore[assignment]  # names from __post_init__ on
    measurements: tuple[str, ...] = None  # type: ignore[assignment]  # names from __post_init__ on

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        put("x0", checks.shaped("x0", self.x0, ("n",)))
        put("P0", checks.covariance("P0", self.P0, (self.n, self.n)))
        if not callable(self.Qd):
            put("Qd", checks.covariance("Qd", self.Qd, ("s", "s"), ("steps", "s", "s")))
        if not callable(self.R):
            put("R", checks.measurement_covariance("R", self.R, ("q", "q"), ("steps+1", "q", "q")))
        put("dt", checks.positive("dt", self.dt))
        start = np.repeat(self.x0[:, None], 2, axis=1)
        moved = np.asarray(self.f(0, start, np.zeros((self.s, 2))))
        seen = np.asarray(self.h(0, start, np.zeros((self.q, 2))))
        if moved.shape != (self.n, 2):
            msg = f"f: expected to return shape ({self.n}, runs), received {moved.shape} for 2 runs"
            raise ValueError(msg)
        if seen.ndim != 2 or seen.shape[1] != 2:
            msg = f"h: expected to return shape (m, runs), received {seen.shape} for 2 runs"
            raise ValueError(msg)
        put("states", checks.labels("states", self.states, self.n, "x"))
        put("measurements", checks.labels("measurements", self.measurements, len(seen), "z"))

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.x0)

    @property
    def m(self) -> int:
        """Number of measurements."""
        return len(self.measurements)

    @property
    def s(self) -> int:
        """Number of noise inputs (n where Qd is a function)."""
        return self.n if callable(self.Qd) else self.Qd.shape[-1]

    @property
    def q(self) -> int:
        """Number of measurement noises (where R is a function, as many as that returns rows)."""
        return np.asarray(self.R(0, self.x0[:, None])).shape[0] if callable(self.R) else self.R.shape[-1]
