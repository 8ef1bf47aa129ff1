"""Loaded by a process of the worker before its first run: two small experiments and a table, so that all is loaded and compiled."""

from __future__ import annotations

from ctlabs.files.modelfile import new
from ctlabs.workbench.runs.experiments import run
from ctlabs.workbench.runs.outcomes import Asked, Upload
from ctlabs.workbench.runs.records import estimated
from ctlabs.workbench.runs.seen import seen
from ctlabs.workbench.runs.wanted import Wanted

_MODEL = new(1, 1, 1).dumps()
run(_MODEL, Asked(steps=20, runs=2).plain(), progress=lambda _done, _runs: None, workers=1)
_DATA = Upload("warm", "z1\n" + "0\n1\n" * 10)
run(_MODEL, Asked(data=_DATA).plain())
seen(_MODEL, _DATA.text, _DATA.name)
estimated(_MODEL, _DATA, Wanted())
