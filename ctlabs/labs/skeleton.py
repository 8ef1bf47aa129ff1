"""The frame of a lab's report, and which functions write its parts.

Statement, aim and control questions come from the lab's sheet, the listing and the books from files beside it. A lab writes what
holds numbers: result, theory, plan, experiment, discussion, answers, conclusions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from inspect import signature
from typing import TYPE_CHECKING, Any

from ctlabs.labs.catalogue import catalogue
from ctlabs.labs.sheets import Sheet, bibliography, listing, sheet
from ctlabs.reporting.cells import cell, grid
from ctlabs.reporting.crossrefs import Places, without_places
from ctlabs.reporting.report import Block, Copy, Equation, Heading, Picture, Report, Table, Text, Value
from ctlabs.text import fill, prose, translated

if TYPE_CHECKING:
    from ctlabs.labs.experiment import Experiment
    from ctlabs.reporting.report import Parameters

#: A function that writes a section into the report, and says by name what later parts need to know.
Part = Callable[..., Mapping[str, Any] | None]
#: A function that says the result in three sentences.
Result = Callable[..., list[str]]
#: A function that answers each item of the sheet in a sentence or two, by its letter.
Answers = Callable[..., Mapping[str, str]]
#: Lists of at most so many numbers stand among the answers.
SHORT = 6


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The parts of a lab in the order of its report.

    A part is given what its arguments name: ``r``, the report; ``p``, the parameters; ``experiment``; what the lab has
    built beforehand; and what the parts before it have returned (``{"steps": 40}``, or nothing). Result and answers come last
    although they are read first or later: they may name everything.

    ``result`` : three sentences, the first of which stands for the lab in the index · ``key`` : the figure that shows it, where
    the parameters leave something to draw · ``answers`` : by letter
    """

    analysis: tuple[Part, ...]
    plan: Part
    experiment: tuple[Part, ...]
    discussion: Part
    answers: Answers
    conclusions: Part
    result: Result
    key: str

    def report(self, meta: Mapping[str, Any], p: Parameters, experiment: Experiment, **given: Any) -> Report:
        """The report of a lab, its parts run in order.

        Raises
        ------
        TypeError
            A part asks for what is neither given nor returned by a part before it.
        """
        r = Report(meta, p, experiment.runs, experiment.seed, framed=True)
        known = {"r": r, "p": p, "experiment": experiment, **given}
        asked = sheet(meta["name"]) if meta["name"] in catalogue() else None
        if asked is not None:
            r.listing, r.bibliography = listing(meta["name"]), bibliography()
            _statement(r, asked)
        first = len(r.blocks)

        def answered() -> None:
            _answers(r, called(self.answers, known))

        for name, heading, parts in (
            ("theory", "Part I. Theory", self.analysis),
            ("plan", "Plan of the experiment", (self.plan,)),
            ("experiment", "Part II. Experiment", self.experiment),
            ("discussion", "Discussion", (self.discussion,)),
            ("answers", "Answers, item by item", (answered,)),
            ("conclusions", "Conclusions", (self.conclusions,)),
        ):
            r.heading(heading, name)
            r.part = r.part if name != "plan" else ""
            for part in parts:
                known |= called(part, known) or {}
        if asked is not None and asked.questions:
            _questions(r, asked)
        sentences = [translated(each) for each in called(self.result, known)]
        r.more["result"] = without_places(sentences[0])
        copy = [Copy(self.key)] if any(isinstance(each, Picture) and each.name == self.key for each in r.blocks) else []
        r.blocks[first:first] = [Heading(translated("Result"), 2, name="result"), Text(" ".join(sentences)), *copy]
        r.blocks = numbered(r.blocks)
        return r


def called(part: Callable[..., Any], known: Mapping[str, Any]) -> Any:
    """Run a part on what it names."""
    names = list(signature(part).parameters)
    missing = [name for name in names if name not in known]
    if missing:
        msg = f"{part.__name__}: expected arguments among {sorted(known)}, received {missing}"
        raise TypeError(msg)
    return part(**{name: known[name] for name in names})


def numbered(blocks: list[Block]) -> list[Block]:
    """Figures, tables and equations numbered anew in the order in which they stand."""
    counts: dict[type, int] = {}
    found: list[Block] = []
    for block in blocks:
        if isinstance(block, Picture | Table | Equation):
            counts[type(block)] = counts.get(type(block), 0) + 1
            found.append(replace(block, number=counts[type(block)]))
        else:
            found.append(block)
    return found


def _statement(r: Report, asked: Sheet) -> None:
    """What is given and asked, the parameters by their letters, and what the lab is for."""
    r.heading("Statement", "statement")
    r.blocks.append(Text(translated(asked.statement)))
    r.blocks.append(Text("\n".join(f"- **({letter})** {translated(words)}" for letter, words in asked.items.items())))
    values = r.parameters.plain()
    symbols: dict[str, str] = getattr(r.parameters, "symbols", dict)()
    rows = [
        [
            f"${symbols.get(name, name)}$",
            cell(values[name]),
            "" if unit == "1" else translated(unit),
            translated(meaning),
        ]
        for name, unit, meaning in r.parameters.described()
    ]
    r.blocks.append(Text(translated("In this report:")))
    r.blocks.append(Text(grid([translated("symbol"), translated("value"), translated("unit"), translated("meaning")], rows)))
    if asked.aim:
        r.heading("Aim", "aim")
        r.blocks.append(Text(translated(asked.aim)))


def _answers(r: Report, answers: Mapping[str, str]) -> None:
    """Each item with its answer, its numbers, and where they come from."""
    if unknown := set(answers) ^ set(r.meta["parts"]):
        parts = ", ".join(r.meta["parts"])
        msg = f"answers: expected one for each of {parts}, received others or none for {', '.join(sorted(unknown))}"
        raise ValueError(msg)
    lines = []
    for letter in r.meta["parts"]:
        told = [
            shown
            for value in r.values.values()
            if value.part == letter and value.symbol and (shown := shown_value(value))
        ]
        numbers = f" {', '.join(told)}." if told else ""
        lines.append(f"- **({letter})** {translated(answers[letter])}{numbers} *→ {{part:{letter}}}*")
    r.blocks.append(Text("\n".join(lines)))


def shown_value(value: Value) -> str:
    """A value with its letter and unit, where it is short enough for a sentence."""
    if value.value is None or (
        isinstance(value.value, list) and (len(value.value) > SHORT or any(isinstance(x, list) for x in value.value))
    ):
        return ""
    unit = "" if value.unit == "1" else f" {value.unit}"
    return f"${value.symbol}$ = {prose(value.value)}{unit}"


def _questions(r: Report, asked: Sheet) -> None:
    r.heading("Control questions", "questions")
    said, places = translated("{question} *Answer: {place}.*"), Places(r)
    lines = [
        f"{i}. " + fill(said, question=translated(question), place=places.there(place.rstrip(".")))
        for i, (question, place) in enumerate(asked.questions, 1)
    ]
    r.blocks.append(Text("\n".join(lines)))
