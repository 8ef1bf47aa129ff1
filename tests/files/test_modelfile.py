"""Model files: what they say, what is wrong with them, and what a change leaves alone."""

import io
import math
import pickle
import re
import time
import tomllib
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from ctlabs.files.modelfile import ModelFileError, copy, from_model, gallery, load, loads, new, ready
from ctlabs.files.modelfile.checks import SHAPES, TEXTS
from ctlabs.files.modelfile.errors import Problem, place, shown
from ctlabs.files.modelfile.expressions import CONSTANTS, DEPTH, DIGITS, FUNCTIONS, LENGTH
from ctlabs.files.modelfile.schema import (
    LARGEST,
    SECTIONS,
    ConstantTable,
    CostTable,
    Data,
    Document,
    ExperimentTable,
    OutputTable,
)
from ctlabs.models import ContinuousModel, DiscreteModel
from tests.strategies import continuous_models, discrete_models

TEXT = '''# A file as a person types it.
format = 1
title = "Tracking along a line"
kind = "continuous"                       # or "discrete"
[constants]
sigma_w2 = 0.01   # the strength
tau = "1/2"
r={value=4,min = 0,  max=100, unit = "m²"}  # a slider
[model]
states = ["x", "v"]
units = ["m", "m/s"]
measurements = ["position"]
measurement_units = ['m']
F = [ ["0", "1"],   # dx/dt = v

      ["0", 0.0 ] ] # end
G = [["0"], ["1"]]
Q = [["sigma_w2"]]
H = [["1", "0"]]
R = [[
  "r*tau"   # covariance
]]
x0 = [0, 0,]
P0 = [["100", "0"], ["0", "10"]]
dt = "tau"

[experiment]   # optional
steps = 50
algorithms = ["joseph", "ud"]
'''  # fmt: skip
DISCRETE = """format = 1
kind = "discrete"
[constants]
q = 0.39
[model]
Phi = [["0.78"]]
Qd = [["q"]]
H = [[1]]
R = [["0.5"]]
P0 = [[1]]
dt = 0.5
"""
VARIED = {"continuous": TEXT, "discrete": DISCRETE}


def changed(text: str, *pairs: tuple[str, str]) -> str:
    """The text with each first word, which it must hold, replaced by the second."""
    for old, fresh in pairs:
        assert old in text, old
        text = text.replace(old, fresh)
    return text


# --- what a file says ---------------------------------------------------------------------------------------------------


def test_a_file_says_what_it_says():
    """Names, units, constants, settings."""
    file = loads(TEXT, "line.toml")
    assert (file.title, file.kind) == ("Tracking along a line", "continuous")
    assert file.constants == {"sigma_w2": 0.01, "tau": 0.5, "r": 4.0}
    assert (file.states, file.units) == (("x", "v"), ("m", "m/s"))
    assert (file.measurements, file.measurement_units) == (("position",), ("m",))
    assert (file.n, file.s, file.m, file.dt) == (2, 1, 1, 0.5)
    assert file.experiment == (0.0, 1, 50, 1000, 1, ("joseph", "ud"))
    assert file.problems() == []
    assert file.varying == ()
    slider = file.definitions[2]
    assert (slider.name, slider.value, slider.expression, slider.min, slider.max, slider.unit) == (
        "r",
        4,
        "4",
        0,
        100,
        "m²",
    )
    assert file.definitions[1].expression == "1/2"
    assert file.latex("R") == r"r\,\tau"
    assert file.latex("F") == r"\begin{bmatrix} 0 & 1 \\ 0 & 0 \end{bmatrix}"
    assert file.latex("x0") == r"\begin{bmatrix} 0 \\ 0 \end{bmatrix}"
    assert file.latex("dt") == r"\tau"
    assert np.array_equal(file.matrix("R"), [[2]])


def test_everything_that_may_be_left_out_has_a_default():
    """The shortest file."""
    file = loads(DISCRETE, "scalar.toml")
    assert file.title == "scalar"
    assert (file.states, file.units, file.measurements, file.measurement_units) == (("x1",), ("",), ("z1",), ("",))
    assert file.experiment == (0.0, 1, 200, 1000, 1, ("joseph",))
    assert (file.s, file.description, file.source) == (0, "", "")
    assert np.array_equal(file.discrete().x0, [0])


def test_a_continuous_file_is_its_models():
    """continuous() has the matrices of the file, discrete() those of the library's discretisation."""
    file = loads(TEXT)
    model = file.continuous()
    assert np.array_equal(model.F, [[0, 1], [0, 0]])
    assert np.array_equal(model.G @ model.Q @ model.G.T, [[0, 0], [0, 0.01]])
    assert np.array_equal(model.P0, np.diag([100, 10]))
    assert model.states == ("x", "v")
    assert model.Rc is None
    sampled = file.discrete()
    assert np.array_equal(sampled.Phi, [[1, 0.5], [0, 1]])
    assert np.array_equal(sampled.R, [[2]])
    assert np.allclose(sampled.Qd, 0.01 * np.array([[0.5**3 / 3, 0.5**2 / 2], [0.5**2 / 2, 0.5]]), rtol=1e-14)


def test_the_tables_of_keys_agree():
    """Every matrix of the schema has a shape, and every shape a matrix."""
    for kind, section in SECTIONS.items():
        assert set(section.model_fields) == {*SHAPES[kind], "dt"}


# --- problems -----------------------------------------------------------------------------------------------------------

WRONG = [
    (('"1", "0"]]', '"1", "omga"]]'), 'model.H[0][1]: unknown name "omga"'),
    (('"sigma_w2"', '"sigma_v2"'), 'model.Q[0][0]: unknown name "sigma_v2"; did you mean "sigma_w2"?'),
    (('"sigma_w2"', '"sigma_w2*(1"'), 'model.Q[0][0]: column 12: expected ")" for the "(" in column 10, received the end'),
    (('"sigma_w2"', "true"), "model.Q[0][0]: expected a number or an expression in quotes, received true"),
    (('"sigma_w2"', "2024-01-01"), 'model.Q[0][0]: expected a number or an expression in quotes, received "2024-01-01"'),
    (('"sigma_w2"', "nan"), "model.Q[0][0]: expected a number, received nan"),
    (('"sigma_w2"', '"1/(tau - 0.5)"'), "model.Q[0][0]: column 2: division by zero"),
    (('"sigma_w2"', "-1"), "model.Q: expected variances >= 0 on the diagonal, received -1"),
    (('"sigma_w2"', "inf"), "model.Q: expected finite numbers, received inf at [0, 0]"),
    (('"sigma_w2"', '"k"'), 'model.Q[0][0]: expected a constant value, received "k", the index of the step, which may not stand here'),
    (('["0", "10"]]', '["1", "10"]]'), "model.P0: expected a symmetric matrix, received one with asymmetry 1"),
    (('["100", "0"], ["0", "10"]]', '["1", "2"], ["2", "1"]]'), "model.P0: expected a nonnegative definite matrix"),
    (('["100", "0"]', '["t", "0"]'), 'model.P0[0][0]: expected a constant value, received "t", the time, which may not stand here'),
    (('H = [["1", "0"]]', 'H = [["1", "0", "0"]]'), "model.H: expected 2 columns (one per state), received 3"),
    (('["0", "1"],', '["0", "1", "2"],'), "model.F[0]: expected 2 columns (one per state), received 3"),
    (('["0", 0.0 ] ]', '["0", 0.0 ], [0, 0] ]'), "model.F: expected 2 rows (one per state), received 3"),
    (('G = [["0"], ["1"]]', 'G = [["0"]]'), "model.G: expected 2 rows (one per state), received 1"),
    (('G = [["0"], ["1"]]', 'G = [["0", 1], ["1", 0]]'), "model.G: expected 1 column (one per noise), received 2"),
    (('Q = [["sigma_w2"]]', "Q = []"), "model.Q: expected from 1 to 200 (one per noise), received 0"),
    (('["position"]', '["position", "b"]'), "model.measurement_units: expected 2 texts (one per measurement), received 1"),
    (("x0 = [0, 0,]", "x0 = [0]"), "model.x0: expected 2 numbers (one per state), received 1"),
    (("x0 = [0, 0,]", "x0 = 0"), "model.x0: expected a list of numbers or expressions, received 0"),
    (('H = [["1", "0"]]', 'H = ["1", "0"]'), 'model.H[0]: expected a row, a list of numbers or expressions, received "1"'),
    (('H = [["1", "0"]]', "H = 1"), "model.H: expected a list of rows, each a list of numbers or expressions, received 1"),
    (('states = ["x", "v"]', 'states = ["x", 1]'), "model.states[1]: expected a text in quotes, received 1"),
    (('states = ["x", "v"]', 'states = ["x", "x"]'), 'model.states: expected names that differ, received "x" twice'),
    (('states = ["x", "v"]', 'states = ["x", " "]'), 'model.states[1]: expected a name, received " "'),
    (('states = ["x", "v"]', 'states = ["x", "v\\n"]'), 'model.states[1]: expected one line of at most 100 characters, received "v\\n"'),
    (('states = ["x", "v"]', 'states = "x"'), 'model.states: expected a list of texts in quotes, received "x"'),
    (("G = [[", "g = [["), 'model: unknown key "g"; did you mean "G"?'),
    (('H = [["1", "0"]]', ""), "model.H: expected the matrix H of z = H x + v, received none"),
    (('dt = "tau"', ""), "model.dt: expected the period dt, s, received none"),
    (('dt = "tau"', "dt = 0"), "model.dt: expected a period > 0, s, received 0"),
    (('dt = "tau"', 'dt = "inf"'), "model.dt: expected a period > 0, s, received inf"),
    (('dt = "tau"', "dt = 1e-200"), "model.dt: expected a period from 1e-150 to 1e+150 s, received 1e-200"),
    (("sigma_w2 = 0.01", "sigma_w2 = 1e-200"), "model.Q: expected variances of 0 or from 1e-150 on, received 1e-200"),
    (('dt = "tau"', 'dt = "tau"\nRc = [[1]]'), "model.R: expected R (covariance of a sampled measurement) or Rc"),
    (("R = [[", "Rc = [["), None),
    (('dt = "tau"', 'dt = "tau"\nu = [1]'), "model.B: expected the matrix B by which the known input u enters, received none"),
    (('dt = "tau"', 'dt = "tau"\nN = [[1]]'), "model.N: expected Rc beside N (the noise that w correlates with), received R"),
    (('dt = "tau"', 'dt = "tau"\nPhi = [[1]]'), 'model: unknown key "Phi" in a continuous model; of the two kinds, this one has F G Q Rc'),
    (('"continuous"', '"continous"'), 'kind: expected "continuous" or "discrete", received "continous"'),
    (("format = 1", "format = 2"), "format: expected 1, the version this program reads, received 2"),
    (("format = 1", ""), "format: expected format = 1, the version of the file, received none"),
    (("title = ", "titel = "), 'unknown key "titel"; did you mean "title"?'),
    (('title = "Tracking along a line"', "title = 3"), "title: expected a text in quotes, received 3"),
    (('tau = "1/2"', 'tau = "2*tau"'), "constants: expected no constants that need each other, received tau -> tau"),
    (("sigma_w2 = 0.01", 'sigma_w2 = "tua"'), 'constants.sigma_w2: unknown name "tua"; did you mean "tau"?'),
    (("sigma_w2 = 0.01", 'sigma_w2 = "t"'), 'constants.sigma_w2: expected a constant value, received "t"'),
    (("sigma_w2 = 0.01", "sigma_w2 = [1]"), "constants.sigma_w2: expected a number or an expression in quotes, received [1]"),
    (("sigma_w2 = 0.01", "sigma_w2 = 0.01\npi = 3"), 'constants.pi: expected a name of its own, received "pi" (known already)'),
    (("sigma_w2 = 0.01", "sigma_w2 = 0.01\nk = 3"), 'constants.k: expected a name of its own, received "k" (the index of the step)'),
    (("sigma_w2 = 0.01", "sigma_w2 = 0.01\nq-1 = 3"), "constants.q-1: expected a name of letters, digits and _"),
    (("value=4", "value=400"), "constants.r: expected a value from 0 to 100, received 400"),
    (("min = 0", "min = 500"), "constants.r: expected min <= max, received min = 500, max = 100"),
    (("min = 0", 'min = "1/0"'), "constants.r.min: column 2: division by zero"),
    (("value=4", "valu=4"), 'constants.r: unknown key "valu"; did you mean "value"?'),
    (("steps = 50", "steps = 0"), "experiment.steps: expected a whole number from 1 to 10000000, received 0"),
    (("steps = 50", "steps = 2.5"), "experiment.steps: expected a whole number from 1 to 10000000, received 2.5"),
    (("steps = 50", "first = 2"), "experiment.first: expected a whole number from 0 to 1, received 2"),
    (("steps = 50", "stesp = 50"), 'experiment: unknown key "stesp"; did you mean "steps"?'),
    (("steps = 50", 't0 = "1/0"'), "experiment.t0: column 2: division by zero"),
    (("steps = 50", "t0 = inf"), "experiment.t0: expected a finite time, s, received inf"),
    (('"ud"', '"udd"'), 'experiment.algorithms[1]: unknown algorithm "udd"; did you mean "ud"'),
    (('["joseph", "ud"]', "[]"), "experiment.algorithms: expected at least one algorithm, received none"),
    (("[experiment]   # optional", "[experiments]"), 'unknown key "experiments"; did you mean "experiment"?'),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), WRONG, ids=[str(message)[:60] for _, message in WRONG])
def test_problems_are_told_in_one_line_with_their_place(change, message):
    """Where, what was expected, what was received; a file without the mistake has no problem."""
    text = changed(TEXT, change)
    if message is None:
        assert loads(text).problems() == []
        return
    with pytest.raises(ModelFileError) as caught:
        loads(text, "ship.toml")
    assert str(caught.value).startswith(f"ship.toml: {message}")
    assert str(caught.value).isprintable()
    assert caught.value.where == caught.value.problem.where
    assert str(loads(text, check=False).problems()[0]).startswith(message)


def test_all_problems_are_told_at_once():
    """One of every kind: cells that are no expressions hide neither unknown names nor other matrices' faults."""
    text = changed(
        TEXT,
        ('"sigma_w2"', '"2*("'),
        ('"1", "0"]]', '"1", "omga"]]'),
        ('["0", "10"]]', '["0", -10]]'),
        ('"1/2"', '"1/"'),
    )
    found = {p.where: p.message for p in loads(text, check=False).problems()}
    assert set(found) == {"model.Q[0][0]", "constants.tau", "model.H[0][1]", "model.P0"}
    two = changed(TEXT, ("steps = 50", "step = 50"), ("x0 = [0, 0,]", "x0 = [0, true]"))
    assert {p.where for p in loads(two, check=False).problems()} == {"experiment", "model.x0[1]"}


def test_a_wrong_constant_is_not_repeated_where_it_is_used():
    """r is told once, not again for R and dt."""
    text = changed(TEXT, ('tau = "1/2"', 'tau = "1/0"'))
    assert [p.where for p in loads(text, check=False).problems()] == ["constants.tau"]


def test_reading_a_file_with_problems_raises_the_first():
    """Whatever is asked of it."""
    file = loads(changed(TEXT, ('"sigma_w2"', "-1")), "ship.toml", check=False)
    for ask in (
        lambda: file.states,
        lambda: file.constants,
        file.discrete,
        file.continuous,
        lambda: file.replace({}),
        file.checked,
    ):
        with pytest.raises(ModelFileError, match=r"ship.toml: model.Q: expected variances"):
            ask()
    assert "-1" in file.dumps()


def test_sizes_are_bounded():
    """A matrix of 201 states is refused before anything is computed; so are too many constants."""
    big = from_model(DiscreteModel(np.eye(3), np.eye(3), np.eye(3), np.eye(3), x0=np.zeros(3), P0=np.eye(3)))
    assert big.n == 3
    rows = ", ".join("[" + ", ".join(["0"] * (LARGEST + 1)) + "]" for _ in range(LARGEST + 1))
    with pytest.raises(ModelFileError, match=r"model.Phi: expected at most 200 rows or elements, received 201"):
        loads(changed(DISCRETE, ('[["0.78"]]', f"[{rows}]")))
    many = "\n".join(f"c{i} = 1" for i in range(1001))
    with pytest.raises(ModelFileError, match="constants: expected at most 1000 constants, received 1002"):
        loads(changed(DISCRETE, ("q = 0.39", f"q = 0.39\n{many}")))


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 300_000) + " = 1",
        'x."a' + '"."a' * 200_000 + '" = 1',
        "[" + "a." * 300_000 + "a]",
        'format = 1\nkind = "discrete"\n[model]\nPhi = [' + '["("],' * 150_000 + "]",
        'format = 1\nkind = "discrete"\n[model]\nPhi = [[' + '"(",' * 200_000 + "]]",
        'format = 1\nkind = "discrete"\n[model]\nPhi = [' + ("[" + '"(",' * 200 + "],") * 200 + "]",
        'format = 1\nkind = "discrete"\n[constants]\n' + "\n".join(f'c{i} = "("' for i in range(60_000)),
        'format = 1\nkind = "discrete"\n[constants]\n'
        + "\n".join(f'c{i} = "c{i + 1}"' for i in range(1000))
        + "\n[model]",
        "\n".join(f"key{i} = 1" for i in range(60_000)),
        '"' * 1_000_000,
        "[" * 1_000_000,
        "a" * 1_000_000,
        "." * 1_000_000,
    ],
    ids=[
        "dots",
        "quoted",
        "header",
        "rows",
        "columns",
        "cells",
        "constants",
        "chain",
        "keys",
        "quotes",
        "brackets",
        "word",
        "points",
    ],
)
def test_large_nonsense_is_refused_in_time(text):
    """A file of a megabyte made to take long takes a second or two, not hours."""
    start = time.process_time()
    with pytest.raises(ModelFileError) as caught:
        loads(text)
    assert str(caught.value).isprintable()
    assert time.process_time() - start < 20


def test_correlated_noises_must_be_possible():
    """N beyond what Q and Rc allow is told of N."""
    text = changed(TEXT, ("R = [[", "Rc = [["), ('dt = "tau"', 'dt = "tau"\nN = [[1]]'))
    with pytest.raises(
        ModelFileError, match=r"model.N: \[\[Q, N\], \[N', Rc\]\]: expected a nonnegative definite matrix"
    ):
        loads(text)
    file = loads(changed(text, ("N = [[1]]", "N = [[0.01]]")))
    assert np.array_equal(file.continuous().N, [[0.01]])
    assert file.discrete().N.shape == (2, 1)
    with pytest.raises(ModelFileError, match=r"model.N: expected equal intervals beside N"):
        file.discrete(times=[0, 1, 3])
    with pytest.raises(
        ModelFileError, match=r"model.N: expected F that do not vary beside N, received expressions of t"
    ):
        loads(changed(text, ("N = [[1]]", "N = [[0]]"), ('["0", "1"],', '["-t", "1"],')))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 0,5", "line 1, column 6: no TOML: expected newline or end of document after a statement; numbers have a decimal point"),
        (
            "a = 1\nb = 2*tau",
            "line 2, column 6: no TOML: expected newline or end of document after a statement; expressions and texts stand in quotes",
        ),
        ("a = tau", "line 1, column 5: no TOML: invalid value; expressions and texts stand in quotes"),
        ("a = [1\n", "line 2, column 1: no TOML: unclosed array"),
        ("a = 1\na = 2", "line 2, column 6: no TOML: cannot overwrite a value"),
        ('a = "x', 'line 1, column 7: no TOML: unterminated string; expressions and texts stand in quotes'),
        ("a = " + "[" * 3000, "expected lists of a few levels, received a deeper nesting"),
        ("b = 1\na = " + "1" * 5000, "line 2, column 5: expected numbers of at most 1000 digits, received more"),
    ],
)  # fmt: skip
def test_what_is_no_toml_is_told_with_line_and_column(text, message):
    """TOML's own errors, in one line, with a hint where the mistake is a usual one."""
    with pytest.raises(ModelFileError) as caught:
        loads(text, "f.toml")
    found = str(caught.value)
    assert found.startswith("f.toml: ")
    assert found.isprintable()
    if "column 6: no TOML: cannot" in message or "unterminated" in message:  # the words are those of Python's version
        assert found.startswith("f.toml: line ")
    else:
        assert found == f"f.toml: {message}"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("format = 1\ntitle = \"Ни\"".encode("cp1251"), "line 2, column 10: expected UTF-8 text, received the byte 0xcd"),
        ("format = 1".encode("utf-16"), "line 1, column 1: expected UTF-8, received UTF-16; save the file as UTF-8"),
        (b"\x89PNG\r\n\x1a\n\x00", "line 1, column 1: expected UTF-8 text, received the byte 0x89"),
        (b"format\n\x00", "line 2, column 1: expected a text file, received a binary one"),
        (b"#" * (2**20 + 1), "expected at most 1 MB, received more"),
        (b"", "format: expected format = 1, the version of the file, received none"),
    ],
)  # fmt: skip
def test_what_is_no_text_is_told_with_line_and_column(tmp_path, content, message):
    """Other encodings, binary and huge files."""
    path = tmp_path / "f.toml"
    path.write_bytes(content)
    with pytest.raises(ModelFileError) as caught:
        load(path)
    assert str(caught.value) == f"f.toml: {message}"


def test_files_that_cannot_be_read_are_named(tmp_path):
    """A missing file, a folder."""
    with pytest.raises(ModelFileError, match=r"no.toml: expected a file that can be read, received: No such file"):
        load(tmp_path / "no.toml")
    with pytest.raises(ModelFileError, match="expected a file that can be read"):
        load(tmp_path)


def test_the_standard_input_is_a_file(monkeypatch):
    """A dash means stdin; its name in messages too."""
    stdin = io.TextIOWrapper(io.BytesIO(TEXT.encode()))
    monkeypatch.setattr("sys.stdin", stdin)
    assert load("-").n == 2
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"x")))
    with pytest.raises(ModelFileError, match=r"^stdin: line 1"):
        load("-")


def test_a_byte_order_mark_and_windows_line_ends_stay(tmp_path):
    """What an editor of another system writes is read, and written back as it was, also after an edit."""
    content = b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode()
    path = tmp_path / "w.toml"
    path.write_bytes(content)
    file = load(path)
    assert file.dumps().encode() == content
    edited = file.edit(("constants", "tau"), "1/4").dumps().encode()
    assert edited == content.replace(b'"1/2"', b'"1/4"')


def test_errors_survive_another_process():
    """A ModelFileError can be pickled, as a worker needs."""
    error = ModelFileError(Problem("model.F", "expected"), "a.toml")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.problem, again.file) == (str(error), error.problem, error.file)


def test_places_and_values_are_written_for_readers():
    """Long values are cut, control characters shown."""
    assert place(("constants", "a b", "min")) == 'constants."a b".min'
    assert len(shown("x" * 1000)) <= 60
    assert shown("\u202e") == '"\\u202e"'
    assert shown([[[[1]]]]) == "[[[[1]]]]"
    assert shown(10**5000) == "a int"


# --- round trips --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [entry.name for entry in gallery()])
def test_loading_and_writing_changes_nothing(name):
    """dumps() of a file is the file, byte for byte."""
    text = next(entry.text for entry in gallery() if entry.name == name)
    assert loads(text).dumps() == text


def cells(data, path=()):
    """Every place of a file's data that holds a number or a text."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from cells(value, (*path, key))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from cells(value, (*path, i))
    else:
        yield path


def value_at(data, path):
    for key in path:
        data = data[key]
    return data


@pytest.mark.parametrize(
    "text",
    [TEXT, TEXT.replace("\n", "\r\n"), ready("task05").dumps(), ready("orbit").dumps()],
    ids=["unix", "windows", "task05", "orbit"],
)
def test_an_edit_changes_its_cell_and_no_other_byte(text):
    """For every value of a file: before and after the new one stands what stood there."""
    file, data = loads(text), tomllib.loads(text)
    for path in cells(data):
        fresh = file.edit(path, "M a r k").dumps()
        assert fresh.count('"M a r k"') == 1
        before, after = fresh.split('"M a r k"')
        assert text.startswith(before)
        assert text.endswith(after)
        assert value_at(tomllib.loads(fresh), path) == "M a r k"
        old = text[len(before) : len(text) - len(after)]
        assert tomllib.loads(f"x = {old}")["x"] == value_at(data, path)


def test_a_constant_with_a_slider_keeps_it():
    """A new value leaves min, max and unit where they are."""
    file = loads(TEXT).set_constant("r", "2*tau")
    assert 'r={value="2*tau",min = 0,  max=100, unit = "m²"}  # a slider' in file.dumps()
    assert file.constants["r"] == 1
    assert loads(TEXT).edit(("constants", "r", "max"), 5).definitions[2].max == 5


def test_edits_add_what_is_not_there():
    """A key, a table, a constant with its limits."""
    file = (
        loads(DISCRETE)
        .edit(("experiment", "seed"), 7)
        .edit(("title",), "Scalar")
        .set_constant("r", {"value": 2, "min": 0})
    )
    assert (file.experiment.seed, file.title, file.constants["r"]) == (7, "Scalar", 2)
    assert "r = {value = 2, min = 0}" in file.dumps()
    assert loads(DISCRETE.replace("[constants]\nq = 0.39", "").replace('"q"', "1")).set_constant("a", 1).constants == {
        "a": 1
    }
    assert loads(DISCRETE).edit(("model", "x0"), np.array([2.5])).discrete().x0 == 2.5
    assert loads(DISCRETE).edit(("model", "Qd"), [[np.float64(2)]]).discrete().Qd == 2


def test_an_edit_is_not_judged_but_told():
    """A half-typed expression is held, and problems() says where it is."""
    file = loads(TEXT).edit(("model", "F", 0, 1), "1/(")
    assert [p.where for p in file.problems()] == ["model.F[0][1]"]
    assert file.edit(("model", "F", 0, 1), "1").problems() == []


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("model", "F", 2, 0), 1, r"model.F\[2\]: expected an index from 0 to 1, received 2"),
        (("model", "F", 0, -1), 1, r"model.F\[0\]\[-1\]: expected an index from 0 to 1, received -1"),
        (("model", "N", 0, 0), 1, "model.N: expected a value there, received none"),
        (("model", "dt", 0), 1, r"model.dt\[0\]: expected a list there, received none"),
        (("title", "x"), 1, 'title: expected a table that holds "x", received "Tracking along a line"'),
        (("title",), object, "title: expected a number, a text or a list, received"),
        (("title",), "\udc80", "title: expected a change that TOML can hold"),
        ((), 1, r"expected a place like \(\"model\", \"F\", 0, 1\), received \[\]"),
        ("model", 1, "expected a place like"),
    ],
)
def test_places_that_are_not_there_are_refused(where, value, message):
    """The place is named, and how far it goes."""
    with pytest.raises(ModelFileError, match=message):
        loads(TEXT).edit(where, value)


def test_keys_are_removed():
    """R makes place for Rc; what is not there cannot be removed."""
    file = loads(TEXT).remove(("model", "R")).edit(("model", "Rc"), [["r"]])
    assert np.array_equal(file.discrete().R, [[8]])
    assert file.continuous().Rc == 4
    with pytest.raises(ModelFileError, match=r"model.Rc: expected a value there"):
        loads(TEXT).remove(("model", "Rc"))


def test_constants_are_renamed_everywhere_and_nothing_else_is():
    """The key and every expression; comments and spaces stay."""
    assert loads(TEXT).rename_constant("tau", "T").dumps() == changed(
        TEXT, ('tau = "1/2"', 'T = "1/2"'), ('"r*tau"', '"r*T"'), ('dt = "tau"', 'dt = "T"')
    )
    back = loads(TEXT).rename_constant("r", "variance").rename_constant("variance", "r")
    assert back == loads(TEXT)
    assert loads(TEXT).rename_constant("tau", "τ").constants["τ"] == 0.5
    for old, fresh, message in (
        ("tua", "T", 'unknown name "tua"; did you mean "tau"'),
        ("tau", "r", 'expected a new name, received "r", which another constant has'),
        ("tau", "pi", "expected a name of its own"),
        ("tau", "2a", "expected a name of letters"),
    ):
        with pytest.raises(ModelFileError, match=message):
            loads(TEXT).rename_constant(old, fresh)


def test_constants_are_renamed_in_any_form_of_the_table():
    """Quoted keys, sliders, values replaced before; a table on one line is refused, for its line is not one constant's."""
    text = changed(TEXT, ("tau = ", '"tau" = '), ('max=100, unit = "m²"', 'max="200*tau", unit = "tau"'))
    file = loads(text).replace({"sigma_w2": 3}).rename_constant("tau", "T")
    assert 'max="200*T", unit = "tau"' in file.dumps()
    assert file.constants == {"sigma_w2": 3, "T": 0.5, "r": 4}
    assert loads(text).rename_constant("r", "rho").definitions[2].meaning == ""
    one = changed(DISCRETE, ("[constants]\nq = 0.39", "constants = {q = 0.39}"))
    with pytest.raises(ModelFileError, match=r"constants.q: expected a line of its own in \[constants\] to rename it"):
        loads(one).rename_constant("q", "p")
    draft = loads("constants = 3\nformat = 1", check=False)
    with pytest.raises(ModelFileError, match='unknown name "q"'):
        draft.rename_constant("q", "p")
    with pytest.raises(ModelFileError, match="expected a value there"):
        draft.remove_constant("q")


def test_files_travel_between_processes():
    """A ModelFile can be pickled, looked at or not, with replaced numbers."""
    for file in (loads(TEXT), loads(TEXT).replace({"tau": 0.25}), ready("crane").checked()):
        again = pickle.loads(pickle.dumps(file))
        assert again == file
        assert np.array_equal(again.discrete(steps=2).Phi, file.discrete(steps=2).Phi)


def test_a_constant_in_use_is_not_removed():
    """Its first user is named."""
    with pytest.raises(
        ModelFileError,
        match=r"constants.r: expected a constant that is used nowhere, received one that model.R\[0\]\[0\] refers to",
    ):
        loads(TEXT).remove_constant("r")
    file = loads(TEXT).edit(("model", "R", 0, 0), 1).remove_constant("r")
    assert set(file.constants) == {"sigma_w2", "tau"}


@pytest.mark.parametrize("name", ["task05", "task12", "orbit", "gyro_bias", "ill_conditioned"])
def test_a_new_state_noise_or_measurement_leaves_the_rest_alone(name):
    """The old matrices are the corner of the new ones, the file stays sound, and removing it gives the old file back."""
    file = ready(name)
    steps = [("n", lambda f: f.add_state("extra", "V"), lambda f: f.remove_state(file.n))]
    steps.append(("m", lambda f: f.add_measurement("more", "W"), lambda f: f.remove_measurement(file.m)))
    if file.kind == "continuous":
        steps.append(("s", lambda f: f.add_noise(), lambda f: f.remove_noise(file.s)))
    for letter, grow, shrink in steps:
        bigger = grow(file)
        assert bigger.problems() == []
        assert getattr(bigger, letter) == getattr(file, letter) + 1
        for matrix in SHAPES[file.kind]:
            if matrix not in TEXTS and matrix in tomllib.loads(file.dumps())["model"]:
                old, now = file.matrix(matrix), bigger.matrix(matrix)
                assert np.array_equal(now[tuple(slice(size) for size in old.shape)], old)
        back, before = tomllib.loads(shrink(bigger).dumps()), tomllib.loads(file.dumps())
        assert {key: back["model"][key] for key in before["model"]} == before["model"]
        assert {key: value for key, value in back.items() if key != "model"} == {
            k: v for k, v in before.items() if k != "model"
        }
    named = file.add_state("extra", "V").add_measurement("more", "W")
    assert (named.states[-1], named.units[-1], named.measurements[-1], named.measurement_units[-1]) == (
        "extra",
        "V",
        "more",
        "W",
    )


def test_a_new_state_changes_no_estimate_of_the_others():
    """A constant that nothing drives and nothing measures: the old block of Φ, Qd and H is as it was."""
    old, now = loads(TEXT).discrete(), loads(TEXT).add_state().discrete()
    assert np.array_equal(now.Phi, np.block([[old.Phi, np.zeros((2, 1))], [np.zeros((1, 2)), np.eye(1)]]))
    assert np.array_equal(now.Qd, np.pad(old.Qd, ((0, 1), (0, 1))))
    assert np.array_equal(now.H, np.pad(old.H, ((0, 0), (0, 1))))
    assert now.states == ("x", "v", "x3")
    assert loads(TEXT).add_state("x4").add_state().states == ("x", "v", "x4", "x5")


def test_removing_takes_the_right_one():
    """The first state of two, the second measurement of three."""
    file = loads(TEXT).remove_state(0)
    assert file.states == ("v",)
    assert np.array_equal(file.matrix("P0"), [[10]])
    assert np.array_equal(file.matrix("G"), [[1]])
    more = loads(TEXT).add_measurement("b").add_measurement("c").edit(("model", "R", 2, 2), 9).remove_measurement(1)
    assert more.measurements == ("position", "c")
    assert np.array_equal(more.matrix("R"), np.diag([2, 9]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.remove_state(2), "expected a state from 0 to 1, and another one left, received 2 of 2"),
        (lambda f: f.remove_state(0).remove_state(0), "expected more than one state, received 0 of 1"),
        (lambda f: f.remove_measurement(0), "expected more than one measurement"),
        (lambda f: f.remove_noise(0), "expected more than one noise"),
        (lambda f: f.remove_state(True), "expected a state from 0 to 1"),
        (lambda f: loads(DISCRETE).add_noise(), "expected a continuous model"),
        (lambda f: f.edit(("model", "H"), [[1]]).add_state(), "model.H: expected 2 columns"),
    ],
)
def test_what_cannot_be_added_or_removed_is_told(change, message):
    """One line, and the file is as it was."""
    with pytest.raises(ModelFileError, match=message):
        change(loads(TEXT))


def test_files_compare_by_their_text():
    """Equal texts are equal files, whatever their names."""
    assert loads(TEXT, "a") == loads(TEXT, "b")
    assert hash(loads(TEXT, "a")) == hash(loads(TEXT, "b"))
    assert loads(TEXT) != loads(DISCRETE)
    assert loads(TEXT) != TEXT
    assert "a.toml" in repr(loads(TEXT, "a.toml"))


# --- other numbers for constants ----------------------------------------------------------------------------------------


def test_replaced_constants_are_followed():
    """Those that are expressions of it, the matrices, and the text."""
    file = loads(changed(TEXT, ("sigma_w2 = 0.01", 'sigma_w2 = "tau^2"'))).replace({"tau": 0.25})
    assert file.constants == {"sigma_w2": 0.0625, "tau": 0.25, "r": 4}
    assert file.dt == 0.25
    assert file.continuous().Q == 0.0625
    assert "tau = 0.25\n" in file.dumps()
    assert loads(file.dumps()).constants == file.constants
    assert file.definitions[1].expression == "0.25"
    both = file.replace({"r": 1})
    assert both.constants == {"sigma_w2": 0.0625, "tau": 0.25, "r": 1}
    assert "r={value=1.0,min = 0," in both.dumps()
    assert both.edit(("title",), "x").constants == both.constants


def test_replaced_constants_are_checked():
    """Names, numbers, limits, and what becomes of the matrices."""
    file = loads(TEXT, "line.toml")
    for values, message in (
        ({"tua": 1}, 'line.toml: constants: unknown name "tua"; did you mean "tau"'),
        ({"tau": math.nan}, "constants.tau: expected a number, received NaN"),
        ({"tau": "1"}, 'constants.tau: expected a number, received "1"'),
        ({"tau": True}, "constants.tau: expected a number, received true"),
    ):
        with pytest.raises(ModelFileError, match=message):
            file.replace(values)
    with pytest.raises(ModelFileError, match=r"constants.r: expected a value from 0 to 100, received -1"):
        file.replace({"r": -1}).discrete()
    with pytest.raises(
        ModelFileError, match=r"line.toml: model.Q: expected variances >= 0 on the diagonal, received -1"
    ):
        file.replace({"sigma_w2": -1}).discrete()
    assert [p.where for p in file.replace({"sigma_w2": -1}).problems()] == ["model.Q"]
    difference = ready("task11").edit(("model", "R", 0, 0), "R - Q + 1").edit(("model", "N"), [["Q - 0.5"]])
    with pytest.raises(ModelFileError, match=r"model.R: expected variances >= 0 on the diagonal, received -0.75"):
        difference.replace({"Q": 2}).discrete()
    with pytest.raises(
        ModelFileError, match=r"task11.toml: model: \[\[Q, N\], \[N', R\]\]: expected a nonnegative definite"
    ):
        difference.replace({"Q": 1.249}).discrete()
    late = ready("task11").edit(("model", "R", 0, 0), "1/(k + Q)")
    with pytest.raises(ModelFileError, match=r"model.R\[0\]\[0\]: at k = 0, t = 1 s: column 2: division by zero"):
        late.replace({"Q": 0}).discrete()
    assert file.problems() == []


# --- writing ------------------------------------------------------------------------------------------------------------


@given(discrete_models(varying=False))
@settings(deadline=None, max_examples=25, derandomize=True)
def test_discrete_models_survive_a_file(model):
    """from_model writes every double so that reading gives it back to the bit."""
    again = loads(from_model(model, 'A "title"').dumps()).discrete()
    for name in ("Phi", "Qd", "H", "R", "x0", "P0", "N", "offset"):
        expected, found = getattr(model, name), getattr(again, name)
        assert (expected is None) == (found is None)
        assert expected is None or np.array_equal(expected, found)
    assert (again.dt, again.states, again.measurements, again.units) == (
        model.dt,
        model.states,
        model.measurements,
        model.units,
    )


@given(continuous_models())
@settings(deadline=None, max_examples=25, derandomize=True)
def test_continuous_models_survive_a_file(model):
    """The same for a continuous model with a period."""
    file = loads(from_model(model, dt=0.1).dumps())
    again = file.continuous()
    for name in ("F", "G", "Q", "H", "Rc", "x0", "P0", "N", "B"):
        expected, found = getattr(model, name), getattr(again, name)
        assert (expected is None) == (found is None)
        assert expected is None or np.array_equal(expected, found)
    assert file.dt == 0.1


def test_models_that_no_file_holds_are_refused():
    """Stacks of matrices; a continuous model without a period or without any noise of a measurement."""
    walk = ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]])
    for ask, message in (
        (lambda: from_model(walk, R=[[1]]), "dt: expected the period"),
        (lambda: from_model(walk, dt=1), "R: expected R or the model's Rc, received neither"),
        (
            lambda: from_model(ready("task16").continuous(), dt=1, R=[[1]]),
            "R: expected R or the model's Rc, received both",
        ),
        (lambda: from_model(walk, dt=-1, R=[[1]]), "dt: expected a number > 0"),
        (
            lambda: from_model(ready("task12").discrete(steps=3)),
            "H: expected a constant matrix, received one that varies",
        ),
        (lambda: from_model(ready("task07").discrete(), dt=1), "expected a discrete model with its own dt and R"),
        (lambda: new(0), "n: expected a whole number >= 1"),
        (lambda: new(kind="other"), "kind: expected continuous or discrete, received 'other'"),
    ):
        with pytest.raises(ValueError, match=message):
            ask()
    with pytest.raises(TypeError, match="model: expected a DiscreteModel, received a str"):
        from_model("walk")


@pytest.mark.parametrize("kind", ["continuous", "discrete"])
@pytest.mark.parametrize("sizes", [(1, 1, 1), (3, 1, 2), (2, 4, 3), (4, 2, 1)])
def test_new_files_are_sound(kind, sizes):
    """A file from nothing has the sizes asked for, no problems, and an observable first state."""
    n, s, m = sizes
    file = new(n, s, m, kind, title="From nothing")
    assert (file.n, file.m, file.title) == (n, m, "From nothing")
    assert file.s == (s if kind == "continuous" else 0)
    assert file.problems() == []
    assert file.discrete(steps=3).n == n


def test_saving_does_not_overwrite(tmp_path):
    """Unless it is told to; what was written is the text."""
    path = tmp_path / "mine.toml"
    loads(TEXT).save(path)
    assert path.read_bytes() == TEXT.encode()
    with pytest.raises(ModelFileError, match="expected a file that does not exist yet"):
        loads(DISCRETE).save(path)
    loads(DISCRETE).save(path, overwrite=True)
    assert load(path) == loads(DISCRETE)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.toml"]
    with pytest.raises(ModelFileError, match="expected a file that can be written"):
        loads(TEXT).save(tmp_path / "nowhere" / "mine.toml")


def test_copies_do_not_overwrite(tmp_path):
    """A model of the gallery goes into a folder once."""
    assert copy("task07", tmp_path).read_text(encoding="utf-8") == ready("task07").dumps()
    with pytest.raises(ModelFileError, match="expected a file that does not exist yet"):
        copy("task07", tmp_path)
    with pytest.raises(ModelFileError, match='unknown model "tsk07"; did you mean "task07"'):
        copy("tsk07", tmp_path)


# --- random changes, and no harm ----------------------------------------------------------------------------------------

operations = st.one_of(
    st.tuples(st.just("add_state"), st.sampled_from(["", "b", "ω"]), st.sampled_from(["", "m²"])),
    st.tuples(st.just("add_measurement"), st.sampled_from(["", "y"])),
    st.tuples(st.just("add_noise")),
    st.tuples(st.sampled_from(["remove_state", "remove_measurement", "remove_noise"]), st.integers(0, 2)),
    st.tuples(
        st.just("set_constant"),
        st.sampled_from(["r", "tau", "extra", "σ"]),
        st.sampled_from([1, 0.25, "1/8", 1e-30, "2*sigma_w2"]),
    ),
    st.tuples(
        st.just("edit"),
        st.sampled_from([("model", "F", 0, 0), ("model", "P0", 0, 0), ("title",), ("experiment", "seed")]),
        st.sampled_from([3, "7", "1/2"]),
    ),
    st.tuples(st.just("rename_constant"), st.sampled_from(["tau", "T", "r"]), st.sampled_from(["T", "tau", "rho_1"])),
    st.tuples(st.just("remove_constant"), st.sampled_from(["extra", "tau"])),
    st.tuples(st.just("replace"), st.sampled_from([{"r": 3.0}, {"sigma_w2": 0.5}])),
)


@given(
    st.sampled_from([TEXT, TEXT.replace("\n", "\r\n"), ready("task05").dumps(), ready("task21").dumps()]),
    st.lists(operations, max_size=8),
)
@settings(deadline=None, max_examples=60, derandomize=True)
def test_random_changes_are_what_is_written(text, changes):
    """After any changes the text read again is the same file with the same values, and comments are still there."""
    file = loads(text)
    comments, refused = text.count("#"), []
    for name, *arguments in changes:
        try:
            file = getattr(file, name)(*arguments)
        except ModelFileError as error:
            refused.append(str(error))
    assert all(message.isprintable() for message in refused)
    again = loads(file.dumps(), check=False)
    assert again == file
    assert again.problems() == file.problems()
    if not file.problems():
        assert again.constants == file.constants
        for matrix in SHAPES[file.kind]:
            if matrix not in TEXTS and matrix in tomllib.loads(file.dumps())["model"]:
                assert np.array_equal(again.matrix(matrix), file.matrix(matrix))
    if not any(name.startswith("remove") for name, *_ in changes):
        assert file.dumps().count("#") == comments


def survives(text: str) -> None:
    """Nothing but a ModelFileError of one line, whatever the text."""
    told = []
    try:
        file = loads(text, check=False)
        told += [str(found) for found in file.problems()]
        if told:
            with pytest.raises(ModelFileError):
                file.discrete(steps=2)
        else:
            file.discrete(steps=2)
        file.edit(("model", "F", 0, 0), 1)
        file.add_state()
    except ModelFileError as error:
        told.append(str(error))
    assert all(message.isprintable() for message in told)


@given(st.text(max_size=200))
@settings(deadline=None, max_examples=200, derandomize=True)
def test_random_text_does_no_harm(text):
    """Any text at all."""
    survives(text)


@given(
    st.sampled_from([TEXT, DISCRETE, ready("motor").dumps()]),
    st.lists(
        st.tuples(
            st.floats(0, 1),
            st.integers(0, 6),
            st.sampled_from(["", "\n", '"', "[", "]", "0", "-1", "=", ",", "t", "k", "inf", "'", "#", "{", "\t", "é"]),
        ),
        min_size=1,
        max_size=5,
    ),
)
@settings(deadline=None, max_examples=200, derandomize=True)
def test_damaged_files_do_no_harm(text, damages):
    """A good file with pieces cut out and put in at random places."""
    for where, length, piece in damages:
        at = int(where * len(text))
        text = text[:at] + piece + text[at + length :]
    survives(text)


leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 5),
    st.floats(allow_nan=True),
    st.sampled_from(["1", "t", "q", "1/q", "x", "", "-1", "k"]),
    st.text(max_size=5),
).filter(lambda x: x is not None)
keys = st.sampled_from(
    [
        "F",
        "G",
        "Q",
        "H",
        "R",
        "P0",
        "dt",
        "x0",
        "states",
        "units",
        "B",
        "u",
        "N",
        "Rc",
        "Phi",
        "Qd",
        "offset",
        "nonsense",
    ]
)
values = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(["a", "value", "min", "q"]), inner, max_size=2)
    ),
    max_leaves=6,
)


@given(
    st.sampled_from(["continuous", "discrete"]),
    st.dictionaries(keys, values, max_size=5),
    st.dictionaries(st.sampled_from(["q", "a", "pi", "r x"]), values, max_size=3),
    st.dictionaries(st.sampled_from(["t0", "first", "steps", "algorithms", "seed"]), values, max_size=3),
)
@settings(deadline=None, max_examples=100, derandomize=True)
def test_well_formed_nonsense_does_no_harm(kind, model, constants, experiment):
    """Files that are TOML with the right keys and anything in them."""
    import tomlkit

    data = tomllib.loads(VARIED[kind])
    data["model"] |= model
    data["constants"] = constants | data["constants"]
    data["experiment"] = experiment
    survives(tomlkit.dumps(data))


# --- the page -----------------------------------------------------------------------------------------------------------

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "model-files.md"


def test_the_pages_files_are_sound():
    """What the page prints as a file is one without problems."""
    files = re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert len(files) >= 1
    for text in files:
        assert loads(text).problems() == []


def test_the_page_has_every_key_function_and_limit():
    """No key of the schema, no function and no bound of the grammar is left out."""
    page = PAGE.read_text(encoding="utf-8")
    fields = [Document, ConstantTable, ExperimentTable, Data, CostTable, OutputTable, *SECTIONS.values()]
    prose = re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL)
    words = set(re.findall(r"\w+", " ".join(re.findall(r"`[^`]+`", prose))))
    assert {key for table in fields for key in table.model_fields} <= words
    assert set(FUNCTIONS) | set(CONSTANTS) | {"t", "k"} <= words
    for bound in (
        f"At most {LENGTH} characters",
        f"{DEPTH} levels",
        f"at most {DIGITS} characters",
        f"at most {LARGEST} of each",
    ):
        assert bound in page
