"""The catalogue: what a lab may be called, which parameters it has, and what is read without importing it."""

import ast
import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from ctlabs import cli
from ctlabs.labs import catalogue as labs
from ctlabs.labs import sheet
from ctlabs.labs.experiment import Experiment
from ctlabs.reporting.params import LabParameters, Positive, Variance, given
from ctlabs.reporting.report import Report

#: The labs of the whole practicum and of the papers, whichever of them are written.
NAMES = [*(f"task{i:02d}" for i in range(1, 24)), "coloured_plant", "field", "slow_error"]
#: Those that are no part of either.
EXTENSIONS = ["task24", "task25", "task26"]


def entry(name: str) -> labs.Lab:
    return labs.Lab(name, f"Title of {name}", "A book", ("a", "b"), 1000, f"nowhere.{name}")


@pytest.fixture
def whole(monkeypatch) -> dict[str, labs.Lab]:
    """A catalogue with every lab."""
    catalogue = {name: entry(name) for name in NAMES}
    monkeypatch.setattr(labs, "catalogue", lambda: catalogue)
    return catalogue


@pytest.fixture
def scripts(tmp_path, monkeypatch):
    """A function that writes scripts and returns the catalogue of them."""

    def make(**sources: str) -> dict[str, labs.Lab]:
        for name, source in sources.items():
            (tmp_path / f"{name}.py").write_text(source, encoding="utf-8")
        spec = SimpleNamespace(submodule_search_locations=[str(tmp_path)])
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec if name == "ctlabs.tasks" else None)
        return labs.catalogue.__wrapped__()

    return make


class One(LabParameters):
    Phi: Positive = given(0.5, unit="1", meaning="a factor")
    Q: Variance = given(1.0, unit="m²", meaning="a variance")


class Other(LabParameters):
    Q: Variance = given(2.0, unit="m²", meaning="a variance")
    tau: Positive = given(1.0, unit="s", meaning="a period")


@pytest.fixture
def two(whole, monkeypatch) -> list[labs.Lab]:
    """Two labs with one parameter in common."""
    classes = {"task07": One, "task16": Other}
    monkeypatch.setattr(labs, "load", lambda lab: SimpleNamespace(Parameters=classes[lab.name]))
    return [whole["task07"], whole["task16"]]


class TestFind:
    @pytest.mark.parametrize("word", ["7", "07", "007", "task7", "task07", "TASK07", "Task007"])
    def test_a_lab_has_a_number_and_a_name(self, whole, word):
        """However the number is written, it is the same lab."""
        assert [lab.name for lab in labs.find([word])] == ["task07"]

    def test_a_paper_has_a_name(self, whole):
        """The labs after papers are called by their names."""
        assert [lab.name for lab in labs.find(["field", "slow_error", "coloured_plant"])] == [
            "field",
            "slow_error",
            "coloured_plant",
        ]
        assert whole["field"].short == "field"
        assert whole["task07"].short == "7"

    def test_all_is_every_lab(self, whole):
        """In the order of the catalogue."""
        assert [lab.name for lab in labs.find(["all"])] == NAMES

    @pytest.mark.parametrize("letter", ["a", "b", "c"])
    def test_a_variant_is_a_column_of_the_practicums_table(self, whole, letter):
        """Twelve labs in order, of which six are control labs; six are common to all variants."""
        column = labs.variant(letter)
        names = [name for name, _starred in column]
        assert [lab.name for lab in labs.find([f"variant-{letter}"])] == names
        assert names == sorted(set(names))
        assert len(names) == 12
        assert {"task01", "task05", "task10", "task18", "task19", "task23"} <= set(names)
        assert sum(starred for _name, starred in column) == 6

    def test_no_lab_is_a_control_lab_of_two_variants(self):
        """Every star of the table stands at a lab of its own."""
        starred = [name for letter in labs.VARIANTS for name, star in labs.variant(letter) if star]
        assert len(starred) == len(set(starred)) == 18

    def test_a_variant_holds_the_labs_that_are_there(self, whole, monkeypatch):
        """A lab that is not written yet is no error of the student's."""
        monkeypatch.setattr(labs, "catalogue", lambda: {"task07": whole["task07"]})
        assert [lab.name for lab in labs.find(["variant-a"])] == ["task07"]

    def test_every_lab_is_chosen_once_in_the_order_given(self, whole):
        """Naming a lab twice does not run it twice."""
        chosen = [lab.name for lab in labs.find(["16", "task07", "7", "variant-a", "16"])]
        assert chosen[:2] == ["task16", "task07"]
        assert sorted(chosen) == sorted({"task16", *(name for name, _starred in labs.variant("a"))})

    @pytest.mark.parametrize(
        ("word", "close"),
        [
            ("task77", "task07"),
            ("feld", "field"),
            ("variant-d", "variant-a"),
            ("99", ""),
            ("", ""),
            ("zzzz", ""),
            ("-7", ""),
        ],
    )
    def test_an_unknown_lab_is_refused_with_the_closest_names(self, whole, word, close):
        """One line: the word, the labs there are, and what may have been meant."""
        with pytest.raises(ValueError) as refusal:
            labs.find(["7", word])
        message = str(refusal.value)
        assert message.startswith(f"lab {word}: expected one of 1, 2, 3")
        assert message.endswith("received an unknown name")
        assert ("did you mean" in message) >= bool(close)
        assert close in message.partition("did you mean")[2]
        assert "\n" not in message


class TestParameters:
    def test_a_setting_goes_to_every_chosen_lab_that_has_it(self, two):
        """Q is given to both, Phi and tau to one each; the others keep their defaults."""
        values = labs.parameters(two, {"Q": 9, "Phi": 0.25})
        assert values == {"task07": One(Phi=0.25, Q=9), "task16": Other(Q=9, tau=1)}

    @pytest.mark.parametrize("place", ["task07", "7", "07", "TASK07"])
    def test_a_setting_can_address_one_lab(self, two, place):
        """task07.Q=9 leaves the other lab's Q alone."""
        values = labs.parameters(two, {f"{place}.Q": 9})
        assert values == {"task07": One(Q=9), "task16": Other()}

    def test_the_later_setting_wins(self, two):
        """A value for all and another for one."""
        values = labs.parameters(two, {"Q": 9, "task16.Q": 3})
        assert (values["task07"].Q, values["task16"].Q) == (9, 3)

    @pytest.mark.parametrize(
        ("key", "words"),
        [
            (
                "phi",
                r"^task07, task16: parameter phi: expected one of Phi, Q, tau \(did you mean Phi\?\), received an unknown name$",
            ),
            ("sigma", r"^task07, task16: parameter sigma: expected one of Phi, Q, tau, received an unknown name$"),
            ("task16.Phi", r"^task07, task16: parameter task16\.Phi: expected one of .*, received an unknown name$"),
            ("task08.Q", r"^task07, task16: parameter task08\.Q: expected one of .*, received an unknown name$"),
            ("task99.Q", r"^lab task99: expected one of 1, .*, received an unknown name$"),
            (".Phi.", r"^lab \.Phi: expected one of 1, .*, received an unknown name$"),
        ],
    )
    def test_a_setting_that_no_chosen_lab_has_is_refused(self, two, key, words):
        """A misspelt name is never ignored."""
        with pytest.raises(ValueError, match=words):
            labs.parameters(two, {key: 1})

    def test_a_bad_value_names_the_lab_that_refuses_it(self, two):
        """Of the labs that received the value."""
        with pytest.raises(ValueError, match=r"^task16: tau: expected a number > 0, received -1$"):
            labs.parameters(two, {"tau": -1})


class TestCatalogue:
    META = 'META = {{"name": "{}", "title": "T", "source": "S", "parts": ["a"]{},\n}}\n'

    def test_meta_is_read_without_importing_the_script(self, scripts):
        """A script that cannot be imported is listed all the same; names that begin with _ are no labs."""
        found = scripts(
            task09_x=self.META.format("task09", ', "runs": 50') + "raise ImportError",
            field=self.META.format("field", "") + "import nothing_of_this_name",
            task02_y="import os\n" + self.META.format("task02", ""),
            _shared="raise ImportError",
        )
        assert list(found) == ["task02", "task09", "field"]
        assert found["task09"] == labs.Lab("task09", "T", "S", ("a",), 50, "ctlabs.tasks.task09_x")
        assert found["field"].runs == 1000

    def test_extensions_stand_behind_the_practicum_and_the_papers(self, scripts):
        """Whatever their names: the order of the practicum is left as it is."""
        found = scripts(
            task02_y=self.META.format("task02", ', "extension": True'),
            field=self.META.format("field", ""),
            task09_x=self.META.format("task09", ""),
        )
        assert [(name, lab.extension) for name, lab in found.items()] == [("task09", False), ("field", False), ("task02", True)]

    def test_the_catalogue_is_the_practicum_the_papers_and_the_extensions(self):
        """Extensions belong to no variant."""
        found = labs.catalogue()
        assert list(found) == [*NAMES, *EXTENSIONS]
        assert [name for name, lab in found.items() if lab.extension] == EXTENSIONS
        assert not {name for letter in labs.VARIANTS for name, _starred in labs.variant(letter)} & set(EXTENSIONS)

    def test_two_scripts_of_one_name_are_refused(self, scripts):
        """One of them would silently hide the other."""
        with pytest.raises(RuntimeError, match="labs: expected one script for task07, received several"):
            scripts(task07_new=self.META.format("task07", ""), task07_old=self.META.format("task07", ""))

    def test_every_script_in_tasks_is_a_lab(self):
        """Names are those of the files, parts are letters, and the module has what the catalogue needs."""
        found = labs.catalogue()
        folder = Path(labs.__file__).parents[2] / "tasks"
        assert {lab.module.rpartition(".")[2] for lab in found.values()} == {
            path.stem for path in folder.glob("[a-z]*.py")
        }
        for name, lab in found.items():
            assert lab.module.rpartition(".")[2].startswith(name)
            assert lab.parts
            assert len(lab.parts) == len(set(lab.parts))
            assert lab.runs >= 1
            module = labs.load(lab)
            assert module.META["name"] == name
            assert issubclass(module.Parameters, LabParameters)
            assert callable(module.report)
            assert module.__doc__
            for info in module.Parameters.model_fields.values():
                assert info.description
                assert info.json_schema_extra["unit"]

    @pytest.mark.parametrize(
        "command", [["list"], ["--help"], ["run", "--help"], ["run", "7", "--runs", "0"], ["run", "nosuchlab"]]
    )
    def test_the_catalogue_is_light(self, command):
        """Listing, helping and refusing load no numerical library, so that they are instant."""
        code = (
            "import json, sys\nfrom ctlabs.cli import main\n"
            f"try:\n    main({command!r})\nexcept SystemExit:\n    pass\n"
            "print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"
        )
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, encoding="utf-8", check=True
        )
        loaded = set(json.loads(done.stdout.splitlines()[-1]))
        assert "click" in loaded
        assert not loaded & {
            "numpy",
            "scipy",
            "pydantic",
            "matplotlib",
            "control",
            "filterpy",
            "sympy",
            "numba",
            "jinja2",
            "PIL",
        }


def test_a_lab_is_run_and_written_with_a_summary(two, tmp_path, monkeypatch):
    """The summary counts the checks and names those that failed."""

    def report(values, experiment):
        made = Report(
            {"name": "task07", "title": "T", "source": "S", "parts": ["a"]}, values, experiment.runs, experiment.seed
        )
        made.check("right", values.Q, values.Q, ("one", "two"))
        made.check("wrong", 1.05, 1.0, ("one", "two"))
        return made

    monkeypatch.setattr(labs, "load", lambda lab: SimpleNamespace(report=report))
    done = labs.run_and_write(two[0], One(Q=3), Experiment(runs=5, seed=2), tmp_path)
    assert {key: done[key] for key in ("lab", "checks", "failed")} == {
        "lab": "task07",
        "checks": 2,
        "failed": ["wrong"],
    }
    assert done["seconds"] >= 0
    stored = json.loads((tmp_path / "task07/results.json").read_text(encoding="utf-8"))
    assert (stored["runs"], stored["seed"], stored["parameters"]["Q"]) == (5, 2, 3.0)
    assert "seconds" not in json.dumps(stored)


@pytest.mark.parametrize("name", sorted(labs.catalogue()))
def test_every_lab_has_a_sheet_with_its_items(name):
    """What is given, and a question for each part that the report answers, in its order; mathematics is closed."""
    found = sheet(name)
    assert tuple(found.items) == labs.catalogue()[name].parts
    assert len(found.statement) > 100
    assert found.statement.endswith((".", "?", ":"))
    for text in (found.statement, *found.items.values()):
        assert text.endswith((".", "?", ":", ";"))
        assert text.count("$") % 2 == 0


def test_there_are_no_other_sheets_and_unknown_labs_have_none():
    """A sheet without a lab would be read by no one."""
    assert {path.stem for path in (labs.folder() / "sheets").iterdir()} == set(labs.catalogue())
    with pytest.raises(KeyError, match="task99"):
        sheet("task99")


@pytest.mark.parametrize("path", sorted(labs.folder().rglob("*.py")), ids=lambda path: path.stem)
def test_a_lab_can_be_read(path):
    """A file has at most 350 lines, a function at most 40."""
    source = path.read_text(encoding="utf-8")
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    assert len(source.splitlines()) <= 350
    assert [node.name for node in functions if node.end_lineno - node.lineno + 1 > 40] == []


@pytest.mark.parametrize("name", sorted(labs.catalogue()))
def test_every_lab_is_a_script(name):
    """Its file ends by running itself."""
    path = Path(labs.load(labs.catalogue()[name]).__file__)
    assert path.read_text(encoding="utf-8").endswith(
        '\n\nif __name__ == "__main__":\n    from ctlabs.cli import script\n\n    script(META)\n'
    )


def test_a_script_runs_its_own_lab(monkeypatch):
    """``python tasks/task07_….py --runs 5`` is ``ctlabs run task07 --runs 5``."""
    lab = next(iter(labs.catalogue().values()))
    calls = []
    monkeypatch.setattr("ctlabs.cli.main", calls.append)
    monkeypatch.setattr(sys, "argv", ["script.py", "--runs", "5"])
    cli.script(labs.load(lab).META)
    assert calls == [["run", lab.name, "--runs", "5"]]


def test_a_lab_is_a_value():
    """Entries compare by content and cannot be changed."""
    assert entry("field") == entry("field")
    assert entry("field") != replace(entry("field"), runs=5)
