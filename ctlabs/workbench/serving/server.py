"""The server: one process, one event loop, many browsers; what is heavy is loaded after the first page is seen.

:func:`serve` listens first and loads afterwards: a browser that is opened at once waits at the open port. The first
page is the empty frame (:mod:`ctlabs.workbench.pages.shell`); the database, the session and with it the library come when the
browser has connected.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ctlabs.workbench.desk.desk import Desk, Seat
from ctlabs.workbench.serving import safety
from ctlabs.workbench.serving.squeezed import Squeezed

if TYPE_CHECKING:
    from nicegui import Client
    from starlette.requests import Request


log = logging.getLogger("ctlabs.workbench")

#: The first port that is tried, and how many after it.
PORT, PORTS = 8080, 100
#: How long a tab that lost its connection is waited for, in seconds; a laptop's sleep is longer, and loads the page again.
RECONNECT = 20.0


def build(
    desk: Desk,
    *,
    host: str,
    token: str | None = None,
    names: Iterable[str] = (),
    pages: str = "ctlabs.workbench.pages",
) -> safety.Guard:
    """The application: NiceGUI with a route for every page, inside the guard."""
    from fastapi import FastAPI
    from nicegui import app, ui

    from ctlabs.workbench.pages import listed, shell

    # GZip of every answer costs the server's time, and this machine's own browser gains little by it: large scripts are packed once.
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
    for page in listed(pages):
        ui.page(f"/{page.name}")(_route(desk, pages, page.name))
    ui.page("/")(_route(desk, pages, listed(pages)[0].name))
    app.on_shutdown(lambda: asyncio.to_thread(desk.close))
    return safety.Guard(Squeezed(frame), host=host, token=token, names=names)


def _route(desk: Desk, pages: str, name: str) -> Callable[..., Any]:
    from nicegui import Client
    from starlette.requests import Request

    from ctlabs.workbench.pages.shell import Shell

    async def front(request: Request, client: Client, draft: str = "", model: str = "") -> None:
        shell = Shell(desk, client, request, pages)
        shell.draw(name)
        # While the browser reads the frame and its scripts, the server has nothing else to do.
        loading = asyncio.get_running_loop().run_in_executor(None, desk.load)
        await client.connected()
        await loading
        if client.is_deleted:
            return
        client.on_delete(shell.left)
        await shell.enter(name, draft[:64], model)

    # FastAPI looks the annotations up among this module's names, where the types are not at run time.
    front.__annotations__ = {"request": Request, "client": Client, "draft": str, "model": str, "return": None}
    return front


def serve(
    host: str = "127.0.0.1",
    port: int | None = None,
    *,
    show: bool = True,
    data: Path | None = None,
    names: Iterable[str] = (),
    pages: str = "ctlabs.workbench.pages",
    session: str = "ctlabs.workbench.desk.session:Session",
    open_to_all: bool = False,
) -> None:
    """Listen and serve until Ctrl-C; everything is saved at any time, so the process may as well be killed.

    Parameters
    ----------
    host : the address to listen on
    port : the port; without one, the first free one from 8080 on
    show : open the page in the browser
    data : folder of the database; :func:`ctlabs.workbench.desk.store.data_folder` if not given
    names : further names by which this machine is called
    pages, session : the package of the pages, the class of a session ("module:class")

    open_to_all : no token, so that every user of this machine gets in; on a loopback address only

    The token is in the address that is printed and opened. ``CTLABS_TOKEN`` may hold one; otherwise that of a loopback address
    is kept in the data folder, and any other is made anew at each start.

    Raises
    ------
    ValueError
        An address that is not this machine's, a port that is taken, a token that is too short.
    """
    from ctlabs.workbench.desk.folder import Unwritable, data_folder, writable

    local, folder = safety.is_loopback(host), data_folder() if data is None else data.expanduser().resolve()
    if open_to_all and not local:
        msg = f"host: expected a loopback address without a token, received {host}"
        raise ValueError(msg)
    own = os.environ.get("CTLABS_TOKEN")
    token = None if open_to_all else own or (safety.kept_token(folder) if local else safety.new_token())
    listening = listen(host, port)
    address = _address(host, listening.getsockname()[1], token)
    print(f"ctlabs workbench: {address} (Ctrl-C ends it; nothing has to be saved)", flush=True)  # noqa: T201
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        writable(folder)
    except (Unwritable, OSError) as why:
        print(f"ctlabs workbench: nothing is kept after the end: {why}", flush=True)  # noqa: T201
    if show:
        threading.Thread(target=_browse, args=(address, folder), daemon=True).start()
    desk = Desk(data, shared=local, session=session, private=local and not open_to_all)
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


def _browse(address: str, folder: Path) -> None:
    """Open the address in the browser: by way of a file that only this user reads, for all see the arguments of a program."""
    import webbrowser

    try:
        webbrowser.open(door(address, folder))
    except (webbrowser.Error, OSError) as why:
        log.warning("no browser could be opened (%s): open %s yourself", why, address)


def door(address: str, folder: Path) -> str:
    """The address of a file that leads to an address with a token; the address itself where there is none, or no place for it."""
    if "token=" not in address:
        return address
    path = folder / "open.html"
    page = f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={address}">'
    try:
        safety.write_private(path, page)
    except OSError:
        return address
    return path.as_uri()


__all__: Sequence[str] = ("Desk", "Seat", "build", "listen", "serve")
