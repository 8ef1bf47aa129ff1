"""Tables that are dropped on any page."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

from nicegui import ui

from ctlabs.workbench.runs.outcomes import LARGEST

if TYPE_CHECKING:
    from nicegui import Client
    from nicegui.events import UploadEventArguments

    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell

#: Where files that are dropped on a page go, in each tab.
_drops: weakref.WeakKeyDictionary[Client, ui.upload] = weakref.WeakKeyDictionary()


def accept_anywhere(session: Session, shell: Shell) -> None:
    """A table that is dropped on any page becomes the draft's data, and is shown on the page Data."""

    async def uploaded(event: UploadEventArguments) -> None:
        upload.reset()
        await session.records.drop(await event.file.read(), event.file.name)
        shell.saved()
        shell.go("data")

    if shell.client not in _drops:
        upload = ui.upload(auto_upload=True, max_file_size=LARGEST, on_upload=uploaded, on_rejected=lambda: shell.complain(too_large()))
        upload.props("data-test=drop-anywhere").classes("hidden ctl-anydrop")
        upload.props(f"data-uploader={upload.id}")
        _drops[shell.client] = upload


def too_large() -> str:
    """What is said of a file that is too large."""
    return f"file: expected a table of at most {LARGEST // 10**6} MB, received a larger one"
