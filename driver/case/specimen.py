"""The specimen: its geometry, its grains and their orientations."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from driver.case.messages import refusal
from driver.case.values import Positive, Table, Vector
from meshes.arrays import FloatArray
from meshes.prism import CellKind, section_divisions

LARGEST_RATIO = 0.7
"""Of the finer size of hexahedra to the working one, up to which both tell of the error."""


class Specimen(Table):
    """Geometry of the prism and of its grain boundary [µm], and the sizes of the two meshes."""

    length_um: Positive = Field(default=12.0, description="length along Y")
    width_um: Positive = Field(default=4.0, description="width of the measured face along X")
    depth_um: Positive | None = Field(
        default=None, description="depth along −Z, default width·√3/2"
    )
    cells: CellKind = Field(
        default="tet10",
        description='"tet10" or "hex20", tetrahedra as other programs take them, or hexahedra in '
        "layers along Y, which follow plastic flow better",
    )
    mesh_size_um: Positive = Field(
        default=1.6, description="edge of the elements of the working mesh"
    )
    fine_mesh_size_um: Positive = Field(
        default=1.1, description="edge of the elements of the finer mesh"
    )
    boundary_point_um: Vector | None = Field(
        default=None, description="a list of three numbers [X, Y, Z], a point of the grain boundary"
    )
    boundary_normal: Vector | None = Field(
        default=None,
        description="a list of three numbers, the normal that points into the second grain",
    )

    @property
    def length(self) -> float:
        """Length along Y [µm]."""
        return self.length_um

    @property
    def width(self) -> float:
        """Width along X [µm]."""
        return self.width_um

    @property
    def mesh_size(self) -> float:
        """Edge of the elements of the working mesh [µm]."""
        return self.mesh_size_um

    @property
    def fine_mesh_size(self) -> float:
        """Edge of the elements of the finer mesh [µm]."""
        return self.fine_mesh_size_um

    @property
    def depth(self) -> float:
        """Depth of the apex below the measured face [µm]."""
        return self.depth_um if self.depth_um is not None else self.width_um * 3**0.5 / 2

    @property
    def area(self) -> float:
        """Area of the triangular section [µm²]."""
        return self.width * self.depth / 2

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.fine_mesh_size_um >= self.mesh_size_um:
            raise refusal(f"a number < mesh_size_um = {self.mesh_size_um:g}", "fine_mesh_size_um")
        if self.cells == "hex20":
            self._refuse_like_hexahedra()
        if (self.boundary_point_um is None) != (self.boundary_normal is None):
            absent = "boundary_point_um" if self.boundary_point_um is None else "boundary_normal"
            raise refusal("a list of three numbers, as the other half of the boundary", absent)
        if self.boundary_normal is not None and not any(self.boundary_normal):
            raise refusal("a normal other than zero", "boundary_normal")
        return self

    def _refuse_like_hexahedra(self) -> None:
        """Refuse two sizes of which the finer one tells nothing of the error of the other."""
        size, fine = self.mesh_size_um, self.fine_mesh_size_um
        divisions = section_divisions(self.width, self.depth, size)
        if section_divisions(self.width, self.depth, fine) <= divisions:
            raise refusal(
                f"a size with more than {divisions} cells along half of the longest side of the "
                "section, as hexahedra",
                "fine_mesh_size_um",
            )
        if fine > LARGEST_RATIO * size:
            raise refusal(
                f"a number ≤ {LARGEST_RATIO * size:g}, {LARGEST_RATIO:g} of mesh_size_um, with "
                "hexahedra",
                "fine_mesh_size_um",
            )


class Grain(Table):
    """A grain and its measured orientation."""

    name: str = Field(description="a text in quotes, the label of the grain")
    euler_deg: Vector = Field(
        description="a list of three numbers [φ1, Φ, φ2], Bunge, sample → crystal, in degrees"
    )


class Orientation(Table):
    """The rotation from the EBSD frame to the specimen frame."""

    ebsd_to_specimen: tuple[Vector, Vector, Vector] = Field(
        default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        description="three rows of three numbers, x_specimen = matrix · x_EBSD",
    )

    @property
    def rotation(self) -> FloatArray:
        """The proper rotation nearest to the given matrix (it may be rounded), shape (3, 3)."""
        left, _, right = np.linalg.svd(np.array(self.ebsd_to_specimen))
        return np.asarray(left @ right, dtype=np.float64)

    @model_validator(mode="after")
    def _proper(self) -> Self:
        matrix = np.array(self.ebsd_to_specimen)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3:
            raise refusal("a proper rotation: orthonormal rows (to 1e-3)", "ebsd_to_specimen")
        if np.linalg.det(matrix) < 0:
            raise refusal(
                "a proper rotation of determinant +1; this one has −1 and mirrors the crystal",
                "ebsd_to_specimen",
            )
        return self
