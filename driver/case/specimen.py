"""The specimen: its geometry, and the sizes of its meshes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from driver.case.mesh_sizes import (
    LARGEST_RATIO,
    next_divisions,
    refined_sizes,
    sizes_at,
    sizes_in_pieces,
    sizes_of_pieces,
)
from driver.case.messages import refusal
from driver.case.values import FileName, Point, Positive, Table, Vector
from meshes.grain_boundary import GrainBoundary, fault_of, is_direction
from meshes.measures import Measures
from meshes.prism import CellKind
from meshes.section import Section

AUTO: Literal["auto"] = "auto"
"""What stands in place of sizes that are chosen, and refined, without the user."""
Shape = Literal["prism", "bar", "mesh"]
"""Of the section: a triangle, or a rectangle or trapezoid; or that of a mesh of the user's own."""
SIZES = ("mesh_size_um", "fine_mesh_size_um")
"""Keys of the sizes of the working and of the finer mesh."""


class BoundaryPlane(Table):
    """A table [[specimen.boundaries]]: the plane between a grain and the next one."""

    point_um: Vector = Field(description="a list of three numbers [X, Y, Z], a point of the plane")
    normal: Vector = Field(
        description="a list of three numbers, the normal that points into the grain of the larger "
        "number"
    )


class Specimen(Table):
    """Geometry of the specimen and of its grain boundaries [µm], and sizes of the two meshes."""

    shape: Shape = Field(
        default="prism",
        description='"prism", triangular, "bar", whose section is a rectangle or a trapezoid, or '
        '"mesh", as mesh_file is',
    )
    length_um: Positive = Field(default=12.0, description="length along Y")
    width_um: Positive = Field(default=4.0, description="width of the measured face along X")
    depth_um: Positive | None = Field(
        default=None,
        description="depth along −Z, default width·√3/2 of a prism, the width of a bar",
    )
    bottom_width_um: Positive | None = Field(
        default=None,
        description="width of the side of a bar that is opposite to the measured face, default "
        "that of the face",
    )
    cells: CellKind | None = Field(
        default=None,
        description='"tet10" or "hex20", tetrahedra as other programs take them, or hexahedra in '
        "layers along Y, which follow plastic flow better; left out, they are chosen with "
        "automatic sizes, and tetrahedra with stated ones",
    )
    mesh_size_um: Positive | Literal["auto"] = Field(
        default=AUTO,
        description='a number > 0, the edge of the elements of the working mesh, or "auto"',
    )
    fine_mesh_size_um: Positive | Literal["auto"] = Field(
        default=AUTO,
        description='a number > 0, the edge of the elements of the finer mesh, or "auto"',
    )
    boundary_point_um: Vector | None = Field(
        default=None, description="a list of three numbers [X, Y, Z], a point of the grain boundary"
    )
    boundary_normal: Vector | None = Field(
        default=None,
        description="a list of three numbers, the normal that points into the second grain",
    )

    boundaries: tuple[BoundaryPlane, ...] = Field(
        default=(),
        description="tables [[specimen.boundaries]] in the order of the grains, one fewer than "
        "grains; in place of boundary_point_um and boundary_normal",
    )

    mesh_file: FileName | None = Field(
        default=None,
        description='a text in quotes, the mesh of the specimen with shape = "mesh": .msh, .med or '
        ".vtu, in µm",
    )
    labels: FileName | None = Field(
        default=None,
        description="a text in quotes, an image of the number of the grain at each pixel of the "
        "face, which lies as the images do, or the EBSD map that all grains name; grains are "
        "columns below it",
    )
    labels_pixel_nm: Positive | None = Field(
        default=None,
        description="side of a pixel of labels, default that of the images, whose field it shows",
    )
    labels_point_um: Point | None = Field(
        default=None,
        description="a list of two numbers [x, y], where an EBSD map in labels has the origin of "
        "the specimen",
    )

    added: ClassVar[frozenset[str]] = frozenset(
        {
            "shape", "bottom_width_um", "boundaries", "mesh_file", "labels", "labels_pixel_nm",
            "labels_point_um",
        }
    )  # fmt: skip

    _refined: int | None = PrivateAttr(default=None)
    _measures: Measures | None = PrivateAttr(default=None)

    def measured(self, measures: Measures) -> Specimen:
        """Return the specimen with the measures of its mesh file, and its kind of cells."""
        known = self.model_copy(update={} if self.automatic else {"cells": measures.kind})
        known._measures = measures
        return known

    @property
    def measures(self) -> Measures:
        """The measures of its mesh file."""
        assert self._measures is not None  # a case gets them where it is read
        return self._measures

    @property
    def of_mesh(self) -> bool:
        """Whether it is a mesh of the user's own."""
        return self.shape == "mesh"

    @property
    def boundaries_stay(self) -> bool:
        """Whether its grain boundaries are drawn and no parameter moves them."""
        return self.of_mesh or self.labels is not None

    @property
    def automatic(self) -> bool:
        """Whether the sizes of the meshes are still to be chosen."""
        return self.mesh_size_um == AUTO

    @property
    def refined(self) -> int | None:
        """How often the sizes that were chosen have been refined; None for stated sizes."""
        return self._refined

    def at_level(self, kind: CellKind, level: int) -> Specimen:
        """Return the specimen with sizes in place of "auto".

        Args:
            kind: of the cells.
            level: how often both meshes were refined.
        """
        if self.of_mesh:
            sizes = sizes_in_pieces(self.measures.size, level)
        else:
            sizes = sizes_at(self.section, kind, level)
        chosen = self.model_copy(update={"cells": kind, **dict(zip(SIZES, sizes, strict=True))})
        chosen._refined = level
        return chosen

    @property
    def cell_kind(self) -> CellKind:
        """Kind of the cells, stated or chosen."""
        assert self.cells is not None  # stated sizes have tetrahedra without it
        return self.cells

    @property
    def length(self) -> float:
        """Length along Y [µm]."""
        return self.length_um if self._measures is None else self._measures.length

    @property
    def width(self) -> float:
        """Width along X [µm]."""
        return self.width_um if self._measures is None else self._measures.width

    @property
    def mesh_size(self) -> float:
        """Edge of the elements of the working mesh [µm]."""
        assert not isinstance(self.mesh_size_um, str)  # a case gets its sizes where it is read
        return self.mesh_size_um

    @property
    def fine_mesh_size(self) -> float:
        """Edge of the elements of the finer mesh [µm]."""
        assert not isinstance(self.fine_mesh_size_um, str)
        return self.fine_mesh_size_um

    @property
    def depth(self) -> float:
        """Depth of the apex or far side below the measured face [µm]."""
        if self._measures is not None:
            return self._measures.depth
        if self.depth_um is not None:
            return self.depth_um
        return self.width_um * 3**0.5 / 2 if self.shape == "prism" else self.width_um

    @property
    def bottom(self) -> float:
        """Width of the far side [µm], 0 of a prism."""
        if self.shape == "prism":
            return 0.0
        return self.width if self.bottom_width_um is None else self.bottom_width_um

    @property
    def section(self) -> Section:
        """The section; of a mesh of the user's own the rectangle about it."""
        return Section(self.width, self.depth, self.bottom)

    @property
    def area(self) -> float:
        """Area of the section [µm²], of a mesh of the user's own its volume over its length."""
        return self.section.area if self._measures is None else self._measures.area

    def divisions(self, size: float) -> int:
        """Return how many hexahedra of a size [µm] lie along half of the longest side.

        Of a mesh of the user's own, in how many pieces its edges are.
        """
        if self.of_mesh:
            return max(1, round(self.measures.size / size))
        return self.section.divisions(size)

    def divisions_of(self, end_faces: int) -> int:
        """Return the same of a mesh that has so many quadrilaterals, or faces, on S_MINUS."""
        if self.of_mesh:
            return max(1, round(float(np.sqrt(end_faces / self.measures.end_faces))))
        return self.section.divisions_of(end_faces)

    def size_of(self, divisions: int) -> float:
        """Return the size of the cells that are so many, or so many pieces of an edge [µm]."""
        if self.of_mesh:
            return self.measures.size / divisions
        return self.section.longest_side / 2 / divisions

    @property
    def next_sizes(self) -> tuple[float, float]:
        """Sizes of the working and of the finer mesh after one more refinement [µm]."""
        if self.of_mesh:
            pieces = self.divisions(self.mesh_size), self.divisions(self.fine_mesh_size)
            return sizes_of_pieces(self.measures.size, next_divisions(*pieces))
        return refined_sizes(self.section, self.cell_kind, (self.mesh_size, self.fine_mesh_size))

    @property
    def planes(self) -> tuple[GrainBoundary, ...]:
        """Planes between neighbouring grains, in the order of the grains."""
        if self.boundary_point_um is not None and self.boundary_normal is not None:
            return (GrainBoundary(self.boundary_point_um, self.boundary_normal),)
        return tuple(GrainBoundary(plane.point_um, plane.normal) for plane in self.boundaries)

    @model_validator(mode="before")
    @classmethod
    def _tetrahedra_of_stated_sizes(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or data.get("mesh_size_um", AUTO) == AUTO:
            return data
        if data.get("shape") == "mesh":
            return data
        return dict(data) | {"cells": data.get("cells") or "tet10"}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.shape != "bar" and self.bottom_width_um is not None:
            raise refusal('nothing, or shape = "bar"', "bottom_width_um")
        if not self.of_mesh and self.mesh_file is not None:
            raise refusal('nothing, or shape = "mesh"', "mesh_file")
        if self.of_mesh:
            self._refuse_what_the_mesh_tells()
        if self.labels is not None:
            self._refuse_what_the_labels_tell()
        else:
            for key in ("labels_pixel_nm", "labels_point_um"):
                if getattr(self, key) is not None:
                    raise refusal("nothing, or labels as well", key)
        automatic = [key for key in SIZES if getattr(self, key) == AUTO]
        if len(automatic) == 1:
            other = next(key for key in SIZES if key not in automatic)
            raise refusal(f'a number, or {other} = "auto" as well', automatic[0])
        if not automatic:
            self._refuse_sizes()
        if (self.boundary_point_um is None) != (self.boundary_normal is None):
            absent = "boundary_point_um" if self.boundary_point_um is None else "boundary_normal"
            raise refusal("a list of three numbers, as the other half of the boundary", absent)
        self._refuse_boundaries()
        return self

    def _refuse_what_the_mesh_tells(self) -> None:
        """Refuse keys of what the mesh of the user's own has."""
        if self.mesh_file is None:
            raise refusal(
                'a text in quotes, the mesh of the specimen, for shape = "mesh"', "mesh_file"
            )
        self._refuse_planes("mesh_file")
        if self.labels is not None:
            raise refusal("nothing: mesh_file has it", "labels")

    def _refuse_what_the_labels_tell(self) -> None:
        """Refuse keys of what labels have, and cells that cannot follow them."""
        self._refuse_planes("labels")
        if self.cells == "hex20":
            raise refusal('"tet10", which follow labels, or nothing', "cells")

    def _refuse_planes(self, told: str) -> None:
        """Refuse planes between grains, which another key tells."""
        for key in ("boundary_point_um", "boundary_normal", "boundaries"):
            if getattr(self, key):
                raise refusal(f"nothing: {told} has it", key)

    def _refuse_boundaries(self) -> None:
        """Refuse boundaries that do not part a row of grains."""
        if self.boundaries and self.boundary_point_um is not None:
            raise refusal("one of boundaries and boundary_point_um", "boundaries", "both")
        normals = {"boundary_normal": self.boundary_normal} | {
            f"boundaries.{number}.normal": plane.normal
            for number, plane in enumerate(self.boundaries, start=1)
        }
        for key, normal in normals.items():
            if normal is not None and not is_direction(normal):
                raise refusal("a normal other than zero", key)
        fault = fault_of(self.planes, self.section, self.length)
        if fault is not None:
            raise refusal(fault.expected, f"boundaries.{fault.number}", fault.found)

    def _refuse_sizes(self) -> None:
        """Refuse two sizes of which the finer one tells nothing of the error of the other."""
        size, fine = self.mesh_size, self.fine_mesh_size
        if fine >= size:
            raise refusal(f"a number < mesh_size_um = {size:g}", "fine_mesh_size_um")
        if self.cells != "hex20" or self.of_mesh:
            return
        divisions = self.section.divisions(size)
        if self.section.divisions(fine) <= divisions:
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
