"""The workbench's labs without a page: the catalogue, what is typed, the run in its own process, the report's files."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.files.modelfile import gallery, ready
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import Experiment
from ctlabs.reporting import render
from ctlabs.workbench.runs import catalogue
from ctlabs.workbench.runs.catalogue import check, fields, search, sheets
from ctlabs.workbench.runs.running import Running
from ctlabs.workbench.runs.worker import Runner
from tests.reference import PNG

ROOT = Path(__file__).parents[2]
NAMES = [each.name for each in sheets()]
DRAFT = "0123456789abcdef"
#: What the tests share is made by one worker.
pytestmark = pytest.mark.xdist_group("workbench labs")

# The catalogue --------------------------------------------------------------------------------------------------------


def test_the_catalogue_has_all_labs_and_imports_none() -> None:
    """Titles, statements and variants are read, the scripts are not run: the page is there at once."""
    code = (
        "import sys; from ctlabs.workbench.runs import catalogue; print(len(catalogue.sheets())); "
        "print([name for name in sys.modules if name.startswith('ctlabs.tasks.')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines() == [str(len(labs.catalogue())), "[]"]
    assert len(labs.catalogue()) == 29


@pytest.mark.parametrize("name", NAMES)
def test_a_sheet_tells_what_the_lab_is(name: str) -> None:
    """Statement without its source and without its answer, which is told apart; variants as in the practicum's table."""
    sheet, lab = catalogue.sheet(name), labs.catalogue()[name]
    assert (sheet.title, sheet.source, sheet.parts, sheet.runs) == (lab.title, lab.source, lab.parts, lab.runs)
    assert len(" ".join(sheet.statement)) > 60
    assert not any(part.startswith("Expected answer") for part in sheet.statement)
    assert len(sheet.answer) > 20
    assert sheet.extension == lab.extension
    for letter in labs.VARIANTS:
        starred = dict(labs.variant(letter)).get(name)
        assert (f"{letter}*" in sheet.variants, letter in sheet.variants) == (starred is True, starred is False)


def test_a_labs_models_are_those_of_the_gallery() -> None:
    """Every gallery model that belongs to a lab is offered there, once, and can be opened."""
    offered = [(sheet.name, model.name) for sheet in sheets() for model in sheet.models]
    assert sorted(offered) == sorted((entry.lab, entry.name) for entry in gallery() if entry.lab)
    assert ("task17", "task17_two") in offered
    for _, name in offered[:3]:
        assert ready(name).problems() == []


def test_labs_are_found_by_number_word_and_variant() -> None:
    """A number is that lab's and no other's; all words have to be there; a variant is a column of the table."""
    assert [each.name for each in search("7")] == [each.name for each in search(" 07 ")] == ["task07"]
    assert [each.name for each in search("PENDULUM nonsense")] == []
    assert "task10" in [each.name for each in search("bad sampling")]
    assert [each.name for each in search(variant="b")] == [name for name, _ in labs.variant("b") if name in NAMES]
    assert search() == sheets()
    assert {each.name for each in search("wiener", "c")} <= {each.name for each in search("wiener")}


def test_a_lab_is_named_by_its_number_or_name() -> None:
    """As on the command line; several at once are none."""
    assert catalogue.sheet("7") is catalogue.sheet("task07")
    assert catalogue.sheet("field").heading == "Kalman filter for a random field"
    assert catalogue.sheet("7").heading.startswith("Lab 7: ")
    for word in ("99", "all", "variant-a"):
        with pytest.raises(ValueError, match=f"^lab {word}: expected"):
            catalogue.sheet(word)


# What is typed --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_fields_as_they_stand_are_the_defaults(name: str) -> None:
    """Every field has a unit, a meaning and a range; typed back, the defaults are the defaults to the last bit."""
    own = labs.load(labs.catalogue()[name]).Parameters
    typed = {field.name: field.default for field in fields(name)}
    assert list(typed) == list(own.model_fields)
    assert all(
        field.unit and field.meaning and field.allowed and field.kind in catalogue.KINDS for field in fields(name)
    )
    found = check(name, typed)
    assert found == (own().plain(), {})
    assert check(name, {}) == found
    assert {key: catalogue.typed_as(value) for key, value in own().plain().items()} == typed
    assert (
        check(name, dict.fromkeys(typed, "") | {f.name: f.default for f in fields(name) if f.kind == "matrix"}) == found
    )


def test_all_that_is_wrong_is_told_at_its_field() -> None:
    """Not the first problem alone, and in the words of the command line."""
    typed = {"Q": "-1", "R": "0", "K_star": "1.5", "steps": "2.5", "lambdas": "1, x", "Phi": "two"}
    found = check("task07", typed)
    assert found.values is None
    assert set(found.problems) == set(typed)
    for name in ("Q", "R", "K_star", "steps"):
        own = labs.load(labs.catalogue()["task07"]).Parameters
        with pytest.raises(ValueError, match="expected") as said:
            own.parse("task07", {name: json.loads(typed[name])})
        assert str(said.value) == f"task07: {name}: {found.problems[name]}"


def test_the_range_is_what_the_message_says() -> None:
    """ "a number from 0 to 1" in the hint is "expected a number from 0 to 1" in the error."""
    allowed = {field.name: field.allowed for field in fields("task07")}
    problems = check("task07", {"Q": "-1", "R": "0", "K_star": "2", "steps": "0", "lambdas": "1, -1"}).problems
    for name, problem in problems.items():
        assert problem.removeprefix("expected ").partition(", received")[0] in allowed[name]
    assert allowed["lambdas"] == "a list of numbers, each a number >= 0"


def test_numbers_may_be_expressions() -> None:
    """π/2, a third, a square; lists with or without brackets; infinity where it is allowed; never a program."""
    assert (
        check("task10", {"dt_bad": "2*pi", "R": "0.3^2"}).values
        == check("task10", {"dt_bad": repr(2 * np.pi), "R": repr(0.3**2)}).values
    )
    assert (
        check("task07", {"lambdas": "[1/2, 2]", "steps": "1e1"}).values
        == check("task07", {"lambdas": "0.5 2", "steps": "10"}).values
    )
    found = check("task06", {"R": "1, inf, 0"}).values
    assert found is not None
    assert found["R"] == [1, "inf", 0]
    assert check("task07", {"Phi": "inf"}).problems == {"Phi": 'expected a number, received "inf"'}
    assert check("task07", {"Phi": "__import__('os').getpid()"}).values is None
    assert check("task20", {"R_values": "2"}).values == check("task20", {"R_values": "[2]"}).values


def test_matrices_are_typed_cell_by_cell() -> None:
    """A symmetric covariance; one that is none is told with its eigenvalue or its asymmetry."""
    good = check("task10", {"P0": [["4", "1/2"], ["0.5", "2"]]}).values
    assert good is not None
    assert good["P0"] == [[4, 0.5], [0.5, 2]]
    assert "eigenvalue -1" in check("task10", {"P0": [["1", "2"], ["2", "1"]]}).problems["P0"]
    assert "expected a 2×2 covariance" in check("task10", {"P0": [["1", "0.1"], ["x", "1"]]}).problems["P0"]


def test_what_concerns_several_fields_is_told_where_it_belongs() -> None:
    """At the field that the message names, else for the whole form."""
    assert check("task14", {"fixes": "11"}).problems == {
        "": "expected at most as many fixes as instants (10), received 11"
    }
    assert list(check("field", {"dt": "5"}).problems) == ["dt"]
    assert list(check("task11", {"x1_mean": "3"}).problems) == ["x1_second_moment"]
    assert "received an unknown name" in check("task07", {"phi": "1"}).problems["phi"]


@settings(deadline=None, max_examples=150, derandomize=True)
@given(
    texts=st.dictionaries(
        st.sampled_from(["Phi", "Q", "R", "P0", "K_star", "lambdas", "steps"]),
        st.one_of(
            st.text(max_size=12),
            st.floats().map(repr),
            st.integers().map(str),
            st.sampled_from(["1/0", "9**9**9", "("]),
        ),
    )
)
def test_whatever_is_typed_is_answered(texts: dict[str, str]) -> None:
    """Values that the lab takes, or a line for each field that is wrong; nothing is raised."""
    found = check("task07", texts)
    assert (found.values is None) == bool(found.problems)
    if found.values is not None:
        assert labs.load(labs.catalogue()["task07"]).Parameters.parse("task07", found.values).plain() == found.values
    assert all("\n" not in line and line.startswith("expected ") for line in found.problems.values())
    assert set(found.problems) <= {*texts, ""}


# The run --------------------------------------------------------------------------------------------------------------


def run(folder: Path, name: str = "task14", runs: int = 40, seed: int = 2, **more: Any) -> int:
    values = check(name, {}).values
    assert values is not None
    return catalogue.run_lab(name, values, runs, seed, str(folder), **more)


#: To the labs before and after, and to the index, of a page and in Markdown.
WAYS = rb'<nav class="around">.*?</nav>\n|(?<=\n\n)\[[^\n]*\[All labs\][^\n]*\n\n'


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab") / "task14"
    run(folder, "task14", 30, 5)
    return folder


def test_the_report_is_that_of_the_command_line(written: Path, tmp_path: Path) -> None:
    """The same parameters, runs and seed: the same bytes but for the ways to other labs; results.json says what a page shows."""
    lab = labs.catalogue()["task14"]
    labs.run_and_write(lab, labs.parameters([lab], {})["task14"], Experiment(30, 5, 1), tmp_path)
    for path in sorted((tmp_path / "task14").rglob("*.*")):
        here = (written / path.relative_to(tmp_path / "task14")).read_bytes()
        assert here == re.sub(WAYS, b"", path.read_bytes(), flags=re.DOTALL), path
    found = catalogue.outcome(written)
    assert found is not None
    told = json.loads((written / "results.json").read_text(encoding="utf-8"))
    assert (found.lab, found.runs, found.seed, list(found.checks)) == ("task14", 30, 5, told["checks"])
    assert (found.failed, found.verdict) == ((), f"all {len(told['checks'])} checks passed")
    assert found.tables == len(list((written / "tables").glob("*.csv"))) > 0


def test_failed_checks_are_counted_and_named(written: Path, tmp_path: Path) -> None:
    """A report with a check that failed says so; one that is broken or missing is none."""
    told = json.loads((written / "results.json").read_text(encoding="utf-8"))
    told["checks"][1]["passed"] = False
    (tmp_path / "results.json").write_text(json.dumps(told), encoding="utf-8")
    assert catalogue.outcome(tmp_path) is None  # no run.json
    (tmp_path / "run.json").write_text((written / "run.json").read_text(encoding="utf-8"), encoding="utf-8")
    found = catalogue.outcome(tmp_path)
    assert found is not None
    assert found.failed == (told["checks"][1]["name"],)
    assert found.verdict == f"1 of {len(told['checks'])} checks failed"
    (tmp_path / "results.json").write_text("{", encoding="utf-8")
    assert catalogue.outcome(tmp_path) is None
    assert catalogue.outcome(tmp_path / "nowhere") is None


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report's files are all there; no picture is drawn."""
    monkeypatch.setattr(render, "png", lambda _figure: PNG)


@pytest.mark.usefixtures("undrawn")
def test_progress_counts_the_runs_of_all_experiments(tmp_path: Path) -> None:
    """It never falls, ends at the last experiment's runs, and has a total as soon as one is known."""
    seen: list[tuple[int, int]] = []
    many = run(tmp_path / "a", "task14", 50, progress=lambda done, total: seen.append((done, total)))
    assert many > 1
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert seen[-1][0] == many * 50
    assert {total for _, total in seen} == {0}
    seen.clear()
    run(tmp_path / "b", "task14", 50, expected=many, progress=lambda done, total: seen.append((done, total)))
    assert {total for _, total in seen} == {many * 50}
    assert max(done for done, _ in seen) == many * 50


@pytest.mark.usefixtures("undrawn")
def test_a_cancelled_run_leaves_the_report_before_it(tmp_path: Path) -> None:
    """Whatever progress raises ends the run, at its very end too; what was there stays whole."""
    folder = tmp_path / "task14"
    calls: list[int] = []
    run(folder, seed=2, progress=lambda done, _: calls.append(done))
    before = {path: path.read_bytes() for path in folder.rglob("*.*")}

    def stop(_done: int, _total: int) -> None:
        calls.pop()
        if not calls:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(folder, seed=3, progress=stop)
    assert {path: path.read_bytes() for path in folder.rglob("*.*")} == before
    assert [path.name for path in tmp_path.iterdir()] == ["task14"]


def test_parameters_are_checked_in_the_process_too(tmp_path: Path) -> None:
    """The process trusts nobody."""
    with pytest.raises(ValueError, match="task07: Q: expected a number >= 0, received -1"):
        catalogue.run_lab("task07", {"Q": -1}, 10, 1, str(tmp_path / "x"))
    assert list(tmp_path.iterdir()) == []


# The files ------------------------------------------------------------------------------------------------------------


def test_a_reports_place_is_made_of_ids_and_names_only(tmp_path: Path) -> None:
    """No path leads out of the data folder."""
    assert catalogue.place(tmp_path, DRAFT, "task07") == tmp_path / "labs" / DRAFT / "task07"
    for draft, name in (
        ("..", "task07"),
        (DRAFT, ".."),
        (DRAFT, "nonsense"),
        ("/etc", "task07"),
        (f"{DRAFT}/..", "task07"),
        (DRAFT.upper(), "task07"),
    ):
        with pytest.raises(ValueError, match=r"^report: expected a draft and a lab, received"):
            catalogue.place(tmp_path, draft, name)


def test_the_tables_come_in_one_file(written: Path) -> None:
    """All of them, readable, and the same bytes each time."""
    packed = catalogue.tables(written)
    assert packed == catalogue.tables(written)
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        names = archive.namelist()
        assert names == sorted(path.name for path in (written / "tables").glob("*.csv"))
        for name in names:
            assert archive.read(name) == (written / "tables" / name).read_bytes()
            assert len(list(csv.reader(io.StringIO(archive.read(name).decode())))) > 1


def test_the_report_has_the_pages_colours_and_nothing_from_elsewhere(written: Path) -> None:
    """Light and dark are chosen by the page, no script, no address of another machine."""
    plain = catalogue.page(written)
    assert plain == (written / "report.html").read_text(encoding="utf-8")
    assert "prefers-color-scheme" in plain
    light, dark = catalogue.page(written, "light"), catalogue.page(written, "dark")
    assert "@media not all" in light
    assert "color-scheme: light;" in light
    assert "@media all" in dark
    assert "color-scheme: dark;" in dark
    assert "<script" not in plain
    assert 'src="http' not in plain


def test_reports_of_drafts_that_are_no_more_are_removed(tmp_path: Path) -> None:
    """Those of others stay, and so does what is no report's folder."""
    for folder in (DRAFT, "f" * 16, "notes"):
        (tmp_path / "labs" / folder / "task07").mkdir(parents=True)
    catalogue.tidy(tmp_path, lambda draft: draft == DRAFT)
    assert sorted(path.name for path in (tmp_path / "labs").iterdir()) == [DRAFT, "notes"]
    catalogue.tidy(tmp_path / "nowhere", lambda _: False)


# In a process of its own ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    """The workbench's own table, one process."""
    made = Runner(size=1)
    yield made
    made.close()


def typed_values(name: str, **typed: str) -> dict[str, Any]:
    values = check(name, typed).values
    assert values is not None
    return values


class Bench(Running):
    """The labs of one draft."""

    def __init__(self, runner: Runner, data: Path, draft: str = DRAFT) -> None:
        super().__init__()
        self.runner, self.data, self.draft = runner, data, draft

    def begin(self, name: str, runs: int, seed: int, **typed: str) -> None:
        folder = catalogue.place(self.data, self.draft, name)
        self.start(catalogue.work(self.runner, self.draft, name, typed_values(name, **typed), runs, seed, folder), name)

    def outcome(self, name: str) -> catalogue.LabOutcome | None:
        kept = catalogue.kept(catalogue.place(self.data, self.draft, name))
        return catalogue.outcome(kept[-1]) if kept else None


def test_a_lab_runs_beside_the_page_and_is_cancelled_within_a_second(runner: Runner, tmp_path: Path) -> None:
    """A report of its own; a second run is not begun at the same time; a cancelled one leaves the report and no problem."""

    async def story() -> None:
        bench = Bench(runner, tmp_path)
        assert bench.outcome("task14") is None
        bench.begin("task14", 50, 4)
        bench.begin("task07", 50, 4)
        assert bench.name == "task14"
        await bench.wait()
        found = bench.outcome("task14")
        assert (bench.problem, bench.finished, found is not None and found.seed) == ("", 1, 4)
        bench.begin("task14", catalogue.RUNS, 5)
        while bench.progress is None or not bench.progress.done:
            await asyncio.sleep(0.02)
        assert bench.progress.total >= catalogue.RUNS  # the first report said how many experiments there are
        bench.cancel()
        await bench.wait()
        assert (bench.running, bench.problem, bench.finished, bench.outcome("task14")) == (False, "", 1, found)

    asyncio.run(story())


def test_numbers_that_overflow_are_told_in_one_line(runner: Runner, tmp_path: Path) -> None:
    """Parameters may be allowed and still lead out of the range of doubles: no report, one line, ready for the next."""

    async def story() -> None:
        bench = Bench(runner, tmp_path)
        bench.begin("task07", 10, 1, Phi="1e200")
        await bench.wait()
        assert bench.problem.startswith("task07: expected parameters for which all numbers stay finite")
        assert "\n" not in bench.problem
        assert bench.outcome("task07") is None
        bench.begin("task14", 20, 1)
        await bench.wait()
        assert (bench.problem, bench.finished) == ("", 1)

    asyncio.run(story())


def test_the_process_writes_where_it_was_told(runner: Runner, tmp_path: Path) -> None:
    """One folder for each draft: two of them do not see each other's reports."""

    async def story() -> None:
        one, two = Bench(runner, tmp_path), Bench(runner, tmp_path, "f" * 16)
        one.begin("task14", 20, 1)
        await one.wait()
        assert two.outcome("task14") is None
        assert [path.name for path in (tmp_path / "labs" / DRAFT).iterdir()] == ["task14"]

    asyncio.run(story())


# What is kept and handed on -------------------------------------------------------------------------------------------


def result(folder: Path, seed: int, value: float, **parameters: float) -> None:
    """As much of a report as is read of it."""
    folder.mkdir(parents=True)
    check = {"name": "limit", "value": value, "passed": value < 2}
    told = {"lab": "task07", "title": "T", "checks": [check], "parameters": parameters, "runs": 10, "seed": seed}
    (folder / "results.json").write_text(json.dumps(told))
    (folder / "run.json").write_text(json.dumps({"seconds": 1.0, "ensembles": 3}))


def test_the_last_runs_are_kept_in_their_order_and_compared(tmp_path: Path) -> None:
    """By number and not by letter; one from before there were numbers is the first; what is half written is none."""
    place = tmp_path / "task07"
    result(place, 0, 1.0, R=1.0, Q=1.0)
    for number in (2, 10, 9):
        result(place / str(number), number, 1.0 + number / 8, R=4.0, Q=1.0)
    (place / "11").mkdir()
    assert [each.name for each in catalogue.kept(place)] == ["task07", "2", "9", "10"]
    first, last = (catalogue.outcome(each) for each in (place, place / "10"))
    assert first is not None
    assert last is not None
    assert catalogue.compared(first, last) == [("R", "1", "4"), ("seed", "0", "10"), ("limit", "1", "2.25 (failed)")]


def test_a_new_run_has_a_new_place_and_the_oldest_make_room(tmp_path: Path) -> None:
    """The page's folder never holds more than so many."""
    place = tmp_path / "task07"
    asked: list[Any] = []

    class Runner_:
        def run(self, _name: str, arguments: dict[str, Any], **_: Any) -> None:
            asked.append(arguments)

    for seed in range(catalogue.KEPT + 3):
        work = catalogue.work(Runner_(), "0" * 16, "task07", {}, 10, seed, place)  # type: ignore[arg-type]  # as much as it needs
        work(lambda _: None, None)  # type: ignore[arg-type]
        result(Path(asked[-1]["folder"]), seed, 1.0)
    assert [each.name for each in catalogue.kept(place)] == [str(k) for k in range(4, catalogue.KEPT + 4)]
    assert [each["expected"] for each in asked[:2]] == [0, 3]


def test_an_address_holds_what_is_typed_and_nothing_else() -> None:
    """There and back for numbers, lists and matrices; a name or shape that the lab does not have is passed over."""
    from urllib.parse import parse_qsl

    for lab, typed in (("task07", {"R": "4,5", "lambdas": "1; 2"}), ("task10", {"P0": [["4", "1/2"], ["0.5", "<b>"]]})):
        told = dict(parse_qsl(catalogue.address(lab, typed, "50", "3")))
        assert told.pop("lab") == lab
        assert catalogue.from_address(lab, told) == {**typed, "": ["50", "3"]}
    assert catalogue.address("task07", {}) == "lab=task07"
    assert catalogue.from_address("task10", {"P0": "[[1]]", "none": "1", "Q": "[", "R": "2"}).keys() <= {"Q", "R", ""}


def test_decimal_commas_are_understood() -> None:
    """Alone, in a list with semicolons, and as groups of thousands not."""
    found = check("task07", {"R": "0,5", "Q": "2,5e-1", "lambdas": "0,5; 2"}).values
    assert found is not None
    assert (found["R"], found["Q"], found["lambdas"]) == (0.5, 0.25, [0.5, 2])
    assert check("task07", {"R": "1,000,000"}).problems["R"].endswith("write 1000000")


def test_a_labs_model_takes_what_is_typed() -> None:
    """Constants of the same name; what is as it was stays as it was written."""
    from ctlabs.files.modelfile import loads, ready

    text, taken = catalogue.model_with("task13", "task13", {"N_c": "400", "mean_hc0": "wrong"})
    assert taken == ("N_c",)
    assert loads(text).constants == {**ready("task13").constants, "N_c": 400.0}
    assert catalogue.model_with("task13", "task13", {}) == (ready("task13").dumps(), ())
    for entry in labs_with_models():
        assert catalogue.model_with(entry[1], entry[0], {}) == (ready(entry[1]).dumps(), ())


def labs_with_models() -> list[tuple[str, str]]:
    return [(sheet.name, model.name) for sheet in catalogue.sheets() for model in sheet.models]


def test_statements_are_typeset() -> None:
    """Every lab's: no dollar signs are left, and what a sheet asks is there by its letter."""
    pytest.importorskip("nicegui", reason="the workbench is not installed")
    from ctlabs.workbench.pages.labs import statement

    for sheet in catalogue.sheets():
        html = statement(sheet)
        assert "$" not in html
        if sheet.asked is not None:
            assert html.count("<dt>") == len(sheet.asked.items)
            assert "<math" in html or "$" not in sheet.asked.statement
