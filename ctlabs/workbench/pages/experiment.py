"""Experiment: what is tried, its run, and what came of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.files.modelfile import gallery, loads
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.models import Anomaly
from ctlabs.workbench.desk import commands, plain
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.dialogs import buttons, dialog
from ctlabs.workbench.pages.keep import export_dialog
from ctlabs.workbench.pages.results import Results
from ctlabs.workbench.pages.showing import Show, help_button, times
from ctlabs.workbench.pages.tables import difference
from ctlabs.workbench.runs.outcomes import LARGEST, LIMITS
from ctlabs.workbench.runs.running import said

if TYPE_CHECKING:
    from nicegui.events import UploadEventArguments

    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

PAGE = {"place": 3, "title": "Experiment", "icon": "science"}

#: Names of the first measurement's instants.
FIRST = {1: "from t1 on", 0: "from t0 on"}
#: What an anomaly is.
LOST, EXACT, OTHER = "lost (R = ∞)", "exact (R = 0)", "another variance"




def page(session: Session, shell: Shell) -> None:
    """Draw the page."""
    _Experiment(session, shell).draw()


class _Experiment:
    """The page in one tab."""

    def __init__(self, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.show, self.running = Show(shell, session.view), session.experiment_run
        self.seen = self.running.finished
        self.fields: dict[str, ui.input] = {}
        self.lines: dict[str, ui.label] = {}
        self.held_up = False  # by a field that is wrong
        self.upload: ui.upload

    # Drawing ---------------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        self.shell.name_draft(self.session.title)
        with ui.element("div").classes("ctl-exp-page"):
            with ui.element("div").classes("ctl-exp-plan"):
                self._draw_run()
                self._draw_fields()
                self._draw_algorithms()
                self._draw_design()
                self._draw_anomalies()
                self._draw_data()
            with ui.element("div").classes("ctl-exp-found") as self.found_box:
                self._draw_difference()
                self._draw_found()
        self.shell.shortcut("mod+enter", "Run the experiment", self.run)
        self.shell.shortcut("alt+shift+x", "Cancel the run", self.running.cancel)
        self.shell.on_leave(self.running.watch(self._look))
        self._look()
        self._found()

    def _draw_run(self) -> None:
        with ui.element("section").classes("ctl-show-card ctl-exp-run").props('aria-label="Run"'):
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                self.run_button = ui.button("Run", icon="play_arrow", on_click=self.run)
                self.run_button.props('no-caps data-test=run aria-keyshortcuts="Control+Enter"').classes("grow")
                with self.run_button:
                    ui.tooltip("Ctrl+Enter").props('anchor="top middle" self="bottom middle"')
                self.cancel_button = ui.button("Cancel", icon="stop", on_click=self._cancel)
                self.cancel_button.props("no-caps outline data-test=cancel")
                help_button("experiment.progress")
            self.bar = ui.linear_progress(value=0.0, show_value=False, size="8px").props(
                'aria-label="Progress" data-test=progress'
            )
            self.told = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=progress-text")
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=run-error")
            self.to_model = ui.button("Go to the model", icon="grid_on", on_click=lambda: self.shell.go("model"))
            self.to_model.props("outline no-caps dense")

    def _draw_fields(self) -> None:
        plan = self.session.plan
        with self.show.card("Experiment", test="plan"):
            with ui.element("div").classes("ctl-exp-fields"):
                for name, title in (("steps", "Steps"), ("runs", "Runs"), ("seed", "Seed")):
                    with ui.element("div").classes("ctl-exp-field"):
                        field = ui.input(
                            title, value=str(getattr(plan, name)), on_change=lambda _, name=name: self._typed(name)
                        )
                        field.without_auto_validation()  # which would take back what is said of the text
                        field.props(
                            "outlined dense debounce=250 inputmode=numeric autocomplete=off hide-bottom-space "
                            f"no-error-icon data-test={name}"
                        )
                        help_button(f"experiment.{name}")
                    field.on("blur", lambda _, name=name: self._tidy(name))
                    self.fields[name] = field
                with ui.element("div").classes("ctl-exp-field"):
                    first = ui.select(
                        FIRST,
                        value=plan.first,
                        label="Measured",
                        on_change=lambda e: self._set("first", first=e.value),
                    )
                    first.props("outlined dense options-dense data-test=first")
                    help_button("experiment.first")
            self.lines["first"] = _error()

    def _draw_algorithms(self) -> None:
        with self.show.card("Algorithms", "experiment.algorithms", test="algorithms"):
            with ui.element("div").classes("ctl-exp-algorithms").props('role=group aria-label="Algorithms"'):
                self.boxes: dict[str, ui.checkbox] = {}
                for name in FORMS:
                    with ui.element("div").classes("ctl-exp-algorithm"):
                        box = ui.checkbox(
                            _title(name), value=name in self.session.plan.algorithms, on_change=self._algorithms
                        )
                        box.props(f"dense data-test=algorithm-{name}")
                        help_button(f"algorithm.{name}")
                    self.boxes[name] = box
            self.lines["algorithms"] = _error()
            self.first_algorithm = ui.label("").classes("ctl-show-hint")
        self._tell_first()

    def _draw_design(self) -> None:
        with self.show.card("The filter's model", "experiment.design", test="design"):
            self.design_told = ui.label("").classes("w-full")
            self.lines["design"] = _error()
            with ui.row().classes("gap-2"):
                ui.button("Choose another…", icon="swap_horiz", on_click=self._choose_design).props(
                    "no-caps outline dense data-test=design-choose"
                )
                self.design_same = ui.button("The same as the truth", on_click=lambda: self._design(None))
                self.design_same.props("no-caps flat dense data-test=design-same")
        self._tell_design()

    def _draw_anomalies(self) -> None:
        with self.show.card("Anomalies", "experiment.anomalies", test="anomalies"):
            self.anomaly_list = ui.element("ul").classes("ctl-exp-list").props('aria-label="Anomalies"')
            self.lines["anomalies"] = _error()
            ui.button("Add an anomaly…", icon="add", on_click=self._add_anomaly).props(
                "no-caps outline dense data-test=add-anomaly"
            )
        self._tell_anomalies()

    def _draw_data(self) -> None:
        with self.show.card("Measured data", "experiment.data", test="data"):
            with ui.element("div").classes("ctl-exp-drop").props("data-test=drop") as zone:
                self.data_told = ui.label("").props("role=status aria-live=polite data-test=data-told")
                with ui.row().classes("gap-2"):
                    ui.button(
                        "Choose a CSV file…", icon="upload_file", on_click=lambda: self.upload.run_method("pickFiles")
                    ).props("no-caps outline dense data-test=choose-data")
                    self.data_remove = ui.button("Remove", icon="close", on_click=self._remove_data)
                    self.data_remove.props(
                        'no-caps flat dense aria-label="Remove the measured data" data-test=remove-data'
                    )
                self.lines["data"] = _error()
            self.upload = ui.upload(
                auto_upload=True, max_file_size=LARGEST, on_upload=self._uploaded, on_rejected=self._rejected
            )
            self.upload.props('accept=".csv,.txt,.tsv,text/csv" data-test=upload').classes("hidden")
            accept_drops(zone, self.upload)
        self._tell_data()

    def _draw_difference(self) -> None:
        with self.show.card(
            "Difference of the truth and the filter's model", "result.difference", test="difference"
        ) as card:
            self.difference_card = card.section
            self.difference_body = ui.html("", sanitize=False).classes("w-full")
        self._tell_difference()

    def _draw_found(self) -> None:
        with (
            ui.element("section").classes("ctl-show-card").props('aria-label="Results" data-test=found') as self.found_card
        ):
            with ui.element("div").classes("ctl-show-head"):
                ui.html("<h2>Results</h2>", sanitize=False)
                ui.space()
                self.print = ui.button("Print", icon="print", on_click=lambda: ui.run_javascript("print()"))
                self.print.props("no-caps flat dense data-test=print")
                self.export = ui.button("Export…", icon="download", on_click=self._export)
                self.export.props("no-caps outline dense data-test=export")
            self.found_told = ui.label("").classes("ctl-show-hint").props("data-test=found-told")
            with ui.element("div").classes("ctl-exp-empty") as self.empty:
                ui.label("Nothing has been run yet. Press Run, or Ctrl+Enter.")
                to_kept = ui.button("Kept experiments", icon="inventory_2", on_click=lambda: self.shell.go("keep"))
                to_kept.props("no-caps flat dense data-test=to-kept").set_visibility(bool(self.session.kept()))
            self.results = Results(self.show, self.session)

    # The plan --------------------------------------------------------------------------------------------------------

    def _set(self, place: str, **changes: Any) -> bool:
        """Change the plan; what is wrong is said at the place."""
        self.shell.saving()
        try:
            self.session.set_plan(**changes)
        except ValueError as why:
            self._complain(place, str(why))
            self.shell.saved()
            return False
        except Exception as why:
            self.shell.not_saved(" ".join(str(why).split()))
            raise
        self._complain(place, "")
        self._changed()
        self.shell.saved()
        return True

    def _complain(self, place: str, line: str) -> None:
        if place in self.fields:
            field = self.fields[place]
            field.error = line.removeprefix(f"{place}: ") or None
            if line:
                field.props("aria-invalid=true")
            else:
                field.props(remove="aria-invalid")
        else:
            self.lines[place].text = line

    def _typed(self, name: str) -> bool:
        """A whole number is typed; it is in the plan when it is one."""
        try:
            value = plain.whole(self.fields[name].value, *LIMITS[name])
        except ValueError as why:
            self._complain(name, str(why))
            return False
        if value == getattr(self.session.plan, name):
            self._complain(name, "")
        elif not self._set(name, **{name: value}):
            return False
        self._in_order()
        return True

    def _changed(self) -> None:
        """Why the last run failed is not said of another plan."""
        if self.running.problem and not self.running.running:
            self.running.problem = ""
            self._look()

    def _in_order(self) -> None:
        """What kept an experiment from running has been put right, or will be said again."""
        if self.held_up:
            self.held_up, self.wrong.text = False, ""

    def _tidy(self, name: str) -> None:
        """A number that was understood is shown as it was."""
        if self._typed(name):
            self.fields[name].value = str(getattr(self.session.plan, name))

    def _algorithms(self) -> None:
        """Chosen algorithms keep their order; a new one comes last."""
        old = self.session.plan.algorithms
        chosen = [name for name in old if self.boxes[name].value]
        chosen += [name for name, box in self.boxes.items() if box.value and name not in old]
        if self._set("algorithms", algorithms=tuple(chosen)):
            self._tell_first()
            self._in_order()

    def _tell_first(self) -> None:
        names = self.session.plan.algorithms
        more = f"; {', '.join(map(_title, names[1:]))} compared with it on the first run" if len(names) > 1 else ""
        self.first_algorithm.text = f"Shown: the estimates by {_title(names[0])}{more}."

    def _tell_data(self) -> None:
        data = self.session.plan.data
        self.data_remove.set_visibility(data is not None)
        if data is None:
            names = ", ".join(self.session.sheet.measurements)
            self.data_told.text = f"None: the experiment is simulated. Drop a CSV file here with the columns {names}, and t if you have it."
        else:
            self.data_told.text = f"{data.name} is filtered instead of simulated runs."
            ui.timer(0, self._count_data, once=True)
        for name in ("steps", "runs", "seed"):
            self.fields[name].set_enabled(data is None)

    async def _count_data(self) -> None:
        """Read the record, which may be long, and say what is in it."""
        data = self.session.plan.data
        try:
            record = await self.session.record()
        except ValueError as why:
            self._complain("data", str(why))
            return
        if data is not None and record is not None and data == self.session.plan.data:
            missing = f", {record.missing} missing" if record.missing else ""
            self.data_told.text = f"{data.name}: {record.rows} rows{missing}. It is filtered instead of simulated runs."

    async def _uploaded(self, event: UploadEventArguments) -> None:
        content = await event.file.read()
        self.upload.reset()
        try:
            await self.session.upload(content, event.file.name)
        except ValueError as why:
            self._complain("data", str(why))
            return
        self._complain("data", "")
        self._tell_data()

    def _rejected(self) -> None:
        self._complain("data", f"file: expected a CSV file of at most {LARGEST // 10**6} MB, received another one")

    def _remove_data(self) -> None:
        if self._set("data", data=None):
            self._tell_data()

    # Anomalies -------------------------------------------------------------------------------------------------------

    def _tell_anomalies(self) -> None:
        names = self.session.sheet.measurements
        self.anomaly_list.clear()
        with self.anomaly_list:
            for i, each in enumerate(self.session.plan.anomalies):
                with ui.element("li").props("data-test=anomaly"):
                    words = _anomaly(each, names)
                    ui.label(words).classes("min-w-0")
                    remove = ui.button(icon="close", on_click=lambda _, i=i: self._remove_anomaly(i)).props(
                        "flat round dense size=sm data-test=remove-anomaly"
                    )
                    remove.props["aria-label"] = f"Remove: {words}"

    def _remove_anomaly(self, index: int) -> None:
        left = tuple(each for i, each in enumerate(self.session.plan.anomalies) if i != index)
        if self._set("anomalies", anomalies=left):
            self._tell_anomalies()

    def _add_anomaly(self) -> None:
        names = self.session.sheet.measurements
        with dialog("Add an anomaly", 20) as made:
            k = (
                ui.input("At step k")
                .props("outlined dense autofocus inputmode=numeric data-test=anomaly-k")
                .classes("w-full")
            )
            last = (
                ui.input("to step (only if it lasts)")
                .props("outlined dense inputmode=numeric data-test=anomaly-last")
                .classes("w-full")
            )
            which = (
                ui.select(dict(enumerate(names)), value=0, label="Measurement")
                .props("outlined dense data-test=anomaly-measurement")
                .classes("w-full")
            )
            kind = ui.radio([LOST, EXACT, OTHER], value=LOST).props("dense data-test=anomaly-kind")
            variance = ui.input("Variance R").props("outlined dense data-test=anomaly-R").classes("w-full")
            variance.bind_visibility_from(kind, "value", value=OTHER)
            wrong = _error()

            def add() -> None:
                try:
                    R = _variance(kind.value, variance.value)
                    anomaly = self._anomaly(k.value, last.value, int(which.value or 0), R)
                except ValueError as why:
                    wrong.text = str(why)
                    return
                if self._set("anomalies", anomalies=(*self.session.plan.anomalies, anomaly)):
                    self._tell_anomalies()
                    made.close()

            k.on("keydown.enter", add)
            buttons(made, "Add", "anomaly-add", add)

    def _anomaly(self, k: object, last: object, measurement: int, R: float) -> Anomaly:
        """The anomaly that was typed, within the steps of a simulation."""
        end = str(last or "").strip()
        made = Anomaly(_step(k, "k"), measurement, R, _step(end, "to step") if end else None)
        made.check()
        most, latest = self.session.plan.steps, max(made.k, made.last or 0)
        if self.session.plan.data is None and latest > most:
            msg = f"k: expected a step from 0 to {most}, received {latest}"
            raise ValueError(msg)
        if made in self.session.plan.anomalies:
            msg = "anomaly: expected one that is not in the list yet, received one that is"
            raise ValueError(msg)
        return made

    # The filter's model ----------------------------------------------------------------------------------------------

    def _tell_design(self) -> None:
        design = self.session.plan.design
        self.design_same.set_visibility(design is not None)
        if design is None:
            self.design_told.text = "The same as the truth."
        else:
            title = loads(design, "", check=False).title or "Untitled model"
            self.design_told.text = f"Another one: {title}"

    def _tell_difference(self) -> None:
        found = self.session.design_differs()
        self.difference_card.set_visibility(found is not None)
        if found is None:
            return
        lines = found.changes()
        self.difference_body.content = (
            difference(lines, "Truth (the model)", "The filter's model")
            if lines
            else "<p>They are the same, line by line.</p>"
        )

    def _design(self, text: str | None) -> str:
        """Take a text as the filter's model; what is wrong with it."""
        self.shell.saving()
        try:
            self.session.set_design(text)
        except ValueError as why:
            self.shell.saved()
            return str(why)
        self.shell.saved()
        self._complain("design", "")
        self._changed()
        self._tell_design()
        self._tell_difference()
        return ""

    def _choose_design(self) -> None:
        _DesignDialog(self.session, self._design)

    # The run ---------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Begin, if all fields are in order."""
        if self.running.running or self._refusal():
            return
        wrong = [name for name in self.fields if not self._typed(name)] if self.session.plan.data is None else []
        if not any(box.value for box in self.boxes.values()):
            wrong.append("algorithms")
        if wrong:
            self.held_up, self.wrong.text = True, f"To put right: {', '.join(wrong)}."
            return
        self.running.start(lambda progress, cancel: self.session.run(progress=progress, cancel=cancel))

    def _cancel(self) -> None:
        self.running.cancel()
        self.told.text = "Ending…"

    def _refusal(self) -> str:
        problems = self.session.sheet.problems
        if not problems:
            return ""
        where, what = next(iter(problems.items()))
        more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
        return f"The model cannot be run: {where + ': ' if where else ''}{what}{more}"

    def _look(self) -> None:
        """Show how far it is."""
        now, refusal = self.running, self._refusal()
        with self.found_box:
            self.run_button.set_enabled(not now.running and not refusal)
            self.cancel_button.set_visibility(now.running)
            self.bar.set_visibility(now.running)
            self.to_model.set_visibility(bool(refusal))
            if now.running:
                self.told.text, self.wrong.text, self.held_up = said(now.progress), "", False
                self.bar.value = now.progress.fraction if now.progress else 0.0
                return
            self.told.text = "Cancelled; nothing was kept of it." if now.cancelled else ""
            self.wrong.text, self.held_up = refusal or now.problem, False
            if now.finished != self.seen:
                self.seen = now.finished
                self._found()
                ui.run_javascript(f"ctlabs.bring({self.found_card.id})")

    def _found(self) -> None:
        found, number = self.session.result, self.session.result_id
        self.empty.set_visibility(found is None)
        self.export.set_visibility(number is not None)
        self.print.set_visibility(found is not None)
        self.found_told.set_visibility(found is not None)
        if found is None:
            return
        kept = None if number is None else self.session.store.experiment(number, self.session.draft.owner)
        changed = kept is not None and kept.model.strip() != self.session.text.strip()
        words = [f"{kept.name}, kept as number {number}" if kept else "Not kept", f"computed in {times(found.seconds)}"]
        if changed:
            words.append("the model has been changed since")
        self.found_told.text = "; ".join(words) + "."
        self.results.show(found)

    def _export(self) -> None:
        if self.session.result_id is not None:
            export_dialog(self.session, self.shell, self.session.result_id)


class _DesignDialog:
    """Where the filter's model comes from."""

    def __init__(self, session: Session, take: Callable[[str | None], str]) -> None:
        self.session, self._take = session, take
        with dialog("The filter's model", 42) as self.dialog:
            with ui.tabs().props("no-caps dense align=left outside-arrows mobile-arrows").classes("w-full") as tabs:
                for name, title in (
                    ("constants", "Other constants"),
                    ("gallery", "Gallery"),
                    ("kept", "Kept experiment"),
                    ("text", "File or text"),
                ):
                    ui.tab(name, title).props(f"data-test=design-{name}")
            with ui.tab_panels(
                tabs, value="constants" if session.file.constants else "gallery", animated=False
            ).classes("w-full"):
                with ui.tab_panel("constants"):
                    self._draw_constants()
                with ui.tab_panel("gallery"):
                    self._draw_gallery()
                with ui.tab_panel("kept"):
                    self._draw_kept()
                with ui.tab_panel("text"):
                    self._draw_text()
            self.wrong = _error()
            ui.button("Close", on_click=self.dialog.close).props("flat no-caps")

    def _taken(self, text: str) -> None:
        line = self._take(text)
        self.wrong.text = line
        if not line:
            self.dialog.close()

    def _draw_constants(self) -> None:
        rows = [row for row in self.session.sheet.constants if row.cell.value is not None]
        if not rows:
            ui.label("The model has no constants; take a text instead, and change it.").classes("ctl-show-hint")
            return
        ui.label("The same model, in which the filter believes other values:").classes("ctl-show-hint")
        inputs: dict[str, ui.input] = {}
        with ui.element("div").classes("ctl-exp-fields w-full"):
            for row in rows:
                label = f"{row.name}, {row.unit}" if row.unit else row.name
                inputs[row.name] = ui.input(label, value=row.cell.text).props(
                    f"outlined dense data-test=design-constant-{row.name}"
                )

        def take() -> None:
            file = self.session.file
            try:
                for row in rows:
                    typed = str(inputs[row.name].value or "").strip()
                    if typed != row.cell.text:
                        file, _ = commands.apply(file, commands.EditCell(("constants", row.name), typed))
            except ValueError as why:
                self.wrong.text = str(why)
                return
            self._taken(file.dumps())

        ui.button("Take these", on_click=take).props("no-caps data-test=design-take-constants")

    def _draw_gallery(self) -> None:
        entries = {entry.name: entry for entry in gallery()}
        titles = {name: f"{entry.title} ({entry.kind})" for name, entry in entries.items()}
        self._select("Model of the gallery", titles, "gallery", lambda name: entries[name].text)

    def _draw_kept(self) -> None:
        kept = {each.id: each for each in self.session.kept()[:200]}
        if not kept:
            ui.label("No experiment is kept yet.").classes("ctl-show-hint")
            return
        self._select(
            "Kept experiment",
            {number: f"{number}: {each.name}" for number, each in kept.items()},
            "kept",
            lambda number: kept[number].model,
        )

    def _select(self, label: str, options: dict[Any, str], test: str, text: Callable[[Any], str]) -> None:
        chosen = (
            ui.select(options, label=label, with_input=True)
            .props(f"outlined dense data-test=design-select-{test}")
            .classes("w-full")
        )
        ui.button(
            "Take it", on_click=lambda: self._taken(text(chosen.value)) if chosen.value is not None else None
        ).props(f"no-caps data-test=design-take-{test}")

    def _draw_text(self) -> None:
        area = ui.textarea("Model file (TOML)", value=self.session.plan.design or self.session.text)
        area.props(
            'outlined input-class="font-mono text-xs" input-style="min-height: 14rem" spellcheck=false data-test=design-toml'
        ).classes("w-full")

        async def uploaded(event: UploadEventArguments) -> None:
            try:
                area.value = (await event.file.read()).decode("utf-8-sig")
            except UnicodeDecodeError:
                self.wrong.text = f"{event.file.name}: expected a text in UTF-8, received other bytes"
            upload.reset()

        with ui.row().classes("gap-2"):
            ui.button("Take this text", on_click=lambda: self._taken(str(area.value or ""))).props(
                "no-caps data-test=design-take-text"
            )
            ui.button("Open a file…", icon="folder_open", on_click=lambda: upload.run_method("pickFiles")).props(
                "no-caps outline"
            )
        upload: ui.upload = (
            ui.upload(auto_upload=True, max_file_size=LARGEST, on_upload=uploaded)
            .props('accept=".toml"')
            .classes("hidden")
        )


# Small things --------------------------------------------------------------------------------------------------------


def accept_drops(zone: ui.element, upload: ui.upload) -> None:
    """Files that are dropped on the zone are uploaded."""
    zone.on("dragover", js_handler="(e) => { e.preventDefault(); e.currentTarget.dataset.over = true; }")
    zone.on("dragleave", js_handler="(e) => { e.currentTarget.dataset.over = false; }")
    zone.on(
        "drop",
        js_handler=f"""(e) => {{
            e.preventDefault();
            e.currentTarget.dataset.over = false;
            runMethod({upload.id}, "addFiles", [[...e.dataTransfer.files].slice(0, 1)]);
        }}""",
    )


def _title(name: str) -> str:
    return help_for(f"algorithm.{name}").title


def _error() -> ui.label:
    return ui.label("").classes("ctl-show-error").props("role=alert")


def _anomaly(each: Anomaly, names: Sequence[str]) -> str:
    """An anomaly in words."""
    when = f"k = {each.k}" if each.last is None else f"k = {each.k} to {each.last}"
    what = "lost" if math.isinf(each.R) else "exact" if each.R == 0 else f"R = {each.R:g}"
    name = (
        names[each.measurement]
        if each.measurement < len(names)
        else f"measurement {each.measurement + 1} (the model has none)"
    )
    return f"{when}: {name} {what}"


def _step(text: object, name: str) -> int:
    try:
        return plain.whole(text, 0, LIMITS["steps"][1])
    except ValueError as why:
        msg = f"{name}: {why}"
        raise ValueError(msg) from None


def _variance(kind: object, text: object) -> float:
    if kind != OTHER:
        return math.inf if kind == LOST else 0.0
    try:
        return plain.number(text, "a variance >= 0")
    except ValueError as why:
        msg = f"R: {why}"
        raise ValueError(msg) from None
