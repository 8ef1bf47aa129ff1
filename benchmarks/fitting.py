"""Constants of a model from long records: four from 2,000 rows at irregular times, four from 100,000 rows at regular ones.

python benchmarks/fitting.py prints one fit of each (a second one: loops are compiled), with standard errors and profiles, and how many
likelihoods it took; and exits 1 when a stated limit is missed. Before that, the estimates are compared with those that drew the record.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from timing import timed

from ctlabs import ContinuousModel, DiscreteModel, fit, simulate
from ctlabs.analysis.fitting import Fit
from ctlabs.models.discretisation import intervals

IRREGULAR, REGULAR = 2_000, 100_000
#: A position whose speed has a memory of tau and is driven with the strength q; sensors of the position and the speed, of variances r, s.
TRUTH = {"tau": 4.0, "q": 0.5, "r": 0.2, "s": 0.3}
POSITIVE = dict.fromkeys(TRUTH, (0.0, None))
START = {"tau": 10.0, "q": 2.0, "r": 1.0, "s": 1.0}


def continuous(c: dict[str, float]) -> ContinuousModel:
    """Position and speed."""
    return ContinuousModel([[0, 1], [0, -1 / c["tau"]]], [[0], [1]], [[c["q"]]], np.eye(2), P0=np.eye(2))


def sampled(times: np.ndarray) -> Callable[[dict[str, float]], DiscreteModel]:
    """The model over these instants, of constants."""
    gaps = np.diff(times)
    lengths, which = np.unique(np.round(gaps, 12), return_inverse=True)

    def build(c: dict[str, float]) -> DiscreteModel:
        model = continuous(c)
        Phi, Qd, _Gamma = intervals(model.F, model.G @ model.Q @ model.G.T, lengths)
        one = len(lengths) == 1
        return DiscreteModel(Phi[0] if one else Phi[which], Qd[0] if one else Qd[which], model.H, np.diag([c["r"], c["s"]]), P0=model.P0)

    return build


def main() -> int:
    """Print the table; 1 if a limit is missed."""
    rng, missed = np.random.default_rng(1), 0
    irregular = np.concatenate([[0.0], np.cumsum(rng.exponential(0.5, IRREGULAR))])
    for name, times, limit in (
        (f"{IRREGULAR} rows at irregular times", irregular, 5.0),
        (f"{REGULAR} rows at regular times", 0.5 * np.arange(REGULAR + 1), 10.0),
    ):
        build = sampled(times)
        z = simulate(build(TRUTH), len(times) - 1, 1, seed=1).z[:, :, 0]
        found = once(build, z)
        seconds = timed(lambda build=build, z=z: once(build, z))
        missed += seconds > limit
        print(
            f"{name:<36} {seconds:6.2f} s, {found.evaluations} likelihoods   at most {limit:g} s   "
            f"{'' if seconds <= limit else 'MISSED'}"
        )
    return int(missed > 0)


def once(build: Callable[[dict[str, float]], DiscreteModel], z: np.ndarray) -> Fit:
    """A fit, whose estimates have to lie within five standard errors of the truth."""
    found = fit(build, z, START, POSITIVE)
    for name, value in TRUTH.items():
        error = found.standard_errors[name]
        if not (found.converged and error is not None and abs(found.estimates[name] - value) < 5 * error):
            sys.exit(f"{name}: expected about {value:g}, received {found.estimates[name]:g} ± {error}")
    return found


if __name__ == "__main__":
    sys.exit(main())
