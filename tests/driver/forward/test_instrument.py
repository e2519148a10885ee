from __future__ import annotations

import numpy as np
import pytest

from driver.forward.instrument import Instrument
from driver.parameters.instrument import IMAGE_DECLARATIONS, LOAD_DECLARATIONS

NULL = {p.name: p.null for p in (*LOAD_DECLARATIONS, *IMAGE_DECLARATIONS)}
OFF = {
    "load_gain": 0.1, "load_offset": 12.0, "load_drift": -7.0, "load_lag": 2.0, "height_scale": 0.2,
    "magnification_drift": 0.01, "scan_shear_drift": -0.02, "tilt_drift": 0.03,
    "height_drift": 0.04,
}  # fmt: skip
RNG = np.random.default_rng(2)
FORCE = RNG.normal(100, 50, 4)
RATE = np.array([3.0, -1.0, 0.5, 0.0])
MOTION = RNG.normal(0, 0.1, (4, 6, 3))


@pytest.fixture(scope="module")
def instrument() -> Instrument:
    xy = np.array([[-1.0, 0], [1, 0], [-1, 4], [1, 4], [0, 2], [0.5, 3]])
    return Instrument(xy, np.array([0.0, 0.3, 0.5, 1.0]), (0.0, 2.0))


def test_a_perfect_instrument_changes_not_a_bit(instrument: Instrument) -> None:
    assert np.array_equal(instrument.reading(FORCE, NULL), FORCE)
    assert np.array_equal(instrument.appearance(MOTION, NULL), MOTION)


def test_the_motion_handed_in_is_left_alone(instrument: Instrument) -> None:
    before = MOTION.copy()
    instrument.appearance(MOTION, OFF)
    instrument.appearance_derivative("height_scale", MOTION)
    assert np.array_equal(MOTION, before)


@pytest.mark.parametrize("name", [p.name for p in LOAD_DECLARATIONS])
def test_the_derivative_of_the_reading(instrument: Instrument, name: str) -> None:
    h = 1e-4
    above, below = (instrument.reading(FORCE, OFF | {name: OFF[name] + s}) for s in (h, -h))
    if name == "load_lag":  # the force is another one then
        above, below = (instrument.reading(FORCE + s * RATE, OFF) for s in (h, -h))
    derivative = instrument.reading_derivative(name, FORCE, RATE, OFF)
    np.testing.assert_allclose(derivative, (above - below) / (2 * h), rtol=1e-9)


@pytest.mark.parametrize("name", [p.name for p in IMAGE_DECLARATIONS])
def test_the_derivative_of_the_appearance(instrument: Instrument, name: str) -> None:
    h = 1e-4
    above, below = (instrument.appearance(MOTION, OFF | {name: OFF[name] + s}) for s in (h, -h))
    derivative = instrument.appearance_derivative(name, MOTION)
    np.testing.assert_allclose(derivative, (above - below) / (2 * h), atol=1e-12)


def test_drifts_grow_from_nothing_about_the_centre(instrument: Instrument) -> None:
    drifted = NULL | {"magnification_drift": 0.01, "tilt_drift": 0.02}
    seen = instrument.appearance(np.zeros_like(MOTION), drifted)
    np.testing.assert_array_equal(seen[0], 0.0)
    np.testing.assert_array_equal(seen[:, 4], 0.0)  # the node at the centre
    # The corner (1, 4) is (1, 2) µm from the centre; the field tilts across the specimen.
    np.testing.assert_allclose(seen[3, 3], [0.01, 0.02, 0.02], atol=1e-15)
    np.testing.assert_allclose(seen[2], 0.5 * seen[3])


def test_the_load_reads_gain_offset_and_drift(instrument: Instrument) -> None:
    off = NULL | {"load_gain": 0.1, "load_offset": 12.0, "load_drift": -7.0}
    np.testing.assert_allclose(
        instrument.reading(np.full(4, 100.0), off), [122.0, 119.9, 118.5, 115.0]
    )
