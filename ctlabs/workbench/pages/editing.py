"""Commands as a page gives them: carried out, saved and shown, or said why not; undo and redo."""

from __future__ import annotations

from collections.abc import Callable
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

    def do(self, command: Command) -> bool:
        """Carry out a command that a button stands for; whether it was possible."""
        line = self.type("", command)
        if line:
            self.shell.complain(line)
        return not line

    def type(self, key: str, command: Command) -> str:
        """Carry out what was typed into a cell (an empty key: an edit of its own); why not, or empty."""
        try:
            self._typing.do(key, command)
        except ValueError as why:
            return line(why)
        except (RuntimeError, LookupError) as why:  # the store says why it cannot write
            self.shell.not_saved(line(why))
            return line(why)
        self.shell.saved()
        self._changed(key)
        return ""

    def done(self) -> None:
        """A cell is left: what is typed there later is another edit."""
        self._typing.stop()

    def undo(self) -> None:
        """Take the last edit back."""
        self._move(self.session.undo)

    def redo(self) -> None:
        """Do again what was taken back."""
        self._move(self.session.redo)

    def _move(self, move: Callable[[], str]) -> None:
        self.done()
        try:
            self.shell.tell(f"{move.__name__.capitalize()}: {move()}")
        except ValueError as why:
            self.shell.tell(line(why))
            return
        self.shell.saved()
        self._changed("")
