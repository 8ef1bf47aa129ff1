"""Several jobs at a time, each in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Job = TypeVar("Job")
Done = TypeVar("Done")


def several(work: Callable[[Job], Done], jobs: Sequence[Job], together: int, *, ordered: bool = False) -> Iterator[Done]:
    """Results of ``work``, ``together`` of them at a time, as they are ready, or ``ordered`` as the jobs are.

    Interrupted, no further job begins. The processes are not forked: a fork would copy locks that this process's threads hold.

    >>> list(several(abs, [-3, 2], 1))
    [3, 2]
    """
    if together == 1 or len(jobs) < 2:
        yield from map(work, jobs)
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, as_completed

    with ProcessPoolExecutor(min(together, len(jobs)), mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = [pool.submit(work, job) for job in jobs]
        try:
            for each in waiting if ordered else as_completed(waiting):
                yield each.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
