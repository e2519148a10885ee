import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from driver.report import evidence_figures
from driver.report.style import CATEGORIES


def widths(axes: Axes) -> list[float]:
    return [bar.get_width() for bar in axes.patches if isinstance(bar, Rectangle)]


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_evidence_shows_how_far_each_cause_is_behind_and_the_line_three_below_the_added_one() -> (
    None
):
    score, refit = np.array([20.0, 30.0, 4.0, -1.0]), np.array([41.0, 12.0, np.nan, np.nan])
    figure = evidence_figures.evidence(
        ["a", "b", "c", "d"], ["material", "boundary", "instrument", "numerics"], score, refit, 0
    )
    axes = figure.axes[0]
    assert texts(axes) == ["+41.0 (added)", "+12.0 (−29.0)", "+4.0 (−37.0)", "−1.0 (−42.0)"]
    assert [bar.get_linewidth() for bar in axes.patches] == [2.0, 0.6, 0.6, 0.6]
    places = [np.asarray(line.get_xdata()) for line in axes.lines]
    verticals = [place[0] for place in places if len(set(place)) == 1]
    assert 0.0 in verticals and -3.0 in verticals
    assert widths(axes) == pytest.approx([0.0, -29.0, -37.0, -42.0])
    assert axes.get_xscale() == "linear"
    colour = axes.patches[1].get_facecolor()[:3]
    assert np.allclose(
        colour, [int(CATEGORIES["boundary"][k : k + 2], 16) / 255 for k in (1, 3, 5)]
    )


def test_a_lead_among_evidence_in_the_thousands_is_seen_and_what_is_far_below_is_cut_off() -> None:
    figure = evidence_figures.evidence(
        ["a", "b", "c"], ["material"] * 3, np.array([3000.0, 2980.0, 2.0]), np.full(3, np.nan), 0
    )
    axes = figure.axes[0]
    low, high = axes.get_xlim()
    assert axes.get_xscale() == "linear" and 20.0 > 0.2 * (high - low)
    assert widths(axes)[2] > -100.0 and texts(axes)[2] == "+2.0 (−2998)"
    assert axes.get_xlabel() == "log evidence less that of a"


def test_refits_that_were_corrected_farther_from_their_end_are_outlined() -> None:
    causes = ["a", "b", "c"], ["material"] * 3, np.full(3, 9.0), np.array([9.0, 8.0, 7.0])
    figure = evidence_figures.evidence(*causes, 0, [1])
    assert [bar.get_fill() for bar in figure.axes[0].patches] == [True, False, True]
    told = [[text.get_text() for text in key.legends[0].get_texts()] for key in (
        figure, evidence_figures.evidence(*causes, 0),
    )]  # fmt: skip
    assert [sum("corrected farther" in label for label in labels) for labels in told] == [1, 0]


def test_where_nothing_was_added_nothing_is_marked_as_the_best() -> None:
    figure = evidence_figures.evidence(
        ["a", "b"], ["material", "material"], np.array([-1.0, -2.0]), np.array([-0.5, np.nan]), None
    )
    assert {bar.get_linewidth() for bar in figure.axes[0].patches} == {0.6}


def test_the_cause_that_was_added_is_marked_though_another_has_more_evidence() -> None:
    figure = evidence_figures.evidence(
        ["a", "b"], ["material", "material"], np.array([9.0, 8.0]), np.array([9.0, 8.0]), 1
    )
    assert [bar.get_linewidth() for bar in figure.axes[0].patches] == [0.6, 2.0]
