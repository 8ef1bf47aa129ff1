"""Records through the front door: workbooks and columnar files, the table [data], known inputs, a look."""

from __future__ import annotations

import gzip
import json
import re

import numpy as np
import pandas as pd
import pytest

from ctlabs import DiscreteModel, kalman_filter, read_model, read_record
from ctlabs.files import clock, datafile, look, modelfile
from ctlabs.files.mapping import Mapping
from ctlabs.reporting import render
from tests.cli.test_cli import Console
from tests.reference import PNG

MODEL = """format = 1
kind = "continuous"
[model]
states = ["x"]
measurements = ["position"]
F = [[0]]
G = [[1]]
Q = [[0.5]]
H = [[1]]
R = [[4]]
P0 = [[100]]
dt = 1
"""
DATA = """[data]
columns = { position = "pos [mm]", t = "stamp" }
time_unit = "unix_ms"
t0 = "first"
missing = [-9999, "bad"]
scale = { position = 0.001 }
"""
LOG = "stamp;pos [mm];temp\n1717156800000;1500;20\n1717156801000;-9999;21\n1717156803000;bad;21\n1717156804000;3500;\n"


@pytest.fixture
def ctlabs(capsys, tmp_path, monkeypatch) -> Console:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "png", lambda _figure: PNG)
    return Console(capsys)


def test_the_models_own_table_says_how_a_record_is_read(tmp_path):
    """[data] once for all; the call may say more."""
    (tmp_path / "m.toml").write_text(MODEL + DATA, encoding="utf-8")
    (tmp_path / "log.csv").write_text(LOG, encoding="utf-8")
    model = read_model(tmp_path / "m.toml")
    record = read_record(tmp_path / "log.csv", model)
    np.testing.assert_array_equal(record.t, [1, 2, 4, 5])
    np.testing.assert_array_equal(record.z[:, 0], [1.5, np.nan, np.nan, 3.5])
    assert record.ignored == ("temp",)
    other = read_record(tmp_path / "log.csv", model, columns={"position": "temp"}, scale={"position": 1})
    np.testing.assert_array_equal(other.z[:, 0], [20, 21, 21, np.nan])


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("decimal = ';'", r'data: decimal: expected \. or ,, received ";"'),
        ("scale = { position = 0 }", r"data: scale position: expected a finite factor other than 0, received 0\.0"),
        ("time_unit = 'weeks'", r'data: time COLUMN:UNIT: expected s, .*, received "weeks"'),
        ("colums = {}", r'data: unknown key "colums"; did you mean "columns"\?'),
        ("skip = -1", r"data\.skip: expected a whole number from 0 to .*, received -1"),
        ("missing = [true]", r"data\.missing\[0\]: expected a text in quotes or a number, received true"),
        ("missing = '-9999'", r'data\.missing: expected a list of texts in quotes, received "-9999"'),
    ],
)
def test_a_wrong_table_is_refused_with_its_place(line, said):
    """As everything in a model file is."""
    problems = modelfile.loads(MODEL + "[data]\n" + line + "\n", check=False).problems()
    assert len(problems) == 1
    assert re.fullmatch(said, str(problems[0])), problems[0]


@pytest.mark.parametrize("kind", ["xlsx", "parquet", "feather", "csv.gz"])
def test_other_formats_hold_the_same_record(tmp_path, kind):
    """Cells are taken as they are; dates are ISO dates."""
    frame = pd.DataFrame(
        {
            "when": pd.date_range("2024-05-31 12:00:00", periods=3, freq="2s"),
            "position": [1.5, None, 0.25],
            "n": [1, 2, 3],
        }
    )
    path = tmp_path / f"log.{kind}"
    match kind:
        case "xlsx":
            frame.to_excel(path, index=False)
        case "parquet":
            frame.to_parquet(path)
        case "feather":
            frame.to_feather(path)
        case _:
            path.write_bytes(gzip.compress(frame.to_csv(index=False).encode()))
    record = read_record(path, ["position"], time="when", unit="iso", t0="first")
    np.testing.assert_array_equal(record.t, [0, 2, 4])
    np.testing.assert_array_equal(record.z[:, 0], [1.5, np.nan, 0.25])


def test_a_workbook_of_several_sheets(tmp_path):
    """One sheet with data is taken; of several the one that is named, and the refusal names them."""
    path = tmp_path / "log.xlsx"
    with pd.ExcelWriter(path) as book:
        pd.DataFrame({"position": [1.5, 2.5]}).to_excel(book, sheet_name="Run 1", index=False)
        pd.DataFrame({"position": [3.5]}).to_excel(book, sheet_name="Run2", index=False)
        pd.DataFrame().to_excel(book, sheet_name="Empty")
    assert read_record(path, ["position"], sheet="Run 1").z.ravel().tolist() == [1.5, 2.5]
    assert read_record(path, ["position"], sheet="Run2").z.ravel().tolist() == [3.5]
    for told, received in (({}, "2 sheets that hold data"), ({"sheet": "run2"}, '"run2"')):
        with pytest.raises(ValueError, match=rf'received {received}; --sheet "Run 1" or --sheet Run2$'):
            read_record(path, ["position"], **told)
    (tmp_path / "log.csv").write_text("position\n1\n", encoding="utf-8")
    with pytest.raises(ValueError, match="--sheet Run2: expected an Excel workbook, received a text file; leave --sheet out"):
        read_record(tmp_path / "log.csv", ["position"], sheet="Run2")


@pytest.mark.parametrize(
    ("text", "cure"),
    [
        (",date,station,flow rate [l/s]\n0,2020-01-01,Aswan,1.5\n1,2020-01-02,Aswan,2.5\n2,2020-01-03,Aswan,2\n",
         '--column z="flow rate [l/s]" --time date:iso --t0 first'),
        ("n;site;depth;stamp\n7;A;1.025,5;1717156800\n8;B;963,1;1717156810\n9;C;NA;1717156820\n",
         "--column z=depth --time stamp:unix --t0 first"),
        ("time,a,b\n0,1.5,2\n1,2.5,4\n", "--column z=COLUMN --time time"),
        ("date,a\n05/06/2024,1.5\n06/06/2024,2.5\n", "--column z=a --time date"),
    ],
)  # fmt: skip
def test_the_only_column_of_measurements_is_named(tmp_path, text, cure):
    """Words, counted rows and times are none; the unit of times is told where their looks leave no doubt."""
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(cure) + "$"):
        read_record(tmp_path / "log.csv", ["z"])


def test_inputs_of_a_record_drive_the_model(tmp_path, ctlabs):
    """The numbers of kalman_filter with u; each row's input acts until the next row; fit and filter take them alike."""
    text = 'format = 1\nkind = "discrete"\n[constants]\nb = 0.5\n[model]\nstates = ["x"]\nmeasurements = ["z"]\n'
    text += 'Phi = [[0.9]]\nB = [["b"]]\n'
    text += "Qd = [[0.01]]\nH = [[1]]\nR = [[0.04]]\nP0 = [[1]]\ndt = 1\n[experiment]\nfirst = 0\n"
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    z, u = [0.1, 0.6, None, 1.4, 1.2], [1.0, 2.0, 0.5, -1.0, 3.0]
    (tmp_path / "d.csv").write_text(
        "z,throttle\n" + "".join(f"{'' if a is None else a},{b}\n" for a, b in zip(z, u, strict=True)), encoding="utf-8"
    )
    model = read_model(tmp_path / "m.toml")
    record = read_record(tmp_path / "d.csv", model, inputs=("throttle",))
    discrete, rows, _ = clock.timed(model, record)
    plain = DiscreteModel([[0.9]], [[0.01]], [[1]], [[0.04]], P0=[[1]], dt=1, B=[[0.5]], first=0)
    wanted = kalman_filter(plain, np.array(z, dtype=float)[:, None], u=np.array(u)[:, None])
    found = kalman_filter(discrete, rows, first=0)
    np.testing.assert_allclose(found.x_plus, wanted.x_plus, rtol=1e-12)
    np.testing.assert_allclose(found.log_likelihood, wanted.log_likelihood, rtol=1e-12)
    assert ctlabs("filter", "m.toml", "d.csv", "--input", "throttle") == 0
    assert ctlabs("filter", "m.toml", "d.csv") == 2
    assert "--input" in ctlabs.err
    (tmp_path / "m1.toml").write_text(text.replace("first = 0", "first = 1"), encoding="utf-8")
    assert ctlabs("filter", "m1.toml", "d.csv", "--input", "throttle") == 2
    assert "first = 0" in ctlabs.err


def test_inputs_are_held_over_the_intervals_of_a_continuous_model(tmp_path):
    """At uneven times: the integral of the input that each row begins."""
    text = MODEL.replace("G = [[1]]", "G = [[1]]\nB = [[2]]") + "[experiment]\nfirst = 0\n"
    model = modelfile.loads(text)
    record = datafile.parse(b"t,position,u\n0,1,3\n0.5,2,-1\n2,2,9\n", ["position"], "d.csv", Mapping(inputs=("u",)))
    discrete, _, _ = clock.timed(model, record)
    np.testing.assert_allclose(discrete.offset[:, 0], [2 * 3 * 0.5, 2 * -1 * 1.5])


class TestLook:
    def test_it_suggests_the_table_by_which_the_model_reads(self, tmp_path, ctlabs):
        """Types, ranges, gaps, suspicious values; what it suggests can be pasted into the model file."""
        (tmp_path / "m.toml").write_text(MODEL, encoding="utf-8")
        (tmp_path / "log.csv").write_text(
            LOG.replace("bad", "2500").replace("pos [mm]", "Position [mm]"), encoding="utf-8"
        )
        assert ctlabs("look", "log.csv", "m.toml") == 0
        data = ctlabs.out[ctlabs.out.index("[data]") :]
        assert 't = "stamp"' in data
        assert 'missing = ["-9999"]' in data
        assert "1 gap" in ctlabs.out
        assert {"report.html", "results.json"} <= {path.name for path in (tmp_path / "look_log").iterdir()}
        (tmp_path / "m2.toml").write_text(MODEL + data, encoding="utf-8")
        record = read_record(tmp_path / "log.csv", read_model(tmp_path / "m2.toml"))
        np.testing.assert_array_equal(record.t, [1, 2, 4, 5])
        np.testing.assert_array_equal(record.z[:, 0], [1500, np.nan, 2500, 3500])

    def test_it_sees_what_has_two_readings(self, tmp_path, ctlabs):
        """And says what a reading would need, without a model."""
        (tmp_path / "flow.csv").write_text(
            'year,flow,remark\n1871,"1,120",ok\n1872,963,\n1873,"1,160",x y\n', encoding="utf-8"
        )
        assert ctlabs("look", "flow.csv", "--json") == 0
        values = json.loads(ctlabs.out)["values"]
        assert "may be 1120 or 1.12" in values["remarks"]["value"]
        assert values["clock"]["value"] == "year"

    def test_what_is_no_table_is_refused(self, tmp_path, ctlabs):
        """In one line."""
        (tmp_path / "empty.csv").write_text("", encoding="utf-8")
        assert ctlabs("look", "empty.csv") == 2
        assert ctlabs.err.count("\n") == 1


#: Tables with their times and values, and what is told of them.
READ = [
    ("% t,position\n1,1.5\n2,2.5\n", {}, [1, 2], [1.5, 2.5]),
    ("t , position\n1 , 1.5\n2 , 2.5\n", {}, [1, 2], [1.5, 2.5]),
    ("t,position\n1,1.5\n2,2.5\n,\n,\n", {}, [1, 2], [1.5, 2.5]),
    ("t,position\n2024/05/31 12:00:01,1\n2024/05/31 12:00:03,2\n", {"unit": "ymd", "t0": "first"}, [0, 2], [1, 2]),
    ("t,position\n5/31/2024 11:59:59 AM,1\n5/31/2024 12:00:01 PM,2\n", {"unit": "mdy", "t0": "first"}, [0, 2], [1, 2]),
    ("t,position\n20240531T115959Z,1\n20240531T120001Z,2\n", {"unit": "iso", "t0": "first"}, [0, 2], [1, 2]),
    ("t,position\n2024-05-31T23:59:59+03:00,1\n2024-05-31T21:00:01+00:00,2\n", {"unit": "iso", "t0": "first"}, [0, 2], [1, 2]),
    ("t,position\n1717156800000000001,1\n1717156800000000003,2\n", {"unit": "unix_ns", "t0": "first"}, [0, 2e-9], [1, 2]),
    ("t,position\n1,\"1,120\"\n2,963\n", {"thousands": ","}, [1, 2], [1120, 963]),
    ("t,position\n1,\"1,120\"\n2,963\n", {"decimal": ","}, [1, 2], [1.12, 963]),
    ("t;position\n1;1.234.567\n2;1.120\n", {}, [1, 2], [1234567, 1120]),
    ("7\n8\n1,1.5\n2,2.5\n", {"skip": 2, "columns": {"position": "2"}, "time": "1"}, [1, 2], [1.5, 2.5]),
    ("Höhe,t\n1.5,1\n2.5,2\n", {"encoding": "utf-8", "columns": {"position": "Höhe"}}, [1, 2], [1.5, 2.5]),
    ("t,position\ns,m\n1,1.5\n2,2.5\n", {}, [1, 2], [1.5, 2.5]),
    ("position\n[m]\n1.5\n2.5\n", {}, None, [1.5, 2.5]),
    ("Time (s),position\n1,1.5\n3,2.5\n", {"time": "none"}, None, [1.5, 2.5]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "told", "t", "z"), READ, ids=[repr(text)[:40] for text, *_ in READ])
def test_a_table_is_read_as_told(text, told, t, z):
    """Every option, and what has one reading without them."""
    record = datafile.parse(text.encode(), ["position"], "d.csv", Mapping(**told))
    np.testing.assert_array_equal(record.z[:, 0], z)
    if t is None:
        assert record.t is None
    else:
        np.testing.assert_allclose(record.t, t, rtol=0, atol=1e-12)


#: Tables that are refused, and what the one line says.
REFUSED = [
    ("time,position\n1,1.5\n", {}, r'line 1: .*"time", which looks like times: --time time takes it, --time none does not'),
    ("t,position\n05/06/2024,1\n06/06/2024,2\n", {}, r"line 2.*several readings.*--time t:dmy --t0 first or --time t:mdy --t0 first"),
    ("t,position\n23:59:59,1\n00:00:01,2\n", {"unit": "clock", "t0": "first"}, r"line 3.*expected a time after 23:59:59 .*midnight.*"),
    ("t,position\n2024-05-31T12:00:00Z,1\n2024-05-31T12:00:01,2\n", {"unit": "iso"}, r"line .*all with a zone or all without one.*"),
    ("t,position\n1,1\n31 May 2024,2\n", {}, r'line 3.*expected a number, received the date .*"31 May 2024": .*--time t:dmy --t0 first'),
    ("flow\n1\n\n2\n\n3\n", {}, r".*--column position=flow"),
    ("position\n1\n\n2\n\n3\n", {}, r"line 3: a blank line behind every value .*--blank skip or --blank missing"),
    ("position\n\n\n1\n\n\n2\n\n\n3\n", {}, r"line 5: a blank line before every value .*--blank skip or --blank missing"),
    ("position\n1\n# 2\n3\n", {}, r"line 3: a row of numbers behind # may be a missing row or none.*"),
    ("position\nm\n1.5\n", {}, r'line 2, column position: expected a number, received "m"; .*--missing m'),
    ("a,b,c\n1,2,3\n", {}, r'line 1: expected the column position, received "a", "b", "c"; --column position=COLUMN'),
    ("t,position\n1,1\n", {"columns": {"speed": "v"}}, r'.*--column speed=v: expected one of position, received "speed"'),
    ("t,position\n1,1\n", {"time": "stamp"}, r'line 1: --time stamp: expected one of the columns "t", "position", received "stamp".*'),
    ("position\n1\n", {"t0": "first"}, r"line 1: --t0 first: expected a column of times.*"),
    ("t;position\n1;1,5\n", {"decimal": "."}, r'line 2.*expected a decimal point \(--decimal \.\), received "1,5" \(--decimal ,\)'),
    ("t,position\n1,\"1,5\"\n", {"thousands": ","}, r'line 2, column position: expected "," \(--thousands ,\) between groups.*'),
    ("t,position,u\n1,1,\n", {"inputs": ("u",)}, r"line 2, column u: expected an input, received none: only measurements may be missing"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "told", "line"), REFUSED, ids=[repr(text)[:40] for text, *_ in REFUSED])
def test_what_has_two_readings_is_refused_with_the_option_that_decides(text, told, line):
    """One line, with the change that would make it work."""
    with pytest.raises(ValueError) as error:
        datafile.parse(text.encode(), ["position"], "d.csv", Mapping(**told))
    assert re.fullmatch(rf"d\.csv: {line}", str(error.value)), error.value


@pytest.mark.parametrize(("head", "foot"), [("", ""), ("Umsatz 2023;;\r\n", ""), ("Umsatz 2023;;\r\n", "Summe;123.456,00;\r\n")])
def test_decimal_commas_and_thousands_part_no_columns(head, foot):
    """A spreadsheet whose rows have as many commas as separators: the cells have to be values; the unit of its dates is told."""
    rows = [f"{i:02d}.01.2023;1.{500 + 7 * i},95;8,{90 + i}" for i in range(1, 9)]
    text = head + "\r\n".join(["Datum;Menge [Stück];Preis (€)", *rows, foot])
    with pytest.raises(ValueError, match=r'expected the column flow, received "Datum", "Menge \[Stück\]", "Preis'):
        datafile.parse(text.encode("cp1252"), ["flow"], "sales.csv")
    told = {"columns": {"flow": "Menge [Stück]"}, "time": "Datum"}
    with pytest.raises(ValueError, match=r"received the date .*--time Datum:dmy --t0 first$"):
        datafile.parse(text.encode("cp1252"), ["flow"], "sales.csv", Mapping(**told))
    told |= {"unit": "dmy", "t0": "first"}
    if foot:
        with pytest.raises(ValueError, match=r'received "Summe"; if the line is not part of the table, remove it or begin it with #$'):
            datafile.parse(text.encode("cp1252"), ["flow"], "sales.csv", Mapping(**told))
    else:
        assert datafile.parse(text.encode("cp1252"), ["flow"], "sales.csv", Mapping(**told)).z[0, 0] == 1507.95


def test_the_names_of_a_logger_stand_above_its_units_and_kinds():
    """TOA5: four lines above the numbers, of which the last has equal and empty cells."""
    lines = [
        '"TOA5","Station","CR1000","12345","CR1000.Std.27","CPU:prog.CR1","4321","Table1"',
        '"TIMESTAMP","RECORD","BattV_Avg","AirTC_Avg"', '"TS","RN","Volts","Deg C"', '"","","Avg","Avg"',
        '"2024-05-31 12:00:00",0,12.5,15.1', '"2024-05-31 12:15:00",1,12.5,"NAN"', '"2024-05-31 12:30:00",2,12.4,15.3',
    ]  # fmt: skip
    assert datafile.header("\r\n".join(lines).encode(), "toa5.dat") == ("TIMESTAMP", "RECORD", "BattV_Avg", "AirTC_Avg")
    found = look.survey("\r\n".join(lines).encode(), "toa5.dat", Mapping(), ["air"])
    assert [column.name for column in found.columns] == ["TIMESTAMP", "RECORD", "BattV_Avg", "AirTC_Avg"]
    assert "--time TIMESTAMP:iso --t0 first" in found.options


#: Texts of the columns t and y (or as they are told), what is said of them, and the times and values that were meant.
MEANT = {
    "31-May-2024 23:59:00,1\n01-Jun-2024 00:00:30,2\n": ("dmy", [0, 90], [1, 2]),
    "31MAY2024,1\n02JUN2024,2\n": ("dmy", [0, 172800], [1, 2]),
    "9007199254740993,1\n9007199254740994,2\n9007199254740997,3\n": ("s", [0, 1, 4], [1, 2, 3]),
    "sec,µg/m³\n1,7\n2,8\n": ("s", [0, 1], [7, 8]),
    "1,1.#QNAN0\n2,-1.#IND00\n3,2.5\n": ("s", [0, 1, 2], [np.nan, np.nan, 2.5]),
}


@pytest.mark.parametrize(("rows", "meant"), MEANT.items())
def test_what_has_one_reading_is_read(rows, meant):
    """Months by their names, times of more digits than a double has, units of units, what C writes for no number."""
    unit, t, z = meant
    record = datafile.parse(f"t,y\n{rows}".encode(), ["y"], mapping=Mapping(time="t", unit=unit, t0="first"))
    assert record.t.tolist() == t
    assert np.array_equal(record.z.ravel(), z, equal_nan=True)


#: Tables that are refused, and how the one line ends.
ENDS = {
    "t,y\n9007199254740993,1\n9007199254740994,2\n": "--t0 first",
    "t,y\n1,5%\n2,4%\n": "a number stands alone in its cell, written with the digits 0 to 9, such as 5.3 or 1e3",
    "t,y\n1,#DIV/0!\n2,4\n": "--missing '#DIV/0!'",
    "t,y\n1,1\n2,2\nt,y\n3,3\n": "if the line is not part of the table, remove it or begin it with #",
    "y\n1\n2\n\ny\n3\n": "if the line is not part of the table, remove it or begin it with #",
    "t,y\n1,1\nTotal,3\n": "if the line is not part of the table, remove it or begin it with #",
    "t,y\n1,1\n2,3\n\nMean: 2\n": "if the line is not part of the table, remove it or begin it with #",
    "date,y\n05/06/2024,1\n05/13/2024,2\n": "--time date:mdy --t0 first takes it, --time none does not",
    "stamp,y\n1717156801000,1\n1717156802000,2\n": "--time stamp:unix_ms --t0 first takes it, --time none does not",
}


@pytest.mark.parametrize(("content", "end"), ENDS.items())
def test_a_refusal_ends_with_what_to_do(content, end):
    """An option, or the change in the file; never one that would read something else."""
    with pytest.raises(ValueError, match=rf"{re.escape(end)}$"):
        datafile.parse(content.encode(), ["y"])
