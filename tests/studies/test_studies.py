"""Studies of one's own model and data: every number against a textbook, whatever way it came."""

import csv
import dataclasses
import io
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from ctlabs.analysis import diagnosis, sensitivity
from ctlabs.analysis.naming import selection
from ctlabs.files import clock, datafile, modelfile
from ctlabs.files.mapping import Mapping
from ctlabs.filtering import steady
from ctlabs.filtering.algorithms import catalogue
from ctlabs.reporting import render
from ctlabs.studies import analysis, common, comparison, filtering, fitting, second, simulation
from tests import reference
from tests.nile import FLOW, Q, R
from tests.reference import SOLVER, close

#: What a person writes in five minutes.
NILE = """\
format = 1
title = "Flow of the Nile"
kind = "discrete"
[constants]
q = 1469.1
r = 15099
[model]
states = ["level"]
measurements = ["flow"]
Phi = [[1]]
Qd = [["q"]]
H = [[1]]
R = [["r"]]
P0 = [[1e7]]
dt = 1
"""
TRACK = """\
format = 1
title = "Track"
kind = "continuous"
[constants]
q = 0.5
r = 4
[model]
states = ["x", "v"]
units = ["m", "m/s"]
measurements = ["gps", "radar"]
F = [[0, 1], [0, "-0.1"]]
G = [[0], [1]]
Q = [["q"]]
H = [[1, 0], [1, 1]]
R = [["r", 1], [1, "2*r"]]
P0 = [[100, 0], [0, 10]]
dt = 0.5
[experiment]
steps = 40
runs = 100
"""
GAPS = np.where((np.arange(100) >= 20) & (np.arange(100) < 40), np.nan, FLOW)


def nile(values=FLOW, **constants):
    """The model file and the record, as read from their texts."""
    text = "flow\n" + "\n".join("NA" if x != x else f"{x:g}" for x in values) + "\n"
    return modelfile.loads(NILE).replace(constants), datafile.parse(text.encode(), ["flow"], "flow.csv")


def track(text: str = TRACK, rows: int = 30, seed: int = 1, times=None):
    """A model of two sensors and a record with gaps in one of them; ``times`` of the rows, uniform if not given."""
    model = modelfile.loads(text)
    rng = np.random.default_rng(seed)
    z = np.cumsum(rng.normal(size=(rows, 1)), axis=0) + rng.normal(size=(rows, 2))
    z[rng.random(rows) < 0.3, 1] = np.nan
    head = ("t," if times is not None else "") + "radar,gps"
    lines = [
        ([] if times is None else [repr(float(times[k]))]) + ["" if x != x else repr(float(x)) for x in z[k, ::-1]]
        for k in range(rows)
    ]
    return model, datafile.parse("\n".join([head, *map(",".join, lines)]).encode(), model.measurements, "track.csv")


def rows_of(report, name: str = "estimates") -> dict[str, np.ndarray]:
    """A CSV file of a report as columns of numbers."""
    first, *rest = csv.reader(io.StringIO(report.files[f"{name}.csv"].decode()))
    table = np.array([[float(cell or "nan") for cell in row] for row in rest])
    return dict(zip(first, table.T, strict=True))


def value(report, name: str):
    return report.values[name].value


def rauch_tung_striebel(moments) -> tuple[np.ndarray, np.ndarray]:
    """The smoother of a local level, written for scalars."""
    x, P = moments.x_plus[:, 0].copy(), moments.P_plus[:, 0, 0].copy()
    for k in range(len(x) - 2, -1, -1):
        C = P[k] / moments.P_minus[k + 1, 0, 0]
        x[k] += C * (x[k + 1] - moments.x_minus[k + 1, 0])
        P[k] += C**2 * (P[k + 1] - moments.P_minus[k + 1, 0, 0])
    return x, P


@pytest.fixture(scope="module")
def one_second_route():
    """The second route of the smoother, which knows nothing of the algorithm, once for each record."""
    known, right = {}, second.smoothed

    def smoothed(model, z, first):
        given = model.Phi, model.Qd, model.H, model.R, model.x0, model.P0, z
        key = first, model.N is None, model.offset is None, *(M.tobytes() for M in given)
        if key not in known or model.N is not None or model.offset is not None:
            known[key] = right(model, z, first)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(second, "smoothed", smoothed)
        yield


class TestFiltering:
    @pytest.mark.usefixtures("one_second_route")
    @pytest.mark.parametrize("values", [FLOW, GAPS], ids=["whole", "gaps"])
    @pytest.mark.parametrize("algorithm", ["joseph", "ud", "srif"])
    def test_the_nile_filters_and_smooths_as_by_the_textbook(self, values, algorithm):
        """Estimates, innovations and likelihood of 100 years, with and without missing cells, to 1e-9."""
        model, record = nile(values)
        report = filtering.study(model, record, algorithm=algorithm, smooth=True)
        z = np.concatenate([[np.nan], values])[:, None]
        textbook = model.discrete()
        wanted = reference.recursion(textbook, z)
        xs, Ps = rauch_tung_striebel(wanted)
        found = rows_of(report)
        assert found["k"].tolist() == list(range(1, 101))
        for column, expected in (
            ("level", wanted.x_plus[1:, 0]),
            ("level_sd", np.sqrt(wanted.P_plus[1:, 0, 0])),
            ("level_smoothed", xs[1:]),
            ("level_smoothed_sd", np.sqrt(Ps[1:])),
            ("innovation_flow", values - wanted.x_minus[1:, 0]),
            ("innovation_sd_flow", np.where(np.isnan(values), np.nan, np.sqrt(wanted.P_minus[1:, 0, 0] + R))),
        ):
            assert close(found[column], expected, 1e-9), column
        likelihood = reference.log_likelihood(textbook, z)
        assert abs(value(report, "log_likelihood") - likelihood) < 1e-9 * abs(likelihood)
        broken = reference.recursion(model.replace({"q": 1.05 * Q}).discrete(), z)
        assert not close(found["level"], broken.x_plus[1:, 0], 1e-9)
        assert report.passed

    def test_the_first_row_is_t1_or_t0(self):
        """With first = 0 the first flow meets the initial estimate itself."""
        model, record = nile()
        at_start = modelfile.loads(NILE + "[experiment]\nfirst = 0\n")
        wanted = reference.recursion(at_start.discrete(), FLOW[:, None], first=0)
        found = rows_of(filtering.study(at_start, record))
        assert found["k"].tolist() == list(range(100))
        assert close(found["level"], wanted.x_plus[:, 0], 1e-9)
        assert not close(found["level"], rows_of(filtering.study(model, record))["level"], 1e-9)

    def test_what_the_data_say_is_a_value(self):
        """NIS with its band, missing cells, verdict: the right constants are not suspected, wrong ones are."""
        model, record = nile(GAPS)
        report = filtering.study(model, record)
        assert (value(report, "steps"), value(report, "missing")) == (100, 20)
        low, high = value(report, "nis_band")
        assert low < value(report, "nis_mean") < high
        assert value(report, "verdict") == "consistent"
        wrong = filtering.study(*nile(r=1500.0, q=10.0))
        assert value(wrong, "verdict") != "consistent"
        assert value(wrong, "nis_mean") > value(wrong, "nis_band")[1]
        assert value(wrong, "nis_p") < 1e-6
        assert wrong.passed  # data are no failed check

    def test_uneven_times_discretise_every_interval(self):
        """Equal to the textbook with Φ and Qd of each interval from its own length, two sensors, gaps."""
        from scipy.linalg import expm

        times = np.cumsum(np.random.default_rng(2).uniform(0.1, 2.0, 30))
        model, record = track(times=times)
        found = rows_of(filtering.study(model, record, algorithm="ud"))
        F, W = np.array([[0, 1], [0, -0.1]]), np.diag([0, 0.5])
        x, P, wanted = np.zeros(2), np.diag([100.0, 10.0]), []
        H, cov = np.array([[1.0, 0], [1, 1]]), np.array([[4.0, 1], [1, 8]])
        for h, z in zip(np.diff(times, prepend=0.0), record.z, strict=True):
            block = expm(np.block([[-F, W], [np.zeros((2, 2)), F.T]]) * h)
            Phi = block[2:, 2:].T
            x, P = reference.predict(x, P, Phi, Phi @ block[:2, 2:])
            used = ~np.isnan(z)
            x, P, _K = reference.update(x, P, z[used], H[used], cov[np.ix_(used, used)])
            wanted.append([*x, *np.sqrt(np.diag(P))])
        assert close(np.column_stack([found[c] for c in ("x", "v", "x_sd", "v_sd")]), wanted, 1e-9)
        np.testing.assert_array_equal(found["t"], times)
        even = rows_of(filtering.study(*track()))
        assert not close(even["x"], found["x"], 1e-3)

    def test_even_times_are_the_models_own_period(self):
        """A column t on the grid changes nothing."""
        with_t = rows_of(filtering.study(*track(times=0.5 * np.arange(1, 31))))
        without = rows_of(filtering.study(*track()))
        assert close(with_t["x"], without["x"], 1e-12)
        np.testing.assert_allclose(without["t"], with_t["t"])

    def test_a_wrong_design_is_judged_by_the_truth(self):
        """Claimed, true and optimal errors as sensitivity analysis has them; both likelihoods."""
        model, record = nile(GAPS)
        report = filtering.study(model, record, design=model.replace({"q": 10 * Q}))
        assert value(report, "rms_optimal")[0] < value(report, "rms_theory")[0]
        z = np.concatenate([[np.nan], GAPS])[:, None]
        truth, design = ({"q": q} for q in (Q, 10 * Q))
        for name, constants in (("log_likelihood_truth", truth), ("log_likelihood", design)):
            wanted = reference.log_likelihood(model.replace(constants).discrete(), z)
            assert abs(value(report, name) - wanted) < 1e-9 * abs(wanted)
        # the last rows have no gaps, and the filter has forgotten them
        limit = sensitivity.steady(model.discrete(), model.replace(design).discrete())
        assert close(value(report, "rms_theory"), np.sqrt(np.diag(limit.P_plus)), 1e-6)

    def test_a_record_without_a_measurement_says_nothing(self):
        """The estimates are the predictions."""
        model, record = nile([np.nan, np.nan])
        report = filtering.study(model, record)
        assert close(rows_of(report)["level_sd"], np.sqrt(1e7 + Q * np.array([1, 2])), 1e-12)
        assert value(report, "log_likelihood") == 0
        assert "verdict" not in report.values

    def test_two_sensors_that_are_almost_one_are_filtered_by_every_form_that_starts_apart(self, monkeypatch):
        """A prior that is large beside the noises costs no digits, in Joseph's form either."""
        model = modelfile.ready("ill_conditioned")
        data = simulation.study(model, runs=1, steps=5, csv_runs=1).files["data.csv"]
        record = datafile.parse(data, model.measurements)
        discrete, z, _t = clock.timed(model, record)
        wanted = reference.high_precision(discrete, z).x_plus[-1]
        # The verdict owes nothing to the form, and its search for better variances takes most of the time: that of coarse sensors.
        verdict = diagnosis.diagnose(dataclasses.replace(discrete, Qd=0.1 * np.eye(3), R=np.eye(2)), z[1:])
        monkeypatch.setattr(diagnosis, "diagnose", lambda *_given, **_named: verdict)
        for form in ("joseph", "ud"):
            report = filtering.study(model, record, algorithm=form)
            assert close(value(report, "estimate_end"), wanted, 1e-6), form


class TestSteadyGain:
    def test_a_steady_gain_is_no_failed_check(self):
        """Its estimates by a schedule of constant gains; the verdict is on the model, not on the filter's start."""
        report = filtering.study(*nile(), algorithm="steady", smooth=True)
        assert report.passed
        assert value(report, "verdict") == "consistent"
        assert value(report, "nis_mean") > value(report, "nis_band")[1]
        model = modelfile.loads(NILE).discrete()
        K, x, wanted = steady.solve(model).K[0, 0], 0.0, []
        for z in FLOW:
            x += K * (z - x)
            wanted.append(x)
        assert close(rows_of(report)["level"], wanted, 1e-9)

    def test_another_gain_is_noticed(self, monkeypatch):
        """5 % off in the gain of the second route."""
        solve = steady.solve
        off = [False]

        def torn(model):
            found = solve(model)
            return dataclasses.replace(found, K=1.05 * found.K) if off[0] else found

        run = filtering.compute(*nile(), "steady")
        off[0] = True
        monkeypatch.setattr(steady, "solve", torn)
        report = common.begin("filter", "", *nile()[:1], "b", common.settings(nile()[0]))
        report.section("b", "")
        filtering.steady_route(report, run)
        assert not report.passed


class TestClock:
    @pytest.mark.parametrize(
        ("text", "times", "line"),
        [
            (TRACK, [0.0, 1.0], r"track.csv: line 2, column t: expected a time after t0 = 0 .*, received 0; .*first = 0"),
            (TRACK + "first = 0\n", [1.0, 2.0], r"track.csv: line 2, column t: expected t0 = 0 .*, received 1; --t0 first, or set t0 = 1"),
            (TRACK + "first = 0\n", [0.0], r"track.csv: expected at least 2 rows .*, received 1"),
        ],
    )  # fmt: skip
    def test_a_first_row_at_the_wrong_time_is_refused(self, text, times, line):
        """With what to change in the model file."""
        with pytest.raises(ValueError, match=line):
            clock.timed(*track(text, rows=len(times), times=times))

    def test_a_discrete_model_names_the_row_that_is_off_its_grid(self):
        """Its period is what it has; rounding of the written times is no offence, and rows may be left out."""
        model = modelfile.loads(NILE)

        def record(*times):
            text = "t,flow\n" + "\n".join(f"{t},1" for t in times)
            return datafile.parse(text.encode(), ["flow"], "flow.csv")

        message = r"flow\.csv: line 4, column t: 1873\.4 may be 1873 or 1874 \(.*one period, here 1 s\).*--time none.*continuous"
        with pytest.raises(ValueError, match=message):
            clock.timed(model, record(1871, 1872, 1873.4, 1875))
        with pytest.raises(ValueError, match=r"line 3, column t: no two rows are one period .* but 30 or more.*--time t:s.*--time none"):
            clock.timed(model, record(0, 30, 61))
        _, z, t = clock.timed(model, record(1871, 1872, 1874, 1875))
        np.testing.assert_array_equal(np.isnan(z[:, 0]), [True, False, False, True, False, False])
        np.testing.assert_array_equal(t, np.arange(1870, 1876))
        discrete, z, t = clock.timed(model, record(1871, 1872.001, 1872.999))
        assert t[0] == 1870
        assert z.shape == (4, 1)
        assert discrete.horizon is None

    def test_a_cut_model_is_the_beginning_of_the_whole(self):
        """Every matrix that varies, shortened alike."""
        model, record = track(times=np.cumsum(np.linspace(0.1, 1, 30)))
        discrete, z, _t = clock.timed(model, record)
        part = discrete.cut(7)
        assert part.horizon == 7
        whole = reference.recursion(discrete, z)
        assert close(reference.recursion(part, z[:8]).x_plus, whole.x_plus[:8], 1e-15)


class TestFitting:
    @pytest.mark.parametrize("values", [FLOW, GAPS], ids=["whole", "gaps"])
    def test_the_niles_variances_are_those_of_greatest_likelihood(self, values):
        """From a start ten times off to the maximum that another optimiser finds with the textbook's likelihood."""
        model, record = nile(values, q=150.0, r=150000.0)
        report = fitting.study(model, record, ["q", "r"])
        z = np.concatenate([[np.nan], values])[:, None]

        def negative(logs):
            q, r = np.exp(logs)
            P, x, total = 1e7, 0.0, 0.0
            for flow in z[1:, 0]:
                P += q
                if flow == flow:
                    S = P + r
                    total += 0.5 * ((flow - x) ** 2 / S + np.log(2 * np.pi * S))
                    x, P = x + P / S * (flow - x), P * r / S
            return total

        best = minimize(negative, np.log([1000, 10000]), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-11})
        found = np.array([value(report, "q"), value(report, "r")])
        np.testing.assert_allclose(found, np.exp(best.x), rtol=1e-4)
        assert abs(value(report, "log_likelihood") + best.fun) < 1e-8 * best.fun
        assert value(report, "converged") is True
        assert report.passed
        if values is FLOW:  # Durbin & Koopman's values, printed with five digits
            np.testing.assert_allclose(found, [Q, R], rtol=1e-3)
            np.testing.assert_allclose([value(report, "q_se"), value(report, "r_se")], [1280, 3146], rtol=0.01)

    def test_start_values_stand_under_parameters_alone(self):
        """The values are the estimates; the file that comes with them holds them too."""
        model, record = nile(q=150.0)
        report = fitting.study(model, record, ["q"])
        assert report.results()["parameters"]["q"] == 150.0
        assert value(report, "q") != 150.0
        fitted = modelfile.loads(report.files["fitted.toml"].decode())
        assert fitted.constants == {"q": value(report, "q"), "r": 15099.0}

    def test_an_unknown_constant_is_refused_by_name(self):
        """With what was perhaps meant."""
        with pytest.raises(ValueError, match=r"--free qq: expected one of q, r \(did you mean q\?\), received"):
            fitting.study(*nile(), ["qq"])


class TestRefusals:
    def test_a_value_that_no_double_can_judge_is_named(self):
        """Its square is beyond double precision: the line and the column, not a form's rounding."""
        model = modelfile.loads(NILE)
        record = datafile.parse(b"flow\n1\n-1e200\n2\n", ["flow"], "flow.csv")
        with pytest.raises(FloatingPointError, match=r"flow\.csv: line 3, column flow: expected .*, received -1e\+200"):
            filtering.study(model, record)

    @pytest.mark.parametrize("names", ['["x", "x_sd"]', '["k", "v"]', '["x", "innovation_gps"]'])
    def test_columns_of_one_name_are_refused(self, names):
        """States whose names are those of other columns of estimates.csv."""
        with pytest.raises(
            ValueError, match=r'estimates\.csv: expected columns of different names, received "\w+" twice'
        ):
            filtering.study(*track(TRACK.replace('["x", "v"]', names)))

    def test_measurements_in_another_order_are_not_taken_for_each_other(self):
        """A design of the same sensors must name them in the same order."""
        model, record = track()
        swapped = modelfile.loads(TRACK.replace('["gps", "radar"]', '["radar", "gps"]'))
        with pytest.raises(ValueError, match=r"measurements \(gps, radar\) in this order, received radar, gps"):
            filtering.study(model, record, design=swapped)

    def test_states_that_are_the_truths_in_part_stand_for_none(self):
        """v, s of a truth x, v: no place decides; other names altogether stand for their places."""
        assert selection(["x", "v"], ["v", "s"]) is None
        assert selection(["x", "v"], ["a", "b"]).tolist() == np.eye(2).tolist()
        assert selection(["x", "v"], ["v", "x"]).tolist() == [[0, 1], [1, 0]]

    def test_a_gap_that_leaves_no_digits_is_refused_or_left_to_factors(self):
        """After 10¹² s without data a constant velocity is not known to any digit: Joseph's form refuses, with what would help."""
        model, record = track(times=[1.0, 2.0, 1e12, 1e12 + 1], rows=4)
        with pytest.raises(FloatingPointError, match=r"digits left in double precision.*a larger R.*algorithm ud"):
            filtering.study(model.replace({"q": 1e4}), record, algorithm="joseph")
        assert filtering.study(model.replace({"q": 1e4}), record).parameters.plain()["algorithm"] in ("ud", "ld")
        assert "nearly singular" not in render.markdown(filtering.study(*track()))


class TestSimulation:
    def test_rounding_is_told_from_a_wrong_theory(self):
        """A failed check of a nearly singular model comes with what to do; of a sound one it would not."""
        text = NILE.replace("r = 15099", "r = 1e-149").replace("q = 1469.1", "q = 1")
        report = simulation.study(modelfile.loads(text), runs=50, steps=20)
        assert not report.passed
        assert "`ctlabs compare` shows the forms that keep their digits" in value(report, "advice")
        assert "advice" not in simulation.study(modelfile.loads(NILE), runs=50, steps=20).values

    def test_a_measurement_named_as_its_state_has_a_column_of_its_own(self):
        """runs.csv tells them apart; data.csv is as the filter reads it, without a second t."""
        text = NILE.replace('["flow"]', '["level"]')
        rows = rows_of(simulation.study(modelfile.loads(text), runs=5, steps=5, csv_runs=1), "runs")
        assert list(rows) == ["run", "k", "t", "level", "measured_level"]
        report = simulation.study(modelfile.loads(NILE.replace('["flow"]', '["t"]')), runs=5, steps=5, csv_runs=1)
        assert list(rows_of(report, "data")) == ["t"]
        assert rows_of(report, "data")["t"].tolist() == rows_of(report, "runs")["measured_t"][1:].tolist()

    def test_the_ensemble_agrees_with_theory_and_workers_change_nothing(self):
        """Every test of chance; the same bytes of results for one worker and two."""
        model = modelfile.loads(TRACK)
        one, two = (simulation.study(model, workers=workers).results() for workers in (1, 2))
        assert one == two
        assert [check["name"] for check in one["checks"] if not check["passed"]] == []
        assert {check["kind"] for check in one["checks"]} == {"CHANCE"}
        other = simulation.study(model, seed=2).results()
        assert other["values"]["rms"] != one["values"]["rms"]

    def test_a_wrong_design_has_the_errors_that_theory_gives_it(self):
        """Not those that it claims."""
        model = modelfile.loads(TRACK)
        report = simulation.study(model, design=model.replace({"q": 50.0}), runs=400)
        assert report.passed
        theory, claimed = np.array(value(report, "rms_theory")), np.array(value(report, "rms_claimed"))
        np.testing.assert_allclose(value(report, "rms"), theory, rtol=0.25)
        assert (theory < claimed).all()
        assert (np.array(value(report, "cost")) > 1.05).all()

    def test_a_design_may_have_fewer_states(self):
        """Its states stand for those of the same name; others are refused."""
        walk = (
            TRACK.replace('["x", "v"]', '["x"]')
            .replace('["m", "m/s"]', '["m"]')
            .replace('[[0, 1], [0, "-0.1"]]', "[[0]]")
        )
        walk = walk.replace("G = [[0], [1]]", "G = [[1]]").replace("H = [[1, 0], [1, 1]]", "H = [[1], [1]]")
        walk = walk.replace("P0 = [[100, 0], [0, 10]]", "P0 = [[100]]")
        report = simulation.study(modelfile.loads(TRACK), design=modelfile.loads(walk), runs=50)
        assert report.passed
        assert len(value(report, "rms")) == 1
        with pytest.raises(ValueError, match=r"design: expected states among the model's \(x, v\), received y"):
            simulation.study(modelfile.loads(TRACK), design=modelfile.loads(walk.replace('["x"]', '["y"]')), runs=5)
        with pytest.raises(
            ValueError, match=r"design: expected the model's measurements \(flow\), received gps, radar"
        ):
            simulation.study(modelfile.loads(NILE), design=modelfile.loads(TRACK), runs=5)

    def test_simulated_data_go_straight_into_the_filter(self):
        """runs.csv holds states and measurements, data.csv what `filter` reads; the errors have the filter's size."""
        model = modelfile.loads(TRACK)
        report = simulation.study(model, runs=2, csv_runs=2)
        everything = rows_of(report, "runs")
        first = everything["run"] == 1
        assert first.sum() == 41
        record = datafile.parse(report.files["data.csv"], model.measurements)
        np.testing.assert_array_equal(record.z[:, 0], everything["gps"][first][1:])
        found = rows_of(filtering.study(model, record))
        error = (found["x"] - everything["x"][first][1:]) / found["x_sd"]
        assert 0.3 < np.sqrt((error**2).mean()) < 2


class TestAnalysis:
    @pytest.mark.parametrize("r", [0.0, 1e-100])
    def test_a_filter_that_forgets_at_once_has_its_limit(self, r):
        """Perfect measurements: every pole is 0, and the recursion is there after the first update."""
        report = analysis.study(modelfile.loads(NILE).replace({"r": r}))
        assert report.passed
        assert close(value(report, "P_minus_steady"), [[Q]], SOLVER)

    def test_the_niles_steady_filter_is_the_closed_form(self):
        """P⁻ = (q + √(q² + 4qr))/2, K = P⁻/(P⁻ + r), pole 1 − K."""
        report = analysis.study(modelfile.loads(NILE))
        P = (Q + np.sqrt(Q**2 + 4 * Q * R)) / 2
        K = P / (P + R)
        for name, wanted in (("P_minus_steady", P), ("P_plus_steady", K * R), ("gain_steady", K)):
            assert close(value(report, name)[0][0], wanted, SOLVER), name
        assert close(value(report, "filter_poles")[0], [1 - K, 0], SOLVER)
        num, den = value(report, "transfer_level_flow")
        assert close(num, [K, 0], SOLVER)
        assert close(den, [1, K - 1], SOLVER)
        assert report.passed

    def test_a_mode_that_is_not_seen_is_named_and_there_is_no_steady_filter(self):
        """Null, with the reason."""
        blind = TRACK.replace("[[1, 0], [1, 1]]", "[[0, 1], [0, 1]]")
        report = analysis.study(modelfile.loads(blind))
        assert value(report, "observable") is False
        assert value(report, "detectable") is False
        assert value(report, "gain_steady") is None
        assert "eigenvalue 1" in report.values["gain_steady"].reason
        assert report.passed

    def test_a_continuous_measurement_has_its_own_filter(self):
        """Rc instead of R: the Kalman–Bucy gain beside the sampled one."""
        text = TRACK.replace('R = [["r", 1], [1, "2*r"]]', 'Rc = [["r", 1], [1, "2*r"]]')
        report = analysis.study(modelfile.loads(text))
        assert np.shape(value(report, "gain_steady_continuous")) == (2, 2)
        assert any("continuous" in check.name for check in report.checks)
        assert report.passed

    def test_matrices_that_vary_have_a_transient_only(self):
        """No modes, no steady filter, but covariances over time."""
        text = TRACK.replace("H = [[1, 0], [1, 1]]", 'H = [[1, 0], ["cos(t)", 1]]')
        report = analysis.study(modelfile.loads(text))
        assert "gain_steady" not in report.values
        assert len(value(report, "sd_plus_end")) == 2
        assert report.passed


@pytest.fixture(scope="module")
def ill():
    """The two sensors that are almost one, compared for two of their differences."""
    return comparison.study(modelfile.ready("ill_conditioned"), sweep="delta=1e-6,1e-8", steps=15)


class TestComparison:
    def test_all_forms_are_listed_with_numbers_or_a_reason(self, ill):
        """In the design's order; a form that refuses has nulls and says why."""
        entries = ill.results()["algorithms"]
        assert [entry["name"] for entry in entries] == list(catalogue.FORMS)
        for entry in entries:
            keys = ("max_relative_error_P", "max_error_x", "seconds_per_step")
            assert all((entry[key] is None) == bool(entry["failed"]) for key in keys)
        assert any(entry["failed"] for entry in entries)

    def test_the_factorised_forms_survive_the_ill_conditioned_model(self, ill):
        """Joseph's form loses half of P at δ = 1e-8, those with factors keep seven digits."""
        cases = {case["value"]: case["algorithms"] for case in ill.results()["sweep"]["cases"]}
        errors = {entry["name"]: entry["max_relative_error_P"] for entry in cases[1e-8]}
        assert errors["joseph"] is None or errors["joseph"] > 0.1
        survivors = ("potter", "carlson", "array", "ud", "ld", "srif")
        assert all(errors[name] <= 1e-6 for name in survivors)
        accurate = value(ill, "advice").partition(".")[0]
        assert accurate.startswith("Accurate: ")
        assert set(survivors) <= set(re.findall(r"\w+", accurate))
        assert "joseph" not in accurate

    def test_a_healthy_model_leaves_the_choice_to_cost(self):
        """All agree to rounding; the cheapest is named; the steady gain is no rounding error."""
        report = comparison.study(*nile(), algorithms="joseph,ud,steady")
        assert [entry["name"] for entry in report.results()["algorithms"]] == ["joseph", "ud", "steady"]
        advice = value(report, "advice")
        assert advice.startswith("All forms agree")
        assert "steady has one gain" in advice
        assert "Not to be trusted" not in advice

    def test_a_long_record_is_cut_and_says_so(self, monkeypatch):
        """50 digits take time."""
        monkeypatch.setattr(comparison, "PATIENCE", 300)
        report = comparison.study(*nile(), algorithms="ud")
        assert report.results()["parameters"]["steps"] < 100
        assert any("left out" in getattr(block, "text", "") for block in report.blocks)

    @pytest.mark.parametrize(
        ("given", "line"),
        [
            ({"algorithms": "joesph"}, r"algorithm joesph: expected all or some of .* \(did you mean joseph\?\), received"),
            ({"sweep": "p=1"}, r"--sweep p=1: expected NAME=a,b,… with NAME one of q, r, received p"),
            ({"sweep": "q"}, r"--sweep q: expected NAME=a,b,… .*"),
            ({"sweep": "q=1,x"}, r"--sweep q: expected numbers with commas between, received 'x'"),
            ({"sweep": "q=1,inf"}, r"--sweep q: expected numbers .*, received 'inf'"),
        ],
    )  # fmt: skip
    def test_what_cannot_be_compared_is_refused(self, given, line):
        """By name, with what was perhaps meant."""
        with pytest.raises(ValueError, match=line):
            comparison.study(*nile(), **given)


class TestCommon:
    def test_a_setting_does_not_hide_a_constant_of_its_name(self):
        """The constant keeps the name, the setting gets an underscore."""
        model = modelfile.loads(NILE.replace("q = 1469.1", "q = 1469.1\nsteps = 7"))
        given = common.settings(model, ("steps", 3, "1", ""))
        assert given.plain() == {"q": 1469.1, "steps": 7.0, "r": 15099.0, "steps_": 3}

    def test_condition_numbers_do_not_depend_on_units(self):
        """Of the correlations; 1 for nothing uncertain, infinite for a combination known."""
        P = np.array([[2.0, 1.0], [1.0, 2.0]])
        scale = np.diag([1e-6, 1e3])
        assert common.condition(P) == pytest.approx(3)
        assert common.condition(scale @ P @ scale) == pytest.approx(3)
        assert common.condition(np.zeros((2, 2))) == 1
        assert common.condition(np.ones((2, 2))) > 1e15


def test_the_page_on_own_data_shows_files_that_are_read():
    """Its model is the Nile's, its table a record with a missing year; the receiver's is refused, and read, as the page says."""
    page = (Path(__file__).parents[2] / "docs" / "tutorials" / "own-data.md").read_text(encoding="utf-8")
    found = re.findall(r"^```(toml|text|ini|console)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (text,) = (each for kind, each in found if kind == "toml")
    flow, track = (each for kind, each in found if kind == "text")
    model = modelfile.loads(text)
    assert model.constants == {"q": Q, "r": R}
    assert analysis.study(model).values["gain_steady"] == analysis.study(modelfile.loads(NILE)).values["gain_steady"]
    record = datafile.parse(flow.encode(), model.measurements)
    np.testing.assert_array_equal(record.z[:, 0], [*FLOW[:4], np.nan, FLOW[5]])
    (said,) = (each for kind, each in found if kind == "console" and each.startswith("$ ctlabs models copy"))
    with pytest.raises(ValueError, match="expected the column position") as refused:
        datafile.parse(track.encode(), ["position"], "gps.csv")
    assert str(refused.value) in said
    told = tomllib.loads(next(each for kind, each in found if kind == "ini" and "timestamp_ms" in each))["data"]
    time = told["columns"].pop("t")
    mapping = Mapping(columns=told["columns"], time=time, unit=told["time_unit"], t0=told["t0"])
    record = datafile.parse(track.encode(), ["position"], "gps.csv", mapping)
    np.testing.assert_array_equal(record.z[:, 0], [2.12, 2.70])
    assert np.diff(record.t) == [1.0]
