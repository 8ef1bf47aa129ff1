"""From and to the objects of other libraries: python-control systems, filterpy filters, pandas tables.

All three are imported when a function needs them. python-control's matrices are A, B, C, D; here they are F, [G B], H and
no direct term.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.linalg.companion import Companion, companion, double
from ctlabs.models import ContinuousModel, DiscreteModel

#: State-space forms of a transfer function.
REALISATIONS = ("observable", "reachable")


def from_control(
    system: Any,
    *,
    Q: ArrayLike,
    P0: ArrayLike,
    Rc: ArrayLike | None = None,
    R: ArrayLike | None = None,
    x0: ArrayLike | None = None,
    noise: str | int | Sequence[int] | None = None,
    u: ArrayLike | None = None,
    realisation: str = "observable",
    states: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    measurements: Sequence[str] | None = None,
) -> ContinuousModel | DiscreteModel:
    r"""A model from a ``StateSpace`` or ``TransferFunction`` whose inputs are noise (and known inputs).

    .. math:: \dot x = Ax + B_ww + B_uu, \quad z = Cx + D_ww + v \quad\Rightarrow\quad
              F = A,\ G = B_w,\ H = C,\ R_c \leftarrow R_c + D_wQD_w^T,\ N = QD_w^T

    Parameters
    ----------
    system : continuous, or discrete with a period; or a continuous transfer function's coefficients ``(num, den)``. A
        transfer function gets the states of ``realisation``, made from its coefficients as they stand: none is dropped, and
        common factors stay. With several inputs each has its own states, named ``u1_1``, ``u1_2``, … after it, one set
        for each different denominator in its column. A state-space system keeps its own
    Q : (s, s), strength of the noise inputs, unit²·s; of a discrete system their covariance, unit², and Qd = B Q Bᵀ
    P0, x0 : covariance (n, n) and mean (n,) of the initial state; x0 defaults to zeros
    Rc : (m, m), strength of the measurement noise of a continuous system, unit²·s
    R : (m, m), covariance of the measurement noise of a discrete system, unit²
    noise : which inputs are noise: ``"input"`` (all) or their indices; the others are known inputs. Given explicitly,
        a direct path from noise to output becomes part of the measurement noise; left out, all inputs are noise and a
        direct path is refused
    u : (r,) or (steps, r), the known inputs of a discrete system (those of a continuous one go to ``discretise``)
    realisation : ``"observable"`` (F = [[−a1, 1], [−a2, 0]], H = [1, 0]) or ``"reachable"``, its transpose; outputs that
        share a denominator share its states, which are then in the reachable form
    states, units, measurements : names; by default those of the system

    Raises
    ------
    TypeError
        Something else than a python-control system.
    ValueError
        An improper transfer function, a direct path that nothing was said about, no period or no kind of time (dt=None),
        R for a continuous system or Rc for a discrete one.

    >>> import control
    >>> G = control.tf([0.3, 0.003], [1, 0.006, 0.003])
    >>> from_control(G, Q=[[36.0]], P0=[[0, 0], [0, 0]]).F.round(6)
    array([[-0.006,  1.   ],
           [-0.003,  0.   ]])
    """
    system, names = _state_space(system, realisation, (states, measurements))
    chosen, known = _inputs(system.ninputs, noise)
    G, D, B = system.B[:, chosen], system.D[:, chosen], system.B[:, known]
    Q = checks.covariance("Q", Q, (len(chosen), len(chosen)))
    _no_direct(system, chosen, known, noise)
    cross, direct = Q @ D.T, D @ Q @ D.T
    correlated = bool(direct.any())
    common: dict[str, Any] = {"H": system.C, "P0": P0, "states": names[0], "measurements": names[1], "units": units}
    if not system.dt:
        _none_of(system, R=R, u=u)
        strength = _added("Rc", Rc, direct) if correlated or Rc is not None else None
        return ContinuousModel(
            system.A, G, Q, Rc=strength, N=cross if correlated else None, B=B if known else None, x0=x0, **common
        )
    _none_of(system, Rc=Rc)
    if R is None:
        msg = "R: expected the covariance of a discrete system's measurement noise, received None"
        raise ValueError(msg)
    return DiscreteModel(
        Phi=system.A,
        Qd=G @ Q @ G.T,
        R=_added("R", R, direct),
        N=G @ cross if correlated else None,
        x0=np.zeros(system.nstates) if x0 is None else x0,
        dt=_period(system.dt),
        offset=_offset(u, B),
        **common,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Delay:
    """A delay as a transfer function: ``num``, ``den`` (order+1,), descending powers of s · ``error``, of its response."""

    num: Array
    den: Array
    error: float


def delay(seconds: float, order: int, up_to: float) -> Delay:
    r"""A delay by Padé's approximation, and a bound of its error.

    .. math:: e^{-sT} \approx \frac{q(-sT)}{q(sT)}, \quad q(z) = \sum_k\frac{(2n-k)!\,n!}{(2n)!\,k!\,(n-k)!}z^k, \quad
              \left|e^{-j\omega T} - \frac{q(-j\omega T)}{q(j\omega T)}\right|
              \le \frac{n!^2}{(2n)!\,(2n+1)!}\frac{(\omega T)^{2n+1}}{|q(j\omega T)|}

    An all-pass: the gain is 1, the error is one of phase. What the rounding of the coefficients adds is in the bound.

    Parameters
    ----------
    seconds : T > 0, s
    order : n ≥ 1
    up_to : rad/s, > 0; ``error`` bounds the difference of the two responses at all frequencies up to this one. It is 2,
        which says nothing, where the approximation does not reach

    Raises
    ------
    ValueError
        Numbers that are not positive, or coefficients beyond double precision (a high order of a short delay).

    Source: Padé's remainder :math:`e^{-z}q(z) - q(-z) = \pm\frac{z^{2n+1}}{(2n)!}\int_0^1u^n(1-u)^ne^{-uz}du`, and |q| ≥ 1,
    which grows on the imaginary axis; Golub & Van Loan, *Matrix Computations*, section 9.3.

    >>> lag = delay(0.5, order=2, up_to=1.0)
    >>> lag.den.tolist(), f"{lag.error:.1e}"
    ([1.0, 12.0, 48.0], '4.3e-05')
    >>> model = from_control((lag.num, lag.den), Q=[[1.0]], P0=np.zeros((2, 2)), noise="input")
    """
    T, w, n = checks.positive("seconds", seconds), checks.positive("up_to", up_to), checks.count("order", order)
    f = math.factorial
    q = [Fraction(f(2 * n - k) * f(n), f(2 * n) * f(k) * f(n - k)) for k in range(n + 1)]
    t, x = Fraction(T), Fraction(T) * Fraction(w)
    monic = [q[k] * t**k / (q[n] * t**n) for k in range(n, -1, -1)]
    den = np.array([double("delay", c) for c in monic])
    terms = [q[k] * x**k for k in range(n + 1)]
    size = sum(terms[::4] + [-c for c in terms[2::4]]) ** 2 + sum(terms[1::4] + [-c for c in terms[3::4]]) ** 2
    least = Fraction(f(n) ** 2, f(2 * n) * f(2 * n + 1)) * x ** (2 * n + 1)
    # A coefficient that is off by ε/2 turns q by at most that share of its own term: two of them to a quotient.
    rounding = 2 * Fraction(np.finfo(float).eps) * sum(terms[1:])
    bound = math.sqrt(min(Fraction(4), least**2 / size)) + float(min(Fraction(2), rounding))
    return Delay(den * (-1.0) ** np.arange(n, -1, -1), den, min(2.0, math.nextafter(bound * (1 + 1e-14), 3)))


def to_control(model: ContinuousModel | DiscreteModel) -> Any:
    """A python-control ``StateSpace`` from the noise w (and the known input u) to z; what is random stays behind.

    The inputs of a continuous model are w[0], w[1], …, then u[0], …; those of a discrete model are the disturbances w
    of its states (B = I). States and outputs keep their names.

    Raises
    ------
    TypeError
        No model.
    ValueError
        A model that varies with time, or a discrete one with a known input (it has no place in the system).

    >>> model = ContinuousModel([[-1]], [[1]], [[2]], [[1]], P0=[[1]], states=["x"])
    >>> to_control(model).state_labels
    ['x']
    """
    import control

    if isinstance(model, ContinuousModel):
        inputs = [f"w[{j}]" for j in range(model.s)]
        B = model.G
        if model.B is not None:
            inputs += [f"u[{j}]" for j in range(model.B.shape[1])]
            B = np.hstack([B, model.B])
        A, dt = model.F, 0.0
    else:
        checks.instance("model", model, DiscreteModel)
        _constant(model, "python-control's StateSpace")
        if model.offset is not None:
            msg = f"offset: expected none (a StateSpace has no constant input), received {model.offset.tolist()}"
            raise ValueError(msg)
        inputs = [f"w[{j}]" for j in range(model.n)]
        A, B, dt = model.Phi, np.eye(model.n), model.dt
    D = np.zeros((model.m, B.shape[1]))
    labels = {"inputs": inputs, "outputs": distinct(model.measurements), "states": distinct(model.states)}
    return control.ss(A, B, model.H, D, dt, **labels, remove_useless_states=False)


def state_space(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, dt: float) -> Any:
    """A python-control system from matrices; ``dt``, its period, s, 0 in continuous time.

    >>> state_space([[0.5]], [[1]], [[1]], [[0]], 0.1).poles().real
    array([0.5])
    """
    import control  # costs 1 s to import

    return control.ss(A, B, C, D, dt)


def to_filterpy(model: DiscreteModel) -> Any:
    """A filterpy ``KalmanFilter`` set up with the model: F, Q, H, R, x and P (column vectors, as filterpy has them).

    ``predict()`` then leads from k to k+1 and ``update(z)`` takes the measurement.

    Raises
    ------
    TypeError
        No discrete model.
    ValueError
        What filterpy cannot do: correlated w and v (N), matrices that vary with time, an absent measurement
        (R = inf), a known input (it would have to be given to every ``predict``).

    >>> kf = to_filterpy(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]]))
    >>> kf.predict(); kf.update(2.0); kf.P.round(6)
    array([[0.916667]])
    """
    checks.instance("model", model, DiscreteModel)
    _constant(model, "filterpy's KalmanFilter")
    if model.N is not None and model.N.any():
        msg = f"N: expected 0 (filterpy has no correlated noises; use ctlabs.filtering.kalman), received {model.N.tolist()}"
        raise ValueError(msg)
    if np.isinf(model.R).any():
        absent = [name for name, r in zip(model.measurements, np.diag(model.R), strict=True) if np.isinf(r)]
        msg = (
            f"R: expected finite variances (filterpy makes NaN of infinite ones), received inf for {', '.join(absent)}"
        )
        raise ValueError(msg)
    if model.offset is not None and model.offset.any():
        msg = (
            "offset: expected none (give it to every predict: kf.predict(u=offset, B=numpy.eye(n))), "
            f"received {model.offset.tolist()}"
        )
        raise ValueError(msg)
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(dim_x=model.n, dim_z=model.m)
    kf.x, kf.P = model.x0[:, None].copy(), model.P0.copy()
    kf.F, kf.Q, kf.H, kf.R = model.Phi.copy(), model.Qd.copy(), model.H.copy(), model.R.copy()
    return kf


def to_dataframe(result: Any, *, states: Sequence[str] | None = None, measurements: Sequence[str] | None = None) -> Any:
    """A pandas table of a result over time: a row per step k (and run), a column per element.

    Works on every result with a time axis ``t`` (schedules, ensembles, actual errors, statistics). Vectors become
    columns like ``x_plus[v]``, matrices ``P_plus[x,v]`` (symmetric ones their upper triangle) and gains ``K[x,z]``;
    an ensemble gets the columns ``run`` and one row per run and step.

    Parameters
    ----------
    result : a dataclass with ``t`` (steps+1,) and arrays whose first axis has that length
    states, measurements : names for the elements; x1, x2, … and z1, z2, … by default

    Raises
    ------
    ModuleNotFoundError
        pandas is not installed.
    TypeError
        A result without a time axis.

    >>> from ctlabs import covariances
    >>> plan = covariances(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]]), 2)
    >>> list(to_dataframe(plan, states=["h"]).columns)
    ['k', 't', 'P_minus[h,h]', 'P_plus[h,h]', 'K[h,z1]', 'S[z1,z1]', 'used[z1]']
    """
    try:
        import pandas as pd
    except ModuleNotFoundError as error:
        msg = "to_dataframe: expected pandas to be installed (pip install pandas), received no such module"
        raise ModuleNotFoundError(msg) from error
    arrays = _over_time(result)
    t = arrays.pop("t")
    runs = arrays["innovation"].shape[2] if "innovation" in arrays and arrays["innovation"].ndim == 3 else 0
    labels = {
        "n": checks.labels(
            "states", None if states is None else list(states), _size(arrays, "P_plus", "x_plus", "bias"), "x"
        ),
        "m": checks.labels(
            "measurements",
            None if measurements is None else list(measurements),
            _size(arrays, "used", "innovation"),
            "z",
        ),
    }
    steps = np.arange(len(t))
    columns: dict[str, Any] = {"k": steps, "t": t}
    if runs:
        columns = {"run": np.repeat(np.arange(runs), len(t)), "k": np.tile(steps, runs), "t": np.tile(t, runs)}
    for name, array in arrays.items():
        columns |= _columns(name, array, labels, runs)
    return pd.DataFrame(columns)


# from_control --------------------------------------------------------------------------------------------------------


def _state_space(system: Any, realisation: str, names: tuple[Any, Any]) -> tuple[Any, tuple[Any, Any]]:
    """A state-space system, and the names of its states and outputs (its own where none are given)."""
    import control

    if realisation not in REALISATIONS:
        msg = f"realisation: expected one of {', '.join(REALISATIONS)}, received {realisation!r}"
        raise ValueError(msg)
    if isinstance(system, tuple):
        if len(system) != 2:
            msg = f"system: expected coefficients (num, den), received a tuple of {len(system)}"
            raise ValueError(msg)
        system = control.tf(*system, 0)
    if not isinstance(system, control.StateSpace | control.TransferFunction):
        msg = f"system: expected a control.StateSpace or control.TransferFunction, received a {type(system).__name__}"
        raise TypeError(msg)
    if isinstance(system, control.StateSpace):
        states = _own(system.state_labels, "x")
        made = system
    else:
        made, states = _realised(system, realisation)
    if system.dt is None:
        msg = (
            "system: expected the kind of its time, dt=0 (continuous) or a period in seconds, received dt=None, "
            "which leaves it open"
        )
        raise ValueError(msg)
    own = (states, _own(system.output_labels, "y"))
    return made, (own[0] if names[0] is None else names[0], own[1] if names[1] is None else names[1])


def _realised(system: Any, realisation: str) -> tuple[Any, list[str] | None]:
    """The companion blocks of a transfer function side by side, and names of their states where there are several inputs."""
    import control

    nums, dens = ([[_trimmed(p) for p in row] for row in part] for part in (system.num_list, system.den_list))
    for num, den in ((nums[i][j], dens[i][j]) for i in range(system.noutputs) for j in range(system.ninputs)):
        if len(num) > len(den):
            msg = (
                f"system: expected a proper transfer function, received degree {len(num) - 1} over {len(den) - 1} "
                "(it differentiates white noise; give the signal before the differentiation)"
            )
            raise ValueError(msg)
    A, B, C = np.zeros((0, 0)), np.zeros((0, system.ninputs)), np.zeros((system.noutputs, 0))
    D = np.zeros((system.noutputs, system.ninputs))
    names: list[str] = []
    for j, label in enumerate(_own(system.input_labels, "u") or [f"u{j + 1}" for j in range(system.ninputs)]):
        column = [row[j] for row in dens]
        for i in (i for i, den in enumerate(column) if den not in column[:i]):
            outputs = [k for k, den in enumerate(column) if den == column[i]]
            block = _block([nums[k][j] for k in outputs], column[i], realisation)
            n, size = len(A), len(block.F)
            A = np.block([[A, np.zeros((n, size))], [np.zeros((size, n)), block.F]])
            B, C = np.pad(B, ((0, size), (0, 0))), np.pad(C, ((0, 0), (0, size)))
            B[n:, j], C[outputs, n:], D[outputs, j] = block.G[:, 0], block.H, block.D[:, 0]
        names += [f"{label}_{i + 1}" for i in range(len(A) - len(names))]
    if not len(A):
        msg = f"system: expected a transfer function with poles, received the constant {_constants(D)}"
        raise ValueError(msg)
    dt = 0 if system.dt is None else system.dt
    made = control.ss(A, B, C, D, dt, remove_useless_states=False)
    return made, names if system.ninputs > 1 else None


def _trimmed(p: Any) -> list[float]:
    """Coefficients without leading zeros."""
    return [float(c) for c in np.trim_zeros(np.atleast_1d(p), "f")]


def _block(nums: list[list[float]], den: list[float], realisation: str) -> Companion:
    """One denominator's states from one input; several outputs share them in the reachable form alone."""
    if len(nums) == 1 and realisation == "observable":
        return companion(nums, den)
    return companion(nums, den).transposed


def _constants(D: Array) -> str:
    return f"{D[0, 0]:g}" if D.size == 1 else str(D.tolist())


def _own(names: list[str], letter: str) -> list[str] | None:
    """The names in a system; None for python-control's defaults x[0], x[1] and so on."""
    return None if names == [f"{letter}[{i}]" for i in range(len(names))] else names


def _inputs(count: int, noise: str | int | Sequence[int] | None) -> tuple[list[int], list[int]]:
    """Indices of the noise inputs and of the known ones."""
    if noise is None or (isinstance(noise, str) and noise == "input"):
        return list(range(count)), []
    chosen: list[Any] = [noise] if isinstance(noise, int | np.integer) else list(noise)
    if not chosen or len(set(chosen)) != len(chosen) or not all(_is_index(i, count) for i in chosen):
        msg = f'noise: expected "input" or different indices below {count}, received {noise!r}'
        raise ValueError(msg)
    return [int(i) for i in chosen], [i for i in range(count) if i not in chosen]


def _is_index(i: Any, count: int) -> bool:
    return isinstance(i, int | np.integer) and not isinstance(i, bool) and bool(0 <= i < count)


def _no_direct(system: Any, chosen: list[int], known: list[int], noise: object) -> None:
    """Refuse direct paths that the model cannot hold."""
    if system.D[:, known].any():
        msg = (
            "D: expected no direct path from a known input (subtract D u from the measurement), "
            f"received {system.D[:, known].tolist()}"
        )
        raise ValueError(msg)
    if noise is None and system.D[:, chosen].any():
        msg = (
            'D: expected no direct path from noise to output, or noise="input" to count it as measurement noise '
            f"(Rc + DQD', N = QD'), received {system.D.tolist()}"
        )
        raise ValueError(msg)


def _none_of(system: Any, **given: object) -> None:
    """Refuse arguments that belong to the other kind of time."""
    for name, value in given.items():
        if value is not None:
            kind, hint = ("discrete", "that is R") if system.dt else ("continuous", "discretise takes it")
            msg = f"{name}: expected None with a {kind} system ({hint}), received a value"
            raise ValueError(msg)


def _added(name: str, given: ArrayLike | None, direct: Array) -> Array:
    """The measurement noise with the part that comes through D."""
    own = np.zeros_like(direct) if given is None else checks.measurement_covariance(name, given, direct.shape)
    return own + direct


def _period(dt: Any) -> float:
    if dt is True:
        msg = "system: expected a period dt in seconds, received a discrete system without one (dt=True)"
        raise ValueError(msg)
    return float(dt)


def _offset(u: ArrayLike | None, B: Array) -> Array | None:
    """B u of a discrete system."""
    r = B.shape[1]
    if (u is None) != (r == 0):
        msg = f"u: expected values of the {r} known inputs, received {u!r}"
        raise ValueError(msg)
    return None if u is None else checks.shaped("u", u, (r,), ("steps", r)) @ B.T


# to_control, to_filterpy ---------------------------------------------------------------------------------------------


def _constant(model: DiscreteModel, what: str) -> None:
    if model.horizon is not None:
        msg = f"model: expected constant matrices for {what}, received some that vary over {model.horizon} steps"
        raise ValueError(msg)


def distinct(names: tuple[str, ...]) -> list[str]:
    """Names that differ from each other, as python-control wants them."""
    result: list[str] = []
    for name in names:
        choices = [name, *(f"{name}_{i}" for i in range(2, len(names) + 2))]
        result.append(next(choice for choice in choices if choice not in result))
    return result


# to_dataframe --------------------------------------------------------------------------------------------------------


#: What an ensemble has one number of for each run.
_OF_RUNS = {"log_likelihood", "log_likelihood_diffuse"}


def _over_time(result: Any) -> dict[str, Array]:
    """The arrays of a result along its time axis."""
    t = getattr(result, "t", None)
    if not isinstance(t, np.ndarray) or t.ndim != 1 or not hasattr(type(result), "__dataclass_fields__"):
        msg = f"result: expected a result with a time axis t, received a {type(result).__name__}"
        raise TypeError(msg)
    found = {field.name: getattr(result, field.name) for field in fields(result) if field.name not in _OF_RUNS}
    return {name: a for name, a in found.items() if isinstance(a, np.ndarray) and 0 < a.ndim < 4 and len(a) == len(t)}


#: What the axes of an array run over, where it is not states: n of them, m measurements.
_AXES = {"K": "nm", "S": "mm", "used": "m", "z": "m", "innovation": "m"}


def _size(arrays: dict[str, Array], *names: str) -> int:
    return next((arrays[name].shape[1] for name in names if name in arrays), 0)


#: The arrays of an ensemble that have runs for their last axis; the others are those of every run.
_BY_RUN = {"x_minus", "x_plus", "innovation", "nis", "z", "truth"}


def _columns(name: str, array: Array, labels: dict[str, tuple[str, ...]], runs: int) -> dict[str, Array]:
    """One column per element of an array over time; of an ensemble's, one block of rows per run."""
    if runs and name not in _BY_RUN:
        return {column: np.tile(values, runs) for column, values in _columns(name, array, labels, 0).items()}
    ndim = array.ndim - 2 if runs else array.ndim - 1
    axes = [labels[kind] for kind in _AXES.get(name, "n" * ndim)]
    if ndim == 0:
        return {name: array.T.reshape(-1)}
    if ndim == 1:
        return {f"{name}[{label}]": array[:, i].T.reshape(-1) for i, label in enumerate(axes[0])}
    symmetric = axes[0] is axes[1]
    return {
        f"{name}[{row},{column}]": array[:, i, j]
        for i, row in enumerate(axes[0])
        for j, column in enumerate(axes[1])
        if j >= i or not symmetric
    }
