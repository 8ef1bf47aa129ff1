"""What coverage need not look at: code of others and the twins of the tests.

On Python 3.11 its tracer slows everything that runs in the interpreter down two to three times, also what it does not count.
"""

import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from coverage import Coverage


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
