"""Figures over a grid: every cell shows its value, and what is marked is what was asked for."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Rectangle

from ctlabs import montecarlo
from ctlabs.models import DiscreteModel
from ctlabs.reporting import plots


def model(q=1.0, r=1.0):
    return DiscreteModel([[1]], [[q]], [[1]], [[r]], x0=[0], P0=[[10]], units=["m"])


def swept(**grid):
    return montecarlo.sweep(model, grid, steps=3, runs=20, seed=1, progress=False)


def test_one_parameter_is_drawn_as_a_line():
    """The line goes through the measured values."""
    result = swept(q=[0.1, 1.0, 10.0])
    figure = plots.sweep(result, "rms_1", labels={"q": "variance of w, m²"}, label="RMS, m", log=True)
    (line,) = figure.axes[0].lines
    assert np.array_equal(line.get_ydata(), result.surface("rms_1"))
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("variance of w, m²", "RMS, m")
    assert figure.axes[0].get_xscale() == "log"


def test_two_parameters_are_drawn_as_a_heat_map():
    """Cell (i, j) has the colour of its value; the colour bar says which quantity and unit."""
    result = swept(q=[0.1, 1.0, 10.0], r=[1.0, 4.0])
    figure = plots.sweep(result, "rms_1", labels={"q": "q, m²", "r": "r, m²"}, label="RMS, m")
    FigureCanvasAgg(figure).draw()
    (mesh,) = figure.axes[0].collections
    assert np.array_equal(np.asarray(mesh.get_array()).reshape(2, 3), result.surface("rms_1").T)
    assert figure.axes[1].get_ylabel() == "RMS, m"


def test_three_parameters_are_refused():
    """A page has two directions."""
    result = swept(q=[0.1, 1.0], r=[1.0, 4.0])
    deeper = montecarlo.Sweep({**result.axes, "s": (1,)}, result.points, result.statistics, result.rows)
    with pytest.raises(ValueError, match=r"expected one or two parameters to draw, received \['q', 'r', 's'\]"):
        plots.sweep(deeper, "rms_1", labels={}, label="RMS, m")


def test_pairs_are_coloured_crossed_out_and_framed():
    """Every pair has its value, a cross if it is not allowed, and the best one a frame."""
    instants, values = np.array([[0, 1], [0, 2], [1, 2]]), np.array([3.0, 2.0, 1.0])
    figure = plots.pairs(
        instants,
        values,
        [True, True, False],
        xlabel="first, number",
        ylabel="second, number",
        label="RMS, m",
        best=(0, 2),
    )
    axes = figure.axes[0]
    image = np.asarray(axes.images[0].get_array())
    assert (image[1, 0], image[2, 0], image[2, 1]) == (3.0, 2.0, 1.0)
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines] == [(1, 2)]
    (frame,) = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert frame.get_xy() == (-0.5, 1.5)
