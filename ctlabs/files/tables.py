"""Tables of results for other programs: as CSV, or as parquet."""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np


def wanted(word: str) -> Path:
    """The file of a table, refused before anything is computed if it cannot be made: "parquet" is one beside the report.

    >>> wanted("estimates.txt")
    Traceback (most recent call last):
    ...
    ValueError: --table estimates.txt: expected parquet, or a name that ends with .parquet or .csv, received .txt
    """
    path = Path(word)
    if word != "parquet" and path.suffix not in (".parquet", ".csv"):
        msg = f"--table {word}: expected parquet, or a name that ends with .parquet or .csv, received {path.suffix or repr(word)}"
        raise ValueError(msg)
    if path.suffix != ".csv" and find_spec("pyarrow") is None:
        msg = f"--table {word}: expected the package pyarrow, received none; pip install 'ctlabs[data]'"
        raise ValueError(msg)
    if word != "parquet" and (path.exists() or not path.absolute().parent.is_dir()):
        found = "one that is there already: it is left alone" if path.exists() else "a folder that does not exist"
        msg = f"--table {word}: expected a new file in a folder that exists, received {found}"
        raise ValueError(msg)
    return path


def parquet(table: bytes) -> bytes:
    r"""A CSV table of ours as parquet: the same columns, numbers to the bit, an empty cell as null.

    >>> import pandas
    >>> made = parquet(b"k,stamp,x\n1,2024-05-31T12:00:00+02:00,0.1\n2,2024-05-31T12:00:01+02:00,\n")
    >>> pandas.read_parquet(io.BytesIO(made)).to_dict("list")
    {'k': [1, 2], 'stamp': ['2024-05-31T12:00:00+02:00', '2024-05-31T12:00:01+02:00'], 'x': [0.1, nan]}
    """
    import pandas as pd

    made, (names, *rows) = io.BytesIO(), csv.reader(io.StringIO(table.decode()))
    columns = zip(*rows, strict=True) if rows else [()] * len(names)
    frame = pd.DataFrame({name: _numbers(cells) for name, cells in zip(names, columns, strict=True)})
    frame.to_parquet(made, engine="pyarrow", index=False)
    return made.getvalue()


def _numbers(cells: Sequence[str]) -> Any:
    """The cells of a column as whole numbers or as numbers, none where a cell is empty; as they are where a number would be written
    otherwise: "001", "0.10", or more digits than it has.
    """
    import pandas as pd

    if not any(cells):
        return [float("nan")] * len(cells)
    with contextlib.suppress(ValueError, OverflowError):
        whole = [int(cell) if cell else None for cell in cells]
        if [str(number) if cell else "" for cell, number in zip(cells, whole, strict=True)] == list(cells):
            return pd.array(whole, dtype="Int64") if None in whole else np.array(whole, dtype=np.int64)
    with contextlib.suppress(ValueError, OverflowError):
        numbers = [float(cell or "nan") for cell in cells]
        if all(cell in ("", repr(number), f"{number:.0f}") for cell, number in zip(cells, numbers, strict=True)):
            return numbers
    return list(cells)
