"""The stage on the specimen of the closed-form solver, whose motion is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
import tifffile

from driver.case.model import load_case, write_case
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.experiment.images.region import Excluded
from driver.results.files import MEASURE
from driver.results.hdf5 import read_hdf5
from driver.workflow.pipeline import run
from meshes.plane_cells import CellKind
from tests.meshes.plane_examples import distorted
from tools import closed_form

BAD, LOW, DUST = 20, 30, (15, 25)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, np.ndarray], str]:
    """Results and log of a series with a spoilt frame and a grain of dust."""
    folder: Path = tmp_path_factory.mktemp("measure")
    closed_form.write_files(folder, {})
    frames = tifffile.imread(folder / "images.tif")
    frames[BAD, 14:20, 15:25] += 8.0  # 52 nm, as of a vibration during a few lines
    repeats = tifffile.imread(folder / "repeats.tif")
    repeats[:, *DUST] += 100.0
    tifffile.imwrite(folder / "images.tif", frames)
    tifffile.imwrite(folder / "repeats.tif", repeats)
    lines: list[str] = []
    with progress_to(lines.append):
        run(folder / "case.toml", "measure", False)
    return read_hdf5(folder / "results" / MEASURE), "\n".join(lines)


def test_the_spoilt_frame_is_named_left_out_and_nothing_else(
    measured: tuple[dict[str, np.ndarray], str],
) -> None:
    results, log = measured
    assert list(np.flatnonzero(results["left_out"])) == [BAD]
    assert f"frame {BAD} is unlike its neighbours: residual" in log
    assert "its image is not fitted, its load is" in log
    assert log.count("unlike its neighbours") == 1


def test_the_dust_is_left_out_and_told(measured: tuple[dict[str, np.ndarray], str]) -> None:
    results, log = measured
    assert results["codes"][DUST] == Excluded.DUST
    assert np.count_nonzero(results["codes"] == Excluded.DUST) == 13
    assert "13 pixels with dust" in log
    assert np.count_nonzero(results["codes"] == Excluded.USED) == len(results["xy"])


def test_both_estimates_of_the_noise_agree_with_what_was_put_in(
    measured: tuple[dict[str, np.ndarray], str],
) -> None:
    results, _ = measured
    for sigma, dof in (("sigma", "noise_dof"), ("noise_later", "noise_later_dof")):
        error = 1 / np.sqrt(2 * results[dof])
        # The motion between frames leaves a little of itself, below 1 %.
        assert results[sigma] == pytest.approx(closed_form.SIGMA, rel=4 * error + 0.01)
    assert not results["noise_larger"].any()


def test_the_rigid_motion_of_each_frame_is_kept(
    measured: tuple[dict[str, np.ndarray], str],
) -> None:
    results, _ = measured
    kept = results["left_out"] == 0
    stage = closed_form.stage_error(closed_form.problem())
    # The stage's random shift is seen beside the mean motion of the specimen, which is smooth.
    rest = (results["rigid"] - stage)[kept]
    roughness = np.std(np.diff(rest[:, 0], 2)) / np.sqrt(6)
    assert roughness < 0.02 * closed_form.PIXEL < 0.15 * np.std(stage[:, 0])


def test_a_mirrored_frame_two_that_changed_places_and_a_copy_are_each_told(tmp_path: Path) -> None:
    closed_form.write_files(tmp_path, {})
    frames = tifffile.imread(tmp_path / "images.tif")
    frames[[5, 30]] = frames[[30, 5]]
    frames[BAD] = frames[BAD, :, ::-1]
    frames[22] = frames[21]
    tifffile.imwrite(tmp_path / "images.tif", frames)
    lines: list[str] = []
    with progress_to(lines.append):
        run(tmp_path / "case.toml", "measure", False)
    log = "\n".join(lines)
    assert f"frame {BAD} shows the surface mirrored along Y: save it as the others are" in log
    assert "frames 5 and 30 look exchanged, for each has the elongation of the other" in log
    assert "images.frames: found every level of frame 21 in frame 22, expected an image" in log
    told = ("shows the surface", "look exchanged", "found every level", "is shifted by")
    assert [log.count(words) for words in told] == [1, 1, 1, 0]


def test_a_series_that_is_mirrored_as_a_whole_is_refused_as_such(tmp_path: Path) -> None:
    closed_form.write_files(tmp_path, {})
    frames = tifffile.imread(tmp_path / "images.tif")
    tifffile.imwrite(tmp_path / "images.tif", frames[:, ::-1].copy())
    with pytest.raises(
        InputError, match=r"\(frame \d+ shows the surface mirrored along X\), expec"
    ):
        run(tmp_path / "case.toml", "measure", False)


def face(folder: Path, kind: CellKind, name: str) -> None:
    """A mesh file of 2 × 4 µm that overlaps the face, its cells distorted."""
    mesh = distorted(kind, n=4)
    points = mesh.points * [2.2 / 3, 4.2 / 3] - [1.1, 0.1]
    points = np.column_stack([points, np.zeros(len(points))])
    cells = [({"tri3": "triangle", "quad8": "quad8"}[kind], mesh.cells)]
    meshio.Mesh(points, cells).write(folder / name, file_format="gmsh22")


def measured_with(folder: Path, **keys: object) -> tuple[dict[str, np.ndarray], str]:
    """Results and log of the same series with other keys of [dic]."""
    closed_form.write_files(folder, {})
    case = load_case(folder / "case.toml")
    dic = case.dic.model_copy(update=keys)
    write_case(case.model_copy(update={"dic": dic}), folder / "case.toml")
    frames = tifffile.imread(folder / "images.tif")
    frames[12, 10:14, 20:26] = np.nan
    tifffile.imwrite(folder / "images.tif", frames)
    lines: list[str] = []
    with progress_to(lines.append):
        run(folder / "case.toml", "measure", False)
    return read_hdf5(folder / "results" / MEASURE), "\n".join(lines)


KNOTS = np.array([0.0, *closed_form.KNOTS])


@pytest.mark.parametrize(
    ("keys", "kinds", "told"),
    [
        ({}, ("quad4", "quad4"), "regularisation tikhonov, roughness"),
        (
            {"mesh": "uv.msh", "height_mesh": "w.msh", "penalty": "equilibrium_gap",
             "roughness_px": 1.5},
            ("tri3", "quad8"), "regularisation equilibrium_gap, roughness 1.5 px (as stated)",
        ),
        (
            {"mesh": "trace", "height_mesh": "trace", "penalty": "elastic"},
            ("tri6", "tri6"), "regularisation elastic, roughness",
        ),
        (
            {"travel_um": 15.0, "roughness_px": "none"}, ("quad4", "quad4"),
            "smoothed along stage travel",
        ),
    ],
)  # fmt: skip
def test_what_the_case_asks_of_the_correlation_is_done_and_carried_to_the_results(
    keys: dict[str, object], kinds: tuple[str, str], told: str, tmp_path: Path
) -> None:
    face(tmp_path, "tri3", "uv.msh")
    face(tmp_path, "quad8", "w.msh")
    results, log = measured_with(tmp_path, **keys)
    assert told in log
    for name, kind in zip(("uv", "w"), kinds, strict=True):
        assert f"{len(results[f'cells_{name}'])} {kind}" in log
        assert results[f"cells_{name}"].shape[1] == (3 if kind.startswith("tri") else 4)
    assert results["converged"].all()
    assert bytes(results["stopped"][5]).decode() == "update of u, v below 0.0001 px"
    assert np.sqrt(np.mean(results["chi"] ** 2)) == pytest.approx(1.0, abs=0.05)
    history = closed_form.history()
    stretch = results["elongation"] - results["elongation"][0]
    sigma = np.sqrt(
        2 * (results["elongation_covariance"].diagonal() + results["elongation_held"] ** 2)
    )
    assert np.all(np.abs(stretch[history.turning] - KNOTS) < 4.5 * sigma[history.turning])
    # The hole is left out of its frame, and of no other.
    assert "1 frames lack heights on the face, frame 12 at most" in log
    assert np.isnan(results["residual"][12]).sum() >= 24
    assert np.isfinite(np.delete(results["residual"], 12, axis=0)).all()
    if "travel_um" in keys:
        assert results["travel_length"] == 15.0
        assert results["elongation_sigma"] < 0.9 * results["elongation_single"]
        assert results["elongation_covariance"][5, 6] > 0
        assert results["elongation_held"] == 0
    else:
        assert np.array_equal(results["smoother"], np.eye(len(stretch)))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"mesh": "absent.msh"}, "absent.msh: dic.mesh: found no such file, expected a plane mesh"),
        ({"height_mesh": "case.toml"}, "dic.height_mesh: found the ending .toml, expected"),
        ({"mesh": "far.msh"}, "dic.mesh, dic.height_mesh: found a mesh over X 8"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_told_in_one_sentence(
    keys: dict[str, object], said: str, tmp_path: Path
) -> None:
    square = distorted("tri3")
    points = np.column_stack([square.points + 8, np.zeros(len(square.points))])
    far = meshio.Mesh(points, [("triangle", square.cells)])
    far.write(tmp_path / "far.msh", file_format="gmsh22")
    with pytest.raises(InputError) as refused:
        measured_with(tmp_path, **keys)
    assert said in str(refused.value) and "\n" not in str(refused.value)


def spoilt(folder: Path, spoil: Callable[[np.ndarray], None]) -> tuple[dict[str, np.ndarray], str]:
    """Results and log of the series with frames [levels] that were spoilt."""
    folder.mkdir(exist_ok=True)
    closed_form.write_files(folder, {})
    frames = tifffile.imread(folder / "images.tif").astype(np.float32)
    spoil(frames)
    tifffile.imwrite(folder / "images.tif", frames)
    lines: list[str] = []
    with progress_to(lines.append):
        run(folder / "case.toml", "measure", False)
    return read_hdf5(folder / "results" / MEASURE), "\n".join(lines)


def test_a_lost_frame_and_a_stretched_first_one_are_told(tmp_path: Path) -> None:
    loaded = int(closed_form.history().turning[2])

    def spoil(frames: np.ndarray) -> None:
        frames[7, :, 20:] = np.nan
        frames[[0, loaded]] = frames[[loaded, 0]]

    results, log = spoilt(tmp_path, spoil)
    assert "frame 7: stopped after 1 steps: less than 50 % of the pixels" in log
    assert log.count("its image is not fitted, its load is") >= 1
    assert results["left_out"][7] == 1 and results["chi"][7] > 2
    assert "frames lack heights" not in log
    stretch = results["elongation"][0]
    assert f"frame 0 is {1e3 * stretch:.0f} nm longer than the repeats" in log
    assert stretch == pytest.approx(KNOTS[2], abs=5 * float(results["elongation_sigma"]))


def test_a_series_of_another_surface_is_refused(tmp_path: Path) -> None:
    def spoil(frames: np.ndarray) -> None:
        others = frames[: len(frames) // 2 + 1]
        rng = np.random.default_rng(0)
        others[:] = rng.normal(others.mean(), others.std(), others.shape)

    with pytest.raises(InputError, match=r"images.frames: found \d+ of \d+ frames that cannot be"):
        spoilt(tmp_path, spoil)


def test_a_frame_of_another_gain_has_its_motion_and_the_others_keep_theirs(
    measured: tuple[dict[str, np.ndarray], str], tmp_path: Path
) -> None:
    """As of a calibration that changed: its heights, with their noise, are a tenth smaller."""
    as_it_is, log = measured
    assert "times as high as" not in log and (as_it_is["gain"] == 1.0).all()
    face = as_it_is["rows"].astype(int), as_it_is["cols"].astype(int)

    def shrink(frames: np.ndarray) -> None:
        # About the mean of the face: what a gain does to it is a shift along Z.
        level = frames[LOW][face].mean()
        frames[LOW] = level + 0.9 * (frames[LOW] - level)

    results, log = spoilt(tmp_path, shrink)
    assert results["gain"][LOW] == pytest.approx(0.9, abs=0.004)
    assert (np.delete(results["gain"], LOW) == 1.0).all()
    assert f"frame {LOW} shows the relief {results['gain'][LOW]:.3f} ± " in log
    assert log.count("times as high as") == 1
    sigma = np.sqrt(np.diag(as_it_is["covariance_one"]))
    off = np.abs(results["coefficients"] - as_it_is["coefficients"]) / sigma
    # What noise does is the same in both, but for the dust and the spoilt frame of the other one.
    assert off[LOW].max() < min(1.0, np.delete(off, (LOW, BAD), axis=0).max())
    assert results["chi"][LOW] == pytest.approx(as_it_is["chi"][LOW], rel=0.03)
    assert not results["left_out"].any()
