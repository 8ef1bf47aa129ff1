"""The interactive figures: that they show the arrays, the units and the names, in both themes."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ctlabs.files.modelfile import ModelFile, ready
from ctlabs.models import Anomaly
from ctlabs.reporting import paper, screen
from ctlabs.reporting.drawing import Band, Curve, Drawing, Mark, Panel, line_styles
from ctlabs.reporting.plots.base import STYLE
from ctlabs.reporting.screen import COLOURS, to_plotly, untyped
from ctlabs.studies.understanding import Understanding, compute
from ctlabs.text import per, squared
from ctlabs.workbench.runs import experiments, figures
from ctlabs.workbench.runs.outcomes import Asked, Outcome, Upload, outcome
from tests.reference import EXACT, SOLVER

#: What single precision keeps of a curve, relative to its span.
SHOWN = 1e-6
THEMES = (False, True)


@cache
def model(name: str = "constant_velocity", **constants: float) -> ModelFile:
    return ready(name).replace(constants)


@cache
def simulated() -> Outcome:
    """Three algorithms, a filter that believes a smaller noise, and a gap in the measurements."""
    plan = Asked(40, 60, 3, algorithms=("joseph", "ud", "conventional"), design=model(q=0.02).dumps(),
                anomalies=(Anomaly(10, 0, last=14), Anomaly(20, 0)))  # fmt: skip
    return outcome(experiments.run(model().dumps(), plan.plain()))


@cache
def measured() -> Outcome:
    """A record of 60 rows with a hole."""
    rng = np.random.default_rng(5)
    rows = [f"{k},{'' if 20 <= k < 25 else 3.0 * k + rng.normal(0, 5)}" for k in range(1, 61)]
    data = Upload("record.csv", "\n".join(["t,position", *rows]))
    return outcome(experiments.run(model().dumps(), Asked(data=data).plain()))


@cache
def understood(name: str = "constant_velocity") -> Understanding:
    return compute(model(name), quick=True)


def drawings() -> dict[str, Drawing]:
    """Every kind of drawing."""
    a, b, u = simulated(), measured(), understood()
    both = figures.side_by_side(("1", a), ("2", b))
    assert both is not None
    return {
        "estimates": figures.estimates(a, [0, 1]),
        "estimates of data": figures.estimates(b, [0, 1]),
        "errors": figures.errors(a, [0, 1]),
        "accuracy": figures.accuracy(a, [0, 1]),
        "bias": figures.bias(a, [0, 1]),
        "consistency": figures.consistency(a),
        "gains": figures.gains(a, [0, 1]),
        "variances": figures.variances(a, [0, 1]),
        "innovations": figures.innovations(a, [0]),
        "nis": figures.nis(a),
        "whiteness": figures.whiteness(a),
        "poles z": u.poles.value.drawing,
        "poles s": u.poles_continuous.value.drawing,
        "bode": u.bode.value.drawing(),
        "deviations": u.deviations([0, 1]),
        "side by side": both,
        "algorithms": figures.pictures(a)["algorithms"][0],
    }


NAMES = ("estimates", "estimates of data", "errors", "accuracy", "bias", "consistency", "gains", "variances", "innovations",
         "nis", "whiteness", "poles z", "poles s", "bode", "deviations", "side by side", "algorithms")  # fmt: skip


def trace(figure: dict[str, Any], name: str, panel: int = 1) -> dict[str, Any]:
    axis = "y" if panel == 1 else f"y{panel}"
    return next(each for each in figure["data"] if each["name"] == name and each["yaxis"] == axis)


def close(found: Any, wanted: Any) -> bool:
    found, wanted = np.asarray(found), np.asarray(wanted, dtype=float)
    span = float(np.ptp(wanted[np.isfinite(wanted)])) if np.isfinite(wanted).any() else 1.0
    return np.allclose(found, wanted, rtol=0, atol=SHOWN * span, equal_nan=True)


# What is shown is what was computed -----------------------------------------------------------------------------------


def test_the_curves_are_the_arrays() -> None:
    """Truth, measurement, estimate, theory and gain in the browser are those of the outcome, gaps included."""
    found = simulated()
    figure = to_plotly(figures.estimates(found, [0, 1]))
    pairs = [
        (trace(figure, "truth", 3), found.truth[:, 1, 0]),  # type: ignore[index]  # simulated
        (trace(figure, "measurement"), found.z[:, 0, 0]),
        (trace(figure, "estimate, Joseph's form", 3), found.x_plus[:, 1, 0]),
        (trace(figure, "estimate, Factors UDUᵀ"), found.estimates["ud"][:, 0]),
        (trace(to_plotly(figures.gains(found, [0, 1])), "from position", 2), found.K[:, 1, 0]),
        (trace(to_plotly(figures.accuracy(found, [1])), "theory of this filter"), found.actual_rms[:, 1]),  # type: ignore[index]
        (trace(to_plotly(figures.nis(found)), "expected"), np.where(found.nis_dof > 0, found.nis_dof, np.nan)),
    ]
    for drawn, wanted in pairs:
        assert close(untyped(drawn["x"]), found.t)
        assert close(untyped(drawn["y"]), wanted)
        assert not close(untyped(drawn["y"]), 1.05 * np.asarray(wanted))
    assert np.isnan(untyped(trace(figure, "measurement")["y"])).sum() == np.isnan(found.z[:, 0, 0]).sum() > 5


def test_the_band_is_one_sigma_around_the_estimate() -> None:
    """The outline goes along x̂ + σ and back along x̂ − σ; σ stands beside the value."""
    found = simulated()
    figure = to_plotly(figures.estimates(found, [0]))
    band, line = trace(figure, "estimate, Joseph's form ± σ"), trace(figure, "estimate, Joseph's form")
    x, sd = found.x_plus[:, 0, 0], np.sqrt(found.P_plus[:, 0, 0])
    outline, count = untyped(band["y"]), len(x)
    assert band["fill"] == "toself"
    assert close(outline[:count], x + sd)
    assert close(outline[count : 2 * count], (x - sd)[::-1])
    assert not close(outline[:count], x + 1.05 * sd)
    assert close(untyped(line["customdata"]), sd)
    assert "±" in line["hovertemplate"]


def test_a_band_has_the_gaps_of_its_edges() -> None:
    """One closed outline for every stretch; an instant alone between two gaps is still seen."""
    low = np.array([0.0, 1.0, np.nan, 2.0, np.inf, 3.0, 4.0])
    drawn = to_plotly(Drawing("Band", "t, s", (Panel("x", (), (Band("band", np.arange(7.0), low, low + 1),)),)))["data"][
        0
    ]
    x, y = untyped(drawn["x"]), untyped(drawn["y"])
    starts = np.flatnonzero(np.isnan(x)).tolist()
    stretches = np.split(x, starts)
    assert [sorted(set(part[np.isfinite(part)].round(6))) for part in stretches] == [[0, 1], [2.7, 3.3], [5, 6]]
    assert np.nanmin(y) == 0
    assert np.nanmax(y) == 5
    for part_x, part_y in zip(stretches, np.split(y, starts), strict=True):
        inside = np.isfinite(part_x)
        assert part_x[inside][0] == part_x[inside][-1]
        assert part_y[inside][0] == part_y[inside][-1]


@given(
    st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=30),
    st.sampled_from([0.0, 1e9, -1e12]),
)
@settings(deadline=None, derandomize=True, max_examples=60)
def test_numbers_travel_as_exactly_as_they_are_seen(values: list[float], offset: float) -> None:
    """Seven digits of the span survive, also of small changes of a large number, for which more digits are sent."""
    wanted = np.array(values) + offset
    figure = to_plotly(Drawing("Any", "t, s", (Panel("x", (Curve("x", np.arange(len(values)), wanted),)),)))
    assert close(untyped(figure["data"][0]["y"]), wanted)


def test_the_sawtooth_goes_through_every_prediction_and_update() -> None:
    """P⁻ and P⁺ of each instant, one after the other at the same time."""
    found = simulated()
    drawing = figures.variances(found, [1])
    line = drawing.panels[0].curves[0]
    assert np.array_equal(np.asarray(line.y)[::2], found.P_minus[:, 1, 1])
    assert np.array_equal(np.asarray(line.y)[1::2], found.P_plus[:, 1, 1])
    assert np.array_equal(np.asarray(line.x)[::2], np.asarray(line.x)[1::2])


def test_innovations_outside_their_band_are_told_apart() -> None:
    """Each innovation is in one of the two curves, by its size in its own standard deviations."""
    found = simulated()
    curves = figures.innovations(found, [0]).panels[0].curves
    inside, outside = (np.asarray(curve.y) for curve in curves)
    size = np.abs(found.innovation[:, 0, 0]) / (1.96 * found.innovation_sd[:, 0])
    there = np.isfinite(size)
    assert outside[np.isfinite(outside)].size > 0
    assert np.array_equal(np.isfinite(outside), there & (size > 1))
    assert np.array_equal(np.isfinite(inside), there & (size <= 1))


def test_the_bode_plot_is_the_transfer_function() -> None:
    """Magnitude and phase agree with numerator and denominator at every frequency."""
    found = understood()
    drawing = found.bode.value.drawing()
    for i, transfer in enumerate(found.transfers.value):
        late = np.exp(-1j * found.bode.value.w * transfer.dt)
        value = np.polyval(transfer.num[::-1], late) / np.polyval(transfer.den[::-1], late)
        gain, phase = (np.asarray(panel.curves[i].y) for panel in drawing.panels)
        assert np.allclose(gain, np.abs(value), rtol=1e-6)
        assert np.allclose(np.exp(1j * np.radians(phase)), value / np.abs(value), atol=1e-6)
        assert not np.allclose(1.05 * gain, np.abs(value), rtol=1e-6)


def test_poles_are_shown_in_one_scale_inside_the_axes() -> None:
    """The unit circle is a circle, and no pole is beyond the axes; those of the model and of the filter are all there."""
    for part in (understood().poles.value, understood("oscillator").poles_continuous.value):
        figure = to_plotly(part.drawing)
        layout = figure["layout"]
        assert layout["yaxis"].get("scaleratio") == (1 if part.plane == "z" else None)
        drawn = trace(figure, "model")
        values = untyped(drawn["x"]) + 1j * untyped(drawn["y"])
        assert np.allclose(
            np.sort_complex(values), np.sort_complex(part.model), atol=1e-6 * np.abs(part.model).max(initial=1.0)
        )
        for each in figure["data"]:
            for axis in "xy":
                low, high = layout[f"{axis}axis"]["range"]
                rounding = SHOWN * (high - low)
                assert (untyped(each[axis]) >= low - rounding).all()
                assert (untyped(each[axis]) <= high + rounding).all()


def test_the_limits_of_the_deviations_are_those_of_the_steady_filter() -> None:
    """The dotted lines, which the last instants have reached."""
    found = understood()
    drawing, limit = found.deviations([0]), found.limit.value
    curves = {curve.name: np.asarray(curve.y) for curve in drawing.panels[0].curves}
    assert {level.name: level.at for level in drawing.panels[0].levels} == {
        "limit of σ⁻": limit.sd_minus[0],
        "limit of σ⁺": limit.sd_plus[0],
    }
    assert close(untyped(trace(to_plotly(drawing), "limit of σ⁺")["y"]), [limit.sd_plus[0]] * 2)
    assert curves["σ⁺"][-1] == pytest.approx(limit.sd_plus[0], rel=0.02)
    assert curves["σ⁺"][-1] != pytest.approx(1.05 * limit.sd_plus[0], rel=0.02)


# Axes ----------------------------------------------------------------------------------------------------------------


def test_a_size_that_falls_far_is_drawn_over_a_logarithmic_axis() -> None:
    """From 10⁴ to 1, but not from 4 to 1, and not where it is 0."""

    def axis(values: Any) -> dict[str, Any]:
        curve = Curve("σ", np.arange(len(values)), values)
        layout: dict[str, Any] = to_plotly(Drawing("σ", "t, s", (Panel("σ, m", (curve,), kind="size"),)))["layout"]
        return layout["yaxis"]

    assert axis([1e4, 10, 1, 1, 1])["type"] == "log"
    for values in ([4.0, 3, 2, 1, 1], [1e4, 10, 1, 1, 0]):
        assert axis(values).get("type") != "log"
        assert axis(values)["rangemode"] == "tozero"


def test_a_few_large_values_do_not_hide_the_others() -> None:
    """They are beyond the axes at first, and the figure says so; an ordinary curve is not cut."""
    values = np.sin(np.arange(200.0))
    for first, cut in ((500.0, True), (1.0, False)):
        values[0] = first
        drawing = Drawing("Error", "t, s", (Panel("error, m", (Curve("e", np.arange(200.0), values),), kind="signed"),))
        layout = to_plotly(drawing)["layout"]
        assert ("range" in layout["yaxis"]) is cut
        assert ("annotations" in layout) is cut
        if cut:
            low, high = layout["yaxis"]["range"]
            assert low < -1 < 1 < high < 3


def test_a_vague_beginning_of_a_band_does_not_hide_the_rest() -> None:
    """The first innovation's band, before anything is known, is beyond the axes at first; a band of one width is not."""
    x, values = np.arange(200.0), np.sin(np.arange(200.0))
    for first, cut in ((500.0, True), (2.0, False)):
        high = np.full(200, 2.0)
        high[0] = first
        panel = Panel("innovation, m", (Curve("innovation", x, values),), bands=(Band("95 % band", x, -high, high),), kind="signed")
        axis = to_plotly(Drawing("Innovations", "t, s", (panel,)))["layout"]["yaxis"]
        assert ("range" in axis) is cut
        assert not cut or 2 < axis["range"][1] < 4


@pytest.mark.parametrize("name", NAMES)
def test_every_axis_names_its_unit(name: str) -> None:
    """The title of an axis is a name, a comma, a unit (a pure number: 1, or a name alone)."""
    layout = to_plotly(drawings()[name])["layout"]
    titles = [value["title"]["text"] for key, value in layout.items() if re.match(r"[xy]axis", key)]
    pure = {"autocorrelation of position", "largest error against 50 digits", "operations of a step", "magnitude", ""}
    for title in titles:
        unit = title.rpartition(", ")[2] if ", " in title else ""
        assert (
            unit in {"s", "m", "m/s", "m²", "(m/s)²", "1", "(m/s)/m", "1/s", "degrees", "rad/s", "innovations"}
            or title in pure or title.endswith("(ratio per step)")
        ), title


def test_units_of_variances_and_gains() -> None:
    """The unit's square, and a unit per unit, in parentheses where they are needed."""
    units = {"m": "m²", "rad/s": "(rad/s)²", "m²": "m⁴", "s⁻¹": "(s⁻¹)²", "°C": "°C²", "%": "%²", "1": "1", "": ""}
    assert {unit: squared(unit) for unit in units} == units
    assert [per(*units) for units in (("m", "m"), ("m/s", "m"), ("m", ""), ("", "m/s"))] == [
        "1",
        "(m/s)/m",
        "m",
        "1/(m/s)",
    ]


# Legend, themes, safety -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_the_legend_stands_once_and_hides_its_curve_in_all_panels(name: str) -> None:
    """Traces of one name are one group, and the first of them is named."""
    figure = to_plotly(drawings()[name])
    named = [each["legendgroup"] for each in figure["data"] if each["showlegend"]]
    assert len(named) == len(set(named)) > 0
    assert all(each["legendgroup"] == each["name"] for each in figure["data"])
    loud = {each["name"] for each in figure["data"] if each.get("hoverinfo") != "skip"}
    assert loud <= set(named)
    panels = drawings()[name].panels
    for curve in itertools.chain.from_iterable(panel.curves for panel in panels):
        copies = [each for each in figure["data"] if each["name"] == curve.name]
        assert len(copies) == sum(other.name == curve.name for panel in panels for other in panel.curves)


def test_other_algorithms_are_hidden_until_they_are_asked_for() -> None:
    """The first one is the estimate; the others wait in the legend."""
    figure = to_plotly(figures.estimates(simulated(), [0]))
    hidden = {each["name"] for each in figure["data"] if each.get("visible") == "legendonly"}
    assert hidden == {"estimate, Factors UDUᵀ", "estimate, Conventional form"}


@pytest.mark.parametrize("name", NAMES)
def test_a_theme_changes_colours_and_nothing_else(name: str) -> None:
    """Without its colours the dark figure is the light one."""
    light, dark = (json.dumps(to_plotly(drawings()[name], dark=dark), sort_keys=True) for dark in THEMES)
    colour = re.compile(r'"#[0-9A-Fa-f]{6}"|"rgba\([^)]*\)"')
    assert light != dark
    assert colour.sub("", light) == colour.sub("", dark)


def luminance(colour: str) -> float:
    values = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("dark", THEMES)
def test_colours_can_be_seen_and_texts_be_read(dark: bool) -> None:
    """Contrast of at least 3 for curves and 7 for texts (WCAG 2.2, 1.4.11 and 1.4.6)."""
    for pair in COLOURS.values():
        assert contrast(pair[dark], screen.BACKGROUND[dark]) >= 3
    assert contrast(screen.INK[dark], screen.BACKGROUND[dark]) >= 7
    assert contrast(screen.INK[dark], screen.HOVER[dark]) >= 7


#: What remains of linear colours for eyes without the second kind of cones (Machado, Oliveira & Fernandes 2009).
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]
)


@pytest.mark.parametrize("dark", THEMES)
def test_the_main_colours_differ_for_colour_blind_readers(dark: bool) -> None:
    """Truth, estimate, measurement, and the right filter or the smoothed estimate."""

    def seen(name: str) -> Any:
        colour = COLOURS[name][dark]
        return DEUTERANOPIA @ (np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255) ** 2.2

    for a, b in itertools.combinations(("black", "blue", "orange", "green"), 2):
        distance = np.linalg.norm(np.clip(seen(a), 0, 1) ** (1 / 2.2) - np.clip(seen(b), 0, 1) ** (1 / 2.2))
        assert distance > 0.15, (a, b)


def test_colours_are_those_of_the_reports() -> None:
    """Those on paper are of its style, in its order; black, blue, orange, green and brown are the same on a white page."""
    cycle = [f"#{each}" for each in re.findall(r"'([0-9A-F]{6})'", STYLE.read_text())]
    assert [paper.COLOURS[colour] for colour, _ in line_styles(8)] == cycle
    assert set(paper.COLOURS) == set(COLOURS)
    for name in ("black", "blue", "orange", "green", "brown"):
        assert COLOURS[name][0] == paper.COLOURS[name]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dark", THEMES)
def test_plotly_knows_every_property(name: str, dark: bool) -> None:
    """Its own library accepts the figure; a property that it does not know is refused."""
    graph_objects = pytest.importorskip("plotly.graph_objects")
    figure = to_plotly(drawings()[name], dark=dark)
    graph_objects.Figure(data=figure["data"], layout=figure["layout"])
    with pytest.raises(ValueError, match="told"):
        graph_objects.Figure(data=[{**figure["data"][0], "told": True}])


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_is_json_and_calls_nobody(name: str) -> None:
    """No number that JSON does not have, no address, no service."""
    text = json.dumps(to_plotly(drawings()[name]), allow_nan=False)
    assert "://" not in text
    config = json.loads(text)["config"]
    assert (config["displaylogo"], config["showSendToCloud"], config["plotlyServerURL"]) == (False, False, "")


def test_names_are_never_markup() -> None:
    """A state called <b> or %{x} is shown as it is called, with its unit, also where it is too long for its axis."""
    name = '<a href="x">&%{y}</a>'
    curve = Curve(name, [0, 1], [0, 1], unit="<i>")
    figure = to_plotly(Drawing(
        "Any", name, (Panel(name + ", " + "m" * 3, (curve,)), Panel("n" * 80 + ", m/s", (curve,)))
    ))
    text = json.dumps(figure)
    assert "<a" not in text
    assert "<i>" not in text
    assert "%{y}</a>" not in text
    assert figure["layout"]["yaxis2"]["title"]["text"].endswith("…, m/s")


# Numbers to copy -------------------------------------------------------------------------------------------------------


def read(text: str) -> dict[str, Any]:
    heads, *rows = (line.split("\t") for line in text.split("\n"))
    assert all(len(row) == len(heads) for row in rows)
    assert len(set(heads)) == len(heads)
    return {head: np.array([float(row[i]) if row[i] else np.nan for row in rows]) for i, head in enumerate(heads)}


def test_copied_numbers_have_all_their_digits() -> None:
    """What is pasted is equal to the last digit, with names, units and empty cells for gaps."""
    found = simulated()
    copied = read(figures.estimates(found, [0, 1]).text())
    assert np.array_equal(copied["t, s"], found.t)
    assert np.array_equal(copied["x: estimate, Joseph's form, m"], found.x_plus[:, 0, 0])
    assert np.array_equal(copied["v: estimate, Factors UDUᵀ, m/s"], found.estimates["ud"][:, 1])
    assert np.array_equal(copied["x: measurement, m"], found.z[:, 0, 0], equal_nan=True)


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_can_be_copied(name: str) -> None:
    """Each named curve is a column, with its own horizontal axis where the curves do not share one."""
    drawing = drawings()[name]
    copied = read(drawing.text())
    curves = [curve for panel in drawing.panels for curve in panel.curves if not curve.quiet]
    assert len(copied) in {len(curves) + 1, 2 * len(curves)}
    values = list(copied.values())
    for curve in curves:
        wanted = np.asarray(curve.y, dtype=float)
        assert any(np.array_equal(column[: len(wanted)], wanted, equal_nan=True) for column in values)


def test_a_table_to_copy_is_one_line_a_row() -> None:
    """Texts without tabs and line ends, numbers with all digits, nothing where there is nothing."""
    rows = [["a\tb\nc", 0.1, None], [np.float64(1 / 3), np.int64(2), True], ["x", [1.0, 0.25], float("nan")]]
    assert figures.table(rows) == "a b c\t0.1\t\n0.3333333333333333\t2\tTrue\nx\t[1, 0.25]\t"


# Two experiments -------------------------------------------------------------------------------------------------------


def test_two_experiments_are_compared_where_they_have_the_same_states() -> None:
    """By name and unit, wherever the state stands; without any there is no figure."""
    a, b = simulated(), measured()
    drawing = figures.side_by_side(("first", a), ("second", b))
    assert drawing is not None
    sds = {curve.name: np.asarray(curve.y) for curve in drawing.panels[1].curves}
    assert set(sds) == {"first: σ", "first: RMS", "second: σ"}
    assert np.allclose(sds["second: σ"] ** 2, b.P_plus[:, 1, 1], rtol=EXACT)
    other = outcome(experiments.run(model("local_level").dumps(), Asked(10, 5).plain()))
    assert figures.side_by_side(("1", a), ("2", other)) is None


def test_a_state_of_which_nothing_is_known_leaves_a_gap() -> None:
    """An infinite variance at the beginning is no point of a figure, and the rest is as it was."""
    known = simulated()
    P = known.P_plus.copy()
    P[0, 0, 0] = np.inf
    found = replace(known, P_plus=P)
    band = trace(to_plotly(figures.estimates(found, [0])), "estimate, Joseph's form ± σ")
    count = len(known.t) - 1
    assert np.isfinite(untyped(band["y"])).all()
    assert close(untyped(band["y"])[:count], (known.x_plus[:, 0, 0] + known.sd_plus[:, 0])[1:])
    drawn = trace(to_plotly(figures.variances(found, [0])), "P⁺")
    assert np.isnan(untyped(drawn["y"])).tolist() == [True] + [False] * count


def test_the_numbers_of_a_family_are_told_apart() -> None:
    """No two of the first 24 curves have the same colour and dash."""
    styles = line_styles(24)
    assert len(set(styles)) == 24
    assert {style for _, style in styles} == {"line", "dash", "dot"}


def test_the_measurement_is_drawn_where_it_reads_the_state() -> None:
    """z = x is shown with x, in its unit, and nowhere else."""
    panels = figures.estimates(simulated(), [0, 1]).panels
    there = ["measurement" in {curve.name for curve in panel.curves} for panel in panels]
    assert [panel.label for panel in panels] == ["x, m", "x, less its estimate, m", "v, m/s"]
    assert there == [True, True, False]


def test_smoothed_estimates_have_a_band_of_their_own() -> None:
    """Of data; it is nowhere wider than that of the filter."""
    found = measured()
    figure = to_plotly(figures.estimates(found, [0]))
    smoothed = trace(figure, "smoothed")
    assert close(untyped(smoothed["y"]), found.smoothed[:, 0])  # type: ignore[index]  # of data
    assert (untyped(smoothed["customdata"]) <= found.sd_plus[:, 0] * (1 + SOLVER) + 1e-6).all()
    assert figures.estimates(found, [0]).name == "Measurement and estimate"


def test_a_long_legend_has_room_of_its_own() -> None:
    """More lines of names move the panels down by as much as they are high; a name that stands in two panels counts once."""

    def drawn(names: int, panels: int = 1) -> Drawing:
        curves = tuple(Curve(f"estimate by form {i}", [0.0, 1.0], [0.0, 1.0]) for i in range(names))
        return Drawing("some", "t, s", (Panel("x, m", curves),) * panels)

    one, many = drawn(2), drawn(6)
    assert (screen.above(one), screen.above(many)) == (screen.ABOVE, screen.ABOVE + screen.LINE)
    assert screen.height(many) - screen.height(one) == screen.LINE
    assert to_plotly(many)["layout"]["margin"]["t"] == screen.above(many)
    assert screen.above(drawn(2, panels=3)) == screen.above(one)
    assert screen.above(drawn(100)) == screen.ABOVE + (screen.LINES - 1) * screen.LINE


# On paper ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_drawing_is_the_same_on_paper(name: str) -> None:
    """Every curve that is not hidden is a line, a bar or points of the same numbers; every name stands once in the legend."""
    drawing = drawings()[name]
    figure = paper.to_matplotlib(drawing)
    FigureCanvasAgg(figure).draw()
    assert len(figure.axes) == len(drawing.panels)
    for axes, panel in zip(figure.axes, drawing.panels, strict=True):
        drawn = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
        drawn += [np.array([bar.get_height() for bar in bars]) for bars in axes.containers]
        for curve in panel.curves:
            there = any(np.array_equal(y, np.asarray(curve.y, dtype=float), equal_nan=True) for y in drawn)
            assert there is not curve.hidden, curve.name
        assert axes.get_ylabel() == panel.label
        assert (axes.get_yscale() == "log") is panel.falls
    words = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert len(words) == len(set(words))
    loud = {curve.name for panel in drawing.panels for curve in panel.loud if not curve.hidden}
    assert loud <= set(words)


def test_a_users_dollar_begins_no_formula_on_paper() -> None:
    """Where a drawing says that its words are a user's; a lab's are mathematics."""
    panel = Panel("x$y$, m", (Curve("$a$", [0.0, 1.0], [0.0, 1.0]),), levels=(Mark("$b$", 0.5),))
    for verbatim, label in ((True, r"x\$y\$, m"), (False, "x$y$, m")):
        assert paper.to_matplotlib(Drawing("", "t, s", (panel,), verbatim=verbatim)).axes[0].get_ylabel() == label
