"""The measured face in square blocks of pixels, few enough for a page."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from driver.report.maps import Face
from meshes.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FaceBlocks:
    """Square blocks over the region of interest.

    Attributes:
        face: where the pixels are.
        side: pixels along a side of a block.
    """

    face: Face
    side: int

    @staticmethod
    def of(face: Face, most: int) -> FaceBlocks:
        """Return the smallest blocks that are at most so many, those of the bounding box counted.

        Args:
            face: where the pixels are.
            most: number of blocks.
        """
        side = 1
        while np.prod(FaceBlocks(face, side).shape) > most:
            side += 1
        return FaceBlocks(face, side)

    @property
    def shape(self) -> tuple[int, int]:
        """Blocks along X and along Y."""
        rows, cols = (int(np.ptp(each)) + 1 for each in (self.face.rows, self.face.cols))
        return -(-rows // self.side), -(-cols // self.side)

    @property
    def x(self) -> FloatArray:
        """X of the middle of each row of blocks [µm], shape (rows,)."""
        return self._middle(self.face.rows, 0)

    @property
    def y(self) -> FloatArray:
        """Y of the middle of each column of blocks [µm], shape (columns,)."""
        return self._middle(self.face.cols, 1)

    def _middle(self, pixels: IntArray, axis: int) -> FloatArray:
        first = pixels.min() - self.face.origin[axis] + 0.5 * (self.side - 1)
        return np.asarray(self.face.pixel * (first + self.side * np.arange(self.shape[axis])))

    @cached_property
    def _block(self) -> IntArray:
        """Block of each pixel, shape (n_pix,)."""
        row = (self.face.rows - self.face.rows.min()) // self.side
        column = (self.face.cols - self.face.cols.min()) // self.side
        return np.asarray(row * self.shape[1] + column)

    def mean(self, values: FloatArray) -> FloatArray:
        """Mean of the pixels of each block, NaN where it has none.

        Args:
            values: at the pixels, NaN where there is none, shape (n_pix,).

        Returns:
            shape (rows, columns).
        """
        total, count = self._sums(values)
        return np.asarray(total / np.where(count > 0, count, np.nan))

    def mean_over_noise(self, values: FloatArray) -> FloatArray:
        """Return the mean over its standard deviation, of values of independent unit noise.

        Args:
            values: as in `mean`.
        """
        total, count = self._sums(values)
        return np.asarray(total / np.sqrt(np.where(count > 0, count, np.nan)))

    def _sums(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        seen, n = np.isfinite(values), int(np.prod(self.shape))
        total = np.asarray(np.bincount(self._block[seen], values[seen], n), dtype=np.float64)
        count = np.bincount(self._block[seen], minlength=n).astype(np.float64)
        return total.reshape(self.shape), count.reshape(self.shape)
