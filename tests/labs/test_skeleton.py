"""The frame of a report: parts in order, each given what it names."""

from dataclasses import replace

import pytest

from ctlabs.labs.experiment import Experiment
from ctlabs.labs.skeleton import Skeleton
from ctlabs.reporting.params import LabParameters, Variance, given
from ctlabs.reporting.plots import lines
from ctlabs.reporting.report import Copy, Heading, Text

META = {"name": "task99", "title": "A test", "source": "A book, task 99", "parts": ["a"]}


class Parameters(LabParameters):
    """Of a lab that does not exist."""

    Q: Variance = given(0.5, unit="m²", meaning="variance of the process noise")


def analysis(r, p, system):
    """Part (a)."""
    r.says("{system} with Q = {Q}", system=system, Q=p.Q)


def plan(r, experiment):
    """How many steps."""
    r.says("{runs} runs", runs=experiment.runs)
    return {"steps": 40}


def measured(r, steps):
    """Part (b)."""
    r.says("{steps} steps", steps=steps)
    return {"worst": 2.5}


def discussion(r, worst):
    """What one sees."""
    r.says("{worst} is seen", worst=worst)


def answers(steps):
    """Each item."""
    return {"a": f"It takes {steps}."}


def result(worst):
    """Read first, said last."""
    return [f"It is {worst}.", "So.", "No more."]


def conclusions(r, worst, steps):
    """What it comes to."""
    r.says("{worst} after {steps}", worst=worst, steps=steps)


PARTS = Skeleton(
    result=result, key="curve", analysis=(analysis,), plan=plan, experiment=(measured,), discussion=discussion, answers=answers,
    conclusions=conclusions,
)  # fmt: skip


def test_the_key_figure_stands_beside_the_result_where_it_is_drawn():
    """Parameters may leave nothing to draw."""

    def drawn(r, steps):
        r.figure("curve", lines([0.0, 1.0], {"x": [0.0, steps]}, xlabel="t, s", ylabel="x, m"), "x.")
        return {"worst": 2.5}

    report = replace(PARTS, experiment=(drawn,)).report(META, Parameters(), Experiment(runs=7, seed=3), system="a tank")
    assert [type(block) for block in report.blocks[:3]] == [Heading, Text, Copy]
    assert report.blocks[2] == Copy("curve")


def test_parts_are_run_in_the_order_of_the_report():
    """Each below its heading, with what was given, and with what the parts before it have returned."""
    report = PARTS.report(META, Parameters(), Experiment(runs=7, seed=3), system="a tank")
    copies = [block for block in report.blocks if isinstance(block, Copy)]
    blocks = [block for block in report.blocks if not isinstance(block, Copy)]
    assert [block.text for block in blocks] == [
        "Result", "It is 2.5. So. No more.",
        "Part I. Theory", "a tank with Q = 0.5",
        "Plan of the experiment", "7 runs",
        "Part II. Experiment", "40 steps",
        "Discussion", "2.5 is seen",
        "Answers, item by item", "- **(a)** It takes 40. *→ {part:a}*",
        "Conclusions", "2.5 after 40",
    ]  # fmt: skip
    assert [type(block) for block in blocks] == [Heading, Text] * 7
    assert copies == []
    assert report.more["result"] == "It is 2.5."
    assert (report.meta, report.runs, report.seed) == (META, 7, 3)


def test_a_part_that_asks_for_what_is_not_there_is_refused():
    """The message names the part, what it asks for, and what there is."""
    with pytest.raises(TypeError, match=r"^analysis: expected arguments among \['experiment', 'p', 'r'\], received \['system'\]$"):
        PARTS.report(META, Parameters(), Experiment())
