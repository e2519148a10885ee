"""A volume over time in one VTKHDF file: the mesh once, each field step after step.

The layout is version 2.0 of the format, the first one with steps
(https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/vtkhdf_specifications.html).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh

# VTK_QUADRATIC_TETRA and VTK_QUADRATIC_HEXAHEDRON by nodes of a cell.
_KINDS = {10: 24, 20: 25}


def write_vtkhdf(
    path: Path,
    mesh: PrismMesh,
    times: FloatArray,
    point_data: Mapping[str, FloatArray],
    cell_data: Mapping[str, FloatArray],
) -> None:
    """Write fields over time on the undeformed mesh, with `grain` (1, 2, …) as cell data.

    Fields are kept in single precision and compressed.

    Args:
        path: file to write, ending in .vtkhdf.
        mesh: the volume.
        times: instants [s], shape (T,).
        point_data: nodal fields by name, each of shape (T, n_nodes, k).
        cell_data: cell fields by name, each of shape (T, n_cells) or (T, n_cells, k).
    """
    n_points, (n_cells, n_local) = len(mesh.points), mesh.cells.shape
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        kind = b"UnstructuredGrid"
        root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
        root["NumberOfPoints"] = [n_points]
        root["NumberOfCells"] = [n_cells]
        root["NumberOfConnectivityIds"] = [mesh.cells.size]
        root["Points"] = mesh.points
        root["Connectivity"] = mesh.cells.ravel()
        root["Offsets"] = np.arange(n_cells + 1) * n_local
        root["Types"] = np.full(n_cells, _KINDS[n_local], dtype=np.uint8)
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = len(times)
        steps["Values"] = times
        steps["NumberOfParts"] = np.ones(len(times), dtype=np.int64)
        # Every step shows the one mesh.
        for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = np.zeros(len(times), dtype=np.int64)
        for group, size, fields in (
            ("PointData", n_points, point_data),
            ("CellData", n_cells, cell_data),
        ):
            offsets = np.arange(len(times)) * size
            for name, values in fields.items():
                rows = values.reshape(len(times) * size, *values.shape[2:]).astype(np.float32)
                # A chunk is a step: an instant is read without its neighbours.
                root.create_dataset(
                    f"{group}/{name}", data=rows, chunks=(size, *rows.shape[1:]),
                    compression="gzip", shuffle=True,
                )  # fmt: skip
                steps[f"{group}Offsets/{name}"] = offsets
        root["CellData/grain"] = mesh.grain + 1
        steps["CellDataOffsets/grain"] = np.zeros(len(times), dtype=np.int64)
