"""Models of real instruments, through the command: exit code, nothing on stderr, and numbers and sentences that are true."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ctlabs.reporting import render
from tests import cases
from tests.cli.test_cli import Console
from tests.reference import PNG

NAMES = sorted(path.stem for path in cases.INSTRUMENTS.glob("*.toml"))


@pytest.fixture
def analysed(capsys: Any, tmp_path: Path, monkeypatch: Any) -> Any:
    """``ctlabs analyse`` of a file: the values, the text of the report, what it printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "png", lambda _figure: PNG)
    console = Console(capsys)

    def run(path: Path) -> tuple[dict[str, Any], str, str]:
        assert console("analyse", str(path)) == 0
        assert console.err == ""
        folder = tmp_path / path.stem
        found = json.loads((folder / "results.json").read_text(encoding="utf-8"))
        assert all(check["passed"] for check in found["checks"])
        return found["values"], (folder / "report.md").read_text(encoding="utf-8"), console.out

    return run


@pytest.mark.parametrize("name", NAMES)
def test_the_analysis_of_an_instrument(name: str, analysed: Any) -> None:
    """Steady covariances, gains, poles and ranks are those of a thousand bits; reasons are given once and are true."""
    values, text, printed = analysed(cases.INSTRUMENTS / f"{name}.toml")
    case = cases.read(cases.INSTRUMENTS / f"{name}.json")
    right, tolerance = case["right"], case["tolerance"]
    assert values["rank"]["value"] == right.get("observability_rank", len(values["sd_minus_end"]["value"]))
    if "discrete" in right:
        wanted = right["discrete"]
        P, K = np.array(values["P_minus_steady"]["value"]), values["gain_steady"]["value"]
        cases.near(P, wanted["P_minus"], tolerance["P_minus"])
        cases.near(np.sqrt(np.diag(P)), wanted["sd_minus"], tolerance["sd"])
        cases.near(np.sqrt(np.diag(values["P_plus_steady"]["value"])), wanted["sd_plus"], tolerance["sd"])
        cases.near(np.array(K), wanted["K"], tolerance["K"])
        largest = max(abs(complex(*pole)) for pole in values["filter_poles"]["value"])
        assert abs((1 - largest) / (1 - wanted["largest_pole"]) - 1) < 1e-4
        assert "no steady filter" not in text
        assert "Dotted: the steady values" in text
        assert "1/k" not in text
    else:
        assert values["P_minus_steady"]["value"] is None
        assert "Dotted" not in text
        assert printed.count("expected") == 1
        assert printed.count("as above") == 6
    if "continuous" in right:
        P = np.array(values["P_steady_continuous"]["value"])
        cases.near(P, right["continuous"]["P"], tolerance["P"])
        cases.near(np.array(values["gain_steady_continuous"]["value"]), right["continuous"]["K"], tolerance["K"])


def test_a_heading_of_ninety_degrees_names_the_state_that_is_hidden(analysed: Any) -> None:
    """One verdict in all places: rank 1, not detectable, north."""
    values, text, printed = analysed(cases.INSTRUMENTS / "heading90.toml")
    assert (values["rank"]["value"], values["observable"]["value"], values["detectable"]["value"]) == (1, False, False)
    assert "1 of 2 dimensions are never seen: eigenvalue 1 of the states north." in text
    assert "There is no steady filter: expected every mode with |eigenvalue| >= 1 to be measured" in text
    assert "north, which no measurement sees" in printed


def test_an_odometer_names_the_reduced_filter(analysed: Any) -> None:
    """Its variance tends to 0 like 1/k: no stable filter has it, and the reduced one is named."""
    _values, text, printed = analysed(cases.INSTRUMENTS / "odometer.toml")
    assert "There is no steady filter: expected a limit that is approached geometrically, received a singular R" in text
    assert "reduced filter" in printed


SLOW = """
format = 1
title = "A slow level and its trend"
kind = "continuous"
[model]
states = ["level", "trend"]
units = ["s", "1"]
measurements = ["z"]
F = {F}
G = {G}
Q = {Q}
H = {H}
Rc = {Rc}
P0 = {P0}
dt = {dt}
"""


def test_a_slow_level_and_trend_warn_of_nothing(analysed: Any, tmp_path: Path) -> None:
    """The closed form √2 q^¼R^¾, √2 q^¾R^¼ of the continuous filter; nothing on stderr."""
    (case,) = (parameter.values[0] for parameter in cases.numerics("k9_no_warning_slow"))
    path = tmp_path / "slow.toml"
    path.write_text(SLOW.format_map(case["model"]), encoding="utf-8")
    values, text, _printed = analysed(path)
    sd = np.sqrt(np.diag(values["P_steady_continuous"]["value"]))
    cases.near(sd, case["right"]["sd"], case["tolerance"]["sd"])
    assert "There is no steady" not in text
