"""The words of a picture in the reader's language: labels, legends and marks, whoever wrote them.

Functions that draw take plain words, so that a lab writes none of its words twice; they are translated together, where the
picture enters a report.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

from ctlabs.reporting.drawing import Drawing, Panel
from ctlabs.text import translated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Named = TypeVar("Named")


def in_words_of_the_reader(picture: Drawing | Figure) -> Drawing | Figure:
    """The picture with each of its words translated; a drawing whose words are a user's as it is.

    >>> in_words_of_the_reader(Drawing("Squares", "t, s", (Panel("x, m"),))).label
    't, s'
    """
    if not isinstance(picture, Drawing):
        for words in _words(picture):
            if (ours := translated(words.get_text())) != words.get_text():
                words.set_text(ours)
        return picture
    if picture.verbatim:
        return picture
    return replace(
        picture,
        name=translated(picture.name),
        label=translated(picture.label),
        panels=tuple(map(_panel, picture.panels)),
        ticks=tuple(map(translated, picture.ticks)),
        marks=_named(picture.marks),
    )


def _panel(panel: Panel) -> Panel:
    return replace(
        panel,
        label=translated(panel.label),
        curves=_named(panel.curves),
        bands=_named(panel.bands),
        levels=_named(panel.levels),
    )


def _named(things: tuple[Named, ...]) -> tuple[Named, ...]:
    """Curves, bands or marks with their names translated."""
    return tuple(replace(cast(Any, each), name=translated(cast(Any, each).name)) for each in things)


def _words(figure: Figure) -> Iterator[Any]:
    """Titles, labels, legends and texts of a figure; the numbers at its ticks are none."""
    for axes in cast(Any, figure).axes:
        lines = [axes.xaxis, axes.yaxis, *([axes.zaxis] if hasattr(axes, "zaxis") else [])]
        yield from (axes.title, *(line.label for line in lines), *axes.texts)
        if axes.get_legend() is not None:
            yield from axes.get_legend().get_texts()
    for legend in figure.legends:
        yield from legend.get_texts()
    yield from figure.texts
