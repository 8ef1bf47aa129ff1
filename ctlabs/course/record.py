r"""A student's record of the experiment: errors of an estimate over many runs, held against the theory of that student's numbers.

A table in any form that :mod:`ctlabs.files` reads, beside ``answers.toml``, with a row for each run and instant:

.. code-block:: text

    run,i,error
    1,1,0.31
    1,2,-0.07

``error`` is x̂ − x (or there are columns ``estimate`` and ``truth``); ``i`` counts the elements of the variance that is tested, ``j`` its
states where it has several. A column may also have the name of an asked variance, whose errors it holds. For Gaussian errors of variance
:math:`P_i`, whatever the number n of runs,

.. math:: \sum e_i^2/P_i \sim \chi^2(n), \qquad \bar e_i/\sqrt{P_i/n} \sim N(0, 1)

and the worst of all these deviations is held against its own probability (Bonferroni's bound): a right record fails once in
:math:`10^5`, less than once in a hundred courses of thirty.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special

from ctlabs.course.asked import AskedValue
from ctlabs.course.reading import content, folded
from ctlabs.files import datafile
from ctlabs.linalg.checks import Array
from ctlabs.montecarlo.chance import chi2_quantile
from ctlabs.text import number

#: Probability that the record of a right experiment fails.
LEVEL = 1e-5
#: Largest table, bytes.
LARGEST = 32 * 2**20
#: Where names of columns stand, bytes.
HEAD = 2000
#: Fewest runs of an experiment.
RUNS = 20
#: How many of a record's numbers are kept to know it again.
SAMPLE = 256
_RUN, _FIRST, _SECOND = ("run", "trial"), ("i", "k", "step", "measurement"), ("j", "state", "component")
_ERROR, _ESTIMATE, _TRUTH = ("error", "e"), ("estimate", "xhat", "x_hat"), ("truth", "true", "x")


@dataclass(frozen=True, slots=True)
class RecordOutcome:
    """What a record shows.

    ``passed``, in ``words`` · ``p`` : probability that a right record deviates as much, over all its tests · ``runs``, the fewest at an
    element · ``found`` : relative error of a variance that so many runs find as often as not · ``sample`` : digests of some of its numbers
    """

    name: str
    passed: bool
    words: str
    p: float
    runs: int
    found: float
    sample: frozenset[int]


def tested(asked: Sequence[AskedValue]) -> tuple[AskedValue, ...]:
    """The variances against which errors can be held, the one of the column ``error`` first: the filter's, along the measurements."""
    apart = ("ratio", "missing", "perfect", "diagonal_noise", "open_loop", "floor", "naive", "claimed", "pseudo")
    named = [each for each in asked if "variance" in each.name and each.name != "covariance"]
    found = [each for each in named if not any(word in each.name for word in apart)]
    return tuple(sorted(found, key=lambda each: (each.value.ndim == 0, "posterior" not in each.name, "steady" in each.name)))


def read(path: Path, asked: Sequence[AskedValue], source: str) -> list[RecordOutcome]:
    """The outcomes of the tests of a table, one for each column of errors.

    Raises
    ------
    ValueError
        A table that cannot be read, or without such columns: in one line that names the file.
    """
    return outcomes(content(path, source, LARGEST), asked, source)


def outcomes(raw: bytes, asked: Sequence[AskedValue], source: str) -> list[RecordOutcome]:
    """The outcomes of the tests of the table in these bytes."""
    theory = tested(asked)
    if not theory:
        raise ValueError(f"{source}: expected a lab with a variance to test a record against, received one without")
    columns = _columns(raw, source)
    index = [next((columns[name] for name in names if name in columns), None) for names in (_FIRST, _SECOND)]
    found = [_outcome(each, errors, index, source) for each, errors in _errors(columns, theory)]
    if not found:
        raise ValueError(f"{source}: expected columns i and error, or estimate and truth, received {', '.join(columns)}")
    return found


def _columns(raw: bytes, source: str) -> dict[str, Array]:
    """The columns of numbers by their folded names; that of the runs is left out."""
    end = raw.find(b"\n", HEAD) + 1
    head = raw[:end] if end and b"\x00" not in raw[:HEAD] else raw  # names stand in front: the whole is read once
    wanted = [name for name in datafile.header(head, source) if name.strip() and folded(name) not in _RUN]
    if not wanted:
        raise ValueError(f"{source}: expected columns i and error, received none")
    record = datafile.parse(raw, wanted, source)
    return {folded(name): record.z[:, place] for place, name in enumerate(wanted)}


def _errors(columns: Mapping[str, Array], theory: Sequence[AskedValue]) -> Iterator[tuple[AskedValue, Array]]:
    """Which errors are held against which variance."""
    estimate, truth = (next((columns[name] for name in names if name in columns), None) for names in (_ESTIMATE, _TRUTH))
    own = next((columns[name] for name in _ERROR if name in columns), None)
    if own is None and estimate is not None and truth is not None:
        own = estimate - truth
    for place, each in enumerate(theory):
        named = columns.get(folded(each.name))
        if named is not None:
            yield each, named
        elif place == 0 and own is not None:
            yield each, own


def variances(asked: AskedValue) -> Array:
    """The variances that ``i`` and ``j`` count: elements of a list, or the diagonals of covariances."""
    P = asked.value
    if "covariance" in asked.name and P.ndim >= 2:
        return np.diagonal(P, axis1=-2, axis2=-1)
    return P


def _outcome(asked: AskedValue, errors: Array, index: Sequence[Array | None], source: str) -> RecordOutcome:
    P = variances(asked)
    places = _places(P, index, ~np.isnan(errors), asked, source)
    inside = places >= 0
    e, at = errors[inside], places[inside]
    theory = P.ravel()
    runs = np.bincount(at, minlength=theory.size)
    if (fewest := int(runs.min())) < RUNS:
        words = f"expected at least {RUNS} runs{_where(int(runs.argmin()), P.shape)}, received {fewest}"
        return RecordOutcome(asked.name, False, words, math.nan, fewest, math.inf, _sample(e))
    squares, sums = np.bincount(at, e**2, theory.size), np.bincount(at, e, theory.size)
    known = theory == 0
    safe = np.where(known, 1.0, theory)
    scores = np.stack([chi2_quantile(np.maximum(squares / safe, 1e-300), runs), sums / np.sqrt(runs * safe)])
    exact = np.sqrt(squares / runs) <= 1e-6 * math.sqrt(float(theory.max()) or 1.0)  # the variance is zero: so is the error
    scores[:, known] = np.where(exact[known], 0.0, np.inf)
    tests = scores.size
    kind, place = np.unravel_index(int(np.argmax(np.abs(scores))), scores.shape)
    p = float(min(1.0, 2 * tests * special.ndtr(-abs(scores[kind, place]))))
    limit = -float(special.ndtri(LEVEL / (2 * tests)))
    found = limit * math.sqrt(2 / fewest)
    if p >= LEVEL:
        words = f"agrees with theory (p = {number(p, 2)}; {fewest} runs find a variance that is wrong by {number(100 * found, 2)} %)"
        return RecordOutcome(asked.name, True, words, p, fewest, found, _sample(e))
    where, what = _where(int(place), P.shape), "the mean error{where} is not zero"
    if kind == 0:
        what = f"the mean square of the error{{where}} is {number(squares[place] / runs[place] / safe[place], 3)} times that of theory"
    what = what.format(where=where)
    words = f"disagrees with theory: {what} (p = {number(p, 2)}, {fewest} runs)"
    return RecordOutcome(asked.name, False, words, p, fewest, found, _sample(e))


def _places(P: Array, index: Sequence[Array | None], there: Array, asked: AskedValue, source: str) -> Array:
    """For each row which element of P it belongs to, −1 for none."""
    place = np.zeros(there.shape, dtype=np.int64)
    inside = there.copy()
    for axis, (name, column) in enumerate(zip(("i", "j")[: P.ndim], index, strict=False)):
        if column is None:
            raise ValueError(f"{source}: expected a column {name}, 1 to {P.shape[axis]}, for {asked.name}, received none")
        whole = np.nan_to_num(column)
        if (whole != np.round(whole)).any():
            raise ValueError(f"{source}: expected whole numbers in the column {name}, received others")
        inside &= (whole >= 1) & (whole <= P.shape[axis])
        place = place * P.shape[axis] + np.where(inside, whole - 1, 0).astype(np.int64)
    return np.where(inside, place, -1)


def _where(place: int, shape: tuple[int, ...]) -> str:
    if not shape:
        return ""
    told = [f"{name} = {int(at) + 1}" for name, at in zip(("i", "j"), np.unravel_index(place, shape), strict=False)]
    return " at " + ", ".join(told)


def _sample(errors: Array) -> frozenset[int]:
    """Digests of the errors with at least four digits, those that come first in an order by chance: two records that share many are one."""
    told = {f"{value:.9g}" for value in np.abs(errors[errors != 0]).tolist()}
    digests = (zlib.crc32(value.encode()) for value in told if len(value.replace("0.", "").replace(".", "").lstrip("0")) >= 4)
    return frozenset(sorted(set(digests))[:SAMPLE])
