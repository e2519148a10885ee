import numpy as np
import pytest

from driver.report.packed_arrays import unpack
from driver.report.specimen_surface import specimen_surface
from driver.report.view import shown_images, view_of_findings
from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from tests.driver.invented_results import KNOTS, PEAKS, STAGE, Results


def test_all_images_are_shown_where_they_are_few_and_else_the_peaks_among_them() -> None:
    assert shown_images(7, np.array([3]), 120).tolist() == list(range(7))
    many = shown_images(1000, np.array([333, 777]), 120)
    assert len(many) <= 120 and {0, 333, 777, 999} <= set(many.tolist())
    assert (np.diff(many) > 0).all()


def test_motion_is_in_nanometres_without_its_mean_and_loads_are_those_of_the_images(
    written: Results,
) -> None:
    view = view_of_findings(written.findings())
    fields, settings = unpack(view.arrays), view.settings
    v = fields["free/v"][PEAKS[-1]]
    y = np.array(settings["face"]["y"])
    assert np.nanmean(v) == pytest.approx(0.0, abs=0.1)
    assert v[0] - v[0, 0] == pytest.approx(1e3 * KNOTS[2] / 12.0 * (y - y[0]), abs=0.06)
    assert settings["load"]["measured"] == pytest.approx([23.1 * s for s in STAGE])
    assert settings["loading"][:6] == [True, True, True, True, False, False]
    assert settings["start"] == PEAKS[-1]


def test_the_surface_of_the_specimen_closes_and_has_its_area() -> None:
    mesh = generate(
        PrismGeometry(12.0, 4.0, 3.0, (GrainBoundary((0.0, 5.0, 0.0), (0.0, 1.0, 0.0)),)), 2.0
    )
    surface = specimen_surface(mesh)
    assert surface is not None
    points = surface["points"][0]
    a, b, c = (points[surface["triangles"][0][:, k].astype(int)] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert normals.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    assert surface["grain"][0].size == len(normals)
    slanted = 12.0 * np.hypot(2.0, 3.0)
    area = 12.0 * 4.0 + 2 * slanted + 2 * (4.0 * 3.0 / 2)
    assert np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(area)
