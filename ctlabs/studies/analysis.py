"""What a model's filter will do, before there are any data: ``ctlabs analyse``."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from ctlabs.analysis import sensitivity
from ctlabs.filtering import bucy, steady
from ctlabs.filtering.filter import covariances
from ctlabs.filtering.settle import settling
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models import ContinuousModel, DiscreteModel, observability
from ctlabs.reporting import plots
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common, sampling, second
from ctlabs.text import _, fill

if TYPE_CHECKING:
    from ctlabs.files.modelfile import ModelFile

#: The settling step is looked for in so many steps.
SETTLING = 20_000
#: Frequency responses are drawn and listed for so many pairs of a state and a measurement.
PAIRS = 6


def study(model: ModelFile) -> Report:
    """Observability, the steady filter, its transient, its frequency response, and where its errors come from.

    Raises
    ------
    ValueError, FloatingPointError
        A model that cannot be discretised; an overflow within the model file's number of steps.
    """
    plan = model.experiment
    discrete = common.discrete(model, plan.steps)
    given = common.settings(
        model,
        ("dt", discrete.dt, "s", _("period")),
        ("steps", plan.steps, "1", _("steps of the transient")),
        ("first", plan.first, "1", _("index of the first measurement")),
    )
    report = common.begin("analyse", _("analysis"), model, "abcde", given)
    constant = discrete.horizon is None
    continuous = model.continuous() if model.kind == "continuous" and constant else None
    report.section("a", _("The model"))
    _model(report, continuous, discrete)
    report.section("b", _("What the measurements see"))
    if constant:
        _observability(report, continuous, discrete)
    else:
        report.says(
            _(
                "The matrices vary with time (over {steps} steps), so there are no modes and no steady filter to speak of."
            ),
            steps=plan.steps,
        )
    report.section("c", _("The steady filter"))
    limit = _steady(report, discrete) if constant else None
    report.section("d", _("From the start to the steady filter"))
    _transient(report, discrete, plan.steps, plan.first, limit)
    if continuous is not None and continuous.Rc is not None:
        report.section("e", _("The filter of the continuous measurement"))
        _bucy(report, continuous)
    return report


def _model(report: Report, continuous: ContinuousModel | None, discrete: DiscreteModel) -> None:
    """Every matrix; of a continuous model also what a period makes of it."""
    if continuous is not None:
        common.show(report, continuous)
        report.says(_("Sampled every {dt} s, exactly:"), dt=discrete.dt)
    common.show(report, discrete)
    if continuous is not None:
        sampling.check(report, continuous, discrete)


def _observability(report: Report, continuous: ContinuousModel | None, model: DiscreteModel) -> None:
    """Ranks and smallest singular values mode by mode, and what sampling loses."""
    seen = observability.analyse(model)
    moduli = np.abs(seen.eigenvalues)
    report.table(
        "observability",
        [_("eigenvalue of Φ"), _("modulus"), _("rank"), _("smallest singular value")],
        zip(seen.eigenvalues.tolist(), moduli.tolist(), seen.ranks, seen.sigma_min.tolist(), strict=True),
        _(
            "Test of Popov, Belevitch and Hautus: at every eigenvalue the matrix [Φ − λI; H] of an observable model has rank {n}; the smallest singular value, relative to the largest, says how near it is to losing it."
        ),
        n=model.n,
    )
    report.value("eigenvalues", seen.eigenvalues)
    report.value("rank", seen.rank)
    report.value("observable", seen.ok)
    report.value("detectable", seen.detectable)
    report.value("sigma_min", float(seen.sigma_min.min()))
    if seen.ok:
        report.says(_("Every state is observable."))
    else:
        modes = "; ".join(seen.unobservable_modes)
        report.says(
            _("{count} of {n} dimensions are never seen ({modes})."), count=model.n - seen.rank, n=model.n, modes=modes
        )
        if not seen.detectable:
            report.says(
                _(
                    "Not detectable: {modes} neither decays nor is seen, so its error has no limit that does not depend on P0."
                ),
                modes="; ".join(seen.undetectable_modes),
            )
    if continuous is not None:
        loss = observability.loss_by_sampling(continuous, model.dt)
        report.value("lost_by_sampling", loss.lost)
        if loss.losing_periods:
            report.says(
                _(
                    "Periods at which two modes become one in the samples, the nearest of each pair: {periods} s; the model's {dt} s is {distance} % away from the nearest."
                ),
                periods=list(loss.losing_periods[:5]),
                dt=model.dt,
                distance=round(100 * loss.distance, 1),
            )


def _steady(report: Report, model: DiscreteModel) -> steady.SteadyState | None:
    """Covariances, gains, poles, settling and transfer functions, or the reason why there are none."""
    names = ("P_minus_steady", "P_plus_steady", "gain_steady", "predictor_gain_steady", "innovation_covariance_steady")
    try:
        limit = steady.solve(model)
    except ValueError as error:
        reason = str(error).removeprefix("steady state: ")
        for name in (*names, "filter_poles", "settling_step"):
            report.value(name, None, reason=reason)
        report.says(_("There is no steady filter: {reason}."), reason=reason)
        return None
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
    common.states_table(
        report,
        "steady",
        model,
        {
            _("σ before an update"): deviations(limit.P_minus),
            _("σ after it"): deviations(limit.P_plus),
            **{fill(_("gain on {name}"), name=name): K for name, K in zip(model.measurements, limit.K.T, strict=True)},
        },
        _("Standard deviations of the steady filter's errors, and its gains."),
    )
    settled = settling(model, longest=SETTLING)
    reason = _never(np.diag(limit.P_plus), fill(_("{steps} steps"), steps=SETTLING))
    report.value("settling_step", settled, reason=reason)
    report.value("settling_time", None if settled is None else settled * model.dt, "s", reason=reason)
    report.figure(
        "poles",
        plots.poles({_("model (Φ)"): np.linalg.eigvals(model.Phi), _("filter"): limit.poles}, plane="z"),
        _(
            "Modes of the model and poles of its steady filter in the z plane: the nearer to 0, the sooner a filter forgets."
        ),
    )
    _responses(report, model)
    return limit


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


def _responses(report: Report, model: DiscreteModel) -> None:
    """Transfer functions from measurements to estimates, in powers of z⁻¹, and their frequency response."""
    pairs = [(i, j) for i in range(model.n) for j in range(model.m) if np.isfinite(model.R[j, j])][:PAIRS]
    systems, rows = {}, []
    for i, j in pairs:
        num, den = steady.transfer_function(model, i, j)
        name = f"{model.states[i]} ← {model.measurements[j]}"
        report.value(f"transfer_{model.states[i]}_{model.measurements[j]}", [num, den])
        rows.append((name, num.tolist(), den.tolist()))
        systems[common.label(name)] = (num, den, model.dt)
    report.table(
        "transfer",
        [_("estimate ← measurement"), _("numerator"), _("denominator")],
        rows,
        _("Transfer functions of the steady filter, coefficients of ascending powers of z⁻¹."),
    )
    nyquist = math.pi / model.dt
    report.figure(
        "bode",
        plots.bode(systems, np.geomspace(nyquist * 1e-4, nyquist, 400)),
        _("Frequency response of the steady filter from measurements to estimates, up to the Nyquist frequency."),
    )


def _transient(report: Report, model: DiscreteModel, steps: int, first: int, limit: steady.SteadyState | None) -> None:
    """Standard deviations and gains over time, and the sources of the error at the end."""
    plan = covariances(model, steps, first=first)
    for i, (name, unit) in enumerate(list(zip(model.states, model.units, strict=True))[: common.SHOWN]):
        both = (np.where(np.isfinite(sd[:, i]), sd[:, i], np.nan) for sd in (plan.sd_minus, plan.sd_plus))
        curves = dict(zip((_("before an update"), _("after it")), both, strict=True))
        limits = None
        if limit is not None:
            limits = {_("before an update"): deviations(limit.P_minus)[i], _("after it"): deviations(limit.P_plus)[i]}
        ylabel = common.label(fill(_("σ of the error of {name}"), name=name), unit)
        report.figure(
            f"transient_{i + 1}",
            plots.transient(plan.t, curves, ylabel=ylabel, limits=limits, log=common.wide(*curves.values())),
            _("Standard deviation of the error of {name} from P0 on; dashed: the steady values.")
            if limits
            else _("Standard deviation of the error of {name} from P0 on."),
            name=name,
        )
    report.value("sd_minus_end", plan.sd_minus[-1], common.units(model))
    report.value("sd_plus_end", plan.sd_plus[-1], common.units(model))
    if not np.isfinite(model.P0).all():
        report.says(_("No error budget: nothing is known of a state at the start (`inf` in P0), so that it has no size."))
        return
    budget = sensitivity.budget(model, steps, first=first)
    report.table(
        "budget",
        [_("source"), *(fill(_("variance of {name}"), name=name) for name in budget.states)],
        budget.table(),
        _("Where the error comes from: contributions to the error variances after the last update."),
    )
    report.check(
        _("error budget adds up"), budget.parts[:, -1].sum(axis=0), plan.P_plus[-1],
        (_("sum over the sources"), _("recursion")), SOLVER,
    )  # fmt: skip


def _bucy(report: Report, model: ContinuousModel) -> None:
    """The Kalman–Bucy filter of a continuous measurement."""
    try:
        limit = bucy.steady(model)
    except ValueError as error:
        reason = str(error).removeprefix("steady state: ")
        for name in ("P_steady_continuous", "gain_steady_continuous"):
            report.value(name, None, reason=reason)
        report.says(_("There is no steady continuous filter: {reason}."), reason=reason)
        return
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
    report.figure(
        "poles_continuous",
        plots.poles({_("model (F)"): np.linalg.eigvals(model.F), _("filter"): limit.poles}, plane="s"),
        _("Modes of the model and poles of its steady continuous filter in the s plane."),
    )
    rate = float(np.abs(limit.poles).max(initial=0.0)) or 1.0
    low = float(np.abs(limit.poles[limit.poles != 0]).min(initial=rate))
    systems = {
        common.label(f"{model.states[i]} ← {model.measurements[j]}"): bucy.transfer_function(model, i, j)
        for i, j in [(i, j) for i in range(model.n) for j in range(model.m)][:PAIRS]
    }
    report.figure(
        "bode_continuous",
        plots.bode(systems, np.geomspace(low / 100, 100 * rate, 400)),
        _("Frequency response of the steady continuous filter from measurements to estimates."),
    )
