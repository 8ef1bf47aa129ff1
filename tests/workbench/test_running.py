"""The run of a session as its pages see it: one at a time, told to all who watch, and always with an end."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from ctlabs.workbench.runs.worker import RunFailed, RunProgress

pytest.importorskip("nicegui", reason="the workbench is not installed: pip install 'ctlabs[workbench]'")

from ctlabs.workbench.runs.running import Running


async def ended(run: Running) -> None:
    for _ in range(200):
        if not run.running:
            return
        await asyncio.sleep(0.005)
    pytest.fail("the run did not end")


def test_all_who_watch_are_told_until_they_stop() -> None:
    """At the beginning, at each progress, at the end; not after they have left."""

    async def body() -> None:
        run, seen, others = Running(), [], []
        run.watch(lambda: seen.append((run.running, run.progress)))
        stop = run.watch(lambda: others.append(1))
        half = RunProgress(0.5, 10.0, 5, 10)

        async def work(progress: Any, cancel: Any) -> None:
            progress(half)
            stop()
            stop()
            progress(half)

        run.start(work)
        await ended(run)
        assert seen == [(True, None), (True, half), (True, half), (False, None)]
        assert len(others) == 2
        assert (run.finished, run.problem, run.cancelled) == (1, "", False)

    asyncio.run(body())


def test_one_run_at_a_time() -> None:
    """A second one is not begun while the first goes on, and can be afterwards."""

    async def body() -> None:
        run, begun, free = Running(), [], asyncio.Event()

        async def work(progress: Any, cancel: Any) -> None:
            begun.append(1)
            await free.wait()

        run.start(work)
        run.start(work)
        await asyncio.sleep(0.01)
        assert begun == [1]
        free.set()
        await ended(run)
        run.start(work)
        await ended(run)
        assert (begun, run.finished) == ([1, 1], 2)

    asyncio.run(body())


@pytest.mark.parametrize(
    ("why", "problem", "cancelled"),
    [
        (RunFailed("cancelled", "cancelled"), "", True),
        (RunFailed("memory", "too large", "experiment"), "too large", False),
        (ValueError("Qd: expected\n a covariance"), "Qd: expected a covariance", False),
    ],
)
def test_a_run_without_a_result_says_why(why: Exception, problem: str, cancelled: bool) -> None:
    """In one line; what was cancelled is no problem; the next run begins without it."""

    async def body() -> None:
        run = Running()

        async def fails(progress: Any, cancel: Any) -> None:
            raise why

        async def works(progress: Any, cancel: Any) -> None:
            assert not cancel.is_set()

        run.start(fails)
        await ended(run)
        assert (run.problem, run.cancelled, run.finished) == (problem, cancelled, 0)
        run.cancel()
        run.start(works)
        await ended(run)
        assert (run.problem, run.cancelled, run.finished) == ("", False, 1)

    asyncio.run(body())


def test_cancel_reaches_the_work() -> None:
    """What it was given is set."""

    async def body() -> None:
        run = Running()

        async def work(progress: Any, cancel: Any) -> None:
            while not cancel.is_set():
                await asyncio.sleep(0.002)
            raise RunFailed("cancelled", "cancelled")

        run.start(work)
        await asyncio.sleep(0.01)
        run.cancel()
        await ended(run)
        assert run.cancelled

    asyncio.run(body())
