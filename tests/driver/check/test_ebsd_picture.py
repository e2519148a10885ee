"""The maps of a case are drawn in the colours of the crystal along the loading axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from driver.case.grains import Grain
from driver.check.ebsd_picture import draw_map, map_pictures
from tests.driver.doubts.test_orientations import ROWS, case_of
from tests.driver.ebsd_files import grid, hexagonal_grid, write_ang, write_ctf
from tests.driver.experiment.test_map_labels import case_in, write_map

RED, GREEN, BLUE = np.eye(3)
TO_111 = float(np.degrees(np.arccos(3**-0.5)))


def test_cells_have_the_colour_of_the_crystal_along_the_loading_axis(tmp_path: Path) -> None:
    x, y = grid(3, 6)
    column = np.rint(x / 0.5).astype(int)
    # Without frames the loading axis is y of the Euler angles: ⟨001⟩, ⟨101⟩ and ⟨111⟩ lie along it.
    angles = np.array(
        [(0, 0, 0), (0, 45, 0), (-TO_111, 90.0, 45.0), (0, 0, 90), (0, 0, 0), (0, 0, 0)]
    )
    write_ctf(tmp_path / "a.ctf", x, y, angles[column], np.where(column == 4, 0, 1))
    grains = (
        Grain(name="one", ebsd="a.ctf", ebsd_point_um=(0.0, 0.5)),
        Grain(name="two", ebsd="a.ctf", ebsd_point_um=(1.0, 1.0)),
    )
    (picture,) = map_pictures(case_of(tmp_path, *grains))
    assert picture.colours.shape == (3, 6, 3) and picture.extent == (-0.25, 2.75, 1.25, -0.25)
    assert picture.picked == (("one", (0.0, 0.5)), ("two", (1.0, 1.0)))
    black = np.zeros(3)
    expected = [RED, GREEN, BLUE, RED, black, RED]
    for row in picture.colours:
        np.testing.assert_allclose(row, expected, atol=0.02)


def test_the_frames_turn_the_loading_axis(tmp_path: Path) -> None:
    x, y = grid(3, 4)
    # x of the map is the loading axis, and −A2 of EDAX: ⟨101⟩ lies along A2 here.
    write_ang(tmp_path / "a.ang", x, y, (0.0, 45.0, 0.0))
    grains = [Grain(name=name, ebsd="a.ang", ebsd_point_um=(0.0, 0.0)) for name in "ab"]
    for frame, colour in (("edax", GREEN), ("oxford", RED)):
        case = case_of(tmp_path, *grains, ebsd_frame=frame, ebsd_to_specimen=ROWS)
        (picture,) = map_pictures(case)
        np.testing.assert_allclose(picture.colours, np.broadcast_to(colour, (3, 4, 3)), atol=0.02)


def test_a_hexagonal_map_fills_its_rows_and_is_drawn(tmp_path: Path) -> None:
    x, y = hexagonal_grid(4, 5)
    write_ang(tmp_path / "a.ang", x, y, (0.0, 0.0, 0.0), hexagonal=True)
    grains = [Grain(name=f"${name}", ebsd="a.ang", ebsd_point_um=(1.0, 0.0)) for name in "ab"]
    (picture,) = map_pictures(case_of(tmp_path, *grains))
    white = (picture.colours == 1.0).all(axis=2)
    np.testing.assert_array_equal(white, np.outer([0, 1, 0, 1], [0, 0, 0, 0, 1]).astype(bool))
    axes = Figure().subplots()
    draw_map(axes, picture)
    assert [text.get_text() for text in axes.texts] == [r"\$a", r"\$b"]
    assert "a.ang" in axes.get_title()


def test_the_face_is_drawn_on_a_map_that_places_the_grains(tmp_path: Path) -> None:
    write_map(tmp_path / "map.ang")
    (picture,) = map_pictures(case_in(tmp_path))
    axes = Figure().subplots()
    draw_map(axes, picture)
    (face,) = axes.patches
    assert isinstance(face, Polygon)
    np.testing.assert_allclose(face.get_xy()[:4], [[2, 1], [2, 5], [14, 5], [14, 1]], atol=1e-9)
