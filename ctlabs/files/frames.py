"""Tables of other programs, by pandas: workbooks of Excel, parquet, feather."""

from __future__ import annotations

import csv
import io
from typing import Any

#: What reads each kind, and the package that pandas needs for it.
READERS = {
    "excel": ("read_excel", "openpyxl"),
    "parquet": ("read_parquet", "pyarrow"),
    "feather": ("read_feather", "pyarrow"),
}
NAMES = {"excel": "an Excel workbook", "parquet": "a parquet file", "feather": "a feather file"}


def text(content: bytes, kind: str, source: str) -> str:
    """The table as the text of a CSV file, its cells as they are."""
    import pandas as pd

    reader, package = READERS[kind]
    what = f"{source}: expected a text file with separated values (CSV), received {NAMES[kind]}"
    try:
        options = _sheet(content, what) if kind == "excel" else {}
        frame = getattr(pd, reader)(io.BytesIO(content), **options)
    except ImportError:
        raise ValueError(
            f"{what}, which needs the package {package}: pip install 'ctlabs[data]', or (save it as CSV)"
        ) from None
    except ValueError as error:
        if str(error).startswith(what):
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


def _sheet(content: bytes, what: str) -> dict[str, Any]:
    """How the one sheet of a workbook that holds data is read: all cells, as they are."""
    import pandas as pd

    book = pd.read_excel(io.BytesIO(content), sheet_name=None, header=None)
    sheets = [name for name, frame in book.items() if not frame.dropna(how="all").empty]
    if len(sheets) > 1:
        raise ValueError(
            f"{what} with {len(sheets)} sheets that hold data, {', '.join(map(str, sheets))}: save one as CSV"
        )
    return {"header": None, "dtype": object, "na_filter": False, "sheet_name": (sheets or list(book))[0]}


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
