"""Types for the parameters of labs: what a person may type, checked once, with one style of message.

A lab declares ``class Parameters(LabParameters)`` with fields such as
``Q: Variance = given(0.39, unit="m²", meaning="…")``.
The command line and the workbench read the same schema (default, unit, meaning, range).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from ctlabs.linalg import checks
from ctlabs.reporting.draws import Draw
from ctlabs.reporting.symbols import symbol as symbol_of

INFINITE = ("inf", "+inf", "infinity", "∞")


def given(default: Any, *, unit: str, meaning: str, symbol: str = "", draw: Draw | None = None) -> Any:
    r"""A parameter's default value, unit and meaning.

    ``symbol`` : its letter in LaTeX where its name does not tell it (Phi is \Phi) · ``draw`` : what a student's own may be;
    without one it is the default
    """
    extra: dict[str, Any] = {"unit": unit, **({"symbol": symbol} if symbol else {}), **({"draw": draw} if draw else {})}
    return Field(default=default, description=meaning, json_schema_extra=extra, validate_default=True)


class LabParameters(BaseModel):
    """Base of a lab's parameters: unknown names and values out of range are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)

    @classmethod
    def parse(cls, lab: str, values: Mapping[str, object]) -> Any:
        """Parameters from raw values; a ``ValueError`` of one line says which one, expected and received."""
        try:
            return cls(**values)
        except ValidationError as error:
            first = error.errors()[0]
            name = ".".join(str(part) for part in first["loc"]) or "parameters"
            what = first["msg"].removeprefix("Value error, ")
            if first["type"] == "extra_forbidden":
                what = f"expected one of {', '.join(cls.model_fields)}, received an unknown name"
            msg = f"{lab}: {name}: {what}"
            raise ValueError(msg) from None

    def plain(self) -> dict[str, Any]:
        """The values as JSON holds them (infinity as "inf")."""
        return {name: plain(getattr(self, name)) for name in type(self).model_fields}

    @classmethod
    def symbols(cls) -> dict[str, str]:
        """The letter of each in LaTeX."""
        extras = {name: info.json_schema_extra for name, info in cls.model_fields.items()}
        return {
            name: str(extra["symbol"]) if isinstance(extra, dict) and "symbol" in extra else symbol_of(name)
            for name, extra in extras.items()
        }

    @classmethod
    def draws(cls) -> dict[str, Draw]:
        """The sets from which a student's own parameters are drawn, by name."""
        extras: dict[str, Any] = {name: info.json_schema_extra for name, info in cls.model_fields.items()}
        return {name: extra["draw"] for name, extra in extras.items() if isinstance(extra, dict) and "draw" in extra}

    def described(self) -> list[tuple[str, str, str]]:
        """Name, unit and meaning of each."""
        extras = (
            (name, info.json_schema_extra, info.description or "") for name, info in type(self).model_fields.items()
        )
        return [
            (name, str(extra.get("unit", "")) if isinstance(extra, dict) else "", meaning)
            for name, extra, meaning in extras
        ]


def plain(value: Any) -> Any:
    """A value as JSON holds it: lists, floats, "inf" and "-inf"; complex numbers as [re, im]. NaN is refused."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, complex | np.complexfloating):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float | np.floating):
        if math.isnan(value):
            msg = "value: expected a number, received NaN"
            raise ValueError(msg)
        return float(value) if math.isfinite(value) else ("inf" if value > 0 else "-inf")
    if value is None or isinstance(value, str):
        return value
    msg = f"value: expected numbers, words, lists of them or None, received a {type(value).__name__}"
    raise TypeError(msg)


def typed(text: str) -> Any:
    """What a person typed after NAME=: JSON where it is JSON (numbers, lists, true), the text itself elsewhere."""
    try:
        return json.loads(text, parse_constant=lambda name: name)
    except (ValueError, RecursionError):  # no JSON, or more than Python reads: 5000 digits, 100 000 brackets
        return text


def _received(value: Any) -> str:
    return (
        json.dumps(value, ensure_ascii=False, default=repr)
        if isinstance(value, str | list | dict | bool | int | float)
        else repr(value)
    )


def _float(value: Any) -> float:
    """The number that ``value`` is (True and "2" are none); NaN where it is none or no double holds it."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


class _RefusedError(ValueError):
    """A value that is none of those expected; the text says more, if there is more to say."""


@dataclass(frozen=True, slots=True)
class Validator:
    """The validator of a parameter: ``expected`` says in words what it takes, ``each`` judges the elements of a list.

    >>> Validator("a number > 0", lambda x: x, each=None).allowed
    'a number > 0'
    """

    expected: str
    read: Callable[[Any], Any]
    each: Validator | None = None

    def __call__(self, value: Any) -> Any:
        """The value as the parameters hold it; ``ValueError``: expected, received."""
        try:
            return self.read(value)
        except _RefusedError as why:
            msg = f"expected {self.expected}, received {_received(value)}{why}"
            raise ValueError(msg) from None

    @property
    def allowed(self) -> str:
        """What may be typed, in words."""
        return self.expected if self.each is None else f"{self.expected}, each {self.each.expected}"


def _number(expected: str, holds: Callable[[float], bool], *, infinite: bool = False) -> Validator:
    """A number for which ``holds``; ``expected`` says so in words."""

    def read(value: Any) -> float:
        if isinstance(value, str) and infinite and value.strip().lower() in INFINITE:
            return math.inf
        number = _float(value)
        if math.isnan(number) or (math.isinf(number) and not infinite) or not holds(number):
            raise _RefusedError
        return number

    return Validator(expected, read)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise _RefusedError
    return int(value)


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise _RefusedError
    return value


def _list(item: Validator, size: int | None = None) -> Validator:
    def read(value: Any) -> tuple[float, ...]:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if not isinstance(value, list | tuple) or not value or (size is not None and len(value) != size):
            raise _RefusedError
        return tuple(item(element) for element in value)

    return Validator(f"a list of {size} numbers" if size else "a list of numbers", read, item)


def _matrix(n: int) -> Validator:
    def read(value: Any) -> tuple[tuple[float, ...], ...]:
        try:
            numbers = [[_float(element) for element in row] for row in value]
            matrix = checks.covariance("the matrix", numbers, (n, n))
        except (TypeError, ValueError) as error:
            detail = str(error).split(", received ")[-1]
            raise _RefusedError(f" ({detail})" if "eigenvalue" in detail or "asymmetry" in detail else "") from None
        return tuple(tuple(row) for row in matrix.tolist())

    return Validator(f"a {n}×{n} covariance (symmetric, nonnegative definite)", read)


def _or_null(item: Validator) -> Validator:
    """Lets null through: a value that follows others unless it is given."""
    return Validator(f"{item.expected} or null", lambda value: None if value is None else item.read(value))


_any = _number("a number", math.isfinite)
_positive = _number("a number > 0", lambda x: x > 0)
_nonnegative = _number("a number >= 0", lambda x: x >= 0)
_fraction = _number("a number from 0 to 1", lambda x: 0 <= x <= 1)
_variance_or_inf = _number('a variance >= 0 or "inf"', lambda x: x >= 0, infinite=True)

_variance_list = _list(_variance_or_inf)
_one_or_many = Validator(
    _variance_or_inf.expected,
    lambda value: (_variance_list if isinstance(value, list | tuple) else _variance_or_inf)(value),
)

Real = Annotated[float, BeforeValidator(_any)]
Positive = Annotated[float, BeforeValidator(_positive), Field(json_schema_extra={"exclusiveMinimum": 0})]
PositiveOrNull = Annotated[
    float | None, BeforeValidator(_or_null(_positive)), Field(json_schema_extra={"exclusiveMinimum": 0})
]
Variance = Annotated[float, BeforeValidator(_nonnegative), Field(json_schema_extra={"minimum": 0})]
Fraction = Annotated[float, BeforeValidator(_fraction), Field(json_schema_extra={"minimum": 0, "maximum": 1})]
VarianceOrInf = Annotated[float, BeforeValidator(_variance_or_inf), Field(json_schema_extra={"minimum": 0})]
Count = Annotated[int, BeforeValidator(Validator("a whole number >= 1", _whole)), Field(json_schema_extra={"minimum": 1})]
Flag = Annotated[bool, BeforeValidator(Validator("true or false", _flag))]
Positives = Annotated[tuple[float, ...], BeforeValidator(_list(_positive))]
Variances = Annotated[tuple[float, ...], BeforeValidator(_list(_nonnegative))]
VarianceOrVariances = Annotated[float | tuple[float, ...], BeforeValidator(_one_or_many)]
VariancesOrInf = Annotated[tuple[float, ...], BeforeValidator(_variance_list)]


def Vector(n: int) -> Any:
    """A list of ``n`` numbers."""
    return Annotated[tuple[float, ...], BeforeValidator(_list(_any, n))]


def Covariance(n: int) -> Any:
    """An n×n covariance matrix as nested lists."""
    return Annotated[tuple[tuple[float, ...], ...], BeforeValidator(_matrix(n))]
