"""Every lab: complete, passing for any seed, with readable figures, and able to notice a wrong filter."""

import ast
import importlib
import importlib.util
import re
import sys
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from ctlabs.filtering import settling
from ctlabs.filtering.engines import adapter, compiled
from ctlabs.filtering.problem import FilterProblem
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import Experiment
from ctlabs.reporting import plots
from ctlabs.reporting.render import drawn
from ctlabs.reporting.report import Heading, Picture, Report

LABS = labs.catalogue()
#: Axis labels without a unit: pure numbers by their words.
DIMENSIONLESS = re.compile(
    r"number|gain|ratio|/R|NEES|NIS|average|relative|factor|information|λ|\$K|probability|rank|magnitude", re.IGNORECASE
)


def run(lab, seed=1, runs=60, **settings):
    values = labs.parameters([lab], settings)[lab.name]
    return labs.run(lab, values, Experiment(runs, seed))


def numbers(lab, **how):
    """The report of a run with blank figures: the default run's are looked at, of the others the numbers are."""
    with pytest.MonkeyPatch.context() as patch:
        for name in plots.__all__:
            if hasattr(getattr(plots, name), "__wrapped__"):  # it draws with the project's style
                patch.setattr(plots, name, lambda *args, **named: Figure())
        return run(lab, **how)


class FailedError(Exception):
    """A check of a report failed."""


def _or_else(verb):
    def judged(self, *args, **named):
        verb(self, *args, **named)
        if not self.checks[-1].passed:
            raise FailedError

    return judged


def until_a_check_fails(lab):
    """The report of a run, which ends with :class:`FailedError` at the first check that fails."""
    with pytest.MonkeyPatch.context() as patch:
        for verb in ("check", "holds", "chance", "order"):
            patch.setattr(Report, verb, _or_else(getattr(Report, verb)))
        return numbers(lab)


@cache
def default(name):
    return run(LABS[name])


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in LABS])
class TestLab:
    def test_every_part_has_a_section_a_value_or_figure_and_a_check(self, name):
        """Each lettered item of the sheet is answered and checked."""
        report = default(name)
        sections = {block.part for block in report.blocks if isinstance(block, Heading) and block.part}
        assert sections == set(LABS[name].parts)
        assert {check.part for check in report.checks} == set(LABS[name].parts)

    @pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))])
    def test_all_checks_pass_for_any_seed(self, name, seed):
        """Theory and ensemble agree, whatever the random numbers."""
        report = default(name) if seed == 1 else numbers(LABS[name], seed=seed, runs=25)
        assert [check for check in report.checks if not check.passed] == []

    def test_figures_have_labelled_axes_with_units(self, name):
        """Every axis says what it shows and in which unit; shared axes need one label."""
        for block in default(name).blocks:
            if isinstance(block, Picture):
                grid = [axes for axes in drawn(block.figure).axes if axes.get_visible() and axes.axison]
                labels = [axes.get_xlabel() for axes in grid] + [axes.get_ylabel() for axes in grid]
                named = [label for label in labels if label]
                assert any(axes.get_xlabel() for axes in grid) or not grid, block.name
                assert any(axes.get_ylabel() for axes in grid) or not grid, block.name
                for label in named:
                    assert re.search(r", \S+|\(.+\)", label) or DIMENSIONLESS.search(label), f"{block.name}: {label}"

    @pytest.mark.slow
    def test_results_do_not_depend_on_anything_but_parameters_and_seed(self, name):
        """Two runs give the same results, drawn or not."""
        assert numbers(LABS[name]).results() == default(name).results()

    @pytest.mark.parametrize("wrong", ["K", "Qd", "R"])
    def test_a_filter_wrong_by_five_percent_is_noticed(self, name, wrong, monkeypatch):
        """At least one check fails when K, Qd or R of the discrete filter is multiplied by 1.05."""
        touched = []

        def larger(model):
            matrix = getattr(model, wrong)
            finite = matrix[np.isfinite(matrix)]
            touched.append(bool(finite.any()))
            return replace(model, **{wrong: np.where(np.isfinite(matrix), 1.05 * matrix, matrix)})

        def mutated(right, given, *rest):
            if wrong == "K":
                found = right(given, *rest)
                touched.append(bool(found.K.any()))
                return replace(found, K=1.05 * found.K)
            changed = replace(given, model=larger(given.model)) if isinstance(given, FilterProblem) else larger(given)
            return right(changed, *rest)

        for engine, verb in ((adapter, "covariances"), (compiled, "record")):
            monkeypatch.setattr(engine, verb, partial(mutated, getattr(engine, verb)))
        # A wrong filter never comes near the right limit: the search for its settling need not go to the end.
        monkeypatch.setattr(settling, "__defaults__", (0.01, None, 500))
        try:
            until_a_check_fails(LABS[name])
        except (FailedError, ValueError, FloatingPointError):
            return  # refused: noticed all the more
        if not any(touched):
            pytest.skip(f"{wrong} is zero or absent in this lab")
        pytest.fail("no check noticed it")


ANSWERS = Path(importlib.util.find_spec("ctlabs.tasks.answers").origin).parent


def test_every_lab_has_answers_by_hand():
    """A module of the lab's name with `analytic`."""
    assert {path.stem for path in ANSWERS.glob("[a-z]*.py")} - {"kinematics"} == set(LABS)
    for name in LABS:
        assert callable(importlib.import_module(f"ctlabs.tasks.answers.{name}").analytic)


@pytest.mark.parametrize("path", sorted(ANSWERS.glob("*.py")), ids=lambda path: path.stem)
def test_the_answers_owe_nothing_to_the_library(path):
    """Mathematics and numbers by other packages; of ctlabs nothing but another lab's answers."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    found += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    ours = {module for module in found if module.split(".")[0] == "ctlabs"} - {"ctlabs.tasks.answers"}
    assert ours == set()
    outside = {module.split(".")[0] for module in found} - {"ctlabs"} - set(sys.stdlib_module_names)
    assert outside <= {"numpy", "scipy", "sympy", "mpmath"}
