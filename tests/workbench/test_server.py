"""The workbench as it runs: ports, drafts and tabs, the guard around the real application, a real browser, kills."""

from __future__ import annotations

import base64
import hashlib
import http.client
import importlib.util
import os
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest
from click.testing import CliRunner

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.workbench.desk.store import FILE, Store
from ctlabs.workbench.serving import command, server
from ctlabs.workbench.serving.server import Desk, listen
from tests.workbench_browser import until

ROOT = Path(__file__).parents[2]
PAGES = ("model", "understand", "experiment", "keep", "labs", "help")


# Ports ---------------------------------------------------------------------------------------------------------------


def test_the_next_free_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a port the first free one; with one that is taken, a line that says so."""
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr(server, "PORT", port)
        with listen("127.0.0.1") as second:
            assert port < second.getsockname()[1] < port + server.PORTS
        with pytest.raises(
            ValueError, match=f"port: expected a free port of 127.0.0.1, received {port}: address already in use"
        ):
            listen("127.0.0.1", port)
        monkeypatch.setattr(server, "PORTS", 1)
        with pytest.raises(ValueError, match=f"port: expected a free port from {port} to {port}, received none"):
            listen("127.0.0.1")


@pytest.mark.parametrize(
    ("host", "port"), [("no.such.host.invalid", 1), ("127.0.0.1", 70000), ("a" * 300, 80), ("203.0.113.7", 0)]
)
def test_an_address_of_another_machine_is_refused(host: str, port: int) -> None:
    """In one line."""
    with pytest.raises(ValueError, match=r"^(host|port): expected .* received [^\n]+$"):
        listen(host, port)


# Drafts and tabs -------------------------------------------------------------------------------------------------------


class Session:
    """A session that says when it is closed."""

    closed: ClassVar[list[str]] = []

    def __init__(self, draft: Any, *, store: Store, runner: Any) -> None:
        self.draft = draft

    def close(self) -> None:
        Session.closed.append(self.draft.id)


class Tab:
    """As much of a tab as the desk sees."""

    def __init__(self, browser: str) -> None:
        self.browser = browser


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Callable[..., Desk]]:
    made: list[Desk] = []

    def make(shared: bool) -> Desk:
        made.append(Desk(tmp_path, shared=shared, session="tests.workbench.test_server:Session"))
        return made[-1]

    Session.closed.clear()
    yield make
    for each in made:
        each.close()


def test_tabs_have_drafts_of_their_own_and_share_when_asked(desk: Callable[..., Desk]) -> None:
    """A tab that wants a new draft has another; one that asks for the first's has its session; both are left apart."""
    d = desk(True)
    one, two, same, other = Tab("a"), Tab("a"), Tab("a"), Tab("b")
    first, second = d.enter(one, ""), d.enter(two, "new")  # type: ignore[arg-type]  # as much of a tab as it needs
    third = d.enter(same, first.draft.id)  # type: ignore[arg-type]
    fourth = d.enter(other, "")  # type: ignore[arg-type]
    assert len({first.draft.id, second.draft.id, fourth.draft.id}) == 3
    assert third.session is first.session
    assert second.session is not first.session
    assert d.others(one) == [same]  # type: ignore[arg-type, comparison-overlap]
    assert d.others(two) == []  # type: ignore[arg-type]
    d.leave(one)  # type: ignore[arg-type]
    assert Session.closed == []
    d.leave(same)  # type: ignore[arg-type]
    d.leave(same)  # type: ignore[arg-type]  # twice is once
    assert Session.closed == [first.draft.id]
    again = d.enter(Tab("a"), first.draft.id)  # type: ignore[arg-type]
    assert again.session is not first.session


def test_the_bare_address_leads_to_the_work_of_last_time(desk: Callable[..., Desk]) -> None:
    """Also where a tab still has it; and however often one comes and goes, a browser has one empty draft at most."""
    d = desk(True)
    work = d.enter(Tab("a"), "")  # type: ignore[arg-type]
    d.store.edit(work.draft.id, "title = 'mine'")
    assert d.enter(Tab("a"), "").draft.id == work.draft.id  # type: ignore[arg-type]
    for _ in range(3):
        tab = Tab("a")
        fresh = d.enter(tab, "new")  # type: ignore[arg-type]
        assert fresh.draft.id != work.draft.id
        d.leave(tab)  # type: ignore[arg-type]
    assert len(d.store.drafts("local")) == 2
    d.store.edit(fresh.draft.id, "title = 'later'")
    assert d.enter(Tab("a"), "").draft.id == fresh.draft.id  # type: ignore[arg-type]


def test_a_folder_that_cannot_be_written_is_said_and_everything_works(tmp_path: Path) -> None:
    """A file is in the way of the folder: the draft is kept as long as the desk, and one line says so."""
    (tmp_path / "file").write_text("")
    d = Desk(tmp_path / "file" / "data", shared=True, session="tests.workbench.test_server:Session")
    seat = d.enter(Tab("a"), "")  # type: ignore[arg-type]
    assert "nothing that is done now is kept after the workbench has ended" in seat.notices[0]
    d.store.edit(seat.draft.id, "title = 'passing'")
    place = d.store.folder
    d.close()
    assert not place.exists()


def test_a_browser_that_comes_back_finds_its_work_before_an_empty_draft(desk: Callable[..., Desk]) -> None:
    """A later tab in which nothing was typed does not hide the model of an earlier one."""
    d = desk(True)
    one, two = Tab("a"), Tab("a")
    work, empty = d.enter(one, ""), d.enter(two, "")  # type: ignore[arg-type]
    d.store.edit(work.draft.id, "title = 'mine'")
    d.store.note(empty.draft.id, looked=True)  # the later of the two
    d.leave(one)  # type: ignore[arg-type]
    d.leave(two)  # type: ignore[arg-type]
    assert d.enter(Tab("a"), "").draft.id == work.draft.id  # type: ignore[arg-type]


def test_drafts_of_others_are_not_opened(desk: Callable[..., Desk]) -> None:
    """On a server for many the id of another's draft leads to a draft of one's own, and says so."""
    d = desk(False)
    mine = d.enter(Tab("a"), "")  # type: ignore[arg-type]
    theirs = d.enter(Tab("b"), mine.draft.id)  # type: ignore[arg-type]
    assert theirs.draft.id != mine.draft.id
    assert theirs.draft.owner == "b"
    line = f"draft {mine.draft.id}: expected one of yours, received an unknown id; here is another"
    assert theirs.notices == (line,)
    assert (d.owner("a"), desk(True).owner("a")) == ("a", "local")


# The command ---------------------------------------------------------------------------------------------------------


def test_without_its_packages_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, and nothing of the workbench has been loaded."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    result = CliRunner().invoke(command.workbench, [])
    assert result.exit_code == 1
    assert result.output.strip().endswith("received none: pip install 'ctlabs[workbench]'")


def test_bad_input_of_the_command_is_one_line() -> None:
    """A port that is taken, and a host that is not ours."""
    with listen("127.0.0.1", 0) as taken:
        port = str(taken.getsockname()[1])
        result = CliRunner().invoke(command.workbench, ["--port", port, "--no-open"])
    assert (result.exit_code, result.output.count("\n")) == (1, 1)
    assert f"received {port}" in result.output
    result = CliRunner().invoke(command.workbench, ["--host", "no.such.host.invalid", "--no-open"])
    assert "host: expected an address of this machine" in result.output


def test_the_command_loads_nothing_before_it_runs() -> None:
    """Neither the web framework nor the database nor the library; the frame needs no numpy."""
    code = "import sys; import ctlabs.workbench.serving.command; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not {"nicegui", "sqlalchemy", "numpy", "fastapi", "uvicorn"} & set(loaded.split())
    code = "import sys; import ctlabs.workbench.serving.server, ctlabs.workbench.pages.shell; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not {"sqlalchemy", "numpy", "scipy", "ctlabs.models", "plotly", "pandas"} & set(loaded.split())


# The real application ------------------------------------------------------------------------------------------------

_SESSION = """
class Session:
    def __init__(self, draft, *, store, runner):
        self.draft, self.store, self.runner = draft, store, runner
        self.text, self.number = draft.text, draft.number

    def edit(self, text):
        self.text, self.number = text, self.store.edit(self.draft.id, text, "typed")

    def undo(self):
        if self.number:
            self.number -= 1
            self.text = self.store.move(self.draft.id, self.number)
"""
_MODEL = """
from nicegui import ui

PAGE = {"place": 0, "title": "Model", "icon": "grid_on"}

def page(session, shell):
    ui.label("This is model")
    field = ui.input("Text", value=session.text).props('aria-label="The text"')

    def typed(event):
        shell.saving()
        session.edit(event.value)
        shell.saved()

    def undo():
        session.undo()
        shell.refresh()

    field.on_value_change(typed)
    shell.shortcut("mod+z", "Undo", undo)
    shell.shortcut("x", "Cross", lambda: shell.tell("crossed"))
    shell.name_draft("Walk <b>")
    shell.on_leave(lambda: session.store.note(session.draft.id, left=True))
    ui.button("Divide", on_click=lambda: 1 / 0)
    ui.upload(label="Data", auto_upload=True, on_upload=lambda event: shell.tell(f"{event.file.size()} bytes"))
"""
_OTHER = """
from nicegui import ui

PAGE = {{"place": {place}, "title": "{title}", "icon": "help"}}

def page(session, shell):
    ui.label("This is {name}")
    ui.plotly({{"data": [{{"y": [1, 2, 0]}}], "layout": {{}}}}).classes("w-full")
    ui.markdown("**bold** $x$")
"""
_SERVE = """
import sys, pathlib
from ctlabs.workbench.serving.server import serve
if __name__ == "__main__":
    serve(sys.argv[1], int(sys.argv[2]), show=False, data=pathlib.Path(sys.argv[3]), pages="trial", session="trial_session:Session")
"""


class Server:
    """A server of its own process, with pages of its own."""

    def __init__(self, folder: Path, host: str = "127.0.0.1") -> None:
        self.folder, self.host, self.port = folder, host, 0
        pages = folder / "trial"
        pages.mkdir()
        (pages / "__init__.py").write_text("def over(session, shell):\n    return None\n")
        for place, name in enumerate(PAGES):
            other = _OTHER.format(name=name, title=name.capitalize(), place=place)
            (pages / f"{name}.py").write_text(_MODEL if name == "model" else other)
        (folder / "trial_session.py").write_text(_SESSION)
        (folder / "serve.py").write_text(textwrap.dedent(_SERVE))

    def start(self) -> str:
        """The line it prints."""
        environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{self.folder}"}
        environment.pop("CTLABS_TOKEN", None)
        arguments = [
            sys.executable,
            str(self.folder / "serve.py"),
            self.host,
            str(self.port),
            str(self.folder / "data"),
        ]
        self.process = subprocess.Popen(
            arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        found = re.search(r":(\d+)/", line)
        assert found, line + self.process.stdout.read()
        self.port = int(found[1])
        token = re.search(r"\?token=([\w-]+)", line)
        assert token
        self.token = token[1]
        return line

    def end(self, how: int = signal.SIGINT) -> str:
        """What it printed after its first line."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        said, _ = self.process.communicate(timeout=60)
        return said

    def ask(self, path: str = "/", method: str = "GET", **headers: str) -> tuple[int, dict[str, str], str]:
        """A request as a program makes it that was shown the token, unless it says itself which cookies it has."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            sent = {"Host": f"127.0.0.1:{self.port}", "Cookie": self._cookie()}
            sent |= {key.replace("_", "-"): value for key, value in headers.items()}
            connection.request(method, path, headers=sent)
            answer = connection.getresponse()
            return answer.status, {key.lower(): value for key, value in answer.getheaders()}, answer.read().decode()
        finally:
            connection.close()

    def _cookie(self) -> str:
        proof = hashlib.sha256(b"ctlabs workbench cookie " + self.token.encode()).hexdigest()
        return f"ctlabs_token_{self.port}={proof}"

    def upgrade(self, **headers: str) -> int:
        """The status of the answer to a socket's handshake."""
        key = base64.b64encode(os.urandom(16)).decode()
        status, _, _ = self.ask(
            "/_nicegui_ws/socket.io/?EIO=4&transport=websocket",
            Upgrade="websocket",
            Connection="Upgrade",
            Sec_WebSocket_Key=key,
            Sec_WebSocket_Version="13",
            **headers,
        )
        return status


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    made = Server(tmp_path)
    made.start()
    yield made
    made.end(signal.SIGKILL)


def test_the_guard_is_around_everything(served: Server) -> None:
    """Pages, files and sockets of the real application; one start for all of these."""
    status, headers, body = served.ask()
    assert status == 200
    assert "Opening the workbench" in body
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "HttpOnly" in headers["set-cookie"]
    assert not re.search(r"""(src|href|url\(|import)\s*[=(]?\s*["']?https?:""", body)
    script = re.search(r'src="(/_nicegui/[^"]+nicegui\.js)"', body)
    assert script
    assert served.ask(script[1])[0] == 200
    for path in ("/", script[1], "/_nicegui_ws/socket.io/?EIO=4&transport=polling"):
        assert served.ask(path, Host="evil.example")[0] == 421
        assert served.ask(path, Origin="http://evil.example")[0] == 403
    own = f"http://127.0.0.1:{served.port}"
    assert served.upgrade(Origin=own) == 101
    for origin in ("http://evil.example", f"http://127.0.0.1:{served.port + 1}", "null"):
        assert served.upgrade(Origin=origin) == 403
    assert served.upgrade() == 403
    assert served.upgrade(Origin="http://evil.example", Host="evil.example") == 403
    assert served.ask("/_nicegui/client/x/upload/1", "POST", Origin=own, Content_Length=str(30 * 2**20))[0] == 413
    assert served.ask("/openapi.json")[0] == served.ask("/docs")[0] == 404
    assert served.end().splitlines()[-1] == "ctlabs workbench: ended; everything is saved"
    assert served.process.returncode == 0
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", served.port), timeout=2)


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_every_address_needs_the_printed_token(tmp_path: Path, host: str) -> None:
    """Nothing without it; with it, once in the address and then in the cookie, pages and sockets."""
    made = Server(tmp_path, host=host)
    line = made.start()
    try:
        token = re.search(r"token=([\w-]{32}) ", line)
        assert token
        assert made.ask(Cookie="")[0] == made.ask("/?token=wrong", Cookie="")[0] == 403
        own = {"Origin": f"http://127.0.0.1:{made.port}"}
        assert made.upgrade(**own, Cookie="") == 403
        status, headers, _ = made.ask(f"/keep?token={token[1]}&draft=7", Cookie="")
        assert (status, headers["location"]) == (303, "/keep?draft=7")
        cookie = headers["set-cookie"].partition(";")[0]
        assert made.ask("/keep", Cookie=cookie)[0] == 200
        assert made.upgrade(Cookie=cookie, **own) == 101
    finally:
        made.end(signal.SIGKILL)


# A real browser ------------------------------------------------------------------------------------------------------


@pytest.fixture
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="no browser tests here: playwright is not installed")
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        pytest.skip("no browser tests here: chromium is not installed")
    arguments = [
        "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
        "--disable-component-update", "--disable-sync",
    ]  # fmt: skip
    with api.sync_playwright() as play:
        opened = play.chromium.launch(executable_path=path, args=arguments)
        yield opened
        opened.close()


class Watched:
    """A tab that notes what it asks for and what it complains of."""

    def __init__(self, browser: Any, server: Server, **options: Any) -> None:
        self.context = browser.new_context(**options)
        self.address = f"http://127.0.0.1:{server.port}"
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.context.request.get(f"{self.address}/?token={server.token}")
        self.tab = self.another()

    def another(self) -> Any:
        tab = self.context.new_page()
        tab.set_default_timeout(60_000)
        tab.on("request", lambda request: self.requests.append(request.url))
        tab.on("console", lambda message: message.type in {"error", "warning"} and self.complaints.append(message.text))
        tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        return tab

    @property
    def elsewhere(self) -> list[str]:
        own = (self.address, self.address.replace("http", "ws"), "data:", "blob:")
        return [url for url in self.requests if not url.startswith(own)]


FIELD = "input[aria-label='The text']"
SAVED = "[role=status][data-state=saved]"


def _shows(tab: Any, name: str) -> None:
    tab.wait_for_selector(f".ctl-main[aria-busy=false] >> text=This is {name}")
    assert tab.get_attribute("nav a[aria-current=page]", "href").startswith(f"/{name}")
    assert tab.locator("nav a[aria-current=page]").count() == 1


@pytest.mark.slow
def test_in_a_browser_every_page_works_and_nothing_leaves_the_machine(served: Server, browser: Any) -> None:
    """Links, history, keys, messages, light and dark, upload; no request to another machine, no word in the console."""
    seen = Watched(browser, served, viewport={"width": 1280, "height": 800})
    tab = seen.tab
    tab.goto(seen.address)
    _shows(tab, "model")
    assert re.search(r"/model\?draft=[0-9a-f]{16}$", tab.url)
    assert tab.title() == "Walk <b> · Model · ctlabs"
    for name in PAGES[1:]:
        tab.click(f"nav a[href^='/{name}']")
        _shows(tab, name)
        assert f"/{name}?draft=" in tab.url
    tab.go_back()
    _shows(tab, "labs")
    tab.keyboard.press("Alt+Shift+M")
    _shows(tab, "model")
    tab.fill(FIELD, "one")
    tab.wait_for_selector(SAVED)
    tab.press(FIELD, "x")  # typed, for a letter alone is no shortcut in a field
    tab.wait_for_function(f"() => document.querySelector(\"{FIELD}\").value === 'onex'")
    tab.keyboard.press("Control+z")
    tab.wait_for_function(f"() => document.querySelector(\"{FIELD}\")?.value === 'one'")
    tab.click("main >> text=This is model")
    tab.keyboard.press("x")
    tab.wait_for_selector("text=crossed")
    tab.keyboard.press("?")
    tab.wait_for_selector(".q-dialog kbd:has-text('Ctrl+Z')")
    tab.keyboard.press("Escape")
    tab.wait_for_selector(".q-dialog", state="detached")
    tab.click("text=Divide")
    tab.wait_for_selector("text=ZeroDivisionError: division by zero")
    tab.click(".q-notification >> text=Close")
    tab.set_input_files("input[type=file]", files=[{"name": "a.csv", "mimeType": "text/csv", "buffer": b"x\n1\n"}])
    tab.wait_for_selector("text=4 bytes")
    for theme, dark in (("light", False), ("dark", True)):
        tab.click("[aria-label^='Theme']")
        tab.wait_for_selector(f"[aria-label='Theme: {theme}']")
        tab.wait_for_function(f"() => document.body.classList.contains('body--dark') === {str(dark).lower()}")
    tab.reload()
    _shows(tab, "model")
    until(lambda: tab.evaluate("document.body.classList.contains('body--dark')"))
    until(lambda: tab.input_value(FIELD) == "one")
    assert seen.elsewhere == []
    assert seen.complaints == []
    assert len(seen.requests) > 20


@pytest.mark.slow
def test_in_a_browser_the_keyboard_alone_and_a_phone(served: Server, browser: Any) -> None:
    """The first key leads to the page past the list, what has the focus is outlined; on a phone the list is behind a button."""
    seen = Watched(browser, served, viewport={"width": 1280, "height": 800})
    tab = seen.tab
    tab.goto(seen.address)
    _shows(tab, "model")
    tab.keyboard.press("Tab")
    until(lambda: tab.evaluate("document.activeElement.textContent") == "Skip to the page")
    tab.keyboard.press("Enter")
    until(lambda: tab.evaluate("document.activeElement.className") == "ctl-main")
    until(lambda: tab.locator("main").count() == tab.locator("nav").count() == tab.locator("header").count() == 1)
    tab.focus("[aria-label^='Theme']")
    tab.keyboard.press("Shift+Tab")
    outline = tab.evaluate(
        "getComputedStyle(document.activeElement).outlineStyle + getComputedStyle(document.activeElement).outlineWidth"
    )
    assert outline == "solid3px"
    tab.focus("nav a[href^='/keep']")
    tab.keyboard.press("Enter")
    _shows(tab, "keep")
    unnamed = "button, a, input:not([type=file])"
    names = tab.eval_on_selector_all(
        unnamed,
        "all => all.filter(e => e.offsetParent && !(e.ariaLabel || e.textContent || e.labels?.length)).map(e => e.outerHTML)",
    )
    assert names == []
    phone = Watched(browser, served, viewport={"width": 375, "height": 700}, has_touch=True)
    tab = phone.tab
    tab.goto(phone.address)
    _shows(tab, "model")
    assert not tab.is_visible("nav a[href^='/keep']")
    tab.click("[aria-label='List of pages']")
    tab.click("nav a[href^='/keep']")
    _shows(tab, "keep")
    tab.wait_for_selector("nav a[href^='/keep']", state="hidden")
    until(lambda: tab.evaluate("document.documentElement.scrollWidth") <= 375)
    assert seen.complaints == phone.complaints == []


@pytest.mark.slow
def test_in_a_browser_tabs_and_browsers_are_apart(served: Server, browser: Any) -> None:
    """A tab with a new draft has its own; the same address is shared, and shows what the other did; another browser sees neither."""
    seen = Watched(browser, served)
    one, two = seen.tab, seen.another()
    one.goto(seen.address)
    _shows(one, "model")
    two.goto(f"{seen.address}/?draft=new")
    _shows(two, "model")
    assert one.url != two.url
    one.fill(FIELD, "mine")
    one.wait_for_selector(SAVED)
    assert two.input_value(FIELD) == ""
    same = seen.another()
    same.goto(one.url)
    _shows(same, "model")
    until(lambda: same.input_value(FIELD) == "mine")
    same.fill(FIELD, "ours")
    same.wait_for_selector(SAVED)
    assert one.evaluate("document.activeElement.value") == "mine"  # nothing is taken from hands that may be typing
    one.evaluate("document.activeElement.blur()")
    one.wait_for_function(f"() => document.querySelector(\"{FIELD}\")?.value === 'ours'")
    other = Watched(browser, served)
    other.tab.goto(other.address)
    _shows(other.tab, "model")
    assert other.tab.url not in {one.url, two.url}
    other.tab.goto(f"{other.address}/model?draft=nonsense")
    other.tab.wait_for_selector("text=draft nonsense: expected one of yours, received an unknown id")
    _shows(other.tab, "model")


@pytest.mark.slow
def test_in_a_browser_a_killed_server_comes_back_with_everything(served: Server, browser: Any) -> None:
    """What was typed is there again, undo too; nothing can be typed into a page without a server."""
    seen = Watched(browser, served)
    tab = seen.tab
    tab.goto(seen.address)
    _shows(tab, "model")
    for text in ("first", "second"):
        tab.fill(FIELD, text)
        tab.wait_for_function(f"() => document.querySelector(\"{FIELD}\").value === '{text}'")
    tab.wait_for_selector(SAVED)
    time.sleep(0.2)
    address = tab.url
    served.end(signal.SIGKILL)
    tab.wait_for_selector(".ctl-main[inert]", state="attached")
    served.start()
    tab.wait_for_selector(".ctl-main:not([inert])[aria-busy=false]")
    _shows(tab, "model")
    assert tab.url == address
    until(lambda: tab.input_value(FIELD) == "second")
    tab.focus(FIELD)
    tab.keyboard.press("Control+z")
    tab.wait_for_function(f"() => document.querySelector(\"{FIELD}\")?.value === 'first'")


@pytest.mark.slow
def test_in_a_browser_a_database_that_cannot_be_read_is_said_so(served: Server, browser: Any) -> None:
    """A file of a newer version: the reason stands in the page, and the file stays as it is."""
    served.end()
    Store(served.folder / "data").close()
    with sqlite3.connect(served.folder / "data" / FILE) as raw:
        raw.execute("PRAGMA user_version = 9")
    raw.close()
    served.start()
    seen = Watched(browser, served)
    seen.tab.goto(seen.address)
    seen.tab.wait_for_selector("[role=alert] >> text=expected tables of version 1, received 9 (a newer ctlabs wrote it")
    for each in (served.folder / "data").glob(f"{FILE}*"):
        each.unlink()
    seen.tab.click("text=Try again")
    _shows(seen.tab, "model")
    seen.tab.goto("about:blank")  # or it would come back by itself, at its own time
    served.end()
    for each in (served.folder / "data").glob(f"{FILE}*"):
        each.unlink()  # SQLite would mend the file from the journal beside it, if the server had left one
    (served.folder / "data" / FILE).write_bytes(b"no database" * 1000)
    served.start()
    seen.tab.goto(f"{seen.address}?draft=0123456789abcdef")  # a tab that was open comes with what it had
    seen.tab.wait_for_selector("text=it was moved to workbench.sqlite3.damaged-")
    seen.tab.wait_for_selector("text=draft 0123456789abcdef: expected one of yours")
