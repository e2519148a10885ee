"""The grains of a specimen: Bunge angles or a place in an EBSD map, and the frames of both."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from driver.case.messages import refusal
from driver.case.values import FileName, Point, Table, Vector
from meshes.arrays import FloatArray

EbsdFrame = Literal["edax", "oxford", "bruker"]

EULER_AXES: dict[EbsdFrame, tuple[Vector, Vector, Vector]] = {
    "edax": ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "oxford": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "bruker": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
}
"""Rotation from the frame of the Euler angles to that of the map, by the maker of the system.

The map has x to the right along its rows, y down its columns and z into the specimen. Columns are
the axes of the Euler angles in it:

- EDAX: A1 (RD) is −y, A2 (TD) is −x, A3 (ND) is −z, a half turn about x − y. Panel c of the figure
  "EDAX TSL" in "Reference frames" of kikuchipy (doc/tutorials/reference_frames.ipynb), and setting
  2 of "Reference Frame Alignment" of MTEX (EBSDReferenceFrame), there "by far the most common". An
  .ang file does not store its setting.
- Oxford: X1 is −x, Y1 is y, Z1 is −z, a half turn about y. Figure "Oxford Instruments" of the same
  page. Its quarter turn about the normal from that of EDAX is the 90° of φ1 between both in EMsoft
  (EMsoft-org/EMsoft issue 155). MTEX assumes a half turn about z for .ctf files, which is this
  one and a half turn about x.
- Bruker: as Oxford. Figure "Bruker" of the same page.
"""


OF_THE_FACE: tuple[Vector, Vector, Vector] = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
"""From a map of the measured face to the specimen, x of the map along Y and y along X."""

GIVES_WAY: dict[str, tuple[str, ...]] = {
    "euler_deg": ("ebsd", "ebsd_point_um", "ebsd_grain"),
    "ebsd": ("euler_deg",),
    "ebsd_point_um": ("ebsd_grain",),
    "ebsd_grain": ("ebsd_point_um",),
}
"""Keys of a grain that another one stands in place of, where a change of a case states it."""


class _Stated(Table):
    """A table that is written without the keys that are left out.

    What a stage depends on is a hash of that: keys that came later leave old results as they are.
    """

    @model_serializer(mode="wrap")
    def _without_absent(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in written(self).items() if value is not None}


class Grain(_Stated):
    """A grain and its measured orientation."""

    name: Annotated[str, Field(min_length=1, max_length=1000)] = Field(
        description="a text in quotes of 1 to 1000 letters, the label of the grain"
    )
    euler_deg: Vector | None = Field(
        default=None,
        description="a list of three numbers [φ1, Φ, φ2], Bunge, sample → crystal, in degrees",
    )
    ebsd: FileName | None = Field(
        default=None,
        description="a text in quotes, an .ang, .ctf or .h5 file with an EBSD map",
    )
    ebsd_point_um: Point | None = Field(
        default=None,
        description="a list of two numbers [x, y], a point of the grain in the map",
    )
    ebsd_grain: Annotated[int, Field(strict=True)] | None = Field(
        default=None, description="a whole number, the grain in the map, where its file counts them"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.euler_deg is None and self.ebsd is None:
            raise refusal(
                "a list of three numbers [φ1, Φ, φ2], Bunge angles in degrees, or a map, ebsd",
                "euler_deg",
            )
        if self.euler_deg is not None and self.ebsd is not None:
            raise refusal("one of euler_deg and ebsd", "ebsd", "both")
        for key in ("ebsd_point_um", "ebsd_grain"):
            if getattr(self, key) is not None and self.ebsd is None:
                raise refusal("an EBSD map as well, ebsd", key)
        if self.ebsd_point_um is not None and self.ebsd_grain is not None:
            raise refusal("one of ebsd_point_um and ebsd_grain", "ebsd_grain", "both")
        return self


class Orientation(_Stated):
    """The rotation from the Euler angles, by way of the EBSD frame, to the specimen frame."""

    ebsd_frame: EbsdFrame | None = Field(
        default=None,
        description='"edax", "oxford" or "bruker", how Euler angles refer to x and y of the map; '
        "left out, the EBSD frame is that of the Euler angles",
    )
    ebsd_to_specimen: tuple[Vector, Vector, Vector] = Field(
        default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        description="three rows of three numbers, x_specimen = matrix · x_EBSD",
    )

    @property
    def rotation(self) -> FloatArray:
        """The proper rotation nearest to the given matrix (it may be rounded), shape (3, 3)."""
        left, _, right = np.linalg.svd(np.array(self.ebsd_to_specimen))
        return np.asarray(left @ right, dtype=np.float64)

    @property
    def from_euler_axes(self) -> FloatArray:
        """Rotation from the frame of the Euler angles to the specimen frame, shape (3, 3)."""
        if self.ebsd_frame is None:
            return self.rotation
        return np.asarray(self.rotation @ np.array(EULER_AXES[self.ebsd_frame]))

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
