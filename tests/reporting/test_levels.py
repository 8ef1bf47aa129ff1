"""What of a long figure is drawn: never another value, always the extremes, every point outside a band, and never too many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ctlabs.linalg.checks import Array
from ctlabs.reporting import levels
from ctlabs.reporting.drawing import Band, Curve, Drawing, Panel, inside_outside
from ctlabs.reporting.screen import to_plotly, untyped

#: Places of a line at most: of its two extremes, first and last of each column; with gaps also what is beside them.
SMOOTH, GAPPED = 4 * levels.COLUMNS, 16 * levels.COLUMNS


@st.composite
def records(draw: st.DrawFn) -> tuple[Array, Array]:
    """Long ones, at even or uneven times, of noise, steps or constants, with spikes and gaps."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = draw(st.integers(levels.LONG + 1, 40_000))
    x = np.arange(count) * draw(st.sampled_from([1.0, 1e-3, 1e6])) if draw(st.booleans()) else np.sort(rng.exponential(size=count).cumsum())
    y = {"noise": rng.normal(size=count), "steps": np.floor(np.arange(count) / 777), "flat": np.full(count, 2.0)}[
        draw(st.sampled_from(["noise", "steps", "flat"]))
    ]
    for at in draw(st.lists(st.integers(0, count - 1), max_size=5)):
        y[at] = draw(st.sampled_from([60.0, -60.0, 1e9]))
    for begin in draw(st.lists(st.integers(0, count - 1), max_size=4)):
        y[begin : begin + draw(st.sampled_from([1, 3, 500, 5000]))] = np.nan
    if draw(st.booleans()):
        y[1 :: draw(st.integers(2, 4))] = np.nan
    return x, y


def drawn(x: Array, y: Array, style: str = "line", reach: tuple[float, float] | None = None, *, every: bool = False) -> tuple[Array, Array]:
    """A curve as it is drawn."""
    curve = Curve("y", x, y, style=style, every=every)
    found = levels.level(Drawing("Long", "t, s", (Panel("y", (curve,)),)), reach).panels[0].curves[0]
    return np.asarray(found.x), np.asarray(found.y)


@settings(max_examples=60, deadline=None)
@given(records())
def test_a_line_keeps_the_extremes_of_every_column(record: tuple[Array, Array]) -> None:
    """Of each column of pixels the least and the greatest value are drawn, at places where they are; nothing else than given values."""
    x, y = record
    px, py = drawn(x, y)
    given_pairs = set(zip(x.tolist(), np.nan_to_num(y, nan=1e300).tolist(), strict=True))
    assert set(zip(px.tolist(), np.nan_to_num(py, nan=1e300).tolist(), strict=True)) <= given_pairs
    assert (np.diff(px) >= 0).all()
    assert len(px) <= (SMOOTH if np.isfinite(y).all() else GAPPED)
    edges = np.linspace(x[0], x[-1], levels.COLUMNS + 1)[:-1]
    whole, part = (np.searchsorted(edges, each, "right") for each in (x, px))
    for best, empty in ((np.fmax, -np.inf), (np.fmin, np.inf)):
        wanted, found = np.full(levels.COLUMNS + 2, empty), np.full(levels.COLUMNS + 2, empty)
        best.at(wanted, whole, np.where(np.isfinite(y), y, empty))
        best.at(found, part, np.where(np.isfinite(py), py, empty))
        np.testing.assert_array_equal(found, wanted)


@settings(max_examples=60, deadline=None)
@given(records())
def test_a_line_has_the_gaps_of_its_values(record: tuple[Array, Array]) -> None:
    """Two points that are joined have no gap between them; an extreme that had a neighbour has one still."""
    x, y = record
    at = levels.lines(x, [y])
    absent = np.concatenate([[0], np.cumsum(~np.isfinite(y))])
    both = np.isfinite(y[at[:-1]]) & np.isfinite(y[at[1:]])
    assert (absent[at[1:][both]] == absent[at[:-1][both]]).all()
    top = int(np.nanargmax(y)) if np.isfinite(y).any() else None
    if top is not None and top in at and 0 < top < len(y) - 1 and np.isfinite(y[top - 1 : top + 2]).all():
        place = int(np.searchsorted(at, top))
        assert np.isfinite(y[at[max(place - 1, 0) : place + 2]]).sum() >= 2


@settings(max_examples=40, deadline=None)
@given(records(), st.integers(0, 2000))
def test_every_point_outside_a_band_is_drawn(record: tuple[Array, Array], count: int) -> None:
    """Also among a hundred thousand others, and however near to one another they are."""
    x, y = record
    y = np.where(np.isfinite(y), 0.1 * np.sin(y), np.nan)
    spikes = np.random.default_rng(count).choice(len(x), count, replace=False)
    y[spikes] = 5.0 + np.arange(count) % 7
    curves = inside_outside("NIS", x, y, np.full(len(x), -1.0), np.full(len(x), 1.0))
    found = levels.level(Drawing("Long", "t, s", (Panel("y", curves),))).panels[0].curves
    assert len(np.asarray(found[0].x)) <= levels.MANY + 2 * levels.COLUMNS
    if count:
        outside = found[1]
        assert set(zip(x[spikes].tolist(), y[spikes].tolist(), strict=True)) == set(
            zip(np.asarray(outside.x).tolist(), np.asarray(outside.y).tolist(), strict=True)
        )


def test_points_that_are_not_drawn_are_covered() -> None:
    """Of very many points one in each cell of a few pixels is drawn, so that the cloud looks as it is; its outermost points are there."""
    rng = np.random.default_rng(3)
    x, y = np.arange(300_000.0), rng.normal(size=300_000)
    px, py = drawn(x, y, "cross")
    assert len(px) <= levels.MANY + 2 * levels.COLUMNS
    assert (py.min(), py.max()) == (y.min(), y.max())
    for i in rng.choice(len(x), 2000):  # within a cell of a two-hundredth of the width and a thirty-seventh of the height
        near = (np.abs(px - x[i]) <= x[-1] / 200) & (np.abs(py - y[i]) <= np.ptp(y) / 37)
        assert near.any()


@settings(max_examples=40, deadline=None)
@given(records(), st.floats(0, 1), st.floats(1e-5, 0.5))
def test_whoever_looks_closer_sees_all(record: tuple[Array, Array], where: float, width: float) -> None:
    """Every row of a part that has no more than columns; of a longer one its own extremes; and the rest as before."""
    x, y = record
    begin = x[0] + where * np.ptp(x)
    reach = begin, begin + width * np.ptp(x)
    inside = (x >= reach[0]) & (x <= reach[1])
    px, py = drawn(x, y, reach=reach)
    shown = (px >= reach[0]) & (px <= reach[1])
    even = np.ptp(np.diff(x)) < 1e-6 * np.diff(x).max()
    if even and inside.sum() <= levels.COLUMNS / 2:
        np.testing.assert_array_equal(py[shown], y[inside])
    if np.isfinite(y[inside]).any():
        assert (np.nanmin(py[shown]), np.nanmax(py[shown])) == (np.nanmin(y[inside]), np.nanmax(y[inside]))
    assert set(drawn(x, y)[0].tolist()) <= set(px.tolist())


def test_a_short_drawing_is_itself() -> None:
    """Nothing is chosen where a screen shows all."""
    x = np.arange(float(levels.LONG))
    drawing = Drawing("Short", "t, s", (Panel("x", (Curve("x", x, x),), (Band("b", x, -x, x),)),))
    assert levels.level(drawing) is drawing


@pytest.mark.parametrize("rows", [20_000, 1_000_000])
def test_two_spikes_are_in_the_browser_and_the_figure_stays_small(rows: int) -> None:
    """Of a record of many rows with its band, and what is sent is far below a megabyte."""
    rng = np.random.default_rng(5)
    t, y = 0.1 * np.arange(rows), rng.normal(size=rows)
    y[[5003, 12345]] = 60.0
    half = np.full(rows, 1.96)
    panel = Panel("innovation, m", inside_outside("innovation", t, y, -half, half, "m"), (Band("95 % band", t, -half, half),))
    drawing = Drawing("Innovations", "t, s", (panel,))
    figure = to_plotly(levels.level(drawing))
    outside = next(each for each in figure["data"] if each["name"] == "outside the band")
    tx, ty = untyped(outside["x"]), untyped(outside["y"])
    assert tx[ty == 60].tolist() == pytest.approx([500.3, 1234.5], rel=1e-6)
    assert sum(len(each[axis]["bdata"]) for each in figure["data"] for axis in ("x", "y")) < 600_000


def test_the_part_that_is_looked_at_fills_its_axes() -> None:
    """The horizontal axis is what was chosen; the vertical ones show what is within it, or stay as they were."""
    t = np.arange(10_000.0)
    drawing = Drawing("Ramp", "t, s", (Panel("x, m", (Curve("x", t, t),), reach=(-500.0, 10_500.0)),))
    near = to_plotly(levels.level(drawing, (100.0, 200.0)), reach=(100.0, 200.0))["layout"]
    assert near["xaxis"]["range"] == [100.0, 200.0]
    assert near["yaxis"]["range"] == [95.0, 205.0]
    own = to_plotly(drawing, reach=(100.0, 200.0), fit=False)["layout"]
    assert own["yaxis"]["range"] == [-500.0, 10_500.0]
    assert "range" not in to_plotly(drawing)["layout"]["xaxis"]


def test_log_axes_on_request() -> None:
    """Where there are positive values and no negative ones; and back."""
    t = np.arange(1.0, 9.0)
    drawing = Drawing("Both", "t, s", (Panel("x", (Curve("x", t, t),), kind="size"), Panel("e", (Curve("e", t, t - 4),), kind="signed")))
    assert drawing.scalable
    assert not drawing.falls
    log = to_plotly(drawing.scaled(True))["layout"]
    assert (log["yaxis"].get("type"), log["yaxis2"].get("type")) == ("log", None)
    assert to_plotly(drawing.scaled(True).scaled(False))["layout"]["yaxis"].get("type") is None
    assert not Drawing("Signed", "t, s", (drawing.panels[1],)).scalable
