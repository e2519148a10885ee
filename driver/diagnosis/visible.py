"""What is said of a cause that was not found: how large it would have to be to be seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from driver.diagnosis.score import Score
from solver_adapters.parameter import Parameter

UNDETECTABLE = 3.0
"""Prior scales beyond which an effect is larger than anyone expects: then it cannot be seen."""


def not_seen(scored: Score, parameters: Mapping[str, Parameter]) -> str:
    """One sentence on a cause that was not found.

    Args:
        scored: its score.
        parameters: declarations by name.
    """
    names = scored.cause.parameters
    if not names:
        return (
            f"tried: its first step promised a log evidence of {scored.log_evidence:+.1f} "
            "against the model of its round"
        )
    sizes = [
        f"{name} by {_size(float(visible), parameters[name])}"
        for name, visible in zip(names, scored.visible, strict=True)
        if np.isfinite(visible)
    ]
    if not sizes:
        return f"undetectable here: of no size would these data show it, for {scored.cause.unseen}"
    smallest = float(np.min(scored.visible))
    if smallest > UNDETECTABLE:
        return (
            f"undetectable here: it would be seen from {' or '.join(sizes)} on, "
            f"{smallest:.1f} times its usual size"
        )
    return f"not seen here: it would have been seen from {' or '.join(sizes)} on"


def _size(scales: float, parameter: Parameter) -> str:
    if parameter.logarithmic:
        return f"a factor {np.exp(scales * parameter.scale):.3g}"
    unit = f" {parameter.unit}" if parameter.unit not in ("", "1") else ""
    return f"{scales * parameter.scale:.3g}{unit}"
