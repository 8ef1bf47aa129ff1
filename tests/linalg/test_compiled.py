"""Loops run without a compiler, and give the same numbers."""

import json
import os
import subprocess
import sys
from contextlib import redirect_stdout
from functools import cache
from io import StringIO

import numpy as np
import pytest

#: A filter with a gap and correlated noises, a perfect measurement, a vague start, a smoother and an experiment; a record that needs
#: square roots, also with noises that correlate, perfect measurements of what is known, a record so long that its covariances rest, the
#: slopes of a likelihood, and what a record says of jumps.
PROGRAM = """
import json
import numpy as np
from ctlabs import DiscreteModel, kalman_filter, monte_carlo, smooth, steady_state
from ctlabs.filtering.disturbances import shocks
from ctlabs.filtering.problem import pose
from ctlabs.filtering.slopes import slopes
m = DiscreteModel([[1, .1], [0, 1]], [[.01, 0], [0, .1]], [[1, 0]], [[1]], P0=10 * np.eye(2), N=[[.05], [0]])
found = kalman_filter(m, [5, 5, np.nan, 5, 4])
whole = smooth(m, found)
perfect = DiscreteModel([[0.5, 1], [0, 1]], [[0, 0], [0, 1]], [[1, 0]], [[0]], x0=[1, 0], P0=[[0, 0], [0, 1]])
vague = DiscreteModel([[1, 1], [0, 1]], [[.1, 0], [0, .1]], [[1, 0]], [[1]], P0=[[np.inf, 0], [0, np.inf]])
stats = monte_carlo(m, steps=5, runs=50, seed=1, progress=False)
slope = slopes(pose(m, [5, 5, np.nan, 5, 4]))
told = shocks(found)
fine = DiscreteModel([[1, 1], [0, 1]], 1e-3 * np.eye(2), [[1, 0]], [[1e-13]], P0=np.eye(2))
roots = kalman_filter(fine, [1, 2, np.nan, 1, 2])
assert roots.algorithm == "array", roots.algorithm
known = DiscreteModel([[1, 1], [0, 1]], np.zeros((2, 2)), [[1, 0]], [[0]], x0=[1 / 3, 1 / 7], P0=np.zeros((2, 2)))
wrong = kalman_filter(known, [1 / 3 + 1 / 7, 2, 1 / 3 + 3 / 7])
assert [each.row for each in wrong.contradictions] == [1], wrong.contradictions
still = DiscreteModel(np.eye(2), np.zeros((2, 2)), [[1, 0], [1, 1]], np.zeros((2, 2)), x0=[1, 0], P0=np.eye(2))
torn = kalman_filter(still, [[1 / 3, 1 / 7], [1 / 3, 2], [1 / 3, 1 / 7]])
assert [each.row for each in torn.contradictions] == [1], torn.contradictions
apart = kalman_filter(DiscreteModel([[1, 1], [0, 1]], 1e-3 * np.eye(2), [[1, 0], [0, 1]], 1e-13 * np.eye(2), P0=np.eye(2),
                                    N=1e-9 * np.eye(2)), [[1, 2], [np.nan, 1], [2, 1], [1, 1]])
assert apart.algorithm == "array", apart.algorithm
long = kalman_filter(m, 5 + np.sin(np.arange(300.0)))
back = smooth(m, long)
parts = [slope.Phi, slope.Qd, slope.H, slope.R, slope.x0, slope.P0, told.outlier, told.outlier_size, told.shock, told.shock_size,
         roots.P_plus, roots.x_plus, [each.innovation for each in wrong.contradictions],
         [each.allowed for each in wrong.contradictions],
         torn.x_plus, [each.allowed for each in torn.contradictions], apart.x_plus, apart.P_plus, long.x_plus, long.P_plus, back.x, back.P,
         found.x_plus, found.P_plus, found.K, [found.log_likelihood], whole.x, whole.P,
         smooth(perfect, [1, 2, 4]).x,
         smooth(vague, [1, 2, 4]).x, smooth(m, [5, 5, 5, 4], lag=1).x, steady_state(m).P_plus, stats.rms, stats.nees]
print(json.dumps([float(x) for part in parts for x in np.ravel(part)]))
"""
#: Run before it, numba is not installed.
WITHOUT = """
import importlib.util, sys
sys.modules["numba"] = None
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == "numba" else find(name, *rest)
"""


def plain(program, **environment):
    """The numbers of a process that compiles nothing."""
    command, given = [sys.executable, "-c", program], {**os.environ, **environment}
    return np.array(json.loads(subprocess.run(command, capture_output=True, text=True, check=True, env=given).stdout))


@cache
def compiled():
    """The numbers of this process, which compiles or finds compiled what other tests need too."""
    with redirect_stdout(StringIO()) as said:
        exec(PROGRAM, {})
    return np.array(json.loads(said.getvalue()))


@pytest.mark.parametrize("how", ["without numba", "compiler switched off"])
def test_the_numbers_need_no_compiler(how):
    """Without numba, or with NUMBA_DISABLE_JIT=1, every loop runs as plain Python and gives the same numbers to 1e-12."""
    found = plain(WITHOUT + PROGRAM) if how == "without numba" else plain(PROGRAM, NUMBA_DISABLE_JIT="1")
    assert np.allclose(found, compiled(), rtol=1e-12, atol=1e-13, equal_nan=True)
