"""How long does what is no longer wanted go on? From the interrupt to the end, against the second that is promised.

    python benchmarks/interrupt.py

- **Ctrl-C**: an experiment with a checkpoint in a process of its own, on threads or on processes, until it has exited;
- **cancel**: a run of the workbench, until its page has the answer: an experiment, which tells how far it is and stops
  there, and a run that tells nothing, which is killed.

Medians; the exit status is 1 if one is beyond the second.
"""

from __future__ import annotations

import asyncio
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from timing import REPEATS

from ctlabs import DiscreteModel
from ctlabs.workbench.runs.worker import FUNCTIONS, RunFailed, Runner

LIMIT = 1.0
MODEL = DiscreteModel([[1, 1], [0, 1]], [[1, 0], [0, 1]], [[1, 0]], [[1]], x0=[0, 0], P0=[[10, 0], [0, 10]])
HOURS: dict[str, Any] = {"truth": MODEL, "steps": 1000, "runs": 10**8, "seed": 1}


def experiment(executor: str, folder: str) -> None:
    """What is interrupted: this file runs itself with these arguments."""
    from ctlabs import montecarlo

    try:
        montecarlo.monte_carlo(**HOURS, executor=executor, workers=2, checkpoint=folder, progress=False)
    except montecarlo.Interrupted:
        sys.exit(130)


def ctrl_c(executor: str) -> float:
    """Seconds from the interrupt to the end of the process."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen([sys.executable, __file__, executor, folder], start_new_session=True)
        while not list(Path(folder).glob("block-*.sums")):
            if process.poll() is not None:
                sys.exit(f"the experiment ended with {process.returncode} before it was interrupted")
            time.sleep(0.01)
        start = time.perf_counter()
        os.killpg(process.pid, signal.SIGINT)
        if process.wait(60) != 130:
            sys.exit(f"the interrupted experiment: expected the exit code 130, received {process.returncode}")
        return time.perf_counter() - start


async def cancelled(runner: Runner, name: str, arguments: dict[str, Any]) -> float:
    """Seconds from the cancelling of a run to the answer."""
    cancel = asyncio.Event()
    task = asyncio.ensure_future(runner.run(name, arguments, cancel=cancel))
    await asyncio.sleep(0.5)  # it is in the middle of its work
    start = time.perf_counter()
    cancel.set()
    try:
        await task
    except RunFailed as why:
        if why.kind != "cancelled":
            raise
    return time.perf_counter() - start


async def cancels(name: str, arguments: dict[str, Any]) -> list[float]:
    """Of several runs, one after the other."""
    runner = Runner({**FUNCTIONS, "silent": "timeit:timeit"}, size=1)
    try:
        times = []
        for _ in range(REPEATS):
            await runner.run("silent", {"number": 1})  # the process is there and loaded
            times.append(await cancelled(runner, name, arguments))
        return times
    finally:
        runner.close()


def main() -> int:
    rows = {f"Ctrl-C, {executor}": [ctrl_c(executor) for _ in range(REPEATS)] for executor in ("threads", "processes")}
    rows["cancel, an experiment"] = asyncio.run(cancels("montecarlo", HOURS))
    rows["cancel, a run that tells nothing"] = asyncio.run(cancels("silent", {"number": 10**12}))
    for name, times in rows.items():
        found = statistics.median(times)
        print(f"{name:<34} {found:6.2f} s   at most {LIMIT:g}   {'' if found <= LIMIT else 'MISSED'}")
    return int(any(statistics.median(times) > LIMIT for times in rows.values()))


if __name__ == "__main__":
    sys.exit(experiment(*sys.argv[1:]) if sys.argv[1:] else main())
