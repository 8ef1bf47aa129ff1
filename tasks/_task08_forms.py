"""Lab 8, part (g): numerical forms of the filter, by accuracy and cost."""

import math
from dataclasses import replace

import numpy as np

from ctlabs.analysis import sensitivity
from ctlabs.filtering import compare, kalman_filter, reference
from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import agreement, mean_error, portrait, rms
from ctlabs.reporting.drawing import Curve, Drawing, Panel
from ctlabs.reporting.report import EXACT, SOLVER
from ctlabs.text import text

#: What the simplified filter's state is in the true state (x, y).
FIRST = ((1.0, 0.0),)
STEP = "measurement number i"


def operations(n):
    """Operations of one step of the short form for n states and one measurement."""
    predict = n * (2 * n - 1) + 2 * n * n * (2 * n - 1) + n * n
    return predict + 2 * (2 * n - 1) + 2 * n * (2 * n - 1) + 2 + n + 2 * n * n + 2 * n


def ratio(x, y):
    """x/y; 1 for 0/0 (perfect measurements leave no error to anyone)."""
    return x / y if y else 1.0


def part_g(r, systems, experiment, steps):
    """Two ways, and the numerical forms of the filter."""
    r.section("g", "Two ways, and the numerical forms of the filter")
    truth, *designs = systems
    r.says("**Way 1** is that of part (f): the equations of (e) are solved. **Way 2** simulates the system and runs every filter on the same data. {fig:ensemble} shows the filter of the true model, {fig:ways} both simplified ones.")
    stats = portrait(r, experiment, truth, steps, xlabel="t, s", figures={"ensemble": "The filter of the true model has the errors that it claims."})
    best, panels, k = covariances(truth, steps), [], np.arange(steps + 1)
    rows = [("true model", best.sd_plus[-1, 0], best.sd_plus[-1, 0], rms(stats), mean_error(stats), stats.nees[-1] / 2, 1)]
    for i, design in enumerate(designs, start=1):
        actual = sensitivity.actual(truth, design, steps, compare=FIRST)
        own = experiment.statistics(truth, design, steps=steps, compare=FIRST)
        name = text("variant {n}", n=i)
        agreement(r, name, own, actual.P_plus, consistent=False)
        claimed, true = actual.claimed.P_plus[-1, 0, 0], actual.P_plus[-1, 0, 0]
        rows.append((name, math.sqrt(claimed), math.sqrt(true), rms(own), mean_error(own), own.nees[-1], ratio(true, claimed)))
        panels.append(Panel(text("σ of the error of x, m: variant {n}", n=i), (
            Curve("claimed", k, actual.claimed.sd_plus[:, 0], "orange", "dash"), Curve("true, by way 1", k, np.sqrt(actual.P_plus[:, 0, 0]), "blue"),
            Curve("RMS, by way 2", k, own.rms[:, 0], "black", "points", size=3.0)), kind="count"))
    r.figure("ways", Drawing("Two ways", STEP, tuple(panels), whole=True, height=6.4),
             "The simplified filters by both ways: what they claim, what the sensitivity analysis says they do, and the RMS error of {runs} runs.", runs=experiment.runs)
    r.table("ways", ["filter", "σ claimed, m", "σ true, m", "RMS, m", "mean error, m", "NEES per state", "NEES in theory"], rows,
            "Error of $x$ after the last simulated measurement. NEES is an average over the runs: below 1 the filter is cautious, above 1 optimistic.")
    r.says("In {fig:ways} the ensemble follows the true curve of the sensitivity analysis, whatever the filter claims; {tab:ways} has the end of the runs.")
    few = experiment.histories(truth, steps=steps, runs=1)
    lost, cheapest = numerical_forms(r, truth, designs[0], few)
    return {"lost": lost, "cheapest": cheapest, "measured": rms(own, unit="m"), "sd": math.sqrt(true)}


def numerical_forms(r, truth, design, one):
    """Accuracy and cost of the numerical forms."""
    r.says("**Numerical forms** ({ref:maybeck, chapter 7}). In {tab:forms} the same record is filtered by every form of the filter in the library, and once with 50 digits. All but the steady form differ from that in rounding only. The conventional, short form is $P^+ = (I-KH)P^-$. Joseph's form adds two squares, and so does the sequential one, element by element. Potter's, Carlson's and the array forms carry a square root of $P$; UD and LD carry its factors without square roots; the information forms carry $P^{-1}$ or a root of it. The steady form has the limit of the gain from the first step on, so its digits say how far the gain is from its limit. The cost is the number of operations of one step with dense matrices.")
    fine = 1e-12 * covariances(truth, 1).P_minus[1, 0, 0]
    z, table = one.z[1:, :, 0], {}
    systems = [("true model", truth), ("true model with a fine sensor", replace(truth, R=[[fine]])), ("variant 1", design)]
    lost, refused, costs = {}, {}, []
    for name, system in systems:
        exact, found = reference(system, z), compare(system, z)
        size = max(np.abs(exact.x_plus[:, 0]).max(), 1e-300)
        costs.append({c.name: c.flops for c in found})
        able = [c for c in found if not c.failed]
        for c in able:
            table.setdefault(c.name, {})[name] = (c.flops, digits(c.error_variance[0]), digits(c.error_x[0] / size))
        lost[name] = [c.name for c in able if c.name != "steady" and digits(c.error_variance[0]) < 8]
        for c in found:
            if c.failed:
                refused.setdefault(c.failed.removeprefix(f"form {c.name}: "), {}).setdefault(c.name, []).append(name)
        r.check(text("P⁺ by filterpy, {system}", system=name), covariances(system, len(z)).P_plus, exact.P_plus, ("double precision", "50 digits"), SOLVER)
        r.check(text("variance of x by UD, {system}", system=name), kalman_filter(system, z, algorithm="ud").P_plus[:, 0, 0], exact.P_plus[:, 0, 0], ("double precision", "50 digits"), SOLVER)
    nothing, (true, sharp, simple) = (None, None, None), (name for name, _system in systems)
    r.table("forms", ["form", "operations, true model", "digits of P⁺", "digits of x̂", "digits of P⁺, fine sensor", "operations, variant 1", "digits of P⁺, variant 1"],
            [(called(form), *found.get(true, nothing), found.get(sharp, nothing)[1], *found.get(simple, nothing)[:2]) for form, found in table.items()],
            "Numerical forms: operations in a step, and correct digits of the variance and of the estimate of $x$. The fine sensor has the variance {fine:2} m², $10^{-12}$ of that of the first prediction.", fine=fine)
    absent = dict.fromkeys(called(form) for where in refused.values() for form in where)
    if absent:
        r.says("Not every form can filter all three systems; these are missing from some columns, or from the whole table: {names}.", names=", ".join(absent))
    if {"information", "srif"} & {form for where in refused.values() for form in where}:
        r.says("At rest $P_0$ is singular: what is known exactly has infinite information, so that the forms which carry $P^{-1}$ cannot start here.")
    for name, system, count in (("flops_true_model", truth, costs[0]), ("flops_simplified", design, costs[2])):
        r.value(name, list(count.values()), reason="forms that cannot start here, named above")
        r.check(text("operations of the short form, {n} states", n=system.n), count["conventional"], operations(system.n), ("counted", "formula"), EXACT)
    few, fewer = ([text("the {form} form", form=called(form)) for form in lost[systems[i][0]]] for i in (0, 1))
    r.says(("With the given sensor every form keeps at least 8 digits of the variance of $x$." if not few else "With the given sensor fewer than 8 digits of the variance of $x$ are kept by {few}."),
           (" So it is with the fine one." if not few and not fewer else " With the fine one every form keeps 8 digits." if not fewer else " With the fine one fewer than 8 are kept by {fewer}."),
           " (The steady form is not counted.) The short form is a small difference of large numbers when a measurement is much better than the prediction.", few=", ".join(few), fewer=", ".join(fewer))
    optimal_ = {called(form): cost for form, cost in costs[0].items() if cost and form != "steady"}
    return ", ".join(few), min(optimal_, key=optimal_.get)


def called(form):
    """A form's name as a reader writes it."""
    plain = form.replace("_", " ")
    return text("{form}", form=plain.upper() if form in ("srif", "ud", "ld") else plain.capitalize() if form in ("joseph", "potter", "carlson") else plain)


def digits(error):
    """Correct digits of a number with a relative error."""
    return 16 if error < 1e-16 else max(0, math.floor(-math.log10(error)))
