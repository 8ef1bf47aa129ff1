"""The index of the book: where a lab first speaks of a term."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache

from ctlabs.labs.catalogue import catalogue, folder

#: What is not prose: listings, equations, links and pictures, places, headings, tables.
_OTHER = re.compile(
    r"(^```.*?^```$|\$\$.*?\$\$|\$[^$\n]+\$|`[^`\n]+`|!?\[[^\]\n]*\]\([^)\n]*\)|<[^>\n]*>|^#.*?$|^\|.*?$)", re.MULTILINE | re.DOTALL
)
#: The place of a term in a lab.
PLACE = "index-{number}-{lab}"


@cache
def terms() -> dict[str, re.Pattern[str]]:
    """The terms in the order of the alphabet, and by which words each is found, from ``tasks/terms.toml``."""
    read = tomllib.loads((folder() / "terms.toml").read_text(encoding="utf-8"))
    return {term: re.compile(rf"\b(?:{read[term]})(?!\w)", re.IGNORECASE) for term in sorted(read, key=str.casefold)}


def marked(lab: str, body: str) -> str:
    r"""The text of a lab with a place before the first words that speak of each term.

    >>> re.sub(r"index-\d+", "index-1", marked("task16", "$pole$ and a pole, and poles"))
    '$pole$ and a <a id="index-1-task16"></a>pole, and poles'
    """
    pieces = _OTHER.split(body)
    found: dict[int, list[tuple[int, int]]] = {}
    for number, words in enumerate(terms().values()):
        for i in range(0, len(pieces), 2):
            if match := words.search(pieces[i]):
                found.setdefault(i, []).append((match.start(), number))
                break
    for i, places in found.items():
        for start, number in sorted(places, reverse=True):
            place = PLACE.format(number=number, lab=lab)
            pieces[i] = f'{pieces[i][:start]}<a id="{place}"></a>{pieces[i][start:]}'
    return "".join(pieces)


def index(bodies: Mapping[str, str]) -> str:
    """The index of marked texts, each by its lab: a line for each term, with links to the labs that speak of it."""
    lines = []
    for number, term in enumerate(terms()):
        places = {lab: PLACE.format(number=number, lab=lab) for lab in bodies}
        links = [f"[{catalogue()[lab].short.replace('_', ' ')}](#{place})" for lab, place in places.items() if f'"{place}"' in bodies[lab]]
        if links:
            lines.append(f"{term}: {', '.join(links)}")
    return "\n\n".join(lines)
