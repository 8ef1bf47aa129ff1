"""Keep: every finished experiment; to be opened again, compared, repeated, exported, deleted and put back."""

from __future__ import annotations

import asyncio
import time
import tomllib
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.workbench.desk import tour
from ctlabs.workbench.pages.dialogs import buttons, dialog
from ctlabs.workbench.pages.showing import Show, help_button
from ctlabs.workbench.pages.tables import difference, table
from ctlabs.workbench.runs import figures
from ctlabs.workbench.runs.kinds import PICTURES, TABLES
from ctlabs.workbench.runs.outcomes import Outcome
from ctlabs.workbench.runs.running import said
from ctlabs.workbench.runs.summaries import KINDS

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.desk.store import KeptExperiment
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.runs.comparing import Difference, Row

PAGE = {"place": 7, "title": "Keep", "icon": "inventory_2"}

#: So many experiments are listed at first, and so many more at a time.
LISTED = 25
#: What an experiment can be exported as: groups, and in each the kinds, with their names.
EXPORTS = (
    ("Report", "model, figures, checks; PDF needs the extra print", (("html", "HTML"), ("pdf", "PDF"))),
    ("Table", "every row, nothing thinned", (("csv", "CSV"), ("parquet", "Parquet"))),
    ("Gains", "the filter's matrices for other programs", (("npz", "NumPy"), ("mat", "MATLAB"), ("h", "C"))),
    ("Figure", "as a picture, as a drawing", (("png", "PNG"), ("svg", "SVG"))),
    ("Lines", "that give these numbers again", (("python", "Python"), ("commands", "Commands"))),
    ("All of it", "the model file; all numbers and settings", (("toml", "TOML"), ("json", "JSON"))),
)


def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Keep(session, shell).draw()


class _Keep:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.show, self.running = Show(shell), session.experiment_run
        self.seen, self.most = self.running.finished, LISTED
        self.chosen: list[int] = []
        self.boxes: dict[int, ui.checkbox] = {}
        self.deleted: int | None = None

    def draw(self) -> None:
        self.shell.name_draft(self.session.title)
        with self.show.card("Kept experiments", "keep.list", wide=True, test="kept") as card:
            self.box = card.section
            with ui.element("div").classes("ctl-keep-bar"):
                self.search = ui.input("Search", on_change=lambda: self._list()).props(
                    "outlined dense clearable debounce=150 type=search data-test=kept-search"
                )
                self.compare_button = ui.button("Compare two", icon="compare_arrows", on_click=self._compare)
                self.compare_button.props("no-caps outline dense data-test=compare")
                help_button("keep.compare")
                self.told = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=kept-told")
                self.cancel = ui.button("Cancel", icon="stop", on_click=self.running.cancel).props(
                    "no-caps outline dense data-test=cancel"
                )
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=run-error")
            self.undo_box = (
                ui.element("div").classes("ctl-keep-undo").props("role=status aria-live=polite data-test=undo-delete")
            )
            self.list = ui.element("div").classes("ctl-keep-list").props('role=list aria-label="Kept experiments"')
            self.more = ui.button("Show more", on_click=self._more).props("no-caps flat dense")
        self.undo_box.set_visibility(False)
        with self.show.card("Comparison", "keep.compare", wide=True, test="comparison") as card:
            self.comparison = card.section
            self.comparison_body = ui.element("div").classes("w-full flex flex-col gap-4")
        self.comparison.set_visibility(False)
        with (
            ui.expansion("Deleted, can be put back", icon="delete_outline")
            .classes("w-full")
            .props("data-test=deleted") as self.deleted_box
        ):
            self.deleted_list = ui.element("div").classes("ctl-keep-list").props("role=list")
        self.shell.shortcut("mod+z", "Put the deleted experiment back", self._undo, in_fields=False)
        self.shell.on_leave(self.running.watch(self._look))
        self._list()
        self._look()

    # The list --------------------------------------------------------------------------------------------------------

    def _list(self) -> None:
        words = str(self.search.value or "").lower().split()
        kept = [each for each in self.session.kept() if all(word in _text(each).lower() for word in words)]
        self.chosen = [number for number in self.chosen if any(each.id == number for each in kept)]
        self.list.clear()
        self.boxes = {}
        with self.list:
            for each in kept[: self.most]:
                self._row(each)
            if not kept:
                with ui.element("div").classes("q-pa-md"):
                    ui.label("None is found." if words else "Nothing yet: every experiment, filtered record and fit is kept here.")
                    if not words:
                        ui.button(
                            "Go to the experiment", icon="science", on_click=lambda: self.shell.go("experiment")
                        ).props("no-caps outline dense")
        self.more.set_visibility(len(kept) > self.most)
        self._tell_chosen()
        gone = self.session.kept(deleted=True)
        self.deleted_box.set_visibility(bool(gone))
        self.deleted_list.clear()
        with self.deleted_list:
            for each in gone[:LISTED]:
                with ui.element("div").classes("ctl-keep-row").props("role=listitem"):
                    ui.label(f"{each.id}").classes("ctl-show-hint")
                    ui.label(each.name).classes("ctl-keep-name")
                    _labelled(
                        ui.button("Put back", icon="restore", on_click=lambda _, n=each.id: self._restore(n)),
                        f"Put back: {each.name}",
                    ).props("no-caps flat dense data-test=restore")

    def _row(self, each: KeptExperiment) -> None:
        number = each.id
        with (
            ui.element("div").classes("ctl-keep-row").props(f"role=listitem data-test=kept-row data-number={number}") as row
        ):
            row.props["data-open"] = str(self.session.result_id == number).lower()
            box = ui.checkbox(
                value=number in self.chosen, on_change=lambda event, n=number: self._choose(n, bool(event.value))
            )
            _labelled(box, f"Select for comparison: {each.name}").props("dense data-test=select")
            self.boxes[number] = box
            with ui.element("div").classes("min-w-0"):
                ui.label(each.name).classes("ctl-keep-name").props("data-test=kept-name")
                ui.label(_about(each)).classes("ctl-show-hint").props("data-test=kept-about")
            with ui.element("div").classes("ctl-keep-buttons"):
                for word, icon, test, action in (
                    ("Open", "folder_open", "open", self._open),
                    ("Run again", "replay", "rerun", self._rerun),
                    ("Rename", "edit", "rename", self._rename),
                    ("Export", "download", "export", self._export),
                    ("Delete", "delete_outline", "delete", self._delete),
                ):
                    if each.kind != "experiment" and test in {"rerun", "export"}:
                        continue  # on the page that it opens there is what runs and exports it
                    button = ui.button(icon=icon, on_click=lambda _, n=number, action=action: action(n))
                    _labelled(button, f"{word}: {each.name}").props(f"flat round dense data-test={test}")
                    with button:
                        ui.tooltip(word)

    def _more(self) -> None:
        self.most += LISTED
        self._list()

    def _open(self, number: int) -> None:
        self.shell.saving()
        try:
            page = self.session.reopen(number)
        except ValueError as why:
            self.wrong.text = str(why)
            return
        finally:
            self.shell.saved()
        self.shell.tell("Opened with its model; undo on the page of the model brings the other one back")
        self.shell.go(page)

    def _rerun(self, number: int) -> None:
        if self.running.running:
            self.shell.tell("Another experiment is running")
            return
        self.running.start(lambda progress, cancel: self.session.rerun(number, progress=progress, cancel=cancel))

    def _rename(self, number: int) -> None:
        name = next(each.name for each in self.session.kept() if each.id == number)
        with dialog("Rename", 24) as made:
            field = (
                ui.input("Name", value=name)
                .props("outlined autofocus maxlength=120 data-test=new-name")
                .classes("w-full")
            )

            def take() -> None:
                self.session.rename(number, str(field.value or ""))
                made.close()
                self._list()

            field.on("keydown.enter", take)
            buttons(made, "Rename", "take-name", take)

    def _export(self, number: int) -> None:
        export_dialog(self.session, self.shell, number)

    def _delete(self, number: int) -> None:
        name = next(each.name for each in self.session.kept() if each.id == number)
        self.session.delete(number)
        self.deleted = number
        self._list()
        self.undo_box.clear()
        with self.undo_box:
            ui.label(f"Deleted: {name}")
            ui.button("Undo", icon="undo", on_click=self._undo).props("no-caps flat dense data-test=undo")
        self.undo_box.set_visibility(True)

    def _undo(self) -> None:
        if self.deleted is not None:
            self._restore(self.deleted)

    def _restore(self, number: int) -> None:
        self.session.restore(number)
        self.deleted = None
        self.undo_box.set_visibility(False)
        self._list()

    def _look(self) -> None:
        """Show how far a run is."""
        now = self.running
        with self.box:
            self.cancel.set_visibility(now.running)
            self.wrong.text = now.problem
            if now.running:
                self.told.text = said(now.progress)
            elif now.finished != self.seen:
                self.seen = now.finished
                self._list()
            else:
                self._tell_chosen()

    # Comparing -------------------------------------------------------------------------------------------------------

    def _choose(self, number: int, chosen: bool) -> None:
        self.chosen = [each for each in self.chosen if each != number] + ([number] if chosen else [])
        while len(self.chosen) > 2:
            old = self.chosen.pop(0)
            if old in self.boxes:
                self.boxes[old].value = False
        self._tell_chosen()

    def _tell_chosen(self) -> None:
        self.compare_button.set_enabled(len(self.chosen) == 2)
        if not self.running.running:
            count = len(self.chosen)
            self.told.text = "Select two experiments to compare them." if count < 2 else "Two are selected."

    def _compare(self) -> None:
        a, b = self.chosen
        names = {each.id: each.name for each in self.session.kept()}
        first, second = f"{a}: {names[a]}", f"{b}: {names[b]}"
        found = self.session.compare(a, b)
        outcomes = [found for found in (self.session.found(a), self.session.found(b)) if isinstance(found, Outcome)]
        self.comparison_body.clear()
        self.comparison.set_visibility(True)
        with self.comparison_body:
            ui.label(f"{first}, and {second}").classes("ctl-show-hint")
            self._rows("Settings", found.settings, first, second)
            self._rows("Results", found.results, first, second)
            self._models(found, first, second)
            if len(outcomes) < 2:
                return
            drawing = figures.side_by_side((f"{a}", outcomes[0]), (f"{b}", outcomes[1]))
            if drawing is not None:
                self.show.plot(drawing, test="plot-comparison")
            else:
                ui.label("They have no state in common (by name and unit), so there is no figure of both.").classes(
                    "ctl-show-hint"
                )
        with self.box:
            ui.run_javascript(f"getHtmlElement({self.comparison.id})?.scrollIntoView({{block: 'start'}})")

    def _rows(self, title: str, rows: Sequence[Row], first: str, second: str) -> None:
        differ = [row for row in rows if not row.same]
        heads = ["", first, second, "Unit"]
        raw = [heads, *([row.name, row.first, row.second, row.unit] for row in rows)]
        with ui.element("div").classes("w-full"):
            with ui.element("div").classes("ctl-show-head"):
                ui.html(f"<h3>{escape(title)}</h3>", sanitize=False)
                ui.space()
                self.show.copy(
                    lambda: figures.table([[_plain(value) for value in row] for row in raw]),
                    f"Copy all {title.lower()}",
                    words="Numbers",
                )
            if not differ:
                ui.label(f"All {len(rows)} are the same.").props(f"data-test=same-{title.lower()}")
                return
            shown = [[row.name, _plain(row.first), _plain(row.second), row.unit] for row in differ]
            ui.html(table(heads, shown), sanitize=False).classes("w-full").props(f"data-test=differ-{title.lower()}")
            if len(differ) < len(rows):
                ui.label(f"{len(rows) - len(differ)} more are the same.").classes("ctl-show-hint")

    def _models(self, found: Difference, first: str, second: str) -> None:
        ui.html("<h3>Models</h3>", sanitize=False).classes("ctl-show-head")
        if found.same_model:
            ui.label("The models are the same.").props("data-test=same-model")
        else:
            ui.html(difference(found.changes(), first, second), sanitize=False).classes("w-full").props(
                "data-test=differ-model"
            )


def export_dialog(session: Session, shell: Shell, number: int) -> None:
    """Choose what an experiment is exported as; the file is made in a thread and goes to the browser's downloads."""
    with shell.client, dialog("Export", 30) as made:
        _Export(session, number, made.close).draw()


class _Export:
    """The dialog; it stays usable while a file is made, and says which and for how long."""

    def __init__(self, session: Session, number: int, close: Callable[[], object]) -> None:
        self.session, self.number, self._close = session, number, close
        self.choices: dict[str, ui.select] = {}
        self.begun: dict[str, float] = {}

    def draw(self) -> None:
        help_button("keep.export")
        parts = {"Table": ("table", self.session.tables(self.number)), "Figure": ("figure", self.session.figures(self.number))}
        first = True
        with ui.element("div").classes("ctl-keep-export").props("role=list"):
            for group, meaning, kinds in EXPORTS:
                with ui.element("div").props(f'role=listitem aria-label="{group}"'):
                    ui.label(group).classes("ctl-keep-name")
                    ui.label(meaning).classes("ctl-show-hint")
                    if group in parts:
                        name, options = parts[group]
                        titles = {key: f"{key.replace('_', ' ')}: {text}" for key, text in options.items()}
                        chosen = ui.select(titles, value=next(iter(options), None), label=group)
                        chosen.props(f"outlined dense options-dense data-test=export-{name}").classes("w-full")
                        self.choices[name] = chosen
                    with ui.row().classes("gap-2"):
                        for kind, word in kinds:
                            button = ui.button(word).props(f"no-caps outline dense data-test=export-{kind} {'autofocus' if first else ''}")
                            button.props["aria-label"] = f"{group} as {word}"
                            button.on_click(lambda _, kind=kind, word=word, button=button: self._export(kind, word, button))
                            first = False
        self.told = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=export-told")
        self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=export-error")
        ui.button("Close", on_click=self._close).props("flat no-caps data-test=export-close")
        self.clock = ui.timer(1.0, self._tell, active=False)

    async def _export(self, kind: str, word: str, button: ui.button) -> None:
        part = self.choices["table"].value if kind in TABLES else self.choices["figure"].value if kind in PICTURES else ""
        button.props("loading")
        self.wrong.text = ""
        self.begun[word] = time.monotonic()
        self._tell()
        self.clock.activate()
        try:
            content = await asyncio.to_thread(self.session.export, self.number, kind, str(part or ""))
            ui.download.content(content, self.session.export_name(self.number, kind, str(part or "")))
            if kind == "html":
                tour.mark(self.session, "export")
        except (ValueError, ArithmeticError) as why:
            self.wrong.text = str(why)
        finally:
            del self.begun[word]
            button.props(remove="loading")
            self._tell()

    def _tell(self) -> None:
        """What is being made, and for how long."""
        now = time.monotonic()
        self.told.text = "; ".join(f"Making {word}… {now - begun:.0f} s" for word, begun in self.begun.items())
        if not self.begun:
            self.clock.deactivate()


# In words ------------------------------------------------------------------------------------------------------------


def _about(each: KeptExperiment) -> str:
    """When, which model, with which settings."""
    plan = each.settings
    data = plan.get("data")
    words = [time.strftime("%Y-%m-%d %H:%M", time.localtime(each.created)), f"no. {each.id}", _title(each.model)]
    if data:
        words.append(f"data {data['name']}" + (f", {KINDS[each.kind]}" if each.kind in KINDS else ""))
    else:
        words.append(f"{plan.get('steps')} steps, {plan.get('runs')} runs, seed {each.seed}")
    words.append(", ".join(plan.get("algorithms", plan.get("free", ()))))
    if plan.get("design") is not None:
        words.append("the filter has another model")
    if count := len(plan.get("anomalies", ())):
        words.append(f"{count} {'anomaly' if count == 1 else 'anomalies'}")
    return " · ".join(filter(None, words))


def _text(each: KeptExperiment) -> str:
    return f"{each.name} {_about(each)}"


def _title(model: str) -> str:
    try:
        return str(tomllib.loads(model).get("title") or "Untitled model")
    except tomllib.TOMLDecodeError:
        return "Untitled model"


def _plain(value: Any) -> Any:
    """A value in a table: a text of several lines by its first one."""
    if isinstance(value, str) and "\n" in value:
        return f"{_title(value)} ({len(value.splitlines())} lines)"
    return value


def _labelled(element: Any, label: str) -> Any:
    element.props["aria-label"] = label
    return element
