"""One suite for all forms: each is the filter by definition, can what it declares, and refuses the rest by its name."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ctlabs.filtering import comparison, flops, kalman_filter, steady
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.engines import driver
from ctlabs.filtering.problem import pose
from ctlabs.models import DiscreteModel
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import covariance, discrete_models, record, transition

pytestmark = pytest.mark.numerical


class Can(NamedTuple):
    """What a form can do."""

    perfect: bool = True  # R = 0, or singular
    singular_P0: bool = True
    singular_Phi: bool = True
    gaps: bool = True  # missing elements
    varying: bool = True  # matrices that vary with time


CAN = {
    "conventional": Can(),
    "joseph": Can(),
    "information": Can(perfect=False, singular_P0=False, singular_Phi=False),
    "sequential": Can(),
    "potter": Can(),
    "carlson": Can(),
    "array": Can(),
    "extended_array": Can(perfect=False),
    "ud": Can(),
    "ld": Can(),
    "srif": Can(perfect=False, singular_P0=False, singular_Phi=False),
    "steady": Can(gaps=False, varying=False),
}
OPTIMAL = [name for name in CAN if name != "steady"]
every_form = pytest.mark.parametrize("form", OPTIMAL)

MODEL = DiscreteModel(
    Phi=[[1.0, 0.2, 0.0], [0.0, 0.9, 0.1], [0.0, -0.1, 0.8]],
    Qd=[[0.1, 0.02, 0.0], [0.02, 0.2, 0.05], [0.0, 0.05, 0.3]],
    H=[[1.0, 0.0, 0.5], [0.0, 1.0, -0.5]],
    R=[[0.5, 0.2], [0.2, 0.8]],
    x0=[1.0, -1.0, 0.5],
    P0=[[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 1.5]],
    dt=0.5,
    N=[[0.05, 0.0], [0.0, 0.1], [0.02, -0.03]],
    offset=[0.1, 0.0, -0.2],
)
Z = record(MODEL, 6, np.random.default_rng(1))


def differs(found, wanted, model=MODEL):
    """The largest deviation of the moments that a filter and an oracle give; of P relative to P0 and Qd at least."""
    size = max(np.abs(model.P0).max(), np.abs(model.Qd).max())
    return max(
        *(reference.deviation(getattr(found, x), getattr(wanted, x)) for x in ("x_minus", "x_plus")),
        *(reference.deviation(getattr(found, P), getattr(wanted, P), size) for P in ("P_minus", "P_plus")),
    )


def solid(model):
    """The model with an invertible P0, for the forms that need one; a singular Qd stays."""
    return dataclasses.replace(model, P0=model.P0 + 0.5 * np.eye(model.n))


def judged(model, wanted):
    """The forms of which SOLVER can be asked here; models that magnify any rounding are not asked about at all.

    With N the state moves by Φ − NR⁻¹H between measurements: P's rounding grows by its norm squared at each step. The
    information form inverts it (twice in a step) and P, and loses the digits of their condition numbers.
    """
    moved = []
    for k in range(len(wanted.P_plus) - 1):
        Phi, H, R = (reference.at(matrix, k) for matrix in (model.Phi, model.H, model.R))
        moved.append(Phi if model.N is None else Phi - reference.at(model.N, k) @ np.linalg.solve(R, H))
    assume(np.prod([max(np.linalg.norm(A, 2), 1.0) ** 2 for A in moved]) < 1e4)
    known = [np.array(P, dtype=np.float64) for P in (*wanted.P_minus, *wanted.P_plus)]
    worst = max(map(np.linalg.cond, moved)) ** 2 * max(map(np.linalg.cond, known))
    return [form for form in OPTIMAL if form != "information" or worst < 1e6]


def test_the_suite_knows_every_form():
    """The forms are those of the design, in its order."""
    assert list(FORMS) == list(CAN)


@pytest.mark.parametrize("form", CAN)
def test_every_form_says_what_it_is(form):
    """Its docstring has equations, a source, the operations of a step, and what it can do with singular matrices."""
    doc = FORMS[form].__doc__
    for part in (".. math::", "Source: ", "Operations per step", "R = 0", "singular Q", "P0"):
        assert part in doc
    for verb in ("start", "predict", "update"):
        assert callable(getattr(FORMS[form], verb))


#: Coefficients of n³ with s = 1, of n³ with s = n and of mn² in the operations of a step (s, rank of Qd), as the docstrings add up.
LEADING = {
    "conventional": (4, 4, 6),
    "joseph": (8, 8, 6),
    "information": (32 / 3, 64 / 3, 2),
    "sequential": (4, 4, 8),
    "potter": (10 / 3, 16 / 3, 6),
    "carlson": (10 / 3, 16 / 3, 4.5),
    "array": (14 / 3, 20 / 3, 6),
    "extended_array": (14 / 3, 20 / 3, 6),
    "ud": (4, 6, 4),
    "ld": (6, 8, 8),
    "srif": (7, 85 / 3, 2),
}


def dense(n, m, s):
    """A model without zeros in it, Qd of rank s."""
    rng = np.random.default_rng(1)
    Phi, H = transition(rng, n, True), rng.normal(size=(m, n))
    return DiscreteModel(Phi, covariance(rng, n, s), H, covariance(rng, m), x0=np.zeros(n), P0=covariance(rng, n))


@every_form
def test_the_operations_of_a_step_are_those_of_the_docstring(form):
    """Counted at four sizes, the third difference in n (and the mixed one in m) is the leading term, exactly."""
    sizes = (5, 7, 9, 11)
    one, full = (np.diff([flops(dense(n, 2, s or n), form) for n in sizes], 3)[0] / (6 * 2**3) for s in (1, None))
    rows = [flops(dense(n, 4, 1), form) - flops(dense(n, 3, 1), form) for n in sizes[1:]]
    assert np.allclose([one, full, np.diff(rows, 2)[0] / (2 * 2**2)], LEADING[form], rtol=EXACT)


def test_the_steady_gain_costs_next_to_nothing():
    """2n² for the prediction, 4mn for the update."""
    for n, m in ((4, 2), (7, 3)):
        assert flops(dense(n, m, n), "steady") == n * (2 * n - 1) + 4 * m * n


# The filter by definition --------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=30, derandomize=True)
@given(
    model=discrete_models(stable=None),
    steps=st.integers(2, 6),
    seed=st.integers(0, 10**6),
    gaps=st.sampled_from([0.0, 0.3]),
    first=st.sampled_from([0, 1]),
)
def test_every_form_is_the_conditional_distribution(model, steps, seed, gaps, first):
    """Stable or not, R full, Qd and P0 singular, matrices that vary, N, known input, missing elements: by definition."""
    z = record(model, steps, np.random.default_rng(seed), gaps, first)
    for some in (model, solid(model)):
        wanted = reference.conditioned(some, z, first)
        likely = reference.log_likelihood(some, z, first) if not np.isnan(z[first:]).all() else 0.0
        for form in judged(some, wanted):
            if not CAN[form].singular_P0 and some is model:
                continue
            found = kalman_filter(some, z[first:], first=first, algorithm=form)
            assert differs(found, wanted, some) < SOLVER, form
            assert close(found.log_likelihood, likely, SOLVER), form
            _innovations_are_right(found, some, z, first)


def _innovations_are_right(found, model, z, first):
    """ν = z − Hx⁻, S = HP⁻Hᵀ + R and νᵀS⁻¹ν of the elements used; NaN and inf elsewhere."""
    for k in range(len(z)):
        used = reference.present(model, z, k, first)
        H, R = reference.at(model.H, k)[used], reference.at(model.R, k)[np.ix_(used, used)]
        nu, S = z[k, used] - H @ found.x_minus[k], H @ found.P_minus[k] @ H.T + R
        assert np.array_equal(np.flatnonzero(found.used[k]), used)
        assert close(found.innovation[k, used], nu, EXACT, size=np.abs(z[k, used]).max(initial=0.0))
        assert close(found.S[k][np.ix_(used, used)], S, EXACT)
        assert np.isnan(np.delete(found.innovation[k], used)).all()
        assert np.isinf(np.delete(found.S[k].diagonal(), used)).all()
        if used.size:
            assert close(found.nis[k], nu @ np.linalg.solve(S, nu), SOLVER, size=1.0)
        else:
            assert np.isnan(found.nis[k])


@every_form
@pytest.mark.parametrize("name", ["Phi", "Qd", "H", "R", "N", "offset", "x0", "P0", "z"])
def test_five_percent_of_one_element_are_noticed(form, name):
    """The identity above fails when one element of the form's model or data is off by 5 %."""
    wanted = reference.conditioned(MODEL, Z)
    assert differs(kalman_filter(MODEL, Z[1:], algorithm=form), wanted) < EXACT
    if name == "z":
        assert differs(kalman_filter(MODEL, broken(np.nan_to_num(Z))[1:], algorithm=form), wanted) > SOLVER
        return
    element = {"R": (0, 0), "Qd": (0, 0), "P0": (0, 0)}.get(name)
    other = dataclasses.replace(MODEL, **{name: broken(getattr(MODEL, name), element)})
    assert differs(kalman_filter(other, Z[1:], algorithm=form), wanted) > SOLVER


@settings(deadline=None, max_examples=20, derandomize=True)
@given(model=discrete_models(stable=None), seed=st.integers(0, 10**6))
def test_the_reference_is_sixty_digits_rounded(model, seed):
    """The reference is the tests' own multiprecision recursion, and every form is within SOLVER of both."""
    z = record(model, 4, np.random.default_rng(seed), gaps=0.2)
    model = solid(model)
    high, own = reference.high_precision(model, z), comparison.reference(model, z[1:])
    assert differs(own, high, model) < EXACT
    for form in judged(model, high):
        assert differs(kalman_filter(model, z[1:], algorithm=form), high, model) < SOLVER, form


@every_form
def test_on_a_well_conditioned_model_every_digit_is_right(form):
    """With N, an input, a full R and a gap all forms agree with the multiprecision filter to EXACT."""
    z = Z.copy()
    z[2], z[4, 1] = np.nan, np.nan
    assert differs(kalman_filter(MODEL, z[1:], algorithm=form), reference.high_precision(MODEL, z)) < EXACT


@every_form
def test_the_likelihood_is_the_joint_density(form):
    """Of the innovations before the updates; 5 % in one element of R are noticed."""
    wanted = reference.log_likelihood(MODEL, Z)
    assert close(kalman_filter(MODEL, Z[1:], algorithm=form).log_likelihood, wanted, EXACT)
    other = dataclasses.replace(MODEL, R=broken(MODEL.R, (0, 0)))
    assert not close(kalman_filter(other, Z[1:], algorithm=form).log_likelihood, wanted, SOLVER)


@settings(deadline=None, max_examples=15, derandomize=True)
@given(model=discrete_models(singular=False), seed=st.integers(0, 10**6), runs=st.integers(1, 4))
def test_several_runs_are_a_loop_over_runs(model, seed, runs):
    """The last axis of z: one covariance, and each run as if it were alone."""
    rng = np.random.default_rng(seed)
    z = np.stack([record(model, 4, rng) for _ in range(runs)], axis=-1)
    z[2, 0] = np.nan
    for form in OPTIMAL:
        together = kalman_filter(model, z[1:], algorithm=form)
        for i in range(runs):
            alone = kalman_filter(model, z[1:, ..., i], algorithm=form)
            for name in ("x_minus", "x_plus", "innovation", "nis"):
                assert close(getattr(together, name)[..., i], getattr(alone, name), EXACT), form
            for name in ("P_minus", "P_plus", "S", "used", "t"):
                both = getattr(together, name) * 1.0, getattr(alone, name) * 1.0
                assert np.array_equal(*both) or (form == "joseph" and close(*both, EXACT)), form  # one record is a compiled loop
            assert close(together.log_likelihood[i], alone.log_likelihood, EXACT)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(model=discrete_models(), seed=st.integers(0, 10**6))
def test_joseph_is_the_library_s_filter(model, seed):
    """The form ``joseph`` and filterpy's filter agree in every result."""
    z = record(model, 5, np.random.default_rng(seed), gaps=0.2)
    found, wanted = kalman_filter(model, z[1:], algorithm="joseph"), kalman_filter(model, z[1:], algorithm="filterpy")
    assert close(found.x_plus, wanted.x_plus, EXACT)
    assert close(found.P_plus, wanted.P_plus, EXACT)
    assert close(found.innovation, wanted.innovation, EXACT)
    assert close(found.S, wanted.S, EXACT)


# What each can, and what it refuses ----------------------------------------------------------------------------------------


def shown_or_refused(form, can, model, z, words, **options):
    """Right by definition where the form can; a line with its name and the ``words`` where it cannot."""
    if can:
        found = kalman_filter(model, z[1:], algorithm=form)
        assert differs(found, reference.conditioned(model, z), model) < SOLVER
        return
    with pytest.raises(ValueError, match=words) as caught:
        kalman_filter(model, z[1:], algorithm=form, **options)
    assert str(caught.value).startswith(f"form {form}: expected ")
    assert "\n" not in str(caught.value)


PERFECT = {
    "zero": np.zeros((2, 2)),
    "one of two": np.diag([0.0, 0.8]),
    "a combination": np.array([[0.5, 0.5], [0.5, 0.5]]),
}


@every_form
@pytest.mark.parametrize("R", PERFECT.values(), ids=list(PERFECT))
def test_perfect_measurements(form, R):
    """R = 0, one perfect element of two, and noises that are one noise."""
    model = dataclasses.replace(MODEL, R=R, N=None)
    shown_or_refused(form, CAN[form].perfect, model, record(model, 5, np.random.default_rng(2)), "perfect measurement")


@pytest.mark.parametrize("form", [name for name in OPTIMAL if CAN[name].perfect])
def test_what_is_known_already_is_left_out(form):
    """The same thing measured perfectly twice, and again when nothing has moved: K = 0, no 0/0, no likelihood of 0/0."""
    still = DiscreteModel(np.eye(2), np.zeros((2, 2)), [[1, 0], [1, 0], [0, 1]], np.diag([0, 0, 1]), x0=[0, 0], P0=np.eye(2))
    z = np.array([[np.nan] * 3, [2.0, 2.0, 1.0], [2.0, 2.0, 3.0]])
    found = kalman_filter(still, z[1:], algorithm=form)
    assert found.used.tolist() == [[False] * 3, [True, False, True], [False, False, True]]
    wanted = reference.conditioned(still, z)
    assert close(found.x_plus, wanted.x_plus, EXACT)
    assert close(found.P_plus, wanted.P_plus, EXACT)
    once = reference.log_likelihood(still, np.where(found.used, z, np.nan))
    assert close(found.log_likelihood, once, EXACT)


@pytest.mark.parametrize("form", [name for name in OPTIMAL if CAN[name].perfect])
@pytest.mark.parametrize("seed", range(8))
def test_what_nearly_equal_measurements_tell_is_left_out_when_it_comes_again(form, seed):
    """Three perfect measurements, two of them nearly equal, determine three states; a fourth adds nothing."""
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(4, 3))
    H[2] = H[1] + 1e-2 * rng.normal(size=3)
    x = rng.normal(size=3)
    model = DiscreteModel(np.eye(3), np.zeros((3, 3)), H, np.zeros((4, 4)), x0=np.zeros(3), P0=np.eye(3))
    found = kalman_filter(model, np.tile(H @ x, (3, 1)), first=0, algorithm=form)
    assert found.used.tolist() == [[True, True, True, False], [False] * 4, [False] * 4]
    assert close(found.x_plus[-1], x, SOLVER)
    assert close(found.P_plus[-1], np.zeros((3, 3)), SOLVER, size=1.0)


@every_form
@pytest.mark.parametrize(
    "P0", [np.zeros((3, 3)), np.diag([1.0, 0.0, 2.0]), np.ones((3, 3))], ids=["0", "rank 2", "rank 1"]
)
def test_singular_starts(form, P0):
    """P0 = 0, a state known exactly, a known combination of states."""
    model = dataclasses.replace(MODEL, P0=P0)
    shown_or_refused(form, CAN[form].singular_P0, model, Z, "P0 with an inverse")


@every_form
@pytest.mark.parametrize(
    "Phi", [np.zeros((3, 3)), np.ones((3, 3)) / 3, np.diag([1.0, 1.0], -1)], ids=["0", "1", "shift"]
)
def test_singular_transitions(form, Phi):
    """Φ = 0, one of rank 1, and a nilpotent one, where Qd does not fill what Φ loses."""
    model = dataclasses.replace(MODEL, Phi=Phi, Qd=np.zeros((3, 3)), N=None)
    z = record(model, 5, np.random.default_rng(3))
    shown_or_refused(form, CAN[form].singular_Phi, model, z, "singular")


def test_the_root_of_information_needs_no_inverse_of_phi():
    """SRIF takes a singular Φ where Qd fills what it loses; the information form does not."""
    model = dataclasses.replace(MODEL, Phi=np.diag([1.0, 1.0], -1), N=None)
    z = record(model, 5, np.random.default_rng(4))
    assert differs(kalman_filter(model, z[1:], algorithm="srif"), reference.conditioned(model, z)) < SOLVER
    with pytest.raises(ValueError, match="form information: expected a Phi with an inverse, received a singular one"):
        kalman_filter(model, z[1:], algorithm="information")


@every_form
def test_no_process_noise(form):
    """Qd = 0 is no trouble to any form."""
    model = dataclasses.replace(MODEL, Qd=np.zeros((3, 3)), N=None)
    shown_or_refused(form, True, model, record(model, 5, np.random.default_rng(5)), "")


@every_form
def test_measurements_that_are_never_taken(form):
    """R = inf: the element is absent; an instant without any is a prediction."""
    model = dataclasses.replace(MODEL, R=np.diag([0.5, np.inf]), N=np.array([[0.05, 0], [0, 0], [0.02, 0]]))
    shown_or_refused(form, True, model, Z, "")
    none = dataclasses.replace(MODEL, R=np.diag([np.inf, np.inf]), N=None)
    found = kalman_filter(none, Z[1:], algorithm=form)
    assert differs(found, reference.conditioned(none, Z)) < SOLVER
    assert found.log_likelihood == 0.0
    assert np.isnan(found.nis).all()


# Zero information --------------------------------------------------------------------------------------------------------

UNKNOWN = OPTIMAL
#: In double precision a variance of 1e300 is none: its rows of the least squares problem are 1e-150.
HUGE = 1e300


@settings(deadline=None, max_examples=30, derandomize=True)
@given(
    model=discrete_models(singular=False, max_n=3),
    seed=st.integers(0, 10**6),
    known=st.integers(0, 2),
    first=st.sampled_from([0, 1]),
)
def test_zero_information_is_least_squares(model, seed, known, first):
    """P0 = inf for some or all states: once they are determined, least squares of the measurements (and of what is known)."""
    n = model.n
    assume(all(np.linalg.cond(Phi) < 1e3 for Phi in model.Phi.reshape(-1, n, n)))
    free = np.arange(n) >= known
    assume(free.any())
    z = record(model, 5, np.random.default_rng(seed), gaps=0.2, first=first)
    outer = free[:, None] | free
    P0 = np.where(outer, np.where(np.eye(n, dtype=bool), np.inf, 0.0), model.P0)
    found = [kalman_filter(model, z[first:], first=first, algorithm=form, P0=P0) for form in UNKNOWN]
    determined = 0
    for k in range(1, 6):
        if np.isfinite(found[0].P_plus[k]).all():
            squares = reference.least_squares(model, z[: k + 1], first, P0)
        for own in found:
            if np.isfinite(own.P_plus[k]).all():
                determined += 1
                assert close(own.x_plus[k], squares.x[-1], SOLVER)
                assert close(own.P_plus[k], squares.P[-1], SOLVER)
            else:  # what is not determined is said to be so, and the two forms agree on it
                lost = np.isinf(own.P_plus[k].diagonal())
                assert np.array_equal(np.isnan(own.x_plus[k]), lost)
                assert not own.P_plus[k][lost][:, ~lost].any()
                assert np.array_equal(lost, np.isinf(found[0].P_plus[k].diagonal()))
    rows = np.isfinite(z[first:]).sum()
    assert determined or rows <= 2 * n  # with enough measurements it is determined


@pytest.mark.parametrize("form", UNKNOWN)
def test_zero_information_is_noticed_to_end(form):
    """A position measured alone: known at the first measurement, its rate at the second, by hand; 5 % are noticed."""
    track = DiscreteModel([[1, 1], [0, 1]], np.zeros((2, 2)), [[1, 0]], [[4.0]], x0=[0, 0], P0=np.eye(2))
    found = kalman_filter(track, [[3.0], [5.0]], algorithm=form, P0=np.diag([np.inf, np.inf]))
    assert np.isnan(found.x_plus[0]).all()
    assert close(found.x_plus[1, 0], 3.0, EXACT)
    assert np.isnan(found.x_plus[1, 1])
    assert close(found.x_plus[2], [5.0, 2.0], EXACT)
    assert close(found.P_plus[2], [[4.0, 4.0], [4.0, 8.0]], EXACT)
    assert found.log_likelihood == 0.0
    assert np.isnan(found.nis).all()
    other = kalman_filter(track, [[3.0 * 1.05], [5.0]], algorithm=form, P0=np.diag([np.inf, np.inf]))
    assert not close(other.x_plus[2], [5.0, 2.0], SOLVER)


@pytest.mark.parametrize("form", UNKNOWN)
def test_measurements_beyond_what_was_unknown_have_their_likelihood(form):
    """Zero information then a determined state: the likelihood is that of the rest of the record, given its beginning."""
    H = np.concatenate([np.eye(3)[None], np.repeat(MODEL.H[:1][None], 5, axis=0).repeat(3, axis=1) + np.eye(3)])
    R = np.diag([0.4, 0.5, 0.6])
    model = DiscreteModel(MODEL.Phi, MODEL.Qd, H, R + np.zeros((6, 3, 3)), x0=MODEL.x0, P0=MODEL.P0)
    z = record(model, 5, np.random.default_rng(6), first=0)
    found = kalman_filter(model, z, first=0, algorithm=form, P0=np.diag([np.inf] * 3))
    after = dataclasses.replace(model, x0=z[0], P0=R)  # the first measurement, H = I, is all that is known at t0
    assert close(found.log_likelihood, reference.log_likelihood(after, z), EXACT)
    assert differs(_later(found), _later(reference.conditioned(after, z))) < EXACT


def _later(moments):
    """Moments from t1 on."""
    return reference.Moments(*(getattr(moments, name)[1:] for name in reference.Moments._fields))


# The steady gain -----------------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=20, derandomize=True)
@given(model=discrete_models(singular=False, varying=False, offset=None), seed=st.integers(0, 10**6))
def test_the_steady_gain_is_the_filter_that_has_settled(model, seed):
    """Started from its own limit, with a measurement at t0, the optimal filter and the steady one are the same."""
    z = record(model, 5, np.random.default_rng(seed), first=0)
    settled = dataclasses.replace(model, P0=steady.solve(model).P_minus)
    found, wanted = kalman_filter(settled, z, first=0, algorithm="steady"), kalman_filter(settled, z, first=0, algorithm="joseph")
    assert differs(found, wanted, settled) < SOLVER
    assert close(found.log_likelihood, wanted.log_likelihood, SOLVER)
    other = kalman_filter(dataclasses.replace(settled, R=broken(model.R, (0, 0))), z, first=0, algorithm="steady")
    assert differs(other, wanted, settled) > SOLVER


@pytest.mark.parametrize(
    ("change", "z", "message"),
    [
        ({"Phi": [MODEL.Phi] * 6}, Z, "constant matrices, received some that vary over 6 steps"),
        ({}, np.where(np.arange(7)[:, None] == 3, np.nan, Z), "2 measured elements at every instant"),
        ({}, np.where(np.arange(14).reshape(7, 2) == 9, np.nan, Z), "2 measured elements at every instant"),
        ({"Phi": np.diag([1.0, 0.5, 1.1]), "H": [[1, 0, 0], [0, 1, 0]]}, Z, "every mode .* to be measured"),
    ],
    ids=["varying", "an instant", "an element", "undetectable"],
)
def test_the_steady_gain_refuses_what_has_no_limit(change, z, message):
    """Matrices that vary, missing measurements, a growing mode that is not seen: by name, in one line."""
    with pytest.raises(ValueError, match=message) as caught:
        kalman_filter(dataclasses.replace(MODEL, N=None, **change), z[1:], algorithm="steady")
    assert str(caught.value).startswith("form steady: ")
    assert "\n" not in str(caught.value)


# Rounding ------------------------------------------------------------------------------------------------------------------


def two_sensors(delta, q=0.0):
    """Bierman's example: two measurements that differ by δ and are as precise as δ, of three states known to 1."""
    H = [[1, 1, 1], [1, 1, 1 + delta]]
    return DiscreteModel(np.eye(3), q * np.eye(3), H, delta**2 * np.eye(2), x0=np.zeros(3), P0=np.eye(3))


def error_of_P(model, z, form, exact):
    """max over k of ‖P⁺ − P_ref‖/‖P_ref‖; inf where the form gives up."""
    try:
        found = driver.run(pose(model, z[1:]), form, own_start=True)[0].P_plus
    except FloatingPointError as error:
        assert str(error).startswith(f"form {form}: expected ")  # noqa: PT017  # giving up is one of two legal ends
        return np.inf
    return (np.linalg.norm(found - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))).max()


FACTORED = ("potter", "carlson", "array", "extended_array", "ud", "ld", "srif")


@pytest.mark.parametrize("delta", [1e-6, 1e-7, 1e-8, 1e-9])
def test_factored_forms_survive_precise_measurements(delta):
    """Of P every factored form keeps six digits down to δ = 1e-9; at 1e-8 Joseph's form keeps none."""
    model = two_sensors(delta)
    z = record(model, 2, np.random.default_rng(7))
    exact = reference.high_precision(model, z).P_plus
    for form in FACTORED:
        assert error_of_P(model, z, form, exact) < 1e-6, form
    joseph = error_of_P(model, z, "joseph", exact)
    assert joseph < 1e-6 if delta > 1e-7 else joseph > 1e-5
    if delta == 1e-8:
        assert joseph > 0.01  # roundings of the size ε/δ² = 2 in P: which part of it is lost depends on their order
    for form in ("conventional", "information"):
        assert error_of_P(model, z, form, exact) > 1e-6, form


def test_factored_forms_survive_long_runs_with_little_noise():
    """The same after 60 steps with Qd = 1e-20 I, where nothing is forgotten."""
    model = two_sensors(1e-9, q=1e-20)
    z = record(model, 60, np.random.default_rng(8))
    exact = reference.high_precision(model, z, digits=50).P_plus
    for form in FACTORED:
        assert error_of_P(model, z, form, exact) < 1e-6, form
    assert error_of_P(model, z, "joseph", exact) > 0.1


def in_other_units(span):
    """MODEL with its first state in units 2^span smaller, its last in units 2^span larger; the scales."""
    units = 2.0 ** np.array([span, 0, -span])
    D, back = np.diag(units), np.diag(1 / units)
    return dataclasses.replace(
        MODEL,
        Phi=D @ MODEL.Phi @ back,
        Qd=D @ MODEL.Qd @ D,
        H=MODEL.H @ back,
        x0=D @ MODEL.x0,
        P0=D @ MODEL.P0 @ D,
        N=D @ MODEL.N,
        offset=D @ MODEL.offset,
    ), units


@pytest.mark.parametrize("form", CAN)
@pytest.mark.parametrize("span", [12, 40])
def test_the_units_of_the_states_do_not_matter(form, span):
    """Metres beside radians: the same estimates to rounding, over 60 steps, in units 2^12 and 2^40 apart."""
    z = record(MODEL, 60, np.random.default_rng(1))
    other, units = in_other_units(span)
    ours, theirs = kalman_filter(MODEL, z[1:], algorithm=form), kalman_filter(other, z[1:], algorithm=form)
    assert close(theirs.x_plus / units, ours.x_plus, EXACT)
    assert close(theirs.P_plus / np.outer(units, units), ours.P_plus, EXACT)
    assert not close(theirs.x_plus / broken(units), ours.x_plus, EXACT)


@pytest.mark.parametrize("form", ["information", "srif", "ud"])
def test_evidence_of_what_is_known_when_other_states_are_not(form):
    """P0 = inf for one state: a measurement of the other one has a NIS; only the diffuse likelihood counts it, and the determining one."""
    two = DiscreteModel(np.eye(2), np.eye(2), np.eye(2), np.eye(2), x0=[0, 0], P0=np.eye(2))
    z = np.array([[np.nan, np.nan], [2.0, np.nan], [np.nan, 1.0]])
    found = kalman_filter(two, z[1:], algorithm=form, P0=np.diag([1.0, np.inf]))
    S = 1.0 + 1.0 + 1.0
    assert found.log_likelihood == 0.0
    both = -0.5 * (4.0 / S + np.log(2 * np.pi * S)) - 0.5 * np.log(2 * np.pi)
    assert found.log_likelihood_diffuse == pytest.approx(both, rel=EXACT)
    assert found.nis[1] == pytest.approx(4.0 / S, rel=EXACT)
    assert np.isnan(found.nis[2])
