"""Numerical forms of the filter: the driver, the arithmetic they share, their cost, and all side by side."""

import dataclasses

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import compare, comparison, covariances, flops, kalman_filter, steady
from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.algorithms.contract import Counted, Noise, doubles, numbers
from ctlabs.filtering.engines import driver
from ctlabs.filtering.problem import pose
from ctlabs.models import DiscreteModel
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import covariance, discrete_models, record, seeds

pytestmark = pytest.mark.numerical

WALK = DiscreteModel(
    [[1, 1], [0, 1]], [[0.25, 0.5], [0.5, 1.0]], [[1, 0]], [[2]], x0=[0, 1], P0=[[4, 1], [1, 3]], offset=[0.1, 0.0]
)
Z = [[np.nan], [1.0], [2.5], [np.nan], [4.0], [5.5]]
#: Of one and the same filter: ``steady`` differs by method, not by rounding.
OPTIMAL = [name for name in FORMS if name != "steady"]
#: Those that need P0 and R with an inverse.
INFORMATION = ["information", "srif"]
#: Those that take perfect measurements.
PERFECT = [name for name in OPTIMAL if name not in [*INFORMATION, "extended_array"]]
KINDS = [float, mpmath.mpf, Counted]


# The driver -----------------------------------------------------------------------------------------------------------


def test_the_forms_agree_with_filterpy_and_with_sixty_digits():
    """With gaps and a known input; the reference is that of the tests' own multiprecision recursion."""
    wanted, high = kalman_filter(WALK, Z[1:], algorithm="filterpy"), reference.high_precision(WALK, Z)
    own = comparison.reference(WALK, Z[1:])
    for found, expected in zip((own.x_minus, own.P_minus, own.x_plus, own.P_plus), high, strict=True):
        assert close(found, expected, EXACT)
    for form in OPTIMAL:
        found = kalman_filter(WALK, Z[1:], algorithm=form)
        assert close(found.P_plus, wanted.P_plus, EXACT), form
        assert close(found.x_plus, wanted.x_plus, EXACT), form
        assert not close(
            found.P_plus, kalman_filter(dataclasses.replace(WALK, Qd=broken(WALK.Qd, (1, 1))), Z[1:], algorithm=form).P_plus, SOLVER
        )


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    model=discrete_models(), seed=st.integers(0, 10**6), gaps=st.sampled_from([0.0, 0.3]), first=st.sampled_from([0, 1])
)
def test_the_driver_takes_whatever_a_model_may_be(model, seed, gaps, first):
    """Full R, N, known inputs, matrices that vary, gaps: the moments and the likelihood of the joint distribution."""
    z = record(model, 5, np.random.default_rng(seed), gaps, first)
    if model.horizon is not None:
        z = np.vstack([z, np.full((model.horizon + 1 - len(z), model.m), np.nan)])
    wanted, found = reference.conditioned(model, z, first), kalman_filter(model, z[first:], first=first, algorithm="sequential")
    size = max(np.abs(model.Qd).max(), np.abs(model.P0).max(), np.abs(wanted.x_minus).max())
    for own, expected in zip((found.x_minus, found.P_minus, found.x_plus, found.P_plus), wanted, strict=True):
        assert close(own, expected, SOLVER, size)
    assert close(found.log_likelihood, reference.log_likelihood(model, z, first), SOLVER)
    plain = kalman_filter(model, z[first:], first=first, algorithm="filterpy")
    assert close(found.innovation, plain.innovation, SOLVER, size)
    assert close(found.S, plain.S, SOLVER)
    assert np.array_equal(found.used, plain.used)
    assert np.array_equal(np.isnan(found.nis), ~found.used.any(axis=1))


@settings(deadline=None, max_examples=15, derandomize=True)
@given(model=discrete_models(correlated=True), seed=st.integers(0, 10**6))
def test_the_reference_is_that_of_sixty_digits(model, seed):
    """Correlated noises too: two different recursions in high precision give the same doubles."""
    z = record(model, 5, np.random.default_rng(seed), 0.2)
    own, high = comparison.reference(model, z[1:]), reference.high_precision(model, z)
    size = max(np.abs(model.Qd).max(), np.abs(model.P0).max())
    assert close(own.P_plus, high.P_plus, EXACT, size)
    assert close(own.x_plus, high.x_plus, EXACT, np.abs(high.x_minus).max())


@pytest.mark.parametrize("form", FORMS)
def test_many_records_at_once_are_one_after_another(form):
    """The runs are the last axis of data, estimates, innovations and likelihoods."""
    z = np.array([[np.nan], [1.0], [2.5], [3.0], [4.0]])[:, :, None] * np.array([1.0, -2.0, 0.5])
    found = kalman_filter(WALK, z[1:], algorithm=form)
    assert found.x_plus.shape == (5, 2, 3)
    assert found.innovation.shape == (5, 1, 3)
    assert found.nis.shape == (5, 3)
    assert found.log_likelihood.shape == (3,)
    for i in range(3):
        one = kalman_filter(WALK, z[1:, :, i], algorithm=form)
        assert isinstance(one.log_likelihood, float)
        for name in ("x_minus", "x_plus", "innovation", "nis", "log_likelihood"):
            assert close(getattr(found, name)[..., i], getattr(one, name), EXACT), name
        assert close(found.P_plus, one.P_plus, EXACT)


@pytest.mark.parametrize("form", PERFECT)
def test_perfect_measurements_and_singular_starts(form):
    """R = 0, P0 = 0 and a second perfect measurement of the same thing are legal: K = 0 there, no 0/0."""
    twice = dataclasses.replace(
        WALK, H=[[1, 0], [1, 0]], R=np.zeros((2, 2)), P0=np.zeros((2, 2)), offset=None, measurements=None, measurement_units=None
    )
    z = np.ones((4, 2))
    found, wanted = kalman_filter(twice, z[1:], algorithm=form), kalman_filter(twice, z[1:], algorithm="filterpy")
    assert close(found.P_plus, wanted.P_plus, EXACT)
    assert close(found.x_plus, wanted.x_plus, EXACT)
    assert np.array_equal(found.used, wanted.used)
    assert not found.used[:, 1].any()


def test_a_perfect_measurement_of_what_stays_known_is_left_out_in_every_form():
    """Without noise everything is known after two perfect measurements: rounding of 10⁻¹⁷ is not informative."""
    turning = DiscreteModel([[0.8, 0.6], [-0.6, 0.8]], np.zeros((2, 2)), [[1, 0]], [[0]], x0=[0, 0], P0=np.eye(2))
    z = np.array([[np.nan], [0.6], [0.96], [0.936], [0.5376]])  # x0 = (0, 1)
    for form in PERFECT:
        found = kalman_filter(turning, z[1:], algorithm=form)
        assert found.used[:, 0].tolist() == [False, True, True, False, False]
        assert close(found.x_plus[-1], [0.5376, -0.8432], 1e-10), form
    assert np.abs(comparison.reference(turning, z[1:]).P_plus[2:]).max() < EXACT


@pytest.mark.parametrize("form", OPTIMAL)
def test_absent_measurements_leave_the_prediction(form):
    """R = ∞ is a filter without data; with first = 0 an empty row 0 changes nothing."""
    absent = dataclasses.replace(WALK, R=[[np.inf]])
    found = kalman_filter(absent, Z[1:], algorithm=form)
    assert close(found.P_plus, covariances(absent, 5, algorithm="filterpy").P_plus, EXACT)
    assert np.isnan(found.nis).all()
    assert np.isinf(found.S).all()
    assert found.log_likelihood == 0
    assert close(kalman_filter(WALK, Z, first=0, algorithm=form).x_plus[0], WALK.x0, EXACT)


@pytest.mark.parametrize("form", OPTIMAL)
def test_zero_information_is_the_fit_to_the_data_alone(form):
    """Nothing known of both states at t0: no estimate until both are seen, then that of least squares, and no P0 in it."""
    still = dataclasses.replace(WALK, Qd=np.zeros((2, 2)), offset=None)
    z = np.array([[np.nan], [1.0], [2.5], [np.nan], [4.0], [5.5]])
    found = kalman_filter(still, z[1:], algorithm=form, P0=np.diag([np.inf, np.inf]))
    k = np.array([1, 2, 4, 5])
    line = np.column_stack([np.ones(4), k])
    level, slope = np.linalg.lstsq(line, z[k, 0])[0]
    assert close(found.x_plus[-1], [level + 5 * slope, slope], SOLVER)
    start = 2.0 * np.linalg.inv(line.T @ line)
    Psi = np.array([[1.0, 5.0], [0.0, 1.0]])
    assert close(found.P_plus[-1], Psi @ start @ Psi.T, SOLVER)
    assert np.isinf(np.diagonal(found.P_plus[0])).all()
    assert np.isnan(found.x_plus[0]).all()
    assert np.isinf(found.P_plus[1, 1, 1])
    assert np.isfinite(found.P_plus[2:]).all()
    # The first two measurements have no distribution, the others have that of their prediction.
    assert np.isnan(found.nis[[0, 1, 2, 3]]).all()
    assert np.isfinite(found.nis[[4, 5]]).all()
    S = found.S[[4, 5], 0, 0]
    terms = found.innovation[[4, 5], 0] ** 2 / S + np.log(2 * np.pi * S)
    assert close(found.log_likelihood, -0.5 * terms.sum(), SOLVER)


@pytest.mark.parametrize("form", OPTIMAL)
def test_one_state_may_be_unknown_beside_a_known_one(form):
    """``inf`` for the position alone: the limit of a large variance, and the velocity keeps what is known."""
    found = kalman_filter(WALK, Z[1:], algorithm=form, P0=np.diag([np.inf, 3.0]))
    wanted = reference.high_precision(dataclasses.replace(WALK, P0=np.diag([1e18, 3.0])), Z)
    assert close(found.x_plus[1:], wanted.x_plus[1:], SOLVER)
    assert close(found.P_plus[1:], wanted.P_plus[1:], SOLVER)
    assert found.P_plus[0].tolist() == [[np.inf, 0.0], [0.0, pytest.approx(3.0)]]


def test_the_steady_gain_refuses_zero_information():
    """It is the gain after everything is known."""
    with pytest.raises(ValueError, match=r"^form steady: expected a finite P0, received inf on its diagonal"):
        kalman_filter(WALK, Z[1:], algorithm="steady", P0=np.diag([np.inf, 1.0]))


@pytest.mark.parametrize("form", FORMS)
def test_another_finite_P0_is_taken_in_place_of_the_models(form):
    """``P0=`` is the model with that P0."""
    P0, z = [[2.0, 0.5], [0.5, 1.0]], np.ones((4, 1))
    found = kalman_filter(WALK, z[1:], algorithm=form, P0=P0)
    wanted = kalman_filter(dataclasses.replace(WALK, P0=P0), z[1:], algorithm=form)
    assert np.array_equal(found.P_plus, wanted.P_plus)
    assert np.array_equal(found.x_plus, wanted.x_plus)


# The forms of this file's own -----------------------------------------------------------------------------------------


def test_joseph_is_filterpy_to_the_bit():
    """The same calls of the same adapter; the compiled loop is the same to rounding."""
    found = driver.run(pose(WALK, Z[1:]), "joseph")[0]
    assert close(kalman_filter(WALK, Z[1:]).P_plus, found.P_plus, EXACT)
    wanted = covariances(WALK, 2, algorithm="filterpy")
    assert np.array_equal(found.P_plus[:3], wanted.P_plus)


def test_steady_applies_the_limit_of_the_gain():
    """Its gain is the Riccati equation's, its covariances the limits; after settling it is the optimal filter."""
    rng = np.random.default_rng(3)
    limit, z = steady.solve(WALK), rng.normal(size=(80, 1))
    found = kalman_filter(WALK, z[1:], algorithm="steady")
    x = WALK.x0
    for k in range(1, 80):
        x = WALK.Phi @ x + WALK.offset
        x = x + limit.K @ (z[k] - WALK.H @ x)
        assert close(found.x_plus[k], x, EXACT)
    assert close(found.P_minus[1], limit.P_minus, EXACT)
    assert close(found.P_plus[-1], limit.P_plus, EXACT)
    assert np.array_equal(found.P_minus[0], WALK.P0)
    optimal = kalman_filter(WALK, z[1:], algorithm="joseph")
    assert close(found.x_plus[-1], optimal.x_plus[-1], SOLVER)
    assert not close(found.x_plus[1], optimal.x_plus[1], 1e-3)


@pytest.mark.parametrize(
    ("change", "z", "message"),
    [
        ({}, Z, r"^form steady: expected 1 measured elements at every instant .*, received 0 at one$"),
        (
            {"H": [[1, 0], [0, 1]], "R": np.eye(2), "measurements": None, "measurement_units": None},
            [[1, 1], [1, np.nan]],
            "received 1 at one$",
        ),
        ({"Qd": np.ones((5, 2, 2))}, Z, "^form steady: model: expected constant matrices"),
        ({"H": [[0, 1]]}, np.ones((3, 1)), "^form steady: .* which no measurement sees"),
    ],
)
def test_steady_refuses_what_has_no_limit(change, z, message):
    """Gaps, elements that are missing, matrices that vary, modes that are not seen."""
    with pytest.raises(ValueError, match=message):
        kalman_filter(dataclasses.replace(WALK, **change), z[1:], algorithm="steady")


@pytest.mark.parametrize("form", INFORMATION)
@pytest.mark.parametrize(("change", "message"), [({"P0": [[1, 1], [1, 1]]}, "P0"), ({"R": [[0]]}, "R")])
def test_information_forms_refuse_what_has_no_inverse(form, change, message):
    """Singular P0 and R: one line that says which."""
    with pytest.raises(ValueError, match=rf"^form {form}: expected .*{message}"):
        kalman_filter(dataclasses.replace(WALK, **change), Z[1:], algorithm=form)


@pytest.mark.parametrize("Phi", [[[1, 1], [1, 1]], [[0.1, 0.2], [0.3, 0.6]]])
def test_the_information_form_refuses_a_transition_without_an_inverse(Phi):
    """Singular exactly, and singular to rounding; a strong contraction alone is no reason."""
    with pytest.raises(ValueError, match=r"^form information: expected a Phi with an inverse, received "):
        kalman_filter(dataclasses.replace(WALK, Phi=Phi), Z[1:], algorithm="information")
    model = dataclasses.replace(WALK, Phi=np.diag([1.0, 1e-3]))
    assert close(kalman_filter(model, Z[1:], algorithm="information").P_plus, reference.recursion(model, Z).P_plus, SOLVER)


def test_the_information_form_runs_without_noise():
    """Qd = 0, where the prediction of Y is Φ⁻ᵀYΦ⁻¹, and singular Qd, against conditioning."""
    for Qd in (np.zeros((2, 2)), [[0, 0], [0, 1]], [[1, 2], [2, 4]]):
        model = dataclasses.replace(WALK, Qd=Qd)
        wanted, found = reference.conditioned(model, Z), kalman_filter(model, Z[1:], algorithm="information")
        assert close(found.P_plus, wanted.P_plus, SOLVER)
        assert close(found.x_plus, wanted.x_plus, SOLVER)


# Rounding and cost ----------------------------------------------------------------------------------------------------


def test_the_short_form_loses_what_the_others_keep():
    """A sensor 10⁻¹² as uncertain as the prediction: the short form keeps few digits of the variance, UD all."""
    fine = dataclasses.replace(WALK, R=[[1e-12]])
    found = {c.name: c for c in compare(fine, Z[1:], ["conventional", "joseph", "sequential", "potter", "ud"])}
    assert found["conventional"].error_variance[0] > 1e-6
    assert max(found[name].error_variance[0] for name in ("joseph", "sequential", "ud")) < EXACT
    assert found["potter"].error_variance[0] < 1e-7
    assert max(c.error_P for c in found.values() if c.name != "conventional") < EXACT
    assert all((c.error_x < 1e-10).all() for c in found.values())


@pytest.mark.parametrize("delta", [1e-6, 1e-7, 1e-8, 1e-9])
def test_who_survives_two_sensors_that_are_almost_one(delta):
    """Bierman's example: Joseph's form keeps no digit of P at δ = 10⁻⁸, every root and factor six at 10⁻⁹.

    The reference is the closed form in rational numbers of the same doubles, not another recursion.
    """
    H = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + delta]])
    model = DiscreteModel(np.eye(3), np.zeros((3, 3)), H, delta**2 * np.eye(2), x0=np.zeros(3), P0=np.eye(3))
    found = {c.name: c for c in compare(model, [[1.0, 1.0]])}
    with mpmath.workdps(60):
        rows, R = mpmath.matrix(H.tolist()), mpmath.matrix(model.R.tolist())
        P = (mpmath.eye(3) + rows.T * R**-1 * rows) ** -1
        exact = reference.as_floats(P)
    assert close(comparison.reference(model, [[1.0, 1.0]]).P_plus[1], exact, 1e-15)
    for name in ("potter", "carlson", "array", "extended_array", "ud", "ld", "srif"):
        assert found[name].error_P < 1e-6, name
    if delta == 1e-8:
        assert found["joseph"].error_P > 0.1
    if delta == 1e-9:  # of S nothing but rounding is left, and a negative one is noticed
        assert found["joseph"].failed or found["joseph"].error_P > 0.1
    assert found["steady"].failed.startswith("form steady: ")
    assert found["steady"].error_P is found["steady"].flops is found["steady"].seconds is None


@settings(deadline=None, max_examples=10, derandomize=True)
@given(n=st.integers(1, 4), m=st.integers(1, 3), seed=st.integers(0, 100))
def test_operations_are_counted_whatever_their_values(n, m, seed):
    """The count of the short form is the sum over its products, and does not depend on the numbers."""
    rng = np.random.default_rng(seed)
    P0 = covariance(rng, n)
    model = DiscreteModel(rng.normal(size=(n, n)), np.eye(n), rng.normal(size=(m, n)), np.eye(m), x0=np.zeros(n), P0=P0)
    dot = 2 * n - 1
    predict = n * dot + 2 * n * n * dot + n * n
    factor = sum(i + 2 * i * i for i in range(m))  # of S: a column of factors, then the rest
    forward = sum(2 * n * i for i in range(m))
    backward = n * sum((2 * i - 1) + 1 if i else 0 for i in range(m)) + n * m
    solve = factor + forward + backward
    product = n * m * dot + m * m * dot + m * m  # PHᵀ and S
    update = product + solve + m * dot + m + n * (2 * m - 1) + n + m * n * dot + n * n * (2 * m - 1) + n * n
    assert flops(model, "conventional") == predict + update
    assert flops(model, "joseph") > flops(model, "conventional")
    assert flops(model, "steady") == n * dot + m * dot + m + n * (2 * m - 1) + n


@pytest.mark.parametrize("form", FORMS)
def test_the_cost_does_not_depend_on_the_data(form):
    """Neither ill conditioned matrices nor tiny noises change the number of operations."""
    other = dataclasses.replace(WALK, R=[[1e-12]], P0=[[1e6, 0.3], [0.3, 1e-6]])
    assert flops(WALK, form) == flops(other, form) > 0


@pytest.mark.parametrize("form", ["conventional", "ud", "steady"])
def test_what_a_measurement_tells_of_the_next_disturbance_costs_a_product(form):
    """With N a step adds M z to the prediction: nm products and sums, the known input's n where there was none."""
    alone = dataclasses.replace(WALK, offset=None)
    coupled = dataclasses.replace(alone, N=[[0.1], [0.2]])
    assert flops(coupled, form) == flops(alone, form) + WALK.n


def test_joseph_itself_leaves_out_a_perfect_measurement_of_what_is_known():
    """Called without the driver: the second of two equal perfect sensors has no gain and no density."""
    form = FORMS["joseph"]
    state, twice = form.start(WALK, np.array(WALK.P0)), np.array([[1.0, 0.0], [1.0, 0.0]])
    both = form.update(state, np.ones((2, 1)), twice, Noise(np.zeros((2, 2))))
    one = form.update(state, np.ones((1, 1)), twice[:1], Noise(np.zeros((1, 1))))
    assert close(both[0].covariance, one[0].covariance, EXACT)
    assert close(both[0].mean, one[0].mean, EXACT)
    assert close(both[1].nis, one[1].nis, EXACT)
    assert close(both[1].log_likelihood, one[1].log_likelihood, EXACT)


def test_a_variance_that_should_vanish_is_judged_by_what_is_left():
    """After perfect measurements rounding of the size 1e-16 in a square root is no loss, 1e-16 in P is."""
    exact = dataclasses.replace(WALK, R=[[0.0]])
    potter, short = compare(exact, Z[1:], ["potter", "conventional"])
    assert potter.error_variance[0] < EXACT
    left = np.abs(kalman_filter(exact, Z[1:], algorithm="conventional").P_plus[:, 0, 0])[[1, 2, 4, 5]].max()
    assert short.error_variance[0] >= np.sqrt(left / 10)


def test_a_reference_at_hand_is_not_computed_again(monkeypatch):
    """``exact`` gives the same errors; they are those against it."""
    exact, whole = comparison.reference(WALK, Z[1:]), compare(WALK, Z[1:], ["ud", "conventional"])
    off = dataclasses.replace(exact, P_plus=1.05 * exact.P_plus)
    monkeypatch.setattr(comparison, "reference", _never)
    again = compare(WALK, Z[1:], ["ud", "conventional"], exact=exact)
    assert [c.error_P for c in again] == [c.error_P for c in whole]
    assert compare(WALK, Z[1:], ["ud"], exact=off)[0].error_P == pytest.approx(0.05 / 1.05, rel=1e-6)


def _never(model, z, first=1):
    raise AssertionError


def test_a_perfect_measurement_beside_singular_innovations_is_told():
    """Two precise sensors of one state, which rounding makes equal, and a perfect one of the same state."""
    model = DiscreteModel(
        np.eye(2), np.eye(2), [[1, 0]] * 3, np.diag([1e-30, 1e-30, 0]), x0=[0, 0], P0=np.zeros((2, 2))
    )
    with pytest.raises(FloatingPointError, match=r"^S: .*received one singular by rounding at step 1 \(t = 1 s\)$"):
        driver.run(pose(model, np.ones((3, 3))[1:]), "ud", own_start=True)[0]


def test_a_chosen_few_are_compared():
    """compare takes names, in their order; by default all, in the order of the table."""
    assert [c.name for c in compare(WALK, Z[1:], ["ud", "joseph"])] == ["ud", "joseph"]
    every = compare(WALK, Z[1:])
    assert [c.name for c in every] == list(FORMS)
    assert [c.name for c in every if c.failed] == ["steady"]  # Z has a gap
    assert all(c.seconds > 0 and c.error_P < EXACT for c in every if not c.failed)


@pytest.mark.parametrize("form", ["conventional", "joseph", "sequential", "ud", "array"])
def test_an_overflow_is_refused_with_its_step(form):
    """An unstable system whose covariance leaves the doubles: the step and the time, no warnings, no NaN."""
    wild = DiscreteModel([[1e90]], [[1]], [[1]], [[np.inf]], x0=[0], P0=[[1]], dt=0.5)
    with pytest.raises(FloatingPointError, match=rf"^form {form}: .* overflow at step 2 \(t = 1 s\)$"):
        driver.run(pose(wild, np.ones((3, 1))), form)
    with pytest.raises(FloatingPointError, match=r"overflow at step 2 \(t = 1 s\)$"):
        kalman_filter(wild, np.ones((3, 1)), algorithm=form)


@pytest.mark.parametrize(
    ("change", "z", "options", "message"),
    [
        ({}, Z[1:], {"algorithm": "cholesky"}, "algorithm: expected one of auto, filterpy, conventional, joseph, .*, received 'cholesky'"),
        ({}, [[1.0, 2.0]], {}, r"z: expected shape \(rows, 1\) or \(rows, 1, runs\), received \(1, 2\)"),
        ({}, np.zeros((0, 1)), {}, r"z: expected shape"),
        ({}, [[1.0], [np.inf]], {}, r"z\[1\]\[0\]: expected finite numbers"),
        ({}, Z[1:], {"first": 2}, "first: expected 0 or 1, received 2"),
        ({"Qd": np.ones((2, 2, 2))}, Z[1:], {}, "steps: expected at most 2"),
    ],
)
def test_what_is_no_record_is_refused(change, z, options, message):
    """Unknown names, wrong shapes, infinite data, more steps than the model has."""
    with pytest.raises(ValueError, match=message):
        kalman_filter(dataclasses.replace(WALK, **change), z, **{"algorithm": "ud", **options})
    with pytest.raises(ValueError, match="expected one of"):
        compare(WALK, Z[1:], ["ud", "UD"])
    with pytest.raises(TypeError, match="model: expected a DiscreteModel"):
        kalman_filter("WALK", Z[1:], algorithm="ud")
    with pytest.raises(ValueError, match="P0: expected 0 beside an infinite variance"):
        kalman_filter(WALK, Z[1:], algorithm="information", P0=[[np.inf, 1.0], [1.0, 2.0]])


# The arithmetic that the forms share ----------------------------------------------------------------------------------


def sizes():
    return st.tuples(st.integers(1, 4), st.integers(1, 6))


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=15, derandomize=True)
@given(size=sizes(), seed=seeds)
def test_a_triangular_root_has_the_same_square(kind, size, seed):
    """LLᵀ = AAᵀ with no negative diagonal; the rows below ride along: AΘ(AΘ)ᵀ = AAᵀ."""
    A = np.random.default_rng(seed).normal(size=size)
    L = doubles(contract.triangular(numbers(A, kind)))
    assert close(L @ L.T, A @ A.T, EXACT)
    assert not np.triu(L, 1).any()
    assert (L.diagonal() >= 0).all()
    assert L.shape == (size[0], size[0])
    for rows in range(1, size[0] + 1):
        T = doubles(contract.triangularised(numbers(A, kind), rows))
        assert close(T @ T.T, A @ A.T, EXACT)
        assert not np.triu(T[:rows], 1).any()
        assert (T[:rows].diagonal() >= 0).all()
    assert not close(broken(L) @ broken(L).T, A @ A.T, SOLVER)


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=15, derandomize=True)
@given(n=st.integers(1, 4), k=st.integers(1, 3), seed=seeds)
def test_linear_systems_are_solved_in_every_kind_of_number(kind, n, k, seed):
    """Solutions put back into their equations, for regular, triangular, definite and indefinite matrices."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, n)) + 2 * np.eye(n), rng.normal(size=(n, k))
    size = np.linalg.cond(A)
    P = covariance(rng, n)
    own = [numbers(M, kind) for M in (A, B, P)]
    assert close(A @ doubles(contract.solve(own[0], own[1])), B, EXACT * size)
    assert close(A @ doubles(contract.inverse(own[0])), np.eye(n), EXACT * size)
    L = doubles(contract.cholesky(own[2]))
    assert close(L @ L.T, P, EXACT)
    assert not np.triu(L, 1).any()
    lower = np.tril(A)
    assert close(lower @ doubles(contract.substituted(own[0], own[1])), B, EXACT * np.linalg.cond(lower))
    upper = np.triu(A)
    assert close(upper @ doubles(contract.substituted_back(own[0], own[1])), B, EXACT * np.linalg.cond(upper))
    d, rows = (doubles(part) for part in contract.eliminated(own[2], own[1]))
    assert close((rows.T / d) @ rows, B.T @ np.linalg.solve(P, B), SOLVER)
    assert close(d.prod(), np.linalg.det(P), SOLVER)


@pytest.mark.parametrize("kind", KINDS)
def test_singular_matrices_are_refused(kind):
    """LinAlgError, which the driver tells with the form and the step."""
    singular, zero = numbers([[1.0, 2.0], [2.0, 4.0]], kind), numbers([[0.0]], kind)
    for call in (
        lambda: contract.solve(singular, singular),
        lambda: contract.inverse(zero),
        lambda: contract.cholesky(numbers([[1.0, 2.0], [2.0, 1.0]], kind)),
        lambda: contract.substituted(numbers([[1.0, 0.0], [1.0, 0.0]], kind), singular),
    ):
        with pytest.raises(np.linalg.LinAlgError, match="expected a regular matrix"):
            call()


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=15, derandomize=True)
@given(n=st.integers(1, 4), seed=seeds, data=st.data())
def test_a_noise_and_its_factors(kind, n, seed, data):
    """M = L diag(d) Lᵀ = (L√d)(L√d)ᵀ, of full rank or not; the thin factors leave out the zero columns."""
    rank = data.draw(st.integers(0, n))
    M = covariance(np.random.default_rng(seed), n, rank)
    noise = Noise(numbers(M, kind))
    L, d, root = doubles(noise.L), doubles(noise.d), doubles(noise.root)
    assert close((L * d) @ L.T, M, EXACT)
    assert close(root @ root.T, M, EXACT)
    assert not np.triu(root, 1).any()
    thin = doubles(noise.thin)
    assert close(thin @ thin.T, M, EXACT)
    assert close((doubles(noise.thin_L) * doubles(noise.thin_d)) @ doubles(noise.thin_L).T, M, EXACT)
    assert thin.shape[1] == np.count_nonzero(d)
    assert noise.singular == (np.count_nonzero(d) < n)
    assert noise.diagonal == (not M[~np.eye(n, dtype=bool)].any())


@settings(deadline=None, max_examples=15, derandomize=True)
@given(m=st.integers(1, 4), seed=seeds)
def test_three_ways_to_the_same_evidence(m, seed):
    """From ν and S, from independent innovations, from whitened ones: the normal density, in doubles and 50 digits."""
    rng = np.random.default_rng(seed)
    S, nu = covariance(rng, m), rng.normal(size=(m, 3))
    C = np.linalg.cholesky(S)
    nis = np.einsum("ir,ij,jr->r", nu, np.linalg.inv(S), nu)
    wanted = -0.5 * (nis + np.linalg.slogdet(2 * np.pi * S)[1])
    e = np.linalg.solve(C, nu)
    with mpmath.workdps(50):
        high = contract.evidence(numbers(nu, mpmath.mpf), numbers(S, mpmath.mpf))
    for found in (
        contract.evidence(nu, S),
        contract.independent(e * C.diagonal()[:, None], C.diagonal() ** 2),
        contract.whitened(e, C.diagonal()),
        high,
    ):
        assert close(doubles(found.nis), nis, SOLVER)
        assert close(doubles(found.log_likelihood), wanted, SOLVER)


def test_evidence_of_what_says_nothing():
    """A variance of 0 is left out; one that rounding has made negative has no likelihood; nothing of it is counted."""
    nu, s = np.array([[1.0], [2.0]]), np.array([0.0, 4.0])
    found = contract.independent(nu, s)
    assert close(found.nis, [1.0], EXACT)
    assert close(found.log_likelihood, [-0.5 * (1 + np.log(8 * np.pi))], EXACT)
    assert np.isnan(contract.evidence(nu, np.diag([1.0, -1e-17])).log_likelihood).all()
    high = contract.independent(numbers(nu, mpmath.mpf), numbers([1.0, -1.0], mpmath.mpf))
    assert mpmath.isnan(high.log_likelihood[0])
    Counted.total, counted = 0, numbers(np.eye(2), Counted)
    contract.evidence(counted, counted)
    contract.whitened(counted, counted[0])
    assert Counted.total == 0


def test_counted_numbers_are_numbers():
    """They compare, negate and turn into doubles without cost; a square root costs one."""
    a, b = Counted(2.0), Counted(3.0)
    Counted.total = 0
    assert a < b <= 3
    assert b > a >= 2
    assert float(-a) == -2.0
    assert float(abs(Counted(-2.0))) == 2.0
    assert not Counted(0.0)
    assert Counted.total == 0
    assert float((a + b) ** 0.5 * 2 / b - 1) == pytest.approx(2 * 5**0.5 / 3 - 1)
    assert Counted.total == 5
