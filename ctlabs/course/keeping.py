"""The keys of a course, kept in its folder: drawing them takes a minute, and reading them no time.

A file of ``key/`` is believed only while nothing has changed that it was computed from: secret, term, students, redrawn attempts, and
the sources of the lab's answers. It is the teacher's, as everything in ``key/``.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course
from ctlabs.course.variants import drawn
from ctlabs.labs.catalogue import folder

#: Folder of the keys in that of the course.
KEYS = "key"
#: Modules from which a key follows, beside the lab's own.
_SOURCES = ("course/asked.py", "course/key.py", "course/variants.py", "reporting/draws.py", "reporting/params.py")


def answers(course: Course, lab: str, told: Callable[[int], object] = int) -> Mapping[str, tuple[AskedValue, ...]]:
    """The keys of all students who have a lab, by the names of their folders, in the roster's order; ``told`` as of the draws.

    Raises
    ------
    ValueError
        As :func:`ctlabs.course.variants.drawn`.
    """
    path, digest = course.folder / KEYS / f"{lab}.json", _digest(course, lab)
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["digest"] == digest:
            return {student: tuple(map(_asked, rows)) for student, rows in found["answers"].items()}
    keys = {student: each.answers for student, each in drawn(course, lab, told).items()}
    keep(course, lab, keys)
    return keys


def keep(course: Course, lab: str, keys: Mapping[str, tuple[AskedValue, ...]]) -> None:
    """Write the keys of a lab, whole or not at all; a folder that cannot be written is no reason to stop."""
    rows = {student: [_row(each) for each in key] for student, key in keys.items()}
    text = json.dumps({"digest": _digest(course, lab), "answers": rows}, ensure_ascii=False, indent=0)
    with contextlib.suppress(OSError):
        place = course.folder / KEYS
        place.mkdir(exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{lab}-", dir=place)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        Path(name).replace(place / f"{lab}.json")


def _row(each: AskedValue) -> dict[str, Any]:
    others = {words: np.asarray(other).tolist() for words, other in each.others.items()}
    fields = {name: getattr(each, name) for name in ("name", "item", "symbol", "meaning", "unit", "relative", "absolute")}
    return {**fields, "value": each.value.tolist(), "others": others}


def _asked(row: Mapping[str, Any]) -> AskedValue:
    others = {words: np.asarray(other, dtype=float) for words, other in row["others"].items()}
    return AskedValue(**{**row, "value": np.asarray(row["value"]), "others": others})


def _digest(course: Course, lab: str) -> str:
    """What a key was computed from."""
    takers = [(each.id, course.redrawn.get((each.id, lab), 0)) for each in course.takers(lab)]
    told = json.dumps([course.secret, course.term, lab, takers, _sources(lab)], ensure_ascii=False)
    return hashlib.sha256(told.encode()).hexdigest()


@cache
def _sources(lab: str) -> str:
    import ctlabs

    tasks, root, found = folder(), Path(ctlabs.__file__).parent, hashlib.sha256()
    own = [*tasks.glob("answers/*.py"), *tasks.glob(f"{lab}*.py"), tasks / "asked" / f"{lab}.toml"]
    for path in [*sorted(own), *(root / name for name in _SOURCES)]:
        found.update(path.read_bytes())
    return found.hexdigest()
