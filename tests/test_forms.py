"""Numerical forms of the filter: one filter in exact arithmetic, different ones in rounding and cost."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs import forms, kalman
from ctlabs.models import DiscreteModel
from tests import reference
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import discrete_models, record

WALK = DiscreteModel(
    [[1, 1], [0, 1]], [[0.25, 0.5], [0.5, 1.0]], [[1, 0]], [[2]], x0=[0, 1], P0=[[4, 1], [1, 3]], offset=[0.1, 0.0]
)
Z = [[np.nan], [1.0], [2.5], [np.nan], [4.0], [5.5]]


def tame(model):
    """A model that the forms take: no N, R diagonal."""
    return dataclasses.replace(model, N=None, R=model.R * np.eye(model.m))


@settings(deadline=None, max_examples=40, derandomize=True)
@given(model=discrete_models(), seed=st.integers(0, 10**6))
def test_all_forms_are_one_filter(model, seed):
    """Every form gives the estimates and covariances of the textbook's recursion."""
    model = tame(model)
    z = record(model, 4, np.random.default_rng(seed))
    wanted = reference.recursion(model, z)
    for form in forms.FORMS:
        found = forms.run(model, z, form)
        assert close(found.P_plus, wanted.P_plus, SOLVER), form
        assert close(found.x_plus, wanted.x_plus, SOLVER), form


def test_the_forms_agree_with_filterpy_and_with_sixty_digits():
    """With gaps and a known input; the reference is that of the tests' own multiprecision recursion."""
    wanted, high, own = kalman.filter_runs(WALK, Z), reference.high_precision(WALK, Z), forms.reference(WALK, Z)
    assert close(own.P_plus, high.P_plus, EXACT)
    assert close(own.x_plus, high.x_plus, EXACT)
    for form in forms.FORMS:
        found = forms.run(WALK, Z, form)
        assert close(found.P_plus, wanted.schedule.P_plus, EXACT)
        assert close(found.x_plus, wanted.x_plus[:, :, 0], EXACT)
        assert not close(
            found.P_plus, forms.run(dataclasses.replace(WALK, Qd=broken(WALK.Qd, (1, 1))), Z, form).P_plus, SOLVER
        )


@pytest.mark.parametrize("form", forms.FORMS)
def test_perfect_measurements_and_singular_starts(form):
    """R = 0, P0 = 0 and a second perfect measurement of the same thing are legal: K = 0 there, no 0/0."""
    twice = dataclasses.replace(
        WALK, H=[[1, 0], [1, 0]], R=np.zeros((2, 2)), P0=np.zeros((2, 2)), offset=None, measurements=None
    )
    z = np.ones((4, 2))
    found, wanted = forms.run(twice, z, form), kalman.filter_runs(twice, z)
    assert close(found.P_plus, wanted.schedule.P_plus, EXACT)
    assert close(found.x_plus, wanted.x_plus[:, :, 0], EXACT)
    absent = dataclasses.replace(WALK, R=[[np.inf]])
    assert close(forms.run(absent, Z, form).P_plus, kalman.schedule(absent, 5).P_plus, EXACT)
    assert close(forms.run(WALK, Z, form, first=0).x_plus[0], WALK.x0, EXACT)


def test_the_short_form_loses_what_the_others_keep():
    """A sensor 10⁻¹³ as uncertain as the prediction: the short form keeps 3 digits of the variance, UD all."""
    fine = dataclasses.replace(WALK, R=[[1e-12]])
    short, joseph, potter, ud = forms.compare(fine, Z)
    assert short.error_variance[0] > 1e-6
    assert max(joseph.error_variance[0], ud.error_variance[0]) < EXACT
    assert potter.error_variance[0] < 1e-7
    assert max(form.error_P for form in (joseph, potter, ud)) < EXACT
    assert all((form.error_x < 1e-10).all() for form in (short, joseph, potter, ud))


@settings(deadline=None, max_examples=10, derandomize=True)
@given(n=st.integers(1, 4), seed=st.integers(0, 100))
def test_operations_are_counted_whatever_their_values(n, seed):
    """The count of the short form is the sum over its products, and does not depend on the numbers."""
    rng = np.random.default_rng(seed)
    model = DiscreteModel(rng.normal(size=(n, n)), np.eye(n), rng.normal(size=(1, n)), [[1]], np.zeros(n), np.eye(n))
    dot = 2 * n - 1
    predict = n * dot + 2 * n * n * dot + n * n
    update = 2 * dot + 2 * n * dot + 2 + n + 2 * n * n + 2 * n
    assert forms.flops(model, "conventional") == predict + update
    assert forms.flops(model, "joseph") > forms.flops(model, "conventional")


def test_a_variance_that_should_vanish_is_judged_by_what_is_left():
    """After perfect measurements rounding of the size 1e-16 in a square root is no loss, 1e-16 in P is."""
    exact = dataclasses.replace(WALK, R=[[0.0]])
    potter, short = forms.compare(exact, Z, ["potter", "conventional"])
    assert potter.error_variance[0] < EXACT
    left = np.abs(forms.run(exact, Z, "conventional").P_plus[:, 0, 0])[[1, 2, 4, 5]].max()
    assert short.error_variance[0] >= np.sqrt(left / 10)


def test_a_chosen_few_are_compared():
    """compare takes names, in their order."""
    assert [c.name for c in forms.compare(WALK, Z, ["ud", "joseph"])] == ["ud", "joseph"]


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        ({}, (Z, "cholesky"), "form: expected one of conventional, joseph, potter, ud, received 'cholesky'"),
        ({}, ([[1.0, 2.0]], "ud"), r"z: expected shape \(steps\+1, 1\), received \(1, 2\)"),
        ({"N": [[0.01], [0.02]]}, (Z, "ud"), "model: expected uncorrelated noises"),
        (
            {"H": np.eye(2), "R": [[2, 1], [1, 2]], "measurements": None},
            (np.ones((3, 2)), "ud"),
            "model: expected uncorrelated noises",
        ),
    ],
)
def test_what_the_forms_cannot_do_is_refused(change, arguments, message):
    """Unknown names, wrong shapes, correlated noises."""
    with pytest.raises(ValueError, match=message):
        forms.run(dataclasses.replace(WALK, **change), *arguments)
