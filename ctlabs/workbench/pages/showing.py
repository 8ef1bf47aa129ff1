"""What the pages Understand, Experiment and Keep draw with: cards with help, tables, figures in the theme, numbers to copy."""

from __future__ import annotations

import json
import math
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from nicegui import ui

from ctlabs.reporting.screen import to_plotly
from ctlabs.text import number
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.dialogs import dialog

if TYPE_CHECKING:
    from nicegui import Client
    from nicegui.events import GenericEventArguments

    from ctlabs.reporting.drawing import Drawing
    from ctlabs.workbench.pages.shell import Shell

#: Texts in tables that are not broken into lines.
NARROW = 14


#: What is known of a browser's theme where it follows the system's.
_dark: weakref.WeakKeyDictionary[Client, bool] = weakref.WeakKeyDictionary()



class Card(NamedTuple):
    """A part of a page, and its head, where further buttons go."""

    section: ui.element
    head: ui.element


class Show:
    """The drawing of one page in one tab."""

    def __init__(self, shell: Shell) -> None:
        self.shell, self.client = shell, shell.client
        self.dark = {"dark": True, "light": False}.get(shell.theme, _dark.get(shell.client, False))
        self._plots: weakref.WeakSet[Plot] = weakref.WeakSet()
        probe = ui.element("span").classes("hidden")
        probe.on("theme", self._themed, args=["detail"])
        with self.client:
            ui.run_javascript(f"ctlabs.watchTheme({probe.id}, {json.dumps(self.dark)})")

    def _themed(self, event: GenericEventArguments) -> None:
        self.dark = _dark[self.client] = bool(event.args["detail"] if isinstance(event.args, dict) else event.args)
        for plot in list(self._plots):
            plot.redraw()

    # Parts of a page -------------------------------------------------------------------------------------------------

    @contextmanager
    def card(self, title: str, key: str = "", *, wide: bool = False, test: str = "", level: int = 2) -> Iterator[Card]:
        """A part of the page with its title and help."""
        with ui.element("section").classes("ctl-show-card") as section:
            section.props["aria-label"] = title
            if wide:
                section.classes("ctl-show-wide")
            if test:
                section.props(f"data-test={test}")
            with ui.element("div").classes("ctl-show-head") as head:
                ui.html(f"<h{level}>{escape(title)}</h{level}>", sanitize=False)
                if key:
                    help_button(key)
            yield Card(section, head)

    def plot(self, drawing: Drawing | None = None, *, test: str = "", key: str = "", title: bool = True) -> Plot:
        """A figure with its title (unless the card has it), help, and a button that copies its numbers."""
        made = Plot(self, test, key, title=title)
        self._plots.add(made)
        if drawing is not None:
            made.show(drawing)
        return made

    def copy(self, text: Callable[[], str], label: str, *, test: str = "", words: str = "") -> ui.button:
        """A button that puts text into the clipboard."""

        def copied() -> None:
            with self.client:
                ui.run_javascript(f"ctlabs.copy({json.dumps(text())})")
            self.shell.tell("Copied")

        button = ui.button(words, icon="content_copy", on_click=copied)
        button.props(f"flat dense no-caps size=sm data-test={test or 'copy'}")
        button.props["aria-label"] = label
        with button:
            ui.tooltip(label)
        return button


class Plot:
    """A figure in its place; :meth:`show` draws another one there, :meth:`hide` takes it away."""

    def __init__(self, show: Show, test: str, key: str, *, title: bool) -> None:
        self._show, self._drawing = show, None  # type: tuple[Show, Drawing | None]
        with ui.element("div").classes("ctl-show-plot") as self.box:
            if test:
                self.box.props(f"data-test={test}")
            with ui.element("div").classes("ctl-show-head"):
                self._title = ui.html("", sanitize=False)
                self._title.set_visibility(title)
                if key:
                    help_button(key)
                ui.space()
                self._copy = show.copy(self._text, "Copy the numbers of this figure", words="Numbers")
            self._place = ui.element("div").classes("w-full")
        self._element: ui.plotly | None = None
        self.box.set_visibility(False)

    def show(self, drawing: Drawing) -> None:
        """Draw this; a legend's choice stays where the curves have the same names."""
        self._drawing = drawing
        figure = to_plotly(drawing, dark=self._show.dark)
        self._title.content = f"<h3>{escape(drawing.name)}</h3>"
        label = f"Figure: {drawing.name}; its numbers can be copied"
        if self._element is None:
            with self._place:
                self._element = ui.plotly(figure).classes("w-full").props("role=figure")
        else:
            self._element.update_figure(figure)
        self._element.props["aria-label"] = label
        self._element.style(f"height: {figure['layout']['height']}px")
        self.box.set_visibility(True)

    def hide(self) -> None:
        """Nothing is shown."""
        self._drawing = None
        self.box.set_visibility(False)

    def redraw(self) -> None:
        """Draw the same again, in the present theme."""
        if self._drawing is not None:
            self.show(self._drawing)

    def _text(self) -> str:
        return "" if self._drawing is None else self._drawing.text()


def help_button(key: str) -> ui.button:
    """A button that tells in a line what something is, and shows all of it when it is pressed."""
    told = help_for(key)
    button = ui.button(icon="help_outline", on_click=lambda: show_help(key))
    button.props(f"flat round dense size=sm tabindex=-1 data-test=help-{key.replace('.', '-')}")
    button.props["aria-label"] = f"Help: {told.title}"
    with button:
        ui.tooltip(told.tooltip).classes("max-w-xs")
    return button


def show_help(key: str) -> None:
    """The help on something, over the page."""
    told = help_for(key)
    with dialog(told.title, looks="ctl-show-help") as made:
        ui.html(told.html, sanitize=False).classes("w-full")
        ui.button("Close", on_click=made.close).props("flat autofocus")


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "", *, row_heads: bool = True) -> str:
    """A table in HTML; numbers are written for a reader, texts as they are. The last cell of a short row is as wide as the rest."""
    top = "".join(f'<th scope="col">{escape(head)}</th>' if head else "<td></td>" for head in heads)
    body = []
    for row in rows:
        cells = []
        for j, value in enumerate(row):
            if j == 0 and row_heads:
                cells.append(f'<th scope="row">{escape(shown(value))}</th>')
            else:
                kind = ' class="n"' if not isinstance(value, str) or len(value) <= NARROW else ""
                rest = len(heads) - j if j == len(row) - 1 else 1
                wide = f' colspan="{rest}"' if rest > 1 else ""
                cells.append(f"<td{kind}{wide}>{escape(shown(value))}</td>")
        body.append(f"<tr>{''.join(cells)}</tr>")
    told = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (
        f'<div class="ctl-show-scroll" tabindex="0" role="region" aria-label="{escape(caption or (heads[0] if heads else "Table"))}">'
        f'<table class="ctl-show-table">{told}<thead><tr>{top}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
    )


def matrix(name: str, values: Any, rows: Sequence[str], columns: Sequence[str]) -> str:
    """A matrix as a table with the names of its rows and columns."""
    return table(["", *columns], [[row, *map(float, line)] for row, line in zip(rows, values, strict=True)], name)


def shown(value: Any) -> str:
    """A number or a text for a reader; a complex number without a part that is not there."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "—"
    if isinstance(value, complex):
        size = abs(value)
        if abs(value.imag) <= 1e-12 * size:
            return number(value.real)
        return number(value) if abs(value.real) > 1e-12 * size else f"{number(value.imag)}i"
    return number(value)


def times(seconds: float) -> str:
    """A time that passes.

    >>> times(0.00031), times(2.4), times(93), times(7500)
    ('0.31 ms', '2.4 s', '1 min 33 s', '2 h 5 min')
    """
    if seconds < 1:
        return f"{number(seconds * 1e3, 3)} ms" if seconds >= 1e-6 else f"{number(seconds * 1e6, 3)} µs"
    if seconds < 60:
        return f"{number(seconds, 2)} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min"


def difference(lines: Sequence[Any], first: str, second: str) -> str:
    """Two texts side by side in HTML: what only one of them has is marked."""
    rows: list[str] = []
    old: list[str] = []
    new: list[str] = []

    def flush() -> None:
        for i in range(max(len(old), len(new))):
            left = f'<td class="old">{escape(old[i])}</td>' if i < len(old) else "<td></td>"
            right = f'<td class="new">{escape(new[i])}</td>' if i < len(new) else "<td></td>"
            rows.append(f"<tr>{left}{right}</tr>")
        old.clear()
        new.clear()

    for line in lines:
        if line.mark == " ":
            flush()
            rows.append(f"<tr><td>{escape(line.text)}</td><td>{escape(line.text)}</td></tr>")
        else:
            (old if line.mark == "-" else new).append(line.text)
    flush()
    return (
        '<div class="ctl-show-lines" tabindex="0" role="region" aria-label="Difference"><table class="ctl-show-diff">'
        f'<thead><tr><th scope="col">{escape(first)}</th><th scope="col">{escape(second)}</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
