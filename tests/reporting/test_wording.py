"""The reader's language: what a lab says in plain words is translated where it enters the report, every word of it."""

import ast
import pickle
import re
from functools import cache
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import ctlabs.text
from ctlabs.files import modelfile, reading
from ctlabs.labs import catalogue as labs
from ctlabs.labs import sheet
from ctlabs.labs.experiment import Experiment
from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel
from ctlabs.reporting.report import Check, Heading, Picture, Report, Table, Text, Value
from ctlabs.reporting.wording import in_words_of_the_reader
from ctlabs.text import fill, text, translated

ROOT = Path(__file__).parents[2]
LABS = labs.catalogue()
QUICK = {"task07", "task14", "task16", "task23"}
#: What a sentence has that a symbol, a unit or the name of a parameter has not: two words in a row.
WORDS = re.compile(r"[a-z]{3,} [a-z]{3,}")


@cache
def sources() -> frozenset[str]:
    """Every literal text of the labs and of the library, and those of the sheets: what a translator is given."""
    files = [path for folder in ("ctlabs", "tasks") for path in (ROOT / folder).rglob("*.py")]
    nodes = (node for path in files for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    found = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    for asked in map(sheet, LABS):
        found |= {asked.statement, asked.aim, *asked.items.values(), *(question for question, _place in asked.questions)}
    return frozenset(found - {""})


@pytest.fixture
def marked(monkeypatch):
    """A language in which every literal text of the sources stands in quotation marks, and nothing else does."""
    known = sources()
    monkeypatch.setattr(ctlabs.text, "_", lambda words: f"«{words}»" if words in known else words)


@pytest.fixture
def foreign(monkeypatch):
    """A language of five words."""
    words = {"gain": "усиление", "t, s": "t, с", "limit": "предел", "The gain is {K}.": "Усиление: {K}.", "great": "велико"}
    monkeypatch.setattr(ctlabs.text, "_", lambda word: words.get(word, word or "head of the catalogue"))


def test_a_text_is_translated_before_it_is_filled(foreign):
    """Sentence by sentence, with the words among its values; numbers, names and the empty text are no words."""
    assert text("The gain is {K}.", K="great") == "Усиление: велико."
    assert text("The gain is {K}.", "", " Why?", K=0.123456789) == "Усиление: 0.12346. Why?"
    assert translated("") == ""


def test_a_users_words_are_not_translated(foreign):
    """A state or a column called gain, and a file, wherever they are put in; a lab's own gain is a word."""
    told = modelfile.ready("local_level").edit(("model", "states", 0), "gain").edit(("model", "measurements", 0), "limit").discrete()
    assert [text("The gain is {K}.", K=name) for name in (*told.states, *told.measurements)] == ["Усиление: gain.", "Усиление: limit."]
    assert [translated(name) for name in (*told.states, *told.measurements, reading.source_of("great"))] == ["gain", "limit", "great"]
    assert pickle.loads(pickle.dumps(told.states)) == ("gain",)


def test_the_words_of_a_figure_are_translated(foreign):
    """Titles, labels, texts and legends, of the figure and of its axes; what has no translation is left alone."""
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], label="gain")
    axes.set_xlabel("t, s")
    axes.set_ylabel("P, m²")
    axes.set_title("limit")
    axes.text(0.5, 0.5, "great")
    axes.legend()
    figure.legend()
    shown = in_words_of_the_reader(figure)
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) == ("t, с", "P, m²", "предел")
    assert axes.texts[0].get_text() == "велико"
    assert [legend.get_texts()[0].get_text() for legend in (axes.get_legend(), *figure.legends)] == ["усиление"] * 2
    assert shown is figure


def test_the_words_of_a_drawing_are_translated_unless_they_are_a_users(foreign):
    """Names of curves, bands, levels and marks, labels of axes; a user's "gain" is a name of his."""
    panel = Panel("gain", (Curve("gain", [0], [1]),), (Band("limit", [0], [0], [1]),), levels=(Mark("limit", 1.0),))
    drawing = Drawing("gain", "t, s", (panel,), marks=(Mark("great", 0.0),))
    shown = in_words_of_the_reader(drawing)
    (found,) = shown.panels
    assert (shown.name, shown.label, shown.marks[0].name) == ("усиление", "t, с", "велико")
    assert (found.label, found.curves[0].name) == ("усиление", "усиление")
    assert (found.bands[0].name, found.levels[0].name) == ("предел", "предел")
    users = Drawing("gain", "t, s", (panel,), verbatim=True)
    assert in_words_of_the_reader(users) is users


def pieces(report: Report):
    """Every text of a report that a reader sees, but equations and the machine's names of values."""
    for block in report.blocks:
        match block:
            case Text(words) if not words.startswith("$$"):
                yield from words.split("\n")
            case Heading(words):
                yield words
            case Table():
                yield block.caption
                yield from block.columns
                yield from (cell for row in block.rows for cell in row if isinstance(cell, str))
            case Picture():
                yield block.caption
            case Check():
                yield from block.route
            case Value():
                yield block.reason


@pytest.mark.xdist_group("sources")  # one worker reads them
@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in LABS])
def test_every_sentence_of_a_lab_can_be_translated(name, marked):
    """What a reader sees in words begins with a text of the sources: none is glued from what no translator has seen."""
    lab = LABS[name]
    report = labs.run(lab, labs.parameters([lab], {})[name], Experiment(25, 1, workers=1))
    sheet = (ROOT / "tasks" / "sheets" / f"{name}.md").read_text(encoding="utf-8")  # translated as a file
    found = [piece for piece in pieces(report) if piece not in sheet]
    assert sum("«" in piece for piece in found) > 50
    assert [piece for piece in found if "«" not in piece and WORDS.search(piece)] == []


def unplaced(call: ast.Call) -> list[str]:
    """Values of a sentence or an equation that its text has no place for; none where the text is not all literal."""
    parts = [node for argument in call.args for node in ast.walk(argument)]
    if any(isinstance(node, ast.Name | ast.JoinedStr) for node in parts):
        return []
    words = " ".join(node.value for node in parts if isinstance(node, ast.Constant) and isinstance(node.value, str))
    one = asked(words)
    named = [each.arg for each in call.keywords if each.arg]
    return [name for name in named if fill(words, **one) == fill(words, **one | {name: "other"})]


def asked(words: str) -> dict[str, str]:
    """A value for everything that looks like a placeholder."""
    return dict.fromkeys(re.findall(r"\{([a-zA-Z]\w*)(?::\d+)?\}", words), "one")


@pytest.mark.parametrize("path", sorted((ROOT / "tasks").rglob("*.py")), ids=lambda path: path.stem)
def test_every_value_has_its_place(path):
    """In a text or an equation: braces that follow a brace are an argument of LaTeX, and what stands in them is not filled."""
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    spoken = [each for each in calls if ast.unparse(each.func) in {"r.says", "r.math", "text"}]
    assert [(each.lineno, found) for each in spoken if (found := unplaced(each))] == []


@pytest.mark.parametrize("path", sorted((ROOT / "tasks").rglob("*.py")), ids=lambda path: path.stem)
def test_a_lab_speaks_plainly(path):
    """No translation by hand, no filling by hand, no pragma of the formatter."""
    source = path.read_text(encoding="utf-8")
    calls = {ast.unparse(node.func) for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)}
    assert not calls & {"_", "fill"}
    assert "fmt: skip" not in source
    assert "fmt: off" not in source
