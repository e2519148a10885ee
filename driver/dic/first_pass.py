"""A first, stiff motion of every frame of a series, from one frame to the next."""

from __future__ import annotations

import numpy as np

from driver.dic.engine import COARSE
from driver.dic.jump import Trail
from driver.dic.kernels import binned
from driver.dic.pyramid import LEFT, Starter
from driver.dic.surface_images import SurfaceImages
from driver.dic.system import End, System
from meshes.arrays import BoolArray, FloatArray

_NOISY = 1.5  # residual of a frame that was followed over its noise: a stiff motion leaves some
_TURN = np.pi / 4  # of a specimen between its grips, at most


def first_pass(images: SurfaceImages, system: System) -> FloatArray:
    """Each frame from where one before it ended that was followed.

    A frame that this leaves unlike the reference, beyond what noise makes, is sought by itself:
    by smaller copies, shifts to anywhere in the frame and turns (`Starter.follow`). One that seems
    to have turned further than a specimen does was saved otherwise than the others, and is not
    followed.

    Args:
        images: the series.
        system: stiff, weighed.

    Returns:
        Nodal values [µm], shape (T, n).
    """
    box = images.box()
    starts = np.zeros((images.n_frames, system.size))
    trail = Trail(system, binned(images.reference_image[box], 2), 2 * images.pixel)
    # Where noise rivals the relief it leaves as much of it wherever a frame is sought.
    noise = images.sigma * np.sqrt(1 + 1 / images.n_reference)
    most = max(LEFT * float(np.std(system.pixels.height)), _NOISY * float(noise))
    alone: Starter | None = None
    for t in range(images.n_frames):
        spline = images.frames.coefficients[t]
        small = binned(images.sampled(spline, box), 2)
        end = system.iterate(spline, trail.start(small, spline), COARSE)
        if end.reason != "converged" or _left(end) > most:
            alone = alone or Starter.build(images.reference_image, _region(images))
            again = system.iterate(spline, _sought(images, system, alone, spline), COARSE)
            found = _left(again) <= min(_left(end), most)
            end = again if found and abs(system.turn_of(again.p)) < _TURN else end
        starts[t] = end.p
        # A frame that was not followed would lead astray all that come after it.
        if end.reason == "converged":
            trail.add(small, end.p)
    return starts


def _sought(
    images: SurfaceImages, system: System, alone: Starter, spline: FloatArray
) -> FloatArray:
    """Return where a frame lies by itself, nodal values [µm], shape (n,)."""
    rows, cols = images.shape
    whole = images.sampled(spline, (slice(0, rows), slice(0, cols)))
    nodes_uv, nodes_w = (
        basis.nodes / images.pixel + images.frames.origin
        for basis in (system.basis_uv, system.basis_w)
    )
    start: FloatArray = alone.follow([whole], nodes_uv, nodes_w)[0]
    start[: 2 * len(nodes_uv)] *= images.pixel
    return start


def _region(images: SurfaceImages) -> BoolArray:
    region = np.zeros(images.shape, dtype=bool)
    region[images.rows, images.cols] = True
    return region


def _left(end: End) -> float:
    """Return the standard deviation of ρ, infinite where most pixels have left the frame."""
    seen = end.residual[np.isfinite(end.residual)]
    return float(np.std(seen)) if 2 * seen.size > end.residual.size else np.inf
