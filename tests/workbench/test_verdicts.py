"""What an experiment says in words, and the small things that carry it about: views and links."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ctlabs.files.modelfile import ready
from ctlabs.workbench.desk import links
from ctlabs.workbench.desk.view import View, zoomed
from ctlabs.workbench.runs import experiments, figures, verdicts
from ctlabs.workbench.runs.outcomes import Asked, Outcome, outcome
from tests.reference import EXACT

MODEL = ready("constant_velocity")


@cache
def ran(factor: float = 1.0, seed: int = 3) -> Outcome:
    """Runs through a filter that believes in a measurement noise so many times as large."""
    design = None if factor == 1 else MODEL.replace({"sigma": factor * float(MODEL.constants["sigma"])}).dumps()
    return outcome(experiments.run(MODEL.dumps(), Asked(100, 200, seed, design=design).plain()))


@pytest.mark.parametrize(("factor", "word"), [(1.0, "Consistent"), (0.2, "Overconfident"), (5.0, "Too cautious")])
def test_the_first_line_says_whether_the_filter_may_be_believed(factor: float, word: str) -> None:
    """And by which factor its errors are larger or smaller than it claims: the root of NEES over its expectation."""
    found = ran(factor)
    first = verdicts.diagnosis(found)[0]
    assert first.startswith(word)
    stats = found.statistics
    assert stats is not None
    ratio = float(np.sqrt(stats.nees[1:].mean() / stats.nees_dof[1:].mean()))
    named = re.search(r"(?:are|errors) ([\d.]+) times", first)
    assert (named is None) == (factor == 1.0)
    if named:
        assert float(named[1]) == pytest.approx(max(ratio, 1 / ratio), rel=0.01)


def test_the_share_outside_has_its_own_band() -> None:
    """In words and numbers, where the filter's model is the truth; of another model's filter there is none."""
    found = ran()
    assert found.statistics is not None
    own = found.statistics.outside
    assert own is not None
    line = verdicts.share(found)
    assert f"{100 * own['value']:.1f} % of the RMS errors" in line
    assert f"between {100 * own['low']:.1f} % and {100 * own['high']:.1f} %" in line
    assert ("as it should be" in line) == (own["low"] <= own["value"] <= own["high"])
    assert own["high"] > 0.08  # a dozen of such points as 402 independent ones would be: 3 to 7 %
    many = replace(found, statistics=replace(found.statistics, outside={**own, "value": 0.5, "p": 1e-9}))
    assert "more than chance gives" in verdicts.share(many)
    assert "against the model, less than 1 in a million" in verdicts.share(many)
    wrong = ran(0.2).statistics
    assert wrong is not None
    assert wrong.outside is None


@given(st.floats(1e-12, 1.0))
def test_a_p_value_is_said_in_words(p: float) -> None:
    """The words follow the levels, the odds the number, within their rounding."""
    words = verdicts.in_words(p)
    assert words.startswith("nothing unusual" if p >= 0.05 else "rare" if p >= 0.01 else "against the model")
    odds = re.search(r"(\d+) in (\d+) by chance$", words)
    if odds:
        assert int(odds[1]) / int(odds[2]) == pytest.approx(p, rel=0.1, abs=0.051)
    else:
        assert p < 1e-6


def test_every_measurement_is_drawn_where_it_tells_something() -> None:
    """z = 2x by its half, z = x + 3y less three times the estimate of y; nothing of a state that is not measured."""
    found = ran()
    H = np.array([[2.0, 0.0], [1.0, 3.0], [0.0, 0.0]])
    x = np.random.default_rng(1).normal(size=(len(found.t), 2, 1))
    z = np.einsum("ji,kir->kjr", H, x)
    z[5, 1] = np.nan
    made = replace(found, H=H, z=z, x_plus=x, measurements=("a", "b", "c"), measurement_units=("V", "m", "m"))
    told = figures.measurements(made, 0)
    assert list(told) == ["measured: a, as this state", "measured: b, less the other states"]
    np.testing.assert_allclose(told["measured: a, as this state"], x[:, 0, 0], rtol=EXACT)
    there = np.arange(len(x)) != 5
    np.testing.assert_allclose(told["measured: b, less the other states"][there], x[there, 0, 0], rtol=1e-12, atol=1e-12)
    assert np.isnan(told["measured: b, less the other states"][5])
    second = figures.measurements(made, 1)["measured: b, less the other states"]
    np.testing.assert_allclose(second[there], x[there, 1, 0], rtol=1e-12, atol=1e-12)


def test_a_band_that_the_scale_hides_is_drawn_below() -> None:
    """Truth and measurement less the estimate, in ±σ; the panel of a state whose band is seen has none."""
    found = ran()
    panels = {panel.label: panel for panel in figures.estimates(found, [0, 1]).panels}
    assert list(panels) == ["x, m", "x, less its estimate, m", "v, m/s"] or len(panels) in (2, 4)
    for label, panel in panels.items():
        if "less its estimate" in label:
            truth = next(curve for curve in panel.curves if curve.name == "truth")
            assert found.truth is not None
            np.testing.assert_array_equal(truth.y, found.truth[:, 0, 0] - found.x_plus[:, 0, 0])
            np.testing.assert_array_equal(panel.bands[0].high, found.sd_plus[:, 0])


def test_what_is_looked_at_is_one_for_all() -> None:
    """By the label of the axis; what is outside of the next record is forgotten."""
    view = View()
    assert view.zoom("t, s", (1.0, 2.0))
    assert not view.zoom("t, s", (1.0, 2.0))
    view.within("t, s", 0.0, 1.5)
    assert view.reach == {"t, s": (1.0, 2.0)}
    view.within("t, s", 3.0, 9.0)
    assert view.reach == {}
    assert zoomed({"xaxis.range": [3, 4]}) == ((3.0, 4.0),)
    assert zoomed({"xaxis.range[0]": "nan", "xaxis.range[1]": 4}) is None
    assert zoomed({"yaxis.range[0]": 1, "yaxis.range[1]": 4}) is None


@given(st.text(max_size=3000))
def test_a_link_holds_the_model_to_the_letter(text: str) -> None:
    """In letters that an address may have; half of it is refused in one line."""
    text = text.encode("utf-8", "ignore").decode()
    link = links.packed(text)
    assert re.fullmatch(r"[A-Za-z0-9_-]+", link)
    assert links.unpacked(link) == text
    for wrong in (link[: len(link) // 2], "=" + link, "é"):
        with pytest.raises(ValueError, match="link: expected one that was copied whole"):
            links.unpacked(wrong)


def test_a_link_cannot_grow_without_bound() -> None:
    """A small one that unpacks to very much is refused, and a model that is too long for an address."""
    import base64
    import zlib

    bomb = base64.urlsafe_b64encode(zlib.compress(b"a" * 10**8, 9)).decode().rstrip("=")
    with pytest.raises(ValueError, match="link: expected one"):
        links.unpacked(bomb)
    with pytest.raises(ValueError, match="send its file"):
        links.packed(np.random.default_rng(1).bytes(40_000).hex())
