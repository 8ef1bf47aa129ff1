"""What goes to another library and comes back is the same model; what would not be the same is refused."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import control
import hypothesis.strategies as st
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bucy, kalman_filter
from ctlabs.labs.experiment import covariances
from ctlabs.models import ContinuousModel, DiscreteModel, interop, shaping
from tests.cases import numerics
from tests.reference import EXACT, SOLVER, broken, close
from tests.strategies import continuous_models, discrete_models, record, seeds

pytestmark = pytest.mark.numerical

Array = NDArray[Any]
W = np.array([0.1, 1.0, 7.0])


def scalar(**more: Any) -> DiscreteModel:
    return DiscreteModel([[1.0]], [[1.0]], [[1.0]], [[1.0]], x0=[0.0], P0=[[10.0]], **more)


# From python-control


def test_the_autopilot_of_lab_13_gets_the_observable_form() -> None:
    """0.3(s+0.01)/(s²+0.006s+0.003) has F=[[−0.006,1],[−0.003,0]], G=[0.3,0.003]ᵀ, H=[1,0]."""
    system = control.tf([0.3, 0.003], [1, 0.006, 0.003])
    model = interop.from_control(system, Q=[[36.0]], Rc=[[81.0]], P0=np.eye(2), states=["h", "x2"])
    plain = interop.from_control(([0.3, 0.003], [1, 0.006, 0.003]), Q=[[36.0]], Rc=[[81.0]], P0=np.eye(2))
    assert np.array_equal(plain.F, model.F)
    assert isinstance(model, ContinuousModel)
    assert close(model.F, [[-0.006, 1], [-0.003, 0]], EXACT)
    assert close(model.G, [[0.3], [0.003]], EXACT)
    assert close(model.H, [[1, 0]], EXACT)
    assert model.states == ("h", "x2")
    assert (model.Rc, model.N, model.B) == (np.array([[81.0]]), None, None)


@pytest.mark.parametrize("realisation", ["observable", "reachable"])
@pytest.mark.parametrize(
    ("num", "den"), [([2.0], [1.0, 3.0]), ([1.0, 4.0], [2.0, 3.0, 5.0]), ([1.0], [1.0, 0.0, 0.0, 1.0])]
)
def test_a_transfer_function_keeps_its_frequency_response(num: Any, den: Any, realisation: str) -> None:
    """H(jωI − F)⁻¹G is the transfer function in either realisation, and is not with 5 % more in one entry."""
    model = interop.from_control(control.tf(num, den), Q=[[1.0]], P0=np.eye(len(den) - 1), realisation=realisation)
    assert isinstance(model, ContinuousModel)
    expected = np.polyval(num, 1j * W) / np.polyval(den, 1j * W)
    assert close(control.ss(model.F, model.G, model.H, 0)(1j * W), expected, SOLVER)
    assert not close(control.ss(model.F, broken(model.G), model.H, 0)(1j * W), expected, 1e-3)


@given(continuous_models(correlated=False))
@settings(max_examples=25)
def test_a_continuous_model_returns_from_python_control(model: ContinuousModel) -> None:
    """to_control and back, with Q, Rc, P0 and x0 handed over, is the model; the known inputs are those not named noise."""
    system = interop.to_control(model)
    assert system.dt == 0
    noise = range(model.s)
    back = interop.from_control(system, Q=model.Q, Rc=model.Rc, P0=model.P0, x0=model.x0, noise=noise)
    assert isinstance(back, ContinuousModel)
    for name in ("F", "G", "Q", "H", "Rc", "x0", "P0"):
        assert close(getattr(back, name), getattr(model, name), EXACT), name
    assert (back.states, back.measurements) == (model.states, model.measurements)
    assert (back.B is None) == (model.B is None)
    if back.B is not None and model.B is not None:
        assert close(back.B, model.B, EXACT)


@given(discrete_models(varying=False, correlated=False, offset=False))
@settings(max_examples=25)
def test_a_discrete_model_returns_from_python_control(model: DiscreteModel) -> None:
    """The same with a period: Phi, Qd, H, R, dt."""
    back = interop.from_control(interop.to_control(model), Q=model.Qd, R=model.R, P0=model.P0, x0=model.x0)
    assert isinstance(back, DiscreteModel)
    for name in ("Phi", "Qd", "H", "R", "x0", "P0", "dt"):
        assert close(getattr(back, name), getattr(model, name), EXACT), name


def test_a_direct_path_is_refused_or_becomes_measurement_noise() -> None:
    """(s+3)/(s+2) driven by white noise: refused unless noise= says so; then Rc + DQDᵀ, N = QDᵀ."""
    system = control.tf([1, 3], [1, 2])
    with pytest.raises(ValueError, match='D: expected no direct path from noise to output, or noise="input"'):
        interop.from_control(system, Q=[[4.0]], Rc=[[1.0]], P0=[[1.0]])
    model = interop.from_control(system, Q=[[4.0]], Rc=[[1.0]], P0=[[1.0]], noise="input")
    assert isinstance(model, ContinuousModel)
    assert model.Rc is not None
    assert model.N is not None
    assert close(model.Rc, [[5.0]], EXACT)
    assert close(model.N, [[4.0]], EXACT)
    # z = Hx + Dw + v has the spectrum |G(jω)|²Q + Rc.
    own = control.ss(model.F, model.G, model.H, 0)(1j * W)
    spectrum = shaping.psd(model, W) + 2 * (own * model.N[0, 0]).real + model.Rc[0, 0]
    assert close(spectrum, 4.0 * (W**2 + 9) / (W**2 + 4) + 1.0, EXACT)
    alone = interop.from_control(system, Q=[[4.0]], P0=[[1.0]], noise="input")
    assert isinstance(alone, ContinuousModel)
    assert alone.Rc is not None
    assert close(alone.Rc, [[4.0]], EXACT)


def test_a_direct_path_in_discrete_time() -> None:
    """z_k = Cx_k + Dw_k + v_k correlates w_k with the measurement noise of the same step: N = BQDᵀ."""
    system = control.ss([[0.5]], [[2.0]], [[1.0]], [[3.0]], 0.1)
    model = interop.from_control(system, Q=[[4.0]], R=[[1.0]], P0=[[1.0]], noise="input")
    assert isinstance(model, DiscreteModel)
    assert close(model.Qd, [[16.0]], EXACT)
    assert close(model.R, [[37.0]], EXACT)
    assert model.N is not None
    assert close(model.N, [[24.0]], EXACT)
    assert model.dt == 0.1


def test_known_inputs_of_a_discrete_system_become_its_offset() -> None:
    """Inputs that are not noise need their values u, and enter as B u."""
    system = control.ss(0.5 * np.eye(2), [[1.0, 2.0], [0.0, 3.0]], [[1.0, 0.0]], [[0.0, 0.0]], 1.0)
    common: dict[str, Any] = {"Q": [[1.0]], "R": [[1.0]], "P0": np.eye(2), "noise": 0}
    model = interop.from_control(system, u=[0.5], **common)
    assert isinstance(model, DiscreteModel)
    assert model.offset is not None
    assert close(model.offset, [1.0, 1.5], EXACT)
    with pytest.raises(ValueError, match="u: expected values of the 1 known inputs, received None"):
        interop.from_control(system, **common)


@settings(max_examples=100)
@given(n=st.integers(1, 8), zeros=st.integers(0, 8), decades=st.floats(0, 20), seed=seeds, reachable=st.booleans())
def test_the_response_is_the_ratio_of_the_polynomials(
    n: int, zeros: int, decades: float, seed: int, reachable: bool
) -> None:
    """Coefficients over twenty decades and both signs: H(jωI − F)⁻¹G + D is num/den to the rounding of their terms."""
    rng = np.random.default_rng(seed)
    num, den = (
        rng.choice([-1, 1], size=size) * 10.0 ** rng.uniform(-decades / 2, decades / 2, size=size)
        for size in (min(zeros, n) + 1, n + 1)
    )
    model = interop.from_control(
        (num, den), Q=[[1.0]], P0=np.zeros((n, n)), noise="input",
        realisation="reachable" if reachable else "observable",
    )  # fmt: skip
    assert isinstance(model, ContinuousModel)
    D = 0.0 if model.N is None else model.N[0, 0]
    eps = np.finfo(float).eps
    with mpmath.workdps(60):
        for w in 10.0 ** rng.uniform(-decades / n - 1, decades / n + 1, size=4):
            x = mpmath.lu_solve(
                mpmath.mpc(0, w) * mpmath.eye(n) - mpmath.matrix(model.F.tolist()),
                mpmath.matrix(model.G[:, 0].tolist()),
            )
            found = mpmath.fsum(mpmath.mpf(h) * v for h, v in zip(model.H[0].tolist(), x, strict=True)) + D
            top, bottom = (mpmath.polyval(p.tolist(), mpmath.mpc(0, w)) for p in (num, den))
            above, below = (mpmath.polyval(np.abs(p).tolist(), w) for p in (num, den))
            # Each coefficient is rounded once, those of num beside D times those of den.
            bound = 2 * eps * (above + abs(D) * below + abs(top / bottom) * below) / abs(bottom)
            assert abs(found - top / bottom) <= bound


@pytest.mark.parametrize("realisation", interop.REALISATIONS)
def test_the_states_are_those_of_python_control_where_it_works(realisation: str) -> None:
    """Its observable and reachable forms of a plant that its rank test passes have the same states."""
    system = control.tf([1.0, 4.0, 2.0], [2.0, 3.0, 5.0, 1.5])
    own = getattr(control, f"{realisation}_form")(control.ss(system))[0]
    model = interop.from_control(system, Q=[[1.0]], P0=np.zeros((3, 3)), realisation=realisation)
    assert isinstance(model, ContinuousModel)
    for name, right in (("F", own.A), ("G", own.B), ("H", own.C)):
        assert close(getattr(model, name), right, EXACT), name


def test_outputs_share_the_states_of_one_denominator() -> None:
    """Two outputs over one denominator and one over another: 2 + 1 states of the first input, 1 of the second."""
    den, lag = [1.0, 2.0, 5.0], [1.0, 3.0]
    system = control.tf(
        [[[1.0], [1.0]], [[2.0, 3.0], [0.0]], [[4.0], [1.0]]], [[den, lag], [den, [1.0]], [lag, lag]],
        inputs=["gust", "u[1]"], outputs=["y[0]", "y[1]", "y[2]"],
    )  # fmt: skip
    model = interop.from_control(system, Q=np.eye(2), P0=np.zeros((4, 4)))
    assert isinstance(model, ContinuousModel)
    assert model.states == ("gust_1", "gust_2", "gust_3", "u[1]_1")
    s = 2.0j
    found = model.H @ np.linalg.solve(s * np.eye(4) - model.F, model.G)
    a, b = np.polyval(den, s), np.polyval(lag, s)
    assert close(found, [[1 / a, 1 / b], [(2 * s + 3) / a, 0], [4 / b, 1 / b]], EXACT)


@given(order=st.integers(1, 12), phase=st.floats(0.01, 40.0), seconds=st.sampled_from([1e-6, 0.01, 3.0, 1e4]))
def test_a_delay_states_its_error(order: int, phase: float, seconds: float) -> None:
    """The response differs from exp(−jωT) by at most the error at every frequency up to the given one, and by nearly it."""
    lag = interop.delay(seconds, order, phase / seconds)
    with mpmath.workdps(60):
        for share in (0.1, 0.5, 0.9, 1.0):
            w = mpmath.mpf(share * phase) / seconds
            s = mpmath.mpc(0, w)
            found = mpmath.polyval(lag.num.tolist(), s) / mpmath.polyval(lag.den.tolist(), s)
            actual = abs(found - mpmath.exp(-s * mpmath.mpf(seconds)))
            assert actual <= lag.error * (1 + 1e-12)
    if 1e-12 < lag.error < 0.1 and phase < order:
        assert lag.error < 2 * actual


@pytest.mark.parametrize("case", numerics("k7_pade_*"))
def test_the_delays_of_the_cases(case: Any) -> None:
    """Padé's coefficients for 10 ms, and errors that bound those computed with sixty digits."""
    order = case["right"]["states"]
    for w, error in case["right"]["error_of_the_delay"]:
        lag = interop.delay(0.01, order, w)
        assert close(lag.den / lag.den[-1], np.array(case["given"]["den"]) / case["given"]["den"][-1], EXACT)
        assert close(lag.num / lag.den[-1], np.array(case["given"]["num"]) / case["given"]["den"][-1], EXACT)
        assert error <= lag.error
    for arguments in ((0.0, 1, 1.0), (1.0, 0, 1.0), (1.0, 1, -1.0)):
        with pytest.raises(ValueError, match=r"(seconds|order|up_to): expected"):
            interop.delay(*arguments)


TF = control.tf([1], [1, 1])
ONE: dict[str, Any] = {"Q": [[1.0]], "P0": [[1.0]]}


@pytest.mark.parametrize(
    ("system", "more", "error", "message"),
    [
        (control.tf([1, 0, 0], [1, 1]), ONE, ValueError, "expected a proper transfer function, received degree 2 over 1"),
        (control.tf([2], [1]), ONE, ValueError, "a transfer function with poles, received the constant 2"),
        (control.tf([[[2], [3]]], [[[1], [4]]]), ONE, ValueError, "with poles, received the constant .*2.0, 0.75"),
        (control.tf([1], [1, 1], None), ONE, ValueError, "received dt=None, which leaves it open"),
        (control.ss([[-1]], [[1]], [[1]], 0, None), ONE, ValueError, "received dt=None, which leaves it open"),
        (([1], [1, 1], 0.1), ONE, ValueError, "coefficients .num, den., received a tuple of 3"),
        (control.tf([1e-300], [1e30, 1e30]), ONE, ValueError, "num: expected coefficients within double precision"),
        (control.tf([1], [1e-300, 1e30]), ONE, ValueError, "within double precision .*, received larger ones"),
        (control.tf([1], [1, 0.5], True), ONE | {"R": [[1.0]]}, ValueError, "expected a period dt in seconds"),
        (control.tf([1], [1, 0.5], 0.1), ONE, ValueError, "R: expected the covariance"),
        (control.tf([1], [1, 0.5], 0.1), ONE | {"Rc": [[1.0]]}, ValueError, "Rc: expected None with a discrete system"),
        (TF, ONE | {"R": [[1.0]]}, ValueError, "R: expected None with a continuous system"),
        (TF, ONE | {"u": [1.0]}, ValueError, "u: expected None with a continuous system"),
        (TF, ONE | {"realisation": "modal"}, ValueError, "realisation: expected one of observable, reachable"),
        (TF, ONE | {"noise": 1}, ValueError, r'noise: expected "input" or different indices below 1, received 1'),
        (TF, ONE | {"noise": []}, ValueError, "noise: expected"),
        (TF, ONE | {"Q": [[1.0, 0.0]]}, ValueError, r"Q: expected shape \(1, 1\), received \(1, 2\)"),
        (TF, ONE | {"states": ["a", "b"]}, ValueError, "states: expected 1 names"),
        (3.0, ONE, TypeError, "expected a control.StateSpace or control.TransferFunction, received a float"),
        (
            control.ss([[-1]], [[1, 1]], [[1]], [[0, 2]]), ONE | {"noise": 0}, ValueError,
            "D: expected no direct path from a known input",
        ),
    ],
)  # fmt: skip
def test_systems_that_make_no_model_are_refused(system: Any, more: Any, error: type[Exception], message: str) -> None:
    """Improper, static or mismatched systems, no kind of time, numbers out of range, each with what to do instead."""
    with pytest.raises(error, match=message):
        interop.from_control(system, **more)


# To python-control


def test_signals_keep_their_names() -> None:
    """States, measurements and inputs of the model are labels of the system; equal names are told apart."""
    model = ContinuousModel(
        -np.eye(2),
        np.eye(2),
        np.eye(2),
        [[1, 0]],
        B=[[1], [0]],
        P0=np.eye(2),
        states=["x", "x"],
        measurements=["range"],
    )
    system = interop.to_control(model)
    assert system.state_labels == ["x", "x_2"]
    assert system.input_labels == ["w[0]", "w[1]", "u[0]"]
    assert system.output_labels == ["range"]


def test_no_state_is_lost() -> None:
    """States that nothing drives or sees stay in the system."""
    model = ContinuousModel(np.zeros((2, 2)), [[0], [1]], [[1]], [[0, 1]], P0=np.eye(2))
    assert interop.to_control(model).nstates == 2


def test_python_control_filters_the_model_as_ctlabs_does() -> None:
    """lqe on the exported system gives the Kalman–Bucy gain of the model."""
    model = ContinuousModel([[0, 1], [-2, -0.3]], [[0], [1]], [[3.0]], [[1, 0]], Rc=[[0.5]], P0=np.eye(2))
    system = interop.to_control(model)
    gain, P, _ = control.lqe(system, model.Q, model.Rc)
    steady = bucy.steady(model)
    assert close(gain, steady.K, SOLVER)
    assert close(P, steady.P, SOLVER)


def test_models_that_are_no_system_are_refused() -> None:
    """Varying matrices and constant inputs have no place in a StateSpace."""
    with pytest.raises(ValueError, match="model: expected constant matrices for python-control's StateSpace"):
        interop.to_control(replace(scalar(), Phi=np.ones((3, 1, 1))))
    with pytest.raises(ValueError, match="offset: expected none"):
        interop.to_control(scalar(offset=[1.0]))
    with pytest.raises(TypeError, match="model: expected a DiscreteModel, received a str"):
        interop.to_control("model")  # type: ignore[arg-type]


# To filterpy


@given(discrete_models(varying=False, correlated=False, offset=False))
@settings(max_examples=20)
def test_filterpy_runs_the_exported_filter_as_ctlabs_does(model: DiscreteModel) -> None:
    """A loop over predict and update gives the estimates and covariances of kalman_filter."""
    z = record(model, 6, np.random.default_rng(5))
    expected = kalman_filter(model, z[1:])
    kf = interop.to_filterpy(model)
    for k in range(1, 7):
        kf.predict()
        kf.update(z[k][:, None])
        assert close(kf.x[:, 0], expected.x_plus[k], SOLVER)
        assert close(kf.P, expected.P_plus[k], SOLVER)


def test_the_exported_filter_is_a_copy() -> None:
    """Running it leaves the model as it was."""
    model = scalar()
    kf = interop.to_filterpy(model)
    kf.x[0, 0], kf.F[0, 0], kf.P[0, 0] = 5.0, 5.0, 5.0
    assert (model.x0[0], model.Phi[0, 0], model.P0[0, 0]) == (0.0, 1.0, 10.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"N": [[0.5]]}, "N: expected 0 .filterpy has no correlated noises"),
        ({"R": [[np.inf]]}, "R: expected finite variances .* received inf for z1"),
        ({"offset": [1.0]}, r"offset: expected none .*, received \[1.0\]"),
        ({"Qd": np.ones((3, 1, 1))}, "model: expected constant matrices for filterpy's KalmanFilter, .* over 3 steps"),
    ],
)
def test_what_filterpy_cannot_do_is_refused(change: dict[str, Any], message: str) -> None:
    """Correlated noises, absent measurements, known inputs and variation with time."""
    with pytest.raises(ValueError, match=message):
        interop.to_filterpy(replace(scalar(), **change))
    with pytest.raises(TypeError, match="model: expected a DiscreteModel, received a ContinuousModel"):
        interop.to_filterpy(shaping.bias(1.0))  # type: ignore[arg-type]


# To pandas

TWO = DiscreteModel([[1, 1], [0, 1]], np.eye(2), [[1, 0]], [[1]], x0=[0, 0], P0=np.eye(2))
NAMED: dict[str, Any] = {"states": ["x", "v"], "measurements": ["range"]}


def test_a_schedule_is_a_table_with_a_row_per_step() -> None:
    """Covariances by their upper triangle, gains by state and measurement, numbers unchanged."""
    plan = covariances(TWO, 5)
    table = interop.to_dataframe(plan, **NAMED)
    assert list(table.columns) == [
        "k", "t",
        "P_minus[x,x]", "P_minus[x,v]", "P_minus[v,v]", "P_plus[x,x]", "P_plus[x,v]", "P_plus[v,v]",
        "K[x,range]", "K[v,range]", "S[range,range]", "used[range]",
    ]  # fmt: skip
    assert len(table) == 6
    assert (table["P_plus[x,v]"].to_numpy() == plan.P_plus[:, 0, 1]).all()
    assert (table["K[v,range]"].to_numpy() == plan.K[:, 1, 0]).all()


def test_an_ensemble_is_a_table_with_a_row_per_run_and_step() -> None:
    """Every value stands in the row of its run and step; also where runs, steps and states are equally many."""
    rng = np.random.default_rng(6)
    z = np.stack([record(TWO, 2, rng) for _ in range(3)], axis=-1)
    runs = kalman_filter(TWO, z[1:])
    table = interop.to_dataframe(runs, **NAMED)
    assert list(table.columns) == [
        "run", "k", "t",
        "P_minus[x,x]", "P_minus[x,v]", "P_minus[v,v]", "P_plus[x,x]", "P_plus[x,v]", "P_plus[v,v]",
        "K[x,range]", "K[v,range]", "S[range,range]", "used[range]",
        "x_minus[x]", "x_minus[v]", "x_plus[x]", "x_plus[v]", "innovation[range]", "nis", "z[range]",
    ]  # fmt: skip
    assert len(table) == 9
    for _, row in table.iterrows():
        run, k = int(row["run"]), int(row["k"])
        assert row["x_plus[v]"] == runs.x_plus[k, 1, run]
        assert row["t"] == runs.t[k]
        assert row["P_plus[x,v]"] == runs.P_plus[k, 0, 1]
        assert row["nis"] == runs.nis[k, run] or not k
        assert row["z[range]"] == z[k, 0, run] or np.isnan(z[k, 0, run])


def test_actual_errors_are_a_table_too() -> None:
    """Vectors and matrices of any result over time get the names of the design's states."""
    result = sensitivity.actual(TWO, TWO, 4)
    table = interop.to_dataframe(result, states=["x", "v"])
    assert (table["P_plus[v,v]"].to_numpy() == result.P_plus[:, 1, 1]).all()
    assert "bias_minus[x]" in table.columns


def test_a_result_without_time_is_refused() -> None:
    """A model, a number, or wrong names are refused; without pandas the message says what to install."""
    with pytest.raises(TypeError, match="result: expected a result with a time axis t, received a DiscreteModel"):
        interop.to_dataframe(TWO)
    with pytest.raises(ValueError, match="states: expected 2 names"):
        interop.to_dataframe(covariances(TWO, 2), states=["x"])


def test_without_pandas_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """pandas is optional."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match="to_dataframe: expected pandas to be installed"):
        interop.to_dataframe(covariances(TWO, 2))
