"""What the picture of the grips shows."""

import numpy as np
import pytest

from driver.report.grip_figure import grip
from driver.report.measured import MeasuredMotion
from tests.driver.invented_results import STAGE


def test_the_line_of_all_images_and_that_of_the_grips_stand_over_the_stage_travel(
    measured: MeasuredMotion,
) -> None:
    curve = grip(measured).axes[0]
    lines = {line.get_label(): line for line in curve.lines}
    found, nominal = (
        np.polyfit(np.asarray(line.get_xdata()), np.asarray(line.get_ydata()), 1)[0]
        for line in (lines["line of all images"], lines["distance of the grips"])
    )
    # Nanometres a micrometre.
    assert found == pytest.approx(1e3 * measured.grip.ratio.value)
    assert nominal == pytest.approx(0.375)


def test_what_the_line_leaves_is_drawn_phase_by_phase(measured: MeasuredMotion) -> None:
    rest = grip(measured).axes[1]
    drawn = [line for line in rest.lines if line.get_marker() == "."]
    assert [np.size(line.get_xdata()) for line in drawn] == [4, 2, 3, 2]
    shown = np.concatenate([line.get_ydata() for line in drawn])
    line = measured.grip.start + measured.grip.ratio.value * np.array(STAGE)
    assert shown == pytest.approx(1e3 * (measured.elongation.value - line))
    legend = rest.get_legend()
    assert legend is not None
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["95 % of the noise", "loading", "unloading"]
