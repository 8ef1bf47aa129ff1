r"""A file of answers as it comes back: ``name = …`` lines that people have filled in, in any encoding and with any editor.

A file is not asked to be TOML any more. An entry begins with a line ``name = value`` (or ``name: value``) and goes on until the next;
``#`` begins a comment, quotation marks may be there, a matrix may stand in rows below its name. Names are known with letters that only
look Latin, with blanks for underscores and in any case. A file is data of strangers: it is read up to LARGEST bytes, links are not
followed, nothing in it is executed, and what is wrong is said with file and line.
"""

from __future__ import annotations

import re
import stat
import unicodedata
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

from ctlabs.files import decode
from ctlabs.files.spelling import shown

#: Largest file that is read, bytes.
LARGEST = 2**20
#: Most entries.
ENTRIES = 500
#: Letters that look like Latin ones.
_ALIKE = str.maketrans("АВЕКМНОРСТУХавекмнорстухіІјЈѕЅ", "ABEKMHOPCTYXabekmhopctyxiIjJsS")
_ENTRY = re.compile(r"""\s*["'«“]?(?P<name>[^\W\d][\w .-]{0,60}?)["'»”]?\s*(?:=|:(?!\d))(?P<rest>.*)""", re.DOTALL)
_SECTION = re.compile(r"\s*\[\[?\s*([^\W\d][\w. -]*)\]?\]\s*")
#: Signs of cp1252 that are letters in cp1251: ², ³, × behind a letter or a digit.
_WESTERN = re.compile(rb"[0-9A-Za-z)][\xb2\xb3\xb9]|[0-9] ?\xd7 ?[0-9]")
_TRIPLE = re.compile(r'"""|\'\'\'')


class FormEntry(NamedTuple):
    """What stands for a name, and in which line it begins."""

    text: str
    line: int


@dataclass(frozen=True, slots=True)
class Answers:
    """A file of answers: what stands for each known name, and what is wrong with the rest, ``source: line n: …``."""

    source: str
    entries: dict[str, FormEntry]
    problems: tuple[str, ...]

    def text(self, name: str) -> str:
        """What stands for a name, without its quotation marks; empty where nothing does."""
        return unquoted(self.entries[name].text) if name in self.entries else ""


def read(path: Path, names: Collection[str], source: str = "", people: Collection[str] = ()) -> Answers:
    """The answers in a file: the entries with these names; the names of ``people`` tell encodings of one byte apart.

    Raises
    ------
    ValueError
        A file that cannot be read, is no text or too large, in one line that names it.
    """
    return parsed(content(path, source or path.name), names, source or path.name, people)


def content(path: Path, source: str, largest: int = LARGEST) -> bytes:
    """The bytes of a plain file, which may be no link, no device and not large."""
    try:
        found = path.lstat()
        if not stat.S_ISREG(found.st_mode):
            kind = "a link" if stat.S_ISLNK(found.st_mode) else "a folder" if stat.S_ISDIR(found.st_mode) else "a device"
            raise ValueError(f"{source}: expected a plain file, received {kind}")
        if found.st_size > largest:
            raise ValueError(f"{source}: expected at most {largest // 2**20} MB, received {found.st_size / 2**20:.1f} MB")
        with path.open("rb") as file:
            return file.read(largest)
    except OSError as error:
        raise ValueError(f"{source}: expected a file that can be read, received: {error.strerror}") from None


def parsed(raw: bytes, names: Collection[str], source: str, people: Collection[str] = ()) -> Answers:
    r"""The entries in the bytes of a file.

    >>> found = parsed("gain steady = 0,52 # mine\nР0: [1 0\n 0 1]\nx = 5".encode("cp1251"), ["gain_steady", "P0"], "a.toml")
    >>> found.text("gain_steady"), found.text("P0"), found.problems
    ('0,52', '[1 0\n 0 1]', ('a.toml: line 4: expected a name of the form, received "x"',))
    """
    known = {folded(name): name for name in names}
    entries: dict[str, FormEntry] = {}
    problems: list[str] = []
    for name, entry in _entries(text(raw, source, people), known):
        plain = known.get(folded(name))
        if plain is None:
            near = get_close_matches(folded(name), known, 1)
            hint = f'; did you mean "{known[near[0]]}"?' if near else ""
            problems.append(f"{source}: line {entry.line}: expected a name of the form, received {shown(name)}{hint}")
        elif plain in entries and unquoted(entries[plain].text) and unquoted(entry.text):
            if unquoted(entries[plain].text) != unquoted(entry.text):
                lines = f"lines {entries[plain].line} and {entry.line}"
                problems.append(f"{source}: line {entry.line}: expected {plain} once, received it in {lines}; the last one counts")
            entries[plain] = entry
        elif plain not in entries or unquoted(entry.text):
            entries[plain] = entry
        if len(entries) + len(problems) > ENTRIES:
            problems.append(f"{source}: line {entry.line}: expected at most {ENTRIES} entries, received more; the rest is left out")
            break
    return Answers(source, entries, tuple(problems))


def text(raw: bytes, source: str, people: Collection[str] = ()) -> str:
    """The text of a file in UTF-8, UTF-16, UTF-32 or an encoding of one byte."""
    what = f"{source}: expected a text file of answers, received"
    for begin, name in {**decode.OTHERS, b"PK\x03\x04": "an archive or an office document: save it as plain text"}.items():
        if raw.startswith(begin):
            raise ValueError(f"{what} {name.split(':')[0]}; save the answers as plain text")
    if raw.startswith(b"{\\rtf"):
        raise ValueError(f"{what} a document in RTF; save the answers as plain text")
    found = _characters(raw, people)
    if found is None or decode.CONTROL.search(found):
        raise ValueError(f"{what} a binary file")
    if found[:200].lstrip("\ufeff \r\n").lower().startswith(("<!doctype", "<html", "<?xml")):
        raise ValueError(f"{what} a web page; save the answers as plain text")
    return found.removeprefix("\ufeff").rstrip("\x1a").replace("\r\n", "\n").replace("\r", "\n")


def _characters(raw: bytes, people: Collection[str]) -> str | None:
    """The text, or None. Of one byte a letter: by the names of people in it, else cp1251 unless there are signs of cp1252."""
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        wide = b"\x00" in raw or raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    else:
        wide = True
    if wide:
        return decode.characters(raw, [])
    foreign = [name for name in people if not name.isascii()]
    for encoding in ("cp1251", "cp1252", "koi8-r", "cp866"):
        found = raw.decode(encoding, errors="replace")
        if any(name in found for name in foreign):
            return found
    return raw.decode("cp1252" if _WESTERN.search(raw) else "cp1251", errors="replace")


def folded(name: str) -> str:
    """A name by which spellings are compared: Latin letters for those that look like them, one case, underscores.

    >>> folded("Gain steady") == folded("gаin_steady")
    True
    """
    plain = unicodedata.normalize("NFKC", name).translate(_ALIKE).strip().lower()
    return re.sub(r"[\s.\-]+", "_", plain)


def unquoted(text: str) -> str:
    r"""A value without quotation marks that hold the whole of it.

    >>> unquoted(' "0,5" '), unquoted('["1", "2"]'), unquoted('"' * 3 + "1 2" + '"' * 3)
    ('0,5', '["1", "2"]', '1 2')
    """
    plain = text.strip().rstrip(",").strip()
    for mark, end in (('"""', '"""'), ("'''", "'''"), ('"', '"'), ("'", "'"), ("«", "»"), ("“", "”"), ("„", "“")):
        inside = plain[len(mark) : len(plain) - len(end)]
        if len(plain) >= len(mark) + len(end) and plain.startswith(mark) and plain.endswith(end) and mark not in inside:
            return inside.strip()
    return plain


def _entries(text: str, known: Collection[str]) -> Iterator[tuple[str, FormEntry]]:
    """Each name with what stands for it."""
    name, line, inside = "", 0, False
    parts: list[str] = []
    for number, row in enumerate(text.split("\n"), 1):
        bare = _uncommented(row)
        start = None if inside else _ENTRY.fullmatch(bare)
        open_before = bool(name) and _open("\n".join(parts))
        if start is not None and open_before and folded(start["name"]) not in known:
            start = None
        if start is None and not inside and not open_before and _SECTION.fullmatch(bare) and not re.fullmatch(r"[\s\[\]\d.,]*", bare):
            if name:
                yield name, FormEntry("\n".join(parts), line)
            name, parts = "", []
        elif start is not None:
            if name:
                yield name, FormEntry("\n".join(parts), line)
            name, line, parts = start["name"], number, [start["rest"]]
            inside = len(_TRIPLE.findall(start["rest"])) % 2 == 1
        elif name:
            parts.append(bare)
            inside ^= len(_TRIPLE.findall(bare)) % 2 == 1
    if name:
        yield name, FormEntry("\n".join(parts), line)


def _open(text: str) -> bool:
    """Whether a list is not closed."""
    return text.count("[") > text.count("]")


def _uncommented(row: str) -> str:
    """A line without its comment."""
    if "#" not in row:
        return row
    quote = ""
    for at, sign in enumerate(row):
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "\"'":
            quote = sign
        elif sign == "#":
            return row[:at]
    return row[: row.index("#")] if quote else row  # a quotation mark that is not closed hides no comment
