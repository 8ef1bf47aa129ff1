"""Measured data of a draft: how a table is read, what comes of the record, constants that are fitted to it; no page, no browser."""

from __future__ import annotations

import asyncio
import csv
import io
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ctlabs import kalman_filter
from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import ready
from ctlabs.filtering.forecasting import forecast
from ctlabs.linalg.covariance import deviations
from ctlabs.workbench.desk import commands
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.desk.telling import TakeEstimates, TellData
from ctlabs.workbench.runs import fits, records
from ctlabs.workbench.runs import seen as tables
from ctlabs.workbench.runs.inside import Unwanted
from ctlabs.workbench.runs.outcomes import Upload
from ctlabs.workbench.runs.wanted import Wanted
from ctlabs.workbench.runs.worker import Runner
from tests import nile
from tests.reference import EXACT

MODEL = ready("local_level").dumps()
SPIKED = nile.FLOW.copy()
SPIKED[50] = 9500.0


def table(flow: np.ndarray, name: str = "Flow (m3/s)") -> str:
    """The Nile's flow as a logger writes it."""
    return f"year;{name};gauge\n" + "".join(f"{nile.YEAR + i};{v:g};{i % 7}\n" for i, v in enumerate(flow))


def upload(flow: np.ndarray) -> Upload:
    return Upload("flow.csv", "flow\n" + "".join(f"{v:g}\n" for v in flow))


@pytest.fixture
def session(tmp_path: Path) -> Any:
    store = Store(tmp_path)
    made = Session.begin(store)
    made.do(commands.Open(MODEL, "nile.toml"))
    yield made
    store.close()


def done(work: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(work)


# The table -------------------------------------------------------------------------------------------------------------


def test_a_logger_s_table_is_mapped_in_one_step_and_taken_back_to_the_letter(session: Session) -> None:
    """Refused with what would put it right; applied, the columns have their roles; undone, the file is what it was."""
    desk = session.records
    done(desk.drop(table(SPIKED).encode(), "flow.csv"))
    seen = done(desk.look())
    assert 'expected the column flow, received "year", "Flow (m3/s)", "gauge"' in seen["refusal"]
    assert not desk.readable
    before = session.text
    session.do(desk.remedied(seen["suggestion"]))
    seen = done(desk.look())
    assert seen["refusal"] == ""
    assert desk.readable
    assert [column["role"] for column in seen["columns"]] == ["time", "measurement:flow", ""]
    assert 'columns = {flow = "Flow (m3/s)", t = "year"}' in session.text
    assert session.undo().startswith("data: ")
    assert session.text == before
    assert not desk.readable


def test_every_role_moves_its_name_to_the_column_and_takes_it_from_another() -> None:
    """A measurement, an input, a regressor, the time, the names of records: never two roles of one column, never two columns of a role."""
    a, b = {"name": "a", "number": 1, "role": ""}, {"name": "b", "number": 2, "role": ""}
    for role, field in (("measurement:z", "columns"), ("input:z", "columns"), ("regressor:z", "regressors")):
        first = tables.mapped(Mapping(), a, role)
        assert getattr(first, field) == {"z": "a"}
        assert getattr(tables.mapped(first, b, role), field) == {"z": "b"}
        nothing = tables.mapped(first, a, "")
        assert (nothing.columns, nothing.inputs, nothing.regressors) == ({}, (), {})
    timed = tables.mapped(Mapping(unit="ms"), a, "time")
    assert (timed.time, timed.unit) == ("a", "")
    assert tables.mapped(timed, a, "measurement:z") == Mapping(columns={"z": "a"}, time="none")
    assert tables.mapped(tables.mapped(Mapping(), a, "record"), b, "record").record == "b"
    scaled = Mapping(inputs=("u",), columns={"u": "a"}, scale={"u": 2.0}, u0=(1.0,))
    assert tables.mapped(scaled, a, "") == Mapping()


def test_a_refused_cell_is_shown_with_the_lines_beside_it(session: Session) -> None:
    """Its line and column are named, and the line is among those that are shown."""
    flow = [f"{v:g}" for v in nile.FLOW]
    flow[60] = "n.m."
    text = "flow\n" + "\n".join(flow) + "\n"
    seen = tables.seen(MODEL, text, "flow.csv")
    assert (seen["line"], seen["column"]) == (62, "flow")
    assert dict(map(tuple, seen["rows"]))[62] == ["n.m."]
    assert "--missing n.m." in seen["remedies"]


def test_a_workbook_with_two_sheets_asks_for_one_and_is_read_as_told(session: Session) -> None:
    """What is said of the sheet stays in the model file, and the table that is kept is read without it."""
    pd, _ = pytest.importorskip("pandas"), pytest.importorskip("openpyxl")
    file, desk = io.BytesIO(), session.records
    with pd.ExcelWriter(file) as writer:
        for name, values in (("Old", nile.FLOW[:5]), ("New", nile.FLOW)):
            pd.DataFrame({"flow": values}).to_excel(writer, sheet_name=name, index=False)
    done(desk.drop(file.getvalue(), "flow.xlsx"))
    assert "2 sheets that hold data" in desk.refused
    assert desk.remedies == ("--sheet Old", "--sheet New")
    session.do(desk.remedied("--sheet New"))
    done(desk.again())
    assert desk.refused == ""
    assert done(desk.look())["read"][0].startswith("100 rows")
    assert 'sheet = "New"' in session.text
    assert desk.data is not None
    np.testing.assert_array_equal(desk.data.record(session.file).z[:, 0], nile.FLOW)


def test_what_is_told_of_data_leaves_all_else_as_typed(session: Session) -> None:
    """Keys come and go one by one; without any there is no table [data]; a period of its own is the model's."""
    before = session.text
    session.do(TellData(Mapping(time="year", t0="first")))
    session.do(TellData(Mapping(time="year", missing=("-9999",))))
    assert session.file.mapping == Mapping(time="year", missing=("-9999",))
    session.do(TellData(Mapping()))
    assert "[data]" not in session.text
    assert session.text.rstrip() == before.rstrip()
    session.do(TellData(Mapping(dt=2.0)))
    assert session.file.dt == 2.0


# The record ------------------------------------------------------------------------------------------------------------


def test_estimates_are_the_filter_s_and_the_spike_is_found_and_left_out() -> None:
    """x̂ and σ as the library's filter has them; the planted row with its line; beyond the gate, it alone is left out."""
    model, data = ready("local_level"), upload(SPIKED)
    found = records.estimated(MODEL, data, Wanted(smooth=True, steps=3))
    z = SPIKED[:, None]
    own = kalman_filter(model.discrete(), z, first=0)
    np.testing.assert_allclose(found.x, own.x_plus, rtol=EXACT)
    np.testing.assert_allclose(found.sd, deviations(own.P_plus), rtol=EXACT)
    ahead = forecast(model.discrete(), own, 3)
    np.testing.assert_allclose(found.forecast[0].panels[0].curves[-2].y[-3:], ahead.x[:, 0], rtol=EXACT)
    told = records.diagnosed(MODEL, data, Wanted())
    assert told.verdict == "outlier"
    assert not told.ok
    assert [(row.line, row.k, row.quantity, row.kind, row.value) for row in told.rows] == [(52, 50, "flow", "outlier", 9500.0)]
    gated = records.estimated(MODEL, data, Wanted(gate=5.0))
    assert [(row.line, row.kind) for row in gated.left_out] == [(52, "beyond the gate")]
    assert gated.beyond == 1
    without = SPIKED.copy()
    without[50] = np.nan
    np.testing.assert_allclose(gated.x, kalman_filter(model.discrete(), without[:, None], first=0).x_plus, rtol=EXACT)


def test_a_row_is_drawn_with_its_neighbours_alone() -> None:
    """The figure of a row that is looked at has the rows beside it and a mark at it; the whole one has all rows."""
    found = records.estimated(MODEL, upload(np.tile(SPIKED, 5)), Wanted())
    row = next(row for row in records.diagnosed(MODEL, upload(np.tile(SPIKED, 5)), Wanted()).rows if row.k == 250)
    assert len(records.drawn(found, [0]).panels[0].curves[0].x) == 500
    near = records.drawn(found, [0], row)
    assert len(near.panels[0].curves[0].x) == 2 * records.BESIDE + 1
    assert near.marks[0].at == 250.0
    assert near.reach == (250.0 - records.BESIDE, 250.0 + records.BESIDE)


def test_files_have_every_row() -> None:
    """The table of estimates row by row, the forecast, a report that needs nothing else."""
    data, wanted = upload(nile.FLOW), Wanted(steps=4)
    rows = list(csv.DictReader(io.StringIO(records.files(MODEL, data, wanted, "csv").decode())))
    assert len(rows) == 100
    found = records.estimated(MODEL, data, wanted)
    np.testing.assert_allclose([float(row["level"]) for row in rows], found.x[:, 0], rtol=EXACT)
    assert len(list(csv.DictReader(io.StringIO(records.files(MODEL, data, wanted, "forecast").decode())))) == 4


def test_what_is_wanted_is_refused_in_one_line_and_kept_with_the_draft(session: Session) -> None:
    """A gate of nothing, a forecast backwards; after a restart it is as it was."""
    for wrong in ({"gate": 0.0}, {"gate": -1.0}, {"steps": -1}):
        with pytest.raises(ValueError, match=next(iter(wrong)) if "gate" in wrong else "forecast"):
            session.records.want(**wrong)
    session.records.want(gate=4.0, smooth=False)
    session.records.choose(["q", "gone"])
    again = Session.resume(session.store, session.draft.id).records
    assert again.wanted == Wanted(gate=4.0, smooth=False)
    assert again.free == ("q",)


def test_estimates_come_before_the_tests_and_are_stale_after_an_edit(session: Session) -> None:
    """They are there when ``seen`` is called, untested; the judgement follows; another model makes them stale."""
    desk, states = session.records, []
    done(desk.drop(upload(SPIKED).text.encode(), "flow.csv"))
    done(desk.filter(seen=lambda: states.append((desk.estimates is not None, desk.judgement))))
    assert states == [(True, None)]
    assert desk.judgement is not None
    assert desk.judgement.verdict == "outlier"
    assert not desk.stale
    session.do(commands.EditCell(("constants", "q"), "2000"))
    assert desk.stale
    session.undo()
    assert not desk.stale


# Fits ------------------------------------------------------------------------------------------------------------------


def test_the_nile_s_variances_are_found_taken_and_given_back(session: Session) -> None:
    """Durbin and Koopman's estimates; into the model as one step, and out of it to the letter."""
    desk = session.records
    done(desk.drop(upload(nile.FLOW).text.encode(), "flow.csv"))
    session.do(commands.EditCells(((("constants", "q"), "500"), (("constants", "r"), "9000"))))
    begun = session.text
    done(desk.fit(["q", "r"]))
    found = desk.fitted
    assert found is not None
    assert found.estimates == pytest.approx({"q": nile.Q, "r": nile.R}, rel=1e-3)
    assert found.log_likelihood > found.start_log_likelihood
    assert found.before is not None
    assert found.after is not None
    assert found.before.values == (500.0, 9000.0)
    assert found.before.log_likelihood == pytest.approx(found.start_log_likelihood)
    assert found.after.log_likelihood == pytest.approx(found.log_likelihood)
    assert found.correlation is not None
    assert found.correlation[0, 1] < 0
    assert [drawing.name.partition(",")[0] for drawing in found.profiles] == ["Profile of q", "Profile of r"]
    session.do(TakeEstimates(found.estimates))
    assert {name: session.file.constants[name] for name in ("q", "r")} == found.estimates
    assert session.undo() == "take the estimates of q, r"
    assert session.text == begun


# What is kept ------------------------------------------------------------------------------------------------------------


def test_a_filtered_record_and_a_fit_are_kept_and_come_again(session: Session, tmp_path: Path) -> None:
    """With model, data and wishes; the same once more is not kept twice; a fit has all its numbers without being run again."""
    desk = session.records
    done(desk.drop(upload(nile.FLOW).text.encode(), "flow.csv"))
    desk.want(gate=4.0, steps=3)
    for _ in range(2):
        done(desk.filter())
    desk.choose(["q"])
    done(desk.fit(["q"]))
    fit, filtered = session.kept()
    assert [(each.kind, each.name.rpartition(": ")[2]) for each in (fit, filtered)] == [
        ("fit", "flow.csv fitted to q"), ("filter", "flow.csv filtered"),
    ]  # fmt: skip
    found, estimates = desk.fitted, desk.estimates
    assert found is not None
    assert estimates is not None
    store = Store(tmp_path)
    other = Session.begin(store)
    assert other.reopen(fit.id) == "fit"
    assert other.records.free == ("q",)
    again = other.records.fitted
    assert again is not None
    for name in ("names", "units", "start", "values", "intervals", "log_likelihood", "model"):
        assert getattr(again, name) == getattr(found, name), name
    np.testing.assert_array_equal(again.errors, found.errors)
    assert other.reopen(filtered.id) == "data"
    assert other.text == session.text
    assert (other.records.wanted, other.records.fresh) == (Wanted(gate=4.0, steps=3), True)
    done(other.records.filter())
    assert other.records.estimates is not None
    np.testing.assert_array_equal(other.records.estimates.x, estimates.x)
    other.undo()
    assert other.untouched
    store.close()


def test_kept_results_are_compared_renamed_deleted_and_put_back(session: Session) -> None:
    """Like experiments; what only an experiment can do is refused in one line."""
    desk = session.records
    done(desk.drop(upload(nile.FLOW).text.encode(), "flow.csv"))
    done(desk.filter())
    session.do(commands.EditCell(("constants", "q"), "2000"))
    done(desk.filter())
    second, first = session.kept()
    differ = {row.name: row for row in session.compare(first.id, second.id).results if not row.same}
    assert differ["log_likelihood"].first > differ["log_likelihood"].second
    assert "rows" not in differ
    assert not session.compare(first.id, second.id).same_model
    asyncio.run(session.run())
    experiment = session.kept()[0]
    assert {row.name for row in session.compare(first.id, experiment.id).results} >= {"rows", "log_likelihood"}
    session.rename(first.id, "The first")
    session.delete(first.id)
    assert [each.id for each in session.kept()] == [experiment.id, second.id]
    session.restore(first.id)
    assert session.kept()[-1].name == "The first"
    refused = rf"^experiment {first.id}: expected an experiment, received a record that was filtered: open it$"
    for use in (lambda: session.export(first.id, "csv"), lambda: session.outcome(first.id), lambda: asyncio.run(session.rerun(first.id))):
        with pytest.raises(ValueError, match=refused):
            use()


def test_a_cancelled_fit_keeps_the_best_so_far() -> None:
    """It ends after a few likelihoods, with the best of them and without what would take longer."""
    model = ready("local_level").replace({"q": 10.0, "r": 90000.0}).dumps()
    seen: list[float] = []

    def tell(done: int, _total: int, point: fits.Point) -> None:
        seen.append(point.best)
        if done >= 12:
            raise Unwanted

    found = fits.fitted(model, upload(nile.FLOW), ["q", "r"], 0, tell)
    assert found.interrupted
    assert found.before is None
    assert found.log_likelihood >= max(seen) - 1e-9
    assert found.log_likelihood > found.start_log_likelihood
    assert seen == sorted(seen)


def test_the_trace_shows_what_is_finite() -> None:
    """Points without a likelihood leave a gap, and the axis follows the others."""
    points = [fits.Point("search", value, i, 1.0) for i, value in enumerate([-np.inf, -700.0, -640.0, -632.5])]
    panel = fits.trace(points).panels[0]
    np.testing.assert_array_equal(panel.curves[0].y, [np.nan, -700.0, -640.0, -632.5])
    assert panel.reach is not None
    assert panel.reach[0] < -700 < -632.5 < panel.reach[1]


def test_no_constant_and_a_constant_that_is_gone_are_refused() -> None:
    """Before anything is computed."""
    with pytest.raises(ValueError, match="one at least to be fitted"):
        fits.fitted(MODEL, upload(nile.FLOW), [])
    with pytest.raises(ValueError, match="expected a constant of the model"):
        commands.apply(ready("local_level"), TakeEstimates({"p": 1.0}))


@pytest.mark.slow
def test_a_run_that_is_cancelled_may_come_to_its_end_with_a_result() -> None:
    """Within its patience what it returns is its result; progress brings a note."""

    async def body() -> None:
        runner = Runner({"ending": "tests.workbench_functions:ending"}, size=1, warm=())
        cancel, notes = asyncio.Event(), []

        def show(state: Any) -> None:
            if state.note:
                notes.append(state.note)
                cancel.set()

        try:
            assert await runner.run("ending", {}, progress=show, cancel=cancel, patience=30.0) == "the best so far"
            assert notes[0] == "a note"
        finally:
            runner.close()

    asyncio.run(body())
