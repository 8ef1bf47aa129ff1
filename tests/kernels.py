"""The numerical tests under each of OpenBLAS's kernels that this processor can run, and under the first with two threads.

    python tests/kernels.py [options of pytest]

A kernel decides in which order sums are rounded, so a number that is right under one and wrong under another was never
right. OpenBLAS takes the one of the processor; ``OPENBLAS_CORETYPE`` names another. A kernel is asked for in a process
of its own, which an instruction that the processor does not have ends; such kernels are left out, and named. Two threads
share out a large product by one rule for all kernels, so that they are tried with the first of them.

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
#: Processes at a time.
TOGETHER = 2
MARK = "pytestmark = pytest.mark.numerical"
#: Uses products and factors of numpy's and scipy's OpenBLAS, and says which kernels these are.
PROBE = """
import numpy as np, scipy.linalg, threadpoolctl
A = np.arange(900.0).reshape(30, 30) % 7 + 30 * np.eye(30)
np.linalg.solve(A @ A, A), scipy.linalg.lu_factor(A)
print(*sorted({lib["architecture"] for lib in threadpoolctl.threadpool_info() if lib["internal_api"] == "openblas"}))
"""


def environment(kernel: str, threads: int) -> dict[str, str]:
    """The variables that choose a kernel and the number of its threads."""
    count = str(threads)
    return {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": count, "OMP_NUM_THREADS": count}


def hindrance(kernel: str) -> str:
    """Why a kernel cannot be tried here; empty if it can."""
    probe = subprocess.run(
        [sys.executable, "-c", PROBE], env=environment(kernel, 1), capture_output=True, text=True, check=False
    )
    if probe.returncode < 0:
        return f"this processor cannot run it ({signal.Signals(-probe.returncode).name})"
    if probe.returncode:
        return probe.stderr.strip().splitlines()[-1]
    took = probe.stdout.strip()
    return "" if took == kernel else f"numpy and scipy took {took or 'no OpenBLAS'} for it"


def files() -> list[str]:
    """Those whose numbers come from OpenBLAS."""
    return sorted(str(file) for file in HERE.glob("test_*.py") if MARK in file.read_text(encoding="utf-8"))


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


def main(options: list[str]) -> int:
    """Try every kernel; 1 if a test failed, or if no kernel could be tried."""
    tried = []
    for kernel in KERNELS:
        if why := hindrance(kernel):
            print(f"{kernel}: skipped, {why}", flush=True)
        else:
            tried.append(kernel)
    with ThreadPoolExecutor(TOGETHER) as pool:
        passed = pool.map(lambda job: run(*job, options), [*((kernel, 1) for kernel in tried), *((kernel, 2) for kernel in tried[:1])])
    return int(not tried or not all(passed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
