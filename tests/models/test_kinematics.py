"""Integrators in a row and the units of their models: closed forms, pint as the judge of dimensions, labs 3 and 4."""

from __future__ import annotations

import ast
import itertools
import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pint
import pytest
from ctlabs.tasks import task03_wiener_velocity as lab3
from ctlabs.tasks import task04_wiener_acceleration as lab4
from ctlabs.tasks.answers import kinematics as by_hand
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.filtering import steady
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import covariances
from ctlabs.linalg.factors import factor, unit_triangular
from ctlabs.models import ContinuousModel, kinematics, observability
from ctlabs.models.discretisation import discretise
from ctlabs.models.kinematics import Unit
from tests.reference import EXACT, SOLVER, broken, close, recursion

pytestmark = pytest.mark.numerical

QUICK = settings(deadline=None, max_examples=40, derandomize=True)
UREG = pint.UnitRegistry()
P0 = np.array([[100.0, 3.0, 0.5], [3.0, 10.0, 0.2], [0.5, 0.2, 1.0]])


def model(n: int, strength: float = 1.3) -> ContinuousModel:
    return kinematics.integrators(n, strength, P0=P0[:n, :n] if n <= 3 else np.eye(n))


# The models -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("tau", [0.01, 1.0, 30.0])
def test_sampled_integrators_have_the_closed_forms_of_powers(n: int, tau: float) -> None:
    """Φ is τᵏ/k! and Qd the integral of products of such powers: element by element for the orders of the labs."""
    sampled = discretise(model(n), tau, [[1.0]])
    Phi = [[tau ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(n)] for i in range(n)]
    Qd = by_hand.spread(n, 1.3, tau)
    assert close(sampled.Phi, Phi, EXACT)
    assert close(sampled.Qd, Qd, EXACT)
    assert not close(sampled.Qd, broken(Qd), 1e-3)
    if n <= 3:
        assert np.allclose(sampled.Qd, Qd, rtol=EXACT, atol=0)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_constant_and_the_brownian_motion_add_up_to_the_last_state(n: int) -> None:
    """The filter with c and β apart gives for c + β, and for the rest, what the filter of their sum gives."""
    whole = discretise(model(n), 0.7, [[2.0]])
    apart = discretise(kinematics.with_constant(model(n)), 0.7, [[2.0]])
    add = np.hstack([np.eye(n), np.eye(n)[:, -1:]])
    one, two = covariances(whole, 12), covariances(apart, 12)
    assert close(add @ two.P_plus @ add.T, one.P_plus, SOLVER)
    assert close(add @ two.K, one.K, SOLVER)
    wrong = covariances(replace(apart, Qd=1.05 * apart.Qd), 12)
    assert not close(add @ wrong.P_plus @ add.T, one.P_plus, 1e-4)


@pytest.mark.parametrize("n", [2, 3])
def test_the_constant_alone_is_not_observable(n: int) -> None:
    """All but the direction c − β is seen, and later measurements leave the variance of c where it is."""
    apart = kinematics.with_constant(model(n))
    seen = observability.analyse(apart)
    assert seen.rank == n
    assert not seen.detectable
    assert close(np.abs(seen.unobservable[:, 0]), [*np.zeros(n - 1), math.sqrt(0.5), math.sqrt(0.5)], EXACT)
    variance = covariances(discretise(apart, 1.0, [[1.0]]), 80).P_plus[:, n - 1, n - 1]
    assert (np.diff(variance) <= EXACT).all()
    assert variance[-1] > 0.99 * variance[40] > 0


def test_integrators_refuse_what_is_none() -> None:
    """A number of integrators below 1, a negative strength, a model that is no chain."""
    with pytest.raises(ValueError, match="n: expected a whole number >= 1"):
        kinematics.integrators(0, 1.0, P0=[[1]])
    with pytest.raises(ValueError, match="Q: expected variances >= 0"):
        kinematics.integrators(1, -1.0, P0=[[1]])
    with pytest.raises(ValueError, match="model: expected integrators in a row"):
        kinematics.with_constant(ContinuousModel([[-1]], [[1]], [[1]], [[1]], P0=[[1]]))


# Units ----------------------------------------------------------------------------------------------------------------


def dimensions(unit: Unit) -> dict[str, int]:
    """A unit as pint writes dimensions."""
    powers = {"[length]": unit.metre, "[time]": unit.second}
    return {name: int(power) for name, power in powers.items() if power}


def agrees(quantity: pint.Quantity, unit: Unit) -> bool:
    return dict(quantity.dimensionality) == dimensions(unit)


powers = st.integers(-6, 6)


@QUICK
@given(powers, powers, powers, powers)
def test_units_are_those_of_pint(a: int, b: int, c: int, d: int) -> None:
    """Text, product, quotient and power mean what pint means by them; reading a unit's text gives the unit."""
    first, second = Unit(a, b), Unit(c, d)
    for unit in (first, first * second, first / second, first**2):
        assert agrees(1 * UREG.parse_units("dimensionless" if str(unit) == "1" else str(unit)), unit)
        assert Unit.parse(str(unit)) == unit
    assert agrees((UREG.m**a * UREG.s**b) / (UREG.m**c * UREG.s**d) * UREG.Quantity(1), first / second)
    assert close(
        kinematics.converted(2.5, first, 1000.0, 3600.0),
        (2.5 * UREG.m**a * UREG.s**b).to(UREG.km**a * UREG.h**b).m,
        EXACT,
    )


@pytest.mark.parametrize("text", ["deg", "m//s", "m/s/s", "kg", "m^", "m-", "m/", "/s", "ms", "1/m·s", "m/(s"])
def test_a_text_that_is_no_unit_is_refused(text: str) -> None:
    """Only products of metres and seconds are read."""
    with pytest.raises(ValueError, match="unit: expected powers of m and s"):
        Unit.parse(text)


def test_units_may_have_fractional_powers() -> None:
    """σ_w itself is m/s^(3/2); a radian and no text at all are pure numbers."""
    root = Unit.parse("m²·s^-3") ** Fraction(1, 2)
    assert root == Unit(1, Fraction(-3, 2))
    assert Unit.parse(str(root)) == root
    assert str(Unit.parse("") * Unit.parse("rad")) == "1"


def pint_model(n: int) -> tuple[list[list[pint.Quantity]], list[list[pint.Quantity]], pint.Quantity, pint.Quantity]:
    """Φ and Qd by the sheet's formulas, τ and R, as quantities with units; every zero has the unit of its place."""
    tau, R = 0.7 * UREG.s, 2.0 * UREG.m**2
    strength = 1.3 * UREG.m**2 / UREG.s ** (2 * n - 1)
    Phi = [
        [tau ** (j - i) / math.factorial(j - i) if j >= i else 0 / tau ** (i - j) for j in range(n)] for i in range(n)
    ]
    order = [n - 1 - i for i in range(n)]
    Qd = [
        [strength * tau ** (i + j + 1) / (math.factorial(i) * math.factorial(j) * (i + j + 1)) for j in order]
        for i in order
    ]
    return Phi, Qd, tau, R


def pint_update(
    P: list[list[pint.Quantity]], R: pint.Quantity
) -> tuple[list[pint.Quantity], list[list[pint.Quantity]]]:
    """K and P⁺ element by element; pint refuses to add unlike quantities."""
    S = P[0][0] + R
    K = [row[0] / S for row in P]
    return K, [[P[i][j] - K[i] * P[0][j] for j in range(len(P))] for i in range(len(P))]


def pint_predict(
    P: list[list[pint.Quantity]], Phi: list[list[pint.Quantity]], Qd: list[list[pint.Quantity]]
) -> list[list[pint.Quantity]]:
    n = range(len(P))
    return [[sum((Phi[i][a] * P[a][b] * Phi[j][b] for a in n for b in n), Qd[i][j]) for j in n] for i in n]


@pytest.mark.parametrize("n", [2, 3])
def test_the_table_of_units_is_that_of_dimensional_analysis(n: int) -> None:
    """Every quantity of labs 3 and 4, computed with units by pint, has the unit of the table and the library's number."""
    table, (Phi, Qd, tau, R) = kinematics.units(model(n)), pint_model(n)
    library = discretise(model(n), 0.7, [[2.0]])
    P = [[P0[i, j] * UREG.m**2 / UREG.s ** (i + j) for j in range(n)] for i in range(n)]
    for _ in range(3):
        P = pint_predict(P, Phi, Qd)
        K, P = pint_update(P, R)
    lower = [[Qd[i][j] * 0 / Qd[j][j] for j in range(n)] for i in range(n)]
    d, rest = [], [list(row) for row in Qd]
    for j in range(n):
        d.append(rest[j][j])
        for i in range(j, n):
            lower[i][j] = rest[i][j] / d[j]
        rest = [
            [rest[a][b] - lower[a][j] * d[j] * lower[b][j] if min(a, b) > j else rest[a][b] for b in range(n)]
            for a in range(n)
        ]
    standardised = [[lower[i][j] * d[j] ** 0.5 for j in range(n)] for i in range(n)]
    plan, (L, variances) = covariances(library, 3), unit_triangular(library.Qd)
    elements = {"Phi": (Phi, library.Phi), "Qd": (Qd, library.Qd), "P": (P, plan.P_plus[3]), "Gd": (lower, L)}
    elements["Gd_standardised"] = (standardised, factor(library.Qd))
    for name, (found, number) in elements.items():
        for i, j in itertools.product(range(n), range(n)):
            assert agrees(found[i][j].to_base_units(), table[name][i][j]), (name, i, j)
            assert math.isclose(found[i][j].to_base_units().m, number[i, j], rel_tol=1e-9, abs_tol=1e-12), (name, i, j)
    for i in range(n):
        assert agrees(d[i], table["Qd_diagonal"][i])
        assert agrees(K[i], table["K"][i][0])
        assert math.isclose(d[i].m, variances[i], rel_tol=1e-9)
        assert math.isclose(K[i].m, plan.K[3, i, 0], rel_tol=1e-9)
    assert agrees(tau, table["t"])
    assert agrees(R, table["R"][0][0])
    assert agrees(1.3 * UREG.m**2 / UREG.s ** (2 * n - 1), table["Q"][0][0])
    assert not agrees(lower[1][0], table["Gd"][0][1])


def test_pint_refuses_a_formula_with_a_wrong_power() -> None:
    """The dimensional analysis can fail: with τ² for τ³ in the first element the prediction adds unlike quantities."""
    Phi, Qd, tau, _ = pint_model(2)
    Qd[0][0] = Qd[0][0] / tau
    P = [[UREG.Quantity(1.0, "m²") / UREG.s ** (i + j) for j in range(2)] for i in range(2)]
    with pytest.raises(pint.DimensionalityError):
        pint_predict(P, Phi, Qd)


@QUICK
@given(st.integers(1, 4), st.floats(0.1, 10), st.floats(0.1, 10), st.floats(0.05, 5))
def test_other_units_change_the_numbers_as_the_table_says(n: int, metre: float, second: float, tau: float) -> None:
    """Discretisation and filter commute with a change of units; a wrong exponent is noticed."""
    source = model(n)
    table, other = kinematics.units(source), kinematics.rescaled(source, metre, second)
    here = covariances(discretise(source, tau, [[2.0]]), 4)
    there = covariances(discretise(other, tau / second, [[2.0 / metre**2]]), 4)
    assert close(there.P_plus[4], kinematics.converted(here.P_plus[4], table["P"], metre, second), SOLVER)
    assert close(there.K[4], kinematics.converted(here.K[4], table["K"], metre, second), SOLVER)
    if n > 1 and abs(math.log(second)) > 0.1:
        wrong = [[Unit()], *table["K"][1:-1], [table["K"][-1][0] * Unit(0, 1)]]
        found = kinematics.converted(here.K[4], wrong, metre, second)
        assert not math.isclose(there.K[4, -1, 0], found[-1, 0], rel_tol=1e-3)


def test_units_that_do_not_fit_are_refused() -> None:
    """A measurement of metres plus metres per second, a noise on both, and matrices whose units nothing determines."""
    both = {"P0": np.eye(2), "units": ["m", "m/s"]}
    with pytest.raises(ValueError, match="H: expected states of one unit"):
        kinematics.units(ContinuousModel(np.eye(2, k=1), [[0], [1]], [[1]], [[1, 1]], **both))
    with pytest.raises(ValueError, match="G: expected states of one unit"):
        kinematics.units(ContinuousModel(np.eye(2, k=1), [[1], [1]], [[1]], [[1, 0]], **both))
    with pytest.raises(ValueError, match="neither N nor B"):
        kinematics.rescaled(
            ContinuousModel(np.eye(2, k=1), [[0], [1]], [[1]], [[1, 0]], B=[[0], [1]], **both), 2.0, 2.0
        )
    plane = ContinuousModel(
        np.zeros((2, 2)), np.eye(2), np.eye(2), np.eye(2), P0=np.eye(2), Rc=np.eye(2), units=["m", "m/s"]
    )
    table = kinematics.units(plane)
    assert [[str(u) for u in row] for row in table["Rc"]] == [["m²·s", "m²"], ["m²", "m²/s"]]
    assert close(kinematics.rescaled(plane, 2.0, 1.0).Rc, np.eye(2) / 4, EXACT)


# The second route of labs 3 and 4 -------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.sampled_from([2, 3]), st.floats(-9, 9), st.floats(-2, 2))
def test_the_spectral_factorisation_is_the_riccati_solution(n: int, ratio: float, period: float) -> None:
    """Steady covariances and gain from the poles equal python-control's solution, element by element, for any ρ and τ."""
    tau, R = 10.0**period, 2.0
    strength = 10.0**ratio * R / tau ** (2 * n - 1)
    limit = steady.solve(discretise(kinematics.integrators(n, strength, P0=np.eye(n)), tau, [[R]]))
    prior, posterior, gain = by_hand.steady_state(n, strength, tau, R)
    for found, expected in ((limit.P_minus, prior), (limit.P_plus, posterior), (limit.K[:, 0], gain)):
        assert np.allclose(found, expected, rtol=SOLVER, atol=0)
    assert not np.allclose(limit.P_minus, by_hand.steady_state(n, 1.05 * strength, tau, R)[0], rtol=1e-4, atol=0)


@QUICK
@given(st.floats(-9, 9))
def test_alpha_and_beta_are_the_poles_gains(ratio: float) -> None:
    """The two equations of lab 3 and the spectral factorisation give the same gains."""
    rho = 10.0**ratio
    assert close(lab3.by_hand.alpha_beta(rho, 1.0), by_hand.steady_state(2, rho, 1.0, 1.0)[2], SOLVER)


@pytest.mark.parametrize("n", [2, 3])
def test_perfect_measurements_are_the_limit_of_good_ones(n: int) -> None:
    """R = 0 continues R → 0 (n = 2: α = 1, β = 3 − √3), and σ_w² = 0 has the limit 0."""
    exact = by_hand.steady_state(n, 1.0, 1.0, 0.0)
    near = by_hand.steady_state(n, 1.0, 1.0, 1e-12)
    assert all(close(a, b, 1e-9) for a, b in zip(exact, near, strict=True))
    if n == 2:
        assert close(exact[2], [1.0, 3 - math.sqrt(3)], EXACT)
        assert lab3.by_hand.alpha_beta(1.0, 0.0) == [1.0, 3 - math.sqrt(3)]
    assert not any(part.any() for part in by_hand.steady_state(n, 0.0, 1.0, 1.0))


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize(("strength", "R"), [(1.3, 2.0), (0.0, 2.0), (1.3, 0.0)])
def test_arrays_and_least_squares_are_the_textbook_filter(n: int, strength: float, R: float) -> None:
    """Square-root arrays, and one least squares problem, give the covariances of the plain recursion."""
    system = discretise(kinematics.integrators(n, strength, P0=P0[:n, :n]), 0.7, [[R]])
    plain = recursion(system, np.zeros((9, 1)))
    found = list(itertools.islice(by_hand.filtered(system.Phi, factor(system.Qd), R, P0[:n, :n]), 8))
    assert close([P for _, P in found], plain.P_plus[1:], SOLVER)
    assert not close([P for _, P in found], broken(plain.P_plus[1:]), 1e-4)
    if R:
        now, start = by_hand.least_squares(system.Phi, factor(system.Qd), R, P0[:n, :n], 8)
        assert close(now, plain.P_plus[8], SOLVER)
        apart = discretise(kinematics.with_constant(kinematics.integrators(n, strength, P0=P0[:n, :n])), 0.7, [[R]])
        assert math.isclose(start[-1, -1], covariances(apart, 8).P_plus[8, n - 1, n - 1], rel_tol=SOLVER)


@pytest.mark.parametrize("n", [2, 3])
def test_the_polynomial_through_the_last_measurements_bounds_the_filter(n: int) -> None:
    """Whatever P0, from measurement n on no variance exceeds that of the backward differences."""
    bound = np.diag(by_hand.backward_differences(n, 1.3, 0.7, 2.0))
    for scale in (0.0, 1.0, 1e8):
        system = discretise(kinematics.integrators(n, 1.3, P0=scale * np.eye(n)), 0.7, [[2.0]])
        variances = np.diagonal(covariances(system, 40).P_plus, axis1=1, axis2=2)
        assert (variances[n:] <= bound * (1 + SOLVER)).all()
    assert (variances[n - 1] > bound).any()


def test_the_sheets_own_numbers() -> None:
    """The values the sheets give for the default parameters."""
    velocity = lab3.by_hand.analytic(lab3.Parameters())
    acceleration = lab4.by_hand.analytic(lab4.Parameters())
    assert np.allclose(velocity["gain_steady"], [0.756738, 0.493216], atol=5e-7)
    assert math.isclose(velocity["posterior_covariance_steady"][1, 1], 1.034294, abs_tol=5e-7)
    assert np.allclose(acceleration["gain_steady"], [0.864663, 0.797614, 0.367882], atol=5e-7)
    assert (velocity["settling_step"], acceleration["settling_step"]) == (5, 6)
    assert velocity["alpha_beta"] == pytest.approx([0.756738, 0.493216], abs=5e-7)


def test_the_second_route_knows_nothing_of_the_library() -> None:
    """The answers by hand import numpy, scipy and the standard library alone; shared modules are no labs."""
    tree = ast.parse(Path(by_hand.__file__).read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= {"itertools", "math", "numpy", "scipy"}
    assert not [lab for lab in labs.catalogue().values() if lab.module.rpartition(".")[2].startswith("_")]
