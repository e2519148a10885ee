"""Responses as MED results, which Salome's ParaVis shows."""

from __future__ import annotations

from pathlib import Path

from meshes.arrays import FloatArray
from meshes.files import write_med
from meshes.med_fields import MedField, Place, add_med_fields
from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import CellFields

_AXES = ("X", "Y", "Z")
_STRESSES = ("SIXX", "SIYY", "SIZZ", "SIYZ", "SIXZ", "SIXY")


def write_results(
    path: Path,
    mesh: PrismMesh,
    times: FloatArray,
    displacement: FloatArray,
    cells: CellFields,
) -> None:
    """Write a mesh with its groups and the fields of a response on it, at all instants.

    Fields: DEPL at the nodes; STRESS, SLIP, ACCUMULATED_SLIP and ROTATION in the cells.

    Args:
        path: file to write; an existing one is replaced.
        mesh: the mesh.
        times: instants of the outputs [s], shape (T,).
        displacement: of every node [µm], shape (T, n_nodes, 3).
        cells: fields of the cells at these instants.

    Raises:
        ValueError: an array does not fit the mesh and the instants.
    """

    def field(
        name: str, place: Place, components: tuple[str, ...], unit: str, values: FloatArray
    ) -> MedField:
        return MedField(name, place, components, (unit,) * len(components), times, values)

    systems = tuple(f"S{number}" for number in range(1, cells.slip.shape[-1] + 1))
    write_med(mesh, path)
    add_med_fields(
        path,
        (
            field("DEPL", "nodes", tuple(f"D{axis}" for axis in _AXES), "um", displacement),
            field("STRESS", "cells", _STRESSES, "MPa", cells.stress),
            field("SLIP", "cells", systems, "", cells.slip),
            field("ACCUMULATED_SLIP", "cells", systems, "", cells.accumulated_slip),
            field("ROTATION", "cells", tuple(f"R{axis}" for axis in _AXES), "rad", cells.rotation),
        ),
    )
