"""Linearisation: right matrices, honest refusals, and a flow that is the solution of the equations."""

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

from ctlabs.models import linearisation
from ctlabs.models.discretisation import interval
from ctlabs.models.linearisation import Dynamics
from tests.reference import EXACT, SOLVER

angle, rate, torque, k, t = sympy.symbols("angle rate torque k t")
PENDULUM = Dynamics([rate, -k * sympy.sin(angle) + torque], [angle, rate], [torque])
x, y = sympy.symbols("x y")
#: A stable circle x² + y² = 1, turned through at the rate 1.
CIRCLE = Dynamics([x - y - x * (x**2 + y**2), x + y - y * (x**2 + y**2)], [x, y])


def test_the_jacobian_is_the_derivative_of_the_equations():
    """∂f/∂x and ∂f/∂u of the pendulum, at any point."""
    F, B = PENDULUM.jacobians()
    assert sympy.Matrix([[0, 1], [-k * sympy.cos(angle), 0]]) == F
    assert sympy.Matrix([0, 1]) == B
    assert PENDULUM.parameters == ("k",)


@pytest.mark.parametrize(("place", "sign"), [(0, -1), (sympy.pi, 1)])
def test_a_point_of_rest_gives_a_constant_model(place, sign):
    """Hanging and standing pendulum differ in the sign of the stiffness."""
    nominal = {angle: place, rate: 0, torque: 0}
    model = linearisation.model(PENDULUM.at(nominal), {"k": 2.5}, H=[[1, 0]], P0=np.eye(2), states=["angle", "rate"])
    assert np.array_equal(model.F, [[0, 1], [2.5 * sign, 0]])
    assert np.array_equal(model.B, [[0], [1]])
    assert not model.Q.any()
    assert model.states == ("angle", "rate")


def test_a_trajectory_gives_a_model_in_its_time():
    """Along the circle the deviations turn with it: F(t) − F(0) has the turning terms."""
    F = CIRCLE.at({x: sympy.cos(t), y: sympy.sin(t)}, t).F
    radial = sympy.Matrix([sympy.cos(t), sympy.sin(t)])
    tangent = radial.diff(t)
    # e_r' = e_t: a tangential deviation keeps its size, a radial one decays like e^(−2t).
    assert sympy.simplify(F * tangent - tangent.diff(t)) == sympy.zeros(2, 1)
    assert sympy.simplify(F * radial - (radial.diff(t) - 2 * radial)) == sympy.zeros(2, 1)


def test_a_nominal_that_is_no_solution_is_refused():
    """A circle run through at the wrong rate, a missing input, and a point where the pendulum falls."""
    with pytest.raises(ValueError, match="nominal: expected a solution of the equations"):
        CIRCLE.at({x: sympy.cos(1.05 * t), y: sympy.sin(1.05 * t)}, t)
    with pytest.raises(ValueError, match=r"received none for \['torque'\]"):
        PENDULUM.at({angle: 0, rate: 0})
    with pytest.raises(ValueError, match="received one that leaves"):
        PENDULUM.at({angle: sympy.pi / 2, rate: 0, torque: 0})
    assert PENDULUM.at({angle: sympy.pi / 2, rate: 0, torque: k}).F == sympy.Matrix([[0, 1], [0, 0]])


def test_wrong_shapes_and_names_are_refused():
    """One equation for each state, each symbol once, a number for each parameter."""
    with pytest.raises(ValueError, match="f: expected 2 expressions"):
        Dynamics([rate], [angle, rate])
    with pytest.raises(ValueError, match="states, inputs: expected different symbols"):
        Dynamics([rate], [angle], [angle])
    with pytest.raises(ValueError, match=r"values: expected a number for each of \['k'\]"):
        linearisation.flow(PENDULUM, {}, 0.1)
    with pytest.raises(ValueError, match=r"values: expected a number for each of \['k'\]"):
        linearisation.model(PENDULUM.at({angle: 0, rate: 0, torque: 0}), {}, H=[[1, 0]], P0=np.eye(2))


def test_the_flow_solves_the_equations_with_order_four():
    """Against an integrator of order 8: the error falls 16 times when the step is halved."""
    start = np.array([[1.0, -2.0], [0.5, 0.1]])

    def solved(column):
        pendulum = solve_ivp(lambda _, s: [s[1], -2 * np.sin(s[0])], (0, 1), column, "DOP853", rtol=1e-13, atol=1e-14)
        return pendulum.y[:, -1]

    exact = np.transpose([solved(column) for column in start.T])
    errors = [
        np.abs(linearisation.flow(PENDULUM, {"k": 2}, 1.0, parts).f(start) - exact).max() for parts in (16, 32, 64)
    ]
    assert errors[-1] < SOLVER
    assert abs(np.log2(errors[0] / errors[1]) - 4) < 0.2
    assert abs(np.log2(errors[1] / errors[2]) - 4) < 0.2
    assert np.abs(linearisation.flow(PENDULUM, {"k": 2.1}, 1.0, 64).f(start) - exact).max() > 1e-3


def test_the_derivative_is_that_of_the_flow():
    """Central differences of f, for each of several states."""
    flow = linearisation.flow(PENDULUM, {"k": 2}, 0.3, parts=2)
    start, step = np.array([[1.0, -2.0, 0.2], [0.5, 0.1, 3.0]]), 1e-5
    shifts = step * np.eye(2)[:, :, None]
    by_differences = np.array([(flow.f(start + shift) - flow.f(start - shift)) / (2 * step) for shift in shifts])
    assert np.abs(flow.F(start) - by_differences.swapaxes(0, 1)).max() < SOLVER


def test_a_linear_flow_is_the_transition_matrix():
    """F of linear equations is e^(Fh) up to the method's order, whatever the state."""
    linear = Dynamics([rate, -k * angle], [angle, rate])
    Phi = interval([[0, 1], [-2, 0]], np.zeros((2, 2)), 0.5).Phi
    F = linearisation.flow(linear, {"k": 2}, 0.5, parts=64).F(np.array([[1.0, 7.0], [0.0, -3.0]]))
    assert np.abs(F - Phi[:, :, None]).max() < SOLVER
    assert np.abs(F[:, :, 0] - F[:, :, 1]).max() < EXACT


def test_transitions_along_a_trajectory_multiply_to_its_derivative():
    """Φ(N, 0) from single steps is the derivative of the last state by the first."""
    flow = linearisation.flow(CIRCLE, {}, 0.05)
    path, Phi = flow.along([0.4, 0.1], 20)
    assert path.shape == (21, 2)
    assert Phi.shape == (20, 2, 2)
    step = 1e-5
    ends = [flow.along(path[0] + shift, 20)[0][-1] for shift in (*(step * np.eye(2)), *(-step * np.eye(2)))]
    by_differences = np.array([(ends[j] - ends[j + 2]) / (2 * step) for j in range(2)]).T
    assert np.abs(np.linalg.multi_dot(Phi[::-1]) - by_differences).max() < SOLVER
