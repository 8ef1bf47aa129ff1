"""Equations of the site as MathML with a font of its own: no script, no network, also from a folder.

The LaTeX is converted as in the reports (:mod:`ctlabs.reporting.mathml`); the signs that the site uses are cut out of the font once,
when all pages are written, and lie in one style sheet.
"""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging

from ctlabs.reporting import mathfont
from ctlabs.reporting.mathml import STYLE, lines, mathml

LOG = logging.getLogger(__name__)
SHEET = "math.css"


def converted(node: nodes.Element, latex: str, *, block: bool) -> str:
    """One equation; what the converter cannot do is a warning, so that no page shows LaTeX."""
    latex = latex.strip()
    if re.search(r"\\\\", latex) and r"\begin" not in latex:
        latex = rf"\begin{{aligned}} {latex} \end{{aligned}}"
    found = mathml(latex, block=block)
    if found.startswith("<code>"):
        LOG.warning("equation is no MathML: %s", latex, location=node, type="equations")
    return found


def inline(translator: Any, node: nodes.math) -> None:
    """An equation in a line of text."""
    translator.body.append(converted(node, node.astext(), block=False))
    raise nodes.SkipNode


def block(translator: Any, node: nodes.math_block) -> None:
    """A displayed equation, its number at the right; side by side they stand below each other where it is narrow."""
    latex, _, number = node.astext().partition(r"\tag{")
    shown = "".join(converted(node, line, block=True) for line in lines(latex))
    told = f'<span class="number">({number.strip().rstrip("}")})</span>' if number else ""
    translator.body.append(f'<div class="equation">{shown}{told}</div>\n')
    raise nodes.SkipNode


def write_sheet(app: Sphinx, failed: Exception | None) -> None:
    """The style sheet with the signs that the pages have."""
    if failed or app.builder.format != "html":
        return
    signs: set[int] = set()
    for page in Path(app.outdir).rglob("*.html"):
        for equation in re.findall("<math.*?</math>", page.read_text(encoding="utf-8"), re.DOTALL):
            signs |= set(map(ord, unescape(re.sub("<[^>]*>", "", equation))))
    page = f"<math>{''.join(map(chr, sorted(signs)))}</math>".replace("&", "&amp;").replace("<", "&lt;", 0)
    (Path(app.outdir) / "_static" / SHEET).write_text(mathfont.font(page) + STYLE, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Make MathML the renderer of equations."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.add_css_file(SHEET)
    app.connect("build-finished", write_sheet)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
