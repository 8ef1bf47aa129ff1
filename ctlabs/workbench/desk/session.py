"""A session: one draft of a model with its history, its experiments, and what is kept; everything but the page.

    session = Session(draft, store=store, runner=runner)
    session.do(EditCell(("model", "F", 0, 1), "-w^2"))      # saved when it returns
    session.undo()
    session.sheet.grids["F"].rows[0][1].problem             # 'unknown name "w"; …'
    session.understand().limit                              # a result, or the reason why there is none
    outcome = await session.run(progress=show, cancel=event)

Every edit is a revision in the store before :meth:`Session.do` returns; a session can be made again from its draft at any
time and is then the same. Errors are ``ValueError`` in one line and change nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import threading
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ctlabs.files.datafile import Record
from ctlabs.files.modelfile import ModelFile, loads, new
from ctlabs.studies.understanding import Understanding, compute
from ctlabs.workbench.desk import commands
from ctlabs.workbench.desk.commands import Command
from ctlabs.workbench.desk.courses import CourseDesk
from ctlabs.workbench.desk.loops import LoopDesk
from ctlabs.workbench.desk.records import RecordDesk
from ctlabs.workbench.desk.sheet import ModelSheet
from ctlabs.workbench.desk.store import REVISIONS, Edited
from ctlabs.workbench.desk.view import View
from ctlabs.workbench.runs import comparing
from ctlabs.workbench.runs.comparing import Difference
from ctlabs.workbench.runs.outcomes import REGISTERED, Asked, Outcome, Upload, outcome, packed
from ctlabs.workbench.runs.running import Running
from ctlabs.workbench.runs.summaries import KINDS, Summary

if TYPE_CHECKING:
    from ctlabs.workbench.desk.store import Draft, KeptExperiment, Store
    from ctlabs.workbench.runs.worker import Cancel, Runner, RunProgress

log = logging.getLogger("ctlabs.workbench")

#: Models with a longer text are edited in a thread.
LARGE = 12_000
#: Longest name of an experiment.
LONGEST = 120
#: The commands that put a model in the place of another.
BEGINS: Mapping[type, str] = {commands.Open: "open", commands.New: "new"}


@dataclass(frozen=True, slots=True)
class HistoryStep:
    """One entry of the history: what was done, whether the model is at it or behind it (``done``), and whether it put another
    model in the place of the one before (``begins``: "open" or "new").
    """

    number: int
    label: str
    done: bool
    begins: str = ""


class Session:
    """One draft on the desk.

    Parameters
    ----------
    draft : of the store; its text may be empty (a small model to begin with is then shown)
    store : where everything is saved
    runner : processes for long runs; without one :meth:`run` computes in a thread
    """

    def __init__(self, draft: Draft, *, store: Store, runner: Runner | None = None) -> None:
        self.draft, self.store, self.runner = draft, store, runner
        #: Held by whoever edits: a large model is edited in a thread.
        self.turn = threading.RLock()
        self._sheet: ModelSheet | None = None
        self._understanding: Understanding | None = None
        self._read(draft)
        noted = draft.notes.get("plan")
        self.plan = replace(Asked(), **_told(self.file)) if noted is None else self._plan(noted)
        self._parsing: tuple[tuple[Upload, ModelFile | tuple[str, ...]], Record] | None = None
        #: The revisions that put a model in the place of another, and how.
        self._begun: dict[int, str] = dict(draft.notes.get("begun", ()))
        self._plans: dict[int, Asked] = {}  # the plans of the models that were on the desk before, by these revisions
        #: The number of the experiment that :attr:`result` is kept as.
        self.result_id: int | None = draft.notes.get("result")
        self._result: Outcome | None = None
        #: The run of an experiment and that of a lab, which all tabs of the draft see.
        self.experiment_run, self.lab_run = Running(), Running()
        #: The measured data: the table, its filtering, its fits.
        self.records = RecordDesk(self)
        #: The regulator: its ensemble, its curves.
        self.loops = LoopDesk(self)
        #: The course that is open on this machine.
        self.courses = CourseDesk(self)
        #: Which part of the results is looked at: it is shown again after the next run.
        self.part = ""
        #: Texts that could not be saved, by matrix and cell: they stay when another page is shown.
        self.refused: dict[str, dict[str, tuple[str, str, str]]] = {}
        #: How the figures of the results are looked at.
        self.view = View()

    def _read(self, draft: Draft) -> None:
        """Take what the store has of the draft."""
        self.draft = draft
        self._revisions = [(each.number, each.label) for each in self.store.history(draft.id)]
        self._at = next(i for i, (number, _) in enumerate(self._revisions) if number == draft.number)
        self._set(_file(draft.text), draft.text)

    def again(self) -> bool:
        """Read the draft again if another server on the same folder has edited it; whether one has."""
        with self.turn:
            found = self.store.draft(self.draft.id)
            if found is None or found.number == self._revisions[self._at][0]:
                return False
            self._read(found)
            self._begun = dict(found.notes.get("begun", ()))
            return True

    def take_notices(self) -> tuple[str, ...]:
        """What whoever opens the draft has to be told, once."""
        interrupted = bool(self.draft.notes.get("running")) and not self.experiment_run.running
        if interrupted:
            self.draft.notes.pop("running")
            self._running(going=False)
        line = "run: the one that went on when the workbench ended was interrupted; Run on the page Experiment starts it again"
        return (line,) if interrupted else ()

    @classmethod
    def begin(cls, store: Store, owner: str = "local", text: str = "", *, runner: Runner | None = None) -> Session:
        """A session with a new draft."""
        return cls(store.new_draft(owner, owner, text), store=store, runner=runner)

    @classmethod
    def resume(cls, store: Store, draft: str, *, runner: Runner | None = None) -> Session:
        """The session of a draft, as it was left."""
        found = store.draft(draft)
        if found is None:
            msg = f"draft {draft}: expected one that is kept, received an unknown id"
            raise ValueError(msg)
        return cls(found, store=store, runner=runner)

    @property
    def large(self) -> bool:
        """Whether an edit takes long enough to be made in a thread."""
        return len(self._text) > LARGE

    def prepare(self) -> None:
        """Compute what a page shows of the model; of a large one it takes a while, and is best done in a thread."""
        sheet = self.sheet
        _ = sheet.problems, sheet.grids, sheet.constants, sheet.equations()

    def warm(self) -> None:
        """Load what :meth:`understand` needs; takes about a second, once, and is best called in a thread."""
        compute(new(), quick=True)

    def close(self) -> None:
        """Nothing to do: all is saved."""

    # The model -------------------------------------------------------------------------------------------------------

    @property
    def text(self) -> str:
        """The text of the model file."""
        return self.file.dumps()

    @property
    def shared(self) -> str:
        """The text of a link: the model file, in which the settings of the next experiment are those of the plan."""
        names = ("steps", "runs", "seed", "first", "algorithms")
        own = {name: getattr(self.plan, name) for name in names}
        changes = [(("experiment", name), list(value) if isinstance(value, tuple) else value) for name, value in own.items()]
        try:
            return self.file.edit_all([each for each in changes if own[each[0][1]] != _told(self.file).get(each[0][1])]).dumps()
        except ValueError:
            return self.text

    @property
    def untouched(self) -> bool:
        """Whether nothing has been opened, begun or typed yet."""
        return self._text == ""

    @property
    def title(self) -> str:
        """The model's title, or what stands for it."""
        return self.sheet.title or "Untitled model"

    @property
    def filename(self) -> str:
        """A name for the model file: the title in plain letters."""
        plain = unicodedata.normalize("NFKD", self.sheet.title).encode("ascii", "ignore").decode()
        word = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:60].strip("_")
        return f"{word or 'model'}.toml"

    @property
    def sheet(self) -> ModelSheet:
        """The model as grids of cells, constants and equations."""
        if self._sheet is None:
            self._sheet = ModelSheet(self.file)
        return self._sheet

    def do(self, command: Command) -> None:
        """Carry out a command and save the result; where another server has edited the draft meanwhile, on what it has become:
        what was typed into other cells there stays.

        Raises
        ------
        ValueError
            The command is impossible: one line, and nothing has changed.
        """
        with self.turn:
            try:
                self._do(command)
            except Edited:
                self.again()
                if isinstance(command, commands.Rewrite | commands.Remove):  # it was meant for what is no more
                    raise
                self._do(command)

    def _do(self, command: Command) -> None:
        file, label = commands.apply(self.file, command)
        text = file.dumps()
        if not text:
            msg = "model: expected a model file, received an empty text"
            raise ValueError(msg)
        if text == self._text or (text == self.text and type(command) not in BEGINS):
            return
        present, begins = self._revisions[self._at][0], BEGINS.get(type(command), "")
        begun = {number: how for number, how in self._begun.items() if present - REVISIONS < number <= present}
        begun |= {present + 1: begins} if begins else {}
        notes = {"begun": list(begun.items())} if begun != self._begun else None
        number = self.store.edit(self.draft.id, text, label, after=present, notes=notes)
        self._revisions = [each for each in self._revisions[: self._at + 1] if each[0] > number - REVISIONS]
        self._revisions.append((number, label))
        self._at = len(self._revisions) - 1
        before, measured = _told(self.file), self.sheet.measurements
        self._set(file, text)
        told = _told(file)
        self._begun = begun
        if begins:  # what belongs to another model is left behind
            data = self.plan.data if self.sheet.measurements == measured else None
            self._plans[self._model(self._at - 1)] = self.plan
            self._settle(told | {"design": None, "anomalies": (), "data": data})
        else:
            self._settle(_changes(before, told))

    @property
    def can_undo(self) -> bool:
        """Whether there is something to take back."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether something has been taken back."""
        return self._at < len(self._revisions) - 1

    def undo(self) -> str:
        """Take the last edit back; what it was. ``ValueError`` if there is none."""
        if not self.can_undo:
            msg = "Nothing to undo"
            raise ValueError(msg)
        label = self._revisions[self._at][1]
        self._move(self._at - 1)
        return label

    def redo(self) -> str:
        """Do again what was taken back; what it was. ``ValueError`` if there is nothing."""
        if not self.can_redo:
            msg = "Nothing to redo"
            raise ValueError(msg)
        self._move(self._at + 1)
        return self._revisions[self._at][1]

    def go(self, number: int) -> None:
        """Make any step of the history the present one."""
        found = [i for i, (each, _) in enumerate(self._revisions) if each == number]
        if not found:
            msg = f"history: expected one of its steps, received number {number}"
            raise ValueError(msg)
        self._move(found[0])

    @property
    def history(self) -> tuple[HistoryStep, ...]:
        """All steps in order; the last ``done`` one is the present."""
        return tuple(
            HistoryStep(number, label, i <= self._at, self._begun.get(number, ""))
            for i, (number, label) in enumerate(self._revisions)
        )

    def understand(self) -> Understanding:
        """What can be said of the model; computed once for every text."""
        if self._understanding is None:
            self._understanding = compute(self.file, quick=True)
        return self._understanding

    # Experiments -----------------------------------------------------------------------------------------------------

    def set_plan(self, **changes: Any) -> None:
        """Change settings of the next experiment (fields of :class:`Plan`); saved with the draft."""
        try:
            plan = replace(self.plan, **changes)
        except TypeError:
            known = ", ".join(Asked.__dataclass_fields__)
            msg = f"plan: expected settings among {known}, received {', '.join(changes)}"
            raise ValueError(msg) from None
        plan.check()
        self._note(plan)

    async def upload(self, content: bytes, name: str) -> Record:
        """Take a CSV file as the next experiment's data; the record in it. It is read in a thread."""
        data = Upload.of(content, name)
        record = await self._parsed(data)
        self.set_plan(data=data)
        return record

    async def record(self) -> Record | None:
        """What is read of the plan's data, if there are any; ``ValueError`` where they do not fit the model."""
        return None if self.plan.data is None else await self._parsed(self.plan.data)

    def set_design(self, text: str | None) -> None:
        """Let another model be the filter's (a model file's text, read and checked), or the truth itself (None)."""
        if text is not None:
            loads(text, "design")
        self.set_plan(design=text)

    def design_differs(self) -> Difference | None:
        """How the design's model file differs from the truth's; ``None`` without a design."""
        return None if self.plan.design is None else comparing.models(self.text, self.plan.design)

    def job(self, plan: Asked | None = None) -> tuple[str, dict[str, Any]]:
        """Name and arguments of the run for the worker: ``await runner.run(*session.job(), …)``."""
        plan = self.plan if plan is None else plan
        plan.check()
        return REGISTERED, {"model": self.file.checked().dumps(), "plan": plan.plain()}

    @property
    def result(self) -> Outcome | None:
        """What came of the last run, after a restart too; ``None`` before the first, or where it has been deleted since."""
        if self._result is None and self.result_id is not None:
            try:
                self._result = self.outcome(self.result_id)
            except (ValueError, LookupError):
                self.result_id = None
        return self._result

    async def run(
        self,
        *,
        progress: Callable[[RunProgress], object] | None = None,
        cancel: Cancel | None = None,
        name: str = "",
    ) -> Outcome:
        """Carry out the plan in another process, keep the result, and show it: :attr:`result`, :attr:`result_id`.

        Raises
        ------
        ValueError, ctlabs.workbench.runs.worker.RunFailed
            The plan or the model cannot be run; it was cancelled, too large or too long. One line.
        """
        job, text, plan = self.job(), self.text, self.plan
        self._running(going=True)
        try:
            found = await self._ran(job, progress, cancel)
        finally:
            self._running(going=False)
        return await self._finished(found, text, plan, name)

    def _running(self, *, going: bool) -> None:
        """Note that a run goes on, so that one is known which a killed server has not ended."""
        with contextlib.suppress(RuntimeError):
            self.store.note(self.draft.id, running=going)

    async def rerun(
        self,
        number: int,
        *,
        progress: Callable[[RunProgress], object] | None = None,
        cancel: Cancel | None = None,
    ) -> Outcome:
        """Carry out a kept experiment again, with its model, settings and seed; the new one is kept too."""
        old = self._experiment(number)
        plan = self._plan(old.settings)
        found = await self._ran((REGISTERED, {"model": old.model, "plan": plan.plain()}), progress, cancel)
        return await self._finished(found, old.model, plan, f"{old.name} (again)")

    # What is kept ----------------------------------------------------------------------------------------------------

    def keep(self, found: Outcome, name: str = "") -> int:
        """Keep an outcome with the present model and plan; its number."""
        return self._keep(found, self.text, self.plan, name)

    def kept(self, *, deleted: bool = False) -> list[KeptExperiment]:
        """The owner's experiments, the latest first; ``deleted``: those that can be put back."""
        return self.store.experiments(self.draft.owner, deleted=deleted)

    def outcome(self, number: int) -> Outcome:
        """What came out of a kept experiment."""
        self._experiment(number)
        return outcome(self.store.results(number))

    def found(self, number: int) -> Outcome | Summary:
        """What came out of anything that is kept."""
        results = self.store.results(number)
        return outcome(results) if self._kept(number).kind == "experiment" else Summary.of(results)

    def reopen(self, number: int) -> str:
        """Put what is kept on the desk: its model (which can be undone), its settings, its result; the page that shows it."""
        old = self._kept(number)
        if old.kind != "experiment":
            self.do(commands.Open(old.model, old.name))
            return self.records.reopen(old)
        found = outcome(self.store.results(number))
        self.do(commands.Open(old.model, old.name))
        self._note(self._plan(old.settings))
        self._show(found, number)
        return "experiment"

    def rename(self, number: int, name: str) -> None:
        """Give a kept experiment another name."""
        self._kept(number)
        self.store.rename(number, _line(name) or f"Experiment {number}")

    def delete(self, number: int) -> None:
        """Take a kept experiment out of the list."""
        self._kept(number)
        self.store.delete(number)

    def restore(self, number: int) -> None:
        """Put a deleted experiment back."""
        self._kept(number, deleted=True)
        self.store.delete(number, undo=True)

    def compare(self, a: int, b: int) -> Difference:
        """How two kept results differ: models line by line, settings, numbers."""
        first, second = self._kept(a), self._kept(b)
        return comparing.experiments((first, self.found(a)), (second, self.found(b)))

    def export(self, number: int, kind: str, part: str = "") -> bytes:
        """A kept experiment as a file of one of the :data:`~ctlabs.workbench.runs.kinds.KINDS`.

        ``part`` : which picture or table, one of :meth:`figures` or :meth:`tables`; the first one where not given.

        Some take seconds: call it in a thread (``asyncio.to_thread``).
        """
        from ctlabs.workbench.runs import exports

        old = self._experiment(number)
        return exports.export(old.name, old.model, self._plan(old.settings), self.outcome(number), kind, part)

    def code(self, kind: str) -> str:
        """The Python lines ("python") or the commands ("commands") that give the numbers of :attr:`result` again; empty without one."""
        from ctlabs.workbench.runs import programs

        found, number = self.result, self.result_id
        if found is None or number is None:
            return ""
        old = self._kept(number)
        return {"python": programs.python, "commands": programs.commands}[kind](old.name, old.model, self._plan(old.settings), found)

    def figures(self, number: int) -> dict[str, str]:
        """The pictures of a kept experiment, and what each shows."""
        from ctlabs.workbench.runs.figures import pictures

        return {name: caption for name, (_, caption) in pictures(self.outcome(number)).items()}

    def tables(self, number: int) -> dict[str, str]:
        """The tables of a kept experiment, and what each holds."""
        from ctlabs.workbench.runs.tables import tables

        return tables(self.outcome(number))

    def export_name(self, number: int, kind: str, part: str = "") -> str:
        """A name for an exported file."""
        from ctlabs.workbench.runs import exports

        return exports.filename(self._experiment(number).name, number, kind, part)

    # Within ----------------------------------------------------------------------------------------------------------

    def _set(self, file: ModelFile, text: str) -> None:
        self.file, self._text = file, text
        self._sheet = self._understanding = None

    def _settle(self, changes: dict[str, Any]) -> None:
        """Take settings that the model file tells into the plan."""
        plan = replace(self.plan, **changes)
        if plan != self.plan:
            self._note(plan)

    def _note(self, plan: Asked) -> None:
        self.store.note(self.draft.id, plan=self._settings(plan))
        self.plan = plan

    def _settings(self, plan: Asked) -> dict[str, Any]:
        """A plan as the store has it: a long record once, beside all plans that use it."""
        plain = plan.plain()
        if plan.data is not None:
            plain["data"] = {"name": plan.data.name, "key": self.store.put(plan.data.text)}
        return plain

    def _plan(self, settings: Mapping[str, Any]) -> Asked:
        """The plan of :meth:`_settings`."""
        if settings.get("data") is None:
            return Asked.of(settings)
        name, key = settings["data"]["name"], settings["data"]["key"]
        return Asked.of({**settings, "data": {"name": name, "text": self.store.text(key)}})

    async def _parsed(self, data: Upload) -> Record:
        model = self.file if not self.file.problems() else self.sheet.measurements
        if self._parsing is None or self._parsing[0] != (data, model):
            self._parsing = (data, model), await asyncio.to_thread(data.record, model)
        return self._parsing[1]

    def _move(self, at: int) -> None:
        with self.turn:
            try:
                self._moved(at)
            except Edited:
                self.again()
                raise

    def _moved(self, at: int) -> None:
        try:
            text = self.store.move(self.draft.id, self._revisions[at][0], after=self._revisions[self._at][0])
        except LookupError as error:
            raise ValueError(str(error)) from None
        left, before = self._model(self._at), _told(self.file)
        self._at = at
        self._set(_file(text), text)
        if (model := self._model(at)) != left and model in self._plans:
            self._plans[left] = self.plan
            self._note(self._plans[model])
        else:
            self._settle(_changes(before, _told(self.file)))

    def _model(self, at: int) -> int:
        """The revision with which the model at a place of the history was opened."""
        return max((number for number, _ in self._revisions[: at + 1] if number in self._begun), default=-1)

    async def _ran(
        self,
        job: tuple[str, dict[str, Any]],
        progress: Callable[[RunProgress], object] | None,
        cancel: Cancel | None,
    ) -> Outcome:
        name, arguments = job
        if self.runner is None:
            from ctlabs.workbench.runs import experiments

            return outcome(await asyncio.to_thread(experiments.run, **arguments))
        result = await self.runner.run(name, arguments, session=self.draft.id, progress=progress, cancel=cancel)
        return outcome(result)

    async def _finished(self, found: Outcome, text: str, plan: Asked, name: str) -> Outcome:
        self._show(found, None)
        try:
            number = await asyncio.to_thread(self._keep, found, text, plan, name)  # all of a long record takes a while to pack
            self._show(found, number)
        except RuntimeError:  # it can be looked at even where it cannot be kept; the page says that it is not
            log.exception("keeping an experiment")
        return found

    def _show(self, found: Outcome, number: int | None) -> None:
        self._result, self.result_id = found, number
        if number is not None:
            self.store.note(self.draft.id, result=number)

    def _keep(self, found: Outcome, text: str, plan: Asked, name: str) -> int:
        title = ModelSheet(loads(text, "", check=False)).title or "Untitled model"
        words = _line(name) or f"{title}: " + (plan.data.name if plan.data else f"{plan.runs} runs, seed {plan.seed}")
        return self.store.keep(self.draft.owner, words, text, self._settings(plan), plan.seed, packed(found))

    def _experiment(self, number: int) -> KeptExperiment:
        found = self._kept(number)
        if found.kind != "experiment":
            msg = f"experiment {number}: expected an experiment, received a record that was {KINDS[found.kind]}: open it"
            raise ValueError(msg)
        return found

    def _kept(self, number: int, *, deleted: bool = False) -> KeptExperiment:
        found = self.store.experiment(number, self.draft.owner)
        if found is None or (found.deleted is not None) is not deleted:
            what = "deleted" if deleted else "kept"
            msg = f"experiment {number}: expected one that is {what}, received {'another' if found else 'an unknown number'}"
            raise ValueError(msg)
        return found


def _file(text: str) -> ModelFile:
    return loads(text, "", check=False) if text else loads(new().dumps(), "", check=False)


def _changes(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in after.items() if before.get(name, value) != value}


def _told(file: ModelFile) -> dict[str, Any]:
    """What the model file tells of an experiment; nothing where its table is wrong."""
    try:
        found = file.experiment
    except ValueError:
        return {}
    return {name: getattr(found, name) for name in ("steps", "runs", "seed", "first", "algorithms")}


def _line(text: str) -> str:
    """One line of letters that can be seen."""
    return "".join(each for each in " ".join(text.split()) if each.isprintable())[:LONGEST]
