"""The foundation: start-up, lab 7, and an ensemble filtered with histories against filterpy's loop over runs.

python benchmarks/foundation.py prints medians of five and exits 1 when a stated limit is missed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile

import filterpy
import numpy as np
from filterpy.kalman import KalmanFilter
from timing import REPEATS, median

from ctlabs import kalman_filter, montecarlo
from ctlabs.models import DiscreteModel

MODEL = DiscreteModel(
    Phi=[[1, 1], [0, 1]], Qd=[[1 / 3, 1 / 2], [1 / 2, 1]], H=[[1, 0]], R=[[1]], x0=[0, 0], P0=[[100, 0], [0, 10]], dt=1
)
RUNS, STEPS, LOOPED = 1000, 1000, 20


def main() -> int:
    """Print the table; 1 if a limit is missed."""
    print(
        f"Python {sys.version.split()[0]}, numpy {np.__version__}, filterpy {filterpy.__version__}; medians of {REPEATS}"
    )
    rows = [
        ("import ctlabs, s", median(lambda: command("-c", "import ctlabs")), 0.3, "at most"),
        ("ctlabs list, s", median(lambda: command("-m", "ctlabs", "list")), 0.3, "at most"),
        ("lab 7 with default runs, s", median(lab7), 8.0, "at most"),
        (f"{RUNS} runs x {STEPS} steps: filterpy's loop / filter_runs", ensemble(), 150.0, "at least"),
    ]
    missed = 0
    for name, found, limit, kind in rows:
        good = found <= limit if kind == "at most" else found >= limit
        missed += not good
        print(f"{name:<58} {found:9.3g}   {kind} {limit:g}   {'' if good else 'MISSED'}")
    return int(missed > 0)


def command(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)


def lab7() -> None:
    with tempfile.TemporaryDirectory() as out:
        command("-m", "ctlabs", "run", "7", "--out", out)


def ensemble() -> float:
    """How much faster one pass with all runs is than filterpy looped over the runs (a part of them, scaled)."""
    z = montecarlo.simulate(MODEL, STEPS, RUNS, seed=1).z
    estimates = kalman_filter(MODEL, z).x_plus[1:, :, :LOOPED]
    looped = np.stack([loop(z[:, :, run]) for run in range(LOOPED)], axis=-1)
    worst = np.abs(estimates - looped).max() / np.abs(looped).max()
    if worst > 1e-12:
        sys.exit(f"filter_runs and filterpy's loop differ by {worst:.1e}")
    ours = median(lambda: kalman_filter(MODEL, z))
    theirs = median(lambda: [loop(z[:, :, run]) for run in range(LOOPED)]) * RUNS / LOOPED
    return theirs / ours


def loop(z: np.ndarray) -> np.ndarray:
    """One run through filterpy, as its documentation shows it; the estimates after each update."""
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.x, kf.P = np.array(MODEL.x0)[:, None], np.array(MODEL.P0)
    kf.F, kf.Q, kf.H, kf.R = MODEL.Phi, MODEL.Qd, MODEL.H, MODEL.R
    found = np.empty((STEPS, 2))
    for k in range(STEPS):
        kf.predict()
        kf.update(z[k])
        found[k] = kf.x[:, 0]
    return found


if __name__ == "__main__":
    sys.exit(main())
