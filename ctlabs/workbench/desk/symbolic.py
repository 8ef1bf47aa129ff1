r"""Coloured noise with its constants kept: the cells of a block as expressions, so that sliders and fits still reach them.

:math:`G(s) = D + \sum_i b_is^{n-i}/(s^n + \sum_i a_is^{n-i})` has the cells :math:`-a_i`, :math:`b_i - Da_i` of the observable
form; its stationary covariance solves :math:`FP + PF^T + GG^T = 0`. An expression stands for a cell only where its value is
that of the cell; :mod:`ctlabs.workbench.desk.blocks` has the numbers.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from ctlabs.files.modelfile.expressions import ExpressionError, parse
from ctlabs.linalg.checks import Array

#: A cell of a block: its matrix, row and column.
Place = tuple[str, int, int]
#: The longest text of a cell, and the highest degree whose covariance is solved for in letters.
LONGEST, DEGREE = 120, 2
#: How far the value of an expression may be from the number that it stands for.
NEAR = 1e-9
OPERATIONS = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "^": operator.pow}


def cells(kind: str, text: str, symbol: str, constants: Mapping[str, float], numbers: Mapping[str, Array]) -> dict[Place, Any]:
    """The cells of F, G, D and P0 that can be told exactly: expressions of the constants, or numbers without a rounding.

    ``numbers`` : the same matrices in numbers

    >>> import numpy as np
    >>> numbers = {"F": np.array([[-2.0]]), "G": np.array([[2.0]]), "P0": np.array([[1.0]]), "D": np.zeros((1, 1))}
    >>> cells("transfer", "w0/(s + w0)", "s", {"w0": 2.0}, numbers)
    {('F', 0, 0): '-w0', ('G', 0, 0): 'w0', ('P0', 0, 0): 'w0/2'}
    >>> numbers["P0"] = np.array([[0.5]]); numbers["G"] = np.sqrt([[2.0]])
    >>> cells("psd", "2*b*q/(w^2 + b^2)", "w", {"b": 2.0, "q": 0.5}, numbers)
    {('F', 0, 0): '-b', ('G', 0, 0): 'sqrt(2)*sqrt(b)*sqrt(q)', ('P0', 0, 0): 'q'}
    """
    import sympy

    try:
        num, den = _fraction(text, symbol)
        found = _transfer(num, den) if kind == "transfer" else _spectrum(num, den)
    except (ArithmeticError, LookupError, TypeError, ValueError, sympy.SympifyError):
        return {}
    made: dict[Place, Any] = {}
    for name, matrix in found.items():
        if matrix.rows * matrix.cols != numbers[name].size:  # factors that cancel by the values of the constants alone
            return {}
        for i in range(matrix.rows):
            for j in range(matrix.cols):
                number = float(numbers[name].reshape(matrix.shape)[i, j])
                if number and (cell := _cell(matrix[i, j], constants, number)) is not None:
                    made[name, i, j] = cell
    return made


def _fraction(text: str, symbol: str) -> tuple[list[Any], list[Any]]:
    """The coefficients of numerator and denominator, descending powers, the denominator's first one 1."""
    import sympy

    stack: list[Any] = []
    for step in parse(text).program:
        if step.kind == "number":
            exact = Fraction(step.what)
            stack.append(sympy.Rational(exact.numerator, exact.denominator))
        elif step.kind == "name":
            stack.append(sympy.Symbol(step.what, positive=True))
        else:
            first = len(stack) - step.arity
            operands = stack[first:]
            known = {**OPERATIONS, "sqrt": sympy.sqrt, "exp": sympy.exp}
            stack[first:] = [-operands[0] if step.kind == "unary" else known[step.what](*operands)]
    variable = sympy.Symbol(symbol, positive=True)
    top, bottom = sympy.fraction(sympy.cancel(sympy.together(stack[0])))
    num, den = (sympy.Poly(part, variable).all_coeffs() for part in (top, bottom))
    return [sympy.cancel(c / den[0]) for c in num], [sympy.cancel(c / den[0]) for c in den]


def _transfer(num: list[Any], den: list[Any]) -> dict[str, Any]:
    """The observable form, and its covariance."""
    import sympy

    n = len(den) - 1
    b = [sympy.Integer(0)] * (n + 1 - len(num)) + num
    F = sympy.Matrix(n, n, lambda i, j: -den[i + 1] if j == 0 else sympy.Integer(int(j == i + 1)))
    G = sympy.Matrix(n, 1, lambda i, _: b[i + 1] - b[0] * den[i + 1])
    plain = {"F": F, "G": G, "D": sympy.Matrix([[b[0]]])}
    if not 1 <= n <= DEGREE:
        return plain
    letters = sympy.symbols(f"p:{n * n}")
    P = sympy.Matrix(n, n, lambda i, j: letters[min(i, j) * n + max(i, j)])
    solved = sympy.solve(list(F * P + P * F.T + G * G.T), set(P), dict=True)
    return plain | ({"P0": P.subs(solved[0])} if solved else {})


def _spectrum(num: list[Any], den: list[Any]) -> dict[str, Any]:
    r"""Of first order, :math:`c/(\omega^2 + a^2)`: the noise :math:`\dot y = -ay + \sqrt{c}\,w`."""
    import sympy

    if len(num) != 1 or len(den) != 3 or den[1] != 0:
        return {}
    a = sympy.sqrt(den[2])
    return {"F": sympy.Matrix([[-a]]), "G": sympy.Matrix([[sympy.sqrt(num[0])]]), "P0": sympy.Matrix([[num[0] / (2 * a)]])}


def _cell(expression: Any, constants: Mapping[str, float], number: float) -> Any:
    """A cell that has the value of ``number``: a number or a text; ``None`` where it is too long or has another value."""
    import sympy

    found = sympy.factor_terms(sympy.cancel(expression) if expression.is_rational_function() else expression)
    if found.is_Rational:
        value = float(Fraction(int(found.p), int(found.q)))
        plain: Any = int(value) if value.is_integer() and abs(value) < 1e15 else value
        return plain if abs(value - number) <= NEAR * abs(number) else None
    text = str(found).replace("**", "^").replace(" ", "")
    try:
        value = parse(text).value(dict(constants))
    except ExpressionError:
        return None
    return text if len(text) <= LONGEST and abs(value - number) <= NEAR * abs(number) else None
