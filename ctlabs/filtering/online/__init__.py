r"""The filter for measurements that arrive one by one: now, late, at irregular times, or not at all.

:class:`Filter` carries any of :data:`ctlabs.filtering.algorithms.FORMS` from instant to instant:

.. math:: \hat x^- = \Phi\hat x^+ + c,\ P^- = \Phi P^+\Phi^T + Q_d, \qquad
          \hat x^+ = \hat x^- + K(z - H\hat x^-),\ P^+ = (I - KH)P^-

A measurement that belongs to the past is put in its place and what came after it is done again, so that the result is
that of the same measurements in order, to the bit. A filter is saved and loaded to the bit as well.
"""

from ctlabs.filtering.online.filter import Filter

__all__ = ["Filter"]
