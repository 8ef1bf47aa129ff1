r"""Units in which the elements of a system's matrices are near 1.

A model in the user's units may have elements from 1e-20 to 1e20. With :math:`x = \mathrm{diag}(s)\,\hat x` and time in units
of t its matrices become

.. math:: \hat A_{ij} = A_{ij}s_jt/s_i, \quad \hat W_{ij} = W_{ij}t/(s_is_j), \quad \hat J_{ij} = J_{ij}s_is_jt

(without t in discrete time), and s, t are chosen so that the logarithms of the elements that are not zero have the least sum of
squares (Curtis & Reid, J. Inst. Maths Applics 10, 1972). They are powers of 2, so that scaling rounds nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgebal

from ctlabs.linalg.checks import Array


class Units(NamedTuple):
    """Units of the states, (n,), and of time: powers of 2."""

    states: Array
    time: float


def balanced(A: Array, W: Array | None = None, J: Array | None = None, *, continuous: bool) -> Units:
    """The units of a transition A, a noise W of the states and an information J about them, (n, n) each.

    Of a discrete system the time is 1. Directions that no element speaks of keep the unit 1.

    >>> balanced(np.array([[0.0, 1e6], [0.0, 0.0]]), np.diag([0.0, 2.0**-40]), continuous=False)
    Units(states=array([1.00000000e+00, 9.53674316e-07]), time=1.0)
    """
    n = len(A)
    normal, right = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
    for M, row, column in ((A, -1, 1), (W, -1, -1), (J, 1, 1)):
        if M is None:
            continue
        # One equation log2|M_ij| + row·s_i + column·s_j + t = 0 for each element; the diagonal of A says nothing of s.
        mask = (M != 0).astype(float)
        logs = np.log2(np.abs(M), where=mask > 0, out=np.zeros((n, n)))
        both = row * column * mask
        normal[:n, :n] += np.diag(mask.sum(axis=1) + mask.sum(axis=0)) + both + both.T
        along = row * mask.sum(axis=1) + column * mask.sum(axis=0)
        normal[:n, n] += along
        normal[n, :n] += along
        normal[n, n] += mask.sum()
        right[:n] -= row * logs.sum(axis=1) + column * logs.sum(axis=0)
        right[n] -= logs.sum()
    size = n + 1 if continuous else n
    logs = np.zeros(n + 1)
    logs[:size] = np.linalg.lstsq(normal[:size, :size], right[:size], rcond=1e-12)[0].round()
    found = np.exp2(logs)
    return Units(found[:n], float(found[n]))


def even(A: Array) -> tuple[Array, Array]:
    """D⁻¹AD whose rows and columns have sizes that are as equal as powers of two make them, and the diagonal of D (LAPACK's gebal).

    ``scipy.linalg.matrix_balance`` warns where an element of D is beyond 2⁶³, for it takes it for a row's number.

    >>> even(np.array([[1.0, 2.0**90], [2.0**-90, 1.0]]))[0].tolist()
    [[1.0, 2.0], [0.5, 1.0]]
    """
    scaled, _, _, units, _ = dgebal(A, scale=1, permute=0)
    return scaled, units
