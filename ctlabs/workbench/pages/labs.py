"""The labs: the catalogue, a lab's statement and parameters, its run, and its report inside the page."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import app, ui
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from ctlabs.reporting.mathml import mathml
from ctlabs.reporting.render import inline
from ctlabs.text import number, printed
from ctlabs.workbench.desk.plain import whole
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.tables import table
from ctlabs.workbench.runs import catalogue
from ctlabs.workbench.runs.catalogue import LabOutcome, LabSheet, Parameter, Typed

if TYPE_CHECKING:
    from ctlabs.workbench.desk.desk import Desk
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 8, "title": "Labs", "icon": "school"}

#: Where the files of reports are, by draft, lab, number of the run and name.
FILES = "/lab-files/{draft}/{lab}/{run}/{name}"
#: What a report may do in the page: nothing but be read.
POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:"
#: How often a run is looked at, in seconds.
LOOK = 0.15



def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Labs(session, shell).draw()


class _Labs:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell, self.draft = session, shell, session.draft.id
        self.running = session.lab_run
        _serve_files(shell.desk)
        found = shell.desk.store.draft(self.draft)
        notes = {} if found is None else found.notes.get("labs", {})
        self.lab: str = notes.get("lab", "")
        self.typed: dict[str, dict[str, Any]] = notes.get("typed", {})
        self.form: _Form | None = None
        self.chosen: Path | None = None  # the run whose report is shown; None: the last one
        self.beside: Path | None = None  # the run that it is compared with
        self.refused = False  # Run was pressed with a field that is wrong
        self._selecting = 0
        self._linked = dict(shell.query) if "lab" in shell.query else {}
        shell.query.clear()
        if self._linked:
            self._follow()

    def _follow(self) -> None:
        """Take lab and values from the address."""
        try:
            self.lab = catalogue.sheet(self._linked["lab"][:40]).name
        except (ValueError, KeyError):
            self.shell.complain("lab: expected the number or name of one lab in the address, received another")

    # The catalogue -----------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        with ui.element("div").classes("ctl-lab-page") as self.frame:
            with ui.element("section").classes("ctl-lab-catalogue").props('aria-label="Catalogue of labs"'):
                self._draw_search()
                with ui.element("div").classes("ctl-lab-list"):
                    self.items = {sheet.name: self._item(sheet) for sheet in catalogue.sheets()}
            self.detail = ui.element("section").classes("ctl-lab-detail").props('aria-label="Lab"')
        self._find()
        self.shell.shortcut("/", "Search the labs", lambda: self.search.run_method("focus"))
        self.shell.shortcut("mod+enter", "Run the lab", self.run)
        ui.timer(LOOK, self._look)
        if self.lab:
            ui.timer(0, lambda: self.select(self.lab, move=False), once=True)
        else:
            self._welcome()

    def _draw_search(self) -> None:
        self.search = ui.input("Search labs", placeholder="oscillator, 7, autopilot …", on_change=self._find)
        self.search.props("outlined dense clearable debounce=150 type=search").classes("w-full")
        with ui.row().classes("items-center gap-2"):
            ui.label("Variant").props("aria-hidden=true")
            choices = {"": "all", **{letter: letter for letter in "abc"}}
            self.variant = ui.toggle(choices, value="", on_change=self._find)
            self.variant.props('dense no-caps unelevated toggle-color=primary aria-label="Variant"')
            self.variant.tooltip(help_for("labs.variant").what)
        self.count = ui.label().classes("ctl-lab-hint").props("role=status aria-live=polite")

    def _find(self) -> None:
        """Show the labs that are searched for; the others are hidden where they are, so that a click meets what it meant."""
        found = {sheet.name for sheet in catalogue.search(self.search.value or "", self.variant.value or "")}
        for name, item in self.items.items():
            item.set_visibility(name in found)
        star = "; * = control lab" if self.variant.value else ""
        self.count.text = f"{len(found)} labs{star}" if len(found) != 1 else f"1 lab{star}"
        if not found:
            self.count.text = "No lab has all these words."

    def _item(self, sheet: LabSheet) -> ui.element:
        item = ui.element("button").classes("ctl-lab-item").props("type=button")
        item.props(f'aria-current={"true" if sheet.name == self.lab else "false"} data-lab="{sheet.name}"')
        with item:
            ui.label(sheet.short if sheet.short.isdigit() else "·").classes("ctl-lab-number")
            ui.label(sheet.title)
            ui.label("extension" if sheet.extension else " ".join(sheet.variants)).classes("ctl-lab-variants").props(
                f'title="Variants {", ".join(sheet.variants)}"' if sheet.variants else ""
            )
        item.on("click", lambda: self.select(sheet.name))
        return item

    def _point(self) -> None:
        """Say in the list which lab is shown; the list stays where it is scrolled to."""
        for name, item in self.items.items():
            item.props(f"aria-current={'true' if name == self.lab else 'false'}")

    def _welcome(self) -> None:
        self.frame.props("data-open=false")
        with self.detail:
            ui.html("<h2>Labs</h2>", sanitize=False)
            ui.label(
                f"{len(catalogue.sheets())} labs, each from its statement to a report whose numbers are all computed twice. "
                "Choose one; change its numbers; run it."
            ).classes("ctl-lab-statement")

    # One lab -----------------------------------------------------------------------------------------------------------

    async def select(self, name: str, *, move: bool = True) -> None:
        """Show a lab."""
        try:
            sheet = catalogue.sheet(name)
        except ValueError:
            self._welcome()
            return
        if sheet.name != self.lab:
            self._linked = {}
        self.lab, self.form, self.chosen, self.beside = sheet.name, None, None, None
        self._selecting += 1
        mine = self._selecting
        self.frame.props("data-open=true")
        self._point()
        self.detail.clear()
        with self.detail:
            heading = self._head(sheet)
            waiting = ui.spinner(size="md")
        if move:
            heading.run_method("focus")
            self._note()
        fields = await asyncio.to_thread(catalogue.fields, sheet.name)  # the lab's module is loaded here
        if mine != self._selecting or self.detail.is_deleted:
            return
        waiting.delete()
        if self._linked and (told := catalogue.from_address(sheet.name, self._linked)):
            self.typed[sheet.name] = told
            self._note()
        self._linked = {}
        with self.detail:
            self._draw_form(sheet, fields)
            self.results = ui.element("div").classes("ctl-lab-detail")
        self._draw_results()
        self._look()

    def _head(self, sheet: LabSheet) -> ui.element:
        with ui.row().classes("ctl-narrow"):
            ui.button("All labs", icon="arrow_back", on_click=self._close).props("flat dense no-caps")
        with ui.element("h2").props("tabindex=-1") as heading:
            ui.label(sheet.heading)
        variants = " · extension" if sheet.extension else f" · variants {', '.join(sheet.variants)}" if sheet.variants else ""
        starred = any(each.endswith("*") for each in sheet.variants)
        star = " (*: with a control lab beside it)" if starred else ""
        ui.label(f"{sheet.source}{variants}{star}").classes("ctl-lab-source")
        ui.html(statement(sheet), sanitize=False).classes("ctl-lab-statement").props("data-test=statement")
        if sheet.answer:
            with ui.expansion("Expected answer").classes("ctl-lab-statement").props("dense"):
                ui.label(sheet.answer)
        with ui.row().classes("gap-2"):
            for model in sheet.models:
                button = ui.button(f"Open “{model.title}” in the workbench", icon="grid_on")
                button.props("flat dense no-caps").on_click(lambda _, name=model.name: self._open(name))
        return heading

    def _close(self) -> None:
        self.lab, self.form = "", None
        self.detail.clear()
        self._welcome()
        self._point()
        self._note()

    def _open(self, name: str) -> None:
        from ctlabs.workbench.desk.commands import Open

        typed = {} if self.form is None else {key: text for key, text in self.form.plain().items() if key}
        text, taken = catalogue.model_with(name, self.lab, typed)
        self.shell.saving()
        self.session.do(Open(text, f"{name}.toml"))
        self.shell.saved()
        self.shell.name_draft(self.session.title)
        values = f" with your {', '.join(taken)}" if taken else ""
        self.shell.tell(f"The lab's model is on the desk{values}; undo brings the one before back.")
        self.shell.go("model")

    def _draw_form(self, sheet: LabSheet, fields: Sequence[Parameter]) -> None:
        before = self._outcome(sheet.name)
        typed = dict(self.typed.get(sheet.name, {}))
        if not typed and before is not None:
            typed = {field.name: catalogue.typed_as(before.parameters.get(field.name)) for field in fields}
            typed |= {"": [str(before.runs), str(before.seed)]}
        self.form = _Form(sheet, fields, typed, self._typed)
        with ui.row().classes("items-center gap-3 w-full"):
            self.start = ui.button("Run", icon="play_arrow", on_click=self.run).props('no-caps title="Ctrl+Enter"')
            self.reset = ui.button("Defaults", icon="restart_alt", on_click=self.form.reset).props("flat no-caps")
            self.stop = ui.button("Cancel", icon="stop", on_click=self.running.cancel).props("outline no-caps")
            link = ui.button("Copy link", icon="link", on_click=self._copy_link).props("flat no-caps data-test=copy-link")
            link.tooltip("The address of this lab with these values")
        with ui.column().classes("w-full gap-1") as self.going:
            self.bar = ui.linear_progress(0.0, show_value=False, size="8px").props('aria-label="Progress of the run"')
            self.words = ui.label().props("role=status aria-live=off")
        self.problem = ui.label("").classes("ctl-lab-error").props("role=alert")

    def _copy_link(self) -> None:
        """The address of the lab with what is typed."""
        if self.form is None:
            return
        plain = self.form.plain()
        runs, seed = plain.pop("")
        told = catalogue.address(self.lab, plain, runs, seed)
        ui.run_javascript(f"ctlabs.copy(location.origin + {json.dumps('/labs?' + told)})")
        self.shell.tell("The link is copied.")

    def _typed(self) -> None:
        if self.form is not None:
            if self.refused and None not in self.form.check():
                self.refused = False
            self.typed[self.lab] = self.form.plain()
            self._note()
            self._say_stale()

    def _note(self) -> None:
        self.shell.desk.store.note(self.draft, labs={"lab": self.lab, "typed": self.typed})

    # The run -----------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Start the lab's run, or go to the field that is in the way."""
        if self.form is None or self.running.running:
            return
        values, runs, seed = self.form.check()
        self.refused = values is None or runs is None or seed is None
        if values is None or runs is None or seed is None:
            self.problem.text = f"Not started. {self.form.focus_problem()}"
            return
        runner, folder = self.shell.desk.runner, catalogue.place(self.shell.desk.store.folder, self.draft, self.lab)
        self.running.start(catalogue.work(runner, self.draft, self.lab, values, runs, seed, folder), self.lab, runs)
        self.chosen = self.beside = None
        self.problem.text = ""
        self._look()
        ui.run_javascript(f"getHtmlElement({self.going.id})?.scrollIntoView({{block: 'nearest'}})")

    def _look(self) -> None:
        """Show how far the run is, and its report when there is a new one."""
        if self.form is None:
            return
        running = self.running.running
        mine = self.running.name == self.lab
        self.start.set_enabled(not running)
        self.stop.set_visibility(running and mine)
        self.going.set_visibility(running)
        if running:
            progress = self.running.progress
            known = progress is not None and progress.total > 0 and progress.done > 0
            self.bar.props("indeterminate" if not known else "", remove="" if not known else "indeterminate")
            self.bar.value = progress.fraction if progress is not None and known else 0.0
            other = "" if mine else f"{catalogue.sheet(self.running.name).heading} is running: "
            self.words.text = other + catalogue.said(progress, self.running.runs)
        if not self.refused:
            self.problem.text = self.running.problem if mine and not running else ""
        if self._shown != self.running.finished and not running:
            self._draw_results()
            if mine:
                ui.run_javascript(f"getHtmlElement({self.results.id})?.scrollIntoView({{block: 'start'}})")
        elif self.report is not None:
            self._show_theme()

    def _kept(self, lab: str) -> list[Path]:
        """The folders of the runs of a lab, the last one at the end."""
        return catalogue.kept(catalogue.place(self.shell.desk.store.folder, self.draft, lab))

    def _folder(self, lab: str) -> Path | None:
        """The folder of the run that is shown."""
        kept = self._kept(lab)
        return self.chosen if self.chosen in kept else kept[-1] if kept else None

    def _outcome(self, lab: str) -> LabOutcome | None:
        """What came of the run of a lab that is shown."""
        folder = self._folder(lab)
        return None if folder is None else catalogue.outcome(folder)

    def _draw_results(self) -> None:
        self._shown = self.running.finished
        self.results.clear()
        self.report: ui.element | None = None
        self.stale: ui.label | None = None
        found = self._outcome(self.lab)
        if found is None:
            return
        with self.results:
            ui.html("<h3>Report</h3>", sanitize=False)
            with ui.row().classes("items-center gap-2"):
                icon = "error" if found.failed else "check_circle"
                with (
                    ui.row()
                    .classes("items-center gap-1 ctl-lab-verdict")
                    .props(f"role=status data-passed={'false' if found.failed else 'true'}")
                ):
                    ui.icon(icon, size="sm").props("aria-hidden=true")
                    ui.label(_sentence(found.verdict))
                ui.label(f"{found.runs} runs, seed {found.seed}, {found.seconds:.1f} s").classes("ctl-lab-source")
            self.stale = ui.label().classes("ctl-lab-hint")
            self._say_stale(found)
            self._draw_kept(found)
            self._draw_links(found)
            title = f"{len(found.checks)} checks"
            with ui.expansion(title, value=bool(found.failed)).props("dense").classes("w-full"):
                ui.label(f"{help_for('labs.checks').what} {help_for('labs.checks').note}").classes("ctl-lab-hint")
                ui.html(_checks(found), sanitize=False).classes("ctl-lab-checks").props(
                    'tabindex=0 role=region aria-label="Checks"'
                )
            self.report = ui.element("iframe").classes("ctl-lab-report")
            self.report.props["title"] = f"Report: {found.title}"
            self.report.props["sandbox"] = ""  # no scripts, no forms, nothing
            self._theme = ""
            self._show_theme()

    def _draw_kept(self, found: LabOutcome) -> None:
        """The runs that are kept, and two of them beside each other."""
        kept = {str(folder): catalogue.outcome(folder) for folder in reversed(self._kept(self.lab))}
        runs = {path: _told(path, each) for path, each in kept.items() if each is not None}
        if len(runs) < 2:
            return
        shown = str(self._folder(self.lab))
        others = {"": "no other run", **{path: words for path, words in runs.items() if path != shown}}

        def look(path: str) -> None:
            self.chosen = Path(path)
            if self.beside == self.chosen:
                self.beside = None
            self._draw_results()

        def compare(path: str) -> None:
            self.beside = Path(path) if path else None
            self._draw_results()

        beside = str(self.beside) if self.beside is not None and str(self.beside) in others else ""
        with ui.row().classes("items-center gap-3 w-full"):
            choose = ui.select(runs, value=shown, label="Run", on_change=lambda event: look(event.value))
            choose.props("outlined dense data-test=lab-run").classes("ctl-lab-choice")
            other = ui.select(others, value=beside, label="Compare with", on_change=lambda event: compare(event.value))
            other.props("outlined dense data-test=lab-beside").classes("ctl-lab-choice")
        second = kept.get(beside)
        if second is not None:
            rows = catalogue.compared(found, second)
            heads = ("", f"run {_number_of(shown)}", f"run {_number_of(beside)}")
            ui.html(table(heads, rows, "Two runs beside each other"), sanitize=False).props("data-test=lab-compared")

    def _show_theme(self) -> None:
        """The report in the page's colours."""
        if self.report is not None and self._theme != self.shell.theme:
            self._theme = self.shell.theme
            self.report.props(f'src="{self._address("report.html")}&theme={self._theme}"')

    def _draw_links(self, found: LabOutcome) -> None:
        with ui.element("div").classes("ctl-lab-links"):
            links = [
                ("Open in a new tab", "report.html", "target=_blank rel=noopener"),
                ("Download report.html", "report.html", f'download="{found.lab}.html"'),
                (f"Download {found.tables} tables (CSV, ZIP)", "tables.zip", f'download="{found.lab}-tables.zip"'),
                ("Download results.json", "results.json", f'download="{found.lab}.json"'),
            ]
            for text, name, props in links:
                with ui.element("a").props(f'href="{self._address(name)}" {props}'):
                    ui.label(text)

    def _say_stale(self, found: LabOutcome | None = None) -> None:
        if getattr(self, "stale", None) is None or self.form is None:
            return
        found = self._outcome(self.lab) if found is None else found
        values, runs, seed = self.form.check()
        same = found is not None and (values, runs, seed) == (found.parameters, found.runs, found.seed)
        if self.stale is not None:
            self.stale.text = "" if same else "This report was made with other values than those above."

    def _address(self, name: str) -> str:
        """Where a file of the report is; another address for every report, so that none is taken from the browser's memory."""
        folder = self._folder(self.lab)
        if folder is None:
            return ""
        stamp = (folder / "report.html").stat().st_mtime_ns
        return FILES.format(draft=self.draft, lab=self.lab, run=_number_of(str(folder)), name=name) + f"?v={stamp}"


class _Form:
    """The fields of a lab."""

    def __init__(
        self, sheet: LabSheet, fields: Sequence[Parameter], typed: dict[str, Any], changed: Callable[[], object]
    ) -> None:
        self.sheet, self.fields, self._changed = sheet, fields, changed
        self._inputs: dict[str, list[list[Any]]] = {}
        self._errors: dict[str, ui.label] = {}
        self._quiet = False
        runs, seed = typed.pop("", [str(sheet.runs), "1"])
        ui.html("<h3>Parameters</h3>", sanitize=False)
        with ui.element("div").classes("ctl-lab-form"):
            for field in fields:
                self._draw(field, typed.get(field.name, field.default))
        self._errors[""] = ui.label("").classes("ctl-lab-error").props("role=alert")
        ui.html("<h3>Experiment</h3>", sanitize=False)
        with ui.element("div").classes("ctl-lab-form"):
            tip = help_for("labs.runs")
            self._draw(
                Parameter(
                    ".runs",
                    "",
                    tip.what,
                    "number",
                    f"a whole number from 1 to {catalogue.RUNS:,}".replace(",", " "),
                    "",
                ),
                runs,
            )
            self._draw(Parameter(".seed", "", help_for("labs.seed").what, "number", "a whole number", ""), seed)
        self.check()

    def _draw(self, field: Parameter, value: Typed) -> None:
        wide = field.kind == "matrix" or len(field.default) > 24
        with ui.element("div").classes("ctl-lab-field" + (" ctl-lab-wide" if wide else "")):
            if field.symbol:
                unit = f", {escape(field.unit)}" if field.kind == "matrix" and field.unit not in {"1", ""} else ""
                name = "" if field.symbol == field.name else f' <span class="ctl-lab-hint">{escape(field.name)}</span>'
                ui.html(f"{mathml(field.symbol)}{unit}{name}", sanitize=False).props("aria-hidden=true").classes("ctl-lab-symbol")
            cells = self._cells(field, value)
            words = f"{field.meaning} · {field.allowed}".replace(">=", "≥").replace("null", "empty")
            hint = ui.label(words).classes("ctl-lab-hint")
            error = ui.label("").classes("ctl-lab-error").props("role=alert")
        for cell in (cell for row in cells for cell in row):
            cell.props(f'aria-describedby="{hint.html_id} {error.html_id}"')
        self._inputs[field.name], self._errors[field.name] = cells, error

    def _cells(self, field: Parameter, value: Typed) -> list[list[Any]]:
        label = field.name.removeprefix(".").capitalize() if field.name.startswith(".") else field.name
        if field.kind == "flag":
            return [[ui.checkbox(label, value=value == "true", on_change=self._edited)]]
        if isinstance(value, str):
            cell = ui.input(None if field.symbol else label, value=value, on_change=self._edited).classes("w-full")
            if field.symbol:
                unit = "" if field.unit in {"1", ""} else f", {field.unit}"
                cell.props["aria-label"] = f"{field.name}{unit}"
            cell.props("outlined dense hide-bottom-space no-error-icon autocomplete=off spellcheck=false")
            if field.unit not in {"1", ""}:
                cell.props["suffix"] = field.unit
            return [[cell]]
        cells: list[list[Any]] = []
        width = len(value[0])
        with (
            ui.element("div").classes("ctl-lab-matrix").style(f"grid-template-columns: repeat({width}, minmax(3rem, 1fr))")
        ):
            for i, row in enumerate(value):
                cells.append([])
                for j, text in enumerate(row):
                    cell = ui.input(value=text, on_change=self._edited).props("outlined dense hide-bottom-space")
                    cell.props(f'no-error-icon autocomplete=off aria-label="{label}, row {i + 1}, column {j + 1}"')
                    cells[-1].append(cell)
        return cells

    def _edited(self) -> None:
        if not self._quiet:
            self.check()
            self._changed()

    def reset(self) -> None:
        """Put the defaults back."""
        self._quiet = True
        defaults = {field.name: field.default for field in self.fields}
        for name, value in {**defaults, ".runs": str(self.sheet.runs), ".seed": "1"}.items():
            for i, row in enumerate(self._inputs[name]):
                for j, cell in enumerate(row):
                    text = value if isinstance(value, str) else value[i][j]
                    cell.value = text == "true" if isinstance(cell, ui.checkbox) else text
        self._quiet = False
        self._edited()

    def _typed(self, name: str) -> Typed:
        cells = [[_typed(cell) for cell in row] for row in self._inputs[name]]
        field = next((each for each in self.fields if each.name == name), None)
        return cells if field is not None and field.kind == "matrix" else cells[0][0]

    def plain(self) -> dict[str, Any]:
        """What is typed, as it is kept."""
        found: dict[str, Any] = {field.name: self._typed(field.name) for field in self.fields}
        return found | {"": [self._typed(".runs"), self._typed(".seed")]}

    def check(self) -> tuple[dict[str, Any] | None, int | None, int | None]:
        """Say at the fields what is wrong with them; parameters, runs and seed, None where they are wrong."""
        checked = catalogue.check(self.sheet.name, {field.name: self._typed(field.name) for field in self.fields})
        problems, counts = dict(checked.problems), {}
        for name, least, most in ((".runs", 1, catalogue.RUNS), (".seed", 0, 2**63 - 1)):
            try:
                counts[name] = whole(self._typed(name), least, most)
            except ValueError as error:
                problems[name] = str(error)
        for name, label in self._errors.items():
            self._mark(name, label, problems.get(name, ""))
        return checked.values, counts.get(".runs"), counts.get(".seed")

    def _mark(self, name: str, label: ui.label, problem: str) -> None:
        if label.text == problem:
            return
        label.text = problem
        for cell in (cell for row in self._inputs.get(name, ()) for cell in row):
            if problem:
                cell.props("error aria-invalid=true")
            else:
                cell.props(remove="error aria-invalid")

    def focus_problem(self) -> str:
        """Go to the first field that is wrong, and say what is wrong with it."""
        for name, label in self._errors.items():
            if not label.text:
                continue
            if name in self._inputs:
                cell = self._inputs[name][0][0]
                cell.run_method("focus")
                ui.run_javascript(f"getHtmlElement({cell.id})?.scrollIntoView({{block: 'center'}})")
            return f"{name.removeprefix('.')}: {label.text}" if name else label.text
        return ""


def _typed(cell: Any) -> str:
    """What a field holds, as text."""
    if isinstance(cell, ui.checkbox):
        return "true" if cell.value else "false"
    return "" if cell.value is None else str(cell.value)


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}"


def statement(sheet: LabSheet) -> str:
    """What is given and asked, with its formulas set; of a lab without a sheet, its text."""
    asked = sheet.asked
    if asked is None:
        return "".join(f"<p>{escape(paragraph)}</p>" for paragraph in sheet.statement)
    given = "".join(f"<p>{inline(' '.join(part.split()))}</p>" for part in asked.statement.split("\n\n"))
    items = "".join(f"<dt>({escape(letter)})</dt><dd>{inline(words)}</dd>" for letter, words in asked.items.items())
    aim = f"<p><b>Aim.</b> {inline(' '.join(asked.aim.split()))}</p>" if asked.aim else ""
    return f"{given}<dl>{items}</dl>{aim}"


def _number_of(folder: str) -> str:
    """The number of a run by its folder; 0 of one from before runs had numbers."""
    name = Path(folder).name
    return name if name.isdigit() else "0"


def _told(folder: str, found: LabOutcome) -> str:
    """A run in a list: number, time, verdict, runs and seed."""
    when = time.strftime("%Y-%m-%d %H:%M", time.localtime((Path(folder) / "results.json").stat().st_mtime))
    return f"{_number_of(folder)} · {when} · {found.runs} runs, seed {found.seed} · {found.verdict}"


def _checks(found: LabOutcome) -> str:
    """The checks as a table, those that failed first."""
    heads = ("", "check", "part", "one way", "another way", "value", "expected", "tolerance")
    rows = []
    for check in sorted(found.checks, key=lambda each: each["passed"]):
        mark = '<span aria-label="passed">✓</span>' if check["passed"] else '<strong class="ctl-lab-error">failed</strong>'
        words = [check["name"], check["part"], *check["route"]]
        numbers = [
            printed(number(check["value"])),
            printed(number(check["expected"])),
            f"{check['kind']} {printed(number(check['tolerance'], 2))}",
        ]
        cells = [f"<td>{mark}</td>", *(f"<td>{escape(str(word))}</td>" for word in words)]
        rows.append("<tr>" + "".join([*cells, *(f'<td class="n">{escape(text)}</td>' for text in numbers)]) + "</tr>")
    head = "".join(f"<th scope=col>{text}</th>" if text else "<td></td>" for text in heads)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


# The files ---------------------------------------------------------------------------------------------------------------


def _serve_files(desk: Desk) -> None:
    """Let the application serve the reports of a draft to its owner; once."""
    app.state.ctlabs_desk = desk
    if not any(getattr(route, "path", "") == FILES for route in app.routes):
        app.get(FILES, include_in_schema=False)(_file)
        data, known = desk.store.folder, desk.store.draft
        threading.Thread(
            target=catalogue.tidy, args=(data, lambda draft: known(draft) is not None), daemon=True
        ).start()


def _file(request: Request, draft: str, lab: str, run: str, name: str) -> Response:
    """A file of a report."""
    desk: Desk = app.state.ctlabs_desk
    missing = PlainTextResponse("ctlabs workbench: no such report\n", 404)
    if desk.store.draft(draft, desk.owner(request.scope["ctlabs.session"])) is None:
        return missing
    try:
        place = catalogue.place(desk.store.folder, draft, lab)
        folder = next(each for each in catalogue.kept(place) if _number_of(str(each)) == run)
        content, kind = _content(folder, name, request.query_params.get("theme", "auto"))
    except (ValueError, OSError, StopIteration):
        return missing
    headers = {"content-security-policy": POLICY, "cache-control": "private, no-store"}
    return Response(content, media_type=kind, headers=headers)


def _content(folder: Path, name: str, theme: str) -> tuple[bytes, str]:
    if name == "report.html":
        return catalogue.page(folder, theme).encode(), "text/html"
    if name == "results.json":
        return (folder / "results.json").read_bytes(), "application/json"
    if name == "tables.zip":
        return catalogue.tables(folder), "application/zip"
    msg = f"report: expected report.html, results.json or tables.zip, received {name!r}"
    raise ValueError(msg)
