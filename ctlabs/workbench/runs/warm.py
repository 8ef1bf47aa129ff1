"""Loaded by a process of the worker before its first run: two small experiments, so that what they need is loaded and compiled."""

from __future__ import annotations

from ctlabs.files.modelfile import new
from ctlabs.workbench.runs.experiments import run
from ctlabs.workbench.runs.outcomes import Asked, Upload

_MODEL = new(1, 1, 1).dumps()
run(_MODEL, Asked(steps=20, runs=2).plain(), progress=lambda _done, _runs: None, workers=1)
run(_MODEL, Asked(data=Upload("warm", "z1\n" + "0\n1\n" * 10)).plain())
