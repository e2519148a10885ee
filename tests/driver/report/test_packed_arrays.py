import base64
import gzip

import numpy as np
import pytest

from driver.report.packed_arrays import pack, unpack


def test_packed_arrays_are_read_back_to_half_a_step_and_none_stays_none() -> None:
    rng = np.random.default_rng(0)
    field = rng.normal(0.0, 50.0, (3, 4, 5))
    field[1, 2, 3] = np.nan
    packed = pack({"first": (np.arange(7.0), 1.0), "field": (field, 0.05)})
    found = unpack(packed)
    assert np.array_equal(found["first"], np.arange(7.0))
    assert np.array_equal(np.isnan(found["field"]), np.isnan(field))
    assert np.nanmax(np.abs(found["field"] - field)) <= 0.025 + 1e-9


def test_the_step_grows_where_two_bytes_would_not_hold_the_largest_value() -> None:
    packed = pack({"wide": (np.array([1e6, -1e6, 0.0]), 0.05)})
    assert packed.entries["wide"]["step"] == pytest.approx(1e6 / 32767)
    assert unpack(packed)["wide"] == pytest.approx([1e6, -1e6, 0.0])


def test_low_bytes_stand_before_high_ones() -> None:
    content = gzip.decompress(base64.b64decode(pack({"a": (np.array([1.0, 258.0]), 1.0)}).text))
    assert content == bytes([1, 2, 0, 1])
