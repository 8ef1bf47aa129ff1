"""Estimates from measurements: the filter of a record, the filter that runs online, smoothing, forecasts, limits.

One verb filters every kind of model with every algorithm (:func:`kalman_filter`); what it gives is :class:`Filtered`, and its half
that needs no data :class:`Covariances`. ``algorithms`` holds the forms, ``engines`` what runs them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ctlabs._front import front

if TYPE_CHECKING:
    from ctlabs.filtering.comparison import compare, flops, reference
    from ctlabs.filtering.engines.adapter import update
    from ctlabs.filtering.filter import covariances, kalman_filter, log_likelihood
    from ctlabs.filtering.forecasting import Forecast, draws, forecast
    from ctlabs.filtering.limit import steady_state
    from ctlabs.filtering.online import Filter
    from ctlabs.filtering.problem import Model
    from ctlabs.filtering.results import Covariances, Filtered, FilteredRow
    from ctlabs.filtering.settle import settling, settling_step
    from ctlabs.filtering.smoothing import Smoothed, smooth

_HOME = {
    "Covariances": "results",
    "Filter": "online",
    "Filtered": "results",
    "FilteredRow": "results",
    "Forecast": "forecasting",
    "Model": "problem",
    "Smoothed": "smoothing",
    "compare": "comparison",
    "covariances": "filter",
    "draws": "forecasting",
    "flops": "comparison",
    "forecast": "forecasting",
    "kalman_filter": "filter",
    "log_likelihood": "filter",
    "reference": "comparison",
    "settling": "settle",
    "settling_step": "settle",
    "smooth": "smoothing",
    "steady_state": "limit",
    "update": "engines.adapter",
}

__all__ = [
    "Covariances",
    "Filter",
    "Filtered",
    "FilteredRow",
    "Forecast",
    "Model",
    "Smoothed",
    "compare",
    "covariances",
    "draws",
    "flops",
    "forecast",
    "kalman_filter",
    "log_likelihood",
    "reference",
    "settling",
    "settling_step",
    "smooth",
    "steady_state",
    "update",
]

__getattr__ = front(__name__, _HOME)
