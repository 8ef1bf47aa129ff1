"""Dialogs over a page: a title, what is drawn inside, and buttons at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape

from nicegui import ui


@contextmanager
def dialog(title: str, width: int = 30, looks: str = "") -> Iterator[ui.dialog]:
    """A dialog around what is drawn inside, so many rem wide; it opens when that is drawn, and is gone when it is closed."""
    with ui.dialog() as made, ui.card().style(f"width: {width}rem; max-width: 94vw; gap: .7rem") as card:
        card.classes(looks)
        ui.html(escape(title), sanitize=False, tag="h2").classes("text-h6").style("margin: 0")
        made.props["aria-label"] = title
        yield made
    made.on("hide", made.delete)
    made.open()


def buttons(made: ui.dialog, word: str, test: str, action: Callable[[], object]) -> None:
    """Cancel, and what the dialog is for."""
    with ui.row().classes("w-full justify-end"):
        ui.button("Cancel", on_click=made.close).props("flat no-caps")
        ui.button(word, on_click=lambda: action()).props(f"no-caps data-test={test}")
