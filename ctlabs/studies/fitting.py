"""Constants of a model estimated from a record by maximum likelihood: ``ctlabs fit``."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ctlabs.analysis import fitting
from ctlabs.analysis.fitting import Fit
from ctlabs.analysis.fitting import Progress as Progress
from ctlabs.analysis.likelihood import Build
from ctlabs.files import clock
from ctlabs.files.mapping import NO_TIME
from ctlabs.filtering.filter import kalman_filter
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.reporting.plots import records as pictures
from ctlabs.reporting.report import SOLVER, Report
from ctlabs.studies import common, filtering, several
from ctlabs.text import _

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile

#: The second route sums the likelihood of at most so many rows (it is a hundred times slower than the first).
CHECKED = 20_000


def study(
    model: ModelFile,
    record: Record | Sequence[Record],
    free: Sequence[str],
    starts: int = 0,
    progress: Callable[[Progress], object] | None = None,
) -> Report:
    """Estimates of the constants ``free`` from their values in the model file on, and the record filtered with them.

    Of several records the log-likelihoods are added. ``starts`` : from so many other starts too · ``progress`` : is told how far the search
    is; Ctrl-C ends it with the best so far

    Raises
    ------
    ValueError
        A constant that does not exist; a start at which there is no likelihood.
    """
    records = [record] if not isinstance(record, Sequence) else list(record)
    made = compute(model, records, free, starts, progress)
    found, first, names = made.fit, model.experiment.first, list(made.fit.names)
    given = common.settings(
        model, ("free", list(names), "", _("constants that are estimated; above, where the search began"))
    )
    report = common.begin("fit", _("constants fitted to a record"), model, "abcd", given, data=several.sources(records))
    report.section("a", _("Estimates"))
    _estimates(report, model, found)
    report.section("b", _("What the record says of each constant"))
    _profiles(report, model, found)
    report.section("c", _("The likelihood by a second route"))
    _likelihood(report, found, [(build(found.estimates), rows) for build, rows in zip(made.builds, made.data, strict=True)], first)
    report.section("d", _("The record filtered with the estimates"))
    fitted = made.model
    if len(records) == 1:
        filtering.add(report, fitted, records[0])
    else:
        several.add(report, fitted, records)
    report.files["fitted.toml"] = fitted.dumps().encode()
    report.says(_("`fitted.toml` is the model with the estimates, `estimates.csv` the filtered record."))
    return report


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Constants ``fit`` to records: ``model`` with the estimates; of each record its ``data`` and what ``builds`` its model."""

    fit: Fit
    model: ModelFile
    builds: tuple[Build, ...]
    data: tuple[Array, ...]


def compute(
    model: ModelFile,
    records: Sequence[Record],
    free: Sequence[str],
    starts: int = 0,
    progress: Callable[[Progress], object] | None = None,
) -> Fitted:
    """The constants ``free`` that make the records most likely, from their values in the model file on; refusals as of :func:`study`."""
    names = _free(free, model)
    for each in records:
        if each.missing == each.z.size:
            raise ValueError(f"{each.source}: no observations: expected one measurement at least, received none: every element is missing")
        for name in names:
            if name in each.regressors:
                raise ValueError(
                    f"--free {name}: expected a constant, received the record's column {each.mapping.regressors[name]}, which stands in "
                    f"its place; --regressor {name}={NO_TIME} leaves it to the constant"
                )
    first = model.experiment.first
    builds, z = zip(*(clock.building(model, each) for each in records), strict=True)
    start = {name: model.constants[name] for name in names}
    bounds, data = _bounds(model, names, builds[0]), [rows[first:] for rows in z]
    found = fitting.fit(builds, data, start, bounds, first, starts=starts, progress=progress)
    return Fitted(found, model.replace(found.estimates), tuple(builds), tuple(data))


def _free(free: Sequence[str], model: ModelFile) -> list[str]:
    """The names, each a constant of the model."""
    names = list(dict.fromkeys(word.strip() for word in free))
    for name in names:
        if name not in model.constants:
            close = difflib.get_close_matches(name, model.constants, n=1)
            hint = f" (did you mean {close[0]}?)" if close else ""
            known = ", ".join(model.constants) or "none: the model has no constants"
            msg = f"--free {name}: expected one of {known}{hint}, received {'an unknown name' if name else 'no name'}"
            raise ValueError(msg)
    return names


def _bounds(model: ModelFile, names: list[str], build: Build) -> dict[str, tuple[float | None, float | None]]:
    """Where each constant may lie: the file's own limits; above 0 where its opposite makes no model (a variance, a time)."""
    bounds = {}
    for told in model.definitions:
        if told.name in names:
            low = told.min
            if low is None and told.value >= 0 and not _makes_sense(build, told.name, -told.value or -1.0):
                low = 0.0
            bounds[told.name] = (low, told.max)
    return bounds


def _makes_sense(build: Build, name: str, value: float) -> bool:
    """Whether the file is a model with this value."""
    try:
        build({name: value})
    except (ValueError, ArithmeticError):
        return False
    return True


def _estimates(report: Report, model: ModelFile, found: Fit) -> None:
    """Every constant with its standard error and interval."""
    units = {told.name: told.unit or "1" for told in model.definitions}
    rows = []
    for name, value in found.estimates.items():
        error = found.standard_errors[name]
        report.value(name, value, units[name])
        report.value(f"{name}_se", error, units[name], reason=found.reasons.get(name, ""))
        unlimited = (-np.inf, np.inf) if np.isfinite(found.log_likelihood) else (None, None)
        low, high = found.intervals.get(name, unlimited)
        rows.append((name, units[name], found.start[name], value, error, low, high))
    columns = [_("constant"), _("unit"), _("start"), _("estimate"), _("standard error"), _("from"), _("to")]
    caption = _(
        "Estimates; standard errors from the curvature of the log-likelihood, 95 % intervals by the likelihood ratio."
    )
    report.table("estimates", columns, rows, caption)
    more = {
        "log_likelihood": found.log_likelihood,
        **({} if found.log_likelihood_diffuse == found.log_likelihood else {"log_likelihood_diffuse": found.log_likelihood_diffuse}),
        "log_likelihood_start": found.start_log_likelihood,
        "aic": found.aic,
        "converged": found.converged,
        "observations": found.observations,
    }
    for name, number in more.items():
        if name not in report.values:
            report.value(name, number)
    if found.interrupted:
        report.value("interrupted", True)
    if found.remark:
        report.value("remark", found.remark)
        report.says("**{remark}**", remark=found.remark)
    if np.isfinite(found.log_likelihood):
        report.says(
            _("The log-likelihood rises from {start} to {top} ({evaluations} evaluations)."),
            start=found.start_log_likelihood,
            top=found.log_likelihood,
            evaluations=found.evaluations,
        )
    for name, reason in found.reasons.items():
        report.says(_("No standard error of {name}: {reason}."), name=f"`{name}`", reason=reason)
    if not (found.converged or found.interrupted) and np.isfinite(found.log_likelihood):
        report.says(
            _("**The search has not converged**: the likelihood may still rise. Start from other values (`--set`).")
        )


def _profiles(report: Report, model: ModelFile, found: Fit) -> None:
    """The profiles, and how estimates move together."""
    units = {told.name: told.unit for told in model.definitions}
    if found.profiles:
        figure = pictures.likelihood_profiles(
            {name: (profile.values, profile.log_likelihood) for name, profile in found.profiles.items()},
            found.estimates,
            top=found.log_likelihood_diffuse,
            labels={name: common.label(name, units[name]) for name in found.names},
            standard_errors=found.standard_errors,
        )
        report.figure(
            "profiles",
            figure,
            _(
                "Profile log-likelihood: the greatest ℓ for each value of one constant, the others at their best. Values above the dotted line make the 95 % interval."
            ),
        )
    if (correlation := found.correlation) is not None:
        report.table(
            "correlation",
            ["", *found.names],
            ([name, *row] for name, row in zip(found.names, correlation.tolist(), strict=True)),
            _("Correlations of the estimates."),
        )


def _likelihood(report: Report, found: Fit, records: list[tuple[DiscreteModel, Array]], first: int) -> None:
    """The log-likelihood of the estimates from the innovations of another form of the filter."""
    if sum(len(z) for _model, z in records) > CHECKED:
        report.says(_("The record is too long for it."))
        return
    if not np.isfinite(found.log_likelihood):
        report.says(_("The record is impossible with these estimates: there is no density to compare."))
        return
    name, form = common.other_form("auto")
    total, count = 0.0, 0
    for model, z in records:
        run = kalman_filter(model, z, first=first, algorithm=form)
        if not common.delicacy(run.P_minus, run.P_plus, run.S, 1000) < common.SINGULAR:
            report.says(_("The error covariance is nearly singular: forms of the filter differ by their rounding."))
            return
        known = np.isfinite(run.P_minus).all(axis=(1, 2))
        rows = (run.innovation[known], run.S[known], run.used[known])
        for nu, S, used in zip(*rows, strict=True):
            seen = used & ~np.isnan(nu)
            if seen.any():
                e, own = nu[seen], S[np.ix_(seen, seen)]
                count += len(e)
                total -= 0.5 * (e @ np.linalg.solve(own, e) + np.linalg.slogdet(own)[1] + seen.sum() * np.log(2 * np.pi))
    routes = (_("compiled filter"), name)
    report.check(_("log-likelihood of the estimates"), found.log_likelihood, float(total), routes, SOLVER, scale=count + abs(total))
