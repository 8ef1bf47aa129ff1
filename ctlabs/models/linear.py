r"""The two kinds of linear Gaussian models.

:class:`ContinuousModel` is :math:`\dot x = Fx + Bu + Gw,\ z = Hx + v` with *strengths* Q, Rc, N (unit²·s);
:class:`DiscreteModel` is :math:`x_{k+1} = \Phi x_k + c_k + w_k,\ z_k = Hx_k + v_k` with *covariances* Qd, R, N (unit²).
They are different types, so that a strength never passes for a covariance. Both are checked once, on construction,
and hold read-only arrays; change one with :func:`dataclasses.replace`.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.text import latex_matrix

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Labels = tuple[str, ...] | list[str] | None

#: A default that ``__post_init__`` replaces.
DEFAULT: Any = None
#: The matrices of a discrete model that may vary: their axes where they do not, and how many more entries than steps they have.
ABLE_TO_VARY = {
    "Phi": (2, 0), "Qd": (2, 0), "B": (2, 0), "offset": (1, 0),
    "H": (2, 1), "R": (2, 1), "D": (2, 1), "measurement_offset": (1, 1),
}  # fmt: skip


def check_joint(name: str, Q: Array, N: Array, R: Array) -> None:
    """Refuse a cross term that no pair of noises can have: [[Q, N], [Nᵀ, R]] must be a covariance."""
    finite = np.isfinite(np.diag(R))
    if N[:, ~finite].any():
        msg = f"{name}: expected 0 in the column of an absent measurement, received {N.tolist()}"
        raise ValueError(msg)
    N, R = N[:, finite], R[np.ix_(finite, finite)]
    checks.covariance(f"[[Q, {name}], [{name}', R]]", np.block([[Q, N], [N.T, R]]), ("n", "n"))


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

    .. math:: \dot x = Fx + Bu + Gw, \quad z = Hx + Du + d + v, \quad
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
    B, D : (n, r), (m, r), how a known input u moves the states and enters the measurements, or ``None``
    measurement_offset : (m,), a known constant in the measurements, or ``None``
    states, measurements, units, measurement_units : names and units, for labels

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
    D: Array | None = DEFAULT
    measurement_offset: Array | None = DEFAULT
    states: tuple[str, ...] = DEFAULT
    measurements: tuple[str, ...] = DEFAULT
    units: tuple[str, ...] = DEFAULT
    measurement_units: tuple[str, ...] = DEFAULT

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
            D: ArrayLike | None = None,
            measurement_offset: ArrayLike | None = None,
            states: Labels = None,
            measurements: Labels = None,
            units: Labels = None,
            measurement_units: Labels = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        put = _setter(self)
        put("F", F := checks.shaped("F", self.F, ("n", "n")))
        n = F.shape[0]
        if F.shape != (n, n):
            msg = f"F: expected a square matrix, received shape {F.shape}"
            raise ValueError(msg)
        put("G", checks.shaped("G", self.G, (n, "s")))
        put("Q", checks.covariance("Q", self.Q, (self.s, self.s)))
        put("H", checks.shaped("H", self.H, ("m", n)))
        put("x0", np.zeros(n) if self.x0 is None else checks.shaped("x0", self.x0, (n,)))
        self.x0.setflags(write=False)
        put("P0", checks.measurement_covariance("P0", self.P0, (n, n)))
        if self.Rc is not None:
            put("Rc", checks.covariance("Rc", self.Rc, (self.m, self.m)))
        if self.N is not None:
            put("N", checks.shaped("N", self.N, (self.s, self.m)))
            if self.Rc is None:
                msg = "N: expected Rc beside it (the noise that w correlates with), received None"
                raise ValueError(msg)
            check_joint("N", self.Q, self.N, self.Rc)
        _known(self, put, n, self.m)
        _labels(self, put, n, self.m)

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

    @property
    def r(self) -> int:
        """Number of known inputs."""
        return _inputs(self)

    def _matrices(self) -> dict[str, Array]:
        letters = {"F": "F", "B": "B", "G": "G", "Q": "Q", "H": "H", "D": "D", "measurement_offset": "d", "Rc": "R_c", "N": "N"}
        return _present(self, letters | {"x0": r"\bar x_0", "P0": "P_0"})


@dataclass(frozen=True, slots=True, eq=False)
class DiscreteModel(_Display):
    r"""Linear Gaussian system in discrete time.

    .. math:: x_{k+1} = \Phi_k x_k + B_k u_k + c_k + w_k, \quad z_k = H_k x_k + D_k u_k + d_k + v_k, \quad
              E[w_k w_k^T] = Q_{d,k},\ E[v_k v_k^T] = R_k,\ E[w_k v_k^T] = N_k

    Parameters
    ----------
    Phi : (n, n) or (steps, n, n); entry k moves the state from k to k+1
    Qd : (n, n) or (steps, n, n), covariance of w_k, unit²
    H : (m, n) or (steps+1, m, n)
    R : (m, m) or (steps+1, m, m), covariance of v_k, unit²; ``inf`` on the diagonal means that the element is not
        measured, 0 that it is measured perfectly
    P0, x0 : (n, n), (n,), covariance and mean of the state at t0; x0 defaults to zeros. ``inf`` on P0's diagonal, with
        zeros beside it, means that nothing is known of that state: its x0 is ignored
    dt : period, s
    N : (n, m), cross covariance of w_k and v_k (the same index k), or ``None``
    B, D : (n, r) or (steps, n, r), (m, r) or (steps+1, m, r), how an input u_k that becomes known at run time moves the
        states and enters the measurements, or ``None``
    offset, measurement_offset : (n,) or (steps, n), c_k, and (m,) or (steps+1, m), d_k, known beforehand, or ``None``
    first : the index of the first measurement, 1 (a period after t0) or 0 (at t0), where a verb is not told another
    states, measurements, units, measurement_units : names and units, for labels

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
    _: KW_ONLY
    P0: Array
    x0: Array = DEFAULT
    dt: float = 1.0
    N: Array | None = DEFAULT
    B: Array | None = DEFAULT
    D: Array | None = DEFAULT
    offset: Array | None = DEFAULT
    measurement_offset: Array | None = DEFAULT
    first: int = 1
    states: tuple[str, ...] = DEFAULT
    measurements: tuple[str, ...] = DEFAULT
    units: tuple[str, ...] = DEFAULT
    measurement_units: tuple[str, ...] = DEFAULT

    if TYPE_CHECKING:  # what may be given: anything array-like; what is read: arrays

        def __init__(
            self,
            Phi: ArrayLike,
            Qd: ArrayLike,
            H: ArrayLike,
            R: ArrayLike,
            *,
            P0: ArrayLike,
            x0: ArrayLike | None = None,
            dt: float = 1.0,
            N: ArrayLike | None = None,
            B: ArrayLike | None = None,
            D: ArrayLike | None = None,
            offset: ArrayLike | None = None,
            measurement_offset: ArrayLike | None = None,
            first: int = 1,
            states: Labels = None,
            measurements: Labels = None,
            units: Labels = None,
            measurement_units: Labels = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        put = _setter(self)
        put("Phi", Phi := checks.shaped("Phi", self.Phi, ("n", "n"), ("steps", "n", "n")))
        n = Phi.shape[-1]
        if Phi.shape[-2] != n:
            checks.shaped("Phi", Phi, (n, n), ("steps", n, n))  # refuses it
        put("x0", np.zeros(n) if self.x0 is None else checks.shaped("x0", self.x0, (n,)))
        self.x0.setflags(write=False)
        put("Qd", checks.covariance("Qd", self.Qd, (n, n), ("steps", n, n)))
        put("H", checks.shaped("H", self.H, ("m", n), ("steps+1", "m", n)))
        m = self.m
        put("R", checks.measurement_covariance("R", self.R, (m, m), ("steps+1", m, m)))
        put("P0", checks.measurement_covariance("P0", self.P0, (n, n)))
        put("dt", checks.positive("dt", self.dt))
        if self.offset is not None:
            put("offset", checks.shaped("offset", self.offset, (n,), ("steps", n)))
        if self.N is not None:
            put("N", checks.shaped("N", self.N, (n, m)))
            for k in range(
                (self.horizon or 1) if max(self.Qd.ndim, self.R.ndim) == 3 else 1
            ):  # no w at the last instant
                check_joint("N", at(self.Qd, k, 2), self.N, at(self.R, k, 2))
        _known(self, put, n, m, ("steps", n, "r"), ("steps+1", m, "r"), ("steps+1", m))
        put("first", checks.count("first", self.first, least=0))
        if self.first > 1:
            msg = f"first: expected 0 or 1, received {self.first!r}"
            raise ValueError(msg)
        _labels(self, put, n, m)
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
        return derived(self, **shorter)

    def varying(self) -> dict[str, tuple[Array, int]]:
        """The matrices that vary, each with how many more entries it has than there are steps."""
        found = {name: (getattr(self, name), axes, extra) for name, (axes, extra) in ABLE_TO_VARY.items()}
        return {name: (M, extra) for name, (M, axes, extra) in found.items() if M is not None and M.ndim > axes}

    @property
    def r(self) -> int:
        """Number of known inputs."""
        return _inputs(self)

    def motion(self, k: int) -> tuple[Array, Array, Array]:
        """Φ, c and Qd from k to k+1."""
        c = np.zeros(self.n) if self.offset is None else at(self.offset, k, 1)
        return at(self.Phi, k, 2), c, at(self.Qd, k, 2)

    def measurement(self, k: int) -> tuple[Array, Array, Array | None]:
        """H, R and N at k."""
        return at(self.H, k, 2), at(self.R, k, 2), self.N

    def _matrices(self) -> dict[str, Array]:
        letters = {"Phi": r"\Phi", "B": "B", "offset": "c", "Qd": "Q_d", "H": "H", "D": "D", "measurement_offset": "d", "R": "R"}
        return _present(self, letters | {"N": "N", "x0": r"\bar x_0", "P0": "P_0"})


def check_inputs(truth: DiscreteModel, design: DiscreteModel) -> None:
    """Refuse two models whose errors depend on a known input that is not given: those that differ in B, D, Φ or H beside one.

    >>> one = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], B=[[1]])
    >>> check_inputs(one, derived(one, B=np.array([[2.0]])))
    Traceback (most recent call last):
    ...
    ValueError: design: expected the truth's B (otherwise the error depends on u: discretise both with u, or give offsets), received another
    """
    names = ("B", "D", "Phi", "H") if truth.r or design.r else ()
    for name in ("measurement_offset", *names):
        own, other = getattr(truth, name), getattr(design, name)
        if not (own is other or (own is not None and other is not None and np.array_equal(own, other))):
            why = "(otherwise the error depends on u: discretise both with u, or give offsets)"
            why = "(give the truth a constant state for a bias that the design does not know)" if name == "measurement_offset" else why
            msg = f"design: expected the truth's {name} {why}, received another"
            raise ValueError(msg)


def derived(model: DiscreteModel, **matrices: Array | None) -> DiscreteModel:
    """The model with other matrices that are right because its own are: beginnings of stacks, the same in other units. No check.

    >>> one = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]])
    >>> derived(one, R=2 * one.R).R
    array([[2.]])
    """
    made = object.__new__(DiscreteModel)
    for name in (field.name for field in fields(DiscreteModel)):
        value = matrices[name] if name in matrices else getattr(model, name)
        if name in matrices and value is not None:
            value = value.view()
            value.setflags(write=False)
        object.__setattr__(made, name, value)
    return made


def at(matrix: Array, k: int, ndim: int) -> Array:
    """Entry k of a matrix that may vary with time: itself if it has ``ndim`` axes, its k-th slice otherwise."""
    return matrix if matrix.ndim == ndim else matrix[k]


def _known(model: Any, put: Any, n: int, m: int, *varying: tuple[int | str, ...]) -> None:
    """Check B, D and measurement_offset; ``varying``, their shapes where they may vary."""
    shapes = {"B": (n, "r"), "D": (m, "r"), "measurement_offset": (m,)}
    for (name, shape), more in zip(shapes.items(), varying or ((), (), ()), strict=True):
        if (value := getattr(model, name)) is not None:
            put(name, checks.shaped(name, value, shape, *((more,) if more else ())))
    if model.B is not None and model.D is not None and model.B.shape[-1] != model.D.shape[-1]:
        msg = f"D: expected {model.B.shape[-1]} columns as B has, received {model.D.shape[-1]}"
        raise ValueError(msg)


def _labels(model: Any, put: Any, n: int, m: int) -> None:
    for name, count, default in (("states", n, "x"), ("measurements", m, "z"), ("units", n, ""), ("measurement_units", m, "")):
        given = getattr(model, name)
        if isinstance(given, tuple) and not any(given):  # no units: as many of none as there are, also after dataclasses.replace
            given = None
        put(name, checks.labels(name, given, count, default))


def input_names(r: int) -> tuple[str, ...]:
    """What inputs without names of their own are called.

    >>> input_names(1), input_names(2)
    (('u',), ('u1', 'u2'))
    """
    return ("u",) if r == 1 else tuple(f"u{i + 1}" for i in range(r))


def _inputs(model: Any) -> int:
    return next((each.shape[-1] for each in (model.B, model.D) if each is not None), 0)


def _setter(model: object) -> Any:
    return lambda name, value: object.__setattr__(model, name, value)


def _present(model: object, names: dict[str, str]) -> dict[str, Array]:
    """The matrices of a model under their textbook letters; of those that vary, the first entry."""
    found = {letter: getattr(model, field) for field, letter in names.items() if getattr(model, field) is not None}
    return {letter: value[0] if value.ndim == 3 else value for letter, value in found.items()}
