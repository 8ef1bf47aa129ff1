"""The committed reports are what the labs say today, on any machine."""

import ast
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
REPORTS = ROOT / "reports"
COMMITTED = sorted(path.parent.name for path in REPORTS.glob("*/results.json"))

#: Another processor and another build of the linear algebra change last digits, not numbers.
RELATIVE, ABSOLUTE = 1e-6, 1e-9


def meta(path: Path) -> dict[str, Any]:
    """The literal META of a lab's script."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "META":
            return ast.literal_eval(node.value)
    msg = f"{path}: expected a META, received none"
    raise AssertionError(msg)


def results(folder: Path) -> dict[str, Any]:
    """What ``results.json`` of a report holds."""
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def made(folder: Path) -> list[str]:
    """The figures and tables of a report."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.suffix in {".png", ".csv"})


def differences(committed: Any, fresh: Any, where: str = "") -> list[str]:
    """Where two values of a results.json differ by more than rounding."""
    if isinstance(committed, dict) and isinstance(fresh, dict):
        if committed.keys() != fresh.keys():
            return [f"{where}: {sorted(committed)} became {sorted(fresh)}"]
        return [line for key in committed for line in differences(committed[key], fresh[key], f"{where}/{key}")]
    if isinstance(committed, list) and isinstance(fresh, list) and len(committed) == len(fresh):
        pairs = enumerate(zip(committed, fresh, strict=True))
        return [line for i, (a, b) in pairs for line in differences(a, b, f"{where}/{i}")]
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (committed, fresh))
    same = math.isclose(committed, fresh, rel_tol=RELATIVE, abs_tol=ABSOLUTE) if numbers else committed == fresh
    return [] if same else [f"{where}: {committed} became {fresh}"]


def comparable(found: dict[str, Any]) -> dict[str, Any]:
    """What must agree: everything, but of a check (whose residual is rounding) the name, routes, kind and verdict."""
    checks = [{key: check[key] for key in ("name", "part", "route", "kind", "passed")} for check in found["checks"]]
    return found | {"checks": checks}


def test_every_lab_has_a_committed_report():
    """reports/ holds the report of every lab in tasks/, and of no other."""
    assert sorted(meta(path)["name"] for path in (ROOT / "tasks").glob("[a-z]*.py")) == COMMITTED
    assert COMMITTED


@pytest.mark.parametrize("name", COMMITTED)
def test_committed_files_belong_together(name: str):
    """A report is committed whole: every picture that the text shows is there, and no other."""
    folder = REPORTS / name
    text = (folder / "report.md").read_text(encoding="utf-8")
    pictures = {path.name for path in (folder / "figures").iterdir()}
    assert pictures == {line.split("](figures/")[1].rstrip(")") for line in text.splitlines() if line.startswith("![")}
    assert all(check["passed"] for check in results(folder)["checks"])


def test_a_change_of_a_number_is_noticed():
    """The comparison sees a changed digit, name, shape, null or verdict, and overlooks rounding."""
    committed = {"values": {"gain": {"value": [0.5, None]}}, "checks": [{"passed": True}]}
    assert differences(committed, committed | {"values": {"gain": {"value": [0.5 + 1e-12, None]}}}) == []
    for value in ([0.50001, None], [0.5, 0.0], [0.5], [None, None], ["inf", None], [True, None]):
        assert differences(committed, committed | {"values": {"gain": {"value": value}}})
    assert differences(committed, committed | {"values": {"gains": {"value": [0.5, None]}}})
    assert differences(committed, committed | {"checks": [{"passed": False}]})


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All labs, run now with their default parameters, runs and seed."""
    out = tmp_path_factory.mktemp("reports")
    command = [sys.executable, "-m", "ctlabs", "run", "all", "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


@pytest.mark.slow
@pytest.mark.xdist_group("reports")
@pytest.mark.parametrize("name", COMMITTED)
def test_a_fresh_run_gives_the_committed_numbers(name: str, fresh: Path):
    """Parameters, values, routes and verdicts are those of the committed results.json, up to rounding."""
    assert differences(comparable(results(REPORTS / name)), comparable(results(fresh / name))) == []


@pytest.mark.slow
@pytest.mark.xdist_group("reports")
@pytest.mark.parametrize("name", COMMITTED)
def test_a_fresh_run_writes_the_same_files(name: str, fresh: Path):
    """The same figures and tables are made, under the same names."""
    assert made(REPORTS / name) == made(fresh / name)
