"""What a draft does with measured data: the table and how it is read, its filtering, its fits; everything but the pages.

desk = session.records
await desk.drop(content, "log.csv")              # the data of the draft; desk.table says what is in it
desk.assign(column, "measurement:position")       # an edit of the model's [data], which can be undone
await desk.filter(progress, cancel)               # desk.estimates at once, desk.judgement when it is tested
await desk.fit(["q", "r"], 0, progress, cancel)   # desk.fitted; session.do(TakeEstimates(…)) puts it into the model
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from collections.abc import Mapping as Table
from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING, Any, Protocol

from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import loads
from ctlabs.files.remedies import changing, said
from ctlabs.workbench.desk.telling import TellData
from ctlabs.workbench.runs import summaries
from ctlabs.workbench.runs.outcomes import Upload
from ctlabs.workbench.runs.running import Running
from ctlabs.workbench.runs.wanted import Wanted
from ctlabs.workbench.runs.worker import here

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.workbench.desk.sheet import ModelSheet
    from ctlabs.workbench.desk.store import Draft, KeptExperiment, Store
    from ctlabs.workbench.runs.fits import FitResult, Point
    from ctlabs.workbench.runs.outcomes import Asked
    from ctlabs.workbench.runs.records import Judgement, RecordEstimates
    from ctlabs.workbench.runs.summaries import Summary
    from ctlabs.workbench.runs.worker import Cancel, Runner, RunProgress

log = logging.getLogger("ctlabs.workbench")

#: How long a fit may take, and how long one that is cancelled may take to come to its end with the best so far, s.
LONGEST, PATIENCE = 3600.0, 20.0
#: Tables of fewer characters are seen through in a thread of the server.
SMALL = 500_000
Show = Callable[["RunProgress"], object]


class Drafted(Protocol):
    """What is needed of a session."""

    draft: Draft
    store: Store
    runner: Runner | None
    file: ModelFile
    plan: Asked

    @property
    def text(self) -> str:
        """The text of the model file."""
        ...

    @property
    def sheet(self) -> ModelSheet:
        """The model as grids of cells and constants."""
        ...

    def set_plan(self, **changes: Any) -> None:
        """Change settings of the next experiment, its data among them."""
        ...


class RecordDesk:
    """The measured data of one draft.

    ``table``, what :func:`ctlabs.workbench.runs.seen.seen` said of the data as ``shown`` (model text, data) · ``refused``, why the
    dropped file is no table, with its ``remedies`` · ``fresh``, whether it was dropped and not filtered yet · ``estimates`` and
    ``judgement`` of the last filtering · ``fitted`` · ``trace`` of the fit that runs · ``filtering``, ``fitting``, the runs
    """

    def __init__(self, session: Drafted) -> None:
        self.session = session
        self.filtering, self.fitting = Running(), Running()
        self.fresh = False
        self.table: dict[str, Any] | None = None
        self.shown: tuple[str, Upload] | None = None
        self.refused, self.remedies = "", ()  # type: tuple[str, tuple[str, ...]]
        self.estimates: RecordEstimates | None = None
        self.judgement: Judgement | None = None
        self.fitted: FitResult | None = None
        self.trace: list[Point] = []
        self._raw: tuple[bytes, str] | None = None
        self._of: tuple[Any, ...] | None = None
        self._free: list[str] = list(session.draft.notes.get("free") or ())
        noted = session.draft.notes.get("records")
        self.wanted = Wanted(**noted) if isinstance(noted, dict) and set(noted) <= {f.name for f in fields(Wanted)} else Wanted()

    # The table ---------------------------------------------------------------------------------------------------------

    @property
    def data(self) -> Upload | None:
        """The data of the draft."""
        return self.session.plan.data

    @property
    def mapping(self) -> Mapping:
        """How the model file says that data are read."""
        try:
            return replace(self.session.file.mapping, standing=())
        except ValueError:
            return Mapping()

    async def drop(self, content: bytes, name: str) -> None:
        """Take a file as the draft's data; where it is no table, :attr:`refused` says why."""
        self._raw, self.refused, self.remedies, self.fresh = (content, name), "", (), True
        try:
            data = await asyncio.to_thread(Upload.of, content, name, self.mapping)
        except ValueError as why:
            self.refused = " ".join(str(why).split())
            self.remedies = changing(self.refused, self.mapping)
            return
        self.session.set_plan(data=data)

    async def look(self) -> dict[str, Any] | None:
        """What is in the data as the present model reads them; ``None`` without data."""
        data, text = self.data, self.session.text
        if data is None:
            self.table = self.shown = None
            return None
        if self.shown != (text, data) or self.table is None:
            arguments = {"model": text, "text": data.text, "name": data.name}
            self.table = await (here if len(data.text) < SMALL else self._run)("table", arguments)
            self.shown = (text, data)
        return self.table

    def forget(self) -> None:
        """Without data."""
        self.session.set_plan(data=None)
        self.table = self.shown = self._raw = None
        self.refused, self.remedies = "", ()

    def assigned(self, column: Table[str, Any], role: str) -> TellData:
        """The edit that gives a column a role: "time", "measurement:x", "input:u", "regressor:r", "record", or none ("")."""
        from ctlabs.workbench.runs import seen  # which takes a while to load

        what = role.partition(":")[2] or role or "not used"
        options = str(self.table["options"]) if self.table else ""
        return TellData(seen.mapped(self.mapping, column, role, options), f"data: {column['name']} is {what}")

    def remedied(self, options: str) -> TellData:
        """The edit that applies what a refusal offers."""
        return TellData(self.mapping.over(said(options)), f"data: {options}")

    async def again(self) -> None:
        """Read a file that was refused once more, as the model now says."""
        if self._raw is not None:
            await self.drop(*self._raw)

    @property
    def readable(self) -> bool:
        """Whether the present model reads the data, as far as is known."""
        return bool(self.table and not self.table["refusal"] and self.shown == (self.session.text, self.data))

    # Filtering ---------------------------------------------------------------------------------------------------------

    def want(self, **changes: Any) -> None:
        """Change what is done with the record; saved with the draft. ``ValueError`` where it cannot be."""
        wanted = replace(self.wanted, **changes)
        wanted.check()
        if wanted != self.wanted:
            self.session.store.note(self.session.draft.id, records=asdict(wanted))
            self.wanted = wanted

    @property
    def stale(self) -> bool:
        """Whether the model, the data or what was wanted have changed since the estimates."""
        return self._of is not None and self._of != self._present()

    def _present(self) -> tuple[Any, ...]:
        return self.session.text, self.data, self.wanted

    async def filter(self, progress: Show | None = None, cancel: Cancel | None = None, seen: Callable[[], object] | None = None) -> None:
        """Filter the record; ``seen`` is called when there are estimates, before they are tested."""
        self.fresh = False
        arguments = {"model": self.session.file.checked().dumps(), "data": self._needed(), "wanted": self.wanted}
        of, wanted = self._present(), self.wanted
        self.estimates = await self._run("estimates", arguments, progress, cancel)
        self.judgement, self._of = None, of
        if seen is not None:
            seen()
        self.judgement = await self._run("diagnosis", arguments, progress, cancel)
        settings = {"kind": "filter", "wanted": asdict(wanted)}
        await self._keep(summaries.of_record(self.estimates, self.judgement), arguments, settings)

    async def file(self, kind: str) -> bytes:
        """The estimates as a file: "csv" (every row), "html" (the report), "forecast"."""
        arguments = {"model": self.session.file.checked().dumps(), "data": self._needed(), "wanted": self.wanted, "kind": kind}
        content: bytes = await self._run("files", arguments)
        return content

    def _needed(self) -> Upload:
        if self.data is None:
            raise ValueError("data: expected a table, received none: drop one on the page Data")
        return self.data

    # Fitting -----------------------------------------------------------------------------------------------------------

    @property
    def free(self) -> tuple[str, ...]:
        """The constants that are ticked, as far as the model has them."""
        return tuple(row.name for row in self.session.sheet.constants if row.name in self._free)

    def choose(self, names: Sequence[str]) -> None:
        """Tick constants; saved with the draft."""
        self.session.store.note(self.session.draft.id, free=list(names))
        self._free = list(names)

    async def fit(self, free: Sequence[str], starts: int = 0, progress: Show | None = None, cancel: Cancel | None = None) -> None:
        """Fit constants to the record; cancelled, the best so far is kept."""
        self.trace = []
        arguments = {"model": self.session.file.checked().dumps(), "data": self._needed(), "free": list(free), "starts": starts}

        def show(state: RunProgress) -> None:
            if state.note is not None:
                if len(self.trace) > 1 and self.trace[-1].best == self.trace[-2].best == state.note.best:
                    self.trace.pop()  # the ends of a level are enough
                self.trace.append(state.note)
            if progress is not None:
                progress(state)

        found: FitResult = await self._run("fit", arguments, show, cancel, seconds=LONGEST, patience=PATIENCE)
        self.fitted = found
        if found.evaluations:
            await self._keep(summaries.of_fit(found), arguments, {"kind": "fit", "free": list(free), "starts": starts})

    # What is kept ------------------------------------------------------------------------------------------------------

    async def _keep(self, found: Summary, arguments: dict[str, Any], settings: dict[str, Any]) -> None:
        """Keep a result with its model and its data, unless it is the last one that was kept."""
        data: Upload = arguments["data"]
        try:
            await asyncio.to_thread(self._kept, found, arguments["model"], data, settings)
        except RuntimeError:  # it can be looked at even where it cannot be kept
            log.exception("keeping a result")

    def _kept(self, found: Summary, model: str, data: Upload, settings: dict[str, Any]) -> None:
        store, owner = self.session.store, self.session.draft.owner
        settings = {**settings, "data": {"name": data.name, "key": store.put(data.text)}}
        last = next(iter(store.experiments(owner, limit=1)), None)
        if last is not None and (last.model, last.settings) == (model, settings):
            return
        title = str(loads(model, "", check=False).data().get("title") or "Untitled model")
        what = f" to {', '.join(settings['free'])}" if found.kind == "fit" else ""
        store.keep(owner, f"{title}: {data.name} {summaries.KINDS[found.kind]}{what}", model, settings, 0, found.plain())

    def reopen(self, old: KeptExperiment) -> str:
        """Put the data and the wishes of a kept result on the desk, whose model is there; the page that shows it."""
        told = old.settings["data"]
        self.session.set_plan(data=Upload(told["name"], self.session.store.text(told["key"])))
        self.table = self.shown = self._raw = None
        self.refused, self.remedies = "", ()
        if old.kind == "fit":
            self.choose(old.settings["free"])
            self.fitted = summaries.Summary.of(self.session.store.results(old.id)).fit
            return "fit"
        self.want(**old.settings["wanted"])
        self.fresh = True  # its estimates come again where they are shown
        return "data"

    async def _run(
        self, name: str, arguments: dict[str, Any], progress: Show | None = None, cancel: Cancel | None = None, **more: float
    ) -> Any:
        runner = self.session.runner
        if runner is None:
            return await here(name, arguments)
        return await runner.run(name, arguments, session=self.session.draft.id, progress=progress, cancel=cancel, **more)
