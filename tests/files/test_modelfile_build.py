"""From a model file to the library's models: intervals of any length, known inputs, matrices that vary."""

import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings

from ctlabs.files.modelfile import ModelFileError, from_model, loads, ready
from ctlabs.files.modelfile.build import moved
from ctlabs.models.discretisation import discretise
from tests.reference import EXACT, SOLVER, close
from tests.strategies import continuous_models

PLANT = """format = 1
kind = "continuous"
[constants]
a = 0.7
[model]
F = [[0, 1], [-2, "-a"]]
G = [[0], [1]]
Q = [[0.3]]
H = [[1, 0]]
R = [[0.5]]
P0 = [[1, 0], [0, 2]]
dt = 0.25
"""
SCALAR = """format = 1
kind = "continuous"
[model]
F = [["F"]]
G = [[1]]
Q = [["Q"]]
H = [[1]]
R = [[1]]
P0 = [[1]]
dt = 0.5
[experiment]
t0 = 0
steps = 4
"""


def scalar(F: object = 0, Q: object = 0, **more: str):
    """A file of one state with these F and Q, and other lines of [model]."""
    text = SCALAR.replace('"F"', f'"{F}"').replace('"Q"', f'"{Q}"')
    return loads(
        text.replace("dt = 0.5", "dt = 0.5\n" + "\n".join(f"{name} = {value}" for name, value in more.items()))
    )


@given(continuous_models(stable=None))
@settings(deadline=None, max_examples=40, derandomize=True)
def test_equal_intervals_are_the_librarys_discretisation(model):
    """Φ, Qd, R = Rc/dt and N of a file are those of discretise()."""
    found, expected = from_model(model, dt=0.3).discrete(steps=5), discretise(model, 0.3)
    for name in ("Phi", "Qd", "R", "H", "x0", "P0"):
        assert close(getattr(found, name), getattr(expected, name), EXACT)
    assert (found.N is None) == (expected.N is None)
    assert found.N is None or close(found.N, expected.N, EXACT)
    assert (found.dt, found.horizon, found.states) == (expected.dt, None, expected.states)


def test_every_interval_of_given_times_is_its_own():
    """Times that are not equally spaced give each interval the Φ and Qd of its own length; equal ones one model."""
    file = loads(PLANT)
    times = [0.5, 0.7, 1.7, 1.9, 5.0]
    found = file.discrete(times=times)
    assert found.horizon == 4
    for k, h in enumerate(np.diff(times)):
        expected = discretise(file.continuous(), h, R=[[0.5]])
        assert close(found.Phi[k], expected.Phi, EXACT)
        assert close(found.Qd[k], expected.Qd, EXACT)
    assert found.dt == pytest.approx(4.5 / 4)
    assert file.discrete(times=3 + 0.1 * np.arange(8)).horizon is None
    assert file.discrete(times=3 + 0.1 * np.arange(8)).dt == pytest.approx(0.1, rel=1e-12)


def test_continuous_noise_becomes_a_variance_of_the_interval_that_follows():
    """R_k = Rc/(t_{k+1} − t_k); the last instant has the interval before it. At equal intervals this is Rc/dt."""
    file = loads(PLANT.replace("R = [[0.5]]", "Rc = [[0.5]]"))
    assert file.discrete(times=[0, 1, 3, 7]).R.ravel().tolist() == [0.5, 0.25, 0.125, 0.125]
    assert file.discrete().R.tolist() == [[2.0]]
    assert file.discrete(steps=3, times=[0, 1, 2, 3]).R.tolist() == [[0.5]]
    varying = loads(PLANT.replace("R = [[0.5]]", 'Rc = [["1 + t"]]'))
    assert varying.discrete(steps=2).R.ravel().tolist() == [4.0, 5.0, 6.0]


def test_a_known_input_is_held_over_an_interval():
    """The offset is what the state of the plant gains from rest under u(t_k), by integrating the equations of motion."""
    file = loads(PLANT.replace("dt = 0.25", 'B = [[1], [3]]\nu = ["2*sin(5*t) + k"]\ndt = 0.25'))
    F = file.matrix("F")
    for times in (0.25 * np.arange(5), np.array([0, 0.1, 0.5, 0.6, 1.6])):
        found = file.discrete(times=times)
        for k in range(4):
            u = 2 * math.sin(5 * times[k]) + k

            def motion(_t, x, u=u):
                return F @ x + np.array([1, 3]) * u

            end = scipy.integrate.solve_ivp(motion, (0, times[k + 1] - times[k]), [0, 0], rtol=1e-12, atol=1e-14).y[
                :, -1
            ]
            assert close(found.offset[k], end, SOLVER)
    assert found.offset.shape == (4, 2)


def test_a_constant_input_gives_the_librarys_offset():
    """One vector, and that of discretise(u=)."""
    file = loads(PLANT.replace("dt = 0.25", 'B = [[1], [3]]\nu = ["2*a"]\ndt = 0.25'))
    expected = discretise(file.continuous(), 0.25, R=[[0.5]], u=[1.4])
    assert close(file.discrete().offset, expected.offset, EXACT)
    assert loads(PLANT.replace("dt = 0.25", "B = [[1], [3]]\ndt = 0.25")).discrete().offset is None


CLOSED = [
    # F, Q, Φ(t, s), Qd from 0 to t
    ("-1/(1 + t)", "2", lambda t, s: (1 + s) / (1 + t), lambda t: 2 * ((1 + t) ** 3 - 1) / (3 * (1 + t) ** 2)),
    ("0", "t^2", lambda t, s: 1.0, lambda t: t**3 / 3),
    (
        "cos(t)",
        "exp(2*sin(t))",
        lambda t, s: math.exp(math.sin(t) - math.sin(s)),
        lambda t: t * math.exp(2 * math.sin(t)),
    ),
    ("0", "abs(t - 0.3)", lambda t, s: 1.0, lambda t: 0.045 + (t - 0.3) * abs(t - 0.3) / 2),
    ("0", "1 + abs(t - 0.7)/(t - 0.7)", lambda t, s: 1.0, lambda t: 2 * max(t - 0.7, 0)),
    ("0", "1 + cos(16*pi*t)", lambda t, s: 1.0, lambda t: t + math.sin(16 * math.pi * t) / (16 * math.pi)),
    ("0", "max(0, t - 1.999)", lambda t, s: 1.0, lambda t: max(t - 1.999, 0) ** 2 / 2),
    ("2*t", "0", lambda t, s: math.exp(t * t - s * s), lambda t: 0.0),
]


@pytest.mark.parametrize(("F", "Q", "Phi", "Qd"), CLOSED, ids=[f"F={row[0]} Q={row[1]}" for row in CLOSED])
def test_matrices_that_vary_within_an_interval_are_integrated(F, Q, Phi, Qd):
    """Φ and Qd of every interval against closed forms; smooth matrices, a kink, a jump."""
    found = scalar(F, Q).discrete()
    total = 0.0
    for k in range(4):
        s, t = 0.5 * k, 0.5 * (k + 1)
        assert found.Phi[k, 0, 0] == pytest.approx(Phi(t, s), rel=1e-10)
        total = Phi(t, s) ** 2 * total + found.Qd[k, 0, 0]
        assert total == pytest.approx(Qd(t), rel=1e-9, abs=1e-15)


def test_varying_matrices_agree_with_an_ode_solver():
    """The crane: Φ and Qd of the first interval by a Runge–Kutta method, an offset by the motion itself."""
    file = loads(ready("crane").dumps().replace("dt = 0.1", 'B = [[0], ["1 + t"]]\nu = [2]\ndt = 0.4'))
    found = file.discrete(steps=3)

    def motion(t, y):
        F, B = file.matrix("F", t=t), file.matrix("B", t=t)
        Phi, Q, c = y[:4].reshape(2, 2), y[4:8].reshape(2, 2), y[8:]
        return np.concatenate([(F @ Phi).ravel(), (F @ Q + Q @ F.T + np.diag([0, 1e-4])).ravel(), F @ c + B[:, 0] * 2])

    for k in range(3):
        start = np.concatenate([np.eye(2).ravel(), np.zeros(6)])
        end = scipy.integrate.solve_ivp(motion, (0.4 * k, 0.4 * k + 0.4), start, "DOP853", rtol=1e-12, atol=1e-16).y[
            :, -1
        ]
        assert close(found.Phi[k], end[:4].reshape(2, 2), SOLVER)
        assert close(found.Qd[k], end[4:8].reshape(2, 2), SOLVER)
        assert close(found.offset[k], end[8:], SOLVER)
    frozen = discretise(loads(ready("crane").dumps().replace("*t)", "*0.2)")).continuous(), 0.4, R=[[1]])
    assert not close(found.Phi[0], frozen.Phi, 1e-4)  # freezing at the middle of the interval would not do


def test_a_stiff_varying_interval_is_followed():
    """|λ|dt = 1e5: Φ is 0, and Qd the quasi-steady q/2λ at the end, up to λ'/2λ²."""
    found = scalar("-2e5*(1 + t)", "3").discrete(steps=1)
    assert found.Phi[0, 0, 0] < 1e-300
    rate = 2e5 * 1.5
    expected = 3 / (2 * rate) * (1 + 2e5 / (2 * rate**2))
    assert found.Qd[0, 0, 0] == pytest.approx(expected, rel=1e-9)


def test_constant_matrices_that_go_the_long_way_round_are_the_same():
    """Expressions of t that do not vary give what constants give."""
    text = PLANT.replace('"-a"', '"-a + 0*t"')
    assert close(loads(text).discrete(steps=2).Phi[1], loads(PLANT).discrete().Phi, EXACT)
    assert close(loads(text).discrete(steps=2).Qd[1], loads(PLANT).discrete().Qd, EXACT)


def test_a_singularity_is_told():
    """1/t from t = 0 has no value at its beginning, and none that can be integrated."""
    with pytest.raises(ModelFileError, match=r"model.F\[0\]\[0\]: at k = 0, t = 0 s: column 2: division by zero"):
        scalar("1/t")
    with pytest.raises(
        ValueError, match=r"F: expected matrices that can be integrated from t = .* received a singularity"
    ):
        moved(lambda t: (np.zeros((1, 1)), np.array([[1 / abs(t - 1 / 3)]]), np.zeros(1)), 0.0, 1.0)


def test_measurement_matrices_may_vary_with_time_and_index():
    """H and R at the instants of the measurements."""
    found = loads(PLANT.replace("H = [[1, 0]]", 'H = [["t", "k"]]').replace("R = [[0.5]]", 'R = [["1 + k"]]')).discrete(
        steps=3
    )
    assert np.array_equal(found.H[:, 0, 0], 0.25 * np.arange(4))
    assert np.array_equal(found.H[:, 0, 1], np.arange(4))
    assert np.array_equal(found.R[:, 0, 0], 1 + np.arange(4))
    assert found.Phi.ndim == 2
    late = loads(PLANT.replace("H = [[1, 0]]", 'H = [["t", "k"]]') + "[experiment]\nt0 = 2\n").discrete(steps=1)
    assert np.array_equal(late.H[:, 0, 0], [2, 2.25])


def test_what_has_no_value_at_t0_is_not_needed_there():
    """With first = 1 nothing is measured at t0: R = 1/k is no mistake. With first = 0 it is."""
    text = PLANT.replace("R = [[0.5]]", 'R = [["1/k"]]').replace("H = [[1, 0]]", 'H = [["1/t", 0]]')
    found = loads(text).discrete(steps=2)
    assert found.R.ravel().tolist() == [math.inf, 1, 0.5]
    assert found.H[:, 0, 0].tolist() == [4, 4, 2]
    with pytest.raises(ModelFileError, match=r"model.H\[0\]\[0\]: at k = 0, t = 0 s: column 2: division by zero"):
        loads(text + "[experiment]\nfirst = 0\n")
    with pytest.raises(ModelFileError, match=r"model.R\[0\]\[0\]: at k = 5, t = 1.25 s: column 2: division by zero"):
        loads(PLANT.replace("R = [[0.5]]", 'R = [["1/(k - 5)^2"]]'))
    with pytest.raises(
        ModelFileError, match=r"model.R: at k = 3, t = 0.75 s: expected variances >= 0 on the diagonal, received -0.5"
    ):
        loads(PLANT.replace("R = [[0.5]]", 'R = [["2.5 - k"]]'))


def test_a_discrete_file_may_vary_in_every_matrix():
    """Entry k of Φ, Qd, offset moves k → k+1; H and R have one more."""
    text = """format = 1
kind = "discrete"
[model]
Phi = [["1 - k/10"]]
Qd = [["t"]]
offset = ["k"]
B = [[2]]
u = ["t"]
H = [["k"]]
R = [["1 + k^2"]]
P0 = [[1]]
dt = 0.5
"""
    found = loads(text).discrete(steps=3)
    assert found.horizon == 3
    assert found.Phi.ravel().tolist() == [1, 0.9, 0.8]
    assert found.Qd.ravel().tolist() == [0, 0.5, 1]
    assert found.offset.ravel().tolist() == [0, 1 + 2 * 0.5, 2 + 2 * 1]
    assert found.H.ravel().tolist() == [0, 1, 2, 3]
    assert found.R.ravel().tolist() == [1, 2, 5, 10]
    assert loads(text).discrete().horizon == 200


def test_a_discrete_file_refuses_other_intervals_and_names_the_row():
    """Within a hundredth of dt of its grid a time is as good as on it."""
    file = ready("task07")
    assert file.discrete(times=[3, 4, 5.001, 6]).horizon is None
    with pytest.raises(
        ModelFileError,
        match=r"times\[2\]: expected 5 s \(a discrete model moves dt = 1 s from row to row\), received 5.5 s",
    ):
        file.discrete(times=[3, 4, 5.5, 6])
    with pytest.raises(ModelFileError, match=r"times\[2\]: expected 2 s"):
        file.discrete(times=[0, 1.006, 2.012, 3.018])


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0, 1, 1], r"times\[2\]: expected a time after 1 s, received 1 s"),
        ([0, 2, 1], r"times\[2\]: expected a time after 2 s, received 1 s"),
        ([0], "times: expected 2 or more instants, t0 first, received 1"),
        ([0, math.nan], r"times: expected finite numbers, received nan at \[1\]"),
        ([[0, 1]], r"times: expected shape \(steps\+1,\), received \(1, 2\)"),
    ],
)
def test_times_must_increase(times, message):
    """The first that does not is named."""
    with pytest.raises(ValueError, match=message):
        loads(PLANT).discrete(times=times)


def test_steps_are_counted():
    """A whole number above zero, and that of the times."""
    with pytest.raises(ValueError, match="steps: expected a whole number >= 1, received 0"):
        loads(PLANT).discrete(steps=0)
    with pytest.raises(ValueError, match="times: expected 4 instants, t0 first, received 3"):
        loads(PLANT).discrete(steps=3, times=[0, 1, 2])


def test_models_of_another_kind_are_refused():
    """A discrete file has no continuous model, a varying one no constant."""
    with pytest.raises(ModelFileError, match='kind: expected "continuous"'):
        ready("task07").continuous()
    with pytest.raises(ModelFileError, match=r"task21.toml: model.H\[0\]\[0\]: expected a constant .*, received t"):
        ready("task21").continuous()


def test_an_interval_beyond_double_precision_is_told():
    """An unstable plant over a very long time."""
    with pytest.raises(
        ModelFileError, match=r"model.dt: expected an interval over which the model stays within double precision"
    ):
        loads(PLANT.replace("-2,", "2,").replace("dt = 0.25", "dt = 1e4")).discrete()


def test_replaced_periods_are_checked():
    """dt itself may be a constant that is replaced."""
    file = loads(PLANT.replace("a = 0.7", "a = 0.7\nT = 1").replace("dt = 0.25", 'dt = "T"'))
    assert file.replace({"T": 0.25}).discrete().dt == 0.25
    for wrong in (0, -1):
        with pytest.raises(ModelFileError, match=r"model.dt: expected a period > 0, s, received"):
            file.replace({"T": wrong}).discrete()


def test_matrices_are_read_at_any_instant():
    """For a screen that shows numbers: t as given, or t0 + k·dt."""
    file = ready("task12")
    assert close(file.matrix("H", k=3)[1, 0], math.sin(3), EXACT)
    assert close(file.matrix("H", t=0.5)[1, 0], math.sin(0.5), EXACT)
    assert file.matrix("dt") == 1
    with pytest.raises(ModelFileError, match='model: no matrix "h"; did you mean "H"'):
        file.matrix("h")
    with pytest.raises(ModelFileError, match='model: no matrix "N"'):
        file.matrix("N")
    assert file.varying == ("H", "R")
