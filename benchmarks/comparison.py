"""The same problems in ctlabs and in its peers: what each gives, how exactly, in what time. The site's page *Comparison* shows this table.

python benchmarks/comparison.py prints it; a peer that is not installed is left out (pip install pykalman dynamax statsmodels). Times are
medians of seven, after a first call that compiles where something compiles. Nothing here has a limit to miss: who wins is said as it is.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import mpmath
import numpy as np
from timing import median

from ctlabs import ContinuousModel, DiscreteModel, discretise, kalman_filter, simulate, smooth, steady_state
from ctlabs.filtering import compare, log_likelihood

#: Position and speed along two axes; both positions are measured, with correlated errors.
MODEL = DiscreteModel(
    Phi=np.kron(np.eye(2), [[1.0, 0.1], [0.0, 0.98]]),
    Qd=np.kron(np.eye(2), [[1e-4, 1e-3], [1e-3, 2e-2]]),
    H=[[1, 0, 0, 0], [0, 0, 1, 0]],
    R=[[0.5, 0.1], [0.1, 0.4]],
    P0=10 * np.eye(4),
    dt=0.1,
    first=0,
)
STEPS, RUNS, SHORT = 2_000, 200, 250
PEERS = ("filterpy", "pykalman", "statsmodels", "dynamax", "control")


def main() -> int:
    """Print the tables."""
    print(f"Python {sys.version.split()[0]}, " + ", ".join(f"{name} {installed(name) or '-'}" for name in ("numpy", *PEERS)))
    for title, rows in (
        (f"filter one record of {STEPS} instants, n = 4, m = 2: estimates, covariances, likelihood", one_record),
        ("smooth it", smoothed),
        ("the likelihood alone", likelihood),
        (f"filter {RUNS} records of {SHORT} instants", many_records),
        ("two sensors that differ by 1e-7 and are as precise: relative error of P", precision),
        ("the covariance of the noise of a stiff plant, |λ|dt = 100: relative error", stiffness),
        ("steady state of a well-conditioned model", steady),
    ):
        print(f"\n{title}")
        for name, seconds, remark in rows():
            print(f"  {name:<34} {'' if seconds is None else f'{1e3 * seconds:10.2f} ms'}   {remark}")
    return 0


def installed(name: str) -> str:
    """The version of a package, or nothing."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


Row = tuple[str, float | None, str]


def record(steps: int, runs: int = 1) -> Any:
    """Measurements of the model, (rows, m, runs)."""
    return simulate(MODEL, steps=steps - 1, runs=runs, seed=1).z


def apart(found: Any, ours: Any) -> str:
    """The largest difference of two histories of estimates, in words."""
    return f"differs from ctlabs by {np.max(np.abs(np.asarray(found) - ours)):.0e}"


def one_record() -> Iterator[Row]:
    """Every peer's filter on one record."""
    z = record(STEPS)[:, :, 0]
    ours = kalman_filter(MODEL, z)
    yield "ctlabs", median(lambda: kalman_filter(MODEL, z)), "compiled when it is first used"
    for name, run in filters(z).items():
        found = run()
        yield name, median(run), apart(found[0], ours.x_plus)


def filters(z: Any) -> dict[str, Callable[[], Any]]:
    """For each peer a call that filters, and returns the filtered means first."""
    found: dict[str, Callable[[], Any]] = {}
    if installed("filterpy"):
        found["filterpy"] = lambda: filterpy(z)
    if installed("pykalman"):
        found["pykalman"] = lambda: pykalman().filter(z)
    if installed("statsmodels"):
        found["statsmodels"] = lambda: (statsmodels(z).filter().filtered_state.T,)
    if installed("dynamax"):
        found["dynamax (jit, 64 bits)"] = dynamax(z, "lgssm_filter", "filtered_means")
    return found


def filterpy(z: Any) -> tuple[Any, ...]:
    """Its loop, which begins with an update."""
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(dim_x=4, dim_z=2)
    kf.F, kf.Q, kf.H, kf.R, kf.P = MODEL.Phi, MODEL.Qd, MODEL.H, MODEL.R, MODEL.P0.copy()
    x, P = [], []
    for value in z:
        kf.update(value)
        x.append(kf.x.ravel())
        P.append(kf.P)
        _ = kf.log_likelihood
        kf.predict()
    return np.array(x), np.array(P)


def pykalman() -> Any:
    """Its filter of the model."""
    from pykalman import KalmanFilter

    return KalmanFilter(MODEL.Phi, MODEL.H, MODEL.Qd, MODEL.R, initial_state_mean=MODEL.x0, initial_state_covariance=MODEL.P0)


def statsmodels(z: Any) -> Any:
    """Its state-space object of the model, with the record bound to it."""
    from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother

    found = KalmanSmoother(k_endog=2, k_states=4)
    found["transition"], found["selection"], found["state_cov"] = MODEL.Phi, np.eye(4), MODEL.Qd
    found["design"], found["obs_cov"] = MODEL.H, MODEL.R
    found.initialize_known(np.array(MODEL.x0), np.array(MODEL.P0))
    found.bind(np.ascontiguousarray(z))
    return found


def dynamax(z: Any, verb: str, *wanted: str, records: bool = False) -> Callable[[], Any]:
    """Its function of the record, compiled, in double precision; over the records of an ensemble by vmap."""
    import jax

    jax.config.update("jax_enable_x64", val=True)
    import jax.numpy as jnp
    from dynamax.linear_gaussian_ssm import inference

    model = inference.make_lgssm_params(
        *(jnp.asarray(matrix) for matrix in (MODEL.x0, MODEL.P0, MODEL.Phi, MODEL.Qd, MODEL.H, MODEL.R))
    )
    run = getattr(inference, verb)
    mapped = jax.vmap(run, in_axes=(None, 0)) if records else run
    compiled = jax.jit(lambda data: tuple(getattr(mapped(model, data), name) for name in (*wanted, "filtered_covariances")))
    data = jnp.asarray(z)

    def call() -> Any:
        return [np.asarray(each.block_until_ready()) for each in compiled(data)]

    call()
    return call


def smoothed() -> Iterator[Row]:
    """Every peer's smoother on the same record."""
    z = record(STEPS)[:, :, 0]
    ours = smooth(MODEL, z).x
    yield "ctlabs", median(lambda: smooth(MODEL, z)), ""
    if installed("pykalman"):
        yield "pykalman", median(lambda: pykalman().smooth(z)), apart(pykalman().smooth(z)[0], ours)
    if installed("statsmodels"):
        yield "statsmodels", median(lambda: statsmodels(z).smooth()), apart(statsmodels(z).smooth().smoothed_state.T, ours)
    if installed("dynamax"):
        run = dynamax(z, "lgssm_smoother", "smoothed_means")
        yield "dynamax (jit, 64 bits)", median(run), apart(run()[0], ours)


def likelihood() -> Iterator[Row]:
    """What an optimiser calls again and again."""
    z = record(STEPS)[:, :, 0]
    yield "ctlabs", median(lambda: log_likelihood(MODEL, z)), ""
    if installed("pykalman"):
        yield "pykalman", median(lambda: pykalman().loglikelihood(z)), ""
    if installed("statsmodels"):
        model = statsmodels(z)
        yield "statsmodels", median(model.loglike), f"differs by {abs(model.loglike() - log_likelihood(MODEL, z)):.0e}"
    if installed("dynamax"):
        yield "dynamax (jit, 64 bits)", median(dynamax(z, "lgssm_filter", "marginal_loglik")), ""


def many_records() -> Iterator[Row]:
    """An ensemble, in one call where there is one."""
    z = record(SHORT, RUNS)
    ours = kalman_filter(MODEL, z).x_plus
    yield "ctlabs", median(lambda: kalman_filter(MODEL, z)), "one call, one sequence of gains"
    if installed("dynamax"):
        run = dynamax(np.moveaxis(z, 2, 0), "lgssm_filter", "filtered_means", records=True)
        yield "dynamax (jit, vmap, 64 bits)", median(run), apart(np.moveaxis(run()[0], 0, 2), ours)
    if installed("statsmodels"):
        yield "statsmodels, a loop", median(lambda: [statsmodels(z[:, :, run]).filter() for run in range(RUNS)]), ""
    if installed("filterpy"):
        few = 5
        yield "filterpy, a loop", median(lambda: [filterpy(z[:, :, run]) for run in range(few)]) * RUNS / few, f"scaled up from {few}"


def precision() -> Iterator[Row]:
    """Bierman's example against fifty digits."""
    delta = 1e-7
    H = np.array([[1, 1, 1], [1, 1, 1 + delta]])
    model = DiscreteModel(np.eye(3), np.zeros((3, 3)), H, R=delta**2 * np.eye(2), P0=np.eye(3), first=0)
    z = [[0.5, 0.5 + 0.5 * delta]]
    for name in ("conventional", "joseph", "ud"):
        (found,) = compare(model, z, [name])
        yield f"ctlabs, {name}", None, found.failed or f"{found.error_P:.0e}"
    exact = kalman_filter(model, z, algorithm="ud").P_plus[-1]
    size = np.linalg.norm(exact)
    yield "ctlabs, auto", None, f"{np.linalg.norm(kalman_filter(model, z).P_plus[-1] - exact) / size:.0e}"
    if installed("filterpy"):
        from filterpy.kalman import KalmanFilter

        kf = KalmanFilter(3, 2)
        kf.F, kf.Q, kf.H, kf.R, kf.P = model.Phi, model.Qd, H, model.R, np.eye(3)
        kf.update(np.array(z[0]))
        yield "filterpy", None, f"{np.linalg.norm(kf.P - exact) / size:.0e}"
    if installed("pykalman"):
        from pykalman import KalmanFilter as Peer

        peer = Peer(model.Phi, H, model.Qd, model.R, initial_state_mean=np.zeros(3), initial_state_covariance=np.eye(3))
        P = peer.filter(z * 2)[1][0]  # of one row it would make two
        yield "pykalman", None, f"{np.linalg.norm(P - exact) / size:.0e}"
    if installed("statsmodels"):
        from statsmodels.tsa.statespace.kalman_filter import KalmanFilter as Compiled

        other = Compiled(k_endog=2, k_states=3)
        other["transition"], other["selection"], other["state_cov"] = np.eye(3), np.eye(3), np.zeros((3, 3))
        other["design"], other["obs_cov"] = H, np.array(model.R)
        other.initialize_known(np.zeros(3), np.eye(3))
        other.bind(np.array(z))
        yield "statsmodels", None, f"{np.linalg.norm(other.filter().filtered_state_cov[:, :, -1] - exact) / size:.0e}"


def stiffness() -> Iterator[Row]:
    """A fast state behind a slow one, noise on the slow one: against Van Loan's exponential with 120 digits."""
    F, G, dt = np.array([[-100.0, 100.0], [0.0, -1.0]]), np.array([[0.0], [1.0]]), 1.0
    model = ContinuousModel(F=F, G=G, Q=[[1]], H=[[1, 0]], P0=np.eye(2))
    with mpmath.workdps(120):
        whole = mpmath.expm(mpmath.matrix(np.block([[-F, G @ G.T], [np.zeros((2, 2)), F.T]]).tolist()) * dt, method="taylor")
        exact = np.array((whole[2:, 2:].T * whole[:2, 2:]).tolist(), dtype=np.float64)

    def worst(Qd: Any) -> str:
        return f"{np.max(np.abs(Qd - exact) / exact):.0e}"

    yield "ctlabs", median(lambda: discretise(model, dt, R=[[1]])), worst(discretise(model, dt, R=[[1]]).Qd)
    if installed("filterpy"):
        from filterpy.common import van_loan_discretization

        found = van_loan_discretization(F, G, dt)[1]
        yield "filterpy", median(lambda: van_loan_discretization(F, G, dt)), worst(found)


def steady() -> Iterator[Row]:
    """The limit of the gains."""
    yield "ctlabs", median(lambda: steady_state(MODEL)), f"with a bound of its error, {steady_state(MODEL).error:.0e} of σ"
    if installed("control"):
        import control

        arguments = (MODEL.Phi, np.eye(4), MODEL.H, MODEL.Qd, MODEL.R)
        difference = np.max(np.abs(control.dlqe(*arguments)[0] - steady_state(MODEL).K_pred))
        yield "python-control dlqe", median(lambda: control.dlqe(*arguments)), f"the predictor's gain; differs by {difference:.0e}"


if __name__ == "__main__":
    sys.exit(main())
