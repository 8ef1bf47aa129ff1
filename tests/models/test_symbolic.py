"""Closed forms: the practicum's answers come out exactly, and numbers put into them are those of the numerical library."""

from __future__ import annotations

from typing import Any

import latex2mathml.converter
import numpy as np
import pytest
import sympy
from numpy.typing import NDArray

from ctlabs.linalg.factors import factor, unit_triangular
from ctlabs.models import ContinuousModel, symbolic
from ctlabs.models.discretisation import interval
from tests.reference import EXACT, broken, close
from tests.strategies import covariance

Array = NDArray[Any]

sigma_w, tau, a, b, q, r, zeta = sympy.symbols("sigma_w tau a b q r zeta", positive=True)
omega, T = sympy.symbols("omega T")  # without assumptions, as a user types them


def same(found: Any, expected: Any) -> bool:
    """Whether two expressions, or matrices of them, are equal as functions."""
    found, expected = ([m] if isinstance(m, sympy.Expr) else m for m in (found, expected))
    difference = sympy.Matrix(found) - sympy.Matrix(expected)
    return all(sympy.simplify(element) == 0 for element in difference)


# The exact answers of the practicum


def test_lab_3_comes_out_exactly() -> None:
    """Φ, Q_d, G_d, Q̄_d and Ḡ_d of velocity = constant + Brownian motion, with the sheet's closed forms."""
    chain = symbolic.chain([[0, 1], [0, 0]], [[0], [1]], [[sigma_w**2]], tau)
    s = chain.s
    assert same(chain.resolvent, [[1 / s, 1 / s**2], [0, 1 / s]])
    assert same(chain.Phi, [[1, tau], [0, 1]])
    assert same(chain.Qd, sigma_w**2 * sympy.Matrix([[tau**3 / 3, tau**2 / 2], [tau**2 / 2, tau]]))
    assert same(chain.unit_lower, [[1, 0], [3 / (2 * tau), 1]])
    assert same(chain.diagonal, [sigma_w**2 * tau**3 / 3, sigma_w**2 * tau / 4])
    root = sympy.Matrix([[sympy.sqrt(tau**3 / 3), 0], [sympy.sqrt(3 * tau / 4), sympy.sqrt(tau) / 2]])
    assert same(chain.standardised, sigma_w * root)
    assert not same(chain.Qd, sigma_w**2 * sympy.Matrix([[1.05 * tau**3 / 3, tau**2 / 2], [tau**2 / 2, tau]]))


def test_lab_4_comes_out_exactly() -> None:
    """The same for acceleration, three states."""
    chain = symbolic.chain([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [0], [1]], [[sigma_w**2]], tau)
    t = tau
    Qd = [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]
    assert same(chain.Phi, [[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]])
    assert same(chain.Qd, sigma_w**2 * sympy.Matrix(Qd))
    assert same(chain.unit_lower, [[1, 0, 0], [5 / (2 * t), 1, 0], [10 / (3 * t**2), 4 / t, 1]])
    assert same(chain.diagonal, [sigma_w**2 * v for v in (t**5 / 20, t**3 / 48, t / 9)])
    assert same(chain.standardised * chain.standardised.T, chain.Qd)


def test_roots_simplify_for_symbols_without_assumptions() -> None:
    """√(σ²τ) is σ√τ for the caller's own plain symbols, which the results contain."""
    sigma, t = sympy.symbols("sigma t")
    chain = symbolic.chain([[0]], [[1]], [[sigma**2]], t)
    assert chain.standardised[0, 0] == sigma * sympy.sqrt(t)
    assert chain.Qd.free_symbols == {sigma, t}


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_random_walk_chain_of_any_order_has_its_closed_form(order: int) -> None:
    """A chain of integrators has Q_d[i, j] = q τ^{…}/(…): the general formula of the sheets."""
    F = sympy.Matrix(order, order, lambda i, j: int(j == i + 1))
    G = sympy.Matrix(order, 1, lambda i, _: int(i == order - 1))
    chain = symbolic.chain(F, G, [[q]])

    def element(i: int, j: int) -> Any:
        p, k = order - 1 - i, order - 1 - j
        power = p + k + 1
        return q * sympy.Symbol("tau", positive=True) ** power / (sympy.factorial(p) * sympy.factorial(k) * power)

    assert same(chain.Qd, sympy.Matrix(order, order, element))


def test_a_real_system_has_real_closed_forms() -> None:
    """An oscillator gives sin and cos, a damped one e^{−ζωτ} with them, without i."""
    w = sympy.Symbol("omega", positive=True)
    chain = symbolic.chain([[0, 1], [-(w**2), 0]], [[0], [1]], [[q]], tau)
    assert same(
        chain.Phi, [[sympy.cos(w * tau), sympy.sin(w * tau) / w], [-w * sympy.sin(w * tau), sympy.cos(w * tau)]]
    )
    assert same(chain.Qd[1, 1], q * (tau / 2 + sympy.sin(2 * w * tau) / (4 * w)))
    damped = symbolic.chain([[0, 1], [-(w**2), -2 * zeta * w]], [[0], [1]], [[q]], tau)
    wd = w * sympy.sqrt(1 - zeta**2)
    assert same(damped.Phi[0, 1], sympy.exp(-zeta * w * tau) * sympy.sin(wd * tau) / wd)
    for matrix in (chain.Phi, chain.Qd, damped.Phi, damped.Qd):
        assert not matrix.has(sympy.I)


def test_clohessy_wiltshire() -> None:
    """Lab 18: the transition matrix of a circular orbit, F² ≠ 0 with a double zero mode."""
    w, r0 = sympy.symbols("w r0", positive=True)
    F = [[0, 1, 0, 0], [3 * w**2, 0, 0, 2 * r0 * w], [0, 0, 0, 1], [0, -2 * w / r0, 0, 0]]
    c, s = sympy.cos(w * tau), sympy.sin(w * tau)
    expected = [
        [4 - 3 * c, s / w, 0, 2 * r0 * (1 - c) / w],
        [3 * w * s, c, 0, 2 * r0 * s],
        [6 * (s - w * tau) / r0, -2 * (1 - c) / (w * r0), 1, (4 * s - 3 * w * tau) / w],
        [6 * w * (c - 1) / r0, -2 * s / r0, 0, 4 * c - 3],
    ]
    chain = symbolic.chain(F, [[0], [1], [0], [0]], [[0]], tau)
    assert same(chain.Phi, expected)
    assert not any(chain.Qd)
    assert chain.unit_lower == sympy.eye(4)


# Numbers put into the closed forms

SYSTEMS: dict[str, tuple[Any, Any, Any, dict[str, float]]] = {
    "integrators": ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [0], [1]], [[q]], {"q": 2.0}),
    "lab 8": ([[-a, 1], [0, -1 / T]], [[0], [1]], [[q]], {"a": 1.0, "T": 0.1, "q": 100.0}),
    "ladder": ([[-2, 1], [1, -1]], [[1], [0]], [[2]], {}),
    "oscillator": ([[0, 1], [-(omega**2), 0]], [[0], [1]], [[q]], {"omega": 2.0, "q": 3.0}),
    "damped": ([[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [1]], [[q]], {"omega": 2.0, "zeta": 0.3, "q": 3.0}),
    "overdamped": ([[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [1]], [[q]], {"omega": 2.0, "zeta": 1.7, "q": 3.0}),
    "triple pole": ([[-1, 1, 0], [0, -1, 1], [0, 0, -1]], [[0], [0], [1]], [[2]], {}),
    "diagonal": (sympy.diag(-a, -b), [[1, 0], [0, 1]], [[q, q / 2], [q / 2, r]], {"a": 1.0, "b": 0.3, "q": 2.0, "r": 3.0}),
    "unstable": ([[a, 0.5], [0, 0]], [[1, 0], [0, 1]], [[1, 0], [0, q]], {"a": 0.4, "q": 0.2}),
    "two oscillators alike": (
        [[0, 1, 0, 0], [-4, 0, 1, 0], [0, 0, 0, 1], [0, 0, -4, 0]], [[0], [0], [0], [1]], [[1]], {},
    ),
    "singular": ([[0, 1], [0, 0]], [[1], [0]], [[q]], {"q": 2.0}),
}  # fmt: skip


@pytest.mark.parametrize(("F", "G", "Q", "values"), SYSTEMS.values(), ids=SYSTEMS)
def test_the_closed_forms_are_what_discretise_computes(F: Any, G: Any, Q: Any, values: dict[str, float]) -> None:
    """Φ, Q_d, the unit triangular factors and the noise factor agree with the numerical ones."""
    chain = symbolic.chain(F, G, Q, tau)
    numbers = chain.evaluate(tau=0.7, **values)
    step = interval(numbers.F, numbers.G @ numbers.Q @ numbers.G.T, 0.7)
    L, d = unit_triangular(numbers.Qd)
    assert close(numbers.Phi, step.Phi, EXACT)
    assert close(numbers.Qd, step.Qd, EXACT)
    assert close(numbers.standardised @ numbers.standardised.T, step.Qd, EXACT)
    assert close(numbers.unit_lower, L, 1e-9)
    assert close(numbers.diagonal, d, 1e-9)
    assert close(numbers.standardised, factor(numbers.Qd), 1e-9)
    wrong = interval(broken(numbers.F) if numbers.F.any() else numbers.F, numbers.G @ numbers.Q @ numbers.G.T, 0.7)
    assert not close(numbers.Phi, wrong.Phi, 1e-4)
    for equation in chain.latex():
        assert latex2mathml.converter.convert(equation).startswith("<math")


def test_numbers_are_exact_fractions() -> None:
    """0.3 in a matrix is 3/10, in arrays too, and the period may be a number."""
    chain = symbolic.chain(np.array([[-0.3]]), [[1]], [[0.1]], 0.5)
    assert chain.Phi[0, 0] == sympy.exp(-sympy.Rational(3, 20))
    assert chain.evaluate().Phi[0, 0] == pytest.approx(np.exp(-0.15), rel=EXACT)


# The filter written out


def autopilot() -> symbolic.SymbolicModel:
    """Lab 13 with symbols: a second-order autopilot and an unknown constant command."""
    c1, c2, k1, k2, N_c, N_m = sympy.symbols("c1 c2 k1 k2 N_c N_m", positive=True)
    return symbolic.SymbolicModel(
        F=[[-c1, 1, k1], [-c2, 0, k2], [0, 0, 0]], G=[[k1], [k2], [0]], Q=[[N_c]], H=[[1, 0, 0]], Rc=[[N_m]],
        states=("h", "x2", "h_c0"),
    )  # fmt: skip


def test_lab_13_has_three_estimate_and_six_riccati_equations() -> None:
    """The scalar equations, element by element, equal the matrix equations at random numbers."""
    model = autopilot()
    found = symbolic.scalar_equations(model)
    texts = found.latex()
    assert {kind: len(lines) for kind, lines in texts.items()} == {"estimate": 3, "gain": 3, "riccati": 6}
    assert texts["gain"][0] == r"K_{1} = \frac{P_{11}}{N_{m}}"
    assert texts["estimate"][2] == r"\dot{\hat{h_{c0}}} = K_{3} \left(- \hat{h} + z\right)"
    assert texts["riccati"][5] == r"\dot{P}_{33} = - \frac{P_{13}^{2}}{N_{m}}"
    rng = np.random.default_rng(1)
    P = covariance(rng, 3)
    at = {symbol: rng.uniform(0.5, 2.0) for symbol in (model.F.free_symbols | {model.Q[0, 0], model.Rc[0, 0]})}
    at |= {found.P[i, j]: P[i, j] for i in range(3) for j in range(3)}
    F, G, Q, Rc = (np.array(m.subs(at), dtype=float) for m in (model.F, model.G, model.Q, model.Rc))
    H = np.array([[1.0, 0.0, 0.0]])
    rate = F @ P + P @ F.T + G @ Q @ G.T - P @ H.T @ np.linalg.inv(Rc) @ H @ P
    assert close(np.array(found.riccati.subs(at), dtype=float), rate, EXACT)
    assert close(np.array(found.gain.subs(at), dtype=float), P @ H.T / Rc, EXACT)
    assert not close(np.array(found.riccati.subs(at), dtype=float), broken(rate), EXACT)
    for lines in texts.values():
        for line in lines:
            assert latex2mathml.converter.convert(line).startswith("<math")


def test_scalar_equations_of_a_numerical_model_with_inputs_and_correlated_noise() -> None:
    """A ContinuousModel with B, N and two measurements: K = (PHᵀ+GN)Rc⁻¹ and the estimate with u and z."""
    rng = np.random.default_rng(2)
    Rc, N = covariance(rng, 2), 0.3 * rng.normal(size=(1, 2))
    model = ContinuousModel(
        rng.normal(size=(2, 2)), rng.normal(size=(2, 1)), [[3.0]], rng.normal(size=(2, 2)), Rc=Rc, N=N,
        B=rng.normal(size=(2, 1)), P0=np.eye(2),
    )  # fmt: skip
    found = symbolic.scalar_equations(model)
    P, x, z, u, K = covariance(rng, 2), rng.normal(size=2), rng.normal(size=2), 0.7, rng.normal(size=(2, 2))
    at = {found.P[i, j]: P[i, j] for i in range(2) for j in range(2)}
    gain = (P @ model.H.T + model.G @ N) @ np.linalg.inv(Rc)
    rate = model.F @ P + P @ model.F.T + model.G @ model.Q @ model.G.T - gain @ Rc @ gain.T
    assert close(np.array(found.gain.subs(at), dtype=float), gain, EXACT)
    assert close(np.array(found.riccati.subs(at), dtype=float), rate, EXACT)
    at = dict(zip([*found.x, *found.z, *found.u, *found.K], [*x, *z, u, *K.ravel()], strict=True))
    assert model.B is not None
    estimate = model.F @ x + model.B[:, 0] * u + K @ (z - model.H @ x)
    assert close(np.array(found.estimate.subs(at), dtype=float)[:, 0], estimate, EXACT)


@pytest.mark.parametrize("correlated", [False, True])
def test_block_equations_are_the_augmented_riccati_equation(correlated: bool) -> None:
    """P1, P12, P2 and both gains in blocks equal those of the augmented state, at random matrices of any size."""
    rng = np.random.default_rng(3)
    n, p, m = 3, 2, 2
    A, G, A_w, C = rng.normal(size=(n, n)), rng.normal(size=(n, p)), rng.normal(size=(p, p)), rng.normal(size=(m, n))
    P, R, N = covariance(rng, n + p), covariance(rng, m), rng.normal(size=(p, m)) * correlated
    Q = covariance(rng, p)
    F, H = np.block([[A, G], [np.zeros((p, n)), A_w]]), np.hstack([C, np.zeros((m, p))])
    GN, W = np.vstack([np.zeros((n, m)), N]), np.zeros((n + p, n + p))
    W[n:, n:] = Q
    gain = (P @ H.T + GN) @ np.linalg.inv(R)
    rate = F @ P + P @ F.T + W - gain @ R @ gain.T
    equations = symbolic.block_equations(correlated=correlated)
    given = {
        "A": A,
        "G": G,
        "A_w": A_w,
        "C": C,
        "Q_0": Q,
        "R": R,
        "P_1": P[:n, :n],
        "P_12": P[:n, n:],
        "P_2": P[n:, n:],
    }
    found = equations.evaluate(**given, **({"N_0": N} if correlated else {}))
    assert close(found["K1"], gain[:n], EXACT)
    assert close(found["K2"], gain[n:], EXACT)
    assert close(found["P1"], rate[:n, :n], EXACT)
    assert close(found["P12"], rate[:n, n:], EXACT)
    assert close(found["P2"], rate[n:, n:], EXACT)
    wrong = equations.evaluate(**(given | {"A": broken(A)}), **({"N_0": N} if correlated else {}))
    assert not close(wrong["P1"], rate[:n, :n], 1e-6)
    assert len(equations.latex()) == 7
    for equation in equations.latex():
        assert latex2mathml.converter.convert(equation).startswith("<math")


# Refusals


def test_what_has_no_closed_form_is_refused() -> None:
    """An irreducible cubic is named instead of printing Cardano's formula."""
    with pytest.raises(ValueError, match=r"linear and quadratic factors, received the factor s\*\*3 \+ s - 1"):
        symbolic.chain([[0, 1, 0], [0, 0, 1], [1, -1, 0]], [[0], [0], [1]], [[1]])


def test_values_that_do_not_fit_are_refused() -> None:
    """A missing symbol, an unknown name, and equal time constants in a formula for different ones."""
    chain = symbolic.chain([[-a, 1], [0, -b]], [[0], [1]], [[1]], tau)
    with pytest.raises(
        ValueError, match=r"values: expected a number for each of \['a', 'b', 'tau'\], received \['a'\]"
    ):
        chain.evaluate(a=1.0)
    with pytest.raises(ValueError, match=r"received .*'c'"):
        chain.evaluate(a=1.0, b=2.0, c=1.0, tau=1.0)
    with pytest.raises(ValueError, match="values: expected values at which the closed form is defined"):
        chain.evaluate(a=1.0, b=1.0, tau=1.0)


@pytest.mark.parametrize(
    ("F", "G", "Q", "error", "message"),
    [
        ([[0, 1]], [[1]], [[1]], ValueError, "expected a square F"),
        ([[0]], [[1], [0]], [[1]], ValueError, r"G: expected shape \(1, 'free'\), received \(2, 1\)"),
        ([[0]], [[1]], [[1, 0], [0, 1]], ValueError, r"Q: expected shape \(1, 1\), received \(2, 2\)"),
        (np.eye(2), np.eye(2), [[1, 2], [3, 4]], ValueError, "a symmetric Q"),
        ([["__import__('os')"]], [[1]], [[1]], TypeError, "F: expected finite numbers or sympy expressions"),
        ([[np.nan]], [[1]], [[1]], TypeError, "F: expected finite numbers"),
        ([[True]], [[1]], [[1]], TypeError, "received True"),
        (3, [[1]], [[1]], ValueError, "F: expected a matrix, received 3"),
        ([[1, 2], [3]], [[1]], [[1]], ValueError, "F: expected rows of one length"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(F: Any, G: Any, Q: Any, error: type[Exception], message: str) -> None:
    """Shapes, asymmetry and elements that are neither numbers nor expressions; text is never evaluated."""
    with pytest.raises(error, match=message):
        symbolic.chain(F, G, Q)


def test_models_that_do_not_fit_are_refused() -> None:
    """Without Rc, with a singular one, with too few names, or no model at all, there are no equations."""
    with pytest.raises(ValueError, match="Rc: expected the strength"):
        symbolic.scalar_equations(ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]]))
    with pytest.raises(ValueError, match="Rc: expected an invertible matrix"):
        symbolic.scalar_equations(symbolic.SymbolicModel([[0]], [[1]], [[1]], [[1]], [[0]]))
    with pytest.raises(ValueError, match="one name per state"):
        symbolic.SymbolicModel([[0]], [[1]], [[1]], [[1]], [[1]], states=("x", "y"))
    with pytest.raises(TypeError, match="model: expected a SymbolicModel or a ContinuousModel, received a int"):
        symbolic.scalar_equations(3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="matrices: expected"):
        symbolic.block_equations().evaluate(A=np.eye(2))
