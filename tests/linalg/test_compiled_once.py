"""Processes that start together where nothing is compiled yet compile once between them."""

import os
import subprocess
import sys

import pytest

from ctlabs.linalg import compiled

#: Says what it compiled and what it found compiled; everything is loaded before it begins, which it is told to.
PROGRAM = """
import sys
import numpy as np
from ctlabs.linalg.loops import distilled
print("ready", flush=True)
sys.stdin.readline()
distilled(np.ones(3), 3, 2)
print(sum(distilled.stats.cache_misses.values()), sum(distilled.stats.cache_hits.values()))
"""


@pytest.mark.skipif(sys.platform == "win32" or not compiled.COMPILED, reason="needs a compiler, and files with locks")
def test_one_process_compiles_and_the_other_finds_it(tmp_path):
    """Both ask at the same moment: the second waits, and loads what the first has kept."""
    given = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | {"XDG_CACHE_HOME": str(tmp_path)}
    if sys.platform == "darwin":
        given["HOME"] = str(tmp_path)
    pipe = subprocess.PIPE
    both = [subprocess.Popen([sys.executable, "-c", PROGRAM], env=given, stdin=pipe, stdout=pipe, text=True) for _ in range(2)]
    for process in both:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in both:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    assert sorted(process.communicate()[0].split() for process in both) == [["0", "1"], ["1", "0"]]
