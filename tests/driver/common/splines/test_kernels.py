import numpy as np
import pytest
from scipy import ndimage

from driver.common.splines.kernels import coefficients, slopes_at


@pytest.mark.parametrize("shape", [(60, 45), (7, 5), (2, 9), (1, 40), (40, 1), (16, 33), (1, 1)])
def test_coefficients_are_those_of_scipy_for_any_shape(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).normal(size=shape)
    expected = ndimage.spline_filter(image, order=3, mode="mirror")
    assert coefficients(image) == pytest.approx(expected, abs=1e-13)


def test_slopes_are_those_of_the_spline_up_to_the_border() -> None:
    image = np.random.default_rng(1).normal(size=(9, 12))
    spline = coefficients(image)
    rows, cols = (index.ravel() for index in np.indices(image.shape))
    found = slopes_at(spline, rows, cols)
    step = 1e-5
    for axis in (0, 1):
        beside = [np.array([rows, cols], dtype=float) for _ in range(2)]
        beside[0][axis] -= step
        beside[1][axis] += step
        low, high = (
            ndimage.map_coordinates(spline, at, order=3, mode="mirror", prefilter=False)
            for at in beside
        )
        assert found[:, axis] == pytest.approx((high - low) / (2 * step), abs=1e-8)
