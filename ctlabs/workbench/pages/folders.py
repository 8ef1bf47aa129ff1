"""A folder of this machine: typed into a field, or chosen in a list of folders."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ctlabs.workbench.desk import courses
from ctlabs.workbench.pages.dialogs import dialog

if TYPE_CHECKING:
    from ctlabs.workbench.pages.shell import Shell


class FolderField:
    """A field for a folder, with a button that lists folders; ``take`` is called with what was typed or chosen."""

    def __init__(self, shell: Shell, label: str, value: str, test: str, take: Callable[[str], Any]) -> None:
        self._shell, self._label, self._take = shell, label, take
        with ui.element("div").classes("ctl-course-path"):
            self.field = ui.input(label, value=value).props(f"outlined dense autocomplete=off spellcheck=false data-test={test}")
            self.field.on("keydown.enter", lambda: take(self.text))
            button = ui.button("Choose…", icon="folder_open", on_click=self._choose)
            button.props(f"no-caps outline dense data-test={test}-choose")
            button.props["aria-label"] = f"Choose: {label}"

    @property
    def text(self) -> str:
        """What stands in the field."""
        return str(self.field.value or "")

    async def _choose(self) -> None:
        with self._shell.client, dialog(self._label, 34) as made:
            _List(self, made).draw()

    async def chosen(self, place: Path) -> None:
        """Take a folder from the list."""
        self.field.value = str(place)
        result = self._take(str(place))
        if asyncio.iscoroutine(result):
            await result

    @property
    def begin(self) -> Path:
        """Where the list begins: at the folder that stands in the field, or at one's own."""
        try:
            return courses.folder(self.text, "a folder")
        except ValueError:
            return Path.home()


class _List:
    """The folders in a folder."""

    def __init__(self, field: FolderField, made: ui.dialog) -> None:
        self._field, self._dialog, self._place = field, made, field.begin

    def draw(self) -> None:
        self._where = ui.label("").classes("ctl-course-where").props("role=status aria-live=polite data-test=folder-where")
        with ui.row().classes("gap-2"):
            up = ui.button("Up", icon="arrow_upward", on_click=lambda: self._go(self._place.parent))
            up.props("no-caps outline dense data-test=folder-up")
            ui.button("Home", icon="home", on_click=lambda: self._go(Path.home())).props("no-caps outline dense")
        self._wrong = ui.label("").classes("ctl-show-error").props("role=alert")
        self._box = ui.element("div").classes("ctl-course-folders").props('role=group aria-label="Folders"')
        with ui.row().classes("w-full justify-end"):
            ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
            ui.button("Take this folder", on_click=lambda: self._take(self._place)).props("no-caps data-test=folder-take")
        self._fill()

    def _go(self, place: Path) -> None:
        self._place = place
        self._fill()

    def _fill(self) -> None:
        self._where.text, self._wrong.text = str(self._place), ""
        self._box.clear()
        try:
            found = courses.inside(self._place)
        except ValueError as why:
            self._wrong.text = str(why)
            return
        with self._box:
            for name, course in found:
                button = ui.button(name, icon="school" if course else "folder", on_click=lambda _, name=name: self._go(self._place / name))
                button.props("flat no-caps dense align=left data-test=folder")
                if course:
                    button.props["aria-label"] = f"{name}: a course"
            if not found:
                ui.label("There is no folder in it.").classes("ctl-show-hint")

    async def _take(self, place: Path) -> None:
        self._dialog.close()
        await self._field.chosen(place)
