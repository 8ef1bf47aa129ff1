"""The mathematical font of a page: not every machine has one, and without one indices go astray."""

from __future__ import annotations

import base64
import io
import re
from functools import lru_cache
from html import unescape
from pathlib import Path

#: STIX Two Math, as much of it as equations need (templates/math-license.txt).
FONT = Path(__file__).parent / "templates" / "math.ttf"
#: The signs of a model's matrices, and of what is said of them, and the font with them ready made: a command on one's own data need
#: not cut it out.
MODELS = frozenset(map(ord, "FGQRHPΦΓBDNKSCxyzuwvthcdse0123456789.,=+−×()[]…∞¯ˆ·/≤≥priaLσλ"))
READY = FONT.with_name("math-models.woff")
#: The first letter of each alphabet, its length, and where its italics begin, in which variables of one letter are set.
ALPHABETS = ((ord("A"), 26, 0x1D434), (ord("a"), 26, 0x1D44E), (0x391, 25, 0x1D6E2), (0x3B1, 25, 0x1D6FC))
#: The italic h, which stands apart from the other italics.
PLANCK = 0x210E
#: It, and the sign of a root, which an equation draws without naming it.
ALWAYS = (PLANCK, 0x221A)


def font(page: str) -> str:
    """The style of equations, with the signs that the equations of a page need."""
    equations = re.sub("<[^>]*>", "", "".join(re.findall("<math.*?</math>", page, re.DOTALL)))
    signs = frozenset(map(ord, unescape(equations)))
    data = base64.b64encode(READY.read_bytes() if signs <= MODELS else subset(signs)).decode()
    return style(f"data:font/woff;base64,{data}", "woff")


def style(address: str, kind: str = "truetype") -> str:
    """The style of equations with the font at an address; ``kind`` as style sheets name formats.

    >>> style("/math.ttf").splitlines()[0]
    '@font-face { font-family: "ctlabs math"; src: url(/math.ttf) format("truetype"); }'
    """
    return (
        f'@font-face {{ font-family: "ctlabs math"; src: url({address}) format("{kind}"); }}\n'
        'math { font-family: "ctlabs math", "STIX Two Math", "Cambria Math", "Latin Modern Math", math; }\n'
    )


@lru_cache(maxsize=32)
def subset(signs: frozenset[int]) -> bytes:
    """The font with these signs, their italics, and all sizes of what grows; the same bytes everywhere."""
    from fontTools import subset as cutter
    from fontTools.ttLib import TTFont

    options = cutter.Options(layout_features=["*"], hinting=False, notdef_outline=True, flavor="woff")
    found, packed = TTFont(io.BytesIO(FONT.read_bytes()), recalcTimestamp=False), io.BytesIO()
    chosen = cutter.Subsetter(options)
    chosen.populate(unicodes={*ALWAYS, *signs, *map(italic, signs)})
    chosen.subset(found)
    cutter.save_font(found, packed, options)
    return packed.getvalue()


def italic(sign: int) -> int:
    """The italic of a letter; another sign as it is.

    >>> chr(italic(ord("x"))), chr(italic(ord("h"))), chr(italic(ord("+")))
    ('𝑥', 'ℎ', '+')
    """
    for first, length, begins in ALPHABETS:
        if first <= sign < first + length and sign != ord("h"):
            return begins + sign - first
    return PLANCK if sign == ord("h") else sign
