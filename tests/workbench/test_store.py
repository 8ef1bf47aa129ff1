"""What the workbench keeps: drafts with their history, experiments, and what happens to a file that is not whole."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ctlabs.workbench.desk import store as module
from ctlabs.workbench.desk.store import FILE, Store, StoreError, data_folder, pack, unpack


@pytest.fixture
def store(tmp_path: Path) -> Any:
    kept = Store(tmp_path)
    yield kept
    kept.close()


def test_a_draft_is_found_again_after_reopening(tmp_path: Path) -> None:
    """Text, position in the history, notes and session survive the end of the process that wrote them."""
    first = Store(tmp_path)
    draft = first.new_draft("me", "tab", "F = 0", label="new", notes={"page": "model"})
    assert first.edit(draft.id, "F = 1", "set F") == 1
    assert first.edit(draft.id, "F = 2", "set F", notes={"runs": 10}) == 2
    first.move(draft.id, 1)
    first.close()
    second = Store(tmp_path)
    found = second.draft(draft.id)
    assert found is not None
    assert (found.text, found.number, found.session, found.owner) == ("F = 1", 1, "tab", "me")
    assert found.notes == {"page": "model", "runs": 10}
    assert [(r.number, r.label, r.text) for r in second.history(draft.id)] == [
        (0, "new", "F = 0"), (1, "set F", "F = 1"), (2, "set F", "F = 2"),
    ]  # fmt: skip
    assert second.notice == ""
    second.close()


def test_an_edit_drops_what_was_undone(store: Store) -> None:
    """After undo, undo, edit there is one way forward: the new text."""
    draft = store.new_draft("me", "tab", "0").id
    for text in "123":
        store.edit(draft, text)
    assert store.move(draft, 1) == "1"
    assert store.edit(draft, "other") == 2
    assert [r.text for r in store.history(draft)] == ["0", "1", "other"]
    with pytest.raises(LookupError, match=f"draft {draft}: expected one of its revisions, received number 3"):
        store.move(draft, 3)
    assert store.draft(draft).text == "other"  # type: ignore[union-attr]  # it exists


def test_the_oldest_revisions_are_forgotten_first(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A history is bounded; the present text and those just before it stay."""
    monkeypatch.setattr(module, "REVISIONS", 5)
    draft = store.new_draft("me", "tab", "0").id
    for i in range(1, 20):
        store.edit(draft, str(i))
    assert [r.text for r in store.history(draft)] == ["15", "16", "17", "18", "19"]


@given(st.lists(st.tuples(st.sampled_from(["edit", "undo", "redo"]), st.text(max_size=8)), max_size=25))
def test_history_is_that_of_an_editor(steps: list[tuple[str, str]]) -> None:
    """Any sequence of edits, undos and redos leaves the text that a list with a pointer has."""
    kept = _memory()
    draft = kept.new_draft("me", "tab", "begin").id
    texts, at = ["begin"], 0
    for verb, text in steps:
        if verb == "edit":
            texts, at = [*texts[: at + 1], text], at + 1
            assert kept.edit(draft, text) == at
        else:
            wanted = at + (1 if verb == "redo" else -1)
            if 0 <= wanted < len(texts):
                at = wanted
                assert kept.move(draft, at) == texts[at]
    found = kept.draft(draft)
    assert found is not None
    assert (found.text, found.number) == (texts[at], at)
    assert [r.text for r in kept.history(draft)] == texts


_SHARED: list[Store] = []


def _memory() -> Store:
    """One store for all examples of a property: a file each would be slow."""
    if not _SHARED:
        import tempfile

        _SHARED.append(Store(tempfile.mkdtemp()))
    return _SHARED[0]


def test_drafts_are_listed_by_owner_and_session(store: Store) -> None:
    """Others' drafts are not shown, and are not opened by those who know their id; the latest is first."""
    mine, too = store.new_draft("me", "a", "1").id, store.new_draft("me", "b", "2").id
    other = store.new_draft("you", "c", "3").id
    time.sleep(0.002)
    store.edit(mine, "4")
    assert [d.id for d in store.drafts("me")] == [mine, too]
    assert [d.id for d in store.drafts("me", "b")] == [too]
    assert store.draft(other, "me") is None
    assert store.draft(other, "you") is not None
    assert store.draft("nonsense") is None
    store.delete_draft(mine)
    assert [d.id for d in store.drafts("me")] == [too]
    store.delete_draft(mine, undo=True)
    assert [d.id for d in store.drafts("me")] == [mine, too]


def test_experiments_are_kept_to_the_bit(store: Store) -> None:
    """Arrays of every kind, nested, with NaN and infinity, come back equal in type, shape and bytes."""
    rng = np.random.default_rng(1)
    results = {
        "t": np.arange(5) * 0.1,
        "P": rng.normal(size=(5, 2, 2)),
        "S": np.array([[np.inf, np.nan], [-0.0, 5e-324]]),
        "used": np.array([True, False]),
        "poles": np.array([1 + 2j, -3.5]),
        "count": np.array(7),
        "empty": np.zeros((0, 3)),
        "strided": np.arange(12.0).reshape(3, 4)[:, ::2],
        "big_endian": np.arange(3, dtype=">f8"),
        "gain": 1 - 2j,
        "scalar": np.float64(0.1),
        "whole": np.int64(3),
        "table": [{"name": "joseph", "failed": None, "ok": True}],
    }
    number = store.keep("me", "walk", "kind = 1", {"steps": 5, "algorithms": ["ud"]}, 7, results)
    found = store.results(number)
    for name, value in results.items():
        if isinstance(value, np.ndarray):
            assert found[name].dtype == value.dtype.newbyteorder("=")
            assert found[name].shape == value.shape
            assert found[name].tobytes() == value.astype(value.dtype.newbyteorder("=")).tobytes()
            assert found[name].flags.writeable
        else:
            assert found[name] == value
    (experiment,) = store.experiments("me")
    assert (experiment.id, experiment.name, experiment.model, experiment.seed) == (number, "walk", "kind = 1", 7)
    assert experiment.settings == {"steps": 5, "algorithms": ["ud"]}
    assert abs(experiment.created - time.time()) < 60


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"a": [object()]}, r"results\.a\[0\]: expected numbers, .* received a object"),
        ({"a": np.array(["x"])}, r"results\.a: .* received an array of <U1"),
        ({"a": np.array([None])}, r"results\.a: .* received an array of object"),
        ({1: 2}, r"results: expected names for keys, received 1"),
        ({"__array__": 2}, r"results: expected names for keys, received '__array__'"),
        ({"a": np.datetime64("2020-01-01")}, r"results\.a: .* received a datetime64"),
    ],
)
def test_results_that_cannot_be_kept_are_named(value: Any, message: str) -> None:
    """What is not a number, a text or an array of numbers is refused with its place."""
    with pytest.raises(TypeError, match=message):
        pack(value)


def test_compact() -> None:
    """A constant covariance over 1000 steps takes a small part of its bytes, noise hardly more than them."""
    assert len(pack(np.ones((1000, 3, 3)))) < 1000
    noise = np.random.default_rng(2).normal(size=10_000)
    assert len(pack(noise)) < 1.4 * noise.nbytes
    assert np.array_equal(unpack(pack(noise)), noise)


def test_deleting_can_be_undone(store: Store) -> None:
    """A deleted experiment leaves the list, waits in the list of deleted ones, and comes back whole."""
    first, second = (store.keep("me", name, "m", {}, 1, {"x": np.eye(2)}) for name in ("one", "two"))
    store.delete(first)
    assert [e.id for e in store.experiments("me")] == [second]
    (gone,) = store.experiments("me", deleted=True)
    assert gone.id == first
    assert gone.deleted is not None
    store.delete(first, undo=True)
    assert [e.id for e in store.experiments("me")] == [second, first]
    assert np.array_equal(store.results(first)["x"], np.eye(2))
    store.rename(first, "first")
    assert store.experiment(first).name == "first"  # type: ignore[union-attr]  # it exists
    assert store.experiment(first, "you") is None
    with pytest.raises(LookupError, match="experiment 99: expected one that is kept, received an unknown one"):
        store.delete(99)
    with pytest.raises(LookupError, match=r"experiment 99: .* received an unknown number"):
        store.results(99)
    with pytest.raises(LookupError, match="draft none: expected one that is kept, received an unknown id"):
        store.edit("none", "text")


def test_only_old_deletions_and_untouched_drafts_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening forgets for good what was deleted a month ago and drafts nobody edited; numbers are not given again."""
    kept = Store(tmp_path)
    gone, stays = kept.keep("me", "gone", "m", {}, 1, {}), kept.keep("me", "stays", "m", {}, 1, {})
    untouched, edited, noted = (kept.new_draft("me", "s", "").id for _ in range(3))
    removed = kept.new_draft("me", "s", "").id
    kept.edit(edited, "x")
    kept.edit(removed, "x")
    kept.note(noted, name="mine")
    kept.delete(gone)
    kept.delete_draft(removed)
    kept.close()
    later = time.time() + 31 * 86400
    monkeypatch.setattr(module.time, "time", lambda: later)
    again = Store(tmp_path)
    assert [e.id for e in again.experiments("me")] == [stays]
    assert again.experiments("me", deleted=True) == []
    assert {d.id for d in again.drafts("me")} == {edited, noted}
    assert again.draft(untouched) is None
    assert again.draft(removed) is None
    assert again.history(removed) == []
    assert again.keep("me", "new", "m", {}, 1, {}) == stays + 1
    again.close()


def test_a_long_text_is_kept_once_and_as_long_as_something_names_it(tmp_path: Path) -> None:
    """A record of many megabytes is not written again with every experiment, and goes with the last one."""
    first = Store(tmp_path)
    draft = first.new_draft("me", "tab", "x").id
    key, other = first.put("z\n" * 10**6), first.put("z\n" * 9)
    assert first.put("z\n" * 10**6) == key != other
    first.note(draft, plan={"data": {"key": key}})
    number = first.keep("me", "one", "x", {"data": {"key": other}}, 1, {})
    first.close()
    second = Store(tmp_path)
    assert second.text(key) == "z\n" * 10**6
    assert second.text(other) == "z\n" * 9
    second.note(draft, plan={"data": None})
    second.delete(number)
    second.close()
    third = Store(tmp_path)
    assert third.text(other) == "z\n" * 9  # the deletion can be taken back
    with pytest.raises(LookupError, match="expected one that is kept"):
        third.text(key)
    third.close()


def test_a_text_without_end_is_refused(store: Store) -> None:
    """A model's text has a length, so that a paste cannot fill the disk with revisions."""
    draft = store.new_draft("me", "s").id
    with pytest.raises(ValueError, match="model: expected a text of at most 1000000 characters, received 1000001"):
        store.edit(draft, "x" * 1_000_001)


def test_many_threads_lose_no_edit(store: Store) -> None:
    """Eight tabs that edit and read at once: every edit is in its draft's history, in order; none waits long."""
    drafts, failures = [store.new_draft("me", str(i)).id for i in range(8)], []

    def work(draft: str) -> None:
        try:
            for i in range(40):
                store.edit(draft, str(i))
                store.drafts("me")
                if i % 10 == 0:
                    store.keep("me", draft, "m", {}, i, {"x": np.arange(100)})
        except Exception as why:
            failures.append(why)

    threads = [threading.Thread(target=work, args=(draft,)) for draft in drafts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert failures == []
    for draft in drafts:
        assert [r.text for r in store.history(draft)] == ["", *map(str, range(40))]
    assert len(store.experiments("me")) == 32


def test_two_tabs_on_one_draft_interleave(store: Store) -> None:
    """Edits of the same draft from several threads are all there, numbered without a gap."""
    draft = store.new_draft("me", "s").id
    threads = [
        threading.Thread(target=lambda n=n: [store.edit(draft, f"{n}.{i}") for i in range(25)]) for n in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    history = store.history(draft)
    assert [r.number for r in history] == list(range(101))
    assert {r.text for r in history[1:]} == {f"{n}.{i}" for n in range(4) for i in range(25)}


def moved(store: Store, draft: str, *numbers: int) -> None:
    """Go to one step after another, at once."""
    with store.together():
        for number in numbers:
            store.move(draft, number)


def test_changes_that_belong_together_are_all_there_or_none(store: Store) -> None:
    """Others see nothing in between; an exception takes all of them back; afterwards each stands for itself again."""
    draft = store.new_draft("me", "s", "0").id
    store.edit(draft, "1")
    other = Store(store.folder)
    with store.together():
        assert store.move(draft, 0) == "0"
        assert store.edit(draft, "2") == 1
        assert store.draft(draft).text == "2"  # type: ignore[union-attr]  # it exists
        assert other.draft(draft).text == "1"  # type: ignore[union-attr]  # it exists
    assert other.draft(draft).text == "2"  # type: ignore[union-attr]  # it exists
    with pytest.raises(LookupError):
        moved(store, draft, 0, 7)
    assert other.draft(draft).text == store.draft(draft).text == "2"  # type: ignore[union-attr]  # it exists
    assert store.edit(draft, "3") == 2
    assert [step.text for step in other.history(draft)] == ["0", "2", "3"]
    other.close()


_EDITOR = """
import sys
from ctlabs.workbench.desk.store import Store
store = Store(sys.argv[1])
draft = store.new_draft("me", "s", "0").id
print(draft, flush=True)
for i in range(1, 10**6):
    store.edit(draft, str(i))
    print(i, flush=True)
"""


def test_a_killed_process_has_lost_nothing(tmp_path: Path) -> None:
    """After SIGKILL in the middle of writing, every edit that was answered is in the file, which opens without complaint."""
    process = subprocess.Popen(
        [sys.executable, "-c", _EDITOR, str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert process.stdout is not None
    draft = process.stdout.readline().strip()
    said = [process.stdout.readline() for _ in range(50)]
    os.kill(process.pid, signal.SIGKILL)
    said += process.stdout.readlines()
    process.stdout.close()
    process.wait(10)
    last = int(next(line for line in reversed(said) if line.endswith("\n")))
    kept = Store(tmp_path)
    found = kept.draft(draft)
    assert kept.notice == ""
    assert found is not None
    assert found.number >= last
    assert [r.text for r in kept.history(draft)][-1] == str(found.number)
    kept.close()


@pytest.mark.parametrize("how", ["text", "middle", "short"])
def test_a_damaged_file_is_moved_aside_and_said_so(tmp_path: Path, how: str) -> None:
    """Whatever the damage, the old bytes stay under another name, the notice names it, and a new file works."""
    kept = Store(tmp_path)
    draft = kept.new_draft("me", "s", "x" * 20_000).id
    for i in range(20):
        kept.edit(draft, f"{'y' * 20_000}{i}")
    kept.close()
    path = tmp_path / FILE
    whole = path.read_bytes()
    size = len(whole)
    broken = {
        "text": b"this is not a database at all\n" * 200,
        "middle": whole[: size // 4] + os.urandom(size // 2) + whole[3 * size // 4 :],
        "short": whole[: size // 2],
    }[how]
    path.write_bytes(broken)
    again = Store(tmp_path)
    (aside,) = tmp_path.glob(f"{FILE}.damaged-*")
    assert aside.read_bytes() == broken
    assert again.notice.startswith(f"{path}: expected a whole database, received ")
    assert aside.name in again.notice
    assert "\n" not in again.notice
    if how == "text":
        assert again.notice.endswith("; nothing in it could be read")
        assert again.drafts("me") == []
    assert again.edit(again.new_draft("me", "s").id, "new") == 1
    again.close()
    third = Store(tmp_path)
    assert third.notice == ""
    third.close()


def test_a_file_of_another_version_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    """Tables of a newer ctlabs are not touched; the line says what to do."""
    Store(tmp_path).close()
    path = tmp_path / FILE
    with sqlite3.connect(path) as raw:
        raw.execute("PRAGMA user_version = 2")
    raw.close()
    before = path.read_bytes()
    with pytest.raises(
        StoreError, match=r"expected tables of version 1, received 2 \(a newer ctlabs wrote it: update ctlabs"
    ):
        Store(tmp_path)
    assert path.read_bytes() == before


def test_another_programs_database_is_refused(tmp_path: Path) -> None:
    """A database that is not ours is neither filled with our tables nor moved away."""
    path = tmp_path / FILE
    with sqlite3.connect(path) as raw:
        raw.execute("CREATE TABLE theirs (x)")
    raw.close()
    with pytest.raises(StoreError, match="expected a file of the workbench, received another program's database"):
        Store(tmp_path)
    with sqlite3.connect(path) as raw:
        assert raw.execute("SELECT name FROM sqlite_master").fetchall() == [("theirs",)]
    raw.close()


def test_a_folder_that_cannot_be_made_is_said_in_one_line(tmp_path: Path) -> None:
    """A file in the way of the folder."""
    (tmp_path / "file").write_text("")
    with pytest.raises(
        StoreError, match="file/deeper: expected a folder for the workbench's data, received Not a directory"
    ):
        Store(tmp_path / "file" / "deeper")


def test_a_disk_that_refuses_is_said_in_one_line(tmp_path: Path) -> None:
    """What SQLite refuses in the middle of the work is an error of one line, and the text before it stays."""
    kept = Store(tmp_path)
    draft = kept.new_draft("me", "s", "before").id
    with kept._engine.connect() as connection:  # the one pooled connection
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(
        StoreError, match=r"workbench.sqlite3: expected a database that can be written, received: .*full$"
    ):
        kept.edit(draft, "z" * 500_000)
    assert kept.draft(draft).text == "before"  # type: ignore[union-attr]  # it exists
    kept.close()


def test_where_the_data_are(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """CTLABS_DATA wins over the system's folder."""
    monkeypatch.setenv("CTLABS_DATA", str(tmp_path / "here"))
    assert data_folder() == tmp_path / "here"
    monkeypatch.delenv("CTLABS_DATA")
    assert data_folder().name == "ctlabs"
    assert data_folder().is_absolute()
