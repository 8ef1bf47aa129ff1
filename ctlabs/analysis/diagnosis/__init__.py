"""Do the data speak against the model? Rows, R and Qd, constants, the initial estimate: what to change.

``verdict`` puts together what the others find: ``consistency`` and ``independence`` of the innovations, single ``rows``, ``repeats`` of
one value, ``candidates`` for changes of the model; ``wording`` says it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.analysis.diagnosis.candidates import Candidate, Event, constants, scaled
    from ctlabs.analysis.diagnosis.consistency import Innovations, innovations, p_values
    from ctlabs.analysis.diagnosis.independence import Whiteness, whiteness
    from ctlabs.analysis.diagnosis.verdict import LONG, Diagnosis, diagnose, tests_of

_HOME = {
    "LONG": "verdict",
    "Candidate": "candidates",
    "Diagnosis": "verdict",
    "Event": "candidates",
    "Innovations": "consistency",
    "Whiteness": "independence",
    "constants": "candidates",
    "diagnose": "verdict",
    "innovations": "consistency",
    "p_values": "consistency",
    "scaled": "candidates",
    "tests_of": "verdict",
    "whiteness": "independence",
}

__all__ = [
    "LONG",
    "Candidate",
    "Diagnosis",
    "Event",
    "Innovations",
    "Whiteness",
    "constants",
    "diagnose",
    "innovations",
    "p_values",
    "scaled",
    "tests_of",
    "whiteness",
]

__getattr__ = front(__name__, _HOME)
