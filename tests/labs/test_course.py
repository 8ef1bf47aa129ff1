"""The index of a folder of reports: a course with topics, prerequisites, variants, results, pass and fail; and lab 0."""

import json
import re
from pathlib import Path

import pytest

from ctlabs.labs import catalogue as labs
from ctlabs.labs import method
from ctlabs.labs.course import course, rows, write_index
from ctlabs.labs.sheets import bibliography
from ctlabs.reporting import render
from ctlabs.reporting.crossrefs import complaints
from ctlabs.reporting.report import Report
from tests.reference import PNG
from tests.reporting.test_render import META, ROUTES, Page, Parameters, files


@pytest.fixture(autouse=True)
def quickly(monkeypatch):
    """Pictures are not looked at here."""
    monkeypatch.setattr(render, "png", lambda figure: PNG)


@pytest.fixture
def out(tmp_path) -> Path:
    """Three labs: one that passed, one that failed, one without checks."""
    for name, values in (("task02", [1.0]), ("field", [1.0, 1.05]), ("task10", [])):
        report = Report({**META, "name": name}, Parameters(), 10, 1, more={"result": f"What {name} found, $K < 1$."})
        for i, value in enumerate(values):
            report.check(f"check {i}", value, 1.0, ROUTES)
        render.write(report, tmp_path / name)
    return tmp_path


class TestCourse:
    def test_every_lab_stands_in_one_topic(self):
        """None is lost and none is told twice."""
        names = [name for topic in course().topics for name in topic.labs]
        assert sorted(names) == sorted(labs.catalogue())

    def test_what_a_lab_needs_comes_from_labs_and_leads_back_to_a_beginning(self):
        """No circle, and no name that is no lab."""
        needs = course().needs
        assert {*needs, *(name for each in needs.values() for name in each)} <= set(labs.catalogue())

        def depth(name, seen=()):
            assert name not in seen
            return 1 + max((depth(each, (*seen, name)) for each in needs.get(name, ())), default=0)

        assert max(map(depth, labs.catalogue())) < 10

    def test_the_books_are_in_the_bibliography(self):
        """Those that the practicum recommends, and two more."""
        assert set(course().books) <= set(bibliography())
        assert len(course().books) >= 6
        assert all(entry.endswith(".") for entry in bibliography().values())


class TestIndex:
    def test_the_index_shows_pass_and_fail_at_a_glance(self, out):
        """Every lab with its verdict, and a link where there is a report."""
        write_index(out)
        text, page = ((out / name).read_text(encoding="utf-8") for name in ("README.md", "index.html"))
        shown = [line for line in text.splitlines() if line.startswith("| [")]
        title = {name: lab.title for name, lab in labs.catalogue().items()}
        assert shown == [
            f"| [2](task02/report.md) | {title['task02']} | What task02 found, $K < 1$. | 1 | A* | 1 passed |",
            f"| [10](task10/report.md) | {title['task10']} | What task10 found, $K < 1$. | 6 | A, B, C | **no checks** |",
            f"| [field](field/report.md) | {title['field']} | What field found, $K < 1$. | 12 |  | **1 of 2 failed**: check 1 |",
        ]
        assert text.count("not run yet: ctlabs run ") == len(labs.catalogue()) - 3
        assert re.findall(r'<span class="(\w+)">', page) == ["good", "bad", "bad"]
        assert "1 of 2 failed: check 1" in page
        outside = [reference for reference in Page(page).references if not reference.startswith("#")]
        assert {"task02/report.html", "task10/report.html", "field/report.html", "lab0.html"} == set(outside)
        assert all((out / reference).is_file() for reference in outside)
        inside = [reference[1:] for reference in Page(page).references if reference.startswith("#")]
        assert set(inside) <= set(re.findall(r'id="([^"]+)"', page))
        assert "<math" in page
        assert not Page(page).tags & {"script", "link"}

    def test_variants_are_those_of_the_practicum(self, out):
        """A star marks a lab of the control session."""
        assert rows(out)["task07"].variants == "A*"
        assert rows(out)["task05"].variants == "A, B, C"
        write_index(out)
        assert r"| A | 1 2\* 5 7\* 9\* 10 | 11\* 15\* 18 19 20\* 23 |" in (out / "README.md").read_text(encoding="utf-8")

    def test_extensions_are_marked(self, out):
        """In place of variants, of which they have none."""
        report = Report({**META, "name": "task24"}, Parameters(), 10, 1, more={"result": "What it found."})
        report.check("check", 1.0, 1.0, ROUTES)
        render.write(report, out / "task24")
        write_index(out)
        text, page = ((out / name).read_text(encoding="utf-8") for name in ("README.md", "index.html"))
        assert "| What it found. | 7 | extension | 1 passed |" in text
        assert len(re.findall(r"^\| .* \| extension \| ", text, re.MULTILINE)) == page.count("· extension") == 3

    def test_the_index_is_written_anew(self, out):
        """A lab that was corrected is shown as such; nothing temporary remains."""
        write_index(out)
        before = files(out)
        write_index(out)
        assert files(out) == before
        report = Report({**META, "name": "field"}, Parameters(), 10, 1)
        report.check("check 1", 1.0, 1.0, ROUTES)
        render.write(report, out / "field")
        write_index(out)
        assert "failed" not in (out / "README.md").read_text(encoding="utf-8")
        left = {path.name for path in out.iterdir()}
        assert left == {"README.md", "index.html", "lab0.md", "lab0.html", "lab0-variances.png", "task02", "task10", "field"}

    @pytest.mark.parametrize("text", ["", "[]", "{}", '{"lab": "x", "checks": 1}', "\xff"])
    def test_folders_that_are_no_reports_are_left_out(self, out, text):
        """A report that is being written, and somebody else's results.json."""
        for name in (".task05-x1y2", "task05", "other"):
            (out / name).mkdir()
        (out / ".task05-x1y2/results.json").write_bytes((out / "task02/results.json").read_bytes())
        for name in ("other", "task05"):
            (out / name / "results.json").write_bytes(text.encode("latin-1"))
        write_index(out)
        assert (out / "README.md").read_text(encoding="utf-8").count("| [") == 3

    def test_somebody_elses_readme_is_not_overwritten(self, out):
        """Reports may be written into a folder that has a README.md and an index.html of its own."""
        names = ("README.md", "index.html", "lab0.md")
        for name in names:
            (out / name).write_text("# My project\n", encoding="utf-8")
        write_index(out)
        for name in names:
            assert (out / name).read_text(encoding="utf-8") == "# My project\n"


class TestAround:
    def test_neighbours_are_those_of_the_catalogue(self):
        """A lab that has no report has its place in the index."""
        found = labs.around(labs.catalogue()["task07"], {"task06"})
        assert found == {
            "previous": ("../task06/report.html", "Lab 6"),
            "index": ("../index.html", "All labs"),
            "next": ("../index.html#task08", "Lab 8"),
        }

    def test_the_first_and_the_last_have_one_neighbour(self):
        """And the papers have their titles."""
        first, *_rest, last = labs.catalogue().values()
        assert set(labs.around(first, ())) == {"index", "next"}
        assert set(labs.around(last, ())) == {"index", "previous"}
        assert labs.around(labs.catalogue()["task23"], ())["next"][1] == "The Kalman–Bucy observer with coloured plant noise"

    def test_a_page_and_its_markdown_lead_to_them(self, tmp_path):
        """With links that work in their own folder."""
        ways = labs.around(labs.catalogue()["task07"], {"task06", "task08"})
        report = Report({**META, "name": "task07"}, Parameters(), 10, 1, around=ways)
        page = render.html(report, {})
        assert {"../task06/report.html", "../index.html", "../task08/report.html"} <= set(Page(page).references)
        line = "[← Lab 6](../task06/report.md) · [All labs](../README.md) · [Lab 8 →](../task08/report.md)"
        assert line in render.markdown(report).splitlines()


class TestMethod:
    def test_lab_0_goes_the_whole_way_and_passes(self):
        """Model, discretisation, filter, plan; in symbols and in numbers, by two routes."""
        report = method.report()
        assert report.passed
        assert {check.part for check in report.checks} == {"b", "c", "d"}
        assert complaints(report) == []

    @pytest.mark.parametrize("settings", [{"tau": 0.01}, {"sigma_w2": 1e-6, "R": 1e4}, {"P11": 0.0, "P22": 0.0}])
    def test_lab_0_holds_for_other_numbers(self, settings):
        """Its checks are of the method, not of one choice."""
        assert method.report(method.MethodParameters(**settings)).passed

    def test_its_page_is_whole(self, out):
        """It needs nothing from outside but the index."""
        write_index(out)
        page = (out / "lab0.html").read_text(encoding="utf-8")
        assert {each for each in Page(page).references if not each.startswith(("#", "data:"))} == {"index.html"}
        assert "(lab0-variances.png)" in (out / "lab0.md").read_text(encoding="utf-8")


def test_the_first_sentence_of_a_result_goes_to_the_index(out):
    """By way of results.json."""
    assert json.loads((out / "task02/results.json").read_text(encoding="utf-8"))["result"] == "What task02 found, $K < 1$."
