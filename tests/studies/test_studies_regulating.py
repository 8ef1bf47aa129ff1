"""The study of a regulator: its numbers by hand-made loops, its report, wrong designs, and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ctlabs.files import modelfile
from ctlabs.files.modelfile import ModelFile, ready
from ctlabs.models import Cost, DiscreteModel, discretise
from ctlabs.regulation import lqr, margins, regulator, sample
from ctlabs.reporting.paper import to_matplotlib
from ctlabs.studies import loops, regulated, regulating, second
from ctlabs.studies.regulating import Regulated, compute
from tests.reference import EXACT, SOLVER

PLANTS = ("autopilot", "cart_pendulum", "dc_motor", "double_integrator", "satellite_thrust", "two_tanks")
DISCRETE = """format = 1
title = "A tank in discrete time"
kind = "discrete"
[model]
states = ["level"]
measurements = ["gauge"]
Phi = [[0.9]]
B = [[0.5]]
Qd = [[0.2]]
H = [[1]]
R = [[0.1]]
x0 = [1]
P0 = [[1]]
dt = 2
[cost]
Qx = [[1]]
Qu = [[0.3]]
track = ["gauge"]
[experiment]
steps = 30
runs = 50
"""


def discrete(*pairs: tuple[str, str]) -> ModelFile:
    """The discrete plant with other pieces of text."""
    text = DISCRETE
    for old, fresh in pairs:
        assert old in text, old
        text = text.replace(old, fresh)
    return modelfile.loads(text)


def by_hand(found: Regulated, x: np.ndarray, steps: int, set_point: np.ndarray | None = None, error: np.ndarray | None = None):
    """The loop without noise, as a person writes it: plant and controller in turn; x, u and z over time."""
    plant, controller = found.truth, found.regulator.controller()
    states, inputs, seen = [], [], []
    for k in range(steps + 1):
        z = plant.H @ x + (0 if error is None or k else error)
        u = controller.step(z, set_point)
        states.append(x)
        inputs.append(u)
        seen.append(z)
        x = plant.Phi @ x + plant.B @ u
    return np.array(states), np.array(inputs), np.array(seen)


def near(found: np.ndarray, expected: np.ndarray) -> bool:
    size = np.abs(expected).max(axis=0, initial=0.0)
    return bool((np.abs(found - expected) <= EXACT * np.where(size > 0, size, 1.0)).all())


@pytest.fixture(scope="module")
def motor() -> Regulated:
    """The motor, which begins at rest."""
    return compute(ready("dc_motor"), runs=40, steps=60)


# Reports -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANTS)
def test_every_plant_of_the_gallery_has_its_report(name: str) -> None:
    """All checks pass; the cost is on three routes, the ensemble is tested, and every picture is there."""
    made = regulated.study(ready(name), runs=40, steps=40)
    assert [check.name for check in made.checks if not check.passed] == []
    routes = {check.name for check in made.checks}
    assert {"cost", "cost, again", "the controller, step by step", "variance of states and inputs", "cost of the runs"} <= routes
    pictures = {block.name for block in made.blocks if hasattr(block, "figure")}
    assert {"poles", "deviations", "kicks", "step_1", "ensemble"} <= pictures
    assert {"cost", "L", "K", "controller_A", "stable", "delay_margin"} <= {value.partition("_u")[0] for value in made.values}
    assert made.values["cost"].value == pytest.approx(regulating.designed(ready(name)).regulator.cost.value, rel=1e-12)


def test_a_report_says_who_is_who(motor: Regulated) -> None:
    """Gains of the report are the library's; the seed is that which was asked for."""
    made = regulated.report(motor)
    np.testing.assert_array_equal(made.values["L"].value, motor.regulator.L)
    np.testing.assert_array_equal(made.values["K"].value, motor.regulator.K)
    assert compute(ready("dc_motor"), seed=7, quick=True).seed == 7
    assert "L_w" not in made.values


def test_the_motors_cost_by_parts(motor: Regulated) -> None:
    """The published value, and the weights' shares with what lies between the samples make up the whole."""
    assert motor.regulator.cost.value == pytest.approx(1.040965, abs=5e-7)
    budget = motor.budget.value
    assert sum(budget.weights.values()) + budget.between == pytest.approx(budget.total, rel=1e-10)


def test_every_picture_can_be_drawn(motor: Regulated) -> None:
    """On paper, with numbers to copy, for pages too."""
    drawn = [
        loops.poles(motor), loops.deviations(motor, [0, 1], [0]), loops.step(motor, motor.set_points.value[0]),
        loops.motion(motor, motor.kicks.value[0]), loops.kicked(motor, [0, 1]), loops.tradeoff(motor, 0), loops.periods(motor),
        loops.opened(motor), loops.many(motor, [0, 2]), loops.shares(motor.budget.value.sources, "cost per second"),
    ]  # fmt: skip
    for drawing in drawn:
        assert len(drawing.text().splitlines()) > 1
        to_matplotlib(drawing)


# Second routes -------------------------------------------------------------------------------------------------------


def test_the_second_route_of_a_feedback_finds_a_wrong_one() -> None:
    """The cost of the optimal gain is the Riccati equation's; that of a gain 5 % off is larger, by terms of second order."""
    plant, cost = sample(ready("cart_pendulum").plant(), ready("cart_pendulum").cost, 0.02, R=np.eye(2))
    f, w = lqr(plant, cost), cost.weights(plant)
    size = np.sqrt(np.outer(np.diag(f.S), np.diag(f.S)))
    assert (np.abs(second.cost_of_gain(plant, w, f.L) - f.S) <= SOLVER * size).all()
    worse = second.cost_of_gain(plant, w, 1.05 * f.L) - f.S
    assert np.linalg.eigvalsh(worse / size).min() > -1e-12
    assert (np.abs(worse) / size).max() > 1e-4


def test_the_second_route_of_a_loops_covariance_finds_a_wrong_one(motor: Regulated) -> None:
    """The sum of what is left of all noises is the limit, and moves with every entry of the noise."""
    model = motor.loop.model
    P = second.stationary(model.Phi, model.Qd)
    sd = motor.limit.value.x.sd
    assert (np.abs(P[:2, :2] - motor.limit.value.x.P) <= SOLVER * np.outer(sd, sd)).all()
    assert (np.abs(second.stationary(model.Phi, 1.05 * model.Qd) / P - 1.05) < 1e-9).all()


# Responses -----------------------------------------------------------------------------------------------------------


def test_a_step_is_what_plant_and_controller_do_in_turn(motor: Regulated) -> None:
    """From rest, with the set point of one; the output comes to it."""
    [response] = motor.set_points.value
    x, u, z = by_hand(motor, np.zeros(2), motor.steps, np.array([1.0]))
    assert near(response.x, x)
    assert near(response.u, u)
    assert near(response.z, z)
    assert abs(z[-1, 0] - 1) < 0.01
    x, u, z = by_hand(motor, np.zeros(2), motor.steps, np.array([-0.3]))
    other = response.scaled(-0.3)
    assert near(other.x, x)
    assert near(other.u, u)
    assert near(other.z, z)
    [told] = [each for panel in loops.step(motor, other).panels for each in panel.levels if each.name]
    assert told.at == other.size == -0.3
    after = response.settled(response.z[:, 0], 1.0)
    assert after is not None
    assert (np.abs(response.z[response.t >= after, 0] - 1) <= 0.02).all()
    assert abs(response.z[response.t < after, 0][-1] - 1) > 0.02


def test_a_kick_is_what_plant_and_controller_do_in_turn(motor: Regulated) -> None:
    """The torque's kick of one σ in a period moves the rate; an error of the measurement moves the input."""
    torque, error = motor.kicks.value
    jump = np.array([0.0, np.sqrt(0.1)])
    x, u, _ = by_hand(motor, jump, motor.steps)
    assert near(torque.x, x)
    assert near(torque.u, u)
    wrong = np.sqrt(np.diag(motor.truth.R))
    x, u, _ = by_hand(motor, np.zeros(2), motor.steps, error=wrong)
    assert near(error.x, x)
    assert near(error.u, u)
    assert [torque.name, error.name] == ["noise w", "error of angle"]


def test_set_points_of_a_plant_that_is_moving() -> None:
    """A step is what the set point adds, wherever the plant begins and whatever loads there are."""
    for name in ("double_integrator", "two_tanks", "autopilot"):
        found = compute(ready(name), steps=400, quick=True)
        [response] = found.set_points.value
        i = found.truth.measurements.index(response.name)
        assert response.z[0, i] == 0
        assert abs(response.z[-1, i] - 1) < 0.01
    both = compute(ready("satellite_thrust"), steps=300, quick=True).set_points.value
    assert [response.name for response in both] == ["angle", "range"]
    assert abs(both[0].z[-1, 0] - 1) < 0.01
    assert abs(both[1].z[-1, 1] - 1) < 0.01


def test_the_mean_motion_is_that_of_a_known_start() -> None:
    """The pole leans and is set upright; the motor has nowhere to go."""
    found = compute(ready("cart_pendulum"), steps=100, quick=True)
    x, u, _ = by_hand(found, found.truth.x0, 100)
    assert near(found.initial.value.x, x)
    assert near(found.initial.value.u, u)
    assert "theta = 0.05" in found.initial.value.cause
    assert "stays there" in compute(ready("dc_motor"), steps=10, quick=True).initial.reason


# Wrong designs -------------------------------------------------------------------------------------------------------


def test_a_wrong_design_costs_what_the_truth_says() -> None:
    """True cost by a Lyapunov equation of our own; nothing is below the right design; the right design costs what it claims."""
    truth, design = ready("double_integrator").replace({"m": 1.5, "sigma": 0.2}), ready("double_integrator")
    found = compute(truth, design=design, steps=10, quick=True)
    plain, stepwise = sample(truth.plant(), truth.cost, truth.dt, R=truth.matrix("R"))
    loop = found.regulator.loop(plain)
    joint = second.stationary(loop.model.Phi, loop.model.Qd)
    H = loop.model.H
    rows = np.vstack([np.eye(2, len(joint)), H[1:]])
    w = stepwise.weights(plain)
    whole = (np.trace(w.joint @ rows @ joint @ rows.T) + stepwise.constant) / truth.dt
    assert found.cost.value == pytest.approx(whole, rel=1e-9)
    assert found.cost.value > found.best.regulator.cost.value
    assert found.regulator.cost.value == pytest.approx(regulating.designed(design).regulator.cost.value, rel=1e-12)
    same = compute(design, design=design, steps=10, quick=True)
    assert same.cost.value == pytest.approx(same.regulator.cost.value, rel=1e-10)
    assert near(same.loop.model.Phi, same.regulator.closed.model.Phi)


def test_noise_and_delay_are_the_truths_own() -> None:
    """A truth with a worse sensor, or a delay that the design knows nothing of, is not judged by what the design believes."""
    design = ready("dc_motor")
    right = compute(design, quick=True, steps=10).cost.value
    louder = compute(design.replace({"r": 0.04}), design=design, quick=True, steps=10)
    np.testing.assert_allclose(louder.truth.R, 0.04 / 0.1, rtol=1e-14)
    late = compute(regulating.changed(design, delay=0.25), design=design, quick=True, steps=10)
    assert late.truth.n == 2 + 3
    assert min(louder.cost.value, late.cost.value) > 1.05 * right
    assert louder.cost.value > louder.best.regulator.cost.value
    assert late.cost.value > late.best.regulator.cost.value


def test_a_loop_that_is_not_stable_is_named_and_not_run() -> None:
    """A mass a hundred times too light: the mode that grows, no limit, no margins, no ensemble; the report stands."""
    file = ready("double_integrator")
    found = compute(file.replace({"m": 0.01}), design=file, runs=20, steps=20)
    assert not found.stable
    assert "grows by a factor 1.7445 each step" in found.growing
    assert "x (controller)" in found.growing
    for part in (found.cost, found.limit, found.margins, found.ensemble):
        assert part.reason
    made = regulated.report(found)
    assert made.passed
    assert "does not hold this plant" in made.values["verdict"].value


def test_a_design_without_a_cost_takes_that_of_the_truth() -> None:
    """With numbers, for the design may not have the constants; its own cost is what it believes in."""
    text = ready("double_integrator").dumps().partition("# Bryson")[0]
    design = modelfile.loads(text.replace("sigma = { value", "noise = { value").replace('"sigma^2"', '"noise^2"'))
    truth = ready("double_integrator")
    found = compute(truth, design=design, quick=True, steps=10)
    np.testing.assert_allclose(found.regulator.L, found.best.regulator.L, rtol=1e-12)
    own = truth.edit(("cost", "Qu", 0, 0), 100)
    other = compute(truth, design=own, quick=True, steps=10)
    assert np.abs(other.regulator.L / found.regulator.L).max() < 0.5
    assert other.cost.value > 1.1 * found.cost.value
    with pytest.raises(ValueError, match=r"cost: expected a table \[cost\] .*, received none"):
        compute(design, quick=True)


def test_kinds_of_time_do_not_mix() -> None:
    """A discrete design has no period for a continuous truth, and the other way round."""
    for truth, design in ((ready("dc_motor"), discrete()), (discrete(), ready("dc_motor"))):
        with pytest.raises(ValueError, match=r"design: expected a .* model as the truth's, received a"):
            compute(truth, design=design, quick=True)


# Horizons, loads, discrete plants ------------------------------------------------------------------------------------


def test_a_horizon_schedules_the_gains() -> None:
    """The cost of five seconds on three routes and by the runs; set points are left out, and it is said."""
    file = regulating.changed(ready("double_integrator"), horizon=5.0)
    found = compute(file, runs=100)
    assert found.steps == 50
    assert found.regulator.L.shape == (50, 1, 2)
    assert found.noted == ("position follows no set point: there are none over a finite horizon",)
    assert found.per == "horizon"
    assert found.margins.reason
    assert abs(found.ensemble.value.score) < 5
    made = regulated.report(found)
    assert made.passed
    assert "stable" not in made.values
    np.testing.assert_array_equal(made.values["L_start"].value, found.regulator.L[0])


def test_a_load_is_borne_but_has_no_limit() -> None:
    """The autopilot: margins and budget without the load, which no input reaches; no limit of the wandering state."""
    found = compute(ready("autopilot"), quick=True)
    assert found.stable
    assert "h_c0" in found.limit.reason
    assert sum(found.budget.value.sources.values()) + found.budget.value.between == pytest.approx(found.budget.value.total, rel=1e-9)
    bears = margins(found.placed, found.truth)
    assert bears.inputs["u"].delay > 1


def test_a_discrete_plant_is_regulated() -> None:
    """Per step, with its own period; gains of the library's verb."""
    found = compute(discrete())
    model = DiscreteModel([[0.9]], [[0.2]], [[1]], [[0.1]], B=[[0.5]], x0=[1], P0=[[1]], dt=2)
    expected = regulator(model, Cost([[1]], [[0.3]]))
    np.testing.assert_allclose(found.regulator.L, expected.L, rtol=1e-12)
    assert found.per == "step"
    assert found.regulator.cost.value == pytest.approx(expected.cost.value, rel=1e-12)
    assert "one period" in found.periods.reason
    made = regulated.report(found)
    assert made.passed
    wrong = compute(discrete(("Phi = [[0.9]]", "Phi = [[0.5]]")), design=discrete(), quick=True)
    assert wrong.cost.value > wrong.best.regulator.cost.value


def test_a_perfect_measurement_and_a_free_input() -> None:
    """The integrator whose state is known at the samples: minimum variance, in closed form; a filter that forgets at once has no rate."""
    text = """format = 1
kind = "continuous"
[model]
F = [[0]]
B = [[1]]
G = [[1]]
Q = [[1]]
H = [[1]]
R = [[0]]
P0 = [[1]]
dt = 0.5
[cost]
Qx = [[1]]
Qu = [[0]]
track = ["z1"]
"""
    found = compute(modelfile.loads(text), runs=50, steps=30)
    assert found.regulator.L.item() * 0.5 == pytest.approx((3 + np.sqrt(3)) / (2 + np.sqrt(3)), rel=1e-12)
    assert found.regulator.cost.value / 0.5 == pytest.approx((3 + np.sqrt(3)) / 6, rel=1e-12)
    to_matplotlib(loops.poles(found))
    assert regulated.report(found).passed


def test_noises_that_correlate_are_answered() -> None:
    """The measurement tells of the disturbance: L_w is in the report, and all checks hold with a known offset and a cross weight."""
    noises = ("Qd = [[0.2]]", "Qd = [[0.2]]\nN = [[0.1]]\noffset = [0.3]")
    file = discrete(noises, ("Qu = [[0.3]]", "Qu = [[0.3]]\nN = [[0.1]]"), ('track = ["gauge"]', ""))
    made = regulated.study(file)
    assert made.passed
    assert made.values["L_w"].value
    assert made.values["cost_offset"].value > 0


def test_changes_are_refused_with_their_place() -> None:
    """Of the period of a discrete model; of what is no time; where there is no cost."""
    with pytest.raises(ValueError, match="dt: expected none with a discrete model, which has its own period, received 3"):
        regulating.changed(discrete(), dt=3)
    with pytest.raises(ValueError, match=r"cost\.delay: expected a time >= 0, s, received -1"):
        regulating.changed(ready("dc_motor"), delay=-1)
    with pytest.raises(ValueError, match=r"local_level\.toml: cost: expected a table \[cost\]"):
        regulating.changed(ready("local_level"), horizon=3)
    assert regulating.changed(ready("dc_motor")) == ready("dc_motor")
    assert regulating.changed(ready("dc_motor"), kind="delayed").regulator.kind == "delayed"


def test_a_page_can_have_all_but_the_runs_at_once(motor: Regulated) -> None:
    """quick leaves out what takes time, and changes nothing else."""
    quick = compute(ready("dc_motor"), steps=60, quick=True)
    assert "not asked for" in quick.ensemble.reason
    assert "not asked for" in quick.margins.reason
    np.testing.assert_array_equal(quick.limit.value.x.P, motor.limit.value.x.P)
    assert dataclasses.is_dataclass(quick)
    assert discretise(ready("dc_motor").plant(), 0.1).Phi.tolist() == quick.truth.Phi.tolist()
