"""The workbench's experiments: what is run, kept, compared and exported; no page, no browser."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import re
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from ctlabs import cli, montecarlo
from ctlabs.analysis import diagnosis, sensitivity
from ctlabs.files.modelfile import loads, ready
from ctlabs.filtering import compare, kalman_filter, log_likelihood, smooth, steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.models import Anomaly, DiscreteModel, anomalous
from ctlabs.workbench.desk import commands as c
from ctlabs.workbench.desk.packing import pack, unpack
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.runs import experiments, programs
from ctlabs.workbench.runs.outcomes import Asked, Outcome, Upload, outcome, packed
from ctlabs.workbench.runs.reporting import report
from ctlabs.workbench.runs.worker import RunFailed, Runner, RunProgress
from tests.reference import EXACT, SOLVER

#: What the tests share is made by one worker.
pytestmark = pytest.mark.xdist_group("workbench experiments")
MODEL = ready("constant_velocity").dumps()
PLAN = Asked(steps=40, runs=60, seed=3)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    made = Store(tmp_path)
    yield made
    made.close()


@pytest.fixture
def session(store: Store) -> Session:
    made = Session.begin(store, text=MODEL)
    made.set_plan(steps=40, runs=60, seed=3)
    return made


def run(plan: Asked, model: str = MODEL) -> Outcome:
    """An experiment, in place."""
    return outcome(experiments.run(model, plan.plain()))


def equal(a: Any, b: Any) -> bool:
    """Whether two outcomes are the same to the bit, but for the time they took."""
    if is_dataclass(a):
        return type(a) is type(b) and all(
            equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.name != "seconds"
        )
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, dict):
        return list(a) == list(b) and all(equal(a[key], b[key]) for key in a)
    return bool(a == b or (a != a and b != b))


# Simulated -----------------------------------------------------------------------------------------------------------


def test_an_experiment_is_the_librarys_ensemble() -> None:
    """Statistics, histories and theory are those of the library's own verbs with the same seed."""
    found, model = run(PLAN), ready("constant_velocity").discrete()
    experiment = Experiment(60, 3)
    stats, some = experiment.statistics(model, steps=40), experiment.histories(model, steps=40, runs=3)
    assert found.statistics is not None
    assert found.truth is not None
    assert some.truth is not None
    np.testing.assert_array_equal(found.statistics.rms, stats.rms)
    np.testing.assert_array_equal(found.statistics.nees_band, np.array(stats.nees_band()))
    np.testing.assert_array_equal(found.truth, some.truth)
    np.testing.assert_array_equal(found.z, some.z)
    np.testing.assert_allclose(found.x_plus, some.x_plus, rtol=0, atol=SOLVER)
    np.testing.assert_array_equal(found.P_plus, covariances(model, 40).P_plus)
    np.testing.assert_array_equal(found.K, covariances(model, 40).K)
    assert found.summary["rms[x]"][0] == stats.rms[-1, 0]
    assert found.errors is not None
    np.testing.assert_array_equal(found.errors, found.x_plus - found.truth)


def test_the_same_seed_gives_the_same_numbers_and_another_seed_others() -> None:
    """An experiment is determined by its model, settings and seed."""
    one = run(PLAN)
    again, other = run(PLAN), run(replace(PLAN, seed=4))
    assert one.summary == again.summary
    assert one.summary["rms[x]"] != other.summary["rms[x]"]
    assert one.summary["sd_theory[x]"] == other.summary["sd_theory[x]"]


def test_anomalies_are_other_variances_at_their_instants() -> None:
    """R = inf leaves the prediction as it is, R = 0 makes the measured state known, all else is the filter of that R."""
    plan = replace(PLAN, anomalies=(Anomaly(10, 0, last=12), Anomaly(20, 0, 0.0)))
    found, model = run(plan), ready("constant_velocity").discrete()
    R = np.repeat(model.R[None], 41, axis=0)
    R[10:13], R[20] = np.inf, 0.0
    wanted = covariances(replace(model, R=R), 40)
    np.testing.assert_array_equal(found.P_plus, wanted.P_plus)
    np.testing.assert_array_equal(found.P_plus[10:13], found.P_minus[10:13])
    assert np.isnan(found.z[10:13, 0]).all()
    assert found.sd_plus[20, 0] == pytest.approx(0, abs=EXACT)
    assert found.truth is not None
    np.testing.assert_allclose(found.x_plus[20, 0], found.truth[20, 0], rtol=SOLVER)


@pytest.mark.parametrize("anomaly", [Anomaly(41), Anomaly(3, 1), Anomaly(3, last=50)])
def test_an_anomaly_outside_the_experiment_is_refused(anomaly: Anomaly) -> None:
    """Instant and measurement must be there; one line says which are."""
    with pytest.raises(ValueError, match=r"^anomaly\.(k|measurement): expected a whole number from 0 to \d+, received"):
        run(replace(PLAN, anomalies=(anomaly,)))


@pytest.mark.parametrize("wrong", [Anomaly(-1), Anomaly(5, R=-1.0), Anomaly(5, last=4), Anomaly(5, R=float("nan"))])
def test_an_anomaly_that_makes_no_sense_is_refused(session: Session, wrong: Anomaly) -> None:
    """Before anything runs, in one line."""
    with pytest.raises(ValueError, match=r"^anomaly\.\w+: expected [^\n]+$"):
        session.set_plan(anomalies=(wrong,))


def test_a_design_that_is_not_the_truth_is_judged_by_the_true_errors() -> None:
    """Claimed, true and optimal errors are the library's; the ensemble follows the true ones, not what the filter claims."""
    wrong = ready("constant_velocity").replace({"sigma": 50})
    found = run(replace(PLAN, runs=2000, design=wrong.dumps()))
    truth, design = ready("constant_velocity").discrete(), wrong.discrete()
    actual = sensitivity.actual(truth, design, 40)
    assert found.actual_P is not None
    assert found.actual_rms is not None
    assert found.optimal_sd is not None
    assert found.statistics is not None
    np.testing.assert_array_equal(found.actual_P, actual.P_plus)
    np.testing.assert_array_equal(found.P_plus, actual.claimed.P_plus)
    np.testing.assert_allclose(found.optimal_sd, covariances(truth, 40).sd_plus, rtol=EXACT)
    low, high = found.statistics.rms_band
    inside = (found.statistics.rms >= low) & (found.statistics.rms <= high)
    assert inside.mean() > 0.8
    assert np.median(found.sd_plus[-1] / found.statistics.rms[-1]) > 1.5


def test_a_constant_gain_is_judged_by_its_own_errors() -> None:
    """Far from the limit at t0, the errors are those of the constant gain and the band is the limit that it claims."""
    model = loads(MODEL).discrete()
    text = loads(MODEL).edit(("model", "P0"), [[1e6, 0], [0, 1e6]]).dumps()
    found = run(replace(PLAN, runs=2000, algorithms=("steady", "joseph")), text)
    limit = steady.solve(model)
    keep, P = np.eye(2) - limit.K @ model.H, np.diag([1e6, 1e6])
    wanted = [P]
    for _ in range(PLAN.steps):
        P = keep @ (model.Phi @ P @ model.Phi.T + model.Qd) @ keep.T + limit.K @ model.R @ limit.K.T
        wanted.append(P)
    assert found.actual_P is not None
    assert found.statistics is not None
    np.testing.assert_allclose(found.actual_P, wanted, rtol=SOLVER)
    np.testing.assert_allclose(found.sd_plus[1:], np.tile(np.sqrt(np.diag(limit.P_plus)), (PLAN.steps, 1)), rtol=SOLVER)
    np.testing.assert_allclose(found.K[1:], np.tile(limit.K, (PLAN.steps, 1, 1)), rtol=SOLVER)
    low, high = found.statistics.rms_band
    inside = (low <= found.statistics.rms) & (found.statistics.rms <= high)
    assert inside.mean() > 0.8
    assert found.statistics.nis[1:4].mean() > 10 * found.statistics.nis[-10:].mean()


def test_the_results_are_those_of_the_algorithm_that_works() -> None:
    """One that cannot take a perfect measurement gives way to the next, and the outcome says so."""
    found = run(replace(PLAN, anomalies=(Anomaly(5, 0, 0.0),), algorithms=("information", "joseph")))
    assert found.algorithm == "joseph"
    assert any("information refused" in note for note in found.notes)
    assert run(PLAN).notes == ()


def test_several_algorithms_are_compared_with_50_digits() -> None:
    """Accuracy and operations are those of ctlabs.filtering.algorithms; one that refuses stays in the table and says why."""
    plan = replace(PLAN, algorithms=("joseph", "ud", "steady"), anomalies=(Anomaly(5),))
    found = run(plan)
    assert [each.name for each in found.algorithms] == ["joseph", "ud", "steady"]
    assert "constant" in found.algorithms[2].failed
    assert set(found.estimates) == {"joseph", "ud"}
    model = anomalous(ready("constant_velocity").discrete(), plan.anomalies, 40)
    wanted = compare(model, found.z[:, :, 0][1:], ["ud"])[0]
    assert (found.algorithms[1].flops, found.algorithms[1].error_P) == (wanted.flops, wanted.error_P)
    np.testing.assert_allclose(found.estimates["ud"], found.estimates["joseph"], rtol=SOLVER)


def test_a_plan_whose_every_algorithm_refuses_is_refused() -> None:
    """The reason is the form's own."""
    with pytest.raises(ValueError, match="form steady: "):
        run(replace(PLAN, algorithms=("steady",), anomalies=(Anomaly(5),)))


def test_nothing_of_a_long_history_is_left_out() -> None:
    """Every instant is there, with the library's numbers; only the whole covariances are those of the first instants and the last."""
    found = run(replace(PLAN, steps=2500, runs=4))
    assert found.k.tolist() == list(range(2501))
    assert len(found.t) == len(found.z) == len(found.K) == 2501
    model = ready("constant_velocity").discrete()
    stats, plan = Experiment(4, 3).statistics(model, steps=2500), covariances(model, 2500)
    assert found.statistics is not None
    assert found.at is not None
    np.testing.assert_array_equal(found.statistics.rms, stats.rms)
    np.testing.assert_array_equal(found.sd_plus, plan.sd_plus)
    np.testing.assert_array_equal(found.sd_minus, plan.sd_minus)
    np.testing.assert_array_equal(found.P_plus, plan.P_plus[found.at])
    assert (len(found.at), found.at[-1]) == (experiments.POINTS + 1, 2500)


def test_the_first_measurement_may_be_at_t0() -> None:
    """A plan's ``first`` is the filter's, whatever the file says."""
    found = run(replace(PLAN, first=0))
    np.testing.assert_array_equal(found.P_plus, covariances(ready("constant_velocity").discrete(), 40, 0).P_plus)
    assert np.isfinite(found.z[0]).all()


# Measured ------------------------------------------------------------------------------------------------------------


def recorded(seed: int = 5, factor: float = 1.0, gap: int = 7) -> bytes:
    """A record of the model whose measurement noise is ``factor`` times as large, with a gap."""
    model = ready("constant_velocity").discrete()
    z = montecarlo.simulate(replace(model, R=factor**2 * model.R), 80, 1, seed).z[1:, 0, 0]
    names = ready("constant_velocity").measurements
    return ("\n".join([names[0], *("" if i == gap else repr(x) for i, x in enumerate(z.tolist()))]) + "\n").encode()


def test_a_measured_record_is_filtered_smoothed_and_judged(session: Session) -> None:
    """Estimates, smoother, likelihood and verdict are the library's on the same record."""
    record = asyncio.run(session.upload(recorded(factor=4.0), "track.csv"))
    assert record.missing == 1
    found = run(session.plan)
    model = ready("constant_velocity").discrete()
    z = record.z
    own = kalman_filter(model, z, algorithm="joseph")
    np.testing.assert_array_equal(found.x_plus[:, :, 0], own.x_plus)
    np.testing.assert_array_equal(found.innovation[:, :, 0], own.innovation)
    assert found.smoothed is not None
    np.testing.assert_array_equal(found.smoothed, smooth(model, own).x)
    verdict = diagnosis.diagnose(model, own)
    assert found.verdict is not None
    assert (found.verdict.verdict, found.verdict.factor_R) == (verdict.verdict, verdict.factor_R)
    assert verdict.verdict != "consistent"
    np.testing.assert_allclose(found.verdict.whiteness_p, verdict.whiteness_p, rtol=EXACT)
    np.testing.assert_allclose(found.verdict.mean_p, verdict.mean_p, rtol=EXACT)
    assert found.verdict.nis_p == pytest.approx(verdict.nis_p, rel=SOLVER, abs=1e-300)
    assert found.summary["log_likelihood"][0] == own.log_likelihood
    filtered = kalman_filter(model, z, algorithm="ud")
    gain = (own.x_plus - own.x_minus) / np.where(np.isnan(own.innovation), np.inf, own.innovation)
    used = own.used[:, 0]
    np.testing.assert_allclose(found.K[used, :, 0], gain[used], rtol=1e-6)
    np.testing.assert_array_equal(found.K[~used], 0)
    np.testing.assert_allclose(filtered.x_plus, own.x_plus, rtol=SOLVER)


def test_data_that_do_not_fit_the_model_are_refused_and_change_nothing(session: Session) -> None:
    """A wrong header, no text, too much of it: one line, and the plan is what it was."""
    before = session.plan
    for content in (b"flow\n1\n2\n", b"\x00\x01", b"", b"x" * 20_000_001):
        with pytest.raises(ValueError, match=r"^a\.csv: [^\n]+$"):
            asyncio.run(session.upload(content, "a.csv"))
    assert session.plan == before


def test_two_models_are_compared_on_one_record(session: Session) -> None:
    """With a design the record's likelihood is given under both."""
    asyncio.run(session.upload(recorded(), "track.csv"))
    session.set_design(ready("constant_velocity").replace({"sigma": 50}).dumps())
    found = run(session.plan)
    assert session.plan.data is not None
    z = session.plan.data.record(ready("constant_velocity").measurements).z
    wanted = log_likelihood(ready("constant_velocity").discrete(), z)
    assert found.summary["log_likelihood_of_the_other_model"][0] == wanted
    assert found.summary["log_likelihood"][0] != found.summary["log_likelihood_of_the_other_model"][0]
    assert session.design_differs() is not None


# Forms that travel ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("data", [False, True])
def test_an_outcome_survives_the_store_to_the_bit(data: bool) -> None:
    """Packed, written as text, read and unpacked it is the same."""
    plan = replace(PLAN, algorithms=("joseph", "ud"), data=Upload("track.csv", recorded().decode()) if data else None)
    found = run(plan)
    assert equal(outcome(unpack(pack(packed(found)))), found)
    other = replace(found, P_plus=1.05 * found.P_plus)
    assert not equal(other, found)


def test_a_plan_survives_json() -> None:
    """With an infinite variance, a design and data."""
    plan = replace(PLAN, anomalies=(Anomaly(3), Anomaly(5, 0, 0.0, 7)), design=MODEL, data=Upload("a", "z\n1\n"))
    assert Asked.of(json.loads(json.dumps(plan.plain()))) == plan


# A session's experiments ---------------------------------------------------------------------------------------------


def test_an_experiment_is_kept_and_can_be_reopened_after_a_kill(session: Session, store: Store) -> None:
    """Model, settings and results are there again; opening it is an edit that can be undone."""
    found = asyncio.run(session.run(name="First try"))
    number = session.result_id
    assert number is not None
    session.do(c.EditCell(("title",), "Something else"))
    session.set_plan(steps=7)
    again = Session.resume(store, session.draft.id)
    assert [each.name for each in again.kept()] == ["First try"]
    assert again.reopen(number) == "experiment"
    assert equal(again.result, found)
    assert again.text == MODEL
    assert again.plan == PLAN
    again.undo()
    assert again.title == "Something else"


def test_the_last_result_is_there_again_after_a_restart(store: Store) -> None:
    """That of this draft, also where the model has been changed since; not another draft's, and not a deleted one."""
    own, other = (Session.begin(store, text=MODEL) for _ in range(2))
    own.set_plan(steps=5, runs=3)
    found = asyncio.run(own.run())
    own.do(c.EditCell(("title",), "Changed"))
    again = Session.resume(store, own.draft.id)
    assert again.result_id == own.result_id
    assert again.result is not None
    assert equal(again.result, found)
    other = Session.resume(store, other.draft.id)
    assert (other.result, other.result_id) == (None, None)
    own.delete(own.result_id or 0)
    later = Session.resume(store, own.draft.id)
    assert (later.result, later.result_id) == (None, None)


def test_a_rerun_gives_the_same_numbers(session: Session) -> None:
    """Whatever has been edited since, a kept experiment runs again with its own model and settings."""
    first = asyncio.run(session.run())
    number = session.result_id or 0
    session.do(c.EditCell(("model", "dt"), "7"))
    session.set_plan(seed=9)
    second = asyncio.run(session.rerun(number))
    assert second.summary == first.summary
    assert session.kept()[0].name.endswith("(again)")
    difference = session.compare(number, session.result_id or 0)
    assert difference.same_model
    assert all(row.same for row in (*difference.settings, *difference.results))


def test_two_experiments_are_compared_line_by_line_and_number_by_number(session: Session) -> None:
    """The changed line of the model, the changed setting, the changed results, and nothing else."""
    asyncio.run(session.run())
    one = session.result_id or 0
    session.do(c.EditCell(("constants", "sigma"), "77"))
    session.set_plan(runs=70)
    asyncio.run(session.run())
    found = session.compare(one, session.result_id or 0)
    assert [line.mark for line in found.lines if line.mark != " "] == ["-", "+"]
    assert "77" in next(line.text for line in found.lines if line.mark == "+")
    assert [row.name for row in found.settings if not row.same] == ["runs"]
    assert not next(row for row in found.results if row.name == "rms[x]").same
    assert next(row for row in found.results if row.name == "nees_expected").same
    assert len(found.changes(0)) < len(found.lines)


def test_deleting_can_be_taken_back_and_others_see_nothing(session: Session, store: Store) -> None:
    """A deleted experiment is out of the list until it is restored; another owner's is unknown."""
    asyncio.run(session.run())
    number = session.result_id or 0
    session.delete(number)
    assert session.kept() == []
    with pytest.raises(ValueError, match="expected one that is kept"):
        session.outcome(number)
    session.restore(number)
    session.rename(number, "  Better\nname ")
    assert [each.name for each in session.kept()] == ["Better name"]
    stranger = Session.begin(store, "somebody")
    assert stranger.kept() == []
    for act in (stranger.outcome, stranger.reopen, stranger.delete, stranger.restore):
        with pytest.raises(ValueError, match="expected one that is"):
            act(number)


def test_a_model_with_problems_is_not_run(session: Session) -> None:
    """The first problem is the message."""
    session.do(c.EditCell(("model", "P0", 0, 0), "-1"))
    with pytest.raises(ValueError, match=r"^model\.P0: "):
        session.job()


def test_a_runner_gives_the_same_numbers_with_progress_and_can_be_cancelled(session: Session) -> None:
    """In a process of its own: equal to the bit; cancelled, it keeps nothing."""
    runner = Runner(size=1)
    try:
        seen: list[RunProgress] = []
        session.runner = runner
        found = asyncio.run(session.run(progress=seen.append))
        assert equal(replace(found, algorithms=()), replace(run(PLAN), algorithms=()))
        assert seen[-1].fraction == 1.0
        session.set_plan(runs=10_000_000)

        async def cancelled() -> None:
            stop = asyncio.Event()
            asyncio.get_running_loop().call_later(0.3, stop.set)
            await session.run(cancel=stop)

        with pytest.raises(RunFailed) as failed:
            asyncio.run(cancelled())
        assert failed.value.kind == "cancelled"
        assert len(session.kept()) == 1
    finally:
        runner.close()


# Exports -------------------------------------------------------------------------------------------------------------

WRONG = ready("constant_velocity").replace({"sigma": 50}).dumps()
PLANS = {
    "simulated": PLAN,
    "anomalies": replace(
        PLAN, anomalies=(Anomaly(5, last=7), Anomaly(20, 0, 0.0)), algorithms=("ud", "array"), first=0
    ),
    "design": replace(PLAN, design=WRONG, anomalies=(Anomaly(5),)),
    "constant gain": replace(PLAN, algorithms=("steady",), first=0),
    "constant gain, design": replace(PLAN, algorithms=("steady", "ud"), design=WRONG),
    "second algorithm": replace(PLAN, anomalies=(Anomaly(5, 0, 0.0),), algorithms=("information", "joseph")),
    "constant gain, data": replace(PLAN, data=Upload("track.csv", recorded(gap=-1).decode()), algorithms=("steady",)),
    "data": replace(PLAN, data=Upload("tr'ack.csv", recorded().decode())),
    "data_design": replace(PLAN, data=Upload("track.csv", recorded().decode()), design=WRONG, anomalies=(Anomaly(9),)),
}


Kept = dict[str, tuple[Session, int]]


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: Any) -> Iterator[Kept]:
    """An experiment of each kind, kept, its title no plain text."""
    store = Store(tmp_path_factory.mktemp("kept"))
    found: Kept = {}
    for name, plan in PLANS.items():
        made = Session.begin(store, text=MODEL)
        made.do(c.EditCell(("title",), 'A "title" with \\ and ’ in it'))
        made.set_plan(**{each.name: getattr(plan, each.name) for each in fields(Asked)})
        asyncio.run(made.run(name=f'{name}: "hello" \\n'))
        found[name] = made, made.result_id or 0
    yield found
    store.close()


@pytest.fixture(params=PLANS)
def kept(request: Any, shelf: Kept) -> tuple[Session, int]:
    """One kind after the other."""
    return shelf[request.param]


def test_the_python_lines_reproduce_the_numbers(shelf: Kept, tmp_path: Path) -> None:
    """Run by a plain interpreter, warnings being errors, they print every number of the summary again."""
    scripts = []
    for session, number in shelf.values():
        scripts.append(tmp_path / session.export_name(number, "python"))
        scripts[-1].write_bytes(session.export(number, "python"))
    one_by_one = "import runpy, sys; [runpy.run_path(path, run_name='__main__') for path in sys.argv[1:]]"
    command = [sys.executable, "-W", "error", "-c", one_by_one, *map(str, scripts)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rest = done.stdout
    for session, number in shelf.values():
        found, end = json.JSONDecoder().raw_decode(rest)
        rest = rest[end:].lstrip()
        wanted = {name: value for name, (value, _) in session.outcome(number).summary.items()}
        assert list(found) == list(wanted)
        for name, value in wanted.items():
            assert found[name] == (value if isinstance(value, str) else pytest.approx(value, rel=SOLVER)), name
    assert not rest


def test_the_table_holds_the_first_run(kept: tuple[Session, int]) -> None:
    """CSV that any program reads, numbers in full, an empty cell where there is none."""
    session, number = kept
    found = session.outcome(number)
    rows = list(csv.DictReader(io.StringIO(session.export(number, "csv").decode())))
    assert [int(row["k"]) for row in rows] == found.k.tolist()
    np.testing.assert_array_equal([float(row[found.states[0]]) for row in rows], found.x_plus[:, 0, 0])
    column = [row[f"{found.measurements[0]}_measured"] for row in rows]
    np.testing.assert_array_equal([float(cell or "nan") for cell in column], found.z[:, 0, 0])


def test_every_table_has_every_row_and_parquet_is_the_same(kept: tuple[Session, int]) -> None:
    """An instant, a run, a lag, a form, a number to a row; both formats hold the doubles to the bit."""
    session, number = kept
    found = session.outcome(number)
    runs = found.x_plus.shape[2]
    wanted = {"histories": len(found.t), "runs": runs * len(found.t), "gains": len(found.t), "algorithms": len(found.algorithms)}
    wanted |= {"numbers": len(found.summary)} | ({} if found.verdict is None else {"innovations": len(found.verdict.lags)})
    for name in session.tables(number):
        rows = list(csv.DictReader(io.StringIO(session.export(number, "csv", name).decode())))
        frame = pd.read_parquet(io.BytesIO(session.export(number, "parquet", name)))
        assert len(rows) == len(frame) == wanted[name]
        for column in frame.columns:
            cells, values = [row[column] for row in rows], frame[column]
            if pd.api.types.is_numeric_dtype(values):
                np.testing.assert_array_equal([float(cell or "nan") for cell in cells], values.to_numpy(dtype=float))
    assert set(session.tables(number)) == set(wanted) - (set() if found.truth is not None else {"runs"})
    with pytest.raises(ValueError, match="table: expected one of histories"):
        session.export(number, "csv", "nothing")


def test_the_tables_hold_what_was_computed(shelf: Kept) -> None:
    """Gains and variances by their names; of each run its own truth and estimate."""
    session, number = shelf["design"]
    found = session.outcome(number)
    state, sensor = found.states[1], found.measurements[0]
    gains = pd.read_csv(io.BytesIO(session.export(number, "csv", "gains")))
    np.testing.assert_array_equal(gains[f"K_{state}_{sensor}"], found.K[:, 1, 0])
    np.testing.assert_array_equal(gains[f"{state}_variance_after"], found.P_plus[:, 1, 1])
    runs = pd.read_csv(io.BytesIO(session.export(number, "csv", "runs")))
    for run, own in runs.groupby("run"):
        np.testing.assert_array_equal(own[state], found.x_plus[:, 1, run - 1])
        np.testing.assert_array_equal(own[f"{state}_true"], found.truth[:, 1, run - 1])  # type: ignore[index]  # simulated


@pytest.mark.parametrize("kind", ["simulated", "data_design"])
def test_gains_go_to_other_programs(shelf: Kept, kind: str) -> None:
    """Of the filter's own model, to NumPy, MATLAB and C: the steady gain, or where an anomaly hinders it that of every instant."""
    session, number = shelf[kind]
    found = session.outcome(number)
    arrays = np.load(io.BytesIO(session.export(number, "npz")))
    matlab = loadmat(io.BytesIO(session.export(number, "mat")))
    header = session.export(number, "h").decode()
    if kind == "simulated":
        np.testing.assert_allclose(arrays["K"], steady.solve(loads(MODEL).discrete()).K, rtol=EXACT)
        np.testing.assert_array_equal(matlab["K"], arrays["K"])
    else:
        np.testing.assert_allclose(arrays["K"], found.K, rtol=SOLVER, atol=SOLVER)
        np.testing.assert_array_equal(np.moveaxis(matlab["K"], -1, 0), arrays["K"])
    assert "static const double gains_K" in header
    assert f"{arrays['K'].ravel()[-1]:.17g}" in header
    assert session.export_name(number, "h").endswith("_gains.h")


def test_the_report_is_printed_or_the_missing_program_is_named(shelf: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    """As PDF; without the extra the line says what to install."""
    session, number = shelf["data"]
    monkeypatch.setitem(sys.modules, "typst", None)
    with pytest.raises(ValueError, match=r"^PDF: expected .* \(pip install 'ctlabs\[print\]'\), received none of typst"):
        session.export(number, "pdf")
    monkeypatch.undo()
    assert session.export(number, "pdf").startswith(b"%PDF-")


@pytest.mark.parametrize("kind", ["simulated", "data"])
def test_the_commands_give_the_same_numbers(shelf: Kept, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each line is a command of ctlabs that ends well beside the model file and the record; their results are those of the page."""
    session, number = shelf[kind]
    found, plan = session.outcome(number), session.plan
    monkeypatch.chdir(tmp_path)
    Path("model.toml").write_bytes(session.export(number, "toml"))
    if plan.data is not None:
        Path(plan.data.name).write_text(plan.data.text)
    lines = [line for line in session.export(number, "commands").decode().splitlines() if not line.startswith("#")]
    for line in lines[1:]:
        word, *rest = shlex.split(line)
        assert word == "ctlabs"
        with pytest.raises(SystemExit) as ended:
            cli.main(rest)
        assert not ended.value.code
    if kind == "simulated":
        values = json.loads(Path("simulated/results.json").read_text())["values"]
        np.testing.assert_allclose(values["rms"]["value"], [found.summary[f"rms[{name}]"][0] for name in found.states], rtol=1e-9)
    else:
        table = pd.read_csv("estimates.csv")
        np.testing.assert_allclose(table[found.states[0]], found.x_plus[1:, 0, 0], rtol=SOLVER)
        assert Path("gains.npz").exists()


def test_a_long_record_is_beside_the_lines(monkeypatch: pytest.MonkeyPatch, shelf: Kept) -> None:
    """It is not repeated in them; they name its file."""
    session, number = shelf["data"]
    monkeypatch.setattr(programs, "LONG", 100)
    lines = session.export(number, "python").decode()
    assert "DATA" not in lines
    assert 'file = Path("tr\'ack.csv")' in lines


def test_json_holds_everything_and_is_json(kept: tuple[Session, int]) -> None:
    """Model, settings, summary and results, without NaN."""
    session, number = kept

    def refuse(word: str) -> None:
        raise ValueError(word)

    found = json.loads(session.export(number, "json"), parse_constant=refuse)
    own = session.outcome(number)
    assert found["model"] == session.text
    assert Asked.of(found["settings"]) == session.plan
    assert np.array(found["results"]["P_plus"], dtype=float).tolist() == own.P_plus.tolist()
    assert {name: each["value"] for name, each in found["summary"].items()} == {
        k: v for k, (v, _) in own.summary.items()
    }


@pytest.mark.parametrize("kind", PLANS)
def test_the_report_has_the_numbers_and_its_checks_pass(shelf: Kept, kind: str) -> None:
    """Every number of the summary; the covariances agree with another form of the filter, and not with wrong ones."""
    session, number = shelf[kind]
    found = session.outcome(number)
    made = report("x", session.text, session.plan, found)
    assert made.checks
    assert made.passed
    for name, (value, _) in found.summary.items():
        assert made.values[name].value == value
    if kind == "data":
        assert not report("x", session.text, session.plan, replace(found, P_plus=1.05 * found.P_plus)).passed


@pytest.mark.parametrize("kind", ["anomalies", "data"])
def test_the_report_is_one_page_and_pictures_are_pictures(shelf: Kept, kind: str) -> None:
    """No request to any server; every figure as SVG that parses; one as PNG; an unknown one is refused."""
    session, number = shelf[kind]
    page = session.export(number, "html").decode()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "<script" not in page
    for name in session.figures(number):
        assert ET.fromstring(session.export(number, "svg", name)).tag.endswith("svg")
    assert session.export(number, "png").startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="figure: expected one of estimates_1"):
        session.export(number, "png", "nothing")
    with pytest.raises(ValueError, match="export: expected one of html, pdf, csv"):
        session.export(number, "doc")


def test_the_model_is_exported_as_it_was(kept: tuple[Session, int]) -> None:
    """The text of the file, to the letter."""
    session, number = kept
    assert session.export(number, "toml").decode() == session.text


def test_anomalies_of_correlated_measurements_leave_no_correlation_behind() -> None:
    """Row and column of the element are zero at the instant, so that R stays a covariance."""
    model = DiscreteModel([[1]], [[1]], [[1], [1]], [[2, 1], [1, 2]], x0=[0], P0=[[1]])
    found = anomalous(model, [Anomaly(1, 0), Anomaly(2, 1, 0.0)], 2)
    np.testing.assert_array_equal(found.R[1], [[np.inf, 0], [0, 2]])
    np.testing.assert_array_equal(found.R[2], [[2, 0], [0, 0]])


def hostile() -> str:
    """A model whose words would be formulas, pictures, placeholders and columns somewhere else."""
    text = loads(MODEL).edit(("model", "states"), ["{q}", "![](http://evil.example/x.png)"])
    text = text.edit(("model", "units"), [r"$\frac{a}{$ b", "<script>alert(1)</script>"])
    return (
        text.edit(("model", "measurements"), ["=1+2"])
        .edit(("title",), r"$\frac{$ <b>bold</b> [x](http://evil.example)")
        .dumps()
    )


@pytest.fixture(scope="module")
def hostile_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """An experiment with it, whose own name is no better."""
    store = Store(tmp_path_factory.mktemp("hostile"))
    made = Session.begin(store, text=MODEL)
    made.do(c.Open(hostile()))
    made.set_plan(steps=20, runs=5, seed=3)
    asyncio.run(made.run(name="a\0b\ud800 $\\frac{$"))
    yield made
    store.close()


@pytest.mark.parametrize("kind", ["html", "csv", "json", "png", "svg", "python", "commands", "toml", "h"])
def test_words_of_a_model_do_nothing_in_its_exports(hostile_run: Session, kind: str) -> None:
    """They are shown as they are: nothing is fetched, computed, formatted or broken by them."""
    assert hostile_run.kept()[0].name == "ab $\\frac{$"
    made = hostile_run.export(hostile_run.result_id or 0, kind)
    if kind == "html":
        page = made.decode()
        assert not re.search(r"""(src|href)=["']?(http|//)""", page)
        assert "<script" not in page
        assert "default-src 'none'" in page
    if kind == "csv":
        assert "'=1+2_measured" in made.decode().splitlines()[0].split(",")
    if kind == "python":
        compile(made, "export.py", "exec")
    if kind == "commands":
        assert not [line for line in made.decode().splitlines() if line[:1] != "#" and not line.startswith("ctlabs ")]


def test_columns_of_one_name_are_refused(session: Session) -> None:
    """A state called nis would take the place of the statistic; the reason is told."""
    session.do(c.Open(loads(MODEL).edit(("model", "states"), ["t", "nis"]).dumps()))
    session.set_plan(steps=20, runs=5)
    asyncio.run(session.run())
    with pytest.raises(ValueError, match='received "t" twice: rename a state or a measurement'):
        session.export(session.result_id or 0, "csv")
