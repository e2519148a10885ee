"""Where the correlation of each image starts: phase correlation, then a stiff coarse motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from driver.common.splines.kernels import coefficients, slopes_at
from driver.dic.basis import GridBasis, grid_basis
from driver.dic.jump import Trail, best_turn, far_shift
from driver.dic.kernels import binned
from driver.dic.regularisation import penalties
from driver.dic.system import Pixels, System
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray, FloatArray

ELEMENT = 16  # px of the level
STIFF = 0.05  # px; granted to second differences: nearly affine, no local minimum to fall into
TOLERANCE = 2e-2  # px of the level; enough for the next one
SMALLEST = 64  # px; the images are halved as long as their shorter side stays as long
FACTOR = 4  # between the finest coarse level and the image, 2 for a small one
LEFT = 0.5  # of the relief; what leaves more was not followed, or is noise for the most part
DAMPING = 1e-3  # of the mean diagonal, on the second differences of w


@dataclass(frozen=True, eq=False)
class _Level:
    """One coarse grid of pixels: `scale` pixels of the image to one of its own."""

    scale: int
    system: System
    basis: GridBasis


@dataclass(frozen=True, eq=False)
class Starter:
    """Coarse systems of one reference, used for all its images, coarsest first."""

    levels: tuple[_Level, ...]
    reference: FloatArray

    @staticmethod
    def build(reference: FloatArray, region: BoolArray) -> Starter:
        """Bin the reference and factor its coarse systems.

        Args:
            reference: f without gaps, shape (rows, cols).
            region: pixels to correlate, same shape.
        """
        rows, cols = np.nonzero(region)
        extent = np.ptp(rows) + 1, np.ptp(cols) + 1
        scale = 2
        while min(extent) // (2 * scale) >= SMALLEST:
            scale *= 2
        scales = [scale]
        while scales[-1] > FACTOR:
            scales.append(scales[-1] // 2)
        return Starter(tuple(_level(reference, region, s) for s in scales), reference)

    def follow(
        self,
        images: Sequence[FloatArray],
        nodes_uv: FloatArray,
        nodes_w: FloatArray,
        given: FloatArray | None = None,
    ) -> FloatArray:
        """Return starting values [u | v | w] in pixels and heights of each image, shape (T, n).

        An image starts from where one before it ended, or that with the shift between the two
        added, whichever leaves least; the coarse motion is followed through all images, but for
        those that do not converge. Where that leaves most of the relief, shifts to anywhere in
        the image and turns of any angle are tried as well.

        Args:
            images: g without gaps, each of shape (rows, cols).
            nodes_uv: where u and v are wanted [px: row, column], (n, 2).
            nodes_w: where w is wanted, (m, 2).
            given: u, v of each image to begin with in the place of images before it [px], shape
                (T, rows, cols, 2).
        """
        starts = []
        top, last = self.levels[0], self.levels[-1]
        box = _box(top.system.pixels)
        reference = binned(self.reference, top.scale)
        trail = Trail(top.system, reference[box], 1.0)
        for t, image in enumerate(images):
            small = binned(image, top.scale)
            splines = [coefficients(small)]
            splines += [coefficients(binned(image, level.scale)) for level in self.levels[1:]]
            if given is not None:
                end = self._descended(splines, _sampled(given[t], top))
                starts.append(_values(last, end.p, nodes_uv, nodes_w))
                continue
            end = self._descended(splines, trail.start(small[box], splines[0]))
            most = LEFT * float(np.std(last.system.pixels.height))
            if end.left > most:
                far = self._descended(splines, far_shift(top.system, reference, small, box))
                end = far if far.left <= most else end
            if end.left > most:
                turned = best_turn(top.system, reference, small, box, splines[0])
                again = self._descended(splines, turned)
                end = again if again.left < end.left else end
            starts.append(_values(last, end.p, nodes_uv, nodes_w))
            if end.followed:
                trail.add(small[box], _carried(last, end.p, top) if last is not top else end.p)
        return np.array(starts)

    def _descended(self, splines: Sequence[FloatArray], p: FloatArray) -> _Descent:
        """Follow a motion of the coarsest level down to the finest one."""
        followed, residual = True, np.zeros(0)
        for k, level in enumerate(self.levels):
            if k:
                p = _carried(self.levels[k - 1], p, level)
            end = level.system.iterate(splines[k], p, TOLERANCE)
            p = end.p if end.reason in ("converged", "slow") else p
            followed &= end.reason == "converged"
            residual = level.system.residual(splines[k], p)
        seen = residual[np.isfinite(residual)]
        enough = 2 * seen.size > residual.size
        return _Descent(p, followed, float(np.std(seen)) if enough else np.inf)


class _Descent(NamedTuple):
    """Where the levels lead: nodal values of the finest one, and what it leaves.

    Attributes:
        p: [px] and heights, shape (n,).
        followed: whether every level converged.
        left: standard deviation of its residual, infinite where most pixels have left the image.
    """

    p: FloatArray
    followed: bool
    left: float


def _level(reference: FloatArray, region: BoolArray, scale: int) -> _Level:
    f = binned(reference, scale)
    inside = binned(region.astype(np.float64), scale) > 0.99
    if not inside.any():
        inside = binned(region.astype(np.float64), scale) > 0
    if not inside.any():
        raise ImageError(f"no pixel to correlate: none lies in {scale} × {scale} whole pixels.")
    at = inside.nonzero()
    # Samples taken for coefficients: a spline that smooths the noise a little.
    slope = slopes_at(f, *at)
    rows, cols = (index.astype(np.float64) for index in at)
    xy = np.column_stack([rows, cols])
    pixels = Pixels(rows, cols, f[at], slope, 1.0)
    # A region one pixel wide still spans a grid.
    low_row, low_col = float(rows.min()), float(cols.min())
    high_row, high_col = float(rows.max()), float(cols.max())
    bounds = (low_row, max(high_row, low_row + 1), low_col, max(high_col, low_col + 1))
    basis = grid_basis(xy, bounds, ELEMENT)
    system = System(pixels, basis, basis, penalties(basis, basis, "tikhonov"))
    n = 2 * len(basis.nodes)
    # The stiffness that white heights of a tenth of the relief would justify.
    variance = (0.1 * float(np.std(f[at]))) ** 2
    diagonal = float(system.hessian.diagonal()[n:].mean())
    system.weigh([variance / STIFF**2, DAMPING * diagonal])
    return _Level(scale, system, basis)


def _sampled(motion: FloatArray, level: _Level) -> FloatArray:
    """Nodal values of a level for u, v at every pixel of an image [px], shape (rows, cols, 2)."""
    at = _in_image(level.basis.nodes, level.scale).T
    u, v = (
        ndimage.map_coordinates(part, at, order=1, mode="nearest") / level.scale
        for part in np.moveaxis(motion, -1, 0)
    )
    return np.concatenate([u, v, np.zeros(level.system.size - 2 * len(u))])


def _carried(coarse: _Level, p: FloatArray, fine: _Level) -> FloatArray:
    """Nodal values of one level at the nodes of another, in pixels of the other."""
    nodes = _in_image(fine.basis.nodes, fine.scale)
    values = _values(coarse, p, nodes, nodes)
    values[: 2 * len(nodes)] /= fine.scale
    return values


def _values(level: _Level, p: FloatArray, nodes_uv: FloatArray, nodes_w: FloatArray) -> FloatArray:
    """Motion of a level in pixels of the image, at nodes given there, held beyond its grid."""
    n = len(level.basis.nodes)
    x0, x1, y0, y1 = level.basis.bounds
    nodal = np.column_stack([level.scale * p[:n], level.scale * p[n : 2 * n], p[2 * n :]])
    uv, w = (
        level.basis.interpolated(
            nodal, np.clip((x - (level.scale - 1) / 2) / level.scale, (x0, y0), (x1, y1))
        )
        for x in (nodes_uv, nodes_w)
    )
    return np.concatenate([uv[:, 0], uv[:, 1], w[:, 2]])


def _in_image(nodes: FloatArray, scale: int) -> FloatArray:
    return np.asarray(nodes * scale + (scale - 1) / 2)


def _box(pixels: Pixels) -> tuple[slice, slice]:
    return (
        slice(int(pixels.rows.min()), int(pixels.rows.max()) + 1),
        slice(int(pixels.cols.min()), int(pixels.cols.max()) + 1),
    )
