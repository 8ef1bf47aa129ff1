"""The page Data: a table of measurements, how the model reads it, and what it says of the states and of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import background_tasks, ui

from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.workbench.desk import plain
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.data_columns import ColumnCards, remedy
from ctlabs.workbench.pages.data_results import RecordResults
from ctlabs.workbench.pages.dropping import too_large
from ctlabs.workbench.pages.editing import Editor
from ctlabs.workbench.pages.showing import Show, help_button
from ctlabs.workbench.runs.inside import line
from ctlabs.workbench.runs.outcomes import LARGEST
from ctlabs.workbench.runs.wanted import FORECAST

if TYPE_CHECKING:
    from nicegui.events import UploadEventArguments

    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 4, "title": "Data", "icon": "table_chart"}

def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Data(session, shell).draw()


class _Data:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell, self.desk = session, shell, session.records
        self.show, self.running = Show(shell), session.records.filtering
        self.editor = Editor(session, shell, lambda _key: self._want())
        self.seen = self.running.finished
        self.looking = self.again = self.left = False
        self.fields: dict[str, ui.input] = {}
        self.upload: ui.upload

    # Drawing -----------------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        self.shell.name_draft(self.session.title)
        with ui.element("div").classes("ctl-data"):
            self._draw_file()
            self.columns = ColumnCards(self.show, self.editor, self.desk)
            self._draw_filter()
            self.results = RecordResults(self.show, self.shell, self.session, self._gate)
        for keys, label, action in (
            ("mod+enter", "Filter the record", self.run),
            ("alt+shift+x", "Cancel the run", self.running.cancel),
        ):
            self.shell.shortcut(keys, label, action)
        self.shell.shortcut("mod+z", "Undo", self.editor.undo, in_fields=False)
        self.shell.shortcut("mod+shift+z", "Redo", self.editor.redo, in_fields=False)
        self.shell.on_leave(self.running.watch(self._look))
        self.shell.on_leave(self._leave)
        self._look()
        self.columns.fill(None)
        self.refusal.set_visibility(False)
        self.which.set_visibility(False)
        self.results.draw()
        self._want()

    def _draw_file(self) -> None:
        with self.show.card("The table", "data.table", test="data-file") as card:
            self.file_card = card.section
            with ui.element("div").classes("ctl-exp-drop").props("data-test=data-drop"):
                self.file_told = ui.label("").props("role=status aria-live=polite data-test=data-told")
                with ui.row().classes("gap-2"):
                    choose = ui.button("Choose a file…", icon="upload_file", on_click=lambda: self.upload.run_method("pickFiles"))
                    choose.props("no-caps outline dense data-test=data-choose")
                    self.remove = ui.button("Remove", icon="close", on_click=self._remove)
                    self.remove.props('no-caps flat dense aria-label="Remove the data" data-test=data-remove')
            with ui.row().classes("items-center gap-2") as hint:
                ui.label("There is no model yet: what the columns measure is said by one.").classes("ctl-show-hint")
                begin = ui.button("Begin with a model", icon="grid_on", on_click=lambda: self.shell.go("model"))
                begin.props("no-caps outline dense data-test=data-begin")
            hint.set_visibility(self.session.untouched)
            self.upload = ui.upload(
                auto_upload=True, max_file_size=LARGEST, on_upload=self._uploaded, on_rejected=lambda: self.shell.complain(too_large())
            )
            self.upload.props("data-test=data-upload").classes("hidden")
            self.understood = ui.element("div").props("role=status aria-live=polite data-test=data-understood")
            self.refusal = ui.element("div").classes("ctl-data-refusal").props("role=alert data-test=data-refusal")

    def _draw_filter(self) -> None:
        wanted = self.desk.wanted
        with self.show.card("Filter", "data.filter", test="data-filter") as card:
            self.filter_card = card.section
            with ui.element("div").classes("ctl-data-fields"):
                forms = {"": f"as the model says ({self._form()})", **{name: help_for(f"algorithm.{name}").title for name in FORMS}}
                chosen = ui.select(forms, value=wanted.algorithm if wanted.algorithm in forms else "", label="Algorithm",
                                   on_change=lambda event: self._set(algorithm=event.value))  # fmt: skip
                chosen.props("outlined dense options-dense data-test=data-algorithm")
                for name, label, value in (
                    ("gate", "Gate, σ (empty: none)", "" if wanted.gate is None else f"{wanted.gate:g}"),
                    ("steps", "Forecast, steps", str(wanted.steps)),
                ):
                    with ui.element("div").classes("ctl-exp-field"):
                        field = ui.input(label, value=value, on_change=lambda _, name=name: self._typed(name))
                        field.without_auto_validation()  # which would take back what is said of the text
                        field.props("outlined dense debounce=250 inputmode=decimal autocomplete=off hide-bottom-space")
                        field.props(f"data-test=data-{name}")
                        help_button(f"data.{name}")
                    self.fields[name] = field
                self.which = ui.select({}, label="Record", on_change=lambda event: self._set(which=event.value))
                self.which.props("outlined dense options-dense data-test=data-which")
                smooth = ui.checkbox("Smooth, too", value=wanted.smooth, on_change=lambda event: self._set(smooth=bool(event.value)))
                smooth.props("dense data-test=data-smooth")
            with ui.row().classes("items-center gap-2"):
                self.run_button = ui.button("Filter", icon="play_arrow", on_click=self.run)
                self.run_button.props('no-caps data-test=data-run aria-keyshortcuts="Control+Enter"')
                self.cancel_button = ui.button("Cancel", icon="stop", on_click=self.running.cancel)
                self.cancel_button.props("no-caps outline data-test=data-cancel")
                self.told = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=data-progress")
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=data-error")

    def _form(self) -> str:
        try:
            return self.session.file.experiment.algorithms[0]
        except (ValueError, IndexError):
            return "joseph"

    # The table ---------------------------------------------------------------------------------------------------------

    async def _uploaded(self, event: UploadEventArguments) -> None:
        self.upload.reset()
        self.file_told.text = f"Reading {event.file.name}…"
        await self.desk.drop(await event.file.read(), event.file.name)
        self.shell.saved()
        self._want()

    def _remove(self) -> None:
        self.desk.forget()
        self.shell.saved()
        self._want()

    def _want(self) -> None:
        """See the table through, in another process; of several wishes meanwhile only the last one."""
        self.again = True
        if not self.looking:
            self.looking = True
            background_tasks.create(self._see(), name="look")

    async def _see(self) -> None:
        try:
            while self.again and not self.left:
                self.again = False
                problem = ""
                if self.desk.data is not None:
                    self._say(f"Reading {self.desk.data.name}…")
                try:
                    await self.desk.look()
                except (ValueError, RuntimeError) as why:
                    problem = line(why)
                if not self.left and not self.again:
                    self._fill(problem)
        finally:
            self.looking = False

    def _say(self, text: str) -> None:
        with self.file_card:
            self.file_told.text = text

    def _fill(self, problem: str) -> None:
        """Show what is known of the table."""
        desk, table = self.desk, self.desk.table
        with self.file_card:
            self.remove.set_visibility(desk.data is not None or bool(desk.refused))
            if desk.data is None:
                names = ", ".join(self.session.sheet.measurements)
                kinds = "CSV, text, Excel, parquet, packed or not"
                self.file_told.text = f"Drop a table anywhere on the page: {kinds}. The model measures {names}."
            else:
                self.file_told.text = desk.data.name
            self.understood.clear()
            with self.understood:
                remarks = [f"{each}." for each in table["remarks"]] if table else []
                _sentences((*table["understood"], *table["read"], *remarks) if table and desk.data else ())
            self._fill_refusal(desk.refused or problem or (table["refusal"] if table and desk.data else ""))
        self.columns.fill(table if desk.data is not None and not desk.refused else None)
        records = table["records"] if table and desk.data else []
        self.which.set_options(dict(enumerate(records)), value=min(desk.wanted.which, max(len(records) - 1, 0)) if records else None)
        self.which.set_visibility(len(records) > 1)
        self._look()
        self.results.draw()
        if desk.fresh and desk.readable and not self.running.running and not self.session.sheet.problems:
            self.run()

    def _fill_refusal(self, refusal: str) -> None:
        """Why the table cannot be read, and a button for each way to put it right."""
        self.refusal.clear()
        self.refusal.set_visibility(bool(refusal))
        if not refusal:
            return
        desk, table = self.desk, self.desk.table or {}
        ways = list(desk.remedies if desk.refused else table.get("remedies", ()))
        suggestion = "" if desk.refused else str(table.get("suggestion", ""))
        with self.refusal:
            ui.label(refusal).props("data-test=data-refusal-text")
            with ui.row().classes("gap-2 items-center"):
                ways = [suggestion, *(way for way in ways if not suggestion.startswith(way))] if suggestion else ways
                for i, way in enumerate(ways):
                    remedy(way, f"data-remedy-{i}", self._remedy)
            hint = "Press what you mean; it is written into the model file under [data]." if ways or suggestion else _by_hand(table)
            ui.label(hint).classes("ctl-show-hint")

    async def _remedy(self, options: str) -> None:
        self.desk.fresh = True
        if self.editor.do(self.desk.remedied(options)) and self.desk.refused:
            await self.desk.again()
            self._want()

    # Filtering ---------------------------------------------------------------------------------------------------------

    def _set(self, **changes: Any) -> bool:
        """Change what is done with the record; what is wrong is said."""
        if changes.get("which", 0) is None:
            return True
        self.shell.saving()
        try:
            self.desk.want(**changes)
        except ValueError as why:
            self.wrong.text = line(why)
            self.shell.saved()
            return False
        self.wrong.text = ""
        self.shell.saved()
        return True

    def _typed(self, name: str) -> bool:
        """A number is typed."""
        field, text = self.fields[name], str(self.fields[name].value or "").strip()
        try:
            value = plain.whole(text or "0", 0, FORECAST) if name == "steps" else plain.number(text, "a number of σ > 0") if text else None
        except ValueError as why:
            field.error = str(why)
            return False
        field.error = None
        return self._set(**{name: value})

    def _gate(self, gate: float | None) -> None:
        """Filter with another gate."""
        self.fields["gate"].value = "" if gate is None else f"{gate:g}"
        if self._set(gate=gate):
            self.run()

    def run(self) -> None:
        """Filter the record, if all is in order."""
        wrong = [name for name in self.fields if not self._typed(name)]
        if wrong or self.running.running or not self._ready():
            return
        self.running.start(lambda progress, cancel: self.desk.filter(progress, cancel, self._arrived))

    def _ready(self) -> str:
        """Whether there is something to filter: the data's name, or nothing."""
        return "" if self.desk.data is None or self.desk.refused or self.session.sheet.problems else self.desk.data.name

    def _arrived(self) -> None:
        """There are estimates; they are being tested."""
        if not self.left:
            self.results.draw()
            self.results.bring()

    def _look(self) -> None:
        """Show how far it is."""
        now, problems = self.running, self.session.sheet.problems
        with self.filter_card:
            self.filter_card.set_visibility(self.desk.data is not None and not self.desk.refused)
            self.run_button.set_enabled(not now.running and bool(self._ready()))
            self.cancel_button.set_visibility(now.running)
            if now.running:
                stage = getattr(now.progress, "note", None) or "Starting"
                self.told.text, self.wrong.text = f"{stage}…", ""
                return
            self.told.text = "Cancelled; what was computed before stays." if now.cancelled else ""
            where = next(iter(problems.items()), None)
            self.wrong.text = f"The model cannot be used: {where[0]}: {where[1]}" if where else now.problem
            if now.finished != self.seen or now.cancelled:
                self.seen = now.finished
                self.results.draw()

    def _leave(self) -> None:
        self.left = True


def _by_hand(table: dict[str, Any]) -> str:
    return "Say below which column is what." if table.get("columns") else "The first lines of the file are below."


def _sentences(lines: tuple[str, ...]) -> None:
    """Sentences as a list."""
    with ui.element("ul").classes("ctl-data-list"):
        for each in lines:
            with ui.element("li"):
                ui.label(each)
