"""From the bytes of a file to plain data; what is no text or no TOML is told with its line and column."""

from __future__ import annotations

import codecs
import re
import tomllib
from typing import Any

from ctlabs.files.modelfile.errors import ModelFileError, Problem

#: Largest file, bytes.
LARGEST = 2**20
BOM = "\ufeff"
#: a.b.c…: the reader takes a time that grows with the square of a dotted key's length.
DOTTED = re.compile(r"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){33}""")


def too_large(name: str) -> ModelFileError:
    """A file that nobody has typed."""
    return ModelFileError(Problem("", f"expected at most {LARGEST // 2**20} MB, received more"), name)


def decoded(content: bytes, name: str) -> str:
    """The text of a file: UTF-8, with or without a byte-order mark."""
    if len(content) > LARGEST:
        raise too_large(name)
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise ModelFileError(
            Problem("line 1, column 1", "expected UTF-8, received UTF-16; save the file as UTF-8"), name
        )
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8")
        raise ModelFileError(
            Problem(
                _position(before, len(before)), f"expected UTF-8 text, received the byte 0x{content[error.start]:02x}"
            ),
            name,
        ) from None
    zero = text.find("\x00")
    if zero >= 0:
        raise ModelFileError(Problem(_position(text, zero), "expected a text file, received a binary one"), name)
    return text


def parsed(text: str, name: str) -> dict[str, Any]:
    """The plain data of a TOML text."""
    plain = text.removeprefix(BOM)
    dots = DOTTED.search(plain)
    if dots:
        raise ModelFileError(
            Problem(_position(plain, dots.start()), "expected keys of at most 32 parts, received more"), name
        )
    try:
        return tomllib.loads(plain)
    except tomllib.TOMLDecodeError as error:
        problem = _no_toml(plain, str(error))
    except RecursionError:
        problem = Problem("", "expected lists of a few levels, received a deeper nesting")
    except ValueError:  # a whole number of thousands of digits
        long = re.search(r"\d[\d_]{999,}", plain)
        problem = Problem(
            _position(plain, long.start() if long else 0), "expected numbers of at most 1000 digits, received more"
        )
    raise ModelFileError(problem, name)


def _no_toml(text: str, message: str) -> Problem:
    """What a TOML reader says, with its place first and a hint where the mistake is a usual one."""
    what, _, where = message.partition(" (at ")
    match = re.match(r"line (\d+), column (\d+)", where)
    lines = text.split("\n")
    if match:
        row, column = int(match[1]), int(match[2])
        at = where.rstrip(")")
    else:
        row, column = len(lines), len(lines[-1]) + 1
        at = f"line {row}, column {column}"
    line = lines[row - 1] if row <= len(lines) else ""
    hint = ""
    if re.search(r"[=\[,]\s*-?\d+,\d+\s*(#.*)?$", line) and line[column - 1 : column] == ",":
        hint = "; numbers have a decimal point"
    elif re.search(r"[A-Za-z_*/^+(]", re.sub(r"\"[^\"]*\"|'[^']*'|#.*|^[^=]*=", "", line)):
        hint = "; expressions and texts stand in quotes"
    return Problem(at, f"no TOML: {what[:1].lower()}{what[1:]}{hint}")


def _position(text: str, at: int) -> str:
    line = text.count("\n", 0, at) + 1
    return f"line {line}, column {at - text.rfind(chr(10), 0, at)}"
