"""The workbench in a browser: how long a person waits, alone and among twenty.

Nineteen of the twenty speak the browser's protocol without drawing, for this machine has the server to run, not their screens;
one has a real browser. Prints one line each; exits 1 when a stated limit is missed or an edit is lost. Needs Chromium and
the extras ``workbench`` and ``test``.
"""

from __future__ import annotations

import asyncio
import html
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable
from contextlib import closing
from itertools import starmap
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import socketio
from timing import REPEATS

from ctlabs.files.modelfile.catalogue import ready
from ctlabs.workbench.desk.desk import LOCAL
from ctlabs.workbench.desk.store import Store

#: Rows of a file that is dropped, states of a large model.
ROWS, STATES = 100_000, 60
SESSIONS, EDITS, THINKING = 20, 9, 0.5
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
            data = Path(folder) / "data"
            drafts = begun(data)
            server, address = serve(data)
            try:
                alone = await opened(browser, address)
                edits = [await edit(alone, f"0.{i + 1}") for i in range(REPEATS)]
                await alone.click("nav a[href^='/experiment']")
                runs = [await run(alone) for _ in range(REPEATS + 1)][1:]  # the first one starts the process
                drops = [await dropped(alone, table) for table in (logged(1), *map(logged, range(2, REPEATS + 2)))][1:]
                await alone.context.close()
                large = await opened(browser, address, oscillators(STATES // 2))
                cells = [await answered(large, f"0.{i + 1}") for i in range(REPEATS)]
                await large.context.close()
                waits, seen = await together(browser, address, drafts)
            finally:
                server.terminate()
                server.wait()
            await browser.close()
        lost = sum(not kept(data, draft, typed(i, EDITS - 1)) for i, draft in enumerate(drafts))
    return [
        ("start to first page, s", statistics.median(starts), 1.5),
        ("an edit to its equation, 3 states, s", statistics.median(edits), 0.3),
        (f"an edit to what is said of it, {STATES} states, s", statistics.median(cells), 0.5),
        (f"a file of {ROWS:,} rows, from drop to estimates, s", statistics.median(drops), 4.0),
        ("click to plot, 1000 runs of 200 steps, 3 states, s", statistics.median(runs), 1.0),
        (
            f"95 % of the edits of {SESSIONS} sessions that also run, s",
            statistics.quantiles(waits + seen, n=20)[-1],
            1.0,
        ),
        ("the middle edit of the one in a browser, s", statistics.median(seen), 1.0),
        ("edits lost", lost, 0),
    ]


def begun(data: Path) -> list[str]:
    """A draft with a model of three states for each of the people."""
    with closing(Store(data)) as store:
        text = ready("singer").dumps()
        return [store.new_draft(LOCAL, f"person{i}", text).id for i in range(SESSIONS - 1)]


def kept(data: Path, draft: str, text: str) -> bool:
    """Whether the last edit of a draft is in the database."""
    with closing(Store(data)) as store:
        found = store.draft(draft, LOCAL)
    return found is not None and text in found.text


def serve(data: Path) -> tuple[subprocess.Popen[str], str]:
    """The command in a process of its own, and its address."""
    command = [
        sys.executable,
        "-m",
        "ctlabs",
        "workbench",
        "--no-open",
        "--no-token",
        "--port",
        "0",
        "--data",
        str(data),
    ]
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


async def opened(browser: Any, address: str, model: str = "") -> Any:
    """A browser of its own with a model of three states, or with another one."""
    page = await (await browser.new_context()).new_page()
    page.set_default_timeout(60_000)
    await page.goto(f"{address}/model")
    if model:
        content = {"name": "model.toml", "mimeType": "application/toml", "buffer": model.encode()}
        await page.set_input_files(".ctl-model input[type=file]", content)
    else:
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


async def answered(page: Any, text: str) -> float:
    """From typing into a cell of a large model, whose equations have no numbers, to the page's word that it has been saved."""
    start = time.perf_counter()
    await page.fill("[data-test=cell-F-0-2]", text)
    said = "() => !document.body.hasAttribute('data-typing') && document.querySelector('.ctl-saved[data-state=saved]')"
    await page.wait_for_function(said)
    return time.perf_counter() - start


def oscillators(count: int) -> str:
    """A model file of so many oscillators, all of them measured together; a large one is shown by its entries that are not zero."""
    n = 2 * count
    F = [[0.0] * n for _ in range(n)]
    for i in range(count):
        F[2 * i][2 * i + 1], F[2 * i + 1][2 * i], F[2 * i + 1][2 * i + 1] = 1.0, -float(i + 1), -0.1
    F[0][2] = 0.5
    noise = [[1.0 if i == 2 * j + 1 else 0.0 for j in range(count)] for i in range(n)]
    unit = [[float(i == j) for j in range(n)] for i in range(n)]
    strengths = [[0.1 * (i == j) for j in range(count)] for i in range(count)]
    row = [float(i % 2 == 0) for i in range(n)]
    table = {"F": F, "G": noise, "Q": strengths, "H": [row], "R": [[1.0]], "x0": [0.0] * n, "P0": unit, "dt": 0.01}
    told = "\n".join(f"{name} = {value}" for name, value in table.items())
    names = json.dumps([f"x{i + 1}" for i in range(n)])
    return f'format = 1\nkind = "continuous"\n[model]\nstates = {names}\nmeasurements = ["z"]\n{told}\n'


def logged(seed: int) -> str:
    """A table of measurements of the model of three states, as a logger writes it."""
    model = ready("singer")
    values = np.cumsum(np.random.default_rng(seed).standard_normal(ROWS))
    return model.measurements[0] + "\n" + "".join(f"{value:.4f}\n" for value in values)


async def dropped(page: Any, table: str) -> float:
    """From the drop of a table to its estimates."""
    await page.click("nav a[href^='/data']")
    await page.wait_for_selector("[data-test=data-choose]")
    name = f"log{hash(table) % 10**6}.csv"
    moved = await page.evaluate_handle(
        "([text, name]) => { const moved = new DataTransfer(); moved.items.add(new File([text], name)); return moved; }",
        [table, name],
    )
    start = time.perf_counter()
    for event in ("dragenter", "dragover", "drop"):
        await page.dispatch_event("body", event, {"dataTransfer": moved})
    await page.wait_for_selector(f"[data-test=data-summary]:has-text('{name}')")
    took = time.perf_counter() - start
    await page.wait_for_selector(
        "[data-test=data-suggestion]:not(:has-text('being tested'))"
    )  # or the next drop would wait for it
    return took


async def run(page: Any) -> float:
    """From the click to the plot."""
    before = await page.text_content("[data-test=found-told]") or ""
    start = time.perf_counter()
    await page.click("[data-test=run]")
    await page.wait_for_function(RESULT, arg=before)
    return time.perf_counter() - start


async def together(browser: Any, address: str, drafts: list[str]) -> tuple[list[float], list[float]]:
    """People who edit at the same time and run an experiment in between: the waits of all, and those of one in a browser."""
    people = [Person(address, draft) for draft in drafts]
    for person in people:
        await person.open("model")
    waits: list[float] = []

    async def work(number: int, person: Person) -> None:
        await asyncio.sleep(THINKING * number / len(people))
        for i in range(EDITS):
            waits.append(await person.edit(typed(number, i)))
            if i == EDITS // 2:
                await person.run()
            await asyncio.sleep(THINKING)
        await person.socket.disconnect()

    async def watch(page: Any) -> list[float]:
        found = []
        for i in range(EDITS):
            found.append(await edit(page, typed(SESSIONS, i)))
            await asyncio.sleep(THINKING)
        return found

    seen, *_ = await asyncio.gather(watch(await opened(browser, address)), *starmap(work, enumerate(people)))
    return waits, seen


def typed(person: int, edit: int) -> str:
    """What nobody else types, nor the same person again."""
    return f"0.{person + 10}{edit + 11}"


class Person:
    """Somebody at a machine of their own: what a browser sends and receives, without one that this machine must draw.

    Speaks NiceGUI's protocol: the page's elements come as JSON, changes as messages over a web socket.
    """

    def __init__(self, address: str, draft: str) -> None:
        self.address, self.draft = address, draft
        self.elements: dict[str, dict[str, Any]] = {}
        self.changed = asyncio.Event()
        self.seen = ""  # what came since the last event was sent
        self.number = 0
        self.socket = socketio.AsyncClient(reconnection=False)
        self.socket.on("update", self._update)

    async def open(self, page: str) -> None:
        """Open a page and wait until it is there."""
        async with httpx.AsyncClient(timeout=60) as web:
            text = (await web.get(f"{self.address}/{page}?draft={self.draft}")).text
            cookies = "; ".join(f"{name}={value}" for name, value in web.cookies.items())
        found = re.search(r"parseElements\(String\.raw`(.*?)`\)", text, re.DOTALL)
        client = re.search(r"'client_id': '([^']+)'", text)
        assert found
        assert client
        self.elements, self.client = json.loads(html.unescape(found[1])), client[1]
        ids = {"client_id": self.client, "document_id": uuid.uuid4(), "tab_id": uuid.uuid4(), "next_message_id": 0}
        query = "&".join(f"{name}={value}" for name, value in ids.items())
        await self.socket.connect(
            f"{self.address}?{query}&implicit_handshake=true",
            headers={"Cookie": cookies, "Origin": self.address},
            transports=["websocket"],
            socketio_path="/_nicegui_ws/socket.io",
            wait_timeout=60,
        )
        await self.until(lambda: self.find("aria-busy", "false"))

    async def edit(self, text: str) -> float:
        """Type into a cell and wait for the equation that shows it."""
        start = time.perf_counter()
        self.number += 1
        grid = self.find("name", "F")
        await self.send(grid, "edit", {"number": self.number, "key": "0,2", "text": text})
        await self.until(lambda: f">{text}<" in self.seen and "<math" in self.seen)
        return time.perf_counter() - start

    async def run(self) -> None:
        """Go to the experiment, run it, wait for its picture, and come back."""
        await self.go("experiment", "run")
        await self.send(self.find("data-test", "run"), "click", {})
        await self.until(lambda: "plotly" in self.seen)
        await self.go("model", "equations")

    async def go(self, page: str, mark: str) -> None:
        """Choose a page in the list and wait until it is there."""
        link = next(i for i, e in self.elements.items() if e.get("props", {}).get("href", "").startswith(f"/{page}"))
        await self.send(link, "click", {})
        await self.until(lambda: self.find("data-test", mark))

    async def send(self, element: str, kind: str, arguments: dict[str, Any]) -> None:
        """An event of an element."""
        listener = next(e["listener_id"] for e in self.elements[element]["events"] if e["type"] == kind)
        message = {
            "id": int(element),
            "client_id": self.client,
            "listener_id": listener,
            "args": [json.dumps(arguments)],
        }
        self.seen = ""
        await self.socket.emit("event", message)

    async def until(self, there: Callable[[], object]) -> None:
        """Wait for something the server sends."""
        async with asyncio.timeout(60):
            while not there():
                self.changed.clear()
                await self.changed.wait()

    def find(self, name: str, value: str) -> str:
        """The element with this property, or nothing."""
        return next((i for i, e in self.elements.items() if e.get("props", {}).get(name) == value), "")

    async def _update(self, data: dict[str, Any]) -> None:
        data.pop("_id")
        for number, element in data.items():
            if element is None:
                self.elements.pop(number, None)
            else:
                self.elements[number] = element
        self.seen += json.dumps(data)
        self.changed.set()


if __name__ == "__main__":
    sys.exit(main())
