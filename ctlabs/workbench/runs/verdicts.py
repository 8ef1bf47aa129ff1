"""What an experiment says of its filter, in sentences that need no statistics to be read."""

from __future__ import annotations

import math

import numpy as np

from ctlabs.text import number
from ctlabs.workbench.runs.outcomes import Outcome

#: p-values from which on nothing is remarkable, and below which a result speaks against the model.
USUAL, RARE = 0.05, 0.01


def in_words(p: float) -> str:
    """A p-value: what it means, and how often chance alone gives a right model a result so far out or farther.

    >>> for p in (0.62, 0.03, 2e-4, 0.0):
    ...     print(in_words(p))
    nothing unusual, 6 in 10 by chance
    rare, 1 in 33 by chance
    against the model, 1 in 5000 by chance
    against the model, less than 1 in a million by chance
    """
    if math.isnan(p):
        return "too few to tell"
    if p >= USUAL:
        return f"nothing unusual, {max(round(10 * p), 1)} in {10 if p >= 0.1 else round(1 / p)} by chance"
    kind = "rare" if p >= RARE else "against the model"
    return f"{kind}, less than 1 in a million by chance" if p < 1e-6 else f"{kind}, 1 in {_round(1 / p)} by chance"


def diagnosis(found: Outcome) -> list[str]:
    """What the experiment says of the filter: first whether it may be believed, then on what that rests."""
    lines = [found.contradiction] if found.contradiction else []
    lines += [line for line in (believed(found), share(found)) if line]
    told = found.verdict
    if told is None:
        return lines
    where = "Of the record" if found.kind == "data" else "Of run 1"
    said = "within" if told.nis_low <= told.nis_mean <= told.nis_high else "outside"
    lines.append(
        f"{where} the mean NIS is {number(told.nis_mean, 3)}, {said} its 95 % band {number(told.nis_low, 3)} to "
        f"{number(told.nis_high, 3)} around {number(told.nis_expected, 3)} ({_chance(told.nis_p)})."
    )
    if told.suggestion:  # first what speaks against the model, then the size of what does
        lines.insert(len(lines) - 1, f"{told.suggestion[0].upper()}{told.suggestion[1:].rstrip('.')}.")
    return lines


def believed(found: Outcome) -> str:
    r"""Whether the errors of simulated runs are as large as the filter claims, and by what factor not: :math:`\sqrt{\text{NEES}/n}`.

    The band is that of each instant, averaged: as if all were alike, so that it is rather too wide.
    """
    stats = found.statistics
    if stats is None:
        return ""
    there = (stats.nees_dof > 0) & np.isfinite(stats.nees)
    if not there.any():
        return ""
    mean, expected = float(stats.nees[there].mean()), float(stats.nees_dof[there].mean())
    low, high = (float(edge[there].mean()) for edge in stats.nees_band)
    size = f"mean NEES {number(mean, 3)}, a right filter's is within {number(low, 3)} to {number(high, 3)}"
    if low <= mean <= high:
        return f"Consistent: the errors are as large as the filter claims ({size})."
    factor = math.sqrt(mean / expected)
    if mean > high:
        return f"Overconfident: the errors are {number(factor, 3)} times as large as the filter claims ({size})."
    by = number(1 / factor, 3) if factor > 0 else "infinitely many"
    return f"Too cautious: the filter claims errors {by} times as large as they are ({size})."


def share(found: Outcome) -> str:
    """How many of the RMS errors are outside their bands, and whether chance alone puts so many there."""
    stats = found.statistics
    if stats is None:
        return ""
    own = stats.outside
    if own is not None:
        begin = f"{_percent(own['value'])} of the RMS errors over {stats.runs} runs are outside their 95 % bands around theory"
        band = f"between {_percent(own['low'])} and {_percent(own['high'])}, for neighbouring errors leave their bands together"
        word = "more than chance gives" if own["value"] > own["high"] else "fewer than chance gives"
        word = "as it should be" if own["low"] <= own["value"] <= own["high"] else word
        return f"{begin}, {word}: a right theory has {band} ({_chance(own['p'])})."
    low, high = stats.rms_band
    there = np.isfinite(low) & np.isfinite(high) & (high > low * (1 + 1e-9))
    if not there.any():
        return ""
    value = float((there & ((stats.rms < low) | (stats.rms > high))).sum() / there.sum())
    return (
        f"{_percent(value)} of the RMS errors over {stats.runs} runs are outside their 95 % bands around the theory of this filter; "
        "about 5 % are by chance, or several times that where neighbouring errors leave their bands together."
    )


def _percent(value: float) -> str:
    return f"{100 * value:.1f} %"


def _chance(p: float) -> str:
    """A p-value in a sentence."""
    return "too few to tell" if math.isnan(p) else f"p = {number(p, 2)}: {in_words(p)}"


def _round(count: float) -> int:
    """Two digits."""
    size = 10 ** max(math.floor(math.log10(count)) - 1, 0)
    return int(round(count / size) * size)
