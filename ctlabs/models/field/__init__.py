"""A random field along a line, as a model."""

from ctlabs.models.field.model import RandomField, measure

__all__ = ["RandomField", "measure"]
