"""The gallery: every ready model is what its description says, and the labs' models are the labs' own."""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from ctlabs.files import clock, datafile
from ctlabs.files.modelfile import gallery, ready
from ctlabs.files.modelfile.catalogue import FOLDER
from ctlabs.filtering import bayes, steady
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import covariances
from ctlabs.models import ContinuousModel, DiscreteModel, observability
from ctlabs.models.discretisation import discretise
from tests.reference import EXACT, SOLVER, broken, close, deviation

NAMES = [entry.name for entry in gallery()]
USUAL = [entry.name for entry in gallery() if not entry.lab]
every_model = pytest.mark.parametrize("name", NAMES)


# --- all of them --------------------------------------------------------------------------------------------------------


@every_model
def test_a_ready_model_works(name):
    """It has no problems, a title, a description and a source; its settings give a filter with finite covariances."""
    file, entry = ready(name), next(entry for entry in gallery() if entry.name == name)
    assert file.problems() == []
    assert (file.title, file.kind, file.description, file.source) == (
        entry.title,
        entry.kind,
        entry.description,
        entry.source,
    )
    assert all([entry.title, entry.description, entry.source])
    steps = min(file.experiment.steps, 5)
    plan = covariances(file.discrete(steps=steps), steps, first=file.experiment.first)
    assert np.isfinite(plan.P_plus).all()


@every_model
def test_a_ready_model_teaches(name):
    """It names its states and measurements, says what every constant means, and has comments."""
    entry = next(entry for entry in gallery() if entry.name == name)
    model = tomllib.loads(entry.text)["model"]
    assert {"states", "measurements"} <= set(model)
    told = [constant for constant in ready(name).definitions if constant.meaning]
    assert len(told) >= 1
    assert all(constant.unit for constant in told)
    assert entry.text.count("#") >= 1
    assert max(len(line) for line in entry.text.splitlines()) <= 170


@every_model
def test_every_constant_is_used(name):
    """A slider that moves nothing would mislead."""
    file = ready(name)
    for constant in file.definitions:
        with pytest.raises(ValueError, match="expected a constant that is used nowhere"):
            file.remove_constant(constant.name)


def test_the_gallery_is_the_folder():
    """Each file once, the usual models first; every lab with a linear model is there."""
    assert sorted(NAMES) == sorted(path.stem for path in FOLDER.glob("*.toml"))
    assert NAMES[: len(USUAL)] == USUAL
    found = {entry.lab for entry in gallery() if entry.lab}
    practicum = {name for name, lab in labs.catalogue().items() if not lab.extension}
    assert found >= practicum - {"field"}  # the field's model is made of a partial differential equation


def test_names_say_which_lab():
    """task08_white belongs to lab 8."""
    assert {entry.name: entry.lab for entry in gallery()}["task08_white"] == "task08"
    assert {entry.name: entry.lab for entry in gallery()}["slow_error"] == "slow_error"


# --- the labs -----------------------------------------------------------------------------------------------------------


#: The lab's own models, from its module and its default parameters: continuous, or sampled, or both.
LABS = {
    "task01": lambda m, p: [m.continuous(p), m.model(p, p.R)],
    "task02": lambda m, p: [m.model(p, p.R)],
    "task03": lambda m, p: [m._kinematics.continuous(p), m._kinematics.sampled(p)],
    "task04": lambda m, p: [m._kinematics.continuous(p), m._kinematics.sampled(p)],
    "task05": lambda m, p: [m.continuous(p), m.variants(p)[0]],
    "task06": lambda m, p: [m.model(p.P0, p.R)],
    "task07": lambda m, p: [m.model(p.Phi, p.Q, p.R, p.P0)],
    "task08": lambda m, p: [m.truth_system(p.a, p.T, p.sigma_y2), m.models(p.a, p.T, p.dt, p.R, p.sigma_y2)[0]],
    "task08_white": lambda m, p: [m.models(p.a, p.T, p.dt, p.R, p.sigma_y2)[1]],
    "task09": lambda m, p: [m.system(p), discretise(m.system(p), p.dt, R=[[p.R_over_b2]])],
    "task10": lambda m, p: [m.model(p), m.sampled(p, p.dt_bad)],
    "task11": lambda m, p: [m.model([p.x1_mean], [[m.by_hand.start(p)]], [[p.Q]], [[p.R]])],
    "task12": lambda m, p: [m.model(p, np.arange(m.STEPS + 1.0))],
    "task13": lambda m, p: [m.model(p.N_c, p.N_m, p.var_hc0, p.mean_hc0), discretise(m.model(p.N_c, p.N_m, p.var_hc0, p.mean_hc0), p.dt)],
    "task14": lambda m, p: [m.model(p, *([p.sigma**2] * 3))],
    "task15": lambda m, p: [m.continuous(p.w0, p.wn, p.Q1, p.Q2, p.Es2, p.En2), m.model(p)],
    "task16": lambda m, p: [m.model(p), discretise(m.model(p), p.dt)],
    "task17": lambda m, p: [m.model(p), discretise(m.model(p), p.dt)],
    "task17_two": lambda m, p: [m.unreduced(p)],
    "task18": lambda m, p: [m.measured(p), discretise(m.measured(p), p.dt, R=m.scales.noise(p))],
    "task19": lambda m, p: [m.model(p), discretise(m.model(p), p.dt)],
    "task20": lambda m, p: [m.model(p, p.R_values[0]), discretise(m.model(p, p.R_values[0]), p.dt)],
    "task21": lambda m, p: [m.model(p, 40)],
    "task22": lambda m, p: [m.model(p), discretise(m.model(p), p.dt, R=[[0]])],
    "task23": lambda m, p: [m.model(p), discretise(m.model(p), p.dt, R=[[0]])],
    "task24": lambda m, p: [m.model(p)],
    "task25": lambda m, p: [m.integrator(p), discretise(m.integrator(p), p.dt)],
    "task26": lambda m, p: [m.plant(p)],
    "coloured_plant": lambda m, p: [m.models(p)["example"]],
    "slow_error": lambda m, p: [bayes.model(m.constants(p, count=10))],
}  # fmt: skip


def noise(model):
    """What drives the states, (n, n): one noise of strength zero more or less makes no difference."""
    return model.G @ model.Q @ model.G.T


def differences(found, expected) -> dict[str, float]:
    """How far two models are apart, matrix by matrix; what one leaves out and the other has as 0 is the same."""
    if isinstance(expected, ContinuousModel):
        pairs = {name: (getattr(found, name), getattr(expected, name)) for name in ("F", "H", "x0", "P0")}
        pairs["GQG'"] = (noise(found), noise(expected))
        if expected.Rc is not None:
            pairs["Rc"] = (found.Rc, expected.Rc)
    else:
        pairs = {name: (getattr(found, name), getattr(expected, name)) for name in ("Phi", "Qd", "H", "x0", "P0")}
        offsets = [np.zeros(len(m.x0)) if m.offset is None else m.offset for m in (found, expected)]
        pairs["offset"] = (offsets[0], offsets[1])
        pairs["R"] = (found.R, expected.R if expected.R.ndim == found.R.ndim else expected.R[1])
        pairs["dt"] = (found.dt, expected.dt)
    return {name: deviation(*pair) if np.any(pair[1]) else float(np.abs(pair[0]).max()) for name, pair in pairs.items()}


@pytest.mark.parametrize("name", sorted(LABS))
def test_a_labs_model_is_the_labs_own(name):
    """Matrix by matrix, with the lab's default parameters; states have its names. Φ of task10 is rounded in the lab."""
    entry = next(entry for entry in gallery() if entry.name == name)
    module = labs.load(labs.catalogue()[entry.lab])
    file, parameters = ready(name), module.Parameters()
    for expected in LABS[name](module, parameters):
        found = (
            file.continuous()
            if isinstance(expected, ContinuousModel)
            else file.discrete(expected.horizon if file.varying else None)
        )
        apart = differences(found, expected)
        assert max(apart.values()) < EXACT, apart
        assert found.states == expected.states
        assert found.units == expected.units or set(expected.units) == {""}
        if isinstance(found, DiscreteModel):
            wrong = replace(found, Qd=broken(found.Qd)) if found.Qd.any() else replace(found, P0=broken(found.P0))
            assert max(differences(wrong, expected).values()) > 1e-3


def test_every_lab_is_compared():
    """No lab's file escapes the comparison."""
    assert set(LABS) == {entry.name for entry in gallery() if entry.lab}


def test_a_list_of_measurement_variances_is_the_last_one_repeated():
    """Lab 6's six variances are all one, as its file has it."""
    p = labs.load(labs.catalogue()["task06"]).Parameters()
    assert set(p.R) == {ready("task06").constants["R"]}


# --- the usual ones -----------------------------------------------------------------------------------------------------


def frequency_response(model, s):
    """H (sI − F)⁻¹ G."""
    return (model.H @ np.linalg.solve(s * np.eye(model.n) - model.F, model.G)).ravel()[0]


S = [0.3j, 1.0 + 2.0j, 50.0j]


def check_response(file, G):
    """The model's transfer function at three points, relative to its size."""
    for s in S:
        expected = G(s)
        assert abs(frequency_response(file.continuous(), s) - expected) < EXACT * abs(expected)
        assert abs(
            frequency_response(replace(file.continuous(), F=broken(file.continuous().F)), s) - expected
        ) > 1e-6 * abs(expected)


def test_local_level_is_the_nile():
    """One random walk in noise; the steady gain is the closed form of lab 1."""
    file = ready("local_level")
    q, r = 1469.1, 15099.0
    assert (file.matrix("Qd"), file.matrix("R"), file.matrix("Phi")) == (q, r, 1)
    ratio = q / r
    assert close(steady.solve(file.discrete()).K, 0.5 * (-ratio + math.sqrt(ratio**2 + 4 * ratio)), SOLVER)


def test_local_linear_trend_is_the_discrete_double_sum():
    """A level that rises by the slope: the second difference of its mean is zero."""
    model = ready("local_linear_trend").discrete()
    path = [np.linalg.matrix_power(model.Phi, k) @ [5, 2] for k in range(3)]
    assert [x[0] for x in path] == [5, 7, 9]
    assert np.array_equal(model.Qd, np.diag([1, 0.01]))


@pytest.mark.parametrize(("name", "n"), [("constant_velocity", 2), ("constant_acceleration", 3)])
def test_integrators_in_a_row(name, n):
    """G(s) = 1/sⁿ; Φ_ij = τ^(j−i)/(j−i)!, Qd_ij = qτ^(2n+1−i−j)/((n−i)!(n−j)!(2n+1−i−j)) in closed form."""
    file = ready(name)
    check_response(file, lambda s: 1 / s**n)
    q, T, found = file.constants["q"], 0.7, file.replace({"T": 0.7}).discrete()
    f = math.factorial
    Phi = [[T ** (j - i) / f(j - i) if j >= i else 0 for j in range(n)] for i in range(n)]
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    power = 2 * n - 1 - i - j
    Qd = q * T**power / (power * np.vectorize(f)(n - 1 - i) * np.vectorize(f)(n - 1 - j))
    assert close(found.Phi, Phi, EXACT)
    assert close(found.Qd, Qd, EXACT)
    assert not close(found.Qd, broken(Qd), EXACT)


def test_gauss_markov_is_stationary():
    """Φ = e^(−dt/τ), Qd = σ²(1 − Φ²): the variance stays σ², the correlation falls to 1/e after τ."""
    file = ready("gauss_markov")
    check_response(file, lambda s: 1 / (s + 0.1))
    model = file.discrete()
    assert close(model.Phi, math.exp(-0.1), EXACT)
    assert close(model.Qd, 4 * (1 - math.exp(-0.2)), EXACT)
    assert close(model.Phi @ model.P0 @ model.Phi.T + model.Qd, model.P0, EXACT)
    wrong = broken(model.Qd)
    assert not close(model.Phi @ model.P0 @ model.Phi.T + wrong, model.P0, 1e-3)


@pytest.mark.parametrize("change", [{}, {"omega0": 0.5, "zeta": 0.9}, {"q": 3.0, "zeta": 0.01}])
def test_oscillator_is_its_transfer_function_and_stationary(change):
    """1/(s² + 2ζω₀s + ω₀²), and the P0 of the file does not change in time, whatever the constants."""
    file = ready("oscillator").replace(change)
    omega, zeta = file.constants["omega0"], file.constants["zeta"]
    check_response(file, lambda s: 1 / (s * s + 2 * zeta * omega * s + omega**2))
    model = file.discrete()
    assert close(model.Phi @ model.P0 @ model.Phi.T + model.Qd, model.P0, SOLVER)


def test_singer_is_singers():
    """1/(s²(s + 1/τ)); Φ in Singer's closed form, the acceleration stationary, the limit τ → ∞ constant acceleration."""
    file = ready("singer")
    tau, T = 20.0, 2.0
    check_response(file, lambda s: 1 / (s * s * (s + 1 / tau)))
    fall = math.exp(-T / tau)
    Phi = [[1, T, tau**2 * (-1 + T / tau + fall)], [0, 1, tau * (1 - fall)], [0, 0, fall]]
    model = file.discrete()
    assert close(model.Phi, Phi, EXACT)
    assert close(fall**2 * 9 + model.Qd[2, 2], 9, EXACT)
    x = T / tau
    first = 9 * tau**4 * (1 - math.exp(-2 * x) + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * math.exp(-x))
    assert close(model.Qd[0, 0], first, SOLVER)  # Singer's q11, in which 13 digits of 1 cancel to x⁵


def test_rc_ladder_is_its_transfer_function():
    """1/(R1C1R2C2 s² + (R1C1 + R1C2 + R2C2)s + 1): the output without a load, 1 at rest."""
    file = ready("rc_ladder")
    c = file.constants
    R1, C1, R2, C2 = c["R1"], c["C1"], c["R2"], c["C2"]
    model = file.continuous()
    for s in (0.0, 300.0j, 1e4 + 2e3j):
        expected = 1 / (R1 * C1 * R2 * C2 * s**2 + (R1 * C1 + R1 * C2 + R2 * C2) * s + 1)
        assert abs(frequency_response(model, s) - expected) < EXACT * abs(expected)
        assert abs(expected - 1 / ((R1 * C1 * s + 1) * (R2 * C2 * s + 1))) > 1e-3 * abs(expected) or s == 0


def test_orbit_has_the_transition_matrix_of_clohessy_and_wiltshire():
    """Φ in closed form, after a minute and after a revolution; and Kepler's third law gives the revolution of a low orbit."""
    file = ready("orbit")
    w = file.constants["omega"]
    assert 2 * math.pi / w == pytest.approx(5553, abs=1)  # seconds, at 400 km
    for t in (60.0, 2 * math.pi / w):
        c, s = math.cos(w * t), math.sin(w * t)
        Phi = np.array([
            [4 - 3 * c, s / w, 0, 2 * (1 - c) / w],
            [3 * w * s, c, 0, 2 * s],
            [6 * (s - w * t), 2 * (c - 1) / w, 1, 4 * s / w - 3 * t],
            [6 * w * (c - 1), -2 * s, 0, 4 * c - 3],
        ])  # fmt: skip
        scale = np.array([1, w, 1, w])
        found = file.discrete(times=[0, t]).Phi
        assert close(found / scale[:, None] * scale, Phi / scale[:, None] * scale, SOLVER)


def test_pendulum_swings_as_it_should():
    """Poles at −d/2 ± i√(g/l − d²/4): a seconds pendulum swings for two; the angle is seen through the rate."""
    file = ready("pendulum").replace({"l": 0.994, "d": 0})
    poles = np.linalg.eigvals(file.continuous().F)
    assert 2 * math.pi / abs(poles[0].imag) == pytest.approx(2, rel=1e-3)
    check_response(ready("pendulum"), lambda s: s / (s * s + 0.2 * s + 9.81))


def test_inverted_pendulum_falls_and_its_filter_does_not():
    """One pole at −d/2 + √(d²/4 + g/l) > 0; the filter's own poles are inside the unit circle."""
    file = ready("inverted_pendulum")
    expected = -0.1 + math.sqrt(0.01 + 9.81)
    assert np.linalg.eigvals(file.continuous().F).real.max() == pytest.approx(expected, rel=1e-12)
    model = file.discrete()
    K = steady.solve(model).K
    assert np.abs(np.linalg.eigvals((np.eye(2) - K @ model.H) @ model.Phi)).max() < 0.99


def test_motor_follows_its_voltage():
    """θ(s)/u(s) = c/(s(s + a)); the mean moves by the voltage at the beginning of each interval."""
    file = ready("motor")
    driven = replace(file.continuous(), G=file.continuous().B)
    check_response(file, lambda s: 1 / (s * (s + 2)))
    assert abs(frequency_response(driven, 2j) - 5 / (2j * (2j + 2))) < EXACT
    model, h = file.discrete(), 0.05
    assert model.offset.shape == (200, 2)
    gain = 5 * np.array([h / 2 - (1 - math.exp(-2 * h)) / 4, (1 - math.exp(-2 * h)) / 2])
    for k in (0, 1, 7):
        assert close(model.offset[k], gain * 3 * math.sin(2 * math.pi * 0.5 * k * h), SOLVER, size=1e-3)


def test_gyro_bias_has_farrenkopfs_noise():
    """Qd = [[N²T + K²T³/3, −K²T²/2], [·, K²T]]; the reading of the gyro turns the angle."""
    file = ready("gyro_bias")
    N, K, T = 1e-4, 1e-6, 10.0
    model = file.discrete()
    Qd = [[N**2 * T + K**2 * T**3 / 3, -(K**2) * T**2 / 2], [-(K**2) * T**2 / 2, K**2 * T]]
    assert close(model.Qd, Qd, EXACT)
    assert close(model.Phi, [[1, -T], [0, 1]], EXACT)
    assert close(model.offset, [0.001 * T, 0], EXACT)


def test_satellite_receiver_takes_the_dilution_of_each_row():
    """R = (σ·hdop)²/2 of the row, or of the constant without a record; each axis is constant_velocity."""
    file, line = ready("satellite_receiver"), ready("constant_velocity").continuous()
    model = file.continuous()
    assert np.array_equal(model.F, np.kron(line.F, np.eye(2)))
    assert np.array_equal(model.H, np.kron(line.H, np.eye(2)))
    record = datafile.parse(b"t,east,north,hdop\n1,0,0,1\n2,3,1,4\n3,6,2,\n", file.measurements, mapping=file.mapping)
    R = clock.timed(file, record)[0].R
    assert close(R[1], 4.5 * np.eye(2), EXACT)
    assert close(R[2], 72 * np.eye(2), EXACT)
    assert np.isinf(np.diag(R[3])).all()
    assert close(file.discrete().R, 0.5 * 3.6**2 * np.eye(2), EXACT)


def test_crane_keeps_its_angular_momentum_without_gravity():
    """With g = 0 the momentum l²·dθ/dt is constant: the rate falls as (l0/l)², the angle rises by l0·ω·vt/(v·l)."""
    file = ready("crane").replace({"g": 0, "q": 0})
    model = file.discrete(steps=40)
    Phi = np.linalg.multi_dot(model.Phi[::-1])
    t, l0, v = 4.0, 2.0, 0.5
    length = l0 + v * t
    assert close(Phi, [[1, l0 * t / length], [0, (l0 / length) ** 2]], SOLVER)


def test_crane_on_a_rope_that_does_not_grow_is_a_pendulum():
    """v = 0 is the harmonic oscillator with ω² = g/l0."""
    model = ready("crane").replace({"v": 0}).discrete(steps=3)
    w = math.sqrt(9.81 / 2)
    c, s = math.cos(0.1 * w), math.sin(0.1 * w)
    for Phi in model.Phi:
        assert close(Phi, [[c, s / w], [-w * s, c]], EXACT)


def test_ill_conditioned_is_biermans():
    """P0 = I, H and R of delta: 1 + δ is a double and 1 + δ² is 1; the exact variance of x3 after two measurements is far below 1."""
    file = ready("ill_conditioned")
    model, delta = file.discrete(), file.constants["delta"]
    assert np.array_equal(model.H, [[1, 1, 1], [1, 1, 1 + delta]])
    assert np.array_equal(model.R, delta**2 * np.eye(2))
    assert 1 + delta > 1 == 1 + delta**2
    assert np.array_equal(model.P0, np.eye(3))
    assert np.array_equal(model.Qd, 1e-16 * np.eye(3))


# --- plants to be regulated: from each input to each measurement -----------------------------------------------------------


def answer(name, s):
    """H(sI − F)⁻¹B, (m, r)."""
    plant = ready(name).plant()
    return plant.H @ np.linalg.solve(s * np.eye(plant.n) - plant.F, plant.B.astype(complex))


def test_double_integrator_is_newtons_law():
    """1/(m s²)."""
    assert close(answer("double_integrator", 2j), [[1 / (2j) ** 2]], EXACT)


def test_dc_motor_has_its_time_constant():
    """1/(s(τs + 1)), of the torque as of the voltage."""
    assert close(answer("dc_motor", 2j), [[1 / (2j * (2j + 1))]], EXACT)
    assert np.array_equal(ready("dc_motor").plant().G, ready("dc_motor").plant().B)


def test_cart_pendulum_is_lagranges_equations():
    """(M+m)s²X + m l s²Θ + bsX = U and s²X + l s²Θ = gΘ, before they are solved for the accelerations."""
    s, M, m, length, b, g = 2j, 1.0, 0.1, 0.5, 0.1, 9.81
    expected = np.linalg.solve([[(M + m) * s**2 + b * s, m * length * s**2], [s**2, length * s**2 - g]], [[1], [0]])
    assert close(answer("cart_pendulum", s), expected, EXACT)


def test_autopilot_is_that_of_lab_13():
    """0.3(s + 0.01)/(s² + 0.006s + 0.003), of the correction as of the command and its noise."""
    s = 0.05j
    assert close(answer("autopilot", s), [[0.3 * (s + 0.01) / (s * s + 0.006 * s + 0.003)]], EXACT)
    plant, lab = ready("autopilot").plant(), ready("task13").continuous()
    assert np.array_equal(plant.F, lab.F)
    assert np.array_equal(plant.B, lab.G)
    assert np.array_equal(plant.F[:2, 2:], plant.B[:2])


def test_satellite_thrust_is_that_of_lab_18():
    """Its free motion is the lab's; a radial acceleration moves the radius, a tangential one turns the angle by 1/r0."""
    plant, lab = ready("satellite_thrust").plant(), ready("task18").continuous()
    assert np.array_equal(plant.F, lab.F)
    high = answer("satellite_thrust", 1e3j) * (1e3j) ** 2  # of quick motions nothing but the acceleration is left
    assert close(np.array([[7e6], [1]]) * high, [[0, 1], [1, 0]], 1e-5)


def test_two_tanks_drain_one_into_the_other():
    """(1/A)(c/A)/(s + c/A)² from the pump to the lower level."""
    s, rate = 0.01j, 4e-4 / 0.02
    assert close(answer("two_tanks", s), [[50 / (s + rate)], [50 * rate / (s + rate) ** 2]], EXACT)


def test_the_usual_models_are_all_tested():
    """Every file that belongs to no lab is named in a test above."""
    from pathlib import Path

    text = Path(__file__).read_text(encoding="utf-8")
    assert [name for name in USUAL if text.count(f'"{name}"') < 1] == []


def test_ready_models_stay_observable():
    """But for those that are about what cannot be seen, at once or nearly."""
    hidden = {"task17_two", "slow_error", "task10", "ill_conditioned"}
    for name in set(NAMES) - hidden:
        model = ready(name).discrete(steps=3)
        if model.horizon is None:
            scale = np.sqrt(np.where(np.diag(model.P0) > 0, np.diag(model.P0), 1))
            scaled = replace(model, Phi=model.Phi / scale[:, None] * scale, H=model.H * scale)
            assert observability.analyse(scaled).ok, name
    assert not observability.analyse(ready("task17_two").discrete()).ok


def test_the_ladders_stationary_variance_is_that_of_the_noise():
    """After a second, many time constants, Qd from empty capacitors is the solution of the Lyapunov equation."""
    file = ready("rc_ladder")
    F, W = file.continuous().F, noise(file.continuous())
    P = scipy.linalg.solve_continuous_lyapunov(F, -W)
    long = file.discrete(times=[0, 1.0]).Qd
    assert close(long, P, SOLVER)
