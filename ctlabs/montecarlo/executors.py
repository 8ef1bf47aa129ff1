"""Who computes the blocks: threads, processes, a Dask scheduler, or any ``concurrent.futures.Executor`` of yours.

In this process blocks are handed over as they are. Elsewhere the experiment travels once to each worker, which keeps
it; after that a task is a few numbers. A worker that does not have it (a new one, or one that was restarted) says so
and is sent it again.
"""

from __future__ import annotations

import os
import pickle
import signal
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from hashlib import sha256
from threading import Event
from typing import Any, Protocol

from ctlabs.linalg import checks
from ctlabs.linalg.threads import one_thread
from ctlabs.montecarlo.histogram import Counter
from ctlabs.montecarlo.plan import Tiling
from ctlabs.montecarlo.statistics import Claims
from ctlabs.montecarlo.sums import Sums


class InBlocks(Protocol):
    """What runs in blocks."""

    @property
    def layout(self) -> Tiling:
        """How runs are grouped."""
        ...

    @property
    def dt(self) -> float:
        """Period, s."""
        ...

    @property
    def counter(self) -> Counter:
        """The histogram's bins."""
        ...

    def prepare(self) -> None:
        """What is done once before the first block, in this process (compilation)."""
        ...

    def block(self, seed: int, block: int, runs: int, stop: Event | None = None) -> Sums:
        """The sums over the first ``runs`` runs of a block."""
        ...

    def claims(self, total: Sums, runs: int) -> Claims:
        """What the statistics need beside the sums."""
        ...

    def identity(self) -> dict[str, str]:
        """Digests of everything that the sums depend on, by name."""
        ...


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Team:
    """Workers for one or more experiments; :func:`team` makes one."""

    def __init__(self, executor: Executor, size: int, local: bool, renew: Any = None) -> None:
        self.executor, self.size, self.local, self._renew = executor, size, local, renew
        self.stop = Event()
        self._known: set[str] = set()

    def renew(self) -> bool:
        """New workers after the old ones died; False if they are not ours to replace."""
        if self._renew is None:
            return False
        self.executor.shutdown(wait=False, cancel_futures=True)
        self.executor = self._renew()
        self._known.clear()
        return True

    def submit(self, task: Task, block: int, runs: int, attempt: int, *, full: bool = False) -> Future[Sums | None]:
        """Start one block; the result None means that the worker needs the experiment (``full``)."""
        if self.local:
            return self.executor.submit(task.experiment.block, task.seed, block, runs, self.stop)
        full = full or task.key not in self._known
        self._known.add(task.key)
        return self.executor.submit(
            _elsewhere, task.key, task.payload if full else None, task.seed, block, runs, attempt
        )

    def abandon(self) -> None:
        """Stop at once: blocks not begun are dropped, our processes are ended."""
        self.stop.set()
        processes = list((getattr(self.executor, "_processes", None) or {}).values()) if self._renew is not None else []
        self.executor.shutdown(wait=self.local, cancel_futures=True)
        for process in processes:
            process.terminate()


class Inline(Executor):
    """One worker, and it is the caller: nothing to hand over."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Compute at once; Ctrl-C passes through."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as why:
            future.set_exception(why)
        return future


class Task:
    """An experiment with its seed, ready to travel."""

    def __init__(self, experiment: InBlocks, seed: int) -> None:
        self.experiment, self.seed = experiment, seed
        self._payload: bytes | None = None
        self._key = ""

    @property
    def payload(self) -> bytes:
        """The experiment in bytes."""
        if self._payload is None:
            try:
                self._payload = pickle.dumps(self.experiment, protocol=pickle.HIGHEST_PROTOCOL)
            except (pickle.PicklingError, AttributeError, TypeError) as why:
                msg = f"experiment: expected functions defined at the top of a module (they travel by name), received {why}"
                raise TypeError(msg) from None
            self._key = sha256(self._payload).hexdigest()
        return self._payload

    @property
    def key(self) -> str:
        """Digest of the payload."""
        return self._key if self.payload else ""


@contextmanager
def team(executor: Executor | Team | str | None, workers: int | None) -> Iterator[Team]:
    """Workers while the experiment lasts; an executor given as an object is left running.

    Parameters
    ----------
    executor : ``None`` or ``"threads"`` · ``"processes"`` · the address of a Dask scheduler (``"tcp://host:8786"``) ·
        any ``concurrent.futures.Executor``, such as ``mpi4py.futures.MPIPoolExecutor()``
    workers : how many; all cores by default. For an executor given as an object: how many it has, if it does not tell.
    """
    count = cores() if workers is None else checks.count("workers", workers)
    if isinstance(executor, Team):
        yield executor
        return
    made = _made(executor, count, workers)
    try:
        yield made
    except BaseException:
        if executor is None or isinstance(executor, str):
            made.abandon()
        raise
    else:
        if executor is None or isinstance(executor, str):
            made.executor.shutdown(wait=True)
    finally:
        made.stop.set()
        if isinstance(executor, str) and "://" in executor:
            made.executor._client.close()  # type: ignore[attr-defined]  # opened by _made


def _made(executor: Executor | str | None, count: int, workers: int | None) -> Team:
    if executor is None or executor == "threads":
        threads: Executor = Inline() if count == 1 else ThreadPoolExecutor(count, thread_name_prefix="montecarlo")
        return Team(threads, count, local=True)
    if executor == "processes":
        return Team(_processes(count), count, local=False, renew=lambda: _processes(count))
    if isinstance(executor, str) and "://" in executor:
        return _dask(executor)
    if isinstance(executor, Executor):
        size = workers or getattr(executor, "_max_workers", None) or _dask_size(executor) or count
        return Team(executor, int(size), local=isinstance(executor, ThreadPoolExecutor))
    msg = f"executor: expected 'threads', 'processes', a scheduler's address (tcp://…) or an Executor, received {executor!r}"
    raise ValueError(msg)


def _processes(count: int) -> ProcessPoolExecutor:
    import multiprocessing

    # Not forked: a fork would copy locks that this process's threads hold.
    return ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"), initializer=_ignore_interrupts)


def _ignore_interrupts() -> None:
    """Leave Ctrl-C to the parent, which ends its workers in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _dask(address: str) -> Team:
    try:
        import distributed
    except ImportError:
        msg = f"executor: expected the extra 'cluster' for {address} (pip install ctlabs[cluster]), received no dask.distributed"
        raise ValueError(msg) from None
    try:
        connect: Any = distributed.Client
        client = connect(address, timeout=10)
    except OSError as why:
        msg = f"executor: expected a Dask scheduler at {address}, received no answer ({why})"
        raise ValueError(msg) from None
    pool = client.get_executor()
    return Team(pool, _dask_size(pool) or 1, local=False)


def _dask_size(executor: Executor) -> int | None:
    client: Any = getattr(executor, "_client", None)
    return None if client is None else sum(client.nthreads().values())


EXPERIMENTS: OrderedDict[str, InBlocks] = OrderedDict()


def _elsewhere(key: str, payload: bytes | None, seed: int, block: int, runs: int, _attempt: int) -> Sums | None:
    """A block in another process; None if the experiment has not arrived there. The attempt's number tells retries apart."""
    if payload is not None:
        EXPERIMENTS[key] = pickle.loads(payload)
        while len(EXPERIMENTS) > 4:
            EXPERIMENTS.popitem(last=False)
    experiment = EXPERIMENTS.get(key)
    if experiment is None:
        return None
    with one_thread():
        return experiment.block(seed, block, runs)
