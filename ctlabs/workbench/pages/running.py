"""The run of an experiment for one session: it goes on while other pages are shown, and every tab of the draft sees the same."""

from __future__ import annotations

import asyncio
import threading
import weakref
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from ctlabs.workbench.outcomes import REGISTERED
from ctlabs.workbench.worker import RunFailed

if TYPE_CHECKING:
    from ctlabs.workbench.session import Session
    from ctlabs.workbench.worker import Cancel, Progress

#: What is run: a function of where to tell its progress, and of what cancels it.
Work = Callable[[Callable[["Progress"], object], "Cancel"], Awaitable[object]]


class Running:
    """At most one run at a time, for one session.

    ``progress`` of the one that runs · ``problem``, why the last one has no result (empty: it has, or was cancelled) ·
    ``cancelled``, whether the last one was · ``finished``, a number that grows with every result
    """

    def __init__(self) -> None:
        self.progress: Progress | None = None
        self.problem, self.cancelled, self.finished = "", False, 0
        #: Where the person looks at results: the same part is shown again after the next run.
        self.part = ""
        self._cancel = threading.Event()
        self._task: asyncio.Task[None] | None = None
        self._watching: list[Callable[[], object]] = []

    @property
    def running(self) -> bool:
        """Whether something runs."""
        return self._task is not None

    def start(self, work: Work) -> None:
        """Begin a run; one that goes on already is left alone."""
        if self.running:
            return
        self.progress, self.problem, self.cancelled, self._cancel = None, "", False, threading.Event()
        self._task = asyncio.get_running_loop().create_task(self._run(work))
        self._tell()

    def cancel(self) -> None:
        """End the run."""
        self._cancel.set()

    def watch(self, action: Callable[[], object]) -> Callable[[], None]:
        """Call this whenever anything changes; what is returned ends it."""
        self._watching.append(action)
        return lambda: self._watching.remove(action) if action in self._watching else None

    async def _run(self, work: Work) -> None:
        try:
            await work(self._told, self._cancel)
            self.finished += 1
        except RunFailed as why:
            self.cancelled = why.kind == "cancelled"
            self.problem = "" if self.cancelled else str(why).removeprefix(f"{REGISTERED}: ")
        except (ValueError, ArithmeticError, LookupError) as why:
            self.problem = " ".join(str(why).split())
        except Exception as why:
            self.problem = f"{type(why).__name__}: {' '.join(str(why).split())}"
            raise
        finally:
            self.progress = self._task = None
            self._tell()

    def _told(self, progress: Progress) -> None:
        self.progress = progress
        self._tell()

    def _tell(self) -> None:
        for action in list(self._watching):
            action()


_runs: weakref.WeakKeyDictionary[Any, Running] = weakref.WeakKeyDictionary()


def running(session: Session) -> Running:
    """The run of a session."""
    return _runs.setdefault(session, Running())
