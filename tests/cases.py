"""The cases in tests/cases/ and tests/peers/ as models, records and tolerances, and the verbs that they ask for."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel

HERE = Path(__file__).parent
NUMERICS = HERE / "cases" / "numerics"
INSTRUMENTS = NUMERICS / "instruments"
PEERS = HERE / "peers"

Case = dict[str, Any]


def read(path: Path) -> Any:
    """A JSON file, plain or compressed."""
    return json.loads(gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes())


def numerics(pattern: str) -> list[Any]:
    """The cases whose names fit a pattern ("k1_*"), variants apart, as parameters of a test named after them."""
    found = [
        pytest.param(case, id=name)
        for path in sorted(NUMERICS.glob(f"{pattern}.json"))
        for name, case in variants(read(path))
    ]
    assert found, f"no case fits {pattern}"
    return found


def variants(case: Case) -> Iterator[tuple[str, Case]]:
    """A case, or each of its variants as a case of its own."""
    if "variants" not in case:
        yield case["name"], case
        return
    for i, variant in enumerate(case["variants"]):
        given = {**case.get("given", {}), **{key: variant[key] for key in variant if key not in ("model", "right")}}
        model = {**case.get("model", {}), **variant.get("model", {})}
        yield f"{case['name']}-{i}", {**case, "model": model, "given": given, "right": variant["right"]}


def peers(collection: str) -> list[Any]:
    """The sets of a collection ("darex"), as parameters of a test named after them."""
    path = next(PEERS.glob(f"{collection}.json*"))
    return [pytest.param(item, id=item["set"]) for item in read(path)["sets"]]


def matrix(value: Any, size: int = 0) -> Array | None:
    """Numbers, "inf", null and the words "identity" and "zero" as an array."""
    if value is None:
        return None
    if value == "identity":
        return np.eye(size)
    if value == "zero":
        return np.zeros((size, size))
    return np.vectorize(lambda v: np.nan if v is None else float(v), otypes=[float])(np.array(value, dtype=object))


def model(given: Mapping[str, Any], **changes: Any) -> ContinuousModel | DiscreteModel:
    """The model of a case; ``changes`` replace entries."""
    given = {**given, **changes}
    continuous = given["type"] == "continuous"
    n = len(given["F" if continuous else "Phi"])
    letters = "F G Q H Rc N B x0 P0" if continuous else "Phi Qd H R N offset x0 P0"
    entries: dict[str, Any] = {
        name: np.zeros(n) if name == "x0" and given[name] == "zero" else matrix(given[name], n)
        for name in letters.split()
        if name in given
    }
    entries |= {name: given[name] for name in ("states", "measurements") if isinstance(given.get(name), list)}
    if not continuous:
        entries |= {"dt": given["dt"]} if "dt" in given else {}
        return DiscreteModel(**entries)
    return ContinuousModel(**entries)


def record(given: Mapping[str, Any]) -> Array:
    """z (steps+1, m), NaN where nothing was measured; row 0 is t0."""
    z = matrix(given["z"])
    assert z is not None
    return z


def near(found: Any, right: Any, tolerance: str) -> None:
    """Assert that ``found`` is ``right`` within a tolerance as the cases write it ("sigma 1e-9")."""
    found, right = np.asarray(found), np.asarray(matrix(right))
    if re.match(r"1 - \|pole\|", tolerance):
        found, right = 1 - np.abs(found), 1 - np.abs(right)
        tolerance = tolerance.partition("|pole| ")[2]
    word, _, rest = tolerance.partition(" ")
    limit = float(re.match(r"[0-9.e+-]+", rest).group())  # type: ignore[union-attr]
    size = np.abs(right).max(initial=0.0)
    if word == "sigma":
        variance = np.diagonal(right, axis1=-2, axis2=-1)
        sd = np.sqrt(np.where(variance > 0, variance, 1.0))
        scale = sd[..., :, None] * sd[..., None, :]
    elif word == "relative":
        scale = np.where(right != 0, np.abs(right), size)
    elif word == "norm":
        scale = np.full(right.shape, np.linalg.norm(right))
        found, right = np.array(np.linalg.norm(found - right)), np.array(0.0)
        scale = scale.max(initial=0.0)
    else:
        assert word == "absolute", tolerance
        scale = np.ones(right.shape)
    np.testing.assert_array_less(np.abs(found - right), np.nextafter(limit * scale, np.inf), err_msg=tolerance)
