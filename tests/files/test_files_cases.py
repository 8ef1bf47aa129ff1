"""Files and models as people have them (tests/cases/files): read as they were meant, or refused with what helps."""

from __future__ import annotations

import csv
import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from ctlabs import cli, read_model, read_record
from ctlabs.cli.records import reading
from ctlabs.reporting import render
from tests.reference import PNG

FILES = Path(__file__).parents[1] / "cases" / "files"
CASES = json.loads((FILES / "expected.json").read_text(encoding="utf-8"))["cases"]
TRIES = [(case, one, f"{case['id']}-{i}") for case in CASES for i, one in enumerate(case["tries"])]
#: Kinds that are about numbers, not about reading: fits, diagnoses, unknown beginnings.
NUMBERS = (
    "fit",
    "diagnosis",
    "analysis",
    "unknown beginning",
    "contradiction",
    "filter and smoother values",
    "forecasts",
)


def has(words: list[str], text: str, names: list[str]) -> bool:
    """Whether one of the words is in a text: short ones whole, longer ones anywhere; names of the case's files do not count."""
    for name in names:
        text = text.replace(name, "")
    for word in words:
        if word == "--":
            found = bool(re.search(r"(?<!\S)\(?--[a-z]", text))
        elif len(word) <= 3:
            found = bool(re.search(rf"(?<!\w){re.escape(word)}(?!\w)", text))
        else:
            found = word.lower() in text.lower()
        if found:
            return True
    return False


def tries():
    """All tries as parameters of a test; the slow ones are marked."""
    for case, one, name in TRIES:
        marks = [pytest.mark.slow] if case["kind"].startswith(NUMBERS) else []
        yield pytest.param(case, one, id=name, marks=marks)


@pytest.mark.parametrize(("case", "one"), list(tries()))
def test_a_file_is_read_as_it_was_meant_or_refused_with_what_helps(case, one, tmp_path, monkeypatch, capsys):
    """Exit 0 with the right numbers, or exit 2 with one line that names file, line, both readings and the option to paste."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "png", lambda _figure: PNG)
    for name in case["files"]:
        shutil.copy(FILES / name, tmp_path / name)
    words = shlex.split(one["command"])[1:]
    with pytest.raises(SystemExit) as end:
        cli.main([*words, "--out", "out"])
    said = capsys.readouterr()
    text = said.out + said.err
    if end.value.code == 2 and one["right"] in ("refuse", "read or refuse", "say or refuse"):
        assert len(said.err.strip().splitlines()) == 1, said.err
        assert len(said.err) < 600, said.err
        for group in one.get("message", []):
            assert has(group, said.err, case["files"]), (group, said.err)
        for word in one.get("never", []):
            assert word.lower() not in said.err.lower()
        return
    assert end.value.code == 0, said.err
    assert one["right"] != "refuse", text
    results = json.loads((tmp_path / "out/results.json").read_text(encoding="utf-8"))
    for group in one.get("says", []):
        assert has(group, text + json.dumps(results["values"]), case["files"]), (group, text)
    if "filter" in one:
        compare(one["filter"], results, tmp_path / "out/estimates.csv")
    if one["right"] == "fit":
        fitted(one, results["values"])
    if "rows" in one:
        smoothed(one, results["values"], tmp_path / "out/estimates.csv")
    if one["right"] == "forecast":
        rows = list(csv.DictReader((tmp_path / "out/forecast.csv").read_text(encoding="utf-8").splitlines()))
        own = one["measurement"]
        found = [[float(row[own]), float(row[f"{own}_sd"])] for row in rows]
        np.testing.assert_allclose(found, one["forecast"], rtol=one["tolerance"])
    if "record" in one:
        record(case, one, words, tmp_path)


def compare(right, results, estimates):
    """The numbers of a filtered record."""
    rows = list(csv.DictReader(estimates.read_text(encoding="utf-8").splitlines()))
    assert len(rows) == right["rows"]
    if "missing" in right:
        assert results["values"]["missing"]["value"] == right["missing"]
    if "log_likelihood" in right:
        np.testing.assert_allclose(
            results["values"]["log_likelihood"]["value"], right["log_likelihood"], rtol=right["tolerance"]
        )
    for state, (x, sd) in right.get("last", {}).items():
        assert abs(float(rows[-1][state]) - x) <= right["tolerance"] * sd
        assert abs(float(rows[-1][f"{state}_sd"]) - sd) <= right["tolerance"] * sd


def near(right, value):
    """Whether a value is the right one, within its own tolerance."""
    expected, value = np.array(right["value"], dtype=float), np.array(value, dtype=float)
    allowed = right["absolute"] if "absolute" in right else right["relative"] * np.abs(expected)
    return bool((np.abs(value - expected) <= allowed).all())


def fitted(one, values):
    """Estimates, standard errors and likelihood of a fit."""
    assert values["converged"]["value"] is one["converged"]
    for name, right in one["estimates"].items():
        assert near(right, values[name]["value"]), (name, values[name]["value"], right)
    for name, right in one.get("standard_errors", {}).items():
        found = values[f"{name}_se"]["value"]
        assert found is None if right is None else near(right, found), (name, found, right)
    if "log_likelihood" in one:
        assert near(one["log_likelihood"], values["log_likelihood"]["value"])


def smoothed(one, values, estimates):
    """Rows of estimates.csv."""
    rows = list(csv.DictReader(estimates.read_text(encoding="utf-8").splitlines()))
    for number, right in one["rows"].items():
        for name, value in right.items():
            sd = value if name.endswith("_sd") else right[f"{name}_sd"]
            assert abs(float(rows[int(number) - 1][name]) - value) <= one["tolerance"] * abs(sd), (number, name)
    if "log_likelihood" in one:
        told = values.get("log_likelihood_diffuse", values["log_likelihood"])["value"]
        assert near(one["log_likelihood"], told), told


def record(case, one, words, folder):
    """The record in the library, with the same options."""
    right = one["record"]
    model = read_model(folder / words[1])
    found = read_record(folder / words[2], model, mapping_of(words[3:]))
    z = np.array([[np.nan if v is None else v] for v in right["z"]], dtype=float)
    np.testing.assert_array_equal(found.z, z)
    if right["t"] is None:
        assert found.t is None
    else:
        np.testing.assert_allclose(found.t, right["t"], rtol=0, atol=right.get("t_tolerance", 1e-12))


def mapping_of(options):
    """What the options of a command say."""
    import click

    @click.command()
    @reading
    def command(mapping):
        return mapping

    return command.main(options, standalone_mode=False)
