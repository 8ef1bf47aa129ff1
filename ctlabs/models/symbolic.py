r"""Closed forms by sympy: from (F, G, Q) to the discrete model, and the filter's equations written out.

:func:`chain` is the practicum's chain for a model of small order,

.. math:: \Phi(s) = (sI-F)^{-1} \;\to\; \Phi(\tau) \;\to\; Q_d = \int_0^\tau\Phi(t)GQG^T\Phi^T(t)dt
          \;\to\; Q_d = G_d\bar Q_dG_d^T \;\to\; \bar G_d = G_d\bar Q_d^{1/2}

with the unit triangular factor G_d, the diagonal Q̄_d and the factor Ḡ_d for standardised noise.
:func:`scalar_equations` writes the Kalman–Bucy filter element by element, :func:`block_equations` in blocks for a plant
driven by coloured noise. sympy is imported on the first call (0.5 s).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel

if TYPE_CHECKING:
    import sympy

#: A matrix as a caller may write it: nested lists, an array, or a sympy matrix; numbers become exact fractions.
Entries = Any
#: A time function Σ c tᵏ e^{(σ + iν)t} as {(k, σ, ν): c}.
Terms = dict[tuple[int, Any, Any], Any]

#: Operations in an expression beyond which it is left as it is.
LONGEST = 150


class ChainValues(NamedTuple):
    """A :class:`Chain` at given values, as :mod:`ctlabs.models.discretisation` computes it; ``diagonal`` is (n,)."""

    F: Array
    G: Array
    Q: Array
    Phi: Array
    Qd: Array
    unit_lower: Array
    diagonal: Array
    standardised: Array


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Closed forms of one model; sympy matrices, with the symbols that the caller used.

    ``F`` (n, n), ``G`` (n, s), ``Q`` (s, s) · ``resolvent`` Φ(s) in the symbol ``s`` · ``Phi`` Φ(τ) and ``Qd`` in the
    symbol or number ``tau`` · ``unit_lower`` G_d · ``diagonal``, the n variances of Q̄_d · ``standardised`` Ḡ_d
    """

    F: sympy.Matrix
    G: sympy.Matrix
    Q: sympy.Matrix
    resolvent: sympy.Matrix
    Phi: sympy.Matrix
    Qd: sympy.Matrix
    unit_lower: sympy.Matrix
    diagonal: tuple[sympy.Expr, ...]
    standardised: sympy.Matrix
    s: sympy.Symbol
    tau: sympy.Expr

    def latex(self) -> list[str]:
        """The chain as equations for a report, in the order of the derivation."""
        import sympy

        tau = sympy.latex(self.tau)
        return [
            rf"F = {_latex(self.F)}, \quad G = {_latex(self.G)}, \quad Q = {_latex(self.Q)}",
            rf"\Phi(s) = (sI - F)^{{-1}} = {_latex(self.resolvent)}",
            rf"\Phi({tau}) = {_latex(self.Phi)}",
            rf"Q_d = \int_0^{{{tau}}} \Phi(t) G Q G^T \Phi^T(t) dt = {_latex(self.Qd)}",
            rf"Q_d = G_d \bar{{Q}}_d G_d^T, \quad G_d = {_latex(self.unit_lower)}",
            rf"\bar{{Q}}_d = {_latex(sympy.diag(*self.diagonal))}",
            rf"\bar{{G}}_d = G_d \bar{{Q}}_d^{{1/2}} = {_latex(self.standardised)}",
        ]

    def evaluate(self, **values: float) -> ChainValues:
        """Numbers for the symbols, by name, computed with 30 digits.

        Raises
        ------
        ValueError
            A symbol without a value, a name that is no symbol, or values at which a closed form is 0/0.

        >>> import sympy
        >>> chain([[0]], [[1]], [[sympy.Symbol("q")]]).evaluate(q=4, tau=0.5).Qd
        array([[2.]])
        """
        import sympy

        matrices = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("s", "tau", "resolvent")}
        matrices["diagonal"] = sympy.Matrix(self.diagonal)
        symbols = {symbol.name: symbol for matrix in matrices.values() for symbol in matrix.free_symbols}
        if set(symbols) != set(values):
            msg = f"values: expected a number for each of {sorted(symbols)}, received {sorted(values)}"
            raise ValueError(msg)
        at = {symbols[name]: _exact("values", value) for name, value in values.items()}
        numbers = {name: _numbers(matrix, at) for name, matrix in matrices.items()}
        return ChainValues(**numbers | {"diagonal": numbers["diagonal"][:, 0]})


@dataclass(frozen=True, slots=True, eq=False)
class SymbolicModel:
    r"""A continuous model with symbols: :math:`\dot x = Fx + Bu + Gw,\ z = Hx + v`, as in :class:`ContinuousModel`.

    Elements are numbers (taken as exact fractions) or sympy expressions. ``N`` is the cross strength of w and v.
    """

    F: Entries
    G: Entries
    Q: Entries
    H: Entries
    Rc: Entries
    B: Entries = None
    N: Entries = None
    states: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        F = _matrix("F", self.F)
        n = F.rows
        G, H = _matrix("G", self.G, (n, None)), _matrix("H", self.H, (None, n))
        found = {"F": F, "G": G, "H": H, "Q": _matrix("Q", self.Q, (G.cols, G.cols))}
        found["Rc"] = _matrix("Rc", self.Rc, (H.rows, H.rows))
        found["B"] = None if self.B is None else _matrix("B", self.B, (n, None))
        found["N"] = None if self.N is None else _matrix("N", self.N, (G.cols, H.rows))
        found["states"] = tuple(f"x{i + 1}" for i in range(n)) if self.states is None else tuple(self.states)
        if F.cols != n or len(found["states"]) != n:
            msg = f"F: expected a square matrix and one name per state, received {F.shape} and {found['states']}"
            raise ValueError(msg)
        for name, value in found.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, slots=True, eq=False)
class ScalarEquations:
    """The Kalman–Bucy filter element by element; sympy matrices in the symbols ``P``, ``K``, ``x``, ``z``, ``u``.

    ``estimate`` (n, 1): x̂' in x̂, K, z, u · ``gain`` (n, m): K in P · ``riccati`` (n, n): P' in P
    """

    estimate: sympy.Matrix
    gain: sympy.Matrix
    riccati: sympy.Matrix
    P: sympy.Matrix
    K: sympy.Matrix
    x: sympy.Matrix
    z: sympy.Matrix
    u: sympy.Matrix

    def latex(self) -> dict[str, list[str]]:
        """Equations by kind: n ``estimate``, nm ``gain`` and n(n+1)/2 ``riccati`` equations."""
        import sympy

        n = self.P.rows
        return {
            "estimate": [
                rf"\dot{{{sympy.latex(x)}}} = {sympy.latex(e)}" for x, e in zip(self.x, self.estimate, strict=True)
            ],
            "gain": [f"{sympy.latex(K)} = {sympy.latex(e)}" for K, e in zip(self.K, self.gain, strict=True)],
            "riccati": [
                rf"\dot{{P}}_{{{_index(i, j, n)}}} = {sympy.latex(self.riccati[i, j])}"
                for i in range(n)
                for j in range(i, n)
            ],
        }


@dataclass(frozen=True, slots=True, eq=False)
class BlockEquations:
    """The filter of a plant with coloured noise in blocks; expressions in sympy's matrix symbols.

    ``expressions``: the right-hand sides of K1, K2 and of dP1/dt, dP12/dt, dP2/dt under "K1", "K2", "P1", "P12", "P2" ·
    ``observer``: its two equations in LaTeX
    """

    expressions: Mapping[str, Any]
    observer: tuple[str, str]

    def latex(self) -> list[str]:
        """Observer, gains and variance equations for a report."""
        import sympy

        found = [rf"K_{name[1:]} = {sympy.latex(self.expressions[name])}" for name in ("K1", "K2")]
        found += [rf"\dot{{P}}_{{{name[1:]}}} = {sympy.latex(self.expressions[name])}" for name in ("P1", "P12", "P2")]
        return [*self.observer, *found]

    def evaluate(self, **matrices: Array) -> dict[str, Array]:
        """The right-hand sides for given matrices, by name (A, G, A_w, C, Q_0, R, [N_0,] P_1, P_12, P_2)."""
        import sympy

        symbols = sorted({symbol for e in self.expressions.values() for symbol in e.atoms(sympy.MatrixSymbol)}, key=str)
        if {symbol.name for symbol in symbols} != set(matrices):
            msg = f"matrices: expected {[symbol.name for symbol in symbols]}, received {sorted(matrices)}"
            raise ValueError(msg)
        values = [np.atleast_2d(np.asarray(matrices[symbol.name], dtype=np.float64)) for symbol in symbols]
        return {name: np.asarray(_numeric(tuple(symbols), e)(*values)) for name, e in self.expressions.items()}


@cache
def _numeric(symbols: tuple[Any, ...], expression: Any) -> Callable[..., Any]:
    """An expression as a function of numpy's arrays; sympy writes and compiles it once."""
    import sympy

    function: Callable[..., Any] = sympy.lambdify(symbols, expression, "numpy")
    return function


def chain(F: Entries, G: Entries, Q: Entries, tau: Any = None) -> Chain:
    r"""The practicum's chain Φ(s) → Φ(τ) → Q_d → G_d, Q̄_d → Ḡ_d in closed form.

    Parameters
    ----------
    F : (n, n) · G : (n, s) · Q : (s, s), numbers or sympy expressions
    tau : period, a symbol or number; by default the symbol τ

    Symbols without assumptions of their own are taken as positive (variances, times, rates), so that roots simplify,
    and for different: a formula with 1/(a−b) is that for a ≠ b. A quadratic factor of unknown discriminant is written
    with sin and cos, which for a negative frequency squared are those of an imaginary argument.

    Raises
    ------
    ValueError
        Shapes that do not fit; a characteristic polynomial with an irreducible factor of degree 3 or more, for
        which no closed form is worth printing.

    Source: Semushin & Tsyganova 2001, section 4 (method notes).

    >>> import sympy
    >>> sigma, tau = sympy.symbols("sigma tau", positive=True)
    >>> chain([[0, 1], [0, 0]], [[0], [1]], [[sigma**2]], tau).diagonal
    (sigma**2*tau**3/3, sigma**2*tau/4)
    """
    import sympy

    F = _matrix("F", F)
    G = _matrix("G", G, (F.rows, None))
    Q = _matrix("Q", Q, (G.cols, G.cols))
    if F.rows != F.cols or Q != Q.T:
        msg = f"F, Q: expected a square F and a symmetric Q, received shapes {F.shape}, {Q.shape}"
        raise ValueError(msg)
    step = sympy.Symbol("tau", positive=True) if tau is None else _exact("tau", tau)
    free = set().union(*(m.free_symbols for m in (F, G, Q)), step.free_symbols)
    positive = {symbol: sympy.Dummy(symbol.name, positive=True) for symbol in free if symbol.is_real is None}
    back = {dummy: symbol for symbol, dummy in positive.items()}
    s = sympy.Symbol("s")
    f, W, period = F.subs(positive), (G * Q * G.T).subs(positive), step.subs(positive)
    omega: dict[Any, Any] = {}
    resolvent = _resolvent(f, s)
    functions = [[_inverse_laplace(resolvent[i, j], s, omega) for j in range(f.cols)] for i in range(f.rows)]
    Phi = sympy.Matrix(f.rows, f.cols, lambda i, j: _expression(functions[i][j], period, omega))
    Qd = _noise_covariance(functions, W, period, omega)
    L, d = _unit_triangular(Qd)
    root = (L * sympy.diag(*map(sympy.sqrt, d))).applyfunc(sympy.powdenest)
    return Chain(
        F=F,
        G=G,
        Q=Q,
        resolvent=resolvent.subs(back),
        Phi=Phi.subs(back),
        Qd=Qd.subs(back),
        unit_lower=L.subs(back),
        diagonal=tuple(x.subs(back) for x in d),
        standardised=root.subs(back),
        s=s,
        tau=step,
    )


def scalar_equations(model: SymbolicModel | ContinuousModel) -> ScalarEquations:
    r"""The equations of the Kalman–Bucy filter written out element by element.

    .. math:: \dot{\hat x} = F\hat x + Bu + K(z-H\hat x), \quad K = (PH^T+GN)R_c^{-1}, \quad
              \dot P = FP + PF^T + GQG^T - KR_cK^T

    Parameters
    ----------
    model : with symbols, or a continuous model (its numbers as exact fractions) that has Rc

    Raises
    ------
    TypeError, ValueError
        Something else than a model; a model without Rc or with a singular one.

    Source: Maybeck vol. 1, section 5.11; labs 13 and coloured_plant.

    >>> import sympy
    >>> q, r = sympy.symbols("q r", positive=True)
    >>> scalar_equations(SymbolicModel([[0]], [[1]], [[q]], [[1]], [[r]])).latex()["riccati"]
    ['\\dot{P}_{11} = - \\frac{P_{11}^{2}}{r} + q']
    """
    import sympy

    if isinstance(model, ContinuousModel):
        if model.Rc is None:
            msg = "Rc: expected the strength of a continuous measurement's noise, received None"
            raise ValueError(msg)
        model = SymbolicModel(model.F, model.G, model.Q, model.H, model.Rc, model.B, model.N, model.states)
    if not isinstance(model, SymbolicModel):
        msg = f"model: expected a SymbolicModel or a ContinuousModel, received a {type(model).__name__}"
        raise TypeError(msg)
    n, m = model.F.rows, model.H.rows
    P = sympy.Matrix(n, n, lambda i, j: sympy.Symbol(f"P_{{{_index(min(i, j), max(i, j), n)}}}"))
    K = sympy.Matrix(n, m, lambda i, j: sympy.Symbol(f"K_{{{i + 1 if m == 1 else _index(i, j, max(n, m))}}}"))
    x = sympy.Matrix([sympy.Symbol(rf"\hat{{{sympy.latex(sympy.Symbol(name))}}}") for name in model.states or ()])
    z = sympy.Matrix([sympy.Symbol("z" if m == 1 else f"z_{{{i + 1}}}") for i in range(m)])
    r = 0 if model.B is None else model.B.cols
    u = sympy.Matrix(r, 1, lambda i, _: sympy.Symbol("u" if r == 1 else f"u_{{{i + 1}}}"))
    if sympy.simplify(model.Rc.det()) == 0:
        msg = "Rc: expected an invertible matrix (a perfect measurement needs the reduced filter), received a singular one"
        raise ValueError(msg)
    right = P * model.H.T + (sympy.zeros(n, m) if model.N is None else model.G * model.N)
    gain = right * model.Rc.inv()
    known = sympy.zeros(n, 1) if model.B is None else model.B * u
    innovation = z - model.H * x
    # The innovation is left as one bracket: K(z − x̂) reads as the textbook has it.
    correction = sympy.Matrix(n, 1, lambda i, _: sum((K[i, j] * innovation[j] for j in range(m)), sympy.S.Zero))
    riccati = (model.F * P + P * model.F.T + model.G * model.Q * model.G.T - gain * right.T).applyfunc(sympy.expand)
    return ScalarEquations(model.F * x + known + correction, gain.applyfunc(sympy.factor), riccati, P, K, x, z, u)


@cache
def block_equations(*, correlated: bool = False) -> BlockEquations:
    r"""The Kalman–Bucy observer of a plant with coloured noise, in blocks.

    .. math:: \dot x = Ax + Bu + Gw, \quad \dot w = A_ww + v_0, \quad y = Cx + v, \quad
              E[v_0v_0^T] = Q_0\delta,\ E[vv^T] = R\delta,\ E[v_0v^T] = N_0\delta

    derived from the filter of the augmented state (x, w) by block multiplication.

    Parameters
    ----------
    correlated : whether v_0 and v correlate (N_0 ≠ 0)

    Source: coloured-plant observer, section on the observer for coloured plant noise.

    >>> block_equations().latex()[2]
    'K_1 = P_{1} C^{T} R^{-1}'
    """
    import sympy
    from sympy import BlockMatrix, MatrixSymbol, ZeroMatrix

    n, q, m = sympy.symbols("n q m", integer=True, positive=True)
    A, G, A_w, C = MatrixSymbol("A", n, n), MatrixSymbol("G", n, q), MatrixSymbol("A_w", q, q), MatrixSymbol("C", m, n)
    Q, R = MatrixSymbol("Q_0", q, q), MatrixSymbol("R", m, m)
    N = MatrixSymbol("N_0", q, m) if correlated else ZeroMatrix(q, m)
    P1, P12, P2 = MatrixSymbol("P_1", n, n), MatrixSymbol("P_12", n, q), MatrixSymbol("P_2", q, q)
    F = BlockMatrix([[A, G], [ZeroMatrix(q, n), A_w]])
    P = BlockMatrix([[P1, P12], [P12.T, P2]])
    W = BlockMatrix([[ZeroMatrix(n, n), ZeroMatrix(n, q)], [ZeroMatrix(q, n), Q]])
    right = BlockMatrix([[P1 * C.T], [P12.T * C.T + N]])
    # P is symmetric: the transpose of P Hᵀ + N is written with its blocks, so that no P1ᵀ appears.
    left = BlockMatrix([[C * P1, C * P12 + N.T]])
    K = sympy.block_collapse(right * R.I)
    flow = sympy.block_collapse(F * P + P * F.T + W - right * BlockMatrix([[R.I]]) * left)
    expressions = {"K1": K.blocks[0, 0], "K2": K.blocks[1, 0]}
    expressions |= {"P1": flow.blocks[0, 0], "P12": flow.blocks[0, 1], "P2": flow.blocks[1, 1]}
    observer = (
        r"\dot{\hat{x}} = A \hat{x} + B u + G \hat{w} + K_1 (y - C \hat{x})",
        r"\dot{\hat{w}} = A_w \hat{w} + K_2 (y - C \hat{x})",
    )
    return BlockEquations(MappingProxyType({name: sympy.expand(e.doit()) for name, e in expressions.items()}), observer)


# Input ---------------------------------------------------------------------------------------------------------------


def _exact(name: str, value: Any) -> Any:
    """A number as an exact fraction (0.3 is 3/10), or a sympy expression as it is."""
    import sympy

    if isinstance(value, sympy.Expr):
        return sympy.nsimplify(value, rational=True) if value.has(sympy.Float) else value
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        msg = f"{name}: expected finite numbers or sympy expressions, received {value!r}"
        raise TypeError(msg)
    return sympy.Rational(repr(float(value)))


def _matrix(name: str, value: Entries, shape: tuple[int | None, int | None] = (None, None)) -> Any:
    """A sympy matrix of exact elements, of the shape given (None: free)."""
    import sympy

    rows = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(rows, list | tuple) or not rows or not all(isinstance(row, list | tuple) for row in rows):
        msg = f"{name}: expected a matrix, received {value!r}"
        raise ValueError(msg)
    if len({len(row) for row in rows}) != 1:
        msg = f"{name}: expected rows of one length, received {[len(row) for row in rows]}"
        raise ValueError(msg)
    matrix = sympy.Matrix([[_exact(name, element) for element in row] for row in rows])
    if any(want not in (None, have) for want, have in zip(shape, matrix.shape, strict=True)):
        wanted = tuple("free" if want is None else want for want in shape)
        msg = f"{name}: expected shape {wanted}, received {matrix.shape}"
        raise ValueError(msg)
    return matrix


# The chain -----------------------------------------------------------------------------------------------------------
#
# A time function Σ c tᵏ e^{(σ + iν)t} is a dictionary {(k, σ, ν): c}: products and integrals are then exact and quick,
# which sympy's own integrate and inverse_laplace_transform are not.


def _resolvent(F: Any, s: Any) -> Any:
    """(sI − F)⁻¹ with every element in lowest terms."""
    import sympy

    pencil = s * sympy.eye(F.rows) - F
    determinant = sympy.expand(pencil.det(method="berkowitz"))
    return pencil.adjugate(method="berkowitz").applyfunc(lambda e: sympy.factor(sympy.cancel(e / determinant)))


def _inverse_laplace(r: Any, s: Any, omega: dict[Any, Any]) -> Terms:
    """The time function of a strictly proper rational function, from its residues.

    Frequencies √(…) are kept as positive symbols, and their values put into ``omega``.
    """
    import sympy

    num, den = sympy.fraction(sympy.cancel(sympy.together(r)))
    lead, factors = sympy.factor_list(den, s)
    poles = [(*root, power) for factor, power in factors for root in _roots(factor, s, omega)]
    scale = lead * sympy.prod([sympy.Poly(factor, s).LC() ** power for factor, power in factors])
    result: Terms = {}
    for sigma, nu, power in poles:
        root = sigma + sympy.I * nu
        others = sympy.prod([(s - x - sympy.I * y) ** p for x, y, p in poles if (x, y) != (sigma, nu)])
        rest = num / (scale * others)
        for k in range(power):
            # e^{st}·rest around the root: the coefficient of tᵏ takes the derivative of order power − 1 − k.
            order = power - 1 - k
            residue = sympy.diff(rest, s, order).subs(s, root) / (sympy.factorial(order) * sympy.factorial(k))
            result[k, sigma, nu] = residue
    return result


def _roots(factor: Any, s: Any, omega: dict[Any, Any]) -> list[tuple[Any, Any]]:
    """Real and imaginary part of the roots of a linear or quadratic factor."""
    import sympy

    coefficients = sympy.Poly(factor, s).all_coeffs()
    if len(coefficients) > 3:
        shown = factor.subs({dummy: sympy.Symbol(dummy.name) for dummy in factor.atoms(sympy.Dummy)})
        msg = f"F: expected a characteristic polynomial of linear and quadratic factors, received the factor {shown}"
        raise ValueError(msg)
    middle = sympy.cancel(-coefficients[1] / (len(coefficients) - 1) / coefficients[0])
    if len(coefficients) == 2:
        return [(middle, sympy.S.Zero)]
    square = sympy.factor_terms(sympy.expand(sympy.cancel(coefficients[2] / coefficients[0] - middle**2)))
    if square.is_negative:
        w = _symbol(sympy.sqrt(-square), omega)
        return [(middle + w, sympy.S.Zero), (middle - w, sympy.S.Zero)]
    w = _symbol(sympy.sqrt(square), omega)
    return [(middle, w), (middle, -w)]


def _symbol(value: Any, omega: dict[Any, Any]) -> Any:
    """A positive symbol for a root, unless it is rational in the symbols: then itself."""
    import sympy

    if not value.has(sympy.Pow) or all(power.exp.is_integer for power in value.atoms(sympy.Pow)):
        return value
    for symbol, known in omega.items():
        if sympy.expand(known**2 - value**2) == 0:
            return symbol
    symbol = sympy.Dummy("omega", positive=True)
    omega[symbol] = value
    return symbol


def _product(a: Terms, b: Terms) -> Terms:
    """The product of two time functions."""
    import sympy

    result: Terms = {}
    for (k, sigma, nu), c in a.items():
        for (power, rho, mu), d in b.items():
            key = (k + power, sympy.cancel(sigma + rho), sympy.cancel(nu + mu))
            result[key] = result.get(key, 0) + c * d
    return result


def _integral(terms: Terms) -> Terms:
    r""":math:`\int_0^\tau` of a time function, as one of τ; tᵏ by parts."""
    import sympy

    result: Terms = {}

    def add(key: tuple[int, Any, Any], value: Any) -> None:
        result[key] = result.get(key, 0) + value

    for (k, sigma, nu), c in terms.items():
        if sigma == 0 and nu == 0:
            add((k + 1, sigma, nu), c / (k + 1))
            continue
        rate = sigma + sympy.I * nu
        for j in range(k + 1):
            add((k - j, sigma, nu), c * (-1) ** j * sympy.ff(k, j) / rate ** (j + 1))
        add((0, sympy.S.Zero, sympy.S.Zero), -c * (-1) ** k * sympy.factorial(k) / rate ** (k + 1))
    return result


def _noise_covariance(Phi: list[list[Terms]], W: Any, tau: Any, omega: dict[Any, Any]) -> Any:
    """∫₀^τ Φ(t)WΦᵀ(t)dt, element by element."""
    import sympy

    n = len(Phi)
    Qd = sympy.zeros(n, n)
    for i in range(n):
        for j in range(i, n):
            total: Terms = {}
            for a in range(n):
                for b in range(n):
                    if W[a, b] != 0:
                        for key, c in _product(Phi[i][a], Phi[j][b]).items():
                            total[key] = total.get(key, 0) + W[a, b] * c
            Qd[i, j] = Qd[j, i] = _expression(_integral(total), tau, omega)
    return Qd


def _expression(terms: Terms, t: Any, omega: dict[Any, Any]) -> Any:
    """A real time function in t, with sin and cos for the pairs of complex terms, coefficients in lowest terms."""
    import sympy

    groups: dict[Any, Any] = {}
    for (k, sigma, nu), c in terms.items():
        real, imaginary = _real_imaginary(c)
        sign, nu = (-1, -nu) if nu.could_extract_minus_sign() else (1, nu)
        decay = sympy.exp(sympy.expand(sigma * t))
        for key, value in ((decay * sympy.cos(nu * t), real), (decay * sympy.sin(nu * t), -sign * imaginary)):
            groups[key] = groups.get(key, 0) + value * t**k
    groups.pop(sympy.S.Zero, None)
    # A frequency √… goes back into its place before the coefficients are brought to lowest terms.
    shown = {key.subs(omega): sympy.cancel(sympy.together(value.subs(omega))) for key, value in groups.items()}
    return sympy.Add(*(key * sympy.factor(value) for key, value in shown.items()))


def _real_imaginary(c: Any) -> tuple[Any, Any]:
    """Real and imaginary part of a rational function of real symbols and i."""
    import sympy

    if not c.has(sympy.I):
        return c, sympy.S.Zero
    num, den = sympy.fraction(sympy.together(c))
    conjugate = den.subs(sympy.I, -sympy.I)
    num, den = sympy.expand(num * conjugate), sympy.expand(den * conjugate)
    imaginary = num.coeff(sympy.I)
    return sympy.cancel((num - sympy.I * imaginary).expand() / den), sympy.cancel(imaginary / den)


def _unit_triangular(Q: Any) -> tuple[Any, list[Any]]:
    """Q = L diag(d) Lᵀ; a direction without noise has d = 0 and a unit column."""
    import sympy

    n = Q.rows
    L, d, rest = sympy.eye(n), [sympy.S.Zero] * n, Q.copy()
    for j in range(n):
        pivot = _reduced(rest[j, j])
        if pivot == 0:
            continue
        d[j] = pivot
        column = [_reduced(rest[i, j] / pivot) for i in range(j + 1, n)]
        for a, i in enumerate(range(j + 1, n)):
            L[i, j] = column[a]
            for b, k in enumerate(range(j + 1, n)):
                rest[i, k] -= column[a] * column[b] * pivot
    return L, d


def _reduced(e: Any) -> Any:
    """Exactly 0 where it is 0, and in lowest terms unless it is too long to be read anyway."""
    import sympy

    if _vanishes(e):
        return sympy.S.Zero
    if sympy.count_ops(e) > LONGEST:
        return e
    num, den = sympy.fraction(sympy.cancel(sympy.together(e)))
    for sine in num.atoms(sympy.sin):
        num = sympy.expand(num).subs(sine**2, 1 - sympy.cos(sine.args[0]) ** 2)
    return sympy.factor(sympy.cancel(num / den))


def _vanishes(e: Any) -> bool:
    """Whether an expression is 0 at a point without relations between its symbols, to 40 of 60 digits."""
    import sympy

    point = {x: sympy.sqrt(sympy.prime(i + 5)) / (i + 2) for i, x in enumerate(sorted(e.free_symbols, key=str))}
    terms = [abs(sympy.N(term.subs(point), 60)) for term in sympy.Add.make_args(e)]
    return bool(abs(sympy.N(e.subs(point), 60, maxn=200)) <= sum(terms) * sympy.Float("1e-40"))


# Output --------------------------------------------------------------------------------------------------------------


def _latex(matrix: Any) -> str:
    import sympy

    if matrix.shape == (1, 1):
        return str(sympy.latex(matrix[0, 0]))
    return str(sympy.latex(matrix, mat_str="bmatrix", mat_delim=""))


def _index(i: int, j: int, n: int) -> str:
    """Indices of an element, from 1, with a comma where they could be misread."""
    return f"{i + 1}{j + 1}" if n < 10 else f"{i + 1},{j + 1}"


def _numbers(matrix: Any, at: Mapping[Any, Any]) -> Array:
    import sympy

    values = matrix.subs(at).applyfunc(lambda e: sympy.N(e, 30))
    if values.has(sympy.nan, sympy.zoo, sympy.oo) or values.free_symbols:
        msg = f"values: expected values at which the closed form is defined (no 0/0), received {dict(at)}"
        raise ValueError(msg)
    return np.array([[float(sympy.re(e)) for e in values.row(i)] for i in range(matrix.rows)])
