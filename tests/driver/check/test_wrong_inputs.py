"""Wrong inputs of users: each is told in one sentence, with what to do, by a check of the program.

A unit that is wrong, and angles that may be meant otherwise, are no errors: they are warned of.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image
from typer.testing import CliRunner

from driver.check import command
from driver.cli import app
from meshes.arrays import FloatArray
from tests.driver.ebsd_files import TITANIUM, grid, halves, write_ang, write_ctf
from tools import closed_form

pytest.importorskip("orix", reason="the library of EBSD maps is absent")
pytest.importorskip("SurfaceTopography", reason="the library of instruments is absent")

Change = Callable[[Path], object]
PNG = b"\x89PNG\r\n\x1a\n" + 200 * b"0"
X, Y = grid(12, 26)
ANGLES = halves(X, 6.0)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    closed_form.write_files(folder, {})
    return folder


@pytest.fixture(scope="module", autouse=True)
def no_picture() -> Iterator[None]:
    """Pictures take more time than all that is tested here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "draw", lambda *arguments: None)
        yield


def told(folder: Path, level: str) -> tuple[int, list[str]]:
    """Exit code of a check, and what it has found of a level."""
    ended = CliRunner().invoke(app, ["check", str(folder / "case.toml"), "--json"])
    answer = json.loads(ended.stdout.splitlines()[-1])
    return ended.exit_code, [f["message"] for f in answer["findings"] if f["level"] == level]


def edited(pattern: str, new: str, name: str = "case.toml") -> Change:
    """A change of a text file by a regular expression that has to be found once at least."""

    def change(folder: Path) -> None:
        text, n = re.subn(pattern, new, (folder / name).read_text("utf-8"), count=0, flags=re.M)
        assert n
        (folder / name).write_text(text, "utf-8")

    return change


def of_first_grain(name: str, pick: str, frame: str) -> Change:
    """A change of the case: its first grain is picked in a map."""

    def change(folder: Path) -> None:
        text = (folder / "case.toml").read_text("utf-8")
        text = re.sub(r"^euler_deg = .*$", f'ebsd = "{name}"\n{pick}', text, count=1, flags=re.M)
        text = text.replace("[orientation]", f"[orientation]\n{frame}", 1)
        (folder / "case.toml").write_text(text, "utf-8")

    return change


def a_map(
    name: str, write: Callable[[Path], object], pick: str = "ebsd_point_um = [2.0, 2.0]"
) -> Change:
    """A map beside the case, whose first grain is picked in it."""

    def change(folder: Path) -> None:
        write(folder / name)
        of_first_grain(name, pick, 'ebsd_frame = "edax"')(folder)

    return change


def holding(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


def ang(path: Path) -> None:
    write_ang(path, X, Y, ANGLES)


def cut(write: Callable[[Path], object]) -> Callable[[Path], None]:
    """A file of which the last third is lacking."""

    def change(path: Path) -> None:
        write(path)
        content = path.read_bytes()
        path.write_bytes(content[: 2 * len(content) // 3])

    return change


def lines(write: Callable[[Path], object], of: Callable[[list[str]], list[str]]) -> Change:
    """A text file whose lines are changed."""

    def change(path: Path) -> None:
        write(path)
        path.write_text("\n".join(of(path.read_text("utf-8").splitlines())) + "\n", "utf-8")

    return change


def scans(ending: str, content: bytes) -> Change:
    """Files of an instrument in place of the frames."""

    def change(folder: Path) -> None:
        for k in range(3):
            (folder / f"scan_{k}{ending}").write_bytes(content)
        edited('^frames = "images.tif"', f'frames = "scan_*{ending}"')(folder)
        edited("^height_per_level_nm", "# height_per_level_nm")(folder)

    return change


def frames(of: Callable[[FloatArray], Any], **options: Any) -> Change:
    """Another stack of frames."""

    def change(folder: Path) -> None:
        stack = tifffile.imread(folder / "images.tif")
        tifffile.imwrite(folder / "images.tif", of(stack), **options)

    return change


def marked(stack: FloatArray, mark: float) -> FloatArray:
    stack[:, :6, :6] = mark
    return stack


def history(of: Callable[[str], str], encoding: str = "utf-8") -> Change:
    """Another text of the log."""

    def change(folder: Path) -> None:
        path = folder / "history.csv"
        path.write_bytes(of(path.read_text("utf-8")).encode(encoding))

    return change


def column(index: int, of: Callable[[float], object]) -> Change:
    """Other numbers in a column of the log."""

    def text(old: str) -> str:
        head, *rows = (row.split(",") for row in old.splitlines())
        for row in rows:
            row[index] = str(of(float(row[index])))
        return "\n".join(",".join(row) for row in (head, *rows))

    return history(text)


def photograph(folder: Path) -> None:
    Image.new("L", (49, 28)).save(folder / "images.jpg")
    edited('^frames = "images.tif"', 'frames = "images.jpg"')(folder)


def workbook(folder: Path) -> None:
    (folder / "history.xlsx").write_bytes(b"PK\x03\x04" + 50 * b"\0")
    edited("history.csv", "history.xlsx")(folder)


CTF = 'ebsd_frame = "oxford"'
# What is wrong: the change, and the end of the sentence with what was found and what to do.
REFUSED: dict[str, tuple[Change, str]] = {
    "a picture of a map named .ang": (
        a_map("map.ang", holding(PNG)), "found a PNG picture, .* export the map with its points"),
    "a picture of a map named .h5": (
        a_map("map.h5", holding(PNG)), "found a PNG picture, .* whole: export it anew"),
    "a picture of a map": (
        a_map("map.png", holding(PNG)), 'the ending ".png", .* exported as .ctf, EDAX\'s as .ang'),
    "a map in EDAX's own format": (
        a_map("map.osc", holding(b"OSC")), 'the ending ".osc", .* exported as .ctf, EDAX\'s as'),
    "a map cut within a line": (
        a_map("map.ang", cut(ang)), r"1 of 10 columns in line 2\d\d, .* whole: export it anew"),
    "a cut map of Oxford": (
        a_map("map.ctf", cut(lambda p: write_ctf(p, X, Y, ANGLES))),
        r"2 of 11 columns in line 2\d\d, .* whole: export it anew"),
    "a map cut between lines": (
        a_map("map.ang", lines(ang, lambda rows: rows[:-40])),
        "found 272 points, but 312 by its header, .* export it anew"),
    "the header of a map": (
        a_map("map.ang", lines(ang, lambda rows: [r for r in rows if r[0] == "#"])),
        "found no points, .* export it anew"),
    "an empty map": (
        a_map("map.ang", holding(b"")), "found an empty file, .* export the map with its points"),
    "no map": (of_first_grain("map.ang", "", 'ebsd_frame = "edax"'),
               "found nothing, expected an EBSD map in a file .ang, .ctf or .h5"),
    "a map with decimal commas": (
        a_map("map.ang", lines(ang, lambda rows: [r.replace(".", ",") for r in rows])),
        'found "4,90438" in line 27, expected numbers with "." as decimal sign'),
    "another text named .ang": (
        a_map("map.ang", holding(b"hello\nworld\n")), 'found "hello" in line 1, .* export it anew'),
    "degrees in an .ang file": (
        a_map("map.ang", lambda p: write_ang(p, X, Y, np.rad2deg(ANGLES))),
        "found Euler angles up to .*, expected radians"),
    "a map without orientations": (
        a_map("map.ang", lambda p: write_ang(p, X, Y, ANGLES, confidence=-1)),
        "312 points, none of them indexed, expected a map with orientations"),
    "a hexagonal crystal": (
        a_map("map.ang", lambda p: write_ang(p, X, Y, ANGLES, phases=(TITANIUM,))),
        "Laue class 6/mmm there, expected a cubic crystal"),
    "a point off the map": (
        a_map("map.ang", ang, "ebsd_point_um = [99.0, 2.0]"),
        r"it has no point, expected .* x from 0 to 12.5 and y from 0 to 5.5"),
    "axes that mirror": (
        edited(r"^ebsd_to_specimen = \[\[1.0", "ebsd_to_specimen = [[-1.0"),
        "expected a proper rotation of determinant"),
    "a text named .sur": (scans(".sur", b"text"), "or the scan saved as TIFF by its own program"),
    "an empty .plu": (scans(".plu", b""), "or the scan saved as TIFF by its own program"),
    "a picture named .x3p": (scans(".x3p", PNG), "or the scan saved as TIFF by its own program"),
    "a cut .al3d": (scans(".al3d", b"AliconaImaging\0"), "or the scan saved as TIFF by its own"),
    "an instrument that is not read": (
        scans(".dat", b"x"), "found no image among 3 files, expected a file, .* instrument files"),
    "levels of an instrument scaled once more": (
        edited('^frames = "images.tif"', 'frames = "a.sur"'),
        "expected nothing, or 1: the heights in a.sur are read in nanometres"),
    "colours": (
        frames(lambda s: np.zeros((*s.shape, 3), np.uint8), photometric="rgb"),
        r"3 colour channels \(RGB\), expected heights, one number a pixel"),
    "complex numbers": (
        frames(lambda s: s.astype(np.complex64)), "complex64, expected integers or floats"),
    "no pixel with a height": (
        frames(lambda s: np.full_like(s, np.nan)), "found no pixel with a height in frame 0, exp"),
    "a cut TIFF": (
        lambda folder: cut(lambda path: None)(folder / "images.tif"),
        "expected a TIFF file that is whole: copy or save it anew"),
    "a picture named .tif": (
        lambda folder: (folder / "images.tif").write_bytes(PNG),
        "found a PNG picture, expected a TIFF file, or the ending of that kind"),
    "a photograph": (photograph, "found a JPEG picture, expected a TIFF file"),
    "too few pages": (frames(lambda s: s[:1]), "found 1 frame, expected 44, the images of"),
    "a sentinel of −9999": (
        frames(lambda s: marked(s, -9999.0)), "images.off_surface_level = -9999 if it marks"),
    "a sentinel of 3.4e38": (
        frames(lambda s: marked(s, 3.4e38)), r"off_surface_level = 3.39\d*e\+38 if it marks"),
    "frames turned by 90°": (
        frames(lambda s: np.ascontiguousarray(s.transpose(0, 2, 1))), "px as the frames"),
    "a tag that turns the picture": (
        frames(lambda s: s, extratags=[(274, 3, 1, 6, True)]), "save the file anew as it is shown"),
    "semicolons": (
        history(lambda s: s.replace(",", ";")), r'or separator = ";" under \[history\]'),
    "a row of units": (
        history(lambda s: s.replace("\n", "\ns,um,,N\n", 1)), "or first_row = 3 under"),
    "times of day": (
        history(lambda s: s.replace("\n0.0,", "\n00:00:00,", 1)), 'unit = "hh:mm:ss"} under'),
    "UTF-16": (history(str, "utf-16"), r'or encoding = "utf-16" under \[history\]'),
    "millimetres in the header": (
        history(lambda s: s.replace("stage_um", "stage_mm")),
        r'or stage = {name = "stage_mm", unit = "mm"} under \[history.columns\]'),
    "times that go back": (
        history(lambda s: "\n".join([*s.splitlines()[:5], *s.splitlines()[3:]])),
        "row 6, time_s: found .*, expected more than"),
    "a workbook": (workbook, r"found a workbook \(.xlsx.*: save its table as text"),
}  # fmt: skip
WARNED: dict[str, tuple[Change, str]] = {
    "angles in radians": (
        edited(r"^euler_deg = \[281.0.*$", "euler_deg = [4.9, 0.14, 0.82]"),
        r"looks like radians .* write euler_deg = \[280.749, 8.021, 46.983\]"),
    "Φ of 200°": (
        edited(r"^euler_deg = \[281.0.*$", "euler_deg = [281.0, 200.0, 47.0]"),
        r"beyond its range .* is taken as \[101.0, 160.0, 227.0\], the same rotation"),
    "a stage in millimetres": (column(1, lambda v: v / 1e3), 'stage = {name = …, unit = "mm'),
    "times in minutes": (column(0, lambda v: v / 6e3), 'time = {name = …, unit = "min"}'),
    "loads in kilonewtons": (column(3, lambda v: v / 1e3), 'force = {name = …, unit = "kN"}'),
    "a section ten times too small": (
        edited("^macroscopic_mm2 = .*$", "macroscopic_mm2 = 0.1"),
        "look at the section, at the unit of the loads"),
}  # fmt: skip


def wrong(good: Path, folder: Path, change: Change) -> Path:
    shutil.copytree(good, folder)
    change(folder)
    return folder


def test_there_are_forty_of_them() -> None:
    assert len(REFUSED) + len(WARNED) >= 40


@pytest.mark.parametrize("what", REFUSED)
def test_a_wrong_input_is_refused_in_one_sentence_that_says_what_to_do(
    what: str, good: Path, tmp_path: Path
) -> None:
    change, expected = REFUSED[what]
    code, errors = told(wrong(good, tmp_path / "case", change), "error")
    assert code == 1
    assert len(errors) == 1, errors
    assert re.search(expected, errors[0]), errors[0]
    assert "\n" not in errors[0] and "found" in errors[0] and "expected" in errors[0]


@pytest.mark.parametrize("what", WARNED)
def test_what_may_be_meant_otherwise_is_warned_of_with_what_to_write(
    what: str, good: Path, tmp_path: Path
) -> None:
    change, expected = WARNED[what]
    code, warnings = told(wrong(good, tmp_path / "case", change), "warning")
    assert code == 0
    assert len([one for one in warnings if re.search(expected, one)]) == 1, warnings


def test_the_case_that_they_were_made_from_is_good(good: Path, tmp_path: Path) -> None:
    code, errors = told(wrong(good, tmp_path / "case", lambda folder: None), "error")
    assert (code, errors) == (0, [])
