"""The appendix of a report: how it was checked, its results by the names that programs use, and the script that gives them.

A section says in one sentence how it was confirmed; the tables of checks stand here, each kind of check explained once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ctlabs.montecarlo import chance
from ctlabs.reporting.cells import cell, grid, reasons
from ctlabs.reporting.crossrefs import APPENDIX, END, FOLD, TITLE, anchor
from ctlabs.reporting.report import Check, Report
from ctlabs.text import _, fill, number, printed, raised, translated

TWO_ROUTES = (
    "**Two routes.** A number is computed in two ways that share no formula, and both must agree. *Algebra* is the same number by two "
    "formulas: they may differ by rounding only, one part in 10¹² of what the number is measured by. *Solution* compares an iteration, a solver of an "
    "equation or an integration with a closed form: they may differ by one part in 10⁸. A covariance is measured in its own standard "
    "deviations, so that the smallest variance is judged like the largest. Of a list the element of largest size is shown; the difference is the "
    "largest of all. *Order* compares the rate at which an error shrinks when a step is halved with the rate of theory."
)
CHANCE = (
    "**Chance.** An ensemble of random runs cannot agree exactly. Each test knows the exact distribution of what it looks at if theory is "
    "right, and writes the worst deviation over all instants and states in standard errors (as a quantile of the normal distribution). "
    "The p-value is the probability that a right filter deviates as much somewhere in this test: values near 1 are nothing unusual, one test in "
    "twenty has a value below 0.05, and a test fails only below 10⁻⁸, so that a right report of a hundred tests fails once in a million."
)
KINDS = {"EXACT": "algebra", "SOLVER": "solution", "ORDER": "order"}


def sentence(checks: Sequence[Check]) -> Iterable[str]:
    """How a section was confirmed, in one sentence."""
    failed = [check.name for check in checks if not check.passed]
    routes, tests = _parted(checks)
    if failed:
        yield (
            fill(
                _("**{count} of {checks} checks of this section failed**: {names}."),
                count=len(failed),
                checks=len(checks),
                names="; ".join(failed),
            )
            + " ([A](#sec-appendix))"
        )
    elif routes and tests:
        said = (
            _(
                "*Confirmed by two independent routes ({n} comparisons, {table}) and by {tests} tests of an ensemble (p = {p}, {other}).*"
            )
            if len(routes) > 1
            else _(
                "*Confirmed by two independent routes ({table}) and by {tests} tests of an ensemble (p = {p}, {other}).*"
            )
        )
        yield fill(
            said, n=len(routes), table=_table("checks"), tests=len(tests), p=together(tests), other=_table("chance")
        )
    elif routes:
        said = (
            _("*Confirmed by two independent routes: {n} comparisons, {table}.*")
            if len(routes) > 1
            else _("*Confirmed by two independent routes, {table}.*")
        )
        yield fill(said, n=len(routes), table=_table("checks"))
    elif tests:
        yield fill(
            _("*Confirmed by {tests} tests of an ensemble: p = {p}, {table}.*"),
            tests=len(tests),
            p=together(tests),
            table=_table("chance"),
        )


def _parted(checks: Sequence[Check]) -> tuple[list[Check], list[Check]]:
    """Comparisons of two routes, and tests of ensembles."""
    return [check for check in checks if check.kind != "CHANCE"], [check for check in checks if check.kind == "CHANCE"]


def _table(name: str) -> str:
    return f"{{app:{name}}}"


def _caption(name: str, words: str) -> str:
    """The head of a table of the appendix, which texts lead to by its name."""
    return f"{anchor(f'app-{name}')}**{fill(_('Table {n}.'), n=APPENDIX[name])}** {translated(words)}"


def together(tests: Sequence[Check]) -> str:
    """The probability that a right filter deviates as much in one of the tests, at most."""
    return p_value(min(1.0, len(tests) * min(chance.adjusted(check.value or 0.0, check.tolerance) for check in tests)))


def p_value(p: float) -> str:
    """A probability in two digits.

    >>> p_value(0.2345), p_value(3.21e-7), p_value(1.0)
    ('0.23', '3.2×10⁻⁷', '1')
    """
    return printed(number(p, 2))


def written(report: Report) -> list[str]:
    """The appendix, its parts folded; nothing where there is nothing to show."""
    parts = [*_checks(report), *(_results(report) if report.framed else []), *_listing(report)]
    return [f"## {_('Appendix')}{anchor('sec-appendix')}", *parts] if parts else []


def _folded(title: str, lines: Iterable[str]) -> list[str]:
    return [f"{FOLD}{title}{TITLE}", *lines, END]


def _checks(report: Report) -> list[str]:
    routes, tests = _parted(report.checks)
    lines = []
    if routes:
        head = [
            _("part"),
            _("what is compared"),
            _("by two routes"),
            _("value"),
            _("expected"),
            _("difference"),
            _("kind"),
            "",
        ]
        lines += [
            translated(TWO_ROUTES),
            _caption("checks", "Comparisons of two routes."),
            grid(head, map(_route, routes)),
        ]
    if tests:
        head = [_("part"), _("test"), _("deviation, σ"), _("allowed, σ"), _("p-value"), ""]
        lines += [
            translated(CHANCE),
            _caption("chance", "Tests of ensembles against theory."),
            grid(head, map(_test, tests)),
        ]
    return _folded(_("A. How this was checked"), lines) if lines else []


def _route(check: Check) -> list[str]:
    return [
        check.part, check.name, f"{check.route[0]} – {check.route[1]}", cell(check.value), cell(check.expected), difference(check),
        translated(KINDS[check.kind]), _mark(check),
    ]  # fmt: skip


def _test(check: Check) -> list[str]:
    p = chance.adjusted(check.value or 0.0, check.tolerance)
    return [
        check.part,
        check.name,
        printed(number(check.value, 3)),
        printed(number(check.tolerance, 3)),
        p_value(p),
        _mark(check),
    ]


def _mark(check: Check) -> str:
    return "✓" if check.passed else _("**failed**")


def difference(check: Check) -> str:
    """How far two routes are apart, as a part of their size: below a power of ten, for the digits of rounding are no result."""
    if check.value is None or check.expected is None:
        return "—"
    if check.kind == "ORDER" or not check.passed:
        return printed(number(abs(check.value - check.expected), 2))
    power = 12
    while power > 0 and check.share > 1.0001 * 10.0**-power:
        power -= 1
    return f"< 10{raised(-power)}" if check.share <= 1 else "—"


def _results(report: Report) -> list[str]:
    values, own = list(report.values.values()), report.parameters.plain()
    described = [
        [f"`{name}`", cell(own[name]), translated(unit), translated(meaning)]
        for name, unit, meaning in report.parameters.described()
    ]
    rows = (
        [
            v.part,
            f"`{v.name}`",
            f"${v.symbol}$" if v.symbol else "",
            cell(v.value) + (f" ({why})" if why else ""),
            "" if v.unit == "1" else v.unit,
        ]
        for v, why in zip(values, reasons(values), strict=True)
    )
    lines = [
        _(
            "The names by which `ctlabs run … --set NAME=VALUE` and `results.json` know the parameters and the results; `results.json` holds all digits that are known."
        ),
        _caption("parameters", "Parameters."),
        grid([_("name"), _("value"), _("unit"), _("meaning")], described),
    ]
    if values:
        lines += [
            _caption("results", "Results."),
            grid([_("part"), _("name"), _("symbol"), _("value"), _("unit")], rows),
        ]
    return _folded(_("B. Parameters and results by name"), lines)


def _listing(report: Report) -> list[str]:
    if not report.listing:
        return []
    said = _(
        "This script has the numbers of the sheet. With those of the statement it gives the main results above; its names are those of the results."
    )
    return _folded(_("C. Listing"), [said, f"```python\n{report.listing.strip()}\n```"])
