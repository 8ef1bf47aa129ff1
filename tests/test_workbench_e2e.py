"""The workbench as a student uses it, in a real browser: from an empty page to an exported report, and what may go wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.workbench_browser import (  # noqa: F401  # fixtures
    DESKTOP,
    PAGES,
    PHONE,
    Visit,
    Workbench,
    another,
    opened,
    until,
    visit,
    workbench,
)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]
Visits = Callable[..., Visit]


def fresh(visit: Visits, ready: str = ""):  # noqa: F811
    """A tab of a person who has never been here, with a ready model where one is named."""
    tab = visit().tab("model", "?draft=new")
    if ready:
        tab.get("begin-ready").click()
        tab.get(f"ready-{ready}").first.click()
        tab.page.wait_for_selector("[data-test^='cell-']")
    return tab


def test_three_states_typed_on_an_empty_page_become_a_report(visit: Visits, tmp_path: Path):  # noqa: F811
    """Type a model, run it, export the report: what the issue calls a first session."""
    tab = fresh(visit)
    tab.get("begin-new").click()
    for name, number in (("n", "3"), ("s", "1"), ("m", "1")):
        tab.field(f"new-{name}").fill(number)
    tab.get("new-begin").click()
    tab.type(
        F=[[0, 1, 0], [0, 0, 1], [0, 0, "-1/10"]], G=[[0], [0], [1]], Q=[["0.2"]], H=[[1, 0, 0]], R=[["4"]],
        P0=[[100, 0, 0], [0, 10, 0], [0, 0, 1]],
    )  # fmt: skip
    until(lambda: tab.get("problems").get_attribute("data-count") == "0")
    tab.go("experiment")
    tab.run()
    tab.go("keep")
    tab.get("export").first.click()
    with tab.page.expect_download() as waiting:
        tab.get("export-html").click()
    report = tmp_path / "report.html"
    waiting.value.save_as(report)
    assert "<math" in report.read_text()


def test_an_error_stands_at_its_cell_until_it_is_mended(visit: Visits):  # noqa: F811
    """An unknown name is told beside the cell; a right one takes it away."""
    tab = fresh(visit, "singer")
    cell = tab.cell("F", 1, 2)
    cell.fill("omga")
    tab.page.wait_for_selector("text=unknown name")
    until(lambda: cell.get_attribute("aria-invalid") == "true")
    cell.fill("1")
    until(lambda: cell.get_attribute("aria-invalid") != "true")


def test_undo_and_redo_by_keys(visit: Visits):  # noqa: F811
    """Ctrl-Z takes an edit back, Ctrl-Shift-Z brings it again."""
    tab = fresh(visit, "singer")
    cell = tab.cell("F", 0, 2)
    before = cell.input_value()
    cell.fill("7")
    tab.press("Tab")
    until(lambda: "7" in tab.get("equations").inner_text())
    tab.get("undo").click()
    until(lambda: cell.input_value() == before)
    tab.press("Control+Shift+Z")
    until(lambda: cell.input_value() == "7")


def test_a_killed_server_comes_back_with_everything(another: Callable[..., Workbench], opened):  # noqa: F811
    """SIGKILL in the middle of an edit: after a restart the cell and its undo are there."""
    server = another()
    server.start()
    person = Visit(opened, server)
    person.forgiven = "ERR_CONNECTION|WebSocket|Failed to load"
    tab = person.tab("model")
    tab.get("begin-ready").click()
    tab.get("ready-singer").first.click()
    cell = tab.cell("F", 0, 2)
    before = cell.input_value()
    cell.fill("7")
    tab.page.wait_for_selector("text=Saved")
    until(lambda: "7" in tab.get("equations").inner_text())
    server.kill()
    server.start()
    tab.open(f"{server.address}/model")
    until(lambda: tab.cell("F", 0, 2).input_value() == "7")
    tab.get("undo").click()
    until(lambda: tab.cell("F", 0, 2).input_value() == before)
    person.context.close()
    person.check()


def test_a_long_run_is_cancelled_and_the_page_goes_on(visit: Visits):  # noqa: F811
    """Ten million runs begin; cancel ends them, and a small run follows."""
    tab = fresh(visit, "singer")
    tab.go("experiment")
    tab.field("runs").fill("10000000")
    tab.press("Tab")
    tab.get("run").click()
    tab.get("cancel").first.click()
    until(lambda: tab.get("run").is_enabled())
    tab.field("runs").fill("50")
    tab.press("Tab")
    tab.run()


def test_algorithms_stand_side_by_side(visit: Visits):  # noqa: F811
    """Two chosen algorithms are two rows of the table."""
    tab = fresh(visit, "singer")
    tab.go("experiment")
    tab.get("algorithm-ud").click()
    tab.run()
    tab.page.get_by_role("tab", name="Algorithms").click()
    table = tab.page.locator("[data-test='results'] table", has_text="Joseph")
    table.wait_for()
    assert "UD" in table.inner_text()


def test_a_measured_record_is_filtered_and_a_broken_one_refused(visit: Visits):  # noqa: F811
    """A table of numbers is read; a text in a number is told with its line."""
    tab = fresh(visit, "local_level")
    tab.go("experiment")
    chooser = tab.page.locator("input[type=file]").first
    chooser.set_input_files({"name": "bad.csv", "mimeType": "text/csv", "buffer": b"flow\n1120\nmany\n963\n"})
    tab.page.wait_for_selector("text=line 3")
    chooser.set_input_files({"name": "flow.csv", "mimeType": "text/csv", "buffer": b"flow\n1120\n1160\n963\n\n1210\n"})
    tab.page.wait_for_selector("text=flow.csv")
    tab.run()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_every_page_fits_its_window(visit: Visits, size: dict[str, int], scheme: str):  # noqa: F811
    """No page is wider than the window, at a desk and on a phone, light and dark."""
    person = visit(viewport=size, color_scheme=scheme)
    tab = person.tab("model")
    for page in PAGES:
        tab.open(f"{person.server.address}/{page}")
        assert tab.widest() <= 0, page


def test_the_exported_numbers_are_those_of_the_run(visit: Visits, tmp_path: Path):  # noqa: F811
    """results.json has the seed and the runs of the experiment."""
    tab = fresh(visit, "singer")
    tab.go("experiment")
    tab.field("seed").fill("5")
    tab.press("Tab")
    tab.run()
    tab.go("keep")
    tab.get("export").first.click()
    with tab.page.expect_download() as waiting:
        tab.get("export-json").click()
    path = tmp_path / "results.json"
    waiting.value.save_as(path)
    assert re.search(r'"seed":\s*5\b', path.read_text())
    json.loads(path.read_text())
