"""What is done with a regulator: its files, many runs of its loop, its cost where the plant is another one."""

from __future__ import annotations

import asyncio
import dataclasses
from html import escape
from typing import TYPE_CHECKING

from nicegui import ui

from ctlabs.studies import loops as pictures
from ctlabs.studies.understanding import Part
from ctlabs.text import prose
from ctlabs.workbench.desk import plain
from ctlabs.workbench.pages.model_parts import earlier
from ctlabs.workbench.pages.tables import table
from ctlabs.workbench.runs.loops import elsewhere, exported, one_run
from ctlabs.workbench.runs.running import said

if TYPE_CHECKING:
    from ctlabs.studies.regulating import Regulated
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.pages.showing import Show

#: Kinds of files, with what they are for.
FILES = {"h": "C header", "npz": "NumPy", "mat": "MATLAB"}
#: Runs of an ensemble at most.
MOST = 1_000_000


class Export:
    """Buttons that give the regulator as a file."""

    def __init__(self, show: Show, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.buttons: list[ui.button] = []
        with show.card("The regulator as a file", "control.export", test="control-export"):
            with ui.row().classes("gap-2"):
                for kind, words in FILES.items():
                    button = ui.button(f"{words} (.{kind})", icon="download", on_click=lambda _, kind=kind: self._download(kind))
                    self.buttons.append(button.props(f"no-caps outline dense data-test=export-{kind}"))
            ui.label("u is added to the plant: the sign of the feedback is in the matrices.").classes("ctl-show-hint")

    def allow(self, ready: bool) -> None:
        """Whether there is a regulator."""
        for button in self.buttons:
            button.set_enabled(ready)

    async def _download(self, kind: str) -> None:
        text, name = self.session.text, self.session.filename.removesuffix(".toml")
        try:
            content = await asyncio.to_thread(exported, text, kind, f"{name}_regulator")
        except (ValueError, ArithmeticError) as why:
            self.shell.complain(f"There is no file: {' '.join(str(why).split())}")
            return
        ui.download.content(content, f"{name}_regulator.{kind}")


class Many:
    """An ensemble of the loop, beside its theory."""

    def __init__(self, show: Show, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.desk, self.running = session.loops, session.loops.running
        self.found: Regulated | None = None
        self.seen = -1
        with show.card("Many runs of the loop", "control.ensemble", wide=True, test="control-ensemble") as card:
            self.card = card.section
            with ui.row().classes("items-center gap-2"):
                self.fields: dict[str, ui.input] = {}
                for name, title in (("runs", "Runs"), ("seed", "Seed")):
                    field = ui.input(title, value=str(getattr(self.desk, name))).classes("w-28")
                    field.props(f"outlined dense inputmode=numeric hide-bottom-space autocomplete=off data-test=control-{name}")
                    self.fields[name] = field
                self.button = ui.button("Run", icon="play_arrow", on_click=self.run).props("no-caps data-test=control-run")
                self.cancel = ui.button("Cancel", icon="stop", on_click=self.running.cancel)
                self.cancel.props("no-caps outline data-test=control-cancel")
                self.single = ui.button("One run (.csv)", icon="download", on_click=self._single)
                self.single.props("no-caps flat data-test=control-csv")
            self.bar = ui.linear_progress(value=0.0, show_value=False, size="8px").props('aria-label="Progress" data-test=control-bar')
            self.told = ui.label("").classes("ctl-show-hint").props("role=status aria-live=polite data-test=control-told")
            self.wrong = ui.label("").classes("ctl-show-error").props("role=alert data-test=control-run-error")
            self.body = ui.html("", sanitize=False).classes("w-full")
            self.plot = show.plot(test="plot-control-many", title=False)
        shell.on_leave(self.running.watch(self._look))
        self._look()

    def run(self) -> None:
        """Begin, if the numbers are in order."""
        runs, seed = self._read("runs"), self._read("seed")
        if runs is not None and seed is not None and not self.running.running:
            self.running.start(lambda progress, cancel: self.desk.run(runs, seed, progress, cancel))

    def _read(self, name: str) -> int | None:
        """The number of a field; None where it is wrong, which is said at the field."""
        field = self.fields[name]
        try:
            value = plain.whole(field.value, 2 if name == "runs" else 0, MOST)
        except ValueError as why:
            field.error = str(why)
            return None
        field.error = None
        return value

    async def _single(self) -> None:
        """One run with the seed that stands there, as a table."""
        text, seed = self.session.text, self._read("seed")
        if seed is None:
            return
        name = self.session.filename.removesuffix(".toml")
        try:
            content = await asyncio.to_thread(one_run, text, seed)
        except (ValueError, ArithmeticError) as why:
            self.shell.complain(f"There is no run: {' '.join(str(why).split())}")
            return
        ui.download.content(content.encode(), f"{name}_run.csv")

    def show(self, found: Regulated | None) -> None:
        """The regulator that is shown beside it."""
        self.found = found
        self._look()
        self._result()

    def _look(self) -> None:
        now = self.running
        with self.card:
            self.button.set_enabled(not now.running and self.found is not None)
            self.single.set_enabled(self.found is not None)
            self.cancel.set_visibility(now.running)
            self.bar.set_visibility(now.running)
            if now.running:
                self.wrong.text, self.told.text = "", said(now.progress)
                self.bar.value = now.progress.fraction if now.progress else 0.0
                return
            self.told.text = "Cancelled." if now.cancelled else ""
            self.wrong.text = now.problem
            if now.finished != self.seen:
                self.seen = now.finished
                self._result()

    def _result(self) -> None:
        """What came of it, if it is of the present model."""
        known, found = self.desk.ensemble, self.found
        if known is None or found is None:
            return
        text, made = known
        with self.card:
            if text != self.session.text:
                self.body.content = "<p>The last runs were those of another model or other weights: run again.</p>"
                self.plot.hide()
                return
            rows = [["of the runs", made.cost], ["expected, exactly", made.cost_expected], ["standard error", made.cost_sd]]
            far = f"{prose(abs(made.score), 2)} standard errors apart"
            verdict = f'<p class="{"ctl-show-good" if abs(made.score) < 4 else "ctl-show-bad"}">Runs and theory are {far}.</p>'
            heads = ["Cost of these steps", {"s": "per second", "step": "per step", "horizon": "in all"}[found.per]]
            self.body.content = verdict + table(heads, rows, f"{made.statistics.runs} runs of {len(made.theory.mean) - 1} steps")
            if found.over and len(found.over.value.t) == len(made.theory.mean):
                count = min(found.truth.n, 4)
                shown = [*range(count), *range(len(made.names) - found.truth.r, len(made.names))]
                self.plot.show(pictures.many(dataclasses.replace(found, ensemble=Part(made)), shown))


class Elsewhere:
    """What the regulator does where the plant is not what was believed: a constant with another value, or another model of the folder."""

    def __init__(self, show: Show, session: Session, shell: Shell) -> None:
        self.session, self.shell = session, shell
        self.models = {f"draft:{each.address.partition('=')[2]}": f"model: {each.title}, {each.when}" for each in earlier(session)}
        with show.card("Where the plant is another one", "control.elsewhere", test="control-elsewhere"):
            with ui.row().classes("items-center gap-2"):
                self.what = ui.select({}, label="What differs", on_change=self._chosen)
                self.what.props("outlined dense options-dense data-test=elsewhere-what").classes("w-56")
                self.value = ui.input("Its true value").classes("w-32")
                self.value.props("outlined dense hide-bottom-space autocomplete=off data-test=elsewhere-value")
                self.value.on("keydown.enter", self.run)
                self.button = ui.button("See", icon="compare_arrows", on_click=self.run).props("no-caps outline data-test=elsewhere-run")
            self.body = ui.html("", sanitize=False).classes("w-full").props("role=status aria-live=polite data-test=elsewhere-found")
        self.show()

    def show(self) -> None:
        """Offer what there is; what was said of another regulator is no more said."""
        rows = self.session.sheet.constants
        options = {f"constant:{row.name}": f"constant {row.name}" for row in rows if row.cell.value is not None} | self.models
        value = self.what.value if self.what.value in options else next(iter(options), None)
        if self.what.options != options or self.what.value != value:
            self.what.set_options(options, value=value)
        self._chosen()
        self.body.content = "" if options else "<p>Give numbers of the model names on the page Model: then one of them can differ.</p>"
        self.button.set_enabled(bool(options))

    def _chosen(self) -> None:
        self.value.set_visibility(str(self.what.value or "").startswith("constant:"))

    async def run(self) -> None:
        """See what the loop does there."""
        kind, _, name = str(self.what.value or "").partition(":")
        design = self.session.text
        self.value.error = None
        try:
            truth = self._truth(kind, name)
            found = await asyncio.to_thread(elsewhere, design, truth)
        except (ValueError, ArithmeticError) as why:
            self.body.content = f'<p class="ctl-show-why">{escape(" ".join(str(why).split()))}</p>'
            return
        self.body.content = told_elsewhere(found)

    def _truth(self, kind: str, name: str) -> str:
        if kind == "constant":
            text = str(self.value.value or "").strip()
            if not text:
                msg = f"{name}: expected its true value, received none"
                raise ValueError(msg)
            return self.session.file.set_constant(name, plain.typed(text)).checked().dumps()
        draft = self.session.store.draft(name)
        if draft is None:
            msg = "model: expected one that is kept, received one that is no more"
            raise ValueError(msg)
        return draft.text


def told_elsewhere(found: Regulated) -> str:
    """What a wrong design believes, what is true, and what could be, in HTML."""
    best, claimed = found.best.regulator.cost.value, found.regulator.cost.value
    if not found.cost:
        why = f"It does not hold this plant: {found.growing or found.cost.reason}."
        return f'<p class="ctl-show-bad">{escape(why)}</p><p>The right regulator would cost {prose(best, 4)}.</p>'
    true = found.cost.value
    rows = [["what this regulator believes", claimed], ["what it costs there", true], ["what the right regulator costs there", best]]
    factor = f"<p>A factor {prose(true / best, 4)} above the best.</p>" if best else ""
    heads = ["Cost", {"s": "per second", "step": "per step", "horizon": "in all"}[found.per]]
    return f'<p class="ctl-show-good">The loop stays stable.</p>{table(heads, rows)}{factor}'
