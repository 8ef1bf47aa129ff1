r"""From nonlinear differential equations to the linear model of small deviations, by sympy.

.. math:: \dot x = f(x, u), \quad \dot x^* = f(x^*, u^*), \quad
          \delta\dot x = F\,\delta x + B\,\delta u, \quad
          F = \left.\frac{\partial f}{\partial x}\right|_*,\ B = \left.\frac{\partial f}{\partial u}\right|_*

about a point or a trajectory that solves the equations (Maybeck vol. 2, eq. 9-59). :func:`flow` moves many states at
once over one period by Runge and Kutta's method, together with the derivative of the motion: what a nonlinear truth and
an extended filter need. sympy is imported on the first call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel

if TYPE_CHECKING:
    import sympy


class Linearised(NamedTuple):
    """The matrices of the deviations: ``F`` (n, n), ``B`` (n, r), sympy matrices."""

    F: sympy.Matrix
    B: sympy.Matrix


@dataclass(frozen=True, slots=True, eq=False)
class Dynamics:
    """Nonlinear equations ẋ = f(x, u) in sympy's symbols.

    Parameters
    ----------
    f : n expressions
    states, inputs : their symbols; every other symbol in f is a parameter

    Raises
    ------
    ValueError
        Not as many equations as states; a symbol twice.

    >>> import sympy
    >>> angle, rate, torque = sympy.symbols("angle rate torque")
    >>> pendulum = Dynamics([rate, -sympy.sin(angle) + torque], [angle, rate], [torque])
    >>> pendulum.at({angle: sympy.pi, rate: 0, torque: 0}).F
    Matrix([
    [0, 1],
    [1, 0]])
    """

    f: Sequence[Any]
    states: Sequence[Any]
    inputs: Sequence[Any] = ()

    def __post_init__(self) -> None:
        import sympy

        for name in ("f", "states", "inputs"):
            object.__setattr__(self, name, tuple(map(sympy.sympify, getattr(self, name))))
        if len(self.f) != len(self.states):
            msg = f"f: expected {len(self.states)} expressions, one for each state, received {len(self.f)}"
            raise ValueError(msg)
        symbols = (*self.states, *self.inputs)
        if len(set(symbols)) != len(symbols):
            msg = f"states, inputs: expected different symbols, received {list(symbols)}"
            raise ValueError(msg)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, sorted."""
        symbols = {symbol for e in self.f for symbol in e.free_symbols} - {*self.states, *self.inputs}
        return tuple(sorted(symbol.name for symbol in symbols))

    def jacobians(self) -> Linearised:
        """∂f/∂x and ∂f/∂u at any point."""
        import sympy

        f = sympy.Matrix(self.f)
        B = f.jacobian(self.inputs) if self.inputs else sympy.zeros(self.n, 0)
        return Linearised(f.jacobian(self.states), B)

    def at(self, nominal: Mapping[Any, Any], time: Any = None) -> Linearised:
        """The linear model about a point, or about a trajectory given in the symbol ``time``.

        Parameters
        ----------
        nominal : expressions for states, inputs and, where they depend on the nominal, parameters

        Raises
        ------
        ValueError
            A state or an input without a value; a nominal that does not solve the equations.
        """
        import sympy

        missing = [symbol.name for symbol in (*self.states, *self.inputs) if symbol not in nominal]
        if missing:
            msg = f"nominal: expected a value for every state and input, received none for {missing}"
            raise ValueError(msg)
        values = {symbol: sympy.sympify(value) for symbol, value in nominal.items()}
        motion = [sympy.diff(values[x], time) if time is not None else sympy.S.Zero for x in self.states]
        left = [sympy.simplify(e.subs(values) - rate) for e, rate in zip(self.f, motion, strict=True)]
        if any(left):
            msg = f"nominal: expected a solution of the equations, received one that leaves {left}"
            raise ValueError(msg)
        F, B = (matrix.subs(values).applyfunc(sympy.simplify) for matrix in self.jacobians())
        return Linearised(F, B)


def model(linear: Linearised, values: Mapping[str, float], *, H: ArrayLike, P0: ArrayLike, **more: Any) -> ContinuousModel:
    """The linear model of the deviations in numbers, without process noise unless ``G`` and ``Q`` are given.

    Parameters
    ----------
    linear : matrices that do not depend on time
    values : a number for each symbol that is left, by name
    H, P0, more : as for :class:`ctlabs.models.ContinuousModel`

    >>> import sympy
    >>> x, k = sympy.symbols("x k")
    >>> model(Dynamics([k * x - x**3], [x]).at({x: 0}), {"k": 2}, H=[[1]], P0=[[1]]).F
    array([[2.]])
    """
    left = {symbol.name: symbol for matrix in linear for symbol in matrix.free_symbols}
    if not set(left) <= set(values):
        msg = f"values: expected a number for each of {sorted(left)}, received {sorted(values)}"
        raise ValueError(msg)
    at = {symbol: values[name] for name, symbol in left.items()}
    F, B = (np.array(matrix.subs(at).evalf(30).tolist(), dtype=np.float64).reshape(matrix.shape) for matrix in linear)
    noise = {"G": np.zeros((len(F), 1)), "Q": np.zeros((1, 1))}
    return ContinuousModel(F=F, H=H, P0=P0, B=B if B.size else None, **noise | more)


class Flow:
    """The motion over one period h, for many states (n, runs) at once; made by :func:`flow`."""

    def __init__(self, slope: Callable[[Array], Array], jacobian: Callable[[Array], Array], h: float, parts: int):
        self._slope, self._jacobian, self._h, self._parts = slope, jacobian, h / parts, parts

    def f(self, x: Array) -> Array:
        """The states one period later, (n, runs)."""
        h = self._h
        for _ in range(self._parts):
            a = self._slope(x)
            b = self._slope(x + 0.5 * h * a)
            c = self._slope(x + 0.5 * h * b)
            d = self._slope(x + h * c)
            x = x + h / 6 * (a + 2 * (b + c) + d)
        return x

    def F(self, x: Array) -> Array:
        """∂f/∂x, (n, n, runs): the same method for the variational equation, so exactly the derivative of :meth:`f`."""
        h, n = self._h, len(x)
        one = np.eye(n)
        Phi = np.repeat(one[None], x.shape[1], axis=0)
        for _ in range(self._parts):
            a = self._slope(x)
            b = self._slope(x + 0.5 * h * a)
            c = self._slope(x + 0.5 * h * b)
            A = self._jacobian(x)
            B = self._jacobian(x + 0.5 * h * a) @ (one + 0.5 * h * A)
            C = self._jacobian(x + 0.5 * h * b) @ (one + 0.5 * h * B)
            D = self._jacobian(x + h * c) @ (one + h * C)
            Phi = (one + h / 6 * (A + 2 * (B + C) + D)) @ Phi
            x = x + h / 6 * (a + 2 * (b + c) + self._slope(x + h * c))
        return np.moveaxis(Phi, 0, -1)

    def along(self, x0: ArrayLike, steps: int) -> tuple[Array, Array]:
        """A trajectory (steps+1, n) from x0 (n,) and the transition matrices (steps, n, n) of deviations from it."""
        x = [checks.shaped("x0", x0, ("n",))[:, None]]
        for _ in range(checks.count("steps", steps)):
            x.append(self.f(x[-1]))
        return np.array(x)[:, :, 0], np.moveaxis(self.F(np.concatenate(x[:-1], axis=1)), -1, 0)


def flow(dynamics: Dynamics, values: Mapping[str, float], h: float, parts: int = 1) -> Flow:
    """The motion without inputs (u = 0) over a period h, by ``parts`` steps of Runge and Kutta's method of order 4.

    Parameters
    ----------
    values : a number for each parameter, by name

    Raises
    ------
    ValueError
        A parameter without a value; a period or a number of parts that is not positive.

    Source: Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, section II.1 and I.14.

    >>> import sympy
    >>> x = sympy.Symbol("x")
    >>> decay = flow(Dynamics([-x], [x]), {}, 0.1, parts=4)
    >>> decay.f(np.array([[1.0, 2.0]])).round(6), decay.F(np.array([[1.0]])).round(6)
    (array([[0.904837, 1.809675]]), array([[[0.904837]]]))
    """
    import sympy

    h, parts = checks.positive("h", h), checks.count("parts", parts)
    if set(dynamics.parameters) - set(values):
        msg = f"values: expected a number for each of {list(dynamics.parameters)}, received {sorted(values)}"
        raise ValueError(msg)
    quiet = dict.fromkeys(dynamics.inputs, 0)
    f = [e.subs(quiet) for e in dynamics.f]
    symbols = {symbol for e in f for symbol in e.free_symbols} - set(dynamics.states)
    at = {symbol: sympy.Float(values[symbol.name], 17) for symbol in symbols}
    F = sympy.Matrix(f).jacobian(dynamics.states).subs(at)
    n, places = dynamics.n, [(i, j) for i in range(dynamics.n) for j in range(dynamics.n) if F[i, j] != 0]
    slopes = sympy.lambdify(dynamics.states, [e.subs(at) for e in f], "numpy", cse=True)
    elements = sympy.lambdify(dynamics.states, [F[i, j] for i, j in places], "numpy", cse=True)

    def slope(x: Array) -> Array:
        result = np.empty_like(x)
        for i, row in enumerate(slopes(*x)):
            result[i] = row
        return result

    def jacobian(x: Array) -> Array:
        result = np.zeros((x.shape[1], n, n))
        for (i, j), value in zip(places, elements(*x), strict=True):
            result[:, i, j] = value
        return result

    return Flow(slope, jacobian, h, parts)
