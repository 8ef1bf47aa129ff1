"""The workbench's help: complete, true of the library, and typed as it says; the guided first experiment."""

from __future__ import annotations

import asyncio
import re
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ctlabs import DiscreteModel
from ctlabs.files.datafile import parse
from ctlabs.files.modelfile import ModelFile, loads, ready
from ctlabs.filtering import flops, kalman_filter, steady
from ctlabs.filtering.algorithms import catalogue
from ctlabs.reporting.mathml import mathml
from ctlabs.workbench.desk import blocks, tour
from ctlabs.workbench.desk.commands import EditCell, New, Open
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.desk.tour import STEPS, Tour
from ctlabs.workbench.help import Help, groups, help_for, topics
from tests.reference import EXACT, SOLVER

TEXTS = [each for group in groups().values() for each in group.entries.values()]
FIELDS = {
    "model": "kind title states units measurements measurement_units constants F B D measurement_offset u G Q H R Rc N x0 P0 dt Phi Qd "
    "offset t0 transfer psd",
    "understand": "observability detectability poles steady transfer bode variance",
    "experiment": "steps runs seed first algorithms design anomalies data progress",
    "algorithm": " ".join(catalogue.FORMS),
    "result": "states errors gain variances innovations nis nees whiteness algorithms statistics diagnosis outside "
    "python commands difference",
    "data": "table columns written rows filter gate steps verdict estimates tests",
    "fit": "constants starts trace estimates sides profiles correlation",
    "control": "begin weights settings margins gains poles sigma responses cost curves ensemble export elsewhere",
    "keep": "list compare rerun export",
    "labs": "parameter runs seed checks variant",
    "course": "folder roster labs issue grade handed handout",
}

# What there is --------------------------------------------------------------------------------------------------------


def test_there_is_help_on_every_field_algorithm_and_figure() -> None:
    """Each key once, none that nobody asks for, and the groups in order."""
    wanted = {f"{group}.{name}" for group, names in FIELDS.items() for name in names.split()}
    keys = [each.key for each in TEXTS]
    assert sorted(keys) == sorted(wanted)
    assert list(FIELDS) == list(groups()) == list(topics())


def test_every_matrix_of_a_model_file_has_help() -> None:
    """What the file's format has, the help has."""
    from ctlabs.files.modelfile.schema import SECTIONS, ExperimentTable

    for section in SECTIONS.values():
        for name in section.model_fields:
            assert help_for(f"model.{name}").what
    for name in set(ExperimentTable.model_fields) - {"t0"}:
        assert help_for(f"experiment.{name}").what


@pytest.mark.parametrize("each", TEXTS, ids=lambda each: each.key)
def test_texts_are_sentences_and_equations_are_mathml(each: Help) -> None:
    """A title without a full stop, whole sentences, a tooltip of one line, and LaTeX of which nothing is left over."""
    assert not each.title.endswith(".")
    for text in (each.what, each.note):
        assert not text or ((text[0].isupper() or text[0].isdigit()) and text.endswith("."))
    assert "\n" not in each.tooltip
    assert each.tooltip.startswith(f"{each.title}: ")
    if each.equation:
        shown = ET.fromstring(each.equation_html)
        words = "".join(shown.itertext())
        assert shown.get("display") == "block"
        assert "\\" not in words
        assert "operatorname" not in words
    ET.fromstring(f"<div>{each.html}</div>".replace("&nbsp;", " "))


def test_an_unknown_key_is_refused_with_the_one_that_was_meant() -> None:
    """One line."""
    with pytest.raises(
        LookupError, match=r"expected a key such as model\.F, received 'model\.Fi' \(did you mean model\.F\?\)"
    ):
        help_for("model.Fi")


def test_help_is_found_by_its_words() -> None:
    """Every word has to be there; groups without a find are left out."""
    assert [each.key for each in topics("Riccati equation")["understand"]] == ["understand.steady"]
    assert set(topics("bierman factors")) == {"algorithm"}
    assert topics("no such word at all") == {}
    assert sum(map(len, topics().values())) == len(TEXTS)


def test_markup_in_a_text_is_shown_and_not_obeyed() -> None:
    """Titles and examples may have < in them."""
    html = Help("model.x", "x", "a < b & c.", example="<script>", unit="<b>").html
    assert "<script>" not in html
    assert "a &lt; b &amp; c." in html


def test_bars_are_fences() -> None:
    """As in the reports, |Φ| has no space around its bars."""
    assert mathml(r"|\Phi|").count('lspace="0" rspace="0"') == 2
    assert 'display="block"' in mathml("x", block=True)


# What it says is true -------------------------------------------------------------------------------------------------

CONSTANTS = "[constants]\ntau = 2\nq = 0.02\n"
COMMON = ("states", "units", "measurements", "measurement_units", "H", "x0", "P0", "dt")


def assembled(kind: str, names: tuple[str, ...]) -> ModelFile:
    """A model file made of the examples."""
    lines = [f"format = 1\nkind = {kind!r}\n{CONSTANTS}{help_for('model.constants').example}\n[model]"]
    lines += [f"{name} = {help_for(f'model.{name}').example}" for name in (*COMMON, *names)]
    return loads("\n".join(lines), "help.toml")


def test_the_examples_of_a_continuous_model_are_one() -> None:
    """F, B, u, G, Q, R and what both kinds have, as typed in the help, make the wheel; Rc may take R's place."""
    wheel = assembled("continuous", ("F", "B", "u", "G", "Q", "R"))
    model = wheel.discrete()
    a = np.exp(-0.2 / 2)
    np.testing.assert_allclose(model.Phi, [[1, 2 * (1 - a)], [0, a]], rtol=0, atol=EXACT)
    np.testing.assert_allclose(model.R, [[0.01]], rtol=EXACT)
    other = assembled("continuous", ("F", "G", "Q", "Rc"))
    np.testing.assert_allclose(other.discrete().R, [[0.01]], rtol=EXACT)  # Rc/dt
    assert other.kind == help_for("model.kind").example


def test_the_examples_of_a_discrete_model_are_one() -> None:
    """Phi, Qd, offset, N and R, as typed in the help."""
    model = assembled("discrete", ("Phi", "Qd", "offset", "R", "N")).discrete()
    assert model.states == ("angle", "rate")
    assert np.linalg.eigvalsh(model.Qd).min() > 0
    np.testing.assert_allclose(model.Phi[1, 1], np.exp(-0.1), rtol=EXACT)


def test_the_examples_of_blocks_are_blocks() -> None:
    """The transfer function as typed; the spectrum's variance is what its equation says for σ² = 1."""
    made = blocks.block("transfer", help_for("model.transfer").example, {})
    np.testing.assert_allclose(made.F, [[-0.5]], rtol=EXACT)
    spectrum = blocks.block("psd", help_for("model.psd").example, {"a": 3.0})
    np.testing.assert_allclose(spectrum.H @ spectrum.P0 @ spectrum.H, 1.0, rtol=SOLVER)


def test_the_examples_of_experiments_are_accepted() -> None:
    """Algorithms that exist, whole numbers, and a CSV header that is read."""
    names = help_for("experiment.algorithms").example.split(", ")
    assert set(names) <= set(catalogue.FORMS)
    for key in ("steps", "runs", "seed", "first"):
        assert int(help_for(f"experiment.{key}").example) >= 0
    record = parse(f"{help_for('experiment.data').example}\n0,1\n0.5,\n1,2\n".encode(), ("sensor",), "a.csv")
    assert record.missing == 1
    assert tomllib.loads(f"a = {help_for('model.states').example}")["a"] == ["angle", "rate"]


def test_a_thousand_runs_give_an_rms_to_the_percentage_told() -> None:
    """1/√(2·1000), and a chi-square ensemble agrees."""
    assert "2.2 %" in help_for("experiment.runs").note
    draws = np.random.default_rng(1).chisquare(1000, 20000)
    assert np.std(np.sqrt(draws / 1000)) == pytest.approx(0.0224, abs=5e-4)


# The algorithms -------------------------------------------------------------------------------------------------------

WALK = DiscreteModel(
    [[1, 1], [0, 0.9]],
    [[0.3, 0.1], [0.1, 0.2]],
    [[1, 0], [0, 1]],
    [[0.5, 0.1], [0.1, 0.4]],
    x0=[0, 1],
    P0=[[2, 0.3], [0.3, 1]],
)
Z = np.array([[0.3, 1.0], [0.9, 0.4], [1.2, 0.2]])
CASES = {
    "perfect": replace(WALK, R=[[0.5, 0], [0, 0]]),
    "singular_start": replace(WALK, P0=[[1, 1], [1, 1]]),
    "singular_motion": replace(WALK, Phi=[[1, 1], [1, 1]]),
}


@pytest.mark.parametrize("form", catalogue.FORMS)
@pytest.mark.parametrize("case", [*CASES, "unknown", "gaps"])
def test_the_table_of_algorithms_is_true(form: str, case: str) -> None:
    """What is said to be possible gives the textbook's numbers; what is not is refused by name."""
    model, z, P0 = CASES.get(case, WALK), Z.copy(), None
    if case == "unknown":
        P0 = np.diag([np.inf, 1.0])
    if case == "gaps":
        z[1, 0] = np.nan
    if case not in help_for(f"algorithm.{form}").able:
        with pytest.raises(ValueError, match=f"^form {form}: expected"):
            kalman_filter(model, z, algorithm=form, P0=P0)
        return
    found = kalman_filter(model, z, algorithm=form, P0=P0)
    if case == "unknown":
        assert np.isfinite(found.P_plus[-1]).all()
    elif form == "steady":  # its covariances are the limits, whatever P0
        np.testing.assert_allclose(found.P_plus[1:], [steady.solve(model).P_plus] * 3, rtol=0, atol=SOLVER)
    else:
        wanted = kalman_filter(model, z, algorithm="sequential")
        np.testing.assert_allclose(found.x_plus, wanted.x_plus, rtol=0, atol=SOLVER)
        np.testing.assert_allclose(found.P_plus, wanted.P_plus, rtol=0, atol=SOLVER)


@pytest.mark.parametrize("form", catalogue.FORMS)
def test_the_operations_are_those_that_are_counted(form: str) -> None:
    """The leading terms tell the count of a model with 20 states within its lower orders, 1/20 and 1/400 of it."""
    n, m, s = 20, 5, 20
    rng = np.random.default_rng(3)
    root, mix = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    model = DiscreteModel(
        rng.normal(size=(n, n)) / n,
        root @ root.T,
        rng.normal(size=(m, n)),
        mix @ mix.T + np.eye(m),
        x0=np.zeros(n),
        P0=np.eye(n),
    )
    text = help_for(f"algorithm.{form}").cost
    for power, word in (("²", "**2"), ("³", "**3")):
        text = text.replace(power, word)
    text = re.sub(r"(?<=[\dnms)])(?=[nms(])", "*", text)
    told = eval(text, {"__builtins__": {}}, {"n": n, "m": m, "s": s})
    assert flops(model, form) == pytest.approx(told, rel=0.12)


# The guided first experiment ------------------------------------------------------------------------------------------


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session.begin(Store(tmp_path))


def done(looked: Tour) -> list[str]:
    return [step.name for step, is_done in looked.look() if is_done]


def test_the_tour_ticks_off_what_is_done_and_nothing_else(session: Session) -> None:
    """Open, change, run, compare, export: each when it has been done, in this session's own way."""
    own = Tour(session)
    assert own.next is STEPS[0]
    session.do(New(1, 1, 1))
    session.do(EditCell(("model", "F", 0, 0), "-1"))
    assert done(own) == []  # a model of one's own is fine, but it is not a ready one
    session.do(Open(ready("local_level").dumps(), "local_level.toml"))
    assert done(own) == ["open"]
    session.do(EditCell(("constants", "q"), "1500"))
    assert done(own) == ["open", "change"]
    session.set_plan(steps=5, runs=20)
    asyncio.run(session.run())
    assert done(own) == ["open", "change", "run"]
    session.set_plan(algorithms=("joseph", "ud"))
    assert own.next is STEPS[3]
    asyncio.run(session.run())
    assert done(own) == ["open", "change", "run", "compare"]
    tour.mark(session, "export")
    again = Tour(session)  # as after a reload
    assert (again.next, done(again)) == (None, [step.name for step in STEPS])


def test_the_tour_stays_done_and_begins_again_when_asked(session: Session) -> None:
    """Undo takes no tick away; beginning again counts only what comes after."""
    own = Tour(session)
    tour.begin(session)
    session.do(EditCell(("constants", "q"), "0.2"))
    session.set_plan(steps=3, runs=10)
    asyncio.run(session.run())
    assert done(own) == ["open", "change", "run"]
    session.undo()
    session.undo()
    assert done(own) == ["open", "change", "run"]
    session.redo()
    own.restart()
    assert (done(own), own.wanted, done(Tour(session))) == ([], True, [])
    session.do(Open(ready("singer").dumps(), "singer.toml"))
    assert done(own) == ["open"]
    own.want(False)
    assert Tour(session).wanted is False


def test_the_tour_survives_a_restart_of_the_server(tmp_path: Path) -> None:
    """The ticks are in the database."""
    store = Store(tmp_path)
    session = Session.begin(store)
    tour.begin(session)
    assert done(Tour(session)) == ["open"]
    store.close()
    resumed = Session.resume(Store(tmp_path), session.draft.id)
    assert done(Tour(resumed)) == ["open"]


def test_a_step_that_is_none_is_refused(session: Session) -> None:
    """One line, nothing noted."""
    with pytest.raises(ValueError, match="tour: expected one of open, change, run, compare, export, received 'fly'"):
        tour.mark(session, "fly")


def test_the_tours_pages_and_model_exist() -> None:
    """Every step leads to a page of the workbench, and its model is in the gallery with a slider to move."""
    pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")
    from ctlabs.workbench.pages import listed

    assert {step.page for step in STEPS} <= {page.name for page in listed()}
    model = ready(tour.MODEL)
    assert f"“{model.title}”" in STEPS[0].what
    assert any(each.min is not None and each.max is not None for each in model.definitions)


def test_no_help_points_to_a_place_beside_it() -> None:
    """A text is shown in many places: what it speaks of is named, and is not "the table below"."""
    beside = re.compile(r"\b(table|figure|list|field)s? (above|below)\b")
    assert [each.key for each in TEXTS if beside.search(f"{each.what} {each.note}")] == []
    assert "page Help" in help_for("experiment.algorithms").note
