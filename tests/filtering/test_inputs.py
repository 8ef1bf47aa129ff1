"""Known inputs and constants in the measurements: what models take and refuse, and what sampling makes of B and D."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from ctlabs import ContinuousModel, DiscreteModel, kalman_filter, simulate
from ctlabs.models import discretise, to_continuous
from tests.reference import EXACT, SOLVER, broken, close

pytestmark = pytest.mark.numerical

F = np.array([[0.0, 1.0], [-4.0, -0.6]])
B, D = np.array([[0.0, 1.0], [2.0, 0.0]]), np.array([[0.3, -0.7]])
PLANT = ContinuousModel(
    F, [[0], [1]], [[0.5]], [[1, 0]], Rc=[[0.2]], P0=np.eye(2), x0=[1, -1], B=B, D=D, measurement_offset=[3],
    measurement_units=["V"],
)  # fmt: skip
DT = 0.4
U = np.array([[1.0, -2.0], [0.5, 0.0], [-1.0, 3.0], [2.0, 1.0], [0.0, -1.0]])


def discrete(**changes: Any) -> DiscreteModel:
    """Two states, one measurement, two known inputs."""
    given: dict[str, Any] = {"Phi": [[1, 0.5], [0, 0.9]], "Qd": np.eye(2), "H": [[1, 0]], "R": [[2]], "P0": np.eye(2), "B": B, "D": D}
    return DiscreteModel(**(given | changes))


class TestModels:
    def test_the_number_of_inputs_is_that_of_b_or_d(self) -> None:
        """r; without either it is 0, and nothing is there by default."""
        assert (discrete().r, discrete(B=None).r, discrete(D=None).r, discrete(B=None, D=None).r) == (2, 2, 2, 0)
        assert (PLANT.r, replace(PLANT, B=None, D=None).r) == (2, 0)
        plain = discrete(B=None, D=None)
        assert plain.B is plain.D is plain.offset is plain.measurement_offset is None
        assert (plain.first, plain.measurement_units, plain.dt) == (1, ("",), 1.0)

    def test_all_are_read_only_float_arrays(self) -> None:
        """As the other matrices are."""
        model = discrete(measurement_offset=[1])
        for name in ("B", "D", "measurement_offset"):
            array = getattr(model, name)
            assert array.dtype == np.float64
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0

    def test_they_may_vary_and_are_cut_with_the_rest(self) -> None:
        """B by steps; D and the measurements' offset by instants, which are one more."""
        model = discrete(B=np.ones((4, 2, 2)), D=np.ones((5, 1, 2)), measurement_offset=np.arange(5.0)[:, None])
        assert model.horizon == 4
        short = model.cut(2)
        assert (short.horizon, len(short.B), len(short.D)) == (2, 2, 3)  # type: ignore[arg-type]  # they are there
        assert short.measurement_offset is not None
        assert short.measurement_offset.ravel().tolist() == [0, 1, 2]

    @pytest.mark.parametrize("first", [0, 1])
    def test_a_model_carries_its_first_instant(self, first: int) -> None:
        """Verbs take it from there, unless they are told otherwise."""
        model = discrete(B=None, D=None, first=first)
        z = np.array([1.0, 2.0, 3.0])
        assert len(kalman_filter(model, z).t) == 3 + first
        assert len(kalman_filter(model, z, first=1 - first).t) == 4 - first
        assert len(simulate(model, 4, 2, 1).z) == 5 - first

    @pytest.mark.parametrize(
        ("make", "message"),
        [
            (lambda: discrete(B=[[1]]), r"^B: expected shape \(2, r\) or \(steps, 2, r\), received \(1, 1\)$"),
            (lambda: discrete(D=[[1], [2]]), r"^D: expected shape \(1, r\) or \(steps\+1, 1, r\), received \(2, 1\)$"),
            (lambda: discrete(D=[[1]]), r"^D: expected 2 columns as B has, received 1$"),
            (lambda: discrete(B=np.ones((3, 2, 2)), D=np.ones((3, 1, 2))), r"expected one number of steps, received \{'B': 3, 'D': 2\}$"),
            (
                lambda: discrete(measurement_offset=[1, 2]),
                r"^measurement_offset: expected shape \(1,\) or \(steps\+1, 1\), received \(2,\)$",
            ),
            (lambda: discrete(measurement_offset=[np.nan]), r"^measurement_offset: expected finite numbers, received nan"),
            (lambda: discrete(measurement_units=["m", "s"]), r"^measurement_units: expected 1 names, received \['m', 's'\]$"),
            (lambda: discrete(first=2), r"^first: expected 0 or 1, received 2$"),
            (lambda: discrete(first=-1), r"^first: expected"),
            (lambda: replace(PLANT, B=[[1]]), r"^B: expected shape \(2, r\), received \(1, 1\)$"),
            (lambda: replace(PLANT, D=[[1, 2], [3, 4]]), r"^D: expected shape \(1, r\), received \(2, 2\)$"),
            (lambda: replace(PLANT, D=[[1]]), r"^D: expected 2 columns as B has, received 1$"),
            (lambda: replace(PLANT, measurement_offset=[1, 2]), r"^measurement_offset: expected shape \(1,\), received \(2,\)$"),
        ],
    )  # fmt: skip
    def test_what_does_not_fit_is_refused(self, make: Any, message: str) -> None:
        """The matrix, what was expected and what was received, in one line."""
        with pytest.raises(ValueError, match=message):
            make()


def by_small_steps(x: np.ndarray, u: np.ndarray, parts: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """x after a period, and the average of z over it, by Runge and Kutta's fourth order in small steps, without noise."""
    h, area = DT / parts, np.zeros(1)

    def slope(x: np.ndarray) -> np.ndarray:
        return F @ x + B @ u

    for _ in range(parts):
        a = slope(x)
        b = slope(x + h / 2 * a)
        c = slope(x + h / 2 * b)
        d = slope(x + h * c)
        middle = x + h / 2 * b
        after = x + h / 6 * (a + 2 * b + 2 * c + d)
        area = area + h / 6 * PLANT.H @ (x + 4 * middle + after)
        x = after
    return x, area / DT + D @ u + 3.0


class TestSampling:
    def test_b_is_the_integral_of_the_transition(self) -> None:
        """B_d = F⁻¹(Φ − I)B; D, the measurements' offset and their units stay; 5 % are seen."""
        found = discretise(PLANT, DT, R=[[1.0]])
        exact = np.linalg.solve(F, (expm(F * DT) - np.eye(2)) @ B)
        assert close(found.B, exact, EXACT)
        assert not close(found.B, broken(exact), EXACT)
        assert found.D is not None
        assert found.measurement_offset is not None
        assert found.D.tolist() == D.tolist()
        assert found.measurement_offset.tolist() == [3]
        assert (found.measurement_units, found.first) == (("V",), 1)

    def test_a_period_is_that_of_a_fine_simulation(self) -> None:
        """State after it, and the average of the measurement over it, for any start and input."""
        samples, averages = discretise(PLANT, DT, R=[[1.0]]), discretise(PLANT, DT, average=True)
        assert averages.first == 0
        for model in (samples, averages):
            assert close(model.B, samples.B, EXACT)
        for x, u in zip(np.array([[1.0, 0.0], [-2.0, 3.0]]), U[:2], strict=True):
            after, mean = by_small_steps(x, u)
            assert close(samples.Phi @ x + samples.B @ u, after, SOLVER)
            assert close(averages.H @ x + averages.D @ u + averages.measurement_offset, mean, SOLVER)
            assert not close(averages.H @ x + D @ u + averages.measurement_offset, mean, 1e-3)

    def test_an_input_known_beforehand_is_an_offset(self) -> None:
        """The same filter by u at run time, and by an offset made of it."""
        plant = replace(PLANT, D=None)
        live, given = discretise(plant, DT, R=[[1.0]]), discretise(plant, DT, R=[[1.0]], u=U)
        z = np.array([1.0, -1.0, 2.0, 0.5, 0.0])
        one, two = kalman_filter(live, z, u=np.vstack([U[1:], [[9.0, 9.0]]]), u0=U[0]), kalman_filter(given, z)
        assert close(one.x_plus, two.x_plus, EXACT)
        assert close(one.P_plus, two.P_plus, EXACT)

    def test_samples_lead_back_to_b(self) -> None:
        """to_continuous gives B, D, the offset and the units again."""
        back = to_continuous(discretise(replace(PLANT, Q=[[0.5]]), DT, R=[[0.5]]))
        assert close(back.F, F, SOLVER)
        assert close(back.B, B, SOLVER)
        assert back.D is not None
        assert back.measurement_offset is not None
        assert (back.D.tolist(), back.measurement_offset.tolist(), back.measurement_units) == (D.tolist(), [3.0], ("V",))
        assert close(discretise(back, DT, R=[[0.5]]).B, discretise(PLANT, DT, R=[[0.5]]).B, SOLVER)

    def test_what_has_two_readings_is_refused(self) -> None:
        """An input that enters the measurement, or the average of one, is given at run time."""
        with pytest.raises(ValueError, match="u: expected a model with B and without D, received one with it"):
            discretise(PLANT, DT, R=[[1.0]], u=[1, 2])
        with pytest.raises(ValueError, match="u: expected a model with B, received one without"):
            discretise(replace(PLANT, B=None, D=None), DT, R=[[1.0]], u=[1, 2])
        with pytest.raises(ValueError, match="u: expected none with average=True"):
            discretise(PLANT, DT, average=True, u=[1, 2])


@pytest.mark.parametrize("first", [0, 1])
def test_a_known_input_only_moves_the_mean(first: int) -> None:
    """Estimates minus the plant's own motion are those without input; simulated records with u are those without, moved."""
    model = discretise(PLANT, DT, R=[[1.0]])
    bare = replace(model, B=None, D=None, measurement_offset=None, x0=[0, 0])
    z = np.array([1.0, -1.0, 2.0, 0.5, 0.0])
    u0 = np.array([0.7, -0.2]) if first else None
    inputs = U if u0 is None else np.vstack([u0, U])
    mean = [np.array([1.0, -1.0])]
    for u in inputs[: len(z) - 1 + first]:
        mean.append(model.Phi @ mean[-1] + model.B @ u)
    moved = np.array(mean)
    shift = moved[first:, 0] + (U @ D.T)[:, 0] + 3.0
    found = kalman_filter(model, z, u=U, u0=u0, first=first)
    own = kalman_filter(bare, z - shift, first=first)
    assert close(found.x_plus - moved, own.x_plus, 1e-10)
    assert close(found.P_plus, own.P_plus, EXACT)
    assert not close(kalman_filter(model, z, u=1.05 * U, u0=u0, first=first).x_plus, found.x_plus, 1e-3)
    here, there = simulate(model, len(z) - 1 + first, 3, 1, first, u=U, u0=u0), simulate(bare, len(z) - 1 + first, 3, 1, first)
    assert close(here.x - moved[:, :, None], there.x, 1e-10)
    assert close(here.z - shift[:, None, None], there.z, 1e-10)
