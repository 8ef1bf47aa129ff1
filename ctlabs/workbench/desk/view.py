"""How figures are looked at: what of each axis, and which of them over logarithmic axes. All parts of a page share it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class View:
    """What is chosen for all figures.

    ``reach`` : what is shown of a horizontal axis, by its label, where it is not all · ``log`` : whether a figure's vertical axes are
    logarithmic, by its name, where somebody has chosen
    """

    reach: dict[str, tuple[float, float]] = field(default_factory=dict)
    log: dict[str, bool] = field(default_factory=dict)

    def zoom(self, label: str, reach: tuple[float, float] | None) -> bool:
        """Show this of the axis, or all; whether it was another part before."""
        before = self.reach.pop(label, None)
        if reach is not None:
            self.reach[label] = reach
        return before != reach

    def within(self, label: str, begin: float, end: float) -> None:
        """Forget a part that is outside of what there is now."""
        reach = self.reach.get(label)
        if reach is not None and not (reach[0] < end and reach[1] > begin):
            del self.reach[label]


def zoomed(event: Mapping[str, Any]) -> tuple[tuple[float, float] | None] | None:
    """What an event of plotly's says of the horizontal axis: a reach, or none for all of it; ``None`` where it says nothing of it.

    >>> zoomed({"xaxis.range[0]": 1, "xaxis.range[1]": 2.5}), zoomed({"xaxis.autorange": True}), zoomed({"dragmode": "pan"})
    (((1.0, 2.5),), (None,), None)
    """
    ends: list[Any] = [event.get(f"xaxis.range[{i}]") for i in (0, 1)]
    whole = event.get("xaxis.range")
    ends = whole if isinstance(whole, list) and len(whole) == 2 else ends
    if all(isinstance(end, int | float) for end in ends) and ends[0] < ends[1]:
        return ((float(ends[0]), float(ends[1])),)
    return (None,) if event.get("xaxis.autorange") else None
