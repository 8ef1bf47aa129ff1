"""``ctlabs forecast``: what comes after a record."""

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
