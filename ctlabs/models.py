r"""The two kinds of linear Gaussian models.

:class:`ContinuousModel` is :math:`\dot x = Fx + Bu + Gw,\ z = Hx + v` with *strengths* Q, Rc, N (unit²·s);
:class:`DiscreteModel` is :math:`x_{k+1} = \Phi x_k + c_k + w_k,\ z_k = Hx_k + v_k` with *covariances* Qd, R, N (unit²).
They are different types, so that a strength never passes for a covariance. Both are checked once, on construction,
and hold read-only arrays; change one with :func:`dataclasses.replace`.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs import _check
from ctlabs._check import Array
from ctlabs.text import latex_matrix

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Labels = tuple[str, ...] | list[str] | None

#: A default that ``__post_init__`` replaces.
DEFAULT: Any = None


def _joint(name: str, Q: Array, N: Array, R: Array) -> None:
    """Refuse a cross term that no pair of noises can have: [[Q, N], [Nᵀ, R]] must be a covariance."""
    finite = np.isfinite(np.diag(R))
    if N[:, ~finite].any():
        msg = f"{name}: expected 0 in the column of an absent measurement, received {N.tolist()}"
        raise ValueError(msg)
    N, R = N[:, finite], R[np.ix_(finite, finite)]
    _check.covariance(f"[[Q, {name}], [{name}', R]]", np.block([[Q, N], [N.T, R]]), ("n", "n"))


class _Display:
    """Matrices as equations in a notebook."""

    __slots__ = ()

    def _matrices(self) -> dict[str, Array]:
        raise NotImplementedError

    def _repr_latex_(self) -> str:
        return "$$" + r" \qquad ".join(f"{k} = {latex_matrix(v)}" for k, v in self._matrices().items()) + "$$"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{name}</th>"
            f"<td><pre style='margin:0'>{np.array2string(value, precision=6)}</pre></td></tr>"
            for name, value in self._matrices().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


@dataclass(frozen=True, slots=True, eq=False)
class ContinuousModel(_Display):
    r"""Linear stochastic differential system with continuous (or later sampled) measurements.

    .. math:: \dot x = Fx + Bu + Gw, \quad z = Hx + v, \quad
              E[w(t)w(\tau)^T] = Q\,\delta(t-\tau),\ E[vv^T] = R_c\,\delta,\ E[wv^T] = N\,\delta

    Parameters
    ----------
    F : (n, n), 1/s
    G : (n, s), noise input
    Q : (s, s), strength of w, unit²·s
    H : (m, n)
    Rc : (m, m), strength of a continuous measurement's noise, unit²·s; ``None`` when measurements are only sampled
    x0, P0 : (n,), (n, n), mean and covariance of x at t0; x0 defaults to zeros. ``inf`` on P0's diagonal, with zeros beside it,
        means that nothing is known of that state: its x0 is ignored
    N : (s, m), cross strength of w and v, or ``None``
    B : (n, r), input matrix of a known input, or ``None``
    states, units, measurements : names and units, for labels

    Raises
    ------
    ValueError, TypeError
        A shape that does not fit, a covariance that is asymmetric or indefinite, NaN; the message says
        which matrix, what was expected and what was received.

    Source: Maybeck, *Stochastic Models, Estimation and Control* vol. 1 (1979), eq. 4-84, 4-93.

    >>> m = ContinuousModel(F=[[0]], G=[[1]], Q=[[4]], H=[[1]], Rc=[[16]], x0=[10], P0=[[25]], units=["m"])
    >>> m.n, m.s, m.m
    (1, 1, 1)
    >>> ContinuousModel(F=[[0, 1], [0, 0]], G=[[0, 1]], Q=[[1]], H=[[1, 0]], P0=[[1, 0], [0, 1]])
    Traceback (most recent call last):
    ...
    ValueError: G: expected shape (2, s), received (1, 2)
    """

    F: Array
    G: Array
    Q: Array
    H: Array
    _: KW_ONLY
    P0: Array
    x0: Array = DEFAULT
    Rc: Array | None = DEFAULT
    N: Array | None = DEFAULT
    B: Array | None = DEFAULT
    states: tuple[str, ...] = DEFAULT
    measurements: tuple[str, ...] = DEFAULT
    units: tuple[str, ...] = DEFAULT

    if TYPE_CHECKING:  # what may be given: anything array-like; what is read: arrays

        def __init__(
            self,
            F: ArrayLike,
            G: ArrayLike,
            Q: ArrayLike,
            H: ArrayLike,
            *,
            P0: ArrayLike,
            x0: ArrayLike | None = None,
            Rc: ArrayLike | None = None,
            N: ArrayLike | None = None,
            B: ArrayLike | None = None,
            states: Labels = None,
            measurements: Labels = None,
            units: Labels = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        put = _setter(self)
        put("F", F := _check.shaped("F", self.F, ("n", "n")))
        n = F.shape[0]
        if F.shape != (n, n):
            msg = f"F: expected a square matrix, received shape {F.shape}"
            raise ValueError(msg)
        put("G", _check.shaped("G", self.G, (n, "s")))
        put("Q", _check.covariance("Q", self.Q, (self.s, self.s)))
        put("H", _check.shaped("H", self.H, ("m", n)))
        put("x0", np.zeros(n) if self.x0 is None else _check.shaped("x0", self.x0, (n,)))
        self.x0.setflags(write=False)
        put("P0", _check.measurement_covariance("P0", self.P0, (n, n)))
        if self.Rc is not None:
            put("Rc", _check.covariance("Rc", self.Rc, (self.m, self.m)))
        if self.N is not None:
            put("N", _check.shaped("N", self.N, (self.s, self.m)))
            if self.Rc is None:
                msg = "N: expected Rc beside it (the noise that w correlates with), received None"
                raise ValueError(msg)
            _joint("N", self.Q, self.N, self.Rc)
        if self.B is not None:
            put("B", _check.shaped("B", self.B, (n, "r")))
        put("states", _check.labels("states", self.states, n, "x"))
        put("measurements", _check.labels("measurements", self.measurements, self.m, "z"))
        put("units", _check.labels("units", self.units, n, ""))

    @property
    def n(self) -> int:
        """Number of states."""
        return self.F.shape[0]

    @property
    def s(self) -> int:
        """Number of noise inputs."""
        return self.G.shape[1]

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self.H.shape[0]

    def _matrices(self) -> dict[str, Array]:
        return _present(
            self,
            {"F": "F", "B": "B", "G": "G", "Q": "Q", "H": "H", "Rc": "R_c", "N": "N", "x0": r"\bar x_0", "P0": "P_0"},
        )


@dataclass(frozen=True, slots=True, eq=False)
class DiscreteModel(_Display):
    r"""Linear Gaussian system in discrete time.

    .. math:: x_{k+1} = \Phi_k x_k + c_k + w_k, \quad z_k = H_k x_k + v_k, \quad
              E[w_k w_k^T] = Q_{d,k},\ E[v_k v_k^T] = R_k,\ E[w_k v_k^T] = N_k

    Parameters
    ----------
    Phi : (n, n) or (steps, n, n); entry k moves the state from k to k+1
    Qd : (n, n) or (steps, n, n), covariance of w_k, unit²
    H : (m, n) or (steps+1, m, n)
    R : (m, m) or (steps+1, m, m), covariance of v_k, unit²; ``inf`` on the diagonal means that the element is not
        measured, 0 that it is measured perfectly
    x0, P0 : (n,), (n, n), mean and covariance of the state at t0. ``inf`` on P0's diagonal, with zeros beside it, means
        that nothing is known of that state: its x0 is ignored
    dt : period, s
    N : (n, m), cross covariance of w_k and v_k (the same index k), or ``None``
    offset : (n,) or (steps, n), known input c_k, or ``None``
    states, measurements, units : names and units, for labels

    Raises
    ------
    ValueError, TypeError
        As for :class:`ContinuousModel`; also when matrices vary over different numbers of steps.

    Source: Maybeck vol. 1, eq. 5-25 to 5-28.

    >>> m = DiscreteModel(Phi=[[0.78]], Qd=[[0.39]], H=[[1]], R=[[0.5]], x0=[0], P0=[[1]], dt=1)
    >>> m.n, m.m, m.horizon
    (1, 1, None)
    >>> DiscreteModel(Phi=[[0.78]], Qd=[[-1]], H=[[1]], R=[[0.5]], x0=[0], P0=[[1]], dt=1)
    Traceback (most recent call last):
    ...
    ValueError: Qd: expected variances >= 0 on the diagonal, received -1
    """

    Phi: Array
    Qd: Array
    H: Array
    R: Array
    x0: Array
    P0: Array
    dt: float = 1.0
    _: KW_ONLY
    N: Array | None = DEFAULT
    offset: Array | None = DEFAULT
    states: tuple[str, ...] = DEFAULT
    measurements: tuple[str, ...] = DEFAULT
    units: tuple[str, ...] = DEFAULT

    if TYPE_CHECKING:  # what may be given: anything array-like; what is read: arrays

        def __init__(
            self,
            Phi: ArrayLike,
            Qd: ArrayLike,
            H: ArrayLike,
            R: ArrayLike,
            x0: ArrayLike,
            P0: ArrayLike,
            dt: float = 1.0,
            *,
            N: ArrayLike | None = None,
            offset: ArrayLike | None = None,
            states: Labels = None,
            measurements: Labels = None,
            units: Labels = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        put = _setter(self)
        put("x0", x0 := _check.shaped("x0", self.x0, ("n",)))
        n = x0.shape[0]
        put("Phi", _check.shaped("Phi", self.Phi, (n, n), ("steps", n, n)))
        put("Qd", _check.covariance("Qd", self.Qd, (n, n), ("steps", n, n)))
        put("H", _check.shaped("H", self.H, ("m", n), ("steps+1", "m", n)))
        m = self.m
        put("R", _check.measurement_covariance("R", self.R, (m, m), ("steps+1", m, m)))
        put("P0", _check.measurement_covariance("P0", self.P0, (n, n)))
        put("dt", _check.positive("dt", self.dt))
        if self.offset is not None:
            put("offset", _check.shaped("offset", self.offset, (n,), ("steps", n)))
        if self.N is not None:
            put("N", _check.shaped("N", self.N, (n, m)))
            for k in range(
                (self.horizon or 1) if max(self.Qd.ndim, self.R.ndim) == 3 else 1
            ):  # no w at the last instant
                _joint("N", at(self.Qd, k, 2), self.N, at(self.R, k, 2))
        put("states", _check.labels("states", self.states, n, "x"))
        put("measurements", _check.labels("measurements", self.measurements, m, "z"))
        put("units", _check.labels("units", self.units, n, ""))
        _ = self.horizon  # refuses matrices that vary over different numbers of steps

    @property
    def n(self) -> int:
        """Number of states."""
        return self.x0.shape[0]

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self.H.shape[-2]

    @property
    def horizon(self) -> int | None:
        """The number of steps a time-varying model is given for; ``None`` for a constant one."""
        given = {name: len(matrix) - extra for name, (matrix, extra) in self.varying().items()}
        if len(set(given.values())) > 1:
            msg = f"matrices that vary: expected one number of steps, received {given}"
            raise ValueError(msg)
        return next(iter(given.values()), None)

    def cut(self, steps: int) -> DiscreteModel:
        """The model of the first ``steps`` steps; a constant one and one that is no longer stay as they are.

        >>> m = DiscreteModel([[1]], [[1]], [[1]], [[[1]], [[2]], [[3]], [[4]]], x0=[0], P0=[[1]])
        >>> m.horizon, m.cut(2).horizon, m.cut(2).R.ravel()
        (3, 2, array([1., 2., 3.]))
        """
        if self.horizon is None or self.horizon <= steps:
            return self
        shorter: dict[str, Any] = {name: matrix[: steps + extra] for name, (matrix, extra) in self.varying().items()}
        return replace(self, **shorter)

    def varying(self) -> dict[str, tuple[Array, int]]:
        """The matrices that vary, each with how many more entries it has than there are steps."""
        able = {"Phi": (2, 0), "Qd": (2, 0), "offset": (1, 0), "H": (2, 1), "R": (2, 1)}
        found = {name: (getattr(self, name), axes, extra) for name, (axes, extra) in able.items()}
        return {name: (M, extra) for name, (M, axes, extra) in found.items() if M is not None and M.ndim > axes}

    def _matrices(self) -> dict[str, Array]:
        return _present(
            self,
            {"Phi": r"\Phi", "Qd": "Q_d", "offset": "c", "H": "H", "R": "R", "N": "N", "x0": r"\bar x_0", "P0": "P_0"},
        )


def at(matrix: Array, k: int, ndim: int) -> Array:
    """Entry k of a matrix that may vary with time: itself if it has ``ndim`` axes, its k-th slice otherwise."""
    return matrix if matrix.ndim == ndim else matrix[k]


def _setter(model: object) -> Any:
    return lambda name, value: object.__setattr__(model, name, value)


def _present(model: object, names: dict[str, str]) -> dict[str, Array]:
    """The matrices of a model under their textbook letters; of those that vary, the first entry."""
    found = {letter: getattr(model, field) for field, letter in names.items() if getattr(model, field) is not None}
    return {letter: value[0] if value.ndim == 3 else value for letter, value in found.items()}
