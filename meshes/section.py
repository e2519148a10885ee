"""The section of a specimen: a triangle or a trapezoid below the measured face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshes.arrays import FloatArray


@dataclass(frozen=True)
class Section:
    """A section whose upper side is the measured face, −width/2 ≤ X ≤ width/2 at Z = 0.

    Attributes:
        width: of the measured face [µm].
        depth: of the far edge or side below it [µm].
        bottom: width of the far side [µm]; 0 of a triangle, whose far edge is the apex line.
    """

    width: float
    depth: float
    bottom: float = 0.0

    @classmethod
    def of(cls, points: FloatArray) -> Section:
        """Return the section of a mesh by its nodes [µm], shape (n, 3)."""
        x, z = points[:, 0], points[:, 2]
        depth = float(np.ptp(z))
        far = x[z < z.min() + 1e-9 * depth]
        return cls(float(np.ptp(x[z > z.max() - 1e-9 * depth])), depth, float(np.ptp(far)))

    @property
    def corners(self) -> FloatArray:
        """Corners (X, Z) [µm]: both sides of the face, then those of the far side, (3 or 4, 2)."""
        half, far = self.width / 2, self.bottom / 2
        face = [[-half, 0.0], [half, 0.0]]
        below = [[far, -self.depth], [-far, -self.depth]] if far else [[0.0, -self.depth]]
        return np.array(face + below)

    def corners_between(self, *heights: float) -> FloatArray:
        """Return the corners of the section at each Y [µm], shape (n · (3 or 4), 3)."""
        x, z = self.corners.T
        return np.concatenate([np.column_stack([x, np.full(x.size, y), z]) for y in heights])

    @property
    def area(self) -> float:
        """Area [µm²]."""
        return (self.width + self.bottom) * self.depth / 2

    @property
    def centroid_depth(self) -> float:
        """Depth of the centroid below the face [µm]."""
        return self.depth / 3 * ((self.width + 2 * self.bottom) / (self.width + self.bottom))

    @property
    def longest_side(self) -> float:
        """Length of the longest side [µm]; of a trapezoid that of the face, far side or depth."""
        if self.bottom:
            return max(self.width, self.bottom, self.depth)
        return max(self.width, float(np.hypot(self.width / 2, self.depth)))

    def divisions(self, size: float) -> int:
        """Return how many hexahedra of a size [µm] lie along half of the longest side."""
        return max(1, round(self.longest_side / 2 / size))

    def quadrilaterals(self, divisions: int) -> tuple[int, int]:
        """Return how many cells a trapezoid has along X and along Z.

        The shorter side has as many as the longer one, or half of them, so that meshes of any
        divisions are of one family.

        Args:
            divisions: cells along half of the longest side.
        """
        across, down = max(self.width, self.bottom), self.depth
        shorter = divisions if min(across, down) <= 0.75 * max(across, down) else 2 * divisions
        return (2 * divisions, shorter) if across >= down else (shorter, 2 * divisions)

    def divisions_of(self, n_cells: int) -> int:
        """Return the divisions of a section that has so many quadrilaterals."""
        if not self.bottom:
            return round(float(np.sqrt(n_cells / 3)))
        along_x, along_z = self.quadrilaterals(1)
        return round(float(np.sqrt(n_cells / (along_x * along_z))))
