"""Riccati and Lyapunov equations: cases with known answers, numbers of others, other units, and twins with proved digits."""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from threadpoolctl import threadpool_limits

from ctlabs.filtering import bucy, steady
from ctlabs.linalg import loops, manyfold, riccati, undriven
from ctlabs.linalg.checks import Array
from ctlabs.linalg.lyapunov import Operator, prove
from ctlabs.linalg.manyfold import Manyfold, solve
from ctlabs.linalg.staircase import hidden
from ctlabs.linalg.updating import updated
from ctlabs.models import ContinuousModel, DiscreteModel, observability, shaping
from ctlabs.models.discretisation import discretise, interval
from tests import cases, twins
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import seeds

pytestmark = pytest.mark.numerical

CASES = [
    case
    for pattern in ("k1_[cdot]*", "k1_scalar*", "k1_slycot*", "k2_ins*", "k2_two*", "k2_heading_weak", "k9_no_warning_[il]*")
    for case in cases.numerics(pattern)
]


def asked(case: cases.Case) -> DiscreteModel | ContinuousModel:
    """The model of a case, discretised where the case says so."""
    model = cases.model(case["model"])
    if isinstance(model, ContinuousModel) and model.Rc is None:
        return discretise(model, case["given"]["dt"], R=case["given"]["R"])
    return model


def limit(model: DiscreteModel | ContinuousModel) -> dict[str, Any]:
    """What the verb for the model's kind gives, under the names of the cases."""
    if isinstance(model, DiscreteModel):
        found = steady.solve(model)
        names = ("P_minus", "P_plus", "K", "K_pred", "S", "error")
        answer = {name: getattr(found, name) for name in names} | {"largest_pole": np.abs(found.poles).max(initial=0.0)}
        answer |= {"sd_minus": np.sqrt(np.diag(found.P_minus)), "sd_plus": np.sqrt(np.diag(found.P_plus))}
    else:
        found = bucy.steady(model)
        answer = {"P": found.P, "K": found.K, "error": found.error, "sd": np.sqrt(np.diag(found.P))}
    return answer | {"poles": np.column_stack([found.poles.real, found.poles.imag])}


def agrees(found: dict[str, Any], right: dict[str, Any], tolerance: dict[str, str]) -> None:
    """Every quantity that has a tolerance, within it."""
    for name in right.keys() & tolerance.keys() & found.keys():
        value, wanted = np.asarray(found[name]), right[name]
        if name == "poles":  # conjugate pairs come in either order
            value, wanted = (rows[np.lexsort(rows.T[::-1])] for rows in (value, np.array(wanted)))
            wanted = wanted.tolist()
        cases.near(value, wanted, tolerance[name])


@pytest.mark.parametrize("fold", [2, 4])
def test_compiled_arithmetic_is_the_same_to_the_bit(fold: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Products, sums and elimination by loops, compiled or not, and by numpy: of many magnitudes, with zeros, of other folds, singular."""
    rng = np.random.default_rng(8)

    def random(rows: int, columns: int, fold: int) -> Manyfold:
        M = Manyfold.of(rng.standard_normal((rows, columns)) * np.exp2(rng.integers(-30, 30, (rows, 1))), fold)
        for k in range(1, fold):
            M = M + rng.standard_normal((rows, columns)) * 2.0 ** (-53 * k)
        return M * 0.75 - np.eye(rows, columns)

    some = [(random(r, k, fold), random(k, c, other)) for r, k, c in ((1, 1, 3), (4, 3, 2), (2, 4, 4)) for other in (1, fold)]
    square = [(random(n, n, fold), random(n, m, other)) for n, m in ((1, 2), (4, 3)) for other in (1, fold)]
    some += [(A * 0.0, B) for A, B in some[:1]]

    def answers() -> list[bytes]:
        found = [X for A, B in some for X in (A @ B, B.T @ A.T, A + A * 0.3, 1.0 - A)] + [solve(A, B) for A, B in square]
        with pytest.raises(np.linalg.LinAlgError, match="Singular"):
            solve(Manyfold.of(np.zeros((2, 2)), fold), Manyfold.of(np.eye(2), fold))
        return [np.array(X.parts).tobytes() for X in found]

    compiled = answers()
    with monkeypatch.context() as patch:
        for kernel in ("distilled", "slices", "product", "increased", "collected", "eliminated"):
            patch.setattr(loops, kernel, getattr(loops, kernel).py_func)
        assert answers() == compiled
        patch.setattr(manyfold, "_compiled", lambda: None)
        assert answers() == compiled
        patch.setattr(manyfold, "_sum", lambda a, b: (a + b, 0 * a))
        assert answers() != compiled


@pytest.mark.parametrize("case", CASES)
def test_known_limits(case: cases.Case) -> None:
    """Quiet and loud sensors, slow clocks, weakly driven modes: the right value, and a bound of a last digit or two."""
    found = limit(asked(case))
    agrees(found, case["right"], case["tolerance"])
    assert found["error"] < 1e-12


def test_one_model_in_many_units() -> None:
    """The same digits in every system of units: states, measurement and time by powers of ten."""
    (case,) = (parameter.values[0] for parameter in cases.numerics("k1_one_model_many_units"))
    model, right = cases.model(case["model"]), np.array(case["right"]["P"])
    assert isinstance(model, ContinuousModel)
    units = case["given"]
    some = [(a, b, c) for a in units["states"] for b in units["measurement"] for c in units["time"]]
    for a, b, c in some[:: 7 if len(some) > 100 else 1]:
        x, z, t = 10.0 ** (a - np.arange(3) * c), 10.0**b, 10.0**c
        other = replace(
            model, F=model.F * x[:, None] / x / t, G=model.G * x[:, None] / t, Q=model.Q * t, H=z * model.H / x, Rc=model.Rc * z**2 * t
        )
        assert np.abs(bucy.steady(other).P / np.outer(x, x) / right - 1).max() < 1e-9


@pytest.mark.parametrize("continuous", [True, False])
def test_two_hundred_random_states_within_three_seconds(continuous: bool) -> None:
    """A full system: processor time of the verb in one thread, and a bound of a last digit or two."""
    rng, n, one = np.random.default_rng(1), 200, np.eye(200)
    F, H, W = rng.normal(size=(n, n)) / np.sqrt(n), rng.normal(size=(3, n)), rng.normal(size=(n, n))
    model: Any = DiscreteModel(0.9 * F, W @ W.T / n, H, np.eye(3), x0=np.zeros(n), P0=one)
    if continuous:
        model = ContinuousModel(F - 1.05 * one, one, W @ W.T / n, H, Rc=np.eye(3), P0=one)
    before = time.process_time()
    with threadpool_limits(1):
        assert limit(model)["error"] < 1e-14
    assert time.process_time() - before < 3


def test_a_mode_that_only_one_scaling_hides_is_seen() -> None:
    """An exchange of 1 and 1, in units in which it is 1e-13 and 1e13: below 1e-12 of A, and above it."""
    A, H = np.array([[-1.0, 1e-13], [1e13, -2.0]]), np.array([[1.0, 0.0]])
    assert hidden(A, H, 1e-12, 1e-12).shape == (2, 1)
    assert observability.never_seen(A, H, 1e-12).shape == (2, 0)
    hidden_mode = np.array([[-1.0, 0.0], [1e13, -2.0]])
    assert observability.never_seen(hidden_mode, H, 1e-12).shape == (2, 1)


def test_two_hundred_states() -> None:
    """A ring of 200: the closed form by Fourier's transform, also of the elements that are 1e-35."""
    (case,) = (parameter.values[0] for parameter in cases.numerics("k1_ring_200"))
    n, one = 200, np.eye(200)
    F = -2 * one + np.roll(one, 1, axis=0) + np.roll(one, -1, axis=0)
    P = bucy.steady(ContinuousModel(F=F, G=one, Q=one, H=one, Rc=one, P0=one)).P
    cases.near(P[0, :5], case["right"]["first_row"], case["tolerance"]["first_row"])
    assert abs(P[0, n // 2]) < 1e-10 * P[0, 0]


@pytest.mark.parametrize(
    "item",
    [
        item
        for name in ("carex", "darex", "riccati_continuous_printed", "riccati_discrete_printed", "gains")
        for item in cases.peers(name)
    ],
)
def test_numbers_of_others(item: dict[str, Any]) -> None:
    """The Riccati collections and printed gains; weights that are no covariance are refused."""
    expected = item.get("expected", {})
    if "refused" in expected:
        with pytest.raises(ValueError, match=r"expected"):
            limit(cases.model(item["model"]))
        return
    if any("lambda" in name for name in expected):
        pytest.skip("relations between the elements of a gain: tests/filtering/test_steady.py has them as closed forms")
    found = limit(cases.model(item["model"]))
    agrees(found, expected, item.get("tolerance") or {})
    if isinstance(item.get("reference"), dict):
        agrees(found, item["reference"], {"P": "norm 1e-13", "P_minus": "norm 1e-13"})
    assert found["error"] < 1e-9


@pytest.mark.slow
def test_four_hundred_and_twenty_one_states() -> None:
    """CAREX 4.4, a rotating axle."""
    (item,) = (parameter.values[0] for parameter in cases.peers("carex_4_4"))
    given, right, n = item["model"], item["expected"], item["model"]["n"]

    def full(elements: Any, rows: int, columns: int) -> Array:
        M = np.zeros((rows, columns))
        i, j, values = np.array(elements).T
        M[i.astype(int), j.astype(int)] = values
        return M

    F, G = full(given["F_sparse"], n, n), full(given["G_sparse"], n, given["noises"])
    H, one = full(given["H_sparse"], given["measurements"], n), np.eye(n)
    P = bucy.steady(ContinuousModel(F, G, np.diag(given["Q_diagonal"]), H, Rc=np.eye(given["measurements"]), P0=one)).P
    diagonal = np.array(right["P_diagonal"])
    assert np.abs(np.diag(P) / diagonal - 1).max() < 1e-9
    assert np.abs((P[0] - right["P_row_0"]) / np.sqrt(diagonal[0] * diagonal)).max() < 1e-9
    assert np.linalg.norm(P) == pytest.approx(right["P_norm"], rel=1e-9)


@pytest.mark.parametrize("item", cases.peers("lyapunov"))
def test_stationary_covariances_of_others(item: dict[str, Any]) -> None:
    """SLICOT's, Octave's, ControlSystems.jl's; an unstable matrix is refused."""
    model = cases.model(item["model"])
    A, Q = (model.F, model.G @ model.Q @ model.G.T) if isinstance(model, ContinuousModel) else (model.Phi, model.Qd)
    continuous = isinstance(model, ContinuousModel)
    if "refused" in item.get("expected", {}):
        with pytest.raises(ValueError, match="expected the solution of a stable matrix"):
            riccati.stationary(A, Q, continuous=continuous)
        return
    found = riccati.stationary(A, Q, continuous=continuous)
    cases.near(found.P.high, item["reference"]["P"], "norm 1e-13")
    agrees({"P": found.P.high}, item.get("expected", {}), item.get("tolerance") or {})


# --- one equation in other coordinates --------------------------------------------------------------------------------


def random_equation(rng: np.random.Generator, most: int = 8) -> tuple[Array, Array, Array, Array, bool]:
    """A, H, Q, R: chains, oscillators, stiff and full systems; noise over 12 decades, periods from 1e-6 to 1e6 s, mixed units."""
    n, m, continuous = int(rng.integers(1, most + 1)), int(rng.integers(1, 4)), bool(rng.integers(2))
    kind = rng.integers(5)
    if kind == 0:
        F = rng.normal(size=(n, n))
    elif kind == 1:
        F = np.diag(np.ones(n - 1), 1) + np.diag(rng.normal(size=n)) * rng.integers(2)
    elif kind == 2:
        F = np.diag(-(10.0 ** rng.uniform(-6, 2, n)))
    elif kind == 3:
        w, damping = 10.0 ** rng.uniform(-3, 3, n), 10.0 ** rng.uniform(-6, 0, n)
        F = scipy.linalg.block_diag(*[[[0, 1], [-(a**2), -2 * b * a]] for a, b in zip(w, damping, strict=True)])[:n, :n]
    else:
        F = rng.normal(size=(n, n))
        F = F - F.T - np.diag(10.0 ** rng.uniform(-8, 0, n))
    H = rng.normal(size=(m, n))
    Q, R = (scaled_covariance(rng, size, decades) for size, decades in ((n, 12), (m, 8)))
    if kind == 1 and rng.integers(2):
        Q = np.diag(np.r_[np.zeros(n - 1), 10.0 ** rng.uniform(-6, 6)])
    x = 10.0 ** rng.uniform(-6, 6, n) if rng.integers(2) else np.ones(n)
    F, H, Q = F * x / x[:, None], H * x, Q / np.outer(x, x)
    if not continuous:
        dt = 10.0 ** rng.uniform(-6, 6)
        dt = min(dt, 9 / max(np.linalg.eigvals(F).real.max(), 1e-9))
        F, Q, _ = interval(F, Q, dt)
    return F, H, Q, R, continuous


def scaled_covariance(rng: np.random.Generator, n: int, decades: float) -> Array:
    """Diagonal or correlated, variances over so many decades."""
    variance = 10.0 ** rng.uniform(-decades / 2, decades / 2, n)
    if rng.integers(2):
        return np.diag(variance)
    M = rng.normal(size=(n, n + 2))
    sd = np.sqrt(variance / np.diag(M @ M.T))
    Q: Array = (M @ M.T) * np.outer(sd, sd)
    return 0.5 * (Q + Q.T)


def test_twins_of_random_models() -> None:
    """Against doubling in ball arithmetic: never off by more than the bound, the bound below 1e-6, none refused; the median ratio."""
    ratios = []
    for i in range(60):
        A, H, Q, R, continuous = random_equation(np.random.default_rng([17, i]), most=8 if i % 10 == 0 else 3)
        found = riccati.solve(A, H, Q, R, continuous=continuous)
        right = twins.riccati(A, H, Q, R, continuous=continuous)
        off = twins.off(found.P.high, right)
        assert off <= found.error < 1e-6, i
        ratios.append(found.error / max(off, 1e-17))
        if not continuous and i % 4 == 0:
            after = updated(found, H, R)
            assert twins.off(after.P, twins.update(right, H, R)) <= after.error
    assert np.median(ratios) < 1e3


def test_a_bound_is_none_for_a_wrong_solution() -> None:
    """The twin tells a change in the smallest part of P by 1e-9 from the solution, and the bound would not hold for it."""
    A, H, Q, R, continuous = random_equation(np.random.default_rng([17, 3]))
    found = riccati.solve(A, H, Q, R, continuous=continuous)
    P = np.array(found.P.high)
    least = int(np.diag(P).argmin())
    P[least, least] *= 1 + 1e-9
    assert twins.off(P, twins.riccati(A, H, Q, R, continuous=continuous)) > 1e3 * found.error


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_permuted_states_and_other_units(seed: int) -> None:
    """The order of the states and powers of ten change nothing but the last digits; powers of 2 not even these."""
    rng = np.random.default_rng(seed)
    A, H, Q, R, continuous = random_equation(rng, most=5)
    found, n = riccati.solve(A, H, Q, R, continuous=continuous), len(A)
    sd = np.sqrt(np.diag(found.P.high))
    order, x, z = rng.permutation(n), 2.0 ** rng.integers(-30, 30, n), 2.0 ** rng.integers(-30, 30, len(H))
    there = riccati.solve(
        (A * x[:, None] / x)[np.ix_(order, order)],
        (H * z[:, None] / x)[:, order],
        (Q * np.outer(x, x))[np.ix_(order, order)],
        R * np.outer(z, z),
        continuous=continuous,
    )
    back = np.empty((n, n))
    back[np.ix_(order, order)] = there.P.high
    assert (np.abs(back / np.outer(x, x) - found.P.high) / np.outer(sd, sd)).max() <= 2 * (found.error + there.error)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_an_equivalent_basis(seed: int) -> None:
    """T P Tᵀ in the basis Tx; by whole numbers, so that the models are the same to the last digit."""
    rng = np.random.default_rng(seed)
    n = 3
    A, H, Q = (rng.integers(-3, 4, shape) / 4 for shape in ((n, n), (2, n), (n, n)))
    Q = Q @ Q.T + np.eye(n)
    T = np.eye(n) + np.triu(rng.integers(-2, 3, (n, n)), 1)
    inverse = np.round(np.linalg.inv(T))
    continuous = bool(rng.integers(2))
    P = riccati.solve(A, H, Q, np.eye(2), continuous=continuous).P.high
    there = riccati.solve(T @ A @ inverse, H @ inverse, T @ Q @ T.T, np.eye(2), continuous=continuous).P.high
    assert close(there, T @ P @ T.T, 1e-14)


def test_rounding_of_the_noise_input_is_not_part_of_the_answer() -> None:
    """CAREX 2.8, whose P changes by 1e5 times a change of GQGᵀ, is right for G and Q as they are given."""
    item = next(p.values[0] for p in cases.peers("carex") if p.id == "carex_2_8_eps1em6")
    cases.near(bucy.steady(cases.model(item["model"])).P, item["expected"]["P"], "norm 1e-14")


# --- what no noise drives --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weak", [1e-6, 1e-18, 1e-30])
def test_weak_is_not_none(weak: float) -> None:
    """A constant driven by however little beside a state driven by 1 has the variance that is right for it alone."""
    model = DiscreteModel(np.eye(2), np.diag([1.0, weak]), np.eye(2), np.eye(2), x0=[0, 0], P0=np.eye(2))
    P = steady.solve(model).P_minus
    assert P[1, 1] == pytest.approx((weak + np.sqrt(weak**2 + 4 * weak)) / 2, rel=1e-12, abs=0)


def test_what_is_rounding_of_its_own_terms_drives_nothing() -> None:
    """A constant in a basis where its noise is 1 − 1 to rounding: known exactly, to the rounding of the basis."""
    T = np.array([[1.0, 0.3], [0.7, -1.1]])
    Phi, Qd = T @ np.diag([0.5, 1.0]) @ np.linalg.inv(T), T @ np.diag([1.0, 0.0]) @ T.T
    found = undriven.without(Phi, Qd, continuous=False)
    assert len(found.known) == 1
    model = DiscreteModel(Phi, 0.5 * (Qd + Qd.T), np.array([[1.0, 2.0]]), [[1.0]], x0=[0, 0], P0=np.eye(2))
    P = np.linalg.inv(T) @ steady.solve(model).P_minus @ np.linalg.inv(T).T
    assert abs(P[1, 1]) < 1e-14 * P[0, 0]


def test_what_hardly_grows_or_decays_is_left_in() -> None:
    """Undriven, |λ| = 1 ± 1e-9: (λ² − 1)R/λ² + …, and 0; not zero for both."""
    grown = DiscreteModel([[1 + 1e-9]], [[0.0]], [[1.0]], [[1.0]], x0=[0], P0=[[1]])
    assert steady.solve(grown).P_plus[0, 0] == pytest.approx(1 - 1 / (1 + 1e-9) ** 2, rel=1e-6)
    assert steady.solve(replace(grown, Phi=[[1 - 1e-9]])).P_plus[0, 0] == 0


# --- one verdict -----------------------------------------------------------------------------------------------------


def heading(degrees: float, **changes: Any) -> DiscreteModel:
    """A range along a heading, of a position that wanders north and returns east."""
    (case,) = (parameter.values[0] for parameter in cases.numerics("k2_heading_90"))
    angle = np.deg2rad(degrees)
    return replace(cases.model(case["model"]), H=[[np.cos(angle), np.sin(angle)]], **changes)


@pytest.mark.parametrize("degrees", [90.0, 270.0, -90.0, 450.0])
@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-9])
def test_the_cosine_of_a_right_angle_measures_nothing(degrees: float, unit: float) -> None:
    """Rank 1, north alone named, and the same verdict of both verbs, whatever the unit of north is."""
    model, x = heading(degrees), np.array([unit, 1.0])
    model = replace(model, Phi=model.Phi, Qd=model.Qd / np.outer(x, x), P0=model.P0 / np.outer(x, x), H=model.H * x)
    seen = observability.analyse(model)
    assert (seen.rank, seen.undetectable_modes) == (1, ("eigenvalue 1 of the states north",))
    with pytest.raises(ValueError, match="eigenvalue 1 of the states north, which no measurement sees"):
        steady.solve(model)


def test_a_nanoradian_measures_something() -> None:
    """1e-9 rad off, north has a limit: both verbs say so."""
    model = heading(90 - np.rad2deg(1e-9))
    assert observability.analyse(model).detectable
    assert steady.solve(model).P_minus[0, 0] == pytest.approx(1.0002e7, rel=1e-4)


@pytest.mark.parametrize("dt", [1e-9, 1.0])
def test_a_mode_that_decays_slowly_needs_no_measurement(dt: float) -> None:
    """At a period of 1e-9 s its eigenvalue is 1 − 1e-10, and its stationary variance what it is at any other."""
    model = ContinuousModel(np.diag([-0.1, 0.0]), np.eye(2), np.eye(2), [[0, 1]], P0=np.eye(2))
    sampled = discretise(model, dt, R=[[1.0]])
    assert observability.analyse(sampled).detectable
    assert steady.solve(sampled).P_minus[0, 0] == pytest.approx(5.0, rel=1e-5)


@pytest.mark.parametrize("name", ["k9_jordan_chain_end", "k9_integrators_middle"])
def test_all_hidden_states_of_a_chain_are_named(name: str) -> None:
    """A Jordan block has one eigenvector and as many hidden states as it is long."""
    (case,) = (parameter.values[0] for parameter in cases.numerics(name))
    seen = observability.analyse(cases.model(case["model"]))
    assert seen.rank == case["right"]["rank"]
    (mode,) = seen.unobservable_modes
    assert mode.partition("states ")[2].split(", ") == case["right"]["hidden_states"]


@pytest.mark.parametrize("name", ["k9_odometer", "k9_singular_R_lag"])
def test_the_reduced_filter_is_named_where_a_perfect_measurement_makes_the_equation_singular(name: str) -> None:
    """A limit that is reached like 1/k has no stable filter: said so, without a raw error."""
    (case,) = (parameter.values[0] for parameter in cases.numerics(name))
    with pytest.raises(ValueError, match=r"^steady state: .*singular R .*reduced filter"):
        steady.solve(cases.model(case["model"]))


def test_two_states_of_one_name() -> None:
    """Labels are told apart where python-control wants them to be."""
    import control

    (case,) = (parameter.values[0] for parameter in cases.numerics("k9_two_states_one_name"))
    system = bucy.filter_system(cases.model(case["model"]))
    assert len(set(system.output_labels)) == len(set(system.state_labels)) == 2
    assert control.step_response(system).outputs.shape[0] == 2


def test_gramian_over_an_infinite_horizon() -> None:
    """The limit of finite ones; a mode that does not decay is named."""
    model = ContinuousModel([[-1, 0.5], [0, -2]], np.eye(2), np.eye(2), [[1, 1]], P0=np.eye(2))
    assert close(observability.gramian(model, np.inf), observability.gramian(model, 40.0), EXACT)
    sampled = discretise(model, 0.3, R=[[1.0]])
    assert close(observability.gramian(sampled, np.inf), observability.gramian(sampled, 400), EXACT)
    with pytest.raises(ValueError, match=r"^horizon: expected a finite one .* eigenvalue 0 of the states x1, x2"):
        observability.gramian(replace(model, F=[[-1, 0.5], [0, 0]]), np.inf)


# --- the parts -------------------------------------------------------------------------------------------------------


def whole(M: Manyfold) -> Array:
    """The sum of the parts, with all digits."""
    return sum((twins.exact(part) for part in M.parts[1:]), twins.exact(M.parts[0]))


@pytest.mark.parametrize("fold", [2, 4, 8])
def test_products_and_quotients_have_their_digits(fold: int) -> None:
    """Against mpmath, for rows of very different size: 53 bits for each part, less a few."""
    rng = np.random.default_rng(fold)
    with mpmath.workdps(200):
        A = Manyfold.of(rng.normal(size=(5, 7)) * 10.0 ** rng.uniform(-9, 9, (5, 1)), fold)
        A = A + A @ (rng.normal(size=(7, 7)) * 1e-17)
        B = rng.normal(size=(7, 4))
        off = np.abs(whole(A @ B) - whole(A) @ twins.exact(B)) / np.abs(A.high).max(axis=1)[:, None]
        assert off.max() < mpmath.mpf(2) ** (6 - 53 * fold)
        S = Manyfold.of(rng.normal(size=(4, 4)), fold)
        right = B.T[:, :2]
        off = np.abs(whole(S) @ whole(solve(S, Manyfold.of(right))) - twins.exact(right))
        assert off.max() < mpmath.mpf(2) ** (20 - 53 * fold)


@pytest.mark.parametrize("continuous", [True, False])
def test_a_proof_of_stability_is_none_of_an_unstable_matrix(continuous: bool) -> None:
    """A matrix within rounding of the boundary is proved stable, or not, and one beyond it never."""
    stable = np.array([[-1e-9]]) if continuous else np.array([[1 - 1e-9]])
    operator = Operator(stable, continuous=continuous)
    assert prove(operator, Manyfold.of(stable, 2), np.abs(stable)) is not None
    beyond = -stable if continuous else 2 - stable
    assert prove(operator, Manyfold.of(beyond, 2), np.abs(beyond)) is None
    with pytest.raises(ArithmeticError, match="expected a stable matrix"):
        Operator(np.array([[1.5]]) if not continuous else np.array([[0.0, 1.0], [0.0, 0.0]]), continuous=continuous)


def test_other_solvers_failures_and_warnings_stay_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever python-control raises (slycot's own exceptions among it) or warns of, the answer is the same."""
    import control

    class OwnError(Exception):
        pass

    def failing(*_: Any, **options: Any) -> Any:
        assert options["method"] == "scipy"
        warnings.warn("ill-conditioned", RuntimeWarning, stacklevel=2)
        raise OwnError

    A, H, Q, R, continuous = random_equation(np.random.default_rng(5))
    before = riccati.solve(A, H, Q, R, continuous=continuous)
    monkeypatch.setattr(control, "care", failing)
    monkeypatch.setattr(control, "dare", failing)
    after = riccati.solve(A, H, Q, R, continuous=continuous)
    assert np.abs(after.P.high / before.P.high - 1).max() < 1e-14
    assert not close(broken(after.P.high), before.P.high, SOLVER)


def test_stationary_covariance_has_its_digits_in_any_units() -> None:
    """A slow and a fast mode in units that differ by 1e12: the closed form."""
    model = ContinuousModel([[-1e-6, 0], [0, -1e6]], np.eye(2), np.diag([1e-12, 1e12]), [[1, 1]], P0=np.eye(2))
    assert shaping.stationary_covariance(model)[[0, 1], [0, 1]].tolist() == pytest.approx([5e-7, 5e5], rel=1e-15)
