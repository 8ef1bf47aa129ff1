"""Numbers at logarithmic axes."""

from __future__ import annotations

from matplotlib.ticker import LogFormatterSciNotation

#: Numbers between these are written out.
PLAIN = (1e-3, 1e5)


class ShortLogTicks(LogFormatterSciNotation):
    """Powers of ten, as usual; on an axis of less than two decades 0.9 and 2, not 9×10⁻¹ and 2×10⁰."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The text at a tick; empty where there is no room for it."""
        text: str = super().__call__(x, pos)
        if self.axis is None:
            return text
        low, high = sorted(self.axis.get_view_interval())
        short = high < 100 * low and PLAIN[0] <= low and high < PLAIN[1]
        return f"{x:.4g}" if text and short else text
