"""Nothing known at the start: the diffuse likelihood and the smoother beside statsmodels' exact ones, through the studies too."""

from __future__ import annotations

import numpy as np
import pytest

from ctlabs import DiscreteModel, diagnose, kalman_filter, smooth
from ctlabs.files import datafile, modelfile
from ctlabs.filtering import log_likelihood
from ctlabs.studies import comparison, filtering, fitting, forecasting
from tests.nile import FLOW, Q, R

SEASON = np.array([[-1.0, -1, -1], [1, 0, 0], [0, 1, 0]])
CYCLE = 0.9 * np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
INF = np.inf


def blocks(*parts: np.ndarray) -> np.ndarray:
    """A block diagonal matrix."""
    n = sum(map(len, parts))
    whole, at = np.zeros((n, n)), 0
    for part in parts:
        whole[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return whole


TREND = np.array([[1.0, 1], [0, 1]])
#: Φ, Qd, H, R, and whether each state is unknown at the start (else: its stationary variance).
STRUCTURAL = {
    "Nile": ([[1.0]], [[Q]], [[1.0]], R, [True]),
    "trend": (TREND, np.diag([900.0, 4.0]), [[1.0, 0]], R, [True, True]),
    "trend and season": (blocks(TREND, SEASON), np.diag([400.0, 1, 50, 0, 0]), [[1.0, 0, 1, 0, 0]], 9000.0, [True] * 5),
    "level and cycle": (blocks(np.eye(1), CYCLE), np.diag([100.0, 2000, 2000]), [[1.0, 1, 0]], 5000.0, [True, False, False]),
    "a slope on time": (np.eye(2), np.diag([300.0, 0.0]), np.array([[[1.0, 0.01 * k]] for k in range(len(FLOW))]), R, [True, True]),
}


def structural(name: str) -> tuple[DiscreteModel, np.ndarray]:
    """The model with inf in P0, and the Nile with two gaps."""
    Phi, Qd, H, r, unknown = STRUCTURAL[name]
    cycle = 2000 / (1 - 0.81)  # each of a cycle's two states
    P0 = np.diag([INF if each else cycle for each in unknown])
    z = np.array(FLOW)
    z[[1, 40]] = np.nan
    return DiscreteModel(Phi, Qd, H, [[r]], P0=P0, first=0), z


@pytest.mark.parametrize("name", STRUCTURAL)
def test_the_diffuse_likelihood_and_smoother_are_those_of_statsmodels(name):
    """To 1e-8, with a missing row among those that determine the start."""
    smoothers = pytest.importorskip("statsmodels.tsa.statespace.kalman_smoother", reason="statsmodels is a second route only")
    states = pytest.importorskip("statsmodels.tsa.statespace.initialization", reason="statsmodels is a second route only")
    model, z = structural(name)
    other = smoothers.KalmanSmoother(k_endog=1, k_states=model.n)
    other.bind(z.copy())
    other["design"] = np.moveaxis(model.H, 0, -1) if model.H.ndim == 3 else model.H
    other["obs_cov"], other["transition"], other["selection"], other["state_cov"] = model.R, model.Phi, np.eye(model.n), model.Qd
    start = states.Initialization(model.n)
    for i, variance in enumerate(np.diag(model.P0)):
        if np.isinf(variance):
            start.set(i, "diffuse")
        else:
            start.set(i, "known", constant=[0.0], stationary_cov=[[variance]])
    other.initialize(start)
    right = other.smooth()
    found = kalman_filter(model, z)
    assert found.log_likelihood_diffuse == pytest.approx(right.llf, abs=1e-8)
    assert log_likelihood(model, z) == pytest.approx(right.llf, abs=1e-8)
    whole = smooth(model, found)
    sd = np.sqrt(np.diagonal(whole.P, axis1=1, axis2=2))
    assert (np.abs(whole.x - right.smoothed_state.T) <= 1e-6 * sd).all()
    right_sd = np.sqrt(np.diagonal(right.smoothed_state_cov, axis1=0, axis2=1))
    assert (np.abs(sd - right_sd) <= 1e-6 * sd).all()
    assert np.isfinite(diagnose(model, z).nis_p)


def test_every_study_of_a_record_takes_a_start_without_information():
    """Filter, smoother, fit, forecast and the comparison of forms, of one file with inf in P0; checks pass."""
    file = modelfile.ready("local_linear_trend").edit(("model", "P0"), [["inf", 0], [0, "inf"]]).checked()
    record = datafile.parse(("\n".join([file.measurements[0], *map(str, FLOW[:40])])).encode(), file.measurements)
    reports = [
        filtering.study(file, record, smooth=True),
        forecasting.study(file, record, 3),
        comparison.study(file, record, algorithms="joseph,ud,srif"),
        fitting.study(file, record, list(file.constants)[:1]),
    ]
    for report in reports:
        assert not [check.name for check in report.checks if not check.passed]
    assert all(one["failed"] is None and one["max_error_x"] < 1e-6 for one in reports[2].more["algorithms"])
    assert "log_likelihood_diffuse" in reports[0].values
    assert "log_likelihood_diffuse" in reports[3].values
