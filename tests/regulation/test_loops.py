"""Loops over time and in the limit, the machine that runs online, budgets, margins, ensembles."""

from __future__ import annotations

import shutil
import subprocess
import warnings
from dataclasses import replace

import control
import numpy as np
import pytest

from ctlabs import ContinuousModel, Cost, DiscreteModel, kalman_filter, regulator, simulate
from ctlabs.linalg import riccati
from ctlabs.montecarlo import chance
from ctlabs.regulation import Controller, cost_budget, ensemble, lqr, margins, periods, tradeoff
from tests.regulation.plants import INTEGRATOR, MOTOR, MOTOR_COST, continuous, discrete

pytestmark = pytest.mark.numerical

SEEDS = range(6)
MANY = {
    "plain": {},
    "delayed": {"kind": "delayed"},
    "late": {"delay": 0.13},
    "averages": {"average": True},
    "integral": {"integral": {"place": 0.5}},
}


# Over time --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_covariances_over_time_go_to_the_limit(seed):
    model, cost = discrete(seed, offset=seed % 2 == 0)
    loop = regulator(model, cost).closed
    steps = min(int(40 / -np.log(np.abs(loop.poles).max())) + 5, 20000)
    over, limit = loop.covariances(steps), loop.steady()
    for name in ("x", "estimate", "z", "u"):
        mine, theirs = getattr(over, name), getattr(limit, name)
        size = np.sqrt(np.diag(theirs.P))
        assert np.allclose(mine.P[-1] / np.outer(size, size), theirs.P / np.outer(size, size), atol=1e-9)
        assert np.allclose(mine.mean[-1], theirs.mean, atol=1e-9 * (1 + np.abs(theirs.mean).max()))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_error_of_the_estimate_is_the_filters(seed):
    """In the loop x̂⁻ − x has the filter's own covariance, whatever the feedback does, and the estimate does not correlate with it."""
    model, cost = discrete(seed)
    found = regulator(model, cost)
    joint, n = found.closed.steady().joint.P, model.n
    e = np.hstack([-np.eye(n), np.eye(n), np.zeros((n, model.r))])
    size = np.sqrt(np.diag(found.estimator.P_minus))
    assert np.allclose(e @ joint @ e.T / np.outer(size, size), found.estimator.P_minus / np.outer(size, size), atol=1e-8)
    whole = np.sqrt(np.diag(joint)[n : 2 * n])
    assert np.allclose((e @ joint)[:, n : 2 * n] / np.outer(size, whole), 0, atol=1e-8)


@pytest.mark.parametrize("kind", ["current", "delayed"])
def test_a_history_of_the_loop_is_the_controller_on_its_measurements(kind):
    model, cost = discrete(4)
    found = regulator(model, cost, kind=kind)
    history = simulate(found.closed.model, steps=40, runs=1, seed=3)
    z, u = history.z[:, : model.m, 0], history.z[:, model.m :, 0]
    assert np.allclose([found.step(row) for row in z], u, rtol=0, atol=1e-10 * np.abs(u).max())


def test_the_controllers_estimate_is_the_kalman_filters():
    model, cost = discrete(2)
    horizon = replace(cost, Qf=np.eye(model.n), horizon=12)
    found = regulator(model, horizon, first=0)
    z = np.random.default_rng(1).normal(size=(12, model.m))
    u = np.array([found.step(row) for row in z])
    filtered = kalman_filter(model, z, u=u, first=0)
    row = 7
    w = filtered.K[row] * 0 if model.N is None else found.estimator.K_w[row] @ filtered.innovation[row]
    expected = -found.L[row] @ filtered.x_plus[row] - found.L_w[row] @ w
    assert np.allclose(u[row], expected, rtol=1e-9)


def test_continuous_loops_over_time_are_finely_sampled_ones():
    found = regulator(MOTOR, MOTOR_COST)
    over = found.closed.covariances([0.0, 0.5, 2.0])
    fine = regulator(MOTOR, MOTOR_COST, dt=1e-3).closed.covariances(2000)
    assert np.allclose(over.x.P[[1, 2]], fine.x.P[[500, 2000]], rtol=5e-3)
    assert np.array_equal(over.x.P[0], MOTOR.P0)


def test_an_unstable_loop_overflows_with_its_mode():
    loop = regulator(MOTOR, MOTOR_COST, dt=0.1).loop(replace(MOTOR, B=-MOTOR.B))
    with pytest.raises(FloatingPointError, match=r"overflow at step .* eigenvalue"):
        loop.covariances(100_000)


# Online -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", MANY.values(), ids=MANY)
def test_a_saved_controller_goes_on_to_the_bit(options, tmp_path):
    found, z = regulator(MOTOR, MOTOR_COST, dt=0.1, **options), np.random.default_rng(1).normal(size=60)
    z[7] = np.nan
    whole = np.array([found.step(row) for row in z])
    found.restart()
    first = [found.step(row) for row in z[:30]]
    again = Controller.load(found.save(tmp_path / "controller.npz"))
    assert np.array_equal(np.array([*first, *(again.step(row) for row in z[30:])]), whole)


def test_a_damaged_file_is_refused_in_one_line(tmp_path):
    path = regulator(MOTOR, MOTOR_COST, dt=0.1).save(tmp_path / "controller.npz")
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(ValueError, match="foreign or damaged file"):
        Controller.load(path)


@pytest.mark.parametrize("kind", ["current", "delayed"])
def test_a_missing_measurement_tells_nothing(kind):
    found = regulator(MOTOR, MOTOR_COST, dt=0.1, kind=kind)
    one, other = found.controller(), found.controller()
    for z in (1.0, 0.3):
        one.step(z)
        other.step(z)
    expected = (found.machine.H_hat @ other.xi + found.machine.d_hat).item()
    assert np.allclose(one.step(None), other.step(expected), atol=1e-15)
    assert np.allclose(one.xi, other.xi, atol=1e-15)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("options", MANY.values(), ids=MANY)
def test_the_exported_c_is_the_controller(options, tmp_path):
    found = regulator(MOTOR, MOTOR_COST, dt=0.1, **options)
    found.export(tmp_path / "motor.h")
    p = len(found.machine.set_points)
    (tmp_path / "main.c").write_text(
        f"""#include <stdio.h>
#include <string.h>
#include "motor.h"
int main(void) {{
    double xi[motor_q], z[motor_m], {"r[1] = {0.25}, " if p else ""}u[motor_r];
    memcpy(xi, motor_xi0, sizeof xi);
    while (scanf("%lf", z) == 1) {{ motor_step(xi, z, {"r" if p else "NULL"}, u); printf("%.17g\\n", u[0]); }}
    return 0;
}}"""
    )
    cc = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off", "-o", tmp_path / "run", tmp_path / "main.c"]
    subprocess.run([str(part) for part in cc], check=True)
    z = np.random.default_rng(2).normal(size=300)
    z[11] = np.nan
    out = subprocess.run([tmp_path / "run"], input="\n".join(map(repr, z.tolist())), capture_output=True, text=True, check=True).stdout
    mine = np.array([found.step(row, [0.25] if p else None)[0] for row in z])
    assert np.abs(np.array(out.split(), dtype=float) - mine).max() < 1e-12 * np.abs(mine).max()


def test_the_exported_arrays_are_the_machine(tmp_path):
    found = regulator(MOTOR, MOTOR_COST, dt=0.1)
    with np.load(found.export(tmp_path / "a.npz")) as data:
        assert np.array_equal(data["A"], found.machine.A)
        assert data["states"].tolist() == ["place", "speed"]
    with pytest.raises(FileExistsError):
        found.export(tmp_path / "a.npz")
    regulator(MOTOR, MOTOR_COST).export(tmp_path / "c.mat")


# Budgets ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_the_shares_of_a_cost_add_up_to_it(seed):
    model, cost = discrete(seed)
    plain, price = continuous(seed)
    sampled = regulator(replace(plain, N=None), price, dt=0.2)
    for found in (regulator(model, cost), regulator(model, cost, kind="delayed"), regulator(plain, price), sampled):
        budget = cost_budget(found)
        assert sum(budget.sources.values()) + budget.between == pytest.approx(budget.total, rel=1e-10)
        assert sum(budget.weights.values()) + budget.between == pytest.approx(budget.total, rel=1e-10)
        assert budget.known + budget.unknown + budget.between == pytest.approx(budget.total, rel=1e-12)


TORQUE = ContinuousModel(
    [[0, 1, 0], [0, -1, 1], [0, 0, 0]], [[0, 0], [1, 0], [0, 1]], np.diag([1.0, 0.1]), [[1, 0, 0]], Rc=[[0.01]], B=[[0], [1], [0]],
    P0=np.eye(3), states=["place", "speed", "torque"], measurements=["place"],
)  # fmt: skip


def test_a_loop_with_a_load_has_its_budget_and_its_margins():
    """What the load adds is its share; the loop's gain is that of the plant without it."""
    found = regulator(TORQUE, Cost(np.diag([1.1, 0.3, 0]), [[0.7]]), dt=0.1, loads=["torque"], track=["place"])
    budget = cost_budget(found)
    assert sum(budget.sources.values()) + budget.between == pytest.approx(budget.total, rel=1e-10)
    assert sum(budget.weights.values()) + budget.between == pytest.approx(budget.total, rel=1e-10)
    assert "torque" not in budget.weights
    bears = margins(found).inputs["u"]
    for gain, stable in ((bears.gain[1] * 0.999, True), (bears.gain[1] * 1.001, False)):
        poles = np.abs(found.loop(replace(TORQUE, B=gain * TORQUE.B)).poles)
        assert (np.sort(poles)[-2] < 1) == stable  # one is the load itself, which nothing moves


@pytest.mark.parametrize("Rc", [[[0.01]], None], ids=["noisy", "perfect"])
def test_a_continuous_loop_with_a_load_has_its_cost_on_every_route_and_its_budget(Rc):
    """With a perfect measurement the controller carries the reduced filter's states, which estimate other combinations of x."""
    plant = replace(TORQUE, Rc=Rc, G=np.array([[0.3, 0, 0], [0, 1, 0], [0, 0, 1]]), Q=np.diag([1.0, 1.0, 0.1]))
    found = regulator(plant, Cost(np.diag([1.1, 0.3, 0]), [[0.7]]), loads=["torque"], track=["place"])
    assert found.cost.spread < 1e-11
    budget = cost_budget(found)
    assert sum(budget.sources.values()) == pytest.approx(budget.total, rel=1e-10)
    assert sum(budget.weights.values()) == pytest.approx(budget.total, rel=1e-10)


def test_scheduled_gains_have_no_margins():
    scheduled = regulator(MOTOR, replace(MOTOR_COST, horizon=2.0), dt=0.1)
    for verb in (margins, cost_budget):
        with pytest.raises(ValueError, match="scheduled"):
            verb(scheduled)


def test_an_ensemble_without_noise_that_costs_something_else_is_infinitely_far():
    found = regulator(replace(MOTOR, x0=np.array([1.0, 0.0])), MOTOR_COST, dt=0.1, R=[[0.1]])
    quiet = replace(found.plant, Qd=np.zeros((2, 2)), R=np.zeros((1, 1)), P0=np.zeros((2, 2)))
    many = ensemble(found, runs=10, steps=20, seed=1, truth=quiet, progress=False)
    assert many.cost_sd == 0.0
    assert many.score == 0.0
    assert replace(many, cost=many.cost * 1.01).score == np.inf


def test_the_margin_of_all_inputs_together_does_not_depend_on_their_units():
    model, _ = discrete(3)
    plant = replace(model, B=np.random.default_rng(1).normal(size=(model.n, 2)), N=None)
    scales = np.array([1e-3, 40.0])
    one = margins(regulator(plant, Cost(np.eye(model.n), np.eye(2))))
    other = margins(regulator(replace(plant, B=plant.B * scales), Cost(np.eye(model.n), np.diag(scales**2))))
    assert other.together == pytest.approx(one.together, rel=1e-6)
    assert other.inputs["u2"].disk == pytest.approx(one.inputs["u2"].disk, rel=1e-6)


def test_a_loop_that_any_small_gain_stabilises_has_no_lower_margin():
    double = ContinuousModel([[0, 1], [0, 0]], [[0], [1]], [[1]], [[1, 0]], Rc=[[0.01]], B=[[0], [1]], P0=np.eye(2))
    assert margins(regulator(double, Cost(np.diag([1.0, 0]), [[1]]), dt=0.1)).inputs["u"].gain[0] == 0.0


def test_a_source_that_is_taken_away_takes_its_share():
    found = regulator(MOTOR, MOTOR_COST, dt=0.1)
    budget = cost_budget(found)
    quiet = replace(found.plant, R=np.zeros((1, 1)))
    assert found.actual_cost(quiet) == pytest.approx(budget.total - budget.sources["noise of place"], rel=1e-12)


# Margins ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("q", "s"), [(1.0, 1.0), (100.0, 100.0), (1e4, 1e4)])
def test_doyles_plant_is_optimal_and_fragile(q, s):
    """The loop with a gain m: the last coefficients of its polynomial are 1 + (1 − m)df and d + f − 4 + 2(m − 1)df."""
    plant = ContinuousModel([[1, 1], [0, 1]], [[1], [1]], [[s]], [[1, 0]], Rc=[[1]], B=[[0], [1]], P0=np.eye(2))
    found = regulator(plant, Cost(q * np.ones((2, 2)), [[1]]))
    f, d = 2 + np.sqrt(4 + q), 2 + np.sqrt(4 + s)
    assert np.allclose(found.L, [[f, f]], rtol=1e-9)
    assert np.allclose(found.K, [[d], [d]], rtol=1e-9)
    low, high = margins(found).inputs["u"].gain
    assert high == pytest.approx(1 + 1 / (d * f), rel=1e-9)
    assert low > 1 - (d + f - 4) / (2 * d * f)  # which the other coefficient asks for; Routh's scheme asks for more
    for gain, stable in ((0.5 * (1 + high), True), (high * (1 + 1e-6), False), (low * (1 - 1e-6), False)):
        off = found.loop(replace(plant, B=gain * plant.B)).poles.real.max() < 0
        assert off == stable


def known(plant: ContinuousModel, cost: Cost):
    """A loop that knows the state: every state is measured, nearly without noise."""
    return regulator(replace(plant, H=np.eye(2), Rc=1e-16 * np.eye(2), G=np.eye(2), Q=np.eye(2), measurements=("a", "b")), cost)


def test_a_known_state_has_the_guaranteed_margins():
    found = margins(known(MOTOR, MOTOR_COST)).inputs["u"]
    assert found.gain[0] < 0.5
    assert found.gain[1] > 1e3
    assert found.phase > np.pi / 3 - 1e-3
    assert found.modulus > 1 - 1e-3


@pytest.mark.parametrize("dt", [None, 0.1, 0.5])
@pytest.mark.parametrize("options", [{}, {"integral": {"place": 0.5}}])
def test_margins_are_python_controls(dt, options):
    found = regulator(MOTOR, MOTOR_COST, dt=dt, **options) if dt else regulator(MOTOR, MOTOR_COST, **options)
    mine, P = margins(found).inputs["u"], found.plant
    plant = control.ss(P.F if dt is None else P.Phi, P.B, P.H, 0, dt or 0)
    loop = found.compensator * plant
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it interpolates on a grid of its own
        gm, pm, _, _, wgc, _ = control.stability_margins(loop)
    near = 1e-6 if dt is None else 1e-4
    assert mine.gain[1] == pytest.approx(gm, rel=near) or (np.isinf(mine.gain[1]) and np.isinf(gm))
    assert np.degrees(mine.phase) == pytest.approx(pm, rel=near)
    assert mine.crossover == pytest.approx(wgc, rel=near)
    grid = np.geomspace(1e-3, np.pi / (dt or 1e-3), 2000)[:-1]  # steps of less than a hundredth: a minimum to its square
    assert mine.disk == pytest.approx(float(control.disk_margins(loop, grid)[0]), rel=1e-4)
    response = loop(1j * grid) if dt is None else loop(np.exp(1j * grid * dt))
    assert mine.modulus == pytest.approx(np.abs(1 + response).min(), rel=1e-4)
    if dt is None:  # a delay of that size has a pair of poles on the axis: |1 + ℓ e^{-jωT}| = 0 there
        w = mine.crossover
        assert abs(1 + loop(1j * w) * np.exp(-1j * w * mine.delay)) < 1e-6


def test_a_loop_of_two_inputs_is_opened_one_by_one_and_together():
    model, _ = discrete(3)
    rng = np.random.default_rng(1)
    plant = replace(model, B=rng.normal(size=(model.n, 2)), N=None)
    found = regulator(plant, Cost(np.eye(model.n), np.eye(2)))
    both = margins(found)
    assert list(both.inputs) == ["u1", "u2"]
    assert both.together <= min(each.disk for each in both.inputs.values()) + 1e-9
    for i, each in enumerate(both.inputs.values()):
        for gain, stable in ((each.gain[1] * 0.999, True), (each.gain[1] * 1.001, False)):
            if np.isfinite(gain):
                factors = np.ones(2)
                factors[i] = gain
                assert (np.abs(found.loop(replace(plant, B=plant.B * factors)).poles).max() < 1) == stable


# Ensembles --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", MANY.values(), ids=MANY)
def test_an_ensemble_agrees_with_the_covariances_and_the_cost(options):
    found = regulator(replace(MOTOR, x0=np.array([1.0, 0.0])), MOTOR_COST, dt=0.1, **options)
    many = ensemble(found, runs=2000, steps=80, seed=5, progress=False)
    assert chance.variance(many.statistics, many.theory.P)
    assert chance.bias(many.statistics, many.theory.P)
    assert chance.nees(many.statistics)
    assert abs(many.score) < 5
    wrong = many.theory.P * np.where(np.arange(len(many.theory.P[0])) == 0, 1.25, 1.0)
    assert not chance.variance(many.statistics, wrong)


def test_an_ensemble_over_a_horizon_has_the_cost_of_the_design():
    found = regulator(MOTOR, replace(MOTOR_COST, Qf=np.eye(2), horizon=3.0), dt=0.1)
    many = ensemble(found, runs=2000, seed=6, progress=False)
    assert many.cost_expected == pytest.approx(found.cost.value, rel=1e-12)
    assert abs(many.score) < 5


def test_the_spread_of_an_ensembles_cost_is_what_theory_says():
    found = regulator(INTEGRATOR, Cost([[1]], [[0.3]]), dt=1.0, R=[[0.5]])
    scores = [ensemble(found, runs=60, steps=40, seed=seed, progress=False).score for seed in range(150)]
    assert 0.75 < np.std(scores) < 1.25  # χ² with 149 degrees of freedom, within 1e-5


# Trade-offs ------------------------------------------------------------------------------------------------------------


def test_dearer_inputs_are_smaller_and_states_larger():
    curve = tradeoff(MOTOR, MOTOR_COST, [0.01, 0.1, 1, 10], dt=0.1)
    assert (np.diff(curve.u_rms[:, 0]) < 0).all()
    assert (np.diff(curve.x_rms[:, 0]) > 0).all()
    with pytest.raises(ValueError, match="factors: expected numbers > 0"):
        tradeoff(MOTOR, MOTOR_COST, [0.0])


def test_longer_periods_cost_more():
    curve = periods(MOTOR, MOTOR_COST, [0.025, 0.1, 0.25, 0.5])
    assert (np.diff(curve.cost) > 0).all()
    assert curve.cost[0] > regulator(MOTOR, MOTOR_COST).cost.value
    assert lqr(MOTOR, MOTOR_COST).L.shape == (1, 2)


def test_the_equation_of_the_closed_loop_is_solved_when_it_is_asked_for(monkeypatch):
    asked = []
    solve = riccati.stationary
    monkeypatch.setattr(riccati, "stationary", lambda *given, **more: asked.append(given) or solve(*given, **more))
    found = periods(MOTOR, MOTOR_COST, [0.1, 0.2]).members[0]
    whole = regulator(MOTOR, MOTOR_COST)
    assert not asked
    assert found.cost.closed_loop == pytest.approx(found.cost.value, rel=1e-12)
    assert whole.cost.spread < 1e-12
    assert len(asked) == 2


def test_scheduled_gains_end_with_their_horizon():
    found = regulator(DiscreteModel([[1]], [[1]], [[1]], [[1]], B=[[1]], P0=[[1]]), Cost([[1]], [[1]], Qf=[[1]], horizon=3))
    for z in (None, 1.0, 2.0):
        found.step(z)
    with pytest.raises(ValueError, match="at most 3 steps"):
        found.step(0.0)
