"""What was found, in words: rows by their names first, then R, Qd and what else is wrong with the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ctlabs.analysis.diagnosis.candidates import Candidate, Event
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, number

#: How a row of a record, counted from 0, is called.
Where = Callable[[int], str]
#: Events, and rows of one event, that are named; the others are counted.
NAMED = 5
#: Kinds of changes that are about rows or the start, and are told before those of R and Qd.
FIRST = ("outlier", "break", "stuck", "start")


def by_number(row: int) -> str:
    """A row by its number."""
    return fill(_("row {row}"), row=row)


def sentence(model: DiscreteModel, change: Candidate, candidates: Sequence[Candidate], where: Where) -> str:
    """A change in words, and another one that the record hardly tells from it."""
    text = _words(model, change, where)
    if change.events:
        return text
    others = [c for c in candidates if not c.events and c.kind not in (change.kind, "start")]
    rivals = [c for c in others if len(c.size) == 1 == len(change.size)]
    rival = max(rivals, key=lambda c: c.gain, default=None)
    if rival is not None and rival.gain > change.gain - 4.0:
        text += fill(_(" (hardly to be told from: {other})"), other=_words(model, rival, where))
    return text


def _words(model: DiscreteModel, change: Candidate, where: Where) -> str:
    if change.events:
        told = [event_words(model, event, where) for event in sorted(change.events, key=lambda e: -e.sigmas)[:NAMED]]
        if len(change.events) > NAMED:
            told.append(fill(_("{count} more such events"), count=len(change.events) - NAMED))
        return "; ".join(told)
    if change.kind == "start":
        return _start(model, change)
    if change.kind == "bias":
        name = model.measurements[change.place]
        return fill(
            _("{name} has a bias of about {size}, or a constant is missing in the model"),
            name=name,
            size=brief(change.size[0]),
        )
    if change.kind == "wander":
        name, unit = model.states[change.place], model.units[change.place]
        text = _("{name} wanders, though Qd says that it does not: by about {size} per step (a variance of {variance})")
        size = f"{brief(float(np.sqrt(change.size[0])))} {unit}".strip()
        return fill(text, name=name, size=size, variance=brief(change.size[0]))
    if change.kind == "input":
        name, unit = model.states[change.place], model.units[change.place]
        size = f"{brief(change.size[0])} {unit}".strip()
        return fill(_("a drift is missing: a constant of about {size} enters {name} every step"), size=size, name=name)
    named = zip(change.kind.split(" and "), change.size, strict=True)
    return _(" and ").join(_factor(name, size) for name, size in named)


def event_words(model: DiscreteModel, event: Event, where: Where) -> str:
    """An event, with its rows and its numbers."""
    if event.kind == "break":
        text = _("{name} jumps by about {size} before {row} ({sigmas} σ)")
        values = {"name": model.states[event.place], "size": number(event.size, 3)}
        return fill(text, row=where(event.rows[0]), sigmas=brief(event.sigmas), **values) + _rival(model, event)
    name, value = model.measurements[event.place], shown(event.value)
    if event.kind == "stuck":
        text = _("{name} is stuck at {value} from {begin} to {end}: {count} equal values, which chance all but excludes")
        return fill(text, name=name, value=value, begin=where(event.rows[0]), end=where(event.rows[-1]), count=len(event.rows))
    if len(event.rows) > 1 or conventional(event.value):
        text = _("{name} is {value} in {rows}, {sigmas} σ from what the others suggest: it looks like a missing value (--missing {value})")
        if len(event.rows) > 1:
            text = text.replace("{rows}", _("{count} rows ({rows})"))
        named = ", ".join(where(row) for row in event.rows[:NAMED])
        if len(event.rows) > NAMED:
            named += fill(_(" and {count} more"), count=len(event.rows) - NAMED)
        return fill(text, name=name, value=value, count=len(event.rows), rows=named, sigmas=brief(event.sigmas))
    text = _("{name} = {value} in {row} is an outlier, {sigmas} σ from the {expected} that the other rows suggest")
    values = {"name": name, "value": value, "row": where(event.rows[0]), "expected": number(event.value - event.size)}
    return fill(text, sigmas=brief(event.sigmas), **values) + _rival(model, event)


def _rival(model: DiscreteModel, event: Event) -> str:
    if event.rival is None:
        return ""
    if event.rival.kind == "outlier":
        return fill(_(" (or {name} is an outlier there)"), name=model.measurements[event.rival.place])
    text = _(" (or {name} jumps there, by about {size})")
    return fill(text, name=model.states[event.rival.place], size=number(event.rival.size, 3))


def _start(model: DiscreteModel, change: Candidate) -> str:
    """The initial estimate beside the one that the record suggests, for the states that differ by more than a σ of P0."""
    shift, sd = np.array(change.size), np.sqrt(model.P0.diagonal())
    told = np.flatnonzero(np.abs(shift) > np.where(sd > 0, sd, 0.0))
    told = told if told.size else np.array([int(np.argmax(np.abs(shift) / np.where(sd > 0, sd, 1.0)))])
    text = _("{name} about {value}, where x0 and P0 say {x0} ± {sd}")
    values, x0 = (model.x0 + shift).tolist(), model.x0.tolist()
    parts = [
        fill(text, name=model.states[j], value=number(values[j], 3), x0=number(x0[j]), sd=brief(float(sd[j])))
        for j in told.tolist()[:NAMED]
    ]
    return fill(
        _("the initial estimate is far from the record, which suggests {parts}: widen P0 (inf where nothing is known at the start)"),
        parts=", ".join(parts),
    )


def _factor(name: str, factor: float) -> str:
    if factor < 1e-6:
        return fill(_("{name} too large (the record is most likely without it)"), name=name)
    text = _("{name} too small by about a factor {by}") if factor > 1 else _("{name} too large by about a factor {by}")
    return fill(text, name=name, by=brief(max(factor, 1 / factor)))


def conventional(value: float) -> bool:
    """Whether a number is one that programs write for "not measured": nines, or the end of a computer's range.

    >>> [conventional(v) for v in (-9999.0, 99.99, 32767.0, 58.77, 9.0, 1e20)]
    [True, True, True, False, False, True]
    """
    digits = repr(abs(value)).removesuffix(".0").replace(".", "")
    ends = (32767, 32768, 65535, 65536, 2147483647, 2147483648, 4294967295, 1e20, 1e30, 1e35)
    return (len(digits) > 1 and set(digits) == {"9"}) or abs(value) in ends


def shown(value: float) -> str:
    """A measured value with the digits that it was written with.

    >>> shown(-9999.0), shown(58.77), shown(0.1 + 0.2)
    ('-9999', '58.77', '0.3')
    """
    return f"{value:.12g}"


def brief(value: float) -> str:
    """Two digits: what is estimated from one record has no more."""
    return number(value, 2)
