"""What a regulator's loop does, in its report: σ over time and in the limit, responses, the controller step by step."""

from __future__ import annotations

import numpy as np

from ctlabs import montecarlo
from ctlabs.linalg.checks import Array
from ctlabs.reporting.report import EXACT, SOLVER, Report
from ctlabs.studies import common, loops, second
from ctlabs.studies.regulating import Regulated, replayed
from ctlabs.text import _

#: Instants at which the machine is replayed.
REPLAYED = 50


def write(report: Report, found: Regulated) -> None:
    """σ over time and in the limit; responses to steps, the start and kicks."""
    if found.regulator.steps is not None:
        report.says(_("Over a finite horizon there is no stability to speak of."))
    elif found.stable:
        report.says(_("The loop is stable: its slowest mode decays by a factor {slow} per step."), slow=_slowest(found))
    else:
        report.says(_("**The loop is not stable**: {reason}."), reason=found.growing)
    if found.regulator.steps is None:
        report.value("stable", found.stable)
    if found.over:
        _sizes(report, found)
        some = min(found.truth.n, loops.SHOWN)
        caption = _("Standard deviations of states and inputs from the start on. Dashed: their limits.")
        report.figure("deviations", loops.deviations(found, range(some), range(min(found.truth.r, 2))), caption)
    else:
        report.says("{reason}.", reason=found.over.reason)
    _replay(report, found)
    for i, response in enumerate(found.set_points.found or () if found.stable else ()):
        final = float(response.z[-1, found.truth.measurements.index(response.name)])
        settled = response.settled(response.z[:, found.truth.measurements.index(response.name)], 1.0)
        report.figure(f"step_{i + 1}", loops.step(found, response), _("{cause}: no noise, from rest."), cause=_capital(response.cause))
        report.value(f"step_end_{i + 1}", final)
        report.value(f"step_settled_{i + 1}", settled, "s", reason=_("it does not stay within 2 % of the step within the steps that are followed"))
    if found.initial:
        response = found.initial.value
        report.figure("start", loops.motion(found, response), _("The mean motion after {cause}."), cause=response.cause)
    if found.kicks.found and found.stable:
        shown = range(min(found.truth.n, 3))
        caption = _("One kick of each noise at t = 0, as large as one σ of it in a period, and what becomes of it.")
        report.figure("kicks", loops.kicked(found, shown), caption)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _slowest(found: Regulated) -> float:
    """The modulus of the slowest mode, loads aside."""
    return float(np.sort(np.abs(found.loop.poles))[len(found.loop.poles) - len(found.regulator.loads) - 1])


def _sizes(report: Report, found: Regulated) -> None:
    """A table of σ at the end and in the limit, with what the design believes where it is wrong."""
    over, limit = found.over.value, found.limit
    n, r = found.truth.n, found.truth.r
    names, units = (*found.truth.states, *found.inputs), (*found.truth.units, *[""] * r)
    columns: dict[str, Array] = {_("mean at the end"): np.concatenate([over.x.mean[-1], over.u.mean[-1]]), _("σ at the end"): np.concatenate([over.x.sd[-1], over.u.sd[-1]])}
    if limit.found is not None:
        columns[_("σ in the limit")] = np.concatenate([limit.found.x.sd, limit.found.u.sd])
        _limits(report, found)
    if found.other is not None and found.best.regulator.steps is None and not found.best.regulator.loads:
        right = found.best.regulator.closed.steady()
        if len(right.x.sd) == n:
            columns[_("σ of the right design")] = np.concatenate([right.x.sd, right.u.sd])
    rows = [[name, unit, *(float(column[i]) for column in columns.values())] for i, (name, unit) in enumerate(zip(names, units, strict=True))]
    report.table("sizes", [_("signal"), _("unit"), *columns], rows, _("States and inputs of the loop."))
    report.value("sd_x_end", over.x.sd[-1], common.units(found.truth))
    report.value("sd_u_end", over.u.sd[-1])


def _limits(report: Report, found: Regulated) -> None:
    """The limits, and a second route to them."""
    limit, model = found.limit.value, found.loop.model
    report.value("sd_x", limit.x.sd, common.units(found.truth))
    report.value("sd_u", limit.u.sd)
    P = second.stationary(model.Phi, model.Qd)
    n = found.truth.n
    sd = np.where(limit.x.sd > 0, limit.x.sd, 1.0)
    routes = (_("Lyapunov solver"), _("sum of all that is left of the noises, 50 digits"))
    report.check(_("covariance of the loop"), limit.x.P, P[:n, :n], routes, SOLVER, scale=np.outer(sd, sd))


def _replay(report: Report, found: Regulated) -> None:
    """The controller as it is exported, fed the measurements of one run of the loop, gives that run's inputs."""
    if not found.over:
        return
    steps = min(found.steps, REPLAYED)
    signals = montecarlo.simulate(found.loop.model, steps, 1, found.seed, 0).z[:, :, 0]
    m, count = found.truth.m, steps if found.regulator.steps is not None else steps + 1
    z, u = signals[:count, :m], signals[:count, m:]
    again = replayed(found, z)
    size = np.abs(u).max(axis=0, initial=0.0)
    report.check(
        _("the controller, step by step"), again, u, (_("controller fed one run's measurements"), _("the loop as one model")),
        EXACT, scale=np.broadcast_to(np.where(size > 0, size, 1.0), u.shape),
    )  # fmt: skip
