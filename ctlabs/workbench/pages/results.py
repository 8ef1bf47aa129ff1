"""What came out of an experiment, part by part: figures, tables, and numbers to copy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.text import number
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.showing import Show, help_button, times
from ctlabs.workbench.pages.tables import table
from ctlabs.workbench.runs import figures, verdicts

if TYPE_CHECKING:
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.runs.outcomes import InnovationTests, Outcome

#: States and measurements that are drawn at first.
SHOWN = 3


class Results:
    """The results of one experiment, in a place of the page."""

    def __init__(self, show: Show, session: Session) -> None:
        self._show, self._session = show, session
        self._found: Outcome | None = None
        self._states: list[int] = []
        self._run = 0
        self.box = ui.element("div").classes("w-full flex flex-col gap-3")

    def show(self, found: Outcome) -> None:
        """Show an outcome; the part and the states that were looked at stay."""
        before, self._found = self._found, found
        if before is None or before.states != found.states:
            self._states = list(range(min(len(found.states), SHOWN)))
        self._run = min(self._run, found.x_plus.shape[2] - 1)
        self._show.view.within("t, s", float(found.t[0]), float(found.t[-1]))
        parts = self._parts(found)
        part = self._session.part if self._session.part in parts else next(iter(parts))
        self.box.clear()
        with self.box:
            self._sentences(found)
            # Not QTabPanels: only the part that is looked at is drawn, and drawn at once.
            with ui.tabs() as tabs:
                tabs.classes("w-full").props(
                    'align=left no-caps dense outside-arrows mobile-arrows aria-label="Parts of the results"'
                )
                drawn = {
                    name: ui.tab(name, title).props(f"data-test=part-{name}") for name, (title, _) in parts.items()
                }
            tabs.value = drawn[part]
            tabs.on_value_change(lambda event: self._part(_named(event.value)))
            self._place = (
                ui.element("div")
                .classes("w-full flex flex-col gap-4")
                .props(f"data-test=results data-runs={_runs(found)}")
            )
        self._part(part)

    def _parts(self, found: Outcome) -> dict[str, tuple[str, Callable[[Outcome], None]]]:
        """What there is to be looked at."""
        parts: dict[str, tuple[str, Callable[[Outcome], None]]] = {"states": ("States", self._draw_states)}
        if found.errors is not None:
            parts["errors"] = ("Errors", self._draw_errors)
        parts |= {
            "gain": ("Gain", self._draw_gain),
            "variances": ("P⁻ and P⁺", self._draw_variances),
            "innovations": ("Innovations", self._draw_innovations),
            "algorithms": ("Algorithms", self._draw_algorithms),
            "numbers": ("Numbers", self._draw_numbers),
            "code": ("Python, commands", self._draw_code),
        }
        return parts

    def _part(self, name: str) -> None:
        found = self._found
        if found is None:
            return
        self._session.part = name
        self._place.clear()
        with self._place:
            self._parts(found)[name][1](found)

    def _again(self) -> None:
        self._part(self._session.part)

    # In words --------------------------------------------------------------------------------------------------------

    def _sentences(self, found: Outcome) -> None:
        with ui.element("div").classes("w-full").props("role=status aria-live=polite data-test=diagnosis"):
            lines = [*verdicts.diagnosis(found), *found.notes]
            with ui.row().classes("items-start no-wrap gap-1"):
                ui.html("".join(f"<p style='margin:0 0 .3rem'>{escape(line)}</p>" for line in lines), sanitize=False)
                help_button("result.diagnosis")
                if found.statistics is not None and found.statistics.outside is not None:
                    help_button("result.outside")

    # Parts -----------------------------------------------------------------------------------------------------------

    def _choices(self, found: Outcome, *, run: bool = False) -> None:
        """Which states and which run are drawn, where there is a choice."""
        runs = found.x_plus.shape[2]
        if len(found.states) <= SHOWN and not (run and runs > 1):
            return
        with ui.row().classes("w-full items-center gap-3"):
            if len(found.states) > SHOWN:
                names = dict(enumerate(found.states))
                chosen = ui.select(
                    names,
                    value=self._states,
                    multiple=True,
                    label="States shown",
                    on_change=lambda e: self._choose(e.value),
                )
                chosen.props("outlined dense use-chips data-test=result-states").classes("grow")
            if run and runs > 1:
                named = {r: f"run {r + 1}" for r in range(runs)}
                toggle = ui.toggle(named, value=self._run, on_change=lambda e: self._choose_run(int(e.value)))
                toggle.props(
                    'no-caps unelevated padding="xs md" toggle-color=primary aria-label="Which run is shown" data-test=result-run'
                )

    def _choose(self, states: Sequence[int]) -> None:
        if states and sorted(states) != self._states:
            self._states = sorted(states)
            self._again()

    def _choose_run(self, run: int) -> None:
        self._run = run
        self._again()

    def _draw_states(self, found: Outcome) -> None:
        self._choices(found, run=True)
        self._show.plot(figures.estimates(found, self._states, self._run), test="plot-states", key="result.states")

    def _draw_errors(self, found: Outcome) -> None:
        self._choices(found)
        if found.statistics is not None:
            self._show.plot(figures.accuracy(found, self._states), test="plot-accuracy", key="result.errors")
        self._show.plot(figures.errors(found, self._states), test="plot-errors", key="result.errors")
        if found.statistics is not None:
            self._show.plot(figures.bias(found, self._states), test="plot-bias", key="result.statistics")
            self._show.plot(figures.consistency(found), test="plot-consistency", key="result.nees")

    def _draw_gain(self, found: Outcome) -> None:
        self._choices(found)
        self._show.plot(figures.gains(found, self._states), test="plot-gain", key="result.gain")

    def _draw_variances(self, found: Outcome) -> None:
        self._choices(found)
        self._show.plot(figures.variances(found, self._states), test="plot-variances", key="result.variances")

    def _draw_innovations(self, found: Outcome) -> None:
        measurements = list(range(len(found.measurements)))[: 2 * SHOWN]
        self._show.plot(
            figures.innovations(found, measurements, self._run), test="plot-innovations", key="result.innovations"
        )
        self._show.plot(figures.nis(found, self._run), test="plot-nis", key="result.nis")
        told = found.verdict
        if told is None:
            ui.label("No element entered the updates, so there is nothing to test.").classes("ctl-show-why")
            return
        if len(told.lags):
            self._show.plot(figures.whiteness(found), test="plot-whiteness", key="result.whiteness")
        rows = innovation_tests(found, told)
        with ui.element("div").classes("ctl-show-head"):
            ui.html("<h3>Tests of the innovations</h3>", sanitize=False)
            ui.space()
            self._show.copy(lambda: figures.table(rows), "Copy the tests", words="Numbers")
        ui.html(
            table(*_headed(rows), "Of the first run" if found.kind == "simulation" else "Of the record"), sanitize=False
        ).classes("w-full")

    def _draw_algorithms(self, found: Outcome) -> None:
        rows = algorithms(found)
        with ui.element("div").classes("ctl-show-head"):
            ui.html("<h3>Accuracy and time</h3>", sanitize=False)
            help_button("result.algorithms")
            ui.space()
            self._show.copy(
                lambda: figures.table(raw_algorithms(found)), "Copy the table", test="copy-algorithms", words="Numbers"
            )
        ui.html(table(*_headed(rows)), sanitize=False).classes("w-full").props("data-test=algorithms-table")
        hint = (
            "Errors are against a filter with 50 digits, on the first run; choose several algorithms to see them."
            if len(found.algorithms) == 1
            else "Errors are against a filter with 50 digits, on the first run; that of an estimate is in units of its σ."
        )
        ui.label(hint).classes("ctl-show-hint")
        if len(found.estimates) > 1:
            ui.label("Their estimates are in the figure of the states: click a name in its legend.").classes(
                "ctl-show-hint"
            )

    def _draw_numbers(self, found: Outcome) -> None:
        rows = [["Name", "Value", "Unit"], *([name, value, unit] for name, (value, unit) in found.summary.items())]
        with ui.element("div").classes("ctl-show-head"):
            ui.html("<h3>Numbers</h3>", sanitize=False)
            help_button("result.statistics")
            ui.space()
            self._show.copy(
                lambda: figures.table(rows),
                "Copy the numbers, with tabs between them",
                test="copy-numbers",
                words="Copy all",
            )
        ui.html(table(*_headed(rows)), sanitize=False).classes("w-full").props("data-test=numbers-table")


    def _draw_code(self, _found: Outcome) -> None:
        for kind, title, what in (
            ("python", "Python", "These lines give the numbers again with the library alone."),
            ("commands", "Commands", "The same on a command line; the model file and the record are in Export."),
        ):
            lines = self._session.code(kind)
            copied = partial(str, lines)
            with ui.element("div").classes("ctl-show-head"):
                ui.html(f"<h3>{title}</h3>", sanitize=False)
                help_button(f"result.{kind}")
                ui.space()
                self._show.copy(copied, f"Copy: {title}", test=f"copy-{kind}", words="Copy")
            ui.label(what if lines else "The experiment is not kept, so there is nothing to refer to.").classes("ctl-show-hint")
            with ui.element("pre").classes("ctl-show-code").props(f'tabindex=0 role=region aria-label="{title}" data-test=code-{kind}'):
                ui.html(escape(lines), sanitize=False)


# In words and tables -------------------------------------------------------------------------------------------------


def innovation_tests(found: Outcome, told: InnovationTests) -> list[list[Any]]:
    """The tests of the innovations."""
    rows: list[list[Any]] = [
        ["Test", "Value", "Expected", "p", "In words"],
        ["NIS, mean per instant", told.nis_mean, told.nis_expected, told.nis_p, verdicts.in_words(told.nis_p)],
    ]
    for name, mean, white in zip(found.measurements, told.mean_p, told.whiteness_p, strict=True):
        rows.append([f"mean of the innovations of {name}", "", "0", float(mean), verdicts.in_words(float(mean))])
        rows.append([f"whiteness of the innovations of {name}", "", "white", float(white), verdicts.in_words(float(white))])
    for name, factor in (("R", told.factor_R), ("Q", told.factor_Q)):
        if factor is not None:
            rows.append([f"factor on {name} that makes the data most likely", factor, 1.0, "", ""])
    return rows


def algorithms(found: Outcome) -> list[list[Any]]:
    """The table of algorithms for a reader."""
    rms = any(each.rms is not None for each in found.algorithms)
    units = [f"{name}, {unit}" if unit else name for name, unit in zip(found.states, found.units, strict=True)][
        : 2 * SHOWN
    ]
    rows: list[list[Any]] = [
        [
            "Algorithm",
            "Time per step",
            "Operations per step",
            "Error of P⁺",
            "Error of x̂, σ",
            *([f"RMS error of {u}" for u in units] if rms else []),
        ]
    ]
    for each in found.algorithms:
        name = help_for(f"algorithm.{each.name}").title
        if each.failed:
            rows.append([name, f"refused: {each.failed}"])
            continue
        errors = [] if each.rms is None else [float(value) for value in each.rms[: len(units)]]
        seconds = None if each.seconds is None else times(each.seconds)
        rows.append([name, seconds, each.flops, _short(each.error_P), _short(each.error_x), *errors])
    return rows


def raw_algorithms(found: Outcome) -> list[list[Any]]:
    """The table of algorithms with all digits."""
    rows: list[list[Any]] = [
        ["Algorithm", "s per step", "operations per step", "error of P+", "error of x, sd", *found.states, "refused"]
    ]
    for each in found.algorithms:
        rms = [None] * len(found.states) if each.rms is None else [float(value) for value in each.rms]
        rows.append([each.name, each.seconds, each.flops, each.error_P, each.error_x, *rms, each.failed])
    return rows


def _short(value: float | None) -> str | None:
    return None if value is None else number(value, 2)


def _headed(rows: Sequence[Sequence[Any]]) -> tuple[Sequence[str], Sequence[Sequence[Any]]]:
    return rows[0], rows[1:]


def _named(tab: Any) -> str:
    """The name of what a row of tabs says is chosen."""
    return str(tab.props["name"] if isinstance(tab, ui.tab) else tab)


def _runs(found: Outcome) -> int:
    return found.statistics.runs if found.statistics is not None else 1
