r"""Several filters on the same data, and how clearly their errors differ."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.filtering.extended import EnsembleFilter
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array


class Together:
    """Several filters on the same data as one design, so that their errors can be compared run by run.

    Its estimate stacks theirs and it claims no covariance. With ``compare=np.vstack([E, E])`` the statistics of
    :func:`ctlabs.montecarlo.monte_carlo` hold the covariances between the errors of different filters too, which :func:`paired`
    needs.

    Parameters
    ----------
    filters : objects that make up a :class:`ctlabs.filtering.extended.EnsembleFilter`, not started
    """

    P = None

    def __init__(self, *filters: EnsembleFilter) -> None:
        self.filters = filters

    @property
    def x(self) -> Array:
        """All estimates, (d1 + d2 + …, runs)."""
        return np.concatenate([each.x for each in self.filters])

    def start(self, runs: int) -> None:
        """Begin ``runs`` records with every filter."""
        for each in self.filters:
            each.start(runs)

    def predict(self, k: int) -> None:
        """From k−1 to k."""
        for each in self.filters:
            each.predict(k)

    def update(self, k: int, z: Array) -> None:
        """The same data to all; their normalised innovations are not comparable and not returned."""
        for each in self.filters:
            each.update(k, z)


def paired(second_moment: ArrayLike, runs: int) -> Array:
    r"""How clearly the mean squares of two filters differ on the same data, in standard errors; > 0: the first is larger.

    .. math:: \frac{\overline{e_1^2} - \overline{e_2^2}}
              {\sqrt{2(s_{11}^2 + s_{22}^2 - 2s_{12}^2)/\text{runs}}},\quad s_{ij} = \overline{e_ie_j}

    Parameters
    ----------
    second_moment : (…, 2d, 2d), averages of e eᵀ, with d errors of the first filter before d of the second
    runs : how many

    Returns
    -------
    (…, d). The standard error is that of errors that are nearly Gaussian. Where both errors are the same: 0.

    >>> paired([[2.0, 1.0], [1.0, 1.0]], 600).round(6)
    array([10.])
    """
    moments = checks.array("second_moment", second_moment)
    if moments.ndim < 2 or moments.shape[-1] != moments.shape[-2] or moments.shape[-1] % 2:
        msg = f"second_moment: expected shape (…, 2d, 2d), received {moments.shape}"
        raise ValueError(msg)
    d = moments.shape[-1] // 2
    first, second = (np.diagonal(moments, axis1=-2, axis2=-1)[..., part] for part in (slice(d), slice(d, None)))
    cross = np.diagonal(moments[..., :d, d:], axis1=-2, axis2=-1)
    variance = 2 * (first**2 + second**2 - 2 * cross**2) / checks.count("runs", runs)
    same = variance <= 64 * np.finfo(float).eps * first**2
    return np.asarray(np.where(same, 0.0, (first - second) / np.sqrt(np.where(same, 1.0, variance))))
