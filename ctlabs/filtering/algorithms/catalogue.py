"""Every form of the filter by its name."""

from __future__ import annotations

from ctlabs.filtering.algorithms import (
    array,
    carlson,
    conventional,
    extended_array,
    information,
    joseph,
    ld,
    potter,
    sequential,
    srif,
    steady,
    ud,
)
from ctlabs.filtering.algorithms.contract import Form

#: Every form by its name.
FORMS: dict[str, Form] = {
    "conventional": conventional,
    "joseph": joseph,
    "information": information,
    "sequential": sequential,
    "potter": potter,
    "carlson": carlson,
    "array": array,
    "extended_array": extended_array,
    "ud": ud,
    "ld": ld,
    "srif": srif,
    "steady": steady,
}


def form(name: str, *others: str) -> Form:
    """The form of a name; ``others`` are names that are taken elsewhere and stand in the refusal only."""
    if name not in FORMS:
        msg = f"algorithm: expected one of {', '.join((*others, *FORMS))}, received {name!r}"
        raise ValueError(msg)
    return FORMS[name]
