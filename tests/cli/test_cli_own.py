"""The commands on one's own model and data: files, exit codes, pipes, refusals, and nothing half-written."""

import csv
import io
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ctlabs import cli
from ctlabs.files import modelfile
from ctlabs.reporting import render
from ctlabs.studies import filtering, forecasting
from tests.cli.test_cli import Console, files
from tests.nile import FLOW
from tests.reference import PNG
from tests.studies.test_studies import GAPS, NILE


@pytest.fixture
def ctlabs(capsys, tmp_path, monkeypatch) -> Console:
    """The command, in a folder with a model and a record."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nile.toml").write_text(NILE, encoding="utf-8")
    (tmp_path / "flow.csv").write_text(table(FLOW), encoding="utf-8")
    return Console(capsys)


@pytest.fixture
def plain(monkeypatch):
    """Figures that cost nothing: their pixels are not what is tested here."""
    monkeypatch.setattr(render, "png", lambda _figure: PNG)


def table(values) -> str:
    """One column of numbers, as a person writes them."""
    return "flow\n" + "\n".join("NA" if x != x else f"{x:g}" for x in values) + "\n"


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


class TestFiles:
    def test_the_nile_from_two_files_to_a_report(self, ctlabs, tmp_path):
        """A folder named after the model, with figures, a page, estimates and results; a table on the terminal."""
        assert ctlabs("filter", "nile.toml", "flow.csv", "--smooth") == 0
        assert ctlabs.err == ""
        written = set(files(tmp_path / "nile"))
        assert {"report.html", "report.md", "results.json", "estimates.csv", "figures/estimates_1.png"} <= written
        found = results(tmp_path / "nile")
        assert (found["schema"], found["lab"], found["parameters"]["q"]) == (1, "filter", 1469.1)
        assert round(found["values"]["log_likelihood"]["value"], 4) == -641.5856
        assert set(found["values"]) >= {"log_likelihood", "nis_mean", "nis_band", "steps", "missing", "verdict"}
        assert all(check["passed"] for check in found["checks"])
        rows = list(csv.DictReader(io.StringIO((tmp_path / "nile/estimates.csv").read_text(encoding="utf-8"))))
        assert len(rows) == 100
        assert list(rows[0]) == [
            "k", "t", "level", "level_sd", "level_smoothed", "level_smoothed_sd",
            "predicted_flow", "predicted_sd_flow", "innovation_flow", "innovation_sd_flow",
        ]  # fmt: skip
        assert re.search(r"^log_likelihood +-641\.59$", ctlabs.out, re.MULTILINE)
        assert ctlabs.out.endswith(f"{Path('nile/report.html')}\n")
        page = (tmp_path / "nile/report.html").read_text(encoding="utf-8")
        assert "Flow of the Nile" in page
        assert "(a)" in page
        assert 'src="figures' not in page

    def test_missing_cells_are_empty_in_the_estimates(self, ctlabs, tmp_path, plain):
        """Their innovations; the estimates go on."""
        (tmp_path / "gaps.csv").write_text(table(GAPS).replace("NA", ""), encoding="utf-8")
        assert ctlabs("filter", "nile.toml", "gaps.csv", "--algorithm", "srif") == 0
        rows = list(csv.DictReader(io.StringIO((tmp_path / "nile/estimates.csv").read_text(encoding="utf-8"))))
        assert [k for k, row in enumerate(rows) if row["innovation_flow"] == ""] == list(range(20, 40))
        assert all(float(row["level_sd"]) > 0 for row in rows)
        assert results(tmp_path / "nile")["values"]["missing"]["value"] == 20

    def test_every_command_writes_its_folder(self, ctlabs, tmp_path, plain):
        """simulate, analyse, compare and fit; the tables that matter are on the terminal."""
        for command, shown in (
            (
                ["simulate", "nile.toml", "--runs", "50", "--steps", "10", "--seed", "3", "--csv", "2"],
                "its standard error",
            ),
            (["analyse", "nile.toml"], "gain on flow"),
            (["compare", "nile.toml", "--algorithms", "joseph,ud", "--steps", "5"], "exact to rounding"),
            (["fit", "nile.toml", "flow.csv", "--free", "q"], "standard error"),
        ):
            assert ctlabs(*command, "--out", command[0]) == 0
            assert shown in ctlabs.out
            found = results(tmp_path / command[0])
            assert found["lab"] == command[0]
            assert (tmp_path / command[0] / "report.html").is_file()
        assert (results(tmp_path / "simulate")["runs"], results(tmp_path / "simulate")["seed"]) == (50, 3)
        assert results(tmp_path / "simulate")["parameters"]["steps"] == 10
        assert [entry["name"] for entry in results(tmp_path / "compare")["algorithms"]] == ["joseph", "ud"]
        assert {"q", "q_se", "log_likelihood"} <= set(results(tmp_path / "fit")["values"])
        assert {"fitted.toml", "estimates.csv"} <= set(files(tmp_path / "fit"))
        assert {"runs.csv", "data.csv"} <= set(files(tmp_path / "simulate"))
        assert ctlabs("filter", "fit/fitted.toml", "simulate/data.csv", "--out", "again") == 0

    def test_the_same_numbers_give_the_same_bytes(self, ctlabs, tmp_path):
        """A report is a function of model, data and seed."""
        for out in ("one", "two"):
            assert ctlabs("simulate", "nile.toml", "--runs", "20", "--steps", "5", "--out", out) == 0
        assert files(tmp_path / "one") == files(tmp_path / "two")

    def test_constants_are_set_by_numbers_and_expressions(self, ctlabs, tmp_path, plain):
        """--set q=r/10 as in the file; every constant that follows, follows."""
        assert ctlabs("analyse", "nile.toml", "--set", "r=100", "--set", "q=r/10") == 0
        assert results(tmp_path / "nile")["parameters"]["q"] == 10.0

    @pytest.mark.parametrize("suffix", [".npz", ".mat", ".h"])
    def test_gains_are_exported(self, ctlabs, tmp_path, plain, suffix):
        """For NumPy, MATLAB and C; a file that is there is left alone."""
        target = tmp_path / f"gains{suffix}"
        assert ctlabs("filter", "nile.toml", "flow.csv", "--export", target.name) == 0
        content = target.read_bytes()
        if suffix == ".npz":
            P = (1469.1 + np.sqrt(1469.1**2 + 4 * 1469.1 * 15099)) / 2
            assert abs(np.load(target)["K"].item() - P / (P + 15099)) < 1e-8
        assert ctlabs("filter", "nile.toml", "flow.csv", "--export", target.name) == 2
        assert target.read_bytes() == content


class TestPipes:
    def test_json_on_the_standard_output(self, ctlabs, tmp_path, plain):
        """What stands in results.json and nothing else."""
        assert ctlabs("filter", "nile.toml", "flow.csv", "--json") == 0
        assert json.loads(ctlabs.out) == results(tmp_path / "nile")

    def test_a_dash_is_the_standard_input(self, ctlabs, tmp_path, plain, monkeypatch):
        """For the data or for the model, not for both."""
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(table(FLOW).encode())))
        assert ctlabs("filter", "nile.toml", "-") == 0
        assert results(tmp_path / "nile")["source"] == "ctlabs filter nile.toml stdin"
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(NILE.encode())))
        assert ctlabs("analyse", "-") == 0
        assert results(tmp_path / "model")["lab"] == "analyse"
        assert ctlabs("filter", "-", "-") == 2
        assert ctlabs.err == "ctlabs: -: expected the standard input for one of the files, received it for several\n"


class TestGallery:
    def test_models_lists_shows_and_copies(self, ctlabs, tmp_path, plain):
        """A name for every model; a copy is a file to edit, and is never overwritten."""
        assert ctlabs("models") == 0
        for entry in modelfile.gallery():
            assert re.search(rf"^{entry.name} +{re.escape(entry.title)}$", ctlabs.out, re.MULTILINE)
        assert ctlabs("models", "show", "oscillator") == 0
        shown = ctlabs.out
        assert ctlabs("models", "copy", "oscillator", "mine") == 0
        copied = tmp_path / "mine" / "oscillator.toml"
        assert copied.read_text(encoding="utf-8") == shown
        assert ctlabs("models", "copy", "oscillator", "mine") == 2
        assert copied.read_text(encoding="utf-8") == shown
        assert ctlabs("analyse", "local_level") == 0
        assert (tmp_path / "local_level" / "results.json").is_file()

    def test_an_unknown_name_is_refused_with_what_was_perhaps_meant(self, ctlabs, tmp_path):
        """For models and for the commands that take one."""
        for command in (["models", "copy", "osilator"], ["models", "show", "osilator"], ["analyse", "osilator"]):
            assert ctlabs(*command) == 2
            assert re.fullmatch(r'ctlabs: unknown model "osilator"; did you mean "oscillator".*\n', ctlabs.err)


#: A command that is refused, and the line that says why.
REFUSED = [
    (["filter", "nile.toml"], r"DATA\.csv: expected as in `ctlabs filter --help`, received none"),
    (["filter", "none.toml", "flow.csv"], r"none\.toml: expected a file that can be read, received: No such file.*"),
    (["filter", "nile.toml", "none.csv"], r"none\.csv: expected a file that can be read, received: No such file.*"),
    (["filter", "nile.toml", "nile.toml"], r"nile\.toml: line 1: expected the column flow, received .*"),
    (["filter", "nile.toml", "flow.csv", "--algorithm", "kalman"], r"algorithm: expected one of auto, .*, received 'kalman'"),
    (["filter", "nile.toml", "flow.csv", "--design", "none.toml"], r"none\.toml: expected a file .*"),
    (["filter", "nile.toml", "flow.csv", "--export", "gains.txt"], r"--export gains\.txt: expected a name that ends .*"),
    (["filter", "nile.toml", "flow.csv", "--export", "no/gains.h"], r"--export no.gains\.h: expected a new file in a folder .*"),
    (["filter", "nile.toml", "flow.csv", "--set", "q"], r"--set q: expected NAME=VALUE, received no name or no ="),
    (["filter", "nile.toml", "flow.csv", "--set", "p=1"], r'nile\.toml: constants: unknown name "p".*'),
    (["filter", "nile.toml", "flow.csv", "--set", "q=-1"], r"nile\.toml: model\.Qd.*: .*"),
    (["filter", "nile.toml", "flow.csv", "--set", "q=[1]"], r"nile\.toml: constants\.q: expected a number, received .*"),
    (["filter", "nile.toml", "flow.csv", "--set", "q=rr"], r'nile\.toml: constants\.q: unknown name "rr".*'),
    (["filter", "nile.toml", "flow.csv", "--dt", "0"], r"--dt: expected a period > 0, s, received 0\.0"),
    (["filter", "nile.toml", "flow.csv", "--dt", "-1"], r"--dt: expected a period > 0, s, received -1\.0"),
    (["simulate", "nile.toml", "--runs", "0"], r"--runs: expected a whole number >= 1, received 0"),
    (["filter", "nile.toml", "flow.csv", "--seed", "3"], r"--seed 3: expected --draws N beside it .*, received none; leave --seed out"),
    (["compare", "nile.toml", "flow.csv", "--seed", "3"], r"--seed 3: expected a record to simulate, received flow\.csv; .*"),
    (["simulate", "nile.toml", "--seed", "-1"], r"--seed: expected a whole number >= 0, received -1"),
    (["simulate", "nile.toml", "--design", "constant_velocity", "--runs", "5"], r"design: expected states among .*"),
    (["compare", "nile.toml", "--algorithms", "ud,x"], r"algorithm x: expected all or some of .*, received an unknown name"),
    (["fit", "nile.toml", "flow.csv"], r"nile\.toml: expected the constants to estimate, received none: --free \S+ takes all"),
    (["filter", "flow.csv", "local_level"], r"local_level: expected a table, .* first: ctlabs \S* ?local_level flow\.csv"),
    (["fit", "nile.toml", "flow.csv", "--free", "s"], r"--free s: expected one of q, r, received an unknown name"),
    (["analyse", "nile.toml", "--out", "."], r"--out \.: expected a folder of its own for the results, received the current one"),
    (["analyse", "nile.toml", "--out", "flow.csv"], r"--out flow\.csv: expected a folder or none, received a file"),
]  # fmt: skip


class TestRefusals:
    @pytest.mark.parametrize(("arguments", "line"), REFUSED, ids=[" ".join(words)[:60] for words, _line in REFUSED])
    def test_a_mistake_is_one_line_and_exit_2(self, ctlabs, tmp_path, arguments, line):
        """Nothing is written."""
        before = files(tmp_path)
        assert ctlabs(*arguments) == 2
        assert ctlabs.out == ""
        assert re.fullmatch(f"ctlabs: {line}\n", ctlabs.err), ctlabs.err
        assert files(tmp_path) == before
        assert sorted(path.name for path in tmp_path.iterdir()) == ["flow.csv", "nile.toml"]

    def test_a_folder_that_is_not_ours_is_left_alone(self, ctlabs, tmp_path, plain):
        """Results replace results, and say so; a folder with anything else in it is refused."""
        assert ctlabs("analyse", "nile.toml") == 0
        assert "replaces" not in ctlabs.out
        assert ctlabs("filter", "nile.toml", "flow.csv") == 0
        assert "(replaces the results that stood there)" in ctlabs.out
        (tmp_path / "nile" / "notes.txt").write_text("mine", encoding="utf-8")
        before = files(tmp_path)
        assert ctlabs("analyse", "nile.toml") == 2
        assert re.search(r"--out nile: expected .*, received one with other files \(notes\.txt\)", ctlabs.err)
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "report.md").write_text("mine", encoding="utf-8")
        assert ctlabs("analyse", "nile.toml", "--out", "mine") == 2
        (tmp_path / "mine" / "report.md").unlink()
        assert files(tmp_path) == before
        assert ctlabs("analyse", "nile.toml", "--out", "mine") == 0

    def test_results_never_replace_what_they_are_computed_from(self, ctlabs, tmp_path, plain):
        """Simulated data stand in the model's own folder, where the filter's results would go."""
        assert ctlabs("simulate", "nile.toml", "--runs", "20", "--csv", "1") == 0
        before = files(tmp_path)
        for command in (["filter"], ["fit", "--free", "q"], ["compare"]):
            assert ctlabs(*command, "nile.toml", "nile/data.csv") == 2
            assert re.fullmatch(r"ctlabs: --out nile: expected .*, received the one with data\.csv: .*\n", ctlabs.err)
        assert ctlabs("filter", "nile.toml", "flow.csv", "--export", "nile/gains.h") == 2
        assert ctlabs.err.startswith("ctlabs: --export nile/gains.h: expected a file outside the folder of the results")
        assert files(tmp_path) == before
        assert ctlabs("filter", "nile.toml", "nile/data.csv", "--out", "other") == 0

    def test_a_replaced_folder_is_told_beside_json_too(self, ctlabs, plain):
        """On the standard error, as the standard output holds JSON alone."""
        assert ctlabs("filter", "nile.toml", "flow.csv", "--json") == 0
        assert ctlabs.err == ""
        assert ctlabs("filter", "nile.toml", "flow.csv", "--json") == 0
        assert ctlabs.err == f"{Path('nile/report.html')} (replaces the results that stood there)\n"

    @pytest.mark.parametrize("arguments", [["-", "flow.csv"], ["nile.toml", "-"]])
    def test_a_closed_standard_input_is_refused(self, ctlabs, monkeypatch, arguments):
        """As a shell closes it with <&-."""
        monkeypatch.setattr(sys, "stdin", None)
        assert ctlabs("filter", *arguments) == 2
        assert re.fullmatch(r"ctlabs: stdin: expected .* on the standard input, received a closed one\n", ctlabs.err)

    @pytest.mark.parametrize(
        ("error", "line"),
        [
            (
                OSError(28, "No space left on device"),
                r"--out nile: expected a folder that can be written, received: No space .*",
            ),
            (MemoryError(), r"expected a task that fits into the memory, .*"),
        ],
    )
    def test_a_machine_that_is_full_is_told_in_one_line(self, ctlabs, tmp_path, monkeypatch, error, line):
        """The disk while the report is written, or the memory; nothing is left behind."""

        def full(*_arguments):
            raise error

        monkeypatch.setattr(render, "_fill", full)
        assert ctlabs("filter", "nile.toml", "flow.csv") == 2
        assert re.fullmatch(f"ctlabs: {line}\n", ctlabs.err)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["flow.csv", "nile.toml"]

    def test_an_interrupt_leaves_the_previous_results(self, ctlabs, tmp_path, plain, monkeypatch):
        """Ctrl-C while a report is computed or written."""
        assert ctlabs("analyse", "nile.toml") == 0
        before = files(tmp_path)

        def interrupted(*_arguments):
            raise KeyboardInterrupt

        for place in (
            "ctlabs.filtering.steady.solve",
            "ctlabs.reporting.render.markdown",
            "ctlabs.reporting.render.swap",
        ):
            with monkeypatch.context() as patch:
                patch.setattr(place, interrupted)
                assert ctlabs("analyse", "nile.toml", "--set", "q=1") == 130
            assert files(tmp_path) == before

    def test_a_failed_check_is_exit_1_and_named(self, ctlabs, tmp_path, plain, monkeypatch):
        """Here the two routes to the estimates are torn apart by 5 % in the data of one."""
        right = filtering.kalman_filter

        def torn(model, z, **more):
            return right(model, 1.05 * z if more.get("algorithm") == "ud" else z, **more)

        monkeypatch.setattr(filtering, "kalman_filter", torn)
        assert ctlabs("filter", "nile.toml", "flow.csv") == 1
        assert ctlabs.err == "failed: estimates\n"
        assert (tmp_path / "nile" / "report.html").is_file()


class TestHelp:
    @pytest.mark.parametrize(
        ("command", "words"),
        [
            ("filter", ["--smooth", "--design", "--algorithm", "--export", "--json", "--set", "--out", "nile.toml flow.csv", "empty cell"]),
            ("simulate", ["--runs", "--seed", "--steps", "--workers", "--csv", "--design"]),
            ("analyse", ["--set", "--out", "Observability"]),
            ("compare", ["--algorithms", "--sweep", "delta=1e-6", "50 digits"]),
            ("fit", ["--free", "maximum likelihood"]),
            ("models", ["copy", "show", "simulate local_level"]),
        ],
    )  # fmt: skip
    def test_every_command_teaches_its_use(self, ctlabs, command, words):
        """Examples, options, defaults."""
        assert ctlabs(command, "--help") == 0
        assert [word for word in words if word not in ctlabs.out] == []
        assert re.search(rf"^ +.*ctlabs {command} ", ctlabs.out, re.MULTILINE)

    def test_the_help_names_all_commands(self, ctlabs):
        """In the group's list."""
        assert ctlabs("--help") == 0
        assert all(re.search(rf"^  {name} ", ctlabs.out, re.MULTILINE) for name in cli.cli.commands)

    def test_listing_stays_light(self):
        """`ctlabs list` and the help load no numerical library."""
        import subprocess

        code = (
            "import sys; from ctlabs.cli import cli; from ctlabs.labs.catalogue import catalogue; catalogue(); print(*sys.modules)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert (
            set(done.stdout.split()) & {"numpy", "scipy", "matplotlib", "pydantic", "numba", "ctlabs.files.modelfile"}
            == set()
        )


def test_a_word_on_a_terminal_while_it_works_and_nothing_left_of_it(ctlabs, plain, monkeypatch):
    """In a pipe there is none."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert ctlabs("analyse", "nile.toml") == 0
    shown = terminal.getvalue()
    assert "computing" in shown
    assert shown.endswith("\r\x1b[K")


class TestSeveral:
    """Options that are about one record are refused beside several, not answered for the first."""

    @pytest.mark.parametrize("option", [["--gate", "5"], ["--draws", "9"], ["--reach", "level=9"], ["--seed", "0"], ["--export", "g.npz"]])
    def test_what_is_about_one_record(self, option, ctlabs, tmp_path):
        """The option is named, and nothing is written."""
        (tmp_path / "second.csv").write_text(table(FLOW[:20]), encoding="utf-8")
        assert ctlabs("filter", "nile.toml", "flow.csv", "second.csv", *option) == 2
        assert f"{option[0]}: expected one record, received 2" in ctlabs.err
        assert not (tmp_path / "nile").exists()
        assert not (tmp_path / "g.npz").exists()


def test_a_column_that_h_names_is_met_below_what_the_file_says_to_skip(ctlabs, tmp_path, plain):
    """The header is read as the model file's table [data] says: its encoding, and the lines above it."""
    text = NILE.replace("H = [[1]]", 'H = [["Größe"]]') + '\n[data]\nskip = 2\nencoding = "cp1252"\n'
    (tmp_path / "sized.toml").write_text(text, encoding="utf-8")
    rows = "\n".join(f"{value},1" for value in FLOW)
    (tmp_path / "sized.csv").write_bytes(f"a,b,c\nd,e,f\nflow,Größe\n{rows}\n".encode("cp1252"))
    assert ctlabs("filter", "sized.toml", "sized.csv") == 0, ctlabs.err
    assert "Größe in the model: the column of sized.csv of that name" in ctlabs.err


def test_the_help_of_forecast_tells_how_many_instants():
    """The number is that of the study."""
    option = next(one for one in cli.cli.commands["forecast"].params if one.name == "steps")
    assert f"default: {forecasting.STEPS};" in option.help
