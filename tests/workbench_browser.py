"""The workbench as a person has it: the real command in a process of its own, and a real browser that notes what it does.

Fixtures: ``workbench`` (one server for a module), ``another`` (servers of a test's own, to be killed or to listen elsewhere),
``visit`` (browsers with cookies of their own). A test fails at its end when a page has written an error or a warning to the
console, when a request has left this machine, or when the server's processes have spoken to another one.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

ROOT = Path(__file__).parent.parent
PAGES = ("model", "understand", "experiment", "data", "fit", "control", "keep", "labs", "course", "help")
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
#: What is left of 1280 × 1024 at 400 %.
ZOOMED = {"width": 320, "height": 256}
#: How long anything may take before a test says that it has not come, in milliseconds.
PATIENCE = 60_000


# The browser -----------------------------------------------------------------------------------------------------------


def needed(what: str, found: object) -> None:
    """Without a browser these tests are skipped in words; where CI is set they fail, for there it is installed."""
    if not found:
        line = f"no browser tests here: {what} is not installed"
        if os.environ.get("CI"):
            pytest.fail(f"{line}, and CI is set", pytrace=False)
        pytest.skip(line)


def chromium() -> str:
    """Where the system's browser is."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    needed("chromium", found)
    return str(found)


def playing() -> Any:
    """Playwright's interface."""
    try:
        from playwright import sync_api
    except ImportError:
        needed("playwright", found=False)
    return sync_api


@pytest.fixture(scope="module")
def opened() -> Iterator[Browser]:
    """A browser without a window."""
    needed("the workbench (pip install 'ctlabs[workbench]')", importlib.util.find_spec("nicegui"))
    path, api = chromium(), playing()
    with api.sync_playwright() as play:
        made = play.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield made
        made.close()


# The server ------------------------------------------------------------------------------------------------------------

#: Python loads this first in every process of the server; what speaks to another machine is written down.
_LISTENER = """
import os
import sys


def _listen(event, args):
    if event == "socket.connect":
        host = args[1][0] if isinstance(args[1], tuple) else "127.0.0.1"
    elif event in {"socket.getaddrinfo", "socket.gethostbyname"}:
        host = args[0] or "localhost"
    else:
        return
    host = host.decode() if isinstance(host, bytes) else str(host)
    if not host.startswith("127.") and host not in {"::1", "localhost", "0.0.0.0"}:
        with open(os.environ["CTLABS_OUTSIDE"], "a") as file:
            file.write(f"{event} {host}\\n")


sys.addaudithook(_listen)
"""


class Workbench:
    """The command ``ctlabs workbench`` in a process of its own, on a free port, with a folder of its own."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self.options, self.port, self.token = folder, options, 0, ""
        self.outside_file, self.log = folder / "outside.log", folder / "server.log"
        (folder / "listener").mkdir()
        (folder / "listener" / "sitecustomize.py").write_text(textwrap.dedent(_LISTENER))
        self.process: subprocess.Popen[str]

    def start(self, **environment: str) -> str:
        """Start it, on the same port as before; the line it prints."""
        around = {name: value for name, value in os.environ.items() if name != "CTLABS_TOKEN"}
        around |= {
            "PYTHONPATH": os.pathsep.join((str(self.folder / "listener"), str(ROOT))),
            "CTLABS_DATA": str(self.folder / "data"),
            "CTLABS_OUTSIDE": str(self.outside_file),
        }
        command = [sys.executable, "-m", "ctlabs", "workbench", "--no-open", "--port", str(self.port), *self.options]
        with self.log.open("a") as log:
            self.process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=log, text=True, env=around | environment, cwd=self.folder
            )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        found = re.search(r":(\d+)/", line)
        assert found, line + self.log.read_text()
        self.port = int(found[1])
        token = re.search(r"\?token=([\w-]+)", line)
        self.token = token[1] if token else ""
        return line

    def kill(self) -> None:
        """End it as a power failure does."""
        self.end(signal.SIGKILL)

    def end(self, how: int = signal.SIGINT) -> None:
        """End it."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        self.process.communicate(timeout=PATIENCE / 1000)

    @property
    def address(self) -> str:
        """Where its pages are."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def outside(self) -> list[str]:
        """With which other machines its processes have spoken."""
        return self.outside_file.read_text().splitlines() if self.outside_file.exists() else []

    @property
    def errors(self) -> list[str]:
        """What it has logged, besides warnings."""
        lines = self.log.read_text().splitlines()
        return [line for line in lines if re.search(r"Traceback|Error\b|ERROR|CRITICAL", line)]


@pytest.fixture(scope="module")
def workbench(tmp_path_factory: pytest.TempPathFactory, opened: Browser) -> Iterator[Workbench]:
    """One server for all tests of a module; everybody's drafts are apart."""
    made = Workbench(tmp_path_factory.mktemp("workbench"))
    made.start()
    yield made
    made.end()


@pytest.fixture
def another(tmp_path: Path, opened: Browser) -> Iterator[Callable[..., Workbench]]:
    """Servers that are a test's own; they have not been started."""
    made: list[Workbench] = []

    def make(*options: str) -> Workbench:
        folder = tmp_path / f"server{len(made)}"
        folder.mkdir()
        made.append(Workbench(folder, *options))
        return made[-1]

    yield make
    for each in made:
        if hasattr(each, "process"):
            each.kill()
        assert each.outside == []


# A person at the browser -----------------------------------------------------------------------------------------------


class Visit:
    """A browser with cookies of its own, that notes what it asks for and what it complains of.

    ``admitted`` : whether it has been shown the server's token
    """

    def __init__(self, browser: Browser, server: Workbench, *, admitted: bool = True, **options: Any) -> None:
        self.server, self.forgiven = server, "(?!)"
        options = {"viewport": DESKTOP, "reduced_motion": "reduce", **options}  # nobody waits for what fades in
        self.context = browser.new_context(**options)
        self.context.set_default_timeout(PATIENCE)
        self.requests: list[str] = []
        self.complaints: list[str] = []
        if admitted and server.token:
            self.context.request.get(f"{server.address}/model?token={server.token}")
        self.context.on("page", self._watch)

    def tab(self, page: str = "model", query: str = "") -> Tab:
        """Another tab that shows a page."""
        made = Tab(self, self.context.new_page())
        made.open(f"{self.server.address}/{page}{query}")
        return made

    def _watch(self, page: Page) -> None:
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))
        page.on("console", lambda said: said.type in {"error", "warning"} and self.complaints.append(said.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    @property
    def elsewhere(self) -> list[str]:
        """Requests that left this machine."""
        return [url for url in self.requests if not re.match(r"(http|ws)://127\.0\.0\.1:\d+/|data:|blob:", url)]

    @property
    def unforgiven(self) -> list[str]:
        """What the console has that a test has not caused on purpose."""
        return [line for line in self.complaints if not re.search(self.forgiven, line)]

    def check(self) -> None:
        """Nothing left this machine, nothing was complained of."""
        assert self.elsewhere == []
        assert self.unforgiven == []


#: Whether one sees where the focus is: at what has it, or at what it is in.
_SEEN = """() => {
  const seen = (e, up) => e && up && (parseFloat(getComputedStyle(e).outlineWidth) >= 1
    && getComputedStyle(e).outlineStyle !== "none" || seen(e.parentElement, up - 1));
  return seen(document.activeElement, 5);
}"""

_UNNAMED = """[...document.querySelectorAll(
  "button, a[href], input:not([type=file], [type=hidden]), textarea, select, [role=checkbox], [role=combobox]",
)].filter(e => e.offsetParent && !(e.ariaLabel || e.textContent.trim() || e.labels?.length || e.title
  || e.getAttribute("aria-labelledby"))).map(e => e.outerHTML)"""

#: What does not scroll with the page, line by line down the middle of the window.
_COVERED = """() => {
  const fixed = e => e && (["fixed", "sticky"].includes(getComputedStyle(e).position) && !e.matches("main, .q-page-container")
    || fixed(e.parentElement));
  const rows = [...Array(innerHeight).keys()];
  const notes = e => e?.closest(".q-notifications");
  return rows.filter(y => { const e = document.elementFromPoint(innerWidth / 2, y); return !notes(e) && fixed(e); }).length / innerHeight;
}"""


class Tab:
    """A page of the workbench, and what a person does with it."""

    def __init__(self, visit: Visit, page: Page) -> None:
        self.visit, self.page = visit, page

    def open(self, address: str) -> None:
        """Go to an address and wait until the page is there."""
        self.page.goto(address)
        self.ready()

    def ready(self) -> None:
        """Wait until the page is there."""
        self.page.wait_for_selector(".ctl-main[aria-busy=false]")

    def go(self, name: str) -> None:
        """Choose a page in the list of pages."""
        hidden = self.page.locator("[aria-label='List of pages']").is_visible()
        if hidden:
            self.page.click("[aria-label='List of pages']")
        self.page.click(f"nav a[href^='/{name}']")
        self.page.wait_for_selector(f"nav a[href^='/{name}'][aria-current=page]", state="attached")
        if hidden:
            self.page.wait_for_selector(f"nav a[href^='/{name}']", state="hidden")
        self.ready()

    def get(self, test: str) -> Locator:
        """What has this mark."""
        return self.page.locator(f"[data-test='{test}']")

    def field(self, test: str) -> Locator:
        """The field with this mark, or inside what has it."""
        return self.page.locator(
            f"input[data-test='{test}'], textarea[data-test='{test}'], [data-test='{test}'] input"
        ).first

    def cell(self, matrix: str, *index: int) -> Locator:
        """A cell of a matrix."""
        return self.get("-".join(["cell", matrix, *map(str, index)]))

    def type(self, **cells: Sequence[Any]) -> None:
        """Type whole matrices, row by row."""
        for name, rows in cells.items():
            for i, row in enumerate(rows):
                for index, text in [((i, j), t) for j, t in enumerate(row)] if isinstance(row, list) else [((i,), row)]:
                    if self.cell(name, *index).input_value() != str(text):
                        self.cell(name, *index).fill(str(text))

    def press(self, keys: str) -> None:
        """Press keys, wherever the caret is."""
        self.page.keyboard.press(keys)

    def focused(self, test: str) -> None:
        """Wait until what has this mark has the focus."""
        self.page.wait_for_function("test => document.activeElement.dataset.test === test", arg=test)

    def walk(self, selector: str, most: int = 90) -> None:
        """Press Tab until the focus is there, and see where it is."""
        for _ in range(most):
            if self.page.evaluate("s => document.activeElement.matches(s)", selector):
                break
            self.press("Tab")
        else:
            pytest.fail(f"Tab does not lead to {selector}")
        self.page.wait_for_function(_SEEN)

    def load(self, text: str, name: str = "model.toml") -> None:
        """Open a model file on the page Model, which then has the focus."""
        before = self.get("undo").get_attribute("title") or ""
        content = {"name": name, "mimeType": "application/toml", "buffer": text.encode()}
        self.page.set_input_files(".ctl-model input[type=file]", content)
        self.page.wait_for_function("before => document.querySelector('[data-test=undo]').title !== before", arg=before)
        self.page.wait_for_function("() => document.activeElement.matches('.ctl-main')")

    def choose(self, test: str, name: str, text: str) -> None:
        """Press what opens the browser's file dialog, and choose a file there."""
        with self.page.expect_file_chooser() as chosen:
            self.get(test).click()
        chosen.value.set_files({"name": name, "mimeType": "text/plain", "buffer": text.encode()})

    def run(self, **fields: object) -> None:
        """Type settings of the experiment, run it, and wait for its results."""
        self.settle(**fields)
        before = self.get("found-told").text_content() or ""
        self.get("run").click()
        self.results(before)

    def results(self, before: str = "") -> None:
        """Wait for results, other ones than before."""
        self.page.wait_for_function(
            "before => { const told = document.querySelector('[data-test=found-told]')?.textContent; return told &&"
            " told !== before && document.querySelector('[data-test=results] :is(.js-plotly-plot .main-svg, table)'); }",
            arg=before,
        )

    def part(self, name: str) -> None:
        """Look at a part of the results."""
        self.get(f"part-{name}").click()

    def settle(self, **fields: object) -> None:
        """Type settings of the experiment."""
        for name, value in fields.items():
            self.field(name).fill(str(value))
            self.field(name).blur()

    def curves(self, plot: str) -> list[str]:
        """What a figure draws, by the names in its legend, once it is drawn."""
        self.page.wait_for_selector(f"[data-test='{plot}'] .js-plotly-plot .main-svg")
        names = f"document.querySelector(\"[data-test='{plot}'] .js-plotly-plot\").data.map(each => each.name ?? '')"
        return list(self.page.evaluate(names))

    def points(self, plot: str, curve: str) -> int:
        """How many points a curve of a figure has."""
        return int(
            self.page.evaluate(
                "([plot, curve]) => document.querySelector(`[data-test='${plot}'] .js-plotly-plot`)"
                "._fullData.find(each => each.name === curve).x.length",
                [plot, curve],
            )
        )

    def saved(self, click: Callable[[], object]) -> tuple[str, bytes]:
        """Name and content of the file that a click brings."""
        with self.page.expect_download() as waiting:
            click()
        return waiting.value.suggested_filename, Path(waiting.value.path()).read_bytes()

    def drop(self, target: str, name: str, content: str) -> None:
        """Drop a file on an element."""
        moved = self.page.evaluate_handle(
            "([name, content]) => { const moved = new DataTransfer();"
            " moved.items.add(new File([content], name)); return moved; }",
            [name, content],
        )
        for event in ("dragenter", "dragover", "drop"):
            self.page.dispatch_event(target, event, {"dataTransfer": moved})

    def unnamed(self) -> list[str]:
        """Buttons, links and fields that have no name for a person who does not see them."""
        return list(self.page.evaluate(_UNNAMED))

    def dark(self) -> bool:
        """Whether the page is a dark one."""
        return bool(self.page.evaluate("document.body.classList.contains('body--dark')"))

    def backgrounds(self) -> list[str]:
        """The colours behind the page and its parts."""
        parts = "[...document.querySelectorAll('body, .ctl-main section, .ctl-main .ctl-card')]"
        return list(self.page.evaluate(f"{parts}.map(e => getComputedStyle(e).backgroundColor)"))

    def covered(self) -> float:
        """Which part of the window's height is covered by what stays in its place while the page scrolls under it."""
        return float(self.page.evaluate(_COVERED))

    def widest(self) -> int:
        """How much wider than the window the page is, in pixels."""
        return int(self.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth"))


@pytest.fixture
def visit(opened: Browser, workbench: Workbench) -> Iterator[Callable[..., Visit]]:
    """Browsers, each of which must have had nothing to complain of in the end."""
    made: list[Visit] = []
    before = len(workbench.errors)

    def make(server: Workbench | None = None, **options: Any) -> Visit:
        made.append(Visit(opened, server or workbench, **options))
        return made[-1]

    yield make
    for each in made:
        each.context.close()
    for each in made:
        each.check()
    assert workbench.outside == []
    assert not workbench.errors[before:], workbench.log.read_text()


def until(true: Callable[[], object], seconds: float = PATIENCE / 1000) -> None:
    """Wait for something that no page shows."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it has not come"
        time.sleep(0.02)
