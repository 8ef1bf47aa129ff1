"""The labs: the catalogue, the sheets, the frame of a report, the standard experiment, the portrait of a filter."""

from ctlabs.labs.sheets import sheet

__all__ = ["sheet"]
