"""What a model's filter will do, before there are any data: the report of ``ctlabs analyse``."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from ctlabs.analysis import budgets
from ctlabs.filtering import bucy, steady
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel
from ctlabs.reporting import plots
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common, sampling, second
from ctlabs.studies.understanding import Understanding, compute
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

__all__ = ["compute", "limit_check", "report", "study"]


def study(model: ModelFile) -> Report:
    """Observability, the steady filter, its transient, its frequency response, and where its errors come from.

    Raises
    ------
    ValueError, FloatingPointError
        A model that cannot be discretised; an overflow within the model file's number of steps.
    """
    return report(compute(model))


def report(found: Understanding) -> Report:
    """What was found, with second routes and the sources of the error."""
    model, discrete, plan = found.file, found.discrete.value, found.transient.value
    steps, first = model.experiment.steps, model.experiment.first
    given = common.settings(
        model,
        ("dt", discrete.dt, "s", _("period")),
        ("steps", steps, "1", _("steps of the transient")),
        ("first", first, "1", _("index of the first measurement")),
    )
    made = common.begin("analyse", _("analysis"), model, "abcde", given)
    continuous = found.continuous.found if discrete.horizon is None else None
    made.section("a", _("The model"))
    if continuous is not None:
        common.show(made, continuous)
        made.says(_("Sampled every {dt} s, exactly:"), dt=discrete.dt)
    common.show(made, discrete)
    if continuous is not None:
        sampling.check(made, continuous, discrete)
    made.section("b", _("What the measurements see"))
    _observability(made, found)
    made.section("c", _("The steady filter"))
    if found.observability:
        _steady(made, found)
    made.section("d", _("From the start to the steady filter"))
    caption = _("Standard deviation of the error of {name} from P0 on, before and after each update.")
    caption += _(" Dotted: the steady values.") if found.limit else ""
    for i, name in enumerate(found.states[: common.SHOWN]):
        made.figure(f"transient_{i + 1}", found.deviations([i]), caption, name=name)
    made.value("sd_minus_end", plan.sd_minus[-1], common.units(discrete))
    made.value("sd_plus_end", plan.sd_plus[-1], common.units(discrete))
    _budget(made, discrete, plan.P_plus[-1], steps, first)
    if continuous is not None and continuous.Rc is not None:
        made.section("e", _("The filter of the continuous measurement"))
        _bucy(made, continuous, found)
    return made


def _observability(report: Report, found: Understanding) -> None:
    """Ranks and smallest singular values mode by mode, and what sampling loses."""
    if not found.observability:
        report.says("{reason}.", reason=found.observability.reason)
        return
    seen = found.observability.value
    report.table(
        "observability",
        [_("eigenvalue of Φ"), _("modulus"), _("rank"), _("smallest singular value")],
        zip(seen.eigenvalues.tolist(), np.abs(seen.eigenvalues).tolist(), seen.ranks, seen.sigma_min.tolist(), strict=True),
        _(
            "Test of Popov, Belevitch and Hautus: at every eigenvalue the matrix [Φ − λI; H] of an observable model has rank {n}; the smallest singular value, relative to the largest, says how near it is to losing it."
        ),
        n=len(seen.ranks),
    )
    report.value("eigenvalues", seen.eigenvalues)
    report.value("rank", seen.rank)
    report.value("observable", seen.ok)
    report.value("detectable", seen.detectable)
    report.value("sigma_min", float(seen.sigma_min.min()))
    for line in found.seen:
        report.says("{line}", line=line)
    if loss := found.sampling.found:
        report.value("lost_by_sampling", loss.lost)
        if loss.losing_periods:
            report.says(
                _(
                    "Periods at which two modes become one in the samples, the nearest of each pair: {periods} s; the model's {dt} s is {distance} % away from the nearest."
                ),
                periods=list(loss.losing_periods[:5]),
                dt=loss.dt,
                distance=round(100 * loss.distance, 1),
            )


def _steady(report: Report, found: Understanding) -> None:
    """Covariances, gains, poles, settling and transfer functions, or the reason why there are none."""
    names = ("P_minus_steady", "P_plus_steady", "gain_steady", "predictor_gain_steady", "innovation_covariance_steady")
    for line in found.settled:
        report.says("{line}", line=line)
    if not found.limit:
        for name in (*names, "filter_poles", "settling_step"):
            report.value(name, None, reason=found.limit.reason)
        return
    model, limit, found_limit = found.discrete.value, found.limit.value.state, found.limit.value
    report.math(
        r"P^- = {a} \qquad P^+ = {b} \qquad K = {c} \qquad K_{{pred}} = {d}".replace("{{", "{").replace("}}", "}"),
        a=limit.P_minus, b=limit.P_plus, c=limit.K, d=limit.K_pred,
    )  # fmt: skip
    report.says(
        _(
            "$P^-$ and $P^+$ are the error covariances before and after an update, $K$ updates the estimate, $K_{pred} = \\Phi K$ (with N, $+NS^{-1}$) leads from one prediction to the next."
        )
    )
    S = np.where(np.isfinite(limit.S), limit.S, np.inf)
    for name, value in zip(names, (limit.P_minus, limit.P_plus, limit.K, limit.K_pred, S), strict=True):
        report.value(name, value)
    report.value("filter_poles", limit.poles)
    limit_check(report, model, limit)
    columns = {_("σ before an update"): found_limit.sd_minus, _("σ after it"): found_limit.sd_plus}
    columns |= {fill(_("gain on {name}"), name=name): K for name, K in zip(model.measurements, limit.K.T, strict=True)}
    common.states_table(report, "steady", model, columns, _("Standard deviations of the steady filter's errors, and its gains."))
    reason = _never(np.diag(limit.P_plus), fill(_("{steps} steps"), steps=found_limit.longest))
    report.value("settling_step", found_limit.settled, reason=reason)
    report.value("settling_time", found_limit.time, "s", reason=reason)
    caption = _("Modes of the model and poles of its steady filter in the z plane: the nearer to 0, the sooner a filter forgets.")
    report.figure("poles", found.poles.value.drawing, caption)
    shown = found.transfers.value[: common.SHOWN]
    for each in shown:
        report.value(f"transfer_{each.state}_{each.measurement}", [each.num, each.den])
    report.table(
        "transfer",
        [_("estimate ← measurement"), _("numerator"), _("denominator")],
        [(each.name, each.num.tolist(), each.den.tolist()) for each in shown],
        _("Transfer functions of the steady filter, coefficients of ascending powers of z⁻¹."),
    )
    caption = _("Frequency response of the steady filter from measurements to estimates, up to the Nyquist frequency.")
    report.figure("bode", found.bode.value.drawing([each.name for each in shown]), caption)


def limit_check(report: Report, model: DiscreteModel, limit: steady.SteadyState) -> None:
    """The Riccati solver against the covariance that its gain really has, however slow the filter."""
    report.check(
        _("steady covariance"), limit.P_minus, second.covariance_of_gain(model, limit),
        (_("Riccati solver"), _("errors under its gain, 50 digits")), SOLVER,
    )  # fmt: skip


def _never(limit: Array, longest: str) -> str:
    """Why a filter has no settling time: a variance that tends to zero, or one that takes too long."""
    if (limit == 0).any():
        return _("a variance that tends to 0 never stays within 1 % of it")
    return fill(_("the variances are not within 1 % of their limits after {longest}"), longest=longest)


def _budget(report: Report, model: DiscreteModel, P: Array, steps: int, first: int) -> None:
    """The sources of the error at the end."""
    if not np.isfinite(model.P0).all():
        report.says(_("No error budget: nothing is known of a state at the start (`inf` in P0), so that it has no size."))
        return
    budget = budgets.budget(model, steps, first=first)
    report.table(
        "budget",
        [_("source"), *(fill(_("variance of {name}"), name=name) for name in budget.states)],
        budget.table(),
        _("Where the error comes from: contributions to the error variances after the last update."),
    )
    report.check(
        _("error budget adds up"), budget.parts[:, -1].sum(axis=0), P,
        (_("sum over the sources"), _("recursion")), SOLVER,
    )  # fmt: skip


def _bucy(report: Report, model: ContinuousModel, found: Understanding) -> None:
    """The Kalman–Bucy filter of a continuous measurement."""
    if not found.continuous_limit:
        reason = found.continuous_limit.reason
        for name in ("P_steady_continuous", "gain_steady_continuous"):
            report.value(name, None, reason=reason)
        report.says(_("There is no steady continuous filter: {reason}."), reason=reason)
        return
    limit = found.continuous_limit.value
    report.value("P_steady_continuous", limit.P)
    report.value("gain_steady_continuous", limit.K)
    report.value("filter_poles_continuous", limit.poles, "1/s")
    known = bool(np.isfinite(model.P0).all())
    settled = bucy.settling_time(model) if known else None
    why = _never(np.diag(limit.P), _("any time that was searched")) if known else _("nothing is known at the start")
    report.value("settling_time_continuous", settled, "s", reason=why)
    slowest = -float(limit.poles.real.max(initial=-np.inf))
    if 0 < slowest < math.inf:
        variance = np.diag(limit.P)
        start = np.diag(np.where(variance > 0, variance, np.diag(model.P0)))
        far = bucy.transient(dataclasses.replace(model, P0=start), [20 / slowest])
        report.check(
            _("steady covariance of the continuous filter"), limit.P, far.P[-1],
            (_("Riccati solver"), _("transient to its limit")), SOLVER,
        )  # fmt: skip
    caption = _("Modes of the model and poles of its steady continuous filter in the s plane.")
    report.figure("poles_continuous", found.poles_continuous.value.drawing, caption)
    rate = float(np.abs(limit.poles).max(initial=0.0)) or 1.0
    low = float(np.abs(limit.poles[limit.poles != 0]).min(initial=rate))
    systems = {
        common.label(f"{model.states[i]} ← {model.measurements[j]}"): bucy.transfer_function(model, i, j)
        for i, j in list(np.ndindex(model.n, model.m))[: common.SHOWN]
    }
    report.figure(
        "bode_continuous",
        plots.bode(systems, np.geomspace(low / 100, 100 * rate, 400)),
        _("Frequency response of the steady continuous filter from measurements to estimates."),
    )
