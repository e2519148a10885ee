"""All causes together: of the model, of its noise, of the EBSD frame, and of the simulation."""

from __future__ import annotations

from functools import cache

from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.diagnosis.causes.grain_causes import library
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.parameters.microstructure import grains_that_bear


@cache
def every(n_grains: int) -> tuple[Cause, ...]:
    """Return every cause that can be named of a specimen of so many grains."""
    return (*library(n_grains), *FLIPS, *COVARIANCE, NUMERICS)


@cache
def names(n_grains: int) -> tuple[str, ...]:
    """Return the names of the causes that can be asked for of a specimen of so many grains."""
    return tuple(cause.name for cause in every(n_grains) if cause is not NUMERICS)


def cause_of(name: str) -> Cause | None:
    """Return the cause of a name, of however many grains; None of one of the user's own."""
    found = [cause for cause in every(grains_that_bear(name)) if cause.name == name]
    return found[0] if found else None


EVERY: tuple[Cause, ...] = every(2)
"""Every cause that can be named of two grains."""
NAMES: tuple[str, ...] = names(2)
"""Names of the causes that can be asked for of two grains."""
