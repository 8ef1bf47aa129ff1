"""The font of equations that the workbench serves has every sign of the equations that its pages show."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from html import unescape

import pytest
from fontTools.ttLib import TTFont

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.files.modelfile import gallery, loads
from ctlabs.labs.catalogue import catalogue as labs
from ctlabs.reporting import mathfont
from ctlabs.reporting.mathml import mathml
from ctlabs.workbench.desk.sheet import ModelSheet
from ctlabs.workbench.help import groups
from ctlabs.workbench.pages.labs import statement
from ctlabs.workbench.runs.catalogue import sheet


@cache
def known() -> frozenset[int]:
    """The signs of the font."""
    return frozenset(TTFont(mathfont.FONT).getBestCmap())


def missing(page: str) -> str:
    """Signs of a page's equations that the font does not have, in the italics in which a letter alone is set."""
    found: set[int] = set()
    inside = "".join(re.findall(r"<math.*?</math>", page, re.DOTALL))
    for name, content in re.findall(r"<(m[ion]|mtext)\b[^>]*>(.*?)</\1>", inside, re.DOTALL):
        text = unescape(content)
        signs = [ord(text)] if len(text) == 1 else [ord(sign) for sign in text if not sign.isspace()]
        found |= {mathfont.italic(sign) if name == "mi" and len(text) == 1 and "normal" not in content else sign for sign in signs}
    return "".join(sorted(chr(sign) for sign in found - known()))


def equations(kind: str) -> Iterator[tuple[str, str]]:
    """Where there are equations, and the page's text there."""
    if kind == "help":
        yield from ((group.heading, "".join(entry.html for entry in group.entries.values())) for group in groups().values())
    elif kind == "labs":
        yield from ((name, statement(sheet(name))) for name in labs())
    else:
        yield from ((entry.name, "".join(map(mathml, ModelSheet(loads(entry.text)).equations()))) for entry in gallery())


@pytest.mark.parametrize("kind", ["help", "labs", "models"])
def test_every_sign_of_an_equation_is_in_the_font(kind: str) -> None:
    """So that it looks alike on a machine without a mathematical font."""
    found = dict(equations(kind))
    assert sum("<math" in page for page in found.values()) > len(found) / 2
    assert {where: signs for where, page in found.items() if (signs := missing(page))} == {}


def test_a_sign_that_is_not_there_is_found() -> None:
    """Of another script; and an italic letter counts as such."""
    assert missing("<math><mi>Ж</mi><mn>1</mn></math>") == "Ж"
    assert missing("<math><mi>x</mi><mo>=</mo><mn>1</mn></math>") == ""
