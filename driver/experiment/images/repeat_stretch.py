"""Whether repeated images of one surface are stretched against one another, as those of a test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from driver.common.distributions import chi2_isf
from meshes.arrays import BoolArray, FloatArray

_SMOOTHING = 1.0  # px, of the slopes
_CHANCE = 1e-6  # of calling repeats stretched that are not
_MATTERS = 5e-4  # of the length, from one repeat to another; less is drift of a microscope


@dataclass(frozen=True, eq=False)
class RepeatStretch:
    """Strain along Y of each repeat against their mean.

    Attributes:
        value: shape (n,).
        sigma: standard deviation by noise.
    """

    value: FloatArray
    sigma: float

    @property
    def told(self) -> str:
        """What is wrong with them, in words, or an empty text."""
        low, high = int(self.value.argmin()), int(self.value.argmax())
        most = float(np.ptp(self.value))
        if most < _MATTERS or not self._seen():
            return ""
        return (
            f"images.repeats: found repeat {high} {100 * most:.2g} % longer along Y than repeat "
            f"{low} (± {100 * 2**0.5 * self.sigma:.1g} %), expected one unloaded surface that "
            "moves as a whole: images of the test are no repeats, for their mean is blurred and "
            "their scatter is no noise"
        )

    def _seen(self) -> bool:
        """Whether they scatter, or go up or down in their order, by more than noise."""
        if not self.sigma > 0:
            return False
        order = np.arange(self.value.size) - (self.value.size - 1) / 2
        z = self.value / self.sigma
        trend = float(z @ order) ** 2 / float(order @ order)
        chance = _CHANCE / 2
        n = self.value.size
        return bool(float(z @ z) > chi2_isf(chance, n - 1) or trend > chi2_isf(chance, 1))


def stretch_of_repeats(
    repeats: FloatArray, region: BoolArray, pixel: float, sigma: float
) -> RepeatStretch:
    """Return the strain along Y of each repeat, by least squares of small motions.

    Beside it each repeat may shift, tilt, turn and shear, and change its length along X.

    Args:
        repeats: height maps, registered [µm], shape (n, rows, cols).
        region: pixels to use, shape (rows, cols).
        pixel: size of a pixel [µm].
        sigma: noise of a pixel of one repeat [µm].
    """
    mean = repeats.mean(axis=0)
    slope_x, slope_y = (
        g[region] for g in np.gradient(ndimage.gaussian_filter(mean, _SMOOTHING), pixel)
    )
    x, y = (pixel * (at - at.mean()) for at in np.nonzero(region))
    along = slope_y * y
    others = np.column_stack(
        [slope_x, slope_y, slope_x * x, slope_x * y, slope_y * x, np.ones_like(x), x, y]
    )
    scale = np.maximum(np.linalg.norm(others, axis=0), np.finfo(np.float64).tiny)
    basis = np.linalg.qr(others / scale)[0]
    own = along - basis @ (basis.T @ along)
    sight = float(own @ own)
    if sight <= 1e-9 * float(along @ along):
        return RepeatStretch(np.zeros(len(repeats)), np.inf)
    # g(y) = f(y − e y) ≈ f − e y ∂f/∂Y
    value = -np.array([(heights - mean)[region] @ own for heights in repeats]) / sight
    return RepeatStretch(value, sigma / sight**0.5)
