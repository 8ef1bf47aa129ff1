"""Functions for the tests of the workbench's processes; they run there, by name."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np


def double(x: Any) -> Any:
    """Twice its argument."""
    return 2 * x


def identity(workers: int) -> dict[str, Any]:
    """The process and what it was given."""
    return {"pid": os.getpid(), "workers": workers, "threads": os.environ["OPENBLAS_NUM_THREADS"]}


def steps(count: int, seconds: float, progress: Callable[[int, int], object]) -> int:
    """Work in steps, telling after each."""
    for i in range(count):
        time.sleep(seconds)
        progress(i + 1, count)
    return os.getpid()


def stubborn(progress: Callable[[int, int], object]) -> None:
    """Try again whatever happens, as code that is kind to its workers does."""
    while True:
        try:
            time.sleep(0.01)
            progress(1, 2)
        except Exception:  # the point of the test
            pass


def silent(begun: str, gate: str) -> int:
    """Tell nothing but that it has begun, by a file, and end when there is another."""
    Path(begun).touch()
    while not Path(gate).exists():
        time.sleep(0.005)
    return os.getpid()


class Received:
    """A result that notes which thread has unpickled it."""

    def __setstate__(self, state: object) -> None:
        self.thread = threading.get_ident()


def received() -> Received:
    """One that has not been sent."""
    found = Received()
    found.thread = 0
    return found


def fill(megabytes: int) -> float:
    """Take memory and use it."""
    return float(np.ones(megabytes * 131072).sum())


def hidden_memory() -> None:
    """A lack of memory that something else reports."""
    try:
        np.empty(2**45)
    except MemoryError as why:
        msg = "block 0: failed 4 times"
        raise RuntimeError(msg) from why


def refuse() -> None:
    """What the library does with bad input."""
    msg = "R: expected variances >= 0 on the diagonal,\n received -1"
    raise ValueError(msg)


def fail() -> None:
    """A defect."""
    raise KeyError("x")


def die(code: int) -> None:
    """End without a word; a negative code is a signal."""
    if code < 0:
        os.kill(os.getpid(), -code)
    os._exit(code)


def unpicklable() -> Any:
    """A result that cannot travel."""
    return lambda: None


def ending(progress: Callable[[int, int, str], object]) -> str:
    """Work until it is unwanted, and then take a while to come to an end with a result."""
    from ctlabs.workbench.runs.inside import Unwanted

    try:
        while True:
            time.sleep(0.01)
            progress(1, 2, "a note")
    except Unwanted:
        time.sleep(1.0)
        return "the best so far"
