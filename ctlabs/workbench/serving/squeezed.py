"""Large scripts and fonts go to the browser compressed, each once: the library that draws figures is most of what a page moves."""

from __future__ import annotations

import asyncio
import zlib
from typing import Any

#: Bytes from which a file is compressed, and how much trouble is taken: a tenth of a second for the largest, once.
LEAST, LEVEL = 100_000, 4
#: What is compressed.
ENDINGS = (".js", ".mjs", ".css", ".ttf")


class Squeezed:
    """An application whose large scripts are compressed for browsers that say they take it."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner
        self._made: dict[tuple[str, bytes], bytes] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer a request."""
        if scope["type"] == "http" and scope["method"] == "GET" and scope["path"].endswith(ENDINGS) and _takes(scope["headers"]):
            await self._inner(scope, receive, _Answer(self._made, scope["path"], send))
        else:
            await self._inner(scope, receive, send)


class _Answer:
    """One answer: it is passed on as it comes, unless it is a large file as a whole."""

    def __init__(self, made: dict[tuple[str, bytes], bytes], path: str, send: Any) -> None:
        self._made, self._path, self._send = made, path, send
        self._start: Any = None
        self._body: list[bytes] = []

    async def __call__(self, message: Any) -> None:
        if message["type"] == "http.response.start" and _large(message):
            self._start = message
        elif message["type"] == "http.response.body" and self._start is not None:
            self._body.append(message.get("body", b""))
            if not message.get("more_body"):
                await self._whole()
        else:
            await self._send(message)

    async def _whole(self) -> None:
        headers = dict(self._start["headers"])
        key = self._path, headers.get(b"etag", b"") + headers[b"content-length"]
        if key not in self._made:
            self._made[key] = await asyncio.to_thread(_compressed, b"".join(self._body))
        body = self._made[key]
        headers |= {b"content-length": str(len(body)).encode(), b"content-encoding": b"gzip", b"vary": b"accept-encoding"}
        await self._send({**self._start, "headers": list(headers.items())})
        await self._send({"type": "http.response.body", "body": body})


def _takes(headers: Any) -> bool:
    """Whether the browser takes it, and asks for the whole file."""
    found = dict(headers)
    return b"gzip" in found.get(b"accept-encoding", b"") and b"range" not in found


def _large(start: Any) -> bool:
    headers = dict(start["headers"])
    return start["status"] == 200 and b"content-encoding" not in headers and int(headers.get(b"content-length", 0)) >= LEAST


def _compressed(body: bytes) -> bytes:
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, 16 + zlib.MAX_WBITS)  # with the head and foot of gzip
    return packer.compress(body) + packer.flush()
