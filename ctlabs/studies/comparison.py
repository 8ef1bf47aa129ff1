"""The forms of the filter on one record: accuracy against 50 digits, operations, time, and advice: ``ctlabs compare``."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ctlabs import montecarlo
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.comparison import Comparison, reference
from ctlabs.filtering.comparison import compare as side_by_side
from ctlabs.filtering.results import Filtered
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.reporting.params import typed
from ctlabs.reporting.plots import studies as pictures
from ctlabs.reporting.report import Report
from ctlabs.studies import clock, common
from ctlabs.text import _, fill, number

if TYPE_CHECKING:
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.models import DiscreteModel

#: How large the relative error of P and the error of the estimate (in units of its σ) may be.
GRADES = (("exact", 1e-10, 1e-8), ("accurate", 1e-6, 1e-3), ("losing", 1e-2, 0.1))
#: Relative error of P up to which a form survives a sweep.
GOOD = 1e-6
#: Products of numbers with 50 digits that a study may take (some ten seconds); a longer record is cut.
PATIENCE = 4e6
#: Most values of a swept constant.
MANY = 50


class Case(NamedTuple):
    """A model and a record: what every form is given."""

    model: DiscreteModel
    z: Array
    first: int
    cut: bool


class Judged(NamedTuple):
    """A form, and its error of the estimate in units of the estimate's σ."""

    form: Comparison
    error_x: float | None

    @property
    def name(self) -> str:
        """The form's name."""
        return self.form.name

    @property
    def why(self) -> str:
        """Why it refused or gave up, without its name."""
        return self.form.failed.removeprefix(f"form {self.name}: ").rstrip(".")

    @property
    def grade(self) -> str:
        """"exact" to rounding, "accurate", "losing" digits, "wrong", or "failed"."""  # fmt: skip
        P, x = self.form.error_P, self.error_x
        if self.form.failed or P is None or x is None:
            return "failed"
        for name, bound_P, bound_x in GRADES:
            if P <= bound_P and x <= bound_x:
                return name
        return "wrong"


def study(
    model: ModelFile,
    record: Record | None = None,
    *,
    algorithms: str = "all",
    sweep: str | None = None,
    seed: int | None = None,
    steps: int | None = None,
) -> Report:
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
    swept = None if sweep is None else _sweep(sweep, model)
    seed = model.experiment.seed if seed is None else seed
    case = _case(model, record, seed, steps)
    given = common.settings(
        model,
        ("dt", case.model.dt, "s", _("period")),
        ("steps", len(case.z) - 1, "1", _("steps that are compared")),
        ("first", case.first, "1", _("index of the first measurement")),
    )
    title, source = _("the forms of its filter compared"), "" if record is None else record.source
    report = common.begin("compare", title, model, "abc", given, data=source, seed=seed)
    report.section("a", _("Model and record"))
    _told(report, case, record, seed)
    report.section("b", _("The forms side by side"))
    z = case.z[case.first :]
    exact = reference(case.model, z, case.first)
    found = side_by_side(case.model, z, chosen, case.first, exact=exact)
    _condition(report, exact)
    marked = judged(found, exact.P_plus)
    _side_by_side(report, marked)
    sentences = advice(marked)
    for sentence in sentences:
        report.says("{sentence}", sentence=sentence)
    report.value("advice", " ".join(sentences))
    report.more["algorithms"] = [_entry(one) for one in found]
    if swept is not None:
        report.section("c", _("Against a constant of the model"))
        _swept(report, model, record, chosen, swept, seed, steps)
    return report


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
    return [
        Judged(one, None if one.error_x is None else float((one.error_x / np.where(sd > 0, sd, 1.0)).max()))
        for one in found
    ]


def advice(found: Sequence[Judged]) -> list[str]:
    r"""In words: which forms are accurate, which of them is cheapest, which lose digits, which refuse.

    >>> one = Comparison("ud", 10, 1e-15, None, None, 1e-6, "")
    >>> wrong = one._replace(name="joseph", flops=8, error_P=0.6)
    >>> print(*advice([Judged(one, 1e-15), Judged(wrong, 0.8)]), sep="\n")
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
        cheapest = min(sure, key=lambda one: one.form.flops or 0)
        text = _("Take {name}: of the accurate forms it needs the fewest operations, {flops} a step.")
        lines.append(fill(text, name=cheapest.name, flops=cheapest.form.flops))
    elif recursive:
        lines.append(
            _("No form is accurate here: change the units of the states, or question so nearly singular a model.")
        )
    for grade, text in (("losing", _("Losing digits: {names}.")), ("wrong", _("Not to be trusted here: {names}."))):
        listed = [one for one in recursive if one.grade == grade]
        if listed:
            lines.append(fill(text, names=", ".join(map(_with_errors, listed))))
    if any(one.name == "steady" and not one.form.failed for one in found):
        lines.append(
            _("steady has one gain for all steps: its errors are those of the start, before the filter has settled.")
        )
    lines += [
        fill(_("{name} is not possible here: {why}."), name=one.name, why=one.why) for one in found if one.form.failed
    ]
    return lines


def _with_errors(one: Judged) -> str:
    text = _("{name} (errors {P}, {x} σ)")
    return fill(text, name=one.name, P=number(one.form.error_P, 2), x=number(one.error_x, 2))


def _case(model: ModelFile, record: Record | None, seed: int, steps: int | None) -> Case:
    """The record of the data file, or a simulated one, no longer than the patience for 50 digits."""
    first = model.experiment.first
    affordable = steps or max(10, int(PATIENCE / (20 * model.n**3 + 10 * model.m**3)))
    if record is None:
        length = min(steps or model.experiment.steps, affordable)
        discrete = model.discrete(steps=length)
        z = montecarlo.simulate(discrete, length, 1, seed, first).z[:, :, 0]
        return Case(discrete, z, first, steps is None and length < model.experiment.steps)
    discrete, z, _t = clock.timed(model, record)
    length = min(len(z) - 1, affordable)
    return Case(discrete.cut(length), z[: length + 1], first, length < len(z) - 1)


def _told(report: Report, case: Case, record: Record | None, seed: int) -> None:
    """What is compared on."""
    common.show(report, case.model)
    steps = len(case.z) - 1
    if record is None:
        report.says(_("A record of {steps} steps is simulated (seed {seed})."), steps=steps, seed=seed)
    else:
        report.says(_("{source}: {steps} steps."), source=record.source, steps=steps)
    if case.cut:
        report.says(_("The rest is left out, as 50 digits take time (`--steps` takes more)."))


def _condition(report: Report, exact: Filtered) -> None:
    """How nearly singular the covariances are: what decides between the forms."""
    worst = max((common.condition(P) for P in exact.P_plus if np.isfinite(P).all()), default=np.inf)
    report.value("condition_P", worst)
    report.says(
        _(
            "The largest condition number of P⁺, scaled to unit variances, is {condition}. A form that carries P itself has errors of about 1e-16 times that, one that carries a root of it about 1e-16 times its square root."
        ),
        condition=worst if worst < np.inf else _("beyond what doubles hold"),
    )


def _side_by_side(report: Report, found: Sequence[Judged]) -> None:
    """A table and a figure of all forms."""
    report.table(
        "algorithms",
        [_("form"), _("error of P"), _("error of x, σ"), _("operations"), _("µs a step"), _("remark")],
        [
            [
                one.name, _finite(one.form.error_P), _finite(one.error_x), one.form.flops,
                None if one.form.seconds is None else round(1e6 * one.form.seconds, 1), _remark(one),
            ]
            for one in found
        ],
        _("Errors against 50 digits on the same doubles: of P⁺ (Frobenius norm, relative) and of the estimate (in units of its largest σ), the largest over the record; operations of a step of prediction and update; the time in this program, which depends on the machine."),
    )  # fmt: skip
    worked = [one for one in found if not one.form.failed]
    if worked:
        report.figure(
            "algorithms",
            pictures.accuracy(
                [one.name for one in worked],
                [_number(one.form.error_P) for one in worked],
                [_number(one.error_x) for one in worked],
                [one.form.flops or 0 for one in worked],
            ),
            _("Accuracy and cost of the forms; errors to the left of 1e-16 are none."),
        )


def _remark(one: Judged) -> str:
    """A word or two on a form."""
    words = {
        "exact": _("exact to rounding"),
        "accurate": _("accurate"),
        "losing": _("loses digits"),
        "wrong": _("wrong") if one.name != "steady" else _("wrong until settled"),
        "failed": _("not possible"),
    }
    return words[one.grade]


def _number(value: float | None) -> float:
    return math.nan if value is None else value


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


def _swept(
    report: Report,
    model: ModelFile,
    record: Record | None,
    chosen: list[str],
    swept: tuple[str, list[float]],
    seed: int,
    steps: int | None,
) -> None:
    """The relative error of every form against one constant."""
    name, values = swept
    rows: list[list[float | None]] = []
    entries = []
    for value in values:
        case = _case(model.replace({name: value}), record, seed, steps)
        found = side_by_side(case.model, case.z[case.first :], chosen, case.first)
        rows.append([value, *(_finite(one.error_P) for one in found)])
        entries.append({"value": value, "algorithms": [_entry(one) for one in found]})
    report.more["sweep"] = {"name": name, "cases": entries}
    errors = np.array([row[1:] for row in rows], dtype=np.float64)  # None becomes NaN
    curves = dict(zip(chosen, errors.T, strict=True))
    report.table(
        "sweep",
        [_("form"), *(f"{name} = {value:g}" for value in values)],
        ([form, *(_finite(float(error)) for error in curve)] for form, curve in curves.items()),
        _("Largest relative error of P⁺ against 50 digits for values of {name}; — where a form refuses or gives up."),
        name=f"`{name}`",
    )
    report.figure(
        "sweep",
        pictures.against(values, curves, xlabel=common.label(name)),
        _("Largest relative error of P⁺ against {name}. Above the dotted line nothing of P is right."),
        name=name,
    )
    survivors = [form for form, curve in curves.items() if (curve <= GOOD).all()]
    report.says(
        _("Accurate to 1e-6 at all {count} values: {names}."),
        count=len(values),
        names=", ".join(survivors) or _("none"),
    )
