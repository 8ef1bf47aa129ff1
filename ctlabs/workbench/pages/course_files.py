"""The files of an open course for a frame in the page or for the browser's downloads: hand-outs, grades, feedback.

Names and texts in them are other people's. A frame has no scripts, no forms, and nothing from elsewhere; the pages of the grades may lead
to each other, and for that alone are of this origin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import quote

from nicegui import app
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from ctlabs.workbench.runs.catalogue import themed

if TYPE_CHECKING:
    from ctlabs.workbench.desk.desk import Desk

#: Where the files are, by draft.
FILES = "/course-files/{draft}/{path:path}"
#: What a frame may do, as its attribute and as the header of what is in it say.
HANDOUT, GRADES = "", "allow-same-origin"
_POLICY = "sandbox {sandbox}; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:"
_KINDS = {".html": "text/html", ".pdf": "application/pdf", ".csv": "text/csv"}


def serve_files(desk: Desk) -> None:
    """Answer for the files, once for a server."""
    app.state.ctlabs_desk = desk
    if not any(getattr(route, "path", "") == FILES for route in app.routes):
        app.get(FILES, include_in_schema=False)(_file)


def address(draft: str, path: str, **query: object) -> str:
    """Where a file is; ``query`` : a theme, and what tells one version from another."""
    told = "&".join(f"{key}={quote(str(value))}" for key, value in query.items())
    return f"/course-files/{draft}/{quote(path)}" + (f"?{told}" if told else "")


def _file(request: Request, draft: str, path: str) -> Response:
    """A file of the course that is open in a draft, for whom the draft is."""
    desk: Desk = app.state.ctlabs_desk
    missing = PlainTextResponse("ctlabs workbench: no such file of the course\n", 404)
    session = desk.session(draft)
    if not desk.private or session is None or desk.store.draft(draft, desk.owner(request.scope["ctlabs.session"])) is None:
        return missing
    try:
        place = session.courses.file(path)
        content = place.read_bytes()
    except (ValueError, OSError):
        return missing
    if place.suffix == ".html":
        content = themed(content.decode("utf-8", "replace"), request.query_params.get("theme", "auto")).encode()
    policy = _POLICY.format(sandbox=GRADES if path.startswith("grades/") else HANDOUT)
    headers = {"content-security-policy": policy, "cache-control": "private, no-store"}
    if place.suffix != ".html":
        headers["content-disposition"] = f'attachment; filename="{place.name}"'
    return Response(content, media_type=_KINDS.get(place.suffix, "text/plain; charset=utf-8"), headers=headers)
