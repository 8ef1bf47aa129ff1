"""The workbench in a browser: how long a person waits, alone and among twenty.

Prints one line each; exits 1 when a stated limit is missed or an edit is lost. Needs Chromium and the extras ``workbench``
and ``test``.
"""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from timing import REPEATS

SESSIONS, EDITS = 20, 10
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
RESULT = """before => { const told = document.querySelector('[data-test=found-told]').textContent;
    return told !== before && document.querySelector('[data-test=results] .js-plotly-plot .main-svg'); }"""


def main() -> int:
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        print("skipped: chromium is not installed")
        return 0
    rows = asyncio.run(measured(browser))
    for name, found, limit in rows:
        print(f"{name:<58} {found:9.3g}   at most {limit:g}   {'' if found <= limit else 'MISSED'}")
    return int(any(found > limit for _, found, limit in rows))


async def measured(path: str) -> list[tuple[str, float, float]]:
    from playwright.async_api import async_playwright

    with tempfile.TemporaryDirectory() as folder:
        async with async_playwright() as play:
            browser = await play.chromium.launch(executable_path=path, args=ARGUMENTS)
            starts = [await first_page(browser, Path(folder) / str(i)) for i in range(REPEATS)]
            server, address = serve(Path(folder) / "data")
            try:
                alone = await opened(browser, address)
                edits = [await edit(alone, f"0.{i + 1}") for i in range(REPEATS)]
                await alone.click("nav a[href^='/experiment']")
                runs = [await run(alone) for _ in range(REPEATS + 1)][1:]  # the first one starts the process
                await alone.context.close()
                waits, lost = await together(browser, address)
            finally:
                server.terminate()
                server.wait()
            await browser.close()
    return [
        ("start to first page, s", statistics.median(starts), 1.5),
        ("an edit to its equation, 3 states, s", statistics.median(edits), 0.3),
        ("click to plot, 1000 runs of 200 steps, 3 states, s", statistics.median(runs), 1.0),
        (f"95 % of the edits of {SESSIONS} sessions that also run, s", statistics.quantiles(waits, n=20)[-1], 1.0),
        ("edits lost", lost, 0),
    ]


def serve(data: Path) -> tuple[subprocess.Popen[str], str]:
    """The command in a process of its own, and its address."""
    command = [sys.executable, "-m", "ctlabs", "workbench", "--no-open", "--port", "0", "--data", str(data)]
    around = {name: value for name, value in os.environ.items() if name != "CTLABS_TOKEN"}
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=around)
    assert server.stdout is not None
    found = re.search(r":(\d+)/", server.stdout.readline())
    assert found
    return server, f"http://127.0.0.1:{found[1]}"


async def first_page(browser: Any, data: Path) -> float:
    """From the start of the command to the list of pages."""
    page = await browser.new_page()
    start = time.perf_counter()
    server, address = serve(data)
    await page.goto(address)
    await page.wait_for_selector("nav a")
    took = time.perf_counter() - start
    await page.close()
    server.terminate()
    server.wait()
    return took


async def opened(browser: Any, address: str) -> Any:
    """A browser of its own with a model of three states."""
    page = await (await browser.new_context()).new_page()
    page.set_default_timeout(60_000)
    await page.goto(f"{address}/model")
    await page.click("[data-test=begin-ready]")
    await page.click("[data-test=ready-singer]")
    await page.wait_for_selector("[data-test=cell-F-0-2]")
    return page


async def edit(page: Any, text: str) -> float:
    """From typing into a cell to the equation that shows it."""
    start = time.perf_counter()
    await page.fill("[data-test=cell-F-0-2]", text)
    shown = "text => document.querySelector('[data-test=equations]').textContent.includes(text)"
    await page.wait_for_function(shown, arg=text)
    return time.perf_counter() - start


async def run(page: Any) -> float:
    """From the click to the plot."""
    before = await page.text_content("[data-test=found-told]") or ""
    start = time.perf_counter()
    await page.click("[data-test=run]")
    await page.wait_for_function(RESULT, arg=before)
    return time.perf_counter() - start


async def together(browser: Any, address: str) -> tuple[list[float], int]:
    """Sessions that edit at the same time and run an experiment in between; the waits, and how many lost their last edit."""
    pages = [await opened(browser, address) for _ in range(SESSIONS)]
    waits: list[float] = []

    async def work(number: int, page: Any) -> int:
        for i in range(EDITS):
            waits.append(await edit(page, f"0.{number + 10}{i + 1}"))
            if i == EDITS // 2:
                await page.click("nav a[href^='/experiment']")
                await run(page)
                await page.click("nav a[href^='/model']")
                await page.wait_for_selector("[data-test=cell-F-0-2]")
            await asyncio.sleep(0.5)  # a person looks at what has come
        await page.reload()
        await page.wait_for_selector("[data-test=cell-F-0-2]")
        return int(await page.input_value("[data-test=cell-F-0-2]") != f"0.{number + 10}{EDITS}")

    return waits, sum(await asyncio.gather(*(work(i, page) for i, page in enumerate(pages))))


if __name__ == "__main__":
    sys.exit(main())
