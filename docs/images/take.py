"""Take the pictures of the workbench that the documentation shows: ``make pictures``, after the pages have changed.

Needs Chromium and the extras ``workbench`` and ``test``. Few colours make small files.
"""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
FOLDER = Path(__file__).parent
COLOURS = 128


def main() -> None:
    """Start a server of its own, take all pictures, end it."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        command = [sys.executable, "-m", "ctlabs", "workbench", "--no-open", "--port", "0", "--data", folder]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        found = re.search(r"http://\S+", server.stdout.readline())
        assert found
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        try:
            for scheme in ("light", "dark"):
                walk(browser, found[0].rstrip("/"), scheme)
            phone = browser.new_context(viewport={"width": 390, "height": 844}).new_page()
            phone.goto(found[0] + "model")
            begin(phone)
            save(phone, "model-phone")
        finally:
            browser.close()
            server.terminate()
            server.wait()


def walk(browser: Any, address: str, scheme: str) -> None:
    """All pages in one scheme of colours."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}, color_scheme=scheme).new_page()
    page.goto(f"{address}/model")
    begin(page)
    save(page, f"model-{scheme}")
    go(page, "understand")
    page.wait_for_selector(".js-plotly-plot .main-svg")
    save(page, f"understand-{scheme}")
    go(page, "experiment")
    page.click("[data-test=algorithm-ud]")
    page.click("[data-test=run]")
    page.wait_for_selector(".js-plotly-plot .main-svg")
    save(page, f"experiment-{scheme}")
    go(page, "keep")
    save(page, f"keep-{scheme}")
    go(page, "labs")
    page.get_by_text("The scalar system").click()
    save(page, f"labs-{scheme}")
    go(page, "help")
    save(page, f"help-{scheme}")
    page.goto(f"{address}/model?draft=new")
    begin(page, "cart_pendulum")
    go(page, "control")
    page.wait_for_selector("[data-test=plot-control-poles] .js-plotly-plot .main-svg")
    save(page, f"control-{scheme}")
    page.context.close()


def begin(page: Any, name: str = "singer") -> None:
    """Open a ready model, by default that of a target that manoeuvres."""
    page.click("[data-test=begin-ready]")
    page.locator(f"[data-test=ready-{name}]").first.click()
    page.wait_for_selector("[data-test^=cell-]")


def go(page: Any, name: str) -> None:
    """Choose a page in the list."""
    page.click(f"nav a[href^='/{name}']")
    page.wait_for_selector(".ctl-main[aria-busy=false]")


def save(page: Any, name: str) -> None:
    """The window as it is when everything in it has come to rest."""
    page.mouse.move(0, 0)
    page.wait_for_timeout(2500)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
