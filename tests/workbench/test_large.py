"""Models of many states: what is shown of a large matrix, and edits that are made in a thread."""

from __future__ import annotations

import asyncio
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.files.modelfile import loads, new
from ctlabs.files.modelfile.splicing import spliced
from ctlabs.workbench.desk import commands as c
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.pages.editing import Editor
from ctlabs.workbench.pages.entries import CELLS, LISTED, Entries, is_large, places


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    store = Store(tmp_path)
    yield Session.begin(store, text=new(60, 2, 3).dumps())
    store.close()


@pytest.fixture
def client() -> Iterator[Any]:
    """A page of NiceGUI that no browser looks at."""
    from nicegui import Client
    from nicegui.page import page as route

    made = Client(route("/"), request=None)
    with made:
        yield made
    made.delete()


# The text ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("style", ["one line", "rows", "comments", "quotes"])
def test_an_entry_is_put_into_the_text_and_the_rest_stays_to_the_letter(style: str) -> None:
    """Whatever stands between the entries; only the entry differs, and the data are those of the plain way."""
    rng, n = np.random.default_rng(7), 5
    cells = [[f'"{i}*q # ],["' if (i + j) % 3 == 0 else f"{i + j / 8!r}" for j in range(n)] for i in range(n)]
    between, after = {"one line": (", ", ""), "rows": (", ", "\n"), "comments": (",", " # [[ ,\n  "), "quotes": (" , ", "\n")}[style]
    row = [f"[{between.join(cells)}{' ,' if style == 'quotes' else ''}]" for cells in cells]
    text = "title = 'F'\n[model] # here\nG = [[1]]\nF = [\n" + f",{after}".join(row) + f"{after}]\nH = [[1, 2]]\n"
    data = tomllib.loads(text)
    for _ in range(20):
        i, j = (int(k) for k in rng.integers(0, n, 2))
        value = [3, -2.5e-7, 'a"b\\', "-w0^2"][int(rng.integers(4))]
        made = spliced(text, data, ((("model", "F", i, j), value),))
        assert made is not None
        assert tomllib.loads(made)["model"]["F"][i][j] == value
        front = next((k for k, (a, b) in enumerate(zip(made, text, strict=False)) if a != b), len(text))
        back = next(k for k in range(1, len(text)) if made[-k] != text[-k]) if front < len(text) else 0
        assert len(text) - front - back < 12  # no more than an entry is another
    hidden = 'title = """\n[model]\nF = [[1]]"""\n' + text.partition("\n")[2]
    assert spliced(hidden, tomllib.loads(hidden), ((("model", "F", 0, 0), 7),)) is None


def test_what_takes_more_than_an_entry_is_left_to_the_plain_way() -> None:
    """A place that is not there, a row, a table in dots, a value that is no entry."""
    text = "model.F = [[1, 2]]\n"
    assert spliced(text, tomllib.loads(text), ((("model", "F", 0, 1), 3),)) is None
    text = "[model]\nF = [[1, 2]]\n"
    data = tomllib.loads(text)
    for path, value in [(("model", "F", 0), 1), (("model", "F", 0, 2), 1), (("model", "F", 1, 0), 1), (("model", "Q", 0, 0), 1),
                        (("model", "F", 0, 0), True), (("model", "F", 0, 0), [1]), (("constants", "F", 0, 0), 1)]:  # fmt: skip
        assert spliced(text, data, ((path, value),)) is None
    assert loads(text, check=False).edit(("model", "F", 0), [5, 6]).contents["model"]["F"] == [[5, 6]]


# The entries -------------------------------------------------------------------------------------------------------------


def test_a_large_matrix_is_shown_by_its_entries(client: Any, session: Session) -> None:
    """Those that are not zero, those that are wrong, and those that are asked for; never thousands."""
    shown = Entries("F", lambda key, text: "no" if text == "?" else "", lambda: None)
    matrix = session.sheet.grids["F"]
    assert is_large(matrix)
    assert len(matrix.rows) ** 2 > CELLS
    shown.show(matrix, "F")
    assert shown.list.props["places"] == [f"{i},{i + 1}" for i in range(59)]
    assert shown._go("3, x60") == ""
    assert "2,59" in shown.list.props["places"]
    assert shown._go("x7") == ""
    assert shown.list.props["places"] == ["6,7"]
    for wrong in ("61", "1, 61", "1 2 3", "0", "nothing"):
        assert "expected a row and a column" in shown._go(wrong)
    shown.enter("model.F[50][4]")
    assert "50,4" in shown.list.props["places"]
    session.do(c.EditCell(("model", "F", 40, 3), "unknown"))
    shown.show(session.sheet.grids["F"], "F")
    at = shown.list.props["places"].index("40,3")
    assert "unknown name" in shown.list.props["rows"][at][0][2]


def test_a_dense_matrix_is_shown_in_part_and_its_problems_always(client: Any, session: Session) -> None:
    """So many entries at most; a wrong one is among them wherever it stands."""
    cells = tuple((("model", "F", i, j), str(i + j + 1)) for i in range(60) for j in range(60))
    session.do(c.EditCells((*cells[:-1], (("model", "F", 59, 59), "unknown"))))
    shown = Entries("F", lambda *_: "", lambda: None)
    matrix = session.sheet.grids["F"]
    shown.show(matrix, "F")
    assert len(places(matrix)) == 3600
    assert len(shown.list.props["places"]) == LISTED
    assert shown.list.props["places"][-1] == "59,59"
    assert f"the first {LISTED} are shown" in shown._told.text


# The thread --------------------------------------------------------------------------------------------------------------


class _Shell:
    """As much of a frame as an editor needs."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *words: self.said.append(" ".join((name, *words)))


def test_a_large_model_is_edited_in_a_thread_in_the_order_of_typing(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop goes on meanwhile; the last of several texts of a cell stays, as one step to undo."""
    threads: set[int] = set()
    plain = session.prepare

    def prepare() -> None:
        threads.add(threading.get_ident())
        plain()

    monkeypatch.setattr(session, "prepare", prepare)
    monkeypatch.setattr("ctlabs.workbench.pages.model_edits.PAUSE", 1e9)  # however long an edit takes
    shell, changed = _Shell(), []  # type: tuple[_Shell, list[str]]
    steps = len(session.history)

    async def typed() -> list[str]:
        editor = Editor(session, shell, changed.append)  # type: ignore[arg-type]  # as much of it as it needs
        answers = [editor.type("F,0,1", c.EditCell(("model", "F", 0, 1), text)) for text in ("1*2", "1*2*3", "1*2*34")]
        assert not any(isinstance(answer, str) for answer in answers)
        found = await asyncio.gather(*answers)  # type: ignore[arg-type]  # none is a text
        editor.done()
        await editor.undo()
        await editor.redo()
        return list(found)

    assert session.large
    assert asyncio.run(typed()) == ["", "", ""]
    assert threading.get_ident() not in threads
    assert session.sheet.grids["F"].rows[0][1].text == "1*2*34"
    assert len(session.history) == steps + 1
    assert changed[-1] == ""
    assert shell.said[-1] == "saved"
