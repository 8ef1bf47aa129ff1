"""Models and records from files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ctlabs.files import datafile, modelfile
from ctlabs.files.datafile import Record
from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import ModelFile


def read_model(path: str | Path) -> ModelFile:
    """The model in a TOML file: :func:`ctlabs.files.modelfile.load`. Its ``continuous()`` and ``discrete()`` are the models.

    >>> from ctlabs.files.modelfile.catalogue import FOLDER
    >>> read_model(FOLDER / "local_level.toml").discrete().R
    array([[15099.]])
    """
    return modelfile.load(path)


def read_record(
    path: str | Path, model: ModelFile | Sequence[str], mapping: Mapping | None = None, **told: Any
) -> Record:
    r"""The record in a table, as a model file's measurements (or names) ask for it.

    Parameters
    ----------
    path : the file, or "-" for the standard input: CSV in its many forms, also packed by gzip; Excel, parquet, feather
    model : a model file, whose table ``[data]`` says how the record names things; or the names of the measurements
    mapping, **told : what else is said of the table, over ``[data]``: fields of :class:`~ctlabs.files.mapping.Mapping`

    Returns
    -------
    Record with ``t`` (rows,), or None, and ``z`` (rows, m), NaN where nothing was measured. With ``t0="first"`` the first row's time
    is that of the model's first instant (0 where only names are given)

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "river.csv"
    ...     _ = file.write_text("year;volume\n1871;1120\n1872;\n1873;963,5\n", encoding="utf-8")
    ...     record = read_record(file, ["flow"], columns={"flow": "volume"}, time="year", t0="first")
    >>> record.t, record.z.ravel()
    (array([0., 1., 2.]), array([1120. ,    nan,  963.5]))
    """
    said = (mapping or Mapping()).over(Mapping(**told))
    if not isinstance(model, ModelFile):
        return datafile.read(path, model, said)
    return placed(datafile.read(path, model.measurements, model.mapping.over(said)), model)


def placed(record: Record, model: ModelFile) -> Record:
    """The record with its first row at the model's first instant, where ``t0 = "first"`` says so."""
    if record.t is None or record.mapping.t0 != "first":
        return record
    start = model.experiment.t0 + model.experiment.first * model.dt
    t = start + record.t
    t.setflags(write=False)
    return dataclasses.replace(record, t=t)
