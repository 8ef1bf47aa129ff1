r"""Another entry of a matrix put straight into the text of a file: a matrix of thousands of entries is not written anew for one.

    >>> text, data = "[model]\nF = [[0, 1], # the rate\n     [0, 0]]\n", {"model": {"F": [[0, 1], [0, 0]]}}
    >>> spliced(text, data, ((("model", "F", 1, 0), "-w^2"),))
    '[model]\nF = [[0, 1], # the rate\n     ["-w^2", 0]]\n'

What is written is read again, and must be what was read before but for the entry; so nothing depends on how well the place was
found.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from typing import Any

from ctlabs.files.modelfile.errors import Path
from ctlabs.files.modelfile.toml import BOM

#: A text, a comment, a bracket or comma, anything else that is written together, space.
TOKEN = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|\#[^\n]*|[\[\],]|[^\s\[\],\#"']+|\s+''',
    re.DOTALL,
)


def spliced(text: str, data: dict[str, Any], changes: Sequence[tuple[Path, Any]]) -> str | None:
    """The text with other values at ("model", name, i) or ("model", name, i, j); ``None`` where that takes more than this.

    ``data`` : what the text says
    """
    made, wanted = text, data
    for path, value in changes:
        written = _written(value)
        if written is None or len(path) not in {3, 4} or path[0] != "model":
            return None
        found = _entry(made, str(path[1]), tuple(path[2:]))
        if found is None:
            return None
        made = made[: found[0]] + written + made[found[1] :]
        wanted = _with(wanted, path, value)
    try:
        return made if tomllib.loads(made.removeprefix(BOM)) == wanted else None
    except (RecursionError, ValueError):
        return None


def _written(value: Any) -> str | None:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _entry(text: str, name: str, index: tuple[int | str, ...]) -> tuple[int, int] | None:
    """Where an element of a list of lists begins and ends; ``None`` if it is no single token."""
    table = re.search(r"^[ \t]*\[[ \t]*model[ \t]*\]", text, re.MULTILINE)
    key = re.compile(rf"^[ \t]*{re.escape(name)}[ \t]*=[ \t]*(?=\[)", re.MULTILINE)
    start = key.search(text, table.end()) if table else None
    if start is None:
        return None
    at: list[int] = []
    for token in TOKEN.finditer(text, start.end()):
        what = token[0]
        if what == "[":
            if tuple(at) == index:
                return None
            at.append(0)
        elif what == "]":
            at.pop()
            if not at:
                return None
        elif what == ",":
            at[-1] += 1
        elif tuple(at) == index and what[0] != "#" and not what.isspace():
            return token.span()
    return None


def _with(data: dict[str, Any], path: Path, value: Any) -> Any:
    """The data with another value at a path; what is elsewhere is shared."""

    def put(item: Any, rest: Path) -> Any:
        if not rest:
            return value
        made: Any = list(item) if isinstance(item, list) else dict(item)
        made[rest[0]] = put(item[rest[0]], rest[1:])
        return made

    return put(data, path)
