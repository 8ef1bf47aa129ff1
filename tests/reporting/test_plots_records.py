"""Figures of a measured record: what is given is what is drawn, gaps stay gaps, and what leaves a band is seen."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from scipy import stats

from ctlabs.reporting import plots
from ctlabs.reporting.render import drawn

T = np.arange(40.0)
RNG = np.random.default_rng(1)
NU = RNG.normal(size=(40, 2))
NU[5] = np.nan
NU[10:20, 0] = np.nan
NU[30, 1] = 7.0
SD = np.tile([1.0, 1.5], (40, 1))
DOF = np.isfinite(NU).sum(axis=1)
NIS = np.nansum((NU / SD) ** 2, axis=1)
Q, R = np.linspace(0.5, 3.0, 9), np.linspace(1.0, 5.0, 11)
PROFILES = {"q": (Q, -3.0 - (Q - 1.5) ** 2), "r": (R, -3.0 - 0.5 * (R - 3.0) ** 2)}


def profiles(**more):
    given = {"top": -3.0, "labels": {"q": "q, m²/s", "r": "r, m²"}, "standard_errors": {"q": 0.7, "r": None}}
    return plots.likelihood_profiles(PROFILES, {"q": 1.5, "r": 3.0}, **{**given, **more})


def innovations():
    return drawn(plots.innovations(T, NU, SD, NIS, DOF, xlabel="time, s", labels=["innovation of z1, m", "innovation of z2, m/s"]))


def correlations():
    lags, r = np.arange(1, 11), 0.05 * np.ones(10)
    r[3] = -0.6
    return drawn(plots.autocorrelation({"z1": (lags, r, np.full(10, 0.3)), "z2": (lags, 0 * r, np.full(10, 0.3))}))


CALLS = {
    "likelihood_profiles": profiles,
    "innovations": innovations,
    "autocorrelation": correlations,
}


def points(axes, label):
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return line.get_xydata()


def bands(axes):
    return [c for c in axes.collections if isinstance(c, PolyCollection)]


def test_every_function_is_tested_here():
    """A new figure of this module comes with a call above."""
    assert set(CALLS) == {n for n in plots.__all__ if getattr(plots, n).__module__ == "ctlabs.reporting.plots.records"}


@pytest.mark.parametrize("name", CALLS)
def test_figures_are_labelled_and_their_legends_stand_outside(name):
    """Axes have names and units, nothing is cut off, and the legend covers no data."""
    figure = CALLS[name]()
    FigureCanvasAgg(figure).draw()
    renderer = figure.canvas.get_renderer()
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert any(axes.get_xlabel() for axes in shown)
    assert any(axes.get_ylabel() for axes in shown)
    (legend,) = figure.legends
    for axes in shown:
        box = axes.get_tightbbox(renderer)
        assert not legend.get_window_extent(renderer).overlaps(box)
        assert box.x0 >= -1
        assert box.x1 <= figure.bbox.x1 + 1
        assert box.y0 >= -1
    assert figure.get_figwidth() == 7.2
    assert figure.canvas.manager is None


class TestProfiles:
    def test_profile_estimate_level_and_parabola_are_drawn(self):
        """Relative to the top: the profile as given, the estimate at 0, the level at −1.92, the parabola of one σ at −½."""
        axes = profiles().axes[0]
        assert np.array_equal(points(axes, "profile log-likelihood"), np.column_stack([Q, -((Q - 1.5) ** 2)]))
        assert points(axes, "estimate").tolist() == [[1.5, 0.0]]
        assert points(axes, "95 % level")[:, 1] == pytest.approx(-0.5 * stats.chi2.ppf(0.95, 1))
        x, y = points(axes, "quadratic approximation").T
        assert np.interp(1.5 + 0.7, x, y) == pytest.approx(-0.5, abs=1e-3)
        assert axes.get_xlabel() == "q, m²/s"

    def test_without_a_standard_error_there_is_no_parabola(self):
        """That of r is missing, and its other curves are there."""
        axes = profiles().axes[1]
        assert {line.get_label() for line in axes.lines} == {"profile log-likelihood", "95 % level", "estimate"}
        assert all(
            "quadratic approximation" not in {line.get_label() for line in axes.lines}
            for axes in profiles(standard_errors=None).axes
        )

    def test_an_empty_place_of_the_grid_is_hidden(self):
        """Three profiles in two columns."""
        three = {**PROFILES, "s": PROFILES["r"]}
        figure = plots.likelihood_profiles(
            three, {"q": 1.5, "r": 3.0, "s": 3.0}, top=-3.0, labels=dict.fromkeys("qrs", "c, 1")
        )
        assert [axes.get_visible() for axes in figure.axes] == [True, True, True, False]


class TestInnovations:
    def test_points_outside_the_band_have_another_shape(self):
        """Every innovation is drawn once: inside ±2σ as a dot, outside as a square."""
        axes = innovations().axes[1]
        inside, outside = (line.get_xydata() for line in axes.lines if line.get_marker() in "os")
        assert [30.0, 7.0] in outside.tolist()
        inside, outside = (found[np.isfinite(found[:, 1])] for found in (inside, outside))
        assert (np.abs(outside[:, 1]) > 1.96 * 1.5).all()
        assert (np.abs(inside[:, 1]) <= 1.96 * 1.5).all()
        assert len(inside) + len(outside) == np.isfinite(NU[:, 1]).sum()

    def test_the_band_holds_95_percent_and_is_open_where_nothing_is_measured(self):
        """±1.96σ in boxes around the instants; none in the gap."""
        (band,) = bands(innovations().axes[0])
        corners = np.vstack([path.vertices for path in band.get_paths()])
        assert corners[:, 1].min() == -1.96
        assert corners[:, 1].max() == 1.96
        assert not ((corners[:, 0] > 9.5) & (corners[:, 0] < 19.5)).any()

    def test_the_nis_stands_in_the_band_of_its_own_degrees_of_freedom(self):
        """Two elements: the quantiles of χ²(2); one: of χ²(1)."""
        (band,) = bands(innovations().axes[2])
        corners = np.vstack([path.vertices for path in band.get_paths()])
        at_25, at_15 = (corners[np.abs(corners[:, 0] - t) < 0.6, 1] for t in (25, 15))
        assert (at_25.min(), at_25.max()) == pytest.approx(tuple(stats.chi2.ppf([0.025, 0.975], 2)))
        assert (at_15.min(), at_15.max()) == pytest.approx(tuple(stats.chi2.ppf([0.025, 0.975], 1)))
        points = np.concatenate([line.get_xydata() for line in innovations().axes[2].lines if line.get_linestyle() == "None"])
        points = points[np.isfinite(points[:, 1])]
        assert len(points) == (DOF > 0).sum()
        assert 5.0 not in points[:, 0]


def test_autocorrelations_outside_the_band_are_marked():
    """One of ten lags of z1, none of z2; the band is as given."""
    first, second = correlations().axes
    outside = points(first, "outside the band")
    assert outside[np.isfinite(outside[:, 1])].tolist() == [[4.0, -0.6]]
    assert np.isfinite(points(first, "autocorrelation")[:, 1]).sum() == 9
    assert not [line for line in second.lines if line.get_label() == "outside the band"]
    assert np.vstack([path.vertices for path in bands(first)[0].get_paths()])[:, 1].max() == 0.3
    assert first.get_ylabel() == "autocorrelation of z1"
    assert second.get_xlabel() == "lag, innovations"
