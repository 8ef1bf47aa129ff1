"""The rows and cells of a text, and how they are laid out: separator, titles above the table, the line of names."""

from __future__ import annotations

import csv
import io
import itertools
import re
import unicodedata
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

from ctlabs.files.spelling import GROUPED, INSTANT, NUMBER, WORDS, short

#: The separators, the likelier first; a blank stands for any number of blanks and tabs.
SEPARATORS = (",", ";", "\t", "|", " ")
#: How many rows tell the layout; how many are read at a time.
HEAD, CHUNK = 60, 20_000
#: The characters among which the first rows are.
TOP = 2**18
#: Cells of spreadsheets that begin like a comment.
ERRORS = ("#n/a", "#na", "#value!", "#div/0!", "#ref!", "#num!", "#name?", "#null!")
#: Ends of lines inside a cell.
_ENDS = re.compile(r"\r\n|\r|\n")
SEP_LINE = re.compile(r"sep=([,;\t| ])[\r\n]")


@dataclass(frozen=True, slots=True)
class Layout:
    """Where a table is in a text.

    ``mark`` : the separator · ``header`` : names of the columns, empty where the table has none · ``line`` : that of the names ·
    ``start`` : the row of the text at which the table begins, ``skip`` lines below its top · ``title`` : the first line above the names
    """

    text: str
    mark: str
    header: tuple[str, ...]
    line: int
    start: int
    skip: int
    title: str = ""
    named: bool = True

    @property
    def width(self) -> int:
        """How many columns."""
        return len(self.header)


def plain(name: str) -> str:
    """A name of a column in the one spelling in which names are compared."""
    return unicodedata.normalize("NFC", name.strip().strip("\ufeff\xa0").strip())


def rows(text: str, mark: str, source: str, skip: int = 0) -> Iterator[tuple[int, list[str]]]:
    """The rows with the lines in which they begin, blank ones too (they have no cells)."""
    reader = _reader(text, mark, skip)
    before = 0
    while True:
        line = before + 1 + skip
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            what = "a quotation mark that is not closed" if "unexpected end" in str(error) else str(error)
            raise ValueError(f"{source}: line {line}: expected separated values, received: {what}") from None
        before = reader.line_num
        yield line, cells


def _reader(text: str, mark: str, skip: int) -> Any:
    """The reader of the csv module, ``skip`` lines below the top."""
    lines = io.StringIO(text, newline="")
    for _ in range(skip):
        lines.readline()
    stripped = (line.replace("\t", " ").strip(" \r\n") + "\n" for line in lines) if mark == " " else lines
    return csv.reader(stripped, delimiter=mark, strict=True, skipinitialspace=mark == " " or _spaced(text))


def _spaced(text: str) -> bool:
    """Whether blanks stand between a separator and a quotation mark."""
    return '"' in text and re.search(r'[,;|] +"', text) is not None


def is_blank(cells: list[str]) -> bool:
    """Whether a line holds nothing but spaces (a quoted empty cell is something)."""
    return not cells or (len(cells) == 1 and cells[0] != "" and not cells[0].strip())


def is_comment(cells: list[str]) -> bool:
    """Whether a line begins with #, and not with what a spreadsheet writes for an error."""
    return bool(cells) and cells[0].lstrip().startswith("#") and not cells[0].strip().lower().startswith(ERRORS)


def is_data(cells: list[str]) -> bool:
    """Whether a row holds only numbers, times and words for missing values, and one number or time at least."""
    told = [cell.strip() for cell in cells]
    numbers = [cell for cell in told if NUMBER.fullmatch(cell) or INSTANT.fullmatch(cell)]
    return bool(numbers) and all(cell in numbers or cell.lower() in WORDS for cell in told)


def is_value(cell: str) -> bool:
    """Whether a cell holds one number, with marks between its thousands or not, a time, or a word for a missing value.

    >>> [is_value(cell) for cell in ("1.518,95", "02.01.2023", "02.01.2023;1.518", "95;8", "NaN")]
    [True, True, False, False, True]
    """
    return any(kind.fullmatch(cell) for kind in (NUMBER, INSTANT, GROUPED)) or cell.lower() in WORDS


def layout(text: str, wanted: Collection[str], source: str, skip: int = 0) -> Layout:
    """The separator and the line of names: those that show most of the ``wanted`` names (the last is that of the times), else the
    most regular.
    """
    if not text or text.isspace():
        raise ValueError(f"{source}: expected a header row and rows of numbers, received an empty file")
    if '"' in text:
        text = _unwrapped(re.sub(r'(^|[,;|])([ ]*"[^"\r\n]*")[ ]+(?=[,;|\r\n]|$)', r"\1\2", text), source)
    told = SEP_LINE.match(text)
    skip = max(skip, 1) if told else skip
    names, own = ({plain(name) for name in some if not NUMBER.fullmatch(name)} for some in (wanted, list(wanted)[:-1]))
    found = max(
        (_fitness(text, mark, names, own, source, skip) for mark in ([told[1]] if told else SEPARATORS)),
        key=lambda fit: fit[:-1],
    )
    return _named(text, found[-1], names, source, skip)


def _unwrapped(text: str, source: str) -> str:
    """The text without the quotes of a spreadsheet that took each row for one cell."""
    if not re.match(r'\s*"[^"\r\n]*[,;\t][^"\r\n]*"\s*[\r\n]', text) or '"' in re.sub(r'(?m)^"|"\r?$', "", text):
        return text
    try:
        whole = [cells for _, cells in rows(text, ",", source)]
    except ValueError:
        return text
    wrapped = (
        all(len(cells) <= 1 for cells in whole)
        and len({len(cell.split(",")) for cells in whole for cell in cells}) == 1
    )
    head = whole[0][0] if whole and whole[0] else ""
    return (
        "\n".join("".join(cells) for cells in whole) + "\n"
        if wrapped and len(head.split(",")) > 1 and not is_data([head]) and _table_inside(whole)
        else text
    )


def _table_inside(whole: list[list[str]]) -> bool:
    """Whether rows of one cell hold several numbers each, and not one number with a comma."""
    return any(
        sum(bool(NUMBER.fullmatch(part.strip())) for part in cells[0].split(",")) > 1 for cells in whole[1:] if cells
    )


def _head(text: str, mark: str, source: str, skip: int) -> list[tuple[int, list[str]]]:
    """The first rows, up to one that makes no sense with this separator."""
    found = []
    if len(text) > TOP:  # as much as may be needed, whole lines
        text = text[: max(text.rfind("\n", 0, TOP), text.rfind("\r", 0, TOP), 0) or TOP]
    try:
        for row in itertools.islice(rows(text, mark, source, skip), HEAD):
            found.append(row)  # noqa: PERF402  # what was read before an error counts
    except ValueError:
        pass
    return found


def _bare(cells: list[str]) -> list[str]:
    """The names in a row, without a comment sign before them."""
    told = [plain(cell) for cell in cells]
    if told and (sign := re.match(r"(#+|%+|//|!)\s*", told[0])):
        told[0] = plain(told[0][sign.end() :])
        if not told[0]:
            told = told[1:]
    return told


def _fitness(
    text: str, mark: str, names: set[str], own: set[str], source: str, skip: int
) -> tuple[int, float, int, float, int, int, str]:
    """How well a separator suits: measurements named in one row, rows of the width of the names, wanted names, cells that are values,
    columns, rank.
    """
    head = [cells for _, cells in _head(text, mark, source, skip) if not is_blank(cells)]
    hits = [len(names & set(_bare(cells))) for cells in head]
    best = max(hits, default=0)
    at = hits.index(best) if best else _first(head)
    body = [cells for cells in head[at + 1 :] if not is_comment(cells)] or head[at : at + 1]
    width = len(_bare(head[at])) if head else 0
    common = Counter(map(len, body)).most_common(1)[0][0] if body else 0
    share = sum(len(cells) == width for cells in body) / max(len(body), 1)
    measured = max((len(own & set(_bare(cells))) for cells in head), default=0)
    if mark == " " and any(cell in SEPARATORS for cells in head for cell in cells):
        share = 0.0
    share *= 1 if best or width > 1 else 0.99
    cells = [cell.strip() for row in body if len(row) == common for cell in row if cell.strip()]
    values = sum(is_value(cell) for cell in cells) / max(len(cells), 1)
    return measured, share, best, values, min(width, common), -SEPARATORS.index(mark), mark


def _first(head: list[list[str]]) -> int:
    """The row of names where none of the wanted ones is there: the last before the data that is as wide as they are, or, where that has
    cells that are empty or equal (kinds of values), the first of that width that has not.
    """
    at = _last(head)
    if not head or is_data(head[at]):
        return at
    alike = [i for i in range(at + 1) if len(head[i]) == len(head[at]) and not is_comment(head[i])]
    return at if _differ(head[at]) else next((i for i in alike if _differ(head[i])), at)


def _differ(cells: list[str]) -> bool:
    """Whether no two cells are equal, and none but the first (a column of row numbers) is empty."""
    return all(cells[1:]) and len(set(cells)) == len(cells)


def _last(head: list[list[str]]) -> int:
    """The last row before the data that is as wide as they are."""
    told = [i for i, cells in enumerate(head) if not is_comment(cells)]
    for place, i in enumerate(told):
        after = head[told[place + 1]] if place + 1 < len(told) else []
        if is_data(head[i]):
            return i
        if is_data(after) or (len(after) == len(head[i]) > 1 and any(NUMBER.fullmatch(cell.strip()) for cell in after)):
            return i
    return told[0] if told else 0


def _named(text: str, mark: str, names: set[str], source: str, skip: int) -> Layout:
    """The layout with this separator."""
    head = _head(text, mark, source, skip)
    seen = [i for i, (_, cells) in enumerate(head) if not is_blank(cells)]
    if not seen:
        for _ in rows(text, mark, source, skip):  # the error, if there is one
            pass
        raise ValueError(f"{source}: expected rows of numbers below the header, received none")
    hits = {i: len(names & set(_bare(head[i][1]))) for i in seen}
    best = max(hits.values())
    own = [i for i in seen if hits[i] == best and not is_comment(head[i][1]) and not is_data(head[i][1])]
    at = own[0] if best and own else seen[_first([head[i][1] for i in seen])]
    line, cells = head[at]
    above = [i for i in seen if i < at]
    if not best or not own:
        commented = [i for i in above if is_comment(head[i][1])] if is_data(cells) else []
        if commented and (len(bare := _bare(head[commented[-1]][1])) == len(cells)) and not is_data(bare):
            return _trimmed(Layout(text, mark, tuple(bare), head[commented[-1]][0], at, skip))
    if is_data(cells):
        count = max(len(row) for _, row in head[at:])
        return Layout(text, mark, tuple(str(i + 1) for i in range(count)), 0, at, skip, named=False)
    early = next((head[i] for i in above if not is_comment(head[i][1]) and is_data(head[i][1])), None)
    if early:
        raise ValueError(
            f"{source}: line {early[0]}: expected the names of the columns above the numbers, received numbers "
            f"above line {line}"
        )
    titles = [head[i][1] for i in above if not is_comment(head[i][1])]
    title = short(",".join(titles[0])) if titles else ""
    return _trimmed(Layout(text, mark, tuple(_bare(cells)), line, at + 1, skip, title))


def _trimmed(found: Layout) -> Layout:
    """Without the empty columns that a spreadsheet left on the right."""
    header = list(found.header)
    while header and not header[-1]:
        header.pop()
    return replace(found, header=tuple(header))


def chunks(found: Layout, source: str) -> Iterator[tuple[list[int], list[list[str]]]]:
    """The rows below the names, many at a time, without comments and without the blank ones at the end; blank ones have no cells."""
    told = rows(found.text, found.mark, source, found.skip)
    below = next(itertools.islice(told, found.start, None), None)
    if below is None:
        return
    commented = "#" in found.text
    held: list[int] = []
    for lines, block in _blocks(found, below[0], source):
        if commented or min(map(len, block)) < 2 or held:
            lines, block, held = _without(lines, block, held, commented)
        if block:
            yield lines, block


def _blocks(found: Layout, line: int, source: str) -> Iterator[tuple[list[int], list[list[str]]]]:
    """All rows from a line on, in blocks."""
    reader = _reader(found.text, found.mark, line - 1)
    before = 0
    while True:
        try:
            block = list(itertools.islice(reader, CHUNK))
        except csv.Error:
            for _ in rows(found.text, found.mark, source, line - 1 + before):  # once more one by one, to name the line
                pass
            raise
        if not block:
            return
        if reader.line_num - before == len(block):
            lines = list(range(line + before, line + before + len(block)))
        else:  # cells of several lines
            lines = [line + before]
            for row in block[:-1]:
                lines.append(lines[-1] + 1 + sum(len(_ENDS.findall(cell)) for cell in row))
        before = reader.line_num
        yield lines, block


def _without(
    lines: list[int], block: list[list[str]], held: list[int], commented: bool
) -> tuple[list[int], list[list[str]], list[int]]:
    """A block without comments; blank rows are held back until another row follows."""
    told: list[int] = []
    kept: list[list[str]] = []
    for line, cells in zip(lines, block, strict=True):
        if len(cells) < 2 and is_blank(cells):
            held.append(line)
            continue
        if held:
            told += held
            kept += [[] for _ in held]
            held = []
        if commented and is_comment(cells):
            continue
        told.append(line)
        kept.append(cells)
    return told, kept, held
