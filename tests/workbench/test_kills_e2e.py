"""The server is killed at any moment, while somebody types and an experiment runs: nothing is lost that was shown as saved."""

from __future__ import annotations

import random
import re
import threading
import time
from collections.abc import Callable
from contextlib import closing

import pytest

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.files.modelfile import loads
from ctlabs.workbench.desk.store import Store
from tests.workbench.test_e2e import begun
from tests.workbench_browser import Tab, Visit, Workbench, another, opened, visit, workbench

__all__ = ["another", "opened", "visit", "workbench"]
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]

#: How often it is killed, and within which time after the page is there, in seconds.
KILLS, WITHIN = 20, 1.5
#: What the page says in one moment: whether all is saved, and what stands in the cell.
SHOWN = """() => {
  const said = document.querySelector(".ctl-saved"), cell = document.querySelector("[data-test=cell-H-0-1]");
  const seen = said?.dataset.state === "saved" && getComputedStyle(said).visibility === "visible";
  return cell && seen ? cell.value : "";
}"""


def typed_until_killed(tab: Tab, server: Workbench, wait: float, word: Callable[[], str]) -> str:
    """Type and type until the server is gone; the last text that was shown as saved."""
    killer = threading.Timer(wait, server.kill)
    killer.start()
    seen, gone = "", time.monotonic() + wait + 0.3
    while time.monotonic() < gone:
        tab.page.evaluate(
            "text => { const cell = document.querySelector('[data-test=cell-H-0-1]'); cell.value = text;"
            " cell.dispatchEvent(new Event('input', {bubbles: true})); }",
            word(),
        )
        for _ in range(random.randrange(1, 12)):
            seen = str(tab.page.evaluate(SHOWN)) or seen
            tab.page.wait_for_timeout(20)
    killer.join()
    return seen


def test_twenty_kills_lose_nothing_that_was_shown_as_saved(another: Callable[..., Workbench], visit: Callable[..., Visit]) -> None:
    """The text that stood beside the word Saved, or a later one, is there; every experiment of which a number was shown is kept."""
    server = another()
    server.start()
    tab = begun(visit, server=server)
    tab.visit.forgiven = r"ERR_CONNECTION_REFUSED|WebSocket connection to|ERR_EMPTY_RESPONSE|ERR_CONNECTION_RESET|Failed to load resource"
    draft = re.search(r"draft=(\w+)", tab.page.url)
    assert draft
    tab.go("experiment")
    tab.run(steps=50, runs=100)
    tab.go("model")
    numbers: set[int] = set()
    count, shown_as_saved = 0, 0

    def word() -> str:
        nonlocal count
        count += 1
        return f"0.{count:06d}1"

    for kill in range(KILLS):
        if kill % 3 == 0:  # every third dies with a run in it
            tab.go("experiment")
            told = tab.get("found-told").text_content() or ""
            numbers |= {int(number) for number in re.findall(r"kept as number (\d+)", told)}
            tab.settle(runs=random.choice([50, 5_000]), seed=kill)
            tab.get("run").click()
            tab.go("model")
            tab.cell("H", 0, 1).wait_for()
        seen = typed_until_killed(tab, server, random.uniform(0.1, WITHIN), word)
        with closing(Store(server.folder / "data")) as store:
            assert store.notice == ""
            kept = store.draft(draft[1])
            assert kept is not None
            text = str(loads(kept.text, "").data()["model"]["H"][0][1])
            assert float(text) >= float(seen or "0"), kill  # what is typed on into one cell is one step
            assert numbers <= {each.id for each in store.experiments("local")}
        shown_as_saved += bool(seen)
        tab.page.wait_for_selector(".ctl-main[inert]", state="attached")
        server.start()
        tab.page.wait_for_selector(".ctl-main:not([inert])[aria-busy=false]")
        assert tab.cell("H", 0, 1).input_value() == text
    assert shown_as_saved > KILLS / 3
    assert numbers
    assert server.errors == []
