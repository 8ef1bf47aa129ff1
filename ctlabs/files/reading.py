"""Models and records from files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ctlabs.files import datafile, modelfile
from ctlabs.files.datafile import Record
from ctlabs.files.modelfile import ModelFile


def read_model(path: str | Path) -> ModelFile:
    """The model in a TOML file: :func:`ctlabs.files.modelfile.load`. Its ``continuous()`` and ``discrete()`` are the models.

    >>> from ctlabs.files.modelfile.catalogue import FOLDER
    >>> read_model(FOLDER / "local_level.toml").discrete().R
    array([[15099.]])
    """
    return modelfile.load(path)


def read_record(path: str | Path, model: ModelFile | Sequence[str]) -> Record:
    r"""The record in a table, as a model file's measurements (or names) ask for it: :func:`ctlabs.files.datafile.read`.

    Returns
    -------
    Record with ``t`` (rows,), or None, and ``z`` (rows, m), NaN where nothing was measured

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "river.csv"
    ...     _ = file.write_text("t;flow\n0,5;1120\n1;\n1,5;963,5\n", encoding="utf-8")
    ...     read_record(file, ["flow"]).z.ravel()
    array([1120. ,    nan,  963.5])
    """
    return datafile.read(path, model.measurements if isinstance(model, ModelFile) else model)
