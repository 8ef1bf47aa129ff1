"""What goes wrong around the workbench, and who means ill: other users, full and read-only disks, killed servers, odd names."""

from __future__ import annotations

import asyncio
import os
import re
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.workbench.desk import commands as c
from ctlabs.workbench.desk.desk import Desk
from ctlabs.workbench.desk.folder import FILE, StoreError, Unwritable, writable
from ctlabs.workbench.desk.session import Session
from ctlabs.workbench.desk.store import Store
from ctlabs.workbench.runs import catalogue
from ctlabs.workbench.serving import server
from ctlabs.workbench.serving.safety import TOKEN, kept_token
from tests.workbench_browser import Visit, opened, visit, workbench

__all__ = ["opened", "visit", "workbench"]

#: Names that mean something to a browser, to LaTeX, to a shell, to a spreadsheet, to a path.
ODD = (
    "<img src=x onerror='window.pwned=1'>", "<script>window.pwned=1</script>", "'\"><svg onload=window.pwned=1>",
    "{{constructor.constructor('window.pwned=1')()}}", r"\href{javascript:window.pwned=1}{x}", r"\input{/etc/passwd}",
    "$(touch pwned)", "=HYPERLINK(1)", "../../../etc/passwd", "a\u202eb", "x" * 300,
)  # fmt: skip


# Other users of the machine ----------------------------------------------------------------------------------------------


def test_the_token_is_read_by_its_owner_only_and_stays(tmp_path: Path) -> None:
    """The same at the next start; one that others could have read, or that is none, is replaced."""
    folder = tmp_path / "data"
    first = kept_token(folder)
    path = folder / TOKEN
    assert kept_token(folder) == first
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    path.chmod(0o644)
    second = kept_token(folder)
    assert second != first
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    for wrong in ("", "short", "é" * 32, second + "\n" + second):
        path.write_text(wrong)
        path.chmod(0o600)
        third = kept_token(folder)
        assert re.fullmatch(r"[\w-]{32}", third)
        assert third != second
    assert {each.name for each in folder.iterdir()} == {TOKEN}


def test_without_a_folder_the_token_is_one_for_this_start(tmp_path: Path) -> None:
    """Nothing is raised, and no two starts have the same."""
    (tmp_path / "file").write_text("")
    assert kept_token(tmp_path / "file" / "data") != kept_token(tmp_path / "file" / "data")


def test_the_token_is_in_no_programs_arguments(tmp_path: Path) -> None:
    """The browser is given a file that its owner alone reads; it leads to the address with the token."""
    address = "http://127.0.0.1:8080/?token=secretsecretsecret"
    given = server.door(address, tmp_path)
    assert "secret" not in given
    path = tmp_path / "open.html"
    assert given == path.as_uri()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert f"url={address}" in path.read_text()
    assert server.door(address, tmp_path / "none") == address
    assert server.door("http://127.0.0.1:8080/", tmp_path) == "http://127.0.0.1:8080/"


def test_only_a_loopback_address_may_do_without() -> None:
    """Said before anything listens."""
    with pytest.raises(ValueError, match=r"host: expected a loopback address without a token, received 0.0.0.0"):
        server.serve("0.0.0.0", 0, show=False, open_to_all=True)


# Disks -------------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name == "nt", reason="modes of folders are another matter there")
def test_what_cannot_be_written_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder, or the file in it; whoever runs the tests, the system is asked and not tried."""
    asked: list[Path] = []

    def access(path: Path, _mode: int) -> bool:
        asked.append(Path(path))
        return Path(path).name != FILE

    monkeypatch.setattr(os, "access", access)
    writable(tmp_path)
    (tmp_path / FILE).write_bytes(b"")
    with pytest.raises(Unwritable, match=r"expected a folder that can be written, received one that cannot$"):
        writable(tmp_path)
    with pytest.raises(Unwritable):
        Store(tmp_path)
    assert asked[0] == tmp_path


class _Plain:
    browser = "a"

    def refresh_soon(self) -> None:
        """Nothing."""


def _full(store: Store) -> None:
    """From now on the database takes no more."""
    with store._engine.connect() as connection:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")


def test_on_a_full_disk_a_result_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It cannot be kept, and is there."""
    store = Store(tmp_path)
    session = Session.begin(store)
    session.do(c.New(2, 1, 1))
    session.set_plan(runs=20, steps=10)
    _full(store)
    with pytest.raises(StoreError, match="full"):
        session.do(c.Open("format = 1\n# " + "z" * 400_000 + "\n"))
    big, kept = session._keep, []  # type: Callable[..., int], list[int]

    def keep(*args: Any) -> int:
        kept.append(1)
        store.put("z" * 500_000)
        return big(*args)

    monkeypatch.setattr(session, "_keep", keep)
    found = asyncio.run(session.run())
    assert kept == [1]
    assert session.result is found
    assert session.result_id is None
    store.close()


# Kills -------------------------------------------------------------------------------------------------------------------


def test_a_run_that_a_killed_server_has_not_ended_is_told_once(tmp_path: Path) -> None:
    """The draft says that one goes on; who opens it next hears that it was interrupted, and nobody after."""
    store = Store(tmp_path)
    session = Session.begin(store)
    store.note(session.draft.id, running=True)
    store.close()
    desk = Desk(tmp_path, shared=True, session="ctlabs.workbench.desk.session:Session")
    seat = desk.enter(_Plain(), session.draft.id)
    assert [line for line in seat.notices if "interrupted" in line]
    assert not [line for line in desk.enter(_Plain(), session.draft.id).notices if "interrupted" in line]
    desk.close()
    store = Store(tmp_path)
    found = store.draft(session.draft.id)
    assert found is not None
    assert found.notes["running"] is False
    store.close()


def test_two_servers_on_one_folder_lose_no_edit(tmp_path: Path) -> None:
    """Both type into cells of their own at the same time; in the end both have all of it."""
    stores = [Store(tmp_path), Store(tmp_path)]
    first = Session.begin(stores[0])
    first.do(c.New(3, 1, 1))
    sessions = [first, Session.resume(stores[1], first.draft.id)]
    failed: list[Exception] = []

    def type_(session: Session, column: int) -> None:
        for k in range(12):
            for _ in range(50):
                try:
                    session.do(c.EditCell(("model", "F", k % 3, column), f"{k}.5"))
                    break
                except ValueError as why:  # edited twice within one command: it is typed again
                    if "edited elsewhere" not in str(why):
                        failed.append(why)

    threads = [threading.Thread(target=type_, args=each) for each in zip(sessions, (0, 2), strict=True)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert failed == []
    for session in sessions:
        session.again()
        cells = [[cell.text for cell in row] for row in session.sheet.grids["F"].rows]
        assert [row[0] for row in cells] == [row[2] for row in cells] == ["9.5", "10.5", "11.5"]
    assert sessions[0].text == sessions[1].text
    for store in stores:
        store.close()


# Names -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("odd", [*ODD, "%2e%2e", "..", "task07/../x", "\0", "C:\\x"])
def test_a_path_is_made_of_ids_and_names_only(tmp_path: Path, odd: str) -> None:
    """Draft, lab and run of a report."""
    for draft, lab in ((odd, "task07"), ("0" * 16, odd)):
        with pytest.raises(ValueError, match="expected a draft and a lab"):
            catalogue.place(tmp_path, draft, lab)
    place = catalogue.place(tmp_path, "0" * 16, "task07")
    if "\0" not in odd:
        assert catalogue.kept(place / odd) == []


@pytest.fixture
def odd_model() -> str:
    """A model whose words are all of them odd."""
    names = [f"{i}{odd}"[:60] for i, odd in enumerate(ODD[:2])]
    quoted = [name.replace("\\", "\\\\").replace('"', '\\"') for name in (*names, *ODD)]
    return (
        f'format = 1\ntitle = "{quoted[2]}"\ndescription = "{quoted[3]}"\nsource = "{quoted[4]}"\nkind = "continuous"\n'
        f'[constants]\nq = {{ value = 1, min = 0.1, max = 2, unit = "{quoted[5]}", meaning = "{quoted[6]}" }}\n'
        f'[model]\nstates = ["{quoted[0]}", "{quoted[1]}"]\nunits = ["{quoted[7]}", "{quoted[4]}"]\n'
        f'measurements = ["{quoted[3]}"]\nF = [[0, 1], [-1, -1]]\nG = [[0], [1]]\nQ = [["q"]]\nH = [[1, 0]]\nR = [[1]]\n'
        "P0 = [[1, 0], [0, 1]]\ndt = 0.1\n[experiment]\nsteps = 20\nruns = 20\n"
    )


@pytest.mark.slow
def test_no_word_of_a_model_becomes_a_script(visit: Callable[..., Visit], odd_model: str) -> None:
    """On any page, and in an address."""
    tab = visit().tab()
    tab.load(odd_model)
    tab.cell("F", 0, 0).wait_for()
    for page in ("understand", "experiment", "keep", "labs", "model"):
        tab.go(page)
        if page == "experiment":
            tab.run(runs=20, steps=20)
        tab.page.wait_for_timeout(500)
        assert tab.page.evaluate("window.pwned") is None, page
    tab.open(f"{tab.visit.server.address}/labs?lab=7&Q=<img src=x onerror=window.pwned=1>&<script>=1")
    tab.page.wait_for_selector(".ctl-lab-form")
    assert tab.page.evaluate("window.pwned") is None
    tab.open(f"{tab.visit.server.address}/labs?lab=<script>window.pwned=1</script>")
    assert tab.page.evaluate("window.pwned") is None
