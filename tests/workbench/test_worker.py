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

import pytest

from ctlabs import DiscreteModel, montecarlo
from ctlabs.workbench.runs import worker
from ctlabs.workbench.runs.worker import FUNCTIONS, Job, RunFailed, Runner, RunProgress, rated
from tests import workbench_functions

TABLE = {
    name: f"tests.workbench_functions:{name}"
    for name, value in vars(workbench_functions).items()
    if inspect.isfunction(value)
} | {"montecarlo": "ctlabs.montecarlo:monte_carlo"}
MODEL = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])


@pytest.fixture(scope="module")
def runner() -> Iterator[Runner]:
    """Two processes, whatever the machine has, with little memory."""
    made = Runner(TABLE, size=2, memory=300 * 1024**2, warm=("ctlabs.montecarlo.kernel", "ctlabs.filtering.filter"))
    yield made
    made.close()


class Gate:
    """The arguments of a ``silent`` run that begins when it likes and ends when it may: no test here depends on a clock."""

    def __init__(self, folder: Path, name: str = "run") -> None:
        self.begun, self.gate = folder / f"{name}.begun", folder / f"{name}.open"

    @property
    def arguments(self) -> dict[str, str]:
        return {"begun": str(self.begun), "gate": str(self.gate)}

    async def entered(self) -> None:
        """Wait until its run has begun."""
        while not self.begun.exists():
            await asyncio.sleep(0.005)

    def open(self) -> None:
        """Let its run end."""
        self.gate.touch()


def wait_for(work: Coroutine[Any, Any, Any]) -> Any:
    """What it returns; two minutes mean that it never will."""
    return asyncio.run(asyncio.wait_for(work, 120))


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
    there, here = run(runner, "montecarlo", **arguments), montecarlo.monte_carlo(**arguments, progress=False)  # type: ignore[arg-type]
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
    """Reports come in order, in the event loop's thread, the last at 1."""
    seen: list[RunProgress] = []
    threads = set()

    def show(state: RunProgress) -> None:
        seen.append(state)
        threads.add(threading.get_ident())

    wait_for(runner.run("steps", {"count": 40, "seconds": 0.01}, progress=show))
    fractions = [state.fraction for state in seen if not state.ahead]
    assert len(fractions) >= 2
    assert fractions == sorted(fractions)
    assert (seen[-1].fraction, seen[-1].done, seen[-1].total) == (1.0, 40, 40)
    assert threads == {threading.get_ident()}
    assert seen[-1].rate > 0
    assert (middle := rated(50, 100, 2.5)) == RunProgress(0.5, 20.0, 50, 100)
    assert middle.left == 2.5
    assert RunProgress(0, 0, 0, 100).left is None


def test_a_page_that_fails_does_not_end_its_run(runner: Runner, caplog: pytest.LogCaptureFixture) -> None:
    """An exception in the function that shows the progress is logged, and the result comes."""

    def broken(_: RunProgress) -> None:
        raise RuntimeError("gone")

    assert wait_for(runner.run("steps", {"count": 3, "seconds": 0.06}, progress=broken)) > 0
    assert "progress of a run" in caplog.text


@pytest.mark.parametrize("event", [threading.Event, asyncio.Event])
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("steps", {"count": 10**9, "seconds": 0.01}),
        ("stubborn", {}),
        ("montecarlo", {"truth": MODEL, "steps": 2000, "runs": 10**8, "seed": 1}),
    ],
)
def test_a_run_that_is_cancelled_stops_at_its_next_report(
    runner: Runner, monkeypatch: pytest.MonkeyPatch, event: Any, name: str, arguments: dict[str, Any]
) -> None:
    """Also one that tries again after every failure; its process is kept."""
    monkeypatch.setattr(worker, "PATIENCE", 60.0)  # nothing is killed because the machine is busy

    async def work() -> None:
        before = (await runner.run("identity", {}))["pid"]
        begun, cancel = asyncio.Event(), event()
        task = asyncio.ensure_future(
            runner.run(name, arguments, cancel=cancel, progress=lambda state: begun.set() if state.done else None)
        )
        await begun.wait()
        cancel.set()
        with pytest.raises(RunFailed, match=f"^{name}: cancelled") as caught:
            await task
        assert caught.value.kind == "cancelled"
        assert (await runner.run("identity", {}))["pid"] == before

    wait_for(work())


@pytest.mark.parametrize("event", [threading.Event, asyncio.Event])
def test_a_run_that_is_cancelled_and_tells_nothing_is_killed(runner: Runner, event: Any, tmp_path: Path) -> None:
    """The next run has another process."""

    async def work() -> None:
        before = (await runner.run("identity", {}))["pid"]
        cancel, gate = event(), Gate(tmp_path)
        task = asyncio.ensure_future(runner.run("silent", gate.arguments, cancel=cancel))
        await gate.entered()
        cancel.set()
        with pytest.raises(RunFailed, match=r"^silent: cancelled$") as caught:
            await task
        assert caught.value.kind == "cancelled"
        assert (await runner.run("identity", {}))["pid"] != before

    wait_for(work())


def test_a_task_that_is_cancelled_cancels_its_run(runner: Runner, tmp_path: Path) -> None:
    """A page that goes away leaves no run behind."""

    async def work() -> None:
        gate = Gate(tmp_path)
        task = asyncio.ensure_future(runner.run("silent", gate.arguments))
        await gate.entered()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        while runner._running:
            await asyncio.sleep(0.02)

    wait_for(work())


def test_the_loop_is_not_held_up(runner: Runner, tmp_path: Path) -> None:
    """The run that ends when the loop lets it would not end otherwise; and its result is unpickled in another thread."""

    async def work() -> None:
        gate = Gate(tmp_path)
        task = asyncio.ensure_future(runner.run("silent", gate.arguments))
        await gate.entered()
        assert not task.done()
        gate.open()
        await task
        assert (await runner.run("received", {})).thread not in {0, threading.get_ident()}

    wait_for(work())


def test_a_run_has_a_time(runner: Runner, tmp_path: Path) -> None:
    """A run longer than its cap is ended, and says so in one line; its process is gone."""

    async def work() -> None:
        before = (await runner.run("identity", {}))["pid"]
        with pytest.raises(
            RunFailed, match=r"^silent: expected at most 0.3 s, received a run that takes longer; it was ended$"
        ) as caught:
            await runner.run("silent", Gate(tmp_path).arguments, seconds=0.3)
        assert caught.value.kind == "time"
        assert (await runner.run("identity", {}))["pid"] != before

    wait_for(work())


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


def test_waiting_runs_know_how_many_are_ahead_and_can_be_cancelled(runner: Runner, tmp_path: Path) -> None:
    """With both processes taken a run waits, says so, and leaves the queue when it is cancelled, before they are free."""

    async def work() -> None:
        gates = {session: Gate(tmp_path, session) for session in "ab"}
        busy = [asyncio.ensure_future(runner.run("silent", g.arguments, session=s)) for s, g in gates.items()]
        for gate in gates.values():
            await gate.entered()
        seen: list[RunProgress] = []
        told, cancel = asyncio.Event(), asyncio.Event()

        def show(state: RunProgress) -> None:
            seen.append(state)
            told.set()

        late = asyncio.ensure_future(runner.run("double", {"x": 1}, session="c", progress=show, cancel=cancel))
        await told.wait()
        assert [state.ahead for state in seen] == [1]
        cancel.set()
        with pytest.raises(RunFailed, match="double: cancelled before it began"):
            await late
        assert not any(task.done() for task in busy)
        for gate in gates.values():
            gate.open()
        await asyncio.gather(*busy)

    wait_for(work())


def test_a_session_with_many_runs_does_not_keep_others_waiting(runner: Runner, tmp_path: Path) -> None:
    """Five runs of one session leave a process for another's, which ends before the first of them does."""

    async def work() -> None:
        gates = [Gate(tmp_path, str(i)) for i in range(5)]
        greedy = [asyncio.ensure_future(runner.run("silent", g.arguments, session="greedy")) for g in gates]
        await gates[0].entered()
        assert await runner.run("double", {"x": 2}, session="modest") == 4
        assert [gate.begun.exists() for gate in gates] == [True, False, False, False, False]
        for gate in gates:
            gate.open()
        await asyncio.gather(*greedy)

    wait_for(work())


def test_the_next_process_goes_to_who_has_fewest_and_waited_longest() -> None:
    """The rule itself, without processes: fewest running, then served longest ago, then first come."""
    runner = Runner(TABLE, size=3)
    jobs = {name: Job("double", {}, name[0], 1.0, lambda _: None) for name in ("a1", "a2", "a3", "b1", "c1")}
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


def test_never_more_processes_than_allowed(runner: Runner, tmp_path: Path) -> None:
    """Six sessions at once are served by two processes, at the same time."""

    async def work() -> set[int]:
        gates = [Gate(tmp_path, str(i)) for i in range(6)]
        tasks = [asyncio.ensure_future(runner.run("silent", g.arguments, session=str(i))) for i, g in enumerate(gates)]
        for gate in gates[:2]:
            await gate.entered()
        assert [gate.begun.exists() for gate in gates] == [True, True, False, False, False, False]
        for gate in gates:
            gate.open()
        return set(await asyncio.gather(*tasks))

    assert len(wait_for(work())) == 2
    assert len(runner._idle) <= 2


def test_closing_ends_everything(tmp_path: Path) -> None:
    """Running and waiting runs are cancelled, no process is left, and nothing new begins."""
    runner = Runner(TABLE, size=1, warm=())

    async def work() -> None:
        gates = [Gate(tmp_path, session) for session in "ab"]
        tasks = [asyncio.ensure_future(runner.run("silent", g.arguments, session=g.begun.stem)) for g in gates]
        await gates[0].entered()
        process = runner._running[0].process
        assert process is not None
        await asyncio.to_thread(runner.close)
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
from ctlabs.workbench.runs.worker import Runner
from tests.workbench.test_worker import TABLE

async def main():
    runner = Runner(TABLE, size=1, warm=())
    print((await runner.run("identity", {}))["pid"], flush=True)
    await runner.run("silent", {"begun": sys.argv[1], "gate": sys.argv[2]})

if __name__ == "__main__":
    asyncio.run(main())
"""


def test_a_killed_server_leaves_no_process(tmp_path: Path) -> None:
    """The process of a run ends when its server is killed, even in the middle of the run."""
    script = tmp_path / "server.py"
    script.write_text(textwrap.dedent(_SERVER))
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": root, "PYTHONWARNINGS": "error"}
    gate = Gate(tmp_path)
    command = [sys.executable, str(script), *gate.arguments.values()]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    pid = int(server.stdout.readline())
    asyncio.run(gate.entered())
    server.send_signal(signal.SIGKILL)
    server.wait(60)
    server.stdout.close()
    end = time.monotonic() + 60
    while _alive(pid):
        assert time.monotonic() < end, "the process of the run goes on without its server"
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")  # a dead process that nobody has waited for
    return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"
