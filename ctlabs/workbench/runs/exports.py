"""A kept experiment as a file: report, tables, gains, pictures, model, and the Python lines and commands that give its numbers again."""

from __future__ import annotations

import json
import math
import re
import tempfile
import unicodedata
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import ctlabs
from ctlabs.files import timed
from ctlabs.models import anomalous
from ctlabs.workbench.runs import tables
from ctlabs.workbench.runs.kinds import GAINS, KINDS, PICTURES, TABLES
from ctlabs.workbench.runs.outcomes import Asked, Outcome, packed
from ctlabs.workbench.runs.programs import commands, files, python


def export(name: str, model: str, plan: Asked, found: Outcome, kind: str, part: str = "") -> bytes:
    """The file.

    Parameters
    ----------
    name, model, plan, found : of the experiment
    kind : one of :data:`ctlabs.workbench.runs.kinds.KINDS`
    part : which picture (a name of :func:`ctlabs.workbench.runs.figures.pictures`) or table (one of
        :func:`ctlabs.workbench.runs.tables.tables`); the first where not given

    Raises
    ------
    ValueError
        Another kind, figure or table; a package that is missing, with the command that brings it.
    """
    if kind not in KINDS:
        msg = f"export: expected one of {', '.join(KINDS)}, received {kind!r}"
        raise ValueError(msg)
    if kind in PICTURES:
        return _picture(found, kind, part)
    if kind in TABLES:
        table = tables.columns(found, part)
        return tables.as_csv(table).encode() if kind == "csv" else tables.as_parquet(table)
    if kind in GAINS:
        return gains(model, plan, kind)
    if kind in ("html", "pdf"):
        return (_page if kind == "html" else _paper)(name, model, plan, found)
    if kind == "toml":
        return model.encode()
    return {"json": data, "python": python, "commands": commands}[kind](name, model, plan, found).encode()


def _page(name: str, model: str, plan: Asked, found: Outcome) -> bytes:
    """The report in one page."""
    from ctlabs.reporting import render
    from ctlabs.reporting.report import Picture
    from ctlabs.workbench.runs.reporting import report

    made = report(name, model, plan, found)
    pictures = {block.name: render.png(block.figure) for block in made.blocks if isinstance(block, Picture)}
    page = render.html(made, pictures)
    # The program at the end has long lines: they move in their own box, not the page.
    return page.replace("</head>", "<style>pre { overflow-x: auto; }</style></head>", 1).encode()


def _paper(name: str, model: str, plan: Asked, found: Outcome) -> bytes:
    """The report as PDF."""
    from ctlabs.labs import printing
    from ctlabs.reporting import render
    from ctlabs.workbench.runs.reporting import report

    try:
        printing.programs()
    except ValueError as why:
        raise ValueError(str(why).replace("--format:", "PDF:")) from None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "report"
        render.write(report(name, model, plan, found), folder)
        return printing.make(folder, ("pdf",), {})[0].read_bytes()


def gains(model: str, plan: Asked, kind: str) -> bytes:
    """The filter's matrices and its steady gains, or (where there are none) the gains of every instant, for other programs."""
    from ctlabs.files import export as writing
    from ctlabs.filtering import kalman_filter, steady

    truth, design = files(model, plan)
    used = design or truth
    if plan.data is None:
        discrete, z = used.discrete(steps=plan.steps), np.zeros((plan.steps + 1, len(used.measurements)))
    else:
        discrete, z, _t = timed(used, plan.data.record(used))
    discrete = anomalous(discrete, plan.anomalies, len(z) - 1)
    try:
        result: Any = steady.solve(replace(discrete, measurement_offset=None))  # which may vary where all else is constant
    except ValueError:  # it varies with time, or has no steady state
        result = kalman_filter(discrete, z[plan.first :], first=plan.first)  # where nothing was measured, there is no gain
    with tempfile.TemporaryDirectory() as place:
        return writing.write(discrete, result, Path(place) / f"gains.{kind}").read_bytes()


def filename(name: str, number: int, kind: str, part: str = "") -> str:
    """A name for the file.

    >>> filename("Crane: 1000 runs, seed 1", 7, "python"), filename("Crane", 7, "csv", "runs")
    ('crane_1000_runs_seed_1_7.py', 'crane_7_runs.csv')
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    word = re.sub(r"[^a-z0-9]+", "_", plain).strip("_")[:60].strip("_") or "experiment"
    which = f"_{part}" if part and kind in (*TABLES, *PICTURES) else "_gains" if kind in GAINS else ""
    return f"{word}_{number}{which}.{KINDS[kind][0]}"


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
