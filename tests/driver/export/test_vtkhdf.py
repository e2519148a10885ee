"""The layout of a VTKHDF file, as VTK 9.3 and 9.7 read it."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.export.vtkhdf import write_vtkhdf
from tools.boxes import BOXES


@pytest.mark.parametrize(("element", "kind"), [("tet10", 24), ("hex20", 25)])
def test_the_mesh_stands_once_and_fields_step_after_step(
    element: str, kind: int, tmp_path: Path
) -> None:
    """Names and shapes of version 2.0 of the format (specification at docs.vtk.org)."""
    mesh, times = BOXES[element](), np.array([0.0, 2.5, 7.0])
    n_points, n_cells = len(mesh.points), len(mesh.cells)
    u = times[:, None, None] * mesh.points
    total = times[:, None] * np.arange(n_cells, dtype=float)
    path = tmp_path / "volume.vtkhdf"
    write_vtkhdf(path, mesh, times, {"u": u}, {"total": total})
    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert root.attrs["Version"].tolist() == [2, 0]
        assert root.attrs["Type"] == b"UnstructuredGrid"
        assert root["NumberOfPoints"][()].tolist() == [n_points]
        assert root["NumberOfCells"][()].tolist() == [n_cells]
        assert root["NumberOfConnectivityIds"][()].tolist() == [mesh.cells.size]
        np.testing.assert_array_equal(root["Points"], mesh.points)
        ends = root["Offsets"][()]
        cells = np.split(root["Connectivity"][()], ends[1:-1])
        np.testing.assert_array_equal(cells, mesh.cells)
        assert set(root["Types"][()]) == {kind} and root["Types"].dtype == np.uint8
        steps = root["Steps"]
        assert steps.attrs["NSteps"] == 3
        assert steps["Values"][()].tolist() == times.tolist()
        for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            assert steps[name][()].tolist() == [0, 0, 0]
        for step in range(3):
            first = steps["PointDataOffsets/u"][step]
            rows = root["PointData/u"][first : first + n_points]
            np.testing.assert_allclose(rows, u[step], rtol=1e-6)
            first = steps["CellDataOffsets/total"][step]
            np.testing.assert_allclose(
                root["CellData/total"][first : first + n_cells], total[step], rtol=1e-6
            )
            assert steps["CellDataOffsets/grain"][step] == 0
        np.testing.assert_array_equal(root["CellData/grain"], mesh.grain + 1)
