r"""Words and numbers for readers: translation, placeholders, number formats.

Reader-facing text is translated where it enters a report, a figure or a message (gettext; English is the source language):
by :func:`text`, which also puts values in, or by :func:`_`. Placeholders are ``{name}`` where they do not follow a LaTeX
command, ``_``, ``^`` or ``}``, so that ``\bar{P}`` in a text stays LaTeX. No numerical library is loaded here, so that the
commands which only list, help and refuse answer at once.
"""

from __future__ import annotations

import gettext
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_ = gettext.translation("ctlabs", localedir=str(Path(__file__).parent / "locale"), fallback=True).gettext

_PLACEHOLDER = re.compile(r"(?<![\\\w^}])\{([a-zA-Z]\w*)(?::(\d+))?\}")
RAISED_DIGITS = "⁰¹²³⁴⁵⁶⁷⁸⁹"
#: Plain digits and signs as raised ones, and back, for str.translate.
RAISED = str.maketrans("0123456789-+/", f"{RAISED_DIGITS}⁻⁺ᐟ")
LOWERED = {raised: plain for plain, raised in RAISED.items()}
#: What is written for a minus sign.
DASHES = "−–‐‑‒﹣"
#: Digits that are free of rounding: a number is taken to so many before it is shown with fewer.
SURE = 12
#: A unit of one letter or word, such as m, °C or %, and its power.
_SIMPLE = re.compile(rf"([°%‰]?[^\W\d_{RAISED_DIGITS}]*)([{RAISED_DIGITS}]*)")


class Own(str):
    """A user's own words, such as the name of a state or a column: no catalogue knows what "gain" means there."""

    __slots__ = ()


def translated(words: str) -> str:
    """Words in the reader's language; a user's :class:`Own`, and what has no translation (a symbol, a text that has one already), stay.

    >>> translated("gain"), translated("")
    ('gain', '')
    """
    return words if not words or isinstance(words, Own) else _(words)  # gettext's translation of "" is the catalogue's head


@dataclass(frozen=True, slots=True)
class Uncertain:
    """A number of an experiment with its standard error: written with as many digits as are known.

    >>> print(Uncertain(0.756571, 0.0169, "m"))
    0.757 ± 0.017 m
    >>> print(Uncertain(-1.93e-6, 4e-8, "rad"), Uncertain(123456.0, 2345.0), Uncertain(0.5, 0.0), sep="; ")
    (−1.930 ± 0.040)×10⁻⁶ rad; 123500 ± 2300; 0.5
    >>> print(Uncertain(-0.0002, 0.014))
    0.000 ± 0.014
    """

    value: float
    error: float
    unit: str = ""

    def __str__(self) -> str:
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        if not (math.isfinite(self.error) and self.error > 0 and math.isfinite(self.value)):
            return f"{number(self.value)}{unit}"
        size = math.floor(math.log10(max(abs(self.value), self.error)))
        power = 0 if -4 <= size < 7 else size
        value, error = self.value / 10.0**power, self.error / 10.0**power
        decimals = 1 - math.floor(math.log10(float(f"{error:.1e}")))
        value = round(value, decimals) + 0.0  # −0.0 + 0.0 is 0.0
        shown = f"{value:.{max(decimals, 0)}f} ± {round(error, decimals):.{max(decimals, 0)}f}".replace("-", "−")
        return f"({shown})×10{raised(power)}{unit}" if power else f"{shown}{unit}"


def raised(power: int) -> str:
    """An exponent: −12 as ⁻¹²."""
    return str(power).translate(RAISED)


def text(*sentences: str, **values: object) -> str:
    r"""A text for the reader: each of the ``sentences`` translated, ``values`` in place of their ``{name}``.

    Values that are words are translated, numbers are written as :func:`prose` does: ``{name}`` with five significant
    digits, ``{name:3}`` with three.

    >>> text("The limit is {limit} m²", ", which is {word}." , limit=0.123456789, word="small")
    'The limit is 0.12346 m², which is small.'
    """
    words = {name: translated(value) if isinstance(value, str) else value for name, value in values.items()}
    return fill("".join(map(translated, sentences)), **words)


def fill(text: str, /, **values: object) -> str:
    r"""Put ``values`` into the placeholders of ``text``; numbers as :func:`prose` writes them.

    >>> print(fill(r"The limit $\bar{P}$ is {limit} m² or {limit:2}.", limit=0.123456789))
    The limit $\bar{P}$ is 0.12346 m² or 0.12.
    """

    def replace(match: re.Match[str]) -> str:
        if match[1] not in values:
            msg = f"text: expected a value for {{{match[1]}}}, received {sorted(values)}"
            raise KeyError(msg)
        value = values[match[1]]
        if isinstance(value, str):
            return value
        digits, inside = int(match[2] or 5), text.count("$", 0, match.start()) % 2
        return latex(value, digits) if inside else prose(value, digits)

    return _PLACEHOLDER.sub(replace, text)


def latex(value: object, digits: int = 5) -> str:
    r"""A number, list or matrix inside an equation.

    >>> print(latex(1.5e-7), latex([0.5, 0.25]), latex(True))
    1.5\cdot 10^{-7} (0.5, 0.25) \text{yes}
    """
    value = _plain(value)
    if isinstance(value, bool):
        return rf"\text{{{number(value)}}}"
    if not isinstance(value, list | tuple):
        return latex_number(value, digits)  # type: ignore[arg-type]  # numbers, and whatever number() writes
    if _rectangular(value):
        return latex_matrix(value, digits)
    return f"({', '.join(latex(item, digits) for item in value)})"


def prose(value: object, digits: int = 5) -> str:
    """A number inside a sentence: powers of ten as in print, lists as tuples, matrices as equations.

    >>> prose(1.2723e-5), prose([0.5, -2.5e-7]), prose(None), prose(12)
    ('1.2723×10⁻⁵', '(0.5, −2.5×10⁻⁷)', '—', '12')
    """
    value = _plain(value)
    if isinstance(value, list | tuple) and _rectangular(value):
        return f"${latex_matrix(value, digits)}$"
    if isinstance(value, list | tuple):
        return f"({', '.join(prose(item, digits) for item in value)})"
    return printed(number(value, digits))


def _plain(value: object) -> object:
    """An array or a number of numpy as Python's own."""
    return value.tolist() if hasattr(value, "tolist") else value


def _rectangular(value: Sequence[object]) -> bool:
    """Whether a list is a matrix: rows of one length."""
    return bool(value) and all(isinstance(row, list | tuple) for row in value) and len({len(row) for row in value}) == 1  # type: ignore[arg-type]


def printed(shown: str) -> str:
    """What :func:`number` wrote, as in print: −1.5×10⁻⁷ for -1.5e-7."""
    found = re.sub(r"(?<=\d)e(-?\d+)", lambda match: f"×10{raised(int(match[1]))}", shown)
    return re.sub(r"(?<![\w.])-(?=[\d∞])", "−", found)


def number(value: object, digits: int = 5) -> str:
    """A number, list or matrix as a reader wants it: five significant digits, no noise.

    >>> number(0.5), number(1234567.0), number(-1e-20), number(None), number([1, 0.25])
    ('0.5', '1234600', '-1e-20', '—', '[1, 0.25]')
    """
    value = _plain(value)
    if value is None:
        return "—"
    if isinstance(value, Uncertain):
        return str(value)
    if isinstance(value, bool):
        return _("yes") if value else _("no")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, str):
        return {"inf": "∞", "-inf": "−∞"}.get(value, value)  # as results.json has them
    if isinstance(value, complex):
        real = re.sub("^-", "−", number(value.real, digits))  # one sign of minus in one number
        return f"{real} {'−' if value.imag < 0 else '+'} {number(abs(value.imag), digits)}i"
    if isinstance(value, float):
        return _real(value, digits)
    return "[" + ", ".join(number(item, digits) for item in value) + "]"  # type: ignore[attr-defined]  # what is left is a sequence


def _real(value: float, digits: int) -> str:
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞" if value < 0 else "NaN"
    if value == 0:
        return "0"
    value = float(f"{value:.{max(SURE, digits) - 1}e}")  # so that rounding in the sixteenth digit turns no half
    if 1e-4 <= abs(value) < 1e7:
        return repr(float(f"{value:.{digits - 1}e}")).removesuffix(".0")
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{mantissa}e{int(exponent)}"


def mode(value: complex) -> str:
    """A mode in a message, with its conjugate.

    >>> mode(-1.5), mode(1 - 2j)
    ('-1.5', '1 ± 2i')
    """
    return f"{value.real:.6g}" if abs(value.imag) < 1e-12 else f"{value.real:.6g} ± {abs(value.imag):.6g}i"


def moment(t: float, *others: float) -> str:
    """A time in a message: 15 digits, which hide its rounding, or all of them where another time would look the same.

    >>> moment(0.1 + 0.2), moment(1717156800.25), moment(5.0), moment(0.1 + 0.2, 0.3)
    ('0.3', '1717156800.25', '5', '0.30000000000000004')
    """
    text = f"{t:.15g}"
    return repr(float(t)) if any(other != t and f"{other:.15g}" == text for other in others) else text


def latex_number(value: float, digits: int = 5) -> str:
    """A number inside an equation; powers of ten as 1.2·10⁻⁷."""
    text = number(value, digits).replace("∞", r"\infty").replace("−", "-")
    return re.sub(r"e(-?\d+)$", r"\\cdot 10^{\1}", text)


def latex_matrix(value: ArrayLike, digits: int = 5) -> str:
    r"""A matrix inside an equation; a 1×1 matrix as a number, a vector as a column.

    >>> latex_matrix([[1, 0.5], [0, 1]])
    '\\begin{bmatrix} 1 & 0.5 \\\\ 0 & 1 \\end{bmatrix}'
    """
    rows = [_listed(row) for row in _listed(value)]
    if [len(row) for row in rows] == [1]:
        return latex_number(rows[0][0], digits)
    body = r" \\ ".join(" & ".join(latex_number(element, digits) for element in row) for row in rows)
    return rf"\begin{{bmatrix}} {body} \end{{bmatrix}}"


def _listed(value: object) -> list[Any]:
    value = _plain(value)
    return list(value) if isinstance(value, list | tuple) else [value]


def squared(unit: str) -> str:
    """The unit of a variance.

    >>> [squared(unit) for unit in ("m", "m/s", "m²", "%", "1", "")]
    ['m²', '(m/s)²', 'm⁴', '%²', '1', '']
    """
    simple = _SIMPLE.fullmatch(unit)
    if unit in ("", "1"):
        return unit
    if simple is None or not simple[1]:
        return f"({unit})²"
    power = 2 * int(simple[2].translate(LOWERED) or 1)
    return simple[1] + raised(power)


def per(unit: str, other: str) -> str:
    """A unit for another one.

    >>> per("m/s", "m"), per("m", "m"), per("", "s"), per("m", "1")
    ('(m/s)/m', '1', '1/s', 'm')
    """
    if unit == other:
        return "1"
    top, bottom = (("1" if each in ("", "1") else each if _SIMPLE.fullmatch(each) else f"({each})") for each in (unit, other))
    return top if bottom == "1" else f"{top}/{bottom}"
