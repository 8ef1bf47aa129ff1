"""How every example of the gallery begins: with the style of the reports' figures, and no figure open."""

from __future__ import annotations

from pathlib import Path

import ctlabs


def styled(_conf: object, _name: str) -> None:
    """What sphinx-gallery calls before each example."""
    import matplotlib.pyplot as plt

    plt.close("all")
    plt.rcdefaults()
    plt.style.use([str(path) for path in (Path(ctlabs.__file__).parent / "reporting/plots").glob("*.mplstyle")])
    plt.rcParams["figure.figsize"], plt.rcParams["figure.dpi"] = (7, 3.6), 110
