"""Large scripts travel compressed, and arrive as they were."""

import asyncio
import zlib
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from ctlabs.workbench.serving.squeezed import LEAST, Squeezed

SCRIPT = b"draw(" + b"0123456789" * (LEAST // 10) + b")"


@pytest.fixture
def made() -> Squeezed:
    """A site with a large script, in one piece and in many, a small one, and a large picture."""

    async def pieces(_request: Any) -> StreamingResponse:
        return StreamingResponse((SCRIPT[i : i + 5000] for i in range(0, len(SCRIPT), 5000)), headers={"content-length": str(len(SCRIPT))})

    def whole(body: bytes) -> Any:
        return lambda _request: Response(body, headers={"etag": f'"{len(body)}"'})

    routes = {"/large.js": whole(SCRIPT), "/pieces.js": pieces, "/small.js": whole(b"draw()"), "/large.png": whole(SCRIPT)}
    return Squeezed(Starlette(routes=[Route(path, route, methods=["GET", "POST"]) for path, route in routes.items()]))


async def fetched(app: Any, path: str, method: str = "GET", **headers: str) -> httpx.Response:
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://bench") as client:
        return await client.request(method, path, headers={"accept-encoding": "identity", **headers})


@pytest.mark.parametrize("path", ["/large.js", "/pieces.js"])
def test_a_large_script_is_compressed_once(made: Squeezed, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a browser takes it the script is a tenth as long, and the same; the second time nothing is compressed."""
    calls, compressor = [], zlib.compressobj
    monkeypatch.setattr(zlib, "compressobj", lambda *options: calls.append(options) or compressor(*options))
    for _ in range(2):
        answer = asyncio.run(fetched(made, path, **{"accept-encoding": "gzip"}))
        assert answer.headers["content-encoding"] == "gzip"
        assert answer.headers["vary"] == "accept-encoding"
        assert int(answer.headers["content-length"]) < len(SCRIPT) / 10
        assert answer.content == SCRIPT
    assert len(calls) == 1


@pytest.mark.parametrize(
    ("path", "method", "headers"),
    [
        ("/large.js", "GET", {}),
        ("/large.js", "GET", {"accept-encoding": "gzip", "range": "bytes=0-9"}),
        ("/large.js", "POST", {"accept-encoding": "gzip"}),
        ("/small.js", "GET", {"accept-encoding": "gzip"}),
        ("/large.png", "GET", {"accept-encoding": "gzip"}),
    ],
)
def test_all_else_is_passed_on_as_it_is(made: Squeezed, path: str, method: str, headers: dict[str, str]) -> None:
    """A browser that does not ask for it, a part of a file, another request, a small file, and what is compressed already."""
    answer = asyncio.run(fetched(made, path, method, **headers))
    assert "content-encoding" not in answer.headers
    assert answer.content == (b"draw()" if path == "/small.js" else SCRIPT)


def test_what_else_the_application_has_is_reached(made: Squeezed) -> None:
    assert made.routes[0].path == "/large.js"
