"""Causes that enter the covariance of the data: levels of noise, and no parameters of the model."""

from __future__ import annotations

from driver.diagnosis.causes.causes import Cause
from driver.parameters.covariance import NOISE_RATIO, SIGMA_E

BOUNDARY_NOISE = Cause(
    "boundary_noise", "boundary", (SIGMA_E.name,),
    "the elongation at the stop of each image scatters about the stage travel",
    "repeated stops at the same stage travel, read by correlation of the rim or a second gauge",
    one_sided=True, label="noise of the boundary motion",
    unseen="too few fast loads tell it from noise of the loads",
)  # fmt: skip

NOISE_NOT_UNIFORM = Cause(
    "noise_not_uniform", "instrument", (NOISE_RATIO.name,),
    "the noise of the images differs from pixel to pixel, with the slope or over the field",
    "the scatter of repeated images pixel by pixel, at several heights of focus",
    one_sided=True, label="uneven noise of the images",
)  # fmt: skip

COVARIANCE: tuple[Cause, ...] = (BOUNDARY_NOISE, NOISE_NOT_UNIFORM)
"""Causes that enter the covariance of the data, each by a level of noise."""
