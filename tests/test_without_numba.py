"""Labs and peers' numbers without a compiler: where numba is not there, or is switched off, they are the same to 1e-12."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.linalg.test_compiled import WITHOUT

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[1]
#: Steady states and a change of time, sampling and an ensemble, twelve forms and a trap of rounding: labs that run every kind of loop.
LABS = ("task01", "task07", "task12", "task17")
#: Prints a table name → numbers.
PROGRAM = """
import json, sys
import numpy as np
from ctlabs import ContinuousModel, kalman_filter, smooth, steady_state
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import Experiment
from ctlabs.linalg import compiled
from tests import cases

found = {"compiled": [float(compiled.COMPILED)]}

def put(name, *values):
    numbers = found.setdefault(name, [])
    for value in values:
        numbers.extend(np.ravel(np.asarray(value, dtype=float)).tolist())

def plain(name, value):
    value = getattr(value, "value", value)
    try:
        put(name, value)
    except (TypeError, ValueError):  # words
        pass

for lab in sys.argv[1:]:
    lab = labs.catalogue()[lab]
    report = labs.run(lab, labs.parameters([lab], {})[lab.name], Experiment(20, 1))
    for key, value in report.values.items():
        plain(f"{lab.name}: {key}", value)
data = cases.read(cases.PEERS / "likelihoods.json")["data"]
for parameter in cases.peers("likelihoods"):
    item = parameter.values[0]
    given = item["given"]
    z = cases.record({"z": data[given["z"]]} if isinstance(given["z"], str) else given)
    filtered = kalman_filter(cases.model(item["model"]), z[given["first"]:], first=given["first"])
    smoothed = smooth(cases.model(item["model"]), filtered)
    name = f"likelihoods: {item['set']}"
    put(name, filtered.x_plus, filtered.P_plus, filtered.log_likelihood, filtered.log_likelihood_diffuse, smoothed.x, smoothed.P)
for collection in ("carex", "darex", "gains", "riccati_continuous_printed", "riccati_discrete_printed"):
    for parameter in cases.peers(collection):
        item = parameter.values[0]
        expected = item.get("expected", {})
        if "refused" in expected or any("lambda" in name for name in expected):  # a relation between symbols
            continue
        model = cases.model(item["model"])
        limit = steady_state(model)
        put(f"{collection}: {item['set']}", limit.P if isinstance(model, ContinuousModel) else limit.P_minus, limit.K)
print(json.dumps(found))
"""


def numbers(program: str, **environment: str) -> dict[str, list[float]]:
    """What a process of its own finds."""
    command, given = [sys.executable, "-c", program, *LABS], {**os.environ, **environment}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=given)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@cache
def compiled() -> dict[str, list[float]]:
    """The same with numba."""
    pytest.importorskip("numba", reason="numba is not installed: there is nothing to compare with")
    found = numbers(PROGRAM)
    if found["compiled"] != [1.0]:
        pytest.skip("NUMBA_DISABLE_JIT is set: there is nothing to compare with")
    return found


@pytest.mark.parametrize("how", ["not there", "switched off"])
def test_labs_and_peers_numbers_need_no_compiler(how: str) -> None:
    """Every number of four labs with an ensemble each, of the peers' likelihoods and of their steady states."""
    right = compiled()
    found = numbers(WITHOUT + PROGRAM) if how == "not there" else numbers(PROGRAM, NUMBA_DISABLE_JIT="1")
    assert found.pop("compiled") == [0.0]
    assert found.keys() == right.keys() - {"compiled"}
    assert len(found) > 100
    for name, values in found.items():
        mine, theirs = np.array(values), np.array(right[name])
        size = np.abs(theirs[np.isfinite(theirs)]).max(initial=0.0)
        assert np.allclose(mine, theirs, rtol=1e-12, atol=1e-12 * size, equal_nan=True), name
