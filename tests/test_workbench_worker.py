"""Long runs in processes of their own: results, progress, cancelling, caps, crashes, and who is served when."""

from __future__ import annotations

import asyncio
import importlib
import inspect
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Coroutine, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ctlabs import DiscreteModel, montecarlo
from ctlabs.workbench.worker import FUNCTIONS, Progress, RunFailed, Runner, _Job
from tests import workbench_functions

TABLE = {
    name: f"tests.workbench_functions:{name}"
    for name, value in vars(workbench_functions).items()
    if inspect.isfunction(value)
} | {"montecarlo": "ctlabs.montecarlo:run"}
MODEL = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    """Two processes, whatever the machine has, with little memory."""
    made = Runner(TABLE, size=2, memory=300 * 1024**2, warm=("ctlabs.montecarlo.kernel", "ctlabs.kalman"))
    yield made
    made.close()


def wait_for(work: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(work)


def run(runner: Runner, name: str, /, **arguments: Any) -> Any:
    """One run from a loop of its own."""
    return asyncio.run(runner.run(name, arguments))


def fails(runner: Runner, name: str, kind: str, /, **arguments: Any) -> str:
    """The line of a run that fails so."""
    with pytest.raises(RunFailed) as caught:
        run(runner, name, **arguments)
    assert caught.value.kind == kind
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_table_names_functions_of_the_library() -> None:
    """Every name is one line of the table, of this library, and can be imported; nothing else is run."""
    for path in FUNCTIONS.values():
        module, _, name = path.partition(":")
        assert module.startswith("ctlabs.")
        assert callable(getattr(importlib.import_module(module), name))


def test_an_unknown_name_is_refused_before_anything_starts() -> None:
    """A path or an expression is no name."""
    runner = Runner(TABLE)
    for name in ("os:system", "tests.workbench_functions:double", ""):
        with pytest.raises(KeyError, match=r"run: expected one of .*double.*, received"):
            run(runner, name)
    assert runner._idle == []


def test_the_same_numbers_as_here(runner: Runner) -> None:
    """An experiment in a process has the bytes of one in this process."""
    arguments = {"truth": MODEL, "steps": 20, "runs": 500, "seed": 3}
    there, here = run(runner, "montecarlo", **arguments), montecarlo.run(**arguments, progress=False)  # type: ignore[arg-type]
    for name in ("t", "bias", "rms", "cov", "nees", "nis"):
        assert getattr(there, name).tobytes() == getattr(here, name).tobytes(), name


def test_a_process_is_kept_and_loaded_once(runner: Runner) -> None:
    """Runs one after the other are in the same process."""
    first = run(runner, "identity")
    second = run(runner, "identity")
    assert first["pid"] == second["pid"] != os.getpid()
    assert second["threads"] == "1"
    assert second["workers"] == len(os.sched_getaffinity(0))
    assert run(runner, "identity", workers=5)["workers"] == 5


def test_progress_rises_to_one_with_a_rate(runner: Runner) -> None:
    """Reports come in order, in the event loop's thread, the last at 1; 40 steps of 10 ms make less than 100 per second."""
    seen: list[Progress] = []
    threads = set()

    def show(state: Progress) -> None:
        seen.append(state)
        threads.add(threading.get_ident())

    wait_for(runner.run("steps", {"count": 40, "seconds": 0.01}, progress=show))
    fractions = [state.fraction for state in seen if not state.ahead]
    assert len(fractions) >= 4
    assert fractions == sorted(fractions)
    assert (seen[-1].fraction, seen[-1].done, seen[-1].total) == (1.0, 40, 40)
    assert threads == {threading.get_ident()}
    assert 10 < seen[-1].rate <= 100
    middle = Progress(0.5, 20.0, 50, 100)
    assert middle.left == 2.5
    assert Progress(0, 0, 0, 100).left is None


def test_a_page_that_fails_does_not_end_its_run(runner: Runner, caplog: pytest.LogCaptureFixture) -> None:
    """An exception in the function that shows the progress is logged, and the result comes."""

    def broken(_: Progress) -> None:
        raise RuntimeError("gone")

    assert wait_for(runner.run("steps", {"count": 3, "seconds": 0.06}, progress=broken)) > 0
    assert "progress of a run" in caplog.text


@pytest.mark.parametrize("event", [threading.Event, asyncio.Event])
@pytest.mark.parametrize(
    ("name", "arguments", "warm"),
    [
        ("steps", {"count": 1000, "seconds": 0.02}, True),
        ("stubborn", {}, True),
        ("silent", {"seconds": 60.0}, False),
        ("montecarlo", {"truth": MODEL, "steps": 2000, "runs": 10_000_000, "seed": 1}, None),
    ],
)
def test_cancelling_ends_a_run_long_before_its_end(
    runner: Runner, event: Any, name: str, arguments: dict[str, Any], warm: bool | None
) -> None:
    """Also one that tells nothing (it is killed) or tries again after every failure; one that tells keeps its process."""

    async def work() -> float:
        before = (await runner.run("identity", {}))["pid"]
        cancel = event()
        task = asyncio.ensure_future(runner.run(name, arguments, cancel=cancel))
        await asyncio.sleep(0.3)
        start = time.perf_counter()
        cancel.set()
        with pytest.raises(RunFailed, match=f"^{name}: cancelled") as caught:
            await task
        took = time.perf_counter() - start
        assert caught.value.kind == "cancelled"
        after = (await runner.run("identity", {}))["pid"]
        assert warm is None or (after == before) == warm  # a block of runs may take longer than we wait for a report
        return took

    assert wait_for(work()) < 10  # of a minute


def test_a_task_that_is_cancelled_cancels_its_run(runner: Runner) -> None:
    """A page that goes away leaves no run behind."""

    async def work() -> None:
        task = asyncio.ensure_future(runner.run("silent", {"seconds": 60.0}))
        await asyncio.sleep(0.2)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        start = time.perf_counter()
        while runner._running:
            await asyncio.sleep(0.02)
        assert time.perf_counter() - start < 10

    wait_for(work())


def test_the_loop_is_not_held_up(runner: Runner) -> None:
    """While a process works and a large result comes back, the event loop turns at least every 0.1 s."""

    async def work() -> float:
        gaps, last, done = [], time.perf_counter(), False

        async def beat() -> None:
            nonlocal last
            while not done:
                await asyncio.sleep(0.005)
                gaps.append(time.perf_counter() - last)
                last = time.perf_counter()

        beats = asyncio.ensure_future(beat())
        await runner.run("silent", {"seconds": 0.3})
        assert (await runner.run("double", {"x": np.ones(2_000_000)})).sum() == 4e6
        done = True
        await beats
        return max(gaps)

    assert wait_for(work()) < 0.1


def test_a_run_has_a_time(runner: Runner) -> None:
    """A run longer than its cap is ended, and says so in one line."""

    async def work() -> None:
        await runner.run("silent", {"seconds": 60.0}, seconds=0.3)

    start = time.perf_counter()
    with pytest.raises(
        RunFailed, match=r"^silent: expected at most 0.3 s, received a run that takes longer; it was ended$"
    ) as caught:
        wait_for(work())
    assert caught.value.kind == "time"
    assert time.perf_counter() - start < 3


@pytest.mark.skipif(sys.platform != "linux", reason="macOS and Windows have no cap on a process's memory")
def test_a_run_has_a_memory(runner: Runner) -> None:
    """What fits runs; what does not is refused in one line, and the process goes on."""
    assert run(runner, "fill", megabytes=100) == 100 * 131072
    pid = run(runner, "identity")["pid"]
    line = fails(runner, "fill", "memory", megabytes=2000)
    assert line == "fill: expected a run within 300 MB, received one that needs more; take fewer runs or steps"
    assert run(runner, "identity")["pid"] == pid
    fails(runner, "hidden_memory", "memory")


def test_errors_are_one_line(runner: Runner, caplog: pytest.LogCaptureFixture) -> None:
    """Bad input has the library's words; a defect has its name, and its traceback goes to the log."""
    assert fails(runner, "refuse", "refused") == "refuse: R: expected variances >= 0 on the diagonal, received -1"
    assert caplog.text == ""
    assert fails(runner, "fail", "failed") == "fail: KeyError: 'x'"
    assert "workbench_functions.py" in caplog.text
    assert "the result cannot be sent" in fails(runner, "unpicklable", "failed")
    assert "expected arguments that can be sent" in fails(runner, "double", "refused", x=lambda: None)
    assert "got an unexpected keyword argument 'y'" in fails(runner, "double", "refused", y=1)


@pytest.mark.parametrize(
    ("code", "how"), [(-signal.SIGKILL, "signal SIGKILL"), (-signal.SIGSEGV, "signal SIGSEGV"), (3, "exit code 3")]
)
def test_a_crash_is_one_line_and_the_next_run_works(runner: Runner, code: int, how: str) -> None:
    """A process that dies takes nothing with it."""
    line = fails(runner, "die", "crashed", code=code)
    assert line == f"die: the run's process died ({how}), perhaps for lack of memory; nothing else is affected"
    assert run(runner, "double", x=2) == 4


def test_waiting_runs_know_how_many_are_ahead_and_can_be_cancelled(runner: Runner) -> None:
    """With both processes taken a run waits, says so, and leaves the queue at once when it is cancelled."""

    async def work() -> None:
        busy = [asyncio.ensure_future(runner.run("silent", {"seconds": 0.8}, session=s)) for s in "ab"]
        await asyncio.sleep(0.1)
        seen: list[Progress] = []
        cancel = asyncio.Event()
        late = asyncio.ensure_future(runner.run("double", {"x": 1}, session="c", progress=seen.append, cancel=cancel))
        await asyncio.sleep(0.2)
        assert [state.ahead for state in seen] == [1]
        start = time.perf_counter()
        cancel.set()
        with pytest.raises(RunFailed, match="double: cancelled before it began"):
            await late
        assert time.perf_counter() - start < 0.3
        await asyncio.gather(*busy)

    wait_for(work())


def test_a_session_with_many_runs_does_not_keep_others_waiting(runner: Runner) -> None:
    """Ten runs of one session leave a process for another's, which starts at once."""

    async def work() -> None:
        order: list[str] = []

        async def one(session: str, seconds: float) -> None:
            await runner.run("silent", {"seconds": seconds}, session=session)
            order.append(session)

        greedy = [asyncio.ensure_future(one("greedy", 0.2)) for _ in range(5)]
        await asyncio.sleep(0.05)
        start = time.perf_counter()
        await one("modest", 0.05)
        assert time.perf_counter() - start < 0.4
        assert order.count("greedy") <= 2
        await asyncio.gather(*greedy)

    run(runner, "identity")
    wait_for(work())


def test_the_next_process_goes_to_who_has_fewest_and_waited_longest() -> None:
    """The rule itself, without processes: fewest running, then served longest ago, then first come."""
    runner = Runner(TABLE, size=3)
    jobs = {name: _Job("double", {}, name[0], 1.0, lambda _: None) for name in ("a1", "a2", "a3", "b1", "c1")}
    runner._waiting = [jobs[name] for name in ("a2", "a3", "b1", "c1")]
    runner._running = [jobs["a1"]]
    runner._served = {"b": 5, "c": 4, "a": 6}
    assert runner._next() is jobs["c1"]
    runner._waiting.remove(jobs["c1"])
    assert runner._next() is jobs["b1"]
    runner._waiting.remove(jobs["b1"])
    assert runner._next() is jobs["a2"]  # the second of three
    runner._running.append(jobs["a2"])
    runner._waiting.remove(jobs["a2"])
    assert runner._next() is None  # the third is left for others
    runner._waiting.append(jobs["b1"])
    assert runner._next() is jobs["b1"]
    runner._running.append(jobs["b1"])
    runner._waiting.append(jobs["c1"])
    assert runner._next() is None  # none is free


def test_never_more_processes_than_allowed(runner: Runner) -> None:
    """Six sessions at once are served by two processes."""

    async def work() -> set[int]:
        return set(await asyncio.gather(*(runner.run("silent", {"seconds": 0.1}, session=str(i)) for i in range(6))))

    assert len(wait_for(work())) <= 2
    assert len(runner._idle) <= 2


def test_closing_ends_everything() -> None:
    """Running and waiting runs are cancelled, no process is left, and nothing new begins."""
    runner = Runner(TABLE, size=1, warm=())

    async def work() -> None:
        tasks = [asyncio.ensure_future(runner.run("silent", {"seconds": 60.0}, session=s)) for s in "ab"]
        await asyncio.sleep(0.7)
        process = runner._running[0].process
        assert process is not None
        start = time.perf_counter()
        await asyncio.to_thread(runner.close)
        assert time.perf_counter() - start < 2
        for task in tasks:
            with pytest.raises(RunFailed) as caught:
                await task
            assert caught.value.kind == "cancelled"
        assert not process.alive()
        with pytest.raises(RunFailed, match="expected a workbench that is running"):
            await runner.run("double", {"x": 1})

    wait_for(work())


_SERVER = """
import asyncio, sys
from ctlabs.workbench.worker import Runner
from tests.test_workbench_worker import TABLE

async def main():
    runner = Runner(TABLE, size=1, warm=())
    print((await runner.run("identity", {}))["pid"], flush=True)
    await runner.run("silent", {"seconds": 120.0})

if __name__ == "__main__":
    asyncio.run(main())
"""


def test_a_killed_server_leaves_no_process(tmp_path: Path) -> None:
    """The process of a run ends when its server is killed, even in the middle of the run."""
    script = tmp_path / "server.py"
    script.write_text(textwrap.dedent(_SERVER))
    root = str(Path(__file__).parent.parent)
    environment = {**os.environ, "PYTHONPATH": root, "PYTHONWARNINGS": "error"}
    server = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    pid = int(server.stdout.readline())
    time.sleep(0.2)
    server.send_signal(signal.SIGKILL)
    server.wait(10)
    server.stdout.close()
    end = time.monotonic() + 5
    while _alive(pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _alive(pid)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")  # a dead process that nobody has waited for
    return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"
