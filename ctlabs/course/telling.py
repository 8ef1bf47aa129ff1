"""Whom long work on a course tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

#: (done, of how many, in words). What it raises ends the work between two files.
Tell = Callable[[int, int, str], object]


def nobody(done: int, total: int, words: str) -> None:
    """Nobody wants to know."""
