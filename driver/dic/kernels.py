"""The loops over pixels: residual, right-hand side, Hessian, places in a grid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit

from meshes.arrays import FloatArray, IntArray
from solver_adapters.kernels import compiled

# NaN has to stay NaN: it marks what was not measured.
_compiled = compiled(
    nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"}
)

# Without contraction: the same to the last bit on every machine.
_exact = compiled(nogil=True, error_model="numpy")

Function = TypeVar("Function", bound=Callable[..., Any])


def _inlined(function: Function) -> Function:
    """Compiled into its caller, whose constants it then knows."""
    return cast(Function, njit(inline="always")(function))


@_inlined
def _cubic(t: float) -> tuple[float, float, float, float]:
    """Cubic B-splines of the four pixels around a place, t beyond the second of them."""
    first, last = (1 - t) ** 3 / 6, t**3 / 6
    second = 2 / 3 - t * t * (1 - 0.5 * t)
    return first, second, 1 - first - second - last, last


MAX_PARTNERS = 32
TOGETHER = 64  # pixels of a pair whose products are summed at a time


@_compiled
def grid_places(
    points: FloatArray, bounds: FloatArray, cells: tuple[int, int]
) -> tuple[IntArray, FloatArray, int]:
    """Cell of each point of a regular grid and its four bilinear functions there.

    Args:
        points: X, Y, shape (n, 2).
        bounds: x0, x1, y0, y1.
        cells: number of elements along X and Y, numbered fastest along Y.

    Returns:
        cells (n,); functions of the corners (−−, +−, ++, −+), (n, 4); the first point outside
        the bounds by more than rounding, or −1.
    """
    n = len(points)
    cell = np.empty(n, np.int64)
    shape = np.empty((n, 4))
    outside = -1
    per_x, per_y = cells[0] / (bounds[1] - bounds[0]), cells[1] / (bounds[3] - bounds[2])
    for k in range(n):
        x, y = (points[k, 0] - bounds[0]) * per_x, (points[k, 1] - bounds[2]) * per_y
        if outside < 0 and not (-1e-9 <= x <= cells[0] + 1e-9 and -1e-9 <= y <= cells[1] + 1e-9):
            outside = k
        i, j = min(max(int(x), 0), cells[0] - 1), min(max(int(y), 0), cells[1] - 1)
        s, t = x - i, y - j
        cell[k] = i * cells[1] + j
        shape[k, 0] = (1 - s) * (1 - t)
        shape[k, 1] = s * (1 - t)
        shape[k, 2] = s * t
        shape[k, 3] = (1 - s) * t
    return cell, shape, outside


@_exact
def motion_of(
    cells_uv: IntArray,
    cell_uv: IntArray,
    shape_uv: FloatArray,
    cells_w: IntArray,
    cell_w: IntArray,
    shape_w: FloatArray,
    p: FloatArray,
    n_uv: int,
) -> FloatArray:
    """u, v, w at the pixels for columns p of nodal values (size, T), shape (3, n, T).

    The other arguments are those of `residual_and_right_side`.
    """
    n_images = p.shape[1]
    motion = np.zeros((3, len(cell_uv), n_images))
    if n_images == 1:  # sums that need not be kept: the same ones, in half of the time
        for k in range(len(cell_uv)):
            u, v, w = 0.0, 0.0, 0.0
            for a in range(shape_uv.shape[1]):
                node, value = cells_uv[cell_uv[k], a], shape_uv[k, a]
                u += value * p[node, 0]
                v += value * p[n_uv + node, 0]
            for a in range(shape_w.shape[1]):
                w += shape_w[k, a] * p[2 * n_uv + cells_w[cell_w[k], a], 0]
            motion[0, k, 0], motion[1, k, 0], motion[2, k, 0] = u, v, w
        return motion
    for k in range(len(cell_uv)):
        for a in range(shape_uv.shape[1]):
            node, value = cells_uv[cell_uv[k], a], shape_uv[k, a]
            for t in range(n_images):
                motion[0, k, t] += value * p[node, t]
                motion[1, k, t] += value * p[n_uv + node, t]
        for a in range(shape_w.shape[1]):
            node, value = 2 * n_uv + cells_w[cell_w[k], a], shape_w[k, a]
            for t in range(n_images):
                motion[2, k, t] += value * p[node, t]
    return motion


@_compiled
def _mirrored(k: int, n: int) -> int:
    if n == 1:
        return 0
    k = abs(k) % (2 * n - 2)
    return k if k < n else 2 * n - 2 - k


@_inlined
def _residual_and_right_side(
    m: int,
    q: int,
    image: FloatArray,
    rows: FloatArray,
    cols: FloatArray,
    per_pixel: float,
    height: FloatArray,
    slope: FloatArray,
    cells_uv: IntArray,
    cell_uv: IntArray,
    shape_uv: FloatArray,
    cells_w: IntArray,
    cell_w: IntArray,
    shape_w: FloatArray,
    p: FloatArray,
    n_uv: int,
    residual: FloatArray,
    right: FloatArray,
) -> int:
    n_rows, n_cols = image.shape
    right[:] = 0.0
    used = 0
    # What pixels in a row share that lie in the same cells is fetched, and added, once for all.
    own, told = np.empty(2 * m + q), np.empty(2 * m + q)
    end = 0
    while end < len(rows):
        first, cu, cw = end, cell_uv[end], cell_w[end]
        while end < len(rows) and cell_uv[end] == cu and cell_w[end] == cw:
            end += 1
        for a in range(m):
            node = cells_uv[cu, a]
            own[a], own[m + a] = p[node] * per_pixel, p[n_uv + node] * per_pixel
        for a in range(q):
            own[2 * m + a] = p[2 * n_uv + cells_w[cw, a]]
        told[:] = 0.0
        for k in range(first, end):
            y, x, w = rows[k], cols[k], 0.0
            for a in range(m):
                y += shape_uv[k, a] * own[a]
                x += shape_uv[k, a] * own[m + a]
            for a in range(q):
                w += shape_w[k, a] * own[2 * m + a]
            if not (-0.5 <= y <= n_rows - 0.5 and -0.5 <= x <= n_cols - 0.5):
                residual[k] = np.nan
                continue
            r, c = int(np.floor(y)), int(np.floor(x))
            a0, a1, a2, a3 = _cubic(y - r)
            b0, b1, b2, b3 = _cubic(x - c)
            if 1 <= r < n_rows - 2 and 1 <= c < n_cols - 2:
                g = 0.0
                for j in range(4):
                    line = (
                        a0 * image[r - 1, c - 1 + j]
                        + a1 * image[r, c - 1 + j]
                        + a2 * image[r + 1, c - 1 + j]
                        + a3 * image[r + 2, c - 1 + j]
                    )
                    g += (b0 if j == 0 else b1 if j == 1 else b2 if j == 2 else b3) * line
            else:
                g = 0.0
                for j in range(4):
                    at = _mirrored(c - 1 + j, n_cols)
                    line = (
                        a0 * image[_mirrored(r - 1, n_rows), at]
                        + a1 * image[_mirrored(r, n_rows), at]
                        + a2 * image[_mirrored(r + 1, n_rows), at]
                        + a3 * image[_mirrored(r + 2, n_rows), at]
                    )
                    g += (b0 if j == 0 else b1 if j == 1 else b2 if j == 2 else b3) * line
            rho = height[k] + w - g
            residual[k] = rho
            if rho != rho:
                continue
            used += 1
            gx, gy = slope[k, 0] * rho, slope[k, 1] * rho
            for a in range(m):
                told[a] += shape_uv[k, a] * gx
                told[m + a] += shape_uv[k, a] * gy
            for a in range(q):
                told[2 * m + a] += shape_w[k, a] * rho
        for a in range(m):
            node = cells_uv[cu, a]
            right[node] += told[a]
            right[n_uv + node] += told[m + a]
        for a in range(q):
            right[2 * n_uv + cells_w[cw, a]] -= told[2 * m + a]
    return used


@_compiled
def residual_and_right_side(
    image: FloatArray,
    rows: FloatArray,
    cols: FloatArray,
    per_pixel: float,
    height: FloatArray,
    slope: FloatArray,
    cells_uv: IntArray,
    cell_uv: IntArray,
    shape_uv: FloatArray,
    cells_w: IntArray,
    cell_w: IntArray,
    shape_w: FloatArray,
    p: FloatArray,
    n_uv: int,
    residual: FloatArray,
    right: FloatArray,
) -> int:
    """ρ = f + w − g(x + u) and b = Σ (∇f·ψ) ρ of one image at the nodal values p.

    A pixel that leaves the image, or meets a NaN among its spline coefficients, has the residual
    NaN and adds nothing to b.

    Args:
        image: cubic B-spline coefficients of g, shape (n_rows, n_cols).
        rows: place of each pixel in the image [px], (n,).
        cols: the same along the columns, (n,).
        per_pixel: pixels to one unit of u.
        height: f, (n,).
        slope: ∂f/∂X, ∂f/∂Y, (n, 2).
        cells_uv: nodes of the cells of u and v, (n_cells, m).
        cell_uv: cell of each pixel, (n,).
        shape_uv: its functions at the pixel, (n, m).
        cells_w: nodes of the cells of w.
        cell_w: cell of w of each pixel.
        shape_w: its functions at the pixel.
        p: nodal values [u | v | w].
        n_uv: nodes of u.
        residual: ρ, written, (n,).
        right: b, written, (len(p),).

    Returns:
        The number of pixels used.
    """
    m, q = shape_uv.shape[1], shape_w.shape[1]
    # With the numbers of nodes known to the compiler the loops over them vanish.
    if m == 4 and q == 4:
        return _residual_and_right_side(
            4, 4, image, rows, cols, per_pixel, height, slope, cells_uv, cell_uv, shape_uv,
            cells_w, cell_w, shape_w, p, n_uv, residual, right,
        )  # fmt: skip
    return _residual_and_right_side(
        m, q, image, rows, cols, per_pixel, height, slope, cells_uv, cell_uv, shape_uv,
        cells_w, cell_w, shape_w, p, n_uv, residual, right,
    )  # fmt: skip


@_compiled
def cell_pairs(cell_uv: IntArray, cell_w: IntArray, n_w: int) -> tuple[IntArray, IntArray, int]:
    """Count the pairs (cell of u, cell of w) that share a pixel.

    Returns:
        pair of each pixel (n,); a pixel of each pair, (n,) of which the first n_pairs count;
        n_pairs, or −1 if a cell of w meets more than 32 cells of u.
    """
    partner = np.full((n_w, MAX_PARTNERS), -1)
    name = np.empty((n_w, MAX_PARTNERS), np.int64)
    pair = np.empty(len(cell_uv), np.int64)
    sample = np.empty(len(cell_uv), np.int64)
    count = 0
    for k in range(len(cell_uv)):
        u, w = cell_uv[k], cell_w[k]
        j = 0
        while j < MAX_PARTNERS and partner[w, j] != u and partner[w, j] >= 0:
            j += 1
        if j == MAX_PARTNERS:
            return pair, sample, -1
        if partner[w, j] < 0:
            partner[w, j], name[w, j] = u, count
            sample[count] = k
            count += 1
        pair[k] = name[w, j]
    return pair, sample, count


@_inlined
def _pair_hessians(
    m: int,
    q: int,
    pair: IntArray,
    n_pairs: int,
    slope: FloatArray,
    shape_uv: FloatArray,
    shape_w: FloatArray,
) -> FloatArray:
    size = 2 * m + q
    blocks = np.zeros((n_pairs, size * (size + 1) // 2))
    first = np.zeros(n_pairs + 1, np.int64)
    for k in range(len(pair)):
        first[pair[k] + 1] += 1
    first = np.cumsum(first)
    member, fill = np.empty(len(pair), np.int64), first[:-1].copy()
    for k in range(len(pair)):
        member[fill[pair[k]]] = k
        fill[pair[k]] += 1
    # Functions of some pixels of a pair, one after the other: their products are sums along lines.
    lines = np.empty((size, TOGETHER))
    for which in range(n_pairs):
        for start in range(first[which], first[which + 1], TOGETHER):
            some = min(TOGETHER, first[which + 1] - start)
            for i in range(some):
                k = member[start + i]
                for a in range(m):
                    lines[a, i] = slope[k, 0] * shape_uv[k, a]
                    lines[m + a, i] = slope[k, 1] * shape_uv[k, a]
                for a in range(q):
                    lines[2 * m + a, i] = -shape_w[k, a]
            at = 0
            for a in range(size):
                for b in range(a + 1):
                    total = 0.0
                    for i in range(some):
                        total += lines[a, i] * lines[b, i]
                    blocks[which, at] += total
                    at += 1
    return blocks


@_compiled
def pair_hessians(
    pair: IntArray, n_pairs: int, slope: FloatArray, shape_uv: FloatArray, shape_w: FloatArray
) -> FloatArray:
    """Lower triangles of Σ (∇f·ψ_i)(∇f·ψ_j) over the pixels of each pair of cells, packed by rows.

    Returns:
        Shape (n_pairs, k (k + 1) / 2) with k = 2 · nodes of a cell of u + nodes of a cell of w.
    """
    m, q = shape_uv.shape[1], shape_w.shape[1]
    if m == 4 and q == 4:
        return _pair_hessians(4, 4, pair, n_pairs, slope, shape_uv, shape_w)
    return _pair_hessians(m, q, pair, n_pairs, slope, shape_uv, shape_w)


@_compiled
def shares(cells: IntArray, cell: IntArray, shape: FloatArray, n: int) -> FloatArray:
    """Sum over the pixels what each function has there, signs left out, shape (n,).

    Args:
        cells: nodes of the cells, (n_cells, m).
        cell: cell of each pixel, (n_pix,).
        shape: its functions at the pixel, (n_pix, m).
        n: number of functions.
    """
    total = np.zeros(n)
    for k in range(len(cell)):
        for a in range(shape.shape[1]):
            total[cells[cell[k], a]] += abs(shape[k, a])
    return total


@_compiled
def spread(places: FloatArray, values: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return the transpose of cubic B-spline interpolation without its filter, over the pixels.

    Args:
        places: where the values stand, row and column [px], (n, 2); those whose four by four pixels
            are not all there are left out.
        values: what is spread, (n,).
        shape: rows and columns of the pixels.
    """
    total = np.zeros(shape)
    for k in range(len(values)):
        r, c = int(np.floor(places[k, 0])), int(np.floor(places[k, 1]))
        if r < 1 or c < 1 or r + 2 >= shape[0] or c + 2 >= shape[1]:
            continue
        t, s = places[k, 0] - r, places[k, 1] - c
        a0, a1, a2, a3 = _cubic(t)
        b0, b1, b2, b3 = _cubic(s)
        for i in range(4):
            along = values[k] * (a0 if i == 0 else a1 if i == 1 else a2 if i == 2 else a3)
            total[r - 1 + i, c - 1] += along * b0
            total[r - 1 + i, c] += along * b1
            total[r - 1 + i, c + 1] += along * b2
            total[r - 1 + i, c + 2] += along * b3
    return total


@_compiled
def binned(image: FloatArray, scale: int) -> FloatArray:
    """Means over squares of `scale` pixels; what is left at the far borders is dropped."""
    rows, cols = image.shape[0] // scale, image.shape[1] // scale
    means = np.zeros((rows, cols))
    for i in range(rows * scale):
        for j in range(cols):
            total = 0.0
            for k in range(scale):
                total += image[i, j * scale + k]
            means[i // scale, j] += total
    return means / (scale * scale)
