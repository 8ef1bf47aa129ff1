"""Links that hold a whole page, and a zoom that goes through all figures, in a real browser."""
# fixtures are imported, and named as arguments

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from tests.workbench.test_e2e import begun, edit, holds
from tests.workbench_browser import Tab, Visit, opened, until, visit, workbench

if TYPE_CHECKING:
    from playwright.sync_api import Locator

__all__ = ["opened", "visit", "workbench"]
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]
Visits = Callable[..., Visit]


def reach(tab: Tab, plot: str) -> list[float]:
    """From where to where the horizontal axis of a figure goes."""
    tab.curves(plot)
    where = f"document.querySelector(\"[data-test='{plot}'] .js-plotly-plot\")._fullLayout.xaxis.range"
    return [float(end) for end in tab.page.evaluate(where)]


def drag(tab: Tab, plot: str, low: float, high: float) -> None:
    """Draw a frame over a part of a figure, by the share of its width."""
    place = tab.page.locator(f"[data-test='{plot}'] .nsewdrag").first
    place.scroll_into_view_if_needed()
    box = place.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    tab.page.mouse.move(box["x"] + low * box["width"], middle)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + high * box["width"], middle, steps=8)
    tab.page.mouse.up()


def about(found: list[float], wanted: tuple[float, float], width: float) -> bool:
    """Whether an axis goes from here to there, but for some pixels."""
    return all(abs(a - b) < 0.03 * width for a, b in zip(found, wanted, strict=True))


def test_a_zoom_goes_through_all_tabs_of_a_result_and_stays(visit: Visits) -> None:
    """Drawn in one figure: over the same time in those of other tabs, after coming back, and after another run; a double click ends it."""
    tab = begun(visit, page="experiment")
    tab.run(steps=200, runs=50)  # 20 s
    whole = reach(tab, "plot-states")
    width = whole[1] - whole[0]
    drag(tab, "plot-states", 0.25, 0.5)
    until(lambda: reach(tab, "plot-states")[1] < 0.6 * whole[1])
    part = (whole[0] + 0.25 * width, whole[0] + 0.5 * width)
    assert about(reach(tab, "plot-states"), part, width)
    for name, plots in (("errors", ("plot-accuracy", "plot-errors")), ("innovations", ("plot-innovations",)), ("states", ("plot-states",))):
        tab.part(name)
        for plot in plots:
            until(lambda plot=plot: about(reach(tab, plot), part, width))
    tab.run(seed=2)
    until(lambda: about(reach(tab, "plot-states"), part, width))
    tab.part("innovations")
    tab.curves("plot-innovations")
    tab.page.locator("[data-test=plot-innovations] .nsewdrag").first.dblclick()
    until(lambda: about(reach(tab, "plot-innovations"), (whole[0], whole[1]), width))
    tab.part("states")
    until(lambda: about(reach(tab, "plot-states"), (whole[0], whole[1]), width))


def copied(tab: Tab, button: Locator) -> str:
    """What a button puts on the clipboard."""
    tab.visit.context.grant_permissions(["clipboard-read", "clipboard-write"])
    tab.page.evaluate("navigator.clipboard.writeText('')")
    button.click()
    until(lambda: tab.page.evaluate("navigator.clipboard.readText()"))
    return str(tab.page.evaluate("navigator.clipboard.readText()"))


@pytest.mark.parametrize("page", ["understand", "experiment"])
def test_a_link_leads_to_a_page_with_its_model(visit: Visits, page: str) -> None:
    """In another browser too, which has never seen the model: a draft of its own, that what is done there does not change here."""
    tab = begun(visit)
    edit(tab, "H", 0, 2, text="0.125")
    tab.go("experiment")
    tab.settle(steps=77, runs=33)
    if page != "experiment":
        tab.go(page)
    address = copied(tab, tab.get("link"))
    assert f"/{page}?" in address
    other = Tab(stranger := visit(), stranger.context.new_page())
    other.open(address)
    other.page.wait_for_selector(f"nav a[href^='/{page}'][aria-current=page]", state="attached")
    other.go("experiment")
    holds(other.field("steps"), "77")
    holds(other.field("runs"), "33")
    other.go("model")
    holds(other.cell("H", 0, 2), "0.125")
    holds(other.cell("F", 1, 0), "-omega^2")
    edit(other, "H", 0, 2, text="0.5")
    tab.go("model")
    holds(tab.cell("H", 0, 2), "0.125")


def test_a_link_leads_to_a_lab_with_its_parameters(visit: Visits) -> None:
    """Those that are not the defaults, runs and seed; a wrong name in the address is passed over."""
    tab = visit().tab("labs")
    tab.page.click("[data-lab=task07]")
    form = tab.page.locator(".ctl-lab-form")

    def field(where: Tab, name: str) -> Locator:
        return where.page.locator(".ctl-lab-form").get_by_label(name, exact=True)

    form.first.wait_for()
    field(tab, "Phi").fill("0,9")
    field(tab, "Runs").fill("40")
    tab.page.wait_for_timeout(500)
    address = copied(tab, tab.get("copy-link"))
    assert "lab=task07" in address
    other = Tab(stranger := visit(), stranger.context.new_page())
    other.open(f"{address}&nothing=5")
    other.page.wait_for_selector("h1, h2 >> text=/Lab 7/")
    until(lambda: field(other, "Phi").input_value() in {"0.9", "0,9"})
    holds(field(other, "Runs"), "40")
    holds(field(other, "R, m²"), field(tab, "R, m²").input_value())
