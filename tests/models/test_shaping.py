"""Shaping filters: every block is what its card says, and the joint models are what the block diagram says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
import scipy.integrate
from hypothesis import given
from numpy.typing import NDArray

from ctlabs.models import ContinuousModel, shaping
from ctlabs.models.discretisation import discretise, interval
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import continuous_models

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
TAU = np.linspace(-3.0, 3.0, 25)
W = np.array([0.0, 0.3, 1.0, 1.9, 5.0, 40.0])


def damped(variance: float, w0: float, zeta: float) -> Callable[[Array], Array]:
    """The autocorrelation on the card of the second-order block."""

    def psi(tau: Array) -> Array:
        t = np.abs(tau)
        if zeta == 1:
            return variance * np.exp(-w0 * t) * (1 + w0 * t)
        if zeta < 1:
            wd = w0 * np.sqrt(1 - zeta**2)
            return variance * np.exp(-zeta * w0 * t) * (np.cos(wd * t) + zeta / np.sqrt(1 - zeta**2) * np.sin(wd * t))
        wd = w0 * np.sqrt(zeta**2 - 1)
        return variance * np.exp(-zeta * w0 * t) * (np.cosh(wd * t) + zeta / np.sqrt(zeta**2 - 1) * np.sinh(wd * t))

    return psi


STATIONARY = {
    "gauss_markov": (shaping.gauss_markov(5.0, 0.7), lambda tau: 5.0 * np.exp(-np.abs(tau) / 0.7)),
    "underdamped": (shaping.second_order(2.0, 1.9, 0.3), damped(2.0, 1.9, 0.3)),
    "critical": (shaping.second_order(2.0, 1.9, 1.0), damped(2.0, 1.9, 1.0)),
    "overdamped": (shaping.second_order(2.0, 1.9, 2.5), damped(2.0, 1.9, 2.5)),
    "bias": (shaping.bias(3.0), lambda tau: 3.0 + 0 * tau),
    "oscillator": (shaping.oscillator(3.0, 1.9), lambda tau: 3.0 * np.cos(1.9 * tau)),
}


@pytest.mark.parametrize(("block", "psi"), STATIONARY.values(), ids=STATIONARY)
def test_the_autocorrelation_is_that_of_the_card(block: ContinuousModel, psi: Callable[[Array], Array]) -> None:
    """ψ(τ) from Lyapunov and the matrix exponential equals the closed form, and P0 is stationary."""
    assert close(shaping.autocorrelation(block, TAU), psi(TAU), SOLVER)
    assert close(shaping.stationary_covariance(block), block.P0, EXACT)
    if block.Q.any():
        assert not close(shaping.autocorrelation(replace(block, F=broken(block.F)), TAU), psi(TAU), 1e-3)


@pytest.mark.parametrize(
    ("block", "num", "den"),
    [
        (shaping.random_walk(4.0), [1.0], [1.0, 0.0]),
        (shaping.gauss_markov(5.0, 0.1), [1.0], [1.0, 10.0]),
        (shaping.second_order(2.0, 3.0, 0.3), [1.0], [1.0, 2 * 0.3 * 3.0, 9.0]),
        (shaping.oscillator(2.0, 3.0), [0.0], [1.0, 0.0, 9.0]),
        (shaping.bias(2.0), [0.0], [1.0, 0.0]),
    ],
    ids=["random walk", "Gauss-Markov", "second order", "oscillator", "bias"],
)
def test_the_transfer_function_is_that_of_the_card(block: ContinuousModel, num: list[float], den: list[float]) -> None:
    """G(s) of the card times √Q, the shaping filter for white noise of unit strength."""
    shape = shaping.transfer_function(block)
    assert close(shape[0], np.array(num) * np.sqrt(block.Q[0, 0]), EXACT)
    assert close(shape[1], den, EXACT)


@pytest.mark.parametrize(
    ("block", "spectrum"),
    [
        (shaping.gauss_markov(5.0, 0.7), lambda w: (2 * 5.0 / 0.7) / (w**2 + 1 / 0.7**2)),
        (
            shaping.second_order(2.0, 1.7, 0.3),
            lambda w: 4 * 0.3 * 1.7**3 * 2.0 / ((1.7**2 - w**2) ** 2 + 4 * 0.3**2 * 1.7**2 * w**2),
        ),
    ],
    ids=["Gauss-Markov", "second order"],
)
def test_the_spectrum_is_that_of_the_card(block: ContinuousModel, spectrum: Callable[[Array], Array]) -> None:
    """S(ω) equals the closed form, integrates to 2π times the variance, and is the transform of ψ."""
    assert close(shaping.psd(block, W), spectrum(W), EXACT)
    power, _ = scipy.integrate.quad(lambda w: float(shaping.psd(block, w)), 0, np.inf, epsrel=1e-10)
    assert close(power / np.pi, block.P0[0, 0], SOLVER)
    cosine, _ = scipy.integrate.quad(lambda t: float(shaping.autocorrelation(block, t)), 0, 60, weight="cos", wvar=1.3)
    assert close(2 * cosine, spectrum(np.array(1.3)), SOLVER)
    assert not close(shaping.psd(replace(block, Q=1.05 * block.Q), W), spectrum(W), 1e-2)


def test_lines_have_no_density() -> None:
    """Integrators and tones are infinite at their frequency; undriven ones are nowhere else."""
    assert shaping.psd(shaping.random_walk(4.0), [0.0, 2.0]).tolist() == [np.inf, 1.0]
    assert shaping.psd(shaping.bias(4.0), [0.0, 2.0]).tolist() == [np.inf, 0.0]
    assert shaping.psd(shaping.oscillator(4.0, 2.0), [-2.0, 0.0, 2.0]).tolist() == [np.inf, 0.0, np.inf]


@given(continuous_models(stable=True))
def test_the_spectrum_is_the_frequency_response_squared(model: ContinuousModel) -> None:
    """S(ω) = G(jω) Q G(jω)ᴴ with the frequency response by python-control."""
    response = control.ss(model.F, model.G, model.H, np.zeros((model.m, model.s)))(1j * W, squeeze=False)
    for output in range(model.m):
        row = response[output]
        assert close(shaping.psd(model, W, output), np.einsum("ak,ab,bk->k", row, model.Q, row.conj()).real, SOLVER)


@given(continuous_models(stable=True))
def test_a_stationary_process_keeps_its_covariance_over_any_interval(model: ContinuousModel) -> None:
    """P = ΦPΦᵀ + Qd for the exact discrete model, and 5 % more in one entry is not kept."""
    P = shaping.stationary_covariance(model)
    step = interval(model.F, model.G @ model.Q @ model.G.T, 0.7)
    assert close(step.Phi @ P @ step.Phi.T + step.Qd, P, SOLVER)
    if P.any():
        wrong = broken(P)
        assert not close(step.Phi @ wrong @ step.Phi.T + step.Qd, wrong, 1e-4)


def test_a_random_walk_grows_by_its_strength() -> None:
    """Var y(t) = P0 + Qt."""
    walk = discretise(shaping.random_walk(0.5, 2.0), 3.0, [[1.0]])
    assert close(walk.Phi @ walk.P0 @ walk.Phi.T + walk.Qd, [[2.0 + 0.5 * 3.0]], EXACT)


# Joint models


@pytest.mark.parametrize(("a", "T", "power"), [(1.0, 0.1, 5.0), (0.0, 2.0, 0.7)])
def test_lab_8_is_a_first_order_plant_driven_by_a_gauss_markov_process(a: float, T: float, power: float) -> None:
    """F=[[−a,1],[0,−1/T]], G=[0,1]ᵀ, Q=2σ²/T, at rest with y stationary."""
    plant = ContinuousModel([[-a]], [[1]], [[0]], [[1]], P0=[[0]], states=["x"], units=["m"])
    model = shaping.augment(plant, shaping.gauss_markov(power, T, name="y", unit="m/s"))
    assert close(model.F, [[-a, 1], [0, -1 / T]], EXACT)
    assert model.G.tolist() == [[0], [1]]
    assert close(model.Q, [[2 * power / T]], EXACT)
    assert model.H.tolist() == [[1, 0]]
    assert close(model.P0, np.diag([0, power]), EXACT)
    assert (model.states, model.units, model.Rc) == (("x", "y"), ("m", "m/s"), None)


def test_lab_15_is_a_signal_with_coloured_measurement_noise() -> None:
    """F=diag(−w0,−wn), H=[1,1], no white noise."""
    signal = ContinuousModel([[-1.0]], [[1]], [[2.0]], [[1]], P0=[[1.0]], states=["signal"])
    model = shaping.augment_measurement(signal, shaping.gauss_markov(0.25, 0.5, name="noise"))
    assert close(model.F, np.diag([-1.0, -2.0]), EXACT)
    assert close(model.Q, np.diag([2.0, 1.0]), EXACT)
    assert model.H.tolist() == [[1, 1]]
    assert model.Rc is None
    assert close(model.P0, np.diag([1.0, 0.25]), EXACT)


@given(continuous_models(stable=True, correlated=False, max_m=1))
def test_a_driven_plant_filters_the_spectrum_of_its_block(plant: ContinuousModel) -> None:
    """S_z = |G(jω)|²S_block plus what the untouched inputs contribute."""
    plant = replace(plant, Q=np.diag(np.diag(plant.Q)))
    block = shaping.second_order(2.0, 1.9, 0.3)
    for j in {0, plant.s - 1}:
        model = shaping.augment(plant, block, j)
        rest = replace(plant, Q=np.where(np.arange(plant.s) == j, 0.0, plant.Q))
        gain = control.ss(plant.F, plant.G[:, [j]], plant.H, 0)(1j * W)
        expected = np.abs(gain) ** 2 * shaping.psd(block, W) + shaping.psd(rest, W)
        assert close(shaping.psd(model, W), expected, SOLVER)
        wrong = replace(model, F=broken(model.F, (0, plant.n))) if model.F[0, plant.n] else None
        assert wrong is None or not close(shaping.psd(wrong, W), expected, SOLVER)


@given(continuous_models(stable=True))
def test_a_coloured_measurement_has_the_sum_of_the_spectra(plant: ContinuousModel) -> None:
    """S_z = S_Hx + S_block for the chosen measurement; the others, the inputs and the white noise stay as they were."""
    block = shaping.gauss_markov(2.0, 0.4)
    chosen = plant.m - 1
    model = shaping.augment_measurement(plant, block, chosen)
    for output in range(plant.m):
        added = shaping.psd(block, W) if output == chosen else 0.0
        assert close(shaping.psd(model, W, output), shaping.psd(plant, W, output) + added, SOLVER)
    assert plant.Rc is not None
    assert model.Rc is not None
    assert close(model.Rc, plant.Rc, EXACT)
    assert (model.B is None) == (plant.B is None)
    if plant.B is not None and model.B is not None:
        assert close(model.B, np.vstack([plant.B, np.zeros((1, plant.B.shape[1]))]), EXACT)
    if plant.N is not None and model.N is not None:
        assert close(model.N, np.vstack([plant.N, np.zeros((1, plant.m))]), EXACT)
    assert close(model.x0, [*plant.x0, 0.0], EXACT)


def test_untouched_inputs_keep_their_correlation_with_the_measurement() -> None:
    """N's rows of the remaining inputs, B and the names are carried over; a replaced input must not have any."""
    plant = ContinuousModel(
        np.diag([-1.0, -2.0]), np.eye(2), np.diag([3.0, 4.0]), [[1, 1]], Rc=[[2.0]], N=[[0.0], [0.5]], B=[[1], [0]],
        x0=[1, 2], P0=np.eye(2),
    )  # fmt: skip
    model = shaping.augment(plant, shaping.gauss_markov(1.0, 1.0), 0)
    assert model.N is not None
    assert model.B is not None
    assert model.N.tolist() == [[0.5], [0.0]]
    assert model.G.tolist() == [[0, 0], [1, 0], [0, 1]]
    assert model.Q.tolist() == [[4, 0], [0, 2]]
    assert model.B.tolist() == [[1], [0], [0]]
    with pytest.raises(ValueError, match=r"N: expected 0 in the rows of the replaced noise inputs \[1\], received"):
        shaping.augment(plant, shaping.gauss_markov(1.0, 1.0), 1)
    with pytest.raises(ValueError, match=r"Q: expected no correlation between the replaced noise inputs \[0\]"):
        shaping.augment(replace(plant, N=None, Q=[[1, 0.5], [0.5, 1]]), shaping.gauss_markov(1.0, 1.0), 0)


def test_a_block_with_a_white_part_brings_it_along() -> None:
    """A block's own Rc and N become a noise input of the plant, or add to the plant's Rc and N."""
    block = replace(shaping.gauss_markov(1.0, 0.5), Rc=[[0.3]], N=[[0.2]])
    plant = ContinuousModel([[-1]], [[1]], [[9]], [[1]], Rc=[[2.0]], P0=[[1]])
    driven = shaping.augment(plant, block)
    assert driven.G.tolist() == [[1, 0], [0, 1]]
    assert close(driven.Q, [[0.3, 0.2], [0.2, 4.0]], EXACT)
    gain = control.tf([1], [1, 1])(1j * W)
    own = control.tf([1], [1, 2])(1j * W)
    joint = 4.0 * np.abs(own) ** 2 + 0.3 + 2 * 0.2 * own.real
    assert close(shaping.psd(driven, W), np.abs(gain) ** 2 * joint, SOLVER)
    measured = shaping.augment_measurement(plant, block)
    assert measured.Rc is not None
    assert measured.N is not None
    assert close(measured.Rc, [[2.3]], EXACT)
    assert measured.N.tolist() == [[0.0], [0.2]]
    assert shaping.augment_measurement(replace(plant, Rc=None), block).Rc == pytest.approx(0.3)


def test_several_outputs_drive_several_inputs_in_the_order_given() -> None:
    """Output i of the block goes into the i-th index; blocks of one kind get names of their own."""
    plant = ContinuousModel(-np.eye(2), np.eye(2), np.eye(2), np.eye(2), P0=np.eye(2))
    two = ContinuousModel(np.diag([-3.0, -4.0]), np.eye(2), np.eye(2), [[1, 0], [0, 2]], P0=np.eye(2))
    model = shaping.augment(plant, two, [1, 0])
    assert model.F[:2, 2:].tolist() == [[0, 2], [1, 0]]
    assert model.states == ("x1", "x2", "x1_2", "x2_2")
    assert shaping.augment_measurement(plant, two, [1, 0]).H[:, 2:].tolist() == [[0, 2], [1, 0]]
    thrice = shaping.augment_measurement(plant, shaping.bias(1.0), 0)
    thrice = shaping.augment_measurement(thrice, shaping.bias(1.0), 1)
    assert thrice.states[2:] == ("bias", "bias_2")


def test_a_block_with_a_known_input_adds_it_to_the_plants() -> None:
    """The inputs of the joint model are (u, u_b)."""
    plant = ContinuousModel([[-1]], [[1]], [[1]], [[1]], B=[[2]], P0=[[1]])
    block = replace(shaping.gauss_markov(1.0, 1.0), B=[[3]])
    model = shaping.augment(plant, block)
    assert model.B is not None
    assert model.B.tolist() == [[2, 0], [0, 3]]


# Refusals


@pytest.mark.parametrize("into", [1, -1, [0, 0], True, 0.0 + 0.5j, [0, 1]])
def test_an_index_that_does_not_exist_is_refused(into: Any) -> None:
    """Indices out of range, repeated, too many or not whole are refused by augment and augment_measurement."""
    plant = ContinuousModel([[-1]], [[1]], [[1]], [[1]], P0=[[1]])
    for verb in (shaping.augment, shaping.augment_measurement):
        with pytest.raises((ValueError, TypeError), match="into: expected"):
            verb(plant, shaping.gauss_markov(1.0, 1.0), into)


def test_as_many_indices_as_outputs() -> None:
    """One output does not silently drive two inputs."""
    plant = ContinuousModel([[-1]], [[1, 2]], np.eye(2), [[1]], P0=[[1]])
    with pytest.raises(ValueError, match="into: expected one index for each of the block's 1 outputs"):
        shaping.augment(plant, shaping.gauss_markov(1.0, 1.0), [0, 1])


def test_a_process_without_stationary_state_is_refused_by_its_mode() -> None:
    """The unstable or wandering mode and its states are in the message."""
    unstable = ContinuousModel(np.diag([-1.0, 0.2]), np.eye(2), np.eye(2), [[1, 1]], P0=np.eye(2), states=["a", "b"])
    with pytest.raises(ValueError, match=r"received the mode 0\.2 of the states b: the process is not stationary"):
        shaping.stationary_covariance(unstable)
    with pytest.raises(ValueError, match=r"received the mode 0\.2 of the states b: its process has no spectrum"):
        shaping.psd(unstable, 1.0)
    with pytest.raises(ValueError, match="received the mode 0 of the states walk"):
        shaping.autocorrelation(shaping.random_walk(1.0), 0.0)
    with pytest.raises(ValueError, match=r"received the mode .*3i of the states tone, tone_rate"):
        shaping.stationary_covariance(replace(shaping.oscillator(1.0, 3.0), P0=np.eye(2)))


def test_bad_numbers_are_refused() -> None:
    """Negative variances, times that are not positive and outputs that do not exist."""
    with pytest.raises(ValueError, match=r"variance: expected a number >= 0, received -1"):
        shaping.bias(-1.0)
    with pytest.raises(ValueError, match=r"tau: expected a number > 0, received 0"):
        shaping.gauss_markov(1.0, 0)
    with pytest.raises(ValueError, match=r"damping: expected a number > 0, received -0\.1"):
        shaping.second_order(1.0, 1.0, -0.1)
    with pytest.raises(ValueError, match="output: expected an index below 1, received 1"):
        shaping.psd(shaping.gauss_markov(1.0, 1.0), 0.0, output=1)
    two = ContinuousModel([[-1]], [[1, 2]], np.eye(2), [[1]], P0=[[1]])
    with pytest.raises(ValueError, match="block: expected one noise input, received 2"):
        shaping.transfer_function(two)
    with pytest.raises(TypeError, match="plant: expected a ContinuousModel, received a str"):
        shaping.augment("plant", two)  # type: ignore[arg-type]
