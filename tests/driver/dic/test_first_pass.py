"""What the first pass hands from frame to frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import driver.dic.first_pass as of_frames
from driver.dic.series import measure
from meshes.arrays import FloatArray
from tests.driver.dic.conftest import PIXEL, Scene, constant

STILL = constant(0.0)


def test_a_large_jump_of_the_stage_between_two_frames_is_followed(scene: Scene) -> None:
    jumps = [(constant(a * PIXEL), constant(b * PIXEL), constant(c))
             for a, b, c in ((3.3, -2.6, 0.1), (-3.1, 3.4, -0.08))]  # fmt: skip
    measured = measure(scene(jumps, noise=0.003))
    mean = measured.at_pixels().mean(axis=1)
    assert measured.converged.all() and measured.chi.max() < 1.1
    assert mean[:, 0] / PIXEL == pytest.approx([3.3, -3.1], abs=0.02)
    assert mean[:, 1] / PIXEL == pytest.approx([-2.6, 3.4], abs=0.02)


def test_a_frame_of_another_surface_leads_no_other_astray(scene: Scene) -> None:
    shifts = [(constant(k * 0.2 * PIXEL), STILL, STILL) for k in range(6)]
    images = scene(shifts, noise=0.003)
    frames = np.array(images.frames.coefficients)
    frames[2] = frames[2, ::-1, ::-1]
    spoilt = measure(replace(images, frames=replace(images.frames, coefficients=frames)))
    others = np.arange(6) != 2
    assert spoilt.converged[others].all() and not spoilt.lost[others].any()
    assert spoilt.chi[others].max() < 1.1 and spoilt.chi[2] > 2
    mean = spoilt.at_pixels()[others, :, 0].mean(axis=1) / PIXEL
    assert mean == pytest.approx(0.2 * np.flatnonzero(others), abs=0.02)


def test_a_bad_frame_leaves_the_others_as_exact_as_they_were(scene: Scene) -> None:
    shifts = [(constant(k * 0.2 * PIXEL), STILL, STILL) for k in range(6)]
    images = scene(shifts, noise=0.009)
    frames = np.array(images.frames.coefficients)
    frames[2] = frames[2, ::-1, ::-1]
    series = replace(images, frames=replace(images.frames, coefficients=frames))
    good, spoilt = (measure(some, roughness="estimated") for some in (images, series))
    n = 2 * len(good.basis_uv.nodes)
    variance = spoilt.covariance_one.diagonal()[:n] / good.covariance_one.diagonal()[:n]
    # A frame that had a say in the roughness made it 14.
    assert np.median(variance) == pytest.approx(1.0, abs=0.2)


def test_frames_whose_noise_rivals_the_relief_are_not_sought_one_by_one(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A search by turns and shifts takes ten times as long, and nothing else leaves less."""
    shifts = [(constant(k * 0.2 * PIXEL), STILL, STILL) for k in range(4)]
    relief = float(np.std(scene(shifts, noise=0.003).reference))
    images = scene(shifts, noise=0.6 * relief)
    sought: list[FloatArray] = []
    whole = of_frames._sought

    def seen(*series: Any) -> FloatArray:
        sought.append(whole(*series))
        return sought[-1]

    monkeypatch.setattr(of_frames, "_sought", seen)
    measured = measure(images)
    assert not sought and measured.converged.all()
    # One that shows another surface still is.
    frames = np.array(images.frames.coefficients)
    frames[2] = 3 * frames[2, ::-1, ::-1]
    measure(replace(images, frames=replace(images.frames, coefficients=frames)))
    assert len(sought) == 1
