"""How fast is a Monte-Carlo experiment? Every ratio from one run, with the peers that are installed.

    python benchmarks/montecarlo.py [--all] [--repeat 7]

The experiment is lab 3's (position and velocity, position measured): 1000 runs of 1000 steps with full statistics, on one
thread, the whole call from the model to the statistics. What it is compared with:

- **drawing**: numpy filling an array with the 3·10⁶ normals that the experiment takes, ``default_rng().standard_normal``;
- **filterpy**: a loop over runs and steps with ``KalmanFilter.predict`` and ``update`` on the same records (a few runs, scaled);
- **jax**: the same experiment (draw, simulate, filter, accumulate) with ``lax.scan`` inside ``vmap`` and ``jit``, in float64;
- **products**, for n = 20, m = 5: the limit of a method that steps a block of runs together, namely numpy drawing the
  block's normals and one BLAS thread doing the products that no such method avoids, each once per step: Φx, Gξ, Φx̂, Hx,
  Lξ, Hx̂, Kν, We, Vν, eeᵀ;
- with ``--all``: the peak memory of 10⁶ runs of 1000 steps, and a local Dask cluster of two workers against two threads
  on 10⁹ run-steps.

Times are medians; a ratio is the median of ratios of times taken one after the other, so that what else the machine does
falls on both. Outputs are compared before anything is timed. The exit status is 1 if a stated ratio is missed.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ctlabs import montecarlo
from ctlabs.filtering import covariances
from ctlabs.models import DiscreteModel
from ctlabs.montecarlo.executors import one_thread

STEPS, RUNS = 1000, 1000
LAB3 = DiscreteModel(
    Phi=[[1, 1], [0, 1]], Qd=[[1 / 3, 1 / 2], [1 / 2, 1]], H=[[1, 0]], R=[[1]], x0=[0, 0], P0=[[100, 0], [0, 10]], dt=1.0
)  # fmt: skip


def experiment(runs: int = RUNS, workers: int = 1, **options: object) -> montecarlo.Statistics:
    return montecarlo.monte_carlo(LAB3, steps=STEPS, runs=runs, seed=1, workers=workers, progress=False, **options)


def seconds(function: Callable[[], object]) -> float:
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def compared(first: Callable[[], object], second: Callable[[], object], repeat: int) -> tuple[float, float, float]:
    """Median times of two functions, called in turn, and the median of second over first."""
    times = np.array([(seconds(first), seconds(second)) for _ in range(repeat)])
    return float(np.median(times[:, 0])), float(np.median(times[:, 1])), float(np.median(times[:, 1] / times[:, 0]))


def draw() -> np.ndarray:
    return np.random.default_rng(1).standard_normal(3 * STEPS * RUNS)


def filterpy_loop(z: np.ndarray) -> np.ndarray:
    """Final estimates of every run of z (steps, 1, runs), one run after the other."""
    from filterpy.kalman import KalmanFilter

    final = np.empty((2, z.shape[2]))
    for r in range(z.shape[2]):
        kf = KalmanFilter(dim_x=2, dim_z=1)
        kf.F, kf.H, kf.Q, kf.R = LAB3.Phi, LAB3.H, LAB3.Qd, LAB3.R
        kf.x, kf.P = np.zeros((2, 1)), LAB3.P0.copy()
        for k in range(len(z)):
            kf.predict()
            kf.update(z[k, :, r])
        final[:, r] = kf.x[:, 0]
    return final


def jax_experiment() -> Callable[[int], np.ndarray]:
    """The same experiment in JAX: a function of the seed that gives the mean square errors by step."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    schedule = covariances(LAB3, STEPS)
    K = jnp.array(schedule.K[1:])
    inverse, S = jnp.array(np.linalg.inv(schedule.P_plus[1:])), jnp.array(schedule.S[1:, 0, 0])
    Phi, G, root = jnp.array(LAB3.Phi), jnp.linalg.cholesky(jnp.array(LAB3.Qd)), jnp.linalg.cholesky(jnp.array(LAB3.P0))

    def one(key):  # type: ignore[no-untyped-def]
        start, noise = jax.random.split(key)
        xi = jax.random.normal(noise, (STEPS, 3))

        def step(carry, given):  # type: ignore[no-untyped-def]
            x, estimate = carry
            n, gain, P, s = given
            x = Phi @ x + G @ n[:2]
            estimate = Phi @ estimate
            before = estimate - x
            nu = x[0] + n[2] - estimate[0]
            estimate = estimate + gain[:, 0] * nu
            e = estimate - x
            return (x, estimate), (e, e**4, before, before**2, before**4, x**2, jnp.outer(e, e), e @ P @ e, nu * nu / s)

        first = root @ jax.random.normal(start, (2,))
        return jax.lax.scan(step, (first, jnp.zeros(2)), (xi, K, inverse, S))[1]

    @jax.jit
    def all_runs(seed):  # type: ignore[no-untyped-def]
        columns = jax.vmap(one)(jax.random.split(jax.random.PRNGKey(seed), RUNS))
        squares = [jnp.sum(column**2, axis=0) for column in columns[-2:]]
        return [jnp.sum(column, axis=0) for column in columns], squares

    return lambda seed: np.asarray(jax.block_until_ready(all_runs(seed))[0][6]) / RUNS


def large_model(n: int = 20, m: int = 5) -> DiscreteModel:
    rng = np.random.default_rng(1)
    Phi = rng.normal(size=(n, n))
    Phi *= 0.95 / np.abs(np.linalg.eigvals(Phi)).max()
    B = rng.normal(size=(n, n))
    return DiscreteModel(Phi, B @ B.T / n, rng.normal(size=(m, n)), np.eye(m), x0=np.zeros(n), P0=np.eye(n))


def products(n: int, m: int, width: int, tiles: int) -> None:
    """The draws and products of ``tiles`` tiles, nothing else."""
    rng = np.random.default_rng(1)
    A, B, Hm, Lm, Km = (rng.normal(size=shape) for shape in ((n, n), (n, n), (m, n), (m, m), (n, m)))
    x, y, w = (np.empty((n, width)) for _ in range(3))
    z, v = np.empty((m, width)), np.empty((m, width))
    square = np.empty((n, n))
    x[:] = y[:] = 0.0
    for _ in range(tiles * STEPS):
        rng.standard_normal(out=w)
        rng.standard_normal(out=v)
        for matrix in (A, B, A, A):  # Φx, Gξ, Φx̂, We
            np.matmul(matrix, w, out=y)
        for _ in range(2):  # Hx, Hx̂
            np.matmul(Hm, w, out=z)
        for _ in range(2):  # Lξ, Vν
            np.matmul(Lm, v, out=z)
        np.matmul(Km, v, out=y)
        np.matmul(w, w.T, out=square)


class Report:
    """Lines of the table, and whether every stated ratio was met."""

    def __init__(self) -> None:
        self.met = True

    def line(self, what: str, found: str, ratio: float, bound: float | None, least: bool) -> None:
        """One line of the table; ``least``: the ratio is to be at least the bound."""
        stated = "" if bound is None else f"{'≥' if least else '≤'} {bound:g}"
        met = bound is None or (ratio >= bound if least else ratio <= bound)
        self.met &= met
        print(f"| {what} | {found} | {ratio:.3g} | {stated} | {'yes' if met else 'NO'} |", flush=True)


def check_outputs() -> None:
    """Statistics equal those of filterpy's own loop on the same records."""
    runs = 20
    records = montecarlo.simulate(LAB3, STEPS, runs, seed=1)
    last = filterpy_loop(records.z) - records.x[-1]
    stats = experiment(runs)
    if not np.allclose(stats.bias[-1], last.mean(axis=1), rtol=0, atol=1e-9 * np.abs(records.x[-1]).max()):
        sys.exit("outputs differ from filterpy's: nothing was timed")


def peak_memory() -> float:
    """Peak memory in MB of a process that runs 10⁶ runs of 1000 steps."""
    done = subprocess.run([sys.executable, __file__, "--memory"], capture_output=True, text=True, check=True)
    return float(done.stdout)


def high_water() -> float:
    """Peak memory of this process, MB; Linux's own count, for the one of getrusage includes the parent's."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(next(line for line in status.read_text().splitlines() if line.startswith("VmHWM")).split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> int:
    parser = argparse.ArgumentParser(description="speed of Monte-Carlo experiments, with all ratios from one run")
    parser.add_argument("--all", action="store_true", help="also memory and the Dask cluster (minutes)")
    parser.add_argument("--repeat", type=int, default=7, help="repetitions (5 at least)")
    parser.add_argument("--memory", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.memory:
        experiment(1_000_000, 2)
        print(high_water())
        return 0
    repeat = max(5, arguments.repeat)
    print(
        f"python {platform.python_version()}",
        *(f"{p} {version(p)}" for p in ("numpy", "numba", "filterpy")),
        f"{os.cpu_count()} cores",
    )
    check_outputs()
    print("\n| what | times | ratio | stated | met |\n|---|---|---|---|---|")
    report = Report()
    drawing, ours, ratio = compared(draw, experiment, repeat)
    report.line("experiment / drawing its normals", f"{ours * 1e3:.1f} ms / {drawing * 1e3:.1f} ms", ratio, 0.7, False)
    records = montecarlo.simulate(LAB3, STEPS, 2, seed=1)
    single, loop, ratio = compared(experiment, lambda: filterpy_loop(records.z), 5)
    report.line("filterpy's loop / experiment", f"{loop * 500:.1f} s / {single * 1e3:.1f} ms", ratio * 500, 700, True)
    if importlib.util.find_spec("jax"):
        peer = jax_experiment()
        theory = np.diagonal(covariances(LAB3, STEPS).P_plus[1:], axis1=1, axis2=2)
        if not np.allclose(np.diagonal(peer(1), axis1=1, axis2=2), theory, rtol=7 * np.sqrt(2 / RUNS)):
            sys.exit("outputs differ from JAX's: nothing more was timed")
        single, other, ratio = compared(experiment, lambda: peer(2), repeat)
        report.line(
            f"JAX {version('jax')} / experiment", f"{other * 1e3:.1f} ms / {single * 1e3:.1f} ms", ratio, 4, True
        )
    two, one, ratio = compared(lambda: experiment(100_000, 2), lambda: experiment(100_000, 1), 5)
    report.line("one worker / two workers (10⁸ run-steps)", f"{one:.2f} s / {two:.2f} s", ratio, 1.7, True)
    big = large_model()
    schedule = covariances(big, STEPS)
    how = {"steps": STEPS, "runs": 2000, "seed": 1, "schedule": schedule, "workers": 1, "progress": False}
    montecarlo.monte_carlo(big, **how)
    with one_thread():
        limit, ours, ratio = compared(lambda: products(20, 5, 500, 4), lambda: montecarlo.monte_carlo(big, **how), 5)
    report.line("n = 20, m = 5 / its draws and products", f"{ours:.2f} s / {limit:.2f} s", ratio, 2, False)
    if arguments.all:
        memory = peak_memory()
        report.line("peak memory of 10⁶ × 1000, MB", "", memory, 500, False)
        cluster(report)
    return 0 if report.met else 1


def cluster(report: Report) -> None:
    """Two Dask workers against two threads."""
    if not importlib.util.find_spec("distributed"):
        print("| dask | not installed | | | |")
        return
    import distributed

    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        address = local.scheduler_address
        montecarlo.monte_carlo(
            LAB3, steps=STEPS, runs=10_000, seed=1, executor=address, progress=False
        )  # workers load the kernel
        remote, threads, ratio = compared(
            lambda: montecarlo.monte_carlo(LAB3, steps=STEPS, runs=1_000_000, seed=1, executor=address, progress=False),
            lambda: experiment(1_000_000, 2),
            5,
        )
    report.line("two threads / two Dask workers (10⁹ run-steps)", f"{threads:.1f} s / {remote:.1f} s", ratio, 0.8, True)


if __name__ == "__main__":
    sys.exit(main())
