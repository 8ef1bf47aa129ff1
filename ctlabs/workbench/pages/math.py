"""Equations on a page: LaTeX as MathML, line by line, so that only a line that has changed travels."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from ctlabs.reporting.mathml import mathml


class Equations(ui.element):
    """Lines of equations, each of which scrolls inside itself where it is long."""

    def __init__(self, label: str) -> None:
        super().__init__("div")
        self.classes("ctl-equations").props(f'role=group aria-label="{label}"')
        self._lines: list[ui.html] = []

    def show(self, lines: Sequence[str]) -> None:
        """Show these lines."""
        while len(self._lines) > len(lines):
            self._lines.pop().delete()
        with self:
            while len(self._lines) < len(lines):
                self._lines.append(ui.html("", sanitize=False).classes("ctl-equation").props("tabindex=0"))
        for element, latex in zip(self._lines, lines, strict=True):
            content = mathml(latex, block=True)
            if element.content != content:
                element.content = content
