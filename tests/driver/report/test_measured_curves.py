"""What the curves of free correlation hold."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.patches import StepPatch
from scipy.stats import norm

from driver.report import measured_curves as curves
from driver.report.measured import MeasuredMotion, Spread
from meshes.arrays import FloatArray
from tests.driver.invented_results import PEAKS, STAGE


def histogram(axes: Axes) -> tuple[FloatArray, FloatArray]:
    """Values and edges of the drawn histogram."""
    drawn = axes.patches[0]
    assert isinstance(drawn, StepPatch)
    values, edges, _ = drawn.get_data()
    return values, edges


def test_bands_are_one_point_nine_six_deviations_to_each_side_in_nanometres(
    measured: MeasuredMotion,
) -> None:
    figure = curves.travel(measured)
    for axes, curve in zip(
        figure.axes, (measured.elongation, measured.tilt, measured.mean_w), strict=True
    ):
        bands = [np.asarray(band.get_paths()[0].vertices) for band in axes.collections]
        assert len(bands) == 4  # two cycles of loading and unloading
        for band, line in zip(bands, axes.lines, strict=True):
            for stage, value in np.asarray(line.get_xydata()):
                edge = band[np.isclose(band[:, 0], stage), 1]
                # 95 % of a normal distribution, from scipy.
                half = norm.ppf(0.975) * 1e3 * curve.sigma
                assert edge.max() - value == pytest.approx(half, rel=1e-4)
                assert value - edge.min() == pytest.approx(half, rel=1e-4)


def test_loading_and_unloading_are_told_apart_by_colour_and_by_stroke(
    measured: MeasuredMotion,
) -> None:
    figure = curves.travel(measured)
    lines = figure.axes[0].lines
    assert [line.get_linestyle() for line in lines] == ["-", "--", "-", "--"]
    assert [line.get_color() for line in lines] == [curves.LOADING, curves.UNLOADING] * 2
    assert [line.get_marker() for line in lines] == ["o", "o", "s", "s"]
    marked = [line.get_markevery() for line in lines]
    assert [every.start for every in marked if isinstance(every, slice)] == [0, 1, 1, 1]
    assert np.asarray(lines[0].get_xdata()).tolist() == list(STAGE[: PEAKS[0] + 1])
    assert lines[1].get_ydata() == pytest.approx(1e3 * measured.elongation.value[3:6])
    assert figure.axes[0].get_ylabel() == "elongation [nm]"
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["loading", "unloading", "95 % band", "cycle 1", "cycle 2"]


def test_the_histogram_has_area_one_beside_the_unit_normal(measured: MeasuredMotion) -> None:
    shares = curves.noise(measured).axes[0]
    values, edges = histogram(shares)
    widths = np.diff(edges)
    assert np.sum(values * widths) == pytest.approx(1.0)
    middle = np.abs(edges[:-1]) < 2.0
    expected = np.diff(norm.cdf(edges)) / widths
    assert values[middle] == pytest.approx(expected[middle], rel=0.15)
    line = next(line for line in shares.lines if line.get_label() == "unit normal")
    assert line.get_ydata() == pytest.approx(norm.pdf(line.get_xdata()))


def test_a_residual_off_the_axis_is_counted_in_the_last_bin(measured: MeasuredMotion) -> None:
    far = measured.standardised.copy()
    far[0, 0] = 40.0
    values, _ = histogram(curves.noise(replace(measured, spread=Spread.of(far))).axes[0])
    assert values[-1] == pytest.approx(8.0 / far.size)


def test_chi_is_drawn_image_by_image_with_the_shown_ones_marked(measured: MeasuredMotion) -> None:
    chi = curves.noise(measured).axes[1]
    assert chi.lines[0].get_ydata() == pytest.approx(measured.chi)
    places = [np.asarray(line.get_xdata()) for line in chi.lines]
    verticals = [place[0] for place in places if len(set(place)) == 1]
    assert verticals == list(PEAKS)
    low, high = chi.get_ylim()
    assert low < measured.chi.min() and measured.chi.max() < high and low < 1.0 < high
