"""The gallery: ready model files, by name."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ctlabs.files.modelfile.document import ModelFile, loads
from ctlabs.files.modelfile.errors import ModelFileError, Problem, meant, shown

FOLDER = Path(__file__).parent / "gallery"


class Entry(NamedTuple):
    """A ready model: its name, title, kind ("continuous" or "discrete"), description, source."""

    name: str
    title: str
    kind: str
    description: str
    source: str

    @property
    def lab(self) -> str:
        """The lab it belongs to ("task07"), empty for the usual models."""
        told = re.match(r"lab (\w+) \(", self.source)
        return "" if told is None else f"task{int(told[1]):02d}" if told[1].isdecimal() else told[1]

    @property
    def text(self) -> str:
        """The file."""
        return (FOLDER / f"{self.name}.toml").read_text(encoding="utf-8")


@cache
def gallery() -> tuple[Entry, ...]:
    """All ready models: the usual ones first, then those of the labs, each group by name."""
    found = []
    for path in FOLDER.glob("*.toml"):
        told = tomllib.loads(path.read_text(encoding="utf-8"))
        found.append(Entry(path.stem, told["title"], told["kind"], told["description"], told.get("source", "")))
    return tuple(sorted(found, key=lambda entry: (bool(entry.lab), not entry.lab.startswith("task"), entry.name)))


def entry(name: str) -> Entry:
    """The entry of a name; :class:`ModelFileError` for an unknown one."""
    for found in gallery():
        if found.name == name:
            return found
    names = [found.name for found in gallery()]
    raise ModelFileError(Problem("", f"unknown model {shown(name)}{meant(name, names, len(names))}"))


def ready(name: str) -> ModelFile:
    """A ready model.

    >>> ready("oscilator")
    Traceback (most recent call last):
    ...
    ctlabs.files.modelfile.errors.ModelFileError: unknown model "oscilator"; did you mean "oscillator"?
    """
    found = entry(name)
    return loads(found.text, f"{name}.toml")


def copy(name: str, folder: str | Path = ".") -> Path:
    """Write a ready model into a folder, as it stands, and say where; a file of that name is never overwritten."""
    target = Path(folder) / f"{name}.toml"
    ready(name).save(target)
    return target
