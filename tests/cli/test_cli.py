"""The command line: exit codes, one line for every mistake, and nothing half-written."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from ctlabs import cli
from ctlabs.labs import catalogue as labs
from ctlabs.labs.experiment import Experiment
from ctlabs.reporting.report import Report

TASK07 = labs.catalogue()["task07"]
PARAMETERS = labs.load(TASK07).Parameters


def fails(error: Exception):
    """A lab's report that raises an error."""

    def report(_values, _experiment):
        raise error

    return report


#: What a run writes beside the reports: the course, and lab 0 on the method.
INDEX = {"README.md", "index.html", "lab0.html", "lab0.md", "lab0-variances.png"}


class Console:
    """Runs commands in this process and keeps what they wrote."""

    def __init__(self, capsys) -> None:
        self._capsys = capsys
        self.out = self.err = ""

    def __call__(self, *arguments: object) -> int:
        with pytest.raises(SystemExit) as end:
            cli.main([str(argument) for argument in arguments])
        self.out, self.err = self._capsys.readouterr()
        return int(end.value.code or 0)


@pytest.fixture
def ctlabs(capsys, tmp_path, monkeypatch) -> Console:
    """The command, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return Console(capsys)


@pytest.fixture
def quick(monkeypatch):
    """A function that replaces every lab's work by checks that pass or fail."""

    def use(**checks: bool) -> None:
        def run(lab, values, experiment) -> Report:
            meta = {"name": lab.name, "title": lab.title, "source": lab.source, "parts": list(lab.parts)}
            report = Report(meta, values, experiment.runs, experiment.seed)
            for name, passes in checks.items():
                report.check(name, 1.0 if passes else 1.05, 1.0, ("one route", "another route"))
            return report

        monkeypatch.setattr(labs, "run", run)

    use(right=True)
    return use


@pytest.fixture(scope="module")
def once(tmp_path_factory) -> Path:
    """The reports of one real run of lab 7, by one worker in this process."""
    out = tmp_path_factory.mktemp("once")
    with pytest.raises(SystemExit) as end:
        cli.main(["run", "7", "--runs", "20", "--seed", "3", "--workers", "1", "--out", str(out)])
    assert end.value.code == 0
    return out


def files(folder: Path) -> dict[str, bytes]:
    """Every file below a folder and its bytes."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


#: A command that is refused, and the line that says why.
REFUSED = [
    (["run", "99"], r"lab 99: expected one of .*7.*, received an unknown name"),
    (["run", "7", "tsk07"], r"lab tsk07: expected one of .* \(did you mean task07.*\), received an unknown name"),
    (["run", "7", ""], r"lab : expected one of .*, received an unknown name"),
    (["run", "7\n8"], r"lab 7 8: expected one of .*, received an unknown name"),
    (["run"], r"LAB\.\.\.: expected as in `ctlabs run --help`, received none"),
    (["show"], r"LAB: expected as in `ctlabs show --help`, received none"),
    (["show", "99"], r"lab 99: expected one of .*, received an unknown name"),
    (["book", "--format", "html"], r"--format: expected some of pdf, docx, tex, md, for a book, received html or none"),
    (["book", "--format", ""], r"--format: expected some of pdf, docx, tex, md, for a book, received html or none"),
    (["run", "7", "--format", "odt"], r"--format: expected some of pdf, docx, tex, html, md, received odt"),
    (["nosuch"], r"command nosuch: expected one of .*fit, forecast, list, look, models, regulate, run, show.*, received an unknown name"),
    (["list", "7"], r"expected what `ctlabs list --help` shows, received another form: .*\(7\).*"),
    (
        ["run", "7", "--rns", "5"],
        r"--rns: expected an option of `ctlabs run --help` .*--runs.*, received an unknown name",
    ),
    (["--nosuch"], r"--nosuch: expected an option of `ctlabs --help`.*, received an unknown name"),
    (
        ["run", "7", "--runs"],
        r"expected what `.*--help` shows, received another form: .*--runs.* requires an argument.*",
    ),
    *(
        (
            ["run", "7", option, value],
            rf"{option}: expected a whole number >= {least}, received {re.escape(value) or 'nothing'}",
        )
        for option, least in (("--runs", 1), ("--workers", 1), ("--seed", 0))
        for value in ("-1", "abc", "1.5", "", "1e3", "inf", "nan", *(["0"] if least else []))
    ),
    (["run", "7", "--set", "Q"], r"--set Q: expected NAME=VALUE, received no name or no ="),
    (["run", "7", "--set", "=1"], r"--set =1: expected NAME=VALUE, received no name or no ="),
    (["run", "7", "--set", ""], r"--set : expected NAME=VALUE, received no name or no ="),
    (
        ["run", "7", "--set", "phi=1"],
        r"task07: parameter phi: expected one of .* \(did you mean Phi.*\), received an unknown name",
    ),
    (["run", "7", "--set", "no\nsuch=1"], r"task07: parameter no such: expected one of .*, received an unknown name"),
    (["run", "7", "--set", "task99.Q=1"], r"lab task99: expected one of .*, received an unknown name"),
    (["run", "7", "--set", "Q=-0.1"], r"task07: Q: expected a number >= 0, received -0\.1"),
    (["run", "7", "--set", "task07.Q=-1"], r"task07: Q: expected a number >= 0, received -1"),
    (["run", "7", "--set", "Q=nan"], r'task07: Q: expected a number >= 0, received "nan"'),
    (["run", "7", "--set", "Q=NaN"], r'task07: Q: expected a number >= 0, received "NaN"'),
    (["run", "7", "--set", "Q=inf"], r'task07: Q: expected a number >= 0, received "inf"'),
    (["run", "7", "--set", "Q=1e999"], r"task07: Q: expected a number >= 0, received Infinity"),
    (["run", "7", "--set", "Q=1" + 400 * "0"], r"task07: Q: expected a number >= 0, received 10+"),
    (["run", "7", "--set", "Q=" + 5000 * "1"], r'task07: Q: expected a number >= 0, received "1+"'),
    (["run", "7", "--set", "Q=" + 100_000 * "["], r'task07: Q: expected a number >= 0, received "\[+"'),
    (["run", "7", "--set", "Q=abc"], r'task07: Q: expected a number >= 0, received "abc"'),
    (["run", "7", "--set", "Q=a\nb"], r'task07: Q: expected a number >= 0, received "a\\nb"'),
    (["run", "7", "--set", "Q=true"], r"task07: Q: expected a number >= 0, received true"),
    (["run", "7", "--set", "Q=null"], r"task07: Q: expected a number >= 0, received None"),
    (["run", "7", "--set", "Q="], r'task07: Q: expected a number >= 0, received ""'),
    (["run", "7", "--set", "Q=[1]"], r"task07: Q: expected a number >= 0, received \[1\]"),
    (["run", "7", "--set", "R=0"], r"task07: R: expected a number > 0, received 0"),
    (["run", "7", "--set", "K_star=1.2"], r"task07: K_star: expected a number from 0 to 1, received 1\.2"),
    (["run", "7", "--set", "steps=0"], r"task07: steps: expected a whole number >= 1, received 0"),
    (["run", "7", "--set", "steps=2.5"], r"task07: steps: expected a whole number >= 1, received 2\.5"),
    (["run", "7", "--set", "lambdas=[]"], r"task07: lambdas: expected a list of numbers, received \[\]"),
    (["run", "7", "--set", "lambdas=[1, -1]"], r"task07: lambdas: expected a number >= 0, received -1"),
    (["run", "7", "--set", "lambdas=1"], r"task07: lambdas: expected a list of numbers, received 1"),
    (["run", "7", "--set", "Q=1", "--set", "Q=-1"], r"task07: Q: expected a number >= 0, received -1"),
]


class TestRefusals:
    @pytest.mark.parametrize(
        ("arguments", "line"), REFUSED, ids=lambda value: " ".join(value)[:40] if isinstance(value, list) else ""
    )
    def test_a_mistake_is_one_line_and_exit_2(self, ctlabs, tmp_path, arguments, line):
        """The line says what, where, expected and received; nothing is computed and nothing is written."""
        assert ctlabs(*arguments) == 2
        assert ctlabs.out == ""
        assert ctlabs.err.count("\n") == 1
        assert re.fullmatch(f"ctlabs: {line}\n", ctlabs.err), ctlabs.err[:300]
        assert list(tmp_path.iterdir()) == []

    def test_a_mistake_in_one_of_several_labs_stops_all(self, ctlabs, tmp_path, quick):
        """Everything is checked before the first lab is run."""
        assert ctlabs("run", "7", "99") == 2
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("place", ["file", "file/below", "/proc/ctlabs", "/proc/self/ctlabs/below"])
    def test_an_output_folder_that_cannot_be_written_is_refused_at_once(self, ctlabs, tmp_path, monkeypatch, place):
        """Before anything is computed, naming the folder and the system's reason."""
        if place.startswith("/proc") and not Path("/proc/self").exists():
            pytest.skip("this system has no /proc, a folder that nobody can write")
        (tmp_path / "file").write_text("mine", encoding="utf-8")
        monkeypatch.setattr(labs, "run", lambda *_arguments: pytest.fail("the lab was run"))
        assert ctlabs("run", "7", "--out", place) == 2
        assert re.fullmatch(
            rf"ctlabs: --out {place}: expected a folder that can be written, received: .+\n", ctlabs.err
        )
        assert files(tmp_path) == {"file": b"mine"}

    def test_a_file_where_the_report_should_go_is_refused_at_once(self, ctlabs, tmp_path, monkeypatch):
        """Somebody's file is not replaced by a folder."""
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "task07").write_text("mine", encoding="utf-8")
        monkeypatch.setattr(labs, "run", lambda *_arguments: pytest.fail("the lab was run"))
        assert ctlabs("run", "7", "--out", "out") == 2
        assert ctlabs.err == "ctlabs: --out out: expected a folder out/task07 or none, received a file\n".replace(
            "/", os.sep
        )
        assert files(tmp_path) == {"out/task07": b"mine"}

    def test_a_refused_command_leaves_the_reports_alone(self, ctlabs, tmp_path, quick):
        """A mistake after a good run changes nothing."""
        assert ctlabs("run", "7") == 0
        before = files(tmp_path)
        assert ctlabs("run", "7", "--set", "Q=-1") == 2
        assert files(tmp_path) == before

    def test_the_process_ends_like_the_function(self, tmp_path):
        """A shell sees exit code 2, one line on stderr, no traceback."""
        done = subprocess.run(
            [sys.executable, "-W", "error", "-m", "ctlabs", "run", "7", "--set", "Phi=x"],
            cwd=tmp_path, capture_output=True, text=True, encoding="utf-8", check=False,
        )  # fmt: skip
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == 'ctlabs: task07: Phi: expected a number, received "x"\n'


class TestRun:
    def test_passed_checks_are_exit_0(self, ctlabs, tmp_path, quick):
        """A line per lab says how it went and where the report is."""
        assert ctlabs("run", "7") == 0
        assert re.fullmatch(r"task07 +all 1 checks passed, \d+\.\d s: reports.task07.report\.html\n", ctlabs.out)
        assert ctlabs.err == ""
        assert {*INDEX, "task07"} == {path.name for path in (tmp_path / "reports").iterdir()}

    def test_a_failed_check_is_exit_1_and_named(self, ctlabs, tmp_path, quick):
        """The report is written, the check that failed is named on stderr, in the report and in the index."""
        quick(right=True, wrong=False, worse=False)
        assert ctlabs("run", "7", "--out", "out") == 1
        assert "2 of 3 checks failed" in ctlabs.out
        assert [line.strip() for line in ctlabs.err.splitlines()] == ["failed: wrong", "failed: worse"]
        for name in ("task07/report.md", "task07/report.html", "README.md", "index.html"):
            assert "wrong; worse" in (tmp_path / "out" / name).read_text(encoding="utf-8")

    def test_a_lab_without_checks_has_not_passed(self, ctlabs, quick):
        """Nothing checked is no success."""
        quick()
        assert ctlabs("run", "7") == 1
        assert "no checks" in ctlabs.out

    def test_an_interrupt_is_exit_130_and_leaves_the_previous_report(self, ctlabs, tmp_path, quick, monkeypatch):
        """Ctrl-C while a lab is computed or written."""
        assert ctlabs("run", "7") == 0
        before = files(tmp_path)

        def interrupted(*_arguments):
            raise KeyboardInterrupt

        for place in ("ctlabs.labs.catalogue.run", "ctlabs.reporting.render.markdown", "ctlabs.reporting.render.swap"):
            with monkeypatch.context() as patch:
                patch.setattr(place, interrupted)
                assert ctlabs("run", "7", "--seed", "2") == 130
            assert ctlabs.err.strip() == "ctlabs: interrupted; the reports that stood there are whole"
            assert files(tmp_path) == before
        assert ctlabs("run", "7", "--seed", "2") == 0
        assert files(tmp_path) != before

    @pytest.mark.parametrize(
        "error", [OverflowError(34, "Numerical result out of range"), FloatingPointError("an overflow at step 3")]
    )
    def test_an_overflow_is_the_parameters_fault(self, ctlabs, tmp_path, monkeypatch, error):
        """Numbers that are allowed one by one may still leave the range of double precision: one line, exit 2."""
        monkeypatch.setattr(labs, "load", lambda lab: SimpleNamespace(Parameters=PARAMETERS, report=fails(error)))
        assert ctlabs("run", "7", "--out", "out") == 2
        assert ctlabs.err == (
            "ctlabs: task07: expected parameters for which all numbers stay finite, "
            f"received an overflow: {error.args[-1]}\n"
        )
        assert files(tmp_path) == {}

    def test_a_mistake_of_the_lab_is_not_the_users(self, ctlabs, tmp_path, monkeypatch):
        """Any other exception is a defect, shown with its traceback."""
        monkeypatch.setattr(
            labs, "load", lambda lab: SimpleNamespace(Parameters=PARAMETERS, report=fails(KeyError("gain")))
        )
        with pytest.raises(KeyError):
            cli.main(["run", "7", "--out", "out"])
        assert files(tmp_path) == {}

    def test_settings_runs_and_seed_reach_the_lab(self, ctlabs, tmp_path, quick):
        """What was typed stands in results.json."""
        assert (
            ctlabs("run", "07", "--set", "Phi=1.3", "--set", "task07.lambdas=[0.5, 1]", "--runs", "17", "--seed", "0")
            == 0
        )
        stored = json.loads((tmp_path / "reports/task07/results.json").read_text(encoding="utf-8"))
        assert (stored["runs"], stored["seed"]) == (17, 0)
        assert (stored["parameters"]["Phi"], stored["parameters"]["lambdas"]) == (1.3, [0.5, 1.0])

    def test_the_defaults_are_the_labs_own_runs_and_seed_1(self, ctlabs, tmp_path, quick):
        """Without options the report is the one in the repository."""
        assert ctlabs("run", "7") == 0
        stored = json.loads((tmp_path / "reports/task07/results.json").read_text(encoding="utf-8"))
        assert (stored["runs"], stored["seed"]) == (TASK07.runs, 1)

    def test_every_lab_runs_once(self, ctlabs, quick):
        """However often it is named."""
        assert ctlabs("run", "7", "task07", "07", "--workers", "1") == 0
        assert ctlabs.out.count("\n") == 1

    def test_all_writes_an_index_of_all(self, ctlabs, tmp_path, quick):
        """A folder per lab and two pages that link them."""
        assert ctlabs("run", "all", "--workers", "1") == 0
        names = {path.name for path in (tmp_path / "reports").iterdir()}
        assert names == {*labs.catalogue(), *INDEX}

    def test_a_real_run_writes_a_whole_report(self, once):
        """Lab 7, with few runs: text, page, results, and every figure that the text shows."""
        folder = once / "task07"
        text = (folder / "report.md").read_text(encoding="utf-8")
        shown = set(re.findall(r"\]\((figures/\w+\.png)\)", text))
        assert shown == {name for name in files(folder) if name.startswith("figures/")}
        assert {"report.html", "results.json"} <= set(files(folder))
        assert json.loads((folder / "results.json").read_text(encoding="utf-8"))["runs"] == 20

    @pytest.mark.slow
    def test_several_processes_write_the_same_files_as_one(self, once, tmp_path):
        """The number of workers changes no byte of a report, nor the order of the summary."""
        values = labs.parameters([TASK07], {})["task07"]
        jobs = [(TASK07, values, Experiment(20, 3), tmp_path / place) for place in ("first", "second")]
        done = list(cli.labs.run_all(jobs, together=2))
        assert [summary["failed"] for summary in done] == [[], []]
        for place in ("first", "second"):
            assert files(tmp_path / place / "task07") == files(once / "task07")

    def test_one_lab_gives_the_same_files_with_any_number_of_workers(self, ctlabs, once, tmp_path):
        """Blocks of runs are added up in one order, whoever computed them."""
        assert ctlabs("run", "7", "--runs", "20", "--seed", "3", "--workers", "2", "--out", "two") == 0
        assert files(tmp_path / "two" / "task07") == files(once / "task07")


class TestHelp:
    def test_without_a_command_the_help_is_shown(self, ctlabs):
        """The first thing that a student types."""
        assert ctlabs() == 0
        bare = ctlabs.out
        assert ctlabs("--help") == 0
        assert ctlabs.out == bare
        assert all(word in bare for word in ("list", "show", "run", "ctlabs run 7", "verified report"))

    @pytest.mark.parametrize(
        ("command", "words"),
        [
            (
                "run",
                [
                    "ctlabs run 7",
                    "--set NAME=VALUE",
                    "--runs",
                    "--seed",
                    "--workers",
                    "--out",
                    "variant-a",
                    "inf",
                    "[default: 1]",
                ],
            ),
            ("show", ["LAB", "07", "parameters"]),
            ("list", ["variants"]),
        ],
    )
    @pytest.mark.parametrize("option", ["--help", "-h"])
    def test_every_command_teaches_its_use(self, ctlabs, command, words, option):
        """Examples, options, defaults."""
        assert ctlabs(command, option) == 0
        assert ctlabs.err == ""
        assert [word for word in words if word not in ctlabs.out] == []

    def test_list_shows_labs_and_variants(self, ctlabs):
        """Every lab with what a person types, and the practicum's three variants."""
        assert ctlabs("list") == 0
        for lab in labs.catalogue().values():
            assert re.search(rf"^ *{lab.short}  {re.escape(lab.title)} ", ctlabs.out, re.MULTILINE)
            assert lab.extension == bool(re.search(rf"^ *{lab.short}  .*\(extension\)$", ctlabs.out, re.MULTILINE))
        assert re.search(r"variant-a  1  2\*  5  7\*", ctlabs.out)

    @pytest.mark.parametrize("word", ["7", "task07"])
    def test_show_tells_question_parts_and_parameters(self, ctlabs, word):
        """The script's docstring, its letters, and each parameter with default, unit and meaning."""
        assert ctlabs("show", word) == 0
        assert ctlabs.out.startswith(f"task07: {TASK07.title}\n{TASK07.source}\n")
        assert f"Parts: {', '.join(TASK07.parts)}\n" in ctlabs.out
        module = labs.load(TASK07)
        assert module.__doc__.strip() in ctlabs.out
        for name, info in module.Parameters.model_fields.items():
            line = next(line for line in ctlabs.out.splitlines() if re.match(rf" +{name} = ", line))
            assert info.description in line
            assert info.json_schema_extra["unit"] in line
        assert re.search(r"^ +Phi = 0\.78 ", ctlabs.out, re.MULTILINE)

    def test_version(self, ctlabs):
        """One line with the package's version."""
        assert ctlabs("--version") == 0
        assert re.fullmatch(r"ctlabs, version \d+\.\d+\.\d+\n", ctlabs.out)


class TestProgress:
    class Terminal:
        """A stderr that is a terminal."""

        def __init__(self) -> None:
            self.text = ""

        def isatty(self) -> bool:
            return True

        def write(self, text: str) -> int:
            self.text += text
            return len(text)

        def flush(self) -> None:
            pass

    def test_a_bar_on_a_terminal_while_several_labs_run(self, monkeypatch):
        """It counts labs and passes their summaries on."""
        terminal = self.Terminal()
        monkeypatch.setattr(sys, "stderr", terminal)
        assert list(cli.labs.progressing(iter([{"lab": "a"}, {"lab": "b"}]), 2)) == [{"lab": "a"}, {"lab": "b"}]
        assert "/2" in terminal.text

    @pytest.mark.parametrize("total", [1, 2])
    def test_nothing_elsewhere(self, capsys, total):
        """In a file or a pipe there is no bar."""
        assert len(list(cli.labs.progressing(iter([{}] * total), total))) == total
        assert capsys.readouterr().err == ""
