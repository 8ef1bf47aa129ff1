"""How far an experiment is: a bar with rate and time left on a terminal, silence elsewhere, or a function of yours."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: ``None``: a bar if the error stream is a terminal · ``True``, ``False``: a bar, none · a function (done, total) in runs
Progress = bool | None | Callable[[int, int], object]


@contextmanager
def reporter(progress: Progress, total: int, title: str = "Monte Carlo") -> Iterator[Callable[[int], None]]:
    """A function that takes the number of runs done so far, while the experiment goes on."""
    if callable(progress):
        yield lambda done: _ignore(progress(done, total))
        return
    if progress is False or (progress is None and not sys.stderr.isatty()):
        yield _ignore
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=title, unit=" runs", unit_scale=True, file=sys.stderr, dynamic_ncols=True) as bar:

        def show(done: int) -> None:
            bar.update(done - bar.n)

        yield show


def _ignore(_: object) -> None:
    return None
