"""Every page and dialog as axe-core sees it, in both themes; and what a keyboard and a small window need."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.files.modelfile import ready
from tests.workbench_browser import ROOT, Tab, Visit, needed, opened, visit, workbench

__all__ = ["opened", "visit", "workbench"]
pytestmark = pytest.mark.slow

#: What is asked of a page: WCAG 2.2 A and AA, and what axe-core calls best practice.
TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
Visits = Callable[..., Visit]


@pytest.fixture(scope="module")
def axe() -> str:
    """axe-core, as the package has it."""
    spec = importlib.util.find_spec("axe_playwright_python")
    needed("axe-playwright-python", spec)
    assert spec is not None
    assert spec.origin is not None
    return (Path(spec.origin).parent / "axe.min.js").read_text(encoding="utf-8")


class Seen:
    """What axe-core finds on a page, by the place where it was asked."""

    def __init__(self, tab: Tab, axe: str) -> None:
        self.tab, self.axe, self.found = tab, axe, []  # type: Tab, str, list[str]

    def look(self, where: str) -> None:
        """Ask it."""
        page = self.tab.page
        if not page.evaluate("() => 'axe' in window"):
            page.evaluate(self.axe)
        page.wait_for_timeout(300)  # what fades in has another contrast
        options: dict[str, Any] = {"runOnly": {"type": "tag", "values": TAGS}, "resultTypes": ["violations"]}
        answer = page.evaluate("options => axe.run(document, options)", options)
        for each in answer["violations"]:
            nodes = [f"{node['html'][:150]} ({'; '.join(a['message'] for a in node['any'])[:160]})" for node in each["nodes"]]
            self.found.append(f"{where}: {each['id']} {len(nodes)}\n      " + "\n      ".join(nodes[:4]))

    def dialog(self, where: str, opener: Callable[[], object]) -> None:
        """Ask it of a dialog."""
        opener()
        self.tab.page.wait_for_selector(".q-dialog .q-card")
        self.look(where)
        self.tab.press("Escape")
        self.tab.page.wait_for_selector(".q-dialog__inner", state="detached")


def model(seen: Seen) -> None:
    """The page Model: empty, with cells, with a wrong one, as text, and its dialogs."""
    tab = seen.tab
    seen.look("begin")
    tab.load(ready("oscillator").dumps())
    tab.cell("F", 0, 1).wait_for()
    seen.look("model")
    tab.page.locator("[data-test^=range-]").first.click()
    tab.cell("F", 0, 0).fill("nothing_known")
    tab.page.wait_for_selector("[data-test^=add-constant-nothing]")
    seen.look("model, wrong")
    tab.cell("F", 0, 0).fill("0")
    tab.page.wait_for_selector("[data-test^=add-constant-nothing]", state="detached")
    seen.dialog("open", tab.get("open").click)
    seen.dialog("new", tab.get("new").click)
    seen.dialog("coloured noise", tab.get("block").click)
    seen.dialog("keys", tab.page.locator("[aria-label='Keyboard shortcuts']").click)
    tab.get("help-F").click()
    tab.page.wait_for_selector(".ctl-helptext b")
    seen.look("help of a matrix")
    tab.press("Escape")
    tab.page.wait_for_selector(".ctl-helptext", state="detached")
    tab.get("view-text").click()
    tab.field("text").wait_for()
    seen.look("text")
    tab.get("view-text").click()


def understand(seen: Seen) -> None:
    """The page Understand with all its figures."""
    seen.tab.go("understand")
    seen.tab.page.wait_for_selector("[data-test=plot-bode] .js-plotly-plot .main-svg")
    seen.look("understand")


def experiment(seen: Seen) -> None:
    """The page Experiment before and after a run, with every part of its results."""
    tab = seen.tab
    tab.go("experiment")
    tab.get("run").wait_for()
    seen.look("experiment")
    tab.run(runs=50, steps=40)
    parts = tab.page.locator("[data-test^=part-]")
    for i in range(parts.count()):
        parts.nth(i).click()
        tab.page.wait_for_timeout(700)
        seen.look(f"results, {parts.nth(i).text_content()}")


def control(seen: Seen) -> None:
    """The page Control: before there is a regulator, with one, with a weight that is wrong."""
    tab = seen.tab
    tab.go("control")
    tab.get("control-add-input").wait_for()
    seen.look("control, no input")
    tab.get("control-add-input").click()
    tab.page.wait_for_selector("[data-test=control-verdict]:has-text('stable')")
    tab.page.wait_for_selector("[data-test=plot-tradeoff] .js-plotly-plot .main-svg")
    tab.get("matrices").click()
    tab.cell("cost-Qx", 0, 0).wait_for()
    seen.look("control")
    tab.cell("cost-Qu", 0, 0).fill("-1")
    tab.page.wait_for_selector("[data-test=control-wrong]:has-text('expected weights')")
    seen.look("control, wrong")


def keep(seen: Seen) -> None:
    """The page Keep with an experiment."""
    seen.tab.go("keep")
    seen.look("keep")


def labs(seen: Seen) -> None:
    """The page Labs: the catalogue, and a lab."""
    seen.tab.go("labs")
    seen.look("labs")
    seen.tab.page.locator("[data-lab=task07]").click()
    seen.tab.page.wait_for_selector(".ctl-lab-form input")
    seen.look("a lab")


def course(seen: Seen) -> None:
    """The page Course: without one, a folder to be chosen, a course."""
    seen.tab.go("course")
    seen.look("course")
    seen.tab.get("course-path-choose").click()
    seen.tab.get("folder-take").wait_for()
    seen.look("folders")
    seen.tab.press("Escape")
    seen.tab.get("folder-take").wait_for(state="detached")
    seen.tab.field("course-path").fill(str(ROOT / "docs" / "sample-course"))
    seen.tab.get("course-open").click()
    seen.tab.get("course-roster").wait_for()
    seen.look("a course")


def help_page(seen: Seen) -> None:
    """The page Help."""
    seen.tab.go("help")
    seen.look("help")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_on_any_page(visit: Visits, axe: str, theme: Any) -> None:
    """WCAG 2.2 A and AA and best practice, with models, results and dialogs there."""
    tab = visit(color_scheme=theme, viewport={"width": 1440, "height": 900}).tab()
    seen = Seen(tab, axe)
    for look in (model, understand, experiment, control, keep, labs, course, help_page):
        look(seen)
    assert tab.dark() is (theme == "dark")
    assert not seen.found, "\n".join(seen.found)
