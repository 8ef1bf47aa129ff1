"""Who may speak to the server: a guard around the whole application, requests and sockets alike.

Another page in the same browser must not reach the workbench: the guard refuses a name in ``Host`` that is not this
machine's (a name that an attacker controls can be made to point at 127.0.0.1), an ``Origin`` that is not this server, and
parts of pages (pictures, scripts, frames) that other sites ask for. Other users of the machine reach the port, too, so
there is a token, printed at the start, given once as ``?token=…`` and then kept in a cookie that scripts cannot read.
On a loopback address it stays the same (:func:`kept_token`), so that an open page and a bookmark outlive the server. Bodies
have a size, and every answer forbids the browser to load anything from elsewhere.

NiceGUI compiles its components in the browser, so scripts in the page and ``eval`` stay allowed; nothing that a user types
becomes a script, for it is sent as data.
"""

from __future__ import annotations

import contextlib
import hashlib
import ipaddress
import os
import re
import secrets
import socket
import tempfile
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

#: The largest body of an upload and of any other request, in bytes.
UPLOAD, BODY = 20 * 1024**2, 1024**2
#: How long a browser keeps its session, in seconds.
YEARS = 2 * 365 * 86400
#: The cookie of a browser's session, and the key of the session in a request's scope.
SESSION = "ctlabs_session"
#: The file with the token in the data folder.
TOKEN = "token"

_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; media-src 'self' blob:; worker-src 'self' blob:; "
    "frame-src 'self' blob:; manifest-src 'self'; connect-src 'self' {socket}; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'self'"
)
_HEADERS = {
    b"x-content-type-options": b"nosniff",
    b"x-frame-options": b"SAMEORIGIN",
    b"referrer-policy": b"no-referrer",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"permissions-policy": b"camera=(), microphone=(), geolocation=(), payment=(), usb=()",
    b"x-dns-prefetch-control": b"off",
}
_ID = re.compile(r"[A-Za-z0-9_-]{32}")
_UPLOADS = re.compile(r"/_nicegui/client/[^/]+/upload/\d+")


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server that listens on ``host``.

    >>> [is_loopback(host) for host in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "192.168.1.5", "example.org")]
    [True, True, True, False, False, False]
    """
    address = _address(host)
    return host.lower() == "localhost" if address is None else address.is_loopback


def new_token() -> str:
    """A token that cannot be guessed."""
    return secrets.token_urlsafe(24)


def kept_token(folder: Path) -> str:
    """The token in a folder of the user's own, made if there is none; where it cannot be kept, one for this start only."""
    path = folder / TOKEN
    try:
        found = path.read_text(encoding="ascii").strip()
        if _ID.fullmatch(found) and (os.name == "nt" or not path.stat().st_mode & 0o077):
            return found
    except (OSError, ValueError):
        pass
    made = new_token()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_private(path, made)
    return made


def write_private(path: Path, text: str) -> None:
    """Write a file that only this user reads, whole or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")  # nobody else may read what this makes
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        Path(name).replace(path)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise


class Guard:
    """An ASGI application around another one.

    Parameters
    ----------
    app : what is guarded
    host : the address that the server listens on; what is not loopback needs a token
    token : what a browser must show once; ``None`` where all may in, on a loopback address
    names : further names by which the server may be called

    The session of the browser, a string that is a secret between the two, is put into ``scope["ctlabs.session"]``.

    Raises
    ------
    ValueError
        No token for an address that others reach, or one that is short.
    """

    def __init__(self, app: App, *, host: str, token: str | None = None, names: Iterable[str] = ()) -> None:
        self.app, self.local = app, is_loopback(host)
        if (token is None and not self.local) or (token is not None and len(token) < 16):
            found = "none" if token is None else f"one of {len(token)}"
            msg = f"token: expected at least 16 characters for host {host}, received {found}"
            raise ValueError(msg)
        self.token = None if token is None else token.encode()
        own = {"localhost"} if self.local else {"localhost", *_own_names()}
        address = _address(host)
        self.names = {name.lower().rstrip(".") for name in (*own, *names, *(() if address else (host,)))}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on."""
        if scope["type"] not in {"http", "websocket"}:
            await self.app(scope, receive, send)
            return
        request = _Request(scope)
        refusal = self._refusal(request)
        if refusal is not None:
            await _refuse(scope, receive, send, *refusal)
            return
        if self.token is not None and not self._is_known(request):
            await self._admit(request, receive, send)
            return
        cookies = []
        session = request.cookies.get(SESSION, "")
        if not _ID.fullmatch(session):
            session = secrets.token_urlsafe(24)
            if request.is_page:
                # Lax: a link on another site opens the workbench with its drafts; requests of other sites are refused above.
                cookies = [_cookie(SESSION, session, "Lax", YEARS)]
        scope["ctlabs.session"] = session
        scope["headers"] = [(key, value) for key, value in scope["headers"] if not key.startswith(b"x-forwarded-")]
        await _passed(self.app, scope, receive, send, request, cookies)

    def _refusal(self, request: _Request) -> tuple[int, str] | None:
        """Why a request is not for us: status and line."""
        if not self._is_ours(request.name):
            names = ", ".join(
                sorted({*self.names, "127.0.0.1"} if self.local else {*self.names, "this machine's addresses"})
            )
            return 421, f"Host: expected one of {names}, received {request.host!r}"
        if request.origin is not None and request.origin != request.host:
            return 403, f"Origin: expected this server, received {request.origin!r}"
        if request.origin is None and (request.is_socket or request.method not in {"GET", "HEAD", "OPTIONS"}):
            return 403, "Origin: expected this server, received none"
        if request.site in {"cross-site", "same-site"} and not request.is_page:
            return 403, f"Sec-Fetch-Site: expected a request of this server's pages, received {request.site}"
        if request.length > request.most:
            return 413, f"body: expected at most {request.most} bytes, received {request.length}"
        return None

    def _is_ours(self, name: str) -> bool:
        address = _address(name)
        if address is None:
            return name.lower().rstrip(".") in self.names
        # An address is not looked up, so it cannot be pointed elsewhere.
        return address.is_loopback or not self.local

    def _is_known(self, request: _Request) -> bool:
        shown = request.cookies.get(self._cookie_name(request), "")
        return self.token is not None and secrets.compare_digest(shown.encode(), _proof(self.token))

    def _cookie_name(self, request: _Request) -> str:
        """One per port: browsers keep cookies per machine, and there may be several servers on it."""
        return f"ctlabs_token_{request.port}"

    async def _admit(self, request: _Request, receive: Receive, send: Send) -> None:
        """Take the token from the address, and lead on to the same address without it."""
        given = [value for key, value in request.query if key == "token"]
        right = self.token is not None and given and secrets.compare_digest(given[-1].encode(), self.token)
        if not right or not request.is_page or self.token is None:
            line = "token: expected the address that the server printed when it started (…?token=…), received "
            await _refuse(request.scope, receive, send, 403, line + ("a wrong one" if given else "none"))
            return
        rest = urlencode([(key, value) for key, value in request.query if key != "token"])
        # A path that begins with two slashes would be another machine's address.
        path = "/" + str(request.scope["path"]).lstrip("/\\")
        target = quote(path) + (f"?{rest}" if rest else "")
        # Lax, as of the session: the address may be opened from a file, which browsers take for another site. On a loopback
        # address the token stays, and so does the cookie.
        cookie = _cookie(self._cookie_name(request), _proof(self.token).decode(), "Lax", YEARS if self.local else None)
        await _answer(send, 303, b"", [(b"location", target.encode("ascii")), (b"set-cookie", cookie)])


class _Request:
    """What the guard reads of a request."""

    def __init__(self, scope: Scope) -> None:
        self.scope = scope
        self.is_socket = scope["type"] == "websocket"
        self.method = str(scope.get("method", "GET"))
        self.host = self._one(b"host") or ""
        self.name, self.port = _split(f"//{self.host}")
        origin = self._one(b"origin")
        self.origin = None if origin is None else _netloc(origin)
        self.site = self._one(b"sec-fetch-site") or ""
        # Absent in old browsers and in programs that are none.
        self.is_page = (
            not self.is_socket
            and self.method == "GET"
            and (self._one(b"sec-fetch-mode") or "navigate") == "navigate"
            and (self._one(b"sec-fetch-dest") or "document") == "document"
        )
        self.query = parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True)
        length = self._one(b"content-length") or "0"
        self.most = UPLOAD if _UPLOADS.fullmatch(str(scope["path"])) else BODY
        self.length = int(length) if length.isascii() and length.isdigit() else self.most + 1

    @property
    def cookies(self) -> dict[str, str]:
        """The cookies, by name."""
        found: dict[str, str] = {}
        for key, value in self.scope["headers"]:
            if key == b"cookie":
                try:
                    found |= {name: morsel.value for name, morsel in SimpleCookie(value.decode("latin-1")).items()}
                except CookieError:  # another program's, on another port
                    continue
        return found

    def _one(self, name: bytes) -> str | None:
        """A header that may be there once; twice is as good as wrong."""
        values = [value.decode("latin-1") for key, value in self.scope["headers"] if key == name]
        return None if not values else values[0] if len(values) == 1 else "\0"


async def _passed(
    app: App, scope: Scope, receive: Receive, send: Send, request: _Request, cookies: list[bytes]
) -> None:
    """Call the application with a body of limited size, and add our headers to its answer."""
    taken, begun, ended = 0, False, False

    async def limited() -> Message:
        nonlocal taken, ended
        message = await receive()
        if message["type"] == "http.request" and not ended:
            taken += len(message.get("body", b""))
            if taken > request.most:  # no length was given, or a wrong one
                ended = True
                if not begun:
                    line = f"ctlabs workbench: body: expected at most {request.most} bytes, received more\n"
                    await _answer(send, 413, line.encode(), [])
        return {"type": "http.disconnect"} if ended else message

    async def secured(message: Message) -> None:
        nonlocal begun
        if ended:
            return
        if message["type"] == "http.response.start":
            begun = True
            given = [(key, value) for key, value in message.get("headers", []) if key.lower() not in _HEADERS]
            message["headers"] = [*given, *_secure(request.host), *((b"set-cookie", cookie) for cookie in cookies)]
        await send(message)

    try:
        await app(scope, limited, secured)
    except Exception:
        if not ended:  # what an application says of a request that broke off is no news
            raise


def _secure(host: str) -> list[tuple[bytes, bytes]]:
    # Browsers that do not count sockets as 'self' need their address; the host has been checked.
    policy = _POLICY.format(socket=f"ws://{host} wss://{host}" if re.fullmatch(r"[\w.:\[\]-]+", host) else "")
    return [(b"content-security-policy", policy.encode("ascii", "ignore")), *_HEADERS.items()]


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, line: str) -> None:
    if scope["type"] == "websocket":
        await receive()  # websocket.connect
        await send({"type": "websocket.close", "code": 1008, "reason": line[:100]})
        return
    await _answer(send, status, f"ctlabs workbench: {line}\n".encode(), [])


async def _answer(send: Send, status: int, body: bytes, headers: list[tuple[bytes, bytes]]) -> None:
    fixed = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        (b"cache-control", b"no-store"),
        (b"connection", b"close"),  # what is left of a body is not read
    ]
    await send({"type": "http.response.start", "status": status, "headers": [*fixed, *headers, *_secure("")]})
    await send({"type": "http.response.body", "body": body})


def _cookie(name: str, value: str, same_site: str, age: int | None) -> bytes:
    kept = "" if age is None else f"; Max-Age={age}"
    return f"{name}={value}; Path=/; HttpOnly; SameSite={same_site}{kept}".encode()


def _proof(token: bytes) -> bytes:
    """What the cookie holds: other servers of this machine see cookies, and the token itself is not for them."""
    return hashlib.sha256(b"ctlabs workbench cookie " + token).hexdigest().encode()


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return None


def _split(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        name, port = parts.hostname or "", parts.port or 80
    except ValueError:
        return "", 80
    return ("" if "@" in url else name), port


def _netloc(origin: str) -> str:
    """The machine and port of an origin, as a browser writes it in ``Host``; "null" of what is none."""
    try:
        parts = urlsplit(origin)
    except ValueError:
        return "null"
    return parts.netloc if parts.scheme in {"http", "https"} and not (parts.path or parts.query) else "null"


def _own_names() -> set[str]:
    """The name of this machine, with and without its domain."""
    name = socket.gethostname()
    return {name, name.partition(".")[0], f"{name.partition('.')[0]}.local"}
