"""The blocks of an experiment: handed out, retried, merged in order, saved as they come.

The sums are added in the order of the blocks, whatever the order in which they finish: the bytes of the result are the
same for any number of workers, any executor, interrupted or not.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait

import numpy as np

from ctlabs.montecarlo.checkpoint import Checkpoint
from ctlabs.montecarlo.executors import Task, Team
from ctlabs.montecarlo.plan import check_finite
from ctlabs.montecarlo.sums import Sums

#: How often a block whose worker failed or was lost is tried again.
RETRIES = 3


class Interrupted(KeyboardInterrupt):
    """The experiment was stopped by the user; the message says what is kept and how to go on."""


class BlockFailed(RuntimeError):
    """A block failed again and again; the message says which, why, and what is kept."""


class Merger:
    """Blocks of one experiment on their way to one table of sums."""

    def __init__(self, task: Task, runs: int, team: Team, store: Checkpoint | None, show: Callable[[int], None]) -> None:
        self.task, self.runs, self.team, self.store, self.show = task, runs, team, store, show
        self.size = task.experiment.layout.runs
        self.count = task.experiment.layout.count(runs)
        self.total = Sums(np.zeros(()), np.zeros((), dtype=np.int64))
        self.merged = 0
        self.finished: dict[int, Sums] = {}
        self.attempts: dict[int, int] = {}
        self.flying: dict[Future[Sums | None], int] = {}
        self.done = 0

    def runs_of(self, block: int) -> int:
        """Runs in a block: all of them, but for the last."""
        return min(self.size, self.runs - block * self.size)

    def result(self) -> Sums:
        """Run every block that is not on record and return the sums over all."""
        self._resume()
        try:
            self._work()
        except KeyboardInterrupt:
            self._drop()
            raise Interrupted(f"interrupted after {self.done} of {self.runs} runs; {self._kept()}") from None
        except BaseException:
            self._drop()
            raise
        return self.total

    def _resume(self) -> None:
        """Start from what is on record."""
        if self.store is not None:
            total, self.merged, self.finished = self.store.load(self.count, self.runs // self.size, self.runs_of)
            self.total = self.total if total is None else total
        self.done = sum(self.runs_of(block) for block in [*range(self.merged), *self.finished])
        self._merge()
        self.show(self.done)

    def _work(self) -> None:
        window = 4 * self.team.size + 4
        todo = iter([block for block in range(self.merged, self.count) if block not in self.finished])
        block = next(todo, None)
        while block is not None or self.flying:
            # The window bounds what waits for an earlier block, and so the memory.
            while block is not None and len(self.flying) < 2 * self.team.size + 1 and block < self.merged + window:
                self._start(block)
                block = next(todo, None)
            for future in wait(self.flying, return_when=FIRST_COMPLETED).done:
                self._receive(future)

    def _start(self, block: int, *, full: bool = False) -> None:
        try:
            future = self.team.submit(self.task, block, self.runs_of(block), self.attempts.get(block, 0), full=full)
        except (BrokenExecutor, RuntimeError) as why:
            self._retry(block, why)
            return
        self.flying[future] = block

    def _receive(self, future: Future[Sums | None]) -> None:
        block = self.flying.pop(future, None)
        if block is None:
            return
        try:
            sums = future.result()
        except FloatingPointError:
            raise  # an overflow comes from the numbers, not from the worker
        except (Exception, CancelledError) as why:
            self._retry(block, why)
            return
        if sums is None:
            self._start(block, full=True)
            return
        self.finished[block] = sums
        self.done += self.runs_of(block)
        if self.store is not None:
            self.store.put(block, self.runs_of(block), sums)
        self._merge()
        self.show(self.done)

    def _retry(self, block: int, why: BaseException) -> None:
        """Try a block again; if all workers are gone, with new ones, and with it the blocks that went down with them."""
        lost = [block]
        if isinstance(why, BrokenExecutor):
            lost += self.flying.values()
            self.flying.clear()
            if not self.team.renew():
                self.attempts[block] = RETRIES  # the workers are not ours to replace
        for each in lost:
            self.attempts[each] = self.attempts.get(each, 0) + 1
            if self.attempts[each] > RETRIES:
                raise BlockFailed(self._failure(each, why)) from why
        for each in lost:
            self._start(each)

    def _failure(self, block: int, why: BaseException) -> str:
        begin = block * self.size
        return (
            f"block {block} (runs {begin} to {begin + self.runs_of(block) - 1}): failed {RETRIES + 1} times, "
            f"the last time with {type(why).__name__}: {why}; {self._kept()}"
        )

    def _merge(self) -> None:
        """Add what continues the merged blocks."""
        full = self.runs // self.size
        while self.merged in self.finished:
            sums = self.finished.pop(self.merged)
            check_finite("sums of x and e", sums.table, self.task.experiment.dt)
            self.total = sums if self.merged == 0 else self.total.plus(sums)
            self.merged += 1
            if self.store is not None and self.merged <= full:
                self.store.compact(self.total, self.merged, force=self.merged == full)

    def _drop(self) -> None:
        for future in self.flying:
            future.cancel()

    def _kept(self) -> str:
        if self.store is None:
            return "nothing is kept (pass checkpoint=FOLDER to be able to resume)"
        return f"the finished blocks are kept: the same call with checkpoint={str(self.store.folder)!r} resumes"
