"""Reports on paper: a title page, PDF, LaTeX and Word from a report's Markdown; all labs as a book."""

import importlib.util
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from ctlabs.cli import cli
from ctlabs.labs import book, printing
from ctlabs.labs import catalogue as labs
from ctlabs.labs.course import course
from ctlabs.labs.sheets import bibliography
from ctlabs.labs.terms import index, marked, terms
from ctlabs.reporting import render
from ctlabs.reporting.report import Copy, Report
from tests.reporting.test_render import META, ROUTES, Parameters, sample

REPORTS = Path(__file__).parents[2] / "reports"
THERE = all(importlib.util.find_spec(name) for name in ("pypandoc", "typst"))
needs_programs = pytest.mark.skipif(not THERE, reason="no pandoc and typst here: pip install 'ctlabs[print]'")
TITLE = {"university": "University & Co.", "course": "Filtering", "student": 'A. "B" C', "group": "7_1", "teacher": "D\\E", "date": "2026"}


def full() -> Report:
    """A report with all that paper has to show."""
    r = sample()
    r.framed, r.bibliography, r.listing = True, {"book": "A. Uthor. *A book*. 1960."}, "from ctlabs import steady_state\nprint('λ̄ ✓')"
    r.around = {"index": ("../index.html", "All labs")}
    r.math(r"K = \frac{P}{P + R}", "gain")
    r.says("By {eq:gain} and {ref:book, p. 7}, see {fig:curve}, {tab:numbers} and {part:a}: P̄ ≥ 0 and x̂ → x, λ = 1.5×10⁻⁷. ∎")
    r.blocks.insert(1, Copy("curve"))
    return r


@pytest.fixture
def folder(tmp_path) -> Path:
    """The folder of such a report."""
    render.write(full(), tmp_path / "task99")
    return tmp_path / "task99"


class TestTitlePage:
    def test_its_keys_are_known(self, tmp_path):
        """In their order; numbers and dates are words."""
        path = tmp_path / "me.toml"
        path.write_text('date = 2026-05-07\nstudent = "I"\ngroup = 41\n', encoding="utf-8")
        assert printing.title_page(path) == {"student": "I", "group": "41", "date": "2026-05-07"}
        assert list(printing.title_page(path)) == ["student", "group", "date"]

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ('students = "I"', "expected keys among university, faculty, department, course, student, .*, received students$"),
            ("student = ", "expected a TOML file, received Invalid value"),
        ],
    )
    def test_others_are_refused(self, tmp_path, text, words):
        """In one line, with those that are known."""
        path = tmp_path / "me.toml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=words):
            printing.title_page(path)

    def test_a_file_that_is_not_there_is_refused(self, tmp_path):
        """By name."""
        with pytest.raises(ValueError, match=r"--title-page .*nowhere\.toml: expected a TOML file, received .*No such file"):
            printing.title_page(tmp_path / "nowhere.toml")


class TestCommand:
    @pytest.mark.parametrize("command", [["run", "7"], ["book"]])
    def test_an_unknown_format_is_refused(self, command):
        """With those that are known."""
        done = CliRunner().invoke(cli, [*command, "--format", "pdf,ps"])
        assert done.exit_code
        assert "--format: expected some of pdf, docx, tex, html, md, received ps" in done.output

    def test_a_missing_program_is_one_line_with_the_command(self, monkeypatch):
        """Before anything is computed."""
        monkeypatch.setitem(__import__("sys").modules, "pypandoc", None)
        done = CliRunner().invoke(cli, ["run", "7", "--format", "pdf"])
        assert done.exit_code
        assert "pip install 'ctlabs[print]'" in done.output
        assert len(done.output.strip().splitlines()) == 1

    def test_a_book_needs_all_reports(self, tmp_path):
        """Those that are missing are named."""
        done = CliRunner().invoke(cli, ["book", "--out", str(tmp_path), "--format", "md"])
        assert done.exit_code
        assert "expected the reports of all labs (ctlabs run all" in done.output
        assert "task07" in done.output


@needs_programs
class TestPaper:
    def test_pdf_holds_all_pages(self, folder):
        """With and without a title page; nothing remains beside it."""
        for title in (TITLE, {}):
            (path,) = printing.make(folder, ("pdf",), title)
            assert path.read_bytes().startswith(b"%PDF")
            left = {each.name for each in folder.iterdir()}
            assert left == {"figures", "tables", "report.md", "report.html", "report.pdf", "results.json"}

    def test_latex_has_the_equations_and_the_places(self, folder):
        """Numbers of equations, labels that links lead to, Greek letters and signs as equations; braces in balance."""
        (path,) = printing.make(folder, ("tex",), TITLE)
        text = path.read_text(encoding="utf-8")
        assert r"\begin{titlepage}" in text
        assert r"University \& Co." in text
        assert r"K = \frac{P}{P + R} \tag{1}" in text
        targets = set(re.findall(r"\\hyperlink\{([^}]+)\}|\\hyperref\[([^\]]+)\]", text))
        for name in {a or b for a, b in targets}:
            assert rf"\label{{{name}}}" in text or rf"\hypertarget{{{name}}}" in text or rf"\phantomsection\label{{{name}}}" in text
        words = re.sub(r"\\begin\{(Highlighting|verbatim)\}.*?\\end\{\1\}", "", text.split(r"\begin{document}")[1], flags=re.DOTALL)
        assert not re.search("[Α-ωḀ-ỿ✓∎≥→\u0300-\u036f⁻]", words)
        assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")

    @pytest.mark.skipif(not shutil.which("lualatex"), reason="no TeX here")
    def test_latex_compiles(self, folder):
        """Where TeX is installed."""
        printing.make(folder, ("tex",), TITLE)
        done = subprocess.run(["lualatex", "-interaction=nonstopmode", "report.tex"], cwd=folder, capture_output=True, check=False)
        assert done.returncode == 0, done.stdout[-2000:]

    def test_word_has_equations_and_pictures(self, folder):
        """As Word's own equations, and the pictures inside."""
        (path,) = printing.make(folder, ("docx",), TITLE)
        with zipfile.ZipFile(path) as archive:
            document = archive.read("word/document.xml").decode()
            assert any(name.startswith("word/media/") for name in archive.namelist())
        assert "<m:oMath" in document
        words = re.sub(r"<[^>]+>", "", re.sub(r"</w:p>", "\n", document))
        assert "University &amp; Co." in words
        assert "Student: A. &quot;B&quot; C" in words.replace('"', "&quot;")
        assert "Teacher: D\\E" in words

    def test_what_is_on_screen_only_is_left_out(self, folder):
        """The ways to other reports, the small copy, and the marks of folded parts."""
        (path,) = printing.make(folder, ("tex",), {})
        text = path.read_text(encoding="utf-8")
        assert "All labs" not in text
        assert "details" not in text
        assert text.count("includegraphics") - text.count("\\pandocbounded{\\includegraphics#") >= 1
        assert len(re.findall(r"figures/curve\.png", text)) == 1


@pytest.fixture
def shelf(tmp_path) -> Path:
    """A report of every lab."""
    for name in labs.catalogue():
        r = Report({**META, "name": name}, Parameters(), 10, 1, framed=True, bibliography=bibliography(), listing="print(1)")
        r.around = labs.around(labs.catalogue()[name], set(labs.catalogue()))
        r.heading("Theory", "theory")
        r.section("a", f"What {name} asks")
        r.math("x = 1", "one")
        r.says("A stable $stable$ pole.")
        r.says("By {eq:one}, {part:a}, {ref:maybeck, p. 3} and {ref:" + ("kalman" if name == "field" else "semushin") + "}; {app:checks}.")
        r.check("one", 1.0, 1.0, ROUTES)
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.md").write_text(render.markdown(r), encoding="utf-8")
    return tmp_path


class TestBook:
    def test_it_has_a_chapter_for_each_topic_and_one_bibliography(self, shelf):
        """Every place has its own name, every link leads somewhere, and references have the numbers of the book."""
        text = book.text(shelf)
        assert re.findall(r"^# (.+)$", text, re.MULTILINE) == [*(topic.name for topic in course().topics), "Bibliography", "Index"]
        assert len(re.findall(r"^## ", text, re.MULTILINE)) == len(labs.catalogue())
        places = re.findall(r'<a id="([^"]+)"></a>', text)
        assert len(places) == len(set(places))
        assert set(re.findall(r"\]\(#([^)]+)\)", text)) <= set(places)
        assert text.count("[\\[1, p. 3\\]](#ref-maybeck)") == len(labs.catalogue())
        assert text.count("(#ref-kalman)") == 1
        assert f'1. <a id="ref-maybeck"></a>{bibliography()["maybeck"]}' in text.splitlines()
        assert "All labs" not in text
        assert "Table A1 " not in text.replace("Table A1.", "")
        assert text.count("```python") == len(labs.catalogue())

    def test_its_index_leads_to_the_first_words_of_each_lab(self, shelf):
        """Prose alone is read; a term that no lab speaks of is left out."""
        lines = book.text(shelf).split("# Index")[1].split("\n\n")[2:]
        assert [line.split(":")[0] for line in lines] == ["pole", "stability"]
        assert lines[0].count("](#index-") == len(labs.catalogue())
        assert book.text(shelf).count('A <a id="index-') == len(labs.catalogue())

    def test_every_term_of_the_index_is_in_the_reports(self):
        """In few enough labs to be of use."""
        reports = {name: (REPORTS / name / "report.md").read_text(encoding="utf-8") for name in labs.catalogue()}
        bodies = {name: marked(name, text) for name, text in reports.items()}
        found = dict(line.split(": ", 1) for line in index(bodies).split("\n\n"))
        assert list(found) == list(terms())
        assert max(line.count("](") for line in found.values()) <= 20

    @needs_programs
    def test_it_becomes_one_document(self, shelf):
        """With contents."""
        done = CliRunner().invoke(cli, ["book", "--out", str(shelf), "--format", "pdf,tex,md"], catch_exceptions=False)
        assert done.exit_code in (0, None), done.output
        assert (shelf / "book.pdf").read_bytes().startswith(b"%PDF")
        source = (shelf / "book.tex").read_text(encoding="utf-8")
        assert r"\tableofcontents" in source
        assert set(re.findall(r"\\pageref\{(.*?)\}", source)) == set(re.findall(r"\\label\{(index-.*?)\}", source))
        assert (shelf / "book.md").read_text(encoding="utf-8").startswith("# Optimal filtering")
