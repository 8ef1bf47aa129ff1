"""Who takes the course: ``roster.csv`` with a name, a group and a variant, as any program writes it."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from ctlabs.files import datafile
from ctlabs.files.spelling import shown

#: What a column may be called; the first that is there counts.
COLUMNS = {
    "name": ("name", "student", "full name", "fullname", "фио", "ф.и.о.", "имя", "студент", "nom", "nombre"),
    "surname": ("surname", "last name", "lastname", "фамилия", "nachname"),
    "first": ("first name", "firstname", "имя", "vorname"),
    "group": ("group", "groups", "группа", "class", "gruppe"),
    "variant": ("variant", "вариант", "variante"),
}
#: What stands between cells, the likeliest first: a comma may stand in a name.
MARKS = "\t;|,"
#: Longest name, and most students.
LONGEST, MOST = 80, 5000
_NAME = re.compile(r"[^\W\d_][\w .,'’`()-]*")
#: Names that no folder may have on some machines.
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Student:
    """``id`` : the name of the student's folder · ``variant`` : a letter, empty for the course's · ``line`` : in the roster."""

    id: str
    name: str
    group: str = ""
    variant: str = ""
    line: int = 0


def read(path: Path) -> tuple[Student, ...]:
    """The students of a roster, in its order.

    Raises
    ------
    ValueError
        The file is no table, holds nobody, a name twice, or a name that is none; with file and line.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        msg = f"{path.name}: expected a table of the students, received: {error.strerror}"
        raise ValueError(msg) from None
    words = [word for each in COLUMNS.values() for word in each]
    return students(datafile.text(content, path.name, words), path.name)


def students(text: str, source: str) -> tuple[Student, ...]:
    r"""The same from the text of a table.

    >>> [(each.id, each.group) for each in students("name;group\nAnna Weiss;CS-1\nIvan Petrov;CS-2\n", "roster.csv")]
    [('Anna_Weiss', 'CS-1'), ('Ivan_Petrov', 'CS-2')]
    """
    lines = [(i, line) for i, line in enumerate(text.lstrip("\ufeff").splitlines(), 1) if line.strip(" \t;,|") and line.lstrip()[0] != "#"]
    if not lines:
        msg = f"{source}: expected a line for each student below `name;group;variant`, received none"
        raise ValueError(msg)
    mark = next((each for each in MARKS if each in lines[0][1]), "")
    rows = [(i, _cells(line, mark)) for i, line in lines]
    columns = _columns(rows[0][1])
    if columns:
        rows = rows[1:]
    elif len(rows[0][1]) <= 3:
        columns = {"name": 0, "group": 1, "variant": 2}
    letters = {row[1][columns["variant"]].strip().lower() for row in rows if "variant" in columns and columns["variant"] < len(row[1])}
    if {"б", "в"} <= letters:
        msg = f"{source}: variant в beside б is the third of the alphabet, or the Latin b: expected Latin letters a, b, c, received both"
        raise ValueError(msg)
    found = tuple(_student(cells, columns, f"{source}: line {line}", line) for line, cells in rows)
    if not 0 < len(found) <= MOST:
        msg = f"{source}: expected 1 to {MOST} students, received {len(found) or 'none'}"
        raise ValueError(msg)
    _differ(found, source)
    return found


def folder_name(name: str) -> str:
    """A name as that of a folder: letters and digits, words joined by underscores.

    >>> folder_name("O’Neill-Smith, Anna  M."), folder_name("Семён Иванов")
    ('ONeill-Smith_Anna_M', 'Семён_Иванов')
    """
    words = re.findall(r"[\w-]+", re.sub(r"['’`]", "", unicodedata.normalize("NFC", name)))
    found = "_".join(words)
    return f"{found}_" if _RESERVED.match(found) else found


def _cells(line: str, mark: str) -> list[str]:
    import csv

    cells = next(csv.reader([line], delimiter=mark)) if mark else [line]
    return [unicodedata.normalize("NFC", " ".join(cell.replace("\xa0", " ").split())).strip('"') for cell in cells]


def _columns(head: list[str]) -> dict[str, int]:
    """Where each column is; none where the first line names nobody's columns."""
    told = [cell.casefold().strip("* :") for cell in head]
    found = {key: told.index(word) for key, words in COLUMNS.items() for word in reversed(words) if word in told}
    if "surname" in found:
        found.pop("name", None)
        return found
    return found if "name" in found else {}


def _student(cells: list[str], columns: dict[str, int], where: str, line: int) -> Student:
    def cell(key: str) -> str:
        at = columns.get(key, len(cells))
        return cells[at] if at < len(cells) else ""

    name = " ".join(filter(None, (cell("surname"), cell("first")))) if "surname" in columns else cell("name")
    if not _NAME.fullmatch(name) or len(name) > LONGEST:
        signs = f"letters, spaces, dots, hyphens and apostrophes ({LONGEST} characters at most)"
        msg = f"{where}: expected a name of {signs}, received {shown(name) if name else 'none'}"
        raise ValueError(msg)
    group, variant = cell("group"), cell("variant").strip().lower()
    if group and not re.fullmatch(r"[\w .,/()+-]{1,40}", group):
        msg = f"{where}: expected a group of letters and digits, received {shown(group)}"
        raise ValueError(msg)
    if variant and not re.fullmatch(r"\w{1,20}", variant):
        msg = f"{where}: expected a variant of one word, received {shown(variant)}"
        raise ValueError(msg)
    return Student(folder_name(name), name, group, _ALIKE.get(variant, variant), line)


#: Variants written with letters that look Latin, or with the practicum's own.
_ALIKE = {"а": "a", "б": "b", "в": "b", "с": "c"}


def _differ(found: tuple[Student, ...], source: str) -> None:
    seen: dict[str, Student] = {}
    for each in found:
        before = seen.setdefault(each.id.casefold(), each)
        if before is not each:
            msg = (
                f"{source}: line {each.line}: expected a name that nobody else has (add a second name or a number to one of them), "
                f"received {each.name} as in line {before.line}"
            )
            raise ValueError(msg)
