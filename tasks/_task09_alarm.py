"""Lab 9: an alarm when the voltage may be above its limit; what its margin promises, and what it does not."""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks.answers import task09 as by_hand
from scipy.special import ndtr

from ctlabs.labs.experiment import covariances
from ctlabs.reporting import plots
from ctlabs.reporting.report import SOLVER
from ctlabs.text import Uncertain, text

#: Margins of the rule, in standard deviations of the error, and limits, in those of the voltage.
FACTORS, LIMITS = (0, 1, 2, 3), (2, 3)
#: Parts of the lab by their filters, and the share of dangerous moments that may be missed.
PARTS, SHARE = {"perfect": "(a)", "noisy": "(b)"}, 0.01
#: Shares smaller than this are not drawn.
LEAST = 1e-5


def alarm(r, p, experiment, filters, steps):
    """The alarm rule: what a margin promises, of all moments and of the dangerous ones."""
    r.subsection("An alarm on the estimate", "alarm")
    r.says("$C_1$ breaks down when $U_1$ exceeds a limit $U_{max}$. With a margin of $k$ standard deviations the rule is")
    r.math(r"\text{alarm when} \quad \hat U_1(t) + k\,\sigma(t) \ge U_{max}, \qquad \sigma^2(t) = P_{11}(t).", "rule")
    r.says("Without an alarm the voltage can be above the limit only if the error is below $-k\\sigma$. That is so in at most the share $N(-k)$ of *all* moments, where N is the normal distribution function: one in 740 for $k = 3$, whatever the limit.")
    r.says("It says little about the *dangerous* moments, those with $U_1 \\ge U_{max}$, which may be rarer than that. The error of an optimal estimate is uncorrelated with the estimate {ref:anderson_moore, chapter 5}, but not with the voltage. With $V = \\mathrm{Var}\\,U_1$ the mean of $\\hat{U}_1$ at a voltage u is $(1 - \\sigma^2/V)u$: it is drawn towards 0, and most where the voltage is large. Since $\\hat{U}_1 \\sim N(0, V - \\sigma^2)$ and, given the estimate, $U_1 \\sim N(\\hat{U}_1, \\sigma^2)$,")
    r.math(r"P(\text{dangerous, no alarm}) = \int_{U_{max}}^\infty p(u)\,N\!\left(\frac{U_{max} - k\sigma - (1-\sigma^2/V)u}{\sigma\sqrt{1-\sigma^2/V}}\right)du = \int_{-\infty}^{U_{max}-k\sigma} p(\hat u)\,N\!\left(\frac{\hat u - U_{max}}\sigma\right)d\hat u,", "joint")
    r.says("where p is the density of the variable in its brackets. Divided by $P(U_1 \\ge U_{max}) = N(-U_{max}/\\sqrt V)$ it is the share of the dangerous moments that the rule misses.")
    schedules = {name: covariances(filters[name], p.steps) for name in PARTS}
    V = covariances(filters["unmeasured"], p.steps).P_plus[-1, 0, 0]
    left = {name: schedule.P_plus[-1, 0, 0] / V for name, schedule in schedules.items()}
    cases = [(name, limit, k) for name in left for limit in LIMITS for k in FACTORS]
    joint = [by_hand.unannounced(left[name], limit, k) for name, limit, k in cases]
    again = [by_hand.by_estimate(left[name], limit, k) for name, limit, k in cases]
    shape = (len(left), len(LIMITS), len(FACTORS))
    missed = np.reshape([x / ndtr(-limit) for x, (_name, limit, _k) in zip(joint, cases, strict=True)], shape)
    r.value("alarm_joint", np.reshape(joint, shape).tolist())
    r.value("alarm_missed_of_dangerous", missed.tolist())
    r.check("dangerous and unannounced", joint, again, ("integral over the voltage", "integral over the estimate"), SOLVER, scale=np.maximum(again, 1e-12))
    seen = {name: simulated(experiment, filters[name], steps) for name in left}
    shares(r, np.reshape(joint, shape), missed, seen, V)
    drawn(r, left, seen, missed)
    return {"missed": missed, "price": thresholds(r, schedules, V)}


def shares(r, joint, missed, seen, V):
    """The table of both probabilities, and what the simulation counts."""
    rows = []
    for i, (name, part) in enumerate(PARTS.items()):
        for j, limit in enumerate(LIMITS):
            for m, k in enumerate(FACTORS):
                here = seen[name][k] if limit == LIMITS[0] else None
                rows.append((part, limit, k, joint[i, j, m], missed[i, j, m], *(("—", "—") if here is None else here)))
    r.table("alarm", ["filter", "limit, σ of U₁", "margin k", "dangerous and unannounced", "share missed", "share missed, all instants", "simulated"], rows,
            "The alarm rule just after the last measurement of the plot, where $U_1$ has the standard deviation {sd} b. The last two columns are averages over all instants of the simulation, each with its own standard deviations, with the error of the count (none where all or none were missed).", sd=math.sqrt(V))


def drawn(r, left, seen, missed):
    """The share missed against the margin."""
    k = np.linspace(0.0, 5.0, 61)
    curves = {}
    for name, part in PARTS.items():
        for limit in LIMITS:
            share = np.array([by_hand.unannounced(left[name], limit, each) for each in k]) / ndtr(-limit)
            curves[text("{part} limit {limit} σ", part=part, limit=limit)] = np.where(share > LEAST, share, np.nan)
    counted = [(at, float(getattr(found[1], "value", found[1]))) for name in PARTS for at, found in seen[name].items() if isinstance(found[1], Uncertain)]
    counted = [(at, share) for at, share in counted if share > LEAST]
    points = {"simulated, limit 2 σ": tuple(np.array(counted).T)} if counted else None
    bound = np.where(ndtr(-k) > LEAST, ndtr(-k), np.nan)
    figure = plots.lines(k, curves, xlabel="margin $k$, a number of σ", ylabel="dangerous moments missed, ratio", log="y", points=points,
                         straight={"one in a hundred": ([0, 5], [SHARE, SHARE]), "$N(-k)$": (k, bound)})
    r.figure("alarm", figure, "Share of the dangerous moments that the alarm misses, against its margin. The falling dashed line is the bound $N(-k)$ on the share of all moments: it says nothing about the curves, of which, for each filter, that of the higher limit is the upper one.")
    r.says("{fig:alarm} and {tab:alarm} give that share. Without a margin the alarm misses {least:2} to {most:2} % of the dangerous moments, since an estimate that is drawn towards 0 is below the limit when the voltage is a little above it. The share falls with $k$, later for the higher limit. The points are the shares that the simulated filters missed, and they lie about the curves.",
           least=100 * float(missed[:, :, 0].min()), most=100 * float(missed[:, :, 0].max()))


def thresholds(r, schedules, V):
    """The margin and the threshold that let one dangerous moment in a hundred pass, and their price."""
    rows = []
    for name, part in PARTS.items():
        for moment, P in (("just after", schedules[name].P_plus), ("just before", schedules[name].P_minus)):
            for limit in LIMITS:
                share = min(P[-1, 0, 0] / V, 1.0)
                k = by_hand.margin(share, limit, SHARE)
                threshold = limit - k * math.sqrt(share)
                alarmed = float(ndtr(-threshold / math.sqrt(1 - share))) if share < 1 else 1.0
                rows.append((part, moment, limit, k, threshold * math.sqrt(V), alarmed, float(ndtr(-limit))))
    r.says("To bound the share itself, solve {eq:joint} for $k$. {tab:thresholds} does so for one dangerous moment in a hundred: the alarm must sound when $\\hat{U}_1$ reaches $U_{max} - k\\sigma$, a voltage that may lie far below the limit, and for a poor estimate below 0. The price is in the last columns: the alarm is on in a much larger share of the time than the voltage is dangerous. Just before a measurement σ is larger, and the threshold no higher than just after it.")
    r.table("thresholds", ["filter", "measurement", "limit, σ of U₁", "k", "threshold of the estimate, b", "share of time on", "share of time dangerous"], rows,
            "The margin with which one dangerous moment in a hundred is missed, just after and just before the last measurement of the plot.")
    return {row[0]: row[-2] for row in rows if row[1] == "just after" and row[2] == LIMITS[0]}


def simulated(experiment, system, steps):
    """By k, the share of the dangerous moments missed at the lower limit: the mean of theory over the instants, and that of all runs.

    Moments of one run are correlated, so the error of the ratio is found from run to run.
    """
    some = experiment.histories(system, steps=steps, runs=experiment.runs)
    V = np.diagonal(covariances(replace(system, R=[[math.inf]]), steps).P_plus, axis1=1, axis2=2)[1:, :1]
    sd, own = np.sqrt(V), some.sd_plus[1:, :1]
    left = np.minimum((own / sd)[:, 0] ** 2, 1.0)
    dangerous, found = some.truth[1:, 0] >= LIMITS[0] * sd, {}
    for k in FACTORS:
        theory = float(np.mean([by_hand.unannounced(each, LIMITS[0], k) for each in left])) / float(ndtr(-LIMITS[0]))
        lost = (dangerous & (some.x_plus[1:, 0] + k * own < LIMITS[0] * sd)).sum(axis=0)
        found[k] = (theory, ratio(lost, dangerous.sum(axis=0)))
    return found


def ratio(counts, of):
    """A share of counts over runs, with its error; "—" where there was nothing to count."""
    if not of.sum():
        return "—"
    share = float(counts.sum() / of.sum())
    return Uncertain(share, float(np.sqrt(((counts - share * of) ** 2).sum()) / of.sum()))
