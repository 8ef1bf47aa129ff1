"""The workbench as a student uses it, in a real browser: from an empty page to an exported report, and what may go wrong.

Every test has a browser with cookies of its own, hence an empty draft; in its end nothing may have been written to the console
or left this machine (:mod:`tests.workbench_browser`). What is kept is one list for all browsers of a machine.
"""
# ruff: noqa: F811  # fixtures are imported, and named as arguments

from __future__ import annotations

import csv
import io
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from ctlabs.files.modelfile import loads, ready
from ctlabs.labs import catalogue as labs
from tests.reference import EXACT
from tests.workbench_browser import (  # noqa: F401  # fixtures
    DESKTOP,
    PAGES,
    PATIENCE,
    PHONE,
    ROOT,
    ZOOMED,
    Tab,
    Visit,
    Workbench,
    another,
    opened,
    until,
    visit,
    workbench,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]
Visits = Callable[..., Visit]
Servers = Callable[..., Workbench]

#: An oscillator with a damper, pushed by a coloured force that is a state of its own.
OSCILLATOR = """
format = 1
title = "Pushed oscillator"
kind = "continuous"

[constants]
omega = { value = 2, min = 0.5, max = 8, unit = "rad/s", meaning = "own frequency" }
tau = 5

[model]
states = ["x", "v", "force"]
units = ["m", "m/s", "m/s²"]
measurements = ["place"]
measurement_units = ["m"]
F = [[0, 1, 0], ["-omega^2", -0.1, 1], [0, 0, "-1/tau"]]
G = [[0], [0], [1]]
Q = [["2*0.3^2/tau"]]
H = [[1, 0, 0]]
R = [["0.1^2"]]
x0 = [0, 0, 0]
P0 = [[1, 0, 0], [0, 1, 0], [0, 0, "0.3^2"]]
dt = 0.1
"""


def begun(visit: Visits, text: str = OSCILLATOR, page: str = "model", **options: Any) -> Tab:
    """A page of a person who has never been here, with a model."""
    tab = visit(**options).tab()
    tab.load(text)
    if page != "model":
        tab.go(page)
    return tab


def complete(tab: Tab) -> None:
    """Wait until nothing is wrong with the model."""
    tab.page.wait_for_selector("[data-test=problems][data-count='0']")


def holds(field: Locator, text: str) -> None:
    """Wait until this stands in a field."""
    until(lambda: field.input_value() == text)


def written(place: Locator) -> str:
    """Mathematics without the spaces and the lines between its signs."""
    return re.sub(r"\s", "", place.inner_text())


def edit(tab: Tab, *cell: Any, text: str) -> None:
    """Type a number into a cell, and wait for it in the equations."""
    tab.cell(*cell).fill(text)
    until(lambda: text in written(tab.get("equations")))


def exported(tab: Tab, kind: str) -> tuple[str, bytes]:
    """Name and content of what the open dialog exports."""
    return tab.saved(lambda: tab.get(f"export-{kind}").click())


def table(content: bytes) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    return list(csv.DictReader(io.StringIO(content.decode())))


def kept(tab: Tab, name: str) -> Locator:
    """The row of a kept experiment."""
    return tab.page.locator("[data-test=kept-row]", has_text=name)


def at(row: Locator, button: str) -> Locator:
    """A button of a row."""
    return row.locator(f"[data-test={button}]")


# The model -------------------------------------------------------------------------------------------------------------


def test_three_states_typed_on_an_empty_page_become_a_report(visit: Visits) -> None:
    """Sizes, names, matrices with expressions, constants that are asked for, a run, the report: a first session."""
    tab = visit().tab()
    tab.get("begin-new").click()
    tab.field("new-n").fill("3")
    tab.get("new-begin").click()
    tab.focused("state-name-0")
    tab.get("title").fill("Pushed oscillator")
    model = tomllib.loads(OSCILLATOR)["model"]
    for i, name in enumerate(model["states"]):
        tab.get(f"state-name-{i}").fill(name)
    tab.type(**{name: model[name] for name in ("F", "G", "Q", "H", "R", "x0", "P0")})
    tab.get("dt").fill("0.1")
    for name, text in (("omega", "2"), ("tau", "5")):
        tab.get(f"add-constant-{name}").click()
        tab.focused(f"constant-{name}")
        tab.get(f"constant-{name}").fill(text)
    complete(tab)
    tab.go("experiment")
    tab.run()
    tab.get("export").click()
    typed, meant = (loads(text).discrete() for text in (exported(tab, "toml")[1].decode(), OSCILLATOR))
    assert typed.states == meant.states
    for matrix in ("Phi", "Qd", "H", "R", "x0", "P0"):
        np.testing.assert_allclose(getattr(typed, matrix), getattr(meant, matrix), atol=EXACT)
    name, report = exported(tab, "html")
    assert re.fullmatch(r"pushed_oscillator_\w+\.html", name)
    assert b"<math" in report
    assert not re.search(rb"""(src|href)=["']https?://""", report)


def test_an_error_stands_at_its_cell_until_it_is_mended(visit: Visits) -> None:
    """An unknown name is told beside the cell, in words that a screen reader finds; the line above leads to it."""
    tab = begun(visit)
    cell = tab.cell("F", 1, 0)
    until(lambda: cell.get_attribute("aria-invalid") is None)
    cell.fill("-omga^2")
    tab.page.wait_for_selector("[data-test=cell-F-1-0][aria-invalid=true]")
    told = tab.page.locator(f"[id='{cell.get_attribute('aria-describedby')}']")
    until(lambda: 'unknown name "omga"' in told.inner_text())
    until(lambda: tab.get("problems").get_attribute("data-count") == "1")
    tab.cell("H", 0, 0).focus()
    tab.get("problems").locator("button", has_text="F[1][0]").click()
    tab.focused("cell-F-1-0")
    tab.go("experiment")
    until(lambda: tab.get("run").is_disabled())
    until(lambda: "omga" in tab.get("run-error").inner_text())
    tab.go("model")
    tab.cell("F", 1, 0).fill("-omega^2")
    complete(tab)
    until(lambda: tab.cell("F", 1, 0).get_attribute("aria-invalid") is None)


def test_a_slider_moves_a_constant(visit: Visits) -> None:
    """By keys, as a person without a mouse does; the cells that use it show their new values."""
    tab = begun(visit)
    value = tab.page.locator("td:has([data-test=cell-F-1-0]) .ctl-value")
    until(lambda: value.inner_text() == "= −4")
    tab.get("slider-omega").focus()
    tab.press("End")
    holds(tab.get("constant-omega"), "8")
    until(lambda: value.inner_text() == "= −64")
    tab.press("ArrowLeft")
    until(lambda: float(tab.get("constant-omega").input_value()) < 8)
    tab.get("range-tau").click()
    tab.get("constant-tau-min").fill("1")
    tab.get("constant-tau-max").fill("9")
    tab.get("slider-tau").wait_for()
    until(lambda: tab.get("slider-tau").is_enabled())
    tab.get("slider-tau").focus()
    tab.press("Home")
    holds(tab.get("constant-tau"), "1")


def test_undo_and_redo_by_keys(visit: Visits) -> None:
    """From within a cell too; what was typed into one cell is one edit."""
    tab = begun(visit)
    edit(tab, "H", 0, 1, text="5")
    tab.cell("H", 0, 2).focus()
    tab.press("Control+a")
    for key in "777":
        tab.press(key)
        until(lambda key=key: key in written(tab.get("equations")))
    until(lambda: "777" in written(tab.get("equations")))
    tab.press("Control+z")
    holds(tab.cell("H", 0, 2), "0")
    holds(tab.cell("H", 0, 1), "5")
    tab.press("Control+z")
    holds(tab.cell("H", 0, 1), "0")
    tab.press("Control+Shift+Z")
    holds(tab.cell("H", 0, 1), "5")
    tab.press("Control+y")
    holds(tab.cell("H", 0, 2), "777")
    until(lambda: tab.get("redo").get_attribute("aria-disabled") == "true")


def test_a_state_comes_and_goes_and_the_rest_stays(visit: Visits) -> None:
    """Matrices grow by a row and a column; the names, the expressions and the other cells are as they were."""
    tab = begun(visit)
    tab.get("add-state").click()
    tab.focused("state-name-3")
    tab.page.keyboard.type("bias")
    edit(tab, "F", 1, 3, text="7")
    holds(tab.cell("F", 1, 0), "-omega^2")
    tab.get("remove-state-0").click()
    tab.cell("F", 3, 3).wait_for(state="detached")
    until(lambda: [tab.get(f"state-name-{i}").input_value() for i in range(3)] == ["v", "force", "bias"])
    until(lambda: [tab.cell("F", 0, j).input_value() for j in range(3)] == ["-0.1", "1", "7"])
    holds(tab.cell("F", 1, 1), "-1/tau")


def test_a_measurement_and_a_noise_come_and_are_taken_back(visit: Visits) -> None:
    """Each grows the matrices that it is in, and only these; undo shrinks them again."""
    tab = begun(visit)
    tab.get("add-measurement").click()
    tab.cell("H", 1, 2).wait_for()
    tab.cell("R", 1, 1).wait_for()
    tab.get("add-noise").click()
    tab.cell("Q", 1, 1).wait_for()
    tab.cell("G", 2, 1).wait_for()
    until(lambda: tab.cell("F", 3, 3).count() == 0)
    for _ in range(2):
        tab.get("undo").click()
    for matrix in ("Q", "H"):
        tab.cell(matrix, 1, 1).wait_for(state="detached")
    holds(tab.cell("Q", 0, 0), "2*0.3^2/tau")


def test_a_transfer_function_becomes_states(visit: Visits) -> None:
    """Coloured noise is typed as 1/(2 s + 1), looked at, and put in the place of white noise."""
    tab = begun(visit)
    tab.get("block").click()
    tab.field("block-text").fill("1/(2*s +")
    until(lambda: "expected" in tab.get("block-problem").inner_text())
    tab.field("block-text").fill("1/(2*s + 1)")
    until(lambda: "=−0.5𝑦" in written(tab.get("block-preview")))
    tab.get("block-insert").click()
    tab.cell("F", 3, 3).wait_for()
    complete(tab)
    until(lambda: float(tab.cell("F", 3, 3).input_value()) == -0.5)
    holds(tab.cell("F", 1, 0), "-omega^2")


def test_a_model_is_downloaded_and_opened_again(visit: Visits) -> None:
    """By Ctrl+S and the browser's file dialog; the expressions are still expressions."""
    tab = begun(visit)
    edit(tab, "H", 0, 1, text="0.25")
    name, content = tab.saved(lambda: tab.press("Control+s"))
    assert name == "pushed_oscillator.toml"
    assert tomllib.loads(content.decode())["model"]["H"] == [[1, 0.25, 0]]
    other = begun(visit, ready("local_level").dumps())
    other.get("open").click()
    other.choose("open-file", name, content.decode())
    other.cell("F", 2, 2).wait_for()
    until(lambda: [other.cell("H", 0, j).input_value() for j in range(3)] == ["1", "0.25", "0"])
    holds(other.cell("F", 1, 0), "-omega^2")
    holds(other.get("title"), "Pushed oscillator")


def test_a_file_is_dropped_on_the_page(visit: Visits) -> None:
    """A model opens wherever it is dropped; what is none is refused in words, and nothing changes."""
    tab = begun(visit)
    tab.drop("[data-test=equations]", "other.toml", ready("crane").dumps())
    title = tomllib.loads(ready("crane").dumps())["title"]
    holds(tab.get("title"), title)
    tab.drop("[data-test=title]", "broken.toml", "format = 1\nkind = ")
    tab.page.wait_for_selector(".q-notification >> text=/broken.toml.*line 2|line 2/")
    holds(tab.get("title"), title)
    tab.get("undo").click()
    holds(tab.get("title"), "Pushed oscillator")


def test_what_is_typed_survives_a_reload_at_once(visit: Visits) -> None:
    """Not a moment is waited between the key and the reload, or the way to another page."""
    tab = begun(visit)
    tab.cell("H", 0, 1).fill("0.75")
    tab.page.reload()
    tab.ready()
    holds(tab.cell("H", 0, 1), "0.75")
    tab.cell("H", 0, 2).fill("0.875")
    tab.go("understand")
    tab.go("model")
    holds(tab.cell("H", 0, 2), "0.875")


def test_equations_are_set_in_the_font_that_is_served(visit: Visits) -> None:
    """Whatever fonts the machine has; it comes from the server, compressed, and is less than 100 kB."""
    tab = visit().tab()
    with tab.page.expect_response(lambda answer: answer.url.endswith("/math.ttf")) as waiting:
        tab.load(OSCILLATOR)
    answer = waiting.value
    assert answer.ok
    assert answer.request.sizes()["responseBodySize"] < 100_000
    until(
        lambda: tab.page.evaluate(
            "[...document.fonts].some(each => /ctlabs math/.test(each.family) && each.status === 'loaded')"
        )
    )
    family = tab.page.evaluate("getComputedStyle(document.querySelector('[data-test=equations] math')).fontFamily")
    assert family.startswith('"ctlabs math"')


# Understanding -----------------------------------------------------------------------------------------------------------


def test_understand_follows_the_model(visit: Visits) -> None:
    """Observable, with poles, gains, P(t) and Bode plot; a constant that is moved changes them, and the model."""
    tab = begun(visit, page="understand")
    tab.page.wait_for_selector("[data-test=observability] >> text=Yes: all 3 states are observable.")
    for plot in ("plot-poles-z", "plot-poles-s", "plot-transient", "plot-bode"):
        assert tab.curves(plot), plot
    until(lambda: tab.get("transfer").locator("math").count() == 3)
    before = tab.get("steady").inner_text()
    tab.field("constant-omega").fill("6")
    tab.field("constant-omega").press("Enter")
    until(lambda: tab.get("steady").inner_text() != before)
    tab.go("model")
    holds(tab.get("constant-omega"), "6")


def test_understand_says_what_is_not_there_and_why(visit: Visits) -> None:
    """A measurement that does not see the oscillator; a model with an error in a cell."""
    tab = begun(visit, OSCILLATOR.replace("H = [[1, 0, 0]]", "H = [[0, 0, 1]]"), page="understand")
    tab.page.wait_for_selector("[data-test=observability] >> text=No: rank 1 of 3.")
    tab.go("model")
    tab.cell("H", 0, 0).fill("1/0")
    tab.page.wait_for_selector("[data-test=cell-H-0-0][aria-invalid=true]")
    tab.go("understand")
    until(lambda: "H[0][0]" in tab.get("summary").inner_text())
    tab.get("go-model").click()
    tab.cell("H", 0, 0).wait_for()


# Experiments -------------------------------------------------------------------------------------------------------------

PARTS = {
    "errors": ("plot-accuracy", "plot-errors", "plot-bias", "plot-consistency"),
    "gain": ("plot-gain",),
    "variances": ("plot-variances",),
    "innovations": ("plot-innovations", "plot-nis", "plot-whiteness"),
}


def test_an_experiment_shows_all_its_parts(visit: Visits) -> None:
    """Truth, measurement, estimate with its band; errors against theory; gain; variances; innovations; numbers to copy."""
    tab = begun(visit, page="experiment")
    tab.settle(steps=150, runs=200, seed=3)
    tab.press("Control+Enter")
    tab.results()
    until(lambda: "200 runs, seed 3" in tab.get("found-told").inner_text())
    until(lambda: {"truth", "measurement", "estimate", "estimate ± σ"} <= set(tab.curves("plot-states")))
    until(lambda: tab.points("plot-states", "truth") == 151)
    for part, plots in PARTS.items():
        tab.part(part)
        for plot in plots:
            assert tab.curves(plot), plot
    tab.part("numbers")
    tab.visit.context.grant_permissions(["clipboard-read", "clipboard-write"])
    tab.get("copy-numbers").click()
    rows = tab.get("numbers-table").locator("tbody tr").count()
    until(lambda: len(tab.page.evaluate("navigator.clipboard.readText()").splitlines()) == rows + 1)
    tab.run(seed=4)
    until(lambda: "200 runs, seed 4" in tab.get("found-told").inner_text())


def test_a_wrong_setting_is_told_at_its_field(visit: Visits) -> None:
    """Nothing runs until what is no whole number is put right; then nothing is complained of."""
    tab = begun(visit, page="experiment")
    tab.settle(runs="many")
    tab.page.wait_for_selector('text=/expected a whole number from 1 to [0-9]+, received "many"/')
    until(lambda: tab.field("runs").get_attribute("aria-invalid") == "true")
    tab.get("run").click()
    until(lambda: "runs" in tab.get("run-error").inner_text())
    until(lambda: not tab.get("cancel").is_visible())
    tab.settle(runs=20)
    until(lambda: not tab.get("run-error").text_content())
    until(lambda: tab.field("runs").get_attribute("aria-invalid") is None)


def test_a_long_run_is_cancelled_and_the_page_stays_alive(visit: Visits) -> None:
    """While ten million runs go on, other pages answer and the model can be edited; cancel ends them, and another runs."""
    tab = begun(visit, page="experiment")
    tab.settle(runs=10_000_000)
    tab.get("run").click()
    until(lambda: re.search(r"of 10.000.000 runs, .* per second", tab.get("progress-text").inner_text()))
    tab.go("model")
    edit(tab, "H", 0, 1, text="0.5")
    tab.go("experiment")
    until(lambda: tab.get("run").is_disabled())
    tab.get("cancel").click()
    tab.get("cancel").wait_for(state="hidden")
    until(lambda: tab.get("progress-text").inner_text() == "Cancelled; nothing was kept of it.")
    tab.run(runs=50)
    until(lambda: "50 runs" in tab.get("found-told").inner_text())


def test_algorithms_stand_side_by_side(visit: Visits) -> None:
    """Two chosen algorithms are two rows of the table, and two curves."""
    tab = begun(visit, page="experiment")
    tab.get("algorithm-ud").click()
    until(lambda: "compared" in tab.get("algorithms").inner_text())
    tab.run(steps=100, runs=100)
    until(lambda: "estimate, Factors UDUᵀ" in tab.curves("plot-states"))
    tab.part("algorithms")
    rows = tab.get("algorithms-table").locator("tbody tr")
    rows.nth(1).wait_for()
    names = rows.locator("th")
    until(lambda: len({name.split(" ")[0] for name in names.all_inner_texts()}) == names.count() == 2)
    until(lambda: not any("refused" in line for line in rows.all_inner_texts()))


def test_anomalies_change_the_filter_at_their_instants(visit: Visits) -> None:
    """A lost measurement is none, an exact one makes its state's σ nought; one beyond the experiment is refused."""
    tab = begun(visit, page="experiment")
    tab.settle(steps=100, runs=20)

    def add(k: str, kind: str) -> None:
        if not tab.get("anomaly-add").is_visible():
            tab.get("add-anomaly").click()
        tab.field("anomaly-k").fill(k)
        tab.get("anomaly-kind").get_by_text(kind).click()
        tab.get("anomaly-add").click()

    add("30", "lost")
    tab.page.wait_for_selector("[data-test=anomaly] >> text=k = 30: place lost")
    tab.get("anomaly-add").wait_for(state="detached")
    add("500", "exact")
    tab.page.wait_for_selector("text=expected a step from 0 to 100, received 500")
    add("60", "exact")
    tab.page.wait_for_selector("[data-test=anomaly] >> text=k = 60: place exact")
    tab.run()
    tab.get("export").click()
    rows = table(exported(tab, "csv")[1])
    assert [i for i in range(1, 101) if not rows[i]["place_measured"]] == [30]
    assert float(rows[60]["x_sd"]) < 1e-9 < float(rows[59]["x_sd"]) < float(rows[30]["x_sd"])


def test_the_filter_may_believe_another_model(visit: Visits) -> None:
    """Another constant than the truth's: the line is shown side by side, and the innovations tell."""
    tab = begun(visit, page="experiment")
    tab.get("design-choose").click()
    tab.field("design-constant-omega").fill("3")
    tab.get("design-take-constants").click()
    changed = tab.get("difference").locator("td.old, td.new")
    until(lambda: changed.count() == 2)
    until(lambda: all("omega" in line for line in changed.all_inner_texts()))
    tab.run(steps=200, runs=200)
    until(lambda: "outside its 95 % band" in tab.get("diagnosis").inner_text())
    tab.get("export").click()
    found = json.loads(exported(tab, "json")[1])["summary"]
    assert found["rms[x]"]["value"] > 3 * found["sd_claimed[x]"]["value"]
    tab.get("export-close").click()
    tab.get("design-same").click()
    tab.get("difference").wait_for(state="hidden")


def gauge(visit: Visits) -> tuple[Tab, str]:
    """The page Experiment with a model of one level, and the name of its measurement."""
    tab = begun(visit, ready("local_level").dumps())
    name = tab.get("measurement-name-0").input_value()
    tab.go("experiment")
    return tab, name


def test_a_measured_record_is_filtered(visit: Visits) -> None:
    """A table of numbers, by the file dialog and by drag and drop, takes the place of simulated runs until it is removed."""
    tab, flow = gauge(visit)
    tab.choose("choose-data", "good.csv", f"{flow}\n1120\n1160\n963\n\n1210\n1160\n1160\n813\n")
    tab.page.wait_for_selector("text=good.csv: 8 rows, 1 missing")
    until(lambda: tab.field("runs").is_disabled())
    before = tab.get("found-told").inner_text()
    tab.get("run").click()
    tab.results(before)
    until(lambda: "good.csv" in tab.get("found-told").inner_text())
    until(lambda: "measurement" in tab.curves("plot-states"))
    until(lambda: "truth" not in tab.curves("plot-states"))
    tab.drop("[data-test=drop]", "dropped.csv", f"{flow}\n1\n2\n3\n4\n5\n")
    tab.page.wait_for_selector("text=dropped.csv: 5 rows")
    tab.get("remove-data").click()
    until(lambda: "simulated" in tab.get("data-told").inner_text())
    until(lambda: tab.field("runs").is_enabled())


def test_a_broken_record_is_refused_and_changes_nothing(visit: Visits) -> None:
    """A text in a number is told with its file and line; a right file takes the words away."""
    tab, flow = gauge(visit)
    tab.choose("choose-data", "bad.csv", f"{flow}\n1120\nmany\n963\n")
    tab.page.wait_for_selector("[data-test=data] >> text=/bad.csv.*line 3.*many/")
    until(lambda: "simulated" in tab.get("data-told").inner_text())
    tab.choose("choose-data", "good.csv", f"{flow}\n1120\n1160\n963\n")
    tab.page.wait_for_selector("text=good.csv: 3 rows")
    until(lambda: not tab.get("data").locator("[role=alert]").text_content())


# What is kept --------------------------------------------------------------------------------------------------------------


def two_kept(visit: Visits, title: str) -> tuple[Tab, Locator, Locator]:
    """The page Keep after two runs, between which a constant was changed; their rows."""
    tab = begun(visit, OSCILLATOR.replace("Pushed oscillator", title), page="experiment")
    tab.run(steps=60, runs=40, seed=11)
    tab.go("model")
    tab.get("constant-tau").fill("9")
    until(lambda: "−0.111" in written(tab.get("equations")))
    tab.go("experiment")
    tab.run(seed=12)
    tab.go("keep")
    return tab, kept(tab, f"{title}: 40 runs, seed 11"), kept(tab, f"{title}: 40 runs, seed 12")


def test_two_kept_experiments_are_compared_and_one_is_opened_again(visit: Visits) -> None:
    """Only the seed and the constant differ; the opened one has its own settings and model."""
    tab, first, second = two_kept(visit, "Compared")
    for row in (first, second):
        at(row, "select").click()
    tab.get("compare").click()
    tab.get("comparison").wait_for()
    until(lambda: tab.get("differ-settings").locator("tbody th").all_inner_texts() == ["seed"])
    changed = tab.get("differ-model").locator("td.old, td.new")
    until(lambda: ["tau" in line for line in changed.all_inner_texts()] == [True, True])
    assert tab.curves("plot-comparison")
    at(first, "open").click()
    tab.page.wait_for_selector("nav a[href^='/experiment'][aria-current=page]")
    tab.results()
    until(lambda: "seed 11" in tab.get("found-told").inner_text())
    holds(tab.field("seed"), "11")
    tab.go("model")
    holds(tab.get("constant-tau"), "5")


def test_a_kept_experiment_is_renamed_run_again_and_deleted_with_undo(visit: Visits) -> None:
    """By its row; the search finds what it is called now."""
    tab = begun(visit, page="experiment")
    tab.run(steps=60, runs=40, seed=41)
    tab.go("keep")
    at(kept(tab, "40 runs, seed 41"), "rename").first.click()
    tab.field("new-name").fill("The one with tau 5")
    tab.get("take-name").click()
    at(kept(tab, "The one with tau 5"), "rerun").click()
    again = kept(tab, "The one with tau 5 (again)")
    again.wait_for()
    at(again, "delete").click()
    again.wait_for(state="detached")
    tab.get("undo-delete").locator("[data-test=undo]").click()
    again.wait_for()
    tab.field("kept-search").fill("with tau 5")
    until(lambda: tab.get("kept-row").count() == 2)


def test_an_experiment_leaves_as_files_that_are_right(visit: Visits) -> None:
    """Report, table, data, picture, drawing, model: each has the numbers of the run, or shows them."""
    tab = begun(visit, page="experiment")
    tab.run(steps=50, runs=30, seed=5)
    tab.get("export").click()
    files = {kind: exported(tab, kind) for kind in ("html", "csv", "json", "png", "svg", "toml")}
    assert all(name.endswith(f".{kind}") for kind, (name, _) in files.items())
    whole, rows = json.loads(files["json"][1]), table(files["csv"][1])
    assert [whole["settings"][name] for name in ("seed", "runs", "steps")] == [5, 30, 50]
    assert len(rows) == 51
    assert float(rows[-1]["x_rms"]) == pytest.approx(whole["summary"]["rms[x]"]["value"], rel=EXACT)
    assert loads(files["toml"][1].decode()).dumps() == loads(whole["model"]).dumps()
    assert b"Pushed oscillator" in files["html"][1]
    assert files["png"][1].startswith(b"\x89PNG\r\n")
    assert b"<svg" in files["svg"][1]


def test_the_exported_lines_of_python_give_the_same_numbers(visit: Visits, tmp_path: Path) -> None:
    """They run in another process, with nothing but the library."""
    tab = begun(visit, page="experiment")
    tab.run(steps=50, runs=30, seed=5)
    tab.get("export").click()
    summary = json.loads(exported(tab, "json")[1])["summary"]
    name, content = exported(tab, "python")
    program = tmp_path / name
    program.write_bytes(content)
    command = [sys.executable, "-W", "error", str(program)]
    alone = os.environ | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path, env=alone)
    numbers = json.loads(ran.stdout)
    assert numbers.keys() == summary.keys()
    for name, value in numbers.items():
        assert value == pytest.approx(summary[name]["value"], rel=1e-9, abs=EXACT), name


def test_a_killed_server_comes_back_with_everything(another: Servers, visit: Visits) -> None:
    """SIGKILL right after an edit: the open page finds the server again, with cells, undo, settings and experiments."""
    server = another()
    server.start()
    tab = begun(visit, server=server)
    tab.visit.forgiven = r"ERR_CONNECTION_REFUSED|WebSocket connection to"
    tab.go("experiment")
    tab.run(steps=40, runs=25, seed=9)
    tab.go("model")
    edit(tab, "H", 0, 1, text="0.5")
    edit(tab, "H", 0, 2, text="0.125")
    server.kill()
    tab.page.wait_for_selector(".ctl-main[inert]", state="attached")
    server.start()
    tab.page.wait_for_selector(".ctl-main:not([inert])[aria-busy=false]")
    holds(tab.cell("H", 0, 2), "0.125")
    tab.get("undo").click()
    holds(tab.cell("H", 0, 2), "0")
    until(lambda: [tab.cell("H", 0, j).input_value() for j in range(2)] == ["1", "0.5"])
    tab.go("experiment")
    until(lambda: [tab.field(name).input_value() for name in ("steps", "runs", "seed")] == ["40", "25", "9"])
    tab.go("keep")
    at(kept(tab, "25 runs, seed 9"), "open").click()
    tab.results()
    assert server.errors == []


# Labs and help ----------------------------------------------------------------------------------------------------------


def lab(visit: Visits, number: str) -> Tab:
    """The page of a lab, found by its number."""
    tab = visit().tab("labs")
    tab.page.get_by_label("Search labs").fill(number)
    items = tab.page.locator(".ctl-lab-item:visible")
    until(lambda: 0 < items.count() < len(labs.catalogue()))  # before that, the lab moves away from under the mouse
    tab.page.click(f"[data-lab=task{number.zfill(2)}]")
    tab.page.wait_for_selector(".ctl-lab-form")
    return tab


def test_the_labs_are_found_by_words(visit: Visits) -> None:
    """All are listed, then those that have the words, then all again."""
    tab = visit().tab("labs")
    search, found = tab.page.get_by_label("Search labs"), tab.page.locator(".ctl-lab-item:visible")
    until(lambda: found.count() == len(labs.catalogue()))
    search.fill("oscillator sampling")
    until(lambda: found.count() == 1)
    until(lambda: found.get_attribute("data-lab") == "task10")
    search.fill("")
    until(lambda: found.count() == len(labs.catalogue()))


def test_a_lab_runs_with_other_numbers_and_shows_its_report(visit: Visits) -> None:
    """Lab 7 with another Phi: the report stands in the page, and is there after a reload."""
    tab = lab(visit, "7")
    phi = tab.page.locator(".ctl-lab-form").get_by_label("Phi", exact=True)
    phi.fill("0.9")
    tab.page.locator(".ctl-lab-form").get_by_label("Runs", exact=True).fill("50")
    tab.press("Control+Enter")
    verdict = tab.page.locator(".ctl-lab-verdict")
    verdict.wait_for(timeout=4 * PATIENCE)
    until(lambda: verdict.get_attribute("data-passed") == "true")
    report = tab.page.frame_locator("iframe.ctl-lab-report").locator("body")
    until(lambda: "0.9" in report.inner_text())
    name, content = tab.saved(lambda: tab.page.click("text=Download results.json"))
    assert name.endswith(".json")
    assert json.loads(content)["parameters"]["Phi"] == 0.9
    tab.page.reload()
    tab.ready()
    verdict.wait_for()
    holds(phi, "0.9")


def test_a_wrong_parameter_of_a_lab_is_told_at_its_field(visit: Visits) -> None:
    """A word for a number: told, marked, and gone with a right one."""
    tab = lab(visit, "7")
    phi = tab.page.locator(".ctl-lab-form").get_by_label("Phi", exact=True)
    phi.fill("fast")
    tab.page.wait_for_selector(".ctl-lab-error >> text=/fast/")
    until(lambda: phi.get_attribute("aria-invalid") == "true")
    phi.fill("0.9")
    tab.page.wait_for_selector(".ctl-lab-error >> text=/fast/", state="hidden")
    until(lambda: phi.get_attribute("aria-invalid") is None)


@pytest.mark.parametrize("page", ["model", "experiment", "data", "fit", "control", "labs"])
def test_numbers_are_typed_as_at_home(visit: Visits, page: str) -> None:
    """Decimal commas, thin spaces between thousands, the minus sign of print, 1e4; what has two readings is refused with both."""
    tab = begun(visit, page="model" if page == "labs" else page)
    if page == "model":
        tab.cell("F", 1, 1).fill("−0,25")
        until(lambda: "−0.25" in written(tab.get("equations")))
        tab.cell("F", 1, 0).focus()
        holds(tab.cell("F", 1, 1), "-0.25")
        tab.cell("F", 1, 1).fill("1,120")
        tab.page.wait_for_selector(".ctl-error >> text=write 1.120 or 1120")
    elif page == "experiment":
        for text, told in (("1\u202f500", "1500"), ("1e4", "10000")):
            tab.settle(runs=text)
            holds(tab.field("runs"), told)
        tab.settle(runs="1,000")
        tab.page.wait_for_selector("text=write 1.000 or 1000")
    elif page == "data":
        tab.drop(".ctl-main", "log.csv", "place\n" + "".join(f"{k / 10}\n" for k in range(20)))
        tab.page.wait_for_selector("[data-test=data-filter]:visible")
        tab.field("data-gate").fill("4,5")
        tab.get("data-run").click()
        tab.page.wait_for_selector("[data-test=data-summary]:has-text('20 rows')")
        tab.field("data-steps").fill("1,000")
        tab.page.wait_for_selector("text=write 1.000 or 1000")
    elif page == "fit":
        tab.field("fit-max-tau").fill("2,5e1")
        tab.field("fit-max-tau").press("Enter")
        tab.go("model")
        tab.get("range-tau").click()
        holds(tab.get("constant-tau-max"), "2.5e1")
    elif page == "control":
        tab.get("control-add-input").click()
        tab.page.wait_for_selector("[data-test=control-verdict]:has-text('stable')")
        tab.field("control-runs").fill("1,000")
        tab.get("control-run").click()
        tab.page.wait_for_selector("text=write 1.000 or 1000")
        tab.field("control-runs").fill("1e2")
        tab.get("control-run").click()
        tab.page.wait_for_selector("[data-test=control-ensemble] >> text=/100 runs/")
    else:
        tab = lab(visit, "7")
        tab.page.locator(".ctl-lab-form").get_by_label("Phi", exact=True).fill("0,9")
        until(lambda: not any(tab.page.locator(".ctl-lab-error").all_inner_texts()))
        tab.page.locator(".ctl-lab-form").get_by_label("Runs", exact=True).fill("1,000")
        tab.page.wait_for_selector(".ctl-lab-error >> text=write 1.000 or 1000")


def test_help_is_beside_every_field(visit: Visits) -> None:
    """What it is, its equation, an example; on the page Model beside the cell, on the others over the page."""
    tab = begun(visit)
    parts = tab.page.locator(".ctl-part .ctl-caption")
    until(lambda: parts.count() == parts.locator("[data-test^=help-]").count() >= 9)
    tab.get("help-F").click()
    told = tab.page.locator(".q-menu[role=dialog]")
    told.locator("math").first.wait_for()
    until(lambda: "Example" in told.inner_text())
    tab.press("Escape")
    told.wait_for(state="hidden")
    tab.go("experiment")
    algorithms = tab.get("algorithms").locator("[role=checkbox]").count()
    until(lambda: tab.page.locator("[data-test^=help-algorithm-]").count() == algorithms >= 8)
    tab.get("help-algorithm-ud").click()
    tab.page.wait_for_selector(".q-dialog .ctl-show-help >> text=/UD/")
    tab.press("Escape")
    tab.page.wait_for_selector(".q-dialog", state="detached")


def test_shortcuts_are_listed_and_lead_to_the_pages(visit: Visits) -> None:
    """A question mark shows the keys of a page; Alt+Shift and a letter opens another."""
    tab = begun(visit)
    tab.page.evaluate("document.activeElement.blur()")
    tab.press("?")
    tab.page.wait_for_selector(".q-dialog kbd:text-is('Ctrl+Z')")
    tab.press("Escape")
    tab.page.wait_for_selector(".q-dialog", state="detached")
    for page in ("experiment", "labs"):
        tab.press(f"Alt+Shift+{page[0].upper()}")
        tab.page.wait_for_selector(f"nav a[href^='/{page}'][aria-current=page]")
        tab.ready()
    tab.page.go_back()
    tab.page.wait_for_selector("nav a[href^='/experiment'][aria-current=page]")


def test_the_help_is_searched(visit: Visits) -> None:
    """Every word counts; a way to a place within the page leaves what was typed."""
    tab = visit().tab("help")
    search = tab.page.get_by_label("Search the help")
    search.fill("covariance")
    tab.page.wait_for_selector(".ctl-help-entry h3 >> text=/covariance/i")
    tab.page.click("a[href$='#keys']")
    search.focus()
    tab.press("End")
    tab.page.keyboard.type(" zzzz")
    tab.page.wait_for_selector("text=Nothing has all these words.")
    holds(search, "covariance zzzz")


def test_the_first_experiment_ticks_itself_off(visit: Visits) -> None:
    """The guided tour, done as it says; a reload on the way takes nothing away."""
    tab = visit().tab()
    tab.get("begin-tour").click()
    tab.page.click("text=Show the steps while I work")
    card = tab.page.locator(".ctl-tour-card")

    def done(steps: int) -> None:
        until(lambda: card.locator("[data-done=true]").count() == steps)

    card.locator("button", has_text="To Model").click()
    tab.get("begin-ready").click()
    tab.get("ready-constant_velocity").click()
    done(1)
    tab.get("constant-q").fill("0.3")
    done(2)
    tab.page.reload()
    done(2)
    card.locator("button", has_text="To Experiment").click()
    tab.run(steps=50, runs=50)
    done(3)
    tab.get("algorithm-conventional").click()
    tab.run()
    done(4)
    tab.get("export").click()
    exported(tab, "html")
    done(5)


# Keyboard, sizes, themes, tabs -------------------------------------------------------------------------------------------


def typed_by_keys(tab: Tab) -> None:
    """From the empty page to a model of one state called level, with Tab, Enter and letters alone."""
    tab.press("Tab")
    until(lambda: tab.page.evaluate("document.activeElement.textContent") == "Skip to the page")
    tab.press("Enter")
    tab.walk("[data-test=begin-new]", most=3)
    tab.press("Enter")
    tab.focused("new-n")
    tab.press("Control+a")
    tab.press("1")
    tab.press("Enter")
    tab.focused("state-name-0")
    tab.page.keyboard.type("level")
    tab.walk("[data-test=cell-F-0-0]", most=3)
    tab.page.keyboard.type("-0.5")
    tab.walk("[data-test=cell-R-0-0]")
    tab.page.keyboard.type("2")


def test_the_keyboard_alone_suffices(visit: Visits) -> None:
    """From the empty page to the results with Tab, Enter, space and arrows; what has the focus is seen."""
    tab = visit().tab()
    typed_by_keys(tab)
    tab.press("Alt+Shift+E")
    tab.page.wait_for_selector("[data-test=runs]")
    tab.walk("[data-test=runs]")
    tab.press("Control+a")
    tab.page.keyboard.type("30")
    tab.walk("[data-test=algorithm-ud]")
    tab.press("Space")
    tab.press("Control+Enter")
    tab.results()
    until(lambda: "30 runs" in tab.get("found-told").inner_text())
    until(lambda: "estimate, Factors UDUᵀ" in tab.curves("plot-states"))
    until(lambda: "level" in (tab.get("plot-states").text_content() or ""))
    tab.walk("[data-test=part-states]")
    tab.press("ArrowRight")
    tab.press("Enter")
    assert tab.curves("plot-accuracy")


@pytest.mark.parametrize("size", [DESKTOP, PHONE, ZOOMED], ids=["desktop", "phone", "400 %"])
def test_every_page_fits_its_window_and_names_its_fields(visit: Visits, size: dict[str, int]) -> None:
    """No page is wider than the window, at a desk, on a phone and at 400 %, light and dark; every field and button has a name."""
    tab = begun(visit, viewport=size, has_touch=size is PHONE)
    for page in PAGES:
        tab.go(page)
        if page == "understand":
            tab.curves("plot-bode")
        for scheme in ("light", "dark"):
            tab.page.emulate_media(color_scheme=scheme)
            until(lambda scheme=scheme: tab.dark() == (scheme == "dark"))
            until(lambda: tab.widest() <= 0)
        until(lambda: "rgb(255, 255, 255)" not in tab.backgrounds())
        until(lambda: tab.unnamed() == [])


@pytest.mark.parametrize("size", [PHONE, ZOOMED], ids=["phone", "400 %"])
def test_results_and_labs_fit_a_small_window(visit: Visits, size: dict[str, int]) -> None:
    """Figures and tables move inside their cards, not the page; what stays in place while one scrolls leaves most of the window."""
    tab = begun(visit, page="experiment", viewport=size, has_touch=True)
    tab.get("algorithm-ud").click()
    tab.run(steps=50, runs=50)
    for part in ("errors", "innovations", "algorithms", "numbers", "states"):
        tab.part(part)
        tab.page.wait_for_selector("[data-test=results] :is(table, .main-svg)")
        until(lambda: tab.widest() <= 0)
        assert tab.covered() <= 0.4
    tab.go("labs")
    tab.page.click("[data-lab=task07]")
    tab.page.wait_for_selector(".ctl-lab-form")
    until(lambda: tab.widest() <= 0)
    until(lambda: tab.unnamed() == [])
    assert tab.covered() <= 0.4


@pytest.mark.parametrize("size", [PHONE, ZOOMED], ids=["phone", "400 %"])
def test_a_model_is_typed_and_regulated_in_a_small_window(visit: Visits, size: dict[str, int]) -> None:
    """A cell that is typed into is seen whole; the regulator's pictures and weights do not widen the page."""
    tab = begun(visit, viewport=size, has_touch=True)
    edit(tab, "H", 0, 2, text="0.125")
    tab.page.wait_for_selector(".q-notification", state="detached")
    for cell in (("P0", 2, 2), ("H", 0, 2), ("F", 0, 0), ("R", 0, 0), ("F", 2, 2)):
        tab.cell(*cell).focus()
        until(lambda cell=cell: tab.cell(*cell).evaluate(
            "e => { const box = e.getBoundingClientRect();"
            " return document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2) === e; }"
        ))  # fmt: skip
    tab.go("control")
    tab.get("control-add-input").click()
    tab.page.wait_for_selector("[data-test=control-verdict]:has-text('stable')")
    tab.page.wait_for_selector("[data-test=plot-tradeoff] .js-plotly-plot .main-svg")
    until(lambda: tab.widest() <= 0)
    assert tab.covered() <= 0.5


def test_dark_and_light_are_chosen(visit: Visits) -> None:
    """As the system says, or as one chooses; figures follow at once, and the choice stays."""
    tab = begun(visit, page="understand", color_scheme="dark")
    tab.curves("plot-bode")

    def lightness() -> float:
        """Of the words in a figure, from 0 to 255."""
        colour = "getComputedStyle(document.querySelector('[data-test=plot-bode] .xtitle')).fill"
        return sum(map(float, re.findall(r"\d+(?:\.\d+)?", tab.page.evaluate(colour))[:3])) / 3

    until(lambda: lightness() > 150)
    tab.page.click("[aria-label='Theme: auto']")
    until(lambda: lightness() < 100)
    tab.page.click("[aria-label='Theme: light']")
    until(lambda: lightness() > 150)
    tab.page.reload()
    tab.ready()
    until(lambda: tab.dark())
    tab.page.emulate_media(color_scheme="light")
    tab.curves("plot-bode")
    until(lambda: lightness() > 150)


def test_two_tabs_have_two_drafts(visit: Visits) -> None:
    """What is typed in one is not in the other, undo and settings neither."""
    person = visit()
    one, two = person.tab(), person.tab(query="?draft=new")
    one.load(OSCILLATOR)
    two.load(ready("local_level").dumps(), "level.toml")
    until(lambda: one.page.url != two.page.url)
    edit(one, "H", 0, 1, text="0.5")
    two.go("experiment")
    two.settle(seed=77)
    two.go("model")
    two.get("undo").click()
    two.get("begin-ready").wait_for()
    one.page.reload()
    one.ready()
    holds(one.cell("H", 0, 1), "0.5")
    one.go("experiment")
    holds(one.field("seed"), "1")


def test_two_tabs_with_one_draft_show_the_same(visit: Visits) -> None:
    """A copied address leads to the same model, and each shows what the other does."""
    one = begun(visit)
    same = Tab(one.visit, one.visit.context.new_page())
    same.open(one.page.url)
    holds(same.cell("F", 1, 0), "-omega^2")
    edit(same, "H", 0, 2, text="0.25")
    holds(one.cell("H", 0, 2), "0.25")
    one.get("undo").click()
    holds(same.cell("H", 0, 2), "0")


def test_nothing_is_taken_from_typing_hands(visit: Visits) -> None:
    """Two tabs with one draft: what one types stays whole while the other edits, and in the end both have both."""
    one = begun(visit)
    same = Tab(one.visit, one.visit.context.new_page())
    same.open(one.page.url)
    cell = same.cell("F", 1, 0)
    cell.focus()
    cell.press("End")
    same.page.keyboard.type("*1.00")
    edit(one, "H", 0, 2, text="0.25")
    holds(same.cell("H", 0, 2), "0.25")
    same.page.keyboard.type("01")
    assert cell.input_value() == "-omega^2*1.0001"
    assert same.page.evaluate("document.activeElement.dataset.test") == "cell-F-1-0"
    holds(one.cell("F", 1, 0), "-omega^2*1.0001")


def test_the_bare_address_and_the_title_lead_back(visit: Visits) -> None:
    """To the draft last worked on, also in the tab that has it; and the title does not load the page again."""
    tab = begun(visit)
    address = tab.page.url
    tab.open(tab.visit.server.address)
    holds(tab.cell("F", 1, 0), "-omega^2")
    assert tab.page.url == address
    tab.page.evaluate("window.stays = 1")
    tab.go("keep")
    tab.page.click(".ctl-title")
    holds(tab.cell("F", 1, 0), "-omega^2")
    assert tab.page.evaluate("window.stays") == 1


def test_what_was_found_stays_while_a_constant_is_wrong(visit: Visits) -> None:
    """Understand follows as one types; a word for a number greys the results and is told once, a right one brings them back."""
    tab = begun(visit)
    tab.go("understand")
    tab.curves("plot-bode")
    seen = tab.get("summary").inner_text()
    field = tab.field("constant-omega")
    field.focus()
    field.press("End")
    tab.page.keyboard.type("+")
    tab.get("understand-wrong").wait_for()
    assert tab.page.locator(".ctl-stale").count() == 2
    assert tab.page.locator("[data-test=reason]:visible").count() == 0
    tab.press("Backspace")
    tab.get("understand-wrong").wait_for(state="hidden")
    until(lambda: tab.get("summary").inner_text() == seen)
    assert tab.page.locator(".ctl-stale").count() == 0


# Who may come in ---------------------------------------------------------------------------------------------------------


def test_another_host_needs_its_token(another: Servers, visit: Visits) -> None:
    """Without it a line and nothing else; with it, once, all pages; other browsers stay out."""
    server = another("--host", "0.0.0.0")
    token = re.search(r"\?token=([\w-]+)", server.start())
    assert token
    person, stranger = visit(server, admitted=False), visit(server, admitted=False)
    stranger.forgiven = "403"
    page = stranger.context.new_page()
    assert page.goto(f"{server.address}/model").status == 403
    assert "token: expected the address that the server printed" in page.inner_text("body")
    tab = person.tab(query=f"?token={token[1]}")
    assert "token" not in tab.page.url
    tab.load(OSCILLATOR)
    edit(tab, "H", 0, 1, text="0.5")
    tab.page.reload()
    tab.ready()
    holds(tab.cell("H", 0, 1), "0.5")
    assert page.goto(tab.page.url).status == 403


def test_what_the_tests_watch_for_in_a_browser_is_seen(another: Servers, opened: Browser) -> None:
    """A word in the console, an exception, a request to another machine (which the page's policy refuses)."""
    server = another()
    server.start()
    person = Visit(opened, server)
    tab = person.tab()
    person.check()
    tab.page.evaluate("console.error('loud')")
    tab.page.evaluate("setTimeout(() => { throw new Error('thrown') })")
    refused = tab.page.evaluate("fetch('http://192.0.2.1/x').then(() => 'came', () => 'refused')")
    assert refused == "refused"
    for seen in ("loud", "thrown", "192.0.2.1"):
        until(lambda seen=seen: any(seen in line for line in [*person.elsewhere, *person.complaints]))
    with pytest.raises(AssertionError):
        person.check()


def test_what_the_tests_watch_for_in_the_server_is_seen(another: Servers) -> None:
    """A process with the listener that asks for another machine leaves a line, one that asks for this one does not."""
    server = another()
    watched = {"PYTHONPATH": str(server.folder / "listener"), "CTLABS_OUTSIDE": str(server.outside_file)}
    for host in ("127.0.0.1", "192.0.2.1"):
        said = f"import socket; s = socket.socket(); s.settimeout(0.01); s.connect_ex(('{host}', 1))"
        subprocess.run([sys.executable, "-c", said], env=watched, check=True)
    assert server.outside == ["socket.connect 192.0.2.1"]
    server.outside_file.unlink()
