"""The bytes of a file as text: what kind of file it is, unpacked, in the encoding that its marks or the wanted names tell."""

from __future__ import annotations

import gzip
import io
import re
import sys
import unicodedata
import zlib
from collections.abc import Collection
from pathlib import Path

#: Larger files are refused before they fill the memory.
LARGEST = 256 * 2**20
#: What no text holds.
CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1b-\x1f]")
CONTROLS = bytes(code for code in range(32) if CONTROL.match(chr(code)))
#: Encodings of one byte a character, of which a text that is not UTF-8 may be any.
NARROW = ("cp1251", "cp1252", "cp866", "koi8-r", "cp1250", "cp1253", "cp437", "mac-roman", "cp932", "gb18030")
#: How files begin that are tables, but no text.
TABLES = {b"PK\x03\x04": "excel", b"PAR1": "parquet", b"ARROW1": "feather", b"FEA1": "feather"}
#: How other files begin, and what they are.
OTHERS = {
    b"\xd0\xcf\x11\xe0": "an Excel workbook of the old kind (.xls): save it as .xlsx or CSV",
    b"\x89HDF": "an HDF5 file (a MATLAB file of version 7.3 is one): write its columns as CSV",
    b"MATLAB 5.0": "a MATLAB file: write its columns as CSV",
    b"\x93NUMPY": "an array of NumPy: write it with numpy.savetxt(…, header=…)",
    b"SQLite format": "a database of SQLite: write the table as CSV",
    b"%PDF": "a PDF document",
    b"\x89PNG": "a binary file (a picture)",
    b"BZh": "a file compressed by bzip2: unpack it",
    b"\xfd7zXZ": "a file compressed by xz: unpack it",
    b"\x28\xb5\x2f\xfd": "a file compressed by zstd: unpack it",
}
MARKS = (
    (b"\xff\xfe\x00\x00", "utf-32"), (b"\x00\x00\xfe\xff", "utf-32"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"),
    (b"\xef\xbb\xbf", "utf-8-sig"),
)  # fmt: skip


def content(path: str | Path, source: str) -> bytes:
    """What the file (or, for "-", the standard input) holds, unpacked, at most LARGEST bytes."""
    try:
        if str(path) == "-":
            if sys.stdin is None:  # closed: <&-
                raise ValueError("stdin: expected values on the standard input, received a closed one")
            found = sys.stdin.buffer.read(LARGEST + 1)
        else:
            with Path(path).open("rb") as file:
                found = file.read(LARGEST + 1)
    except OSError as error:
        raise ValueError(f"{path}: expected a file that can be read, received: {error.strerror}") from None
    return unpacked(found, source)


def unpacked(found: bytes, source: str) -> bytes:
    """The bytes, or what gzip made them from; more than LARGEST are refused."""
    if found.startswith(b"\x1f\x8b"):
        try:
            with gzip.open(io.BytesIO(found)) as packed:
                found = packed.read(LARGEST + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise ValueError(
                f"{source}: expected a whole file, received one compressed by gzip that is damaged ({error})"
            ) from None
    if len(found) > LARGEST:
        raise ValueError(f"{source}: expected at most {LARGEST // 2**20} MB, received more")
    return found


def kind(found: bytes) -> str:
    """What table of other programs the bytes are: "excel", "parquet", "feather"; empty for text."""
    return next((name for begin, name in TABLES.items() if found.startswith(begin)), "")


def text(found: bytes, source: str, wanted: Collection[str] = (), encoding: str = "") -> str:
    r"""The text in ``found``.

    A byte-order mark decides, then UTF-8, then UTF-16 or UTF-32 by their zero bytes. What remains is of one byte a character
    and does not say which: the encoding in which the ``wanted`` names stand in the text, cp1251 or cp1252 where none does.

    >>> text("t;Höhe\n".encode("latin-1"), "file", ["Höhe"])
    't;Höhe\n'
    """
    what = f"{source}: expected a text file with separated values (CSV), received"
    if encoding:
        try:
            return _plain(found.decode(encoding))
        except (UnicodeError, LookupError):
            raise ValueError(f"{source}: expected text in {encoding} (--encoding), received other bytes") from None
    for begin, name in OTHERS.items():
        if found.startswith(begin):
            raise ValueError(f"{what} {name}")
    decoded = characters(found, [unicodedata.normalize("NFC", name) for name in wanted if not name.isascii()])
    wide = b"\x00" in found
    if decoded is None or (CONTROL.search(decoded) if wide else len(found.translate(None, CONTROLS)) < len(found)):
        raise ValueError(f"{what} a binary file")
    start = decoded[:200].lstrip().lower()
    if start.startswith(("<!doctype html", "<html", "<table", "<body", "<head")):
        raise ValueError(f"{what} a web page (HTML): save the table in it as CSV")
    if start.startswith("<?xml") or re.match(r"\{\s*\"|\[\s*[\[{]", start):
        raise ValueError(f"{what} {'XML' if start[0] == '<' else 'JSON'}: write its columns as CSV")
    return _plain(decoded)


def encoding(found: bytes, wanted: Collection[str] = ()) -> str:
    """The encoding in which :func:`text` reads bytes, "" where none suits.

    >>> encoding("t;Höhe".encode()), encoding("t;Höhe".encode("utf-16")), encoding("t;Höhe".encode("cp1252"), ["Höhe"])
    ('utf-8', 'utf-16', 'cp1252')
    """
    for name in _encodings(found, [unicodedata.normalize("NFC", each) for each in wanted if not each.isascii()]):
        try:
            found.decode(name)
        except UnicodeDecodeError:
            continue
        return name
    return ""


def characters(found: bytes, names: list[str]) -> str | None:
    """The text in the encoding that the bytes, or the ``names`` in them, tell; None where they are none."""
    for encoding in _encodings(found, names):
        try:
            return found.decode(encoding)
        except UnicodeDecodeError:
            continue
    return None


def _encodings(found: bytes, names: list[str]) -> list[str]:
    """What to try, best first."""
    marked = next((encoding for mark, encoding in MARKS if found.startswith(mark)), "")
    if marked:
        return [marked]
    if b"\x00" in found:
        head = found[:4000]
        zeros = [2 * head[i::4].count(0) > len(head[i::4]) for i in range(4)]
        wide: dict[tuple[bool, ...], str] = {(False, True, True, True): "utf-32-le", (True, True, True, False): "utf-32-be",
                (False, True, False, True): "utf-16-le", (True, False, True, False): "utf-16-be"}  # fmt: skip
        if tuple(zeros) in wide:
            return [wide[tuple(zeros)]]
        return []
    try:
        found.decode("utf-8")
    except UnicodeDecodeError:
        return [*_narrow(found, names), "latin-1"]
    return ["utf-8"]


def _narrow(found: bytes, names: list[str]) -> list[str]:
    """Encodings of one byte a character: those in which the names stand; else by whether the letters make words."""
    head = found[: 2**16]
    for encoding in NARROW if names else ():
        decoded = unicodedata.normalize("NFC", head.decode(encoding, errors="replace"))
        if all(name in decoded for name in names):
            return [encoding]
    words = re.findall(rb"[\xc0-\xff]{2,}", head)
    cyrillic = 2 * sum(map(len, words)) > len(re.findall(rb"[\xc0-\xff]", head))
    return ["cp1251", "cp1252"] if cyrillic else ["cp1252", "cp1251"]


def _plain(decoded: str) -> str:
    r"""One end of a line where a program wrote \r\r\n, no byte-order mark, no end of file of DOS."""
    decoded = decoded.removeprefix("\ufeff").rstrip("\x1a")
    if "\r\r\n" in decoded and not re.search(r"\r(?!\r?\n)", decoded):
        decoded = decoded.replace("\r\r\n", "\n")
    return decoded
