r"""Equations for a page: LaTeX as MathML."""

from __future__ import annotations

import re
from functools import lru_cache
from html import escape

_MATRIX = re.compile(r"<mo>&#x0005B;</mo><mtable>(.*?)</mtable><mo>&#x0005D;</mo>", re.DOTALL)
_DOTTED = re.compile(r"<mover><mi>([xy])</mi><mo>&#x002D9;</mo></mover>")
_BAR = '<mo stretchy="false">&#x0007C;</mo>'


@lru_cache(maxsize=1024)
def mathml(latex: str, *, block: bool = False) -> str:
    r"""LaTeX as MathML; what cannot be converted is shown as it is. The last lines are remembered, not all.

    >>> mathml(r"\Phi")
    '<math xmlns="http://www.w3.org/1998/Math/MathML" display="inline"><mrow><mi>&#x003A6;</mi></mrow></math>'
    """
    from latex2mathml.converter import convert

    try:
        found = str(convert(latex, display="block" if block else "inline"))
    except Exception:  # the converter has no common class of its errors
        return f"<code>{escape(latex)}</code>"
    # Brackets of matrices are drawn by the page's style, for not every machine has a font whose brackets grow.
    found = _MATRIX.sub(r'<mtable class="ctl-matrix">\1</mtable>', found)
    found = _DOTTED.sub(lambda letter: f'<mi style="font-style: italic">{"ẋ" if letter[1] == "x" else "ẏ"}</mi>', found)
    # A bar is a fence (|Φ|) in every formula here, never a relation: no space around it.
    return found.replace(_BAR, '<mo stretchy="false" lspace="0" rspace="0">&#x0007C;</mo>')
