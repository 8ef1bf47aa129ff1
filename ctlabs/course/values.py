r"""Numbers, lists and matrices as people write them, into an array of the shape that is asked for.

A number is an expression of the model files' grammar (read, never executed), after signs of print are put into that grammar's:
``0,523``, ``1.2·10⁻³``, ``1,2е-3``, ``√2/2``, ``5 %``. A comma between digits is a decimal comma; there is no mark for thousands but a
blank. In lists a comma may be either, and the number of elements decides: ``[0,5, 0,25]`` is two numbers where two are asked for,
and four where four are. What has two readings then, or none, is refused in words.

>>> answer("[0,5; 0,25] м²", (2,)).values, round(answer("30°", ()).values.item(), 4)
(array([0.5 , 0.25]), 0.5236)
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ctlabs.course.units import LENGTH, UnitError, WrittenUnit, unit
from ctlabs.files.modelfile.expressions import ExpressionError, parse
from ctlabs.files.spelling import shown
from ctlabs.linalg.checks import Array
from ctlabs.text import DASHES, LOWERED

#: Longest answer, characters.
LONGEST = 20_000
#: What stands for no answer.
NOTHING = frozenset({"", "-", "--", "---", "—", "–", "?", "...", "…", "n/a", "nan", "none", "todo"})
#: The two answers to a question, in words.
WORDS = {"yes": True, "true": True, "да": True, "верно": True, "no": False, "false": False, "нет": False, "неверно": False}

_PLAIN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?", re.ASCII)
_RAISED = re.compile("[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_SIGNS = str.maketrans(
    {
        **dict.fromkeys(DASHES, "-"), **dict.fromkeys("·⋅∙•×✕∗", "*"), "÷": "/", "∕": "/", "⁄": "/", "π": "pi", "∞": "inf",
        "＋": "+", **dict.fromkeys("\u200b\u200c\u200d\u2060\ufeff\u00ad", ""), **dict.fromkeys("“”„«»", '"'),
        **dict.fromkeys("\u00a0\u2007\u2009\u202f", " "),
    }
)  # fmt: skip
_LATEX = (
    (re.compile(r"\\(?:,|;|!|quad|left|right|displaystyle)|\$"), " "),
    (re.compile(r"\\(?:cdot|times)\b"), "*"),
    (re.compile(r"\\[dt]?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}"), r"((\1)/(\2))"),
    (re.compile(r"\\sqrt\s*\{([^{}]*)\}"), r"sqrt(\1)"),
    (re.compile(r"\\(pi|sqrt|exp|ln)\b"), r"\1"),
    (re.compile(r"\^\s*\{([^{}]*)\}"), r"^(\1)"),
)
#: A power of ten after a sign of multiplication that is a letter, or none.
_TEN = re.compile(r"(?<=[\d.])(?:\s*[xXхХ]\s*|\s+)(?=10\s*(?:\^|\*\*))")
_CYRILLIC_E = re.compile(r"(?<=\d)[еЕ](?=[-+]?\d)")
_GROUPS = re.compile(r"[-+]?\d{1,3}(?: \d{3})+(?:[.,]\d*)?", re.ASCII)
_TWO_MARKS = re.compile(r"\d,\d+\.\d|\d\.\d+,\d")
_BLANK = re.compile(r"(?<=[\w).%°'])\s+(?=[-+]?(?:[\d.(]|sqrt|pi\b|inf\b))")
#: Where a unit may begin: a symbol, 1/…, or brackets around one.
_UNIT = re.compile(r"[^\W\d_]|[%‰°º'′″]|(?<=\s)1\s*/|\((?:1\s*/\s*)?[^\W\d_]")


class AnswerError(ValueError):
    """A text that is no answer; the message says what was expected and received."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """An answer as it was read.

    ``values`` : of the shape asked for, in the coherent unit where a unit was written; NaN where an element is left out ·
    ``unit`` : as written, None where there is none · ``turned`` : whether rows were given as columns · ``text`` : as written
    """

    values: Array
    unit: WrittenUnit | None
    turned: bool
    text: str


def answer(text: str, shape: tuple[int, ...], *, verdict: bool = False) -> Received | None:
    """The answer in ``text``, None where there is none.

    Raises
    ------
    AnswerError
        Anything that has no reading as an array of ``shape``, or two.
    """
    if len(text) > LONGEST:
        raise AnswerError(f"expected at most {LONGEST} characters, received {len(text)}")
    if "\x00" in text:
        raise AnswerError("expected a text, received a zero byte")
    plain = text.strip().strip("\"'").strip()
    if plain.lower() in NOTHING or not plain.strip("[](){} ,;"):
        return None
    if verdict:
        return Received(np.array(_verdict(plain)), None, False, text)
    wanted = math.prod(shape)
    if wanted == 1:
        value, told = _single(plain)
        return Received(np.full(shape, value), told, False, text)
    return _array(text.strip(), shape)


def _verdict(text: str) -> bool:
    word = text.lower().strip(".! ")
    if word not in WORDS:
        raise AnswerError(f"expected yes or no, received {shown(text)}")
    return WORDS[word]


def _single(text: str) -> tuple[float, WrittenUnit | None]:
    """A number, brackets around it left out."""
    found = re.fullmatch(r"\[\s*\[?([^\[\]]*)\]?\s*\](.*)", text, re.DOTALL)
    return scalar(f"{found[1].strip().strip(chr(34))} {found[2]}" if found else text)


@lru_cache(maxsize=65536)
def scalar(text: str) -> tuple[float, WrittenUnit | None]:
    """A number in the coherent unit of SI, and the unit that it was written in.

    >>> scalar("1,2·10^-3"), scalar("1/3")[0] == 1 / 3, scalar("5 cm²")[0], scalar("5 %")[0]
    ((0.0012, None), True, 0.0005, 0.05)
    """
    text = text.strip()
    if _PLAIN.fullmatch(text) and math.isfinite(float(text)):
        return float(text), None
    if _TWO_MARKS.search(text):
        raise AnswerError(f"expected one decimal mark and no mark between thousands, received {shown(text)}")
    plain = grammar(text)
    if _GROUPS.fullmatch(plain):
        plain = plain.replace(" ", "")
    if not re.search(r"\b(atan2|min|max)\s*\(", plain):
        plain = re.sub(r",(?=\d)", ".", plain)
    try:
        return parse(plain).value({}), None
    except ExpressionError as error:
        why = error
    for at in range(max(1, len(plain) - LENGTH), len(plain)):
        if not _UNIT.match(plain, at) or plain[at - 1].isalpha():
            continue
        try:
            told = unit(plain[at:])
            return parse(plain[:at].rstrip()).value({}) * told.factor, told
        except (UnitError, ExpressionError):
            continue
    raise AnswerError(f"expected a number, as in 0.5, 1/3 or 5 cm², received {shown(text)}: {why.message}")


@lru_cache(maxsize=16384)
def grammar(text: str) -> str:
    r"""A number of print in the signs of the grammar.

    >>> grammar("≈ 1,2 × 10⁻³ м²"), grammar("√2/2"), grammar("K = 0.5")
    ('1,2 * 10^(-3) м^(2)', 'sqrt(2)/2', '0.5')
    """
    text = _RAISED.sub(lambda found: f"^({found[0].translate(LOWERED)})", text)
    text = re.sub("[¼-¾⅐-⅞]", lambda found: f"({unicodedata.normalize('NFKC', found[0])})", text).translate(_SIGNS)
    text = unicodedata.normalize("NFKC", text).replace("μ", "µ")
    for pattern, replacement in _LATEX if "\\" in text or "$" in text or "{" in text else ():
        text = pattern.sub(replacement, text)
    text = re.sub(r"(?<=\d)\s*√", "*√", text)
    text = re.sub(r"√\s*(\d+(?:[.,]\d+)?)", r"sqrt(\1)", text).replace("√", "sqrt")
    text = _CYRILLIC_E.sub("e", _TEN.sub("*", text))
    text = re.sub(r"^[^=\d\[(]{0,20}=\s*", "", text.strip())
    return re.sub(r"^[≈~≅=]+\s*", "", text).rstrip(" .;,")


def _array(text: str, shape: tuple[int, ...]) -> Received:
    """A list, a matrix or a list of matrices."""
    body, told = _common_unit(text)
    wanted, counts, failed = math.prod(shape), set(), None
    found: list[tuple[list[list[float]], WrittenUnit | None]] = []
    for cells in _readings(body):
        counts.add(count := sum(map(len, cells)))
        if count != wanted:
            continue
        try:
            found.append(_numbers(cells, told))
        except AnswerError as error:
            failed = failed or error
    if not found:
        if failed is not None:
            raise failed
        size = " × ".join(map(str, shape))
        raise AnswerError(f"expected {wanted} numbers ({size}), received {' or '.join(map(str, sorted(counts))) or 'none'}")
    flat = [np.array([value for row in rows for value in row]) for rows, _ in found]
    if any(not np.array_equal(flat[0], other, equal_nan=True) for other in flat[1:]):
        raise AnswerError(f"{shown(text)} has two readings: expected numbers with a decimal point, or parted by semicolons")
    rows, own = max(found, key=lambda each: len({len(row) for row in each[0]}) == 1 and len(each[0]) in shape)
    turned = len(shape) == 2 and shape[0] != shape[1] and len(rows) == shape[1] and {len(row) for row in rows} == {shape[0]}
    values = np.array(rows).T if turned else flat[0].reshape(shape)
    return Received(values, own, turned, text)


def _common_unit(text: str) -> tuple[str, WrittenUnit | None]:
    """A list without the unit behind its last bracket, and the unit."""
    found = re.fullmatch(r"(.*\])\s*([^\[\]]+?)\s*", text, re.DOTALL)
    if found is None or not found[2].strip(" .;,"):
        return text, None
    try:
        return found[1], unit(grammar(found[2].strip(" .;,*")))
    except UnitError as error:
        raise AnswerError(str(error)) from None


def _readings(text: str) -> list[list[list[str]]]:
    """The ways in which a text falls into rows of elements: quoted ones as they are, commas as separators or as decimal marks."""
    quoted: list[str] = []

    def kept(found: re.Match[str]) -> str:
        quoted.append(found[1] or found[2] or "")
        return f"\x00{len(quoted) - 1}\x00"

    ways = []
    bare = re.sub(r"""["']""", " ", re.sub(r"""["']\s*[,;]\s*["']""", "\n", text))
    inside = re.sub(r'"([^"\n]*)"|\'([^\'\n]*)\'', kept, text)
    for body in (inside, bare) if quoted else (inside,):
        lines = re.sub(r"[\])}]\s*[,;]?\s*[\[({]" if _tuples(body) else r"[\]}]\s*[,;]?\s*[\[{]", "\n", body)
        lines = re.sub(r"[\[\]{}]", " ", lines).replace("|", "\n").strip()
        if _tuples(body):
            lines = lines.strip(" ()")
        for between in ("\n", "[\n;]"):
            for mark in (r"[,;]", ";|,\\s+|" + _BLANK.pattern):
                rows = [_elements(row, mark, quoted) for row in re.split(between, lines) if row.strip(" ,;\t\r")]
                glued = mark == "[,;]" and any(_BLANK.search(cell) for row in rows for cell in row)  # "3 -0,5": not 3 − 0 and 5
                if rows not in ways and not glued:
                    ways.append(rows)
    return ways


def _tuples(text: str) -> bool:
    """Whether round brackets hold lists: (0.1, 0.2)."""
    return re.match(r"\s*\(", text) is not None and re.search(r"\([^()]*[,;][^()]*\)|\(\s*\(", text) is not None


def _elements(row: str, mark: str, quoted: list[str]) -> list[str]:
    plain = row.strip(" ,;\t\r") if "\x00" in row else grammar(row.strip(" ,;\t\r"))
    parts = [part.strip() for part in re.split(mark, plain)]
    return [quoted[int(part[1:-1])] if re.fullmatch("\x00\\d+\x00", part) else part.replace("\x00", '"') for part in parts]


def _numbers(rows: list[list[str]], told: WrittenUnit | None) -> tuple[list[list[float]], WrittenUnit | None]:
    """The elements as numbers in one unit: each its own, the last one's, or that behind the list."""
    read = [[(math.nan, None) if cell.lower() in NOTHING else scalar(cell) for cell in row] for row in rows]
    units = [own for row in read for _, own in row]
    if told is not None:
        if any(own is not None for own in units):
            raise AnswerError("expected one unit, received one in the list and one behind it")
        return [[value * told.factor for value, _ in row] for row in read], told
    last = units[-1]
    if last is not None and all(own is None for own in units[:-1]):  # 1, 2, 3 m
        factors = [last.factor] * (len(units) - 1) + [1.0]
        each = iter(factors)
        return [[value * next(each) for value, _ in row] for row in read], last
    given = {own.dimension for own in units if own is not None}
    bare = sum(own is None and value != 0 and not math.isnan(value) for row in read for value, own in row)
    if len(given) > 1 or (given and bare):
        raise AnswerError("expected elements in one unit, received some with another unit or without")
    own = next((own for own in units if own is not None), None)
    return [[value for value, _ in row] for row in read], own and WrittenUnit(1.0, own.dimension)


