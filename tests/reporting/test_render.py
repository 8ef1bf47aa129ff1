"""Reports become files: whole or not at all, the same bytes for the same numbers, pages that need no server."""

import base64
import csv
import io
import json
import re
import struct
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from fontTools.ttLib import TTFont
from PIL import Image

from ctlabs.labs import catalogue as labs
from ctlabs.models import ContinuousModel
from ctlabs.reporting import mathfont, plots, render
from ctlabs.reporting.mathfont import font
from ctlabs.reporting.mathml import lines
from ctlabs.reporting.params import LabParameters, Variance, VariancesOrInf, given
from ctlabs.reporting.report import Report
from tests.labs.test_tasks import default
from tests.reference import PNG

META = {"name": "task99", "title": "Gains < 1 & variances", "source": "A book, task 99", "parts": ["a", "b"]}
ROUTES = ("recursion", "closed form")
MODEL = ContinuousModel(F=[[0, 1], [0, -2]], G=[[0], [1]], Q=[[4]], H=[[1, 0]], Rc=[[16]], P0=np.eye(2))


class Parameters(LabParameters):
    """Of a lab that does not exist."""

    Q: Variance = given(0.39, unit="m²", meaning="variance of the process noise w")
    R: VariancesOrInf = given([1.0, "inf"], unit="m²", meaning="variances of the measurements")


def sample(seed: int = 1, figures: tuple[str, ...] = ("curve",)) -> Report:
    """A report with everything that a report can hold."""
    r = Report(META, Parameters(), runs=10, seed=seed)
    r.heading("Part I. Analysis")
    r.section("a", "Equations of the filter, $|\\Phi| < 1$")
    r.says(
        "Where $|(1-K_*)\\Phi| < 1$ & $\\bar{P} \\ge 0$, **the error** tends to {limit} m². <b>5 < 6</b>", limit=1 / 3
    )
    r.model(MODEL)
    r.math(
        r"P = {P}, \qquad \frac{a}{b} = \sqrt{c^2 + d_i}, \qquad \hat x(t_{i+1}^-) = \sum_{j=0}^{i-1}\Phi^{-2j}",
        P=MODEL.P0,
    )
    r.items(["$K \\to 0$: no measurement is used", "the gain is {K}"], K=0.25)
    r.value("gain", np.linspace(0.1, 1.0, 20), at=np.arange(20), agrees={"gain": np.linspace(0.1, 1.0, 20)})
    r.value("settling_step", None, reason="it does not settle")
    x = np.linspace(0.0, 1.0, 50)
    for name in figures:
        figure = plots.lines(x, {f"λ = {seed}": seed * x**2}, xlabel="gain $K_*$", ylabel="variance, m²")
        r.figure(name, figure, 'Variance against [the gain] $K_*$, "as it is" & more.')
    r.section("b", "Numbers")
    rows = [(1 / 3, np.float64(2 / 3), "inf"), (1e-17, None, [1, np.inf]), (7, True, np.array([0.1, 1 / 3]))]
    r.table("numbers", ["$\\bar{P}$, m²", "K*", "|Φ|"], rows, "Numbers of $|\\Phi|$.")
    r.check("P⁺ where |Φ| = 1", 2.0, 2.0, ROUTES)
    return r


def files(folder: Path) -> dict[str, bytes]:
    """Every file below a folder and its bytes."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class Page(HTMLParser):
    """What a page refers to, its text outside equations, and its tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: set[str] = set()
        self.words: list[str] = []
        self._math = 0
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self._math += tag in {"math", "pre"}  # a listing is no text
        self.references += [
            value for name, value in attrs if name in {"src", "href", "srcset", "action", "data", "poster"}
        ]

    def handle_endtag(self, tag):
        self._math -= tag in {"math", "pre"}

    def handle_data(self, data):
        if not self._math:
            self.words.append(data)


#: Elements of MathML that need a fixed number of children.
CHILDREN = {"mfrac": 2, "msub": 2, "msup": 2, "munder": 2, "mover": 2, "mroot": 2, "msubsup": 3, "munderover": 3}


def complaints(text: str) -> list[str]:
    """What is wrong with the equations of a page: LaTeX that was not understood, or left in the text."""
    found = []
    for equation in re.findall(r"<math.*?</math>", text, re.DOTALL):
        try:
            tree = ET.fromstring(equation)
        except ET.ParseError as error:
            found.append(f"{error}: {equation}")
            continue
        for element in tree.iter():
            tag = element.tag.rpartition("}")[2]
            if (
                tag == "merror"
                or len(element) != CHILDREN.get(tag, len(element))
                or re.search(r"[\\&$]", element.text or "")
            ):
                found.append(ET.tostring(element, encoding="unicode"))
    words = "".join(Page(text).words)
    return found + [line for line in words.split("\n") if re.search(r"\$|\\[a-zA-Z]", line)]


def self_contained(text: str) -> bool:
    """Whether a page asks for nothing outside itself."""
    page = Page(text)
    inside = all(reference.startswith(("data:image/webp;base64,", "#")) for reference in page.references)
    return inside and not page.tags & {"script", "link", "iframe", "object"} and not re.search(r"@import|url\((?!data:)", text)


class TestFolder:
    def test_a_report_has_these_files_and_no_other(self, tmp_path):
        """Text, page, results, figures and tables; no temporary folder beside them."""
        render.write(sample(figures=("curve", "family")), tmp_path / "out" / "task99")
        assert set(files(tmp_path)) == {
            f"out/task99/{name}"
            for name in ("report.md", "report.html", "results.json", "figures/curve.png", "figures/family.png", "tables/numbers.csv")
        }  # fmt: skip
        assert [path.name for path in (tmp_path / "out").iterdir()] == ["task99"]

    def test_the_folder_can_be_read_by_others(self, tmp_path):
        """A report is no secret, although it was made in a temporary folder."""
        render.write(sample(), tmp_path / "task99")
        assert (tmp_path / "task99").stat().st_mode & 0o777 == 0o755

    def test_the_same_report_gives_the_same_bytes(self, tmp_path):
        """No date, no random order, no memory address in any file."""
        for name in ("first", "second"):
            render.write(sample(), tmp_path / name)
        assert files(tmp_path / "first") == files(tmp_path / "second")

    def test_another_report_gives_other_bytes(self, tmp_path):
        """A changed curve changes the figure, the page and the results."""
        for seed in (1, 2):
            render.write(sample(seed), tmp_path / str(seed))
        first, second = files(tmp_path / "1"), files(tmp_path / "2")
        assert {name for name in first if first[name] != second[name]} == set(first) - {"tables/numbers.csv"}

    def test_a_second_report_replaces_the_first_as_a_whole(self, tmp_path):
        """A figure that the new report does not have is gone."""
        render.write(sample(1), tmp_path / "task99")
        render.write(sample(2, figures=("other",)), tmp_path / "task99")
        render.write(sample(2, figures=("other",)), tmp_path / "fresh")
        assert files(tmp_path / "task99") == files(tmp_path / "fresh")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["fresh", "task99"]

    @pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, OSError])
    @pytest.mark.parametrize("stage", ["png", "markdown", "html", "_json", "swap"])
    @pytest.mark.parametrize("before", [True, False], ids=["over a report", "the first report"])
    def test_an_interrupted_write_leaves_what_was_there(self, tmp_path, monkeypatch, error, stage, before):
        """Whatever fails while files are made, the previous report is whole and nothing else remains."""
        monkeypatch.setattr(render, "png", lambda figure: PNG)
        if before:
            render.write(sample(1), tmp_path / "task99")
        previous = files(tmp_path)

        def fails(*_arguments):
            raise error

        monkeypatch.setattr(render, stage, fails)
        with pytest.raises(error):
            render.write(sample(2), tmp_path / "task99")
        assert files(tmp_path) == previous
        assert [path.name for path in tmp_path.iterdir()] == ["task99"] * before

    @pytest.mark.parametrize("interrupted", [1, 2])
    def test_an_interrupt_between_the_renames_puts_the_previous_report_back(self, tmp_path, monkeypatch, interrupted):
        """Ctrl-C right after the old folder was moved away, or while the new one takes its place."""
        monkeypatch.setattr(render, "png", lambda figure: PNG)
        render.write(sample(1), tmp_path / "task99")
        previous, rename, calls = files(tmp_path), Path.rename, []

        def interrupt(path, target):
            calls.append(path)
            if len(calls) == 2 == interrupted:
                raise KeyboardInterrupt
            rename(path, target)
            if len(calls) == 1 == interrupted:
                raise KeyboardInterrupt

        monkeypatch.setattr(Path, "rename", interrupt)
        with pytest.raises(KeyboardInterrupt):
            render.write(sample(2), tmp_path / "task99")
        assert files(tmp_path) == previous
        assert [path.name for path in tmp_path.iterdir()] == ["task99"]


class TestFigures:
    def test_a_figure_is_a_palette_image_without_metadata(self):
        """Small files, and no date, software or other text in them."""
        data = render.png(plots.lines([0, 1], {"x": [0, 1]}, xlabel="time, s", ylabel="x, m"))
        chunks, at = [], 8
        while at < len(data):
            length, kind = struct.unpack(">I4s", data[at : at + 8])
            chunks.append(kind.decode())
            at += 12 + length
        assert set(chunks) == {"IHDR", "PLTE", "IDAT", "IEND"}
        with Image.open(io.BytesIO(data)) as image:
            assert image.mode == "P"
            assert image.width > 700

    def test_the_palette_keeps_the_colours_of_the_curves(self):
        """Blue and orange lines stay blue and orange on white."""
        x = np.linspace(0, 1, 30)
        data = render.png(plots.lines(x, {"a": x, "b": 1 - x}, xlabel="time, s", ylabel="x, m"))
        with Image.open(io.BytesIO(data)) as image:
            pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
        for colour in (plots.base.BLUE, plots.base.ORANGE, "#FFFFFF"):
            wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
            assert np.abs(pixels - wanted).max(axis=1).min() <= 8


class TestPage:
    def test_a_picture_inside_a_page_is_the_picture(self):
        """To the last dot; the small copy has half its width."""
        picture = render.png(next(block.figure for block in sample().blocks if hasattr(block, "figure")))
        inside = [base64.b64decode(render.embedded(picture, share).split(",")[1]) for share in (1.0, 0.5)]
        whole, small = (Image.open(io.BytesIO(data)) for data in inside)
        assert np.array_equal(np.asarray(whole), np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")))
        assert small.width == whole.width // 2

    def test_a_page_has_the_signs_of_its_equations(self):
        """The font inside a page has them, in italics too, the same bytes for the same signs, and no others."""
        pages = ["<math><mi>x</mi><mo>+</mo><mi>&#x003A6;</mi><mo>∫</mo></math> y", "<math><mi>y</mi><mo>∫</mo></math>"]
        first, second = (TTFont(io.BytesIO(base64.b64decode(re.search("base64,([^)]*)", font(page))[1]))).getBestCmap() for page in pages)
        assert {ord("x"), ord("+"), 0x3A6, 0x1D465, 0x1D6F7, ord("√")} <= set(first)
        assert not {ord("y"), 0x1D466} & set(first)
        assert {ord("y"), 0x1D466} <= set(second)
        assert font(pages[0]) == font(pages[0] + "z")

    def test_the_page_needs_nothing_from_outside(self):
        """No script, no style sheet, no picture and no link that asks a server."""
        text = render.html(sample(figures=("curve", "family")), {"curve": PNG, "family": PNG})
        assert self_contained(text)
        assert Page(text).references.count(render.embedded(PNG)) == 2

    @pytest.mark.parametrize(
        "addition",
        [
            '<img src="figures/curve.png">',
            '<a href="https://example.org">x</a>',
            "<script>1</script>",
            '<link rel="stylesheet">',
            '<style>@import "x.css"</style>',
            "<p style='background: url(x.png)'>",
        ],
    )
    def test_a_reference_to_the_outside_is_noticed(self, addition):
        """The test of self-containment fails when it should."""
        assert self_contained("<p>x</p>")
        assert not self_contained("<p>x</p>" + addition)

    def test_equations_become_mathml(self):
        """Inline and displayed equations, in text, captions and table heads; none left as LaTeX."""
        text = render.html(sample(), {})
        displayed = re.findall(r"\$\$(.*?)\$\$", render.markdown(sample()), re.DOTALL)
        assert len(displayed) == 2
        alone = sum(len(lines(each)) for each in displayed)
        assert alone > len(displayed)  # the model's matrices, side by side or below each other as the page is wide
        assert text.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">') == alone
        assert text.count('display="inline"') >= 6
        assert complaints(text) == []

    @pytest.mark.parametrize(
        "latex",
        [r"\begin{aligned} a &= b \\ c &= d \end{aligned}", r"\foo{a}", r"\frac{a}", r"\bogus + 1"],
    )
    def test_latex_that_was_not_understood_is_noticed(self, latex):
        """The renderer passes on what it does not know, so a lab must not use it."""
        report = sample()
        report.blocks = []
        report.math("a + b")
        assert complaints(render.html(report, {})) == []
        report.math(latex)
        assert complaints(render.html(report, {})) != []

    def test_a_dollar_left_in_the_text_is_noticed(self):
        """An equation that was opened and not closed."""
        report = sample()
        report.says("The gain $K tends to 0.")
        assert complaints(render.html(report, {})) != []

    def test_text_is_escaped(self):
        """What a reader wrote is shown, not executed."""
        text = render.html(sample(), {})
        assert "<b>5" not in text
        assert "&lt;b&gt;5 &lt; 6&lt;/b&gt;" in text
        assert "<title>Gains &lt; 1 &amp; variances</title>" in text

    def test_every_table_is_a_table(self):
        """Bars inside cells do not break rows: parameters, numbers of a section, the table, checks."""
        body = render.html(sample(), {})
        tables = re.findall(r"<table>.*?</table>", body, re.DOTALL)
        assert len(tables) == 4
        for table in tables:
            cells = {row.count("<td") + row.count("<th") for row in re.findall(r"<tr>.*?</tr>", table, re.DOTALL)}
            assert len(cells) == 1

    @pytest.mark.parametrize(  # in the process that runs the lab's own tests: it has the report
        "name", [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in labs.catalogue()]
    )
    def test_the_page_of_every_lab_is_whole(self, name):
        """Each lab's page needs no server and shows every equation."""
        report = default(name)
        pictures = {block.name: PNG for block in report.blocks if hasattr(block, "figure")}
        text = render.html(report, pictures)
        assert complaints(text) == []
        assert self_contained(text)


class TestText:
    def test_markdown_shows_everything_in_order(self):
        """Title, verdict, parameters, sections with their letters, captions, numbers; the checks in the appendix."""
        text = render.markdown(sample(figures=("curve", "family")))
        marks = [
            "# Gains < 1 & variances",
            "Experiment: 10 runs, seed 1. Checks: all 2 passed.",
            "| `Q` | 0.39 | m² | variance of the process noise w |",
            "| `R` | 1, ∞ |",
            "## Part I. Analysis",
            "### (a) Equations of the filter",
            "tends to 0.33333 m²",
            "- the gain is 0.25",
            "](figures/curve.png)",
            "**Figure 1.** Variance against",
            "**Figure 2.** Variance against",
            "| `gain` | 0.1, 0.14737, 0.19474, 0.24211, …, 1 | 1 |",
            "| `settling_step` | — (it does not settle) | 1 |",
            "*Confirmed by two independent routes, [Table A1](#app-checks).*",
            "### (b) Numbers",
            "**Table 1.** Numbers of",
            "## Appendix",
            "| a | gain | recursion – closed form |",
            "| b | P⁺ where \\|Φ\\| = 1 | recursion – closed form | 2 | 2 | < 10⁻¹² | solution | ✓ |",
        ]
        places = [text.index(mark) for mark in marks]
        assert places == sorted(places)

    def test_a_failed_check_is_named_at_the_top(self):
        """A reader sees at once that something is wrong, and what."""
        report = sample()
        report.check("the limit", 1.0, 1.05, ROUTES)
        text = render.markdown(report)
        assert "Checks: **1 of 3 failed**: the limit." in text
        assert "**1 of 2 checks of this section failed**: the limit." in text
        assert re.search(r"the limit \| recursion – closed form \| 1 \| 1.05 \| 0.05 .*\*\*failed\*\*", text)

    def test_a_report_without_checks_says_so(self):
        """Nothing checked is not "all passed"."""
        assert "Checks: **no checks**." in render.markdown(Report(META, Parameters(), 10, 1))


class TestData:
    def test_tables_are_csv_in_the_digits_that_are_known(self, tmp_path):
        """Every number of a table has ten digits, as results.json."""
        render.write(sample(), tmp_path / "task99")
        with (tmp_path / "task99/tables/numbers.csv").open(newline="", encoding="utf-8") as file:
            head, first, second, third = csv.reader(file)
        assert head == ["P, m²", "K*", "|Φ|"]
        assert [float(cell) for cell in first] == [0.3333333333, 0.6666666667, np.inf]
        assert (float(second[0]), second[1], json.loads(second[2])) == (1e-17, "", [1, "inf"])
        assert (third[0], third[1], json.loads(third[2])) == ("7", "True", [0.1, 0.3333333333])

    def test_results_json_is_what_the_report_says(self, tmp_path):
        """The file parses, strictly, to the results; a line for every value and check."""
        report = sample()
        render.write(report, tmp_path / "task99")
        text = (tmp_path / "task99/results.json").read_text(encoding="utf-8")

        def refuse(name):
            raise AssertionError(name)

        assert json.loads(text, parse_constant=refuse) == report.results()
        assert sum('"part": ' in line for line in text.splitlines()) == len(report.values) + len(report.checks)

    def test_an_empty_report_is_json_too(self, tmp_path):
        """No values and no checks are an empty object and an empty list."""
        report = Report(META, Parameters(), 10, 1)
        render.write(report, tmp_path / "task99")
        assert json.loads((tmp_path / "task99/results.json").read_text(encoding="utf-8")) == report.results()


def test_the_ready_font_is_the_one_that_would_be_cut_out():
    """What the pages of models are set in, and no page with another sign."""
    assert mathfont.READY.read_bytes() == mathfont.subset(mathfont.MODELS)
    ready = mathfont.font("<math><mi>&#x3A6;</mi><mo>=</mo><mn>1</mn></math>")
    assert ready == mathfont.font("<math><mi>Q</mi></math>") != mathfont.font("<math><mo>∫</mo></math>")
