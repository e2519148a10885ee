"""The trace of the boundary between two picked grains on an EBSD map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from driver.experiment.ebsd.maps import EbsdMap
from driver.experiment.ebsd.segmentation import grid_steps
from meshes.arrays import BoolArray, FloatArray, IntArray

_GAP = 3.1  # steps; points on a boundary are often not indexed
_FEWEST = 6  # pairs of points, and steps of their extent, of which a direction is taken
_STRAIGHT = 1.0  # step rms off the line, beyond which a boundary is curved


@dataclass(frozen=True)
class MapTrace:
    """A straight piece of a boundary on a map.

    Attributes:
        along: unit vector along it, x and y of the map; its sign means nothing.
        sigma: standard deviation of its direction [rad].
        resolution: a step of the map over the length of the piece [rad].
    """

    along: tuple[float, float]
    sigma: float
    resolution: float


def boundary_trace(
    points: EbsdMap, first: IntArray, second: IntArray, ends: FloatArray, reach: float
) -> MapTrace | None:
    """Return the direction of the boundary of two grains, near the line between their places.

    It is that of the largest scatter of the middles between points of both that are each the
    nearest one of the other grain.

    Args:
        points: the map.
        first: points of one grain.
        second: points of the other.
        ends: a place in each [µm], shape (2, 2).
        reach: how far from that line the boundary is looked at [µm].

    Returns:
        None where the grains do not meet, on a piece that is too short, or along a curve.
    """
    step = max(grid_steps(points))
    places = np.column_stack([points.x, points.y])
    one, other = places[first], places[second]
    away, nearest = cKDTree(other).query(one, distance_upper_bound=_GAP * step)
    met = np.flatnonzero(np.isfinite(away))
    if met.size < _FEWEST:
        return None
    back = cKDTree(one).query(other[nearest[met]])[0]
    met = met[away[met] <= back * (1.0 + 1e-9)]
    middles = (one[met] + other[nearest[met]]) / 2
    middles = middles[_near(middles, ends, reach)]
    if len(middles) < _FEWEST:
        return None
    centred = middles - middles.mean(axis=0)
    spreads, axes = np.linalg.svd(centred, full_matrices=False)[1:]
    length = float(np.ptp(centred @ axes[0]))
    off = float(spreads[1]) / len(middles) ** 0.5
    if length < _FEWEST * step or off > _STRAIGHT * step:
        return None
    return MapTrace(
        along=(float(axes[0, 0]), float(axes[0, 1])),
        sigma=max(off, step / 12**0.5) / float(spreads[0]),
        resolution=step / length,
    )


def _near(middles: FloatArray, ends: FloatArray, reach: float) -> BoolArray:
    """Which middles lie around the one that the line between the ends meets, shape (n,)."""
    line = ends[1] - ends[0]
    share = np.clip((middles - ends[0]) @ line / max(float(line @ line), 1e-12), 0.0, 1.0)
    off = np.linalg.norm(middles - ends[0] - share[:, None] * line, axis=1)
    crossing = middles[int(off.argmin())]
    return np.asarray(np.linalg.norm(middles - crossing, axis=1) <= reach)
