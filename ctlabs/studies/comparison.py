"""The forms of the filter on one record: accuracy against 50 digits, operations, time, and advice: ``ctlabs compare``."""

from __future__ import annotations

import contextlib
import difflib
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ctlabs import montecarlo
from ctlabs.files import clock
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.comparison import Comparison, Judged, compare, flops, reference
from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.problem import by_instant
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting.params import typed
from ctlabs.reporting.plots import studies as pictures
from ctlabs.reporting.report import Report
from ctlabs.studies import common
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.models import DiscreteModel

#: Relative error of P up to which a form survives a sweep.
GOOD = 1e-6
#: Products of numbers with 50 digits that a study may take (some ten seconds); a longer record is cut.
PATIENCE = 4e6
#: Most values of a swept constant.
MANY = 50


class Case(NamedTuple):
    """A model and a record: what every form is given; ``cut``, whether a longer one was shortened, and ``notes``, on how it was read."""

    model: DiscreteModel
    z: Array
    first: int
    cut: bool
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> Array:
        """The record's rows."""
        return self.z[self.first :]


class Attempt(NamedTuple):
    """A record by one form, in so many seconds a step; or why it refused."""

    filtered: Filtered | None
    seconds: float
    failed: str


class Swept(NamedTuple):
    """The forms compared for other values of a constant."""

    name: str
    values: list[float]
    cases: list[tuple[Comparison, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """What a comparison gives.

    ``file``, ``source`` of the record ("" of a simulated one), ``seed`` · ``case`` · ``condition``, the largest condition number of P⁺ ·
    ``found``, the forms as they were measured, and ``judged`` · ``swept``
    """

    file: ModelFile
    source: str
    seed: int
    case: Case
    condition: float
    found: tuple[Comparison, ...]
    judged: list[Judged]
    swept: Swept | None


def study(model: ModelFile, record: Record | None = None, **more: Any) -> Report:
    """:func:`compute` as a report."""
    return report(compute(model, record, **more))


def compute(
    model: ModelFile,
    record: Record | None = None,
    *,
    algorithms: str = "all",
    sweep: str | None = None,
    seed: int | None = None,
    steps: int | None = None,
) -> Compared:
    """Every form on the same record, measured or simulated.

    Parameters
    ----------
    model, record : as read; without a record one is simulated
    algorithms : "all", or names of forms with commas between
    sweep : "NAME=a,b,…": the comparison repeated for other values of one constant
    seed, steps : of the simulated record; ``steps`` also says how much of a long record is used

    Raises
    ------
    ValueError
        An algorithm or a constant that does not exist; values that are no numbers.
    """
    chosen = names(algorithms)
    name, values = ("", []) if sweep is None else _sweep(sweep, model)
    seed = model.experiment.seed if seed is None else seed
    case = _case(model, record, seed, steps)
    exact = reference(case.model, case.rows, case.first)
    found = compare(case.model, case.rows, chosen, case.first, exact=exact)
    others = (_case(model.replace({name: value}), record, seed, steps) for value in values)
    cases = [compare(other.model, other.rows, chosen, other.first) for other in others]
    return Compared(
        model, "" if record is None else record.source, seed, case, max((common.condition(P) for P in exact.P_plus if np.isfinite(P).all()), default=np.inf), found,
        judged(found, exact.P_plus), Swept(name, values, cases) if values else None,
    )  # fmt: skip


def tried(model: DiscreteModel, z: Array, algorithms: Sequence[str], first: int) -> dict[str, Attempt]:
    """A record, or several runs, by each of some forms; what is loaded at the first call is not a form's time."""
    found: dict[str, Attempt] = {}
    for name in algorithms:
        with contextlib.suppress(ValueError, ArithmeticError):
            kalman_filter(model.cut(1), z[: 2 - first], first=first, algorithm=name)
        start = time.perf_counter()
        try:
            filtered = kalman_filter(model, z, first=first, algorithm=name)
        except (ValueError, ArithmeticError) as error:
            found[name] = Attempt(None, 0.0, " ".join(str(error).split()))
        else:
            found[name] = Attempt(filtered, (time.perf_counter() - start) / len(z), "")
    return found


def working(found: dict[str, Attempt]) -> tuple[str, Filtered]:
    """The first form that works, and its result."""
    for name, attempt in found.items():
        if attempt.filtered is not None:
            return name, attempt.filtered
    raise ValueError(next(iter(found.values())).failed)


def judge(model: DiscreteModel, z: Array, found: dict[str, Attempt], first: int, patience: float = PATIENCE) -> list[Judged]:
    """Forms that have been tried on a record (N, m): their costs, and (of several) the accuracy over as many steps as there is patience for."""
    compared: dict[str, Judged] = {}
    if len(found) > 1:
        steps = min(len(z) - 1 + first, max(int(patience / (model.n**3 + model.n**2 * model.m + model.m**3)), 2))
        exact = working(found)[1].P_plus[: steps + 1]
        compared = {one.name: one for one in judged(compare(model.cut(steps), z[: steps + 1 - first], list(found), first), exact)}
    rows = []
    for name, each in found.items():
        if each.failed:
            rows.append(Judged(name, failed=_why(name, each.failed)))
        else:
            rows.append(compared.get(name) or Judged(name, flops(model.cut(1), name), each.seconds))
    return rows


def names(algorithms: str) -> list[str]:
    """The forms that a list of the command line names, each once.

    >>> names("ud, joseph,ud")
    ['ud', 'joseph']
    """
    words = [word.strip() for word in algorithms.split(",")]
    if words == ["all"]:
        return list(FORMS)
    for word in words:
        if word not in FORMS:
            close = difflib.get_close_matches(word, FORMS, n=1)
            hint = f" (did you mean {close[0]}?)" if close else ""
            msg = f"algorithm {word}: expected all or some of {', '.join(FORMS)}{hint}, received an unknown name"
            raise ValueError(msg)
    return list(dict.fromkeys(words))


def judged(found: Sequence[Comparison], P: Array) -> list[Judged]:
    """The forms with their errors of the estimate in units of its σ, by its covariances P (steps+1, n, n)."""
    sd = deviations(P[np.isfinite(P).all(axis=(1, 2))]).max(axis=0, initial=0.0)  # of the rows at which everything is known
    unit = np.where(sd > 0, sd, 1.0)
    return [
        Judged(one.name, one.flops, one.seconds, one.error_P, None if one.error_x is None else float((one.error_x / unit).max()), _why(one.name, one.failed))
        for one in found
    ]


def _why(name: str, failed: str) -> str:
    """Why a form refused or gave up, without its name."""
    return failed.removeprefix(f"form {name}: ").rstrip(".")


def advice(found: Sequence[Judged]) -> list[str]:
    r"""In words: which forms are accurate, which of them is cheapest, which lose digits, which refuse.

    >>> print(*advice([Judged("ud", 10, None, 1e-15, 1e-15), Judged("joseph", 8, None, 0.6, 0.8)]), sep="\n")
    Accurate: ud.
    Take ud: of the accurate forms it needs the fewest operations, 10 a step.
    Not to be trusted here: joseph (errors 0.6, 0.8 σ).
    """
    recursive = [one for one in found if one.name != "steady"]
    sure = [one for one in recursive if one.grade in ("exact", "accurate")]
    lines = []
    if sure and all(one.grade == "exact" for one in recursive):
        lines.append(
            _("All forms agree with the 50 digits to rounding: the model is well conditioned, and any will do.")
        )
    elif sure:
        lines.append(fill(_("Accurate: {names}."), names=", ".join(one.name for one in sure)))
    if sure:
        cheapest = min(sure, key=lambda one: one.flops or 0)
        text = _("Take {name}: of the accurate forms it needs the fewest operations, {flops} a step.")
        lines.append(fill(text, name=cheapest.name, flops=cheapest.flops))
    elif recursive:
        lines.append(
            _("No form is accurate here: change the units of the states, or question so nearly singular a model.")
        )
    for grade, text in (("losing", _("Losing digits: {names}.")), ("wrong", _("Not to be trusted here: {names}."))):
        listed = [one for one in recursive if one.grade == grade]
        if listed:
            lines.append(fill(text, names=", ".join(map(_with_errors, listed))))
    if any(one.name == "steady" and not one.failed for one in found):
        lines.append(
            _("steady has one gain for all steps: its errors are those of the start, before the filter has settled.")
        )
    lines += [
        fill(_("{name} is not possible here: {why}."), name=one.name, why=one.failed) for one in found if one.failed
    ]
    return lines


def _with_errors(one: Judged) -> str:
    text = _("{name} (errors {P}, {x} σ)")
    return fill(text, name=one.name, P=number(one.error_P, 2), x=number(one.error_x, 2))


def _case(model: ModelFile, record: Record | None, seed: int, steps: int | None) -> Case:
    """The record of the data file, or a simulated one, no longer than the patience for 50 digits."""
    first = model.experiment.first
    affordable = steps or max(10, int(PATIENCE / (20 * model.n**3 + 10 * model.m**3)))
    if record is None:
        length = min(steps or model.experiment.steps, affordable)
        discrete = model.discrete(steps=length)
        z = by_instant(montecarlo.simulate(discrete, length, 1, seed, first).z, first)[:, :, 0]
        return Case(discrete, z, first, steps is None and length < model.experiment.steps)
    made = clock.over(model, record)
    length = min(len(made.z) - 1, affordable)
    notes = (*record.notes, *clock.notes(model, record, made))
    return Case(made.model.cut(length), made.z[: length + 1], first, length < len(made.z) - 1, notes)


def _sweep(text: str, model: ModelFile) -> tuple[str, list[float]]:
    """NAME=a,b,… as a constant and its values."""
    name, equals, rest = (part.strip() for part in text.partition("="))
    if not equals or name not in model.constants:
        msg = f"--sweep {text}: expected NAME=a,b,… with NAME one of {', '.join(model.constants) or 'no constants'}, received {name or 'no name'}"
        raise ValueError(msg)
    values = [typed(word.strip()) for word in rest.split(",")]
    for word, value in zip(rest.split(","), values, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            msg = f"--sweep {name}: expected numbers with commas between, received {word.strip() or 'nothing'!r}"
            raise ValueError(msg)
    if len(values) > MANY:
        msg = f"--sweep {name}: expected at most {MANY} values, received {len(values)}"
        raise ValueError(msg)
    return name, [float(value) for value in values]


# The report ----------------------------------------------------------------------------------------------------------


def report(found: Compared) -> Report:
    """The comparison in tables, figures and words."""
    case, steps = found.case, len(found.case.z) - 1
    given = common.settings(
        found.file,
        ("dt", case.model.dt, "s", _("period")),
        ("steps", steps, "1", _("steps that are compared")),
        ("first", case.first, "1", _("index of the first measurement")),
    )
    made = common.begin("compare", _("the forms of its filter compared"), found.file, "abc", given, data=found.source, seed=found.seed)
    made.section("a", _("Model and record"))
    common.show(made, case.model)
    if found.source:
        made.says(_("{source}: {steps} steps."), source=found.source, steps=steps)
        common.notes(made, case.notes)
    else:
        made.says(_("A record of {steps} steps is simulated (seed {seed})."), steps=steps, seed=found.seed)
    if case.cut:
        made.says(_("The rest is left out, as 50 digits take time (`--steps` takes more)."))
    made.section("b", _("The forms side by side"))
    made.value("condition_P", found.condition)
    made.says(
        _(
            "The largest condition number of P⁺, scaled to unit variances, is {condition}. A form that carries P itself has errors of about 1e-16 times that, one that carries a root of it about 1e-16 times its square root."
        ),
        condition=found.condition if found.condition < np.inf else _("beyond what doubles hold"),
    )
    side_by_side(made, found.judged)
    made.value("advice", " ".join(advice(found.judged)))
    made.more["algorithms"] = [_entry(one) for one in found.found]
    if found.swept is not None:
        made.section("c", _("Against a constant of the model"))
        _against(made, [one.name for one in found.judged], found.swept)
    return made


def side_by_side(report: Report, found: Sequence[Judged]) -> None:
    """A table of all forms, and where they were compared a figure and what to make of it."""
    report.table(
        "algorithms",
        [_("form"), _("error of P"), _("error of x, σ"), _("operations"), _("µs a step"), _("remark")],
        [
            [
                one.name, _finite(one.error_P), _finite(one.error_x), one.flops,
                None if one.seconds is None else round(1e6 * one.seconds, 1), _remark(one),
            ]
            for one in found
        ],
        _("Errors against 50 digits on the same doubles: of P⁺ (Frobenius norm, relative) and of the estimate (in units of its largest σ), the largest over the record; operations of a step of prediction and update; the time in this program, which depends on the machine."),
    )  # fmt: skip
    worked = [one for one in found if one.grade not in ("", "failed")]
    if worked:
        report.figure(
            "algorithms", pictures.algorithms(worked), _("Accuracy and cost of the forms; errors below 1e-16 are none.")
        )
    for sentence in advice(found) if any(one.grade for one in found) else ():
        report.says("{sentence}", sentence=sentence)


def _remark(one: Judged) -> str:
    """A word or two on a form."""
    words = {
        "": "",
        "exact": _("exact to rounding"),
        "accurate": _("accurate"),
        "losing": _("loses digits"),
        "wrong": _("wrong") if one.name != "steady" else _("wrong until settled"),
        "failed": _("not possible"),
    }
    return words[one.grade]


def _finite(value: float | None) -> float | None:
    """A number for results.json: None for NaN."""
    return None if value is None or math.isnan(value) else value


def _entry(one: Comparison) -> dict[str, Any]:
    """A form in results.json."""
    error = None if one.error_x is None else _finite(float(np.max(one.error_x)))
    return {
        "name": one.name,
        "max_relative_error_P": _json(_finite(one.error_P)),
        "max_error_x": _json(error),
        "flops": one.flops,
        "seconds_per_step": one.seconds,
        "failed": one.failed or None,
    }


def _json(value: float | None) -> float | str | None:
    return "inf" if value is not None and math.isinf(value) else value


def _against(report: Report, forms: Sequence[str], swept: Swept) -> None:
    """The relative error of every form against one constant."""
    pairs = list(zip(swept.values, swept.cases, strict=True))
    report.more["sweep"] = {
        "name": swept.name,
        "cases": [{"value": value, "algorithms": [_entry(one) for one in found]} for value, found in pairs],
    }
    errors = np.array([[one.error_P for one in found] for found in swept.cases], dtype=np.float64)  # None becomes NaN
    curves = dict(zip(forms, errors.T, strict=True))
    report.table(
        "sweep",
        [_("form"), *(f"{swept.name} = {value:g}" for value in swept.values)],
        ([form, *(_finite(float(error)) for error in curve)] for form, curve in curves.items()),
        _("Largest relative error of P⁺ against 50 digits for values of {name}; — where a form refuses or gives up."),
        name=f"`{swept.name}`",
    )
    report.figure(
        "sweep",
        pictures.against(swept.values, curves, xlabel=common.label(swept.name)),
        _("Largest relative error of P⁺ against {name}. Above the dotted line nothing of P is right."),
        name=swept.name,
    )
    survivors = [form for form, curve in curves.items() if (curve <= GOOD).all()]
    report.says(
        _("Accurate to 1e-6 at all {count} values: {names}."),
        count=len(swept.values),
        names=", ".join(survivors) or _("none"),
    )
