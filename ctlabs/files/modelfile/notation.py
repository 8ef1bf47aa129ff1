r"""Expressions as equations."""

from __future__ import annotations

import re
from typing import NamedTuple

from ctlabs.text import latex_number

#: How tightly the written form holds together.
SUM, NEGATIVE, PRODUCT, FRACTION, POWER, ATOM = range(6)
GREEK = frozenset((
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi", "rho", "sigma",
    "tau", "upsilon", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Sigma", "Upsilon", "Phi", "Psi", "Omega",
))  # fmt: skip
LATEX_NAMES = {"pi": r"\pi", "inf": r"\infty", "e": "e"}


class Step(NamedTuple):
    """One step of the program: push a number or a name, or apply something to the last ``arity`` values."""

    kind: str
    what: str
    value: float
    arity: int
    column: int


def latex_name(name: str) -> str:
    r"""A name inside an equation.

    >>> latex_name("sigma_w2"), latex_name("x0"), latex_name("mass"), latex_name("q")
    ('\\sigma_{w2}', 'x_{0}', '\\mathrm{mass}', 'q')
    """
    if name in LATEX_NAMES:
        return LATEX_NAMES[name]
    head, _, index = name.partition("_")
    if not index and (match := re.fullmatch(r"([^\W\d]+?)(\d+)", head)):
        head, index = match[1], match[2]
    letter = rf"\{head}" if head in GREEK else head if len(head) == 1 else rf"\mathrm{{{head}}}"
    if not head:
        return rf"\mathrm{{{index}}}".replace("_", r"\_")
    return f"{letter}_{{{index.replace('_', ' ')}}}" if index else letter


def latex(program: tuple[Step, ...]) -> str:
    """The equation that a program computes."""
    stack: list[tuple[str, int]] = []
    for step in program:
        first = len(stack) - step.arity
        operands = stack[first:]
        del stack[first:]
        stack.append(_written(step, operands))
    return stack[0][0]


def _written(step: Step, operands: list[tuple[str, int]]) -> tuple[str, int]:
    if step.kind == "number":
        text = latex_number(step.value, 15)
        return text, NEGATIVE if text.startswith("-") else PRODUCT if "cdot" in text else ATOM
    if step.kind == "name":
        return latex_name(step.what), ATOM
    if step.kind == "unary":
        return f"-{_held(operands[0], PRODUCT)}", NEGATIVE
    if step.kind == "call":
        return _latex_call(step.what, [text for text, _ in operands]), ATOM
    left, right = operands
    if step.what in "+-":
        return f"{left[0]} {step.what} {_held(right, PRODUCT)}", SUM
    if step.what == "/":
        return rf"\frac{{{left[0]}}}{{{right[0]}}}", FRACTION
    if step.what == "^":
        return f"{_held(left, ATOM)}^{{{right[0]}}}", POWER
    factor = _held(right, FRACTION)
    times = r" \cdot " if factor[0].isdigit() else r"\,"
    return f"{_held(left, NEGATIVE)}{times}{factor}", min(left[1], PRODUCT) if left[1] >= NEGATIVE else PRODUCT


def _held(written: tuple[str, int], least: int) -> str:
    """A part of a formula, in parentheses where it would fall apart."""
    return written[0] if written[1] >= least else rf"\left({written[0]}\right)"


def _latex_call(name: str, arguments: list[str]) -> str:
    if name == "sqrt":
        return rf"\sqrt{{{arguments[0]}}}"
    if name == "abs":
        return rf"\left|{arguments[0]}\right|"
    special = {"atan": r"\arctan", "atan2": r"\mathrm{atan2}", "log10": r"\log_{10}", "log2": r"\log_2"}
    head = special.get(name, rf"\{name}")
    return rf"{head}\left({', '.join(arguments)}\right)"
