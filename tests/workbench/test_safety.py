"""Who may speak to the workbench: names, origins, tokens, sizes, and what a browser is told to load from where."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import pytest

from ctlabs.workbench.serving.safety import BODY, UPLOAD, Guard, is_loopback, new_token

TOKEN = "a-token-of-some-length"
HERE = "127.0.0.1:8080"
PAGE = {"sec-fetch-mode": "navigate", "sec-fetch-dest": "document", "sec-fetch-site": "none"}


class Answer(NamedTuple):
    """What came back; ``scope`` is what the application saw, None if it was not called."""

    status: int
    headers: list[tuple[str, str]]
    body: str
    scope: dict[str, Any] | None

    def header(self, name: str) -> str:
        return "; ".join(value for key, value in self.headers if key == name)


def ask(
    guard_of: dict[str, Any] | None = None,
    path: str = "/",
    *,
    method: str = "GET",
    host: str | None = HERE,
    query: str = "",
    chunks: Iterable[bytes] = (b"",),
    kind: str = "http",
    **headers: str,
) -> Answer:
    """One request through a guard; headers are written with underscores."""
    seen: list[dict[str, Any]] = []
    sent: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        seen.append(scope)
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.accept"})
            return
        body = b""
        while True:
            message = await receive()
            if message["type"] == "http.disconnect":
                raise ConnectionError("the client has gone")
            body += message["body"]
            if not message.get("more_body"):
                break
        await send({"type": "http.response.start", "status": 200, "headers": [(b"x-frame-options", b"ALLOWALL")]})
        await send({"type": "http.response.body", "body": str(len(body)).encode()})

    waiting = [{"type": "http.request", "body": chunk, "more_body": True} for chunk in chunks]
    waiting[-1]["more_body"] = False
    if kind == "websocket":
        waiting = [{"type": "websocket.connect"}]

    async def receive() -> Any:
        return waiting.pop(0)

    async def send(message: Any) -> None:
        sent.append(message)

    pairs = [("host", host)] if host is not None else []
    pairs += [(key.replace("_", "-"), value) for key, value in headers.items()]
    scope = {
        "type": kind,
        "path": path,
        "query_string": query.encode(),
        "headers": [(key.encode(), value.encode("latin-1")) for key, value in pairs],
    }
    if kind == "http":
        scope["method"] = method
    guard = Guard(app, **(guard_of or {"host": "127.0.0.1"}))
    asyncio.run(guard(scope, receive, send))
    if kind == "websocket":
        (message,) = sent
        code = 101 if message["type"] == "websocket.accept" else message["code"]
        return Answer(code, [], message.get("reason", ""), seen[0] if seen else None)
    start, *rest = sent
    names = [(key.decode(), value.decode()) for key, value in start["headers"]]
    body = b"".join(part.get("body", b"") for part in rest).decode()
    return Answer(start["status"], names, body, seen[0] if seen else None)


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST", "[::1]:8080", "127.0.0.2:1", "localhost."]
)
def test_a_browser_on_this_machine_is_served(host: str) -> None:
    """Every way to write this machine's own address, on any port (a tunnel may lead to ours)."""
    assert ask(host=host).status == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", "127.0.0.1.evil.example:8080", "localhost.evil.example", "0.0.0.0:8080", "192.168.1.5:8080",
        "127.0.0.1@evil.example", "user:x@127.0.0.1", "", "[::1", "2130706433.evil", "localhost:port", None,
    ],
)  # fmt: skip
def test_a_name_that_can_be_pointed_here_is_refused(host: str | None) -> None:
    """DNS rebinding: the request reaches 127.0.0.1, but its Host is the attacker's; sockets likewise."""
    answer = ask(host=host)
    assert (answer.status, answer.scope) == (421, None)
    assert answer.body.startswith("ctlabs workbench: Host: expected one of 127.0.0.1, localhost, received")
    socket = ask(host=host, kind="websocket", origin=f"http://{host}")
    assert (socket.status, socket.scope) == (1008, None)


def test_two_hosts_are_refused() -> None:
    """A request with two Host headers is read differently by different programs."""
    guard = Guard(_never, host="127.0.0.1")
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": "http", "method": "GET", "path": "/", "query_string": b"",
        "headers": [(b"host", HERE.encode()), (b"host", b"evil.example")],
    }  # fmt: skip
    asyncio.run(guard(scope, _never, send))  # type: ignore[arg-type]  # is not called
    assert sent[0]["status"] == 421


async def _never(*_: Any) -> None:
    raise AssertionError("the application was called")


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    ("origin", "good"),
    [
        (f"http://{HERE}", True),
        (f"https://{HERE}", True),
        ("http://127.0.0.1:9999", False),
        ("http://localhost:8080", False),
        ("http://evil.example", False),
        ("http://127.0.0.1:8080.evil.example", False),
        (f"http://{HERE}/path", False),
        (f"file://{HERE}", False),
        ("http://[", False),
        ("null", False),
        ("", False),
    ],
)
def test_other_origins_are_refused(kind: str, origin: str, good: bool) -> None:
    """Requests that change something and sockets come from our own pages, not from another port or a file."""
    answer = ask(kind=kind, method="POST", origin=origin)
    assert (answer.scope is not None) == good
    assert answer.status == ((101 if kind == "websocket" else 200) if good else (1008 if kind == "websocket" else 403))
    assert good or "Origin: expected this server, received" in answer.body


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_what_changes_something_names_its_origin(method: str) -> None:
    """Browsers always do; a socket without one is refused too, a plain page needs none."""
    assert ask(method=method).status == 403
    assert ask(kind="websocket").status == 1008
    assert ask().status == 200


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_parts_of_other_sites_pages_are_refused(site: str) -> None:
    """A picture, a script, a frame or a fetch of another site (or port); following a link to us is allowed."""
    for mode, dest in [("no-cors", "image"), ("no-cors", "script"), ("cors", "empty"), ("navigate", "iframe")]:
        answer = ask(sec_fetch_site=site, sec_fetch_mode=mode, sec_fetch_dest=dest)
        assert (answer.status, answer.scope) == (403, None)
    assert ask(sec_fetch_site=site, sec_fetch_mode="navigate", sec_fetch_dest="document").status == 200
    assert ask(sec_fetch_site="same-origin", sec_fetch_mode="cors", sec_fetch_dest="empty").status == 200
    assert ask(sec_fetch_site="same-origin", sec_fetch_mode="navigate", sec_fetch_dest="iframe").status == 200


def test_bodies_have_a_size() -> None:
    """By their length if it is given, by counting if not; an upload may be larger."""
    upload = "/_nicegui/client/5a/upload/7"
    own = {"method": "POST", "origin": f"http://{HERE}"}
    assert ask(content_length=str(BODY), **own).status == 200  # type: ignore[arg-type]
    for length in (str(BODY + 1), "1e9", "-1", "x"):
        answer = ask(content_length=length, **own)  # type: ignore[arg-type]
        assert (answer.status, answer.scope) == (413, None)
    half = b"x" * (BODY // 2)
    assert ask(chunks=[half, half], **own).body == str(2 * len(half))  # type: ignore[arg-type]
    answer = ask(chunks=[half, half, b"x"], **own)  # type: ignore[arg-type]
    assert answer.status == 413
    assert answer.body == f"ctlabs workbench: body: expected at most {BODY} bytes, received more\n"
    assert ask(path=upload, content_length=str(UPLOAD), **own).status == 200  # type: ignore[arg-type]
    assert ask(path=upload, content_length=str(UPLOAD + 1), **own).status == 413  # type: ignore[arg-type]
    assert ask(path=upload, chunks=[half, half, half], **own).status == 200  # type: ignore[arg-type]
    assert ask(path=f"/x{upload}", content_length=str(UPLOAD), **own).status == 413  # type: ignore[arg-type]


def test_every_answer_forbids_what_is_elsewhere() -> None:
    """Refusals too: nothing is loaded from other machines, no other site may frame the pages or read them."""
    for answer in (ask(), ask(host="evil.example"), ask(origin="null")):
        policy = answer.header("content-security-policy")
        assert "default-src 'none'" in policy
        assert "http:" not in policy
        assert "https:" not in policy
        assert "*" not in policy
        assert "frame-ancestors 'self'" in policy
        assert answer.header("x-content-type-options") == "nosniff"
        assert answer.header("referrer-policy") == "no-referrer"
        assert answer.header("cross-origin-resource-policy") == "same-origin"
        assert answer.header("x-frame-options") == "SAMEORIGIN"  # the application's own was other
    assert f"connect-src 'self' ws://{HERE} wss://{HERE};" in ask().header("content-security-policy")


def test_headers_of_proxies_are_not_believed() -> None:
    """X-Forwarded-… would change addresses in the page."""
    scope = ask(x_forwarded_prefix="//evil.example", x_forwarded_host="evil.example").scope
    assert scope is not None
    assert [key for key, _ in scope["headers"]] == [b"host"]


def test_each_browser_has_a_session() -> None:
    """The first page gives it, a cookie keeps it, a made-up one is replaced, and no two are equal."""
    first = ask(**_fetch(PAGE))
    assert first.scope is not None
    session = first.scope["ctlabs.session"]
    cookie = first.header("set-cookie")
    assert re.fullmatch(r"ctlabs_session=[\w-]{32}; Path=/; HttpOnly; SameSite=Lax; Max-Age=63072000", cookie)
    assert session in cookie
    again = ask(cookie=f"other=1; ctlabs_session={session}", **_fetch(PAGE))
    assert again.scope is not None
    assert again.scope["ctlabs.session"] == session
    assert again.header("set-cookie") == ""
    for false in ("", "admin", "../../etc", session + "x", "é" * 32):
        other = ask(cookie=f"ctlabs_session={false}", **_fetch(PAGE))
        assert other.scope is not None
        assert other.scope["ctlabs.session"] not in {false, session}
        assert "ctlabs_session=" in other.header("set-cookie")
    assert ask(path="/static/x.js", sec_fetch_mode="no-cors", sec_fetch_dest="script").header("set-cookie") == ""


def _fetch(headers: dict[str, str]) -> dict[str, Any]:
    return {key.replace("-", "_"): value for key, value in headers.items()}


OPEN = {"host": "0.0.0.0", "token": TOKEN, "names": ("lab.example",)}
THERE = "192.168.1.5:8080"


def test_other_addresses_need_a_token() -> None:
    """Without one the guard is not even made."""
    assert is_loopback("127.1.2.3")
    for host in ("0.0.0.0", "192.168.1.5", "::", "myhost"):
        with pytest.raises(ValueError, match=f"token: expected at least 16 characters for host {host}, received none"):
            Guard(_never, host=host)
    with pytest.raises(ValueError, match="received one of 5"):
        Guard(_never, host="0.0.0.0", token="short")
    assert len({new_token() for _ in range(100)}) == 100
    assert len(new_token()) == 32


def test_the_token_is_given_once_and_then_kept() -> None:
    """?token= leads to the same address without it and a cookie; the cookie opens pages and sockets."""
    answer = ask(OPEN, "/understand", query=f"draft=5&token={TOKEN}", host=THERE, **_fetch(PAGE))
    assert (answer.status, answer.scope) == (303, None)
    assert answer.header("location") == "/understand?draft=5"
    cookie = answer.header("set-cookie")
    assert re.fullmatch(r"ctlabs_token_8080=[0-9a-f]{64}; Path=/; HttpOnly; SameSite=Lax", cookie)
    assert TOKEN not in cookie
    shown = cookie.partition(";")[0]
    assert ask(OPEN, host=THERE, cookie=shown).status == 200
    assert ask(OPEN, host=THERE, kind="websocket", cookie=shown, origin=f"http://{THERE}").status == 101
    assert ask({**OPEN, "token": TOKEN + "2"}, host=THERE, cookie=shown).status == 403


@pytest.mark.parametrize(
    "query", ["", "token=", "token=wrong", f"token={TOKEN[:-1]}", f"token={TOKEN}x", "token=%C3%A9", f"Token={TOKEN}"]
)
def test_without_the_token_nothing_is_reached(query: str) -> None:
    """Neither pages, nor the files of the application, nor sockets; nor is a cookie set."""
    for path in ("/", "/_nicegui/static/x.js", "/_nicegui_ws/socket.io"):
        answer = ask(OPEN, path, query=query, host=THERE)
        assert (answer.status, answer.scope) == (403, None)
        assert answer.header("set-cookie") == ""
        assert TOKEN not in answer.body
    for cookie in ("ctlabs_token_8080=", f"ctlabs_token_8080={TOKEN}", "ctlabs_token_8080=x", "ctlabs_session=x"):
        assert ask(OPEN, query=query, host=THERE, cookie=cookie).status == 403
        assert (
            ask(OPEN, query=query, host=THERE, kind="websocket", origin=f"http://{THERE}", cookie=cookie).status == 1008
        )


def test_the_token_does_not_lead_elsewhere() -> None:
    """A path that looks like another machine's address stays a path of ours."""
    for path in ("//evil.example/x", "/\\evil.example", "/\r\nset-cookie: a=b", "/ä"):
        location = ask(OPEN, path, query=f"token={TOKEN}", host=THERE).header("location")
        assert re.fullmatch(r"/[\w%.:-]+(/x)?", location), location


def test_the_token_is_only_taken_from_a_page() -> None:
    """A request of a script with the token in its address is refused: it is for the address bar."""
    assert ask(OPEN, method="POST", origin=f"http://{THERE}", query=f"token={TOKEN}", host=THERE).status == 403
    assert ask(OPEN, sec_fetch_mode="cors", sec_fetch_dest="empty", query=f"token={TOKEN}", host=THERE).status == 403


def test_names_of_an_open_server() -> None:
    """Addresses cannot be pointed elsewhere and are served; names must be known, token or not."""
    shown = ask(OPEN, query=f"token={TOKEN}", host=THERE).header("set-cookie").partition(";")[0]
    for host in (
        "192.168.1.5:8080",
        "10.0.0.1:8080",
        "[fe80::1]:8080",
        "lab.example:8080",
        "LAB.example:8080",
        "localhost:8080",
    ):
        assert ask(OPEN, host=host, cookie=shown).status == 200, host
    for host in ("evil.example:8080", "lab.example.evil:8080"):
        assert ask(OPEN, host=host, cookie=shown).status == 421
    assert ask({"host": "lab.example", "token": TOKEN}, host="lab.example:8080", cookie=shown).status == 200


def test_other_messages_pass() -> None:
    """The application's start and end are not requests."""
    seen = []

    async def app(scope: Any, _receive: Any, _send: Any) -> None:
        seen.append(scope["type"])

    asyncio.run(Guard(app, host="127.0.0.1")({"type": "lifespan"}, _never, _never))  # type: ignore[arg-type]
    assert seen == ["lifespan"]


def test_errors_of_the_application_are_not_hidden() -> None:
    """Only what follows a refused body is swallowed."""

    async def broken(_scope: Any, _receive: Any, _send: Any) -> None:
        raise ZeroDivisionError

    scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": [(b"host", HERE.encode())]}
    with pytest.raises(ZeroDivisionError):
        asyncio.run(Guard(broken, host="127.0.0.1")(scope, _never, _never))  # type: ignore[arg-type]
