"""What a filtered record says, on the page Data: the verdict first, the rows that speak against the model, then the figures."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.text import prose
from ctlabs.workbench.help import groups, help_for
from ctlabs.workbench.pages.showing import Show
from ctlabs.workbench.pages.tables import table
from ctlabs.workbench.runs import records
from ctlabs.workbench.runs.inside import line

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.runs.records import RecordRow

#: States and rows that are shown at first; the gate that is proposed where there are outliers, σ.
STATES, ROWS, GATE = 4, 12, 5.0
#: Kinds of files: what they are called, their ending and type.
FILES = {
    "csv": ("Estimates, every row (CSV)", "estimates.csv", "text/csv"),
    "forecast": ("Forecast (CSV)", "forecast.csv", "text/csv"),
    "html": ("Report (HTML)", "record.html", "text/html"),
}


class RecordResults:
    """The results of one record; ``gate`` filters it again with another gate."""

    def __init__(self, show: Show, shell: Shell, session: Session, gate: Callable[[float | None], object]) -> None:
        self._show, self._shell, self._session, self._gate = show, shell, session, gate
        self.desk = session.records
        self._at: RecordRow | None = None
        self._rows, self._states = ROWS, STATES
        self._drawn: tuple[Any, ...] = ()
        self.box = ui.element("div").classes("ctl-data-found")

    def bring(self) -> None:
        """Scroll to the results, where they are out of sight."""
        with self.box:
            ui.run_javascript(f"ctlabs.bring({self.box.id})")

    def draw(self) -> None:
        """Show what there is, if that is another than before."""
        state = (self.desk.estimates, self.desk.judgement, self.desk.filtering.running, self.desk.stale)
        if state == self._drawn:
            return
        if not self._drawn or self._drawn[0] is not state[0]:
            self._at, self._rows = None, ROWS
        self._drawn = state
        self._draw()

    def _draw(self) -> None:
        found = self.desk.estimates
        self.box.clear()
        if found is None:
            return
        with self.box:
            self._draw_verdict()
            with self._show.card("Estimates", "data.estimates", test="data-estimates"):
                self._draw_estimates()
            for drawing in found.forecast[: self._states]:
                with self._show.card(f"Forecast of {drawing.name}", "data.steps", test="data-forecast"):
                    self._show.plot(drawing, test="plot-forecast", title=False)
            self._draw_tests()

    # In words ----------------------------------------------------------------------------------------------------------

    def _draw_verdict(self) -> None:
        found, told = self.desk.estimates, self.desk.judgement
        assert found is not None
        with self._show.card("What the record says of the model", "data.verdict", test="data-verdict"):
            with ui.element("div").props("role=status aria-live=polite"):
                if told is not None:
                    words = told.suggestion[:1].upper() + told.suggestion[1:].rstrip(".")
                    looks = "ctl-show-good" if told.ok else "ctl-show-bad" if told.verdict else ""
                    ui.label(f"{words}.").classes(looks).props("data-test=data-suggestion")
                elif self.desk.filtering.running:
                    ui.label("The record is being tested against the model…").props("data-test=data-suggestion")
                else:
                    ui.label("Not tested: the run was ended before.").props("data-test=data-suggestion")
                missing = f", {prose(found.missing)} values missing" if found.missing else ""
                ui.label(
                    f"{found.source}: {prose(found.rows)} rows{missing}; filtered by {_title(found.algorithm)}, "
                    f"log-likelihood {prose(found.log_likelihood)}."
                ).classes("ctl-show-hint").props("data-test=data-summary")
                for note in found.notes:
                    ui.label(note).classes("ctl-show-hint")
                if self.desk.stale:
                    ui.label("The model or the data have been changed since.").classes("ctl-show-why").props("data-test=data-stale")
            if told is not None and told.rows:
                ui.html("<h3>Rows that speak against the model</h3>", sanitize=False).classes("ctl-show-head")
                self._draw_rows(told.rows, "data-row")
                if any(row.kind == "outlier" for row in told.rows) and self.desk.wanted.gate is None:
                    button = ui.button(f"Filter without what is beyond {GATE:g} σ", on_click=lambda: self._gate(GATE))
                    button.props("no-caps outline dense data-test=data-take-gate")
            if found.beyond:
                ui.html(f"<h3>Left out by the gate: {found.beyond}</h3>", sanitize=False).classes("ctl-show-head")
                self._draw_rows(found.left_out, "data-left-out")
            with ui.row().classes("gap-2"):
                for kind, (words, name, _type) in FILES.items():
                    if kind != "forecast" or found.forecast:
                        button = ui.button(words, icon="download", on_click=lambda _, kind=kind: self._save(kind))
                        button.props(f"no-caps outline dense data-test=data-save-{kind}")
                        button.props["aria-label"] = f"{words}, {name}"

    def _draw_rows(self, rows: tuple[RecordRow, ...], test: str) -> None:
        """Rows as a list; one that is pressed is shown in the figures."""
        with ui.element("ul").classes("ctl-data-rows"):
            for row in rows[: self._rows]:
                with ui.element("li"):
                    link = ui.element("button").classes("ctl-link").props(f"type=button data-test={test}")
                    link.props["aria-pressed"] = str(row == self._at).lower()
                    with link:
                        ui.label(records.where(row))
                    link.on("click", lambda _, row=row: self._look(row))
                    ui.label(records.told(row))
        if len(rows) > self._rows:
            ui.button(f"All {len(rows)} rows", on_click=self._all).props(f"no-caps flat dense data-test={test}-all")

    def _all(self) -> None:
        self._rows = records.LISTED
        self._draw()

    def _look(self, row: RecordRow | None) -> None:
        """Show a row in the figures, or all of them."""
        self._at = row
        self._draw()
        with self.box:
            ui.run_javascript("document.querySelector('[data-test=data-estimates]')?.scrollIntoView({ block: 'start' })")

    # Figures -----------------------------------------------------------------------------------------------------------

    def _draw_estimates(self) -> None:
        found, at = self.desk.estimates, self._at
        assert found is not None
        if at is not None:
            with ui.row().classes("items-center gap-2"):
                ui.label(f"Beside {records.where(at)}").props("data-test=data-beside role=status")
                whole = ui.button("The whole record", icon="zoom_out_map", on_click=lambda: self._look(None))
                whole.props("no-caps outline dense data-test=data-whole")
        states = range(min(len(found.states), self._states))
        self._show.plot(records.drawn(found, states, at), test="plot-record", title=False)
        if len(found.states) > self._states:
            more = ui.button(f"All {len(found.states)} states", on_click=self._all_states)
            more.props("no-caps flat dense data-test=data-all-states")
        self._show.plot(records.innovations(found, at), test="plot-record-innovations", key="result.innovations")

    def _all_states(self) -> None:
        self._states = 200
        self._draw()

    def _draw_tests(self) -> None:
        told = self.desk.judgement
        if told is None or not told.tests:
            return
        with self._show.card("Tests of the innovations", "data.tests", test="data-tests"):
            if told.whiteness is not None:
                self._show.plot(told.whiteness, test="plot-record-whiteness", key="result.whiteness")
            ui.html(table(list(map(str, told.tests[0])), told.tests[1:], "Of the record"), sanitize=False).classes("w-full")

    # Files -------------------------------------------------------------------------------------------------------------

    async def _save(self, kind: str) -> None:
        """Compute a file and hand it over."""
        words, name, media = FILES[kind]
        self._shell.tell(f"{words}: being written…")
        try:
            content = await self.desk.file(kind)
        except (ValueError, RuntimeError) as why:
            self._shell.complain(line(why))
            return
        stem = self.desk.estimates.source.rpartition(".")[0] if self.desk.estimates else "record"
        with self.box:
            ui.download.content(content, f"{escape(stem) or 'record'}_{name}", media_type=media)


def _title(algorithm: str) -> str:
    """An algorithm as the lists of the pages call it."""
    key = f"algorithm.{algorithm}"
    return help_for(key).title if key in groups()["algorithm"].entries else algorithm
