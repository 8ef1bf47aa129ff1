"""The clock of a record, which is :func:`ctlabs.files.timed`."""

from ctlabs.files.clock import timed

__all__ = ["timed"]
