"""Records that tell more than measurements: regressors, known inputs, rows left out, several records of one model."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ctlabs import DiscreteModel, cli, diagnose, fit, forecast, kalman_filter, smooth
from ctlabs.files import clock, datafile, look, modelfile, read_records, reading
from ctlabs.files.mapping import Mapping
from ctlabs.filtering import log_likelihood
from ctlabs.reporting import render
from ctlabs.studies import analysis, comparison, filtered, filtering, fitting, forecasting, several, simulation
from tests import reference
from tests.reference import EXACT, PNG, close

DEMAND = """format = 1
kind = "discrete"
[constants]
q = 0.01
r = { value = 0.04, min = 0 }
bias = 0.3
[model]
states = ["base", "slope"]
measurements = ["demand", "stock"]
Phi = [[1, 0], [0, 0.9]]
Qd = [["q", 0], [0, "q/4"]]
H = [[1, "price"], ["0.5*price^2", 1]]
R = [["r*(1 + hdop^2)", "r/10*hdop"], ["r/10*hdop", "r"]]
D = [["gain"], [0]]
measurement_offset = [0, "bias*price"]
B = [[0], [0.2]]
P0 = [[10, 1], [1, 5]]
dt = 1
[experiment]
first = FIRST
[data]
inputs = ["push"]
regressors = { price = "Price", hdop = "hdop", gain = "gain" }
"""


def table(rows: int, seed: int) -> tuple[dict[str, np.ndarray], str]:
    """Columns of a record, and the table that holds them."""
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(rows, 2))
    z[rng.random((rows, 2)) < 0.2] = np.nan
    z[rows // 2, 0] = 1.0
    columns = {"demand": z[:, 0], "stock": z[:, 1]}
    columns |= {name: rng.normal(size=rows) for name in ("Price", "hdop", "gain", "push")}
    lines = [",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    return columns, "\n".join([",".join(columns), *lines]) + "\n"


def demand(first: int, u0: float | None = None) -> modelfile.ModelFile:
    """The model file; with ``u0`` in its table [data]."""
    return modelfile.loads(DEMAND.replace("FIRST", str(first)) + ("" if u0 is None else f"u0 = [{u0}]\n"))


def plain(columns: dict[str, np.ndarray], first: int) -> tuple[DiscreteModel, dict[str, np.ndarray]]:
    """The library's model and its arguments, written out."""
    price, hdop = columns["Price"], columns["hdop"]
    one = np.ones(len(price))
    H = np.array([[one, price], [0.5 * price**2, one]]).transpose(2, 0, 1)
    R = 0.04 * np.array([[1 + hdop**2, hdop / 10], [hdop / 10, one]]).transpose(2, 0, 1)
    z = np.column_stack([columns["demand"] - columns["gain"] * columns["push"], columns["stock"] - 0.3 * price])
    start = {"P0": [[10, 1], [1, 5]], "B": [[0], [0.2]], "first": first}
    model = DiscreteModel([[1, 0], [0, 0.9]], [[0.01, 0], [0, 0.0025]], H[0], R[0], **start)
    return model, {"z": z, "H": H, "R": R, "u": columns["push"][:, None]}


class TestRegressors:
    @given(st.integers(2, 9), st.integers(0, 2**20), st.sampled_from([0, 1]))
    def test_columns_are_the_matrices_of_the_library(self, rows, seed, first):
        """H, R, D, B and the offset by rows: kalman_filter with arrays, and all states given all data at once."""
        columns, text = table(rows, seed)
        file = demand(first, 0.7 if first else None)
        record = datafile.parse(text.encode(), file.measurements, mapping=file.mapping)
        model, z, _t = clock.timed(file, record)
        found = kalman_filter(model, z[first:], first=first)
        library, arguments = plain(columns, first)
        wanted = kalman_filter(library, **arguments, **({"u0": [0.7]} if first else {}))
        assert close(found.x_plus, wanted.x_plus, EXACT, 1.0)
        assert close(found.P_plus, wanted.P_plus, EXACT)
        assert found.log_likelihood == pytest.approx(wanted.log_likelihood, rel=1e-12, abs=1e-12)
        dense = reference.conditioned(wanted.model, np.concatenate([np.full((first, 2), np.nan), wanted.z[first:]]), first)
        assert close(found.x_plus, dense.x_plus, 1e-9, 1.0)
        assert close(found.P_plus, dense.P_plus, 1e-9)

    def test_the_likelihood_of_a_constant_beside_a_column(self):
        """A bias is taken off what is measured anew for each of its values."""
        columns, text = table(12, 3)
        file = demand(0)
        record = datafile.parse(text.encode(), file.measurements, mapping=file.mapping)
        for bias in (0.3, -1.0):
            model, z, _t = clock.timed(file.replace({"bias": bias}), record)
            library, arguments = plain(columns, 0)
            arguments["z"][:, 1] += (0.3 - bias) * columns["Price"]
            assert log_likelihood(model, z, 0) == pytest.approx(kalman_filter(library, **arguments).log_likelihood, rel=1e-12)

    def test_many_rows_and_one_are_the_same(self):
        """A column at once, or element by element where t, a function or an infinite value stands beside it."""
        file = demand(0).edit(("model", "H", 0, 1), "max(price, price)").checked()
        _columns, text = table(7, 5)
        record = datafile.parse(text.encode(), file.measurements, mapping=file.mapping)
        np.testing.assert_array_equal(clock.timed(file, record)[0].H, clock.timed(demand(0), record)[0].H)

    @pytest.mark.parametrize("first", [0, 1])
    def test_a_measurement_whose_regressor_lacks_is_left_out_and_named(self, first):
        """As if it had not been measured; the other element of the row stays."""
        columns, text = table(8, 11)
        columns["demand"][4] = columns["stock"][4] = 0.5
        lines = text.splitlines()
        lines[5] = f"0.5,0.5,{float(columns['Price'][4])!r},{float(columns['hdop'][4])!r},,{float(columns['push'][4])!r}"
        file = demand(first, 0.7 if first else None)
        record = datafile.parse("\n".join(lines).encode(), file.measurements, mapping=file.mapping)
        model, z, _t = clock.timed(file, record)
        found = kalman_filter(model, z[first:], first=first)
        columns["demand"][4], columns["gain"][4] = np.nan, 0.0
        library, arguments = plain(columns, first)
        wanted = kalman_filter(library, **arguments, **({"u0": [0.7]} if first else {}))
        assert close(found.x_plus, wanted.x_plus, EXACT, 1.0)
        assert found.log_likelihood == pytest.approx(wanted.log_likelihood, rel=1e-12)
        assert clock.notes(file, record, clock.over(file, record)) == ["demand in line 6 is left out: a regressor beside it has no value"]
        assert np.isfinite(smooth(model, found).x).all()
        assert diagnose(model, z[first:], first=first).nis_p > 0

    def test_verbs_without_a_record_name_the_regressor(self):
        """And say what to do."""
        file = demand(0)
        said = r'model\.(H\[0\]\[1\]|R\[0\]\[0\]): expected a record with "(price|hdop)".*filter, fit and forecast.*\[constants\]'
        for verb in (analysis.study, simulation.study, comparison.study):
            arguments = {comparison.study: (file, None)}.get(verb, (file,))
            with pytest.raises(ValueError, match=said):
                verb(*arguments)
        with pytest.raises(ValueError, match=r"expected the regressor price, received none; --regressor price=COLUMN"):
            clock.timed(file, datafile.parse(b"demand,stock,push\n1,2,3\n4,5,6\n", file.measurements, mapping=Mapping(inputs=("push",))))

    def test_a_constant_stands_in_for_a_column(self):
        """Without a record, and with one that has none; with a column it has no effect, and cannot be fitted."""
        file = modelfile.loads(TVP.replace('"x"', '"price"').replace("x =", "price =")).edit(("constants", "price"), 3.0).checked()
        alone = file.edit(("data", "regressors"), {}).checked()
        assert (file.varying, file.regressors) == ((), ("price",))
        assert np.array_equal(file.discrete().H, [[1, 3]])
        assert analysis.study(file).values == analysis.study(alone).values
        table = b"y,x\n1,1\n2,5\n4,2\n"
        column, none = (
            reading.parsed([(table, "data")], file, Mapping(regressors={"price": told}))[0] for told in ("x", "none")
        )
        H = [clock.timed(file.replace({"price": value}), column)[0].H for value in (3.0, 7.0)]
        assert np.array_equal(H[0][1:], [[[1, 1]], [[1, 5]], [[1, 2]]])
        assert np.array_equal(H[0], H[1])
        assert clock.notes(file, column, clock.over(file, column)) == ["price is the record's (x), in place of the constant"]
        assert np.array_equal(clock.timed(file, none)[0].H, [[1, 3]])
        assert clock.notes(file, none, clock.over(file, none)) == ["price is the constant 3, as the record has no such column"]
        with pytest.raises(ValueError, match=r"expected the column price, received .y.; --regressor price=none"):
            reading.parsed([(b"y\n1\n2\n", "data")], file, Mapping(regressors={"price": "price"}))
        with pytest.raises(ValueError, match=r"--free price: expected a constant, .*; --regressor price=none leaves it to the constant"):
            fitting.study(file, column, ["price"])

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ((("model", "Phi", 0, 0), "price"), r"Phi\[0\]\[0\]: unknown name .price.*may stand in H, R, D, measurement_offset and B"),
            ((("model", "H", 0, 1), "prices"), r"H\[0\]\[1\]: unknown name .prices.; did you mean"),
            ((("model", "H", 0, 1), "volume"), r"H\[0\]\[1\]: unknown name .volume.*regressors = \{ volume = .COLUMN. \} under \[data\]"),
            ((("data", "regressors", "q"), "Price"), r"regressors.q: expected a name of its own, .* q, which model.Qd\[0\]\[0\] needs too"),
            ((("data", "regressors", "t"), "Price"), r"regressors.*expected a name of its own"),
        ],
    )
    def test_names_that_do_not_fit_are_refused_with_their_place(self, change, message):
        """Where a regressor may stand, and how it is declared."""
        with pytest.raises(ValueError, match=message):
            demand(0).edit(*change).checked()

    @pytest.mark.parametrize(
        ("cell", "price", "message"),
        [
            ("1/price", "0", r"data: line 3: column 2: division by zero"),
            ("sqrt(price)", "-1", r"data: line 3: .*sqrt\(-1\)"),
        ],
    )
    def test_a_row_without_a_value_is_named(self, cell, price, message):
        """By its line."""
        file = modelfile.loads(TVP).edit(("model", "H", 0, 1), cell)
        record = datafile.parse(f"y,x\n1,1\n2,{price}\n".encode(), ["y"], mapping=Mapping(regressors={"price": "x"}))
        with pytest.raises(ValueError, match=message):
            clock.timed(file.declaring({"price": "x"}), record)

    def test_a_row_without_a_covariance_is_named(self):
        """R < 0 by a column."""
        file = modelfile.loads(TVP).edit(("model", "R", 0, 0), "x")
        record = datafile.parse(b"y,x\n1,1\n2,-1\n", ["y"], mapping=Mapping(regressors={"x": "x"}))
        with pytest.raises(ValueError, match=r"model\.R: data: line 3: expected variances >= 0 on the diagonal, received -1"):
            clock.timed(file, record)

    def test_the_forecast_needs_rows_to_come(self):
        """Their regressors and inputs stand below the record; the library's forecast with H and R of them."""
        columns, text = table(9, 8)
        columns["demand"][6:] = columns["stock"][6:] = np.nan
        lines = [",".join(["", "", *row.split(",")[2:]]) if i > 6 else row for i, row in enumerate(text.splitlines())]
        file = demand(0)
        record = datafile.parse("\n".join(lines).encode(), file.measurements, mapping=file.mapping)
        last = int(np.flatnonzero(~np.isnan(record.z).all(axis=1))[-1])
        report = forecasting.study(file, record)
        model, arguments = plain(columns, 0)
        found = kalman_filter(model, **arguments)
        assert report.passed
        assert np.allclose(report.values["state_end"].value, found.x_minus[-1])
        rows = report.files["forecast.csv"].decode().splitlines()
        assert len(rows) == 1 + 8 - last
        z = arguments["H"][-1] @ found.x_minus[-1] + [columns["gain"][-1] * columns["push"][-1], 0.3 * columns["Price"][-1]]
        told = dict(zip(rows[0].split(","), map(float, rows[-1].split(",")), strict=True))
        assert np.allclose([told["demand"], told["stock"]], z)
        with pytest.raises(ValueError, match=rf"rows below the last measurement .*received {8 - last} such rows: write 12 below it"):
            forecasting.study(file, record, 12)
        short = datafile.parse(text.encode(), file.measurements, mapping=file.mapping)
        whole = dataclasses.replace(short, z=np.ones_like(short.z))
        with pytest.raises(ValueError, match=r"measurement \(line 10\) with push, price, hdop, gain of the time to come, received none"):
            forecasting.study(file, whole)
        lines[-1] = ",,,1,1,1"
        with pytest.raises(ValueError, match=r"expected price, hdop, gain at every instant to come, received none at t = 8"):
            forecasting.study(file, datafile.parse("\n".join(lines).encode(), file.measurements, mapping=file.mapping))


TVP = """format = 1
kind = "discrete"
[constants]
q = 0.01
r = { value = 1, min = 0 }
[model]
states = ["a", "b"]
measurements = ["y"]
Phi = [[1, 0], [0, 1]]
Qd = [["q", 0], [0, "q"]]
H = [[1, "x"]]
R = [["r"]]
P0 = [["inf", 0], [0, "inf"]]
dt = 1
[data]
regressors = { x = "x" }
"""


def regression(seed: int, rows: int = 40) -> bytes:
    """A record of y = 2 + 3x + v."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=rows)
    y = 2 + 3 * x + 0.5 * rng.normal(size=rows)
    return ("y,x\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(y.tolist(), x.tolist(), strict=True))).encode()


def test_least_squares_is_a_filter_that_knows_nothing():
    """With q = 0 and inf in P0 the last estimate is that of numpy's least squares."""
    file = modelfile.loads(TVP).replace({"q": 0})
    record = datafile.parse(regression(1), ["y"], mapping=file.mapping)
    model, z, _t = clock.timed(file, record)
    found = kalman_filter(model, z[1:])
    A = np.column_stack([np.ones(record.rows), record.regressors["x"]])
    assert close(found.x_plus[-1], np.linalg.lstsq(A, record.z[:, 0], rcond=None)[0], 1e-10)
    assert close(found.P_plus[-1], np.linalg.inv(A.T @ A), 1e-10)


class TestInputs:
    GYRO = """format = 1
kind = "continuous"
[model]
states = ["angle", "bias"]
measurements = ["compass"]
F = [[0, -1], [0, 0]]
B = [[1], [0]]
u = [0.001]
G = [[1, 0], [0, 1]]
Q = [[1e-4, 0], [0, 1e-6]]
H = [[1, 0]]
R = [[0.01]]
P0 = [[1, 0], [0, 0.01]]
dt = 1
"""

    @pytest.mark.parametrize("text", [b"t,compass,gyro\n0,,0.5\n0.5,1,0.2\n2,1.5,0.1\n", b"t,compass,gyro\n0.5,1,0.2\n2,1.5,0.1\n"])
    def test_a_gyros_reading_drives_the_angle(self, text):
        """In place of the file's u; from t0 on by a row at t0 or by u0."""
        file = modelfile.loads(self.GYRO)
        u0 = () if b"\n0,," in text else (0.5,)
        record = datafile.parse(text, ["compass"], mapping=Mapping(inputs=("gyro",), u0=u0))
        model, z, t = clock.timed(file, record)
        np.testing.assert_allclose(model.offset, [[0.25, 0], [0.3, 0]], atol=1e-15)
        np.testing.assert_array_equal(t, [0, 0.5, 2])
        wanted = kalman_filter(
            dataclasses.replace(file.continuous()), [[1.0], [1.5]], t=[0.5, 2], R=[[0.01]], u=[[0.2], [0.1]], u0=[0.5]
        )
        assert close(kalman_filter(model, z[1:], first=1).x_plus, wanted.x_plus, EXACT, 1.0)
        assert "in place of u" in clock.notes(file, record, clock.over(file, record))[0]

    def test_the_input_before_the_first_row_is_asked_for(self):
        """And refused where nothing asks for it."""
        file = modelfile.loads(self.GYRO)
        text = b"t,compass,gyro\n0.5,1,0.2\n2,1.5,0.1\n"
        with pytest.raises(ValueError, match=r"none from t0 to the first row \(first = 1\): --u0 VALUE"):
            clock.timed(file, datafile.parse(text, ["compass"], mapping=Mapping(inputs=("gyro",))))
        text = b"t,compass,gyro\n0,,0.5\n0.5,1,0.2\n2,1.5,0.1\n"
        with pytest.raises(ValueError, match=r"--u0: expected none \(the first row is at t0\), received 0.5"):
            clock.timed(file, datafile.parse(text, ["compass"], mapping=Mapping(inputs=("gyro",), u0=(0.5,))))
        with pytest.raises(ValueError, match=r"--u0: expected 1 numbers, one for each input, received 2"):
            Mapping(inputs=("gyro",), u0=(0.5, 1.0))

    def test_an_input_is_held_where_rows_are_left_out(self):
        """A discrete model at t = 0, 1, 3: the row of 1 acts twice."""
        text = 'format = 1\nkind = "discrete"\n[model]\nPhi = [[0.5]]\nB = [[2]]\nQd = [[1]]\nH = [[1]]\nR = [[1]]\nP0 = [[1]]\ndt = 1\n'
        file = modelfile.loads(text + "[experiment]\nfirst = 0\n")
        record = datafile.parse(b"t,z1,u\n0,1,5\n1,2,6\n3,3,7\n", ["z1"], mapping=Mapping(inputs=("u",)))
        model, z, t = clock.timed(file, record)
        np.testing.assert_array_equal(model.offset[:, 0], [10, 12, 12])
        np.testing.assert_array_equal(np.isnan(z[:, 0]), [False, False, True, False])
        np.testing.assert_array_equal(t, [0, 1, 2, 3])
        assert clock.notes(file, record, clock.over(file, record)) == ["1 instant of the model's grid without a row: not measured there"]


class TestSeveral:
    @given(st.lists(st.integers(1, 6), min_size=2, max_size=4), st.integers(0, 2**20))
    def test_a_column_names_the_records(self, sizes, seed):
        """Rows in any order of records; each has its own times, and is what it would be in a file of its own."""
        rng = np.random.default_rng(seed)
        names = [f"run {i}" for i in range(len(sizes))]
        order = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
        t, lines, own = [0.0] * len(sizes), [], {name: ["t,y"] for name in names}
        for i in order:
            t[i] += float(rng.integers(1, 4))
            row = f"{t[i]},{rng.integers(0, 99)}"
            lines.append(f"{names[i]},{row}")
            own[names[i]].append(row)
        found = reading.parsed([("\n".join(["who,t,y", *lines]).encode(), "all.csv")], ["y"], Mapping(record="who"))
        assert {record.name for record in found} == set(names)
        for record in found:
            alone = datafile.parse("\n".join(own[record.name]).encode(), ["y"])
            np.testing.assert_array_equal(record.z, alone.z)
            np.testing.assert_array_equal(record.t, alone.t)
            assert lines[record.lines[0] - 2].startswith(record.name)

    def test_two_files_are_named_after_themselves(self, tmp_path):
        """Also where their names are one, or one table has several records."""
        for name, text in {"a.csv": "y\n1\n", "b.csv": "y\n2\n"}.items():
            (tmp_path / name).write_text(text, encoding="utf-8")
        found = read_records([tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "a.csv"], ["y"])
        assert [record.name for record in found] == ["a", "b", "a (2)"]
        with pytest.raises(ValueError, match=r"all.csv: expected one record, received 2 \(A, B\): filter and fit take several"):
            datafile.parse(b"who,y\nA,1\nB,2\n", ["y"], "all.csv", Mapping(record="who"))

    @pytest.mark.parametrize(
        ("text", "told", "message"),
        [
            (b"who,y\nA,1\n,2\n", {"record": "who"}, "all.csv: line 3: expected the name of a record in every row"),
            (b"who,y\nA,1\n", {"record": "whom"}, r"--record-column whom: expected one of the columns .who., .y.*--record-column who"),
            (b"t,x,measured_x\n1,2,3\n", {}, "both .x. and .measured_x. may be x: .*--column x=measured_x or --column x=x"),
            (b"y,t,price\n1,1,2\n", {"regressors": {"p": "t"}}, "--regressor p: expected a column of numbers, received that of times"),
            (b"y,Price\n1,2\n", {"regressors": {"p": "price"}}, "expected the column price, received .y., .Price.; --regressor p=Price"),
        ],
    )
    def test_what_does_not_fit_is_refused(self, text, told, message):
        """With the option that helps."""
        names = ["x"] if b"measured_x" in text else ["y"]
        with pytest.raises(ValueError, match=message):
            datafile.parse(text, names, "all.csv", Mapping(**told))

    def test_two_records_in_one_fit_are_the_sum(self):
        """ℓ of both at the joint estimate is the sum of each; the estimate of r is theirs together."""
        file = modelfile.loads(TVP).replace({"q": 0}).checked()
        records = reading.parsed([(regression(seed, 30), f"{seed}.csv") for seed in (1, 2)], file, Mapping())
        builds = [lambda c, record=record: clock.timed(file.replace(c), record)[0] for record in records]
        data = [clock.timed(file, record)[1][1:] for record in records]
        found = fit(builds, data, {"r": 1.0}, {"r": (0, None)})
        alone = [log_likelihood(build(found.estimates), z) for build, z in zip(builds, data, strict=True)]
        assert found.log_likelihood_diffuse == pytest.approx(sum(alone), rel=1e-12)
        squares = []  # the residual sum of squares over its degrees of freedom makes the diffuse likelihood greatest
        for record in records:
            A = np.column_stack([np.ones(record.rows), record.regressors["x"]])
            squares.append(float(np.linalg.lstsq(A, record.z[:, 0], rcond=None)[1][0]))
        assert found.estimates["r"] == pytest.approx(sum(squares) / (2 * 28), rel=1e-5)
        report = fitting.study(file, records, ["r"])
        assert report.passed
        assert report.values["r"].value == pytest.approx(found.estimates["r"], rel=1e-6)

    def test_a_joint_verdict(self):
        """Each record has its row; together they speak for the model, or against it where one does."""
        file = modelfile.loads(TVP).replace({"q": 0, "r": 0.25})
        tables = [(regression(seed, 60), f"{seed}.csv") for seed in (1, 2, 3)]
        records = reading.parsed(tables, file, Mapping())
        report = several.study(file, records, smooth=True)
        assert report.values["verdict"].value == "consistent"
        alone = [kalman_filter(*(lambda m, z, _t: (m, z[1:]))(*clock.timed(file, record))).log_likelihood for record in records]
        assert report.values["log_likelihood"].value == pytest.approx(sum(alone), rel=1e-12)
        rows = report.files["estimates.csv"].decode().splitlines()
        assert rows[0].startswith("record,k,t,a,a_sd")
        assert [row.split(",")[0] for row in rows[1:]] == ["1"] * 60 + ["2"] * 60 + ["3"] * 60
        wrong = [*tables[:2], (tables[2][0].replace(b"\n1", b"\n9"), "3.csv")]
        report = several.study(file, reading.parsed(wrong, file, Mapping()))
        assert report.values["verdict"].value != "consistent"
        assert report.values["suggestion"].value.startswith("3: ")
        with pytest.raises(ValueError, match="--design: expected one record, received 3"):
            several.study(file, records, design=file)


TRACK = """format = 1
kind = "KIND"
[model]
states = ["x", "v"]
measurements = ["x"]
MOTION
H = [[1, 0]]
R = [[0.25]]
D = [[2]]
B = [[0], [1]]
u = ["0.1*k"]
measurement_offset = [5]
P0 = [[1, 0], [0, 1]]
dt = 0.5
[experiment]
first = FIRST
steps = 30
"""


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(
    ("kind", "motion"),
    [
        ("discrete", "Phi = [[1, 0.5], [0, 1]]\nQd = [[0.01, 0], [0, 0.02]]"),
        ("continuous", "F = [[0, 1], [0, 0]]\nG = [[0], [1]]\nQ = [[0.1]]"),
    ],
)
def test_simulated_runs_are_records(kind, motion, first):
    """runs.csv is known by its form: a record per run, measurements and not the states of their name, the first row at t0."""
    text = TRACK.replace("KIND", kind).replace("MOTION", motion).replace("FIRST", str(first))
    file = modelfile.loads(text)
    report = simulation.study(file, runs=60, csv_runs=2)
    records = reading.parsed([(report.files["runs.csv"], "runs.csv")], file, Mapping())
    one = reading.parsed([(report.files["data.csv"], "data.csv")], file, Mapping())[0]
    assert [record.name for record in records] == ["1", "2"]
    (model, z, t), (other, z1, t1) = clock.timed(file, records[0]), clock.timed(file, one)
    np.testing.assert_array_equal(z, z1)
    np.testing.assert_allclose(t, t1, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(model.H, other.H)
    found = [kalman_filter(m, rows[first:], first=first) for m, rows, _t in (clock.timed(file, record) for record in records)]
    truth = np.array([row.split(",") for row in report.files["runs.csv"].decode().splitlines()[1:]])[:, 3].astype(float).reshape(2, 31)
    error = np.array([(run.x_plus[:, 0] - x)[first:] / np.sqrt(run.P_plus[first:, 0, 0]) for run, x in zip(found, truth, strict=True)])
    assert 0.4 < np.sqrt((error**2).mean()) < 2  # an offset of 5 or an input left out is 10 σ
    nis = float(sum(np.nansum(run.nis) for run in found))
    assert 20 < nis < 120  # χ² with 60 or 62 degrees of freedom
    assert filtering.study(file, records[1]).passed


def test_a_column_that_is_the_models_clock_needs_no_word():
    """Whether it is taken or not, the numbers are the same; another one is refused with both options."""
    file = modelfile.loads(TVP)
    parsed = reading.parsed([(b"day,y,x\n1,2,3\n2,4,5\n", "d.csv")], file, Mapping())
    assert parsed[0].clock == "day"
    for text in (b"day,y,x\n2,2,3\n3,4,5\n", b"day,y,x\n1,2,3\n3,4,5\n", b"day,y,x\nMo,2,3\nTu,4,5\n"):
        with pytest.raises(ValueError, match=re.escape("--time day takes it, --time none does not")):
            reading.parsed([(text, "d.csv")], file, Mapping())


def test_a_forecast_of_the_library_adds_what_is_known():
    """D u and the offset of the instants to come."""
    model = DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]], D=[[2]], measurement_offset=[5], first=0)
    ahead = forecast(model, kalman_filter(model, [6.0, 7.0], u=[[0.0], [0.5]]), 2, u=[[0.5], [1.0], [2.0]])
    assert close(ahead.z[:, 0] - ahead.x[:, 0], [7, 9], EXACT)


def test_a_look_suggests_the_columns_that_the_model_names():
    """Also where case and unit differ."""
    told = Mapping(regressors={"price": "price", "hdop": "HDOP"}, record="run")
    found = look.survey(b"run,y,Price [EUR],HDOP\nA,1,2,3\nB,4,5,6\n", "d.csv", told, ["y"])
    assert 'regressors = { price = "Price [EUR]", hdop = "HDOP" }\nrecord = "run"' in found.data
    assert found.options == '--regressor price="Price [EUR]" --regressor hdop=HDOP --record-column run'


class TestWhatIsSaid:
    """What was done with a record is said by every command, with the record's name where there are several."""

    GAPPED = "t,demand,price\n" + "\n".join(f"{t},{8 - 0.1 * t:.1f},{'' if t == 4 else t % 3}" for t in (0, 1, 2, 4, 5, 6, 7, 8)) + "\n"
    MODEL = (
        'format = 1\ntitle = "Demand"\nkind = "discrete"\n[model]\nstates = ["base", "slope"]\nmeasurements = ["demand"]\n'
        'Phi = [[1, 0], [0, 1]]\nQd = [["q", 0], [0, 0.01]]\nH = [[1, "price"]]\nR = [["r"]]\nP0 = [[100, 0], [0, 100]]\ndt = 1\n'
        '[constants]\nq = 0.1\nr = 1\n[data]\nregressors = {price = "price"}\n[experiment]\nfirst = 0\n'
    )

    @pytest.fixture
    def file(self):
        return modelfile.loads(self.MODEL)

    @pytest.mark.parametrize("command", ["filter", "fit", "compare", "forecast"])
    def test_a_row_that_is_left_out_and_an_instant_without_one(self, command, file):
        """Two rows to come are below the record of the forecast."""
        text = self.GAPPED + ("9,,1\n10,,2\n" if command == "forecast" else "")
        record = datafile.parse(text.encode(), ["demand"], "sales.csv", file.mapping)
        report = {
            "filter": lambda: filtering.study(file, record),
            "fit": lambda: fitting.study(file, record, ["r"]),
            "compare": lambda: comparison.study(file, record, algorithms="joseph"),
            "forecast": lambda: forecasting.study(file, record, 2),
        }[command]()
        said = report.values["notes"].value
        assert said.split("; ") == [
            "1 instant of the model's grid without a row: not measured there",
            "demand in line 5 is left out: a regressor beside it has no value",
        ]
        assert sum("demand in line 5" in getattr(block, "text", "") for block in report.blocks) == 1

    def test_of_several_records_whose_it_is(self, file, monkeypatch):
        """Notes and events have the name of their record before them; each record is diagnosed once."""
        rng = np.random.default_rng(5)
        tables = []
        for name in ("a", "b"):
            z = 5 + rng.normal(size=60)
            z[30] = 60.0 if name == "b" else z[30]
            rows = "\n".join(f"{t},{v:.4f},{t % 3 if t != 4 else ''}" for t, v in enumerate(z))
            tables.append((f"t,demand,price\n{rows}\n".encode(), f"{name}.csv"))
        asked = []
        own = filtered.diagnosis.diagnose
        monkeypatch.setattr(filtered.diagnosis, "diagnose", lambda *args, **more: asked.append(1) or own(*args, **more))
        report = several.study(file.replace({"q": 0}), reading.parsed(tables, file, Mapping()))
        assert len(asked) == 2
        assert report.values["notes"].value.startswith("a: demand in line 6 is left out")
        assert "; b: demand in line 6" in report.values["notes"].value
        (events,) = (block for block in report.blocks if getattr(block, "name", "") == "events" and hasattr(block, "rows"))
        assert [row[:2] for row in events.rows] == [("b", 32)]
        assert events.rows[0][5] == 60.0
        assert report.values["events"].value == 1


class TestCalendar:
    """Dates on the grid of a model in discrete time whose period is another one than that of the rows."""

    MODEL = (
        'format = 1\nkind = "discrete"\n[model]\nPhi = [[1]]\nQd = [[1]]\nH = [[1]]\nR = [[1]]\nP0 = [[9]]\ndt = 1\n'
        "[experiment]\nfirst = 0\n"
    )

    @staticmethod
    def record(stamps, unit, **told):
        rows = "\n".join(f"{stamp},{i}.5" for i, stamp in enumerate(stamps))
        return datafile.parse(f"at,z1\n{rows}\n".encode(), ["z1"], "log.csv", Mapping(time="at", unit=unit, t0="first", **told))

    @pytest.mark.parametrize(
        ("stamps", "unit", "apart"),
        [([f"2024-05-{i:02d}" for i in (1, 2, 4)], "iso", 86400), ([f"{45000 + i / 4}" for i in range(3)], "excel", 21600)],
    )
    def test_days_are_no_seconds(self, stamps, unit, apart):
        """Every row thousands of periods after the one before: refused with the period, or another reading, to set."""
        with pytest.raises(ValueError, match=rf"no two rows are less than {apart} periods .* --dt {apart} .*--time none .*--dt 1 "):
            clock.timed(modelfile.loads(self.MODEL), self.record(stamps, unit))
        model = modelfile.loads(self.MODEL.replace("dt = 1", f"dt = {apart}"))
        assert len(clock.timed(model, self.record(stamps, unit))[2]) == (4 if unit == "iso" else 3)

    def test_a_unit_of_seconds_is_meant(self):
        """Who says in which unit the times are has told how far apart they are."""
        model = modelfile.loads(self.MODEL)
        record = datafile.parse(b"at,z1\n0,1\n2,1.5\n4,1\n", ["z1"], mapping=Mapping(time="at", unit="h", t0="first"))
        assert len(clock.timed(model, record)[2]) == 4 * 3600 + 1

    def test_some_periods_apart_is_said(self):
        """Every ten seconds at dt = 1: refused as every interval is that has two readings; with --dt 1 filtered, and told."""
        model, stamps = modelfile.loads(self.MODEL), [f"2024-05-31T12:00:{s:02d}" for s in (0, 10, 20)]
        with pytest.raises(ValueError, match=r"no two rows are less than 10 periods .* --dt 10 .*--time none .*--dt 1 leaves the period"):
            clock.over(model, self.record(stamps, "iso"))
        record = self.record(stamps, "iso", dt=1.0)
        (note,) = clock.notes(model, record, clock.over(model, record))
        assert note.startswith("18 instants of the model's grid without a row")
        assert note.endswith("(no two rows are less than 10 periods apart; --time none: they are one apart)")


def test_days_are_the_periods_of_a_discrete_model_when_it_is_told(tmp_path, monkeypatch, capsys):
    """A file of days and a model of dt = 1: refused with --dt 86400, with which the command runs, and leaves an instant for a lost day."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "png", lambda _figure: PNG)
    (tmp_path / "d.csv").write_text("date,flow\n2021-01-01,900\n2021-01-02,950\n2021-01-04,870\n2021-01-05,930\n", encoding="utf-8")
    words = ["filter", "local_level", "d.csv", "--time", "date:iso", "--t0", "first", "--out", "out"]
    with pytest.raises(SystemExit):
        cli.main(words)
    told = re.search(r"expected a choice, (--dt \d+) makes it that, --time none", capsys.readouterr().err)
    with pytest.raises(SystemExit) as end:
        cli.main([*words, *told[1].split()])
    assert end.value.code == 0
    assert "1 instant of the model's grid without a row" in capsys.readouterr().out
