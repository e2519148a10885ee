import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from driver.report.history_figures import Course, convergence, spread

NAN = np.nan
STAGES = ["A", "B", "C"]
LAMBDA = Course("λ⁺_Y", "", [np.array([1.0, 0.8]), np.full(2, NAN), np.array([0.8, 0.81])], 0.02)
TAU = Course("τ₀", "MPa", [np.array([40.0, 30.0]), np.array([30.0, 22.0]),
                           np.array([22.0, 21.0])], 0.5)  # fmt: skip
CHIS = {
    "χ_F of loads": [np.array([78.0, 70.0]), np.array([70.0, 60.0]), np.array([59.0, 58.0])],
    "χ of images": [np.array([2.0, 1.5]), np.array([1.5, 1.4]), np.array([1.3, 1.2])],
}


@pytest.fixture
def panels() -> list[Axes]:
    return convergence(STAGES, CHIS, [LAMBDA], [TAU]).axes


def curve(axes: Axes, marker: str) -> Line2D:
    return next(line for line in axes.lines if line.get_marker() == marker)


def test_apex_amplitudes_are_drawn_as_they_are_and_the_law_over_its_start(
    panels: list[Axes],
) -> None:
    amplitudes, law, _ = panels
    assert np.asarray(curve(amplitudes, "o").get_ydata())[-1] == 0.81
    assert curve(law, "o").get_ydata() == pytest.approx(np.array([40, 30, 30, 22, 22, 21]) / 40)


def test_a_parameter_that_is_held_is_dotted_at_its_value(panels: list[Axes]) -> None:
    dotted = [line for line in panels[0].lines if line.get_linestyle() == ":"]
    assert {x for line in dotted for x in np.asarray(line.get_xdata())} == {1, 2, 3, 4}
    assert all(np.allclose(line.get_ydata(), 0.8) for line in dotted)


def test_the_end_of_each_curve_says_its_value_with_its_unit(panels: list[Axes]) -> None:
    ends = [text.get_text() for axes in panels for text in axes.texts]
    assert "τ₀ = 21.0 MPa" in ends and r"$\mathregular{χ_F}$ of loads: 58.0" in ends
    bars = panels[1].collections[0]
    assert isinstance(bars, LineCollection)
    bar = bars.get_segments()[0]
    assert np.ptp(bar[:, 1]) == pytest.approx(2 * 1.96 * 0.5 / 40)


def test_the_stages_are_named_and_shaded_in_turn(panels: list[Axes]) -> None:
    assert [text.get_text() for text in panels[0].texts if text.get_text() in STAGES] == STAGES
    band = next(patch for patch in panels[1].patches)
    assert isinstance(band, Rectangle)
    assert (band.get_x(), band.get_width()) == (1.5, 2.0)


def test_the_residuals_have_a_logarithmic_scale(panels: list[Axes]) -> None:
    assert panels[2].get_yscale() == "log" and panels[0].get_yscale() == "linear"


def test_labels_are_moved_apart_no_further_than_needed() -> None:
    assert spread([0.1, 0.5, 0.9], 0.1) == pytest.approx([0.1, 0.5, 0.9])
    assert spread([0.50, 0.52], 0.1) == pytest.approx([0.46, 0.56])
    assert np.diff(spread([0.3, 0.3, 0.31, 0.32], 0.05)) == pytest.approx([0.05] * 3)


def test_without_apex_amplitudes_their_panel_is_left_out() -> None:
    assert len(convergence(STAGES, CHIS, [], [TAU]).axes) == 2


def test_a_parameter_that_is_held_to_the_end_keeps_its_value_and_has_no_bar() -> None:
    parts = [np.array([1.0, 0.8]), np.full(2, NAN), np.full(2, NAN)]
    axes = convergence(STAGES, CHIS, [Course("λ⁺_Y", "", parts, NAN)], [TAU]).axes[0]
    assert not axes.collections
    assert r"$\mathregular{λ⁺_Y}$ = 0.800" in [text.get_text() for text in axes.texts]
