"""The two kinds of models: two types, checked once, read-only, with names; what they refuse; how they show themselves."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from ctlabs.models import ContinuousModel, DiscreteModel, at
from tests.reference import broken
from tests.strategies import continuous_models, discrete_models

properties = settings(deadline=None, max_examples=30, derandomize=True)
inf, nan = np.inf, np.nan


def continuous(**changes: Any) -> ContinuousModel:
    """Position and speed, one noise, one measurement, one known input."""
    given: dict[str, Any] = {
        "F": [[0, 1], [0, -2]], "G": [[0], [1]], "Q": [[3]], "H": [[1, 0]], "Rc": [[4]], "P0": np.eye(2), "B": [[0], [1]],
    }  # fmt: skip
    return ContinuousModel(**(given | changes))


def discrete(**changes: Any) -> DiscreteModel:
    """Two states, two measurements."""
    given: dict[str, Any] = {
        "Phi": [[1, 0.5], [0, 1]], "Qd": np.eye(2), "H": np.eye(2), "R": np.eye(2), "x0": [0, 0], "P0": np.eye(2), "dt": 0.5,
    }  # fmt: skip
    return DiscreteModel(**(given | changes))


def test_dimensions_and_defaults() -> None:
    """n, s, m come from the matrices; x0 is zero, states x1, x2, measurements z1, units empty unless given."""
    model = continuous()
    assert (model.n, model.s, model.m) == (2, 1, 1)
    assert model.x0.tolist() == [0, 0]
    assert (model.states, model.measurements, model.units) == (("x1", "x2"), ("z1",), ("", ""))
    named = discrete(states=["a", "b"], measurements=("p", "q"), units=["m", "m/s"])
    assert (named.n, named.m, named.dt) == (2, 2, 0.5)
    assert (named.states, named.measurements, named.units) == (("a", "b"), ("p", "q"), ("m", "m/s"))


@properties
@given(continuous_models(stable=None), discrete_models(stable=None))
def test_models_are_frozen_and_their_arrays_read_only(first: ContinuousModel, second: DiscreteModel) -> None:
    """Neither a field nor an element of an array can be assigned, x0 by default included."""
    for model in (first, second, continuous()):
        for field in fields(model):
            value = getattr(model, field.name)
            with pytest.raises(FrozenInstanceError):
                setattr(model, field.name, value)
            if isinstance(value, np.ndarray):
                assert value.dtype == np.float64
                assert not value.flags.writeable
        with pytest.raises((AttributeError, TypeError)):
            model.another = 1  # type: ignore[union-attr]  # refused


@properties
@given(discrete_models(stable=None))
def test_replace_changes_one_matrix_and_checks_again(model: DiscreteModel) -> None:
    """replace() keeps the others, bit for bit; a change that does not fit is refused like a new model."""
    changed = replace(model, Phi=2 * model.Phi)
    assert np.array_equal(changed.Phi, 2 * model.Phi)
    for name in ("Qd", "H", "R", "x0", "P0"):
        assert np.array_equal(getattr(changed, name), getattr(model, name))
    assert changed.states == model.states
    with pytest.raises(ValueError, match=r"^P0: expected variances >= 0"):
        replace(model, P0=-np.eye(model.n))


def test_models_share_no_memory_with_what_they_were_given() -> None:
    """Changing the original afterwards changes no model."""
    P0 = np.eye(2)
    model = discrete(P0=P0)
    P0[0, 0] = 100
    assert model.P0[0, 0] == 1


def test_horizon_is_the_number_of_steps() -> None:
    """None for a constant model; steps of Phi, Qd, offset; one less than the entries of H and R."""
    three = [np.eye(2)] * 3
    assert discrete().horizon is None
    assert discrete(offset=[1, 2]).horizon is None
    for name in ("Phi", "Qd"):
        assert discrete(**{name: three}).horizon == 3
    for name in ("H", "R"):
        assert discrete(**{name: three}).horizon == 2
    assert discrete(offset=np.zeros((4, 2))).horizon == 4
    assert discrete(Phi=three, R=[np.eye(2)] * 4).horizon == 3


def test_entry_of_a_matrix_that_may_vary() -> None:
    """A constant matrix at every k, otherwise the k-th."""
    constant, varying = np.eye(2), np.arange(12.0).reshape(3, 2, 2)
    assert at(constant, 7, 2) is constant
    assert np.array_equal(at(varying, 2, 2), varying[2])


def test_a_cross_term_must_be_possible() -> None:
    """[[Q, N], [Nᵀ, R]] is a covariance: |N| ≤ √(QR), at equality the noises are one; 5 % more is refused."""
    limit = np.sqrt(3 * 4)
    assert continuous(N=[[limit]]).N[0, 0] == limit
    with pytest.raises(ValueError, match=r"^\[\[Q, N\], \[N', R\]\]: expected a nonnegative definite matrix"):
        continuous(N=broken([[limit]]))
    assert discrete(N=np.eye(2)).N.tolist() == [[1, 0], [0, 1]]
    with pytest.raises(ValueError, match=r"^\[\[Q, N\], \[N', R\]\]: expected a nonnegative definite matrix"):
        discrete(N=1.05 * np.eye(2))


def test_a_cross_term_is_checked_at_every_step() -> None:
    """w_k goes with v_k: one too small Qd or R among the steps is found, the R after the last step is free."""
    N = 0.9 * np.eye(2)
    small, one = 0.5 * np.eye(2), np.eye(2)
    assert discrete(N=N, Qd=[one, one]).horizon == 2
    assert discrete(N=N, Qd=[one, one], R=[one, one, small]).horizon == 2
    for changes in ({"Qd": [one, small]}, {"R": [one, small, one]}, {"Qd": [one, small], "R": [one, one, one]}):
        with pytest.raises(ValueError, match="expected a nonnegative definite matrix"):
            discrete(N=N, **changes)


def test_an_absent_measurement_correlates_with_nothing() -> None:
    """R = ∞ asks for a zero column in N."""
    R = np.diag([inf, 1.0])
    assert discrete(R=R, N=[[0, 0.5], [0, 0.1]]).m == 2
    with pytest.raises(ValueError, match=r"^N: expected 0 in the column of an absent measurement, received \[\["):
        discrete(R=R, N=[[0.5, 0], [0, 0]])


REFUSED: dict[str, tuple[Any, str]] = {
    "F not square": (lambda: continuous(F=[[0, 1]]), r"^F: expected a square matrix, received shape \(1, 2\)$"),
    "F flat": (lambda: continuous(F=[0, 1]), r"^F: expected shape \(n, n\), received \(2,\)$"),
    "G": (lambda: continuous(G=[[0, 1]]), r"^G: expected shape \(2, s\), received \(1, 2\)$"),
    "Q of another size": (lambda: continuous(Q=np.eye(2)), r"^Q: expected shape \(1, 1\), received \(2, 2\)$"),
    "Q negative": (lambda: continuous(Q=[[-1]]), r"^Q: expected variances >= 0 on the diagonal, received -1$"),
    "H": (lambda: continuous(H=[[1]]), r"^H: expected shape \(m, 2\), received \(1, 1\)$"),
    "Rc": (lambda: continuous(Rc=np.eye(2)), r"^Rc: expected shape \(1, 1\), received \(2, 2\)$"),
    "Rc infinite": (lambda: continuous(Rc=[[inf]]), r"^Rc: expected finite numbers, received inf at \[0, 0\]$"),
    "P0 asymmetric": (lambda: continuous(P0=[[1, 0.5], [0, 1]]), r"^P0: expected a symmetric matrix, received one with asymmetry 0.5$"),
    "P0 indefinite": (lambda: continuous(P0=[[1, 2], [2, 1]]), r"^P0: expected a nonnegative definite matrix"),
    "x0": (lambda: continuous(x0=[1]), r"^x0: expected shape \(2,\), received \(1,\)$"),
    "B": (lambda: continuous(B=[[1]]), r"^B: expected shape \(2, r\), received \(1, 1\)$"),
    "N without Rc": (lambda: continuous(Rc=None, N=[[1]]), r"^N: expected Rc beside it .* received None$"),
    "N": (lambda: continuous(N=[[1, 2]]), r"^N: expected shape \(1, 1\), received \(1, 2\)$"),
    "states": (lambda: continuous(states=["a"]), r"^states: expected 2 names, received \['a'\]$"),
    "Phi": (lambda: discrete(Phi=np.eye(3)), r"^x0: expected shape \(3,\), received \(2,\)$"),
    "Phi not square": (
        lambda: discrete(Phi=[np.ones((2, 3))]),
        r"^Phi: expected shape \(3, 3\) or \(steps, 3, 3\), received \(1, 2, 3\)$",
    ),
    "NaN": (lambda: discrete(Phi=[[nan, 0], [0, 1]]), r"^Phi: expected finite numbers, received nan at \[0, 0\]$"),
    "Qd": (lambda: discrete(Qd=[[1, 0.3], [0, 1]]), r"^Qd: expected a symmetric matrix"),
    "one Qd of many": (lambda: discrete(Qd=[np.eye(2), -np.eye(2)]), r"^Qd: expected variances >= 0 on the diagonal, received -1$"),
    "discrete H": (lambda: discrete(H=[1, 0]), r"^H: expected shape \(m, 2\) or \(steps\+1, m, 2\), received \(2,\)$"),
    "R": (lambda: discrete(R=[[1]]), r"^R: expected shape \(2, 2\) or \(steps\+1, 2, 2\), received \(1, 1\)$"),
    "dt": (lambda: discrete(dt=0), r"^dt: expected a number > 0, received 0$"),
    "offset": (lambda: discrete(offset=[1]), r"^offset: expected shape \(2,\) or \(steps, 2\), received \(1,\)$"),
    "spans": (
        lambda: discrete(Phi=[np.eye(2)] * 3, R=[np.eye(2)] * 3),
        r"^matrices that vary: expected one number of steps, received \{'Phi': 3, 'R': 2\}$",
    ),
    "units": (lambda: discrete(units="m"), r"^units: expected 2 names, received 'm'$"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(case: tuple[Any, str]) -> None:
    """The matrix, what was expected and what was received."""
    call, message = case
    with pytest.raises(ValueError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_a_model_shows_itself_as_equations() -> None:
    """LaTeX and a table with every matrix that is there and none that is not; a varying one by its first entry."""
    latex = continuous()._repr_latex_()
    assert latex.startswith("$$F = \\begin{bmatrix} 0 & 1 \\\\ 0 & -2 \\end{bmatrix}")
    assert latex.endswith("$$")
    for letter in ("B = ", "G = ", "Q = 3", "H = ", "R_c = 4", "P_0 = "):
        assert letter in latex
    assert "N = " not in latex
    shown = discrete(Phi=[2 * np.eye(2), 3 * np.eye(2)])._repr_latex_()
    assert r"\Phi = \begin{bmatrix} 2 & 0 \\ 0 & 2 \end{bmatrix}" in shown
    html = discrete(R=np.diag([inf, 1]))._repr_html_()
    assert html.startswith("<table><caption>DiscreteModel</caption>")
    assert html.count("<tr>") == 6
    assert "inf" in html
    assert r"\infty" in discrete(R=np.diag([inf, 1]))._repr_latex_()
