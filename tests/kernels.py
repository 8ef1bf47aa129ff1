"""The numerical tests under each of OpenBLAS's kernels that this processor can run, and under the first with two threads.

    python tests/kernels.py [--brief] [options of pytest]

A kernel decides in which order sums are rounded, so a number that is right under one and wrong under another was never
right. OpenBLAS takes the one of the processor; ``OPENBLAS_CORETYPE`` names another. A kernel is asked for in a process
of its own, which an instruction that the processor does not have ends; such kernels are left out, and named. Two threads
share out a large product by one rule for all kernels, so that they are tried with the first of them.

``--brief`` is for `make check`: the processor's own kernel with one thread is left to `make test`, which runs the same tests
under it, and with two threads it is the one that is tried; each kernel takes half of the cases of every parametrised test, two
kernels together all of them.

The numerical tests are the files with the line ``pytestmark = pytest.mark.numerical``; of hypothesis's examples the
first few are run. Files whose numbers come from compiled loops alone (fits, diagnoses) need no mark: no kernel is asked.
"""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
KERNELS = ("Haswell", "SkylakeX", "Sandybridge", "Nehalem")
EXAMPLES = 3
#: Processes at a time: in brief there are three, and two of them on two processors would leave one idle for the third.
TOGETHER = 3
MARK = "pytestmark = pytest.mark.numerical"
#: Uses products and factors of numpy's and scipy's OpenBLAS, and says which kernels these are.
PROBE = """
import numpy as np, scipy.linalg, threadpoolctl
A = np.arange(900.0).reshape(30, 30) % 7 + 30 * np.eye(30)
np.linalg.solve(A @ A, A), scipy.linalg.lu_factor(A)
print(*sorted({lib["architecture"] for lib in threadpoolctl.threadpool_info() if lib["internal_api"] == "openblas"}))
"""


def environment(kernel: str, threads: int) -> dict[str, str]:
    """The variables that choose a kernel (none: the processor's own) and the number of its threads."""
    count, others = str(threads), {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"}
    chosen = {"OPENBLAS_CORETYPE": kernel} if kernel else {}
    return others | chosen | {"OPENBLAS_NUM_THREADS": count, "OMP_NUM_THREADS": count}


def asked(kernel: str) -> subprocess.CompletedProcess[str]:
    """A process that uses a kernel and prints its name."""
    command = [sys.executable, "-c", PROBE]
    return subprocess.run(command, env=environment(kernel, 1), capture_output=True, text=True, check=False)


def hindrance(kernel: str) -> str:
    """Why a kernel cannot be tried here; empty if it can."""
    probe = asked(kernel)
    if probe.returncode < 0:
        return f"this processor cannot run it ({signal.Signals(-probe.returncode).name})"
    if probe.returncode:
        return probe.stderr.strip().splitlines()[-1]
    took = probe.stdout.strip()
    return "" if took == kernel else f"numpy and scipy took {took or 'no OpenBLAS'} for it"


def files() -> list[str]:
    """Those whose numbers come from OpenBLAS."""
    return sorted(str(file) for file in HERE.rglob("test_*.py") if MARK in file.read_text(encoding="utf-8"))


def run(kernel: str, threads: int, options: list[str]) -> bool:
    """Whether the numerical tests pass under a kernel; what pytest said is printed."""
    command = [sys.executable, "-m", "pytest", "-q", "-n0", "-m", "numerical and not slow", f"--examples={EXAMPLES}"]
    done = subprocess.run(
        [*command, "-p", "no:cacheprovider", *options, *files()],
        env=environment(kernel, threads), cwd=HERE.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    printed = (done.stdout + done.stderr).strip()
    print(f"{kernel}, {threads} thread{'s' * (threads > 1)}: {printed.splitlines()[-1]}", flush=True)
    if done.returncode:
        print(printed, flush=True)
    return done.returncode == 0


def jobs(tried: list[str], own: str, *, brief: bool) -> list[tuple[str, int]]:
    """The kernels, and with how many threads each is tried.

    >>> jobs(["Haswell", "Nehalem"], "Haswell", brief=False)
    [('Haswell', 1), ('Nehalem', 1), ('Haswell', 2)]
    >>> jobs(["Haswell", "Nehalem"], "Nehalem", brief=True)
    [('Haswell', 1), ('Nehalem', 2)]
    """
    if not brief:
        return [*((kernel, 1) for kernel in tried), *((kernel, 2) for kernel in tried[:1])]
    return [*((kernel, 1) for kernel in tried if kernel != own), (own if own in tried else tried[0], 2)]


def main(options: list[str]) -> int:
    """Try every kernel; 1 if a test failed, or if no kernel could be tried."""
    brief, tried = "--brief" in options, []
    options = [option for option in options if option != "--brief"]
    for kernel in KERNELS:
        if why := hindrance(kernel):
            print(f"{kernel}: skipped, {why}", flush=True)
        else:
            tried.append(kernel)
    if not tried:
        return 1
    own = asked("").stdout.strip()
    if brief:
        print(f"{own}, 1 thread: the processor's own, left to make test", flush=True)
    with ThreadPoolExecutor(TOGETHER) as pool:
        share = [[f"--share={i % 2}/2"] if brief else [] for i in range(len(KERNELS) + 1)]
        todo = zip(jobs(tried, own, brief=brief), share, strict=False)
        passed = list(pool.map(lambda job: run(*job[0], [*job[1], *options]), todo))
    return int(not all(passed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
