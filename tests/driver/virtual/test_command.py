"""`prismid virtual` from a case to a folder that runs, with the solver in closed form."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from driver.case.model import Case, load_case, write_case
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.forward import build
from driver.results.hdf5 import read_hdf5
from driver.virtual import command
from driver.virtual.command import true_case, virtual
from driver.virtual.settings import Discretisation, Virtual
from driver.workflow import pipeline
from driver.workflow.engine import run_stages
from solver_adapters.interface import Progress, SolverError
from solver_adapters.profile import Profile
from tools import closed_form

ALPHA = Path(__file__).parents[3] / "examples" / "alpha" / "case.toml"
SETTINGS = """
[face]
dots_per_um2 = 2.0
[microscope]
bits = 16
noise_nm = 3.0
repeats = 6
flats = 20
[program]
cycles = [[3, 1], [4, 2]]
largest_strain = 0.012
[truth]
tau0 = 44.0
"""


def solver(name: str, profile: Profile) -> closed_form.ClosedFormSolver:
    return closed_form.ClosedFormSolver()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The folder of a virtual experiment, and what was said."""
    folder = tmp_path_factory.mktemp("virtual")
    write_case(closed_form.small_case(), folder / "case.toml")
    (folder / "settings.toml").write_text(SETTINGS, encoding="utf-8")
    lines: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", solver)
        with progress_to(lines.append):
            virtual(folder / "case.toml", folder / "settings.toml", folder / "out", 3)
    return folder, lines


def test_the_discretisation_of_the_truth_is_finer_and_said_so(
    made: tuple[Path, list[str]],
) -> None:
    case = closed_form.small_case()
    truth = true_case(case, Virtual())
    assert truth.specimen.mesh_size < case.specimen.fine_mesh_size
    assert truth.solver.steps_per_interval > case.solver.fine_steps_per_interval
    assert f"a mesh of {truth.specimen.mesh_size:g} µm" in made[1][0]
    assert "11 images, about" in made[1][0]


def test_each_of_two_simulations_tells_its_own_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    def pulled(*given: Any) -> None:
        for tell in given[-2:]:
            tell(Progress(1.0, 1.0, 1, 1, 0))
        raise SolverError("no more is asked")

    monkeypatch.setattr(command, "pull", pulled)
    with pytest.raises(SolverError):
        virtual(ALPHA, None, tmp_path / "out", 1)
    assert [line.partition(" %")[0] for line in lines if "100 %" in line] == [
        "  truth: 100", "  truth on larger cells: 100",
    ]  # fmt: skip


def test_a_truth_is_of_hexahedra_where_layers_can_follow_the_boundary() -> None:
    case = load_case(ALPHA)
    truth = true_case(case, Virtual())
    assert case.specimen.cells == "tet10" and not case.mean_dilatation
    assert truth.specimen.cells == "hex20" and truth.mean_dilatation
    assert truth.specimen.mesh_size <= case.specimen.fine_mesh_size / 2

    tilted = {"boundary_point_um": (0.0, 1.0, 0.0), "boundary_normal": (0.0, 1.0, -1.0)}
    steep = case.model_copy(update={"specimen": case.specimen.model_copy(update=tilted)})
    truth = true_case(steep, Virtual())
    assert truth.specimen.cells == "tet10" and truth.mean_dilatation


@pytest.mark.parametrize(
    ("discretisation", "message"),
    [
        (Discretisation(mesh_size_um=1.0), "mesh_size_um: found 1, expected less than 1, "),
        (Discretisation(steps_per_interval=2), "steps_per_interval: found 2, expected more than"),
    ],
)
def test_data_are_never_made_with_what_identifies_them(
    discretisation: Discretisation, message: str
) -> None:
    case: Case = closed_form.small_case()
    case = case.model_copy(
        update={"solver": case.solver.model_copy(update={"fine_steps_per_interval": 2})}
    )
    assert case.specimen.fine_mesh_size == 1.0
    with pytest.raises(InputError, match=message):
        true_case(case, Virtual(discretisation=discretisation))


def test_the_folder_holds_what_a_user_would_have_and_the_truth(
    made: tuple[Path, list[str]],
) -> None:
    folder = made[0] / "out"
    assert {file.name for file in folder.iterdir() if file.is_file()} == {
        "case.toml", "case.schema.json", "images.tif", "repeats.tif", "flats.tif", "history.csv",
        "truth.json", "truth.h5",
    }  # fmt: skip
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    assert truth["values"]["tau0"] == {"value": 44.0, "unit": "MPa"}
    assert truth["seed"] == 3 and truth["settings"]["microscope"]["bits"] == 16
    case = load_case(folder / "case.toml")
    assert case.material == closed_form.small_case().material
    assert case.images.height_per_level_nm == pytest.approx(6.5 / 256)


def test_a_run_of_the_folder_measures_the_true_elongation(made: tuple[Path, list[str]]) -> None:
    folder = made[0] / "out"
    path = folder / "case.toml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", solver)
        run_stages(load_case(path), pipeline.stages(load_case(path)), "measure")
    measured, truth = read_hdf5(folder / "results" / "measure.h5"), read_hdf5(folder / "truth.h5")
    assert float(measured["sigma"]) == pytest.approx(float(truth["noise"].mean()), rel=0.03)
    ends = [
        truth["nodal_motion"][:, np.isclose(truth["nodes"][:, 1], end), 1].mean(axis=1)
        for end in (0.0, closed_form.LENGTH)
    ]
    elongation = ends[1] - ends[0]
    assert elongation.max() == pytest.approx(0.012 * closed_form.LENGTH, rel=1e-6)
    wrong = (measured["elongation"] - elongation) / float(measured["elongation_sigma"])
    assert np.abs(wrong).max() < 4
    # Loads to their noise, 4 digits of a newton included.
    assert (
        np.abs(measured["force"] - truth["load"]).max() < 5 * closed_form.small_case().loads.gamma_F
    )
    # χ of one: what is left is noise, neither stage, pattern nor trench.
    assert np.sqrt(np.mean(measured["chi"] ** 2)) == pytest.approx(1.0, abs=0.1)


def test_a_run_of_the_folder_reads_what_the_case_names_beside_its_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "find_adapter", solver)
    case = closed_form.small_case()
    causes = case.diagnosis.model_copy(update={"cause_files": ("own.toml",)})
    write_case(case.model_copy(update={"diagnosis": causes}), tmp_path / "case.toml")
    (tmp_path / "own.toml").touch()
    (tmp_path / "settings.toml").write_text(SETTINGS, encoding="utf-8")
    out = tmp_path / "far" / "out"
    virtual(tmp_path / "case.toml", tmp_path / "settings.toml", out, 3)
    made = load_case(out / "case.toml")
    (named,) = made.diagnosis.cause_files
    assert made.path(named).samefile(tmp_path / "own.toml")
    assert made.images.frames == "images.tif" and made.history.file == "history.csv"


def test_an_experiment_that_is_interrupted_leaves_an_empty_folder(
    made: tuple[Path, list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the same command would refuse its own folder."""

    def interrupted(folder: Path, *_: object) -> None:
        (folder / "repeats.tif").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr(build, "find_adapter", solver)
    monkeypatch.setattr("driver.virtual.command.record", interrupted)
    case, settings, out = made[0] / "case.toml", made[0] / "settings.toml", tmp_path / "new" / "out"
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            virtual(case, settings, out, 3)
        assert not list(out.iterdir())


def test_blas_has_one_thread_whatever_the_user_has_set(
    made: tuple[Path, list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the last digits of an experiment would depend on the cores of the machine."""
    threads: list[int] = []

    def seen(*_: object) -> None:
        blas = [found for found in threadpool_info() if found["user_api"] == "blas"]
        threads.extend(found["num_threads"] for found in blas)

    monkeypatch.setattr(build, "find_adapter", solver)
    monkeypatch.setattr("driver.virtual.command.record", seen)
    with threadpool_limits(2, "blas"):
        virtual(made[0] / "case.toml", made[0] / "settings.toml", tmp_path / "out", 3)
    assert set(threads) == {1}


def test_a_folder_with_files_is_not_written_to(tmp_path: Path) -> None:
    write_case(closed_form.small_case(), tmp_path / "case.toml")
    with pytest.raises(InputError, match="--to: found something there, expected an empty or a new"):
        virtual(tmp_path / "case.toml", None, tmp_path, 0)
