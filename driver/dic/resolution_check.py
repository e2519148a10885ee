"""How many nodal values a correlation may ask for."""

from __future__ import annotations

from driver.experiment.images.heightmaps import ImageError

LARGEST = 5000  # nodal values, whose covariance takes 200 MB


def refuse_too_fine(n_pix: int, n_uv: int, n_w: int) -> None:
    """Refuse elements that are too small for the pixels or for the memory.

    Args:
        n_pix: pixels of the region of interest.
        n_uv: nodes of u and of v.
        n_w: nodes of w.

    Raises:
        ImageError: the nodal values are more than half of the pixels, or more than `LARGEST`.
    """
    unknowns = 2 * n_uv + n_w
    if 2 * unknowns > n_pix:
        raise ImageError(
            f"dic.element_px: found {unknowns} nodal values to be decided by {n_pix} pixels of the "
            "face, expected at most half as many: larger elements (height_element_px for the "
            "heights, mesh and height_mesh where they are given), or a face of more pixels "
            "(images.pixel_size_nm, origin_pixel, mask)"
        )
    if unknowns > LARGEST:
        raise ImageError(
            f"dic.element_px: found {unknowns} nodal values of u, v and w, expected at most "
            f"{LARGEST}: larger elements (height_element_px for the heights, mesh and height_mesh "
            "where they are given)"
        )
