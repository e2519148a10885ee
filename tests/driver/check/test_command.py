import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import tifffile
from matplotlib.image import imread

from driver.case.model import case_text, load_case
from driver.check import command as check_module
from driver.check.command import check
from driver.forward.build import geometry_of
from driver.forward.geometry import boundary_traces
from meshes.prism import CellKind, generate
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.interface import Adapter, Capabilities, Simulation, UnsupportedError
from solver_adapters.profile import Profile
from solver_adapters.registry import find_adapter
from tests.driver.ebsd_files import grid, write_ang
from tests.driver.experiment.test_map_labels import case_in as map_case
from tests.driver.experiment.test_map_labels import write_map
from tests.solver_adapters.bar import BarAdapter

ALPHA = Path(__file__).parents[3] / "examples" / "alpha"


class SmallStrainSolver:
    name = "bundled"

    def capabilities(self) -> Capabilities:
        return Capabilities(frozenset({"tau0", "c", "d"}), frozenset({"small"}), True)

    def version(self) -> str:
        return "1.2"


def install(monkeypatch: pytest.MonkeyPatch, adapter: Adapter | SmallStrainSolver) -> None:
    """Let `solver.name` find an adapter, whatever the name is."""
    monkeypatch.setattr(check_module, "find_adapter", lambda name, profile: adapter)


@pytest.fixture
def case_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the example, and a solver that offers small strain only.

    Its time steps are not looked at: that takes seconds (`test_steps`).
    """
    install(monkeypatch, SmallStrainSolver())
    monkeypatch.setattr(check_module, "recommended_steps", lambda *_: iter(()))
    for name in ("case.toml", "images.tif", "flats.tif", "repeats.tif", "history.csv"):
        shutil.copy(ALPHA / name, tmp_path / name)
    return tmp_path / "case.toml"


@pytest.fixture
def images_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Images are opened, but neither looked at nor drawn: that takes two seconds."""
    monkeypatch.setattr(check_module, "look_at_images", lambda *_: ([], None))
    monkeypatch.setattr(check_module, "draw", lambda *_: None)


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def found(path: Path, level: str) -> list[str]:
    # Whether the distribution is installed is not the matter of the case.
    return [
        finding.message
        for finding in check(path)
        if finding.level == level and finding.subject != "libraries"
    ]


def test_the_example_is_in_order_and_drawn(case_path: Path) -> None:
    assert found(case_path, "error") == [] and found(case_path, "warning") == []
    picture = imread(case_path.parent / "results" / "check.png")
    assert picture.shape[0] > 400 and picture.shape[1] > 1000
    # The grain boundary stands in the picture in its own colour.
    orange = np.all(np.abs(picture[..., :3] - (1.0, 0.541, 0.122)) < 0.02, axis=-1)
    assert orange.sum() > 200


def test_where_no_picture_can_be_written_all_else_is_still_told(case_path: Path) -> None:
    (case_path.parent / "results").write_text("a file")
    (message,) = found(case_path, "error")
    assert message.startswith(f"{case_path.parent / 'results'}: folder: found ")
    assert found(case_path, "ok")


@pytest.mark.usefixtures("images_unseen")
@pytest.mark.parametrize("kind", get_args(CellKind))
def test_the_mesh_that_the_case_asks_for_is_counted(case_path: Path, kind: CellKind) -> None:
    edit(case_path, "[specimen]\n", f'[specimen]\ncells = "{kind}"\n')
    case = load_case(case_path)
    mesh = generate(geometry_of(case), case.specimen.mesh_size, kind)
    first, second = (
        f"{grain.name} {count}"
        for grain, count in zip(case.grains, np.bincount(mesh.grain), strict=True)
    )
    message = f"{len(mesh.cells)} {kind} ({first}, {second}), {len(mesh.points)} nodes"
    assert message in found(case_path, "ok")


@pytest.mark.usefixtures("images_unseen")
def test_automatic_sizes_are_chosen_and_told_with_their_budget(case_path: Path) -> None:
    edit(case_path, "\nmesh_size_um = 2.0", '\nmesh_size_um = "auto"')
    edit(case_path, "fine_mesh_size_um = 1.1", 'fine_mesh_size_um = "auto"')
    told = found(case_path, "ok")
    assert any(message.startswith("262 tet10 (") for message in told)
    (sizes,) = (message for message in told if "chosen by prismid" in message)
    assert sizes.startswith("tet10 of 1.6 and 1.11 µm, ") and "budget_min = 120" in sizes
    (case_path.parent / "results" / "sizes.json").write_text("{")
    (message,) = found(case_path, "error")
    assert "sizes.json: found no readable JSON" in message


def test_the_trace_of_the_grain_boundary_lies_on_its_plane() -> None:
    (trace,) = boundary_traces(load_case(ALPHA / "case.toml"))
    points = np.column_stack([trace, np.zeros(2)])
    np.testing.assert_allclose((points - (0, 5.4, 0)) @ (0.15, 1, 0.30), 0.0, atol=1e-12)
    assert trace[:, 0].tolist() == [-2.0, 2.0]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("width_um = 4.0", "width_um = 0", "specimen.width_um: found 0, expected a number > 0"),
        ('frames = "images.tif"', 'frames = "frames_*.tif"', "images.frames: found no image"),
        ("origin_pixel = [35.5, 21.0]", "origin_pixel = [35.5, 60.0]",
         "images.origin_pixel: found the measured face at rows 17.3 … 53.7, columns 60.0 … 169.1, "
         "expected it inside 72 × 152 px"),
        ("pixel_size_nm = 110.0", "pixel_size_nm = 0.11",
         "images.pixel_size_nm: found 0.11, with which the measured face is 36363.6 × 109090.9 px, "
         "expected one that fits into 72 × 152 px"),
        ('strain_measure = "small"', 'strain_measure = "finite"',
         'material.strain_measure: found "finite", expected one that bundled offers: small'),
        ('parameters = ["tau0", "c", "d"]', 'parameters = ["tau0", "n"]',
         'identification.parameters: found "n", expected one that bundled honours: c, d, tau0'),
        ('held_out_cycle = "last"', "held_out_cycle = 4",
         "diagnosis.held_out_cycle: found 4, expected one of the 3 cycle(s)"),
        ("height_element_px = 8", "height_element_px = 1",
         "nodal values to be decided by 3672 pixels of the face, expected at most half as many"),
        ("boundary_point_um = [0.0, 5.4, 0.0]", "boundary_point_um = [0.0, 54, 0.0]", "specimen: "),
    ],
)  # fmt: skip
def test_what_would_stop_a_run_is_found_before_it(
    case_path: Path, old: str, new: str, sentence: str
) -> None:
    edit(case_path, old, new)
    (message,) = found(case_path, "error")
    assert sentence in message


def test_loads_that_end_early_are_found(case_path: Path) -> None:
    history = case_path.parent / "history.csv"
    lines = history.read_text().splitlines()
    lines[-1] = lines[-1].rsplit(",", 1)[0] + ","
    history.write_text("\n".join(lines))
    (message,) = found(case_path, "error")
    assert message.endswith(
        "force_N: found nothing, expected the load of image 96, or loads logged shortly before "
        "and after it"
    )


def test_a_face_drawn_over_a_trench_and_missing_stacks_are_warned_of(case_path: Path) -> None:
    edit(case_path, "origin_pixel = [35.5, 21.0]", "origin_pixel = [28.0, 21.0]")
    edit(case_path, 'repeats = "repeats.tif"', "")
    trench, noise = found(case_path, "warning")
    assert "of the measured face" in trench and "carries no height" in trench
    assert noise.startswith("9 nm as stated: image 0 is the reference with the noise of one image")
    edit(case_path, "noise_nm = 9.0", "")
    (repeats,) = found(case_path, "error")
    assert "images.repeats: found nothing, expected repeated images of the unloaded" in repeats
    assert repeats.endswith("or images.noise_nm, a number > 0: the noise stated instead")


def test_an_element_larger_than_the_face_is_warned_of(case_path: Path) -> None:
    edit(case_path, "element_px = 16", "element_px = 160")
    (element,) = found(case_path, "warning")
    assert element.startswith("dic.element_px: found 160, expected less than the 107 px")


def test_noise_pixels_and_pattern_are_told_as_they_will_be_measured(case_path: Path) -> None:
    told = found(case_path, "ok")
    # 9 nm nominal, by the README of the data; 6.5 nm of quantisation add 1.9 nm in squares.
    assert any(line.startswith("9.15 ± 0.04 nm from 10 repeats") for line in told)
    assert any("pixels of the face are used" in line and "0 as dust" in line for line in told)
    assert any(line.startswith("fixed pattern of 400 flats") for line in told)
    assert not found(case_path, "warning")


def test_bad_frames_a_wrong_scale_and_dust_are_warned_of_by_name(case_path: Path) -> None:
    folder = case_path.parent
    frames = tifffile.imread(folder / "images.tif")
    frames[40, 30:40, 60:80] += 20
    frames[0, 0, 0] = 255
    frames[60, 35, 70:73] = frames[61, 35, 75] = 0
    tifffile.imwrite(folder / "images.tif", frames, photometric="minisblack")
    repeats = tifffile.imread(folder / "repeats.tif")
    repeats[:, 36, 100] += 40
    tifffile.imwrite(folder / "repeats.tif", repeats, photometric="minisblack")
    edit(case_path, "height_per_level_nm = 6.5", "height_per_level_nm = 13")
    clipped, noise, holes, frame = found(case_path, "warning")
    assert "2 frames lack heights on the face, frame 60 at most, of 3 pixels" in holes
    assert clipped.startswith("images.frames: 1 pixels are at the largest level")
    assert noise.startswith("images.noise_nm: found 9, expected about the 18.29 ")
    assert frame.startswith("frame 40 is unlike its neighbours: residual")
    assert any("and 13 as dust" in line for line in found(case_path, "ok"))


@pytest.mark.usefixtures("images_unseen")
def test_a_scheme_that_the_solver_lacks_is_an_error_with_the_remedy(case_path: Path) -> None:
    edit(case_path, 'integration = "backward_euler"', 'integration = "exponential"')
    (message,) = found(case_path, "error")
    assert message.startswith('solver.integration: found "exponential", expected backward_euler')
    assert message.endswith("or the key left out")


@pytest.mark.usefixtures("images_unseen")
def test_a_strain_measure_that_a_program_lacks_is_told_once(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = case_path.parent / "ccx"
    program.write_text("#!/bin/sh\necho This is Version 2.20\n")
    program.chmod(0o755)
    install(monkeypatch, CalculixAdapter(Profile(command=(str(program),))))
    edit(case_path, 'name = "bundled"', 'name = "calculix"')
    edit(case_path, 'strain_measure = "small"', 'strain_measure = "finite"')
    assert found(case_path, "error") == [
        'material.strain_measure: found "finite", expected one that calculix offers: small'
    ]


@pytest.mark.usefixtures("images_unseen")
def test_the_caution_of_a_solver_about_a_strain_measure_is_a_warning(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class CautiousSolver(SmallStrainSolver):
        def capabilities(self) -> Capabilities:
            return replace(super().capabilities(), cautions={"small": "Small is coarse."})

    install(monkeypatch, CautiousSolver())
    assert found(case_path, "warning") == ["Small is coarse."]


@pytest.mark.usefixtures("images_unseen")
def test_a_program_that_is_not_there_is_a_warning_that_says_where_to_name_it(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_module, "find_adapter", lambda name, profile: BarAdapter(profile))
    monkeypatch.setenv("PRISMID_CONFIG", str(case_path.parent / "config.toml"))
    config = case_path.parent / "config.toml"
    config.write_text("")
    (message,) = found(case_path, "warning")
    assert "its program is not on this machine" in message and "[solver.profiles." in message
    config.write_text(f"[profiles.bundled]\ncommand = [{sys.executable!r}]\n")
    assert found(case_path, "warning") == []
    config.write_text("[profiles.bundled]\nthreads = 0\n")
    (message,) = found(case_path, "error")
    assert message.startswith(f"{config}: profiles.bundled.threads: found 0, expected")


@pytest.mark.usefixtures("images_unseen")
def test_the_store_of_a_program_is_told_and_one_that_cannot_be_made_is_an_error(
    case_path: Path,
) -> None:
    with case_path.open("a", encoding="utf-8") as file:
        file.write('store = "../jobs"\n')
    told = f"{case_path.parent / '../jobs'} holds the jobs of bundled"
    assert told in found(case_path, "ok") and found(case_path, "error") == []
    assert (case_path.parent.parent / "jobs").is_dir()
    edit(case_path, 'store = "../jobs"', 'store = "case.toml"')
    (message,) = found(case_path, "error")
    assert message.startswith(f"{case_path}: execution.store: found ")


@pytest.mark.usefixtures("images_unseen")
def test_a_program_that_cannot_start_is_an_error_with_what_it_said(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = case_path.parent / "run_aster"
    program.write_text("#!/bin/sh\necho No module named run_aster.run_aster_main >&2; exit 1\n")
    program.chmod(0o755)
    install(monkeypatch, CodeAsterAdapter(Profile(command=(str(program),))))
    edit(case_path, 'name = "bundled"', 'name = "code_aster"')
    (message,) = found(case_path, "error")
    assert message.startswith("code_aster: broken installation (found no version in the answer to")
    assert "No module named run_aster" in message


@pytest.mark.usefixtures("images_unseen")
def test_a_solver_that_is_not_installed_is_an_error_with_those_that_are(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_module, "find_adapter", find_adapter)
    edit(case_path, 'name = "bundled"', 'name = "abaqus"')
    (message,) = found(case_path, "error")
    assert message.startswith('solver.name: found "abaqus", expected one of bundled')


@pytest.mark.usefixtures("images_unseen")
def test_what_each_external_solver_makes_of_the_model_is_told_and_is_no_error(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, BundledAdapter())
    decks = [message for message in found(case_path, "ok") if "deck" in message]
    assert decks == [
        "no deck of this model for calculix: tau0_112 = 1: CalculiX has no {112}⟨111⟩ systems; "
        "expected 1000 or more, which switches them off, or one of the solvers that can: bundled, "
        "code_aster",
        "code_aster can take this model as a deck",
    ]


@pytest.mark.usefixtures("images_unseen")
def test_what_an_external_solver_refuses_is_found_before_it_runs(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Refusing(BarAdapter):
        def capabilities(self) -> Capabilities:
            return replace(super().capabilities(), material=frozenset({"tau0", "c", "d"}))

        def check_supported(self, simulation: Simulation) -> None:
            raise UnsupportedError("the bar has no images")

    install(monkeypatch, Refusing())
    assert "the bar has no images" in found(case_path, "error")


@pytest.mark.usefixtures("images_unseen")
def test_sizes_of_more_cells_than_any_machine_holds_are_found_by_their_keys(
    case_path: Path,
) -> None:
    edit(case_path, "fine_mesh_size_um = 1.1", "fine_mesh_size_um = 0.005")
    (found,) = (finding for finding in check(case_path) if finding.subject == "mesh")
    assert found.level == "error"
    assert found.message.startswith(
        "specimen.fine_mesh_size_um: elements of 0.005 µm would be about 6e+09 cells"
    )


@pytest.mark.usefixtures("images_unseen")
def test_a_run_that_needs_more_memory_than_there_is_is_no_good_case(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("driver.common.machine.memory", lambda: 1e8)
    found = next(finding for finding in check(case_path) if finding.subject == "cost")
    assert found.level == "warning" and "but this machine has 0.1 GB" in found.message


def test_the_name_of_a_grain_is_drawn_letter_by_letter(case_path: Path) -> None:
    edit(case_path, 'name = "grain 1"', r"name = '$\frac$ and $'")
    found = {finding.subject: finding for finding in check(case_path)}
    assert found["picture"].level == "ok"


@pytest.mark.usefixtures("images_unseen")
def test_a_prism_that_is_none_is_told_as_such_and_not_by_the_size_of_its_cells(
    case_path: Path,
) -> None:
    edit(case_path, "# depth_um = 3.464", "depth_um = 0.001  #")
    (found,) = (finding for finding in check(case_path) if finding.subject == "mesh")
    assert found.level == "error" and found.message.startswith("specimen: prism length is 12 µm")


def mapped(case_path: Path, name: str) -> None:
    """Let the first grain of the case be picked in a map."""
    edit(case_path, "euler_deg = [281.0, 8.0, 47.0]",
         f'ebsd = "{name}"\nebsd_point_um = [1.0, 1.0]')  # fmt: skip
    edit(
        case_path,
        "ebsd_to_specimen = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        'ebsd_frame = "edax"\n'
        "ebsd_to_specimen = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]",
    )


def test_the_map_of_a_grain_is_drawn_below_the_images(case_path: Path) -> None:
    write_ang(case_path.parent / "a.ang", *grid(6, 9), (0.0, 0.0, 0.0))
    mapped(case_path, "a.ang")
    findings = [finding for finding in check(case_path) if finding.subject != "libraries"]
    assert {finding.level for finding in findings} == {"ok"}
    assert findings[-1].message.endswith("load curve, grain boundary, slip traces, EBSD map")
    picture = imread(case_path.parent / "results" / "check.png")
    # ⟨001⟩ along the loading axis is red, and nothing else in the lower part is.
    red = np.all(np.abs(picture[..., :3] - (1.0, 0.0, 0.0)) < 0.02, axis=-1)
    upper = int(picture.shape[0] * 0.54)
    assert red[:upper].sum() < 100 < 20_000 < red[upper:].sum()


def test_a_map_that_cannot_be_read_is_told_once(case_path: Path) -> None:
    mapped(case_path, "a.ang")
    for motion in ("", 'motion = "stage"\nstage_ratio = 0.5\nstage_ratio_uncertainty = 0.1\n'):
        edit(case_path, 'U_X = "held"', f'{motion}U_X = "held"')
        findings = check(case_path)
        (error,) = (one.message for one in findings if one.level == "error")
        place = f"{case_path.parent / 'a.ang'}: grains.1.ebsd: "
        assert error.startswith(f"{place}found nothing, expected an EBSD map")
        assert not any("EBSD map" in one.message for one in findings if one.level == "ok")


@pytest.mark.parametrize("unknown", [False, True])
def test_how_much_of_the_face_a_map_tells_that_places_the_grains_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unknown: bool
) -> None:
    monkeypatch.setattr(check_module, "_MUCH_UNTOLD", 0.02)
    write_map(tmp_path / "map.ang", unknown=unknown)
    (tmp_path / "case.toml").write_text(case_text(map_case(tmp_path)), encoding="utf-8")
    (told,) = (one for one in check(tmp_path / "case.toml") if "of the face" in one.message)
    assert (told.level, told.subject) == ("warning" if unknown else "ok", "mesh")
    assert told.message.endswith("expected at most 2 %, along boundaries") == unknown
