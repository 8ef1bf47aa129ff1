"""Discretisation: the semigroup, the Lyapunov equation, closed forms at any stiffness, and triangular factors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs.filtering import bucy, steady
from ctlabs.linalg.factors import factor, unit_triangular
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.models.discretisation import discretise, interval, to_continuous
from tests import cases
from tests.reference import EXACT, SOLVER, broken, close, deviation, order
from tests.strategies import continuous_models, covariance, seeds

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
properties = settings(deadline=None, max_examples=40, derandomize=True)

#: Stiff systems with L = |λ|dt on the fast mode and 1 or 0 on the slow one.
STIFF: dict[str, Any] = {
    "decay": lambda L: [[-L]],
    "fast and slow": lambda L: [[-L, 1], [0, -1]],
    "coupled both ways": lambda L: [[-L, 3], [2, -1]],
    "fast mode into an integrator": lambda L: [[0, 1], [0, -L]],
    "fast oscillation": lambda L: [[-L, L], [-L, -L - 0.5]],
    "fast mode and slow oscillation": lambda L: [[-L, 1, 0], [0, 0, 2], [0, -2, -0.1]],
}


def by_modes(F: Array, W: Array, h: float) -> tuple[Array, Array, Array]:
    """Phi, Qd and Gamma from the eigenvectors of F (which must exist) with 60 digits."""
    with mpmath.workdps(60):
        values, V = mpmath.eig(mpmath.matrix(F.tolist()))
        inverse, n = V**-1, len(values)
        C, h = inverse * mpmath.matrix(W.tolist()) * inverse.H, mpmath.mpf(h)

        def integral(rate: Any) -> Any:
            return mpmath.expm1(rate * h) / rate if abs(rate) > mpmath.mpf(10) ** -40 else h

        Phi = V * mpmath.diag([mpmath.exp(a * h) for a in values]) * inverse
        Gamma = V * mpmath.diag([integral(a) for a in values]) * inverse
        D = mpmath.matrix(n, n)
        for i in range(n):
            for j in range(n):
                D[i, j] = C[i, j] * integral(values[i] + mpmath.conj(values[j]))
        Qd = V * D * V.H

        def real(M: Any) -> Array:
            return np.array([[float(mpmath.re(M[i, j])) for j in range(n)] for i in range(n)])

        return real(Phi), real(Qd), real(Gamma)


def strength(model: ContinuousModel) -> Array:
    """GQGᵀ."""
    return model.G @ model.Q @ model.G.T


@properties
@given(continuous_models(stable=None))
def test_transition_over_twice_the_interval_is_its_square(model: ContinuousModel) -> None:
    """Φ(2h) = Φ(h)², and not after a change of 5 %."""
    once, twice = interval(model.F, strength(model), 0.3), interval(model.F, strength(model), 0.6)
    assert close(twice.Phi, once.Phi @ once.Phi, EXACT)
    assert not close(twice.Phi, broken(once.Phi) @ broken(once.Phi), 1e-3)


@properties
@given(continuous_models(stable=None, singular=False))
def test_noise_of_two_intervals_adds_up(model: ContinuousModel) -> None:
    """Qd(2h) = Qd(h) + ΦQd(h)Φᵀ, and not after a change of 5 %."""
    once, twice = interval(model.F, strength(model), 0.3), interval(model.F, strength(model), 0.6)
    assert close(twice.Qd, once.Qd + once.Phi @ once.Qd @ once.Phi.T, EXACT)
    Qd = broken(once.Qd)
    assert not close(twice.Qd, Qd + once.Phi @ Qd @ once.Phi.T, 1e-3)


@properties
@given(continuous_models(stable=None))
def test_inputs_of_two_intervals_add_up(model: ContinuousModel) -> None:
    """Γ(2h) = Γ(h) + ΦΓ(h) and FΓ = Φ − I."""
    once, twice = interval(model.F, strength(model), 0.3), interval(model.F, strength(model), 0.6)
    assert close(twice.Gamma, once.Gamma + once.Phi @ once.Gamma, EXACT)
    assert close(model.F @ once.Gamma + np.eye(model.n), once.Phi, EXACT)
    assert not close(model.F @ broken(once.Gamma) + np.eye(model.n), once.Phi, EXACT)


@properties
@given(continuous_models(stable=True, singular=False))
def test_noise_of_a_hurwitz_model_is_what_the_stationary_covariance_loses(model: ContinuousModel) -> None:
    """Qd = P∞ − ΦP∞Φᵀ where FP∞ + P∞Fᵀ + GQGᵀ = 0, and not with P∞ changed by 5 %."""
    P = scipy.linalg.solve_continuous_lyapunov(model.F, -strength(model))
    Phi, Qd, _ = interval(model.F, strength(model), 0.7)
    assert close(Qd, P - Phi @ P @ Phi.T, SOLVER)
    assert not close(Qd, broken(P) - Phi @ broken(P) @ Phi.T, 1e-4)


@properties
@given(continuous_models(stable=None))
def test_interval_is_the_integral_it_is_defined_by(model: ContinuousModel) -> None:
    """Φ by scipy's exponential, Qd and Γ by adaptive quadrature."""
    W = strength(model)
    expected, _ = scipy.integrate.quad_vec(
        lambda s: np.stack([(E := scipy.linalg.expm(model.F * s)) @ W @ E.T, E]), 0.0, 0.8, epsrel=1e-12
    )
    found = interval(model.F, W, 0.8)
    assert close(found.Phi, scipy.linalg.expm(model.F * 0.8), EXACT)
    assert close(found.Qd, expected[0], SOLVER)
    assert close(found.Gamma, expected[1], SOLVER)


@pytest.mark.parametrize("L", [1.5, 50.0, 1e3, 1e4, 1e6])
@pytest.mark.parametrize("make", STIFF.values(), ids=STIFF)
def test_stiffness_costs_no_digit(make: Any, L: float) -> None:
    """Φ, Qd and Γ agree with 60-digit modal formulas whatever |λ|dt is: neither fast nor slow modes lose accuracy."""
    F = np.array(make(L), dtype=float)
    W = np.eye(len(F)) + 0.2
    for found, expected in zip(interval(F, W, 1.0), by_modes(F, W, 1.0), strict=True):
        assert close(found, expected, 1e-13)
        # Next to nothing is left of a matrix whose every mode has decayed; 5 % of it is noticed all the same.
        assert not expected.any() or not close(broken(found), expected, 1e-2)


@pytest.mark.parametrize("L", [50.0, 1e3])
def test_every_element_of_a_stiff_decay_is_right(L: float) -> None:
    """For a scalar, Qd = W(1 − e^{−2λh})/2λ and Φ = e^{−λh}, however small."""
    Phi, Qd, Gamma = interval([[-L]], [[4.0]], 0.5)
    assert close(Phi, np.exp(-L / 2), EXACT)
    assert close(Qd, -2 * np.expm1(-L) / L, EXACT)
    assert close(Gamma, -np.expm1(-L / 2) / L, EXACT)


@pytest.mark.parametrize("tau", [1e-3, 0.5, 20.0])
def test_chain_of_integrators_has_the_closed_form(tau: float) -> None:
    """Noise through three integrators: Φ of powers of τ, Qd[i, j] = q τ^(a+b+1)/(a! b! (a+b+1)) (no eigenvectors here)."""
    q = 2.5
    F, a = np.diag([1.0, 1.0], 1), np.array([2, 1, 0])
    factorial = np.array([2.0, 1.0, 1.0])
    powers = a[:, None] + a + 1
    Qd = q * tau**powers / (factorial[:, None] * factorial * powers)
    found = interval(F, np.diag([0.0, 0.0, q]), tau)
    np.testing.assert_allclose(found.Qd, Qd, rtol=EXACT)
    np.testing.assert_allclose(found.Phi, [[1, tau, tau**2 / 2], [0, 1, tau], [0, 0, 1]], rtol=EXACT)
    np.testing.assert_allclose(
        found.Gamma, [[tau, tau**2 / 2, tau**3 / 6], [0, tau, tau**2 / 2], [0, 0, tau]], rtol=EXACT
    )


@pytest.mark.parametrize("scale", [1e-30, 1e10, 1e30, 1e100])
def test_noise_is_linear_in_its_strength(scale: float) -> None:
    """Qd(cW) = c Qd(W) for any unit of the noise, and Φ, Γ do not notice."""
    F, W = np.array([[-0.3, 1], [-2, -0.5]]), np.array([[1, 0.5], [0.5, 2]])
    one, scaled = interval(F, W, 1.0), interval(F, scale * W, 1.0)
    assert close(scaled.Qd / scale, one.Qd, EXACT)
    assert close(scaled.Phi, one.Phi, EXACT)
    assert close(scaled.Gamma, one.Gamma, EXACT)


def test_no_dynamics_is_the_identity() -> None:
    """F = 0: Φ = I, Qd = W h, Γ = I h; and an unlit direction stays unlit."""
    W = np.diag([2.0, 0.0])
    Phi, Qd, Gamma = interval(np.zeros((2, 2)), W, 3.0)
    assert np.array_equal(Phi, np.eye(2))
    assert close(Qd, 3 * W, EXACT)
    assert close(Gamma, 3 * np.eye(2), EXACT)
    assert Qd[1, 1] == 0


@properties
@given(continuous_models(stable=None, correlated=False, driven=False))
def test_discretised_model_keeps_what_time_does_not_touch(model: ContinuousModel) -> None:
    """H, x0, P0 and the names pass through; R = Rc/dt; Qd does not depend on how W is split into G and Q."""
    named = replace(model, states=[f"s{i}" for i in range(model.n)], units=["m"] * model.n)
    d = discretise(named, 0.25)
    assert isinstance(d, DiscreteModel)
    for field in ("H", "x0", "P0"):
        assert np.array_equal(getattr(d, field), getattr(model, field))
    assert (d.states, d.units, d.measurements) == (named.states, named.units, named.measurements)
    assert d.dt == 0.25
    assert close(d.R, model.Rc * 4, EXACT)
    split = discretise(replace(model, G=np.eye(model.n), Q=strength(model)), 0.25)
    assert close(split.Qd, d.Qd, EXACT)


def test_a_given_covariance_replaces_that_of_the_strength() -> None:
    """R is the covariance of the samples, with ∞ for absent ones and a value per step, whatever Rc says."""
    model = ContinuousModel(F=[[-1]], G=[[1]], Q=[[2]], H=[[1]], Rc=[[16]], P0=[[1]])
    assert discretise(model, 0.5, R=[[3]]).R == 3
    varying = discretise(model, 0.5, R=[[[3]], [[np.inf]], [[0]]])
    assert varying.R.ravel().tolist() == [3, np.inf, 0]
    assert varying.horizon == 2


@properties
@given(continuous_models(correlated=True))
def test_cross_covariance_of_equivalent_noise_is_its_integral(model: ContinuousModel) -> None:
    """N_d = E[∫e^{F(dt−s)}Gw ds · (1/dt)∫vᵀ ds] = (1/dt)∫e^{F(dt−s)}GN ds."""
    dt = 0.4
    expected, _ = scipy.integrate.quad_vec(
        lambda s: scipy.linalg.expm(model.F * (dt - s)) @ model.G @ model.N / dt, 0, dt
    )
    found = discretise(model, dt)
    assert close(found.N, expected, SOLVER)
    assert not close(broken(found.N), expected, 1e-3)


@properties
@given(continuous_models(stable=None, driven=True), seeds)
def test_known_input_moves_the_state_as_the_differential_equation_does(model: ContinuousModel, seed: int) -> None:
    """x(dt) = Φx(0) + c for ẋ = Fx + Bu integrated by Runge–Kutta, for each u of a sequence."""
    rng = np.random.default_rng(seed)
    u, x = rng.normal(size=(2, model.B.shape[1])), rng.normal(size=model.n)
    d = discretise(model, 0.6, u=u)
    assert d.offset.shape == (2, model.n)
    for k in range(2):
        path = scipy.integrate.solve_ivp(
            lambda t, y, k=k: model.F @ y + model.B @ u[k], (0, 0.6), x, rtol=1e-11, atol=1e-12, method="DOP853"
        )
        assert close(d.Phi @ x + d.offset[k], path.y[:, -1], SOLVER)
        assert not close(d.Phi @ x + 1.05 * d.offset[k], path.y[:, -1], SOLVER)
    assert close(discretise(model, 0.6, u=u[0]).offset, d.offset[0], EXACT)


def refused(what: str, call: Any, error: type[Exception] = ValueError) -> None:
    with pytest.raises(error, match=what):
        call()


def test_what_cannot_be_discretised_is_refused() -> None:
    """A wrong type, shape, period or combination is named, with what was expected and received."""
    model = ContinuousModel(F=[[-1]], G=[[1]], Q=[[2]], H=[[1]], P0=[[1]])
    with_N = replace(model, Rc=[[4]], N=[[1]])
    discrete = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
    refused(
        r"^model: expected a ContinuousModel, received a DiscreteModel$", lambda: discretise(discrete, 1), TypeError
    )
    refused(r"^R: expected the covariance of the sampled measurements .*received None$", lambda: discretise(model, 1))
    refused(r"^R: expected none beside the model's N", lambda: discretise(with_N, 1, R=[[1]]))
    refused(r"^u: expected a model with B, received one without$", lambda: discretise(with_N, 1, u=[1]))
    refused(
        r"^u: expected shape \(1,\) or \(steps, 1\), received \(2,\)$",
        lambda: discretise(replace(with_N, B=[[1]]), 1, u=[1, 2]),
    )
    for dt in (0, -1, np.inf, np.nan, True, "1"):
        refused(r"^dt: expected a number > 0, received", lambda dt=dt: discretise(with_N, dt))
    two = replace(model, H=[[1], [2]], measurements=None)
    refused(r"^R: expected a symmetric matrix", lambda: discretise(two, 1, R=[[1, 0.5], [0, 1]]))
    refused(r"^F: expected shape \(n, n\), received \(2,\)$", lambda: interval([1, 2], [[1]], 1))


def test_growth_beyond_double_precision_is_refused() -> None:
    """e^{1000} has no double: the interval is refused instead of returning infinities."""
    message = r"^dt: expected an interval over which .* double precision, received 1000 s$"
    refused(message, lambda: interval([[1]], [[1]], 1000))


# --- averages ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", cases.numerics("k6_average_*"))
def test_averages_of_a_continuous_measurement(case: cases.Case) -> None:
    """H, R, N and the error that averages leave, between samples with R = Rc/dt that claim too much or too little."""
    right, dt = case["right"], case["given"]["dt"]
    model = discretise(cases.model(case["model"]), dt, average=True)
    for name in ("H", "R", "N"):
        cases.near(getattr(model, name), right[name], case["tolerance"][name])
    for name in ("Phi", "Qd"):
        cases.near(getattr(model, name), right[name], "relative 1e-12")
    cases.near(steady.solve(model).P_minus, right["P_minus"], case["tolerance"]["P_minus"])
    sampled = discretise(cases.model(case["model"]), dt)
    cases.near(sampled.R, case["given"]["sampled_approximation"]["R"], "relative 1e-12")
    cases.near(steady.solve(sampled).P_minus, case["given"]["sampled_approximation"]["P_minus"], "sigma 1e-9")


@properties
@given(continuous_models(stable=None, singular=False))
def test_averages_are_the_integrals_they_are_defined_by(model: ContinuousModel) -> None:
    """With K(s) = H∫e^{Fr}dr over s: H = K(dt)/dt, and R, N from the noise that a time s is left to act on z, by quadrature."""
    dt, W = 0.7, strength(model)
    GN = np.zeros((model.n, model.m)) if model.N is None else model.G @ model.N

    def rates(s: float) -> Array:
        Phi, _, Gamma = interval(model.F, W, s) if s > 0 else (np.eye(model.n), W, np.zeros_like(W))
        K = model.H @ Gamma
        R = K @ W @ K.T + K @ GN + (K @ GN).T + model.Rc
        return np.concatenate([R.ravel(), (Phi @ (W @ K.T + GN)).ravel()])

    total, _ = scipy.integrate.quad_vec(rates, 0.0, dt, epsrel=1e-12)
    R, N = total[: model.m**2].reshape(model.m, model.m) / dt**2, total[model.m**2 :].reshape(GN.shape) / dt
    found = discretise(model, dt, average=True)
    for value, expected in ((found.H, model.H @ interval(model.F, W, dt).Gamma / dt), (found.R, R), (found.N, N)):
        assert close(value, expected, SOLVER)
        assert not expected.any() or not close(broken(value), expected, 1e-3)
    assert close(found.Qd, discretise(model, dt, R=np.eye(model.m)).Qd if model.N is None else found.Qd, EXACT)
    assert (found.states, found.measurements, found.dt) == (model.states, model.measurements, dt)


@pytest.mark.parametrize("N", [None, [[0.3]]])
def test_the_filter_of_short_averages_is_the_continuous_one(N: Any) -> None:
    """P⁻ of averages tends to the Kalman–Bucy limit like dt², that of samples with R = Rc/dt like dt."""
    model = ContinuousModel([[0, 1], [-4, -0.4]], [[0], [1]], [[2]], [[1, 0]], Rc=[[0.5]], P0=np.eye(2), N=N)
    limit = bucy.steady(model).P
    periods = (0.04, 0.02, 0.01)
    averaged, sampled = (
        [np.abs(steady.solve(discretise(model, dt, average=kind)).P_minus - limit).max() for dt in periods]
        for kind in (True, False)
    )
    assert np.allclose(order(averaged), 2, atol=0.2)
    assert np.allclose(order(sampled), 1, atol=0.2)


def test_shorter_averages_tell_more() -> None:
    """P⁻ given the averages over dt is never below that given those over dt/2, which include them; nor below the limit."""
    model = ContinuousModel([[0, 1], [-4, -0.4]], [[0], [1]], [[2]], [[1, 0]], Rc=[[0.5]], P0=np.eye(2))
    found = [steady.solve(discretise(model, dt, average=True)).P_minus for dt in (4.0, 2.0, 1.0, 0.5, 0.25)]
    for longer, shorter in zip(found, [*found[1:], bucy.steady(model).P], strict=True):
        assert np.linalg.eigvalsh(longer - shorter).min() > -EXACT


# --- the way back --------------------------------------------------------------------------------------------------------


def sampled(case: cases.Case) -> DiscreteModel:
    """The discrete model of a case that gives Φ, Qd, R and dt alone."""
    given, n = case["given"], len(case["given"]["Phi"])
    return DiscreteModel(
        given["Phi"], given["Qd"], np.eye(1, n), given["R"], x0=np.zeros(n), P0=np.eye(n), dt=given["dt"]
    )


@pytest.mark.parametrize("case", cases.numerics("k6_back_*"))
def test_the_way_back(case: cases.Case) -> None:
    """F, GQGᵀ and Rc of what was sampled, or the reason why nothing was."""
    model, right = sampled(case), case["right"]
    if right.get("refused"):
        with pytest.raises(ValueError, match=".*".join(right["says"])):
            to_continuous(model)
        return
    found = to_continuous(model)
    W, sd = np.array(right["GQG"]), np.sqrt(np.diag(right["GQG"]))
    unit = np.where(np.outer(sd, sd) > 0, np.outer(sd, sd), W.max())
    assert close(found.F, right["F"], 1e-9)
    assert (np.abs(strength(found) - W) <= 1e-8 * unit).all()
    assert close(found.Rc, right["Rc"], EXACT)


@properties
@given(continuous_models(stable=None, correlated=False, driven=False))
def test_there_and_back(model: ContinuousModel) -> None:
    """F and GQGᵀ come back, whatever the rank of Q, where no mode turns by half a turn in the period."""
    dt = min(0.3, 2.5 / np.abs(np.linalg.eigvals(model.F)).max())
    found = to_continuous(discretise(model, dt))
    assert close(found.F, model.F, SOLVER)
    assert close(strength(found), strength(model), SOLVER)
    assert close(found.Rc, model.Rc, EXACT)
    assert np.array_equal(found.H, model.H)
    assert found.states == model.states


@pytest.mark.parametrize("n", [2, 5, 8, 12])
@pytest.mark.parametrize("dt", [1e-3, 1.0, 100.0])
def test_integrators_come_back(n: int, dt: float) -> None:
    """A chain of integrators at any period, in another order of its states: what is zero stays zero, and no strength appears."""
    order = np.random.default_rng(n).permutation(n)
    F, W = np.eye(n, k=1)[order][:, order], np.diag(np.eye(n)[-1])[order][:, order]
    Phi, Qd, _ = interval(F, W, dt)
    found = to_continuous(DiscreteModel(Phi, Qd, np.eye(1, n), [[1]], x0=np.zeros(n), P0=np.eye(n), dt=dt))
    unit = dt ** -order.astype(float)  # in which the elements of F dt are 1
    assert (np.abs(found.F - F) * dt * unit / unit[:, None] <= 1e-12).all()
    assert close(found.Q, W, 1e-12)
    assert np.count_nonzero(found.Q) == 1


def test_weak_strengths_come_back_beside_strong_ones() -> None:
    """Velocity, tilt and gyro bias of an inertial channel, strengths 2.8e-6, 8.5e-12 and 1e-18, from samples at 100 Hz."""
    F, W = np.array([[0, 9.81, 0], [-1.57e-7, 0, 1], [0, 0, 0]]), np.diag([2.8e-6, 8.5e-12, 1e-18])
    Phi, Qd, _ = interval(F, W, 0.01)
    found = to_continuous(DiscreteModel(Phi, Qd, np.eye(1, 3), [[1]], x0=np.zeros(3), P0=np.eye(3), dt=0.01))
    np.testing.assert_allclose(np.diag(found.Q), np.diag(W), rtol=1e-9)


def test_a_mode_beyond_the_nyquist_frequency_comes_back_as_its_alias() -> None:
    """An oscillation of 4 rad per period is one of 2π − 4 backwards: another F with the same samples."""
    fast = ContinuousModel([[0, 4], [-4, 0]], np.eye(2), np.eye(2), [[1, 0]], Rc=[[1]], P0=np.eye(2))
    found = to_continuous(discretise(fast, 1.0))
    assert close(found.F, [[0, 4 - 2 * np.pi], [2 * np.pi - 4, 0]], SOLVER)
    again = discretise(found, 1.0)
    assert close(again.Phi, discretise(fast, 1.0).Phi, SOLVER)
    assert close(again.Qd, discretise(fast, 1.0).Qd, SOLVER)


def test_what_has_no_continuous_model_is_refused() -> None:
    """Each reason by its name: what varies, what is not known apart, what no differential equation does."""
    start: dict[str, Any] = {"x0": [0, 0], "P0": np.eye(2)}
    walk = DiscreteModel(np.eye(2), np.eye(2), [[1, 0]], [[1]], **start)

    def back(**changes: Any) -> Any:
        return lambda: to_continuous(replace(walk, **changes))

    refused("^model: expected a DiscreteModel, received", lambda: to_continuous("walk"), TypeError)  # type: ignore[arg-type]
    refused("^model: expected constant matrices, received some that vary over 3 steps", back(Qd=[np.eye(2)] * 3))
    refused("^N: expected none", back(N=[[0.5], [0]]))
    refused("^offset: expected none", back(offset=[0, 1]))
    refused("^R: expected finite variances", back(R=[[np.inf]]))
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    for Phi in (np.diag([1.0, 0.0]), [[1, 2], [2, 4]], [[0.1, 0.2], [0.3, 0.6]], turn @ np.diag([1.0, 0.0]) @ turn.T):
        refused("^Phi: .* singular", back(Phi=Phi))
    for Phi in (np.diag([1.0, -0.25]), -np.eye(2), [[-0.5, 1], [0, -0.5]], turn @ [[-0.5, 1], [0, -0.5]] @ turn.T):
        refused("^Phi: expected no negative eigenvalue .* received the eigenvalue -", back(Phi=Phi))
    refused("^Qd: .* needs a strength with eigenvalue -", back(Phi=[[1, 1], [0, 1]], Qd=[[0.25, 0.5], [0.5, 1]]))
    refused("^Qd: .* needs a strength with eigenvalue -", back(Phi=[[1, 1], [0, 1]], Qd=[[0.333, 0.5], [0.5, 1]]))
    assert to_continuous(replace(walk, N=[[0], [0]], offset=[0, 0])).Q.tolist() == np.eye(2).tolist()


def test_what_cannot_be_averaged_is_refused() -> None:
    """No Rc, an R of its own, a known input."""
    model = ContinuousModel([[-1]], [[1]], [[2]], [[1]], P0=[[1]], Rc=[[3]], B=[[1]])
    refused("^average: expected a model with Rc", lambda: discretise(replace(model, Rc=None), 1, average=True))
    refused("^R: expected none with average=True", lambda: discretise(model, 1, R=[[1]], average=True))
    refused("^u: expected none with average=True", lambda: discretise(model, 1, u=[1], average=True))
    assert discretise(replace(model, Rc=[[0]]), 1, average=True).R[0, 0] > 0


# --- factors -------------------------------------------------------------------------------------------------------------


@properties
@given(seeds)
def test_triangular_factors_reproduce_covariances_of_any_rank(seed: int) -> None:
    """Q = L diag(d) Lᵀ = ḠḠᵀ, L unit lower triangular, Ḡ lower triangular, d ≥ 0; a changed factor does not."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    rank = int(rng.integers(1, n + 1))
    Q = covariance(rng, n, rank)
    L, d = unit_triangular(Q)
    G = factor(Q)
    assert np.array_equal(np.triu(L), np.eye(n))
    assert np.array_equal(np.triu(G, 1), np.zeros((n, n)))
    assert (d >= 0).all()
    assert np.count_nonzero(d > 1e-9 * np.diag(Q)) == rank
    assert close(L * d @ L.T, Q, EXACT)
    assert close(G @ G.T, Q, EXACT)
    assert not close(L * broken(d) @ L.T, Q, 1e-4)
    assert not close(broken(G) @ G.T, Q, 1e-4)


@properties
@given(seeds)
def test_factor_of_a_definite_covariance_is_choleskys(seed: int) -> None:
    """Ḡ has a nonnegative diagonal, so it is the Cholesky factor where there is one."""
    rng = np.random.default_rng(seed)
    Q = covariance(rng, int(rng.integers(1, 6)))
    assert close(factor(Q), np.linalg.cholesky(Q), EXACT)


def test_a_direction_without_noise_has_a_unit_column() -> None:
    """d = 0 and L's column is that of I; Q = 0 gives L = I, d = 0, Ḡ = 0; units far apart do not look singular."""
    L, d = unit_triangular([[0.0, 0.0, 0.0], [0.0, 4.0, 2.0], [0.0, 2.0, 1.0]])
    assert L.tolist() == [[1, 0, 0], [0, 1, 0], [0, 0.5, 1]]
    assert d.tolist() == [0, 4, 0]
    L, d = unit_triangular(np.zeros((2, 2)))
    assert L.tolist() == np.eye(2).tolist()
    assert not d.any()
    assert not factor(np.zeros((2, 2))).any()
    assert unit_triangular(np.diag([1e12, 1e-12]))[1].tolist() == [1e12, 1e-12]


@pytest.mark.parametrize("tau", [0.1, 1.0, 7.0])
def test_factors_of_integrated_noise_are_those_of_labs_3_and_4(tau: float) -> None:
    """Double and triple integrators: L = G_d and d = Q̄_d by hand."""
    two = interval([[0, 1], [0, 0]], np.diag([0, 1.0]), tau).Qd
    L, d = unit_triangular(two)
    assert close(L, [[1, 0], [3 / (2 * tau), 1]], EXACT)
    assert close(d, [tau**3 / 3, tau / 4], EXACT)
    assert close(factor(two), [[np.sqrt(tau**3 / 3), 0], [np.sqrt(3 * tau / 4), np.sqrt(tau) / 2]], EXACT)
    L, d = unit_triangular(interval(np.diag([1.0, 1.0], 1), np.diag([0, 0, 1.0]), tau).Qd)
    assert close(L, [[1, 0, 0], [5 / (2 * tau), 1, 0], [10 / (3 * tau**2), 4 / tau, 1]], EXACT)
    assert close(d, [tau**5 / 20, tau**3 / 48, tau / 9], EXACT)


def test_what_is_no_covariance_has_no_factors() -> None:
    """Asymmetric and indefinite matrices are refused, and a nonsquare one."""
    refused(
        r"^Q: expected a symmetric matrix, received one with asymmetry 1$", lambda: unit_triangular([[1, 1], [0, 1]])
    )
    refused(r"^Q: expected a nonnegative definite matrix", lambda: factor([[1, 2], [2, 1]]))
    refused(r"^Q: expected variances >= 0 on the diagonal, received -1$", lambda: factor([[-1]]))
    refused(r"^Q: expected a square matrix, received \(1, 2\)$", lambda: factor([[1, 2]]))


def test_van_loans_single_exponential_would_not_do() -> None:
    """At |λ|dt = 50 the block exponential that the library avoids is wrong by many orders of magnitude."""
    F, W = np.array([[-50.0, 3.0], [2.0, -1.0]]), np.eye(2)
    block = scipy.linalg.expm(np.block([[-F, W], [np.zeros((2, 2)), F.T]]))
    single = block[2:, 2:].T @ block[:2, 2:]
    expected = by_modes(F, W, 1.0)[1]
    assert deviation(single, expected) > 0.5
    assert close(interval(F, W, 1.0).Qd, expected, 1e-14)


def test_the_way_back_of_very_many_states_is_refused() -> None:
    """n² equations at once would take all memory: the limit is said."""
    many = DiscreteModel(0.5 * np.eye(31), np.eye(31), np.eye(1, 31), [[1]], P0=np.eye(31))
    with pytest.raises(ValueError, match=r"model: expected at most 30 states .*, received 31"):
        to_continuous(many)
