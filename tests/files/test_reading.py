"""Models and records from files, by the front door."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ctlabs import ContinuousModel, DiscreteModel, kalman_filter, read_model, read_record
from ctlabs.files import modelfile
from ctlabs.files.modelfile import ModelFileError
from ctlabs.files.modelfile.catalogue import FOLDER
from tests.reference import EXACT, close

LEVEL = """
format = 1
kind = "discrete"

[constants]
q = 3

[model]
states = ["h"]
units = ["m"]
measurements = ["gauge"]
Phi = [[1]]
Qd = [["q"]]
H = [[1]]
R = [[2]]
x0 = [0]
P0 = [[10]]
dt = 0.5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "level.toml").write_text(LEVEL, encoding="utf-8")
    (tmp_path / "level.csv").write_text("t;gauge\n0,5;1,25\n1;\n1,5;3\n", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.toml")))
def test_every_model_of_the_gallery_is_read(name: str) -> None:
    """As loading its text does, by a path or its name."""
    file = read_model(FOLDER / f"{name}.toml")
    assert file.dumps() == read_model(str(FOLDER / f"{name}.toml")).dumps() == modelfile.ready(name).dumps()
    assert isinstance(file.discrete(), DiscreteModel)


def test_a_model_is_what_its_file_says(folder: Path) -> None:
    """Matrices, names and units; a continuous one has both forms."""
    model = read_model(folder / "level.toml").discrete()
    assert (model.Phi.tolist(), model.Qd.tolist(), model.R.tolist(), model.dt) == ([[1]], [[3]], [[2]], 0.5)
    assert (model.states, model.units, model.measurements) == (("h",), ("m",), ("gauge",))
    assert isinstance(read_model(FOLDER / "oscillator.toml").continuous(), ContinuousModel)


def test_a_record_is_read_by_a_model_or_by_names(folder: Path) -> None:
    """One row for each line, NaN where nothing stands."""
    model = read_model(folder / "level.toml")
    for asked in (model, ["gauge"], ("gauge",)):
        record = read_record(folder / "level.csv", asked)
        assert np.array_equal(record.z, [[1.25], [np.nan], [3.0]], equal_nan=True)
        assert (record.rows, record.missing) == (3, 1)


def test_what_is_read_can_be_filtered(folder: Path) -> None:
    """z goes into the filter as it is: the first row is a period after t0."""
    model, record = read_model(folder / "level.toml"), read_record(folder / "level.csv", ["gauge"])
    found = kalman_filter(model.discrete(), record.z)
    P, x = 10.0, 0.0
    for z in (1.25, None, 3.0):
        P += 3.0
        if z is not None:
            x, P = x + P / (P + 2) * (z - x), 2 * P / (P + 2)
    assert close(found.x_plus[-1, 0], x, EXACT)
    assert close(found.P_plus[-1, 0, 0], P, EXACT)


def test_what_cannot_be_read_is_refused_with_its_place(folder: Path) -> None:
    """A file that is not there, one that says nonsense, and a column that is not there."""
    (folder / "bad.toml").write_text(LEVEL.replace('[["q"]]', '[["unheard"]]'), encoding="utf-8")
    with pytest.raises(ModelFileError, match="unheard"):
        read_model(folder / "bad.toml")
    with pytest.raises((ModelFileError, OSError)):
        read_model(folder / "nowhere.toml")
    with pytest.raises(ValueError, match=r"level\.csv: [^\n]*flow"):
        read_record(folder / "level.csv", ["flow"])
