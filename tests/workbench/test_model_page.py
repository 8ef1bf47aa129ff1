"""The page Model without a browser: what typing, pasting, sliding and pausing mean, and what is shown of a model."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.files.modelfile import gallery, loads, new, ready
from ctlabs.files.modelfile.schema import wrong_name
from ctlabs.reporting.mathml import mathml
from ctlabs.workbench.desk import blocks
from ctlabs.workbench.desk.commands import (
    AddConstant,
    AddPart,
    EditCell,
    EditCells,
    Name,
    New,
    Open,
    Rewrite,
    apply,
)
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.sheet import ModelSheet
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.help import help_for
from ctlabs.workbench.pages import STATIC, model_parts
from ctlabs.workbench.pages.cells import POSITIONS, Slider, block, number, placed, shown, slider, typed
from ctlabs.workbench.pages.model_dialogs import preview_lines
from ctlabs.workbench.pages.model_edits import (
    PAUSE,
    Typing,
    block_command,
    cell_command,
    free_name,
    line_of,
    sections,
    unknown_name,
)
from tests.reference import EXACT

FEW = settings(deadline=None, max_examples=30, derandomize=True)
GALLERY = [entry.name for entry in gallery()]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    made = Store(tmp_path_factory.mktemp("data"))
    yield made
    made.close()


@pytest.fixture
def session(store: Store) -> Session:
    return begun(store)


def begun(store: Store, n: int = 3) -> Session:
    """A session with a new model of n states, the first step of its history."""
    made = Session.begin(store)
    made.do(New(n, 1, 1))
    return made


def cell(i: int, j: int, text: str) -> EditCell:
    return EditCell(("model", "F", i, j), text)


class Clock:
    """A time that stands still until it is told otherwise."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


# Typing --------------------------------------------------------------------------------------------------------------


@FEW
@given(
    st.lists(
        st.tuples(st.integers(0, 2), st.sampled_from([0.1, PAUSE - 0.01, PAUSE + 0.01]), st.booleans()),
        min_size=1,
        max_size=12,
    )
)
def test_what_is_typed_into_one_cell_without_a_pause_is_one_edit(
    store: Store, typing: list[tuple[int, float, bool]]
) -> None:
    """The history has one step for every cell, pause and leaving of a cell; the model is that of all texts typed."""
    session, plain, clock = begun(store), begun(store), Clock()
    one, before = Typing(session, clock), session.text
    expected, last = 0, -1
    for k, (column, gap, left) in enumerate(typing):
        clock.now += gap
        if left:
            one.stop()
        expected += column != last or gap > PAUSE or left
        last = column
        one.do(f"F,0,{column}", cell(0, column, str(k + 2)))
        plain.do(cell(0, column, str(k + 2)))
    assert session.text == plain.text
    assert len(session.history) == 2 + expected
    for _ in range(expected):
        session.undo()
    assert session.text == before


def test_an_impossible_text_changes_nothing_and_typing_goes_on(session: Session) -> None:
    """A command that is refused in the middle of typing leaves the text and the history as they were."""
    clock = Clock()
    typing = Typing(session, clock)
    typing.do("a", cell(0, 0, "1"))
    text, history = session.text, session.history
    with pytest.raises(ValueError, match=r"F\[0\]\[7\]"):
        typing.do("a", cell(0, 7, "1"))
    assert (session.text, session.history) == (text, history)
    typing.do("a", cell(0, 0, "12"))
    assert len(session.history) == len(history)
    assert session.sheet.shown(("model", "F", 0, 0)).text == "12"


def test_an_edit_of_another_tab_is_not_taken_back_by_typing(session: Session) -> None:
    """Typing goes on as an edit of its own when something else has been edited in between, or taken back."""
    typing = Typing(session, Clock())
    typing.do("a", cell(0, 0, "1"))
    session.do(cell(1, 1, "5"))
    typing.do("a", cell(0, 0, "12"))
    assert session.sheet.shown(("model", "F", 1, 1)).text == "5"
    session.undo()
    typing.do("a", cell(0, 0, "123"))
    assert session.sheet.shown(("model", "F", 1, 1)).text == "5"
    assert session.sheet.shown(("model", "F", 0, 0)).text == "123"


def test_an_edit_without_a_key_is_always_one_of_its_own(session: Session) -> None:
    """Buttons never take part in typing: two of them at once are two steps to undo."""
    typing = Typing(session, Clock())
    before = len(session.history)
    typing.do("", AddConstant("q"))
    typing.do("", AddConstant("r"))
    assert len(session.history) == before + 2
    assert [row.name for row in session.sheet.constants] == ["q", "r"]


# Cells and blocks ------------------------------------------------------------------------------------------------------


@FEW
@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.sampled_from(["0", "0.5", "-2", "2*3"])), max_size=15)
)
def test_a_covariance_that_is_typed_stays_symmetric(typing: list[tuple[int, int, str]]) -> None:
    """What is typed on one side of P0 stands on the other too, so that no state in between is refused for that."""
    file = new(4)
    for i, j, text in typing:
        file, _ = apply(file, cell_command(ModelSheet(file), "P0", f"{i},{j}", text))
        texts = [[each.text for each in row] for row in ModelSheet(file).grids["P0"].rows]
        assert texts == [list(column) for column in zip(*texts, strict=True)]
        assert texts[i][j] == text


def test_sides_that_differ_are_typed_one_by_one() -> None:
    """Where the other side has another text it is left alone, and so is every matrix that need not be symmetric."""
    file, _ = apply(new(2), EditCell(("model", "P0", 0, 1), "3"))
    assert cell_command(ModelSheet(file), "P0", "0,1", "4") == EditCell(("model", "P0", 0, 1), "4")
    assert cell_command(ModelSheet(file), "F", "1,0", "4") == EditCell(("model", "F", 1, 0), "4")
    assert cell_command(ModelSheet(file), "P0", "1,1", "4") == EditCell(("model", "P0", 1, 1), "4")
    assert cell_command(ModelSheet(file), "x0", "1,0", "4") == EditCell(("model", "x0", 1), "4")


def test_headers_are_names_and_units() -> None:
    """A name is typed beside its unit and the unit beside its name, of states in F and of measurements in H."""
    file = ready("constant_velocity")
    sheet = ModelSheet(file)
    assert cell_command(sheet, "F", "name,1", "speed") == Name("state", 1, "speed", file.units[1])
    assert cell_command(sheet, "F", "unit,0", "km") == Name("state", 0, file.states[0], "km")
    assert cell_command(sheet, "H", "name,0", "radar") == Name("measurement", 0, "radar", file.measurement_units[0])


@FEW
@given(st.integers(1, 4), st.integers(0, 3), st.integers(0, 3), st.randoms(use_true_random=False))
def test_a_pasted_block_fills_the_cells_that_there_are(n: int, row: int, column: int, random: Any) -> None:
    """The numbers of a block stand where it was pasted, all the rest is what it was, and it is one edit."""
    row, column = min(row, n - 1), min(column, n - 1)
    values = np.array([[random.uniform(-9, 9) for _ in range(3)] for _ in range(3)])
    text = "\n".join("\t".join(repr(float(x)) for x in line) for line in values)
    file = new(n)
    expected = file.matrix("F").copy()
    inside = values[: n - row, : n - column]
    expected[row : row + len(inside), column : column + inside.shape[1]] = inside
    made, _ = apply(file, block_command(ModelSheet(file), "F", row, column, text))
    np.testing.assert_array_equal(made.matrix("F"), expected)
    assert made.problems() == []


def test_a_block_is_read_as_spreadsheets_write_it() -> None:
    """Tabs and line ends of any system; empty cells and what goes beyond the matrix are left out."""
    assert block("1\t2\r\n3\t4\r\n") == [["1", "2"], ["3", "4"]]
    assert placed("1\t\t3\n\t5", 0, 0, (2, 2)) == {(0, 0): "1", (1, 1): "5"}
    assert placed("1\n2\n3", 1, 0, (3, 1)) == {(1, 0): "1", (2, 0): "2"}


def test_a_block_goes_into_an_estimate_that_was_left_out() -> None:
    """x0 may be left out of a file; a block pasted into the zeros that are shown is written with all of it."""
    file = new(3).remove(("model", "x0"))
    made, _ = apply(file, block_command(ModelSheet(file), "x0", 1, 0, "4\n5"))
    np.testing.assert_array_equal(made.matrix("x0"), [0, 4, 5])


@FEW
@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), st.integers(-99, 99)), min_size=1, max_size=9))
def test_many_cells_at_once_are_the_same_as_one_by_one(cells: list[tuple[int, int, int]]) -> None:
    """EditCells writes the text that EditCell after EditCell would."""
    file = single = ready("constant_acceleration")
    pairs = tuple((("model", "F", i, j), str(value)) for i, j, value in cells)
    made, _ = apply(file, EditCells(pairs))
    for path, text in pairs:
        single, _ = apply(single, EditCell(path, text))
    assert made.dumps() == single.dumps()


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (("model", "F", 0, 9), r"model.F\[0\]\[9\]: expected an index from 0 to 1"),
        (("model", "B", 0, 0), "model.B: expected a value there"),
    ],
)
def test_many_cells_of_which_one_is_not_there_are_refused(path: tuple[str | int, ...], said: str) -> None:
    """In one line that names the cell."""
    with pytest.raises(ValueError, match=rf"^model\.toml: {said}[^\n]*$"):
        apply(new(2), EditCells(((("model", "F", 0, 0), "5"), (path, "1"))))


def test_a_text_is_taken_as_it_was_typed_or_refused_with_its_line() -> None:
    """The raw text view: comments and spaces stay; what is no TOML is told by line and changes nothing."""
    text = ready("constant_velocity").dumps() + "\n# a remark   \n"
    made, _ = apply(new(), Rewrite(text))
    assert made.dumps() == text
    with pytest.raises(ValueError, match=r"^line 2, column \d+: no TOML"):
        apply(new(), Rewrite("format = 1\nkind = \n"))


# What is shown -----------------------------------------------------------------------------------------------------------


def test_a_value_stands_beside_expressions_only() -> None:
    """A number needs none; an expression has its value, one that varies says of when; a wrong cell has its problem."""
    text = ready("constant_velocity").dumps()
    file = loads(text).edit(("model", "F", 0, 0), "2*sigma").edit(("model", "F", 1, 0), "sin(t)")
    rows = ModelSheet(file.edit(("model", "F", 1, 1), "2*sgima")).grids["F"].rows
    assert shown(rows[0][1]) == ["1"]
    assert shown(rows[0][0]) == ["2*sigma", "= 10"]
    assert shown(rows[1][0])[1] == f"= {number(math.sin(1.0))} at t1"
    assert shown(rows[1][1])[:2] == ["2*sgima", ""]
    assert 'did you mean "sigma"' in shown(rows[1][1])[2]


@FEW
@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_a_value_is_read_as_what_it_is(value: float) -> None:
    """Six digits of it, with a true minus and a power of ten."""
    text = number(value).replace("−", "-").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")).replace("·10", "e")
    assert float(text) == pytest.approx(value, rel=5e-6)


@pytest.mark.parametrize("name", GALLERY)
def test_every_matrix_of_a_model_has_its_place_and_its_help(name: str) -> None:
    """Each part stands in exactly one card, with a title, and there is help on it; its problems are found in the text."""
    file = ready(name)
    sheet = ModelSheet(file)
    parts = [part for section in sections(sheet.kind, sheet.grids) for part in section.parts]
    assert sorted(parts) == sorted(sheet.grids)
    lines = file.dumps().splitlines()
    for part in parts:
        assert model_parts.TITLES[part]
        assert help_for(f"model.{part}").what
        if sheet.grids[part].given:
            assert lines[line_of(file.dumps(), f"model.{part}[0]") - 1].replace(" ", "").startswith(f"{part}=")
    for row in sheet.constants:
        assert lines[line_of(file.dumps(), f"constants.{row.name}") - 1].startswith(row.name)


def test_every_part_that_can_be_added_has_words_for_it() -> None:
    """The buttons under the cards."""
    for kind in ("continuous", "discrete"):
        for part in ModelSheet(new(2, 1, 1, kind)).missing_parts:
            assert model_parts.PARTS[part]
            apply(new(2, 1, 1, kind), AddPart(part))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", GALLERY)
def test_every_equation_of_the_gallery_becomes_mathml(name: str) -> None:
    """Well-formed, with no LaTeX left and no bracket of a matrix that a font would have to stretch."""
    sheet = ModelSheet(ready(name))
    for line in (*sheet.equations(), *sheet.statement()):
        found = ET.fromstring(mathml(line))
        assert found.tag.endswith("math")
        text = "".join(found.itertext())
        assert "\\" not in text
        tables = [each for each in found.iter() if each.tag.endswith("mtable")]
        assert len(tables) == line.count("begin{bmatrix}")
        assert all(each.get("class") == "ctl-matrix" for each in tables)


def test_what_cannot_be_converted_is_shown_as_it_is() -> None:
    """Markup in it does no harm."""
    assert mathml(r"\left( <b>") == r"<code>\left( &lt;b&gt;</code>"


# Constants -----------------------------------------------------------------------------------------------------------------


def test_a_name_that_is_typed_first_becomes_a_constant(session: Session) -> None:
    """The message about an unknown name says which constant to add, and with it the problem is gone."""
    session.do(EditCell(("model", "Q", 0, 0), "3*strength"))
    (message,) = session.sheet.problems.values()
    assert unknown_name(message) == "strength"
    session.do(AddConstant(unknown_name(message)))
    assert session.sheet.problems == {}
    session.do(EditCell(("model", "Q", 0, 0), "3*k"))
    assert [unknown_name(message) for message in session.sheet.problems.values()] == [""]


@FEW
@given(st.integers(0, 60))
def test_new_constants_have_names_that_are_allowed(count: int) -> None:
    """However many there are: each is new, and none is a name that means something else."""
    taken: list[str] = []
    for _ in range(count):
        taken.append(free_name(taken))
    assert len(set(taken)) == count
    assert [wrong_name(name) for name in taken] == [""] * count


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 5.0), (-3.0, 7.0), (0.01, 10.0), (1e-12, 1e-6), (1e5, 3e5), (-1e-9, 1e-9), (1.0, 1.001)]
)
def test_a_slider_goes_through_its_range(low: float, high: float) -> None:
    """Positions and values belong together, the ends are exact, values rise and have few digits."""
    chosen = slider(low, high)
    assert chosen is not None
    values = [chosen.at(position) for position in range(POSITIONS + 1)]
    assert (values[0], values[-1]) == (low, high)
    assert values == sorted(set(values))
    assert [chosen.position(value) for value in values] == list(range(POSITIONS + 1))
    assert all(len(f"{value:.12g}".strip("-0.").partition("e")[0].replace(".", "")) <= 8 for value in values)
    assert [float(typed(value)) for value in values] == values


def test_a_slider_over_decades_is_logarithmic() -> None:
    """The middle is the geometric mean from a hundredfold on, the arithmetic one below."""
    assert Slider(0.01, 100.0).at(POSITIONS // 2) == pytest.approx(1.0, rel=EXACT)
    assert Slider(1.0, 99.0).at(POSITIONS // 2) == pytest.approx(50.0, rel=EXACT)


@pytest.mark.parametrize(
    ("low", "high"), [(None, 1.0), (0.0, None), (1.0, 1.0), (2.0, 1.0), (-math.inf, 1.0), (0.0, math.inf)]
)
def test_without_a_range_there_is_no_slider(low: float | None, high: float | None) -> None:
    """Neither where an end is missing or infinite, nor where there is nothing between them."""
    assert slider(low, high) is None


# Coloured noise ------------------------------------------------------------------------------------------------------------


def test_the_preview_of_a_block_is_what_is_inserted(session: Session) -> None:
    """The matrices in the preview are those that stand in the model afterwards."""
    lines = preview_lines("transfer", "3/(s^2 + 4*s + 5)", session)
    made = blocks.block("transfer", "3/(s^2 + 4*s + 5)", {})
    for value in (*made.F.ravel(), *made.G):
        assert f"{abs(value):g}" in lines[0]
    session.do(blocks.InsertBlock("transfer", "3/(s^2 + 4*s + 5)"))
    np.testing.assert_allclose(session.file.matrix("F")[3:, 3:], made.F, atol=EXACT)


@pytest.mark.parametrize(
    ("kind", "text"), [("transfer", "s^2"), ("psd", "w/(w^2+1)"), ("transfer", "1/(s +"), ("psd", "")]
)
def test_what_is_no_block_is_told_in_one_line(session: Session, kind: str, text: str) -> None:
    """As one types."""
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        preview_lines(kind, text, session)


def test_a_model_with_problems_is_to_be_put_right_first(session: Session) -> None:
    """A block needs the values of the constants."""
    session.do(EditCell(("model", "F", 0, 0), "?"))
    with pytest.raises(ValueError, match=r"^put right first: model.F\[0\]\[0\]"):
        preview_lines("transfer", "1/(s+1)", session)


# The element ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def client() -> Iterator[Callable[[], Any]]:
    """A page of NiceGUI that no browser looks at."""
    from nicegui import Client
    from nicegui.page import page as route

    made = Client(route("/"), request=None)
    with made:
        yield lambda: None
    made.delete()


def edit(element: Any, key: str, text: str, number: int) -> None:
    """What the browser says when something is typed."""
    from nicegui.events import GenericEventArguments

    element._edited(
        GenericEventArguments(sender=element, client=element.client, args={"number": number, "key": key, "text": text})
    )


def test_a_text_that_is_refused_stays_with_its_reason(client: Any, session: Session) -> None:
    """Until it is typed anew, or the model has another text there; every message is answered by its number."""
    from ctlabs.workbench.pages.grid import TextField

    texts: list[str] = []
    refuse = [True]

    def typed_text(text: str) -> str:
        texts.append(text)
        return "expected another" if refuse[0] else ""

    field = TextField("Name", typed_text, test="name")
    field.write("q")
    edit(field, "0,0", "t", 1)
    assert texts == ["t"]
    assert (field.props["rows"], field.props["ack"]) == ([[["t", "", "expected another"]]], 1)
    field.write("q")  # something else has changed
    assert field.props["rows"] == [[["t", "", "expected another"]]]
    refuse[0] = False
    edit(field, "0,0", "q", 2)
    assert (field.props["rows"], field.props["ack"]) == ([[["q", "", ""]]], 2)
    refuse[0] = True
    edit(field, "0,0", "e", 3)
    field.write("omega")  # undone, or renamed elsewhere
    assert field.props["rows"] == [[["omega", "", ""]]]


def test_a_grid_sends_what_has_changed_and_nothing_else(client: Any, session: Session) -> None:
    """The same matrix again is no message; a cell that is typed is answered with its value."""
    from ctlabs.workbench.pages.grid import GridElement

    def type_(key: str, text: str) -> str:
        session.do(cell_command(session.sheet, "F", key, text))
        element.show(session.sheet.grids["F"], "F")
        return ""

    nothing: Callable[..., None] = lambda *_: None  # noqa: E731
    element = GridElement("F", type_, on_block=nothing, on_remove=nothing, on_done=nothing)
    element.show(session.sheet.grids["F"], "F")
    sent: list[int] = []
    element.update = lambda: sent.append(1)  # type: ignore[method-assign]
    element.show(session.sheet.grids["F"], "F")
    assert not sent
    edit(element, "1,0", "2+3", 1)
    assert sent
    assert element.props["rows"][1][0] == ["2+3", "= 5"]
    assert element.props["ack"] == 1


def test_the_component_is_part_of_the_package() -> None:
    """The browser's half of the cells lies beside the other and knows every message that is listened to."""
    text = (STATIC / "grid.js").read_text(encoding="utf-8")
    for event in ("edit", "block", "remove", "done"):
        assert f'this.$emit("{event}"' in text
    for method in ("enter(path)", "nameRow(i)", "line(number)"):
        assert method in text


def test_opening_a_ready_model_is_one_step_back(session: Session) -> None:
    """Undo after opening brings the model before it back, to the letter."""
    before = session.text
    session.do(Open(ready("orbit").dumps(), "orbit.toml"))
    assert session.title == ready("orbit").title
    session.undo()
    assert session.text == before


def test_earlier_models_are_offered_the_latest_first(tmp_path: Path) -> None:
    """Those of the same person that have been begun; not the one that is open, not an empty one, not somebody else's."""
    store = Store(tmp_path)
    first, second, own = begun(store), begun(store), begun(store)
    first.do(EditCell(("title",), "A <first> & model"))
    second.do(EditCell(("title",), "A second"))
    Session.begin(store)
    Session.begin(store, "another").do(New(1, 1, 1))
    found = model_parts.earlier(own)
    assert [each.title for each in found] == ["A second", "A <first> & model"]
    assert [each.address for each in found] == [f"/model?draft={each.draft.id}" for each in (second, first)]
    for _ in range(model_parts.EARLIER + 3):
        begun(store)
    assert len(model_parts.earlier(own)) == model_parts.EARLIER
    store.close()


def test_a_refused_text_outlives_its_element(client: Any, session: Session) -> None:
    """What could not be saved is there again when the page is drawn again, until the model has another text there."""
    from ctlabs.workbench.pages.grid import GridElement

    nothing: Callable[..., None] = lambda *_: None  # noqa: E731
    kept: dict[str, tuple[str, str, str]] = {}

    def drawn() -> GridElement:
        made = GridElement("F", lambda *_: "full", on_block=nothing, on_remove=nothing, on_done=nothing, refused=kept)
        made.show(session.sheet.grids["F"], "F")
        return made

    edit(drawn(), "1,0", "7.25", 1)
    assert drawn().props["rows"][1][0] == ["7.25", "", "full"]
    session.do(EditCell(("model", "F", 1, 0), "8.5"))
    assert drawn().props["rows"][1][0][0] == "8.5"
    assert kept == {}


def test_cells_are_whole_pixels_high() -> None:
    """A box of a fractional height cuts the underscores of some fonts off."""
    style = (STATIC / "cells.css").read_text(encoding="utf-8")
    for rule in (r"\.ctl-cells input, \.ctl-cells textarea \{[^}]*\}", r"\.ctl-cells \.ctl-name, \.ctl-cells \.ctl-unit \{[^}]*\}"):
        found = re.search(rule, style)
        assert found is not None
        assert not re.search(r"(?<!-)height: [^a;][^;]*(rem|em|%)", found[0])
        assert re.search(r"min-height: \d+px", found[0])


def test_the_numbers_of_lines_are_as_high_as_the_lines() -> None:
    """The text of a model file and the numbers beside it have the same font, height of a line and padding at the top."""
    style = (STATIC / "cells.css").read_text(encoding="utf-8")
    numbers = re.search(r"\.ctl-gutter \{[^}]*\}", style)
    text = re.search(r"\.ctl-cells input, \.ctl-cells textarea \{[^}]*\}", style)
    assert numbers is not None
    assert text is not None
    for rule in (r"font: ([^;]+);", r"padding: (\S+)"):
        assert re.findall(rule, numbers[0]) == re.findall(rule, text[0]) != []
