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

if TYPE_CHECKING:
    from nicegui import Client
    from nicegui.events import GenericEventArguments

    from ctlabs.reporting.drawing import Drawing
    from ctlabs.workbench.pages.shell import Shell

#: Texts in tables that are not broken into lines.
NARROW = 14

_STYLE = """
.show-grid { width: 100%; display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 1rem; align-items: start; }
.show-card { width: 100%; min-width: 0; display: flex; flex-direction: column; gap: .6rem; padding: .9rem 1rem 1rem; border-radius: 10px;
  border: 1px solid color-mix(in srgb, currentColor 18%, transparent); background: #fff; }
body.body--dark .show-card { background: #1d1d1d; }
.show-card > .q-btn { align-self: flex-start; }
.show-card .q-btn--outline.q-btn--dense { padding: .2rem .6rem; }
.show-wide { grid-column: 1 / -1; }
.show-head { display: flex; align-items: center; gap: .25rem; min-height: 2.2rem; flex-wrap: wrap; }
.show-head h2, .show-head h3 { font-size: 1.15rem; line-height: 1.3; font-weight: 600; margin: 0; }
.show-head h3 { font-size: 1rem; }
.show-why { padding: .5rem .7rem; border-left: 4px solid #b26a00; background: color-mix(in srgb, #b26a00 12%, transparent);
  border-radius: 4px; overflow-wrap: anywhere; }
.show-error { font-weight: 600; color: #b00020; overflow-wrap: anywhere; }
body.body--dark .show-error { color: #ff9c94; }
.show-error:empty, .show-why:empty { display: none; }
.show-hint { font-size: .85rem; opacity: .82; line-height: 1.35; overflow-wrap: anywhere; }
.show-good { color: #00664a; font-weight: 600; }
.show-bad { color: #b00020; font-weight: 600; }
body.body--dark .show-good { color: #58d3a5; }
body.body--dark .show-bad { color: #ff9c94; }
.show-scroll { overflow-x: auto; max-width: 100%; }
.show-table { border-collapse: collapse; font-size: .9rem; }
.show-table caption { text-align: left; font-weight: 600; padding: .3rem 0; white-space: nowrap; }
.show-table th { text-align: left; font-weight: 600; padding: .25rem .9rem .25rem 0; vertical-align: top; }
.show-table td { padding: .25rem .9rem .25rem 0; vertical-align: top; }
.show-table td.n { font-variant-numeric: tabular-nums; white-space: nowrap; }
.show-table tbody tr { border-top: 1px solid color-mix(in srgb, currentColor 16%, transparent); }
.show-side { display: flex; flex-wrap: wrap; gap: .5rem 2rem; }
.show-diff { width: 100%; border-collapse: collapse; table-layout: fixed; font: .82rem/1.45 ui-monospace, "DejaVu Sans Mono", monospace; }
.show-lines { max-height: 22rem; overflow-y: auto; width: 100%; }
.show-diff th { text-align: left; font-family: inherit; padding: .2rem .4rem; }
.show-diff td { padding: 0 .4rem; white-space: pre-wrap; overflow-wrap: anywhere; vertical-align: top; width: 50%; }
.show-diff td.old { background: color-mix(in srgb, #d55e00 20%, transparent); }
.show-diff td.new { background: color-mix(in srgb, #0072b2 20%, transparent); }
.show-help p { margin: 0 0 .5rem; line-height: 1.5; }
.show-help math[display=block] { display: block; overflow-x: auto; overflow-y: hidden; margin: .6rem 0; text-align: left; }
.show-help dl { display: grid; grid-template-columns: 5rem minmax(0, 1fr); gap: .2rem .5rem; margin: 0; font-size: .92rem; }
.show-help dt { opacity: .75; } .show-help dd { margin: 0; overflow-wrap: anywhere; }
.show-equation { overflow-x: auto; overflow-y: hidden; max-width: 100%; padding: .2rem 0; }
.show-plot { width: 100%; min-width: 0; }
.show-plot .modebar-btn path { fill: currentColor !important; opacity: .75; }
.show-plot .modebar-group { background: none !important; }
@media (max-width: 899px) {
  .show-grid { grid-template-columns: minmax(0, 1fr); }
  .show-card { padding: .6rem .65rem .75rem; }
  .show-plot .modebar-container { display: none; }
}
"""

#: What is known of a browser's theme where it follows the system's.
_dark: weakref.WeakKeyDictionary[Client, bool] = weakref.WeakKeyDictionary()

_WATCH = """
(() => {
  let last = %(last)s;
  const look = (tries) => {
    const probe = getHtmlElement(%(id)s);
    if (!probe) return tries && setTimeout(() => look(tries - 1), 20);
    const tell = () => {
      if (!probe.isConnected) return watch.disconnect();
      const dark = document.body.classList.contains("body--dark");
      if (dark !== last) probe.dispatchEvent(new CustomEvent("theme", { detail: last = dark }));
    };
    const watch = new MutationObserver(tell);
    watch.observe(document.body, { attributes: true, attributeFilter: ["class"] });
    tell();
  };
  look(100);
  import("nicegui-plotly");
})()
"""
# The clipboard is there only on pages that are this machine's own or encrypted; selecting and copying works elsewhere too.
_COPY = """
(async () => {
  const text = %s;
  try { await navigator.clipboard.writeText(text); } catch {
    const area = document.body.appendChild(document.createElement("textarea"));
    area.value = text; area.select(); document.execCommand("copy"); area.remove();
  }
})()
"""


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
        ui.html(f"<style>{_STYLE}</style>", sanitize=False).classes("hidden")
        probe = ui.element("span").classes("hidden")
        probe.on("theme", self._themed, args=["detail"])
        with self.client:
            ui.run_javascript(_WATCH % {"id": probe.id, "last": json.dumps(self.dark)})

    def _themed(self, event: GenericEventArguments) -> None:
        self.dark = _dark[self.client] = bool(event.args["detail"] if isinstance(event.args, dict) else event.args)
        for plot in list(self._plots):
            plot.redraw()

    # Parts of a page -------------------------------------------------------------------------------------------------

    @contextmanager
    def card(self, title: str, key: str = "", *, wide: bool = False, test: str = "", level: int = 2) -> Iterator[Card]:
        """A part of the page with its title and help."""
        with ui.element("section").classes("show-card") as section:
            section.props["aria-label"] = title
            if wide:
                section.classes("show-wide")
            if test:
                section.props(f"data-test={test}")
            with ui.element("div").classes("show-head") as head:
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
                ui.run_javascript(_COPY % json.dumps(text()))
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
        with ui.element("div").classes("show-plot") as self.box:
            if test:
                self.box.props(f"data-test={test}")
            with ui.element("div").classes("show-head"):
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
                self._element = ui.plotly(figure).classes("w-full").props("role=img")
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
    button.props(f"flat round dense size=sm data-test=help-{key.replace('.', '-')}")
    button.props["aria-label"] = f"Help: {told.title}"
    with button:
        ui.tooltip(told.tooltip).classes("max-w-xs")
    return button


def show_help(key: str) -> None:
    """The help on something, over the page."""
    told = help_for(key)
    with ui.dialog() as dialog, ui.card().classes("show-help") as card:
        card.props["aria-label"] = told.title
        ui.html(
            f"<h2 style='font-size:1.2rem;line-height:1.3;font-weight:600;margin:0'>{escape(told.title)}</h2>",
            sanitize=False,
        )
        ui.html(told.html, sanitize=False).classes("w-full")
        ui.button("Close", on_click=dialog.close).props("flat autofocus")
    dialog.on("hide", dialog.delete)
    dialog.open()


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "", *, row_heads: bool = True) -> str:
    """A table in HTML; numbers are written for a reader, texts as they are. The last cell of a short row is as wide as the rest."""
    top = "".join(f'<th scope="col">{escape(head)}</th>' for head in heads)
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
        f'<div class="show-scroll" tabindex="0" role="region" aria-label="{escape(caption or (heads[0] if heads else "Table"))}">'
        f'<table class="show-table">{told}<thead><tr>{top}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
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
        '<div class="show-lines" tabindex="0" role="region" aria-label="Difference"><table class="show-diff">'
        f'<thead><tr><th scope="col">{escape(first)}</th><th scope="col">{escape(second)}</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
