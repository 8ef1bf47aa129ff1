"""Figures of continuous filters and of the frequency domain: what they draw is what they were given."""

from __future__ import annotations

import ast
import inspect

import control
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ctlabs import montecarlo
from ctlabs.filtering import bucy, steady
from ctlabs.labs.experiment import covariances
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.reporting import plots, render
from ctlabs.reporting.drawing import Drawing
from ctlabs.reporting.plots import frequency
from tests.reference import EXACT, close

WIENER = ContinuousModel([[0]], [[1]], [[4]], [[1]], Rc=[[16]], P0=[[25]], x0=[10], states=["x"], units=["m"])
OMEGA = np.geomspace(0.01, 100.0, 31)
T = np.linspace(0.0, 8.0, 41)


def curves(axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The lines of an axes by label."""
    return {line.get_label(): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in axes.lines}


def drawn(described: Drawing | Figure) -> Figure:
    """The figure, after it has been rendered without an error."""
    figure = render.drawn(described)
    FigureCanvasAgg(figure).draw()
    return figure


def words(figure: Figure) -> list[str]:
    """The entries of its legend."""
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


class TestResponse:
    def test_control_objects_and_polynomials_have_one_response(self):
        """A transfer function, a state space, and num, den give H(jω) = 0.5/(jω + 0.5), written by hand."""
        hand = 0.5 / (1j * OMEGA + 0.5)
        for system in (control.tf([0.5], [1, 0.5]), bucy.filter_system(WIENER), bucy.transfer_function(WIENER), hand):
            assert close(plots.response(system, OMEGA), hand, EXACT)
        assert not close(plots.response(([0.5 * 1.05], [1, 0.5]), OMEGA), hand, EXACT)

    def test_sampled_response_is_that_of_powers_of_z(self):
        """In z⁻¹ the response is K/(1 − (1−K)e^{−jω dt}), the same from a control object in z, up to π/dt."""
        dt = 0.5
        num, den = steady.transfer_function(discretise(WIENER, dt))
        K, below = num[0], OMEGA <= np.pi / dt
        hand = K / (1 - (1 - K) * np.exp(-1j * OMEGA[below] * dt))
        for system in ((num, den, dt), ([K], [1, K - 1], dt), control.tf([K, 0], [1, K - 1], dt)):
            found = plots.response(system, OMEGA)
            assert close(found[below], hand, EXACT)
            assert np.isnan(found[~below]).all()
            assert below.sum() < len(OMEGA)

    def test_single_frequencies_work(self):
        """One frequency gives one number."""
        assert plots.response(control.tf([0.5], [1, 0.5]), [0.5]).shape == (1,)

    @pytest.mark.parametrize(
        ("system", "omega", "words"),
        [
            (([1.0], [1.0, 1.0]), [0.0, 1.0], r"omega: expected frequencies > 0, received 0"),
            (np.ones(3), [1.0, 2.0], r"received shape \(3,\)"),
            (control.tf([1], [1, 1], True), [1.0], r"expected a period dt"),
            (control.ss(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2))), [1.0], r"received shape \(2, 2, 1\)"),
        ],
        ids=["frequency 0", "another length", "no period", "two inputs"],
    )
    def test_bad_input_is_named(self, system, omega, words):
        """The message says what was expected and what was received."""
        with pytest.raises(ValueError, match=words):
            plots.response(system, omega)


class TestBode:
    def test_bode_draws_magnitude_and_phase_of_every_system(self):
        """The curves are |H| and arg H; at the corner of a first-order low-pass 1/√2 and −45°."""
        omega = np.array([0.05, 0.5, 5.0])
        figure = drawn(plots.bode({"low-pass": ([0.5], [1, 0.5])}, omega, marks={"corner": 0.5}))
        magnitude, phase = figure.axes
        assert close(magnitude.lines[0].get_ydata()[1], np.sqrt(0.5), EXACT)
        assert close(phase.lines[0].get_ydata()[1], -45.0, EXACT)
        assert words(figure) == ["low-pass", "corner"]
        assert (magnitude.get_xscale(), magnitude.get_yscale(), phase.get_yscale()) == ("log", "log", "linear")
        assert "rad/s" in phase.get_xlabel()

    def test_the_phase_has_no_jumps(self):
        """Three lags take the phase to −270°, not to +90°."""
        figure = drawn(plots.bode({"lags": ([1.0], [1.0, 3.0, 3.0, 1.0])}, np.geomspace(0.01, 1000, 200)))
        assert close(figure.axes[1].lines[0].get_ydata()[-1], -270.0, 1e-2)

    def test_a_sampled_system_ends_at_its_nyquist_frequency(self):
        """What lies above π/dt is not drawn, and the frequency is marked."""
        figure = drawn(plots.bode({"sampled": ([0.5, 0.0], [1.0, -0.5], 1.0)}, OMEGA))
        shown = OMEGA[np.isfinite(figure.axes[0].lines[0].get_ydata())]
        assert shown.max() <= np.pi < OMEGA.max()
        assert "Nyquist frequency" in words(figure)

    def test_a_filter_that_is_zero_is_drawn(self):
        """Without a response there is no logarithm: the magnitude stays linear and there is no phase."""
        figure = drawn(plots.bode({"zero": ([0.0], [1.0, 1.0])}, OMEGA))
        assert figure.axes[0].get_yscale() == "linear"
        assert np.isnan(figure.axes[1].lines[0].get_ydata()).all()


class TestPoles:
    def test_poles_and_zeros_are_those_of_the_system(self):
        """From a control object, from polynomials and from an array of poles."""
        autopilot = control.tf([0.3, 0.003], [1, 0.006, 0.003])
        figure = drawn(
            plots.poles({"object": autopilot, "num, den": ([0.3, 0.003], [1, 0.006, 0.003]), "array": [-1 + 2j]})
        )
        found = curves(figure.axes[0])
        hand = np.sort_complex(np.array([-0.003 - 1j * np.sqrt(0.003 - 9e-6), -0.003 + 1j * np.sqrt(0.003 - 9e-6)]))
        for name in ("object", "num, den"):
            x, y = found[name]
            assert close(np.sort_complex(x + 1j * y), hand, EXACT)
            assert close(found[f"{name}, zeros"][0], [-0.01], EXACT)
        assert found["array"][0] == [-1]
        assert "array, zeros" not in found

    def test_every_point_and_the_boundary_are_in_view(self):
        """The limits contain all poles and zeros and, in the plane of s, the imaginary axis."""
        for found in ([-100.0, -1.0], [3 + 4j, 3 - 4j], [0.0]):
            axes = drawn(plots.poles({"poles": found})).axes[0]
            (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
            assert left < np.real(found).min() <= np.real(found).max() < right
            assert low < np.imag(found).min() <= np.imag(found).max() < high
            assert left < 0 < right

    def test_the_plane_of_z_shows_the_unit_circle(self):
        """A sampled filter's pole 1 − K stands inside the circle, its zero at the origin."""
        dt = 1.0
        num, den = steady.transfer_function(discretise(WIENER, dt))
        figure = drawn(plots.poles({"filter": (num, den, dt), "short": (num[:1], den, dt)}, plane="z"))
        found = curves(figure.axes[0])
        for name in ("filter", "short"):
            assert close(found[name][0], [-den[1]], EXACT)
            assert close(found[f"{name}, zeros"][0], [0.0], EXACT)
        circle = figure.axes[0].lines[0].get_xydata()
        assert np.hypot(*circle.T) == pytest.approx(1)
        assert figure.axes[0].get_aspect() == 1
        assert figure.axes[0].get_xlabel().endswith("(ratio per step)")

    @pytest.mark.parametrize(
        ("system", "plane", "words"),
        [
            (([1.0], [1.0, 1.0]), "w", r"plane: expected 's' or 'z', received 'w'"),
            (([1.0], [1.0, 1.0]), "z", r"F: expected a sampled system .* received a continuous one"),
            (control.tf([1], [1, 0.5], 0.25), "s", r"F: expected a continuous system .* dt = 0.25 s"),
        ],
        ids=["plane", "continuous", "sampled"],
    )
    def test_a_system_of_the_other_kind_is_refused(self, system, plane, words):
        """Poles in s and in z do not go into one plane."""
        with pytest.raises(ValueError, match=words):
            plots.poles({"F": system}, plane=plane)


class TestTransient:
    def test_curves_and_limits_are_drawn_as_given(self):
        """P(t), its limit at √(QR), and the settling time."""
        P = bucy.transient(WIENER, T).P[:, 0, 0]
        figure = drawn(
            plots.transient(T, {"P(t)": P}, ylabel="variance, m²", limits={"P(t)": 8.0}, marks={"settled": 4.64})
        )
        found = curves(figure.axes[0])
        assert close(found["P(t)"][1], P, EXACT)
        assert list(found["limit"][1]) == [8.0, 8.0]
        assert found["settled"][0][0] == 4.64
        assert figure.axes[0].get_ylim()[0] == 0
        assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("t, s", "variance, m²")

    def test_logarithmic_axes(self):
        """Both axes when asked for; gaps (NaN) stay gaps."""
        axes = drawn(plots.transient([1, 10, 100], {"P": [5.0, np.nan, 0.1]}, ylabel="P, m²", log="xy")).axes[0]
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert np.isnan(axes.lines[0].get_ydata()[1])

    def test_a_limit_without_a_curve_is_refused(self):
        """A misspelt name is not dropped in silence."""
        with pytest.raises(ValueError, match=r"limits: expected names among \['P'\], received \['Q'\]"):
            plots.transient(T, {"P": T}, ylabel="P, m²", limits={"Q": 1.0})


class TestSampled:
    def test_the_sawtooth_is_the_schedule_and_the_curve_is_p_of_t(self):
        """Teeth P⁻, P⁺ at every measurement, and the continuous variance through them."""
        schedule = covariances(discretise(WIENER, 1.0), 8)
        P = bucy.transient(WIENER, T).P[:, 0, 0]
        figure = drawn(plots.sampled({"dt = 1 s": schedule}, T, P, ylabel="variance, m²", limit=8.0))
        found = curves(figure.axes[0])
        assert close(found["prediction P⁻"][1], schedule.P_minus[1:, 0, 0], EXACT)
        assert close(found["filtering P⁺"][1], schedule.P_plus[:, 0, 0], EXACT)
        assert close(found["continuous P(t)"][1], P, EXACT)
        teeth = figure.axes[0].lines[0].get_ydata()
        assert list(teeth[:3]) == [25.0, 29.0, schedule.P_plus[1, 0, 0]]
        assert (schedule.P_plus[1:, 0, 0] < np.interp(schedule.t[1:], T, P)).all()

    def test_only_the_time_of_the_curve_is_shown(self):
        """A schedule that goes on longer is cut; one panel for each schedule."""
        schedule = covariances(discretise(WIENER, 1.0), 20)
        figure = drawn(plots.sampled({"one": schedule, "two": schedule}, T, np.ones(41), ylabel="P, m²"))
        assert [axes.get_title() for axes in figure.axes] == ["one", "two"]
        assert curves(figure.axes[1])["filtering P⁺"][0].max() == 8.0

    def test_a_logarithmic_time_begins_after_t0(self):
        """t0 has no place on a logarithmic axis, and is left out rather than drawn at the edge."""
        schedule = covariances(discretise(WIENER, 1.0), 8)
        axes = drawn(plots.sampled({"": schedule}, T[1:], T[1:], ylabel="P, m²", log="xy")).axes[0]
        found = curves(axes)
        assert found["filtering P⁺"][0][0] == found["prediction P⁻"][0][0] == 1.0
        assert axes.lines[0].get_ydata()[0] == 29.0

    def test_many_measurements_are_lines_not_points(self):
        """More than sixty markers would be a smear."""
        dense = covariances(discretise(WIENER, 0.05), 160)
        few = covariances(discretise(WIENER, 0.5), 16)
        lines = [plots.sampled({"": s}, T, T, ylabel="P, m²").axes[0].lines[2] for s in (dense, few)]
        assert [(line.get_marker(), line.get_linestyle()) for line in lines] == [("", "-"), ("o", "None")]


class TestGains:
    def test_discrete_gains_are_shown_over_the_period(self):
        """K/dt, from the first measurement on, beside Kc(t)."""
        schedule, transient = covariances(discretise(WIENER, 0.5), 16), bucy.transient(WIENER, T)
        figure = drawn(plots.gains(T, transient.K, schedule, names=["K"], units=["1/s"]))
        found = curves(figure.axes[0])
        assert close(found["continuous filter"][1], transient.K[:, 0, 0], EXACT)
        x, y = found["discrete filter, gain over the period"]
        assert x[0] == 0.5
        assert close(y, schedule.K[1:, 0, 0] / 0.5, EXACT)
        assert figure.axes[0].get_ylabel() == "K, 1/s"

    def test_negative_gains_on_a_logarithmic_axis_are_shown_by_their_size(self):
        """The caller says so in the name."""
        schedule = covariances(discretise(WIENER, 0.5), 16)
        axes = drawn(plots.gains(T[1:], -T[1:, None, None], schedule, names=["|K|"], units=["1/s"], log="y")).axes[0]
        assert (axes.lines[0].get_ydata() > 0).all()


class TestEstimates:
    def test_truth_measurements_and_bands(self):
        """Each filter keeps its own time grid and its ±σ band."""
        figure = drawn(
            plots.estimates(
                (T, T), {"a": (T, T + 1, np.ones(41)), "b": (T[::8], T[::8], np.ones(6))}, ylabel="x, m", measurements=(T[::8], T[::8] - 1)
            )
        )  # fmt: skip
        axes = figure.axes[0]
        found = curves(axes)
        assert close(found["a ± σ"][1], T + 1, EXACT)
        assert len(found["b ± σ"][0]) == 6
        assert close(found["truth"][1], T, EXACT)
        assert close(found["measurement"][1], T[::8] - 1, EXACT)
        band = axes.collections[0].get_paths()[0].vertices[:, 1]
        assert (band.min(), band.max()) == (0.0, 10.0)

    def test_any_number_of_filters(self):
        """No filter is left out when the colours run out."""
        figure = plots.estimates(None, {str(i): (T, T, T) for i in range(5)}, ylabel="x, m", log="x")
        assert len(figure.axes[0].lines) == 5


class TestEnsembleLog:
    def test_errors_that_shrink_are_shown_relative_to_theory(self):
        """RMS on a logarithmic axis, the mean error in σ, from the first measurement on."""
        model = discretise(WIENER, 0.5)
        theory, stats = covariances(model, 20), montecarlo.monte_carlo(model, steps=20, runs=50, seed=1)
        figure = drawn(plots.ensemble_log(stats, theory.P_plus, xlabel="t, s", units=["m"], names=["x"], log="xy"))
        rms, bias, nees, nis = figure.axes
        assert rms.get_yscale() == "log"
        assert close(curves(rms)["theory"][1], np.sqrt(theory.P_plus[1:, 0, 0]), EXACT)
        assert close(curves(bias)["ensemble"][1], stats.bias[1:, 0] / np.sqrt(theory.P_plus[1:, 0, 0]), EXACT)
        assert close(curves(nees)["ensemble"][1], stats.nees[1:], EXACT)
        assert close(curves(nis)["theory"][1], np.ones(20), EXACT)
        assert nis.get_xscale() == "log"

    def test_a_state_that_is_known_is_left_blank(self):
        """A variance of zero has no logarithm and no relative error."""
        known = ContinuousModel([[0, 0], [0, 0]], [[1], [0]], [[4]], [[1, 0]], Rc=[[16]], P0=[[25, 0], [0, 0]])
        model = discretise(known, 0.5)
        theory, stats = covariances(model, 5), montecarlo.monte_carlo(model, steps=5, runs=20, seed=1)
        figure = drawn(plots.ensemble_log(stats, theory.P_plus, xlabel="t, s", units=["m", "m"], names=["x", "y"]))
        assert np.isnan(curves(figure.axes[2])["ensemble"][1]).all()
        assert np.isnan(curves(figure.axes[3])["ensemble"][1]).all()
        assert figure.axes[2].get_yscale() == "linear"


def test_plots_do_not_import_control():
    """Objects of python-control are handed in; importing it costs a second."""
    tree = ast.parse(inspect.getsource(frequency))
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not [name for name in names if name.split(".")[0] == "control"]
