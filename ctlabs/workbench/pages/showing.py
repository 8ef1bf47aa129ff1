"""What the pages Understand, Experiment and Keep draw with: cards with help, tables, figures in the theme, numbers to copy."""

from __future__ import annotations

import asyncio
import json
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from nicegui import background_tasks, ui

from ctlabs.reporting import levels
from ctlabs.reporting.screen import height, to_plotly
from ctlabs.text import number
from ctlabs.workbench.desk.view import View, zoomed
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages.dialogs import dialog

if TYPE_CHECKING:
    from nicegui import Client
    from nicegui.events import GenericEventArguments

    from ctlabs.reporting.drawing import Drawing
    from ctlabs.workbench.pages.shell import Shell

#: Values of a curve up to which a figure is made at once, and characters that the clipboard is given.
PROMPT, LARGEST = 20_000, 4_000_000


#: What is known of a browser's theme where it follows the system's.
_dark: weakref.WeakKeyDictionary[Client, bool] = weakref.WeakKeyDictionary()



class Card(NamedTuple):
    """A part of a page, and its head, where further buttons go."""

    section: ui.element
    head: ui.element


class Show:
    """The drawing of one page in one tab."""

    def __init__(self, shell: Shell, view: View | None = None) -> None:
        self.shell, self.client = shell, shell.client
        self.view = View() if view is None else view
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

    def zoom(self, by: Plot | None, drawing: Drawing, reach: tuple[float, float] | None) -> None:
        """Show this of the drawing's horizontal axis in all figures that have it; the one ``by`` which it was chosen has it already."""
        if self.view.zoom(drawing.label, reach):
            for plot in [each for each in self._plots if each.label == drawing.label]:
                plot.redraw(fit=plot is not by)

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
            found = text()
            if len(found) > LARGEST:
                self.shell.tell("That is too much for the clipboard: Export has every row as a file")
                return
            with self.client:
                ui.run_javascript(f"ctlabs.copy({json.dumps(found)})")
            self.shell.tell("Copied")

        button = ui.button(words, icon="content_copy", on_click=copied)
        button.props(f"flat dense no-caps size=sm data-test={test or 'copy'}")
        button.props["aria-label"] = label
        with button:
            ui.tooltip(label)
        return button


class Plot:
    """A figure in its place; :meth:`show` draws another one there, :meth:`hide` takes it away.

    A long one is drawn by levels (:mod:`ctlabs.reporting.levels`): whoever looks at a part of it gets that part anew, and all figures over
    the same axis go with it.
    """

    def __init__(self, show: Show, test: str, key: str, *, title: bool) -> None:
        self._show, self._drawing = show, None  # type: tuple[Show, Drawing | None]
        self._drawn = 0  # how many times, so that a slow one does not come after a later one
        with ui.element("div").classes("ctl-show-plot") as self.box:
            if test:
                self.box.props(f"data-test={test}")
            with ui.element("div").classes("ctl-show-head"):
                self._title = ui.html("", sanitize=False)
                self._title.set_visibility(title)
                if key:
                    help_button(key)
                ui.space()
                self._log = ui.button("Log axis", on_click=self._turn).props("flat dense no-caps size=sm data-test=log")
                self._copy = show.copy(self._text, "Copy the numbers of this figure", words="Numbers")
            self._place = ui.element("div").classes("w-full")
            self._hint = ui.label("").classes("ctl-show-hint").props("data-test=drawn")
        self._element: ui.plotly | None = None
        self.box.set_visibility(False)

    def show(self, drawing: Drawing) -> None:
        """Draw this; a legend's choice stays where the curves have the same names."""
        self._drawing = drawing
        self.redraw()

    def hide(self) -> None:
        """Nothing is shown."""
        self._drawing = None
        self.box.set_visibility(False)

    def redraw(self, *, fit: bool = True) -> None:
        """Draw the same again, in the present theme, what of it is looked at; ``fit`` : also over another part of the vertical axes."""
        if self._drawing is None or self.box.is_deleted:
            return
        drawing, view = self._drawing, self._show.view
        chosen = view.log.get(drawing.name)
        scaled = drawing if chosen is None or not drawing.scalable else drawing.scaled(chosen)
        reach = None if drawing.square else view.reach.get(drawing.label)
        self._drawn += 1
        self._describe(drawing, scaled, levels.longest(drawing), log=scaled.falls)
        if levels.longest(drawing) <= PROMPT:
            self._put(_figure(scaled, self._show.dark, reach, fit))
        else:
            background_tasks.create(self._later(self._drawn, scaled, reach, fit), name="figure")

    async def _later(self, number: int, drawing: Drawing, reach: tuple[float, float] | None, fit: bool) -> None:
        """A long one, in a thread: the page stays alive."""
        made = await asyncio.to_thread(_figure, drawing, self._show.dark, reach, fit)
        if number == self._drawn and not self.box.is_deleted:
            self._put(made)

    def _describe(self, drawing: Drawing, scaled: Drawing, count: int, *, log: bool) -> None:
        self._title.content = f"<h3>{escape(drawing.name)}</h3>"
        self._log.set_visibility(drawing.scalable)
        self._log.text = "Linear axis" if log else "Log axis"
        self._log.props["aria-label"] = f"{self._log.text}: {drawing.name}"
        long = f"{count:,} instants".replace(",", " ")
        self._hint.text = f"{long}: the extremes of every column of the screen are drawn, and what is outside a band; zoom in to see all."
        self._hint.set_visibility(count > levels.LONG)
        self._place.style(f"min-height: {height(scaled)}px")
        self.box.set_visibility(True)

    def _put(self, figure: dict[str, Any]) -> None:
        if self._element is None:
            with self._place:
                self._element = ui.plotly(figure).classes("w-full").props("role=figure")
                self._element.on("plotly_relayout", self._relayout)
        else:
            self._element.update_figure(figure)
        name = "" if self._drawing is None else self._drawing.name
        self._element.props["aria-label"] = f"Figure: {name}; its numbers can be copied"
        self._element.style(f"height: {figure['layout']['height']}px")

    def _relayout(self, event: GenericEventArguments) -> None:
        """Somebody has looked closer, or at all of it again."""
        found = zoomed(event.args if isinstance(event.args, dict) else {})
        if found is not None and self._drawing is not None and not self._drawing.square:
            self._show.zoom(self, self._drawing, found[0])

    def _turn(self) -> None:
        """A logarithmic axis, or a linear one again."""
        if self._drawing is not None:
            name = self._drawing.name
            self._show.view.log[name] = not self._show.view.log.get(name, self._drawing.falls)
            self.redraw()

    def _text(self) -> str:
        return "" if self._drawing is None else self._drawing.text()

    @property
    def label(self) -> str:
        """What is on the horizontal axis; empty where nothing is shown, or where it does not go with that of others."""
        return "" if self._drawing is None or self._drawing.square else self._drawing.label


def _figure(drawing: Drawing, dark: bool, reach: tuple[float, float] | None, fit: bool) -> dict[str, Any]:
    return to_plotly(levels.level(drawing, reach), dark=dark, reach=reach, fit=fit)


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
