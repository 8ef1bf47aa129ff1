"""What can be asked of a model and a record of one's own; each answer is a :class:`~ctlabs.reporting.report.Report`.

:mod:`~ctlabs.studies.analysis` of a model · :mod:`~ctlabs.studies.simulation` of many runs ·
:mod:`~ctlabs.studies.filtering` of a measured record · :mod:`~ctlabs.studies.comparison` of the filter's forms ·
:mod:`~ctlabs.studies.fitting` of the model's constants. Each has one verb, ``study``.
"""
