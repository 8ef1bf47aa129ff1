"""What coverage need not look at: code of others, the twins of the tests, and what brings nothing new.

On Python 3.11 its tracer slows everything that runs in the interpreter down two to three times, also what it does not count.
What is reported is therefore a lower bound: coverage looks away from a test that has found nothing new for a while.
"""

import functools
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from coverage import Coverage

#: How often it is asked whether a test found something new, in seconds of processor time.
TICK = 0.1
#: So many cases of one test that found nothing new are enough.
BARREN = 3
_barren: Counter[str] = Counter()


def untraced(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, run without the tracer of coverage: for code of others, which it slows down two to four times for nothing."""

    @functools.wraps(function)
    def quick(*given: Any, **named: Any) -> Any:
        trace = sys.gettrace()
        if trace is None:
            return function(*given, **named)
        sys.settrace(None)
        try:
            return function(*given, **named)
        finally:
            sys.settrace(trace)
            (lambda: None)()  # coverage comes back to its quick self at the next call, which has to be before this function returns

    return quick


@contextmanager
def unwatched() -> Iterator[Coverage | None]:
    """Coverage looks away here. It begins anew afterwards: a tracer that missed calls takes returns for those of others."""
    watcher = Coverage.current() if sys.gettrace() is not None else None
    if watcher is not None:
        watcher.stop()
    try:
        yield watcher
    finally:
        if watcher is not None:
            watcher.start()


@contextmanager
def watched(test: str) -> Iterator[None]:
    """Coverage looks at a case of a test as long as there is something new, and not at all if its last ``BARREN`` cases had nothing."""
    watcher = Coverage.current()
    if watcher is None or not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
    elif _barren[test] >= BARREN:
        with unwatched():
            yield
    else:
        before = _found(watcher)
        with _until_nothing_is_new(watcher, before):
            yield
        _barren[test] = 0 if _found(watcher) > before else _barren[test] + 1


@contextmanager
def _until_nothing_is_new(watcher: Coverage, found: int) -> Iterator[None]:
    """Ask every ``TICK``; where a system's clock strikes late, later."""
    over = False

    def ask(*_signal: Any) -> None:
        nonlocal found, over
        now = _found(watcher)
        if now == found and not over:
            over = True
            watcher.stop()
        found = now

    before = signal.signal(signal.SIGVTALRM, ask)
    signal.setitimer(signal.ITIMER_VIRTUAL, TICK, TICK)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
        if over:
            watcher.start()


def _found(watcher: Coverage) -> int:
    """How many arcs have been found so far; coverage has no public name for what it has not written yet."""
    return sum(len(arcs) for arcs in list(watcher._collector.data.values()))
