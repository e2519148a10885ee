"""Parameters of the clock of the history."""

from __future__ import annotations

from solver_adapters.parameter import Parameter

HOLD = "hold_time_error"

HOLD_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter(
        HOLD, "s", 0.0, 5.0, -600.0, 600.0, enters="clock", label="holds longer than stamped by"
    ),
)
