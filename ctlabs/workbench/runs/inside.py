"""The other end of :mod:`ctlabs.workbench.runs.worker`: what happens inside the process of a run.

Messages to it: (name, arguments, threads) begins a run, "stop" ends it. Messages from it: "loaded" once; then for each
run ("progress", done, total, note) any number of times and ("done", result) or ("failed", kind, line, traceback) once.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Literal

Kind = Literal["refused", "failed", "memory", "time", "crashed", "cancelled"]

#: How often a run tells how far it is, in seconds.
TELL = 0.05


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def line(why: BaseException) -> str:
    """What an exception says, in one line."""
    return " ".join(str(why).split()) or type(why).__name__


class Unwanted(BaseException):
    """The run is no longer wanted. Not an ``Exception``: what is tried again after a failure is not tried again now."""


def work(connection: Connection, functions: dict[str, str], modules: tuple[str, ...], memory: int) -> None:
    """The process: load, then answer one request after the other until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's; it ends its processes
    threading.Thread(target=_follow, daemon=True).start()
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")  # read when numpy loads; the processes are the parallel part
    for module in modules:
        importlib.import_module(module)
    _cap(memory)
    try:
        connection.send("loaded")
        while True:
            request = connection.recv()
            if request != "stop":  # one that came after its run had ended
                _answer(connection, functions, *request)
    except (EOFError, OSError):  # the server has gone
        return


def _follow() -> None:
    """End with the server, even if it is killed while a run goes on."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _cap(memory: int) -> None:
    """Limit the memory to what is taken now and ``memory`` bytes more, where the system can."""
    if sys.platform == "win32":
        return
    import resource

    with contextlib.suppress(OSError, ValueError):  # macOS has the call, but not the limit
        pages = int(Path("/proc/self/statm").read_text().split()[0]) if sys.platform == "linux" else 0
        # Threads reserve address space (stack, arena of malloc) that they do not use.
        taken = pages * resource.getpagesize() + 80 * 1024**2 * cores()
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        wanted = taken + memory
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


def _answer(
    connection: Connection, functions: dict[str, str], name: str, arguments: dict[str, Any], threads: int
) -> None:
    try:
        message = _computed(connection, functions[name], arguments, threads)
    except Unwanted:
        message = "failed", "cancelled", "cancelled", ""
    except BaseException as why:
        message = "failed", _kind(why), _said(why), traceback.format_exc()
    try:
        connection.send(message)
    except OSError:
        raise
    except Exception as why:  # the result cannot be pickled, or there is no memory left for it: nothing has been sent
        kind = "memory" if isinstance(why, MemoryError) else "failed"
        connection.send(("failed", kind, f"the result cannot be sent: {line(why)}", traceback.format_exc()))


def named(path: str) -> Callable[..., Any]:
    """The function of "module:function"."""
    module, _, attribute = path.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), attribute)
    return found


def _computed(connection: Connection, path: str, arguments: dict[str, Any], threads: int) -> tuple[Any, ...]:
    function = named(path)
    offered = {"workers": threads, **arguments, "progress": _teller(connection)}
    taken = inspect.signature(function).parameters
    return "done", function(**{key: value for key, value in offered.items() if key in taken or key in arguments})


def _teller(connection: Connection) -> Callable[..., None]:
    """The function (done, total, note) that a run calls: it tells how far it is, with a note of its own, and ends the run by
    :class:`Unwanted` if it is.
    """
    last = 0.0

    def tell(done: int, total: int, note: Any = None) -> None:
        nonlocal last
        if connection.poll():
            connection.recv()  # nothing but "stop" is sent during a run
            raise Unwanted
        now = time.monotonic()
        if now - last >= TELL or 0 < total <= done:
            last = now
            connection.send(("progress", int(done), int(total), note))

    return tell


def _kind(why: BaseException) -> Kind:
    cause: BaseException | None = why
    while cause is not None:
        if isinstance(cause, MemoryError):
            return "memory"
        cause = cause.__cause__ or cause.__context__
    return "refused" if isinstance(why, ValueError | TypeError | ArithmeticError) else "failed"


def _said(why: BaseException) -> str:
    return line(why) if _kind(why) == "refused" else f"{type(why).__name__}: {line(why)}"
