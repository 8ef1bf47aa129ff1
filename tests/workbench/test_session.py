"""The workbench's session: commands, undo, what is shown and understood; no page, no browser."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from ctlabs import covariances
from ctlabs.files.modelfile import gallery, loads, new, ready
from ctlabs.filtering import bucy, settling, steady
from ctlabs.models import Anomaly, observability, shaping, spectra
from ctlabs.models.discretisation import interval
from ctlabs.studies.understanding import compute
from ctlabs.workbench.desk import commands as c
from ctlabs.workbench.desk import session as session_module
from ctlabs.workbench.desk import store as store_module
from ctlabs.workbench.desk.blocks import InsertBlock, block, rational
from ctlabs.workbench.desk.kinds import before_sampling
from ctlabs.workbench.desk.plain import typed
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.sheet import ModelSheet
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.runs.outcomes import Asked
from tests.reference import EXACT, SOLVER


@pytest.fixture
def store(tmp_path: Path) -> Any:
    made = Store(tmp_path)
    yield made
    made.close()


@pytest.fixture
def session(store: Store) -> Session:
    return Session.begin(store)


# Random edits --------------------------------------------------------------------------------------------------------

TEXTS = ["0", "1", "-2.5", "1e-4", "q", "2*q", "1/tau", "sin(t)", "k", "2*(q", "", "inf", "ω^2", "3,5", 'a"b', " 7 "]
NAMES = ["q", "tau", "ω", "w", "x", "pi", "t", "2a", "", "левый", "long name"]
texts, names, indices = st.sampled_from(TEXTS), st.sampled_from(NAMES), st.integers(-1, 4)
matrices = st.sampled_from(["F", "G", "Q", "Phi", "Qd", "H", "R", "Rc", "N", "P0", "B", "Z"])
cells = st.one_of(
    st.tuples(st.just("model"), matrices, indices, indices),
    st.tuples(st.just("model"), st.sampled_from(["x0", "u", "offset", "units", "states"]), indices),
    st.sampled_from([("model", "dt"), ("title",), ("constants", "q"), ("experiment", "t0"), (), ("model",), (0,)]),
)
SETTINGS = st.sampled_from(["steps", "runs", "seed", "first", "t0", "algorithms", "x"])
WHAT = st.sampled_from(["state", "noise", "measurement"])
BLOCKS = st.sampled_from(["1/(s+1)", "4/(w^2+1)", "s", "1/q", "2*("])
COMMANDS: st.SearchStrategy[Any] = st.one_of(
    st.builds(c.EditCell, cells, texts),
    st.builds(c.EditCell, cells, texts),
    st.builds(c.New, st.integers(0, 4), st.integers(0, 3), st.integers(0, 3), st.sampled_from(["continuous", "discrete", "x"])),
    st.builds(c.Open, st.sampled_from([*(e.text for e in gallery()[:12]), "format = 1", "", "F = [", "[model]\nF = 3"])),
    st.builds(c.Add, WHAT, names, names),
    st.builds(c.Add, WHAT, names, names),
    st.builds(c.Remove, WHAT, indices),
    st.builds(c.Remove, WHAT, indices),
    st.builds(c.Name, st.sampled_from(["state", "measurement"]), indices, names, names),
    st.builds(c.AddConstant, names, texts),
    st.builds(c.EditCell, st.tuples(st.just("constants"), names), texts),
    st.builds(c.RenameConstant, names, names),
    st.builds(c.RemoveConstant, names),
    st.builds(c.EditCell, st.tuples(st.just("constants"), names, st.sampled_from([*c.TOLD, "x"])), texts),
    st.builds(c.EditCell, st.just(("title",)), st.text(max_size=8)),
    st.builds(c.SetKind, st.sampled_from(["continuous", "discrete", "x"])),
    st.builds(c.EditCell, st.tuples(st.just("experiment"), SETTINGS), texts),
    st.builds(c.AddPart, st.sampled_from(["u", "N", "offset", "x0", "R", "Rc", "F"])),
    st.builds(c.RemovePart, st.sampled_from(["u", "N", "offset", "x0", "R", "F"])),
    st.builds(InsertBlock, st.sampled_from(["transfer", "psd"]), BLOCKS, indices, st.sampled_from(["noise", "measurement"])),
    st.builds(c.Rewrite, st.sampled_from(["", " ", "format = 1\n", "x = ["])),
    st.builds(c.EditCells, st.lists(st.tuples(cells, texts), max_size=3).map(tuple)),
)  # fmt: skip


class Edits(RuleBasedStateMachine):
    """Anything anybody does, in any order, against a plain list of texts."""

    folder: tempfile.TemporaryDirectory[str]
    store: Store

    @initialize(start=st.sampled_from(["", *(entry.text for entry in gallery()[:6])]))
    def begin(self, start: str) -> None:
        self.session = Session.begin(type(self).store, text=start)
        self.seen, self.at, self.line = [self.session.text], 0, ""

    @rule(command=COMMANDS)
    def do(self, command: Any) -> None:
        before = (self.session.text, self.session.history)
        try:
            self.session.do(command)
        except ValueError as refused:
            self.line = str(refused)
            assert (self.session.text, self.session.history) == before
            return
        if len(self.session.history) != len(before[1]) or self.session.history[-1] != before[1][-1]:
            self.seen, self.at = [*self.seen[: self.at + 1], self.session.text], self.at + 1

    @precondition(lambda self: self.at > 0)
    @rule()
    def undo(self) -> None:
        self.session.undo()
        self.at -= 1

    @precondition(lambda self: self.at < len(self.seen) - 1)
    @rule()
    def redo(self) -> None:
        self.session.redo()
        self.at += 1

    @rule()
    def killed(self) -> None:
        """The process dies; another makes the session again from what is in the database."""
        again = Session.resume(type(self).store, self.session.draft.id)
        assert again.text == self.session.text
        assert again.history == self.session.history
        assert again.sheet.problems == self.session.sheet.problems
        self.session = again

    @invariant()
    def exact(self) -> None:
        assert "\n" not in self.line
        assert self.session.text == self.seen[self.at]
        assert self.session.can_undo == (self.at > 0)
        assert self.session.can_redo == (self.at < len(self.seen) - 1)

    @invariant()
    def shown(self) -> None:
        """Whatever is wrong with the model, it can be shown; its saved text is read as the same model."""
        again = loads(self.session.text, "", check=False)
        assert again.dumps() == self.session.text
        assert {p.where for p in again.problems()} == set(self.session.sheet.problems)
        assert all(isinstance(line, str) for line in [*self.session.sheet.equations(), *self.session.sheet.statement()])
        for grid in self.session.sheet.grids.values():
            assert all(isinstance(cell.text, str) for row in grid.rows for cell in row)


@pytest.mark.property
def test_random_edits_are_undone_exactly_and_survive_a_kill(request: pytest.FixtureRequest) -> None:
    """Undo and redo give every text again to the letter, an impossible command changes nothing, a killed session is the same."""
    with tempfile.TemporaryDirectory() as folder:
        Edits.store = Store(folder)
        try:
            from hypothesis.stateful import run_state_machine_as_test

            run_state_machine_as_test(
                Edits,
                settings=settings(
                    max_examples=min(40, request.config.getoption("--examples")),
                    stateful_step_count=25,
                    deadline=None,
                    derandomize=True,
                    phases=(Phase.generate,),  # to shrink a failure takes minutes: leave this out to have it
                    suppress_health_check=list(HealthCheck),
                ),
            )
        finally:
            Edits.store.close()


# Commands ------------------------------------------------------------------------------------------------------------


def test_typing_keeps_what_was_typed_and_tells_what_is_wrong_at_the_cell(session: Session) -> None:
    """A wrong expression stays in its cell with a message beside it, and all else keeps its value."""
    session.do(c.EditCell(("model", "F", 1, 0), "-omga^2"))
    cell = session.sheet.grids["F"].rows[1][0]
    assert cell.text == "-omga^2"
    assert cell.value is None
    assert cell.problem is not None
    assert cell.problem.startswith('unknown name "omga"')
    assert session.sheet.grids["F"].rows[0][1].value == 1.0
    session.do(c.AddConstant("omega", "3"))
    session.do(c.EditCell(("model", "F", 1, 0), "-omega^2"))
    assert session.sheet.shown(("model", "F", 1, 0)) == c_cell(session)
    assert session.sheet.shown(("model", "F", 1, 0)).value == -9.0
    assert session.sheet.problems == {}


def c_cell(session: Session) -> Any:
    """The same cell by the grid."""
    return session.sheet.grids["F"].rows[1][0]


@pytest.mark.parametrize(
    "command",
    [
        c.EditCell(("model", "F", 5, 0), "1"),
        c.EditCell(("model", "Z", 0, 0), "1"),
        c.Remove("state", 7),
        c.Remove("measurement", 0),
        c.AddConstant("pi", "3"),
        c.EditCell(("constants", "none"), "3"),
        c.EditCell(("constants", "none", "min"), "3"),
        c.AddPart("offset"),
        c.RemovePart("u"),
        c.SetKind("sideways"),
        c.Open("F = ["),
        InsertBlock("transfer", "1/(s+1)", 9),
        InsertBlock("transfer", "s^2/(s+1)"),
        InsertBlock("transfer", "1/(2*s+"),
        InsertBlock("psd", "1/(w+1)"),
        InsertBlock("psd", "-1/(w^2+1)"),
        InsertBlock("psd", "1/w^2"),
        InsertBlock("transfer", "(s+2)/(s+1)", 0, "measurement"),
    ],
)
def test_an_impossible_command_says_why_in_one_line_and_changes_nothing(session: Session, command: Any) -> None:
    """``ValueError`` in one line; model, history and database are what they were."""
    before = (session.text, session.history, session.store.draft(session.draft.id))
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        session.do(command)
    assert (session.text, session.history, session.store.draft(session.draft.id)) == before


def test_a_state_added_and_removed_leaves_the_rest_to_the_letter(session: Session) -> None:
    """Comments, expressions and numbers of the other states stay as they were typed."""
    session.do(c.Open(ready("oscillator").dumps()))
    before = session.text
    session.do(c.Add("state", "bias", "m"))
    assert session.file.states == ("y", "v", "bias")
    session.do(c.Remove("state", 2))
    assert session.text == before


@pytest.mark.parametrize("name", ["constant_velocity", "oscillator", "gauss_markov", "singer"])
def test_a_continuous_model_and_its_samples_are_one_another(session: Session, name: str) -> None:
    """To discrete time and back gives F and GQGᵀ again; the samples are those of the file."""
    session.do(c.Open(ready(name).dumps()))
    wanted, sampled = session.file.continuous(), session.file.discrete()
    session.do(c.SetKind("discrete"))
    for part in ("Phi", "Qd", "H", "R", "P0"):
        np.testing.assert_array_equal(getattr(session.file.discrete(), part), getattr(sampled, part))
    assert session.file.experiment.steps == ready(name).experiment.steps
    session.do(c.SetKind("continuous"))
    found = session.file.continuous()
    scale = np.abs(wanted.F).max()
    np.testing.assert_allclose(found.F, wanted.F, rtol=0, atol=SOLVER * scale)
    W = wanted.G @ wanted.Q @ wanted.G.T
    np.testing.assert_allclose(found.Q, W, rtol=0, atol=1e-6 * np.abs(W).max())
    np.testing.assert_allclose(session.file.discrete().Qd, sampled.Qd, rtol=0, atol=SOLVER * np.abs(sampled.Qd).max())


def test_a_large_discrete_model_has_its_continuous_one_too() -> None:
    """Forty states with fast and slow decay: F and Q come back, though the determinant of Φ is next to nothing."""
    rng = np.random.default_rng(5)
    F = rng.normal(size=(40, 40)) / np.sqrt(40) - 3.0 * np.eye(40)
    G = rng.normal(size=(40, 2))
    made = interval(F, G @ G.T, 0.5)
    assert np.linalg.det(made.Phi) < 1e-20
    found_F, found_Q = before_sampling(made.Phi, made.Qd, 0.5)
    np.testing.assert_allclose(found_F, F, rtol=0, atol=SOLVER)
    np.testing.assert_allclose(found_Q, G @ G.T, rtol=0, atol=SOLVER * np.abs(G @ G.T).max())


@pytest.mark.parametrize(("Phi", "Qd"), [("-0.5", "1"), ("0", "1")])
def test_samples_of_no_continuous_model_are_refused(session: Session, Phi: str, Qd: str) -> None:
    """A negative eigenvalue, or 0, is no sample of a real differential equation."""
    session.do(c.New(1, 1, 1, "discrete"))
    session.do(c.EditCell(("model", "Phi", 0, 0), Phi))
    session.do(c.EditCell(("model", "Qd", 0, 0), Qd))
    with pytest.raises(ValueError, match="Phi: expected the samples of a continuous model"):
        session.do(c.SetKind("continuous"))


def test_parts_come_and_go(session: Session) -> None:
    """A known input, Rc instead of R and N beside it; what is left is what was there."""
    before = session.text
    session.do(c.AddPart("u"))
    assert session.file.matrix("B").shape == (2, 1)
    session.do(c.EditCell(("model", "B", 1, 0), "2/3"))
    session.do(c.AddPart("u"))
    np.testing.assert_array_equal(session.file.matrix("B"), [[0, 0], [2 / 3, 0]])
    assert session.file.matrix("u").tolist() == [0, 0]
    assert session.sheet.shown(("model", "B", 1, 0)).text == "2/3"
    session.do(c.RemovePart("u"))
    assert session.text == before
    session.do(c.AddPart("Rc"))
    session.do(c.AddPart("N"))
    assert session.file.continuous().N is not None
    assert session.sheet.missing_parts == ("u", "R")
    session.do(c.AddPart("R"))
    assert session.sheet.problems == {"model.N": "expected Rc beside N (the noise that w correlates with), received R"}


# Blocks --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("transfer", "3/(2*s + 1)"),
        ("transfer", "(s + 4)/(s^2 + 0.4*s + 2)"),
        ("transfer", "(s + 4)/(s + 1)"),
        ("psd", "4/(w^2 + 1)"),
        ("psd", "(w^2 + 9)/((w^2 + 1)*(w^2 + 4))"),
        ("psd", "(w^2 + 16)/(4*(w^2 + 4))"),
    ],
)
def test_a_block_in_a_file_is_the_augmented_model(session: Session, kind: str, text: str) -> None:
    """The spectrum of what drives the plant is that of the text, and the measurement's that of ctlabs.models.shaping.augment."""
    session.do(c.Open(ready("oscillator").dumps()))
    plant = session.file.continuous()
    strength = float(plant.Q[0, 0])
    session.do(InsertBlock(kind, text, 0, "noise", "y_in"))  # type: ignore[arg-type]  # one of the two kinds
    assert session.sheet.problems == {}
    found = session.file.continuous()
    if kind == "psd":
        S = spectra.parse(text)
    else:
        num, den = rational(text, "s", {})
        S = spectra.white(strength).through(num, den)
    wanted = shaping.augment(plant, spectra.shaping_filter(S))
    w = np.geomspace(1e-2, 1e2, 40)
    np.testing.assert_allclose(shaping.psd(found, w), shaping.psd(wanted, w), rtol=SOLVER)
    assert not np.allclose(shaping.psd(found, w), 1.05 * shaping.psd(wanted, w), rtol=1e-3)
    n = plant.n
    np.testing.assert_allclose(found.F[n:, n:] @ found.P0[n:, n:] + (found.F[n:, n:] @ found.P0[n:, n:]).T,
                               -(found.G @ found.Q @ found.G.T)[n:, n:], atol=SOLVER * np.abs(found.P0).max())  # fmt: skip


@pytest.mark.parametrize("text", ["(s - 4)/(s^2 + 0.4*s + 2)", "-3/(2*s + 1)", "(2*s^2 + 1)/(s^2 + 3*s + 5)", "1/s^2"])
def test_a_transfer_function_keeps_its_sign_and_its_zeros(text: str) -> None:
    """H(sI − F)⁻¹G + D of the block is the function that was typed, at any s."""
    made = block("transfer", text, {})
    for s in (0.3 + 0.2j, -0.1 + 4j, 7.0):
        found = made.H @ np.linalg.solve(s * np.eye(len(made.F)) - made.F, made.G) + made.D
        assert found == pytest.approx(eval(text.replace("^", "**"), {"s": s}), rel=SOLVER)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("transfer", "w0/(s + w0)"),
        ("transfer", "w0^2/(s^2 + 2*zeta*w0*s + w0^2)"),
        ("transfer", "(s + 3*w0)/(s + w0)"),
        ("transfer", "(w0*s + zeta)/(s + 1)"),
        ("transfer", "(zeta*s + 1)/((s + w0)*(s + 2*w0)*(s + 0.1))"),
        ("psd", "2*zeta*w0/(w^2 + w0^2)"),
        ("psd", "w0/(4*w^2 + zeta)"),
        ("transfer", "1/(s + sqrt(w0))"),
        ("psd", "(w^2 + w0)/((w^2 + 1)*(w^2 + zeta))"),
    ],
)
def test_a_block_with_other_constants_is_the_block_of_these_constants(session: Session, kind: str, text: str) -> None:
    """Where letters stand in its cells, other values of them give what another block with these values gives."""
    constants = ((("constants", "w0"), "1.5"), (("constants", "zeta"), "0.3"), (("model", "Q", 0, 0), "w0 + 1"))
    first, second = (ready("constant_velocity").set_constant("w0", 1).set_constant("zeta", 1) for _ in range(2))
    for path, value in constants:
        first = first.edit(path, typed(value))
        second = second.edit(path, typed(value.replace("1.5", "2.25").replace("0.3", "0.7")))
    block_of = InsertBlock(kind, text, 0, "noise", "y_in")  # type: ignore[arg-type]  # one of the two kinds
    made, other = c.apply(first, block_of)[0], c.apply(second, block_of)[0].continuous()
    moved = made.replace({"w0": 2.25, "zeta": 0.7}).continuous()
    if "+ zeta))" in text:  # a spectrum of higher order has no factor in letters
        assert not np.allclose(moved.F, other.F)
    else:
        np.testing.assert_allclose(moved.F, other.F, rtol=1e-12)
        np.testing.assert_allclose(moved.G, other.G, rtol=1e-12)
        if "0.1" not in text:  # of the third order the covariance stays a number
            np.testing.assert_allclose(moved.P0, other.P0, rtol=1e-9)


def test_a_block_of_numbers_has_no_rounding(session: Session) -> None:
    """What is 1/5 is written 0.2, and a strength of 0.002 gives 0.002 and not 0.0020000000000000005."""
    file = ready("constant_velocity").edit(("model", "Q", 0, 0), 0.002)
    made = c.apply(file, InsertBlock("transfer", "1/(s + 0.5)", 0, "noise", "y"))[0]
    assert made.contents["model"]["P0"][-1][-1] == 0.002
    made = c.apply(file, InsertBlock("transfer", "0.1/(s^2 + 0.3*s + 0.7)", 0, "noise", "y"))[0]
    assert [row[-2:] for row in made.contents["model"]["F"][-2:]] == [[-0.3, 1], [-0.7, 0]]


def test_a_block_keeps_constants_working(session: Session) -> None:
    """After a transfer function the strength q still sets the noise and the block's initial covariance."""
    session.do(c.Open(ready("oscillator").dumps()))
    session.do(InsertBlock("transfer", "1/(2*s + 1)", 0, "noise", "force"))
    one = session.file.continuous()
    session.do(c.EditCell(("constants", "q"), "3"))
    three = session.file.continuous()
    np.testing.assert_allclose(three.Q, 3 * one.Q, rtol=EXACT)
    np.testing.assert_allclose(three.P0[2, 2], 3 * one.P0[2, 2], rtol=EXACT)
    assert session.sheet.grids["F"].rows[1][0].text == "-omega0^2"


def test_coloured_measurement_noise_adds_to_the_measurement(session: Session) -> None:
    """Into a measurement: the spectrum of z is that of the plant and of the text together."""
    session.do(c.Open(ready("oscillator").dumps()))
    plant = session.file.continuous()
    session.do(InsertBlock("psd", "4/(w^2 + 1)", 0, "measurement", "colour"))
    w = np.geomspace(1e-2, 1e2, 40)
    wanted = shaping.psd(plant, w) + spectra.parse("4/(w^2 + 1)")(w)
    np.testing.assert_allclose(shaping.psd(session.file.continuous(), w), wanted, rtol=SOLVER)


@pytest.mark.parametrize("power", ["((((((3^24)^24)^24)^24)^24)^24)", "(1e-300*1e-300*1e-300)", "(7^24)^24*(7^24)^24"])
def test_numbers_of_a_block_stay_within_bounds(power: str) -> None:
    """A few characters must not keep the machine busy for hours: what no double could hold twice over is refused."""
    with pytest.raises(ValueError, match=r"^block: column \d+: expected numbers of fewer digits"):
        rational(f"1/(s+{power})", "s", {})


def test_common_factors_are_cancelled_exactly() -> None:
    """(s+0.1)(s+k)/((s+0.1)(s+2)²) has one pole twice and one zero."""
    num, den = rational("(s+0.1)*(s+k)/((s+0.1)*(s+2)^2)", "s", {"k": 0.3})
    np.testing.assert_array_equal(num, [1.0, 0.3])
    np.testing.assert_array_equal(den, [1.0, 4.0, 4.0])


# What is shown -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", gallery(), ids=lambda entry: entry.name)
def test_every_ready_model_is_shown_and_understood(entry: Any) -> None:
    """Every cell has a value, equations have no holes, every part of the understanding is there or says why not."""
    file = loads(entry.text, "")
    sheet = ModelSheet(file)
    for name, grid in sheet.grids.items():
        values = np.array([[cell.value for cell in row] for row in grid.rows], dtype=float)
        if name not in file.varying and grid.given:
            np.testing.assert_array_equal(values.reshape(file.matrix(name).shape), file.matrix(name))
        assert not np.isnan(values).any()
    assert not any("square" in line for line in [*sheet.equations(), *sheet.statement()])
    found = compute(file)
    assert found.discrete
    assert found.transient
    for part in ("observability", "sampling", "poles", "limit", "transfers", "bode", "continuous_limit"):
        one = getattr(found, part)
        assert bool(one) != bool(one.reason)
        assert "\n" not in one.reason


def test_understanding_is_the_librarys(session: Session) -> None:
    """Each part is the number that the library's own verb gives."""
    session.do(c.Open(ready("oscillator").dumps()))
    found, file = session.understand(), session.file
    model = file.discrete()
    limit = steady.solve(model)
    np.testing.assert_array_equal(found.limit.value.state.P_plus, limit.P_plus)
    assert found.limit.value.settled == settling(model)
    assert found.observability.value.rank == observability.analyse(model).rank
    num, den = steady.transfer_function(model, 1, 0)
    transfer = found.transfers.value[1]
    np.testing.assert_allclose(transfer.num, num, rtol=EXACT, atol=EXACT)
    np.testing.assert_allclose(transfer.den, den, rtol=EXACT)
    late = np.exp(-1j * found.bode.value.w * model.dt)
    response = np.polyval(num[::-1], late) / np.polyval(den[::-1], late)
    np.testing.assert_allclose(found.bode.value.response[transfer.name], response, rtol=SOLVER)
    plan = covariances(model, file.experiment.steps, first=file.experiment.first)
    np.testing.assert_array_equal(found.transient.value.P_minus, plan.P_minus)
    assert session.understand() is found
    session.do(c.EditCell(("model", "dt"), "0.3"))
    assert session.understand() is not found


def test_what_is_understood_over_time_begins_at_t0(session: Session) -> None:
    """The time axis is the file's: an R that is large around t = 105 shows there."""
    file = ready("local_level").edit(("experiment", "t0"), 100).edit(("experiment", "steps"), 20)
    session.do(c.Open(file.edit(("model", "R", 0, 0), "1 + 1e9*exp(-9*(t - 105)^2)").dumps()))
    found = session.understand().transient.found
    assert found is not None
    assert found.t[0] == 100
    assert found.t[np.diff(found.P_plus[:, 0, 0]).argmax() + 1] == pytest.approx(105)


def test_a_known_input_that_varies_takes_nothing_from_the_filter(session: Session) -> None:
    """Covariances know nothing of u: the motor has a steady filter although its voltage alternates."""
    session.do(c.Open(ready("motor").dumps()))
    found, model = session.understand(), replace(session.file.discrete(), offset=None)
    np.testing.assert_array_equal(found.limit.value.state.K, steady.solve(model).K)


def test_a_continuous_measurement_has_its_own_steady_filter(session: Session) -> None:
    """With Rc the Kalman–Bucy filter is understood too."""
    session.do(c.AddPart("Rc"))
    found = session.understand()
    np.testing.assert_array_equal(found.continuous_limit.value.P, bucy.steady(session.file.continuous()).P)


def test_a_model_with_a_problem_is_not_understood_and_says_why(session: Session) -> None:
    """Every part gives the first problem as its reason."""
    session.do(c.EditCell(("model", "P0", 0, 0), "-1"))
    found = session.understand()
    assert not found.limit
    assert found.limit.reason == found.transient.reason
    assert found.limit.reason.startswith("model.P0: ")


def test_equations_have_the_numbers_in_and_the_statement_the_symbols(session: Session) -> None:
    """ẋ = Fx + Gw with values; with what was typed."""
    session.do(c.Open(ready("gauss_markov").dumps()))
    equations, statement = session.sheet.equations(), session.sheet.statement()
    assert len(equations) == len(statement)
    assert statement != equations
    assert statement[0].startswith(r"\dot x = ")
    from latex2mathml.converter import convert

    for line in [*equations, *statement]:
        assert convert(line).startswith("<math")


# History, plan, names ------------------------------------------------------------------------------------------------


def test_history_tells_what_was_done_and_any_step_can_be_gone_to(session: Session) -> None:
    """Labels in order, what is undone marked; going to a step gives its text."""
    texts_ = [session.text]
    for value in ("2", "3", "4"):
        session.do(c.EditCell(("model", "R", 0, 0), value))
        texts_.append(session.text)
    assert [step.label for step in session.history[1:]] == ["R[0][0] = 2", "R[0][0] = 3", "R[0][0] = 4"]
    assert session.undo() == "R[0][0] = 4"
    assert [step.done for step in session.history] == [True, True, True, False]
    session.go(session.history[1].number)
    assert session.text == texts_[1]
    with pytest.raises(ValueError, match="expected one of its steps"):
        session.go(999)
    session.go(session.history[3].number)
    with pytest.raises(ValueError, match="Nothing to redo"):
        session.redo()


def test_a_long_history_forgets_its_oldest_steps_only(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """After more edits than a draft remembers (500, here 50) everything that is listed can still be undone."""
    for module in (session_module, store_module):
        assert module.REVISIONS == 500
        monkeypatch.setattr(module, "REVISIONS", 50)
    for i in range(60):
        session.do(c.EditCell(("title",), f"title {i}"))
    count = 0
    while session.can_undo:
        session.undo()
        count += 1
    assert count == 49
    assert session.title == "title 10"


def test_a_draft_that_is_open_twice_is_not_overwritten(session: Session, store: Store) -> None:
    """Two servers on one folder: edits of cells merge, and what was meant for the old text as a whole is refused."""
    other = Session.resume(store, session.draft.id)
    session.do(c.EditCell(("title",), "Mine"))
    other.do(c.EditCell(("model", "F", 0, 1), "7.5"))
    assert other.title == "Mine"
    session.do(c.EditCell(("model", "F", 1, 0), "8.5"))
    assert session.sheet.grids["F"].rows[0][1].text == "7.5"
    assert Session.resume(store, session.draft.id).text == session.text
    for late in (c.Rewrite(other.text + "# mine\n"), c.Remove("state", 0)):
        session.do(c.EditCell(("title",), session.title + "!"))
        with pytest.raises(ValueError, match="edited elsewhere and has been read again"):
            other.do(late)
        assert other.text == session.text
    session.undo()
    other = Session.resume(store, session.draft.id)
    session.redo()
    with pytest.raises(ValueError, match="edited elsewhere"):
        other.redo()


def test_the_plan_is_saved_and_checked(session: Session, store: Store) -> None:
    """Settings of the next experiment survive a kill; impossible ones are refused in one line and change nothing."""
    session.set_plan(steps=50, runs=7, algorithms=("ud", "joseph"))
    again = Session.resume(store, session.draft.id)
    assert again.plan == session.plan
    for wrong in ({"steps": 0}, {"runs": True}, {"algorithms": ()}, {"algorithms": ("udd",)}, {"colour": 1}):
        with pytest.raises(ValueError, match=r"^[^\n]+$"):
            session.set_plan(**wrong)
    assert session.plan == again.plan


def test_the_plan_follows_the_model_file(session: Session, store: Store) -> None:
    """What [experiment] tells is the plan of an opened model, by itself and after a restart; undo brings the old plan back."""
    session.do(c.Open(ready("oscillator").dumps()))
    session.set_plan(steps=33, runs=5, anomalies=(Anomaly(3),), design=session.text)
    mine = session.plan
    text = new().dumps().split("[experiment]")[0] + (
        "[experiment]\nsteps = 50\nruns = 7\nseed = 9\nfirst = 0\nalgorithms = ['ud']\n"
    )
    session.do(c.Open(text))
    assert session.plan == Asked(50, 7, 9, 0, ("ud",))
    assert Session.resume(store, session.draft.id).plan == session.plan
    session.undo()
    assert session.plan == mine
    session.redo()
    assert session.plan == Asked(50, 7, 9, 0, ("ud",))
    session.set_plan(runs=8)
    session.do(c.EditCell(("experiment", "steps"), "60"))
    assert (session.plan.steps, session.plan.runs) == (60, 8)


def test_a_new_draft_begins_with_a_small_model_that_is_not_saved(session: Session, store: Store) -> None:
    """Nothing was typed: the draft is empty, a model can be looked at; after an edit it is there, and undo leads back."""
    assert session.untouched
    assert session.text == new().dumps()
    session.do(c.EditCell(("title",), "Mine"))
    assert not session.untouched
    assert session.filename == "mine.toml"
    session.undo()
    assert session.untouched
    with pytest.raises(ValueError, match="unknown id"):
        Session.resume(store, "nothing")


def test_discretised_numbers_on_the_sheet_are_not_confused_with_the_file() -> None:
    """A cell that varies shows its value at the first measurement, and says that it varies."""
    sheet = ModelSheet(ready("crane"))
    moving = [cell for grid in sheet.grids.values() for row in grid.rows for cell in row if cell.varies]
    file = ready("crane")
    assert moving
    t = file.experiment.t0 + file.experiment.first * file.dt
    for cell in moving:
        place: Any = cell.path[2:]
        wanted = file.matrix(str(cell.path[1]), t, file.experiment.first)[place]
        assert cell.value == pytest.approx(wanted, rel=EXACT)
