"""The columns of a table on the page Data: a picture of each, what it is to the model, how it is written; and its lines."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.files.mapping import NO_TIME, UNITS, Mapping
from ctlabs.files.remedies import words
from ctlabs.studies.looking import written
from ctlabs.workbench.desk import plain
from ctlabs.workbench.desk.telling import TellData
from ctlabs.workbench.pages.showing import Show, help_button
from ctlabs.workbench.runs.seen import RECORD, TIME

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ctlabs.workbench.desk.records import RecordDesk
    from ctlabs.workbench.pages.editing import Editor

#: Columns that are drawn at first, and cells of a line that are shown.
SHOWN, CELLS = 30, 16
#: Most lines that are left out above a table.
SKIP = 1_000_000
MARKS = {"": "as it looks", ".": "point", ",": "comma"}
THOUSANDS = {"": "as it looks", ",": "comma", ".": "point", "'": "apostrophe", " ": "blank"}
BLANKS = {"": "as it looks", "skip": "nothing", "missing": "a row in which nothing was measured"}
STARTS = {"": "as it looks", "first": "the first row is the first instant", "model": "the model's own clock"}


class ColumnCards:
    """Two cards: the columns with their selects, and the lines of the file."""

    def __init__(self, show: Show, editor: Editor, desk: RecordDesk) -> None:
        self.editor, self.desk = editor, desk
        self._all = self._open = self._refused = False
        self._table: dict[str, Any] | None = None
        with show.card("Columns", "data.columns", test="data-columns") as card:
            self.card = card.section
            self.list = ui.element("div").classes("ctl-data-columns").props('role=list aria-label="Columns"')
            self.more = ui.button("", on_click=self._show_all).props("no-caps flat dense data-test=data-all-columns")
            with ui.expansion("How it is written", on_value_change=self._opened).classes("w-full").props("dense data-test=data-written"):
                self.written = ui.element("div").classes("ctl-data-fields")
        with show.card("Lines of the file", "data.rows", test="data-rows") as card:
            self.rows_card = card.section
            self.shown = ui.expansion("The first and the last of them").classes("w-full").props("dense data-test=data-show-rows")
            with self.shown:
                self.rows = ui.html("", sanitize=False).classes("w-full")

    def fill(self, table: dict[str, Any] | None) -> None:
        """Show a table, or nothing."""
        self._table = table
        columns = [] if table is None else table["columns"]
        self.card.set_visibility(bool(columns))
        self.rows_card.set_visibility(bool(table and table["rows"]))
        if table is None:
            return
        self.list.clear()
        first = sorted(columns, key=lambda column: not column["role"])[:SHOWN]
        drawn = columns if self._all or len(columns) <= SHOWN else sorted(first, key=lambda column: int(column["number"]))
        with self.list:
            for column in drawn:
                self._draw(column)
        self.more.set_visibility(len(drawn) < len(columns))
        self.more.text = f"All {len(columns)} columns"
        self._fill_written()
        self.rows.content = lines(table)
        if bool(table["refusal"]) != self._refused:
            self._refused = bool(table["refusal"])
            self.shown.value = self._refused

    def _show_all(self) -> None:
        self._all = True
        self.fill(self._table)

    # A column ----------------------------------------------------------------------------------------------------------

    def _draw(self, column: dict[str, Any]) -> None:
        number, role = column["number"], column["role"]
        with ui.element("div").classes("ctl-data-column").props(f"role=listitem data-test=data-column-{number}"):
            ui.html(picture(column), sanitize=False).classes("ctl-data-picture")
            with ui.element("div").classes("ctl-data-named"):
                ui.label(column["name"]).classes("ctl-data-name")
                missing = f", {column['missing']} missing" if column["missing"] else ""
                ui.label(f"{column['kind']}: {column['range']}{missing}").classes("ctl-show-hint")
                for remark in column["remarks"]:
                    ui.label(remark).classes("ctl-data-remark")
                for way in dict.fromkeys(column["remedies"]):
                    remedy(way, f"data-column-remedy-{number}", lambda way: self.editor.do(self.desk.remedied(way)))
            select = ui.select(self._roles(column), value=role, label="What it is", on_change=lambda e: self._assign(column, e.value))
            select.props(f"outlined dense options-dense data-test=data-role-{number}")
            select.props["aria-label"] = f"What the column {column['name']} is"
            with ui.element("div").classes("ctl-data-more"):
                kind, _, name = role.partition(":")
                if kind == TIME:
                    self._unit()
                elif kind in ("measurement", "input"):
                    self._scale(name)

    def _roles(self, column: dict[str, Any]) -> dict[str, str]:
        """What a column may be."""
        sheet, file = self.editor.session.sheet, self.editor.session.file
        roles = {"": "not used", TIME: "the time"}
        roles |= {f"measurement:{name}": f"measurement {name}" for name in sheet.measurements}
        mapping = self.desk.mapping
        own = str(column["name"])
        inputs = [*mapping.inputs, *([own] if own not in mapping.inputs and _has_inputs(file.data()) else [])]
        roles |= {f"input:{name}": f"known input {name}" for name in inputs}
        roles |= {f"regressor:{name}": f"regressor {name}" for name in mapping.regressors}
        roles[RECORD] = "the names of records"
        return roles if column["role"] in roles else {**roles, column["role"]: column["role"].partition(":")[2]}

    def _assign(self, column: dict[str, Any], role: str) -> None:
        if role != column["role"]:
            self.desk.fresh = True
            self.editor.do(self.desk.assigned(column, role))

    def _unit(self) -> None:
        units = {"": "as the reader finds it", **{unit: f"{unit}: {written(unit)}" for unit in UNITS}}
        select = ui.select(units, value=self.desk.mapping.unit, label="Written as", on_change=lambda event: self._change(unit=event.value))
        select.props("outlined dense options-dense data-test=data-unit")

    def _scale(self, name: str) -> None:
        value = self.desk.mapping.scale.get(name, 1.0)
        field = ui.input("Times", value=f"{value:g}").props("outlined dense inputmode=decimal hide-bottom-space")
        field.props["data-test"] = f"data-scale-{name}"
        field.props["aria-label"] = f"Factor on {name}"

        def typed() -> None:
            try:
                factor = plain.number(field.value or "1")
            except ValueError as why:
                field.error = str(why)
                return
            if factor != value:
                scale = {each: own for each, own in self.desk.mapping.scale.items() if each != name}
                field.error = self._change(scale={**scale, **({name: factor} if factor != 1.0 else {})})

        field.on("blur", typed)
        field.on("keydown.enter", typed)

    # How it is written -------------------------------------------------------------------------------------------------

    def _opened(self, event: Any) -> None:
        self._open = bool(event.value)
        self._fill_written()

    def _fill_written(self) -> None:
        """The fields are drawn where they are seen."""
        self.written.clear()
        if not self._open:
            return
        told = self.desk.mapping
        with self.written:
            for name, label, options in (
                ("decimal", "Decimal mark", MARKS), ("thousands", "Mark between thousands", THOUSANDS),
                ("blank", "Blank lines are", BLANKS), ("t0", "Times count from", STARTS),
            ):  # fmt: skip
                select = ui.select(options, value=getattr(told, name), label=label)
                select.on_value_change(lambda e, name=name: self._change(**{name: e.value}))
                select.props(f"outlined dense options-dense data-test=data-{name}")
            self._text("missing", "Further words for “not measured”", ", ".join(told.missing), _words)
            self._text("skip", "Lines above the table", str(told.skip), lambda text: plain.whole(text, 0, SKIP))
            if told.inputs:
                self._text("u0", "Inputs before the first row", "; ".join(f"{value:g}" for value in told.u0), plain.numbers)
            if not _has_times(told):
                ui.button("There are times", on_click=lambda: self._change(time="", unit="")).props("no-caps outline dense")
        with self.written:
            help_button("data.written")

    def _text(self, name: str, label: str, value: str, read: Callable[[str], Any]) -> None:
        field = ui.input(label, value=value).props(f"outlined dense hide-bottom-space autocomplete=off data-test=data-{name}")

        def typed() -> None:
            text = str(field.value or "").strip()
            if text == value:
                return
            try:
                told = read(text or "0" if name == "skip" else text)
            except ValueError as why:
                field.error = str(why)
                return
            field.error = self._change(**{name: told})

        field.on("blur", typed)
        field.on("keydown.enter", typed)

    def _change(self, **changes: Any) -> str | None:
        """Say something else of the table; what is wrong with it, if anything is."""
        try:
            told = replace(self.desk.mapping, **changes)
        except ValueError as why:
            return str(why).removeprefix("--")
        self.desk.fresh = True
        what = ", ".join(f"{name} = {value}" for name, value in changes.items())
        self.editor.do(TellData(told, f"data: {what[:60]}"))
        return None


def remedy(options: str, test: str, press: Callable[[str], object]) -> None:
    """A button that says in words what options say, and has them as its hint."""
    button = ui.button(words(options) or options, on_click=lambda: press(options))
    button.props(f"no-caps outline dense data-test={test}").classes("ctl-data-way")
    button.props["title"] = options


def _has_inputs(data: dict[str, Any]) -> bool:
    """Whether something in the model takes known inputs."""
    model = data.get("model")
    return isinstance(model, dict) and bool({"B", "D"} & set(model))


def _has_times(told: Mapping) -> bool:
    return told.time != NO_TIME


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def picture(column: dict[str, Any]) -> str:
    """A column as a small picture: from its least to its greatest value in each part; gaps are missing values.

    >>> picture({"low": [0.0, None], "high": [1.0, None], "name": "x", "range": "1 … 2"})[:60]
    '<svg viewBox="0 0 120 32" role="img" aria-label="x: 1 … 2" p'
    """
    low, high = column["low"], column["high"]
    width = 120 / max(len(low), 1)
    bars = "".join(
        f'<rect x="{i * width:.1f}" y="{30 - 28 * b:.1f}" width="{max(width, 1):.1f}" height="{max(28 * (b - a), 1.5):.1f}"/>'
        for i, (a, b) in enumerate(zip(low, high, strict=True)) if a is not None
    )  # fmt: skip
    told = escape(f"{column['name']}: {column['range']}", quote=True)
    return f'<svg viewBox="0 0 120 32" role="img" aria-label="{told}" preserveAspectRatio="none">{bars}</svg>'


def lines(table: dict[str, Any]) -> str:
    """The lines of a file as a table; the one that is refused is marked, and in it the cell."""
    wrong, named = table["line"], table["column"]
    names = [column["name"] for column in table["columns"]]
    place = next((i for i, name in enumerate(names) if name == named or str(i + 1) == named), None)
    body, before = [], None
    for number, cells in table["rows"]:
        if before is not None and number > before + 1:
            body.append(f'<tr class="gap"><th scope="row">…</th><td colspan="{min(max(len(names), 1), CELLS)}"></td></tr>')
        before = number
        told = _cells(cells, place if number == wrong else None)
        body.append(f'<tr{" class=wrong" if number == wrong else ""}><th scope="row">{number}</th>{told}</tr>')
    return (
        '<div class="ctl-show-scroll" tabindex="0" role="region" aria-label="Lines of the file"><table class="ctl-data-lines">'
        '<thead><tr><th scope="col">line</th>'
        + "".join(f'<th scope="col">{i + 1}</th>' for i in range(min(max(len(names), 1), CELLS)))
        + f"</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
    )


def _cells(cells: Sequence[str], wrong: int | None) -> str:
    shown = list(enumerate(cells[:CELLS]))
    told = "".join(f'<td{" class=cell data-test=data-wrong-cell" if i == wrong else ""}>{escape(cell[:60])}</td>' for i, cell in shown)
    return told + ("<td>…</td>" if len(cells) > CELLS else "")
