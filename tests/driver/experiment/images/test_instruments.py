"""Files of instruments, written here byte by byte from the descriptions of their formats."""

from __future__ import annotations

import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from driver.case.instrument_files import INSTRUMENTS
from driver.case.model import CaseError, default_case, load_case, write_case
from driver.experiment.image_sizes import StackSize, stack_size
from driver.experiment.images.heightmaps import ImageError, load_stack
from driver.experiment.reading import read_experiment
from driver.experiment.stack_checks import ExperimentError

PIXEL = 110e-9  # m


def scan(seed: int = 1) -> np.ndarray:
    """Heights of 6 rows and 10 columns [m], one pixel not measured, no two rows alike."""
    heights = 1e-9 * np.random.default_rng(seed).normal(300.0, 40.0, (6, 10))
    heights[4, 7] = np.nan
    return heights


def write_x3p(path: Path, heights: np.ndarray, pitch: tuple[float, float] = (PIXEL, PIXEL)) -> None:
    """ISO 25178-72: a zip of main.xml and doubles in metres, x first."""
    rows, columns = heights.shape
    axes = "".join(
        f"<C{axis}><AxisType>I</AxisType><DataType>D</DataType><Increment>{step}</Increment>"
        f"<Offset>0</Offset></C{axis}>"
        for axis, step in zip("XY", pitch, strict=True)
    )
    main = (
        '<?xml version="1.0" encoding="UTF-8"?><p:ISO5436_2 '
        'xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1><Revision>ISO5436 - 2000'
        f"</Revision><FeatureType>SUR</FeatureType><Axes>{axes}<CZ><AxisType>A</AxisType>"
        "<DataType>D</DataType></CZ></Axes></Record1><Record2><Date>2020-01-01T00:00:00</Date>"
        "<Instrument><Manufacturer>m</Manufacturer><Model>m</Model><Serial>1</Serial><Version>1"
        "</Version></Instrument><CalibrationDate>2020-01-01T00:00:00</CalibrationDate>"
        "<ProbingSystem><Type>NonContacting</Type><Identification>i</Identification>"
        f"</ProbingSystem></Record2><Record3><MatrixDimension><SizeX>{columns}</SizeX><SizeY>{rows}"
        "</SizeY><SizeZ>1</SizeZ></MatrixDimension><DataLink><PointDataLink>bindata/data.bin"
        "</PointDataLink></DataLink></Record3><Record4><ChecksumFile>md5checksum.hex"
        "</ChecksumFile></Record4></p:ISO5436_2>"
    )
    with zipfile.ZipFile(path, "w") as content:
        content.writestr("main.xml", main)
        content.writestr("bindata/data.bin", heights.astype("<f8").tobytes())


def write_gwy(path: Path, heights: np.ndarray) -> None:
    """Gwyddion's own format: objects of named components, lengths in metres."""

    def object_of(name: str, *components: bytes) -> bytes:
        content = b"".join(components)
        return name.encode() + b"\0" + struct.pack("<I", len(content)) + content

    def component(name: str, kind: str, content: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + content

    rows, columns = heights.shape
    unit = object_of("GwySIUnit", component("unitstr", "s", b"m\0"))
    data = heights.astype("<f8").ravel()
    field = object_of(
        "GwyDataField",
        component("xres", "i", struct.pack("<i", columns)),
        component("yres", "i", struct.pack("<i", rows)),
        component("xreal", "d", struct.pack("<d", columns * PIXEL)),
        component("yreal", "d", struct.pack("<d", rows * PIXEL)),
        component("si_unit_xy", "o", unit),
        component("si_unit_z", "o", unit),
        component("data", "D", struct.pack("<I", data.size) + data.tobytes()),
    )
    container = object_of(
        "GwyContainer",
        component("/0/data", "o", field),
        component("/0/data/title", "s", b"Height\0"),
    )
    path.write_bytes(b"GWYP" + container)


def write_sdf(path: Path, heights: np.ndarray) -> None:
    """ISO 25178-71 as text: lengths in metres, and whole numbers of Zscale."""
    rows, columns = heights.shape
    header = (
        f"aISO-1.0\nManufacID = m\nCreateDate = 010120200000\nModDate = 010120200000\n"
        f"NumPoints = {columns}\nNumProfiles = {rows}\nXscale = {PIXEL}\nYscale = {PIXEL}\n"
        "Zscale = 1e-12\nZresolution = -1\nCompression = 0\nDataType = 6\nCheckType = 0\n*\n"
    )
    lines = [" ".join(f"{value:.0f}" for value in row) for row in heights * 1e12]
    path.write_text(header + "\n".join(lines) + "\n*\n")


@pytest.mark.parametrize("suffix", ["x3p", "gwy", "sdf"])
def test_heights_come_in_nanometres_row_by_row_as_the_instrument_wrote_them(
    tmp_path: Path, suffix: str
) -> None:
    heights = scan()
    if suffix == "sdf":
        heights[4, 7] = 3e-7  # it has no mark that is common to all programs
    {"x3p": write_x3p, "gwy": write_gwy, "sdf": write_sdf}[suffix](
        tmp_path / f"a.{suffix}", heights
    )
    stack = load_stack(tmp_path / f"a.{suffix}")
    assert len(stack) == 1 and stack.levels.sources[0].in_nm
    np.testing.assert_allclose(stack[0], 1e9 * heights, rtol=1e-5)
    assert stack.levels.sources[0].pixel_nm == pytest.approx((110.0, 110.0), rel=1e-6)


def case_of_scans(folder: Path, pitch: float = PIXEL) -> Path:
    for seed in range(4):
        for name in ("scan", "repeat"):
            write_x3p(folder / f"{name}_{seed}.x3p", scan(seed), (pitch, pitch))
    rows = [f"{t},{t},{t},1" for t in range(4)]
    (folder / "history.csv").write_text("\n".join(["time_s,stage_um,image,force_N", *rows]))
    case = default_case()
    write_case(case, folder / "case.toml")
    text = (folder / "case.toml").read_text("utf-8")
    kept = [line for line in text.splitlines() if not line.startswith(("height_per", "off_surf",
            "frames", "repeats", "flats"))]  # fmt: skip
    where = kept.index("[images]") + 1
    kept[where:where] = ['frames = "scan_*.x3p"', 'repeats = "repeat_*.x3p"']
    (folder / "case.toml").write_text("\n".join(kept), encoding="utf-8")
    return folder / "case.toml"


def test_a_case_of_scans_needs_no_scale_of_heights(tmp_path: Path) -> None:
    case = load_case(case_of_scans(tmp_path))
    experiment = read_experiment(case)
    assert case.images.height_per_level_nm == 1.0 and case.images.off_surface_level == "none"
    np.testing.assert_allclose(experiment.frames[2], 1e6 * scan(2), rtol=1e-12)
    assert stack_size(case, "frames") == StackSize(4, 60, 8)


def test_another_scale_or_size_of_pixels_than_that_of_the_file_is_refused(tmp_path: Path) -> None:
    path = case_of_scans(tmp_path, 1.02 * PIXEL)
    told = (
        r"scan_0\.x3p: images\.frames: found pixels of 112\.2 nm in the file, expected the 110 of "
        r"images\.pixel_size_nm, to 1%"
    )
    with pytest.raises(ExperimentError, match=told):
        read_experiment(load_case(path))
    text = path.read_text("utf-8").replace("[images]\n", "[images]\nheight_per_level_nm = 6.5\n")
    path.write_text(text, encoding="utf-8")
    told = r"height_per_level_nm.*found 6\.5, expected nothing, or 1: the heights in scan_"
    with pytest.raises(CaseError, match=told):
        load_case(path)


def test_scans_of_a_folder_are_told_to_need_their_scale(tmp_path: Path) -> None:
    path = case_of_scans(tmp_path)
    (tmp_path / "scans").mkdir()
    for file in tmp_path.glob("scan_*"):
        file.rename(tmp_path / "scans" / file.name)
    path.write_text(path.read_text("utf-8").replace("scan_*.x3p", "scans"), encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"found heights in nanometres and height_per_level_"):
        read_experiment(load_case(path))


def test_what_the_library_cannot_read_names_file_library_and_reason(tmp_path: Path) -> None:
    write_x3p(tmp_path / "a.x3p", scan(), (PIXEL, 2 * PIXEL))
    with pytest.raises(ImageError, match=r"a\.x3p.*found pixels of 110 nm along a row and 220 nm"):
        load_stack(tmp_path / "a.x3p")
    (tmp_path / "b.sur").write_bytes(bytes(2000))
    told = r"b\.sur: images: found what SurfaceTopography [\d.]+ cannot read \(\w+: “"
    with pytest.raises(ImageError, match=told):
        load_stack(tmp_path / "b.sur")


def test_without_the_extra_its_name_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "SurfaceTopography.IO", None)
    write_x3p(tmp_path / "a.x3p", scan())
    with pytest.raises(ImageError, match=r"pip install 'prismid\[instruments\]'"):
        load_stack(tmp_path / "a.x3p")


def test_no_ending_is_that_of_a_plain_image() -> None:
    assert not {".tif", ".png", ".npy", ".h5", ".mat", ".csv", ".txt"} & set(INSTRUMENTS)
