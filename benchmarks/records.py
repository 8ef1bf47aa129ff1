"""One long record through the compiled filter, against statsmodels' compiled one; filterpy's loop is the slow reference.

python benchmarks/records.py prints medians of seven and exits 1 when a stated ratio is missed. What is timed on both sides
is a call that leaves every history (predicted and filtered moments, innovations, their covariances, the likelihood);
statsmodels has its default options, its own shortcut for settled covariances among them. Both take turns, so that
whatever else the machine does falls on both. Before that, the outputs are compared, with that shortcut off: it stops
earlier than ours, at errors near 1e-9.
"""

from __future__ import annotations

import statistics
import sys
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from timing import REPEATS, median, timed

from ctlabs import montecarlo
from ctlabs.filtering import Filtered, kalman_filter, log_likelihood, smooth
from ctlabs.models import DiscreteModel

STEPS, LOOPED = 200_000, 2_000
EQUAL = 1e-10
#: Position and speed along two axes; both positions are measured, with correlated errors.
AXIS_PHI, AXIS_QD = np.array([[1.0, 0.1], [0.0, 0.98]]), np.array([[1e-4, 1e-3], [1e-3, 2e-2]])
MODEL = DiscreteModel(
    Phi=np.kron(np.eye(2), AXIS_PHI),
    Qd=np.kron(np.eye(2), AXIS_QD),
    H=[[1, 0, 0, 0], [0, 0, 1, 0]],
    R=[[0.5, 0.1], [0.1, 0.4]],
    x0=np.zeros(4),
    P0=10 * np.eye(4),
    dt=0.1,
)


def main() -> int:
    """Print the table; 1 if a limit is missed."""
    try:
        print(
            f"Python {sys.version.split()[0]}, "
            + ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "statsmodels", "filterpy"))
            + f"; {STEPS} samples, n = {MODEL.n}, m = {MODEL.m}; medians of {REPEATS}"
        )
    except PackageNotFoundError as missing:
        print(f"skipped: {missing.name} is not installed (pip install 'ctlabs[test]')")
        return 0
    missed = 0
    for name, model, z, limit in cases():
        ours, theirs, ratio = compare(model, z)
        good = ratio <= limit
        missed += not good
        print(
            f"{name:<44} {ours:7.3f} s, statsmodels {theirs:7.3f} s: {ratio:6.3f}   at most {limit:g}   "
            f"{'' if good else 'MISSED'}"
        )
    others()
    return int(missed > 0)


def cases() -> list[tuple[str, DiscreteModel, np.ndarray, float]]:
    """What is filtered, and the limit of its ratio."""
    rng = np.random.default_rng(1)
    z = montecarlo.simulate(MODEL, STEPS, 1, seed=1).z[:, :, 0]
    holes = np.where(rng.uniform(size=z.shape) < 0.1, np.nan, z)
    scale = rng.uniform(0.8, 1.2, (4, STEPS + 1, 1, 1))
    varying = replace(
        MODEL,
        Phi=0.5 * (scale[0, 1:] * MODEL.Phi + MODEL.Phi) / 1.05,
        Qd=scale[1, 1:] * MODEL.Qd,
        H=scale[2] * MODEL.H,
        R=scale[3] * MODEL.R,
    )
    return [
        ("constant matrices", MODEL, z, 0.5),
        ("constant matrices, a tenth missing", MODEL, holes, 2.0),
        ("Phi, Qd, H, R all vary", varying, z, 2.0),
        ("all vary, a tenth missing", varying, holes, 2.0),
    ]


def compare(model: DiscreteModel, z: np.ndarray) -> tuple[float, float, float]:
    """Seconds of both and their ratio, after their outputs were found equal."""
    other = statsmodels_filter(model, z)
    check(kalman_filter(model, z), statsmodels_filter(model, z, tolerance=0).filter())
    pairs = [(timed(lambda: kalman_filter(model, z)), timed(other.filter)) for _ in range(REPEATS)]
    ours, theirs = (statistics.median(times) for times in zip(*pairs, strict=True))
    return ours, theirs, statistics.median(own / its for own, its in pairs)


def check(own: Filtered, other: Any) -> None:
    """Leave where the histories differ."""
    pairs = {
        "x_minus": (own.x_minus[1:], other.predicted_state[:, :-1].T),
        "x_plus": (own.x_plus[1:], other.filtered_state.T),
        "P_minus": (own.P_minus[1:], np.moveaxis(other.predicted_state_cov[:, :, :-1], -1, 0)),
        "P_plus": (own.P_plus[1:], np.moveaxis(other.filtered_state_cov, -1, 0)),
        "log_likelihood": (np.array(own.log_likelihood), np.array(other.llf_obs.sum())),
    }
    for name, (a, b) in pairs.items():
        difference = np.abs(a - b).max() / np.abs(b).max()
        if not difference <= EQUAL:
            sys.exit(f"{name}: ctlabs and statsmodels differ by {difference:.1e}")


def statsmodels_filter(model: DiscreteModel, z: np.ndarray, **options: Any) -> Any:
    """statsmodels' filter of the same record: it starts from the moments predicted for the first measurement, at t1."""
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

    def moving(matrix: np.ndarray) -> np.ndarray:
        """From k = 1 on; a constant one as it is. What follows the last measurement is not used."""
        return matrix if matrix.ndim == 2 else np.moveaxis(np.concatenate([matrix[1:], matrix[-1:]])[:STEPS], 0, -1)

    kf = KalmanFilter(k_endog=model.m, k_states=model.n, **options)
    kf.bind(np.ascontiguousarray(z))
    kf["design"], kf["obs_cov"], kf["selection"] = moving(model.H), moving(model.R), np.eye(model.n)
    kf["transition"], kf["state_cov"] = moving(model.Phi), moving(model.Qd)
    Phi = model.Phi if model.Phi.ndim == 2 else model.Phi[0]
    Qd = model.Qd if model.Qd.ndim == 2 else model.Qd[0]
    kf.initialize_known(Phi @ model.x0, Phi @ model.P0 @ Phi.T + Qd)
    return kf


def others() -> None:
    """The slow reference, and what the same record costs elsewhere: no limits."""
    z = montecarlo.simulate(MODEL, STEPS, 1, seed=1).z[:, :, 0]
    own, looped = kalman_filter(MODEL, z), filterpy_loop(z[:LOOPED])
    difference = np.abs(own.x_plus[1 : LOOPED + 1] - looped).max() / np.abs(looped).max()
    if difference > EQUAL:
        sys.exit(f"filter_record and filterpy's loop differ by {difference:.1e}")
    rows = {
        f"filterpy's loop ({LOOPED} samples, scaled)": median(lambda: filterpy_loop(z[:LOOPED])) * STEPS / LOOPED,
        "log_likelihood alone": median(lambda: log_likelihood(MODEL, z)),
        "smooth": median(lambda: smooth(MODEL, own)),
        "smooth, lag of 20 steps": median(lambda: smooth(MODEL, z, lag=20)),
    }
    for name, seconds in rows.items():
        print(f"{name:<44} {seconds:7.3f} s")


def filterpy_loop(z: np.ndarray) -> np.ndarray:
    """The estimates after each update, as filterpy's documentation shows the loop."""
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(dim_x=MODEL.n, dim_z=MODEL.m)
    kf.x, kf.P = np.array(MODEL.x0)[:, None], np.array(MODEL.P0)
    kf.F, kf.Q, kf.H, kf.R = MODEL.Phi, MODEL.Qd, MODEL.H, MODEL.R
    found = np.empty((len(z), MODEL.n))
    for k in range(len(z)):
        kf.predict()
        kf.update(z[k])
        found[k] = kf.x[:, 0]
    return found


if __name__ == "__main__":
    sys.exit(main())
