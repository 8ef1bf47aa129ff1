r"""A transfer function or a spectrum becomes states of a model file: coloured noise from what is known of it.

``transfer`` of s: the noise w that entered directly passes through G(s) = D + H_b(sI − F_b)⁻¹G_b first,

.. math:: \dot x = Fx + \dots + g(H_by + Dw), \quad \dot y = F_by + G_bw

``psd`` of w (rad/s, two-sided, unit²·s): the same with the factor of the spectrum and white noise of strength 1. Cells that are
not concerned stay as they were typed; what is added refers to the cells that were there, so that constants still work.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from ctlabs.files.modelfile import ModelFile
from ctlabs.files.modelfile.expressions import CONSTANTS, Expression, ExpressionError, parse
from ctlabs.linalg import riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.companion import companion
from ctlabs.models import spectra
from ctlabs.workbench.desk import symbolic
from ctlabs.workbench.desk.plain import typed

#: Highest degree of a numerator or denominator.
DEGREE = 12
#: Longest numerator or denominator of a coefficient, in bits: twice that of the largest double.
BITS = 2048
SYMBOLS = {"transfer": "s", "psd": "w"}

OPERATIONS = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}


@dataclass(frozen=True, slots=True)
class InsertBlock:
    """Coloured noise in the place of white noise ``into`` ("noise"), or added to measurement ``into`` ("measurement").

    ``kind`` : "transfer", G(s) as "1/(2*s + 1)"; "psd", S(w) as "4/(w^2 + 1)" · ``text`` may contain the model's constants,
    which stay in the cells wherever these can be told in letters · ``name``, ``unit`` of the block's output, its first state
    """

    kind: Literal["transfer", "psd"]
    text: str
    into: int = 0
    place: Literal["noise", "measurement"] = "noise"
    name: str = "coloured"
    unit: str = ""

    def apply(self, file: ModelFile) -> tuple[ModelFile, str]:
        """Put the block into the file."""
        return inserted(file, self), f"{self.kind} {self.text[:40]} into {self.place} {self.into + 1}"


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """ẏ = F y + G w, output H y + D w, w of strength 1; P0, its stationary covariance, or 0 where there is none.

    ``exact`` : cells of F, G, D, P0 as they are written, where that is not their number
    """

    F: Array
    G: Array
    H: Array
    D: float
    P0: Array
    exact: dict[symbolic.Place, Any] = field(default_factory=dict)

    def cell(self, name: str, i: int, j: int) -> Any:
        """A cell of F, G, D or P0 as it is written: an expression of the constants, or a number."""
        value = float(np.reshape(getattr(self, name), (-1, len(self.F) if name in {"F", "P0"} else 1))[i, j])
        return self.exact.get((name, i, j), _number(value)) if value else 0


def inserted(file: ModelFile, command: InsertBlock) -> ModelFile:
    """The file with the block in it.

    Raises
    ------
    ValueError
        A discrete model; no such noise or measurement; a text that is no rational function; a direct path into a measurement.
    """
    if file.kind != "continuous":
        msg = "block: expected a continuous model (a block is a differential equation), received a discrete one"
        raise ValueError(msg)
    size = file.s if command.place == "noise" else file.m
    if command.place not in {"noise", "measurement"} or not 0 <= command.into < size:
        msg = f"into: expected a {command.place} from 0 to {size - 1}, received {command.into}"
        raise ValueError(msg)
    made = block(command.kind, command.text, file.constants)
    before = file.n
    states = _names(command.name.strip() or "coloured", len(made.F), file.states)
    for i, name in enumerate(states):
        file = file.add_state(name, command.unit if i == 0 else "")
    file = (_into_noise if command.place == "noise" else _into_measurement)(file, made, command, before)
    n = len(made.F)
    return file.edit_all(
        [(("model", "F", before + i, before + j), made.cell("F", i, j)) for i in range(n) for j in range(n)]
    )


def block(kind: str, text: str, constants: dict[str, float]) -> Block:
    """The block of a text.

    >>> block("transfer", "3/(2*s + 1)", {}).F
    array([[-0.5]])
    >>> block("psd", "2*a/(w^2 + a^2)", {"a": 5.0}).P0.round(9)
    array([[1.]])
    """
    if kind not in SYMBOLS:
        msg = f"kind: expected {' or '.join(SYMBOLS)}, received {kind!r}"
        raise ValueError(msg)
    num, den = rational(text, SYMBOLS[kind], constants)
    made = _of_transfer(num, den) if kind == "transfer" else _of_spectrum(num, den)
    numbers = {"F": made.F, "G": made.G, "P0": made.P0, "D": np.array([[made.D]])}
    return replace(made, exact=symbolic.cells(kind, text, SYMBOLS[kind], constants, numbers))


def rational(text: str, symbol: str, constants: dict[str, float]) -> tuple[Array, Array]:
    """Numerator and denominator, descending powers of the symbol, without common factors.

    >>> rational("(s + 1)/((s + 1)*(s + k))", "s", {"k": 2.0})
    (array([1.]), array([1., 2.]))
    """
    if symbol in constants:
        msg = f'block: expected no constant of the name "{symbol}", which is the variable here, received one; rename it'
        raise ValueError(msg)
    try:
        expression = parse(text)
        expression.check([symbol, *constants])
        num, den = _computed(expression, symbol, constants)
    except ExpressionError as error:
        msg = f"block: {error}"
        raise ValueError(msg) from None
    try:
        top, bottom = (np.array([float(c) for c in p]) for p in (num, den))
    except OverflowError:
        msg = "block: expected coefficients within double precision, received larger ones"
        raise ValueError(msg) from None
    return top, bottom


def _of_transfer(num: Array, den: Array) -> Block:
    """The observable form."""
    if len(num) > len(den):
        msg = f"transfer: expected a proper function, received degree {len(num) - 1} over {len(den) - 1}: it differentiates white noise"
        raise ValueError(msg)
    if len(den) == 1:
        msg = f"transfer: expected a function with poles, received the constant {num[0]:g}"
        raise ValueError(msg)
    made = companion([num], den)
    return _block(made.F, made.G[:, 0], made.H[0], float(made.D[0, 0]))


def _of_spectrum(num: Array, den: Array) -> Block:
    """White noise of strength 1 through the spectrum's factor."""
    pairs = []
    for name, p in (("numerator", num), ("denominator", den)):
        powers = p[::-1]
        if powers[1::2].any():
            msg = f"psd: expected an even function of w, received an odd power in the {name}"
            raise ValueError(msg)
        pairs.append(powers[::2][::-1])
    model = spectra.shaping_filter(spectra.Spectrum(*pairs), 1.0)
    D = 0.0 if model.N is None else float(model.N[0, 0])
    return _block(model.F, model.G[:, 0], model.H[0], D)


def _block(F: Array, G: Array, H: Array, D: float) -> Block:
    P0 = np.zeros_like(F)
    if np.linalg.eigvals(F).real.max() < -1e-12 * max(np.abs(F).max(), 1e-300):
        P0 = riccati.stationary(F, np.outer(G, G), continuous=True).P.high
    return Block(np.array(F), np.array(G), np.array(H), D, P0)


# Into the file -------------------------------------------------------------------------------------------------------


def _into_noise(file: ModelFile, made: Block, command: InsertBlock, before: int) -> ModelFile:
    """The block's output enters where the white noise did."""
    model, j = file.contents["model"], command.into
    strength = _text(model["Q"][j][j])
    if command.kind == "psd":
        own = [i for i in range(len(model["Q"])) if i != j]
        Q = file.matrix("Q")
        if Q[j, own].any() or ("N" in model and file.matrix("N")[j].any()):
            msg = f"into: expected a noise that correlates with no other (a spectrum does not say how), received noise {j + 1}"
            raise ValueError(msg)
        strength = "1"
        file = file.edit(("model", "Q", j, j), 1)
    for i in range(before):
        cell = model["G"][i][j]
        if _text(cell) in {"0", "0.0"}:
            continue
        for k, h in enumerate(made.H):
            if h:
                file = file.edit(("model", "F", i, before + k), _times(cell, h))
        file = file.edit(("model", "G", i, j), _times(cell, made.cell("D", 0, 0)))
    for i in range(len(made.G)):
        file = file.edit(("model", "G", before + i, j), made.cell("G", i, 0))
    return _initial(file, made, before, strength)


def _into_measurement(file: ModelFile, made: Block, command: InsertBlock, before: int) -> ModelFile:
    """The block's output adds to a measurement; it has a noise of its own."""
    if made.D:
        msg = "into: expected a block without a direct path (white noise in a measurement is R or Rc), received one with it"
        raise ValueError(msg)
    column = file.s
    file = file.add_noise()
    for i in range(len(made.G)):
        file = file.edit(("model", "G", before + i, column), made.cell("G", i, 0))
    for i, h in enumerate(made.H):
        file = _put(file, ("model", "H", command.into, before + i), h)
    return _initial(file, made, before, "1")


def _initial(file: ModelFile, made: Block, before: int, strength: str) -> ModelFile:
    """The stationary covariance of the block, times the strength of its noise."""
    n = len(made.P0)
    cells = {(i, j): made.cell("P0", i, j) for i in range(n) for j in range(n)}
    return file.edit_all(
        [(("model", "P0", before + i, before + j), _times(strength, cell)) for (i, j), cell in cells.items()]
    )


def _put(file: ModelFile, path: tuple[str | int, ...], value: float) -> ModelFile:
    return file.edit(path, _number(value))


def _text(cell: Any) -> str:
    return cell.strip() if isinstance(cell, str) else repr(cell)


def _times(cell: Any, factor: Any) -> Any:
    """A cell times a number or an expression: a number where both are numbers, otherwise an expression."""
    text = _text(cell)
    if factor in (0.0, 1.0):
        return 0 if factor == 0 else typed(text)
    shown = factor if isinstance(factor, str) else repr(_number(factor))
    try:  # in decimals: no rounding is added
        return _number(float(Fraction(text) * Fraction(shown)))
    except (ValueError, ZeroDivisionError):
        pass
    return shown if text == "1" else f"{_whole(shown)}*{_whole(text)}"


def _whole(text: str) -> str:
    """An expression that may stand in a product."""
    return text if parse(text).program[-1].kind in {"number", "name", "call"} else f"({text})"


def _number(value: float) -> int | float:
    """A whole number where it is one."""
    value = float(value)
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def _names(name: str, count: int, taken: tuple[str, ...]) -> list[str]:
    """Names for the states that none has yet: coloured, coloured_2 and so on."""
    found: list[str] = []
    number = 1
    while len(found) < count:
        candidate = name if number == 1 else f"{name}_{number}"
        if candidate not in taken:
            found.append(candidate)
        number += 1
    return found


# Rational functions, exactly -----------------------------------------------------------------------------------------


def _computed(expression: Expression, symbol: str, constants: dict[str, float]) -> tuple[list[Fraction], list[Fraction]]:
    """Run the expression's program on fractions of polynomials: numerator and monic denominator, descending powers."""
    from sympy import QQ
    from sympy.polys.fields import field

    rationals, variable = field(symbol, QQ)
    stack: list[Any] = []
    for step in expression.program:
        if step.kind == "name" and step.what == symbol:
            stack.append(variable)
        elif step.kind in {"number", "name"}:
            number = step.what if step.kind == "number" else CONSTANTS.get(step.what, constants.get(step.what, 0.0))
            if isinstance(number, float) and not np.isfinite(number):
                raise ExpressionError(f"expected finite numbers, received {step.what}", step.column)
            exact = Fraction(number if isinstance(number, str) else repr(float(number)))
            stack.append(rationals(QQ(exact.numerator, exact.denominator)))
        else:
            first = len(stack) - step.arity
            stack[first:] = [_applied(step, stack[first:], rationals)]
        parts = stack[-1].numer, stack[-1].denom
        if max(part.degree() for part in parts) > 2 * DEGREE:
            raise ExpressionError(f"expected a degree of at most {DEGREE}, received more", step.column)
        if max(c.bit_length() for part in parts for x in part.coeffs() for c in _exact(x).as_integer_ratio()) > BITS:
            raise ExpressionError("expected numbers of fewer digits, received larger ones", step.column)
    lead = stack[0].denom.LC
    num, den = ([_exact(c / lead) for c in part.to_dense()] for part in (stack[0].numer, stack[0].denom))
    return num or [Fraction(0)], den


def _exact(x: Any) -> Fraction:
    return Fraction(int(x.numerator), int(x.denominator))


def _number_in(x: Any) -> Fraction | None:
    """The number that a fraction of polynomials is; ``None`` where it depends on the variable."""
    return _exact(x.numer.LC / x.denom.LC) if max(x.numer.degree(), x.denom.degree()) <= 0 else None


def _applied(step: Any, operands: list[Any], rationals: Any) -> Any:
    """An operation on fractions of polynomials."""
    if step.kind == "unary":
        return -operands[0]
    numbers = [_number_in(x) for x in operands]
    try:
        if step.kind == "call":
            pass
        elif step.what in OPERATIONS:
            return OPERATIONS[step.what](*operands)
        elif (exponent := numbers[1]) is None:
            raise ExpressionError("expected a number as exponent, received the variable", step.column)
        elif exponent.denominator == 1 and abs(exponent) <= 2 * DEGREE:
            return operands[0] ** int(exponent) if exponent else rationals(1)
        elif numbers[0] is None:
            msg = f"expected a whole exponent up to {2 * DEGREE}, received {float(exponent):g}"
            raise ExpressionError(msg, step.column)
    except ZeroDivisionError:
        raise ExpressionError("division by zero", step.column) from None
    if None in numbers:
        raise ExpressionError(f"{step.what}: expected numbers, received the variable (only + - * / ^ make it)", step.column)
    values = (step._replace(kind="number", value=float(x), arity=0) for x in numbers if x is not None)
    value = Fraction(repr(Expression("", (*values, step), frozenset()).value({})))
    return rationals(rationals.domain(value.numerator, value.denominator))
