"""What came out of an experiment as tables, every row of each: for CSV, and for parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from ctlabs.linalg.checks import Array
from ctlabs.studies import common
from ctlabs.workbench.runs.outcomes import Outcome

#: The columns of a table by their names, all of one length.
Columns = Mapping[str, Any]


def tables(found: Outcome) -> dict[str, str]:
    """The tables of an experiment by their names, and what each holds; the first is the one that is meant where none is named."""
    simulated = found.truth is not None
    known = {
        "histories": "the first run at every instant, and what all runs give" if simulated else "the record at every instant",
        "runs": f"{found.x_plus.shape[2]} runs at every instant: states, measurements, estimates" if simulated else "",
        "gains": "gains and variances at every instant",
        "innovations": "their autocorrelations and bands at every lag" if found.verdict is not None and len(found.verdict.lags) else "",
        "algorithms": "the forms of the filter side by side",
        "numbers": "the numbers of the summary",
    }
    return {name: meaning for name, meaning in known.items() if meaning}


def columns(found: Outcome, name: str = "") -> Columns:
    """One of the tables: the first where none is named.

    Raises
    ------
    ValueError
        Another name; two columns of one name.
    """
    known = tables(found)
    name = name or next(iter(known))
    if name not in known:
        msg = f"table: expected one of {', '.join(known)}, received {name!r}"
        raise ValueError(msg)
    pairs = _MAKERS[name](found)
    common.distinct(f"{name}.csv", [each for each, _ in pairs])
    return dict(pairs)


def as_csv(table: Columns) -> str:
    """A table as CSV, numbers with all their digits, an empty cell where there is none.

    >>> print(as_csv({"k": np.arange(2), "=x": [0.1, float("nan")]}), end="")
    k,'=x
    0,0.1
    1,
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    # A spreadsheet would compute a name like "=1+2".
    writer.writerow([f"'{name}" if name[:1] in "=+-@" else name for name in table])
    lists = [_cells(column) for column in table.values()]
    writer.writerows(zip(*lists, strict=True))
    return text.getvalue()


def as_parquet(table: Columns) -> bytes:
    """A table as parquet, numbers to the bit.

    Raises
    ------
    ValueError
        The package that writes it is missing; the message says how to get it.
    """
    if find_spec("pyarrow") is None:
        msg = "parquet: expected the package pyarrow (pip install 'ctlabs[data]'), received none"
        raise ValueError(msg)
    import pandas as pd

    made = io.BytesIO()
    pd.DataFrame(dict(table)).to_parquet(made, engine="pyarrow", index=False)
    return made.getvalue()


def _cells(column: Any) -> list[Any]:
    values = column.tolist() if isinstance(column, np.ndarray) else list(column)
    return ["" if value is None or value != value else value for value in values]


def _histories(found: Outcome) -> list[tuple[str, Any]]:
    made: list[tuple[str, Any]] = [("k", found.k), ("t", found.t)]
    sd_plus, sd_minus = found.sd_plus, found.sd_minus
    for i, state in enumerate(found.states):
        if found.truth is not None:
            made.append((f"{state}_true", found.truth[:, i, 0]))
        made += [(state, found.x_plus[:, i, 0]), (f"{state}_sd", sd_plus[:, i])]
        if found.smoothed is not None and found.smoothed_sd is not None:
            made += [(f"{state}_smoothed", found.smoothed[:, i]), (f"{state}_smoothed_sd", found.smoothed_sd[:, i])]
        if found.statistics is not None:
            made += [(f"{state}_rms", found.statistics.rms[:, i]), (f"{state}_bias", found.statistics.bias[:, i])]
        made += [(f"{state}_predicted", found.x_minus[:, i, 0]), (f"{state}_predicted_sd", sd_minus[:, i])]
    for j, measurement in enumerate(found.measurements):
        made += [
            (f"{measurement}_measured", found.z[:, j, 0]),
            (f"{measurement}_innovation", found.innovation[:, j, 0]),
            (f"{measurement}_innovation_sd", found.innovation_sd[:, j]),
        ]
    made += [(f"{state}_by_{name}", x[:, i]) for name, x in list(found.estimates.items())[1:] for i, state in enumerate(found.states)]
    made.append(("nis", found.nis[:, 0]))
    if found.statistics is not None:
        made += [("nees_mean", found.statistics.nees), ("nis_mean", found.statistics.nis)]
    return made


def _runs(found: Outcome) -> list[tuple[str, Any]]:
    assert found.truth is not None
    count = found.x_plus.shape[2]

    def stacked(values: Array, i: int) -> Array:
        return values[:, i].T.ravel()

    made: list[tuple[str, Any]] = [
        ("run", np.repeat(np.arange(1, count + 1), len(found.k))), ("k", np.tile(found.k, count)), ("t", np.tile(found.t, count)),
    ]  # fmt: skip
    for i, state in enumerate(found.states):
        made += [(f"{state}_true", stacked(found.truth, i)), (state, stacked(found.x_plus, i))]
    for j, name in enumerate(found.measurements):
        made += [(f"{name}_measured", stacked(found.z, j)), (f"{name}_innovation", stacked(found.innovation, j))]
    return [*made, ("nis", found.nis.T.ravel())]


def _gains(found: Outcome) -> list[tuple[str, Any]]:
    before, after = found.variances
    made: list[tuple[str, Any]] = [("k", found.k), ("t", found.t)]
    for i, state in enumerate(found.states):
        made += [(f"{state}_variance_before", before[:, i]), (f"{state}_variance_after", after[:, i])]
        made += [(f"K_{state}_{name}", found.K[:, i, j]) for j, name in enumerate(found.measurements)]
    return made


def _innovations(found: Outcome) -> list[tuple[str, Any]]:
    told = found.verdict
    assert told is not None
    made: list[tuple[str, Any]] = [("lag", told.lags)]
    for j, name in enumerate(found.measurements):
        made += [(f"{name}_autocorrelation", told.correlation[j]), (f"{name}_band", told.band[j])]
    return made


def _algorithms(found: Outcome) -> list[tuple[str, Any]]:
    names = {"name": "algorithm", "seconds": "seconds", "flops": "operations"}
    names |= {"error_P": "error_P", "error_x": "error_x", "failed": "refused"}
    made: list[tuple[str, Any]] = [(word, [getattr(each, name) for each in found.algorithms]) for name, word in names.items()]
    for i, state in enumerate(found.states):
        values: Sequence[float | None] = [None if each.rms is None else float(each.rms[i]) for each in found.algorithms]
        made.append((f"rms_{state}", values))
    return made


def _numbers(found: Outcome) -> list[tuple[str, Any]]:
    values = [value if isinstance(value, str) else repr(value) for value, _ in found.summary.values()]
    return [("name", list(found.summary)), ("value", values), ("unit", [unit for _, unit in found.summary.values()])]


_MAKERS = {
    "histories": _histories, "runs": _runs, "gains": _gains, "innovations": _innovations, "algorithms": _algorithms, "numbers": _numbers,
}  # fmt: skip
