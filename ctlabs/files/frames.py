"""Tables of other programs, by pandas: workbooks of Excel, parquet, feather."""

from __future__ import annotations

import csv
import io
from typing import Any

from ctlabs.files.mapping import pasted

#: What reads each kind, and the package that pandas needs for it.
READERS = {
    "excel": ("read_excel", "openpyxl"),
    "parquet": ("read_parquet", "pyarrow"),
    "feather": ("read_feather", "pyarrow"),
}
NAMES = {"excel": "an Excel workbook", "parquet": "a parquet file", "feather": "a feather file"}


def text(content: bytes, kind: str, source: str, sheet: str = "") -> str:
    """The table as the text of a CSV file, its cells as they are; of a workbook that of the ``sheet``, or of the only one with data."""
    import pandas as pd

    reader, package = READERS[kind]
    what = f"{source}: expected a text file with separated values (CSV), received {NAMES[kind]}"
    if sheet and kind != "excel":
        raise ValueError(f"{source}: --sheet {sheet}: expected an Excel workbook, received {NAMES[kind]}; leave --sheet out")
    try:
        options = _sheet(content, source, sheet) if kind == "excel" else {}
        frame = getattr(pd, reader)(io.BytesIO(content), **options)
    except ImportError:
        raise ValueError(
            f"{what}, which needs the package {package}: pip install 'ctlabs[data]', or (save it as CSV)"
        ) from None
    except ValueError as error:
        if str(error).startswith(f"{source}: expected a sheet"):
            raise
        raise ValueError(f"{what} (save it as CSV): it cannot be opened") from None
    except Exception:  # whatever the reader of a damaged file raises
        raise ValueError(f"{what} (save it as CSV): it cannot be opened, damaged or another kind of archive") from None
    if kind != "excel" and frame.index.name is not None:
        frame = frame.reset_index()
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n", quoting=csv.QUOTE_MINIMAL)
    if kind != "excel":
        writer.writerow([str(name) for name in frame.columns])
    for row in zip(*(_cells(frame[name]) for name in frame.columns), strict=True):
        writer.writerow(row)
    return out.getvalue()


def _sheet(content: bytes, source: str, sheet: str) -> dict[str, Any]:
    """How a sheet of a workbook is read, the one that is asked for or the only one that holds data: all cells, as they are."""
    import pandas as pd

    book = pd.read_excel(io.BytesIO(content), sheet_name=None, header=None)
    sheets = [str(name) for name, frame in book.items() if not frame.dropna(how="all").empty]
    if sheet not in book and (sheet or len(sheets) > 1):
        received = f'"{sheet}"' if sheet else f"{len(sheets)} sheets that hold data"
        choices = " or ".join(pasted(("--sheet", name)) for name in sheets)
        raise ValueError(f"{source}: expected a sheet of the workbook, received {received}; {choices}")
    return {"header": None, "dtype": object, "na_filter": False, "sheet_name": sheet or (sheets or list(book))[0]}


def _cells(column: Any) -> list[str]:
    """The values of a column as text, numbers to the bit."""
    return [_cell(value) for value in column.astype(object).tolist()]


def _cell(value: Any) -> str:
    if value is None or value != value:  # NaN, NaT
        return ""
    if hasattr(value, "isoformat"):
        return str(value.isoformat())
    if isinstance(value, float):
        return repr(float(value))
    return str(value)
