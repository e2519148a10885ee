"""The measured face for ParaView: pixels as points, motions and residuals as fields over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import meshio
import numpy as np

from driver.results.files import SURFACE_FRAMES, SURFACE_SERIES, surface_frame
from driver.results.reader import FittedModel
from meshes.arrays import FloatArray, IntArray


def write_surface(
    folder: Path,
    measured: Mapping[str, FloatArray],
    models: Sequence[FittedModel],
    rigid: bool,
) -> None:
    """Write the measured face as a time series, one VTU file an image and a PVD over all.

    The pixels of the region of interest are the points, at Z = 0; squares of four are the cells.

    Args:
        folder: where to write `surface.pvd` and the folder `surface`.
        measured: the results of the correlation by name.
        models: the fitted models.
        rigid: whether rotations of each image are taken off the measured motion, too.
    """
    xy, rows, cols = measured["xy"], measured["rows"], measured["cols"]
    moved, _ = aligned(measured["motion"], models[0].motion, xy, rigid)
    height = measured["reference"][rows.astype(int), cols.astype(int)]
    points = np.column_stack([xy, np.zeros(len(xy))])
    cells = [("quad", pixel_squares(rows.astype(int), cols.astype(int)))]
    (folder / SURFACE_FRAMES).mkdir()
    names = [surface_frame(t) for t in range(len(moved))]
    for t, name in enumerate(names):
        fields = {"height_um": height, "motion_measured_um": moved[t]}
        for model in models:
            fields[f"motion_{model.label}_um"] = model.motion[t]
            fields[f"residual_{model.label}_nm"] = 1e3 * model.rho[t]
        fields = {key: np.asarray(value, dtype=np.float32) for key, value in fields.items()}
        meshio.Mesh(points, cells, point_data=fields).write(folder / name, file_format="vtu")
    sets = "".join(
        f'    <DataSet timestep="{time:.12g}" group="" part="0" file="{name}"/>\n'
        for time, name in zip(measured["time"], names, strict=True)
    )
    (folder / SURFACE_SERIES).write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        f"{sets}  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )


def pixel_squares(rows: IntArray, cols: IntArray) -> IntArray:
    """Squares of four neighbouring pixels, anticlockwise seen from +Z, shape (n_squares, 4).

    Args:
        rows: row of each pixel (along +X), shape (n_pix,).
        cols: column of each pixel (along +Y), shape (n_pix,).
    """
    index = np.full((rows.max() + 1, cols.max() + 1), -1, dtype=np.int64)
    index[rows, cols] = np.arange(rows.size)
    corners = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    squares = np.stack([corner.ravel() for corner in corners], axis=1)
    return np.asarray(squares[(squares >= 0).all(axis=1)])


def aligned(
    motion: FloatArray, onto: FloatArray, xy: FloatArray, rigid: bool
) -> tuple[FloatArray, FloatArray]:
    """Return a motion less the rigid motion that parts it from another one, by least squares.

    The stage re-centres and refocuses between the images, so a rigid motion of each image is
    unknown, and no part of what a model predicts.

    Args:
        motion: measured motion [µm], shape (T, n_pix, 3).
        onto: predicted motion [µm], shape (T, n_pix, 3).
        xy: X, Y of the pixels [µm], shape (n_pix, 2).
        rigid: whether to remove small rotations beside the translation.

    Returns:
        the motion [µm], and what was removed: translation along X, Y, Z [µm], with `rigid` then
        ∂v/∂X = −∂u/∂Y, ∂w/∂X, ∂w/∂Y [-], shape (T, 3) or (T, 6).
    """
    modes = np.zeros((6 if rigid else 3, len(xy), 3))
    modes[[0, 1, 2], :, [0, 1, 2]] = 1.0
    if rigid:
        x, y = (xy - xy.mean(axis=0)).T
        modes[3, :, 0], modes[3, :, 1] = -y, x
        modes[4, :, 2], modes[5, :, 2] = x, y
    columns = modes.reshape(len(modes), -1).T
    difference = (motion - onto).reshape(len(motion), -1)
    removed: FloatArray = np.asarray(np.linalg.lstsq(columns, difference.T)[0].T, dtype=np.float64)
    return motion - np.einsum("tm,mpc->tpc", removed, modes), removed
