"""Exact measurements that disagree with what is known exactly: found, said, and not cried where rounding explains them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs import cli
from ctlabs.analysis import diagnosis, fitting
from ctlabs.filtering import Filtered, contradictions, hypotheses, kalman_filter, log_likelihood, smooth
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.contradictions import Contradiction
from ctlabs.filtering.online import Filter
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.reporting import render
from tests import cases
from tests.reference import PNG

Command = Callable[..., tuple[int, str, dict[str, Any]]]
#: Forms that take a perfect measurement.
PERFECT = [name for name in FORMS if name not in ("information", "srif", "extended_array", "steady")]
FILTER = [param for param in cases.numerics("k4_*") if param.values[0]["verb"] == "kalman_filter"]


def places(found: Sequence[Contradiction]) -> list[tuple[int, int]]:
    return [(each.row, each.element) for each in found]


def rotation(angle: float) -> Array:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def undriven(Phi: Any, x0: Any, H: Any = None, P0: Any = None) -> DiscreteModel:
    """A system without noises, measured exactly, known exactly unless P0 is given."""
    n = len(x0)
    H = np.eye(n) if H is None else np.asarray(H)
    nothing = np.zeros((n, n))
    return DiscreteModel(Phi, nothing, H, np.zeros((len(H),) * 2), x0=x0, P0=nothing if P0 is None else P0)


# The cases ------------------------------------------------------------------------------------------------------------


def judge(case: Mapping[str, Any], found: Sequence[Contradiction], log_likelihood: float) -> None:
    """What a case says of a filter's contradictions and likelihood."""
    right = case["right"]
    if right["contradiction"]:
        assert places(found)[0] == (right["row"] - 1, right["element"])  # the cases count instants, from t0
        assert abs(found[0].innovation - right["innovation"]) < 1e-9
        assert 0 < found[0].allowed < 1e-12
        assert log_likelihood == -np.inf
    else:
        assert found == ()


@pytest.mark.parametrize("case", FILTER)
def test_the_cases_by_record_ensemble_and_smoother(case: Mapping[str, Any]) -> None:
    """Row, element and innovation are right, and the likelihood is −∞ there and right elsewhere."""
    model, z, right = cases.model(case["model"]), cases.record(case["given"]), case["right"]
    assert isinstance(model, DiscreteModel)
    found = kalman_filter(model, z[1:])
    judge(case, found.contradictions, found.log_likelihood)
    assert log_likelihood(model, z[1:]) == found.log_likelihood
    assert places(kalman_filter(model, z[1:], algorithm="filterpy").contradictions) == places(found.contradictions)
    assert smooth(model, found).contradictions == found.contradictions
    if not right["contradiction"]:
        assert abs(found.log_likelihood - right["log_likelihood"]) <= 1e-9 * abs(right["log_likelihood"])
        assert contradictions.known(model, z, found.used, 1).sum() == right["known_already"]


@pytest.mark.parametrize("form", PERFECT)
@pytest.mark.parametrize("case", FILTER)
def test_the_cases_by_every_form_and_online(case: Mapping[str, Any], form: str) -> None:
    """The forms, and the filter that is fed step by step, say the same."""
    model, z = cases.model(case["model"]), cases.record(case["given"])
    assert isinstance(model, DiscreteModel)
    found, online = kalman_filter(model, z[1:], algorithm=form), Filter(model, algorithm=form)
    judge(case, found.contradictions, found.log_likelihood)
    steps = [each for row in z[1:] for each in online.step(row).contradictions]
    bounds = [[each.allowed for each in some] for some in (steps, found.contradictions)]
    np.testing.assert_allclose(*bounds, rtol=1e-12)  # of gains computed, and of gains given
    assert [each._replace(allowed=0) for each in steps] == [each._replace(allowed=0) for each in found.contradictions]
    np.testing.assert_allclose(online.log_likelihood, found.log_likelihood, rtol=1e-12)


@pytest.fixture
def command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Command:
    """A command on a case's model file and CSV: exit code, what was printed, and the values of results.json."""

    def run(name: str, case: Mapping[str, Any], *more: str) -> tuple[int, str, dict[str, Any]]:
        write(tmp_path, case)
        out = tmp_path / "out"
        with pytest.raises(SystemExit) as end:
            cli.main([name, str(tmp_path / "m.toml"), str(tmp_path / "z.csv"), "--out", str(out), *more])
        code, printed = int(end.value.code or 0), capsys.readouterr()
        values = json.loads((out / "results.json").read_text(), parse_constant=pytest.fail)["values"] if out.is_dir() else {}
        return code, printed.out + printed.err, {key: value["value"] for key, value in values.items()}

    return run


def write(tmp_path: Path, case: Mapping[str, Any]) -> None:
    """The case's model file and CSV."""
    given, free = case["model"], case["given"].get("free", [])
    start = case["given"].get("start", {})
    lines = ["format = 1", f'title = "{case["name"]}"', 'kind = "discrete"', "[constants]"]
    lines += [f"{letter} = {{ value = {start.get(letter, 1.0)} }}" for letter in free]
    lines += ["[model]", f"states = {[f'x{i}' for i in range(len(given['x0']))]}"]
    lines += [f"measurements = {[f'z{i}' for i in range(len(given['H']))]}", f"x0 = {given['x0']}"]
    lines += [f"{letter} = {given[letter]}" for letter in ("Phi", "Qd", "H", "R", "P0")]
    (tmp_path / "m.toml").write_text("\n".join(lines) + "\ndt = 1\n")
    header = ",".join(f"z{i}" for i in range(len(given["H"])))
    rows = (",".join("NA" if v is None else repr(v) for v in row) for row in case["given"]["z"][1:])
    (tmp_path / "z.csv").write_text("\n".join([header, *rows]) + "\n")


@pytest.mark.parametrize("case", FILTER)
def test_the_cases_by_the_command(
    case: Mapping[str, Any], command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``ctlabs filter`` says a contradiction with its row, and is not the less successful; results.json is valid."""
    if not case["right"]["contradiction"]:  # an ordinary record, whose figures others draw
        monkeypatch.setattr(render, "png", lambda _figure: PNG)
    code, printed, values = command("filter", case, "--smooth")
    report, right = (tmp_path / "out" / "report.md").read_text(), case["right"]
    assert code == 0
    assert "No element was measured" not in report
    if right["contradiction"]:
        sentence = values["contradiction"]
        value = case["given"]["z"][right["row"]][right["element"]]
        where = f"line {right['row'] + 1} (t = {right['row']}), where {value:.12g} was measured"
        assert f"{where}, z{right['element']} differs" in sentence
        assert "−∞" in sentence
        assert "two sensors of one source" in sentence
        assert "impossible for this model" in printed
        assert sentence in report
        assert values["log_likelihood"] == "-inf"
    else:
        assert "contradiction" not in values
        assert values.get("known_already", 0) == right["known_already"]
        np.testing.assert_allclose(values["log_likelihood"], right["log_likelihood"], rtol=1e-9)


def test_improbable_is_not_impossible_but_deserves_a_word(command: Command) -> None:
    """R = 1e-12 and values 0.1 apart."""
    case = next(param.values[0] for param in FILTER if param.id == "k4_nearly_perfect")
    assert "z0 = 3.1 in line 3 (t = 2) is an outlier, 82000 σ from the 3 that" in command("filter", case)[2]["suggestion"]


def test_a_record_without_measurements(command: Command) -> None:
    """The filter says so; there is nothing to fit."""
    case = next(param.values[0] for param in cases.numerics("k4_all_missing"))
    code, printed, values = command("filter", case)
    assert (code, values["log_likelihood"]) == (0, 0)
    assert "No element was measured" in printed
    code, printed, _values = command("fit", case, "--free", "q")
    assert code == 2
    assert "no observations" in printed


# Fitting --------------------------------------------------------------------------------------------------------------


def decay(values: Mapping[str, float]) -> DiscreteModel:
    return undriven([[values["a"]]], [1.0])


def test_a_fit_moves_away_from_a_contradiction(command: Command) -> None:
    """The case: rounded to 12 digits, so that 0.8 contradicts it less than any other value, and still does."""
    case = next(param.values[0] for param in cases.numerics("k4_fit_moves_away"))
    found = fitting.fit(decay, cases.record(case["given"])[1:], {"a": 0.5})
    assert abs(found.estimates["a"] - 0.8) < 1e-12
    assert not found.converged
    assert (found.start_log_likelihood, found.log_likelihood) == (-np.inf, -np.inf)
    assert found.contradictions
    assert "row 0 of z, element 0: 0.3 away" in found.remark
    code, printed, values = command("fit", case, "--free", "a")
    assert code == 0
    assert "the record is impossible (row 0 of z" in " ".join(printed.split())
    assert (values["converged"], values["log_likelihood"], values["log_likelihood_start"]) == (False, "-inf", "-inf")


@pytest.mark.parametrize("start", [0.5, 0.95, 0.8])
def test_a_record_that_determines_a_constant_exactly(start: float) -> None:
    """All digits of 0.8ᵏ: there the record is possible, beside it it is not."""
    found = fitting.fit(decay, 0.8 ** np.arange(1.0, 31.0), {"a": start})
    assert abs(found.estimates["a"] - 0.8) < 1e-15
    assert (found.converged, found.log_likelihood, found.contradictions) == (True, 0.0, ())
    assert found.standard_errors["a"] is None
    assert "exactly" in found.reasons["a"]
    assert found.intervals["a"] == (found.estimates["a"],) * 2
    assert bool(found.remark) == (start != 0.8)


def test_what_is_not_determined_exactly_is_estimated_as_ever() -> None:
    """Beside an exact sensor a noisy one: the estimate of its variance is the mean square of its errors."""

    def build(values: Mapping[str, float]) -> DiscreteModel:
        model = undriven([[values["a"]]], [1.0], [[1.0], [1.0]])
        return replace(model, R=np.diag([0.0, values["r"]]))

    exact, errors = 0.8 ** np.arange(31.0), np.random.default_rng(1).normal(size=31)
    z = np.column_stack([exact, exact + errors])
    found = fitting.fit(build, z[1:], {"a": 0.5, "r": 3.0}, {"r": (0, None)})
    r = np.mean(errors[1:] ** 2)
    assert abs(found.estimates["a"] - 0.8) < 1e-14
    assert abs(found.estimates["r"] - r) < 1e-6 * r
    error = found.standard_errors["r"]
    assert error is not None
    assert abs(error - r * np.sqrt(2 / 30)) < 1e-4 * r
    assert found.converged


def test_a_variance_that_was_zero_is_found() -> None:
    """Three values of a constant that differ: impossible with r = 0, and likeliest with their scatter."""

    def build(values: Mapping[str, float]) -> DiscreteModel:
        return DiscreteModel([[1]], [[0]], [[1]], [[values["r"]]], x0=[0], P0=[[4]])

    z = np.array([3.0, 3.1, 3.0])
    found = fitting.fit(build, z, {"r": 0.0}, {"r": (0, None)})
    other = fitting.fit(build, z, {"r": 0.01}, {"r": (0, None)})
    assert found.converged
    np.testing.assert_allclose(found.estimates["r"], other.estimates["r"], rtol=1e-6)
    assert "where the record is possible" in found.remark


def test_constants_that_cannot_help_stay_where_they_are() -> None:
    """Two perfect sensors disagree whatever the walk's variance."""

    def build(values: Mapping[str, float]) -> DiscreteModel:
        return DiscreteModel([[1]], [[values["q"]]], [[1], [1]], np.zeros((2, 2)), x0=[0], P0=[[4]])

    found = fitting.fit(build, [[1.0, 2.0], [3.0, 3.0]], {"q": 1.5}, {"q": (0, None)})
    assert found.estimates == {"q": 1.5}
    assert not found.converged
    assert places(found.contradictions) == [(0, 1)]


def test_nothing_measured_is_nothing_to_fit() -> None:
    """However many rows there are."""

    def build(values: Mapping[str, float]) -> DiscreteModel:
        return DiscreteModel([[1]], [[values["q"]]], [[1]], [[1]], x0=[0], P0=[[1]])

    with pytest.raises(ValueError, match="no observations: expected a record with at least one element measured"):
        fitting.fit(build, [np.nan, np.nan], {"q": 1.0})


# Rounding is no contradiction, and nothing else is rounding -----------------------------------------------------------


@pytest.mark.parametrize("angle", [1e-3, 0.1, 1.0, np.pi / 3, np.pi / 2, 2.0])
@pytest.mark.parametrize("known", [True, False])
def test_a_long_record_of_an_undriven_oscillator(angle: float, known: bool) -> None:
    """cos kω as another program computes it, over 1200 steps; 1e-9 more at one of them is found there, and only there."""
    k = np.arange(1201)
    z = np.cos(angle * k)[:, None]
    if angle == np.pi / 2:
        z = np.array([1.0, 0.0, -1.0, 0.0])[k % 4][:, None]  # as anyone writes it, though cos 90° is 6e-17
    model = undriven(rotation(angle), [1.0, 0.0], [[1.0, 0.0]], None if known else np.eye(2))
    found = kalman_filter(model, z[1:])
    assert found.contradictions == ()
    assert contradictions.known(model, z, found.used, 1).sum() == (1200 if known else 1198)
    z[1000] += 1e-9
    assert places(kalman_filter(model, z[1:]).contradictions) == [(999, 0)]


def test_a_hundred_thousand_steps() -> None:
    """The bound alone, on the estimates as the filter would compute them."""
    rows, Phi = 100_001, rotation(0.1)
    x = np.empty((rows, 2))
    x[0] = 1.0, 0.0
    for k in range(1, rows):
        x[k] = Phi @ x[k - 1]
    z, none = np.cos(0.1 * np.arange(rows))[:, None], np.zeros((rows, 2, 2))
    model = undriven(Phi, [1.0, 0.0], [[1.0, 0.0]])
    nan, used = np.full((rows, 1), np.nan), np.zeros((rows, 1), dtype=bool)
    history = Filtered(
        np.arange(rows), none, none, np.zeros((rows, 2, 1)), np.full((rows, 1, 1), np.inf), used,
        x_minus=x, x_plus=x, innovation=nan, nis=nan[:, 0], log_likelihood=0.0, log_likelihood_diffuse=0.0, z=z, model=model,
    )  # fmt: skip
    e, allowed = contradictions.innovations(model, z, history, 1)
    assert (np.abs(e[1:, :, 0]) <= allowed[1:]).all()
    assert allowed[-1, 0] < 1e-9


@pytest.mark.parametrize("a", [0.5, 0.1, 0.99, 1.01])
def test_a_decay_to_the_smallest_numbers(a: float) -> None:
    """aᵏ over 1000 steps, to 1e-300; one part in 10⁹ more at the last is found."""
    rows = 1001 if a > 0.1 else 301
    z = np.array([float(Fraction(str(a)) ** k) for k in range(rows)])[:, None]
    model = undriven([[a]], [1.0])
    assert kalman_filter(model, z[1:]).contradictions == ()
    z[-1] *= 1 + 1e-9
    assert places(kalman_filter(model, z[1:]).contradictions) == [(rows - 2, 0)]


decimals = st.integers(-99, 99).map(lambda i: i / 100)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_exact_values_rounded_once_agree(data: st.DataObject) -> None:
    """Any undriven system of decimals, computed in fractions and rounded: no contradiction; a hundred bounds off: one."""
    n = data.draw(st.integers(1, 4))
    Phi = [[data.draw(decimals) for _ in range(n)] for _ in range(n)]
    H, x0 = [[data.draw(decimals) for _ in range(n)]], [data.draw(decimals) for _ in range(n)]
    exact, rows = [Fraction(str(v)) for v in x0], []
    for _ in range(40):
        rows.append([float(sum(Fraction(str(h)) * x for h, x in zip(H[0], exact, strict=True)))])
        exact = [sum(Fraction(str(p)) * x for p, x in zip(row, exact, strict=True)) for row in Phi]
        exact = [Fraction(x) for x in exact]
    z, model = np.array(rows), undriven(Phi, x0, H)
    found = kalman_filter(model, z[1:])
    assert found.contradictions == ()
    allowed = contradictions.innovations(model, z, found, 1)[1]
    z[-1] += 100 * allowed[-1]
    assert places(kalman_filter(model, z[1:]).contradictions) == [(38, 0)]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_redundant_perfect_sensors_of_a_driven_system(seed: int) -> None:
    """More perfect sensors than states: those that come last are known, and agree with a simulated truth; one wrong does not."""
    rng = np.random.default_rng(seed)
    n, rows = int(rng.integers(1, 4)), 25
    G, H = rng.normal(size=(n, n)), rng.normal(size=(n + 2, n)).round(3)
    Phi = rng.normal(size=(n, n)) / np.sqrt(n)
    model = DiscreteModel(Phi, G @ G.T, H, np.zeros((n + 2,) * 2), x0=np.zeros(n), P0=np.eye(n))
    x = np.zeros((rows, n))
    for k in range(1, rows):
        x[k] = Phi @ x[k - 1] + G @ rng.normal(size=n)
    z = x @ H.T
    found = kalman_filter(model, z[1:])
    assert found.contradictions == ()
    allowed = contradictions.innovations(model, z, found, 1)[1]
    known = np.isfinite(allowed)
    assert known[1:].sum() == 2 * (rows - 1)
    k, i = np.argwhere(known)[rng.integers(known.sum())]
    z[k, i] += 10 * allowed[k, i]
    wrong = kalman_filter(model, z[1:])
    assert (k - 1, i) in places(wrong.contradictions)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_units_change_nothing(seed: int) -> None:
    """States and measurements in units of powers of ten from 1e-9 to 1e9: the same elements, the innovations in their units."""
    rng = np.random.default_rng(seed)
    n, m, rows = 3, 5, 12
    Phi, H = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    G = rng.normal(size=(n, 2))
    model = DiscreteModel(Phi, G @ G.T, H, np.zeros((m, m)), x0=rng.normal(size=n), P0=np.eye(n))
    z = rng.normal(size=(rows, m))
    s, r = 10.0 ** rng.integers(-9, 10, n), 10.0 ** rng.integers(-9, 10, m)
    other = DiscreteModel(
        s[:, None] * Phi / s, s[:, None] * model.Qd * s, r[:, None] * H / s, model.R, x0=s * model.x0,
        P0=s[:, None] * model.P0 * s,
    )  # fmt: skip
    one, two = kalman_filter(model, z[1:]).contradictions, kalman_filter(other, z[1:] * r).contradictions
    assert one
    assert places(one) == places(two)
    for a, b in zip(one, two, strict=True):
        scale = r[a.element]
        assert abs(b.innovation / scale - a.innovation) <= a.allowed + b.allowed / scale
        assert 0.5 < b.allowed / (a.allowed * scale) < 2


# Models and calls of every kind ---------------------------------------------------------------------------------------


def test_an_ensemble_has_a_likelihood_of_each_run() -> None:
    """Only the run with the contradiction is impossible."""
    model = undriven([[1.0]], [0.0], P0=[[4.0]])
    z = np.array([[[np.nan] * 3], [[1.0, 2.0, 3.0]], [[1.0, 2.5, 3.0]]])
    found = kalman_filter(model, z[1:], algorithm="joseph")
    assert [each[:3] + each[4:] for each in found.contradictions] == [(1, 0, 0.5, 1)]
    assert np.isneginf(found.log_likelihood).tolist() == [False, True, False]
    assert kalman_filter(model, z[1:], algorithm="filterpy").contradictions == found.contradictions


def test_missing_and_absent_elements_contradict_nothing() -> None:
    """NaN, and R = inf."""
    R = np.array([np.diag([0.0, np.inf])] * 4)
    model = replace(undriven([[1.0]], [2.0], [[1.0], [1.0]]), R=R)
    assert kalman_filter(model, [[2.0, 9.0], [np.nan, np.nan], [2.0, 7.0]]).contradictions == ()
    assert places(kalman_filter(model, [[3.0, 9.0], [np.nan, 1.0], [2.0, 7.0]]).contradictions) == [(0, 0)]


def test_the_first_measurement_may_be_at_t0() -> None:
    """first = 0: what is known at t0 is compared there."""
    model = undriven([[1.0]], [2.0])
    found = kalman_filter(model, [[2.5], [2.0]], first=0)
    assert places(found.contradictions) == places(found.row(0).contradictions) == [(0, 0)]
    assert found.row(-1).contradictions == kalman_filter(model, [2.0, 2.0]).contradictions == ()
    assert places(kalman_filter(model, [2.5, 2.0], first=1).row(1).contradictions) == [(0, 0)]
    assert places(Filter(model, first=0).step(2.5).contradictions) == [(0, 0)]


def test_a_disturbance_that_a_measurement_gives_away() -> None:
    """N ≠ 0: x moves by exactly what the noise of z was, so that a second perfect sensor of x is known from then on."""
    Phi, N = np.array([[1.0]]), np.array([[1.0, 0.0]])
    model = DiscreteModel(Phi, [[1]], [[1], [1]], np.diag([1.0, 0.0]), N=N, x0=[0], P0=[[4]])
    rng = np.random.default_rng(3)
    z, x = np.zeros((30, 2)), 1.7
    for k in range(30):
        v = rng.normal()
        z[k], x = (x + v, x), x + v
    found = kalman_filter(model, z[1:])
    assert found.contradictions == ()
    assert contradictions.known(model, z, found.used, 1)[2:, 1].all()
    z[20, 1] += 1e-9
    assert (19, 1) in places(kalman_filter(model, z[1:]).contradictions)
    online = Filter(model)
    assert next(c for row in z[1:] for c in online.step(row).contradictions)[:2] == (19, 1)


def test_known_inputs_and_matrices_that_vary() -> None:
    """x doubles and halves in turn, with an offset; what is measured comes from the same recursion in fractions."""
    Phi, c = np.array([[[2.0]], [[0.5]]] * 10), np.array([[0.1], [-0.3]] * 10)
    model = DiscreteModel(Phi, np.zeros((1, 1)), [[1]], [[0]], x0=[0.7], P0=[[0]], offset=c)
    x, z = Fraction("0.7"), []
    for k in range(21):
        z.append([float(x)])
        x = x * (2 if k % 2 == 0 else Fraction(1, 2)) + (Fraction("0.1") if k % 2 == 0 else Fraction("-0.3"))
    assert kalman_filter(model, z[1:]).contradictions == ()
    z[15][0] *= 1 + 1e-12
    assert places(kalman_filter(model, z[1:]).contradictions) == [(14, 0)]


def test_the_online_filter_remembers_and_keeps_its_contradictions(tmp_path: Path) -> None:
    """The likelihood stays −∞, late measurements are compared too, and a saved filter goes on to the bit."""
    model = undriven([[0.5]], [1.0])
    online = Filter(model, memory=2)
    online.step(None)
    assert online.step(0.25).contradictions == ()
    online.step(0.6, t=1.0)  # late: 0.5 was known
    assert online.log_likelihood == -np.inf
    online.save(tmp_path / "filter")
    again = Filter.load(tmp_path / "filter")
    for each in (online, again):
        assert [each.step(z).contradictions == () for z in (0.125, 0.0625, 0.03125, 0.02)] == [True, True, True, False]
        assert each.log_likelihood == -np.inf


def test_a_diagnosis_and_hypotheses_know_of_it() -> None:
    """A contradiction is the verdict; a model that the record excludes has the probability 0; one of them must allow it."""
    model = replace(undriven([[1.0]], [0.0], [[1.0], [1.0]], [[4.0]]), Qd=np.array([[1.0]]))
    z = np.column_stack([np.arange(20.0)] * 2)
    found = kalman_filter(model, z[1:])
    assert diagnosis.diagnose(model, found).verdict != "contradiction"
    z[3, 1] += 1
    found = kalman_filter(model, z[1:])
    told = diagnosis.diagnose(model, found)
    assert (told.verdict, told.factor_R, told.factor_Q) == ("contradiction", None, None)
    assert "row 2" in told.suggestion
    exact, wrong = undriven([[0.5]], [1.0]), undriven([[0.5]], [1.5])
    halves = [[0.5], [0.25]]
    assert hypotheses.hypotheses([exact, wrong], halves).probability[-1, :, 0].tolist() == [1.0, 0.0]
    with pytest.raises(ValueError, match="received one that contradicts all by row 0"):
        hypotheses.hypotheses([wrong, wrong], halves)


def test_the_filter_goes_on_as_if_the_element_were_not_measured() -> None:
    """Estimates are those of the record without the contradicting element."""
    model = DiscreteModel([[1]], [[1]], [[1], [1]], np.zeros((2, 2)), x0=[0], P0=[[4]])
    z = np.array([[np.nan, np.nan], [1.0, 2.0], [3.0, 3.0]])
    without = z.copy()
    without[1, 1] = np.nan
    np.testing.assert_array_equal(kalman_filter(model, z[1:]).x_plus, kalman_filter(model, without[1:]).x_plus)


@pytest.mark.parametrize("start", [0.0, np.inf])
def test_what_is_known_of_a_measurement_has_its_own_rounding(start: float) -> None:
    """z = x + d with a perfect sensor and d of a million: z − d has the digits of d, in the batch and online."""
    d, x = 1e6 / 3, 0.1
    model = DiscreteModel([[1]], [[0]], [[1]], [[0]], x0=[x], P0=[[start]], measurement_offset=[d])
    z = [d + x, d + x * (1 + 1e-12), d + x]
    online = Filter(model)
    assert kalman_filter(model, z).contradictions == ()
    assert [online.step(each).contradictions for each in z] == [(), (), ()]
    assert len(kalman_filter(model, [d + x, d + x + 1e-6, d + x]).contradictions) == 1
