"""Causes that enter the covariance of the data: levels of noise, and no parameters of the model."""

from __future__ import annotations

from driver.diagnosis.causes.causes import Cause
from solver_adapters.parameter import NANOMETRES, Parameter

BOUNDARY_NOISE = Cause(
    "boundary_noise", "boundary", ("sigma_e",),
    "the elongation at the stop of each image scatters about the stage travel",
    "repeated stops at the same stage travel, read by correlation of the rim or a second gauge",
    one_sided=True, label="noise of the boundary motion",
    unseen="too few fast loads tell it from noise of the loads",
)  # fmt: skip
SIGMA_E = Parameter(
    "sigma_e", "µm", 0.0, 3e-4, 0.0, enters="covariance", label="σ_e, noise of the elongation",
    read_in=NANOMETRES,
)  # fmt: skip
"""Standard deviation of the elongation at a stop; its scale is that of a good stage."""

NOISE_NOT_UNIFORM = Cause(
    "noise_not_uniform", "instrument", ("noise_ratio",),
    "the noise of the images differs from pixel to pixel, with the slope or over the field",
    "the scatter of repeated images pixel by pixel, at several heights of focus",
    one_sided=True, label="uneven noise of the images",
)  # fmt: skip
NOISE_RATIO = Parameter(
    "noise_ratio", "", 1.0, 0.405, 1.0, 100.0, logarithmic=True, enters="covariance",
    label="σ of noisy pixels / σ of quiet ones",
)  # fmt: skip
"""σ of the noisiest pixels over that of the quietest; its scale is a factor of 1.5."""

COVARIANCE: tuple[Cause, ...] = (BOUNDARY_NOISE, NOISE_NOT_UNIFORM)
"""Causes that enter the covariance of the data, each by a level of noise."""
COVARIANCE_PARAMETERS = {parameter.name: parameter for parameter in (SIGMA_E, NOISE_RATIO)}
