"""The table [cost] of a model file: what it gives, what is wrong with it and where, and that changes of the file keep it."""

import numpy as np
import pytest

from ctlabs.files.modelfile import ModelFileError, gallery, loads, ready
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.regulation import margins, regulator, sample
from ctlabs.studies.designing import designed

PLANTS = ("autopilot", "cart_pendulum", "dc_motor", "double_integrator", "satellite_thrust", "task24", "task25", "task26", "two_tanks")
TEXT = """format = 1
kind = "continuous"
[constants]
a = 2
big = { value = 4, min = 0 }
[model]
states = ["x", "v", "load"]
measurements = ["position", "speed"]
F = [[0, 1, 0], [0, "-a", 1], [0, 0, 0]]
B = [[0], [1], [0]]
G = [[0, 0], [1, 0], [0, 1]]
Q = [[1, 0], [0, 0.1]]
H = [[1, 0, 0], [0, 1, 0]]
R = [[0.1, 0], [0, 0.1]]
P0 = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
dt = 0.5
[cost]
Qx = [["big", 0, 0], [0, 0, 0], [0, 0, 0]]    # the place
Qu = [["1/a"]]
N = [[0], ["0.1*a"], [0]]
outputs = { speed = "2*a", miss = { row = ["1", "-1", 0], weight = "3" } }
loads = ["load"]
track = ["position"]
delay = "0.1*a"
kind = "delayed"
"""


def test_a_cost_says_what_it_says() -> None:
    """Expressions of the constants in weights, outputs, rows, times; options as they are typed."""
    file = loads(TEXT)
    cost, options = file.cost, file.regulator
    assert cost is not None
    assert cost.Qx[0, 0] == 4
    assert cost.Qu[0, 0] == 0.5
    assert cost.N[1, 0] == pytest.approx(0.2, abs=0)
    row, weight = cost.outputs["miss"]
    assert (row.tolist(), weight, cost.outputs["speed"]) == ([1, -1, 0], 3, (None, 4))
    assert options == ("delayed", 0.2, {}, ("load",), ("position",), False)
    assert file.replace({"big": 9}).cost.Qx[0, 0] == 9
    assert loads(TEXT.partition("[cost]")[0]).cost is None
    with pytest.raises(ModelFileError, match=r"model\.toml: cost: expected a table \[cost\] .*, received none"):
        _ = loads(TEXT.partition("[cost]")[0]).regulator


def test_defaults_are_those_of_the_library() -> None:
    """A cost of two keys."""
    file = loads(TEXT.partition("[cost]")[0] + "[cost]\nQx = [[1,0,0],[0,0,0],[0,0,0]]\nQu = [[1]]\n")
    cost = file.cost
    assert (cost.N, cost.Qf, cost.horizon, cost.outputs, cost.discount) == (None, None, None, None, 1)
    assert file.regulator == ("current", 0, {}, (), (), False)
    assert file.input_names == ("u",)


#: A piece of the text, what stands there instead, and the problem.
WRONG = [
    ('Qu = [["1/a"]]', 'Qu = [["1/b"]]', 'cost.Qu[0][0]: unknown name "b"; known are a, big, pi, e, inf'),
    ('Qu = [["1/a"]]', 'Qu = [["1/"]]', 'cost.Qu[0][0]: column 3: expected a number, a name or "(", received the end'),
    ('Qu = [["1/a"]]', 'Qu = [["t"]]', 'cost.Qu[0][0]: expected a constant value, received "t", the time, which may not stand here'),
    ('Qu = [["1/a"]]', 'Qu = [["1/(a-2)"]]', "cost.Qu[0][0]: column 2: division by zero"),
    ('Qu = [["1/a"]]', 'Qu = [["-a"]]', "cost.Qu: expected weights >= 0 on the diagonal, received -2"),
    ('Qu = [["1/a"]]', "Qu = 3", "cost.Qu: expected a list of rows, each a list of numbers or expressions, received 3"),
    ('Qu = [["1/a"]]', "Qu = [[1, 0]]", "cost.Qu[0]: expected 1 column (one per known input), received 2"),
    ('Qu = [["1/a"]]', "Qu = [[1], [1]]", "cost.Qu: expected 1 row (one per known input), received 2"),
    ('Qu = [["1/a"]]\n', "", "cost.Qu: expected the weight Qu of the inputs, received none"),
    ('Qu = [["1/a"]]', 'QU = [["1/a"]]', 'cost: unknown key "QU"; did you mean "Qu"?'),
    ("[0, 0, 0], [0, 0, 0]]    #", "[0, 0, 0]]    #", "cost.Qx: expected 3 rows (one per state), received 2"),
    ('speed = "2*a"', 'spede = "2*a"',
     'cost.outputs.spede: expected a measurement (or a row beside the weight), received "spede"; did you mean "speed"?'),
    ('speed = "2*a"', 'speed = "2*"', 'cost.outputs.speed: column 3: expected a number, a name or "(", received the end'),
    ('speed = "2*a"', 'speed = "-a"', "cost.outputs.speed: expected a number >= 0, received -2.0"),
    ('row = ["1", "-1", 0]', 'row = ["1", "-1"]', "cost.outputs.miss.row: expected 3 numbers (one per state), received 2"),
    ('row = ["1", "-1", 0]', 'row = ["1", "c", 0]', 'cost.outputs.miss.row[1]: unknown name "c"; known are a, big, pi, e, inf'),
    ('weight = "3"', 'wait = "3"', 'cost.outputs.miss: unknown key "wait"; did you mean "weight"?'),
    ("outputs = {", "integral = { speed = 0, position = 1 }\noutputs = {", "cost.integral.speed: expected a weight > 0, received 0"),
    ("outputs = {", "integral = 3\noutputs = {", "cost.integral: expected a table NAME = weight, received 3"),
    ('loads = ["load"]', 'loads = ["laod"]', 'cost.loads[0]: expected a state, received "laod"; did you mean "load"?'),
    ('track = ["position"]', 'track = "position"', 'cost.track: expected a list of texts in quotes, received "position"'),
    ('track = ["position"]', 'track = ["x"]', 'cost.track[0]: expected a measurement, received "x"; known are position, speed'),
    ('delay = "0.1*a"', 'delay = "-a"', "cost.delay: expected a time >= 0, s, received -2"),
    ('kind = "delayed"', 'kind = "late"', 'cost.kind: expected "current" or "delayed", received "late"'),
    ('kind = "delayed"', "stabilise = 1", "cost.stabilise: expected true or false, received 1"),
    ('kind = "delayed"', "discount = 2", "cost.discount: expected a number in (0, 1], received 2"),
    ('kind = "delayed"', "Qf = [[1,0,0],[0,0,0],[0,0,0]]",
     "cost.horizon: expected a horizon beside Qf, the weight of the last state, received none"),
    ('kind = "delayed"', 'horizon = "-a"', "cost.horizon: expected a number > 0, received -2.0"),
    ("B = [[0], [1], [0]]\n", "", "model.B: expected the matrix B by which the inputs of a regulator enter, received none beside [cost]"),
    ("B = [[0], [1], [0]]\n", "B = [[0], [1], [0]]\nu = [1]\n",
     "model.u: expected none beside [cost], whose regulator makes the inputs, received one"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "fresh", "expected"), WRONG)
def test_what_is_wrong_with_a_cost_is_said_with_its_place(old: str, fresh: str, expected: str) -> None:
    """One problem, in one line: place, expected, received."""
    assert TEXT.count(old) == 1
    found = loads(TEXT.replace(old, fresh), check=False).problems()
    assert str(found[0]) == expected
    assert len(found) == 1 or "unknown key" in expected  # what is missing then is told, too


def test_weights_that_are_indefinite_together_are_refused() -> None:
    """N beside Qx and Qu, with and without outputs, which make it definite."""
    wide = TEXT.replace('N = [[0], ["0.1*a"], [0]]', "N = [[0], [9], [0]]")
    for text in (wide, "\n".join(line for line in wide.splitlines() if not line.startswith("outputs"))):
        [problem] = loads(text, check=False).problems()
        assert problem.where == "cost.N"
        assert "[[Qx, N], [N', Qu]]" in problem.message
    assert loads(TEXT).problems() == []
    without = "\n".join(line for line in TEXT.splitlines() if not line.startswith("outputs"))
    assert [p.where for p in loads(without, check=False).problems()] == ["cost.N"]


def test_numbers_that_make_a_cost_none_are_told_when_they_are_replaced() -> None:
    """--set big=-1 is refused with the place, as the model's matrices are."""
    with pytest.raises(ModelFileError, match=r"cost\.Qx: expected weights >= 0 on the diagonal, received -1"):
        _ = loads(TEXT.replace("min = 0", "min = -9")).replace({"big": -1}).cost


def test_a_file_that_is_written_again_keeps_its_cost() -> None:
    """To the byte without a change; with other constants the comments and expressions of [cost] stay."""
    assert loads(TEXT).dumps() == TEXT
    changed = loads(TEXT).replace({"a": 4}).dumps()
    assert changed == TEXT.replace("a = 2", "a = 4").replace("a = 4.0", "a = 4") or changed == TEXT.replace("a = 2", "a = 4.0")
    assert loads(changed).cost.outputs["speed"] == (None, 8)


def test_a_renamed_constant_is_renamed_in_the_cost() -> None:
    """In matrices, outputs, rows and times; a constant that the cost uses cannot be removed."""
    file = loads(TEXT.replace('row = ["1"', 'row = ["a/2"')).rename_constant("a", "alpha")
    again = loads(file.dumps())
    assert again.cost.Qu[0, 0] == 0.5
    assert again.cost.outputs["miss"][0][0] == 1
    assert again.regulator.delay == 0.2
    with pytest.raises(ModelFileError, match=r"constants\.big: expected a constant that is used nowhere, .* cost\.Qx"):
        loads(TEXT).remove_constant("big")


def test_states_that_come_and_go_take_their_weights_with_them() -> None:
    """A new state weighs nothing; one that goes leaves the weights of the others; a name that is gone is told."""
    wider = loads(TEXT).add_state("drift")
    assert wider.problems() == []
    np.testing.assert_array_equal(wider.cost.Qx, np.diag([4.0, 0, 0, 0]))
    np.testing.assert_array_equal(wider.cost.N.ravel(), [0, 0.2, 0, 0])
    assert wider.cost.outputs["miss"][0].tolist() == [1, -1, 0, 0]
    np.testing.assert_array_equal(wider.remove_state(3).cost.Qx, loads(TEXT).cost.Qx)
    fewer = loads(TEXT).remove_state(2)
    assert [str(p) for p in fewer.problems()] == ['cost.loads[0]: expected a state, received "load"; known are x, v']
    assert fewer.remove(("cost", "loads")).cost.Qx.shape == (2, 2)
    lost = loads(TEXT).remove_measurement(1)
    assert [p.where for p in lost.problems()] == ["cost.outputs.speed"]
    assert loads(TEXT).add_noise().add_measurement("angle").problems() == []


def test_a_cost_can_be_written_into_a_file() -> None:
    """A whole table and single cells by edit, as pages do."""
    plain = loads(TEXT.partition("[cost]")[0])
    table = {"Qx": np.diag([1.0, 0, 0]), "Qu": [["1/a"]], "outputs": {"speed": 2, "miss": {"row": [1, 0, 0], "weight": "a"}}}
    file = plain.edit(("cost",), table).edit(("cost", "Qu", 0, 0), "3*a").edit(("cost", "outputs", "speed"), "a")
    assert file.problems() == []
    assert (file.cost.Qu[0, 0], file.cost.outputs["speed"], file.cost.outputs["miss"][1]) == (6, (None, 2), 2)
    assert file.remove(("cost",)).cost is None
    assert loads(file.dumps()).cost.Qx.tolist() == np.diag([1.0, 0, 0]).tolist()


def test_a_plant_has_its_inputs() -> None:
    """Continuous, or discrete with B and D, constant or over some steps."""
    assert isinstance(loads(TEXT).plant(), ContinuousModel)
    text = """format = 1
kind = "discrete"
[model]
Phi = [[0.9]]
B = [["1+k"]]
D = [[0.5]]
Qd = [[1]]
H = [[1]]
R = [[1]]
P0 = [[1]]
dt = 2
[cost]
Qx = [[1]]
Qu = [[1]]
horizon = 3
"""
    model = loads(text).plant(3)
    assert isinstance(model, DiscreteModel)
    np.testing.assert_array_equal(model.B, [[[1]], [[2]], [[3]]])
    np.testing.assert_array_equal(model.D, [[0.5]])
    assert loads(text).cost.horizon == 3
    assert loads(text.replace('"1+k"', "2")).plant().B.tolist() == [[2]]
    with pytest.raises(ModelFileError, match=r"cost\.delay: expected none in a discrete model"):
        loads(text + "delay = 1\n").checked()
    with pytest.raises(ModelFileError, match=r"model\.B: expected the matrix B"):
        ready("local_level").plant()


# --- the gallery's plants ---------------------------------------------------------------------------------------------


def test_the_plants_are_those_with_a_cost() -> None:
    """Six of them, and three of labs."""
    assert sorted(entry.name for entry in gallery() if ready(entry.name).cost is not None) == list(PLANTS)


@pytest.mark.parametrize("name", PLANTS)
def test_a_plant_of_the_gallery_is_regulated(name: str) -> None:
    """One cost by three routes, a loop whose poles are inside the circle, and names and units of everything."""
    file = ready(name)
    found = designed(file).regulator
    assert found.cost.spread < 1e-12
    assert np.abs(found.poles).max() < 1
    assert all(file.units)
    assert all(file.measurement_units)


def test_the_labs_plants_cost_what_is_found_by_hand() -> None:
    """Labs 24 to 26: the root of a square, J = q√(ρ + h²/12) + √(qr + q²h²/4) + qτ, Doyle's gains and his margin in the limit of dt."""
    lab = {name: ready(name) for name in ("task24", "task25", "task26")}
    Qu, b, Phi, Q, R = (lab["task24"].constants[name] for name in ("input_weight", "b", "Phi", "Q", "R"))
    S = np.max(np.roots([b**2, Qu * (1 - Phi**2) - b**2, -Qu]))
    P_minus = np.max(np.roots([1, R * (1 - Phi**2) - Q, -Q * R]))
    L, P_plus = b * Phi * S / (Qu + b**2 * S), P_minus * R / (P_minus + R)
    assert designed(lab["task24"]).regulator.cost.value == pytest.approx(S * Q + L**2 * (Qu + b**2 * S) * P_plus, rel=1e-12)
    q, r, h, rho, tau = (lab["task25"].constants[name] for name in ("q", "r", "h", "input_weight", "tau"))
    J = q * np.sqrt(rho + h**2 / 12) + np.sqrt(q * r + q**2 * h**2 / 4) + q * tau
    assert designed(lab["task25"]).regulator.cost.value == pytest.approx(J, rel=1e-12)
    f = 10.0  # 2 + √(4 + 60)
    assert margins(designed(lab["task26"]).regulator).inputs["u"].gain[1] == pytest.approx(1 + 1 / f**2, rel=1e-5)


@pytest.mark.parametrize(("dt", "expected"), [(0.025, 1.038359), (0.1, 1.040965), (0.25, 1.055809), (0.5, 1.111583)])
def test_the_motor_costs_what_is_published(dt: float, expected: float) -> None:
    """The mean cost per second of the DC motor at four periods."""
    file = ready("dc_motor")
    assert abs(regulator(file.plant(), file.cost, dt=dt, **file.regulator._asdict()).cost.value - expected) < 5e-7


def test_the_cart_falls_without_a_regulator_and_first_moves_the_other_way() -> None:
    """One growing mode, and an unstable zero from the force to the position: what makes it hard."""
    plant, cost = sample(ready("cart_pendulum").plant(), ready("cart_pendulum").cost, 0.02, R=np.eye(2))
    assert (np.abs(np.linalg.eigvals(plant.Phi)) > 1.01).sum() == 1
    assert cost.N is not None
