"""``ctlabs forecast``: what comes after a record."""

import datetime as dt

import numpy as np
import pytest

from ctlabs import forecast, kalman_filter
from ctlabs.files import datafile, modelfile
from ctlabs.files.mapping import Mapping
from ctlabs.studies import forecasting
from tests.nile import FLOW

DRIFT = """\
format = 1
title = "A drifting clock"
kind = "continuous"
[model]
states = ["offset", "rate"]
units = ["s", "s/s"]
F = [[0, 1], [0, 0]]
G = [[0], [1]]
Q = [[1e-4]]
H = [[1, 0]]
R = [[0.01]]
measurements = ["reading"]
P0 = [[1, 0], [0, 0.01]]
dt = 1
[experiment]
first = 1
"""


def test_the_forecast_is_that_of_the_library():
    """Rows of forecast.csv, the values and the checks: the library's forecast of the same model and record."""
    nile = modelfile.ready("local_level").edit(("experiment", "first"), 0).checked()
    record = datafile.parse(("flow\n" + "\n".join(map(str, FLOW))).encode(), nile.measurements)
    report = forecasting.study(nile, record, 5)
    model = nile.discrete()
    ahead = forecast(model, kalman_filter(model, np.array(FLOW, dtype=float), first=0), 5)
    assert report.passed
    assert np.allclose(report.values["state_end"].value, ahead.x[-1])
    assert np.allclose(report.values["state_sd_end"].value, ahead.sd[-1])
    assert len(report.checks) == 2


def test_irregular_times_go_on_at_the_usual_interval():
    """Of a continuous model the instants to come are as far apart as the rows usually are."""
    clock = modelfile.loads(DRIFT)
    record = datafile.parse(b"t,reading\n1,0.1\n2,0.2\n4,0.5\n5,0.4\n", ["reading"])
    report = forecasting.study(clock, record, 2)
    assert report.passed
    z = [0.1, 0.2, np.nan, 0.5, 0.4]  # the same on a grid
    ahead = forecast(clock.discrete(), kalman_filter(clock.discrete(), z, first=1), 2)
    assert np.allclose(report.values["state_end"].value, ahead.x[-1], rtol=1e-9)


def test_a_known_input_of_the_record_has_no_future():
    """A record drives the model by its rows; after them nothing is known of the input, which is said."""
    text = DRIFT.replace('P0 = [[', 'B = [[0], [1]]\nP0 = [[').replace("first = 1", "first = 0")
    driven = modelfile.loads(text + '[data]\ninputs = ["push"]\n')
    record = datafile.parse(b"t,reading,push\n0,0.1,1\n1,0.2,1\n2,0.5,1\n", ["reading"], mapping=driven.mapping)
    with pytest.raises(ValueError, match=r"expected rows below the last measurement \(line 4\) with push"):
        forecasting.study(driven, record, 2)


def test_times_to_come_are_written_as_those_of_the_record():
    """Dates go on with their zone, past midnight; beside them the seconds of the model's clock."""
    clock = modelfile.loads(DRIFT.replace("first = 1", "first = 0"))
    table = b"at,reading\n2024-05-31T23:59:57+02:00,0.1\n2024-05-31T23:59:58+02:00,0.2\n2024-05-31T23:59:59+02:00,0.5\n"
    record = datafile.parse(table, ["reading"], mapping=Mapping(time="at", unit="iso", t0="first"))
    head, *rows = forecasting.study(clock, record, 2).files["forecast.csv"].decode().splitlines()
    assert head.startswith("k,at,t,")
    assert [row.split(",")[:3] for row in rows] == [["3", "2024-06-01T00:00:00+02:00", "3.0"], ["4", "2024-06-01T00:00:01+02:00", "4.0"]]


PRICED = """\
format = 1
title = "Demand by price"
kind = "discrete"
[model]
states = ["base", "slope"]
measurements = ["demand"]
Phi = [[1, 0], [0, 1]]
Qd = [[0.1, 0], [0, 0.01]]
H = [["1", "price"]]
R = [[1]]
P0 = [[100, 0], [0, 100]]
dt = 1
[data]
regressors = {price = "price"}
[experiment]
first = 0
"""


def forecast_of(text, dt=1, **told):
    """The report on a record of the priced model, and the rows of its forecast."""
    model = modelfile.loads(PRICED.replace("dt = 1", f"dt = {dt}"))
    mapping = Mapping(**{"regressors": {"price": "price"}, **told})
    report = forecasting.study(model, datafile.parse(text, ["demand"], mapping=mapping))
    return report, [row.split(",") for row in report.files["forecast.csv"].decode().splitlines()]


@pytest.mark.parametrize("day", ["{:02d}.06.2024", "{:02d}/06/24"])
def test_rows_to_come_keep_the_times_they_were_written_with(day):
    """In rows below the record the times stand there already, in whatever form: none is made up."""
    rows = [f"{day.format(i)},{9 - i},{i + 1}" for i in range(1, 6)] + [f"{day.format(i)},,{i}" for i in (6, 7)]
    text = "\n".join(["day,demand,price", *rows]).encode()
    _report, (head, *found) = forecast_of(text, dt=86400, time="day", unit="dmy", t0="first")
    assert head[:3] == ["k", "day", "t"]
    assert [row[:2] for row in found] == [["5", day.format(6)], ["6", day.format(7)]]


def test_seconds_are_no_times_of_the_record():
    """Where dates cannot be continued the seconds stand under their own name if the record's column is t."""
    model = modelfile.loads(DRIFT.replace("first = 1", "first = 0"))
    rows = [f"23:59:5{i},0.{i}" for i in range(1, 5)]
    record = datafile.parse("\n".join(["t,reading", *rows]).encode(), ["reading"], mapping=Mapping(time="t", unit="clock", t0="first"))
    head = forecasting.study(model, record, 2).files["forecast.csv"].decode().splitlines()[0].split(",")
    assert head[:2] == ["k", "seconds"]


def test_a_measured_row_without_its_regressor_is_no_row_to_come():
    """The last measured row has no price: it is left out and said, and the forecast begins after it; rows are counted up to it."""
    text = b"t,demand,price\n0,8,1\n1,7,2\n2,6.5,3\n3,5,\n4,,4\n5,,5\n"
    report, (_head, *found) = forecast_of(text)
    assert [row[:2] for row in found] == [["4", "4.0"], ["5", "5.0"]]
    said = " ".join(getattr(block, "text", "") for block in report.blocks)
    assert "4 rows from t = 0 to 3 s" in said
    assert "demand in line 5 is left out" in said
    assert report.passed


@pytest.mark.parametrize(
    ("unit", "text", "step"),
    [
        ("dmy", "{:%d.%m.%Y %H:%M}", 3600),
        ("dmy", "{:%d/%m/%y}", 86400),
        ("mdy", "{:%m/%d/%Y %H:%M:%S}", 1),
        ("ymd", "{:%Y/%m/%d}", 172800),
        ("iso", "{:%Y-%m-%d}", 86400),
        ("iso", "{:%Y-%m-%dT%H:%M:%S}+05:30", 600),
    ],
)
def test_times_that_go_on_are_read_as_the_seconds_beside_them(unit, text, step):
    """What is written after the last row is that instant by the reading of the record itself, also past the end of a year."""
    start, model = dt.datetime(2024, 12, 30), modelfile.loads(DRIFT.replace("first = 1", "first = 0"))
    stamps = [text.format(start + dt.timedelta(seconds=i * step)) for i in range(3)]
    mapping = Mapping(time="at", unit=unit, t0="first")

    def read(stamps):
        rows = "\n".join(f"{stamp},0.{i + 1}" for i, stamp in enumerate(stamps))
        return datafile.parse(f"at,reading\n{rows}\n".encode(), ["reading"], mapping=mapping)

    head, *rows = forecasting.study(model, read(stamps), 5).files["forecast.csv"].decode().splitlines()
    assert head.split(",")[:3] == ["k", "at", "t"]
    later = [row.split(",") for row in rows]
    again = read([*stamps, *(row[1] for row in later)])
    assert [float(row[2]) for row in later] == again.t[3:].tolist()


def test_a_constant_stands_in_for_the_rows_to_come():
    """Of a model whose regressors are constants too: the forecast is that of the record with rows that hold the constant."""
    model = modelfile.ready("satellite_receiver")
    rows = b"t,east,north,hdop\n1,0,0,1\n2,3,1,4\n3,6,2,2\n"
    record, longer = (
        datafile.parse(text, model.measurements, mapping=model.mapping) for text in (rows, rows + b"4,,,1.2\n5,,,1.2\n")
    )
    found, told = forecasting.study(model, record, 2), forecasting.study(model, longer)
    assert found.files["forecast.csv"] == told.files["forecast.csv"]
    assert "hdop of the time to come is the constant 1.2" in " ".join(getattr(block, "text", "") for block in found.blocks)
