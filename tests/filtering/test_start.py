"""Little or no information at the start, and perfect measurements: against conditioning in 400 digits and what others published."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ctlabs.analysis import budgets, diagnosis, fitting, sensitivity
from ctlabs.files import modelfile
from ctlabs.filtering import Smoothed, covariances, kalman_filter, log_likelihood, smooth
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.linalg import columns, rounding
from ctlabs.linalg.covariance import deviations
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.montecarlo import simulate
from tests import cases, twin_smoother
from tests.reference import EXACT, SOLVER, close

pytestmark = pytest.mark.numerical

SMOOTHED = [
    *(f"k2_{name}" for name in ("ma*", "arma*", "airline", "ima11", "varma11", "oscillator_ma1", "coloured_noise*")),
    "k2_one_of_two_perfect",
    *(f"k3_{name}" for name in ("acceleration*", "first*", "lagged*", "level*", "nile*", "trend*", "two*", "velocity*", "walk*")),
]
#: The forms that take R = 0, and those that do not.
PERFECT = [name for name in FORMS if name not in ("information", "srif", "extended_array", "steady")]
ALL = [name for name in FORMS if name != "steady"]
NAN = float("nan")


def taking(model):
    """The default route and every form that takes the model."""
    regular = all((np.linalg.eigvalsh(R) > 0).all() for R in model.R.reshape(-1, model.m, model.m))
    invertible = abs(np.linalg.det(model.Phi)) > 0
    return ["", *[name for name in (ALL if regular else PERFECT) if name != "information" or invertible]]


def filtered(model, z, first, form=""):
    return kalman_filter(model, z[first:], first=first, algorithm=form or "auto")


def known(P):
    """Standard deviations as the cases have them, those of the smallest doubles taken for zero."""
    sd = np.array(P, dtype=float)
    return np.where(sd < 1e-200, 0.0, sd)


def misses(found, right, rows, names):
    """The errors of estimates, of their σ, in units of the largest σ of the state."""
    (x, P), sd = found, known(right[names[1]])
    size = np.where(sd.max(axis=0) > 0, sd.max(axis=0), 1.0)
    return np.abs(x[rows] - np.array(right[names[0]])) / size, np.abs(deviations(P[rows]) - sd) / size


# Cases --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", [case for pattern in SMOOTHED for case in cases.numerics(pattern)])
def test_smoothed_estimates_are_right_whatever_the_form(case):
    """Moving averages observed exactly, unknown and vaguely known states: every form's history is smoothed rightly."""
    model, z, first, right = cases.model(case["model"]), cases.record(case["given"]), case["given"]["first"], case["right"]
    for form in taking(model):
        past = filtered(model, z, first, form)
        found = smooth(model, past)
        x, sd = misses((found.x, found.P), right, right["rows"], ("x", "sd"))
        limit = 1e-7 if "inf" in case["name"] else 1e-6
        if form in ("conventional", "") or "k3" in case["name"]:
            assert x.max() < limit, form
        assert sd.max() < (limit if form not in ("sequential", "ld", "conventional") else 2e-6), form
        if not ("k2" in case["name"] and form == "conventional"):
            assert past.log_likelihood == pytest.approx(right["log_likelihood"], abs=1e-8), form
        if "log_likelihood_diffuse" in right:
            assert past.log_likelihood_diffuse == pytest.approx(right["log_likelihood_diffuse"], abs=1e-8)
        if "x_plus" in right:
            x, sd = misses((past.x_plus, past.P_plus), right, right["filter_rows"], ("x_plus", "sd_plus"))
            assert max(x.max(), sd.max()) < 1e-7


@pytest.mark.parametrize("case", cases.numerics("k1_srif_units*"))
@pytest.mark.parametrize("form", ALL)
def test_no_form_depends_on_the_units_of_what_is_unknown(case, form):
    """A slow clock and a velocity in units 1e12 apart, from no information."""
    model, z, right = cases.model(case["model"]), cases.record(case["given"]), case["right"]
    found = kalman_filter(model, z, first=0, algorithm=form)
    sd = np.array(right["sd_plus"])
    assert (np.abs(found.x_plus[right["rows"]] - np.array(right["x_plus"])) < 1e-7 * sd).all()
    assert (np.abs(deviations(found.P_plus[right["rows"]]) / sd - 1) < 1e-7).all()
    assert found.log_likelihood == pytest.approx(right["log_likelihood"], abs=1e-7)


@pytest.mark.parametrize("case", cases.numerics("k3_likelihood*"))
def test_likelihoods_keep_their_digits(case):
    """P0 up to 1e21 times R."""
    model, z, right = cases.model(case["model"]), cases.record(case["given"]), case["right"]
    for form in taking(model):
        assert filtered(model, z, case["given"]["first"], form).log_likelihood == pytest.approx(
            right["log_likelihood"], abs=1e-8
        )
    assert log_likelihood(model, z[case["given"]["first"] :], case["given"]["first"]) == pytest.approx(right["log_likelihood"], abs=1e-8)


@pytest.mark.parametrize("item", cases.peers("likelihoods"))
def test_likelihoods_of_others(item):
    """KFAS, Koopman and the Nile; KFAS leaves out −½ ln 2π of the elements that determine something unknown."""
    given, expected = item["given"], item["expected"]
    data = cases.read(cases.PEERS / "likelihoods.json")["data"]
    z = cases.record({"z": data[given["z"]]} if isinstance(given["z"], str) else given)
    model, reference = cases.model(item["model"]), item["reference"]
    found = kalman_filter(model, z[given["first"] :], first=given["first"])
    assert found.log_likelihood == pytest.approx(reference["log_likelihood"], abs=1e-8)
    if "log_likelihood_diffuse" in reference:
        assert found.log_likelihood_diffuse == pytest.approx(reference["log_likelihood_diffuse"], abs=1e-8)
    if (printed := expected.get("log_likelihood_diffuse_without_2pi")) is not None:
        count = np.isinf(np.diag(model.P0)).sum()
        assert found.log_likelihood_diffuse + 0.5 * count * np.log(2 * np.pi) == pytest.approx(printed, abs=1e-6)
    if "P_minus" in expected:
        assert close(found.x_minus[1], expected["x_minus"], EXACT)
        assert close(found.P_minus[1], expected["P_minus"], EXACT)


def test_the_nile_from_no_information():
    """Durbin & Koopman's estimates, and their smoothed levels."""
    item = next(p.values[0] for p in cases.peers("likelihoods") if p.id == "nile")
    z, reference = cases.record(item["given"]), item["reference"]

    def build(c):
        return DiscreteModel([[1]], [[c["q"]]], [[1]], [[c["r"]]], x0=[0], P0=[[np.inf]])

    found = fitting.fit(build, z, {"q": 1000.0, "r": 10000.0}, {"q": (0, None), "r": (0, None)}, first=0, profiles=False)
    assert found.converged
    assert found.estimates == pytest.approx({"q": 1469.1, "r": 15099}, rel=1e-3)
    assert found.log_likelihood == pytest.approx(-632.5456, abs=1e-4)
    assert found.log_likelihood_diffuse == pytest.approx(reference["log_likelihood_diffuse"], abs=1e-4)
    model = cases.model(item["model"])
    smoothed = smooth(model, kalman_filter(model, z, first=0))
    assert close(smoothed.x[reference["smoothed_rows"], 0], reference["smoothed_x"], SOLVER)
    assert close(smoothed.P[reference["smoothed_rows"], 0, 0], reference["smoothed_P"], SOLVER)
    assert diagnosis.diagnose(model, kalman_filter(model, z, first=0)).verdict == "consistent"


@pytest.mark.parametrize("item", cases.peers("smoother"))
def test_the_continuous_smoother_is_the_limit(item):
    """Gelb's closed form, from samples 1 ms apart."""
    from ctlabs.models.discretisation import discretise

    given, model = item["given"], cases.model(item["model"])
    discrete = discretise(model, given["dt"], R=np.array(model.Rc) / given["dt"])
    z = np.zeros((given["steps"] + 1, 1))
    found = smooth(discrete, kalman_filter(discrete, z[given["first"] :], first=given["first"]))
    assert found.P[given["row"], 0, 0] == pytest.approx(item["expected"]["P"], abs=5e-3)


# Conditioning -------------------------------------------------------------------------------------------------------


@st.composite
def vague_models(draw):
    """A model of up to three states, some of them unknown, whose R, Qd and Φ may be singular, and a record with gaps."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    n, m = draw(st.integers(1, 3)), draw(st.integers(1, 2))
    Phi, H = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    if draw(st.booleans()):
        Phi[:, -1] = 0.0
    elif draw(st.booleans()):
        Phi = np.eye(n)
    if draw(st.booleans()):
        H[:, -1] = 0.0
    G, B = rng.normal(size=(n, draw(st.integers(0, n)))), rng.normal(size=(m, draw(st.integers(0, m))))
    N = None
    if G.size and B.size and draw(st.booleans()):
        C = rng.normal(size=(G.shape[1], B.shape[1]))
        N = 0.5 * G @ (C / np.linalg.norm(C, 2)) @ B.T
    unknown, C = rng.uniform(size=n) < 0.6, rng.normal(size=(n, n))
    P0 = np.where(unknown[:, None] | unknown, np.where(np.eye(n, dtype=bool), np.inf, 0.0), C @ C.T)
    z = rng.normal(size=(6, m))
    z[rng.uniform(size=z.shape) < 0.25] = NAN
    offset = rng.normal(size=n) if draw(st.booleans()) else None
    return DiscreteModel(Phi, G @ G.T, H, B @ B.T, x0=rng.normal(size=n), P0=P0, N=N, offset=offset), z


@settings(deadline=None, max_examples=60, derandomize=True)
@given(both=vague_models(), first=st.integers(0, 1), lag=st.integers(1, 3))
def test_what_is_unknown_and_what_is_exact_is_conditioned_on(both, first, lag):
    """Filter, smoother, lag-one covariances, fixed lag and likelihood, whatever is unknown, singular, perfect or missing."""
    model, z = both
    past = kalman_filter(model, z[first:], first=first)
    z = np.where(past.used, z, NAN)  # perfect measurements of what is known already agree with no random record
    twin, found = twin_smoother.conditioned(model, z, first), smooth(model, past)
    variances = np.diagonal(twin.P, axis1=1, axis2=2)
    size = max(variances[np.isfinite(variances)].max(initial=0.0), 1.0)
    scale = size**0.5 + np.abs(np.nan_to_num(twin.x)).max(initial=0.0)
    assume(size < 1e8)  # nearly undetermined
    same(found.x, twin.x, 1e-6 * scale)
    same(found.P, twin.P, 1e-6 * size)
    same(found.lag_one, twin.lag_one, 1e-6 * size)
    likelihood = log_likelihood(model, z[first:], first)  # of a record that contradicts nothing
    assert likelihood == pytest.approx(twin.log_likelihood, rel=1e-7, abs=1e-7)
    if not past.contradictions:
        assert past.log_likelihood_diffuse == pytest.approx(likelihood, rel=EXACT, abs=EXACT)
    behind = smooth(model, z[first:], first=first, lag=lag)
    k = 5 - lag
    short = twin_smoother.conditioned(model, z, first, end=k - 1 + lag)
    same(behind.x[k - 1], short.x[k - 1], 1e-6 * scale)
    same(behind.P[k - 1], short.P[k - 1], 1e-6 * max(size, np.where(np.isfinite(short.P), short.P, 0.0).max()))


def same(found, wanted, tolerance):
    assert np.array_equal(np.isfinite(found), np.isfinite(wanted))
    assert np.array_equal(np.isinf(found), np.isinf(wanted))
    there = np.isfinite(wanted)
    assert (np.abs(found[there] - wanted[there]) <= tolerance).all()


@settings(deadline=None, max_examples=25, derandomize=True)
@given(both=vague_models(), seed=st.integers(0, 1000))
def test_units_and_order_of_the_states_do_not_matter(both, seed):
    """States in other units, powers of 2 as far as 2^±40 apart, and in another order."""
    model, z = both
    rng = np.random.default_rng(seed)
    units, order = 2.0 ** rng.integers(-40, 40, size=model.n), rng.permutation(model.n)
    T = np.diag(units)[order]
    back, P0 = np.linalg.inv(T), np.where(np.isinf(model.P0), 0.0, model.P0)
    P0 = T @ P0 @ T.T + np.diag(np.where(np.isinf(np.diag(model.P0))[order], np.inf, 0.0))
    other = dataclasses.replace(
        model, Phi=T @ model.Phi @ back, Qd=T @ model.Qd @ T.T, H=model.H @ back, x0=T @ model.x0, P0=P0,
        N=None if model.N is None else T @ model.N, offset=None if model.offset is None else T @ model.offset,
    )  # fmt: skip
    own, theirs = (smooth(m, kalman_filter(m, z[1:])) for m in (model, other))
    variances = np.diagonal(own.P, axis1=1, axis2=2)
    size = max(variances[np.isfinite(variances)].max(initial=0.0), 1.0)
    assume(size < 1e8)
    same(theirs.x / units[order], own.x[:, order], 1e-6 * (size**0.5 + np.abs(np.nan_to_num(own.x)).max()))
    same(theirs.P / np.outer(units, units)[np.ix_(order, order)], own.P[:, order][:, :, order], 1e-6 * size)


LINE = DiscreteModel([[1, 1], [0, 1]], [[0.1, 0], [0, 0.2]], [[1, 0]], [[0.5]], x0=[7, 7], P0=np.diag([np.inf, np.inf]))
Z = np.array([[1.2], [NAN], [1.9], [4.4], [NAN], [9.6], [14.2]])


@pytest.mark.parametrize("size", [1e7, 1e10, 1e14, 1e20])
def test_no_information_is_the_limit_of_little(size):
    """The difference falls as 1/P0, and no rounding shows below it; x0 does not matter."""
    little = dataclasses.replace(LINE, P0=size * np.eye(2), x0=[0, 0])
    found, limit = (smooth(m, kalman_filter(m, Z, first=0)) for m in (little, LINE))
    assert close(found.x, limit.x, 50 / size + 1e-13)
    assert close(found.P, limit.P, 50 / size + 1e-13)
    one, other = (kalman_filter(m, Z, first=0) for m in (little, LINE))
    assert close(one.log_likelihood + np.log(size), other.log_likelihood_diffuse, 50 / size + 1e-13)


def test_an_exact_measurement_is_the_limit_of_a_good_one():
    """R → 0: the smoothed σ of a moving average's shock tends to that of R = 0, not to 0."""
    exact = DiscreteModel([[0, 0.9], [0, 0]], [[1, 1], [1, 1]], [[1, 0]], [[0]], x0=[0, 0], P0=[[1.81, 1], [1, 1]])
    z = np.random.default_rng(3).normal(size=(120, 1))
    right = smooth(exact, kalman_filter(exact, z, first=0))
    closed = 0.9**2 * (1 - 0.9**2) / (1 - 0.9 ** (2 * 121))
    assert right.P[0, 1, 1] == pytest.approx(closed, rel=1e-6)
    for R in (1e-6, 1e-9, 1e-12):
        good = smooth(near := dataclasses.replace(exact, R=[[R]]), kalman_filter(near, z, first=0))
        assert abs(good.P[0, 1, 1] - closed) < 20 * R + 1e-6 * closed
        assert np.abs(good.x[:, 1] - right.x[:, 1]).max() < 1e3 * R + 1e-6  # (1 − θ²)⁻² = 28 times the innovations


# Verbs --------------------------------------------------------------------------------------------------------------


def test_schedules_and_ensembles_begin_without_information():
    """filterpy's route is the compiled one's, gains and all; innovations of something unknown are NaN."""
    plan, found = covariances(LINE, 6, first=0, algorithm="filterpy"), kalman_filter(LINE, Z, first=0, algorithm="filterpy")
    own = kalman_filter(LINE, Z, first=0)
    assert np.isinf(plan.P_minus[0].diagonal()).all()
    assert np.isfinite(plan.P_plus[1:]).all()
    assert np.isnan(found.x_minus[0]).all()
    assert np.isnan(found.innovation[[0, 1, 2]]).all()
    for theirs, ours in ((found.x_plus, own.x_plus), (found.P_plus, own.P_plus)):
        assert np.array_equal(np.isfinite(theirs), np.isfinite(ours))
        assert close(np.where(np.isfinite(theirs), theirs, 0.0), np.where(np.isfinite(ours), ours, 0.0), EXACT)
    again = kalman_filter(LINE, np.stack([Z, 2 * Z], axis=2), first=0, algorithm="filterpy", gains=found)
    assert close(again.x_plus[2:, :, 1], 2 * own.x_plus[2:], EXACT)


def test_what_is_never_measured_stays_unknown():
    """NaN and inf to the end, smoothed too; what does not depend on it is estimated, and the likelihood is that of the rest."""
    both = DiscreteModel(np.eye(2), np.eye(2), [[1, 0]], [[1]], x0=[0, 0], P0=np.diag([np.inf, np.inf]))
    alone = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[np.inf]])
    found, wanted = kalman_filter(both, Z, first=0), kalman_filter(alone, Z, first=0)
    for one, other in ((found, wanted), (smooth(both, found), smooth(alone, wanted))):
        x, P = (one.x, one.P) if isinstance(one, Smoothed) else (one.x_plus, one.P_plus)
        x1, P1 = (other.x, other.P) if isinstance(other, Smoothed) else (other.x_plus, other.P_plus)
        assert close(x[:, 0], x1[:, 0], EXACT)
        assert close(P[:, 0, 0], P1[:, 0, 0], EXACT)
        assert np.isnan(x[:, 1]).all()
        assert np.isinf(P[:, 1, 1]).all()
        assert not P[:, 0, 1].any()
    assert found.log_likelihood == 0.0
    assert found.log_likelihood_diffuse == pytest.approx(wanted.log_likelihood_diffuse, rel=EXACT)


def test_a_difference_of_two_unknown_states_is_known():
    """Only x1 − x2 is measured: neither is known, however long the record, and their difference has a likelihood."""
    turn = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    H = np.array([[1.0, -1.0]]) @ np.linalg.matrix_power(np.array(turn).T, 7)  # some direction that is no state
    model = DiscreteModel(np.eye(2), np.zeros((2, 2)), H, [[0.5]], x0=[0, 0], P0=np.diag([np.inf, np.inf]))
    z = np.random.default_rng(1).normal(size=(300, 1))
    found = kalman_filter(model, z, first=0)
    assert np.isnan(found.x_plus).all()
    spread = (z - z.mean()) / 0.5**0.5
    alpha = np.linalg.norm(H)
    right = -0.5 * (299 * np.log(2 * np.pi * 0.5) + (spread**2).sum() + np.log(300)) - 0.5 * np.log(2 * np.pi) - np.log(alpha)
    assert found.log_likelihood_diffuse == pytest.approx(right, rel=EXACT)
    assert np.isfinite(found.nis[1:]).all()


def test_a_large_start_that_nothing_measures_costs_no_digits():
    """P0 = 1e20 along a direction that no measurement sees, across the states."""
    model = DiscreteModel(np.eye(2), 0.1 * np.eye(2), [[1, -1]], [[1e-4]], x0=[0, 0], P0=1e20 * np.eye(2))
    z = np.random.default_rng(2).normal(size=(12, 1))
    small = DiscreteModel([[1]], [[0.2]], [[1]], [[1e-4]], x0=[0], P0=[[2e20]])
    found, wanted = kalman_filter(model, z, first=0), kalman_filter(small, z, first=0)
    assert found.log_likelihood == pytest.approx(wanted.log_likelihood, rel=EXACT)
    assert close(found.x_plus @ [1, -1], wanted.x_plus[:, 0], 1e-5)  # x itself is known to 1e-16 of 1e10


def test_models_and_files_say_that_nothing_is_known(tmp_path):
    """``inf`` on the diagonal of P0, with zeros beside it; in a file as text or as a number."""
    with pytest.raises(ValueError, match="P0: expected 0 beside an infinite variance, received a correlation"):
        dataclasses.replace(LINE, P0=[[np.inf, 1], [1, 1]])
    assert np.isinf(ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[np.inf]]).P0).all()
    text = (
        'format = 1\nkind = "discrete"\ntitle = "walk"\n[model]\nstates = ["x"]\nmeasurements = ["z"]\n'
        "Phi = [[1]]\nQd = [[1]]\nH = [[1]]\nR = [[1]]\nP0 = [[{}]]\ndt = 1\n"
    )
    for written in ('"inf"', "inf", '"2*inf"'):
        file = tmp_path / "walk.toml"
        file.write_text(text.format(written))
        assert np.isinf(modelfile.load(file).discrete(3).P0).all()


def test_the_rounding_of_another_program_is_no_variance():
    """−2.7e-20 beside 1 counts as 0; −1e-3 is refused."""
    case = next(p.values[0] for p in cases.numerics("k9_P0_rounding"))
    assert cases.model(case["model"]).P0.tolist() == case["right"]["P0_used"]
    with pytest.raises(ValueError, match=r"P0: expected variances >= 0 on the diagonal, received -0\.001"):
        cases.model(case["model"], P0=case["right"]["refused_for"])


def test_verbs_without_data_ask_for_a_start():
    """Where no data tell what is unknown, a finite P0 is asked for."""
    finite = dataclasses.replace(LINE, P0=np.eye(2))
    for verb in (
        lambda: simulate(LINE, 3, 2, 1),
        lambda: sensitivity.actual(LINE, finite, 3),
        lambda: budgets.budget(LINE, 3),
    ):
        with pytest.raises(ValueError, match=r"^P0: expected finite variances .*, received inf \(nothing known\)$"):
            verb()


# Parts --------------------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=50, derandomize=True)
@given(n=st.integers(1, 5), d=st.integers(1, 4), seed=st.integers(0, 10**6))
def test_columns_span_the_same_after_a_motion(n, d, seed):
    """AAᵀ is that of ΦA, with no more columns than its rank."""
    rng = np.random.default_rng(seed)
    A, Phi = rng.normal(size=(n, d)), rng.normal(size=(n, n))
    rank = int(rng.integers(0, n + 1))
    Phi = Phi[:, :rank] @ Phi[:rank]
    found = columns.moved(Phi, A, rounding.EPS)
    assert found.shape[1] == min(rank, d, n)
    assert close(found @ found.T, Phi @ A @ A.T @ Phi.T, EXACT, size=float(np.abs(Phi).max() ** 2 * np.abs(A).max() ** 2 * n) + 1)


def test_small_columns_keep_their_digits():
    """A mode that has decayed to 1e-18 of the other is still there: two measurements tell both."""
    modes = np.linalg.inv([[1.0, 1.0], [1.0, 0.5]]).T
    Phi = np.linalg.inv(modes) @ np.diag([1.0, 0.5]) @ modes
    model = DiscreteModel(Phi, np.zeros((2, 2)), [[1, 0]], [[1]], x0=[0, 0], P0=np.diag([np.inf, np.inf]))
    z = np.full((63, 1), NAN)
    z[60:] = [[1.0], [2.0], [2.5]]
    found = kalman_filter(model, z, first=0)
    assert np.isnan(found.x_plus[:61, 1]).all()
    assert np.isfinite(found.x_plus[61:]).all()
    late = dataclasses.replace(model)
    wanted = kalman_filter(late, z[60:], first=0)  # from inf at t60: the same, as no mode is lost
    assert close(found.x_plus[61:], wanted.x_plus[1:], 1e-9)
    assert close(found.P_plus[61:], wanted.P_plus[1:], 1e-9)


def test_a_perfect_element_and_a_missing_one_after_a_start_without_information():
    """Fewer elements at one instant than at the one before, while something is unknown: every form gives what the record gives."""
    H = [[1.0, 0.5, -0.3, 0.2], [0.2, 1.0, 0.4, -1.0], [-0.5, 0.3, 1.0, 0.6]]
    Phi = [[0.9, 0.2, 0, 0.1], [0, 0.8, 0.3, 0], [0.1, 0, 0.95, 0.2], [0.3, 0, 0.1, 0.7]]
    model = DiscreteModel(Phi, np.eye(4), H, np.diag([0.0, 1.0, 2.0]), P0=np.diag(np.full(4, np.inf)))
    z = np.array([[1.0, NAN, NAN], [0.5, 1.0, NAN], [2.0, NAN, 1.5], [1.0, 0.0, 1.0]])
    wanted = kalman_filter(model, z)
    for form in PERFECT:
        found = kalman_filter(model, z, algorithm=form)
        assert close(found.x_plus[-2:], wanted.x_plus[-2:], SOLVER), form
        assert close(found.P_plus[-2:], wanted.P_plus[-2:], SOLVER), form


def test_a_start_that_took_more_digits_is_smoothed_with_a_word():
    """Four integrators seen perfectly over a thousandth of their time: the filter is right, the way back has too few digits and says so."""
    model = DiscreteModel(
        [[1, 1e-2, 5e-5, 1e-7], [0, 1, 1e-2, 5e-5], [0, 0, 1, 1e-2], [0, 0, 0, 1]],
        np.diag([1e-10, 1e-7, 1e-2, 1e3]), [[1, 0, 0, 0]], [[0]], P0=np.diag(np.full(4, np.inf)), dt=1e-2,
    )  # fmt: skip
    seen = kalman_filter(model, [0.3, 0.1, -0.2, 0.4, 0.1, 0.2])
    smoothed = smooth(model, seen)
    assert seen.start.precise
    assert not seen.remarks
    assert len(smoothed.remarks) == 1
    assert "took more digits than doubles have" in smoothed.remarks[0]
    assert not smooth(model, kalman_filter(model, [0.3, 0.1, -0.2, 0.4], P0=model.Qd)).remarks
