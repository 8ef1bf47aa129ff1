"""Set points on the page Control: a number for each tracked output, and what the loop does after a step to it."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from nicegui import ui

from ctlabs.reporting.drawing import labelled
from ctlabs.studies import loops as pictures
from ctlabs.workbench.desk import plain

if TYPE_CHECKING:
    from ctlabs.studies.regulating import Regulated
    from ctlabs.workbench.desk.loops import LoopDesk
    from ctlabs.workbench.pages.showing import Plot, Show


class _Row(NamedTuple):
    """One tracked output."""

    field: ui.input
    plot: Plot


class SetPoints:
    """The tracked outputs one below the other; rows stay where they are, so that nothing is lost that is being typed."""

    def __init__(self, show: Show, desk: LoopDesk) -> None:
        self.show_, self.desk = show, desk
        self.found: Regulated | None = None
        self.rows: dict[str, _Row] = {}
        self.place = ui.element("div").classes("w-full")

    def show(self, found: Regulated) -> None:
        """Show those of a regulator."""
        self.found = found
        names = [response.name for response in found.set_points.found or ()]
        if list(self.rows) != names:
            self.place.clear()
            with self.place:
                self.rows = {name: self._row(found, i, name) for i, name in enumerate(names)}
        for name in names:
            self._draw(name)

    def _row(self, found: Regulated, i: int, name: str) -> _Row:
        units = dict(zip(found.truth.measurements, found.file.measurement_units, strict=True))
        with ui.element("div").classes("w-full"):
            field = ui.input(
                labelled(f"Set point of {name}", units.get(name, "")), value=f"{self.desk.set_points.get(name, 1.0):g}",
                on_change=partial(self._typed, name), validation=_refusal,
            ).classes("w-48")  # fmt: skip
            field.props(f"outlined dense inputmode=decimal hide-bottom-space autocomplete=off data-test=set-point-{i}")
            return _Row(field, self.show_.plot(test=f"plot-control-step-{i}"))

    def _typed(self, name: str) -> None:
        try:
            self.desk.set_points[name] = _finite(self.rows[name].field.value)
        except ValueError:  # which the field says itself
            return
        self._draw(name)

    def _draw(self, name: str) -> None:
        found = self.found
        assert found is not None
        response = next(each for each in found.set_points.value if each.name == name).scaled(self.desk.set_points.get(name, 1.0))
        drawing = pictures.step(found, response)
        self.rows[name].plot.show(dataclasses.replace(drawing, name=f"{drawing.name}: {name}"))


def _refusal(text: object) -> str | None:
    """Why it is no set point, in one line."""
    try:
        _finite(text)
    except ValueError as why:
        return str(why)
    return None


def _finite(text: object) -> float:
    value = plain.number(text)
    if not math.isfinite(value):
        msg = f"expected a finite number, received {value:g}"
        raise ValueError(msg)
    return value
