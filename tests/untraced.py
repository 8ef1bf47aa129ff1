"""Code that coverage need not look at: that of others, and the twins of the tests."""

import functools
import sys
from collections.abc import Callable
from typing import Any


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
