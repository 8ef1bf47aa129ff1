"""A measured record, filtered, smoothed and diagnosed: what ``ctlabs filter`` reports, as arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import NDArray

from ctlabs.analysis import diagnosis
from ctlabs.files import clock
from ctlabs.filtering.filter import kalman_filter
from ctlabs.filtering.smoothing import smooth as smooth_
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel
from ctlabs.text import _, fill, moment

if TYPE_CHECKING:
    from ctlabs.analysis.diagnosis import Diagnosis
    from ctlabs.files.datafile import Record
    from ctlabs.files.modelfile import ModelFile
    from ctlabs.filtering.results import Filtered
    from ctlabs.filtering.smoothing import Smoothed

#: The probability that the tests of one record, or of several together, suspect a right model.
LEVEL = 0.01
#: Standard deviations whose square is beyond double precision.
ENORMOUS = 1e150


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A record ready to be filtered, and what came of it.

    ``model``, discrete, of the record's instants, with what is known of the measurements · ``z`` (steps+1, m), as the file has them, and
    ``t`` (steps+1,) s, by instants · ``first``, the index of the first row · ``algorithm``, the form that was used · ``filtered``,
    ``smoothed`` or None · ``verdict`` on the model, None where nothing is left to test or the test has no digits, as ``untested`` says ·
    ``record``, as it was read · ``rows`` (steps+1,), its row at each instant, −1 where there is none · ``called``, how a row of z from the
    first measurement on is called: by its line and time · ``notes``, what was done beyond reading, and what has too few digits
    """

    model: DiscreteModel
    z: Array
    t: Array
    first: int
    algorithm: str
    filtered: Filtered
    smoothed: Smoothed | None
    verdict: Diagnosis | None
    untested: str
    record: Record
    rows: NDArray[np.int64]
    called: Callable[[int], str]
    notes: tuple[str, ...]

    @property
    def data(self) -> Array:
        """What was filtered: z without what is beyond the gate."""
        return self.filtered.asked[1]

    @property
    def bare(self) -> DiscreteModel:
        """The model without what is known of the measurements, which moves no gain and may vary where all else is constant."""
        return replace(self.model, measurement_offset=None)

    @property
    def told(self) -> Array:
        """What the measurements say of the states: z without what is known of it."""
        return self.z if self.filtered.known is None else self.z - self.filtered.known

    def line(self, row: int) -> int | None:
        """The line of the file that a row of z from the first measurement on stands in, or ``None``."""
        at = self.rows[self.first + row]
        return int(self.record.lines[at]) if at >= 0 else None


def compute(
    model: ModelFile,
    record: Record,
    algorithm: str,
    *,
    smooth: bool = False,
    gate: float | None = None,
    level: float = LEVEL,
    test: bool = True,
) -> Run:
    """The record with its model, filtered by a form, without what is beyond the ``gate``; diagnosed; and smoothed where asked for.

    A right model is suspected with probability ``level``; without ``test`` it is not diagnosed, which takes the longest.

    Raises
    ------
    ValueError
        Times that do not fit the model; what the form cannot do; nothing within the gate.
    FloatingPointError
        Values that the model cannot give, or a form that rounding has defeated.
    """
    made, first = clock.over(model, record), model.experiment.first
    discrete, z, t, rows = made.model, made.z, made.t, made.placing.rows
    found = kalman_filter(discrete, z[first:], first=first, algorithm=algorithm, gate=gate)
    if not (np.isfinite(found.log_likelihood) or found.contradictions):
        _refuse(discrete, found, algorithm, record, rows)
    smoothed = smooth_(discrete, found) if smooth else None
    verdict, untested, called = None, _("nothing was measured"), names(record, t[first:], rows[first:])
    if not test:
        untested = _("no test was asked for")
    elif np.isfinite(found.innovation).any():
        try:
            verdict = _diagnosed(discrete, found, algorithm, first, level, called)
        except ArithmeticError as error:  # the diagnosis filters in Joseph's form, whatever the form chosen here
            untested = str(error)
    remarks = (*found.remarks, *(() if smoothed is None else smoothed.remarks))
    notes = (*record.notes, *clock.notes(model, record, made), *remarks)
    return Run(discrete, z, t, first, found.algorithm, found, smoothed, verdict, untested, record, rows, called, notes)


def names(record: Record, t: Array, rows: NDArray[np.int64]) -> Callable[[int], str]:
    """How instants are called: by the lines of their ``rows`` and their times ``t``, as they are written where they are no seconds."""

    def called(instant: int) -> str:
        row = rows[instant]
        if row < 0:
            return fill(_("t = {time}"), time=moment(float(t[instant])))
        time = record.stamps[row] if record.clocked else moment(float(t[instant]))
        return fill(_("line {line} (t = {time})"), line=int(record.lines[row]), time=time)

    return called


def _diagnosed(
    model: DiscreteModel, found: Filtered, algorithm: str, first: int, level: float, where: Callable[[int], str]
) -> Diagnosis:
    """The diagnosis by the optimal filter's innovations (the start of one with the steady gain is not the model's)."""
    if algorithm == "steady":
        found = kalman_filter(model, found.asked[1][first:], first=first)
    return diagnosis.diagnose(model, found, first=first, level=level, longest=diagnosis.LONG, where=where)


def _refuse(model: DiscreteModel, filtered: Filtered, algorithm: str, record: Record, rows: NDArray[np.int64]) -> NoReturn:
    """Say why there is no likelihood: values without measure, or a form that rounding has defeated."""
    sd = np.sqrt(np.diagonal(filtered.S, axis1=1, axis2=2).clip(np.finfo(float).tiny))
    away = np.abs(np.where(np.isfinite(filtered.innovation), filtered.innovation, 0.0)) / sd
    k, i = divmod(int(np.argmax(np.nan_to_num(away))), model.m)
    if away[k, i] > ENORMOUS:
        row, name = rows[k], model.measurements[i]
        msg = (
            f"{record.source}: line {record.lines[row]}, column {name}: expected a value that the model leaves possible, "
            f"received {record.z[row, i]:g}, {away[k, i]:.0e} standard deviations away"
        )
    else:
        msg = f"form {algorithm}: expected finite numbers, received NaN by rounding; take a factorised form: --algorithm ud"
    raise FloatingPointError(msg)
