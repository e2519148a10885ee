import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from driver.report import matrix_figures
from meshes.arrays import FloatArray

HESSIAN = np.array([[4.0e5, -300.0, 0.0], [-300.0, 2.0, 0.05], [0.0, 0.05, 0.5]])
CORRELATION = np.array([[1.0, -0.93, 0.2], [-0.93, 1.0, 0.1], [0.2, 0.1, 1.0]])
NAMES = ["λ⁺_Y", "τ₀", "c"]


@pytest.fixture
def figure() -> Figure:
    return matrix_figures.hessian_and_correlation(NAMES, HESSIAN, NAMES, CORRELATION)


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_every_cell_holds_its_number_with_its_sign(figure: Figure) -> None:
    hessian, correlation = figure.axes[:2]
    expected = ["4·10⁵", "−300", "0", "−300", "2.0", "0.050", "0", "0.050", "0.50"]
    assert texts(hessian) == expected
    assert texts(correlation)[:3] == ["1.00", "−0.93", "0.20"]


def test_the_hessian_has_a_logarithmic_scale_of_magnitudes_and_zeros_stay_blank(
    figure: Figure,
) -> None:
    picture = figure.axes[0].images[0]
    assert picture.norm(np.array(300.0)) == pytest.approx(np.log(300 / 0.05) / np.log(4e5 / 0.05))
    shown = picture.get_array()
    assert isinstance(shown, np.ma.MaskedArray)
    assert shown.min() == 0.05 and shown.mask.sum() == 2


def test_the_scale_of_the_hessian_covers_eight_decades_at_most() -> None:
    wide, names = np.diag([1.0, 1e-20]), ["a", "b"]
    figure = matrix_figures.hessian_and_correlation(names, wide, names, np.eye(2))
    assert figure.axes[0].images[0].get_clim() == pytest.approx((1e-8, 1.0))


def test_the_scale_of_correlations_is_symmetric_about_zero(figure: Figure) -> None:
    assert figure.axes[1].images[0].get_clim() == (-1.0, 1.0)


def test_numbers_stand_out_from_the_colour_of_their_cell(figure: Figure) -> None:
    for axes, values in zip(figure.axes[:2], (np.abs(HESSIAN), CORRELATION), strict=True):
        for text, value in zip(axes.texts, values.ravel(), strict=True):
            if value == 0.0:
                continue
            colour = np.ravel(axes.images[0].to_rgba(np.array([value])))[:3]
            cell = luminance(colour)
            ink = 0.0 if text.get_color() == "black" else 1.0
            light, dark = max(cell, ink), min(cell, ink)
            # WCAG 2.1, success criterion 1.4.3: 4.5 for text of this size
            assert (light + 0.05) / (dark + 0.05) >= 4.5


def luminance(colour: FloatArray) -> float:
    """Relative luminance of an sRGB colour, WCAG 2.1."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_among_many_parameters_the_strong_correlations_are_written() -> None:
    axes = matrix_figures.correlation_of_all(NAMES, CORRELATION).axes[0]
    assert [text for text in texts(axes) if text] == ["−.93", "−.93"]
    assert axes.images[0].get_clim() == (-1.0, 1.0)


def test_every_row_is_named_and_cells_are_parted_at_their_edges(figure: Figure) -> None:
    axes = figure.axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()][1:] == ["τ₀", "c"]
    assert axes.get_xticks(minor=True).tolist() == [-0.5, 0.5, 1.5, 2.5]
