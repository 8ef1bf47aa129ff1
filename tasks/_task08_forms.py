"""Lab 8, part (g): numerical forms of the filter, by accuracy and cost."""

import math
from dataclasses import replace

import numpy as np

from ctlabs.analysis import sensitivity
from ctlabs.filtering import compare, kalman_filter, reference, steady
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, portrait
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT, SOLVER
from ctlabs.text import text

#: What the simplified filter's state is in the true state (x, y).
FIRST = ((1.0, 0.0),)
STEP, RELATIVE = "measurement number i", "variance relative to the optimal one"


def operations(n):
    """Operations of one step of the short form for n states and one measurement."""
    predict = n * (2 * n - 1) + 2 * n * n * (2 * n - 1) + n * n
    return predict + 2 * (2 * n - 1) + 2 * n * (2 * n - 1) + 2 + n + 2 * n * n + 2 * n


def ratio(x, y):
    """x/y; 1 for 0/0 (perfect measurements leave no error to anyone)."""
    return x / y if y else 1.0


def part_g(r, systems, experiment, steps):
    """Two ways, and the numerical forms of the filter."""
    r.section("g", "Two ways, and the filter's numerical forms")
    truth, *designs = systems
    r.says("**Way 1** is part (f): the equations of (e), solved. **Way 2** simulates the system and every filter. First the filter of the true model:")
    limit = steady.solve(truth)
    stats = portrait(r, experiment, truth, steps, xlabel="t, s", limits=(limit.P_minus[0, 0], limit.P_plus[0, 0]))
    best, rows = covariances(truth, steps), []
    rows.append(("true model", best.sd_plus[-1, 0], best.sd_plus[-1, 0], stats.rms[-1, 0], stats.bias[-1, 0], stats.nees[-1] / 2, 1))
    for i, design in enumerate(designs, start=1):
        actual = sensitivity.actual(truth, design, steps, compare=FIRST)
        own = experiment.statistics(truth, design, steps=steps, compare=FIRST)
        name = text("variant {n}", n=i)
        agreement(r, name, own, actual.P_plus, consistent=False)
        claimed, true = actual.claimed.P_plus[-1, 0, 0], actual.P_plus[-1, 0, 0]
        rows.append((name, math.sqrt(claimed), math.sqrt(true), own.rms[-1, 0], own.bias[-1, 0], own.nees[-1], ratio(true, claimed)))
        curves = {"claimed": actual.claimed.sd_plus[:, 0], "true": np.sqrt(actual.P_plus[:, 0, 0])}
        r.figure(f"ways_variant{i}", plots.lines(range(steps + 1), curves, xlabel=STEP, ylabel="standard deviation of the error of x, m", points={"ensemble": (range(steps + 1), own.rms[:, 0])}, steps=True),
                 "Variant {n}, way 1 (lines) and way 2 (points, RMS of {runs} runs): the ensemble follows the true curve of the sensitivity analysis, whatever the filter claims.", n=i, runs=experiment.runs)
    r.table("ways", ["filter", "σ claimed, m", "σ true, m", "RMS, m", "mean error, m", "NEES per state", "NEES in theory"], rows,
            "Error of x after the last simulated measurement. NEES is an average over the runs: below 1 the filter is cautious, above 1 optimistic.")
    few = [experiment.histories(truth, model, steps=steps, runs=1) for model in (truth, designs[0])]
    shown = {name: (e.t, e.x_plus[:, 0, 0], e.sd_plus[:, 0]) for name, e in zip(("true model", "variant 1"), few, strict=True)}
    r.figure("both", plots.estimates((few[0].t, few[0].truth[:, 0, 0]), shown, ylabel="x, m", measurements=(few[0].t[1:], few[0].z[1:, 0, 0])),
             "One run, filtered with the true model and with variant 1.")
    lost, cheapest = numerical_forms(r, truth, designs[0], few[0])
    return {"lost": lost, "cheapest": cheapest}


def numerical_forms(r, truth, design, one):
    """Accuracy and cost of the numerical forms."""
    r.says("**Numerical forms.** The same record is filtered by every form of the filter in the library, and by one with 50 digits. All but the steady form differ from it in rounding only. $P^+ = (I-KH)P^-$ is the conventional, short form; Joseph's adds two squares, and so does the sequential one, element by element; Potter's, Carlson's and the array forms carry a square root of $P$; UD and LD its factors without square roots; the information forms $P^{-1}$ or a root of it. The steady form has the gain's limit from the first step on, so its difference is one of method: its digits say how far the gain is from its limit. The cost is counted, operation by operation, while one step is done with dense matrices.")
    fine = 1e-12 * covariances(truth, 1).P_minus[1, 0, 0]
    z, rows = one.z[1:, :, 0], []
    systems = [("true model", truth), ("true model, fine sensor", replace(truth, R=[[fine]])), ("variant 1", design)]
    lost, refused, costs = {}, {}, []
    for name, system in systems:
        exact, found = reference(system, z), compare(system, z)
        size = max(np.abs(exact.x_plus[:, 0]).max(), 1e-300)
        costs.append({c.name: c.flops for c in found})
        able = [c for c in found if not c.failed]
        rows += [(name, c.name, c.flops, digits(c.error_variance[0]), digits(c.error_x[0] / size)) for c in able]
        lost[name] = [c.name for c in able if c.name != "steady" and digits(c.error_variance[0]) < 8]
        for c in found:
            if c.failed:
                refused.setdefault(c.failed.removeprefix(f"form {c.name}: "), {}).setdefault(c.name, []).append(name)
        r.check(text("P⁺ by filterpy, {system}", system=name), covariances(system, len(z)).P_plus, exact.P_plus, ("double precision", "50 digits"), SOLVER)
        r.check(text("variance of x by UD, {system}", system=name), kalman_filter(system, z, algorithm="ud").P_plus[:, 0, 0], exact.P_plus[:, 0, 0], ("double precision", "50 digits"), SOLVER)
    r.table("forms", ["system", "form", "operations per step", "correct digits of P⁺ of x", "correct digits of x̂"], rows,
            "Numerical forms. The fine sensor has the variance {fine} m², 10⁻¹² of the first prediction's.", fine=fine)
    for reason, where in refused.items():
        r.says("Not in the table: {names}. The library says why: {reason}.", reason=reason,
               names="; ".join(f"{form} ({', '.join(places)})" for form, places in where.items()))
    if {"information", "srif"} & {form for where in refused.values() for form in where}:
        r.says("At rest $P_0$ is singular: what is known exactly has infinite information, so forms that carry $P^{-1}$ cannot start here.")
    for name, system, count in (("flops_true_model", truth, costs[0]), ("flops_simplified", design, costs[2])):
        r.value(name, list(count.values()), reason="forms that cannot start here, named above")
        r.check(text("operations of the short form, {n} states", n=system.n), count["conventional"], operations(system.n), ("counted", "formula"), EXACT)
    given, worse = (", ".join(lost[systems[i][0]]) for i in (0, 1))
    r.says("(flops_true_model and flops_simplified list the forms in the order {order}; no number where a form cannot start.) Forms that keep fewer than 8 digits of the variance of x: with the given sensor {given}, with the fine one {fine}. The short form is a small difference of large numbers when a measurement is much better than the prediction.",
           order=", ".join(FORMS), given=given or "none", fine=worse or "none")
    optimal_ = {form: cost for form, cost in costs[0].items() if cost and form != "steady"}
    return given, min(optimal_, key=optimal_.get)


def digits(error):
    """Correct digits of a number with a relative error."""
    return 16 if error < 1e-16 else max(0, math.floor(-math.log10(error)))
