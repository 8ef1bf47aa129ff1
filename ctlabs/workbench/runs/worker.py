"""Long runs, each in a process of its own: with progress and rate, a cap on memory and on time, and an end within a second.

    runner = Runner()
    statistics = await runner.run("montecarlo", {"truth": model, "steps": 200, "runs": 1000, "seed": 1},
                                  session=session_id, progress=show, cancel=event)

The page's event loop is never held up: a thread talks to the process and hands its messages over. Processes are spawned
(not forked), load the library once and are then kept. What can be run is the table :data:`FUNCTIONS`, by name; nothing
that a user types ever reaches it. A function that has a parameter ``progress`` is given a function (done, total), one
that has a parameter ``workers`` its share of the cores.

Sessions share the processes: the next free one goes to the session with the fewest runs, then to the one that
was served longest ago, and no session has all of them at once. A run that is cancelled stops at its next report of
progress, which leaves the process warm; one that reports nothing is killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import logging
import multiprocessing
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from multiprocessing.connection import wait
from typing import Any, NamedTuple, Protocol

from ctlabs.workbench.runs.inside import TELL, Kind, cores, line, named, work

log = logging.getLogger("ctlabs.workbench")

#: What can be run: name → "module:function". Add a line for a new kind of run; the test calls for an importable function.
FUNCTIONS: Mapping[str, str] = {
    "montecarlo": "ctlabs.montecarlo:monte_carlo",
    "simulate": "ctlabs.montecarlo:simulate",
    "experiment": "ctlabs.workbench.runs.experiments:run",
    "lab": "ctlabs.workbench.runs.catalogue:run_lab",
    "table": "ctlabs.workbench.runs.seen:seen",
    "estimates": "ctlabs.workbench.runs.records:estimated",
    "diagnosis": "ctlabs.workbench.runs.records:diagnosed",
    "files": "ctlabs.workbench.runs.records:files",
    "fit": "ctlabs.workbench.runs.fits:fitted",
    "loop_curves": "ctlabs.workbench.runs.loops:curves",
    "loop_ensemble": "ctlabs.workbench.runs.loops:many",
    "course_issue": "ctlabs.workbench.runs.courses:issue_course",
    "course_grade": "ctlabs.workbench.runs.courses:grade_course",
}
#: Loaded by a process before its first run.
WARM: Sequence[str] = ("ctlabs.workbench.runs.warm",)
#: What a run may take beyond what the loaded library takes, in bytes; and for how long, in seconds.
MEMORY, SECONDS = 2 * 1024**3, 600.0
#: How long a cancelled run may take to stop by itself, and how long a process may load, in seconds.
PATIENCE, LOADING = 0.5, 600.0


async def here(name: str, arguments: Mapping[str, Any]) -> Any:
    """What a run gives, in a thread of this process: it needs no process that may still be loading, and cannot be cancelled."""
    return await asyncio.to_thread(lambda: named(FUNCTIONS[name])(**arguments))


class RunFailed(RuntimeError):
    """A run that has no result: ``line`` says why, ``name`` what was run, ``kind`` whose fault it is.

    ``refused``: the input (a ``ValueError``, ``TypeError`` or overflow of the library) · ``failed``: anything else it
    raised · ``memory``, ``time``: a cap · ``crashed``: the process died · ``cancelled``
    """

    def __init__(self, kind: Kind, line: str, name: str = "") -> None:
        super().__init__(f"{name}: {line}" if name else line)
        self.kind, self.line, self.name = kind, line, name


class RunProgress(NamedTuple):
    """How far a run is. ``ahead``: how many wait before it (0: it runs); ``rate`` per second, 0 while not known; ``note``: what else the
    run tells.
    """

    fraction: float
    rate: float
    done: int
    total: int
    ahead: int = 0
    note: Any = None

    @property
    def left(self) -> float | None:
        """Seconds that remain at this rate; ``None`` while not known."""
        return (self.total - self.done) / self.rate if self.rate > 0 else None


class Cancel(Protocol):
    """A ``threading.Event`` or an ``asyncio.Event``."""

    def is_set(self) -> bool:
        """Whether the run is no longer wanted."""
        ...


class Runner:
    """Processes for the runs of all sessions.

    Parameters
    ----------
    functions : what can be run
    size : how many processes at most; as many as there are cores, if not given
    memory, seconds : caps of one run
    warm : modules that a process loads before its first run
    """

    def __init__(
        self,
        functions: Mapping[str, str] = FUNCTIONS,
        *,
        size: int | None = None,
        memory: int = MEMORY,
        seconds: float = SECONDS,
        warm: Sequence[str] = WARM,
    ) -> None:
        self.functions, self.memory, self.seconds = dict(functions), memory, seconds
        self.size = max(1, size if size is not None else cores())
        self._modules = tuple(warm)
        self._lock, self._starting = threading.Lock(), threading.Lock()
        self._waiting: list[Job] = []
        self._running: list[Job] = []
        self._served: dict[str, int] = {}  # when a session was last given a process, counted in runs; the latest last
        self._count = 0
        self._idle: list[_Process] = []
        self._closed = False

    def warm(self) -> None:
        """Start a process now, so that the first run finds it loaded. Returns at once."""
        threading.Thread(target=self._renew, name="workbench-warm", daemon=True).start()

    async def run(
        self,
        name: str,
        arguments: Mapping[str, Any],
        *,
        session: str = "",
        progress: Callable[[RunProgress], object] | None = None,
        cancel: Cancel | None = None,
        seconds: float | None = None,
        patience: float = PATIENCE,
    ) -> Any:
        """Run a function of the table elsewhere and return its result.

        Parameters
        ----------
        name, arguments : which function, and its keyword arguments (picklable)
        session : who asks; sessions are served in turn
        progress : called in this event loop; it may change elements of a page, but make none
        cancel : when it is set, the run ends within a second
        seconds : cap on its time, from when it starts; the runner's own if not given
        patience : how long it may take to stop when it is cancelled, s; one that then has a result, as far as it came, gives it

        Raises
        ------
        RunFailed
        KeyError
            A name that is not in the table.

        A task that is cancelled itself cancels its run.
        """
        if name not in self.functions:
            msg = f"run: expected one of {', '.join(sorted(self.functions))}, received {name!r}"
            raise KeyError(msg)
        loop, context = asyncio.get_running_loop(), contextvars.copy_context()

        def show(state: RunProgress) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(_shown, progress, state, context=context)

        job = Job(name, dict(arguments), session, self.seconds if seconds is None else seconds, show, patience)
        self._enter(job)
        done, ahead = asyncio.wrap_future(job.future), -1
        done.add_done_callback(lambda future: future.cancelled() or future.exception())  # it may be awaited by nobody
        try:
            while not done.done():
                if cancel is not None and cancel.is_set():
                    job.unwanted.set()
                    self._withdraw(job)
                if ahead != (ahead := self._ahead(job)) and ahead:
                    _shown(progress, RunProgress(0.0, 0.0, 0, 0, ahead))
                await asyncio.wait({done}, timeout=TELL)
        finally:
            job.unwanted.set()
            self._withdraw(job)
        return done.result()

    def close(self) -> None:
        """End all processes; what is running or waiting is cancelled."""
        with self._starting, self._lock:  # a process that loses its parent while it starts prints a traceback
            self._closed = True
            idle, self._idle = self._idle, []
            jobs, self._waiting = [*self._waiting, *self._running], []
        for job in jobs:
            job.unwanted.set()
            job.closing.set()
            if job.process is None:
                job.fail("cancelled", "cancelled, because the workbench ends")
        for process in idle:
            process.kill()
        for job in jobs:
            with contextlib.suppress(Exception):
                job.future.exception(timeout=2)

    def threads(self) -> int:
        """How many threads a run may use, for a function that has a parameter ``workers``."""
        with self._lock:
            return max(1, cores() // max(1, len(self._running)))

    # The queue -------------------------------------------------------------------------------------------------------

    def _enter(self, job: Job) -> None:
        with self._lock:
            if self._closed:
                msg = "expected a workbench that is running, received one that has ended"
                raise RunFailed("cancelled", msg, job.name)
            self._waiting.append(job)
        self._dispatch()

    def _withdraw(self, job: Job) -> None:
        """Take a job that has not begun out of the queue."""
        with self._lock:
            if job not in self._waiting:
                return
            self._waiting.remove(job)
        job.fail("cancelled", "cancelled before it began")

    def _ahead(self, job: Job) -> int:
        with self._lock:
            return self._waiting.index(job) + 1 if job in self._waiting else 0

    def _dispatch(self) -> None:
        """Begin what can begin now."""
        while True:
            with self._lock:
                job = self._next()
                if job is None:
                    return
                self._waiting.remove(job)
                self._running.append(job)
                self._count += 1
                self._served.pop(job.session, None)
                self._served[job.session] = self._count
                if len(self._served) > 1000:
                    del self._served[next(iter(self._served))]
            threading.Thread(target=self._serve, args=(job,), name=f"workbench-{job.name}", daemon=True).start()

    def _next(self) -> Job | None:
        if len(self._running) >= self.size:
            return None
        of_session = Counter(job.session for job in self._running)
        share = max(1, self.size - 1)  # one process is left for the others
        free = [job for job in self._waiting if of_session[job.session] < share]
        return min(free, key=lambda job: (of_session[job.session], self._served.get(job.session, 0)), default=None)

    def _serve(self, job: Job) -> None:
        """Run one job in a process; this is the thread that talks to it."""
        process: _Process | None = None
        try:
            process = self._take()
            job.process = process
            process.converse(job, self)
        except Exception as why:  # nothing may leave a page waiting
            log.exception("run %s", job.name)
            job.fail("failed", f"the run could not be started: {line(why)}")
        finally:
            with self._lock:
                self._running.remove(job)
            kept = self._give_back(process)
            self._dispatch()
            if not kept:
                self._renew()

    def _take(self) -> _Process:
        while True:
            with self._lock:
                process = self._idle.pop() if self._idle else None
            if process is None:
                return _Process(self)
            if process.alive():
                return process
            process.kill()  # waits for it, and so not while others wait for the lock

    def _give_back(self, process: _Process | None) -> bool:
        """Keep a process for the next run, if it lives."""
        with self._lock:
            if process is not None and process.alive() and not self._closed:
                self._idle.append(process)
                return True
        if process is not None:
            process.kill()
        return False

    def _renew(self) -> None:
        """Have one process ready, unless there is one."""
        with self._starting:
            with self._lock:
                if self._closed or self._idle or len(self._running) >= self.size:
                    return
            process = _Process(self)
            with self._lock:
                if not self._closed and len(self._idle) + len(self._running) < self.size:
                    self._idle.append(process)
                    return
            process.kill()


class Job:
    """One run, from its place in the queue to its outcome."""

    def __init__(
        self,
        name: str,
        arguments: dict[str, Any],
        session: str,
        seconds: float,
        show: Callable[[RunProgress], object],
        patience: float = PATIENCE,
    ) -> None:
        self.name, self.arguments, self.session, self.seconds, self.show = name, arguments, session, seconds, show
        self.patience = patience
        self.future: Future[Any] = Future()
        self.unwanted, self.closing = threading.Event(), threading.Event()
        self.process: _Process | None = None

    def fail(self, kind: Kind, line: str) -> None:
        """End it without a result."""
        with contextlib.suppress(Exception):  # it has an outcome already
            self.future.set_exception(RunFailed(kind, line, self.name))

    def succeed(self, result: Any) -> None:
        """End it with a result."""
        with contextlib.suppress(Exception):
            self.future.set_result(result)


class _Process:
    """A spawned process and the pipe to it."""

    def __init__(self, runner: Runner) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other = context.Pipe()
        self.process = context.Process(
            target=work,
            args=(other, runner.functions, runner._modules, runner.memory),
            name="ctlabs-workbench-run",
            daemon=True,
        )
        self.process.start()
        other.close()
        self.loaded = False

    def alive(self) -> bool:
        return self.process.is_alive() and not self.connection.closed

    def kill(self) -> None:
        with contextlib.suppress(ValueError, OSError):  # closed already
            self.process.kill()
            self.process.join(1)
        self.connection.close()

    def converse(self, job: Job, runner: Runner) -> None:
        """Hand the job over and listen until it has an outcome; the process is dead afterwards, or ready for another."""
        try:
            if not self.loaded and not self._load(job):
                return
            try:
                self.connection.send((job.name, job.arguments, runner.threads()))
            except (OSError, BrokenPipeError):
                self._crashed(job)
                return
            except Exception as why:  # not picklable: nothing has been sent
                job.fail(
                    "refused",
                    f"expected arguments that can be sent to another process, received {line(why)}",
                )
                return
            self._listen(job, runner)
        except (EOFError, OSError):
            self._crashed(job)

    def _load(self, job: Job) -> bool:
        """Wait until the library is loaded."""
        end = time.monotonic() + LOADING
        while not self._ready(0.05):
            if job.unwanted.is_set():
                # The process goes on loading, for the next run.
                job.fail("cancelled", "cancelled before it began")
                if job.closing.is_set():
                    self.kill()
                return False
            if time.monotonic() > end:
                self.kill()
                job.fail("crashed", f"the run's process did not load within {LOADING:.0f} s")
                return False
        self.connection.recv()
        self.loaded = True
        return True

    def _listen(self, job: Job, runner: Runner) -> None:
        start, told = time.monotonic(), False
        end, patience = start + job.seconds, float("inf")
        while True:
            ready = self._ready(TELL)
            now = time.monotonic()
            if ready:
                message = self.connection.recv()
                if message[0] != "progress":
                    self._outcome(job, message, runner)
                    return
                job.show(rated(message[1], message[2], now - start)._replace(note=message[3]))
            if job.unwanted.is_set() and not told:
                told, patience = True, now + job.patience
                self.connection.send("stop")
            if now > patience or job.closing.is_set():
                self.kill()
                job.fail("cancelled", "cancelled")
                return
            if now > end:
                self.kill()
                job.fail(
                    "time",
                    f"expected at most {job.seconds:g} s, received a run that takes longer; it was ended",
                )
                return

    def _ready(self, timeout: float) -> bool:
        """Whether there is a message; an end of the process counts as one only after its last message."""
        found = wait([self.connection, self.process.sentinel], timeout)
        if self.connection in found:
            return True
        if found:
            if self.connection.poll():
                return True
            raise EOFError
        return False

    def _outcome(self, job: Job, message: tuple[Any, ...], runner: Runner) -> None:
        if message[0] == "done":
            job.succeed(message[1])
            return
        kind, line, trace = message[1:]
        if kind == "memory":
            line = f"expected a run within {runner.memory / 1024**2:.0f} MB, received one that needs more; take fewer runs or steps"
        if kind == "failed":
            log.error("run %s: %s\n%s", job.name, line, trace)
        job.fail(kind, line)

    def _crashed(self, job: Job) -> None:
        self.process.join(1)
        code = self.process.exitcode
        how = f"signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"exit code {code}"
        self.kill()
        job.fail(
            "crashed",
            f"the run's process died ({how}), perhaps for lack of memory; nothing else is affected",
        )


def _shown(progress: Callable[[RunProgress], object] | None, state: RunProgress) -> None:
    if progress is None:
        return
    try:
        progress(state)
    except Exception:  # a page that has gone must not end its run otherwise than by cancelling it
        log.exception("progress of a run")


def rated(done: int, total: int, seconds: float) -> RunProgress:
    """How far a run is, and how fast."""
    fraction = min(max(done / total, 0.0), 1.0) if total > 0 else 0.0
    return RunProgress(fraction, done / seconds if seconds > 0 else 0.0, done, total)
