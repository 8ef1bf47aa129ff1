"""The server: one process, one event loop, many browsers; what is heavy is loaded after the first page is seen.

:func:`serve` listens first and loads afterwards: a browser that is opened at once waits at the open port. The first
page is the empty frame (:mod:`ctlabs.workbench.pages.shell`); the database, the session and with it the library come when the
browser has connected.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import importlib
import importlib.util
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ctlabs.workbench import safety

if TYPE_CHECKING:
    from nicegui import Client
    from starlette.requests import Request

    from ctlabs.workbench.pages.shell import Shell
    from ctlabs.workbench.store import Draft, Store
    from ctlabs.workbench.worker import Runner

log = logging.getLogger("ctlabs.workbench")

#: The first port that is tried, and how many after it.
PORT, PORTS = 8080, 100
#: How long a tab that lost its connection is waited for, in seconds; a laptop's sleep is longer, and loads the page again.
RECONNECT = 20.0
#: Who owns the drafts and experiments of a server that only this machine reaches.
LOCAL = "local"


class Place(NamedTuple):
    """What a tab works at: its draft, and the session that is the same in all tabs with this draft."""

    draft: Draft
    session: Any
    notices: tuple[str, ...]


class Desk:
    """The sessions that are open, by draft: tabs with the same draft share one, other tabs share nothing.

    Parameters
    ----------
    folder : where the data are
    shared : whether the drafts and experiments of all browsers are one person's (a server that only this machine reaches)
    session : "module:class" of a session, made as ``Session(draft, store=store, runner=runner)``

    :attr:`store` and :attr:`runner` are made when they are first needed.
    """

    def __init__(self, folder: Path | None, *, shared: bool, session: str) -> None:
        self.folder, self.shared, self._path = folder, shared, session
        self._loading = threading.RLock()  # while something is loaded or a session is made
        self._lock = threading.Lock()  # for the tables below: never held for long, the event loop waits for it
        self._store: Store | None = None
        self._runner: Runner | None = None
        self._open: dict[str, Any] = {}
        self._tabs: dict[str, list[Shell]] = {}

    @property
    def store(self) -> Store:
        """The database, opened at first use."""
        with self._loading:
            if self._store is None:
                from ctlabs.workbench.store import Store

                self._store = Store(self.folder)
                if self._store.notice:
                    log.warning(self._store.notice)
            return self._store

    @property
    def runner(self) -> Runner:
        """The processes for long runs; none is started yet."""
        with self._loading:
            if self._runner is None:
                from ctlabs.workbench.worker import Runner

                self._runner = Runner()
            return self._runner

    def load(self) -> None:
        """Open the database and load the library, so that :meth:`enter` is quick; what fails here fails there again."""
        with contextlib.suppress(Exception):
            _named(self._path)
            _ = self.store, self.runner

    def owner(self, browser: str) -> str:
        """Whose drafts and experiments a browser sees."""
        return LOCAL if self.shared else browser

    def enter(self, shell: Shell, wanted: str) -> Place:
        """Open the draft that a tab asks for; without one the browser's latest that is in no other tab, or a new one.

        Blocks (the library is loaded here), so it is called in a thread.
        """
        with self._loading:
            store, owner = self.store, self.owner(shell.browser)
            notices = [store.notice] if store.notice else []
            draft = store.draft(wanted, owner) if wanted else None
            if draft is None:
                if wanted:
                    notices.append(f"draft {wanted}: expected one of yours, received an unknown id; here is another")
                free = [each for each in store.drafts(owner, shell.browser) if each.id not in self._tabs]
                free.sort(key=lambda each: not each.text)  # an empty one must not hide the work behind it
                draft = free[0] if free else store.new_draft(owner, shell.browser)
            session = self._open.get(draft.id) or _named(self._path)(draft, store=store, runner=self.runner)
            with self._lock:
                self._open[draft.id] = session
                self._tabs.setdefault(draft.id, []).append(shell)
            return Place(draft, session, tuple(notices))

    def leave(self, shell: Shell) -> None:
        """A tab is gone; with the last one its session is closed. All it has is in the database."""
        with self._lock:
            mine = [draft for draft, tabs in self._tabs.items() if shell in tabs]
            for draft in mine:
                self._tabs[draft].remove(shell)
            done = [self._open.pop(draft) for draft in mine if not self._tabs[draft]]
            self._tabs = {draft: tabs for draft, tabs in self._tabs.items() if tabs}
        for session in done:
            _close(session)

    def others(self, shell: Shell) -> list[Shell]:
        """The other tabs with the same draft."""
        with self._lock:
            return [other for tabs in self._tabs.values() if shell in tabs for other in tabs if other is not shell]

    def close(self) -> None:
        """End the processes, close the database."""
        with self._loading:
            with self._lock:
                sessions = list(self._open.values())
                self._open.clear()
                self._tabs.clear()
            for session in sessions:
                _close(session)
            if self._runner is not None:
                self._runner.close()
            if self._store is not None:
                self._store.close()


def build(
    desk: Desk,
    *,
    host: str,
    token: str | None = None,
    names: Iterable[str] = (),
    pages: str = "ctlabs.workbench.pages",
) -> safety.Guard:
    """The application: NiceGUI with a route for every page, inside the guard.

    Raises
    ------
    ImportError
        A page's module is missing.
    """
    from ctlabs.workbench.pages import shell

    missing = [page.name for page in shell.PAGES if importlib.util.find_spec(f"{pages}.{page.name}") is None]
    if missing:
        msg = f"{pages}: expected a module for every page, received none for {', '.join(missing)}"
        raise ImportError(msg)

    from fastapi import FastAPI
    from nicegui import app, ui

    # GZip costs the server's time, and this machine's own browser gains nothing by it.
    squeezed: dict[str, Any] = {"gzip_middleware_factory": None} if safety.is_loopback(host) else {}
    frame = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.run_with(
        frame,
        title="ctlabs workbench",
        language="en-US",
        dark=None,
        reconnect_timeout=RECONNECT,
        show_welcome_message=False,
        favicon=shell.FAVICON,
        **squeezed,
    )
    shell.prepare()
    for page in shell.PAGES:
        ui.page(f"/{page.name}")(_route(desk, pages, page.name))
    ui.page("/")(_route(desk, pages, shell.PAGES[0].name))
    app.on_shutdown(lambda: asyncio.to_thread(desk.close))
    return safety.Guard(frame, host=host, token=token, names=names)


def _route(desk: Desk, pages: str, name: str) -> Callable[..., Any]:
    from nicegui import Client
    from starlette.requests import Request

    from ctlabs.workbench.pages.shell import Shell

    async def front(request: Request, client: Client, draft: str = "") -> None:
        shell = Shell(desk, client, request, pages)
        shell.draw(name)
        # While the browser reads the frame and its scripts, the server has nothing else to do.
        loading = asyncio.get_running_loop().run_in_executor(None, desk.load)
        await client.connected()
        await loading
        if client.is_deleted:
            return
        client.on_delete(shell.left)
        await shell.enter(name, draft[:64])

    # FastAPI looks the annotations up among this module's names, where the types are not at run time.
    front.__annotations__ = {"request": Request, "client": Client, "draft": str, "return": None}
    return front


def serve(
    host: str = "127.0.0.1",
    port: int | None = None,
    *,
    show: bool = True,
    data: Path | None = None,
    names: Iterable[str] = (),
    pages: str = "ctlabs.workbench.pages",
    session: str = "ctlabs.workbench.session:Session",
) -> None:
    """Listen and serve until Ctrl-C; everything is saved at any time, so the process may as well be killed.

    Parameters
    ----------
    host : the address to listen on; all but loopback addresses need a token, which is printed
    port : the port; without one, the first free one from 8080 on
    show : open the page in the browser
    data : folder of the database; :func:`ctlabs.workbench.store.data_folder` if not given
    names : further names by which this machine is called
    pages, session : the package of the pages, the class of a session ("module:class")

    The token is made anew at each start, unless ``CTLABS_TOKEN`` holds one.

    Raises
    ------
    ValueError
        An address that is not this machine's, a port that is taken, a token that is too short.
    """
    token = None if safety.is_loopback(host) else os.environ.get("CTLABS_TOKEN") or safety.new_token()
    listening = listen(host, port)
    address = _address(host, listening.getsockname()[1], token)
    print(f"ctlabs workbench: {address} (Ctrl-C ends it; nothing has to be saved)", flush=True)  # noqa: T201
    if show:
        threading.Thread(target=_browse, args=(address,), daemon=True).start()
    desk = Desk(data, shared=safety.is_loopback(host), session=session)
    try:
        _run(desk, listening, host, token, names, pages)
    except KeyboardInterrupt:  # while it is loaded; later uvicorn repeats the signal when it has ended in order
        pass
    finally:
        desk.close()
        listening.close()
    print("ctlabs workbench: ended; everything is saved", flush=True)  # noqa: T201


def _run(desk: Desk, listening: socket.socket, host: str, token: str | None, names: Iterable[str], pages: str) -> None:
    """Load the framework and serve."""
    sys.setswitchinterval(0.0005)  # a thread that loads or computes gives way sooner: pages are answered meanwhile
    # NiceGUI reads this when it is imported, and would otherwise look into the present folder; nothing is written there.
    os.environ["NICEGUI_STORAGE_PATH"] = str((desk.folder or Path.home()) / ".nicegui")
    import uvicorn

    config = uvicorn.Config(
        build(desk, host=host, token=token, names=names, pages=pages),
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws="wsproto",
        ws_max_size=safety.BODY,
        timeout_graceful_shutdown=2,
    )
    uvicorn.Server(config).run(sockets=[listening])


def listen(host: str, port: int | None = None) -> socket.socket:
    """A socket that listens; without a port, on the first free one from 8080 on.

    Raises
    ------
    ValueError
        One line: an address that is not this machine's, a port that is taken.
    """
    for each in range(PORT, PORT + PORTS) if port is None else (port,):
        made, address = _socket(host, each)
        try:
            made.bind(address)
            made.listen(128)
        except OSError as why:
            made.close()
            if why.errno == errno.EADDRINUSE and port is None:
                continue
            msg = f"port: expected a free port of {host}, received {each}: {(why.strerror or str(why)).lower()}"
            raise ValueError(msg) from None
        return made
    msg = f"port: expected a free port from {PORT} to {PORT + PORTS - 1}, received none"
    raise ValueError(msg)


def _socket(host: str, port: int) -> tuple[socket.socket, Any]:
    """A socket for an address, and the address as the socket wants it."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (socket.gaierror, UnicodeError, OverflowError):
        found = []
    if not found or not 0 <= port < 65536:  # some systems reduce a larger number to another port
        msg = f"host: expected an address of this machine and a port up to 65535, received {host} and {port}"
        raise ValueError(msg)
    family, kind, protocol, _, address = found[0]
    made = socket.socket(family, kind, protocol)
    # On Windows this option would let two programs have the same port; elsewhere it frees the port of a killed server.
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, int(sys.platform != "win32"))
    return made, address


def _address(host: str, port: int, token: str | None) -> str:
    """What to type into a browser."""
    name = socket.gethostname() if host in {"0.0.0.0", "::", ""} else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")


def _browse(address: str) -> None:
    import webbrowser

    try:
        webbrowser.open(address)
    except (webbrowser.Error, OSError) as why:
        log.warning("no browser could be opened (%s): open %s yourself", why, address)


def _named(path: str) -> Callable[..., Any]:
    module, _, name = path.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def _close(session: Any) -> None:
    """Tell a session that nobody looks at it any more, if it wants to know."""
    close = getattr(session, "close", None)
    if callable(close):
        try:
            close()
        except Exception:
            log.exception("closing a session")


__all__: Sequence[str] = ("Desk", "Place", "build", "listen", "serve")
