"""A random field of a stochastic partial differential equation: model, stability, and filters for any length.

:func:`filter_dense` runs the published equations through :func:`ctlabs.kalman_filter`; :func:`filter_exact` gives the same
numbers by the structure of the matrices; :func:`filter_local` filters a long field at a cost proportional to its length.
"""

from ctlabs.filtering.fields.filters import FieldEstimate, filter_dense, filter_exact
from ctlabs.filtering.fields.local import filter_local
from ctlabs.models.field.model import RandomField, measure

__all__ = ["FieldEstimate", "RandomField", "filter_dense", "filter_exact", "filter_local", "measure"]
