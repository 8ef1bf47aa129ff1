"""A student with a plant, in a real browser: from an empty page to a regulator in C that takes the same steps as the workbench.

Fixtures and rules are those of :mod:`tests.workbench_browser`: nothing on the console, nothing to another machine.
"""
# ruff: noqa: F811  # fixtures are imported, and named as arguments

from __future__ import annotations

import csv
import io
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ctlabs import Cost, regulator
from ctlabs.files.modelfile import ready
from ctlabs.models import ContinuousModel
from ctlabs.text import number
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

#: A cart with a pole: place, speed, angle, its rate; the push moves cart and pole.
PENDULUM: dict[str, Any] = {
    "F": [[0, 1, 0, 0], [0, -0.1, -0.981, 0], [0, 0, 0, 1], [0, 0.2, 21.582, 0]],
    "G": [[0], [1], [0], [-2]],
    "Q": [[0.001]],
    "H": [[1, 0, 0, 0], [0, 0, 1, 0]],
    "R": [["0.005^2", 0], [0, "0.005^2"]],
    "P0": [["0.01^2", 0, 0, 0], [0, "0.01^2", 0, 0], [0, 0, "0.01^2", 0], [0, 0, 0, "0.01^2"]],
}
#: Reads measurements, a line each, and writes the inputs that answer them.
PROGRAM = """
#include <stdio.h>
#include "regulator.h"
int main(void) {
    double xi[NAME_q], z[NAME_m], u[NAME_r];
    for (int i = 0; i < NAME_q; i++) xi[i] = NAME_xi0[i];
    while (scanf("%lf %lf", &z[0], &z[1]) == 2) {
        NAME_step(xi, z, NULL, u);
        printf("%.17g\\n", u[0]);
    }
    return 0;
}
"""


def begun(visit: Visits, name: str = "cart_pendulum", **options: Any) -> Tab:
    """The page Control of a person who has opened a ready plant, with its regulator."""
    tab = visit(**options).tab()
    tab.load(ready(name).dumps(), f"{name}.toml")
    tab.go("control")
    verdict(tab)
    return tab


def verdict(tab: Tab, words: str = "The loop is stable") -> str:
    """Wait for the verdict; what it says."""
    tab.page.wait_for_selector(f"[data-test=control-verdict]:has-text('{words}')")
    return tab.get("control-verdict").inner_text()


def chosen(tab: Tab, test: str, words: str) -> None:
    """Choose in a select."""
    tab.page.locator(f"[data-test='{test}']").click()
    tab.page.locator(".q-menu .q-item", has_text=words).first.click()


def by_hand() -> Any:
    """The regulator of the pendulum that is typed below, by the library alone."""
    F, G, Q, H = (np.array(PENDULUM[name], dtype=float) for name in "FGQH")
    plant = ContinuousModel(F, G, Q, H, B=G, P0=1e-4 * np.eye(4))
    return regulator(plant, Cost(np.diag([25, 1, 100, 1]), [[0.25]]), dt=0.02, R=2.5e-5 * np.eye(2))


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_pendulum_typed_on_an_empty_page_is_balanced_by_c(visit: Visits, tmp_path: Path) -> None:
    """Matrices, an input, weights, a regulator, its file: compiled, it answers the workbench's own run as the workbench does."""
    tab = visit().tab()
    tab.get("begin-new").click()
    tab.field("new-n").fill("4")
    tab.field("new-m").fill("2")
    tab.get("new-begin").click()
    tab.focused("state-name-0")
    tab.get("title").fill("Pole")
    for i, name in enumerate(("s", "speed", "theta", "rate")):
        tab.get(f"state-name-{i}").fill(name)
    tab.type(**PENDULUM)
    tab.get("dt").fill("0.02")
    tab.page.wait_for_selector("[data-test=problems][data-count='0']")
    tab.go("control")
    chosen(tab, "control-input-state", "speed")
    tab.get("control-add-input").click()
    tab.get("weights").wait_for()
    tab.go("model")
    tab.cell("B", 3, 0).fill("-2")
    tab.go("control")
    verdict(tab, "the plant alone is not")
    tab.get("weight-Qx-0").fill("25")
    tab.get("weight-Qx-2").fill("100")
    tab.get("weight-Qu-0").fill("0.25")
    expected = number(by_hand().cost.value, 5)
    until(lambda: f"It costs {expected} per second" in verdict(tab))
    name, header = tab.saved(tab.get("export-h").click)
    assert name == "pole_regulator.h"
    _, run = tab.saved(tab.get("control-csv").click)
    heads, *rows = csv.reader(io.StringIO(run.decode()))
    assert heads[-3:] == ["z1 (measured)", "z2 (measured)", "u"]
    values = np.array(rows, dtype=float)
    (tmp_path / "regulator.h").write_bytes(header)
    (tmp_path / "main.c").write_text(PROGRAM.replace("NAME", "pole_regulator"))
    program = tmp_path / "run"
    cc = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off", "-o", str(program), str(tmp_path / "main.c")]
    subprocess.run(cc, check=True)
    fed = "".join(f"{row[-3]} {row[-2]}\n" for row in rows)
    told = subprocess.run([str(program)], input=fed, capture_output=True, text=True, check=True).stdout
    u = np.array(told.split(), dtype=float)
    assert len(u) == len(rows) > 100
    assert np.abs(u - values[:, -1]).max() <= 1e-12 * np.abs(values[:, -1]).max()


def test_a_slider_moves_all_that_follows_and_undo_brings_the_expression_back(visit: Visits) -> None:
    """By the keyboard: the slider of an input's weight; σ beside the weights, the verdict, the poles follow."""
    tab = begun(visit)
    before, sigma = verdict(tab), tab.get("sigma-weight-Qu-0").inner_text()
    assert tab.get("weight-Qu-0").input_value() == "1/u_max^2"
    tab.get("slider-weight-Qu-0").focus()
    tab.press("End")
    until(lambda: tab.get("weight-Qu-0").input_value() == "1000")
    until(lambda: verdict(tab) != before)
    until(lambda: tab.get("sigma-weight-Qu-0").inner_text() != sigma)
    tab.page.evaluate("document.activeElement.blur()")
    tab.press("Control+z")
    until(lambda: tab.get("weight-Qu-0").input_value() == "1/u_max^2")
    until(lambda: verdict(tab) == before)
    assert {"plant", "feedback", "estimator"} <= set(tab.curves("plot-control-poles"))


def test_what_is_wrong_is_said_and_the_last_regulator_stays(visit: Visits) -> None:
    tab = begun(visit)
    tab.get("weight-Qu-0").fill("-1")
    tab.page.wait_for_selector("[data-test=control-wrong]:has-text('expected weights >= 0')")
    until(lambda: tab.get("control-gains").is_visible() and tab.get("export-h").is_disabled())
    tab.get("weight-Qu-0").fill("1")
    tab.page.wait_for_selector("[data-test=control-wrong]", state="hidden")
    until(tab.get("export-h").is_enabled)


def test_settings_curves_runs_and_another_plant(visit: Visits) -> None:
    """What is set is in the model file; the curves come; many runs agree with theory; a heavier cart falls."""
    tab = begun(visit)
    chosen(tab, "control-kind", "before")
    tab.get("control-integral-position").click()
    tab.get("weight-integral-position").wait_for()
    verdict(tab)
    assert "this regulator" in tab.curves("plot-tradeoff")
    assert "this regulator" in tab.curves("plot-periods")
    tab.field("control-runs").fill("200")
    tab.get("control-run").click()
    tab.page.wait_for_selector("[data-test=control-ensemble]:has-text('Runs and theory are')")
    assert "theory" in tab.curves("plot-control-many")
    chosen(tab, "elsewhere-what", "constant M")
    tab.field("elsewhere-value").fill("10")
    tab.get("elsewhere-run").click()
    tab.page.wait_for_selector("[data-test=elsewhere-found]:has-text('does not hold this plant')")
    tab.go("model")
    tab.get("view-text").click()
    until(lambda: 'kind = "delayed"' in tab.field("text").input_value())
    assert "integral = {position = 1}" in tab.field("text").input_value()


def test_the_response_follows_the_set_point_that_is_typed(visit: Visits) -> None:
    """The lower tank comes to rest where it is told, 0.2 or −0.05 m, also after the weights have moved; a word is refused."""
    tab = begun(visit, "two_tanks")

    def ends() -> float:
        tab.curves("plot-control-step-0")
        last = "document.querySelector(\"[data-test='plot-control-step-0'] .js-plotly-plot\")._fullData[0].y.slice(-1)[0]"
        return float(tab.page.evaluate(last))

    until(lambda: abs(ends() - 1.0) < 0.05)
    tab.field("set-point-0").fill("0.2")
    until(lambda: abs(ends() - 0.2) < 0.01)
    tab.field("set-point-0").fill("half")
    tab.page.wait_for_selector("text=expected a number, received")
    tab.field("set-point-0").fill("-0.05")
    until(lambda: abs(ends() + 0.05) < 0.0025)
    before = verdict(tab)
    tab.get("weight-Qu-0").fill("1e8")
    until(lambda: verdict(tab) != before)
    until(lambda: abs(ends() + 0.05) < 0.02)
    assert tab.field("set-point-0").input_value() == "-0.05"


def test_a_known_input_is_given_to_a_regulator_and_back(visit: Visits) -> None:
    tab = begun(visit, "dc_motor")
    tab.get("control-end").click()
    tab.get("control-begin-cost").click()
    verdict(tab)
    tab.page.evaluate("document.activeElement.blur()")
    tab.press("Control+z")
    tab.get("control-begin-cost").wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_phone_and_the_keyboard_leads_to_the_weights(visit: Visits, scheme: Any) -> None:
    tab = begun(visit, viewport=PHONE, has_touch=True, color_scheme=scheme)
    tab.curves("plot-control-course")
    until(lambda: tab.widest() <= 0)
    assert tab.unnamed() == []
    tab.walk("[data-test=weight-Qx-0]")
    tab.walk("[data-test=slider-weight-Qx-0]")
