"""The frame of a lab's report: nothing is missing that a reader, a student who defends it, or a teacher looks for."""

import ast
import re
import runpy

import numpy as np
import pytest

from ctlabs.labs import catalogue as labs
from ctlabs.labs.sheets import bibliography, listing, sheet
from ctlabs.reporting.crossrefs import Places, called, complaints, without_places
from ctlabs.reporting.markdown import markdown
from ctlabs.reporting.report import Heading, Picture, Text
from tests.labs.test_tasks import default

LABS = labs.catalogue()
FRAMED = [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in LABS]
SECTIONS = ["statement", "aim", "result", "theory", "plan", "experiment", "discussion", "answers", "conclusions", "questions"]


def sections(report):
    """The text of each division of a report, by its name."""
    found, name = {}, ""
    for block in report.blocks:
        if isinstance(block, Heading) and block.level == 2:
            name = block.name
            found[name] = []
        elif isinstance(block, Text):
            found[name].append(block.text)
    return found


@pytest.mark.parametrize("name", FRAMED)
class TestFramed:
    def test_its_divisions_stand_in_order(self, name):
        """Statement, aim, result, theory, plan, experiment, discussion, answers, conclusions, control questions."""
        found = sections(default(name))
        assert list(found) == SECTIONS
        assert all(any(text.strip() for text in found[each]) or each in {"theory", "experiment"} for each in SECTIONS)

    def test_the_result_has_three_sentences_and_a_key_figure(self, name):
        """Three sentences, the first of which stands in the index; the figure is one of the report."""
        report = default(name)
        (result,) = sections(report)["result"]
        assert without_places(result).startswith(report.more["result"])
        assert "{" not in re.sub(r"\$[^$]*\$", "", report.more["result"])
        assert report.more["result"].endswith(".")
        parts = labs.load(LABS[name]).PARTS
        assert parts.key in {block.name for block in report.blocks if isinstance(block, Picture)}

    def test_every_figure_is_read_and_every_reference_leads_somewhere(self, name):
        """No figure without a sentence that refers to it, no reference to what is not there."""
        assert complaints(default(name)) == []

    def test_a_placeholder_has_a_place(self, name):
        """Nothing in curly brackets is left in a page that was read to its end."""
        text = re.sub(r"```.*?```", "", markdown(default(name)), flags=re.DOTALL)
        assert re.findall(r"\{(?:fig|tab|eq|part|sec|app|ref):[^}]*\}", text) == []

    def test_every_place_is_one(self, name):
        """No link has two ends."""
        places = re.findall(r'<a id="([^"]*)"', markdown(default(name)))
        assert sorted(set(places)) == sorted(places)

    def test_it_has_four_to_seven_figures(self, name):
        """All of them needed."""
        assert 3 <= sum(isinstance(block, Picture) for block in default(name).blocks) <= 8

    def test_every_item_is_answered(self, name):
        """With the place of the answer."""
        answers = "\n".join(sections(default(name))["answers"])
        assert re.findall(r"^- \*\*\((\w+)\)\*\* \S+.*\{part:\1\}\*$", answers, re.MULTILINE) == list(LABS[name].parts)

    def test_control_questions_have_their_places(self, name):
        """Five to eight, each with the place of its answer."""
        questions = sheet(name).questions
        assert 5 <= len(questions) <= 8
        assert all(re.search(r"\{(fig|tab|eq|part|sec):", place) for _question, place in questions)

    def test_it_cites_a_book(self, name):
        """At least one, and only what the bibliography has."""
        cited = {each.removeprefix("ref:") for each in called(default(name)) if each.startswith("ref:")}
        assert cited
        assert cited <= set(bibliography())

    def test_the_listing_gives_the_main_numbers(self, name):
        """The script runs, asks nothing but public verbs, and its names have the values of results.json."""
        tree, wanted = ast.parse(listing(name)), default(name).values
        modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert {"ctlabs"} <= {module for module in modules if module.startswith("ctlabs")} <= {"ctlabs", "ctlabs.regulation"}
        found = runpy.run_path(str(labs.folder() / "listings" / f"{name}.py"))
        common = [each for each in wanted if each in found]
        assert len(common) >= 3
        for each in common:
            own, ours = (np.array(x, dtype=float) for x in (found[each], wanted[each].value))
            assert np.allclose(own, ours, rtol=1e-8, atol=1e-12), each
        assert len(listing(name).splitlines()) <= 60

    def test_the_text_holds_no_names_of_the_program(self, name):
        """Nor a number in the form of a computer, nor a sentence that ends in a colon before nothing; these stand in the appendix."""
        body = markdown(default(name)).split("## Appendix")[0]
        words = re.sub(r"\]\([^)]*\)|\\\[.*?\\\]|<a [^>]*>|\$\$.*?\$\$|\$[^$]*\$", "", body, flags=re.DOTALL)
        names = {*default(name).values, *default(name).parameters.plain()}
        machine = {each for each in names if "_" in each}
        assert [each for each in machine if re.search(rf"\b{each}\b", words)] == []
        assert "`" not in words
        assert re.findall(r".*\d[eE][+-]?\d+.*", words) == []
        assert re.findall(r".*\[[-−\d.]+, [-−\d., \[\]]+\].*", words) == []
        blocks = default(name).blocks
        pairs = zip(blocks, [*blocks[1:], None], strict=True)
        ends = [a.text for a, b in pairs if isinstance(a, Text) and a.text.endswith(":") and (b is None or isinstance(b, Heading))]
        assert ends == []


def test_a_question_names_the_places_that_the_report_has():
    """Some may be missing at the corners of the parameters; where all are, the complaint about them stands."""
    places = Places(default("task07"))
    assert places.there("{part:b}, {fig:nowhere}, {eq:gain}, {eq:update}") == "{part:b}, {eq:update}"
    assert places.there("{fig:nowhere}") == "{fig:nowhere}"
    assert places.there("{sec:discussion}") == "{sec:discussion}"
