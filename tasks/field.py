r"""Field. Kalman filter for a random field: the published table and figures beside our own.

Source: Lipatov 2010, "Use of the Kalman filter for suppressing the measurement error of a random field", eq. 1-51, table,
figures 1-3. A field z(x, t) driven by white noise through a partial differential equation is written as a difference
scheme in state-space form, measured at every node in white noise, and filtered; the paper reports ten simulated variants.

Expected answer: the field's mean and spread agree with the printed ones; the printed errors lie below the error of the
best causal filter and cannot come from the filter alone; the claim holds: the filter suppresses the noise, and the ratio
σ_n/σ_ε grows with σ_n and falls with α. The step in time is limited by von Neumann's condition, not by the eigenvalues.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from ctlabs.tasks._field_results import part_figures, part_scale, part_table, part_verdict
from ctlabs.tasks._field_theory import (
    finite_variance,
    of_nodes,
    part_stability,
    part_theory,
    resolved,
    statement,
)
from ctlabs.tasks._field_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import field as by_hand
from ctlabs.tasks.answers.field import PRINTED
from pydantic import model_validator

from ctlabs.analysis import sensitivity
from ctlabs.filtering import Covariances, fields
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models.field import RandomField
from ctlabs.montecarlo import chance
from ctlabs.reporting.draws import span
from ctlabs.reporting.params import Count, Flag, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import Report

META = {
    "name": "field",
    "title": "Kalman filter for a random field",
    "source": "Lipatov 2010",
    "parts": ["table", "figures", "theory", "verdict", "stability", "scale"],
    "runs": 1000,
}


class Parameters(LabParameters):
    """What may be changed; the printed variants of the table keep their own α = β and σ_n. u is the field's unit."""

    alpha: Positive = given(0.1, unit="1/s", meaning="coefficient of the first derivative in place, α = b₀₁", draw=span(0.05, 0.12, 0.01))
    beta: Positive = given(0.1, unit="1/m", meaning="coefficient of the first derivative in time, β = b₁₀", draw=span(0.05, 0.12, 0.01))
    sigma_n: Positive = given(1.0, unit="u", meaning="standard deviation of the measurement noise at a node", draw=span(0.5, 3, 0.25))
    sigma_eta: Positive = given(
        3.0, unit="u/√(m·s)", meaning="standard deviation of the driving noise at a node and step",
        symbol=r"\sigma_\eta",
    )
    b20: Positive = given(0.25, unit="s/m", meaning="coefficient of the second derivative in time")
    b11: Variance = given(1.0, unit="1", meaning="coefficient of the mixed derivative")
    dt: Positive = given(0.2, unit="s", meaning="step in time")
    h: Positive = given(1.0, unit="m", meaning="distance of the nodes")
    N1: Count = given(30, unit="1", meaning="number of the last node; node 0 is the boundary")
    m: Count = given(100, unit="1", meaning="number of steps in time")
    P0: Variance = given(10.0, unit="u² and u²/s²", meaning="variance of every state at t0, as the filter believes it")
    node: Count = given(
        22, unit="1", meaning="node of figures 2 and 3 (the last one, where a shorter field is asked for)", symbol="i"
    )
    allow_unstable: Flag = given(False, unit="yes/no", meaning="take a step beyond von Neumann's limit")

    @model_validator(mode="after")
    def fits(self):
        """The step is stable and the node exists."""
        own(self)
        if "node" in self.model_fields_set and self.node > self.N1:
            msg = f"node: expected at most N1 = {self.N1}, received {self.node}"
            raise ValueError(msg)
        return self


def own(p):
    """The field of the given parameters."""
    return RandomField(p.alpha, p.beta, p.b20, p.b11, p.h, p.dt, p.N1, p.sigma_eta, allow_unstable=p.allow_unstable)


class Case(NamedTuple):
    """One variant without random numbers: the filter's claim, its true error, and the filter that knows X_0 = 0."""

    field: RandomField
    sigma_n: float
    claimed: Covariances
    actual: sensitivity.Actual
    bound: Covariances


def case(p, alpha, beta, sigma_n):
    """Covariances of a variant; the printed ones are computed for whatever dt is given."""
    field = replace(own(p), alpha=alpha, beta=beta, allow_unstable=True)
    design, truth = field.model(sigma_n, p.P0), field.model(sigma_n, 0.0)
    claimed = covariances(design, p.m)
    return Case(field, sigma_n, claimed, sensitivity.actual(truth, design, p.m, gains=claimed), covariances(truth, p.m))


class World(NamedTuple):
    """An ensemble of one field: z and unit noise of its first run (m+1, N1+1), m̂_z and σ̂_z of every run."""

    z: np.ndarray
    noise: np.ndarray
    mean: np.ndarray
    spread: np.ndarray
    test: chance.Verdict


class Sample(NamedTuple):
    """An ensemble of one variant: σ̂_ε of every run with the printed filter and with the one that knows X_0 = 0.

    ``rms`` (m+1,) is the root mean square error over nodes and runs, of both.
    """

    printed: np.ndarray
    bound: np.ndarray
    rms: tuple[np.ndarray, np.ndarray]
    tests: tuple[chance.Verdict, chance.Verdict]


def run_all(p, experiment, cases):
    """Worlds by (α, β) and samples by variant; None where the field outgrows double precision."""
    worlds, samples = {}, {}
    for alpha, beta in dict.fromkeys(key[:2] for key in cases):
        several = {key: found for key, found in cases.items() if key[:2] == (alpha, beta)}
        field = next(iter(several.values())).field
        size = finite_variance(field, p.m)
        worlds[alpha, beta] = None
        samples |= dict.fromkeys(several)
        if size is None or size.max() > 1e200:
            continue
        z = field.simulate(p.m, experiment.seed, experiment.runs).reshape(p.m + 1, field.nodes, experiment.runs)
        noise = fields.measure(np.zeros_like(z), 1.0, experiment.seed)
        test = chance.mean_square(z, field.variance(p.m))
        worlds[alpha, beta] = World(z[:, :, 0], noise[:, :, 0], z.mean(axis=(0, 1)), z.std(axis=(0, 1)), test)
        samples |= {
            key: sample(p, found, z, noise) for key, found in several.items() if resolved(field, p.m, found.sigma_n)
        }
    return worlds, samples


def simulated(p, experiment, cases, key):
    """The fields of all cases, and what the filters make of them; those of the given parameters apart."""
    worlds, samples = run_all(p, experiment, cases)
    return {"worlds": worlds, "samples": samples, "world": worlds[key[:2]], "drawn": samples[key]}


def sample(p, found, z, noise):
    """Filter all runs of a variant, twice."""
    data, sigmas, rms, tests = z + found.sigma_n * noise, [], [], []
    for P0, P in ((p.P0, found.actual.P_plus), (0.0, found.bound.P_plus)):
        error = fields.filter_exact(found.field, data[1:], sigma_n=found.sigma_n, P0=P0).z_hat.reshape(z.shape) - z
        sigmas.append(np.sqrt((error**2).mean(axis=(0, 1))))
        rms.append(np.sqrt((error**2).mean(axis=(1, 2))))
        tests.append(chance.mean_square(error, of_nodes(P, found.field)))
    return Sample(sigmas[0], sigmas[1], (rms[0], rms[1]), (tests[0], tests[1]))


def plan(r, p, experiment):
    """Every number chosen."""
    r.says("{tab:plan} lists what was chosen. One record per α is the table's field; the ensemble says which of its numbers are typical. All variants of one α share field and noise (scaled by $\\sigma_n$), as in the paper.")
    r.table("plan", ["quantity", "value", "why"], [
        ["steps m", p.m, "the paper's k = 0…m, unless another number is given"],
        ["nodes", p.N1 + 1, "$N = N_1 + 1$"],
        ["seeds", experiment.runs, "a percentile of the ensemble is known to about ±3 % with 1000"],
        ["seed", experiment.seed, "its first run is the record of the table and the figures"],
        ["start", "$X_0 = 0$", "that of the paper; the filter believes in $P_0$"],
        ["measurements", "every node, k = 1…m", "equation (36) of the paper"],
    ], "Plan of the experiment.")


PARTS = Skeleton(
    result=result,
    key="sigma_eps",
    analysis=(statement, part_stability, part_theory),
    plan=plan,
    experiment=(simulated, part_table, part_figures, part_verdict, part_scale),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the paper, item by item."""
    variants = [(alpha, alpha, sigma_n) for alpha, sigma_n, *_rest in PRINTED]
    key = (p.alpha, p.beta, p.sigma_n)
    cases = {each: case(p, *each) for each in dict.fromkeys([*variants, key])}
    here, several = cases[key], [cases[each] for each in variants]
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), variants=variants, key=key, cases=cases,
                        here=here, several=several, field=here.field)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
