"""Models in TOML files: data with arithmetic expressions, never code.

>>> from ctlabs.files.modelfile import ready
>>> ready("local_level").discrete().R          # the Nile's flow: a random walk in noise
array([[15099.]])
"""

from ctlabs.files.modelfile.catalogue import Entry, copy, gallery, ready
from ctlabs.files.modelfile.costs import RegulatorSettings
from ctlabs.files.modelfile.document import Constant, ExperimentSettings, ModelFile, load, loads
from ctlabs.files.modelfile.errors import ModelFileError, Problem
from ctlabs.files.modelfile.writing import from_model, new

__all__ = [
    "Constant",
    "Entry",
    "ExperimentSettings",
    "ModelFile",
    "ModelFileError",
    "Problem",
    "RegulatorSettings",
    "copy",
    "from_model",
    "gallery",
    "load",
    "loads",
    "new",
    "ready",
]
