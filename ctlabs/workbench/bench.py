"""The run of a lab for one draft: it goes on while other pages are shown, and every tab of the draft sees the same."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ctlabs.workbench import catalogue
from ctlabs.workbench.worker import RunFailed

if TYPE_CHECKING:
    from ctlabs.workbench.worker import Progress, Runner

#: What a lab may take, in seconds: longer than an experiment, a million runs are not unusual.
SECONDS = 3600.0


class Bench:
    """At most one lab at a time, for one draft.

    ``lab``, the one that runs or ran last · ``progress`` · ``problem``, why the last run has no report ·
    ``finished``, a number that grows with every report
    """

    def __init__(self, runner: Runner, data: Path, draft: str) -> None:
        self.runner, self.data, self.draft = runner, data, draft
        self.lab = ""
        self.progress: Progress | None = None
        self.problem = ""
        self.finished = 0
        self._cancel = threading.Event()
        self._task: asyncio.Task[None] | None = None

    @property
    def running(self) -> bool:
        """Whether a lab runs."""
        return self._task is not None and not self._task.done()

    def outcome(self, lab: str) -> catalogue.Outcome | None:
        """What came of the last run of a lab."""
        return catalogue.outcome(catalogue.place(self.data, self.draft, lab))

    def start(self, lab: str, values: Mapping[str, Any], runs: int, seed: int) -> None:
        """Begin a run; it is over when :attr:`running` is false.

        Raises
        ------
        ValueError
            Another lab of this draft is running.
        """
        if self.running:
            msg = f"run: expected no lab that runs, received {self.lab}; cancel it, or wait"
            raise ValueError(msg)
        before = self.outcome(lab)
        arguments = {
            "name": lab,
            "values": dict(values),
            "runs": runs,
            "seed": seed,
            "folder": str(catalogue.place(self.data, self.draft, lab)),
            # Another number of computational experiments is possible with other parameters: then the rest is not known.
            "expected": before.ensembles if before is not None else 0,
        }
        self.lab, self.progress, self.problem, self._cancel = lab, None, "", threading.Event()
        self._task = asyncio.get_running_loop().create_task(self._run(arguments))

    def cancel(self) -> None:
        """End the run; the report before it stays."""
        self._cancel.set()

    async def wait(self) -> None:
        """Wait for the end of the run."""
        if self._task is not None:
            await asyncio.wait({self._task})

    async def _run(self, arguments: dict[str, Any]) -> None:
        try:
            await self.runner.run(
                "lab", arguments, session=self.draft, progress=self._told, cancel=self._cancel, seconds=SECONDS
            )
            self.finished += 1
        except RunFailed as why:
            self.problem = "" if why.kind == "cancelled" else str(why).removeprefix("lab: ")
        except Exception as why:
            self.problem = f"{type(why).__name__}: {' '.join(str(why).split())}"
            raise
        finally:
            self.progress = None

    def _told(self, progress: Progress) -> None:
        self.progress = progress


def said(progress: Progress | None) -> str:
    """How far a run is, in words.

    >>> from ctlabs.workbench.worker import Progress
    >>> said(Progress(0.25, 500.0, 2000, 8000)), said(Progress(0.0, 500.0, 2000, 0)), said(Progress(0.0, 0.0, 0, 0, 2))
    ('2 000 of 8 000 runs, 500 per second, 12 s left', '2 000 runs, 500 per second', '2 runs before this one')
    """
    if progress is None:
        return "Starting…"
    if progress.ahead:
        return f"{progress.ahead} {'run' if progress.ahead == 1 else 'runs'} before this one"
    if not progress.done:
        return "Computing what can be computed without an experiment…"
    rate = f", {_spaced(progress.rate)} per second" if progress.rate >= 1 else ""
    if not progress.total:
        return f"{_spaced(progress.done)} runs{rate}"
    left = "" if progress.left is None else f", {_spaced(progress.left)} s left"
    return f"{_spaced(progress.done)} of {_spaced(progress.total)} runs{rate}{left}"


def _spaced(number: float) -> str:
    """A whole number with thin groups: 12 000."""
    return f"{number:,.0f}".replace(",", " ")
