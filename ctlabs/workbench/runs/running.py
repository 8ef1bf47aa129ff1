"""A run of one session: it goes on while other pages are shown, and every tab of the draft sees the same."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from ctlabs.workbench.runs.worker import RunFailed

if TYPE_CHECKING:
    from ctlabs.workbench.runs.worker import Cancel, RunProgress

#: What is run: a function of where to tell its progress, and of what cancels it.
Work = Callable[[Callable[["RunProgress"], object], "Cancel"], Awaitable[object]]


class Running:
    """At most one run at a time.

    ``name`` of the one that runs or ran last · ``progress`` of the one that runs · ``problem``, why the last one has no result
    (empty: it has, or was cancelled) · ``cancelled``, whether the last one was · ``finished``, a number that grows with every result ·
    ``runs`` that were asked for, where that is told
    """

    def __init__(self) -> None:
        self.progress: RunProgress | None = None
        self.name, self.problem, self.cancelled, self.finished, self.runs = "", "", False, 0, 0
        self._cancel = threading.Event()
        self._task: asyncio.Task[None] | None = None
        self._watching: list[Callable[[], object]] = []

    @property
    def running(self) -> bool:
        """Whether something runs."""
        return self._task is not None

    def start(self, work: Work, name: str = "", runs: int = 0) -> None:
        """Begin a run; one that goes on already is left alone."""
        if self.running:
            return
        self.runs = runs
        self.name, self.progress, self.problem, self.cancelled, self._cancel = name, None, "", False, threading.Event()
        self._task = asyncio.get_running_loop().create_task(self._run(work))
        self._tell()

    def cancel(self) -> None:
        """End the run."""
        self._cancel.set()

    async def wait(self) -> None:
        """Wait for the end of the run."""
        if self._task is not None:
            await asyncio.wait({self._task})

    def watch(self, action: Callable[[], object]) -> Callable[[], None]:
        """Call this whenever anything changes; what is returned ends it."""
        self._watching.append(action)
        return lambda: self._watching.remove(action) if action in self._watching else None

    async def _run(self, work: Work) -> None:
        try:
            await work(self._show, self._cancel)
            self.finished += 1
        except RunFailed as why:
            self.cancelled = why.kind == "cancelled"
            self.problem = "" if self.cancelled else why.line
        except (ValueError, ArithmeticError, LookupError) as why:
            self.problem = " ".join(str(why).split())
        except Exception as why:
            self.problem = f"{type(why).__name__}: {' '.join(str(why).split())}"
            raise
        finally:
            self.progress = self._task = None
            self._tell()

    def _show(self, progress: RunProgress) -> None:
        self.progress = progress
        self._tell()

    def _tell(self) -> None:
        for action in list(self._watching):
            action()


def said(progress: RunProgress | None) -> str:
    """How far a run is, in words.

    >>> from ctlabs.workbench.runs.worker import RunProgress
    >>> said(RunProgress(0.25, 500.0, 2000, 8000)), said(RunProgress(0.0, 500.0, 2000, 0)), said(RunProgress(0.0, 0.0, 0, 0, 2))
    ('2 000 of 8 000 runs, 500 per second, 12 s left', '2 000 runs, 500 per second', '2 runs before this one')
    """
    if progress is None:
        return "Starting…"
    if progress.ahead:
        return f"{progress.ahead} {'run' if progress.ahead == 1 else 'runs'} before this one"
    if not progress.done:
        return "Computing what can be computed without an experiment…"
    rate = f", {spaced(progress.rate)} per second" if progress.rate >= 1 else ""
    if not progress.total:
        return f"{spaced(progress.done)} runs{rate}"
    left = "" if progress.left is None else f", {spaced(progress.left)} s left"
    return f"{spaced(progress.done)} of {spaced(progress.total)} runs{rate}{left}"


def spaced(number: float) -> str:
    """A whole number with thin groups: 12 000."""
    return f"{number:,.0f}".replace(",", " ")
