"""From a grain of each square of the measured face to smooth lines between grains.

Lines go through the middles of the sides between squares of two grains, are smoothed along their
length, and are left with as few points as keep within a share of a square (Douglas and Peucker,
1973). Where three grains or more meet, and at the rim of the face, they end at one point.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter1d, label

from meshes.arrays import FloatArray, IntArray

_SMOOTHED = 2.0  # squares, standard deviation along a line
_OFF = 0.5  # of a square, by which a line may be off its smoothed points in any case

Vertex = tuple[int, int]


def without_specks(grain: IntArray, fewest: float) -> IntArray:
    """Return the grains with small regions, and squares of no grain, given to what lies nearest.

    Args:
        grain: of each square, from 0, −1 of none, shape (n_x, n_y).
        fewest: squares of a region that is kept.

    Raises:
        ValueError: nothing is left.
    """
    kept = np.zeros(grain.shape, dtype=bool)
    for k in np.unique(grain[grain >= 0]):
        regions, _ = label(grain == k)
        large = np.flatnonzero(np.bincount(regions.ravel()) >= fewest)
        kept |= np.isin(regions, large[large > 0])
    if not kept.any():
        raise ValueError(
            f"found no grain of {fewest:.3g} pixels or more in one piece, expected larger ones"
        )
    nearest = distance_transform_edt(~kept, return_distances=False, return_indices=True)
    found: IntArray = grain[tuple(nearest)]
    return found


def lines_between(
    grain: IntArray, square: tuple[float, float], off: float
) -> tuple[FloatArray, ...]:
    """Return the lines between grains, in the frame of the squares, whose first corner is 0, 0.

    Args:
        grain: of each square, shape (n_x, n_y).
        square: its sides [µm].
        off: how far a line may be off its smoothed points, with half a square at least [µm].

    Returns:
        points of each line [µm], shapes (n, 2), ends included.
    """
    lines = []
    for chain in _chains(grain):
        corners = np.array(chain, dtype=float)
        middles = (corners[1:] + corners[:-1]) / 2
        smooth = np.array(square) * _smoothed(np.concatenate([corners[:1], middles, corners[-1:]]))
        lines.append(smooth[_few(smooth, max(off, _OFF * max(square)))])
    return tuple(lines)


def _chains(grain: IntArray) -> list[list[Vertex]]:
    """Corners of squares along the sides between two grains, from one end to the other."""
    beside: dict[Vertex, list[Vertex]] = defaultdict(list)
    for axis in range(2):
        first, second = (np.take(grain, range(n, grain.shape[axis] + n - 1), axis) for n in (0, 1))
        for at in np.argwhere(first != second):
            one, other = [int(at[0]), int(at[1])], [int(at[0]), int(at[1])]
            one[axis] += 1
            other[axis] += 1
            other[1 - axis] += 1
            a, b = (one[0], one[1]), (other[0], other[1])
            beside[a].append(b)
            beside[b].append(a)
    left = {(a, b) for a, others in beside.items() for b in others}
    ends = sorted(vertex for vertex, others in beside.items() if len(others) != 2)
    chains = []
    # A line that comes back to itself, round a grain inside another, is cut at any corner.
    for start in (*ends, *sorted(beside)):
        for step in beside[start]:
            if (start, step) in left:
                chains.append(_followed(start, step, beside, left, set(ends)))
    return chains


def _followed(
    start: Vertex,
    step: Vertex,
    beside: dict[Vertex, list[Vertex]],
    left: set[tuple[Vertex, Vertex]],
    ends: set[Vertex],
) -> list[Vertex]:
    chain = [start]
    here, ahead = start, step
    while True:
        left -= {(here, ahead), (ahead, here)}
        chain.append(ahead)
        if ahead in ends or ahead == start:
            return chain
        (following,) = (vertex for vertex in beside[ahead] if vertex != here)
        here, ahead = ahead, following


def _smoothed(points: FloatArray) -> FloatArray:
    """Return a line smoothed along its length, mirrored through its ends, which stay."""
    n = len(points) - 1
    before, after = 2 * points[0] - points[:0:-1], 2 * points[-1] - points[-2::-1]
    whole = gaussian_filter1d(np.concatenate([before, points, after]), _SMOOTHED, axis=0)
    smooth: FloatArray = whole[n : 2 * n + 1]
    smooth[[0, -1]] = points[[0, -1]]
    return smooth


def _few(points: FloatArray, off: float) -> IntArray:
    """Return the points that a line needs, ends included; of a closed one four at least."""
    if np.array_equal(points[0], points[-1]):
        cuts = np.linspace(0, len(points) - 1, 5).round().astype(int)
    else:
        cuts = np.array([0, len(points) - 1])
    kept = set(cuts.tolist())
    parts = list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        along = points[last] - points[first]
        from_first = points[first + 1 : last] - points[first]
        across = np.abs(from_first[:, 0] * along[1] - from_first[:, 1] * along[0])
        across /= max(float(np.linalg.norm(along)), 1e-12)
        if across.max() > off:
            middle = first + 1 + int(np.argmax(across))
            kept.add(middle)
            parts += [(first, middle), (middle, last)]
    return np.array(sorted(kept))
