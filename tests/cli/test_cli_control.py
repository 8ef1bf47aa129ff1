"""``ctlabs regulate``: its folder, its exit codes, its options, what it exports, what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ctlabs.files.modelfile import ready
from ctlabs.reporting import render
from ctlabs.studies import regulating
from tests.cli.test_cli import Console, files
from tests.reference import PNG


@pytest.fixture
def ctlabs(capsys, tmp_path, monkeypatch) -> Console:
    """The command, in a folder of its own, with figures that cost nothing."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "png", lambda _figure: PNG)
    return Console(capsys)


#: A short experiment.
FEW = ("--runs", "5", "--steps", "5")


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def test_a_plant_of_the_gallery_is_regulated(ctlabs, tmp_path):
    """A folder named after it, the tables that matter on the terminal, the controller beside it."""
    assert ctlabs("regulate", "dc_motor", "--runs", "30", "--steps", "20", "--seed", "3", "--export", "motor.npz") == 0
    assert ctlabs.err == ""
    assert {"report.html", "report.md", "results.json", "figures/poles.png", "tables/budget.csv"} <= set(files(tmp_path / "dc_motor"))
    found = results(tmp_path / "dc_motor")
    assert (found["lab"], found["runs"], found["seed"], found["parameters"]["steps"]) == ("regulate", 30, 3, 20)
    assert all(check["passed"] for check in found["checks"])
    assert round(found["values"]["cost"]["value"], 6) == 1.040965
    for shown in (r"^cost +1\.041 +1/s$", r"^by separation +1\.04$", r"^noise of angle +0\.101", r"^theta +rad +1\.19"):
        assert re.search(shown, ctlabs.out, re.MULTILINE), shown
    assert ctlabs.out.endswith("dc_motor/report.html\nmotor.npz\n")
    machine = regulating.designed(ready("dc_motor")).regulator.machine
    with np.load("motor.npz") as written:
        for letter in "ABCDFG":
            np.testing.assert_array_equal(written[letter], getattr(machine, letter))


def test_options_change_the_regulator(ctlabs, tmp_path):
    """Period, delay, kind and constants; JSON on the standard output; a folder is not written over by chance."""
    assert ctlabs("regulate", "dc_motor", "--dt", "0.5", *FEW, "--json") == 0
    assert round(json.loads(ctlabs.out)["values"]["cost"]["value"], 6) == 1.111583
    assert ctlabs("regulate", "dc_motor", "--kind", "delayed", "--delay", "0.05", "--set", "r=0.02", *FEW, "--out", "late") == 0
    found = results(tmp_path / "late")
    assert found["parameters"]["kind"] == "delayed"
    assert found["parameters"]["r"] == 0.02
    assert found["values"]["cost"]["value"] > 1.1


def test_a_wrong_design_is_named(ctlabs, tmp_path):
    """What it costs, and that it does not hold the plant; both are findings, not failures."""
    assert ctlabs("regulate", "double_integrator", "--set", "m=2", "--design", "double_integrator", *FEW, "--out", "a") == 0
    found = results(tmp_path / "a")["values"]
    assert found["factor"]["value"] > 1
    assert "The wrong design believes that it costs 0.1755" in " ".join(ctlabs.out.split())
    assert ctlabs("regulate", "double_integrator", "--set", "m=0.01", "--design", "double_integrator", *FEW, "--out", "b") == 0
    assert results(tmp_path / "b")["values"]["stable"]["value"] is False
    assert "does not hold this plant" in " ".join(ctlabs.out.split())


def test_a_horizon(ctlabs, tmp_path):
    """Gains of fifty steps, in the header for C too."""
    assert ctlabs("regulate", "double_integrator", "--horizon", "5", "--runs", "20", "--export", "gains.h") == 0
    assert results(tmp_path / "double_integrator")["parameters"]["steps"] == 50
    assert "#define gains_steps 50" in (tmp_path / "gains.h").read_text()


REFUSED = [
    (["regulate"], r"MODEL: expected as in `ctlabs regulate --help`, received none"),
    (["regulate", "none.toml"], r"none\.toml: expected a file that can be read, received: No such file.*"),
    (["regulate", "dcmotor"], r'unknown model "dcmotor"; did you mean "dc_motor".*'),
    (["regulate", "local_level"], r"local_level\.toml: cost: expected a table \[cost\] with the weights Qx .*, received none"),
    (["regulate", "local_level", "--horizon", "3"], r"local_level\.toml: cost: expected a table \[cost\] .*, received none"),
    (["regulate", "dc_motor", "--kind", "late"], r'dc_motor\.toml: cost\.kind: expected "current" or "delayed", received "late"'),
    (["regulate", "dc_motor", "--dt", "0"], r"dc_motor\.toml: model\.dt: expected a period > 0, s, received 0"),
    (["regulate", "dc_motor", "--dt", "fast"], r"expected what `ctlabs regulate --help` shows, .*'fast' is not a valid float.*"),
    (["regulate", "dc_motor", "--delay", "-1"], r"dc_motor\.toml: cost\.delay: expected a time >= 0, s, received -1"),
    (["regulate", "dc_motor", "--horizon", "-1"], r"dc_motor\.toml: cost\.horizon: expected a number > 0, received -1\.0"),
    (["regulate", "dc_motor", "--horizon", "0.25"], r"horizon: expected a whole number of periods of 0\.1 s, received 0\.25 s .*"),
    (["regulate", "two_tanks", "--horizon", "50"], r"horizon: expected none beside integral, loads or track .*, received one"),
    (["regulate", "dc_motor", "--set", "voltage_weight=-1"], r"dc_motor\.toml: constants\.voltage_weight: expected a value from .*"),
    (["regulate", "dc_motor", "--runs", "0"], r"--runs: expected a whole number >= 1, received 0"),
    (["regulate", "dc_motor", "--export", "motor.txt"], r"--export motor\.txt: expected a name that ends with .*"),
    (["regulate", "dc_motor", "--design", "cart_pendulum"], r"truth: expected 2 measurements and 1 inputs as the design has, .*"),
    (["regulate", "-", "--design", "-"], r"-: expected the standard input for one of the files, received it for several"),
    (["regulate", "dc_motor", "--out", "."], r"--out \.: expected a folder of its own for the results, received the current one"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "line"), REFUSED, ids=[" ".join(words) for words, _ in REFUSED])
def test_bad_input_is_one_line_and_exit_2(ctlabs, tmp_path, words, line):
    """What, where, expected, received; nothing is written."""
    assert ctlabs(*words) == 2
    assert ctlabs.out == ""
    assert re.fullmatch(rf"ctlabs: {line}\n", ctlabs.err), ctlabs.err
    assert list(tmp_path.iterdir()) == []


def test_the_help_teaches(ctlabs):
    """What [cost] is, how to choose weights, and a line for every use."""
    assert ctlabs("regulate", "--help") == 0
    for word in ("[cost]", "Qx", "Qu", "margins", "--design simple.toml", "--export motor.h"):
        assert word in ctlabs.out
