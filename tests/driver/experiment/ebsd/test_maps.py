"""Maps are read as their makers mean them, and what is damaged is told in one sentence."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from driver.experiment.ebsd import headers
from driver.experiment.ebsd.maps import EbsdMap, Phase, read_map
from driver.experiment.ebsd.orix_library import compiled_apart
from driver.experiment.images.files import Refused
from meshes.arrays import FloatArray
from tests.driver.ebsd_files import (
    FIRST,
    IRON,
    SECOND,
    TITANIUM,
    grid,
    halves,
    hexagonal_grid,
    write_ang,
    write_bruker,
    write_ctf,
)

X, Y = grid(4, 6)
# Bunge's rotation Rz(φ1)·Rx(Φ)·Rz(φ2) from the crystal to the sample, by scipy.
EXPECTED = Rotation.from_euler("ZXZ", halves(X, 1.2), degrees=True).as_matrix()


def matrices(points: EbsdMap) -> FloatArray:
    return np.asarray(Rotation.from_quat(points.rotations, scalar_first=True).as_matrix())


def refused(file: Path) -> tuple[str, str]:
    with pytest.raises(Refused) as error:
        read_map(file)
    return error.value.found, error.value.expected


def test_an_ang_file_of_edax_is_read_in_radians(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = read_map(write_ang(tmp_path / "a.ang", X, Y, halves(X, 1.2)))
    np.testing.assert_allclose(matrices(points), EXPECTED, atol=1e-5)
    np.testing.assert_allclose(points.x, X)
    np.testing.assert_allclose(points.y, Y)
    assert points.cubic.all() and points.phases == {0: Phase("Iron - Alpha", "m-3m")}
    assert points.step == (0.5, 0.5) and not points.like_radians and points.grain_ids is None
    assert capsys.readouterr() == ("", "")


def test_a_ctf_file_is_read_in_degrees(tmp_path: Path) -> None:
    for comma in (False, True):
        points = read_map(write_ctf(tmp_path / "a.ctf", X, Y, halves(X, 1.2), comma=comma))
        np.testing.assert_allclose(matrices(points), EXPECTED, atol=1e-12)
        assert points.step == (0.5, 0.5) and points.cubic.all()
        np.testing.assert_allclose(points.x, X)


def test_an_hdf5_file_of_bruker_is_read_with_x_to_the_right(tmp_path: Path) -> None:
    points = read_map(write_bruker(tmp_path / "a.h5", X, Y, halves(X, 1.2)))
    np.testing.assert_allclose(matrices(points), EXPECTED, atol=1e-12)
    np.testing.assert_allclose(points.x, X)
    np.testing.assert_allclose(points.y, Y)
    assert points.phases == {1: Phase("iron", "m-3m")}


def test_a_hexagonal_map_keeps_its_points(tmp_path: Path) -> None:
    x, y = hexagonal_grid(5, 4)
    points = read_map(write_ang(tmp_path / "a.ang", x, y, FIRST, hexagonal=True))
    assert points.x.size == 4 + 3 + 4 + 3 + 4
    np.testing.assert_allclose(points.x, x, atol=1e-5)


def test_points_that_were_not_indexed_are_known_by_the_mark_of_each_maker(tmp_path: Path) -> None:
    gone = np.arange(X.size) % 5 == 0
    edax = write_ang(tmp_path / "a.ang", X, Y, FIRST, confidence=np.where(gone, -1, 0.5))
    np.testing.assert_array_equal(read_map(edax).indexed, ~gone)
    # The angles alone are a mark as well, in a file of more columns than orix knows.
    text = edax.read_text("utf-8").replace(" -1.000 ", "  0.000 ")
    wide = [line + ("" if line.startswith("#") else " 0.0") for line in text.splitlines()]
    (tmp_path / "wide.ang").write_text("\n".join(wide) + "\n", encoding="utf-8")
    np.testing.assert_array_equal(read_map(tmp_path / "wide.ang").indexed, ~gone)
    oxford = write_ctf(tmp_path / "a.ctf", X, Y, FIRST, np.where(gone, 0, 1))
    np.testing.assert_array_equal(read_map(oxford).indexed, ~gone)


def test_phases_have_the_laue_class_of_their_header(tmp_path: Path) -> None:
    both, phase = (IRON, TITANIUM), np.where(X < 1.2, 1, 2)
    for file in (
        write_ang(tmp_path / "a.ang", X, Y, FIRST, phase, phases=both),
        write_ctf(tmp_path / "a.ctf", X, Y, FIRST, phase, phases=both),
    ):
        points = read_map(file)
        assert [points.phases[key].laue for key in (1, 2)] == ["m-3m", "6/mmm"]
        np.testing.assert_array_equal(points.cubic, X < 1.2)


def test_grains_that_the_file_counts_are_kept(tmp_path: Path) -> None:
    ids = np.where(X < 1.2, 7, 12)
    points = read_map(write_ang(tmp_path / "a.ang", X, Y, FIRST, grains=ids))
    np.testing.assert_array_equal(points.grain_ids, ids)


def test_small_angles_in_a_column_of_degrees_look_like_radians(tmp_path: Path) -> None:
    for degrees, like in ((np.deg2rad(halves(X, 1.2)), True), (FIRST, False), ((0, 0, 0), False)):
        assert read_map(write_ctf(tmp_path / "a.ctf", X, Y, degrees)).like_radians is like


def test_a_turned_surface_of_acquisition_is_kept(tmp_path: Path) -> None:
    points = read_map(write_ctf(tmp_path / "a.ctf", X, Y, FIRST, header={"AcqE2": "-90.0000"}))
    assert points.surface == (0.0, -90.0, 0.0)


def orix_file(path: Path, unit: str) -> Path:
    """A map that orix has written, a fifth of it not indexed."""
    with compiled_apart():
        from orix import io
        from orix.crystal_map import CrystalMap, PhaseList
        from orix.quaternion import Rotation as ToCrystal

    crystal_map = CrystalMap(
        rotations=ToCrystal.from_euler(halves(X, 1.2), degrees=True),
        phase_id=np.where(np.arange(X.size) % 5, 1, -1),
        x=X,
        y=Y,
        phase_list=PhaseList(names=["iron"], point_groups=["m-3m"], ids=[1]),
        prop={"grain_id": np.where(X < 1.2, 3, 4)},
        scan_unit=unit,
    )
    io.save(str(path), crystal_map, overwrite=True)
    return path


def test_a_file_of_orix_is_read_with_the_unit_of_its_coordinates(tmp_path: Path) -> None:
    for unit, factor in (("um", 1.0), ("nm", 1e-3)):
        points = read_map(orix_file(tmp_path / "a.h5", unit))
        np.testing.assert_allclose(matrices(points), EXPECTED, atol=1e-12)
        np.testing.assert_allclose(points.x, X * factor)
        np.testing.assert_array_equal(points.cubic, np.arange(X.size) % 5 > 0)
        np.testing.assert_array_equal(points.grain_ids, np.where(X < 1.2, 3, 4))
    assert refused(orix_file(tmp_path / "a.h5", "px")) == ("coordinates in “px”", "micrometres")


def test_angles_of_an_ang_file_in_degrees_are_refused(tmp_path: Path) -> None:
    file = write_ang(tmp_path / "a.ang", X, Y, np.rad2deg(halves(X, 1.2)))
    assert refused(file) == ("Euler angles up to 281", "radians, as an .ang file has them")


def test_a_mirrored_map_is_refused_with_the_reason(tmp_path: Path) -> None:
    why = "so that its coordinates are mirrored and its angles are not"
    negative = write_ang(tmp_path / "a.ang", X, Y, FIRST, header={"XSTEP": "-0.500000"})
    assert refused(negative)[0] == f"XSTEP = -0.5, {why}"
    for axis, (x, y) in (("x", (X.max() - X, Y)), ("y", (X, Y.max() - Y))):
        positive = {"XStep": "0.5000", "YStep": "0.5000"}
        found, expected = refused(write_ctf(tmp_path / "a.ctf", x, y, FIRST, header=positive))
        assert found == f"{axis} that falls from point to point on a grid of positive steps, {why}"
        assert expected == "a right-handed map: it is exported anew, not flipped"


def test_a_file_that_is_none_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    kinds = "an EBSD map in a file .ang, .ctf or .h5"
    assert refused(tmp_path / "a.ang") == ("nothing", kinds)
    (tmp_path / "b.ang").mkdir()
    assert refused(tmp_path / "b.ang") == ("no file", kinds)
    found, expected = refused(tmp_path / "a.cpr")
    assert found == 'the ending ".cpr"' and expected.startswith(kinds + "; Oxford's own files are")


@pytest.mark.parametrize("suffix", [".ang", ".ctf", ".h5"])
@pytest.mark.parametrize(
    "content", [b"", b"\x00\xff" * 200, b"Phase\tX\tY\n1 2 3\n", b"1 2\n3\n", b"x" * 9999]
)
def test_a_damaged_file_gets_one_sentence(tmp_path: Path, suffix: str, content: bytes) -> None:
    file = tmp_path / f"a{suffix}"
    file.write_bytes(content)
    found, expected = refused(file)
    assert (
        0 < len(found) < 200
        and "\n" not in found
        and ("whole" in expected or "can be read" in expected)
    )


def test_a_file_that_was_cut_is_refused(tmp_path: Path) -> None:
    whole = write_ang(tmp_path / "a.ang", X, Y, FIRST).read_text("utf-8")
    lines = whole.splitlines(keepends=True)
    (tmp_path / "b.ang").write_text("".join(lines[:-5]), encoding="utf-8")
    expected = "a file that is whole: export it anew"
    assert refused(tmp_path / "b.ang") == ("19 points, but 24 by its header", expected)
    (tmp_path / "c.ang").write_text(whole[:-40], encoding="utf-8")
    assert refused(tmp_path / "c.ang")[1] == "an .ang file that is whole: export it anew"
    cut = write_ctf(tmp_path / "a.ctf", X, Y, FIRST).read_text("utf-8").splitlines(keepends=True)
    (tmp_path / "b.ctf").write_text("".join(cut[:-1]), encoding="utf-8")
    assert refused(tmp_path / "b.ctf") == ("23 points, but 24 by its header", expected)
    h5 = write_bruker(tmp_path / "a.h5", X, Y, FIRST).read_bytes()
    (tmp_path / "b.h5").write_bytes(h5[: len(h5) // 2])
    assert refused(tmp_path / "b.h5")[1].endswith("that can be read")


def test_a_number_of_the_header_that_is_none_is_named(tmp_path: Path) -> None:
    for key, text in (("XStep", "fine"), ("XStep", "nan"), ("YCells", "1e999")):
        file = write_ctf(tmp_path / "a.ctf", X, Y, FIRST, header={key: text})
        assert refused(file) == (f'{key} = "{text}" in its header', "a number")


def test_what_is_no_number_among_the_points_is_refused(tmp_path: Path) -> None:
    angles = np.where((X == 1.0)[:, None], np.nan, FIRST)
    found, expected = refused(write_ctf(tmp_path / "a.ctf", X, Y, angles))
    assert (found, expected) == ("coordinates or angles that are no numbers", "numbers")
    x = np.where(X == 1.0, np.nan, X)
    file = write_ctf(tmp_path / "b.ctf", x, Y, FIRST, header={"XStep": "0.5", "XCells": "0"})
    assert refused(file)[1] == "a .ctf file that is whole: export it anew"


def test_a_map_without_an_orientation_is_refused(tmp_path: Path) -> None:
    file = write_ctf(tmp_path / "a.ctf", X, Y, FIRST, 0)
    assert refused(file) == ("24 points, none of them indexed", "a map with orientations")


def test_an_hdf5_file_of_another_maker_is_refused_with_a_way_out(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["Manufacturer"] = b"EDAX"
    assert (
        "of Bruker, EMsoft or orix that is whole; of others, an export as .ang"
        in (refused(tmp_path / "a.h5")[1])
    )


def test_a_file_is_judged_by_its_size_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "orix.io", None)  # nothing is read
    file = tmp_path / "a.ang"
    file.touch()
    os.truncate(file, 5_000_000_000)  # takes no room on the disk
    limit = "at most 1e+07 points and 4 GB: the part of the map around the specimen is enough"
    assert refused(file) == ("5 GB", limit)
    with h5py.File(tmp_path / "a.h5", "w") as content:
        content.create_dataset("Scan/EBSD/Data/MAD", (20_000_000,), "f4", chunks=True)
        content.create_dataset("Scan/EBSD/Data/RawPatterns", (9, 2**20, 2**20), "u1", chunks=True)
    assert refused(tmp_path / "a.h5") == ("2e+07 points, 0.08 GB", limit)
    monkeypatch.setattr(headers, "_MOST_LINES", 0)
    monkeypatch.setattr(headers, "MOST_POINTS", 30)
    assert refused(write_ctf(tmp_path / "a.ctf", X, Y, SECOND))[0].startswith("39 points")


def test_without_orix_it_is_named_with_what_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for library in ("orix.io", "quaternion"):
        with monkeypatch.context() as absent:
            absent.setitem(sys.modules, library, None)
            found, expected = refused(write_ang(tmp_path / "a.ang", X, Y, FIRST))
        assert found == f"no library {library}, with which it is read"
        assert expected == '`pip install "prismid[ebsd]"` before'
