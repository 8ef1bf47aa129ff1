"""What is asked of an experiment (:class:`Asked`) and what comes out (:class:`Outcome`); how it is computed:
:mod:`ctlabs.workbench.runs.experiments`.

Both have a plain form (numbers, texts, lists, arrays) that travels to another process and into the store.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping as Table
from dataclasses import dataclass
from typing import Any

import numpy as np

from ctlabs.files import datafile, reading
from ctlabs.files.datafile import PLAIN
from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import ModelFile
from ctlabs.files.modelfile.errors import meant, shown
from ctlabs.files.modelfile.schema import RUNS, STEPS
from ctlabs.filtering.algorithms.catalogue import FORMS
from ctlabs.filtering.comparison import Judged
from ctlabs.linalg.checks import Array
from ctlabs.linalg.covariance import deviations
from ctlabs.models.anomalies import Anomaly

#: The name under which :func:`ctlabs.workbench.runs.experiments.run` is in the worker's table.
REGISTERED = "experiment"
#: Largest measured record that a plan holds, in characters.
LARGEST = 20_000_000


@dataclass(frozen=True, slots=True)
class Upload:
    """A measured record: the file's ``name`` and its text."""

    name: str
    text: str

    @classmethod
    def of(cls, content: bytes, name: str, mapping: Mapping = PLAIN) -> Upload:
        """The data of an uploaded file, in the encoding or from the sheet that is told."""
        if len(content) > LARGEST:
            msg = f"{name}: expected at most {LARGEST // 10**6} MB, received more"
            raise ValueError(msg)
        return cls(name, datafile.text(content, name, encoding=mapping.encoding, sheet=mapping.sheet))

    def record(self, model: ModelFile | tuple[str, ...]) -> datafile.Record:
        """The record, as the model's table [data] reads it; of names alone, its columns in their order."""
        return datafile.only(self.records(model))

    def records(self, model: ModelFile | tuple[str, ...]) -> tuple[datafile.Record, ...]:
        """All records of the data."""
        own = decoded(model) if isinstance(model, ModelFile) else model
        return reading.parsed([(self.text.encode(), self.name)], own)


def decoded(model: ModelFile) -> ModelFile:
    """The model for a table that is a text already: its [data] without the encoding and the sheet from which that was read."""
    told = model.data().get("data")
    for key in ("encoding", "sheet"):
        if isinstance(told, dict) and key in told:
            model = model.remove(("data", key))
    return model


#: From what to what the whole numbers of an experiment go.
LIMITS = {"steps": (1, STEPS), "runs": (1, RUNS), "seed": (0, 2**63 - 1), "first": (0, 1)}


@dataclass(frozen=True, slots=True)
class Asked:
    """What is asked.

    ``algorithms`` : one or more names of :data:`ctlabs.filtering.algorithms.FORMS`; with several, each is compared with 50 digits ·
    ``design`` : text of the filter's model, where it is not the truth · ``anomalies`` · ``data`` : a measured record instead of
    simulated runs (``steps``, ``runs`` and ``seed`` then mean nothing)
    """

    steps: int = 200
    runs: int = 1000
    seed: int = 1
    first: int = 1
    algorithms: tuple[str, ...] = ("joseph",)
    design: str | None = None
    anomalies: tuple[Anomaly, ...] = ()
    data: Upload | None = None

    def check(self) -> None:
        """Refuse in one line what no experiment can be; the rest is found when it runs."""
        for name, (least, most) in LIMITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
                msg = f"{name}: expected a whole number from {least} to {most}, received {shown(value)}"
                raise ValueError(msg)
        if not self.algorithms:
            msg = "algorithms: expected at least one, received none"
            raise ValueError(msg)
        for name in self.algorithms:
            if name not in FORMS:
                msg = f"algorithms: unknown algorithm {shown(name)}{meant(name, FORMS, len(FORMS))}"
                raise ValueError(msg)
        for anomaly in self.anomalies:
            anomaly.check()

    def plain(self) -> dict[str, Any]:
        """The plan as JSON holds it (an infinite variance is "inf")."""
        found = dataclasses.asdict(self)
        found["algorithms"] = list(self.algorithms)
        found["anomalies"] = [{**dataclasses.asdict(a), "R": "inf" if math.isinf(a.R) else a.R} for a in self.anomalies]
        return found

    @classmethod
    def of(cls, plain: Table[str, Any]) -> Asked:
        """The plan of :meth:`plain`'s answer; what is not there has its default."""
        known = {each.name for each in dataclasses.fields(cls)}
        given = {key: value for key, value in plain.items() if key in known}
        given["algorithms"] = tuple(given.get("algorithms", ("joseph",)))
        given["anomalies"] = tuple(Anomaly(**{**a, "R": float(a["R"])}) for a in given.get("anomalies", ()))
        if given.get("data") is not None:
            given["data"] = Upload(**given["data"])
        return cls(**given)


@dataclass(frozen=True, slots=True, eq=False)
class InnovationTests:
    """Tests of the innovations of one record.

    ``nis_mean`` per instant, ``nis_expected``, its 95 % band ``nis_low``, ``nis_high`` and two-sided ``nis_p`` · per measurement
    ``mean_p`` (of a zero mean), ``whiteness_p`` (NaN: too few innovations), autocorrelations ``correlation`` (m, L) at ``lags`` (L,) and
    the half-width ``band`` (m, L) within which 95 % of white ones lie · ``verdict`` and ``suggestion`` as
    :class:`ctlabs.analysis.diagnosis.Diagnosis` has them ("" for simulated runs, whose model is known), with ``factor_R``, ``factor_Q``
    """

    nis_mean: float
    nis_expected: float
    nis_low: float
    nis_high: float
    nis_p: float
    mean_p: Array
    whiteness_p: Array
    lags: Array
    correlation: Array
    band: Array
    verdict: str = ""
    suggestion: str = ""
    factor_R: float | None = None
    factor_Q: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ErrorStatistics:
    """Errors x̂ − x over ``runs`` runs.

    ``rms``, ``bias`` (K, n) with the band of 95 % of ensembles around theory, ``rms_band``,
    ``bias_band`` (2, K, n) · ``nees``, ``nis`` (K,), averages over runs, their expectations ``…_dof`` and bands ``…_band`` (2, K) ·
    ``outside`` : how many of the RMS errors are outside their bands, and what chance makes of that (a
    :class:`~ctlabs.montecarlo.shares.Share` by its names), None where it is not known
    """

    runs: int
    rms: Array
    bias: Array
    rms_band: Array
    bias_band: Array
    nees: Array
    nees_dof: Array
    nees_band: Array
    nis: Array
    nis_dof: Array
    nis_band: Array
    outside: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What came out, every instant of it. K instants, n states of the filter, m measurements, r shown runs.

    ``kind`` "simulation" or "data" · ``k`` (K,), ``t`` (K,) s · ``states``, ``units``, ``measurements``, ``measurement_units`` ·
    ``z`` (K, m, r), NaN where nothing was measured · ``truth`` (K, n, r) or None · ``measured`` (n,), which measurement reads a
    state alone, −1 if none · ``algorithm``, the first one that works, and its ``x_minus``, ``x_plus`` (K, n, r) ·
    ``estimates``, x_plus of run 0 by every algorithm · ``P_minus``, ``P_plus`` (K, n, n), as the filter claims; of a long
    record only at the instants ``at``, the first and the last, and of all of them the variances ``var_minus``, ``var_plus`` (K, n) ·
    ``H`` (m, n) or (K, m, n), what is measured · ``K`` (K, n, m) · ``innovation`` (K, m, r), ``innovation_sd`` (K, m) ·
    ``nis`` (K, r), ``nis_dof`` (K,) · ``smoothed``, ``smoothed_sd``
    (K, n) of data · ``statistics`` : over all runs, see :class:`ErrorStatistics`, or None · ``actual_P``, ``actual_bias`` : the theory of
    the true errors where the design is not the truth · ``verdict`` : tests of the innovations of run 0 ·
    ``algorithms`` · ``summary`` : numbers to copy, name → (value, unit) · ``contradiction`` : why the record is impossible for
    the model, empty if it is not · ``seconds`` it took
    """

    kind: str
    algorithm: str
    k: Array
    t: Array
    states: tuple[str, ...]
    units: tuple[str, ...]
    measurements: tuple[str, ...]
    measurement_units: tuple[str, ...]
    z: Array
    truth: Array | None
    measured: tuple[int, ...]
    x_minus: Array
    x_plus: Array
    estimates: dict[str, Array]
    P_minus: Array
    P_plus: Array
    K: Array
    innovation: Array
    innovation_sd: Array
    nis: Array
    nis_dof: Array
    algorithms: tuple[Judged, ...]
    verdict: InnovationTests | None
    summary: dict[str, tuple[Any, str]]
    statistics: ErrorStatistics | None = None
    actual_P: Array | None = None
    actual_bias: Array | None = None
    optimal_sd: Array | None = None
    smoothed: Array | None = None
    smoothed_sd: Array | None = None
    log_likelihood: float | None = None
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    contradiction: str = ""
    var_minus: Array | None = None
    var_plus: Array | None = None
    at: Array | None = None
    H: Array | None = None

    @property
    def sd_minus(self) -> Array:
        """Standard deviations that the filter claims before an update, (K, n)."""
        return deviations(self.P_minus) if self.var_minus is None else np.sqrt(self.var_minus.clip(0))

    @property
    def sd_plus(self) -> Array:
        """Standard deviations that the filter claims after an update, (K, n)."""
        return deviations(self.P_plus) if self.var_plus is None else np.sqrt(self.var_plus.clip(0))

    @property
    def variances(self) -> tuple[Array, Array]:
        """The variances that the filter claims before and after an update, (K, n) each."""
        if self.var_minus is None or self.var_plus is None:
            return np.diagonal(self.P_minus, axis1=1, axis2=2), np.diagonal(self.P_plus, axis1=1, axis2=2)
        return self.var_minus, self.var_plus

    @property
    def actual_rms(self) -> Array | None:
        """RMS error by the theory of a wrong filter, bias included, (K, n)."""
        if self.actual_P is None or self.actual_bias is None:
            return None
        return np.sqrt(np.diagonal(self.actual_P, axis1=1, axis2=2).clip(0) + self.actual_bias**2)

    @property
    def errors(self) -> Array | None:
        """Estimate − truth of the shown runs, (K, n, r)."""
        return None if self.truth is None else self.x_plus - self.truth


def packed(found: Outcome) -> dict[str, Any]:
    """An outcome as texts, numbers, lists, dicts and arrays."""
    return {each.name: _plain(getattr(found, each.name)) for each in dataclasses.fields(found)}


def outcome(result: Table[str, Any]) -> Outcome:
    """The outcome of what a run returned, or the store keeps."""
    known = {each.name for each in dataclasses.fields(Outcome)}
    given: dict[str, Any] = {key: value for key, value in result.items() if key in known}
    for key in ("states", "units", "measurements", "measurement_units", "measured", "notes"):
        given[key] = tuple(given.get(key, ()))
    given["algorithms"] = tuple(Judged(**each) for each in given["algorithms"])
    given["summary"] = {key: (value, unit) for key, (value, unit) in given["summary"].items()}
    for key, kind in (("statistics", ErrorStatistics), ("verdict", InnovationTests)):
        if given.get(key) is not None:
            given[key] = kind(**given[key])
    return Outcome(**given)


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {each.name: _plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    return value
