r"""Context help: what a field is, its equation, unit and example; the algorithms; the figures. No page is needed for it.

>>> help_for("model.Q").unit
'(input unit)²·s'
>>> help_for("model.Q").tooltip
'Strength of the noise, Q: how strong the white noise w is: the height of its flat spectrum, not a variance.'

A page shows the tooltip beside a field, and :attr:`Help.html` in a panel; the texts themselves are in
:mod:`ctlabs.workbench.help_texts`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import cache

from ctlabs.reporting.mathml import mathml
from ctlabs.workbench.help_entry import Help
from ctlabs.workbench.help_texts import TEXTS

#: The groups of keys, in the order in which a person meets them, and their headings.
GROUPS = {
    "model": "The model",
    "understand": "What the model tells before any data",
    "experiment": "The experiment",
    "algorithm": "The algorithms",
    "result": "The results",
    "keep": "Keeping and exporting",
    "labs": "The labs",
}


def help_for(key: str) -> Help:
    """The help on a field, algorithm or figure.

    Raises
    ------
    LookupError
        A key that there is no help on.
    """
    found = _by_key()
    if key not in found:
        close = difflib.get_close_matches(key, found, n=1)
        meant = f" (did you mean {close[0]}?)" if close else ""
        msg = f"help: expected a key such as model.F, received {key!r}{meant}"
        raise LookupError(msg)
    return found[key]


def topics(words: str = "") -> dict[str, tuple[Help, ...]]:
    """All help by group, or that in which every one of ``words`` occurs; groups without any are left out."""
    wanted = words.lower().split()
    found = {
        group: tuple(each for each in _by_key().values() if each.group == group and _has(each, wanted))
        for group in GROUPS
    }
    return {group: each for group, each in found.items() if each}


@cache
def _by_key() -> dict[str, Help]:
    return {each.key: each for each in TEXTS}


def _has(each: Help, wanted: Iterable[str]) -> bool:
    text = f"{each.key} {each.title} {each.what} {each.unit} {each.example} {each.note} {each.source}".lower()
    return all(word in text for word in wanted)


__all__ = ["GROUPS", "Help", "help_for", "mathml", "topics"]
