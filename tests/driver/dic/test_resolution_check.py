"""What is refused before it is correlated."""

from __future__ import annotations

import pytest

from driver.dic.resolution_check import refuse_too_fine
from driver.experiment.images.heightmaps import ImageError


def test_more_nodal_values_than_half_of_the_pixels_are_refused() -> None:
    refuse_too_fine(n_pix=800, n_uv=100, n_w=200)
    with pytest.raises(ImageError, match="found 400 nodal values to be decided by 799 pixels"):
        refuse_too_fine(n_pix=799, n_uv=100, n_w=200)


def test_more_nodal_values_than_their_covariance_has_room_for_are_refused() -> None:
    refuse_too_fine(n_pix=10**6, n_uv=1000, n_w=3000)
    with pytest.raises(ImageError, match="found 5001 nodal values of u, v and w, expected at most"):
        refuse_too_fine(n_pix=10**6, n_uv=1000, n_w=3001)
