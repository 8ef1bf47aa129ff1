"""Models and records from files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ctlabs.files import datafile, decode, modelfile
from ctlabs.files.datafile import Record
from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import ModelFile
from ctlabs.text import Own


def read_model(path: str | Path) -> ModelFile:
    """The model in a TOML file: :func:`ctlabs.files.modelfile.load`. Its ``continuous()`` and ``discrete()`` are the models.

    >>> from ctlabs.files.modelfile.catalogue import FOLDER
    >>> read_model(FOLDER / "local_level.toml").discrete().R
    array([[15099.]])
    """
    return modelfile.load(path)


def read_records(
    path: str | Path | Sequence[str | Path], model: ModelFile | Sequence[str], mapping: Mapping | None = None, **told: Any
) -> tuple[Record, ...]:
    r"""The records in a table with a column that names them (``record="run"``), or in several tables.

    Parameters and refusals are those of :func:`read_record`. A table of simulated runs (``ctlabs simulate --csv``) is known by its form.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "runs.csv"
    ...     _ = file.write_text("trial,x\nA,1\nA,2\nB,3\n", encoding="utf-8")
    ...     records = read_records(file, ["x"], record="trial")
    >>> [(record.name, record.z.ravel().tolist()) for record in records]
    [('A', [1.0, 2.0]), ('B', [3.0])]
    """
    said = (mapping or Mapping()).over(Mapping(**told))
    paths = [path] if isinstance(path, str | Path) else path
    contents = [(decode.content(each, source_of(each)), source_of(each)) for each in paths]
    return parsed(contents, model, said)


def source_of(path: str | Path) -> str:
    """The name of a file in messages."""
    return Own("stdin" if str(path) == "-" else Path(path).name)


def parsed(contents: Sequence[tuple[bytes, str]], model: ModelFile | Sequence[str], said: Mapping | None = None) -> tuple[Record, ...]:
    """The records in tables, each given as its bytes and its name."""
    said = said or Mapping()
    if not isinstance(model, ModelFile):
        found = [datafile.several(content, model, source, said) for content, source in contents]
        return named([record for records in found for record in records])
    said = model.mapping.over(said)
    dt, first = model.dt, model.experiment.first
    grid = (model.experiment.t0 + first * dt, dt)
    found = [datafile.several(content, model.measurements, source, said, grid) for content, source in contents]
    return named([placed(record, model) for records in found for record in records])


def named(records: Sequence[Record]) -> tuple[Record, ...]:
    """Several records with names that differ: their own, or those of their files."""
    if len(records) < 2:
        return tuple(records)
    many = len({record.file for record in records}) > 1
    names: list[str] = []
    for record in records:
        stem = record.file.rpartition(".")[0] or record.file
        name = stem if not record.name else f"{stem} {record.name}" if many else record.name
        count = 1 + sum(other == name or other.startswith(f"{name} (") for other in names)
        names.append(name if count == 1 else f"{name} ({count})")
    return tuple(dataclasses.replace(record, name=name) for record, name in zip(records, names, strict=True))


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
    return datafile.only(read_records(path, model, mapping, **told))


def placed(record: Record, model: ModelFile) -> Record:
    """The record with its first row at the model's first instant, where ``t0 = "first"`` says so."""
    if record.t is None or record.mapping.t0 != "first":
        return record
    start = model.experiment.t0 + model.experiment.first * model.dt
    t = start + record.t
    t.setflags(write=False)
    return dataclasses.replace(record, t=t)
