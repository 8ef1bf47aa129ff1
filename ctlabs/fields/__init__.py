"""A random field of a stochastic partial differential equation: model, stability, and filters for any length.

:func:`filter_dense` runs the published equations through :mod:`ctlabs.kalman`; :func:`filter_exact` gives the same
numbers by the structure of the matrices; :func:`filter_local` filters a long field at a cost proportional to its length.
"""

from ctlabs.fields.filters import FieldEstimate, filter_dense, filter_exact
from ctlabs.fields.local import filter_local
from ctlabs.fields.model import RandomField, measure

__all__ = ["FieldEstimate", "RandomField", "filter_dense", "filter_exact", "filter_local", "measure"]
