"""The options at the end of a refusal, one remedy after the other, and what each of them says of a table.

A reader that refuses a table ends its line with what would put it right (:mod:`ctlabs.files.datafile`). On the command line that is pasted;
a page makes a button of it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from collections.abc import Mapping as Table
from typing import Any

from ctlabs.files.mapping import NO_TIME, Mapping, pairs, time_option

#: A word of a command: bare, or with parts in quotation marks.
_WORD = r"""(?:"[^"]*"|'[^']*'|[^\s"'])+"""
_OPTION = re.compile(rf"(?<![\w-])(--[a-z][a-z0-9-]*)(?:=|\s+)({_WORD})")
#: What stands where only a person knows the answer.
BLANKS = ("COLUMN", "VALUE", "MEASUREMENT")


def _number(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{option}: expected a number, received {text}") from None


def _scale(text: str) -> dict[str, Any]:
    return {"scale": {name: _number(f"--scale {name}", value) for name, value in pairs("--scale", [text]).items()}}


#: What the word behind an option says, as fields of a mapping.
_FIELDS: Table[str, Callable[[str], dict[str, Any]]] = {
    "--column": lambda text: {"columns": pairs("--column", [text])},
    "--time": lambda text: dict(zip(("time", "unit"), time_option(text), strict=True)),
    "--t0": lambda text: {"t0": text},
    "--dt": lambda text: {"dt": _number("--dt", text)},
    "--missing": lambda text: {"missing": (text,)},
    "--scale": _scale,
    "--input": lambda text: {"inputs": (text,)},
    "--u0": lambda text: {"u0": tuple(_number("--u0", word) for word in text.split(","))},
    "--regressor": lambda text: {"regressors": pairs("--regressor", [text])},
    "--record-column": lambda text: {"record": text},
    "--decimal": lambda text: {"decimal": text},
    "--thousands": lambda text: {"thousands": text},
    "--blank": lambda text: {"blank": text},
    "--encoding": lambda text: {"encoding": text},
    "--skip": lambda text: {"skip": round(_number("--skip", text))},
    "--sheet": lambda text: {"sheet": text},
}


def offered(refusal: str) -> tuple[str, ...]:
    """The remedies that a refusal offers, each as options to paste; those beside each other are one.

    What only a person knows (COLUMN) is left out, and the rest of its remedy kept.

    >>> offered('f.csv: line 2, column x: "1,120" may be 1120 or 1.12: expected a choice, --thousands , or --decimal ,')
    ('--thousands ,', '--decimal ,')
    >>> offered('expected the column z, received "a"; --column z=COLUMN --time "Time (s)" --t0 first')
    ('--time "Time (s)" --t0 first',)
    >>> offered("--sheet Log: expected an Excel workbook, received a text file; leave --sheet out")
    ()
    """
    begin = refusal.find("expected")
    found: list[list[str]] = []
    end = -1
    for match in _OPTION.finditer(refusal, max(begin, 0)):
        name, word = match[1], match[2]
        while len(word) > 1 and word[-1] in "),;:":
            word = word[:-1]
        if name not in _FIELDS or refusal[: match.start()].endswith("leave "):
            continue
        beside = end >= 0 and not refusal[end : match.start()].strip()
        end = match.start(2) + len(word)
        if not beside:
            found.append([])
        if word.rpartition("=")[2].strip("\"'") not in BLANKS and not word.startswith(BLANKS):
            found[-1].append(f"{name}={word}" if word.startswith("-") else f"{name} {word}")
    return tuple(dict.fromkeys(" ".join(options) for options in found if options))


def said(options: str) -> Mapping:
    """What options say of a table.

    >>> said('--column position="pos [m]" --time stamp:unix_ms --missing=-9999').unit
    'unix_ms'

    Raises
    ------
    ValueError
        An option that says nothing of a table, or a value that it cannot have.
    """
    words = shlex.split(re.sub(r"(--[a-z0-9-]+)=", r"\1 ", options))
    if len(words) % 2:
        raise ValueError(f"options: expected a value behind each, received {options}")
    mapping = Mapping()
    for name, word in zip(words[::2], words[1::2], strict=True):
        if name not in _FIELDS:
            raise ValueError(f"{name}: expected one of {', '.join(_FIELDS)}")
        own = Mapping(**_FIELDS[name](word))
        mapping = Mapping(**{**_all(mapping.over(own)), "inputs": (*mapping.inputs, *own.inputs)})
    return mapping


def changing(refusal: str, present: Mapping) -> tuple[str, ...]:
    """Those of the remedies that say something new.

    >>> changing('expected a decimal comma (--decimal ,), received "1.5" (--decimal .)', Mapping(decimal=","))
    ('--decimal .',)
    """
    return tuple(options for options in offered(refusal) if _new(options, present))


def words(options: str) -> str:
    """What options say, for a reader; "" where they say nothing of a table.

    >>> words('--column flow="Flow (m3/s)" --time stamp:unix_ms --t0 first')
    'flow is in the column “Flow (m3/s)”, the times are in “stamp” as unix_ms, counted from the first row'
    >>> words("--thousands ,"), words("--missing=-9999"), words("--time none")
    ('a comma parts thousands', '-9999 means not measured', 'there are no times: the rows are one period apart')
    """
    try:
        told = said(options)
    except ValueError:
        return ""
    found = [f"{name} is in the column “{column}”" for name, column in told.columns.items()]
    if told.time == NO_TIME:
        found.append("there are no times: the rows are one period apart")
    elif told.time:
        found.append(f"the times are in “{told.time}”{f' as {told.unit}' if told.unit else ''}")
    found += [f"{name} is a constant here" if column == NO_TIME else f"{name} is “{column}”" for name, column in told.regressors.items()]
    found += [f"{word} means not measured" for word in told.missing]
    found += [f"{name} is a known input" for name in told.inputs]
    found += [f"{name} times {factor:g}" for name, factor in told.scale.items()]
    marks = {",": "comma", ".": "point", "'": "apostrophe", " ": "blank"}
    kinds = {"skip": "blank lines are nothing", "missing": "in a blank line nothing was measured"}
    starts = {"first": "counted from the first row", "model": "counted on the model's clock"}
    for text, value in (
        (starts.get(told.t0, ""), told.t0),
        (f"the decimal mark is a {marks.get(told.decimal)}", told.decimal),
        (f"a{'n' if told.thousands == chr(39) else ''} {marks.get(told.thousands)} parts thousands", told.thousands),
        (kinds.get(told.blank, ""), told.blank),
        (f"records are named by “{told.record}”", told.record),
        (f"the period is {told.dt} s", told.dt),
        (f"the encoding is {told.encoding}", told.encoding),
        (f"{told.skip} lines above the table are no part of it", told.skip),
        (f"the sheet “{told.sheet}”", told.sheet),
    ):
        if value:
            found.append(text)
    return ", ".join(found)


def _new(options: str, present: Mapping) -> bool:
    try:
        return present.over(said(options)) != present
    except ValueError:
        return False


def _all(mapping: Mapping) -> dict[str, Any]:
    return {name: getattr(mapping, name) for name in Mapping.__dataclass_fields__}
