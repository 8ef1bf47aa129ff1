"""Circuit diagrams: every part is drawn once, with its name."""

import pytest

from ctlabs.reporting import plots

SECTIONS = [("$R_1$", "$C_1$", "$U_1$"), ("$R_2$", "$C_2$", "")]


@pytest.mark.parametrize("followers", [False, True])
def test_a_ladder_names_all_its_parts(followers):
    """Resistors, capacitors, voltages and the box; a follower between two sections where asked for."""
    figure = plots.ladder(SECTIONS, source="$u$", output="$U_0$", enclosure="black box", followers=followers)
    (axes,) = figure.axes
    names = [text.get_text() for text in axes.texts if text.get_text()]
    wanted = ["$R_1$", "$C_1$", "$U_1$", "$R_2$", "$C_2$", "$u$", "$U_0$", "black box"] + ["1"] * followers
    assert sorted(names) == sorted(wanted)
    assert not axes.axison


def test_nothing_leaves_the_page():
    """Every name and line of a longer ladder is inside the axes."""
    figure = plots.ladder([("R", "C", "U")] * 4, source="u", output="z")
    (axes,) = figure.axes
    low, high = axes.get_xlim()
    assert all(low < text.get_position()[0] < high for text in axes.texts)
    assert all(low < x < high for line in axes.lines for x in line.get_xdata())
