"""The links inside the site: each leads to a page, a file, a place that there is; another one is a warning."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.util import logging

LOG = logging.getLogger(__name__)


class Page(HTMLParser):
    """The places of a page, and where its links and pictures lead."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.targets: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what an element is called, and what it points to."""
        given = {name: value or "" for name, value in attrs}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        self.targets |= {given[name] for name in ("href", "src") if given.get(name)}


def broken(folder: Path) -> list[str]:
    """The links that lead nowhere, as ``page: target``."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in folder.rglob("*.html")}
    found = []
    for path, page in pages.items():
        for target in sorted(page.targets):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            other = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not other.exists() or (place and other in pages and place not in pages[other].places):
                found.append(f"{path.relative_to(folder)}: {target}")
    return found


def check(app: Sphinx, failed: Exception | None) -> None:
    """Warn of each broken link once all is written."""
    if not failed and app.builder.format == "html":
        for line in broken(Path(app.outdir).resolve()):
            LOG.warning("link leads nowhere: %s", line, type="links")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect it, after everything else that writes at the end."""
    app.connect("build-finished", check, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
