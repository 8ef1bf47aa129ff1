"""A damaged database gives back what can be read of it: whatever is damaged, nothing that was readable is lost, nothing is invented."""

from __future__ import annotations

import os
import random
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from ctlabs.files.modelfile import gallery
from ctlabs.workbench.desk.store import FILE, Store

PAGE = 4096
MODELS = [entry.text for entry in gallery()]


def filled(folder: Path) -> dict[str, list[str]]:
    """A folder with drafts that have a history, and experiments; the texts of each draft's steps by its id."""
    kept: dict[str, list[str]] = {}
    store = Store(folder)
    for i in range(12):
        draft = store.new_draft("local", "local", MODELS[i % len(MODELS)]).id
        kept[draft] = [MODELS[i % len(MODELS)]]
        for step in range(8):
            kept[draft].append(f"# {i} {step}\n{MODELS[(i + step) % len(MODELS)]}")
            store.edit(draft, kept[draft][-1], f"step {step}", notes={"part": step})
        if i % 3 == 0:
            store.keep("local", f"experiment {i}", kept[draft][-1], {"runs": i}, i, {"x": list(range(500))})
    store.close()
    return kept


def zeroed(page: int) -> Callable[[bytes], bytes]:
    """Nothing where a page was."""
    return lambda whole: whole[: page * PAGE] + bytes(PAGE) + whole[(page + 1) * PAGE :]


def random_page(page: int) -> Callable[[bytes], bytes]:
    """Anything where a page was."""
    return lambda whole: whole[: page * PAGE] + random.Random(page).randbytes(PAGE) + whole[(page + 1) * PAGE :]


def truncated(share: float) -> Callable[[bytes], bytes]:
    """The beginning of the file, not even whole pages."""
    return lambda whole: whole[: int(share * len(whole))]


def garbage(size: int) -> Callable[[bytes], bytes]:
    """Another head."""
    return lambda whole: random.Random(size).randbytes(size) + whole[size:]


def opened(folder: Path, kept: dict[str, list[str]], damage: Callable[[bytes], bytes]) -> tuple[Store, int, int]:
    """A store on a file that was damaged; how many drafts, and how many of their steps, came back. All of these are true ones."""
    path = folder / FILE
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    store = Store(folder)
    drafts = store.drafts("local")
    steps = 0
    for draft in drafts:
        history = store.history(draft.id)
        assert all(step.text == kept[draft.id][step.number] for step in history)
        assert draft.text in kept[draft.id]
        steps += len(history)
    for each in store.experiments("local"):
        assert store.results(each.id)["x"] == list(range(500))
    return store, len(drafts), steps


def said(store: Store) -> tuple[int, int, int]:
    """How many drafts, steps and results the notice says."""
    found = re.search(r"; (\d+) drafts? with (\d+) steps? of editing and (\d+) kept results? were saved from it", store.notice)
    assert found, store.notice
    return int(found[1]), int(found[2]), int(found[3])


@pytest.mark.parametrize("size", [16, 100, PAGE])
def test_with_a_garbage_head_all_is_saved(tmp_path: Path, size: int) -> None:
    """The first page says where the tables lie; that of a new file says it, too."""
    kept = filled(tmp_path)
    store, drafts, steps = opened(tmp_path, kept, garbage(size))
    assert (drafts, steps) == (12, 12 * 9)
    assert said(store) == (12, 12 * 9, 4)
    assert len(store.experiments("local")) == 4
    assert store.edit(store.drafts("local")[0].id, "title = 'on'") == 9
    store.close()
    again = Store(tmp_path)
    assert again.notice == ""
    assert len(again.drafts("local")) == 12
    again.close()


@pytest.mark.parametrize("damage", [zeroed, random_page])
def test_with_one_page_gone_nearly_all_is_saved(tmp_path: Path, damage: Callable[[int], Callable[[bytes], bytes]]) -> None:
    """Of every page in turn: a leaf of a table takes its rows with it, and those behind it are read; what is said is what there is."""
    kept = filled(tmp_path / "whole")
    whole = (tmp_path / "whole" / FILE).read_bytes()
    least = 12 * 9
    for page in range(0, len(whole) // PAGE, 3):
        folder = tmp_path / f"{page}"
        folder.mkdir()
        (folder / FILE).write_bytes(whole)
        store, drafts, steps = opened(folder, kept, damage(page))
        if store.notice:
            assert said(store)[:2] == (drafts, steps)
            least = min(least, steps)
        store.close()
    assert least >= 12 * 9 - 30


def test_of_a_truncated_file_the_beginning_is_saved(tmp_path: Path) -> None:
    """The more of the file there is, the more steps, and every draft of which there is one; and that something is lost is said."""
    kept = filled(tmp_path / "whole")
    whole = (tmp_path / "whole" / FILE).read_bytes()
    counts = []
    for share in (0.25, 0.5, 0.75, 0.95):
        folder = tmp_path / f"{share}"
        folder.mkdir()
        (folder / FILE).write_bytes(whole)
        store, drafts, steps = opened(folder, kept, truncated(share))
        assert said(store)[:2] == (drafts, steps)
        assert "could not be read" in store.notice
        counts.append(steps)
        store.close()
    assert 0 < counts[0] < counts[1] < counts[2] < counts[3] < 12 * 9
    assert counts[3] > 0.8 * 12 * 9


def test_a_draft_whose_own_row_is_lost_has_its_steps(tmp_path: Path) -> None:
    """Its settings are gone, its history is not; a draft whose present step is lost is at the one before."""
    kept = filled(tmp_path)
    first, second = list(kept)[:2]
    with sqlite3.connect(tmp_path / FILE) as raw:
        raw.execute("DELETE FROM draft WHERE id = ?", (first,))
        raw.execute("DELETE FROM revision WHERE draft = ? AND number = 8", (second,))
    raw.close()
    store, drafts, _ = opened(tmp_path, kept, garbage(16))
    assert drafts == 12
    found = {draft.id: draft.number for draft in store.drafts("local")}
    assert (found[first], found[second]) == (8, 7)
    store.close()


def test_what_was_not_written_back_is_saved_too(tmp_path: Path) -> None:
    """Edits that are still in the file beside the database, where a server was killed."""
    store = Store(tmp_path / "running")
    draft = store.new_draft("local", "local", "").id
    store.edit(draft, MODELS[0])
    copy = tmp_path / "killed"
    copy.mkdir()
    for part in (tmp_path / "running").glob(f"{FILE}*"):
        (copy / part.name).write_bytes(part.read_bytes())
    store.close()
    path = copy / FILE
    path.write_bytes(os.urandom(max(len(path.read_bytes()), PAGE)))
    saved = Store(copy)
    assert [each.text for each in saved.drafts("local")] == [MODELS[0]]
    saved.close()
