"""An engineer with a model and a file, in a real browser: from the drop to the verdict, and from ticked constants to a fitted model.

Fixtures and rules are those of :mod:`tests.workbench_browser`: nothing on the console, nothing to another machine.
"""
# ruff: noqa: F811  # fixtures are imported, and named as arguments

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ctlabs.files.modelfile import ready
from tests import nile
from tests.workbench_browser import (  # noqa: F401  # fixtures
    PHONE,
    Tab,
    Visit,
    opened,
    until,
    visit,
    workbench,
)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]
Visits = Callable[..., Visit]

FLOW = nile.FLOW.copy()
FLOW[50] = 9500.0
LOGGED = "year;Flow (m3/s);gauge\n" + "".join(f"{nile.YEAR + i};{v:g};{i % 7}\n" for i, v in enumerate(FLOW))
NAMED = "flow\n" + "".join(f"{v:g}\n" for v in nile.FLOW)


def begun(visit: Visits, **options: Any) -> Tab:
    """A page of a person who has opened the model of the Nile."""
    tab = visit(**options).tab()
    tab.load(ready("local_level").dumps(), "nile.toml")
    return tab


def chosen(tab: Tab, test: str, words: str) -> None:
    """Choose in a select."""
    tab.page.locator(f"[data-test='{test}']").click()
    tab.page.locator(".q-menu .q-item", has_text=words).first.click()


def suggestion(tab: Tab, words: str) -> None:
    """Wait for the verdict."""
    tab.page.wait_for_selector(f"[data-test=data-suggestion]:has-text('{words}')")


def text(tab: Tab, test: str) -> str:
    return tab.get(test).first.inner_text()


def test_a_logger_s_file_becomes_a_verdict_with_a_row_to_look_at(visit: Visits) -> None:
    """Dropped on the model's page, put right by one button, tested; the spike leads into the figures; the gate leaves it out."""
    tab = begun(visit)
    tab.drop("body", "flow.csv", LOGGED)
    tab.page.wait_for_selector("[data-test=data-refusal-text]:has-text('expected the column flow')")
    assert "100 rows, columns separated by a semicolon" in text(tab, "data-understood")
    assert "flow is in the column “Flow (m3/s)”" in text(tab, "data-remedy-0")
    tab.get("data-remedy-0").click()
    suggestion(tab, "flow = 9500 in line 52")
    tab.curves("plot-record")
    assert tab.points("plot-record", "measurement") == 100
    assert text(tab, "data-row") == "line 52 (t = 1921)"
    tab.get("data-row").first.click()
    tab.page.wait_for_selector("[data-test=data-beside]:has-text('line 52')")
    until(lambda: tab.points("plot-record", "measurement") == 81)
    tab.get("data-whole").click()
    tab.page.wait_for_selector("[data-test=data-beside]", state="detached")
    tab.get("data-take-gate").click()
    tab.page.wait_for_selector("[data-test=data-left-out]:has-text('line 52')")
    suggestion(tab, "Nothing speaks against the model")
    name, content = tab.saved(lambda: tab.get("data-save-csv").click())
    assert name.endswith(".csv")
    assert len(list(csv.DictReader(io.StringIO(content.decode())))) == 100


def test_columns_are_mapped_by_hand_and_the_mapping_is_the_model_s(visit: Visits) -> None:
    """By selects alone; it stands in the model file; undo takes it back column by column; it is there after a reload."""
    tab = begun(visit)
    tab.go("data")
    tab.choose("data-choose", "flow.csv", LOGGED)
    tab.page.wait_for_selector("[data-test=data-refusal-text]")
    chosen(tab, "data-role-2", "measurement flow")
    until(lambda: tab.field("data-role-2").input_value() == "measurement flow")
    tab.page.wait_for_selector("[data-test=data-refusal-text]:has-text('looks like times')")
    chosen(tab, "data-role-1", "the time")
    tab.page.wait_for_selector("[data-test=data-understood]:has-text('the first at 1871')")
    suggestion(tab, "9500")
    tab.field("data-scale-flow").fill("0,001")
    tab.press("Enter")
    tab.page.wait_for_selector("[data-test=data-summary]")
    tab.go("model")
    tab.get("view-text").click()
    until(lambda: "scale = {flow = 0.001}" in tab.get("text").input_value())
    file = tab.get("text").input_value()
    assert 'columns = {flow = "Flow (m3/s)", t = "year"}' in file
    tab.page.reload()
    tab.ready()
    tab.go("data")
    until(lambda: tab.field("data-role-2").input_value() == "measurement flow")
    assert tab.field("data-scale-flow").input_value() == "0.001"
    tab.page.locator("h2").first.click()
    tab.press("Control+z")
    until(lambda: tab.field("data-scale-flow").input_value() == "1")


def test_a_cell_that_is_no_number_is_shown_and_put_right(visit: Visits) -> None:
    """The line is among those shown, the cell is marked, and the button says what its word means."""
    tab = begun(visit)
    tab.go("data")
    cells = ["n.m." if i == 61 else f"{v:g}" for i, v in enumerate(nile.FLOW)]
    tab.choose("data-choose", "flow.csv", "flow;of\n" + "".join(f"{cell};{i % 3}\n" for i, cell in enumerate(cells)))
    tab.page.wait_for_selector("[data-test=data-wrong-cell]:has-text('n.m.')")
    assert "means not measured" in text(tab, "data-remedy-0")
    tab.get("data-remedy-0").click()
    tab.page.wait_for_selector("[data-test=data-understood]:has-text('1 missing')")
    tab.page.wait_for_selector("[data-test=data-suggestion]")


def test_constants_are_fitted_taken_and_given_back_by_keyboard(visit: Visits) -> None:
    """Ticked with Space, fitted with Ctrl+Enter; the book's estimates; one button puts them into the model, Ctrl+Z takes them out."""
    tab = begun(visit)
    tab.drop("body", "flow.csv", NAMED)
    tab.page.wait_for_selector("[data-test=data-summary]")
    tab.press("Alt+Shift+F")
    tab.page.wait_for_selector("[data-test=fit-constants]")
    for name in ("q", "r"):
        tab.walk(f"[data-test=fit-free-{name}], [data-test=fit-free-{name}] *")
        tab.press("Space")
    tab.press("Control+Enter")
    tab.page.wait_for_selector("[data-test=fit-found] table")
    cells = tab.page.locator("[data-test=fit-found] tbody tr").nth(1).locator("td").all_inner_texts()
    assert float(cells[2]) == pytest.approx(nile.R, rel=2e-3)
    assert tab.page.locator("[data-test=plot-fit-profile]").count() == 2
    tab.page.wait_for_selector("[data-test=fit-before]")
    before = text(tab, "fit-value-r")
    tab.get("fit-take").click()
    tab.page.wait_for_selector("[data-test=fit-taken]:has-text('They are in the model')")
    assert text(tab, "fit-value-r") != before
    tab.page.locator("h2").first.click()
    tab.press("Control+z")
    until(lambda: text(tab, "fit-value-r") == before)


def test_what_was_filtered_and_fitted_is_kept(visit: Visits) -> None:
    """Both are in the list of the page Keep; each opens on the page that made it; two are compared; one is deleted and put back."""
    tab = begun(visit)
    tab.drop("body", "kept.csv", NAMED)
    tab.page.wait_for_selector("[data-test=data-suggestion]")
    until(lambda: not tab.get("data-cancel").is_visible())
    tab.go("fit")
    tab.get("fit-free-q").click()
    tab.get("fit-run").click()
    tab.page.wait_for_selector("[data-test=fit-found] table")
    tab.go("keep")
    rows = tab.page.locator("[data-test=kept-row]", has_text="kept.csv")
    until(lambda: rows.count() == 2)
    for i in range(2):
        rows.nth(i).locator("[data-test=select]").click()
    tab.get("compare").click()
    tab.page.wait_for_selector("[data-test=differ-results] >> text=log_likelihood")
    rows.nth(1).locator("[data-test=delete]").click()
    until(lambda: rows.count() == 1)
    tab.get("undo-delete").locator("[data-test=undo]").click()
    until(lambda: rows.count() == 2)
    rows.nth(1).locator("[data-test=open]").click()
    tab.page.wait_for_selector("[data-test=data-summary]")
    tab.go("keep")
    rows.filter(has_text="fitted").first.locator("[data-test=open]").click()
    tab.page.wait_for_selector("[data-test=fit-found] table")


def test_a_long_fit_rises_and_is_cancelled_with_the_best_so_far(visit: Visits) -> None:
    """Its likelihood is drawn while it rises; after Cancel there are estimates, and it is said that the search was ended."""
    rng = np.random.default_rng(5)
    z = np.cumsum(rng.normal(0, 38.3, 400)) + rng.normal(0, 122.9, 400)
    tab = begun(visit)
    tab.go("data")
    tab.choose("data-choose", "flow.csv", "flow\n" + "".join(f"{v:.2f}\n" for v in z))
    tab.page.wait_for_selector("[data-test=data-summary]")
    tab.go("fit")
    for name in ("q", "r"):
        tab.get(f"fit-free-{name}").click()
    tab.field("fit-starts").fill("1000")
    tab.get("fit-run").click()
    tab.page.wait_for_selector("[data-test=fit-progress]:has-text('best log-likelihood')")
    tab.curves("plot-fit-trace")
    tab.get("fit-cancel").click()
    tab.page.wait_for_selector("[data-test=fit-words]:has-text('interrupted')")
    assert tab.get("fit-take").is_enabled()


def test_the_first_page_leads_to_the_data_and_a_phone_shows_them(visit: Visits) -> None:
    """The card "I have data"; on a phone, both pages fit with a record and a fit in them."""
    tab = visit(viewport=PHONE, has_touch=True).tab()
    tab.get("begin-data").click()
    tab.page.wait_for_selector("[data-test=data-choose]")
    tab.go("model")
    tab.load(ready("local_level").dumps(), "nile.toml")
    tab.go("data")
    tab.choose("data-choose", "flow.csv", NAMED)
    tab.page.wait_for_selector("[data-test=data-summary]")
    tab.curves("plot-record")
    until(lambda: tab.widest() <= 0)
    assert tab.unnamed() == []
    tab.go("fit")
    tab.get("fit-free-r").click()
    tab.get("fit-run").click()
    tab.page.wait_for_selector("[data-test=fit-found] table")
    until(lambda: tab.widest() <= 0)
    assert tab.unnamed() == []
