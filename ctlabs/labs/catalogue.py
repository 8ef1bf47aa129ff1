"""The catalogue of labs: finds the scripts in ``tasks/``, checks parameters, runs.

A script's META is read without importing it, so that ``ctlabs list`` is instant.
"""

from __future__ import annotations

import ast
import difflib
import importlib
import importlib.util
import re
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ctlabs.labs.experiment import Experiment
    from ctlabs.reporting.params import LabParameters
    from ctlabs.reporting.report import Report

#: Table 2 of the practicum: the labs of each variant's two parts; a star marks the labs of the control sessions.
VARIANTS = {
    "a": ("1 2* 5 7* 9* 10", "11* 15* 18 19 20* 23"),
    "b": ("1 3* 5 6* 8* 10", "12* 16* 18 19 22* 23"),
    "c": ("1* 4* 5 9 10 13*", "14* 17* 18 19 21* 23"),
}


@dataclass(frozen=True, slots=True)
class Lab:
    """An entry of the catalogue: the script's META and its module's name; ``extension``: neither in the practicum nor in a paper of its."""

    name: str
    title: str
    source: str
    parts: tuple[str, ...]
    runs: int
    module: str
    extension: bool = False

    @property
    def short(self) -> str:
        """What a person types: 7 for task07, the name itself for the others."""
        return str(int(self.name[4:])) if re.fullmatch(r"task\d+", self.name) else self.name


def folder() -> Path:
    """Where the labs' scripts, answers and sheets lie."""
    spec = importlib.util.find_spec("ctlabs.tasks")
    if spec is None or not spec.submodule_search_locations:
        msg = "labs: expected the package ctlabs.tasks (`pip install -e .` in a checkout), received none"
        raise RuntimeError(msg)
    return Path(next(iter(spec.submodule_search_locations)))


@cache
def catalogue() -> dict[str, Lab]:
    """All labs by name: the practicum's, those after papers, the extensions."""
    found = [_lab(path) for path in folder().glob("[a-z]*.py")]
    for lab in found:
        if sum(other.name == lab.name for other in found) > 1:
            msg = f"labs: expected one script for {lab.name}, received several"
            raise RuntimeError(msg)
    return {lab.name: lab for lab in sorted(found, key=_place)}


def _place(lab: Lab) -> tuple[bool, bool, str]:
    return lab.extension, not lab.name.startswith("task"), lab.name


def _lab(path: Path) -> Lab:
    literal = re.search(r"^META = (\{.*?^\})", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    if literal is None:
        msg = f"{path.name}: expected META = {{…}} at the beginning of a line, closed by a line of its own, received none"
        raise ValueError(msg)
    meta = ast.literal_eval(literal[1])
    return Lab(
        meta["name"],
        meta["title"],
        meta["source"],
        tuple(meta["parts"]),
        meta.get("runs", 1000),
        f"ctlabs.tasks.{path.stem}",
        meta.get("extension", False),
    )


def halves(letter: str) -> list[list[tuple[str, bool]]]:
    """The two parts of a column of the practicum's table 2: its labs, and whether each is one of the control session's."""
    return [[(f"task{int(word.rstrip('*')):02d}", word.endswith("*")) for word in half.split()] for half in VARIANTS[letter]]


def variant(letter: str) -> list[tuple[str, bool]]:
    """The labs of both parts."""
    return [each for half in halves(letter) for each in half]


def find(words: Iterable[str]) -> list[Lab]:
    """The labs that ``words`` name (7, 07, task07, field, all, variant-a), each once, in the order given."""
    chosen: dict[str, Lab] = {}
    for word in words:
        for name in _names(word):
            chosen.setdefault(name, catalogue()[name])
    return list(chosen.values())


def _names(word: str) -> list[str]:
    labs, lower = catalogue(), word.lower()
    if lower == "all":
        return list(labs)
    if lower.startswith("variant-") and lower[8:] in VARIANTS:
        return [name for name, _ in variant(lower[8:]) if name in labs]
    number = re.fullmatch(r"(?:task)?0*(\d+)", lower)
    name = f"task{int(number[1]):02d}" if number else lower
    if name not in labs:
        known = [*(lab.short for lab in labs.values()), *labs, "all", *(f"variant-{v}" for v in VARIANTS)]
        raise ValueError(
            f"lab {word}: expected one of {_some(word, known, [lab.short for lab in labs.values()])}, received an unknown name"
        )
    return [name]


def _some(word: str, known: Sequence[str], shown: Sequence[str]) -> str:
    close = difflib.get_close_matches(word, known, n=3, cutoff=0.5)
    return f"{', '.join(shown)}" + (f" (did you mean {' or '.join(close)}?)" if close else "")


def load(lab: Lab) -> Any:
    """The lab's module."""
    return importlib.import_module(lab.module)


def by_hand(name: str) -> Any:
    """The answers by hand of the lab ``name``, the second route of its report."""
    return importlib.import_module(f"{catalogue()[name].module.rpartition('.')[0]}.answers.{name}")


def parameters(labs: Sequence[Lab], settings: Mapping[str, object]) -> dict[str, LabParameters]:
    """The parameters of each lab, with ``settings`` (NAME or LAB.NAME → value) given to every chosen lab that has them.

    Raises
    ------
    ValueError
        A name that no chosen lab has, or a value out of its range; nothing has been computed by then.
    """
    own: dict[str, dict[str, object]] = {lab.name: {} for lab in labs}
    classes = {lab.name: load(lab).Parameters for lab in labs}
    for key, value in settings.items():
        place, _, name = key.rpartition(".")
        targets = [
            lab.name for lab in labs if (not place or lab in find([place])) and name in classes[lab.name].model_fields
        ]
        if not targets:
            names = sorted({field for parameters_class in classes.values() for field in parameters_class.model_fields})
            labs_text = ", ".join(lab.name for lab in labs)
            raise ValueError(
                f"{labs_text}: parameter {key}: expected one of {_some(name, names, names)}, received an unknown name"
            )
        for target in targets:
            own[target][name] = value
    return {lab.name: classes[lab.name].parse(lab.name, own[lab.name]) for lab in labs}


def run(lab: Lab, values: LabParameters, experiment: Experiment) -> Report:
    """Compute a lab's report; nothing is written.

    Raises
    ------
    ArithmeticError
        The parameters are allowed, but the numbers leave the range of double precision.
    """
    try:
        with replace(experiment, name=lab.name).with_workers() as own:
            return load(lab).report(values, own)
    except (OverflowError, FloatingPointError) as error:
        msg = (
            f"{lab.name}: expected parameters for which all numbers stay finite, received an overflow: {error.args[-1]}"
        )
        raise ArithmeticError(msg) from error


def around(lab: Lab, there: Collection[str]) -> dict[str, tuple[str, str]]:
    """Addresses and titles of the labs before and after one and of the index, as seen from its folder.

    A lab that is not ``there`` has its place in the index.
    """
    order, found = list(catalogue().values()), {"index": ("../index.html", "All labs")}
    names = [each.name for each in order]
    at = names.index(lab.name) if lab.name in names else len(order)
    for way, i in (("previous", at - 1), ("next", at + 1)):
        if 0 <= i < len(order) and at < len(order):
            other = order[i]
            address = f"../{other.name}/report.html" if other.name in there else f"../index.html#{other.name}"
            found[way] = (address, f"Lab {other.short}" if other.short.isdigit() else other.title)
    return found


def run_and_write(lab: Lab, values: LabParameters, experiment: Experiment, out: Path, beside: Collection[str] = ()) -> dict[str, Any]:
    """Run a lab, write its folder, and say how it went: name, number of checks, failed checks, seconds.

    ``beside`` : names of labs that are being written with it; their pages and it lead to each other
    """
    from ctlabs.reporting import render

    start = time.perf_counter()
    report = run(lab, values, experiment)
    report.around = around(lab, {*beside, *(path.parent.name for path in out.glob("*/results.json"))})
    render.write(report, out / lab.name)
    failed = [check.name for check in report.checks if not check.passed]
    return {"lab": lab.name, "checks": len(report.checks), "failed": failed, "seconds": time.perf_counter() - start}
