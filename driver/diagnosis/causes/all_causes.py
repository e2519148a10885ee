"""All causes together: of the model, of its noise, of the EBSD frame, and of the simulation."""

from __future__ import annotations

from driver.diagnosis.causes.causes import LIBRARY, NUMERICS, Cause
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.diagnosis.causes.noise_causes import COVARIANCE

EVERY: tuple[Cause, ...] = (*LIBRARY, *FLIPS, *COVARIANCE, NUMERICS)
"""Every cause that can be named."""
NAMES: tuple[str, ...] = tuple(cause.name for cause in (*LIBRARY, *FLIPS, *COVARIANCE))
"""Names of the causes that can be asked for."""
