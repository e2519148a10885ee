"""The volume of an export: the fields of each model, simulated once more."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from driver.export.command import ExportError, export_case
from meshes.med_fields import read_med_fields
from solver_adapters.interface import Response
from solver_adapters.jobs.errors import CommandMissingError
from solver_adapters.jobs.status import Status
from tests.driver.export.exported import (
    TIME,
    Results,
    coarse_mesh,
)


def volume(path: Path) -> dict[str, NDArray[np.float64]]:
    """Every dataset of a volume file by its path below VTKHDF."""
    found = {}
    with h5py.File(path) as file:
        file["VTKHDF"].visititems(
            lambda name, item: found.update({name: item[()]}) if hasattr(item, "dtype") else None
        )
    return found


@pytest.mark.parametrize(("label", "tau0"), [("model", 21.0), ("extended", 20.0)])
def test_the_volume_of_each_model_holds_its_fields_at_the_images(
    results: Results, label: str, tau0: float
) -> None:
    export_case(results.case_path, results.to)
    found, mesh = volume(results.to / f"volume_{label}.vtkhdf"), coarse_mesh()
    n = len(mesh.cells)
    assert found["Steps/Values"].tolist() == TIME.tolist()
    u = found["PointData/displacement_um"].reshape(3, -1, 3)
    assert u == pytest.approx(1e-3 * TIME[:, None, None] * mesh.points, rel=1e-6)
    cells = tau0 * TIME[:, None] * np.arange(n)
    for name, width in {"slip": 24, "stress_MPa": 6, "lattice_rotation_rad": 3}.items():
        values = found[f"CellData/{name}"]
        assert values.shape == (3 * n, width)
        assert values[:, 0].reshape(3, n) == pytest.approx(cells, rel=1e-6)
    # VTK's order XX, YY, ZZ, XY, YZ, XZ of a tensor that was XX, YY, ZZ, YZ, XZ, XY.
    share = found["CellData/stress_MPa"][-n] / (tau0 * TIME[-1])
    assert share == pytest.approx([0, 0.01, 0.02, 0.05, 0.03, 0.04], abs=1e-7)
    one_by_one = found["CellData/accumulated_slip"]
    assert one_by_one == pytest.approx(found["CellData/slip"] + 1, rel=1e-6)
    summed = found["CellData/accumulated_slip_sum"]
    assert summed == pytest.approx(one_by_one.sum(axis=1), rel=1e-6)
    assert found["CellData/grain"].tolist() == (mesh.grain + 1).tolist()


def test_the_volume_is_written_for_salome_where_that_is_asked(results: Results) -> None:
    export_case(results.case_path, results.to, med=True)
    for label in ("model", "extended"):
        found = read_med_fields(results.to / f"volume_{label}.med")
        shown = volume(results.to / f"volume_{label}.vtkhdf")
        assert found["DEPL"].times.tolist() == TIME.tolist()
        u = shown["PointData/displacement_um"].reshape(found["DEPL"].values.shape)
        assert found["DEPL"].values == pytest.approx(u, rel=1e-6)
        slip = shown["CellData/slip"].reshape(found["SLIP"].values.shape)
        assert found["SLIP"].values == pytest.approx(slip, rel=1e-6)
    assert "volume_model.med" in (results.to / "README.txt").read_text("utf-8")
    export_case(results.case_path, results.to)
    assert not list(results.to.glob("*.med"))


def test_the_models_are_simulated_once_each_as_they_were_fitted(
    results: Results, lines: list[str]
) -> None:
    export_case(results.case_path, results.to)
    model, extended = results.solver.asked
    assert [s.material.tau0_grain2 for s in (model, extended)] == [1.0, 1.15]
    # The end face moves by the elongation between the turning points.
    ends = [np.ptp(s.motion[1, :, 1]) for s in (model, extended)]
    assert ends == pytest.approx([0.064, 0.065], rel=0.2)
    assert not model.directions
    assert "2 simulations" in lines[0] and "s on free cores" in lines[0]
    assert lines[1:3] == ["  model: 50 %, 60 s to go", "  model: 100 %, 60 s to go"]


def test_without_the_volume_nothing_is_simulated_and_a_stale_one_is_removed(
    results: Results,
) -> None:
    export_case(results.case_path, results.to)
    asked = len(results.solver.asked)
    export_case(results.case_path, results.to, volume=False)
    assert len(results.solver.asked) == asked
    assert not list(results.to.glob("*.vtkhdf"))
    assert "vtkhdf" not in (results.to / "README.txt").read_text("utf-8")


def test_a_solver_without_fields_leaves_the_volume_out_and_says_so(
    results: Results, lines: list[str]
) -> None:
    results.solver.cell_fields = False
    export_case(results.case_path, results.to)
    assert lines[0] == "no fields of the volume: the solver bundled answers none"
    n_files = sum(path.is_file() for path in results.to.rglob("*"))
    assert lines[1:] == [f"{results.to}: {n_files} files, README.txt says what they hold"]
    assert not list(results.to.glob("*.vtkhdf"))


def test_med_without_the_volume_is_refused(results: Results) -> None:
    with pytest.raises(ExportError, match="^--med: found --no-volume, expected --volume"):
        export_case(results.case_path, results.to, volume=False, med=True)
    assert not results.to.exists()


def test_an_absent_program_leaves_the_volume_out_and_says_why(
    results: Results, monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    def absent(*_: object) -> Response:
        status = Status.COMMAND_MISSING
        raise CommandMissingError("bar", status, 'found no "bar" on PATH', remedy="prepare")

    monkeypatch.setattr(results.solver, "solve", absent)
    export_case(results.case_path, results.to, med=True)
    assert lines[-2] == (
        'no fields of the volume: bar: found no "bar" on PATH (--no-volume leaves them out unasked)'
    )
    assert (results.to / "loads.csv").is_file()
    assert not list(results.to.glob("volume_*"))
    assert "vtkhdf" not in (results.to / "README.txt").read_text("utf-8")


def test_the_jobs_of_the_volume_of_an_external_solver_are_kept_beside_those_of_a_run(
    results: Results,
) -> None:
    export_case(results.case_path, results.to)
    assert results.solver.workspaces == [None, None]
    results.edit('name = "bundled"', 'name = "calculix"')
    results.record("mesh", "measure", "identify", "diagnose")
    export_case(results.case_path, results.to)
    assert results.solver.workspaces[2:] == [results.folder / "jobs"] * 2
