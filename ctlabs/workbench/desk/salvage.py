"""What can still be read of a damaged database: row by row, past the pages that cannot be.

SQLite ends a query at the first page that is not whole. Here every row is asked for by its number; where a page is broken, the first number
behind it that can be read is found by doubling and halving the step. Where a page is broken that leads to others, these are read one by
one, each as a table of its own. Where the first page itself is broken, which says which table lies where, that of a new database takes its
place: all of one version of the tables have the same. All this is done with a copy; nothing is written into the damaged file.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: The numbers of rows that are tried.
MOST = 2**40
#: How a page begins that holds rows of a table, and how many columns are looked for there.
_LEAF, _WIDTH = 0x0D, 9
#: What tells one row of a table from another.
KEYS = {"draft": ("id",), "revision": ("draft", "number"), "text": ("key",), "experiment": ("id",)}
#: Where the head of the first page has how many pages there are, and which are free.
_PAGES, _FREE = slice(28, 32), slice(32, 40)
_DRAFT = re.compile(r"[0-9a-f]{16}")

Row = dict[str, Any]


@dataclass(slots=True)
class Salvaged:
    """Rows by table, each with the columns that were asked for; ``lost``, how many were there and could not be read, at least."""

    rows: dict[str, list[Row]] = field(default_factory=dict)
    lost: int = 0

    def __str__(self) -> str:
        """What was read, in words."""
        words = {"draft": "draft", "revision": "step", "experiment": "kept result"}
        counts = {word: len(self.rows.get(table, ())) for table, word in words.items()}
        parts = [f"{count} {word}{'' if count == 1 else 's'}" for word, count in counts.items()]
        if not any(self.rows.values()):
            return "nothing in it could be read"
        lost = f"; at least {self.lost} row{'' if self.lost == 1 else 's'} could not be read" if self.lost else ""
        return f"{parts[0]} with {parts[1]} of editing and {parts[2]} were saved from it{lost}"


def salvage(damaged: Path, whole: Path, columns: dict[str, list[str]]) -> Salvaged:
    """The rows of a ``damaged`` file that can be read; ``whole`` is an empty one of the same version.

    ``columns`` : by table. What was read is checked as far as it can be, and put together: a draft whose present step is lost is at the
    last one that is not, one whose own row is lost has those of its steps.
    """
    found = Salvaged()
    with tempfile.TemporaryDirectory(prefix="ctlabs-") as folder:
        for head in (False, True):
            copy = Path(folder) / f"copy{head:d}"
            _copied(damaged, copy, whole if head else None)
            made = _read(copy, columns)
            if not made.lost and any(made.rows.values()):
                found = made
                break
            with contextlib.suppress(sqlite3.Error):
                _scattered(copy, columns, made)
            if not head or sum(map(len, made.rows.values())) > sum(map(len, found.rows.values())):
                found = made
    _mended(found)
    return found


def _copied(damaged: Path, copy: Path, whole: Path | None) -> None:
    """A copy to be read, with what SQLite keeps beside it; with the first page of a whole file where one is given."""
    for suffix in ("", "-wal"):
        if (part := Path(f"{damaged}{suffix}")).exists():
            shutil.copyfile(part, f"{copy}{suffix}")
    if whole is None:
        return
    head = bytearray(whole.read_bytes())
    size = int.from_bytes(head[16:18], "big")
    first = bytearray(head[:size])
    content = copy.read_bytes()
    first[_PAGES] = (max(len(content), size) // size).to_bytes(4, "big")
    first[_FREE] = bytes(8)
    copy.write_bytes(bytes(first) + content[size:])


def _read(path: Path, columns: dict[str, list[str]]) -> Salvaged:
    found = Salvaged({name: [] for name in columns})
    with contextlib.closing(_connected(path)) as connection:
        for table, names in columns.items():
            good = CHECKS[table]
            for _, row in _rows(connection, table, names, found):
                if good(row):
                    found.rows[table].append(row)
                else:
                    found.lost += 1
    return found


def _connected(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path)
    with contextlib.suppress(sqlite3.Error):
        connection.execute("PRAGMA writable_schema = ON")  # a file that is shorter than it says is read, too
    return connection


def _scattered(path: Path, columns: dict[str, list[str]], found: Salvaged) -> None:
    """Add the rows of all pages that hold some, wherever they belong to."""
    with contextlib.closing(_connected(path)) as connection, contextlib.suppress(sqlite3.Error):
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    content = path.read_bytes()
    size = int.from_bytes(content[16:18], "big")
    if size < 512:  # the head is not SQLite's
        return
    leaves = [at // size + 1 for at in range(size, len(content), size) if content[at] == _LEAF]
    names = [f"c{i}" for i in range(_WIDTH)]
    with contextlib.closing(_connected(path)) as connection, connection:
        made = [(f"leaf_{page}", page, f"CREATE TABLE leaf_{page} ({', '.join(names)})") for page in leaves]
        connection.executemany("INSERT INTO sqlite_master VALUES ('table', ?1, ?1, ?2, ?3)", made)
    known = {table: {tuple(row[key] for key in KEYS[table]) for row in rows} for table, rows in found.rows.items()}
    with contextlib.closing(_connected(path)) as connection:
        for page in leaves:
            for number, values in _rows(connection, f"leaf_{page}", names, Salvaged()):
                table, row = _whose(number, list(values.values()), columns)
                key = tuple(row.get(name) for name in KEYS[table]) if table else ()
                if table and key not in known[table]:
                    known[table].add(key)
                    found.rows[table].append(row)


def _whose(number: int, values: list[Any], columns: dict[str, list[str]]) -> tuple[str, Row]:
    """The table to which a row belongs by its looks, and the row; none of them where it has no such looks."""
    for table, names in columns.items():
        row = dict(zip(names, values, strict=False))
        if table == "experiment":
            row["id"] = number  # it stands in the number of the row alone
        if all(value is None for value in values[len(names) :]) and CHECKS[table](row):
            return table, row
    return "", {}


def _rows(connection: sqlite3.Connection, table: str, names: list[str], found: Salvaged) -> Iterator[tuple[int, Row]]:
    """The rows of a table that can be read, in their order."""
    listed = ", ".join(f'"{name}"' for name in names)

    def after(number: int, what: str = "rowid") -> tuple[Any, ...] | None:
        query = f'SELECT {what} FROM "{table}" NOT INDEXED WHERE rowid > ? ORDER BY rowid LIMIT 1'  # our own names
        row: tuple[Any, ...] | None = connection.execute(query, (number,)).fetchone()
        if row is not None and row[0] <= number:
            raise sqlite3.DatabaseError("a broken tree that leads in a circle")
        return row

    at = -1
    while True:
        try:
            row = after(at)
        except sqlite3.Error:
            found.lost += 1
            there = _behind(at, after)
            if there is None:
                return
            at = there
            continue
        if row is None:
            return
        try:
            whole = after(at, f"rowid, {listed}")
        except sqlite3.Error:  # the row is there; what it holds is not
            whole = None
            found.lost += 1
        at = int(row[0])
        if whole is not None:
            yield at, dict(zip(names, whole[1:], strict=True))


def _behind(at: int, after: Callable[[int], object]) -> int | None:
    """The first number behind a broken page from which on one can read; None where there is none."""

    def readable(number: int) -> bool:
        try:
            after(number)
        except sqlite3.Error:
            return False
        return True

    step = 1
    while not readable(at + step):
        step *= 2
        if step > MOST:
            return None
    low, high = step // 2, step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if readable(at + middle) else (middle, high)
    return at + high


# What is read, checked and put together ------------------------------------------------------------------------------------


def _text(*values: object) -> bool:
    return all(isinstance(value, str) and "\0" not in value for value in values)


def _json(value: object) -> bool:
    try:
        return isinstance(json.loads(str(value)), dict | list)
    except ValueError:
        return False


def _is_draft(row: Row) -> bool:
    return _text(row["id"], row["owner"], row["session"]) and _DRAFT.fullmatch(row["id"]) is not None and _json(row["notes"])


def _is_revision(row: Row) -> bool:
    return _text(row["draft"], row["label"], row["text"]) and _DRAFT.fullmatch(row["draft"]) is not None and isinstance(row["number"], int)


def _is_text(row: Row) -> bool:
    return _text(row["text"]) and hashlib.sha256(row["text"].encode()).hexdigest() == row["key"]


def _is_experiment(row: Row) -> bool:
    return _text(row["owner"], row["name"], row["model"]) and _json(row["settings"]) and _json(row["results"])


CHECKS: dict[str, Callable[[Row], bool]] = {
    "draft": _is_draft, "revision": _is_revision, "text": _is_text, "experiment": _is_experiment,
}  # fmt: skip


def _mended(found: Salvaged) -> None:
    """Every draft with its steps, at one that is there; what belongs to nothing is left out."""
    steps: dict[str, list[int]] = {}
    for row in found.rows["revision"]:
        steps.setdefault(row["draft"], []).append(row["number"])
    known = {row["id"]: row for row in found.rows["draft"]}
    owners = {row["owner"] for row in (*known.values(), *found.rows["experiment"])}
    owner = owners.pop() if len(owners) == 1 else "local"
    for draft in steps.keys() - known.keys():
        known[draft] = {"id": draft, "owner": owner, "session": owner, "number": 0, "notes": "{}", "deleted": None}
        known[draft] |= {"number": max(steps[draft]), "updated": time.time()}
    for draft, row in list(known.items()):
        if draft not in steps:
            del known[draft]
            found.lost += 1
        elif row["number"] not in steps[draft]:
            row["number"] = max((step for step in steps[draft] if step <= row["number"]), default=min(steps[draft]))
    found.rows["draft"] = list(known.values())
