import numpy as np
from matplotlib.axes import Axes

from driver.report import evidence_figures
from driver.report.style import CATEGORIES


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_evidence_marks_the_best_refit_and_the_line_three_below_it() -> None:
    score, refit = np.array([20.0, 30.0, 4.0, -1.0]), np.array([41.0, 12.0, np.nan, np.nan])
    figure = evidence_figures.evidence(
        ["a", "b", "c", "d"], ["material", "boundary", "instrument", "numerics"], score, refit, 0
    )
    axes = figure.axes[0]
    assert texts(axes) == ["+41.0", "+12.0", "+4.0", "−1.0"]
    assert [bar.get_linewidth() for bar in axes.patches] == [2.0, 0.6, 0.6, 0.6]
    places = [np.asarray(line.get_xdata()) for line in axes.lines]
    verticals = [place[0] for place in places if len(set(place)) == 1]
    assert 0.0 in verticals and 38.0 in verticals
    assert axes.get_xscale() == "linear"
    colour = axes.patches[1].get_facecolor()[:3]
    assert np.allclose(
        colour, [int(CATEGORIES["boundary"][k : k + 2], 16) / 255 for k in (1, 3, 5)]
    )


def test_evidence_in_the_thousands_is_drawn_logarithmically_and_says_so() -> None:
    figure = evidence_figures.evidence(
        ["a", "b"], ["material", "material"], np.array([3000.0, 2.0]), np.full(2, np.nan), None
    )
    axes = figure.axes[0]
    assert axes.get_xscale() == "symlog" and "logarithmic beyond" in axes.get_xlabel()


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
