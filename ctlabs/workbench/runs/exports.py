"""A kept experiment as a file: report, table, data, picture, model, and the Python lines that give its numbers again."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import unicodedata
from typing import Any

import numpy as np

import ctlabs
from ctlabs.linalg.checks import Array
from ctlabs.studies import common
from ctlabs.workbench.runs.outcomes import Asked, Outcome, packed
from ctlabs.workbench.runs.programs import python

#: Endings of the files, and their types for a browser.
KINDS = {
    "html": ("html", "text/html"),
    "csv": ("csv", "text/csv"),
    "json": ("json", "application/json"),
    "png": ("png", "image/png"),
    "svg": ("svg", "image/svg+xml"),
    "python": ("py", "text/x-python"),
    "toml": ("toml", "application/toml"),
}


def export(name: str, model: str, plan: Asked, found: Outcome, kind: str, figure: str = "") -> bytes:
    """The file.

    Parameters
    ----------
    name, model, plan, found : of the experiment
    kind : one of :data:`KINDS`
    figure : which picture ("png", "svg"), a name of :func:`ctlabs.workbench.runs.figures.pictures`; the first where not given

    Raises
    ------
    ValueError
        Another kind, another figure.
    """
    if kind not in KINDS:
        msg = f"export: expected one of {', '.join(KINDS)}, received {kind!r}"
        raise ValueError(msg)
    if kind in {"png", "svg"}:
        return _picture(found, kind, figure)
    if kind == "html":
        from ctlabs.reporting import render
        from ctlabs.reporting.report import Picture
        from ctlabs.workbench.runs.reporting import report

        made = report(name, model, plan, found)
        pictures = {block.name: render.png(block.figure) for block in made.blocks if isinstance(block, Picture)}
        page = render.html(made, pictures)
        # The program at the end has long lines: they move in their own box, not the page.
        return page.replace("</head>", "<style>pre { overflow-x: auto; }</style></head>", 1).encode()
    if kind == "toml":
        return model.encode()
    return {"csv": table, "json": data, "python": python}[kind](name, model, plan, found).encode()


def filename(name: str, number: int, kind: str) -> str:
    """A name for the file.

    >>> filename("Crane: 1000 runs, seed 1", 7, "python")
    'crane_1000_runs_seed_1_7.py'
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    word = re.sub(r"[^a-z0-9]+", "_", plain).strip("_")[:60].strip("_") or "experiment"
    return f"{word}_{number}.{KINDS[kind][0]}"


def table(_name: str, _model: str, _plan: Asked, found: Outcome) -> str:
    """The first run as CSV, an instant to a row; of simulated runs also what all of them give."""
    columns: list[tuple[str, Array]] = [("k", found.k), ("t", found.t)]
    for i, state in enumerate(found.states):
        if found.truth is not None:
            columns.append((f"{state}_true", found.truth[:, i, 0]))
        columns += [(state, found.x_plus[:, i, 0]), (f"{state}_sd", found.sd_plus[:, i])]
        if found.smoothed is not None and found.smoothed_sd is not None:
            columns += [(f"{state}_smoothed", found.smoothed[:, i]), (f"{state}_smoothed_sd", found.smoothed_sd[:, i])]
        if found.statistics is not None:
            columns += [
                (f"{state}_rms", found.statistics.rms[:, i]),
                (f"{state}_bias", found.statistics.bias[:, i]),
            ]
    for j, measurement in enumerate(found.measurements):
        columns += [
            (f"{measurement}_measured", found.z[:, j, 0]),
            (f"{measurement}_innovation", found.innovation[:, j, 0]),
            (f"{measurement}_innovation_sd", found.innovation_sd[:, j]),
        ]
    columns.append(("nis", found.nis[:, 0]))
    if found.statistics is not None:
        columns += [("nees_mean", found.statistics.nees), ("nis_mean", found.statistics.nis)]
    names = [name for name, _ in columns]
    common.distinct("experiment.csv", names)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    # A spreadsheet would compute a name like "=1+2".
    writer.writerow([f"'{name}" if name[:1] in "=+-@" else name for name in names])
    lists = [column.tolist() for _, column in columns]
    writer.writerows([["" if cell != cell else cell for cell in row] for row in zip(*lists, strict=True)])
    return text.getvalue()


def data(name: str, model: str, plan: Asked, found: Outcome) -> str:
    """Everything as JSON; a number that is none is null, an infinite one "inf"."""
    whole = {
        "schema": 1,
        "program": f"ctlabs {ctlabs.__version__}",
        "name": name,
        "model": model,
        "settings": plan.plain(),
        "summary": {key: {"value": value, "unit": unit} for key, (value, unit) in found.summary.items()},
        "results": {key: value for key, value in packed(found).items() if key != "summary"},
    }
    return json.dumps(_json(whole), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _json(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return _json(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "inf" if value > 0 else "-inf"
    if isinstance(value, dict):
        return {key: _json(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_json(each) for each in value]
    return value


def _picture(found: Outcome, kind: str, figure: str) -> bytes:
    from ctlabs.reporting import render
    from ctlabs.workbench.runs.figures import pictures

    drawn = pictures(found)
    figure = figure or next(iter(drawn))
    if figure not in drawn:
        msg = f"figure: expected one of {', '.join(drawn)}, received {figure!r}"
        raise ValueError(msg)
    return (render.png if kind == "png" else render.svg)(drawn[figure][0])
