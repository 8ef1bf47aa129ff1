"""What is wrong with a model file, and where."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from typing import Any, NamedTuple

#: The way to a value in a file: ("model", "H", 2, 1).
Path = tuple[str | int, ...]


class Problem(NamedTuple):
    """One thing that is wrong: ``where`` it is ("model.H[2][1]", empty for the whole file) and ``message``."""

    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" if self.where else self.message


class ModelFileError(ValueError):
    """The first problem of a model file, in one line, after the file's name where there is one.

    >>> str(ModelFileError(Problem("model.H[2][1]", 'unknown name "omga"'), "ship.toml"))
    'ship.toml: model.H[2][1]: unknown name "omga"'
    """

    def __init__(self, problem: Problem, file: str = "") -> None:
        super().__init__(f"{file}: {problem}" if file else str(problem))
        self.problem, self.file = problem, file

    @property
    def where(self) -> str:
        """The place in the file."""
        return self.problem.where

    @property
    def message(self) -> str:
        """What is wrong there."""
        return self.problem.message

    def __reduce__(self) -> tuple[type[ModelFileError], tuple[Problem, str]]:
        return type(self), (self.problem, self.file)


def place(path: Iterable[str | int]) -> str:
    """A path as a person reads it.

    >>> place(("model", "H", 2, 1)), place(("constants", "my q"))
    ('model.H[2][1]', 'constants."my q"')
    """
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            plain = part.isascii() and part.replace("_", "").replace("-", "").isalnum()
            text += ("." if text else "") + (part if plain else shown(part))
    return text


def shown(value: Any, size: int = 60) -> str:
    r"""A value of a file as a message quotes it: in one line, and not too long.

    >>> shown("a\nb"), shown(True), shown([1, "x"]), shown({"a": 1})
    ('"a\\nb"', 'true', '[1, "x"]', '{"a": 1}')
    """
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (ValueError, RecursionError):  # a whole number of thousands of digits, lists in lists in lists
        text = f"a {type(value).__name__}"
    text = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text)
    return text if len(text) <= size else f"{text[: size - 1]}…"


def meant(word: str, known: Iterable[str], show: int = 8) -> str:
    """The end of a message about an unknown word: a likely one, or those that are known.

    >>> meant("omga", ["omega", "q"]), meant("foo", ["omega", "q"]), meant("Pi", ["pi"]), meant("a", [])
    ('; did you mean "omega"?', '; known are omega, q', '; did you mean "pi"?', '')
    """
    names = list(known)
    close = [name for name in names if name.lower() == word.lower()]
    close = close or difflib.get_close_matches(word[:100], names, n=2, cutoff=0.6)
    if close:
        return "; did you mean " + " or ".join(f'"{name}"' for name in close) + "?"
    if not names:
        return ""
    return "; known are " + ", ".join(names[:show]) + (", …" if len(names) > show else "")
