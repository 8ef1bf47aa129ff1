r"""Equations for a page: LaTeX as MathML, and the style of its matrices."""

from __future__ import annotations

import re
from functools import lru_cache
from html import escape

#: Brackets of matrices as borders: not every machine has a font whose brackets grow.
STYLE = """
mtable.ctl-matrix { margin: 0 .15em; --stroke: linear-gradient(currentColor, currentColor); background:
  var(--stroke) left top / 1.3px 100%, var(--stroke) right top / 1.3px 100%, var(--stroke) left top / .35em 1.3px,
  var(--stroke) left bottom / .35em 1.3px, var(--stroke) right top / .35em 1.3px, var(--stroke) right bottom / .35em 1.3px;
  background-repeat: no-repeat; }
"""

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
    # As accents, the signs that stand above a letter and not beside it.
    for sign, accent in (("5E", "2C6"), ("7E", "2DC")):
        found = found.replace(f">&#x000{sign};</mo></mover>", f">&#x00{accent};</mo></mover>")
    found = _MATRIX.sub(r'<mtable class="ctl-matrix">\1</mtable>', found)
    found = _DOTTED.sub(lambda letter: f'<mi style="font-style: italic">{"ẋ" if letter[1] == "x" else "ẏ"}</mi>', found)
    # A bar is a fence (|Φ|) in every formula here, never a relation: no space around it.
    return found.replace(_BAR, '<mo stretchy="false" lspace="0" rspace="0">&#x0007C;</mo>')


def lines(latex: str) -> list[str]:
    r"""Equations side by side as single ones, so that a page can put them below each other where it is narrow.

    >>> lines(r"\Phi = 1 \qquad Q_d = \begin{bmatrix} 1 \qquad 0 \end{bmatrix}")
    ['\\Phi = 1', 'Q_d = \\begin{bmatrix} 1 \\qquad 0 \\end{bmatrix}']
    """
    found = [""]
    for piece in latex.split(r"\qquad"):
        last = found[-1]
        whole = last.count("{") == last.count("}") and last.count(r"\begin") == last.count(r"\end")
        if whole and last.count(r"\left") == last.count(r"\right"):
            found.append(piece)
        else:
            found[-1] = rf"{last}\qquad{piece}"
    return [each.strip() for each in found if each.strip()]
