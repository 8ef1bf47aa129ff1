"""People's files: models, records, exports."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.files.clock import timed
    from ctlabs.files.reading import read_model, read_record, read_records

_HOME = {
    "read_model": "reading",
    "read_record": "reading",
    "read_records": "reading",
    "timed": "clock",
}

__all__ = [
    "read_model",
    "read_record",
    "read_records",
    "timed",
]

__getattr__ = front(__name__, _HOME)
