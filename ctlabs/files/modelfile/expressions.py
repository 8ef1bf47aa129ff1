r"""Arithmetic expressions of a model file: read, never executed.

.. code-block:: text

    sum    = term  { ("+" | "-") term }
    term   = unary { ("*" | "/") unary }
    unary  = ("-" | "+") unary | power
    power  = atom [ ("^" | "**") unary ]                 a^b^c = a^(b^c), -a^2 = -(a^2), as in Python
    atom   = NUMBER | NAME | FUNCTION "(" sum { "," sum } ")" | "(" sum ")"
    NAME   = a constant, pi, e, inf; t and k where a value may vary with time

The parser writes a short program for a stack; evaluating it is a loop over floats. Nothing else is possible: there
are no attributes, indices, strings, comparisons, or names beside those given. Length, depth, digits and exponents
are bounded, and a result that is not a number, is complex or overflows is an error that says so.
"""

from __future__ import annotations

import graphlib
import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ctlabs.files.modelfile import notation
from ctlabs.files.modelfile.errors import meant, shown
from ctlabs.files.modelfile.notation import Step
from ctlabs.files.spelling import EITHER, GROUPED
from ctlabs.linalg.checks import Array

#: Longest expression, in characters.
LENGTH = 1000
#: Deepest nesting of parentheses, functions, signs and powers.
DEPTH = 40
#: Most digits in a number.
DIGITS = 40
#: Largest power something is raised to.
EXPONENT = 1e6

CONSTANTS = {"pi": math.pi, "e": math.e, "inf": math.inf}
FUNCTIONS: dict[str, Callable[..., float]] = {
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "ln": math.log,
    "log10": math.log10,
    "log2": math.log2,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "atan": math.atan,
    "atan2": math.atan2,
    "abs": abs,
    "min": min,
    "max": max,
}
#: The time, s, and the index of the step.
VARIABLES = {"t": "the time", "k": "the index of the step"}
#: Operations that a whole column takes at once, with the same rounding.
ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "^": operator.pow,
}  # fmt: skip
#: Names that no constant may have.
RESERVED = {*CONSTANTS, *FUNCTIONS, *VARIABLES}
#: What people type for what is meant.
HINTS = {"−": "-", "–": "-", "·": "*", "×": "*", "÷": "/", ":": "/", "√": "sqrt", "∞": "inf"}
OTHER_NAMES = {
    "lg": "log10",
    "ld": "log2",
    "lb": "log2",
    "arctan": "atan",
    "arctg": "atan",
    "tg": "tan",
    "arctan2": "atan2",
    "infinity": "inf",
    "π": "pi",
    "∞": "inf",
}

#: Functions of other programs that resemble one that is known here and are not it.
OTHER_FUNCTIONS = {
    *vars(math), "arcsin", "arccos", "arsinh", "arcosh", "artanh", "sind", "cosd", "tand", "sinc", "sgn", "sign", "cot", "sec", "csc",
}  # fmt: skip

TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[^\W\d]\w*)|(?P<mark>\*\*|[-+*/^(),]))"
)
NAME = re.compile(r"[^\W\d]\w*")


class ExpressionError(ValueError):
    """A text that is no expression, or an expression without a value; ``column`` counts from 1, 0 = the whole."""

    def __init__(self, message: str, column: int = 0) -> None:
        super().__init__(f"column {column}: {message}" if column else message)
        self.message, self.column = message, column


class Token(NamedTuple):
    """A number, a name, a mark, or the end; ``start`` and ``stop`` are its place in the text."""

    kind: str
    text: str
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Expression:
    r"""A checked expression.

    >>> area = parse("pi*d^2/4")
    >>> sorted(area.names), area.value({"d": 2.0}), area.latex()
    (['d'], 3.141592653589793, '\\frac{\\pi\\,d^{2}}{4}')
    """

    text: str
    program: tuple[Step, ...] = field(repr=False, compare=False)
    names: frozenset[str] = field(repr=False, compare=False)

    @property
    def constant(self) -> bool:
        """Whether its value does not depend on t or k."""
        return not self.names & VARIABLES.keys()

    def value(self, names: Mapping[str, float]) -> float:
        """Its value, a float, which may be infinite; :class:`ExpressionError` where it has none."""
        stack: list[float] = []
        for step in self.program:
            if step.kind == "number":
                stack.append(step.value)
            elif step.kind == "name":
                stack.append(step.value if step.what in CONSTANTS else _named(step.what, names))
            else:
                first = len(stack) - step.arity
                stack[first:] = [_applied(step, stack[first:])]
        return stack[0]

    def many(self, names: Mapping[str, Array | float]) -> Array | None:
        """Its values for arrays of names at once; None where :meth:`value` has more to say, or a function could round otherwise.

        >>> parse("2*x^2").many({"x": np.array([1.0, 3.0])})
        array([ 2., 18.])
        """
        stack: list[Any] = []
        with np.errstate(all="ignore"):
            for step in self.program:
                if step.kind == "number" or (step.kind == "name" and step.what in CONSTANTS):
                    stack.append(step.value)
                elif step.kind == "name":
                    stack.append(names[step.what])
                elif step.what not in ARITHMETIC or step.kind == "call":
                    return None
                elif step.kind == "unary":
                    stack[-1] = -stack[-1]
                else:
                    right = stack.pop()
                    if step.what == "^" and not (np.ndim(right) == 0 and right in (1, 2)):
                        return None
                    stack[-1] = ARITHMETIC[step.what](stack[-1], right)
        result = np.asarray(stack[0], dtype=np.float64)
        return result if np.isfinite(result).all() else None

    def check(self, known: Collection[str]) -> None:
        """Refuse a name that is not ``known``, whatever the values."""
        for step in self.program:
            if step.kind == "name" and step.what not in CONSTANTS and step.what not in known:
                raise _unknown(step.what, known)

    def latex(self) -> str:
        """The expression inside an equation."""
        return notation.latex(self.program)

    def renamed(self, old: str, new: str) -> str:
        """Its text with one name in place of another, all else as typed."""
        text = self.text
        for token in reversed(list(_tokens(text))):
            if token.kind == "name" and token.text == old:
                text = text[: token.start] + new + text[token.stop :]
        return text


def parse(value: object) -> Expression:
    """The expression that a number or a text of a file is.

    Raises
    ------
    ExpressionError
        Anything else than a number or an expression of the grammar above.

    >>> parse("2*(q").value({})
    Traceback (most recent call last):
    ...
    ctlabs.files.modelfile.expressions.ExpressionError: column 5: expected ")" for the "(" in column 3, received the end
    """
    if isinstance(value, str):
        found = _parse(value)
        if isinstance(found, ExpressionError):
            raise ExpressionError(found.message, found.column)
        return found
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ExpressionError(f"expected a number or an expression in quotes, received {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        raise ExpressionError("expected a number within double precision, received a larger one") from None
    if math.isnan(number):
        raise ExpressionError("expected a number, received nan")
    return Expression(repr(value), (Step("number", repr(value), number, 0, 1),), frozenset())


def values(
    definitions: Mapping[str, Expression], without: Collection[str] = ()
) -> tuple[dict[str, float], dict[str, ExpressionError]]:
    """The values of constants that may refer to each other in any order, and what is wrong with the others.

    A cycle is named under the empty name. Those that refer to a wrong one, or to one ``without`` a value, are in neither answer.

    >>> values({"a": parse("2*b"), "b": parse("1/4")})[0]
    {'b': 0.25, 'a': 0.5}
    >>> values({"a": parse("b"), "b": parse("a + 1")})[1][""]
    ExpressionError('a -> b -> a')
    """
    wrong: dict[str, ExpressionError] = {}
    graph = {name: [n for n in definitions if n in found.names] for name, found in definitions.items() if found.names}
    try:
        order = [*graphlib.TopologicalSorter(graph).static_order()]
    except graphlib.CycleError as error:
        cycle = [str(name) for name in reversed(error.args[1])][:-1]
        first = cycle.index(min(cycle, key=list(definitions).index))
        cycle = cycle[first:] + cycle[:first]
        wrong[""] = ExpressionError(" -> ".join([*cycle, cycle[0]] if len(cycle) < 12 else [*cycle[:11], "…"]))
        return {}, wrong
    found: dict[str, float] = {}
    for name in [*(name for name in definitions if name not in graph), *order]:
        expression = definitions[name]
        if name in found or name in without or any(n in definitions and n not in found for n in expression.names):
            continue
        try:
            expression.check(definitions)
            found[name] = expression.value(found)
        except ExpressionError as error:
            wrong[name] = error
    return found, wrong


# --- from text to a program ------------------------------------------------------------------------------------------


def _tokens(text: str) -> Iterator[Token]:
    at = 0
    while at < len(text.rstrip()):
        match = TOKEN.match(text, at)
        if match is None:
            rest = text[at:].lstrip()
            column = len(text) - len(rest) + 1
            hint = f"; write {HINTS[rest[0]]}" if rest[0] in HINTS else ""
            raise ExpressionError(
                f"expected a number, a name, + - * / ^ or ( ), received {shown(rest[0])}{hint}", column
            )
        kind = str(match.lastgroup)
        yield Token(kind, match[kind], match.start(kind), match.end(kind))
        at = match.end()
    yield Token("end", "the end", len(text), len(text))


@lru_cache(maxsize=4096)
def _parse(text: str) -> Expression | ExpressionError:
    """The expression, or what is wrong with it: a file may hold the same mistake many times."""
    if len(text) > LENGTH:
        return ExpressionError(f"expected at most {LENGTH} characters, received {len(text)}")
    if not text.strip():
        return ExpressionError("expected a number or an expression, received an empty text")
    try:
        return _Parser(text).whole()
    except ExpressionError as error:
        return error.with_traceback(None)


class _Parser:
    """Recursive descent; the methods are the rules of the grammar."""

    def __init__(self, text: str) -> None:
        self.text, self.tokens, self.at = text, list(_tokens(text)), 0
        self.program: list[Step] = []
        self.depth = 0

    def whole(self) -> Expression:
        self.sum()
        if self.now.kind != "end":
            raise self._unexpected("an operator or the end")
        names = frozenset(s.what for s in self.program if s.kind == "name" and s.what not in CONSTANTS)
        return Expression(self.text, tuple(self.program), names)

    @property
    def now(self) -> Token:
        return self.tokens[self.at]

    def take(self, *marks: str) -> Token | None:
        """The present token, if it is one of the marks."""
        token = self.now
        if token.kind != "mark" or token.text not in marks:
            return None
        self.at += 1
        return token

    def deeper(self, token: Token, rule: Callable[[], None]) -> None:
        self.depth += 1
        if self.depth > DEPTH:
            raise ExpressionError(f"expected at most {DEPTH} levels of nesting, received more", token.start + 1)
        rule()
        self.depth -= 1

    def push(self, kind: str, token: Token, count: int, value: float = 0.0) -> None:
        what = "^" if token.text == "**" else token.text
        self.program.append(Step(kind, what, value, count, token.start + 1))

    def sum(self) -> None:
        self.chain(self.term, "+", "-")

    def term(self) -> None:
        self.chain(self.unary, "*", "/")

    def chain(self, rule: Callable[[], None], *marks: str) -> None:
        rule()
        while mark := self.take(*marks):
            rule()
            self.push("binary", mark, 2)

    def unary(self) -> None:
        if sign := self.take("-", "+"):
            self.deeper(sign, self.unary)
            if sign.text == "-":
                self.push("unary", sign, 1)
        else:
            self.power()

    def power(self) -> None:
        self.atom()
        if mark := self.take("^", "**"):
            self.deeper(mark, self.unary)
            self.push("binary", mark, 2)

    def atom(self) -> None:
        token = self.now
        if token.kind == "number":
            self.at += 1
            self.push("number", token, 0, _number(token))
        elif token.kind == "name":
            self.at += 1
            if token.text in FUNCTIONS:
                self.call(token)
            elif self.now.text == "(":
                raise _no_function(token)
            else:
                self.push("name", token, 0, CONSTANTS.get(token.text, math.nan))
        elif opening := self.take("("):
            self.deeper(opening, self.sum)
            self.close(opening)
        else:
            raise self._unexpected('a number, a name or "("')

    def call(self, function: Token) -> None:
        opening = self.take("(")
        if opening is None:
            raise ExpressionError(
                f'expected "(" after the function {function.text}, received {_quoted(self.now)}', self.now.start + 1
            )
        count = 1
        self.deeper(opening, self.sum)
        while self.take(","):
            self.deeper(opening, self.sum)
            count += 1
        self.close(opening)
        many = function.text in {"min", "max"}
        least = 2 if many or function.text == "atan2" else 1
        if count < least or (count > least and not many):
            inside = self.text[opening.stop : self.tokens[self.at - 1].start]
            hint = comma_hint(inside) if count == least + 1 else ""
            wanted = f"{least} arguments{' or more' if many else ''}" if least > 1 else "1 argument"
            raise ExpressionError(f"{function.text}: expected {wanted}, received {count}{hint}", function.start + 1)
        self.push("call", function, count)

    def close(self, opening: Token) -> None:
        if not self.take(")"):
            raise self._unexpected(f'")" for the "(" in column {opening.start + 1}')

    def _unexpected(self, expected: str) -> ExpressionError:
        token, before = self.now, self.tokens[self.at - 1] if self.at else None
        hint = ""
        if token.text == ",":
            hint = comma_hint(self.text)
        elif before is not None and before.kind == "number" and re.fullmatch(r"_[\d_]*", token.text):
            hint = f"; write {before.text}{token.text}".replace("_", "")
        elif token.kind in {"name", "number"} and before is not None and before.kind != "mark":
            hint = f"; to multiply, write {before.text}*{token.text}"
        elif token.text == "(" and before is not None:
            hint = f"; to multiply, write {before.text}*("
        return ExpressionError(f"expected {expected}, received {_quoted(token)}{hint}", token.start + 1)


def _quoted(token: Token) -> str:
    return token.text if token.kind == "end" else shown(token.text)


def comma_hint(text: str) -> str:
    """What is said behind a refusal where a comma, or more than one mark, leaves open which number is meant; empty elsewhere.

    >>> comma_hint("2*0,5"), comma_hint("1,120"), comma_hint("1.234,5"), comma_hint("1,000,000"), comma_hint("many")
    ('; a decimal point is meant? write 0.5', '; write 1.120 or 1120', '; write 1234.5', '; write 1000000', '')
    """
    text = text.strip()
    found = GROUPED.fullmatch(text) if "," in text else None
    if EITHER.fullmatch(text) and "," in text:
        return f"; write {text.replace(',', '.')} or {text.replace(',', '')}"
    if found is not None and found[4] in {",", "."} and not found[2].startswith("0"):
        return f"; write {found[1]}{found[2]}{found[3].replace(found[4], '')}{'.' + found[6] if found[5] else ''}"
    once = re.search(r"\d+,\d+", text, re.ASCII)
    return f"; a decimal point is meant? write {once[0].replace(',', '.')}" if once else ""


def _no_function(token: Token) -> ExpressionError:
    name = token.text
    if name in OTHER_NAMES and OTHER_NAMES[name] in FUNCTIONS:
        hint = f'; did you mean "{OTHER_NAMES[name]}"?'
    else:
        known = ", ".join(FUNCTIONS)
        hint = f"; known are {known}" if name.lower() in OTHER_FUNCTIONS else meant(name, FUNCTIONS, len(FUNCTIONS))
        hint += "" if "did you mean" in hint else f"; to multiply, write {name}*("
    return ExpressionError(f"unknown function {shown(name)}{hint}", token.start + 1)


def _number(token: Token) -> float:
    mantissa = re.split("[eE]", token.text)[0]
    if len(token.text) > DIGITS:
        raise ExpressionError(f"expected at most {DIGITS} digits, received {len(token.text)}", token.start + 1)
    number = float(token.text)
    if math.isinf(number) or (number == 0 and mantissa.strip("0.")):
        raise ExpressionError(f"expected a number within double precision, received {token.text}", token.start + 1)
    return number


# --- from a program to a value ---------------------------------------------------------------------------------------


def _named(name: str, names: Mapping[str, float]) -> float:
    try:
        return names[name]
    except KeyError:
        raise _unknown(name, names) from None


def _unknown(name: str, known: Iterable[str]) -> ExpressionError:
    """What to say about a name that has no value."""
    if name in VARIABLES:
        return ExpressionError(
            f'expected a constant value, received "{name}", {VARIABLES[name]}, which may not stand here'
        )
    if OTHER_NAMES.get(name) in CONSTANTS:
        return ExpressionError(f'unknown name "{name}"; did you mean "{OTHER_NAMES[name]}"?')
    return ExpressionError(f"unknown name {shown(name)}{meant(name, [*known, *CONSTANTS])}")


def _applied(step: Step, values: list[float]) -> float:
    """The operation of a step on its operands."""
    if step.kind == "unary":
        return -values[0]
    try:
        result = float(_operation(step, values))
    except ExpressionError:
        raise
    except ZeroDivisionError:
        raise ExpressionError("division by zero", step.column) from None
    except OverflowError:
        raise ExpressionError(
            f"{_described(step, values)} is beyond double precision (overflow)", step.column
        ) from None
    except ValueError:
        raise ExpressionError(f"{_described(step, values)} is not defined", step.column) from None
    if math.isnan(result):
        raise ExpressionError(f"{_described(step, values)} is not a number", step.column)
    if math.isinf(result) and all(math.isfinite(value) for value in values):
        raise ExpressionError(f"{_described(step, values)} is beyond double precision (overflow)", step.column)
    return result


def _operation(step: Step, values: list[float]) -> float:
    if step.kind == "call":
        return FUNCTIONS[step.what](*values)
    a, b = values
    if step.what == "+":
        return a + b
    if step.what == "-":
        return a - b
    if step.what == "*":
        return a * b
    if step.what == "/":
        return a / b
    if abs(b) > EXPONENT:
        raise ExpressionError(f"expected an exponent from -{EXPONENT:g} to {EXPONENT:g}, received {b:g}", step.column)
    if a < 0 and not b.is_integer():
        raise ExpressionError(f"{a:g}^{b:g} is complex: a negative number to a power that is not whole", step.column)
    return a**b


def _described(step: Step, values: list[float]) -> str:
    """The operation with its numbers: "sqrt(-1)", "inf - inf"."""
    if step.kind == "call":
        return f"{step.what}({', '.join(f'{value:g}' for value in values[:4])}{', …' if len(values) > 4 else ''})"
    return f"{values[0]:g} {step.what} {values[1]:g}"
