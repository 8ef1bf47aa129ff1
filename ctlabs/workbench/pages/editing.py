"""Commands as a page gives them: carried out, saved and shown, or said why not; undo and redo.

A large model is edited in a thread, so that the server answers others meanwhile; then the answer comes later.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from ctlabs.workbench.pages.model_edits import Typing
from ctlabs.workbench.runs.inside import line

if TYPE_CHECKING:
    from ctlabs.workbench.desk.commands import Command
    from ctlabs.workbench.desk.session import Session
    from ctlabs.workbench.pages.shell import Shell


class Editor:
    """What edits the model in one tab; ``changed`` is called after every edit with the key of the cell (empty: no cell)."""

    def __init__(self, session: Session, shell: Shell, changed: Callable[[str], object]) -> None:
        self.session, self.shell, self._changed = session, shell, changed
        self._typing = Typing(session)
        self._turn = asyncio.Lock()  # what is typed in a row is done in this order

    def do(self, command: Command) -> bool:
        """Carry out a command that a button stands for; whether it was possible."""
        why = self._answer("", self._done("", command))
        if why:
            self.shell.complain(why)
        return not why

    async def do_later(self, command: Command) -> bool:
        """The same in a thread."""
        why = await self._later("", command)
        if why:
            self.shell.complain(why)
        return not why

    def type(self, key: str, command: Command) -> str | Awaitable[str]:
        """Carry out what was typed into a cell (an empty key: an edit of its own); why not, or empty."""
        if self.session.large:
            self.shell.saving()
            return self._later(key, command)
        return self._answer(key, self._done(key, command))

    async def _later(self, key: str, command: Command) -> str:
        async with self._turn:
            found = await asyncio.to_thread(self._done, key, command)
            return self._answer(key, found)

    def _done(self, key: str, command: Command) -> tuple[str, bool]:
        """Carry a command out and make ready what is shown of it; why not, and whether the store is the reason."""
        try:
            with self.session.turn:
                self._typing.do(key, command)
                self.session.prepare()
        except ValueError as why:
            return line(why), False
        except (RuntimeError, LookupError) as why:  # the store says why it cannot write
            return line(why), True
        return "", False

    def _answer(self, key: str, found: tuple[str, bool]) -> str:
        why, stored = found
        if stored:
            self.shell.not_saved(why)
        if not why:
            self.shell.saved()
            self._changed(key)
        return why

    def done(self) -> None:
        """A cell is left: what is typed there later is another edit."""
        self._typing.stop()

    async def undo(self) -> None:
        """Take the last edit back."""
        await self._move(self.session.undo)

    async def redo(self) -> None:
        """Do again what was taken back."""
        await self._move(self.session.redo)

    async def _move(self, move: Callable[[], str]) -> None:
        self.done()

        def moved() -> str:
            with self.session.turn:
                label = move()
                self.session.prepare()
            return label

        try:
            async with self._turn:
                label = await asyncio.to_thread(moved) if self.session.large else moved()
            self.shell.tell(f"{move.__name__.capitalize()}: {label}")
        except ValueError as why:
            self.shell.tell(line(why))
            self._changed("")  # it may have been read again
            return
        except (RuntimeError, LookupError) as why:
            self.shell.not_saved(line(why))
            return
        self.shell.saved()
        self._changed("")
