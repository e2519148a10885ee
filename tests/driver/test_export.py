from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from driver import export, finished_results, pipeline, volume_view
from driver.boundary import LAMBDAS
from driver.case import default_case, load_case, write_case
from driver.export import ExportError, export_case
from driver.model import declared_parameters
from driver.paraview import aligned, pixel_squares
from driver.results import ResultError, write_hdf5
from driver.specimen import mesh_of
from driver.stages import stage_key
from meshes.files import write_med, write_vtu
from meshes.med_fields import read_med_fields
from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import Capabilities, CellFields, Progress, Response, Simulation
from solver_adapters.jobs.errors import CommandMissingError
from solver_adapters.jobs.status import Status

Arrays = dict[str, tuple[NDArray[np.generic] | float, str]]
PIXEL = 0.11
TIME = np.array([0.0, 40.5, 81.0])
STAGE = np.array([0.0, 10.0, 4.0])
FORCE = np.array([1.5, 302.0, 120.25])
SHIFT = np.array([[0.0, 0.0, 0.0], [0.02, -0.05, 0.01], [-0.03, 0.04, 0.2]])
# Seven pixels of a field of 3 × 3: one is masked in the middle of the first row, one at a corner.
ROWS, COLS = np.array([0, 1, 1, 1, 2, 2, 2]), np.array([0, 0, 1, 2, 0, 1, 2])
XY = np.column_stack([(ROWS - 1) * PIXEL, COLS * PIXEL])
OUTPUTS = {
    "mesh": ("mesh.med", "mesh.vtu"),
    "measure": ("measure.h5",),
    "identify": ("identify.h5",),
    "diagnose": ("diagnosis.json", "diagnosis.h5"),
}


@cache
def coarse_mesh() -> PrismMesh:
    return mesh_of(default_case(), 3.0)


class LinearSolver:
    """Fields that are linear in time and tell models, cells and components apart."""

    name = "bundled"
    cell_fields = True

    def __init__(self) -> None:
        self.asked: list[Simulation] = []
        self.workspaces: list[Path | None] = []

    def capabilities(self) -> Capabilities:
        return Capabilities(frozenset(), frozenset({"small", "finite"}), False, self.cell_fields)

    def version(self) -> str:
        return "1"

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        self.asked.append(simulation)
        self.workspaces.append(workspace)
        if progress is not None:
            for time in simulation.times[1:]:
                progress(Progress(time, simulation.times[-1], 1, 1, 0, 60.0))
        times = simulation.times[simulation.output]
        points = simulation.mesh.points[simulation.output_nodes]

        def field(width: int) -> NDArray[np.float64]:
            cells = np.arange(len(simulation.mesh.cells))[:, None] + np.arange(width) / 100
            return simulation.material.tau0 * times[:, None, None] * cells

        return Response(
            displacement=1e-3 * times[:, None, None] * points,
            force=times,
            d_displacement=np.zeros((0, len(times), len(points), 3)),
            d_force=np.zeros((0, len(times))),
            cells=CellFields(field(6), field(24), field(24) + 1, field(3)),
        )


class Results:
    """A small case of three images whose results are known; both models stretch the face."""

    def __init__(self, folder: Path) -> None:
        self.solver = LinearSolver()
        self.case_path, self.folder = folder / "case.toml", folder / "results"
        self.to = folder / "to"
        folder.mkdir(exist_ok=True)
        self.folder.mkdir()
        write_case(default_case(), self.case_path)
        rows = "".join(
            f"{t},{s},{i},{f / 2}\n"
            for i, (t, s, f) in enumerate(zip(TIME, STAGE, FORCE, strict=True))
        )
        (folder / "history.csv").write_text("time_s,stage_um,image,force_N\n" + rows)
        stretch = np.zeros((3, 7, 3))
        stretch[..., 1] = np.outer([0.0, 0.01, 0.005], XY[:, 1])
        self.motion = {"final": stretch, "after": 1.1 * stretch}
        self.rho = {key: np.arange(21.0).reshape(3, 7) * 1e-3 for key in self.motion}
        self.load = {"final": np.array([0.0, 300.0, 130.0]), "after": np.array([0.5, 302.5, 120.0])}
        self.measured = stretch + SHIFT[:, None, :]
        self.reference = np.arange(9.0).reshape(3, 3) / 100
        self.write_measure()
        names = ["tau0", "elongation_1", "elongation_2"]
        declared = declared_parameters(3)
        everything = {name: parameter.null for name, parameter in declared.items()}
        everything |= {"tau0": 21.0, "elongation_1": 0.064, "elongation_2": 0.056}
        everything |= {name: 0.9 for name in LAMBDAS}
        write_hdf5(
            self.folder / "identify.h5",
            {
                "sigma": (np.array([0.5, 1e-3, 2e-3]), "see units"),
                "start": (np.array([40.0, 0.0, 0.0]), "see units"),
                **self.predictions("final"),
            },
            {
                "names": json.dumps(names),
                "units": json.dumps(["MPa", "µm", "µm"]),
                "all_values": json.dumps(everything),
            },
        )
        write_hdf5(self.folder / "diagnosis.h5", self.predictions("after"))
        extended = {
            "tau0": {"value": 20.0, "sigma": 0.4, "unit": "MPa"},
            "elongation_1": {"value": 0.065, "sigma": 1e-3, "unit": "µm"},
            "elongation_2": {"value": 0.057, "sigma": 1e-3, "unit": "µm"},
            "tau0_grain2": {"value": 1.15, "sigma": 0.02, "unit": ""},
            "tilt_drift": {"value": 1e-3, "sigma": 1e-4, "unit": ""},
            "reason": "the Newton decrement is 0.01 σ",
        }
        (self.folder / "diagnosis.json").write_text(json.dumps({"extended": extended}))
        write_med(coarse_mesh(), self.folder / "mesh.med")
        write_vtu(coarse_mesh(), self.folder / "mesh.vtu")
        self.record("mesh", "measure", "identify", "diagnose")

    def predictions(self, prefix: str) -> Arrays:
        return {
            f"{prefix}/load": (self.load[prefix], "µN"),
            f"{prefix}/load_residual": (FORCE - self.load[prefix], "µN"),
            f"{prefix}/motion": (self.motion[prefix], "µm"),
            f"{prefix}/rho": (self.rho[prefix], "µm"),
        }

    def write_measure(self) -> None:
        write_hdf5(
            self.folder / "measure.h5",
            {
                "time": (TIME, "s"),
                "stage": (STAGE, "µm"),
                "cycle": (np.array([1, 1, 1]), "1"),
                "force": (FORCE, "µN"),
                "reference": (self.reference, "µm"),
                "xy": (XY, "µm"),
                "rows": (ROWS, "pixel"),
                "cols": (COLS, "pixel"),
                "motion": (self.measured, "µm"),
                "chi": (np.array([1.0, 1.1, 0.9]), "1"),
                "elongation": (np.array([0.0, 0.07, 0.05]), "µm"),
                "tilt": (np.array([0.0, 0.02, 0.01]), "µm"),
            },
        )

    def record(self, *finished: str) -> None:
        """What `run_stages` would have written after these stages."""
        case, key = load_case(self.case_path), ""
        entries: dict[str, dict[str, object]] = {}
        for stage in pipeline.stages(case):
            key = stage_key(stage, case, key)
            if stage.name in finished:
                entries[stage.name] = {"key": key, "outputs": OUTPUTS[stage.name]}
        (self.folder / "stages.json").write_text(json.dumps(entries))

    def edit(self, old: str, new: str) -> None:
        text = self.case_path.read_text("utf-8")
        assert text.count(old) == 1
        self.case_path.write_text(text.replace(old, new), encoding="utf-8")

    def frames(self) -> list[tuple[float, meshio.Mesh]]:
        """Time and mesh of each step of the exported series."""
        sets = ElementTree.parse(self.to / "surface.pvd").getroot().findall("Collection/DataSet")
        return [
            (float(s.attrib["timestep"]), meshio.read(self.to / s.attrib["file"])) for s in sets
        ]

    def table(self, name: str) -> list[dict[str, str]]:
        with (self.to / name).open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def numbers(self, name: str, column: str) -> NDArray[np.float64]:
        return np.array([float(row[column]) for row in self.table(name)])


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Results:
    made = Results(tmp_path / "alpha")
    monkeypatch.setattr(volume_view, "adapter_of", lambda case: made.solver)
    return made


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_the_series_holds_every_image_at_its_time_with_all_fields(results: Results) -> None:
    pipeline.export(results.case_path, results.to, False, False, print)
    frames = results.frames()
    assert [time for time, _ in frames] == TIME.tolist()
    for t, (_, mesh) in enumerate(frames):
        assert mesh.points == pytest.approx(np.column_stack([XY, np.zeros(7)]))
        fields = mesh.point_data
        assert fields["motion_model_um"] == pytest.approx(results.motion["final"][t], abs=1e-9)
        assert fields["motion_extended_um"] == pytest.approx(results.motion["after"][t], abs=1e-9)
        assert fields["residual_model_nm"] == pytest.approx(1e3 * results.rho["final"][t])
        assert fields["residual_extended_nm"] == pytest.approx(1e3 * results.rho["after"][t])
        assert fields["height_um"] == pytest.approx(results.reference[ROWS, COLS])


def test_the_shift_of_the_stage_is_taken_off_the_measured_motion_and_kept(results: Results) -> None:
    export_case(results.case_path, results.to)
    for _, mesh in results.frames():
        motion = mesh.point_data
        assert motion["motion_measured_um"] == pytest.approx(motion["motion_model_um"], abs=1e-8)
    for i, axis in enumerate("XYZ"):
        column = results.numbers("images.csv", f"shift_{axis}_nm")
        assert column == pytest.approx(1e3 * SHIFT[:, i], abs=1e-6)


def test_rotations_are_taken_off_in_the_rigid_gauge_alone(results: Results) -> None:
    x, y = (XY - XY.mean(axis=0)).T
    results.measured[1] += np.column_stack([-2e-3 * y, 2e-3 * x, 5e-3 * x - 4e-3 * y])
    results.write_measure()
    export_case(results.case_path, results.to)
    shown = results.frames()[1][1].point_data
    left = np.abs(shown["motion_measured_um"] - shown["motion_model_um"]).max()
    assert left > 2e-4
    expected = {"slope_vX_urad": 2000.0, "slope_wX_urad": 5000.0, "slope_wY_urad": -4000.0}
    for name, slope in expected.items():
        assert results.numbers("images.csv", name)[1] == pytest.approx(slope)
    results.edit('gauge = "translation"', 'gauge = "rigid"')
    results.record("mesh", "measure", "identify", "diagnose")
    export_case(results.case_path, results.to)
    shown = results.frames()[1][1].point_data
    assert shown["motion_measured_um"] == pytest.approx(shown["motion_model_um"], abs=1e-8)


def test_what_is_removed_is_rigid_and_nothing_of_a_stretch_is() -> None:
    motion = np.zeros((1, 7, 3))
    motion[0, :, 1] = XY[:, 1] - XY[:, 1].mean()
    kept, _ = aligned(motion, np.zeros_like(motion), XY, rigid=False)
    assert kept == pytest.approx(motion, abs=1e-15)


def test_squares_face_the_viewer_and_leave_masked_pixels_out() -> None:
    squares = pixel_squares(ROWS, COLS)
    assert len(squares) == 2  # two of the four squares of the field touch a masked pixel
    for square in squares:
        x, y = XY[square].T
        area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
        assert area == pytest.approx(PIXEL**2)


def test_the_volume_mesh_keeps_its_grains_though_its_picture_was_cut(results: Results) -> None:
    whole = (results.folder / "mesh.vtu").read_bytes()
    (results.folder / "mesh.vtu").write_bytes(whole[:100])
    export_case(results.case_path, results.to)
    mesh = meshio.read(results.to / "mesh.vtu")
    assert len(mesh.cells_dict["tetra10"]) == len(coarse_mesh().cells)
    assert mesh.cell_data["grain"][0].tolist() == (coarse_mesh().grain + 1).tolist()


@pytest.mark.parametrize("label", ["model", "extended"])
def test_model_and_residual_make_up_the_measured_load(results: Results, label: str) -> None:
    export_case(results.case_path, results.to)
    made_up = results.numbers("loads.csv", f"load_{label}_uN")
    made_up = made_up + results.numbers("loads.csv", f"residual_{label}_uN")
    assert made_up == pytest.approx(results.numbers("loads.csv", "load_measured_uN"))
    assert results.numbers("loads.csv", "load_measured_uN") == pytest.approx(FORCE)
    assert results.numbers("loads.csv", "time_s") == pytest.approx(TIME)


def test_knots_stand_at_the_turning_points_in_nanometres(results: Results) -> None:
    export_case(results.case_path, results.to)
    assert results.numbers("knots.csv", "stage_um").tolist() == [0.0, 10.0, 4.0]
    assert results.numbers("knots.csv", "elongation_model_nm") == pytest.approx([0, 64, 56])
    assert results.numbers("knots.csv", "elongation_extended_nm") == pytest.approx([0, 65, 57])
    rows = results.table("knots.csv")
    assert [row["elongation_model_sigma_nm"] for row in rows] == ["", "1", "2"]
    # Tilt knots are not free here: they have a value and no standard deviation.
    assert [(row["tilt_model_nm"], row["tilt_model_sigma_nm"]) for row in rows] == [("0", "")] * 3


def test_parameters_of_both_models_stand_side_by_side(results: Results) -> None:
    export_case(results.case_path, results.to)
    columns = ("parameter", "unit", "start", "model", "model_sigma", "extended", "extended_sigma")
    assert [tuple(row[name] for name in columns) for row in results.table("parameters.csv")] == [
        ("tau0", "MPa", "40", "21", "0.5", "20", "0.4"),
        ("tau0_grain2", "", "", "", "", "1.15", "0.02"),
        ("tilt_drift", "", "", "", "", "0.001", "0.0001"),
    ]


def test_the_readme_names_every_file_field_and_column_group(results: Results) -> None:
    export_case(results.case_path, results.to)
    text = (results.to / "README.txt").read_text("utf-8")
    for path in results.to.iterdir():
        assert path.name == "README.txt" or path.name in text
    for field in results.frames()[0][1].point_data:
        assert field in text


@pytest.mark.parametrize("missing", ["mesh", "measure", "identify"])
def test_a_missing_stage_is_named_with_the_command_that_makes_it(
    results: Results, missing: str
) -> None:
    results.record(*({"mesh", "measure", "identify"} - {missing}))
    with pytest.raises(ExportError) as error:
        export_case(results.case_path, results.to)
    assert str(error.value) == (
        f"{results.folder}: stage {missing}: found no results, expected those of the case as it "
        f"is (`prismid run {results.case_path} --until identify` makes them)"
    )
    assert not results.to.exists()


def test_a_case_that_was_never_run_is_told_so(tmp_path: Path) -> None:
    write_case(default_case(), tmp_path / "case.toml")
    with pytest.raises(ExportError, match="stage mesh: found no results"):
        export_case(tmp_path / "case.toml", tmp_path / "to")


def test_a_lost_result_file_counts_as_missing(results: Results) -> None:
    (results.folder / "identify.h5").unlink()
    with pytest.raises(ExportError, match="stage identify: found no results"):
        export_case(results.case_path, results.to)


def test_results_of_an_edited_case_are_not_passed_off_as_its_own(results: Results) -> None:
    results.edit("tau0_MPa = 40.0", "tau0_MPa = 30.0")
    with pytest.raises(ExportError, match="stage identify: found results of another state"):
        export_case(results.case_path, results.to)


@pytest.mark.parametrize("why", ["never run", "of another state"])
def test_without_a_diagnosis_of_the_case_the_rest_is_exported(results: Results, why: str) -> None:
    if why == "never run":
        results.record("mesh", "measure", "identify")
    else:
        results.edit("refit = 5", "refit = 3")
    export_case(results.case_path, results.to)
    names = [*results.frames()[0][1].point_data, *results.table("loads.csv")[0],
             *results.table("knots.csv")[0], *results.table("parameters.csv")[0]]  # fmt: skip
    assert "load_model_uN" in names and not [name for name in names if "extended" in name]
    assert "no finished diagnosis" in (results.to / "README.txt").read_text("utf-8")


def test_files_of_others_are_left_alone_and_an_earlier_export_is_replaced(results: Results) -> None:
    results.to.mkdir()
    (results.to / "notes.md").write_text("mine")
    export_case(results.case_path, results.to)
    before = contents(results.to)
    results.load["after"] += 1.0
    write_hdf5(results.folder / "diagnosis.h5", results.predictions("after"))
    export_case(results.case_path, results.to)
    after = contents(results.to)
    assert after.keys() == before.keys() and after["notes.md"] == b"mine"
    assert after["loads.csv"] != before["loads.csv"]
    assert after["knots.csv"] == before["knots.csv"]


@pytest.mark.parametrize("name", ["README.txt", "loads.csv"])
def test_a_file_of_others_is_never_overwritten(results: Results, name: str) -> None:
    results.to.mkdir()
    (results.to / name).write_text("mine")
    with pytest.raises(ExportError, match=f"--to: found a file {name} that is no export"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == {name: b"mine"}


def test_a_file_in_the_place_of_the_folder_is_refused(results: Results) -> None:
    results.to.write_text("mine")
    with pytest.raises(ExportError, match="--to: found a file, expected a folder"):
        export_case(results.case_path, results.to)
    assert results.to.read_text() == "mine"


def test_a_broken_result_leaves_the_earlier_export_as_it_was(results: Results) -> None:
    export_case(results.case_path, results.to)
    before = contents(results.to)
    whole = (results.folder / "identify.h5").read_bytes()
    (results.folder / "identify.h5").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ResultError, match="identify.h5"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == before


def test_an_export_that_breaks_off_leaves_the_earlier_one_and_nothing_else(
    results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    export_case(results.case_path, results.to)
    before = contents(results.to)
    results.load["after"] += 1.0
    write_hdf5(results.folder / "diagnosis.h5", results.predictions("after"))

    def full(path: Path, columns: Mapping[str, object]) -> None:
        path.write_text("half of it")
        raise OSError("No space left on device")

    monkeypatch.setattr(export, "write_csv", full)
    with pytest.raises(OSError, match="No space"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == before
    assert not list(results.to.glob("partial-*"))


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


def test_the_models_are_simulated_once_each_as_they_were_fitted(results: Results) -> None:
    told: list[str] = []
    export_case(results.case_path, results.to, log=told.append)
    model, extended = results.solver.asked
    assert [s.material.tau0_grain2 for s in (model, extended)] == [1.0, 1.15]
    # The end face moves by the elongation between the turning points.
    ends = [np.ptp(s.motion[1, :, 1]) for s in (model, extended)]
    assert ends == pytest.approx([0.064, 0.065], rel=0.2)
    assert not model.directions
    assert "2 simulations" in told[0] and "min" in told[0]
    assert told[1:3] == ["  model: 50 %, 1.0 min to go", "  model: 100 %, 1.0 min to go"]


def test_without_the_volume_nothing_is_simulated_and_a_stale_one_is_removed(
    results: Results,
) -> None:
    export_case(results.case_path, results.to)
    asked = len(results.solver.asked)
    export_case(results.case_path, results.to, volume=False)
    assert len(results.solver.asked) == asked
    assert not list(results.to.glob("*.vtkhdf"))
    assert "vtkhdf" not in (results.to / "README.txt").read_text("utf-8")


def test_a_solver_without_fields_leaves_the_volume_out_and_says_so(results: Results) -> None:
    results.solver.cell_fields = False
    told: list[str] = []
    export_case(results.case_path, results.to, log=told.append)
    assert told == ["no fields of the volume: the solver bundled answers none"]
    assert not list(results.to.glob("*.vtkhdf"))


def test_a_volume_of_others_is_neither_overwritten_nor_removed(results: Results) -> None:
    results.to.mkdir()
    (results.to / "volume_model.vtkhdf").write_text("mine")
    with pytest.raises(ExportError, match="found a file volume_model.vtkhdf that is no export"):
        export_case(results.case_path, results.to)
    assert not results.solver.asked  # told before the simulations
    export_case(results.case_path, results.to, volume=False)
    assert (results.to / "volume_model.vtkhdf").read_text() == "mine"


def test_a_file_that_no_export_has_written_stays_beside_one(results: Results) -> None:
    results.to.mkdir()
    mine = {"volume_model.med": b"mine", "volume_extended.vtkhdf": b"mine, too"}
    for name, content in mine.items():
        (results.to / name).write_bytes(content)
    for _ in range(2):
        export_case(results.case_path, results.to, volume=False)
        assert mine.items() <= contents(results.to).items()
    for options in ({"med": True}, {}):
        with pytest.raises(ExportError, match="found a file volume_.* that is no export"):
            export_case(results.case_path, results.to, **options)
    assert mine.items() <= contents(results.to).items()
    assert not results.solver.asked


def test_a_list_that_somebody_has_edited_removes_nothing_outside_the_folder(
    results: Results,
) -> None:
    export_case(results.case_path, results.to, volume=False)
    outside = results.to.parent / "mine.txt"
    outside.write_text("mine")
    with (results.to / "README.txt").open("a", encoding="utf-8") as readme:
        readme.write(f"  ../mine.txt\n  {outside}\n")
    export_case(results.case_path, results.to, volume=False)
    assert outside.read_text() == "mine"


def test_what_an_earlier_export_holds_beyond_this_one_is_removed(results: Results) -> None:
    export_case(results.case_path, results.to, volume=False)
    extra = results.to / "surface" / "surface_0003.vtu"
    extra.write_text("of a longer test")
    export_case(results.case_path, results.to, volume=False)
    assert extra.is_file()
    with (results.to / "README.txt").open("a", encoding="utf-8") as readme:
        readme.write("  surface/surface_0003.vtu\n")
    export_case(results.case_path, results.to, volume=False)
    assert not extra.exists()


def test_a_file_in_the_place_of_a_folder_of_the_export_is_refused(results: Results) -> None:
    results.to.mkdir()
    (results.to / "surface").write_text("mine")
    with pytest.raises(ExportError, match="found a file surface that is no export"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == {"surface": b"mine"}


def test_med_without_the_volume_is_refused(results: Results) -> None:
    with pytest.raises(ExportError, match="^--med: found --no-volume, expected --volume"):
        export_case(results.case_path, results.to, volume=False, med=True)
    assert not results.to.exists()


def test_an_absent_program_leaves_the_volume_out_and_says_why(
    results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(*_: object) -> Response:
        status = Status.COMMAND_MISSING
        raise CommandMissingError("bar", status, 'found no "bar" on PATH', remedy="prepare")

    monkeypatch.setattr(results.solver, "solve", absent)
    told: list[str] = []
    export_case(results.case_path, results.to, med=True, log=told.append)
    assert told[-1] == (
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


@pytest.mark.parametrize(
    "text", ["", "[]", "5", "null", '{"mesh": 5}', '{"mesh": ["key", "outputs"]}',
             '{"mesh": {"key": "a", "outputs": 5}}', '{"mesh": {"key": "a", "outputs": [5]}}'],
)  # fmt: skip
def test_a_damaged_record_is_no_record(results: Results, text: str) -> None:
    (results.folder / "stages.json").write_text(text)
    with pytest.raises(ExportError, match="stage mesh: found no results, expected those of the"):
        export_case(results.case_path, results.to)


def other_parameters(results: Results) -> None:
    with h5py.File(results.folder / "identify.h5", "a") as file:
        file.attrs["names"] = json.dumps(["tau0"])


def fewer_images(results: Results) -> None:
    with h5py.File(results.folder / "measure.h5", "a") as file:
        force = file["force"][:2]
        del file["force"]
        file["force"] = force


def of_another_stage(results: Results) -> None:
    measured = (results.folder / "measure.h5").read_bytes()
    (results.folder / "identify.h5").write_bytes(measured)


@pytest.mark.parametrize(
    ("damage", "stage", "said"),
    [
        (of_another_stage, "identify", "identify.h5: found no numbers final/load"),
        (other_parameters, "identify", "identify.h5: found no readable parameters"),
        (fewer_images, "measure", r"measure.h5: found force of shape \(2,\) in place of \(3\)"),
        (
            lambda results: (results.folder / "mesh.med").write_text("half"),
            "mesh",
            "mesh.med: found no readable mesh",
        ),
        (
            lambda results: (results.folder / "diagnosis.json").write_text('{"extended": 5}'),
            "diagnose",
            "diagnosis.json: found no readable extended model",
        ),
        (
            lambda results: (results.folder / "measure.h5").write_text("half"),
            "measure",
            "measure.h5: found no readable HDF5 file",
        ),
    ],
)
def test_a_damaged_result_is_one_sentence_that_names_its_stage(
    results: Results, damage: Callable[[Results], object], stage: str, said: str
) -> None:
    damage(results)
    with pytest.raises(ResultError, match=said) as error:
        export_case(results.case_path, results.to)
    message = str(error.value)
    assert message.endswith(f"`prismid run` makes it anew, running the stage {stage} alone")
    assert "\n" not in message
    assert not results.to.exists()


def test_results_that_a_run_replaces_meanwhile_are_not_mixed(
    results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = finished_results.read_med

    def replaced(path: Path) -> PrismMesh:
        results.record("mesh", "measure")
        return read(path)

    monkeypatch.setattr(finished_results, "read_med", replaced)
    with pytest.raises(ExportError, match="found a run that replaces results"):
        export_case(results.case_path, results.to)
