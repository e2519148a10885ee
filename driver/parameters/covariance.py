"""Parameters of the covariance of the data: levels of noise, and the error of the simulation."""

from __future__ import annotations

from solver_adapters.parameter import NANOMETRES, Parameter

SIGMA_E = Parameter(
    "sigma_e", "µm", 0.0, 3e-4, 0.0, enters="covariance", label="σₑ, noise of the elongation",
    key="boundary.jitter_nm", read_in=NANOMETRES,
)  # fmt: skip
"""Standard deviation of the elongation at a stop; its scale is that of a good stage."""

NOISE_RATIO = Parameter(
    "noise_ratio", "", 1.0, 0.405, 1.0, 100.0, logarithmic=True, enters="covariance",
    label="σ of noisy pixels / σ of quiet ones",
)  # fmt: skip
"""σ of the noisiest pixels over that of the quietest; its scale is a factor of 1.5."""

DISCRETISATION = Parameter(
    "discretisation", "", 0.0, 1.0, enters="covariance",
    label="share of the finer-minus-working difference",
)  # fmt: skip
"""Share that is missing of the correction of the simulation by a finer one."""

COVARIANCE_PARAMETERS = {
    parameter.name: parameter for parameter in (SIGMA_E, NOISE_RATIO, DISCRETISATION)
}
"""By name; they are no parameters of the general model, whose prediction they do not change."""
