from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.region import Excluded, region_codes

VALID = np.ones((20, 30), bool)


def test_every_pixel_has_the_reason_why_it_is_not_used() -> None:
    valid, mask = VALID.copy(), VALID.copy()
    valid[:, 20] = False
    mask[:, :12] = False
    codes = region_codes(valid, 0.5, (10.0, 5.0), (-2.0, 2.0, 1.0, 10.0), mask)
    inside = codes[6:15]  # X from −2 to 2 µm
    assert (codes[:6] == Excluded.OUTSIDE).all() and (codes[15:] == Excluded.OUTSIDE).all()
    assert (inside[:, :7] == Excluded.OUTSIDE).all()  # Y below 1 µm
    assert (inside[:, 7:12] == Excluded.MASK).all()
    assert (inside[:, 12:18] == Excluded.USED).all()
    assert (inside[:, 18:23] == Excluded.TRENCH).all()  # within two pixels of it
    assert (inside[:, 23:26] == Excluded.USED).all() and (inside[:, 26:] == 4).all()


def test_a_face_of_which_nothing_is_left_is_refused_with_the_field_of_view() -> None:
    with pytest.raises(ImageError, match=r"field of view \(X -5 to 4.5, Y -2.5 to 12 µm\)"):
        region_codes(VALID, 0.5, (10.0, 5.0), (90.0, 91.0, 1.0, 10.0))
    with pytest.raises(ImageError, match=r"^images\.origin_pixel: found no pixel of the face"):
        region_codes(VALID, 0.5, (10.0, 5.0), (-2.0, 2.0, 1.0, 10.0), ~VALID)
