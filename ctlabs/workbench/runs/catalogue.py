"""The labs for a page: statement, fields, checks of what is typed, the run in a process of its own, and its files.

Nothing here needs a page. What a person typed goes to a lab's own parameters, so that the page and the command line say the
same of it. Reports lie in the data folder, apart for every draft: ``labs/DRAFT/LAB``.
"""

from __future__ import annotations

import ast
import importlib.util
import io
import json
import re
import shutil
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlencode

from ctlabs.files.modelfile.expressions import comma_hint
from ctlabs.labs import catalogue as labs
from ctlabs.labs.sheets import Sheet
from ctlabs.labs.sheets import sheet as labs_sheet
from ctlabs.reporting.params import Validator
from ctlabs.text import number
from ctlabs.workbench.desk import plain
from ctlabs.workbench.runs import running

if TYPE_CHECKING:
    from ctlabs.files.modelfile import Entry
    from ctlabs.workbench.runs.running import Work
    from ctlabs.workbench.runs.worker import Runner, RunProgress

#: A matrix, a list and a single value, as they are typed.
Typed = str | Sequence[Sequence[str]]

#: Most runs that a page asks for; the command line has no limit.
RUNS = 10_000_000
#: Which values a field takes; "list" is one text with commas, "matrix" a grid of cells.
KINDS = ("number", "flag", "list", "matrix")
#: How the paragraph of a statement begins that gives the answer away.
ANSWER = "Expected answer"
#: The folder of the reports in the data folder.
FOLDER = "labs"
#: So many reports of a lab are kept in a draft.
KEPT = 12
#: What a lab may take, in seconds: longer than an experiment, a million runs are not unusual.
SECONDS = 3600.0
_NAME = re.compile(r"[a-z][a-z0-9_]*")
#: Style sheets for the dark, of all media or of one.
_DARK = re.compile(r"@media (?:(\w+) and )?\(prefers-color-scheme: dark\)")
_DRAFT = re.compile(r"[0-9a-f]{16}")


class Models(NamedTuple):
    """A ready model of a lab: its name in the gallery, and its title."""

    name: str
    title: str


@dataclass(frozen=True, slots=True)
class LabSheet:
    """What is told of a lab before it is run.

    ``name``, ``short`` ("7") and ``title`` · ``source`` · ``parts`` · ``runs`` · ``statement``, in paragraphs ·
    ``answer``, what is to be expected · ``variants``, such as "a" and "b*" (a star: of the control sessions) · ``models`` of the gallery ·
    ``extension``: no part of the practicum
    """

    name: str
    short: str
    title: str
    source: str
    parts: tuple[str, ...]
    runs: int
    statement: tuple[str, ...]
    answer: str
    variants: tuple[str, ...]
    models: tuple[Models, ...]
    extension: bool = False

    @property
    def asked(self) -> Sheet | None:
        """The sheet: what is given and asked, with its formulas in LaTeX; ``None`` of a lab that has none."""
        try:
            return labs_sheet(self.name)
        except (OSError, KeyError):
            return None

    @property
    def heading(self) -> str:
        """The title with the lab's number, if it has one."""
        return f"Lab {self.short}: {self.title}" if self.short.isdigit() else self.title


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter as a field of a form.

    ``kind`` one of :data:`KINDS` · ``allowed``, its range in words ("a number >= 0") · ``default`` as text, a grid of
    texts for a matrix · ``alone``, whether one number may stand where a list may · ``symbol`` in LaTeX
    """

    name: str
    unit: str
    meaning: str
    kind: str
    allowed: str
    default: Typed
    alone: bool = True
    symbol: str = ""


class Checked(NamedTuple):
    """What is typed: the values if all is well (for :func:`run_lab`), else a line for each field that is wrong.

    A problem under "" concerns several fields together.
    """

    values: dict[str, Any] | None
    problems: dict[str, str]


class LabOutcome(NamedTuple):
    """A report that has been written: what the page shows of it without opening it.

    ``checks`` as in results.json · ``parameters``, ``runs``, ``seed`` it was made with · ``seconds`` it took ·
    ``ensembles``, how many computational experiments it has · ``tables``, how many CSV tables
    """

    lab: str
    title: str
    checks: tuple[dict[str, Any], ...]
    parameters: dict[str, Any]
    runs: int
    seed: int
    seconds: float
    ensembles: int
    tables: int

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the checks that failed."""
        return tuple(check["name"] for check in self.checks if not check["passed"])

    @property
    def verdict(self) -> str:
        """In words."""
        if self.failed:
            return f"{len(self.failed)} of {len(self.checks)} checks failed"
        return f"all {len(self.checks)} checks passed" if self.checks else "no checks"


# The catalogue ----------------------------------------------------------------------------------------------------------


@cache
def sheets() -> tuple[LabSheet, ...]:
    """All labs, the practicum's first; no lab is imported."""
    return tuple(_sheet(lab) for lab in labs.catalogue().values())


def sheet(name: str) -> LabSheet:
    """The lab that is called task07, 7 or 07.

    Raises
    ------
    ValueError
        An unknown name.
    """
    wanted = labs.find([name])
    if len(wanted) != 1:
        msg = f"lab {name}: expected the name of one lab, received one of {len(wanted)}"
        raise ValueError(msg)
    return next(each for each in sheets() if each.name == wanted[0].name)


def search(words: str = "", variant: str = "") -> tuple[LabSheet, ...]:
    """The labs in which every one of ``words`` occurs; a number is that lab's. ``variant``: a letter, of that column only.

    >>> [found.short for found in search("oscillator sampling")]
    ['10']
    """
    wanted = words.lower().split()
    if len(wanted) == 1 and wanted[0].isdigit():
        short = str(int(wanted[0]))
        return tuple(each for each in sheets() if each.short == short)
    return tuple(
        each
        for each in sheets()
        if all(word in _searched(each) for word in wanted)
        and (not variant or variant in {found[0] for found in each.variants})
    )


@cache
def _searched(each: LabSheet) -> str:
    models = " ".join(f"{model.name} {model.title}" for model in each.models)
    return f"{each.name} {each.heading} {each.source} {' '.join(each.statement)} {each.answer} {models}".lower()


def _sheet(lab: labs.Lab) -> LabSheet:
    found = importlib.util.find_spec(lab.module)  # finds the file and does not run it
    text = Path(found.origin).read_text(encoding="utf-8") if found is not None and found.origin else ""
    tree = ast.parse(text)
    paragraphs = [" ".join(part.split()) for part in (ast.get_docstring(tree) or "").split("\n\n")[1:]]
    statement = [part.removeprefix(f"Source: {lab.source}. ") for part in paragraphs]
    answer = [part.removeprefix(ANSWER).lstrip(":, ") for part in statement if part.startswith(ANSWER)]
    starred = {letter: dict(labs.variant(letter)) for letter in labs.VARIANTS}
    variants = tuple(f"{letter}{'*' if own[lab.name] else ''}" for letter, own in starred.items() if lab.name in own)
    models = tuple(Models(entry.name, entry.title) for entry in _gallery() if entry.lab == lab.name)
    return LabSheet(
        lab.name,
        lab.short,
        lab.title,
        lab.source,
        lab.parts,
        lab.runs,
        tuple(part for part in statement if not part.startswith(ANSWER)),
        " ".join(answer),
        variants,
        models,
        lab.extension,
    )


def _gallery() -> tuple[Entry, ...]:
    from ctlabs.files.modelfile import gallery

    return gallery()


# What is typed ----------------------------------------------------------------------------------------------------------


@cache
def fields(name: str) -> tuple[Parameter, ...]:
    """The fields of a lab, in its order; its module is imported here."""
    parameters = labs.load(labs.catalogue()[name]).Parameters
    told, defaults, symbols = parameters.model_fields, parameters(), parameters.symbols()
    return tuple(
        replace(_field(field, unit, meaning, told[field], getattr(defaults, field)), symbol=symbols.get(field, ""))
        for field, unit, meaning in defaults.described()
    )


def _field(name: str, unit: str, meaning: str, info: Any, default: Any) -> Parameter:
    told = next(each.func for each in info.metadata if isinstance(getattr(each, "func", None), Validator))
    kind, text = "number", typed_as(default)
    if isinstance(default, bool):
        kind = "flag"
    elif isinstance(default, tuple):
        kind = "matrix" if isinstance(text, tuple) else "list"
    return Parameter(name, unit, meaning, kind, told.allowed, text, told.each is None)


def typed_as(value: Any) -> Typed:
    """A parameter as it is typed: a list with commas, a matrix cell by cell."""
    if not isinstance(value, list | tuple):
        return value if isinstance(value, str) else _text(value)
    if value and isinstance(value[0], list | tuple):
        return tuple(tuple(str(typed_as(x)) for x in row) for row in value)
    return ", ".join(str(typed_as(x)) for x in value)


def _text(value: Any) -> str:
    """A value as it is typed: 1000000 and not 1e+06, inf, true, nothing where it follows others."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    found = float(value)
    return str(int(found)) if found.is_integer() and abs(found) < 1e16 else repr(found)


def check(name: str, typed: Mapping[str, Typed]) -> Checked:
    """Check all fields of a lab; what is left out has its default.

    A number may be typed as an expression: "pi/2", "1/3", "1e-4^2". An empty field has its default.

    >>> check("task07", {"Q": "0.3^2", "R": "-1", "K_star": "half"}).problems
    {'R': 'expected a number > 0, received -1', 'K_star': 'expected a number from 0 to 1, received "half"'}
    """
    from pydantic import ValidationError

    known = {field.name: field for field in fields(name)}
    unknown = [key for key in typed if key not in known]
    if unknown:
        return Checked(None, {unknown[0]: f"expected one of {', '.join(known)}, received an unknown name"})
    raw = {key: _value(known[key], text) for key, text in typed.items()}
    parameters = labs.load(labs.catalogue()[name]).Parameters
    try:
        found = parameters(**{key: value for key, value in raw.items() if value is not None})
    except ValidationError as error:
        problems: dict[str, str] = {}
        for each in error.errors(include_url=False):
            line = " ".join(each["msg"].removeprefix("Value error, ").split())
            name_first, _, rest = line.partition(": ")
            key = str(each["loc"][0]) if each["loc"] else name_first if name_first in known else ""
            problems.setdefault(key, (rest if not each["loc"] and key else line) + _hint(raw.get(key)))
        return Checked(None, problems)
    return Checked(found.plain(), {})


def _hint(value: Any) -> str:
    """What to write instead of a number that was refused for its comma."""
    values = value if isinstance(value, list) else [value]
    cells = [cell for each in values for cell in (each if isinstance(each, list) else [each])]
    return next(filter(None, (comma_hint(cell) for cell in cells if isinstance(cell, str))), "")


def _value(field: Parameter, text: Typed) -> Any:
    """What was typed as the parameters take it; the text itself where it is no number, so that they say so."""
    if not isinstance(text, str):
        return [[_number(cell) for cell in row] for row in text]
    stripped = text.strip()
    if not stripped:
        return None
    if field.kind == "flag":
        return {"true": True, "false": False}.get(stripped.lower(), stripped)
    if field.kind == "list":
        bare = stripped.strip("[]()")
        # Beside semicolons, commas are decimal ones.
        parts = bare.split(";") if ";" in bare else bare.split(",") if "," in bare else bare.split()
        # A number alone is allowed where a list is; the parameter knows.
        return [_number(part) for part in parts] if len(parts) > 1 or stripped[0] in "[(" else _single(field, parts)
    return _number(stripped)


def _single(field: Parameter, parts: Sequence[str]) -> Any:
    value = _number(parts[0])
    return value if field.alone else [value]


def _number(text: str) -> Any:
    """The number that a text is; the text itself where it is none, so that the parameters say so.

    >>> _number("1e4"), _number("-0,5"), _number("2,5e-3"), _number("pi/2 "), _number("1,000,000")
    (10000, -0.5, 0.0025, 1.5707963267948966, '1,000,000')
    """
    stripped = text.strip()
    digits = plain.plainly(stripped)
    if re.fullmatch(r"[+-]?[0-9]{1,300}", digits):
        return int(digits)
    try:
        value = plain.number(stripped)
    except ValueError:
        return stripped
    if value == float("inf"):
        return "inf"
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def _quoted(text: str) -> str:
    return json.dumps(text if len(text) <= 40 else f"{text[:39]}…", ensure_ascii=False)


def model_with(name: str, lab: str, typed: Mapping[str, Typed]) -> tuple[str, tuple[str, ...]]:
    """A lab's ready model with what is typed in the lab's fields, and which of its constants that changed.

    A field and a constant belong together where they have the same name; what is no number stays as it is in the model.
    """
    from ctlabs.files.modelfile import ready

    file, changes = ready(name), []
    for field in fields(lab):
        text = typed.get(field.name, field.default)
        if field.kind != "number" or not isinstance(text, str) or field.name not in file.constants:
            continue
        value = _number(text)
        if isinstance(value, int | float) and value != file.constants[field.name] and value != _number(str(field.default)):
            changes.append((field.name, value))
    made = file.edit_all([(("constants", key), value) for key, value in changes])
    return made.dumps(), tuple(key for key, _ in changes)


def address(lab: str, typed: Mapping[str, Typed], runs: str = "", seed: str = "") -> str:
    """The part of an address that leads to a lab with values in its fields: what is the default is left out.

    >>> address("task07", {field.name: field.default for field in fields("task07")} | {"R": "4"}, "1000", "2")
    'lab=task07&R=4&runs=1000&seed=2'
    """
    known = {field.name: field for field in fields(lab)}
    told = {
        key: text if isinstance(text, str) else json.dumps(text)
        for key, text in typed.items()
        if key in known and _plainly(text) != _plainly(known[key].default)
    }
    rest = {"runs": runs, "seed": seed}
    return urlencode({"lab": lab, **told, **{key: value for key, value in rest.items() if value}})


def from_address(lab: str, told: Mapping[str, str]) -> dict[str, Any]:
    """What :func:`address` put into an address, as a form takes it; names that the lab does not have are passed over."""
    found: dict[str, Any] = {}
    for field in fields(lab):
        text = told.get(field.name)
        if text is None:
            continue
        if field.kind != "matrix":
            found[field.name] = text[:400]
            continue
        try:
            rows = [[str(cell) for cell in row] for row in json.loads(text)]
        except (ValueError, TypeError):
            continue
        if [len(row) for row in rows] == [len(row) for row in field.default]:
            found[field.name] = rows
    if found or {"runs", "seed"} & told.keys():
        found |= {"": [told.get("runs", str(sheet(lab).runs))[:30], told.get("seed", "1")[:30]]}
    return found


def _plainly(text: Typed) -> Any:
    return text.strip() if isinstance(text, str) else [list(row) for row in text]


# The run ---------------------------------------------------------------------------------------------------------------


def run_lab(
    name: str,
    values: Mapping[str, Any],
    runs: int,
    seed: int,
    folder: str,
    workers: int = 1,
    expected: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> int:
    """Run a lab and write its report into a folder; how many computational experiments it has.

    Parameters
    ----------
    name, values : the lab, and its parameters as :func:`check` gives them
    runs, seed, workers : of its experiments
    folder : the report's place, replaced as a whole when the run is complete
    expected : how many experiments it will have, if that is known; without it ``progress`` is told no total
    progress : function of (runs done, runs in all or 0)

    Raises
    ------
    ValueError
        Parameters out of range.
    ArithmeticError
        They are allowed, but the numbers leave the range of double precision.
    """
    from ctlabs.labs.experiment import Experiment
    from ctlabs.reporting import render

    start, lab, ensembles = time.perf_counter(), labs.catalogue()[name], 0

    def tell(ensemble: int, done: int) -> None:
        nonlocal ensembles
        ensembles = max(ensembles, ensemble + 1)
        if progress is not None:
            progress(ensemble * runs + done, max(expected, ensembles) * runs if expected else 0)

    experiment = Experiment(runs, seed, workers, progress=tell)
    report = labs.run(lab, labs.load(lab).Parameters.parse(name, values), experiment)
    tell(ensembles - 1, runs)  # the last chance to be cancelled: what follows is written
    report.files["run.json"] = json.dumps({"seconds": time.perf_counter() - start, "ensembles": ensembles}).encode()
    render.write(report, Path(folder))
    return ensembles


def work(runner: Runner, draft: str, name: str, values: Mapping[str, Any], runs: int, seed: int, folder: Path) -> Work:
    """The run of a lab for :meth:`ctlabs.workbench.runs.running.Running.start`: in another process, its report into a new
    folder beside those of the runs before (:func:`kept`), of which the oldest make room.
    """
    earlier = kept(folder)
    before = outcome(earlier[-1]) if earlier else None
    following = int(earlier[-1].name) + 1 if earlier and earlier[-1] != folder else 1
    for old in earlier[: max(len(earlier) - KEPT + 1, 0)]:
        if old != folder:
            shutil.rmtree(old, ignore_errors=True)
    arguments = {
        "name": name,
        "values": dict(values),
        "runs": runs,
        "seed": seed,
        "folder": str(folder / str(following)),
        # Another number of computational experiments is possible with other parameters: then the rest is not known.
        "expected": before.ensembles if before is not None else 0,
    }
    return lambda progress, cancel: runner.run(
        "lab", arguments, session=draft, progress=progress, cancel=cancel, seconds=SECONDS
    )


def said(progress: RunProgress | None, runs: int) -> str:
    """How far a lab's run is, in words: every experiment has so many ``runs``.

    >>> from ctlabs.workbench.runs.worker import RunProgress
    >>> said(RunProgress(0.25, 500.0, 2400, 8000), 1000)
    'Experiment 3 of 8: 400 of 1 000 runs, 11 s left'
    >>> said(RunProgress(0.0, 500.0, 400, 0), 1000), said(RunProgress(1.0, 500.0, 8000, 8000), 1000)
    ('Experiment 1: 400 of 1 000 runs', 'All experiments are complete. Writing the report…')
    >>> said(RunProgress(0.0, 500.0, 3000, 0), 1000)
    '3 experiments are complete. Computing what follows from them, or writing the report…'
    """
    if progress is None or progress.ahead or not progress.done or runs < 1:
        return running.said(progress)
    complete, within = divmod(progress.done, runs)
    known = progress.total // runs
    if known and complete >= known:
        return "All experiments are complete. Writing the report…"
    if not within:
        words = "1 experiment is complete" if complete == 1 else f"{complete} experiments are complete"
        return f"{words}. Computing what follows from them, or writing the report…"
    of = f" of {known}" if known else ""
    left = "" if progress.left is None or not known else f", {running.spaced(progress.left)} s left"
    return f"Experiment {complete + 1}{of}: {running.spaced(within)} of {running.spaced(runs)} runs{left}"


# The files -------------------------------------------------------------------------------------------------------------


def place(data: Path, draft: str, name: str) -> Path:
    """The folder of a draft's report on a lab.

    Raises
    ------
    ValueError
        What is no draft's id or no lab's name: a path is made of nothing else.
    """
    if not _DRAFT.fullmatch(draft) or not _NAME.fullmatch(name) or name not in labs.catalogue():
        msg = f"report: expected a draft and a lab, received {_quoted(draft)} and {_quoted(name)}"
        raise ValueError(msg)
    return data / FOLDER / draft / name


def kept(folder: Path) -> list[Path]:
    """The folders of a lab's reports in one draft, the latest last; one that lies there without a number is the first."""
    numbered = sorted((each for each in folder.glob("[0-9]*") if each.name.isdigit()), key=lambda each: int(each.name))
    return [each for each in (folder, *numbered) if (each / "results.json").is_file()]


def compared(a: LabOutcome, b: LabOutcome) -> list[tuple[str, str, str]]:
    """How two runs of a lab differ: parameters, runs and seed that differ, then all checks; what, in the first, in the second."""
    first, second = ({**each.parameters, "runs": each.runs, "seed": each.seed} for each in (a, b))
    rows = [
        (name, _cell(first.get(name)), _cell(second.get(name)))
        for name in dict.fromkeys((*first, *second))
        if first.get(name) != second.get(name)
    ]
    found = [{check["name"]: check for check in each.checks} for each in (a, b)]
    for name in dict.fromkeys((*found[0], *found[1])):
        cells = [_checked(each.get(name)) for each in found]
        rows.append((name, cells[0], cells[1]))
    return rows


def _cell(value: Any) -> str:
    typed = typed_as(value)
    return typed if isinstance(typed, str) else "; ".join(", ".join(row) for row in typed)


def _checked(check: dict[str, Any] | None) -> str:
    if check is None:
        return "—"
    return number(check["value"]) + ("" if check["passed"] else " (failed)")


def outcome(folder: Path) -> LabOutcome | None:
    """What came of the run whose report lies in a folder; ``None`` if there is none."""
    try:
        told = json.loads((folder / "results.json").read_text(encoding="utf-8"))
        took = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        return LabOutcome(
            told["lab"],
            told["title"],
            tuple(told["checks"]),
            told["parameters"],
            told["runs"],
            told["seed"],
            took["seconds"],
            took["ensembles"],
            len(list((folder / "tables").glob("*.csv"))),
        )
    except (OSError, ValueError, KeyError, TypeError):  # none, or one that is just being replaced
        return None


def tables(folder: Path) -> bytes:
    """The report's CSV tables in one ZIP file, without dates: the same tables give the same bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted((folder / "tables").glob("*.csv")):
            archive.writestr(zipfile.ZipInfo(path.name, (1980, 1, 1, 0, 0, 0)), path.read_bytes(), zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def page(folder: Path, theme: str = "auto") -> str:
    """The report's HTML in the page's colours: "light", "dark", or the browser's own ("auto")."""
    return themed((folder / "report.html").read_text(encoding="utf-8"), theme)


def themed(text: str, theme: str = "auto") -> str:
    """A page of ours in the workbench's colours: its style sheets, which follow the browser's own, follow these."""
    head, end, body = text.partition("</head>")
    if theme in ("light", "dark"):
        head = _DARK.sub(lambda found: f"@media {found[1] or 'all' if theme == 'dark' else 'not all'}", head)
    scheme = {"light": "light", "dark": "dark"}.get(theme, "light dark")
    return head.replace("color-scheme: light dark", f"color-scheme: {scheme}", 1) + end + body


def tidy(data: Path, known: Callable[[str], bool]) -> None:
    """Remove the reports of drafts that are no more (``known`` says which are)."""
    root = data / FOLDER
    if root.is_dir():
        for folder in root.iterdir():
            if _DRAFT.fullmatch(folder.name) and not known(folder.name):
                shutil.rmtree(folder, ignore_errors=True)
