"""What ``ctlabs filter`` computes: the gate, the tables, times as they came, rows that are named, and draws."""

import csv
import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from ctlabs import DiscreteModel, kalman_filter
from ctlabs.files import datafile, modelfile, tables
from ctlabs.files.mapping import Mapping
from ctlabs.filtering import draws
from ctlabs.montecarlo import chance
from ctlabs.studies import estimates, filtered, filtering, paths

LEVEL = """\
format = 1
title = "Level"
kind = "continuous"
[model]
states = ["level"]
measurements = ["gauge"]
F = [[0]]
G = [[1]]
Q = [[1]]
H = [[1]]
R = [[4]]
x0 = [10]
P0 = [[9]]
dt = 1
"""


def record(cells, head="gauge", mapping=Mapping()):  # noqa: B008  # frozen
    """A record of the model from the cells of its rows."""
    return datafile.parse("\n".join([head, *cells]).encode(), ["gauge"], "log.csv", mapping)


def rows_of(report, name="estimates"):
    return list(csv.DictReader(io.StringIO(report.files[f"{name}.csv"].decode())))


def told(report, name):
    """The rows of one of its tables."""
    (table,) = (block for block in report.blocks if getattr(block, "name", "") == name and hasattr(block, "rows"))
    return table.rows


def test_every_row_has_its_prediction_with_its_deviation_also_where_nothing_was_measured():
    """Hx̂⁻ and √(P⁻ + R) by hand, in a gap and after the last measurement."""
    model = modelfile.loads(LEVEL)
    rows = rows_of(filtering.study(model, record(["11", "NA", "12", "NA", "NA"])))
    x, P = 10.0, 9.0
    for row, z in zip(rows, [11, None, 12, None, None], strict=True):
        P += 1
        assert float(row["predicted_gauge"]) == pytest.approx(x, rel=1e-12)
        assert float(row["predicted_sd_gauge"]) == pytest.approx(np.sqrt(P + 4), rel=1e-12)
        assert (row["innovation_gauge"] == "") == (z is None)
        if z is not None:
            K = P / (P + 4)
            x, P = x + K * (z - x), (1 - K) * P


def test_the_prediction_of_an_unknown_state_says_so():
    """Not measured yet: no value, and an infinite deviation; of the state that is known there is one."""
    model = DiscreteModel(np.eye(2), np.eye(2), np.eye(2), np.eye(2), x0=[3, 4], P0=np.diag([np.inf, 1]))
    found = kalman_filter(model, [[np.nan, np.nan], [1, 1]])
    z, sd = estimates.predictions(model, found.x_minus, found.P_minus)
    assert np.isnan(z[1, 0])
    assert np.isinf(sd[1, 0])
    assert (z[1, 1], sd[1, 1]) == pytest.approx((4, np.sqrt(3)))


@pytest.mark.parametrize(
    ("unit", "stamps"),
    [
        ("iso", ["2024-05-31T12:00:01+02:00", "2024-05-31T12:00:02+02:00", "2024-05-31T12:00:04+02:00"]),
        ("unix_ms", ["1717156801000", "1717156802000", "1717156804000"]),
        ("clock", ["12:00:01", "12:00:02", "12:00:04"]),
    ],
)
@pytest.mark.parametrize("name", ["stamp", "t", "k"])
def test_times_are_written_as_they_came_in(unit, stamps, name):
    """Under their own name, beside the seconds of the model's clock; in CSV and in parquet."""
    model = modelfile.loads(LEVEL + "[experiment]\nfirst = 0\n")
    data = record([f"{stamp},{10 + i}" for i, stamp in enumerate(stamps)], f"{name},gauge", Mapping(time=name, unit=unit, t0="first"))
    report = filtering.study(model, data)
    rows = rows_of(report)
    assert [row["time_k" if name == "k" else name] for row in rows] == stamps
    assert [float(row["seconds" if name == "t" else "t"]) for row in rows] == [0, 1, 3]
    frame = pd.read_parquet(io.BytesIO(tables.parquet(report.files["estimates.csv"])))
    assert [str(cell) for cell in frame["time_k" if name == "k" else name]] == stamps
    assert frame["level"].tolist() == [float(row["level"]) for row in rows]


def test_what_is_beyond_the_gate_is_listed_and_left_out():
    """With its line, time and value; the estimates are those of the record without it, and a lost record is said."""
    model = modelfile.loads(LEVEL)
    values = ["10", "11", "60", "12", "11"]
    gated = filtering.study(model, record(values), gate=5)
    assert gated.values["left_out"].value == 1
    assert gated.values["left_out_rows"].value.startswith("gauge = 60 in line 4 (t = 3), ")
    assert gated.passed
    without = filtering.study(model, record(["10", "11", "NA", "12", "11"]))
    assert [row["level"] for row in rows_of(gated)] == [row["level"] for row in rows_of(without)]
    lost = filtering.study(model, record([*values, *["900"] * 8]), gate=5)
    assert lost.values["lost"].value == 8


def test_rows_are_named_by_line_and_time():
    """In the suggestion and in a table; a date as it is written."""
    model = modelfile.loads(LEVEL + "[experiment]\nfirst = 0\n")
    rng = np.random.default_rng(0)
    walk = 10 + np.cumsum(rng.normal(size=50)) + 2 * rng.normal(size=50)
    walk[30] = 88.5
    cells = [f"2024-05-31T12:00:{i:02d}Z,{value!r}" for i, value in enumerate(walk.tolist())]
    report = filtering.study(model, record(cells, "at,gauge", Mapping(time="at", unit="iso", t0="first")))
    assert report.values["verdict"].value == "outlier"
    assert "gauge = 88.5 in line 32 (t = 2024-05-31T12:00:30Z) is an outlier" in report.values["suggestion"].value


def test_the_compute_half_is_a_frozen_result():
    """Arrays and a verdict, without a report."""
    run = filtered.compute(modelfile.loads(LEVEL), record(["10", "11", "12"]), "ud", smooth=True)
    assert run.filtered.algorithm == "ud"
    assert run.verdict.ok
    with pytest.raises(AttributeError):
        run.z = None


def dense(model, z):
    """Mean and covariance of (x_0, …, x_N) given z (steps+1, m), by the joint Gaussian of everything; a diffuse part as 1e9."""
    n, m, rows = model.n, model.m, len(z)
    size = n + (rows - 1) * (n + m) + m
    noise = np.zeros((size, size))
    P0 = np.where(np.isinf(model.P0), 1e9, model.P0)
    noise[:n, :n] = P0
    N = np.zeros((n, m)) if model.N is None else model.N
    for k in range(rows - 1):
        at = n + k * (n + m)
        noise[at : at + n + m, at : at + n + m] = np.block([[model.Qd, N], [N.T, model.R]])
    noise[-m:, -m:] = model.R
    X, Z = np.zeros((rows * n, size)), np.zeros((rows * m, size))
    X[:n, :n] = np.eye(n)
    for k in range(rows):
        at = n + k * (n + m)
        if k:
            X[k * n : (k + 1) * n] = model.Phi @ X[(k - 1) * n : k * n]
            X[k * n : (k + 1) * n, at - n - m : at - m] += np.eye(n)
        Z[k * m : (k + 1) * m] = model.H @ X[k * n : (k + 1) * n]
        Z[k * m : (k + 1) * m, at + n if k < rows - 1 else size - m : (at + n if k < rows - 1 else size - m) + m] += np.eye(m)
    mean = np.concatenate([np.linalg.matrix_power(model.Phi, k) @ model.x0 for k in range(rows)])
    seen = ~np.isnan(z.ravel())
    A, B = Z[seen] @ noise @ Z[seen].T, X @ noise @ Z[seen].T
    gain = np.linalg.solve(A, B.T).T
    expected = mean + gain @ (z.ravel()[seen] - (np.kron(np.eye(rows), model.H) @ mean)[seen])
    return expected, X @ noise @ X.T - gain @ B.T


MODELS = {
    "singular Qd": DiscreteModel([[1, 1], [0, 1]], [[0, 0], [0, 0.3]], [[1, 0]], [[1.0]], x0=[2, 0], P0=np.diag([4, 1])),
    "correlated": DiscreteModel([[0.8]], [[1.0]], [[1]], [[1.0]], P0=[[2]], N=[[0.6]]),
    "unknown start": DiscreteModel([[1, 1], [0, 1]], 0.2 * np.eye(2), [[1, 0]], [[1.0]], P0=np.diag([np.inf, 1])),
}


@pytest.mark.parametrize("name", MODELS)
def test_draws_have_the_joint_distribution_of_the_whole_history(name):
    """Mean and all covariances between all instants: with the inverse of the Gaussian's, NEES of all draws together is χ²."""
    model, number = MODELS[name], 2000
    z = np.full((6, 1), np.nan)
    z[[1, 2, 4, 5], 0] = [3.0, 4.5, 4.0, 7.0]
    made = draws(model, kalman_filter(model, z[1:]), number, 7).reshape(-1, number)
    mean, P = dense(model, z)
    values, vectors = np.linalg.eigh(P)
    seen = values > 1e-6
    white = (vectors[:, seen] / np.sqrt(values[seen])).T @ (made - mean[:, None])
    rank, count = int(seen.sum()), number
    assert np.abs(vectors[:, ~seen].T @ (made - mean[:, None])).max(initial=0.0) < 1e-3
    tests = rank * (rank + 3) // 2
    bound = -stats.norm.ppf(1e-8 / (2 * tests))
    assert np.abs(white.mean(axis=1)).max() * np.sqrt(count) < bound
    moments = white @ white.T / count
    assert np.abs(moments - np.diag(np.diag(moments))).max() * np.sqrt(count) < bound * 1.2
    squares = (white**2).sum(axis=1)
    assert (stats.chi2.cdf(squares, count).min(), stats.chi2.sf(squares, count).min()) > (1e-8, 1e-8)


def test_functions_of_the_path_are_those_of_the_draws():
    """Greatest, least, area and first passage; the same for the same seed; a level that is never reached has no time."""
    model = modelfile.loads(LEVEL)
    run = filtered.compute(model, record(["10", "12", "14", "17", "21"]), "joseph")
    found = paths.compute(run, 400, 3, {"level": [15.0, 500.0]})
    x = draws(run.model, run.filtered, 400, 3)[1:, 0]
    np.testing.assert_array_equal(found.functions["level_max"], x.max(axis=0))
    np.testing.assert_allclose(found.functions["level_area"], ((x[1:] + x[:-1]) / 2).sum(axis=0))
    first = [next((t for t, v in enumerate(path, 1) if (v >= 15) == (path[0] < 15)), np.nan) for path in x.T]
    np.testing.assert_array_equal(found.functions["level_reaches_15_t"], first)
    assert np.isnan(found.functions["level_reaches_500_t"]).all()
    report = filtering.study(model, run.record, draws=400, seed=3, reach=("level=15",))
    assert report.passed
    assert len(rows_of(report, "draws")) == 400
    assert report.values["level_reaches_15_probability"].value == np.isfinite(first).mean()
    wrong = replace(found, x=found.x + 0.5)
    assert not chance.means(wrong.x, x.mean(axis=1)[:, None], x.std(axis=1)[:, None]).passed


@pytest.mark.parametrize(
    ("reach", "message"),
    [(("speed=1",), "--reach speed: expected a state of the model"), (("level=high",), "--reach: expected STATE=VALUE with a finite")],
)
def test_what_cannot_be_reached_is_refused(reach, message):
    """Another state, no number; and a passage without draws."""
    model, data = modelfile.loads(LEVEL), record(["10", "12"])
    with pytest.raises(ValueError, match=message):
        filtering.study(model, data, draws=5, reach=reach)
    with pytest.raises(ValueError, match="--reach: expected --draws N beside it"):
        filtering.study(model, data, reach=("level=1",))


@pytest.mark.parametrize(
    ("word", "message"),
    [("out.txt", "received .txt"), ("excel", "received 'excel'"), ("none/out.csv", "received a folder that does not exist")],
)
def test_a_table_that_cannot_be_written_is_refused_first(word, message):
    """Before anything is computed."""
    with pytest.raises(ValueError, match=message):
        tables.wanted(word)


KNOWN = """\
format = 1
title = "A level above a known datum"
kind = "discrete"
[model]
states = ["level"]
measurements = ["gauge"]
Phi = [[1]]
Qd = [[1]]
H = [[1]]
D = [[1]]
measurement_offset = [40]
R = [[1]]
P0 = [[10]]
dt = 1
[data]
inputs = ["datum"]
[experiment]
first = 0
"""


@pytest.fixture
def datum():
    """A record that a known input and an offset move by 100 and more, with a sentinel twice and one value far off; the same without."""
    rng = np.random.default_rng(8)
    u = np.round(60 + 20 * np.cos(np.arange(80.0)), 2)
    z = np.round(np.cumsum(rng.normal(size=80)) + rng.normal(size=80) + u + 40, 2)
    z[[20, 60]], z[33] = -9999.0, 260.0
    model = modelfile.loads(KNOWN)
    cells = "\n".join(["gauge,datum", *(f"{a:.2f},{b:.2f}" for a, b in zip(z, u, strict=True))]).encode()
    plain = modelfile.loads(KNOWN.replace("D = [[1]]\nmeasurement_offset = [40]\n", "").replace('[data]\ninputs = ["datum"]\n', ""))
    less = "\n".join(["gauge", *(f"{a - b - 40:.2f}" for a, b in zip(z, u, strict=True))]).encode()
    return (
        (model, datafile.parse(cells, ["gauge"], "log.csv", model.mapping)),
        (plain, datafile.parse(less, ["gauge"], "less.csv", plain.mapping)), u + 40,
    )  # fmt: skip


def test_what_is_known_of_the_measurements_moves_predictions_and_nothing_else(datum):
    """Du + d: the table is that of the record without it, but for predictions, which are higher by it, at every row."""
    known, plain, d = datum
    with_it, without = (rows_of(filtering.study(*each)) for each in (known, plain))
    assert len(with_it) == len(without) == 80
    for one, other, more in zip(with_it, without, d, strict=True):
        for name in other:
            value = float(other[name] or "nan") + (more if name == "predicted_gauge" else 0.0)
            assert float(one[name] or "nan") == pytest.approx(value, rel=1e-9, abs=1e-9, nan_ok=True)


def test_values_are_told_as_the_file_has_them(datum):
    """In the verdict, in the table of events and beyond a gate: −9999 and 260, whatever is known of the measurements."""
    known, plain, _d = datum
    report, other = filtering.study(*known), filtering.study(*plain)
    events = {line: value for line, _time, _name, _kind, value, _size in told(report, "events")}
    assert (events[22], events[62], events[35]) == (-9999.0, -9999.0, 260.0)
    assert "--missing -9999)" in report.values["suggestion"].value
    assert report.values["nis_mean"].value == pytest.approx(other.values["nis_mean"].value)
    gated = filtering.study(*known, gate=5)
    assert [row[3] for row in told(gated, "left_out")] == [-9999.0, 260.0, -9999.0]
    assert gated.passed


@pytest.mark.parametrize("algorithm", ["joseph", "ud", "steady", "filterpy"])
def test_the_second_routes_know_what_is_known(algorithm, datum):
    """Smoother, constant gains and filterpy, where the offset of the measurements varies."""
    known, _plain, _d = datum
    report = filtering.study(*known, algorithm=algorithm, smooth=True, gate=None if algorithm == "steady" else 5)
    assert report.passed
    assert len(report.checks) == (1 if algorithm == "steady" else 4)


def test_a_design_with_the_offset_of_the_truth_is_judged():
    """The same offset in both models is no difference; the estimates are worth what they claim."""
    model = modelfile.loads(LEVEL.replace("x0 = [10]", "x0 = [10]\nmeasurement_offset = [100]"))
    report = filtering.study(model, record(["111", "113", "", "112", "109"]), design=model)
    assert report.values["cost"].value == pytest.approx([1.0])


def test_gains_of_a_varying_offset_are_constant(datum, tmp_path):
    """Steady gains are exported where only what is known of the measurements varies, and it is exported with them."""
    filtering.export_gains(*datum[0], tmp_path / "gains.npz")
    found = np.load(tmp_path / "gains.npz")
    assert found["K"].shape == (1, 1)
    assert found["measurement_offset"].ravel() == pytest.approx(datum[2])


@pytest.mark.parametrize(
    ("cells", "kind"),
    [
        (["1717156800123456789", "", "1717156800123456790"], "Int64"),
        (["1", "2", "3"], "int64"),
        (["0.5", "", "1e-09"], "float64"),
        (["1.0", "2.5", "-0.0"], "float64"),
        (["", "", ""], "float64"),
        (["001", "002", "010"], "text"),
        (["1", "02", ""], "text"),
        (["0.10", "0.20", "0.30"], "text"),
        (["1_000", "2", "3"], "text"),
        (["99999999999999999999", "1", ""], "text"),
        (["9007199254740993", "0.5", ""], "text"),
        (["2024-05-31", "", "x"], "text"),
    ],
)
def test_a_column_of_parquet_loses_nothing_of_its_cells(cells, kind):
    """Whole numbers with all digits, also beside an empty cell; what a number would write otherwise stays text."""
    table = "k,c\n" + "".join(f"{k},{cell}\n" for k, cell in enumerate(cells))
    found = pd.read_parquet(io.BytesIO(tables.parquet(table.encode())))["c"]
    assert str(found.dtype) == kind or (kind == "text" and found.tolist() == cells)
    if kind == "Int64":
        assert [None if value is pd.NA else int(value) for value in found] == [int(cell) if cell else None for cell in cells]


def test_a_row_at_t0_stands_in_the_table_too():
    """A first row in which nothing is measured is t0: it has the initial estimate, and no row of the file lacks."""
    rows = rows_of(filtering.study(modelfile.loads(LEVEL), record(["0,", "1,11", "2.5,12"], "t,gauge")))
    assert tuple(rows[0][name] for name in ("k", "t", "level")) == ("0", "0.0", "10.0")
    assert [row["t"] for row in rows] == ["0.0", "1.0", "2.5"]
    assert [row["innovation_gauge"] == "" for row in rows] == [True, False, False]


def test_instants_between_the_rows_of_a_grid_stand_in_the_table():
    """A discrete model's record with a row left out: a row of the table for every instant."""
    text = LEVEL.replace("continuous", "discrete").replace("F = [[0]]\nG = [[1]]\nQ", "Phi = [[1]]\nQd")
    rows = rows_of(filtering.study(modelfile.loads(text), record(["1,11", "2,12", "4,11", "5,10"], "t,gauge")))
    assert [row["t"] for row in rows] == ["1.0", "2.0", "3.0", "4.0", "5.0"]
    assert rows[2]["innovation_gauge"] == ""
