"""A table of data seen through for the page Data: columns, rows, how a model reads it, and what would put right why it does not."""

from __future__ import annotations

import re
from collections.abc import Mapping as Table
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ctlabs.files import clock, look, reading
from ctlabs.files.datafile import Record
from ctlabs.files.look import Column
from ctlabs.files.mapping import NO_TIME, Mapping
from ctlabs.files.modelfile import ModelFile, loads
from ctlabs.files.remedies import changing, offered, said
from ctlabs.linalg.checks import Array
from ctlabs.studies import looking
from ctlabs.text import moment, number
from ctlabs.workbench.runs.outcomes import decoded

#: Points of the small picture of a column, and columns that have one.
BINS, DRAWN = 60, 40
#: What a column is to a model: kind and name, "measurement:x".
TIME, RECORD, UNUSED = "time", "record", ""


def seen(model: str, text: str, name: str) -> dict[str, Any]:
    """A table as the model in a file's text reads it.

    Returns
    -------
    ``understood``, sentences · ``columns``, each with number, name, kind, missing, range, remarks, role, low and high of its picture ·
    ``rows`` (line, cells) of the top, the end and beside a refused line · ``refusal``, why the model cannot read it, "" if it can, with
    its ``line`` and ``column`` (0, "" where it names none) and ``remedies`` · ``options``, what the look would say of the table, and as a
    ``suggestion`` where it would help · ``read``, what was read, in sentences · ``records``, their names

    Raises
    ------
    ValueError
        What is no table.
    """
    file = decoded(loads(model, "", check=False))
    told, content = _mapping(file), text.encode()
    records, refusal = _read(file, content, name)
    line, column = _place(refusal)
    found, why = _survey(content, name, told, file.measurements)
    if found is None:
        return _unseen(content, told, refusal or why)
    clocked = records[0].clock if records else told.time or told.columns.get("t", "t")
    suggestion = next(iter(changing(found.options, told)), "")
    return {
        "understood": looking.sentences(found),
        "columns": [_column(each, _role(each, told, file, clocked)) for each in found.columns],
        "rows": look.excerpt(content, name, told, file.measurements, around=line or None),
        "remarks": list(found.remarks),
        "refusal": refusal,
        "line": line,
        "column": column,
        "remedies": list(changing(refusal, told)),
        "suggestion": suggestion if refusal else "",
        "options": found.options,
        "read": [sentence for each in records for sentence in _sentences(each)],
        "records": [each.name for each in records],
        "clock": found.clock,
        "unit": found.unit,
    }


def _mapping(file: ModelFile) -> Mapping:
    """What the model file says of tables; nothing where that is wrong."""
    try:
        return file.mapping
    except ValueError:
        return Mapping()


def _read(file: ModelFile, content: bytes, name: str) -> tuple[Sequence[Record], str]:
    """The records, or why there are none; times must fit the model, too, where it is one."""
    wrong = file.problems()
    try:
        if wrong:
            return reading.parsed([(content, name)], file.measurements, _mapping(file)), ""
        records = reading.parsed([(content, name)], file)
        for each in records:
            clock.over(file, each)
    except (ValueError, ArithmeticError) as error:
        return (), " ".join(str(error).split()).removeprefix(f"{name}: ")
    return records, ""


def _survey(content: bytes, name: str, told: Mapping, measurements: Sequence[str]) -> tuple[look.Survey | None, str]:
    """The table seen through; without what is told where that stands in the way."""
    why = ""
    for mapping in (told, Mapping(skip=told.skip), Mapping()):
        try:
            return look.survey(content, name, mapping, measurements), ""
        except ValueError as error:
            why = why or " ".join(str(error).split()).removeprefix(f"{name}: ")
    return None, why


def _unseen(content: bytes, told: Mapping, refusal: str) -> dict[str, Any]:
    """What can be shown of a table in which no columns were found."""
    line, column = _place(refusal)
    lines = content.decode().splitlines()
    around = sorted({*range(8), *range(max(line - 3, 0), line + 2)})
    return {
        "understood": [], "columns": [], "rows": [(i + 1, [lines[i][:200]]) for i in around if i < len(lines)], "remarks": [],
        "refusal": refusal, "line": line, "column": column, "remedies": list(changing(refusal, told)), "suggestion": "", "options": "",
        "read": [], "records": [], "clock": "", "unit": "",
    }  # fmt: skip


def _place(refusal: str) -> tuple[int, str]:
    """The line and the column that a refusal names.

    >>> _place('line 12, column pos [m]: "1,120" may be'), _place("expected a header row")
    ((12, 'pos [m]'), (0, ''))
    """
    found = re.search(r"\bline (\d+)(?:, column ([^:]+))?", refusal)
    return (int(found[1]), found[2] or "") if found else (0, "")


def _role(column: Column, told: Mapping, file: ModelFile, clocked: str) -> str:
    """What a column is to the model."""
    called = (column.name, str(column.number))
    if told.time != NO_TIME and clocked in called:
        return TIME
    if told.record and told.record in called:
        return RECORD
    for kind, names in (("measurement", file.measurements), ("input", told.inputs)):
        for name in names:
            if told.columns.get(name, name) in called:
                return f"{kind}:{name}"
    return next((f"regressor:{name}" for name, own in told.regressors.items() if own in called), UNUSED)


def _column(column: Column, role: str) -> dict[str, Any]:
    low, high = _picture(column.values)
    return {
        "number": column.number, "name": column.name, "kind": column.kind, "missing": column.missing, "range": look.described(column),
        "remarks": [*column.remarks], "remedies": [way for remark in column.remarks for way in offered(f"expected {remark}")],
        "role": role, "low": low if column.number <= DRAWN else [], "high": high if column.number <= DRAWN else [],
    }  # fmt: skip


def _picture(values: Array) -> tuple[list[float | None], list[float | None]]:
    """Least and greatest value in each of some parts of a column, from 0 at its least to 1 at its greatest; None where there is none."""
    there = np.isfinite(values)
    if not there.any():
        return [], []
    least, most = float(values[there].min()), float(values[there].max())
    scale = (most - least) or 1.0
    lows: list[float | None] = []
    highs: list[float | None] = []
    for part in np.array_split(values, BINS if len(values) > 2 * BINS else len(values)):
        own = part[np.isfinite(part)]
        lows.append(None if not own.size else float((own.min() - least) / scale))
        highs.append(None if not own.size else float((own.max() - least) / scale))
    return lows, highs


def _sentences(record: Record) -> list[str]:
    """What was read."""
    name = f"{record.name}: " if record.name else ""
    span = "" if record.t is None else f" from t = {moment(float(record.t[0]))} to {moment(float(record.t[-1]))} s"
    started = f", the first at {record.start}" if record.clocked and record.start else ""
    missing = f"; {number(record.missing)} missing" if record.missing else "; none is missing"
    unused = f" Not used: {', '.join(record.ignored)}." if record.ignored else ""
    told = [f"{name}{number(record.rows)} rows{span}{started}, {number(record.z.size)} values{missing}.{unused}"]
    return told + [f"{name}{note[0].upper()}{note[1:]}." for note in record.notes]


def mapped(told: Mapping, column: Table[str, Any], role: str, options: str = "") -> Mapping:
    """What is told of a table when a column is given another role; ``options``, what the look would say: how times are written.

    >>> mapped(Mapping(), {"name": "pos [m]", "number": 2}, "measurement:position").columns
    {'position': 'pos [m]'}
    """
    name, number_ = str(column["name"]), str(column["number"])
    columns = {own: other for own, other in told.columns.items() if other not in (name, number_)}
    inputs = tuple(each for each in told.inputs if told.columns.get(each, each) not in (name, number_))
    regressors = {own: other for own, other in told.regressors.items() if other not in (name, number_)}
    fields: dict[str, Any] = {"columns": columns, "inputs": inputs, "regressors": regressors}
    if told.time in (name, number_) or (not told.time and column.get("role") == TIME):
        fields |= {"time": NO_TIME, "unit": ""}
    if told.record in (name, number_):
        fields["record"] = ""
    kind, _, own = role.partition(":")
    if kind == TIME:
        own_time = said(next(iter(offered(options)), ""))
        fields |= {"time": name, "unit": ""}
        fields |= {"unit": own_time.unit, "t0": own_time.t0} if own_time.time == name else {}
    elif kind == RECORD:
        fields["record"] = name
    elif kind == "measurement":
        fields["columns"] = {**{n: c for n, c in columns.items() if n != own}, **({own: name} if own != name else {})}
    elif kind == "input":
        fields["inputs"] = (*(each for each in inputs if each != own), own)
        fields["columns"] = {**{n: c for n, c in columns.items() if n != own}, **({own: name} if own != name else {})}
    elif kind == "regressor":
        fields["regressors"] = {**regressors, own: name}
    if kind != "input" and len(inputs) != len(told.inputs):
        fields["u0"] = ()
    gone = {each for each in told.inputs if each not in fields["inputs"]}
    fields["scale"] = {each: factor for each, factor in told.scale.items() if each not in gone}
    return replace(told, **fields)
