"""Figures: labelled, readable, drawn without touching matplotlib's settings."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ctlabs import montecarlo
from ctlabs.filtering import Covariances, Filtered, kalman_filter
from ctlabs.labs.experiment import covariances
from ctlabs.models import DiscreteModel
from ctlabs.reporting import plots
from ctlabs.reporting.plots.base import STYLE

MODEL = DiscreteModel(
    Phi=[[1, 0.5], [0, 0.9]], Qd=[[0.1, 0.02], [0.02, 0.2]], H=[[1, 0]], R=[[0.5]], x0=[0, 0], P0=[[4, 0], [0, 1]], dt=0.5,
    states=["x", "v"], units=["m", "m/s"],
)  # fmt: skip
STEPS, RUNS = 12, 40
X = np.linspace(0.0, 2.0, 30)


def ensemble() -> Filtered:
    simulation = montecarlo.simulate(MODEL, STEPS, RUNS, seed=5)
    return replace(kalman_filter(MODEL, simulation.z), truth=simulation.x)


def schedules() -> dict[str, Covariances]:
    return {f"R = {R}": covariances(replace(MODEL, R=[[R]]), 4) for R in (0.1, 1.0, 5.0, 20.0)}


def theory() -> Figure:
    statistics = montecarlo.monte_carlo(MODEL, steps=STEPS, runs=RUNS, seed=5)
    P = covariances(MODEL, STEPS).P_plus
    return plots.ensemble_against_theory(statistics, P, xlabel="time, s", units=["m", "m/s"], names=["x", "v"])


#: A call of every function for discrete filters and curves; the other kinds of figures have test modules of their own.
CALLS: dict[str, Callable[[], Figure]] = {
    "lines": lambda: plots.lines(
        X, {f"λ = {i}": (i + 1) * X**2 + 1e-3 for i in range(8)}, xlabel="gain $K_*$", ylabel="variance, m²", ordered=True,
        points={"minima": ([0.5, 1], [1, 2])}, straight={"limit": ([0, 2], [3, 3])}, log="y",
    ),
    "sawtooth": lambda: plots.sawtooth(schedules(), xlabel="measurement number i", ylabel="variance, m²", limits=[(0.3, 0.2)] * 4),
    "record": lambda: plots.record(ensemble(), xlabel="time, s", ylabel="x, m", run=1),
    "errors": lambda: plots.errors(ensemble(), xlabel="time, s", unit="m"),
    "ensemble_against_theory": theory,
}  # fmt: skip


@pytest.fixture(params=CALLS, scope="module")
def figure(request) -> Figure:
    """A figure of every function, drawn."""
    drawn = CALLS[request.param]()
    FigureCanvasAgg(drawn).draw()
    return drawn


def shown(figure: Figure) -> list:
    return [axes for axes in figure.axes if axes.get_visible()]


def test_every_function_is_tested_here():
    """A new figure of these modules comes with a call above."""
    modules = ("ctlabs.reporting.plots.base", "ctlabs.reporting.plots.filters")
    public = {name for name in plots.__all__ if getattr(plots, name).__module__ in modules}
    assert set(CALLS) == public - {"styled"}


class TestEveryFigure:
    def test_it_is_a_figure_without_a_window(self, figure):
        """A plain Figure: no manager, no window, nothing to close."""
        assert isinstance(figure, Figure)
        assert figure.canvas.manager is None

    def test_every_axis_is_labelled(self, figure):
        """The lowest axes of a column say what is across, the first of a row what is up."""
        for axes in shown(figure):
            place = axes.get_subplotspec()
            below = [a for a in shown(figure) if a.get_subplotspec().colspan == place.colspan]
            beside = [a for a in shown(figure) if a.get_subplotspec().rowspan == place.rowspan]
            assert any(a.get_xlabel() for a in below)
            assert any(a.get_ylabel() for a in beside)

    def test_the_legend_stands_outside_the_axes(self, figure):
        """It never covers data, titles or labels, and is not cut off at the page."""
        renderer = figure.canvas.get_renderer()
        (legend,) = figure.legends
        box = legend.get_window_extent(renderer)
        for axes in shown(figure):
            assert not box.overlaps(axes.get_tightbbox(renderer))
            assert axes.get_legend() is None
        assert box.x0 >= -0.5
        assert box.y0 >= -0.5
        assert box.x1 <= figure.bbox.x1 + 0.5
        assert box.y1 <= figure.bbox.y1 + 0.5

    def test_nothing_is_cut_off(self, figure):
        """Labels and titles are inside the page, and panels do not overlap."""
        renderer = figure.canvas.get_renderer()
        boxes = [axes.get_tightbbox(renderer) for axes in shown(figure)]
        for i, box in enumerate(boxes):
            assert box.x0 >= -1
            assert box.y0 >= -1
            assert box.x1 <= figure.bbox.x1 + 1
            assert box.y1 <= figure.bbox.y1 + 1
            for other in boxes[:i]:
                overlap = [min(box.x1, other.x1) - max(box.x0, other.x0), min(box.y1, other.y1) - max(box.y0, other.y0)]
                assert min(overlap) <= 2

    def test_the_page_is_as_wide_as_text(self, figure):
        """All figures of a report have one width."""
        assert figure.get_figwidth() == 7.2


@pytest.mark.parametrize("name", CALLS)
def test_matplotlibs_settings_are_left_alone(name):
    """A figure in our style changes nothing for the user's own figures, and takes nothing from them."""
    before = dict(mpl.rcParams)
    with mpl.rc_context({"font.size": 31.0}):
        theirs = dict(mpl.rcParams)
        drawn = CALLS[name]()
        assert dict(mpl.rcParams) == theirs
    assert dict(mpl.rcParams) == before
    assert max(text.get_fontsize() for axes in drawn.axes for text in (axes.xaxis.label, axes.yaxis.label)) < 15


def test_settings_are_left_alone_when_drawing_fails():
    """An error in a figure does not leave its style behind."""
    before = dict(mpl.rcParams)

    @plots.styled
    def broken() -> Figure:
        assert mpl.rcParams["font.size"] == mpl.rc_params_from_file(STYLE, use_default_template=False)["font.size"]
        raise RuntimeError

    with pytest.raises(RuntimeError):
        broken()
    assert dict(mpl.rcParams) == before


def test_pyplot_is_never_imported():
    """No figure manager, no display, no global figure: drawing in a process of its own loads no pyplot."""
    code = (
        "import sys\nfrom ctlabs.reporting import plots, render\n"
        "render.png(plots.lines([0, 1], {'x': [0, 1]}, xlabel='time, s', ylabel='x, m'))\n"
        "assert 'matplotlib.pyplot' not in sys.modules, 'pyplot'"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stderr


class TestLines:
    def test_curves_points_and_reference_lines_are_the_data(self):
        """What is given is what is drawn, under the names given."""
        drawn = plots.lines(
            X, {"first": X, "second": X**2}, xlabel="time, s", ylabel="x, m",
            points={"end": ([2], [4])}, straight={"limit": ([0, 2], [1, 1])},
        )  # fmt: skip
        (axes,) = drawn.axes
        assert {line.get_label() for line in axes.lines} == {"first", "second", "end", "limit"}
        found = {line.get_label(): line.get_xydata() for line in axes.lines}
        assert np.array_equal(found["second"], np.column_stack([X, X**2]))
        assert found["end"].tolist() == [[2, 4]]
        assert found["limit"].tolist() == [[0, 1], [2, 1]]
        assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["first", "second", "limit", "end"]
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("time, s", "x, m")

    @pytest.mark.parametrize(
        ("log", "scales"),
        [("", ("linear", "linear")), ("x", ("log", "linear")), ("y", ("linear", "log")), ("xy", ("log", "log"))],
    )
    def test_logarithmic_axes_are_those_named(self, log, scales):
        """log="y" and so on."""
        (axes,) = plots.lines(X + 1, {"x": X + 1}, xlabel="time, s", ylabel="x, m", log=log).axes
        assert (axes.get_xscale(), axes.get_yscale()) == scales

    def test_an_ordered_family_goes_from_dark_to_light(self):
        """Colours of a family follow its order, also in grey."""
        (axes,) = plots.lines(X, {str(i): X + i for i in range(5)}, xlabel="time, s", ylabel="x, m", ordered=True).axes
        light = [np.dot(mpl.colors.to_rgb(line.get_color()), [0.3, 0.6, 0.1]) for line in axes.lines]
        assert light == sorted(light)
        assert len(set(light)) == 5

    def test_limits_and_whole_numbers_where_asked(self):
        """The vertical range is the one given; steps have no fractions."""
        drawn = plots.lines(
            [0, 1, 2, 3], {"x": [0, 1, 2, 3]}, xlabel="measurement number", ylabel="x, m", ylim=(0, 1.5), steps=True
        )
        (axes,) = drawn.axes
        assert axes.get_ylim() == (0, 1.5)
        assert all(tick == round(tick) for tick in axes.get_xticks())


class TestSawtooth:
    def test_variances_alternate_between_prediction_and_filtering(self):
        """P0, P1⁻, P1⁺, P2⁻, P2⁺ …: up at each step, down at each measurement."""
        found = schedules()
        drawn = plots.sawtooth(found, xlabel="measurement number i", ylabel="variance, m²")
        for axes, (name, schedule) in zip(drawn.axes, found.items(), strict=False):
            assert axes.get_title() == name
            minus, plus = schedule.P_minus[:, 0, 0], schedule.P_plus[:, 0, 0]
            expected = [plus[0], *(value for pair in zip(minus[1:], plus[1:], strict=True) for value in pair)]
            assert axes.lines[0].get_ydata().tolist() == expected
            assert axes.lines[0].get_xdata().tolist() == [0, *np.repeat(schedule.t[1:], 2)]

    def test_a_measurement_at_t0_has_its_prediction_too(self):
        """With first = 0 the saw begins with P0⁻."""
        found = covariances(MODEL, 3, first=0)
        drawn = plots.sawtooth({"": found}, xlabel="measurement number i", ylabel="variance, m²")
        line = drawn.axes[0].lines[0]
        assert line.get_ydata().tolist() == np.stack([found.P_minus, found.P_plus], axis=1)[..., 0, 0].ravel().tolist()
        assert line.get_xdata().tolist() == np.repeat(found.t, 2).tolist()

    def test_empty_panels_are_hidden(self):
        """Four schedules in rows of three leave two places free."""
        drawn = plots.sawtooth(schedules(), xlabel="measurement number i", ylabel="variance, m²")
        FigureCanvasAgg(drawn).draw()
        assert [axes.get_visible() for axes in drawn.axes] == [True] * 4 + [False] * 2
        lowest = [drawn.axes[i] for i in (1, 2, 3)]
        assert all(any(tick.label1.get_visible() for tick in axes.xaxis.get_major_ticks()) for axes in lowest)
        assert not any(tick.label1.get_visible() for tick in drawn.axes[0].xaxis.get_major_ticks())

    def test_a_variance_of_zero_has_an_axis_too(self):
        """A state that is known from the start."""
        known = covariances(replace(MODEL, P0=np.zeros((2, 2)), Qd=np.zeros((2, 2))), 3)
        drawn = plots.sawtooth({"known": known}, xlabel="measurement number i", ylabel="variance, m²")
        FigureCanvasAgg(drawn).draw()
        assert drawn.axes[0].get_ylim()[0] == 0


class TestRuns:
    def test_a_record_shows_one_run(self):
        """Truth, measurements, estimate and its band, of the run and state asked for."""
        found = ensemble()
        drawn = plots.record(found, xlabel="time, s", ylabel="v, m/s", state=1, measurement=None, run=3)
        lines = {line.get_label(): line.get_ydata() for line in drawn.axes[0].lines}
        assert set(lines) == {"truth", "estimate"}
        assert np.array_equal(lines["truth"], found.truth[:, 1, 3])
        assert np.array_equal(lines["estimate"], found.x_plus[:, 1, 3])

    def test_measured_data_have_no_truth(self):
        """A record of one's own data shows measurements and estimate."""
        drawn = plots.record(replace(ensemble(), truth=None), xlabel="time, s", ylabel="x, m")
        assert {line.get_label() for line in drawn.axes[0].lines} == {"measurement", "estimate"}

    def test_errors_are_those_of_the_runs_inside_their_bands(self):
        """Three rows: innovation, prediction error, filtering error; bands ±σ, ±2σ of the schedule."""
        found = ensemble()
        drawn = plots.errors(found, xlabel="time, s", unit="m", shown=7)
        assert [axes.get_ylabel() for axes in drawn.axes] == [
            "innovation, m",
            "prediction error, m",
            "filtering error, m",
        ]
        for axes, when in zip(drawn.axes[1:], ("minus", "plus"), strict=True):
            e, sd = found.error(when)[:, 0], np.sqrt(getattr(found, f"P_{when}")[:, 0, 0])
            drawn_lines = [line.get_ydata() for line in axes.lines]
            assert len(drawn_lines) == 7 + 1 + 4
            assert all(np.array_equal(drawn_lines[run], e[:, run]) for run in range(7))
            for band, wanted in zip(drawn_lines[8:], (sd, -sd, 2 * sd, -2 * sd), strict=True):
                assert np.allclose(band, wanted, rtol=1e-12, atol=0)

    def test_statistics_stand_against_their_theory(self):
        """RMS against √P, mean against 0, NEES against n and NIS against m, a row per state."""
        statistics = montecarlo.monte_carlo(MODEL, steps=STEPS, runs=RUNS, seed=5)
        drawn = theory()
        labels = [axes.get_ylabel() for axes in drawn.axes]
        assert len(labels) == 6
        assert labels[0].endswith("x, m")
        assert labels[2].endswith("v, m/s")
        P = covariances(MODEL, STEPS).P_plus
        for i in range(2):
            lines = {line.get_label(): line.get_ydata() for line in drawn.axes[2 * i].lines}
            assert np.allclose(lines["theory"], np.sqrt(P[:, i, i]), rtol=1e-12, atol=0)
            assert np.array_equal(lines["ensemble"], statistics.rms[:, i])
            lines = {line.get_label(): line.get_ydata() for line in drawn.axes[2 * i + 1].lines}
            assert not lines["theory"].any()
            assert np.array_equal(lines["ensemble"], statistics.bias[:, i])
        for axes, dof in zip(drawn.axes[4:], (2, 1), strict=True):
            lines = {line.get_label(): line.get_ydata() for line in axes.lines}
            assert set(lines["theory"][1:]) == {dof}


@pytest.mark.parametrize(
    ("low", "high", "wanted"), [(0.31, 0.92, {"0.4", "0.6"}), (1.2, 8.5, {"2", "4"}), (0.01, 200.0, {r"$\mathdefault{10^{0}}$"})]
)
def test_a_short_logarithmic_axis_has_plain_numbers(low, high, wanted):
    """0.9 and not 9×10⁻¹; powers of ten where it is long."""
    figure = plots.lines([1.0, 2.0], {"": [low, high]}, xlabel="x", ylabel="y", log="y")
    figure.canvas.draw()
    texts = {tick.get_text() for tick in figure.axes[0].yaxis.get_ticklabels(which="both")} - {""}
    assert wanted <= texts
    assert len(wanted) > 1 or all("10^" in text for text in texts)
    assert len(wanted) == 1 or not any("10^" in text for text in texts)
