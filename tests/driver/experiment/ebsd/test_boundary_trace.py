"""The trace of a boundary on a map has the direction that it was drawn with."""

from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.ebsd.boundary_trace import MapTrace, boundary_trace
from driver.experiment.ebsd.maps import EbsdMap
from meshes.arrays import BoolArray, FloatArray
from tests.driver.ebsd_files import FIRST, grid, hexagonal_grid
from tests.driver.experiment.ebsd.test_segmentation import ebsd_map

ENDS = np.array([[2.0, 5.0], [10.0, 5.0]])


def traced(points: EbsdMap, left: BoolArray, right: BoolArray, reach: float) -> MapTrace | None:
    return boundary_trace(points, np.flatnonzero(left), np.flatnonzero(right), ENDS, reach)


def parted(kind: str) -> EbsdMap:
    x, y = (hexagonal_grid if kind == "hexagonal" else grid)(49, 61, 0.2)
    return ebsd_map(x, y, FIRST)


def direction(trace: MapTrace) -> float:
    """Angle of the trace from y towards x [degrees], between −90 and 90."""
    return float(np.rad2deg(np.arctan(trace.along[0] / trace.along[1])))


def height(points: EbsdMap, angle: float) -> FloatArray:
    """Distance along x from a line through the middle [µm], its angle from y towards x."""
    return np.asarray(points.x - 6.0 - np.tan(np.deg2rad(angle)) * (points.y - 5.0))


@pytest.mark.parametrize("angle", [-50.0, -8.0, 0.0, 25.0])
@pytest.mark.parametrize("kind", ["square", "hexagonal"])
@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_a_straight_boundary_has_its_direction_with_points_left_out_beside_it_or_not(
    kind: str, angle: float, gap: float
) -> None:
    points = parted(kind)
    off = height(points, angle)
    trace = traced(points, off < -gap / 2, off > gap / 2, 4.0)
    assert trace is not None
    error = abs(direction(trace) - angle)
    assert error < np.rad2deg(3 * trace.sigma) and error < np.rad2deg(trace.resolution)


def test_a_boundary_is_looked_at_where_the_line_between_the_places_meets_it() -> None:
    points = parted("square")
    # Bent by 60° beyond 2 µm.
    bent = height(points, 0.0) - 1.7 * np.maximum(np.abs(points.y - 5.0) - 2.0, 0.0)
    trace = traced(points, bent < 0, bent > 0, 1.8)
    assert trace is not None and abs(direction(trace)) < 1.0
    assert traced(points, bent < 0, bent > 0, 6.0) is None  # no straight line


def test_grains_that_do_not_meet_or_hardly_have_no_trace() -> None:
    points = parted("square")
    off = height(points, 0.0)
    assert traced(points, off < -1.0, off > 1.0, 4.0) is None
    assert traced(points, off < 0.0, off > 0.0, 0.4) is None
