"""The page Control without a browser: its commands, what it computes, what it says."""

from __future__ import annotations

import csv
import dataclasses
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs import Cost, discretise, regulator
from ctlabs.files.modelfile import gallery, loads, new, ready
from ctlabs.models import ContinuousModel
from ctlabs.studies.designing import designed
from ctlabs.workbench.desk import commands
from ctlabs.workbench.desk.costing import AddInput, BeginCost, EndCost, SetRegulator, Weigh
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.sheet import ModelSheet
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.pages.control_more import told_elsewhere
from ctlabs.workbench.pages.control_results import bears, verdict
from ctlabs.workbench.pages.control_weights import weights
from ctlabs.workbench.runs import loops

CART = "cart_pendulum"


@pytest.fixture
def session(tmp_path: Path) -> Any:
    store = Store(tmp_path)
    yield Session.begin(store)
    store.close()


def opened(session: Session, name: str = CART) -> Session:
    """A session with a ready model."""
    session.do(commands.Open(ready(name).dumps(), f"{name}.toml"))
    return session


def cost(session: Session) -> dict[str, Any]:
    """[cost] of the present model."""
    found = session.file.data().get("cost")
    assert isinstance(found, dict)
    return found


# Commands ------------------------------------------------------------------------------------------------------------


def test_an_input_and_weights_make_a_regulator_and_all_can_be_undone(session: Session) -> None:
    """From a model that nothing moves to one that is regulated, and back to the letter."""
    session.do(commands.New(2, 1, 1))
    texts = [session.text]
    for command in (AddInput(1), BeginCost(), Weigh(("Qx", 0, 0), "4"), Weigh(("outputs", "z1"), "2"), Weigh(("integral", "z1"), "0.5"),
                    SetRegulator("kind", "delayed"), SetRegulator("delay", "0.1"), SetRegulator("track", ["z1"]), AddInput(0)):  # fmt: skip
        session.do(command)
        assert not session.sheet.problems
        texts.append(session.text)
    assert cost(session) == {
        "Qx": [[4, 0], [0, 1]], "Qu": [[1, 0], [0, 1]], "outputs": {"z1": 2}, "integral": {"z1": 0.5}, "kind": "delayed", "delay": 0.1,
        "track": ["z1"],
    }  # fmt: skip
    assert session.file.data()["model"]["B"] == [[0, 1], [1, 0]]
    for text in reversed(texts):
        assert session.text == text
        if text != texts[0]:
            session.undo()
    for _ in texts[1:]:
        session.redo()
    session.do(EndCost())
    assert "cost" not in session.file.data()
    assert "B" in session.file.data()["model"]


def test_a_setting_that_says_the_usual_is_left_out(session: Session) -> None:
    """What is turned on and off again leaves the file as it was read."""
    before = opened(session).file.data()
    told = ("kind", "delayed", "current"), ("delay", "0.01", ""), ("stabilise", True, False), ("loads", ["s"], []), ("horizon", "3", "")
    for key, value, usual in told:
        session.do(SetRegulator(key, value))
        assert key in cost(session)
        session.do(SetRegulator(key, usual))
        assert session.file.data() == before


def test_weights_keep_expressions_and_a_weight_of_a_state_makes_the_matrix(session: Session) -> None:
    opened(session)
    told = {each.name: each.cell.value for each in weights(session.sheet) if each.group == "Outputs"}
    assert told == {"position": pytest.approx(25), "angle": pytest.approx(100)}
    session.do(Weigh(("outputs", "angle"), "2/theta_max^2"))
    assert cost(session)["outputs"] == {"position": "1/s_max^2", "angle": "2/theta_max^2"}
    assert "Qx" not in cost(session)
    session.do(Weigh(("Qx", 1, 1), "3*q"))
    made = session.file.cost
    assert made is not None
    assert np.array_equal(made.Qx, np.diag([0, 0.003, 0, 0]))
    session.do(Weigh(("outputs", "angle"), "0"))
    session.do(Weigh(("outputs", "position"), ""))
    assert "outputs" not in cost(session)
    assert not session.sheet.problems


def test_without_any_weight_of_outputs_there_is_a_matrix_of_zeros(session: Session) -> None:
    """The last output that goes leaves a cost that is one, of no state."""
    opened(session, "dc_motor")
    for name in list(cost(session).get("outputs", {})):
        session.do(Weigh(("outputs", name), "0"))
    assert not [where for where in session.sheet.problems if where.startswith("cost")]


def test_a_wrong_weight_stays_where_it_was_typed_and_is_told_there(session: Session) -> None:
    opened(session)
    session.do(Weigh(("Qu", 0, 0), "-1"))
    cells = {each.name: each.cell for each in weights(session.sheet)}
    assert cells["u"].text == "-1"
    assert "expected weights >= 0" in str(cells["u"].problem)
    session.do(Weigh(("Qu", 0, 0), "unknown_thing"))
    assert 'unknown name "unknown_thing"' in str({each.name: each.cell for each in weights(session.sheet)}["u"].problem)


WRONG = ["3", '"x"', "{}", "{Qx = 3, Qu = 1, outputs = 3, integral = [1], track = 1, kind = [1]}", "{Qu = [[1], 2], Qx = []}"]


@pytest.mark.parametrize("told", WRONG)
def test_a_table_that_is_none_is_shown_as_far_as_it_goes(told: str) -> None:
    """Whatever stands in [cost], there are rows, and what is wrong is told."""
    text = ready(CART).dumps()
    begin, end = text.index("[cost]"), text.index("[experiment]")
    sheet = ModelSheet(loads(f"cost = {told}\n{text[:begin]}{text[end:]}", "", check=False))
    assert {each.group for each in weights(sheet)} == {"States", "Outputs", "Inputs"}
    assert any(where.startswith("cost") for where in sheet.problems)
    assert set(sheet.weights) <= {"Qx", "Qu"}


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (AddInput(7), "model.B: expected one of the 4 states, received number 8"),
        (SetRegulator("speed", "1"), "cost: expected one of kind, delay"),
        (commands.AddPart("u"), "model.u: expected a model without [cost]"),
    ],
)
def test_what_is_impossible_is_refused_in_one_line(session: Session, command: Any, told: str) -> None:
    text = opened(session).text
    with pytest.raises(ValueError, match="expected") as why:
        session.do(command)
    assert str(why.value).startswith(told)
    assert "\n" not in str(why.value)
    assert session.text == text


PLANTS = ("double_integrator", "dc_motor", CART, "autopilot", "satellite_thrust", "two_tanks")


@pytest.mark.parametrize("late", [0.0, 0.4])
@pytest.mark.parametrize("name", PLANTS)
def test_a_cost_goes_with_its_model_to_the_samples(session: Session, name: str, late: float) -> None:
    """The regulator of the samples is that of the plant, delays, integrals, loads and what noise adds between them included."""
    opened(session, name)
    if late:
        session.do(SetRegulator("delay", str(late * session.file.dt)))
    plant = designed(session.file).regulator
    session.do(commands.SetKind("discrete"))
    sampled = designed(session.file).regulator
    assert session.file.kind == "discrete"
    assert sampled.plant.states == plant.plant.states
    assert (sampled.kind, sampled.machine.set_points) == (plant.kind, plant.machine.set_points)
    np.testing.assert_array_equal(sampled.L, plant.L)
    np.testing.assert_array_equal(sampled.K, plant.K)
    assert sampled.cost.value == pytest.approx(plant.cost.value * session.file.dt, rel=1e-13)
    if "delay" not in ready(name).data()["cost"] and not late:
        session.do(commands.SetKind("continuous"))
        again = designed(session.file).regulator
        np.testing.assert_allclose(again.L, plant.L, rtol=0, atol=1e-10 * np.abs(plant.L).max())
        assert again.cost.value == pytest.approx(plant.cost.value, rel=1e-9)
        assert session.file.cost is not None
        assert session.file.cost.constant == 0.0
    else:
        with pytest.raises(ValueError, match="Phi: expected the samples of a continuous model"):
            session.do(commands.SetKind("continuous"))


STEPWISE = """format = 1
kind = "discrete"
[model]
Phi = [[1]]
Qd = [[1]]
B = [[1]]
H = [[1]]
R = [[1]]
P0 = [[1]]
dt = 2
[cost]
horizon = 10
Qx = [[2]]
Qf = [[3]]
N = [["N"]]
Qu = [["Qu"]]
constant = "constant"
discount = "discount"
[constants]
N = 1
Qu = 1
constant = 1.5
discount = 1
"""


def test_a_cost_per_step_becomes_that_per_second_of_which_it_is_the_sample(session: Session) -> None:
    """ẋ = u/2 + w with Q = ½ and the weights 1 and 1/6: ∫₀² (x + us/2)² + u²/6 ds = 2x² + 2xu + (2/3 + 1/3) u²; noise adds 1 of the 1.5."""
    session.do(commands.Rewrite(STEPWISE))
    session.do(commands.SetKind("continuous"))
    found, plant = session.file.cost, session.file.plant()
    assert found is not None
    assert isinstance(plant, ContinuousModel)
    np.testing.assert_allclose(plant.B, [[0.5]], rtol=1e-12)
    np.testing.assert_allclose(found.weights(plant).joint, [[1, 0], [0, 1 / 6]], rtol=1e-12, atol=1e-12)
    assert (found.horizon, found.constant) == (20.0, pytest.approx(0.25, rel=1e-12))
    np.testing.assert_array_equal(found.Qf, [[3.0]])


@pytest.mark.parametrize(
    ("constants", "told"),
    [
        ({"constant": 0.5}, "cost.constant: expected at least 1, what noise between the samples costs in each step"),
        ({"Qu": 0.5}, "cost: expected the weights of a step to be what some weights per second come to in a period"),
        ({"discount": 0.9}, "cost.discount: expected 1 in a cost that goes to the other time, received 0.9"),
    ],
)
def test_a_cost_per_step_that_is_no_sample_stays_one(session: Session, constants: dict[str, float], told: str) -> None:
    session.do(commands.Rewrite(loads(STEPWISE).replace(constants).dumps()))
    with pytest.raises(ValueError, match="expected") as why:
        session.do(commands.SetKind("continuous"))
    assert str(why.value).startswith(told)
    assert session.file.kind == "discrete"


def test_an_input_that_nothing_makes_and_the_names_of_a_record_go_with_the_model(session: Session) -> None:
    opened(session)
    session.do(EndCost())
    session.do(commands.Rewrite(session.text + '\n[data]\ninputs = ["force"]\n'))
    plant = session.file.plant()
    assert isinstance(plant, ContinuousModel)
    session.do(commands.SetKind("discrete"))
    assert session.file.input_names == ("force",)
    np.testing.assert_array_equal(session.file.plant().B, discretise(plant, session.file.dt, R=session.file.matrix("R")).B)
    session.do(commands.SetKind("continuous"))
    np.testing.assert_allclose(session.file.plant().B, plant.B, rtol=0, atol=1e-12)


def test_a_regulator_takes_the_place_of_a_known_input(session: Session) -> None:
    session.do(commands.New(2, 1, 1))
    session.do(commands.AddPart("u"))
    session.do(commands.EditCell(("model", "B", 1, 0), "1"))
    with pytest.raises(ValueError, match=r"model\.u: expected inputs that a regulator makes"):
        session.do(AddInput(0))
    session.do(BeginCost())
    assert "u" not in session.file.data()["model"]
    assert not session.sheet.problems
    with pytest.raises(ValueError, match=r"model\.B: expected the matrix"):
        commands.apply(new(2), BeginCost())


def test_a_new_name_is_the_regulators_name_too(session: Session) -> None:
    opened(session)
    session.do(Weigh(("integral", "position"), "0.1"))
    session.do(commands.Name("measurement", 0, "place", "m"))
    told = [list(cost(session)[key]) for key in ("track", "outputs", "integral")]
    assert told == [["place"], ["place", "angle"], ["place"]]
    assert not session.sheet.problems


def test_the_sheet_shows_inputs_that_no_table_makes() -> None:
    for entry in gallery():
        sheet = ModelSheet(ready(entry.name))
        if "cost" not in sheet.data:
            continue
        assert "u" not in sheet.missing_parts
        assert r"\,u" in sheet.equations()[0]
        assert len(sheet.grids["B"].column_names) == len(sheet.inputs) == sheet.file.inputs
        assert {name: len(grid.rows) for name, grid in sheet.weights.items()}["Qu"] == sheet.file.inputs


# What is computed ----------------------------------------------------------------------------------------------------


def test_what_is_shown_is_the_librarys_regulator() -> None:
    """Matrices by hand, no model file between: the double integrator, its sampling and its weights."""
    file = ready("double_integrator")
    found = loops.regulated(file.dumps())
    assert file.cost is not None
    assert file.cost.Qx is not None
    R = file.matrix("R")
    F, G, Q, H, B, P0 = (file.matrix(name) for name in ("F", "G", "Q", "H", "B", "P0"))
    plant = ContinuousModel(F, G, Q, H, B=B, P0=P0)
    by_hand = regulator(plant, Cost(file.cost.Qx, file.cost.Qu), dt=file.dt, R=R, track=["z1"])
    assert np.allclose(found.regulator.L, by_hand.L, rtol=1e-12, atol=0)
    assert np.allclose(found.regulator.K, by_hand.K, rtol=1e-12, atol=0)
    assert found.regulator.cost.value == pytest.approx(by_hand.cost.value, rel=1e-12)


def test_another_text_is_another_regulator_and_the_same_is_kept() -> None:
    """A constant that only the cost uses, one of the plant, the period: each changes what is shown; coming back is not computing again."""
    file = ready(CART)
    first = loops.regulated(file.dumps())
    for changed in (file.set_constant("u_max", 3), file.set_constant("l", 0.6), file.edit(("model", "dt"), 0.01)):
        assert not np.allclose(loops.regulated(changed.dumps()).regulator.L, first.regulator.L, rtol=1e-3)
    assert loops.regulated(file.dumps()) is first


def test_a_loop_is_followed_no_longer_than_a_page_can_show() -> None:
    file = ready(CART)
    assert [loops.steps(file.edit(("experiment", "steps"), steps)) for steps in (1, 250, 100_000)] == [loops.SHORTEST, 250, loops.LONGEST]


def test_the_curves_go_through_the_regulator() -> None:
    """At the factor 1 and at the period of the file they are the regulator that is shown; dearer inputs are quieter."""
    file = ready("double_integrator")
    found, told = loops.regulated(file.dumps()), []
    curves = loops.curves(file.dumps(), lambda done, total: told.append((done, total)))
    here = int(np.argmin(np.abs(np.log(curves.weights.values))))
    assert curves.weights.values[here] == pytest.approx(1)
    assert curves.weights.cost[here] == pytest.approx(found.regulator.cost.value, rel=1e-9)
    assert (np.diff(curves.weights.u[:, 0]) < 0).all()
    assert (np.diff(curves.weights.x[:, 0]) > 0).all()
    at = int(np.argmin(np.abs(curves.periods.values - file.dt)))
    assert curves.periods.cost[at] == pytest.approx(found.regulator.cost.value, rel=1e-9)
    assert (np.diff(curves.periods.cost) > 0).all()
    assert told == [(i + 1, len(told)) for i in range(len(loops.FACTORS) + len(loops.PERIODS))]


def test_another_truth_costs_what_the_library_says() -> None:
    """A longer pole under the regulator of the shorter one; a pole so long that it falls, with the mode."""
    file = ready(CART)
    truth = file.set_constant("l", 0.6)
    found = loops.elsewhere(file.dumps(), truth.dumps())
    design = loops.regulated(file.dumps()).regulator
    assert truth.cost is not None
    plant = truth.plant()
    assert isinstance(plant, ContinuousModel)
    assert found.cost.value == pytest.approx(design.actual_cost(plant), rel=1e-6)
    assert found.cost.value > found.best.regulator.cost.value * (1 - 1e-12)
    assert "The loop stays stable" in told_elsewhere(found)
    far = loops.elsewhere(file.dumps(), file.set_constant("M", 10).dumps())
    assert not far.stable
    assert "It does not hold this plant: the mode" in told_elsewhere(far)


def test_a_truth_without_weights_takes_those_of_the_design() -> None:
    """The same plant whose file says nothing of a regulator is the same loop."""
    file = ready(CART)
    bare, _ = commands.apply(file, EndCost())
    found = loops.elsewhere(file.dumps(), bare.dumps())
    assert found.cost.value == pytest.approx(found.regulator.cost.value, rel=1e-9)


def test_one_run_is_replayed_by_the_controller() -> None:
    text = ready(CART).dumps()
    heads, *rows = csv.reader(io.StringIO(loops.one_run(text, 3)))
    assert heads == ["t", "s", "speed", "theta", "rate", "position (measured)", "angle (measured)", "u"]
    values = np.array(rows, dtype=float)
    controller = loops.regulated(text).regulator.controller()
    u = np.array([controller.step(z)[0] for z in values[:, 5:7]])
    assert np.abs(u - values[:, 7]).max() <= 1e-12 * np.abs(u).max()
    assert not np.array_equal(values[:, 5], np.array(list(csv.reader(io.StringIO(loops.one_run(text, 4))))[1:], dtype=float)[:, 5])


def test_an_export_has_the_matrices(tmp_path: Path) -> None:
    text = ready(CART).dumps()
    (tmp_path / "r.npz").write_bytes(loops.exported(text, "npz"))
    machine = loops.regulated(text).regulator.machine
    with np.load(tmp_path / "r.npz", allow_pickle=False) as arrays:
        assert all(np.array_equal(arrays[name], getattr(machine, name)) for name in "ABCDFG")
    with pytest.raises(ValueError, match="export: expected one of h, npz, mat"):
        loops.exported(text, "exe")


def test_a_plant_without_a_regulator_says_why() -> None:
    """A mode that no input reaches and that grows is named."""
    file = ready(CART).edit(("model", "B"), [[0], [0], [0], [0]])
    with pytest.raises(ValueError, match="mode"):
        loops.regulated(file.dumps())


# What is said --------------------------------------------------------------------------------------------------------


def test_the_verdict_tells_stability_margins_and_cost() -> None:
    said = verdict(loops.regulated(ready(CART).dumps()))
    assert "The loop is stable (the plant alone is not)" in said
    assert "That is little" in said
    assert "per second" in said
    said = verdict(loops.regulated(ready("double_integrator").dumps()))
    assert "(the plant alone is not)" in said


def test_margins_are_called_little_by_phase_and_by_gain() -> None:
    found = loops.regulated(ready(CART).dumps()).margins.value.inputs["u"]
    for low, high, degrees, little in ((0.0, 4.0, 45.0, False), (0.0, np.inf, 29.0, True), (0.5, 1.9, 45.0, True)):
        said = bears(found._replace(gain=(low, high), phase=np.radians(degrees)))
        assert ("That is little" in said) is little
        assert ("without limit" in said) is (high == np.inf)


def test_the_budget_by_weight_adds_up() -> None:
    for name in (CART, "dc_motor", "two_tanks"):
        found = loops.regulated(ready(name).dumps())
        assert sum(float(value) for _, value, _ in found.weighed()) == pytest.approx(found.regulator.cost.value, rel=1e-9)


def test_a_horizon_has_a_schedule_and_no_curves_of_periods(session: Session) -> None:
    opened(session, "double_integrator").do(SetRegulator("horizon", "2"))
    found = loops.regulated(session.text)
    assert found.regulator.steps is not None
    assert "The gains are scheduled" in verdict(found)
    curves = dataclasses.asdict(loops.curves(session.text))
    assert curves["periods"]["reason"] == "a horizon has its own periods"


def test_a_file_of_its_own_is_regulated_by_weights_of_its_own() -> None:
    """Two inputs, an integral and set points at once: no name is taken for another."""
    text = loads(ready("two_tanks").dumps(), "").dumps()
    found = loops.regulated(text)
    assert len(found.inputs) == found.truth.r
    assert set(found.inputs).isdisjoint(found.truth.states)
