"""The sessions that are open, by draft, and the tabs that look at them."""

from __future__ import annotations

import contextlib
import importlib
import logging
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from ctlabs.workbench.desk.links import unpacked

if TYPE_CHECKING:
    from ctlabs.workbench.desk.store import Draft, Store
    from ctlabs.workbench.runs.worker import Runner

log = logging.getLogger("ctlabs.workbench")

#: Who owns the drafts and experiments of a server that only this machine reaches.
LOCAL = "local"
#: What a tab asks for that wants an empty draft.
NEW = "new"


class Tab(Protocol):
    """What is known of a tab: whose browser it is in, and how it shows what another tab has changed."""

    browser: str

    def refresh_soon(self) -> None:
        """Show what another tab has changed, when there is time."""
        ...


class Seat(NamedTuple):
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
    private : whether nobody but the person whose machine this is gets in, so that pages may open folders of it

    :attr:`store` and :attr:`runner` are made when they are first needed.
    """

    def __init__(self, folder: Path | None, *, shared: bool, session: str, private: bool = False) -> None:
        self.folder, self.shared, self._path, self.private = folder, shared, session, private
        self._loading = threading.RLock()  # while something is loaded or a session is made
        self._lock = threading.Lock()  # for the tables below: never held for long, the event loop waits for it
        self._store: Store | None = None
        self._passing: tempfile.TemporaryDirectory[str] | None = None  # where a folder that cannot be written is replaced
        self._runner: Runner | None = None
        self._open: dict[str, Any] = {}
        self._tabs: dict[str, list[Tab]] = {}

    @property
    def store(self) -> Store:
        """The database, opened at first use."""
        with self._loading:
            if self._store is None:
                from ctlabs.workbench.desk.folder import Unwritable
                from ctlabs.workbench.desk.store import Store

                try:
                    self._store = Store(self.folder)
                except Unwritable as why:  # all pages work; only what is done there is not kept
                    self._passing = tempfile.TemporaryDirectory(prefix="ctlabs-", ignore_cleanup_errors=True)
                    self._store = Store(self._passing.name)
                    self._store.notice = f"{why}: nothing that is done now is kept after the workbench has ended"
                if self._store.notice:
                    log.warning(self._store.notice)
            return self._store

    @property
    def runner(self) -> Runner:
        """The processes for long runs; none is started yet."""
        with self._loading:
            if self._runner is None:
                from ctlabs.workbench.runs.worker import Runner

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

    def enter(self, shell: Tab, wanted: str, model: str = "") -> Seat:
        """Open the draft that a tab asks for, or one with the ``model`` of a link; without either that which the browser worked on last,
        or its first.

        ``wanted`` : an id, empty, or :data:`NEW` for a draft in which nothing has been done. Of these a browser has one that is
        free at most, so that no empty ones pile up.

        Blocks (the library is loaded here), so it is called in a thread.
        """
        with self._loading:
            store, owner = self.store, self.owner(shell.browser)
            notices = [store.notice] if store.notice else []
            draft = store.draft(wanted, owner) if wanted not in {"", NEW} else None
            if draft is None and model:
                draft = self._linked(model, owner, shell.browser, notices)
            if draft is None:
                if wanted not in {"", NEW}:
                    notices.append(f"draft {wanted}: expected one of yours, received an unknown id; here is another")
                mine = store.drafts(owner, shell.browser)
                if wanted == NEW:
                    mine = [each for each in mine if not each.text and each.id not in self._tabs]
                mine.sort(key=lambda each: not each.text)  # an empty one must not hide the work behind it
                draft = mine[0] if mine else store.new_draft(owner, shell.browser)
            session = self._open.get(draft.id)
            if session is None:
                session = _named(self._path)(draft, store=store, runner=self.runner)
            elif (again := getattr(session, "again", None)) is not None:
                again()  # another server on the same folder may have edited it
            if (told := getattr(session, "take_notices", None)) is not None:
                notices += told()
            with self._lock:
                self._open[draft.id] = session
                self._tabs.setdefault(draft.id, []).append(shell)
            return Seat(draft, session, tuple(notices))

    def _linked(self, link: str, owner: str, browser: str, notices: list[str]) -> Draft | None:
        """The draft with the model of a link: the one that there is already, or a new one."""
        from ctlabs.files.modelfile import loads

        try:
            text = unpacked(link)
            loads(text, "link", check=False)
        except ValueError as why:
            notices.append(str(why))
            return None
        found = next((each for each in self.store.drafts(owner, browser) if each.text == text), None)
        return found or self.store.new_draft(owner, browser, text)

    def leave(self, shell: Tab) -> None:
        """A tab is gone; with the last one its session is closed. All it has is in the database."""
        with self._lock:
            mine = [draft for draft, tabs in self._tabs.items() if shell in tabs]
            for draft in mine:
                self._tabs[draft].remove(shell)
            done = [self._open.pop(draft) for draft in mine if not self._tabs[draft]]
            self._tabs = {draft: tabs for draft, tabs in self._tabs.items() if tabs}
        for session in done:
            _close(session)

    def session(self, draft: str) -> Any:
        """The session of a draft that is open; None where it is not."""
        with self._lock:
            return self._open.get(draft)

    def others(self, shell: Tab) -> list[Tab]:
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
            if self._passing is not None:
                self._passing.cleanup()


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
