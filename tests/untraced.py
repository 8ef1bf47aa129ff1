"""Code that coverage need not look at: that of others, the twins of the tests, and what a test does after its beginning."""

import functools
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from coverage import Coverage

#: How long coverage looks at a test, in seconds of processor time: what takes longer mostly does the same again.
WATCHED = 0.2
#: Holds something while the time of the running test is over.
_over: list[int] = []


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
            sys.settrace(None if _over else trace)
            (lambda: None)()  # coverage comes back to its quick self at the next call, which has to be before this function returns

    return quick


@contextmanager
def watched_at_first() -> Iterator[None]:
    """Coverage looks for the first ``WATCHED`` seconds at what is done here, and then away: what it reports is a lower bound."""
    coverage = Coverage.current()
    if sys.gettrace() is None or coverage is None or not hasattr(signal, "setitimer"):
        yield
        return

    def end(number: int, _frame: Any) -> None:
        _over.append(number)
        coverage.stop()

    signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, WATCHED)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        if _over:  # with a new tracer: the old one takes the functions that it saw begin for those that still run
            _over.clear()
            coverage.start()
