"""Is it fast for every model? Ratios to peers in the same run, over families of models drawn from a seed.

    python benchmarks/families.py [--seed 1] [--repeat 5] [--only experiment --only online …]

Every ratio is of the processor's time of one thread, ours over the peer's, both taken in turn; a model's ratio is the median of the
repetitions, and the table has the worst and the median over the family. Where a peer computes the same, its output is compared
first. The exit status is 1 if a stated ratio is missed.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drawn import Named, constant, family, with_bursts
from montecarlo import products

from ctlabs import DiscreteModel, covariances, fit, kalman_filter, monte_carlo, simulate, smooth, steady_state
from ctlabs.filtering import log_likelihood
from ctlabs.filtering.fields import RandomField, filter_local, measure
from ctlabs.filtering.online import Filter
from ctlabs.models.histories import shape, truth_arrays

STEPS, RUNS, LONG = 1000, 1000, 200_000
#: Where a fit begins.
START, BOUNDS = {"a": 0.5, "q": 1.0, "r": 1.0}, {"a": (-1.0, 1.0), "q": (0.0, None), "r": (0.0, None)}
Pair = tuple[str, Callable[[], object], Callable[[], object] | float]


class Row(NamedTuple):
    """A line of the table: pairs of ours and the peer's (seconds where there is none), and the limits."""

    key: str
    what: str
    pairs: Callable[[int], Iterator[Pair]]
    worst: float
    median: float = np.inf


def processor(action: Callable[[], object]) -> float:
    """Seconds of this process."""
    begin = time.process_time()
    action()
    return time.process_time() - begin


def ratio(ours: Callable[[], object], peer: Callable[[], object] | float, repeat: int) -> float:
    """The median ratio; both are done once before, as loops may be compiled."""
    ours()
    if isinstance(peer, float):
        return statistics.median(processor(ours) for _ in range(repeat)) / peer
    peer()
    return statistics.median(processor(ours) / processor(peer) for _ in range(repeat))


def equal(name: str, ours: Any, peer: Any, tolerance: float) -> None:
    """Leave where outputs differ."""
    difference = np.abs(np.asarray(ours) - peer).max() / np.abs(peer).max()
    if not difference <= tolerance:
        sys.exit(f"{name}: outputs differ by {difference:.1e}, more than {tolerance:g}")


# Experiments ----------------------------------------------------------------------------------------------------------


def drawing(model: DiscreteModel, runs: int) -> int:
    """How many normals an experiment takes."""
    own = shape(truth_arrays(model, STEPS), STEPS, model.first)
    return (own.start + own.w * STEPS + own.v * (STEPS + 1 - own.first)) * runs


def experiment(model: DiscreteModel, runs: int) -> Callable[[], object]:
    return lambda: monte_carlo(model, steps=STEPS, runs=runs, seed=1, workers=1, progress=False)


def small(seed: int) -> Iterator[Pair]:
    """Against numpy drawing the same normals."""
    for name, model in family(seed, 2, 1, 12, STEPS):
        count = drawing(model, RUNS)
        yield name, experiment(model, RUNS), lambda count=count: np.random.default_rng(1).standard_normal(count)


def large(n: int, m: int) -> Callable[[int], Iterator[Pair]]:
    """Against numpy drawing as many normals as a model takes at most, and the products that no method avoids."""

    def pairs(seed: int) -> Iterator[Pair]:
        for name, model in family(seed, n, m, 6, STEPS):
            yield name, experiment(model, RUNS), lambda: products(n, m, 500, RUNS // 500)

    return pairs


def schedules(seed: int) -> Iterator[Pair]:
    """Against the compiled loop over a record of as many steps."""
    for name, model in family(seed, 2, 1, 12, 2000):
        z = np.zeros((2000, 1))
        yield name, lambda model=model: covariances(model, 2000), lambda model=model, z=z: kalman_filter(model, z)


# Long records ---------------------------------------------------------------------------------------------------------


def peer(model: DiscreteModel, z: np.ndarray, kind: str = "filter", **options: Any) -> Any:
    """statsmodels' filter or smoother of a record that begins at t1."""
    from statsmodels.tsa.statespace import kalman_filter as filters
    from statsmodels.tsa.statespace import kalman_smoother as smoothers

    made = smoothers.KalmanSmoother if kind == "smoother" else filters.KalmanFilter
    kf = made(k_endog=model.m, k_states=model.n, **options)
    kf.bind(np.ascontiguousarray(z))
    kf["design"], kf["obs_cov"], kf["selection"] = model.H, model.R, np.eye(model.n)
    kf["transition"], kf["state_cov"] = model.Phi, model.Qd
    kf.initialize_known(model.Phi @ model.x0, model.Phi @ model.P0 @ model.Phi.T + model.Qd)
    return kf


def records(seed: int, *, holes: bool = False, count: int = 5) -> Iterator[tuple[Named, np.ndarray]]:
    """Constant models of radii up to 0.9999, and a long record of each."""
    rng = np.random.default_rng(seed)
    for named in constant(seed, 4, 2, count):
        z = simulate(named.model, LONG, 1, seed=seed).z[1:, :, 0]
        yield named, with_bursts(rng, z) if holes else z


def likelihoods(*, holes: bool) -> Callable[[int], Iterator[Pair]]:
    def pairs(seed: int) -> Iterator[Pair]:
        for (name, model), z in records(seed, holes=holes):
            other = peer(model, z)
            equal(name, log_likelihood(model, z), peer(model, z, tolerance=0).loglike(), 1e-10)
            yield name, lambda model=model, z=z: log_likelihood(model, z), other.loglike

    return pairs


def histories(seed: int) -> Iterator[Pair]:
    for (name, model), z in records(seed):
        equal(name, kalman_filter(model, z).x_plus[1:], peer(model, z, tolerance=0).filter().filtered_state.T, 1e-9)
        yield name, lambda model=model, z=z: kalman_filter(model, z), peer(model, z).filter


def smoothers(seed: int) -> Iterator[Pair]:
    for (name, model), z in records(seed, count=3):
        other = peer(model, z, "smoother")
        equal(name, smooth(model, z).x[1:], other.smooth().smoothed_state.T, 1e-6)
        yield name, lambda model=model, z=z: smooth(model, z), other.smooth


def fits(seed: int) -> Iterator[Pair]:
    """Three constants from 10⁵ rows, against statsmodels' maximum of the same likelihood from the same start."""
    from statsmodels.tsa.statespace.mlemodel import MLEModel

    rng = np.random.default_rng([seed, 5])
    for radius in (0.8, 0.95, 0.99):
        truth = {"a": radius, "q": float(np.exp(rng.normal())), "r": float(np.exp(rng.normal()))}

        def build(c: dict[str, float]) -> DiscreteModel:
            return DiscreteModel([[c["a"], 1], [0, 0.5]], [[0, 0], [0, c["q"]]], [[1, 0]], [[c["r"]]], P0=np.eye(2))

        z = simulate(build(truth), 100_000, 1, seed=seed).z[1:, :, 0]

        class Likelihood(MLEModel):
            """The same model."""

            start_params = np.array([0.5, 0.0, 0.0])
            param_names = ["a", "log q", "log r"]  # noqa: RUF012  # as statsmodels has it

            def update(self, params: Any, **options: Any) -> None:
                params = super().update(params, **options)
                self["transition"] = np.array([[params[0], 1], [0, 0.5]], dtype=params.dtype)
                self["state_cov"] = np.array([[0, 0], [0, np.exp(params[1])]], dtype=params.dtype)
                self["obs_cov"] = np.array([[np.exp(params[2])]], dtype=params.dtype)

        other = Likelihood(z, k_states=2)
        other["design"], other["selection"] = np.array([[1.0, 0.0]]), np.eye(2)
        other.initialize_known(np.zeros(2), np.eye(2) + np.diag([0.25, 1.0]))
        yield (
            f"a = {radius:g}",
            lambda z=z, build=build: fit(build, z, START, BOUNDS, profiles=False),
            lambda other=other: other.fit(disp=False, cov_type="oim"),
        )


# One by one, long fields, limits, the first call ----------------------------------------------------------------------


def online(seed: int) -> Iterator[Pair]:
    """A hundred steps, against filterpy's predict and update."""
    from filterpy.kalman import KalmanFilter

    (_, model), z = next(records(seed, count=1))

    def theirs() -> None:
        kf = KalmanFilter(dim_x=4, dim_z=2)
        kf.x, kf.P, kf.F, kf.Q, kf.H, kf.R = np.zeros((4, 1)), model.P0.copy(), model.Phi, model.Qd, model.H, model.R
        for row in z[:100]:
            kf.predict()
            kf.update(row[:, None])

    def ours(form: str) -> None:
        own = Filter(model, algorithm=form)
        for row in z[:100]:
            own.step(row)

    for form in ("joseph", "ud", "array", "srif"):
        yield form, lambda form=form: ours(form), theirs


def fields(seed: int) -> Iterator[Pair]:
    """Seconds of a field of 10⁵ nodes and 100 steps."""
    for alpha, beta, noise in ((0.1, 0.1, 1.0), (0.05, 0.05, 3.0), (0.2, 0.1, 0.5)):
        field = RandomField(alpha=alpha, beta=beta, b20=0.25, b11=1.0, h=1.0, dt=0.2, N1=100_000, sigma_eta=3.0)
        data = measure(field.simulate(100, seed=seed), noise, seed=seed)
        yield f"α = {alpha:g}", lambda field=field, data=data, noise=noise: filter_local(field, data[1:], sigma_n=noise), 1.0


def limits(seed: int) -> Iterator[Pair]:
    """Seconds of the steady state of 200 states: at random, like an inertial system's errors, a chain."""
    rng, n = np.random.default_rng([seed, 6]), 200
    dense = rng.normal(size=(n, n)) / np.sqrt(n)
    inertial = np.diag(rng.uniform(0.99, 0.9999, n)) + np.diag(np.where(np.arange(n - 1) % 3 == 2, 0.0, 0.01), 1)
    chain = np.diag(np.full(n, 0.9)) + np.diag(np.full(n - 1, 0.09), 1)
    for name, Phi in (("random", dense * (0.98 / np.abs(np.linalg.eigvals(dense)).max())), ("inertial", inertial), ("chain", chain)):
        models = iter([
            DiscreteModel(Phi, np.diag(rng.uniform(0.5, 2.0, n)), rng.normal(size=(10, n)), np.eye(10), P0=np.eye(n)) for _ in range(20)
        ])  # fmt: skip
        yield name, lambda models=models: steady_state(next(models)), 1.0


def first_call(seed: int) -> Iterator[Pair]:  # noqa: ARG001  # one model is as good as another
    """Seconds of a filter in a process whose cache of compiled loops is empty."""
    code = (
        "import time; from ctlabs import DiscreteModel, kalman_filter; begin = time.process_time();"
        "kalman_filter(DiscreteModel([[1]], [[1]], [[1]], [[1]], P0=[[1]]), [1.0, 2.0]); print(time.process_time() - begin)"
    )
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**os.environ, "XDG_CACHE_HOME": folder}
        )
    seconds = float(done.stdout)
    yield f"kalman_filter, {seconds:.1f} s", lambda: None, seconds


ROWS = (
    Row("experiment", "experiment, n = 2, m = 1 / drawing", small, 0.8, 0.6),
    Row("experiment-6", "experiment, n = 6, m = 2 / drawing and products", large(6, 2), 1.5),
    Row("experiment-20", "experiment, n = 20, m = 5 / drawing and products", large(20, 5), 1.5),
    Row("covariances", "covariances, 2,000 steps / compiled loop", schedules, 3.0),
    Row("likelihood", "log-likelihood, 2·10⁵ steps / statsmodels", likelihoods(holes=False), 0.02),
    Row("bursts", "the same with bursts of NaN / statsmodels", likelihoods(holes=True), 0.1),
    Row("filter", "filter with histories / statsmodels", histories, 0.1),
    Row("smoother", "filter and smoother / statsmodels", smoothers, 0.2),
    Row("fit", "fit of 3 constants, 10⁵ rows / statsmodels", fits, 0.1),
    Row("online", "Filter.step / filterpy", online, 1.5),
    Row("field", "field of 10⁵ nodes, s", fields, 0.5),
    Row("limit", "steady_state, n = 200, s", limits, 2.0),
)


def main() -> int:
    """Print the table; 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description="worst and median ratios over families of models")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--only", action="append", choices=[*(row.key for row in ROWS), "compilation"])
    parser.add_argument("--verbose", action="store_true", help="every model")
    arguments = parser.parse_args()
    missed = 0
    print("| work | worst | of | median | stated | |\n|---|---|---|---|---|---|")
    for row in (*ROWS, Row("compilation", "first call, s", first_call, 5.0)):
        if arguments.only and row.key not in arguments.only:
            continue
        found = []
        for name, ours, theirs in row.pairs(arguments.seed):
            seconds = theirs if row.key == "compilation" else ratio(ours, theirs, arguments.repeat)
            found.append((seconds, name))
            if arguments.verbose:
                print(f"  {seconds:8.3f}  {name}", flush=True)
        (worst, name), median = max(found), statistics.median(value for value, _ in found)
        good = worst <= row.worst and median <= row.median
        missed += not good
        stated = f"≤ {row.worst:g}" + (f", median ≤ {row.median:g}" if row.median < np.inf else "")
        print(f"| {row.what} | {worst:.3g} | {name} | {median:.3g} | {stated} | {'' if good else 'MISSED'} |", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
