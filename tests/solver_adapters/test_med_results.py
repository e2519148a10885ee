"""A response as a MED result: read back, and on the mesh with its groups."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from meshes.files import read_med
from meshes.med_fields import read_med_fields
from meshes.prism import PrismGeometry, generate
from solver_adapters.interface import CellFields
from solver_adapters.med_results import write_results
from tests.meshes import raw_med


def test_a_response_is_read_back_at_all_instants_on_its_mesh(tmp_path: Path) -> None:
    mesh = generate(PrismGeometry(), 3.0)
    rng, n = np.random.default_rng(5), len(mesh.cells)
    cells = CellFields(*(rng.random((2, n, width)) for width in (6, 24, 24, 3)))
    u, times = rng.random((2, len(mesh.points), 3)), np.array([0.0, 12.5])
    path = tmp_path / "result.med"
    write_results(path, mesh, times, u, cells)
    np.testing.assert_array_equal(read_med(path).cells, mesh.cells)
    found = read_med_fields(path)
    expected = {
        "DEPL": u,
        "STRESS": cells.stress,
        "SLIP": cells.slip,
        "ACCUMULATED_SLIP": cells.accumulated_slip,
        "ROTATION": cells.rotation,
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name].values, values)
        np.testing.assert_array_equal(found[name].times, times)
    # The order of `CellFields`, said in the names that Code_Aster uses.
    assert found["STRESS"].components == ("SIXX", "SIYY", "SIZZ", "SIYZ", "SIXZ", "SIXY")
    assert set(found["STRESS"].units) == {"MPa"}
    assert found["SLIP"].components[-1] == "S24"
    of_48 = replace(cells, slip=rng.random((2, n, 48)), accumulated_slip=rng.random((2, n, 48)))
    write_results(path, mesh, times, u, of_48)
    found = read_med_fields(path)
    for name, slips in (("SLIP", of_48.slip), ("ACCUMULATED_SLIP", of_48.accumulated_slip)):
        assert found[name].components[-1] == "S48"
        np.testing.assert_array_equal(found[name].values, slips)


def test_a_response_is_written_in_med_4_0_as_h5py_alone_sees_it(tmp_path: Path) -> None:
    mesh = generate(PrismGeometry(), 3.0)
    rng, n = np.random.default_rng(6), len(mesh.cells)
    cells = CellFields(*(rng.random((2, n, width)) for width in (6, 24, 24, 3)))
    u, times = rng.random((2, len(mesh.points), 3)), np.array([0.0, 12.5])
    path = tmp_path / "result.med"
    write_results(path, mesh, times, u, cells)
    assert raw_med.version(path) == (4, 0)
    declared = raw_med.declared_families(path, "prism")
    for kind in (None, "T10", "TR6"):
        assert set(raw_med.families(path, "prism", kind)) <= declared
    for name, place, values in (
        ("DEPL", "NOE", u),
        ("STRESS", "MAI.T10", cells.stress),
        ("SLIP", "MAI.T10", cells.slip),
        ("ACCUMULATED_SLIP", "MAI.T10", cells.accumulated_slip),
        ("ROTATION", "MAI.T10", cells.rotation),
    ):
        written = raw_med.field(path, name, place)
        assert [time for _, _, time in written] == times.tolist()
        np.testing.assert_array_equal(list(written.values()), values)
