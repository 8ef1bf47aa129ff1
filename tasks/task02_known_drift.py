r"""Lab 2. The position of lab 1 with a known drift.

Source: Semushin & Tsyganova 2001, task 2. x(t) = x0 + ut + β(t) with a known constant velocity u; everything else, and
every question, as in lab 1.

Expected answer: the input enters the mean only, x̂⁻ = x̂⁺ + uτ; the variances and the gain are those of lab 1. A filter
that forgets u has the steady bias uτ/K̄ before an update and uτ(1−K̄)/K̄ after it (truth minus estimate).
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from ctlabs.tasks import _task02_words as words
from ctlabs.tasks import task01_brownian_position as lab1
from ctlabs.tasks.answers import task02 as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import steady
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import agreement, rms
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots
from ctlabs.reporting.draws import span
from ctlabs.reporting.params import Real, given
from ctlabs.reporting.report import Report

META = {
    "name": "task02",
    "title": "Random constant plus Brownian motion with a known drift",
    "source": "Semushin & Tsyganova 2001, task 2",
    "parts": ["a", "b", "c", "d"],
}


class Parameters(lab1.Parameters):
    """What may be changed: as in lab 1, and the drift."""

    u: Real = given(1.0, unit="m/s", meaning="known constant velocity", draw=span(0.5, 3, 0.1))


def model(p, R, sigma_w2=None, u=None):
    """ẋ = u + w, sampled; the known input adds uτ to the mean each period."""
    continuous = ContinuousModel(
        F=[[0]], G=[[1]], Q=[[p.sigma_w2 if sigma_w2 is None else sigma_w2]], H=[[1]], B=[[1]], x0=[p.x0_mean], P0=[[p.P0]], states=["x"], units=["m"]
    )
    stacked = np.array([math.inf, *R])[:, None, None] if np.ndim(R) else [[R]]
    return discretise(continuous, p.tau, stacked, u=[p.u if u is None else u])


def part_a(r, p, answer, build):
    """The known input, and why the covariances do not feel it."""
    r.part = "a"
    r.subsection("Model and filter", "model")
    r.says("The known velocity is an input {ref:maybeck, section 4.9}: $\\dot{x} = u + w$. Over one period it moves the state by $u\\tau$ (a velocity, multiplied by the period), and the prediction adds the same:")
    r.math(r"x(t_{i+1}) = x(t_i) + u\tau + w_d(t_i), \qquad \hat x(t_i^-) = \hat x(t_{i-1}^+) + u\tau, \qquad P(t_i^-) = P(t_{i-1}^+) + Q_d", "prediction")
    system = build(lab1.by_hand.variances(p))
    r.model(build(lab1.by_hand.variances(p)[-1]))
    lab1.last_of_list(r, p)
    r.says("The update is that of lab 1,")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R(t_i)}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = [1 - K(t_i)]P(t_i^-).", "update")
    r.says("**Why the covariances do not feel the input.** In the error $e = \\hat{x} - x$ the input cancels, $e(t_i^-) = e(t_{i-1}^+) - w_d(t_{i-1})$. So the variances, the gain, the settling and the effect of an anomaly are those of lab 1, whatever u.")
    r.value("control_increment", float(system.offset[0]), "m", symbol=r"u\tau", agrees=answer, routes=("discretised input", "product uτ"))
    steps = len(lab1.by_hand.variances(p))
    schedule, without = covariances(system, steps), covariances(replace(system, offset=None), steps)
    at = [i * p.tau for i in range(1, steps + 1)]
    r.value("posterior_variance", schedule.P_plus[1:, 0, 0], "m²", at=at, agrees=answer, routes=("recursion", "joint conditioning"))
    r.check("variances with and without the input", sensitivity.actual(system, system, steps).P_plus, without.P_plus, ("joint covariance with u", "recursion without u"))
    known = covariances(replace(system, P0=[[0.0]]), steps)
    r.value("posterior_variance_known_start", known.P_plus[1:, 0, 0], "m²", at=at, agrees=answer, routes=("recursion", "joint conditioning"))
    r.subsection("A known start", "start")
    r.says("The sheet may also be read with $x(t_0)$ known: then $P_0 = 0$ and the variance climbs to its limit from below. It is {first:4} m² after the first measurement and {last:4} m² after the last listed one.",
           first=known.P_plus[1, 0, 0], last=known.P_plus[-1, 0, 0])


def forgotten(r, answer, build, R):
    """The filter that does not know u."""
    r.part = "c"
    r.subsection("Steady state", "steady")
    r.says("With $\\rho = \\sigma_w^2\\tau/R$ the limits are those of lab 1 {ref:anderson_moore, section 4.4},")
    r.math(r"\bar P^\mp = \tfrac12\left[\pm Q_d + \sqrt{Q_d^2 + 4Q_dR}\,\right], \qquad \bar K = \tfrac12\left[-\rho + \sqrt{\rho^2 + 4\rho}\,\right], \qquad \frac{\bar P^+}{R} = \bar K,", "steady")
    r.says("and the error is called settled from the first measurement after which its variance stays within 1 % of $\\bar P^+$.")
    r.subsection("A filter that forgets the drift", "forgotten")
    r.says("If the filter leaves out $u$, its mean error obeys $b^- = b^+ + u\\tau$, $b^+ = (1-K)b^-$ (b is truth minus estimate). In the steady state")
    r.math(r"\bar b^- = \frac{u\tau}{\bar K}, \qquad \bar b^+ = \frac{u\tau(1 - \bar K)}{\bar K}, \qquad \mathrm{MSE} = \bar P^+ + (\bar b^+)^2.", "forgotten")
    r.says("The filter itself claims $\\bar P^+$ and knows nothing of the rest. A larger gain would make the bias smaller at the cost of a larger variance, which is why a filter whose model may be wrong is given more process noise than there is {ref:jazwinski, chapter 8}.")
    finite = math.isfinite(R)
    solvable = finite and answer["gain_steady"] != 0
    reason = "" if solvable else "the gain tends to 0: the bias grows without limit"
    limit = steady.solve(build(R)) if finite else None
    r.value("gain_steady", None if limit is None else limit.K[0, 0], "1", symbol=r"\bar K", reason="the last measurement is absent (R = ∞)", agrees=answer, routes=("Riccati equation", "closed form"))
    wrong = sensitivity.steady(build(R), build(R, u=0.0)) if solvable else None
    routes = ("joint recursion, limit", "closed form")
    r.value("unmodelled_drift_bias_prior", None if wrong is None else -wrong.bias_minus[0], "m", symbol=r"\bar b^-", reason=reason, agrees=answer, routes=routes)
    r.value("unmodelled_drift_bias_posterior", None if wrong is None else -wrong.bias_plus[0], "m", symbol=r"\bar b^+", reason=reason, agrees=answer, routes=routes)
    r.value("unmodelled_drift_mse", None if wrong is None else wrong.P_plus[0, 0] + wrong.bias_plus[0] ** 2, "m²", symbol=r"\mathrm{MSE}", reason=reason, agrees=answer, routes=routes)


def forgets_in_experiment(r, answer, build, experiment, steps, R):
    """The forgetful filter beside the right one on the same data."""
    if not math.isfinite(R):
        return {}
    truth, forgetful = build(R), build(R, u=0.0)
    actual = sensitivity.actual(truth, forgetful, steps)
    stats = experiment.statistics(truth, forgetful, steps=steps)
    agreement(r, "filter that forgets u", stats, actual.P_plus, actual.bias_plus, consistent=False)
    i = np.arange(steps + 1)
    figure = plots.lines(i, {"after an update": -actual.bias_plus[:, 0], "before an update": -actual.bias_minus[:, 0]}, xlabel=lab1.STEP, ylabel="mean of truth − estimate, m",
                         points={"ensemble": (i, -stats.bias[:, 0])}, steps=True)
    r.figure("forgotten_drift", figure, "Bias of the filter that forgets the drift: theory and the ensemble's mean after an update.")
    r.says("**The drift forgotten.** {fig:forgotten_drift} shows the bias ", ("of a filter that forgets $u = 0$, which is none." if not float(truth.offset[0]) else
           "growing to its limit, larger before an update than after it by $u\\tau$." if answer["unmodelled_drift_bias_posterior"] is not None else "growing without limit, as the gain goes to 0."), " {tab:forgotten_drift} compares both filters on the same data.")
    right = covariances(truth, steps)
    r.table("forgotten_drift", ["filter", "bias, m", "σ, m", "RMS of theory, m", "RMS of the ensemble, m"], [
        ("knows u", 0.0, right.sd_plus[-1, 0], right.sd_plus[-1, 0], rms(experiment.statistics(truth, steps=steps))),
        ("forgets u", -actual.bias_plus[-1, 0], math.sqrt(actual.P_plus[-1, 0, 0]), math.sqrt(actual.mse_plus[-1, 0, 0]), rms(stats)),
    ], "Both filters on the same data, at the last measurement.")
    return {"lost": rms(stats, unit="m")}


def part_d(r, p, build, experiment, R):
    """One anomalous measurement: the covariances are those of lab 1."""
    lab1.part_d(r, p, build, lab1.by_hand.analytic(p), experiment, R)


def measured_a(r, p, build, experiment, steps, R):
    """The diffusion, and the ensemble of the given system."""
    r.section("a", "Influence of the diffusion")
    lab1.diffusions(r, p, build, experiment, steps, R)
    return lab1.portrayed(r, build, experiment, steps, R)


def measured_b(r, p, build, experiment, steps, R):
    """The measurements."""
    r.section("b", "Influence of the measurement variance")
    lab1.sweep(r, build, experiment, steps, "b", "variance R, m²", "R", [(R * f, p.sigma_w2, R * f) for f in (lab1.FACTORS if R else (1.0,))], drawn=False)
    r.says("{tab:sweep_b} shows what R does while the diffusion is kept. In theory accuracy, gain and settling are those of lab 1, which also treats a variance that changes from one measurement to the next.")


PARTS = Skeleton(
    result=words.result,
    key="forgotten_drift",
    analysis=(part_a, forgotten),
    plan=lab1.plan,
    experiment=(measured_a, measured_b, lab1.part_c, forgets_in_experiment, part_d),
    discussion=words.discussion,
    answers=words.answers,
    conclusions=words.conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), R=lab1.by_hand.variances(p)[-1], build=partial(model, p))


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
