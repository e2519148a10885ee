"""What is said of a cause that was not found: how large it would have to be to be seen.

Of one that was seen in the last round and yet not added it is said why.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from driver.diagnosis.answer.result_types import Round
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE, NOISE_NOT_UNIFORM
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.diagnosis.statistics.score_test import (
    NAMING_LEVEL,
    WORTH,
    Score,
)
from solver_adapters.parameter import Parameter

UNDETECTABLE = 3.0
"""Prior scales that few effects exceed: what is seen only beyond is as good as undetectable."""


def not_found(scored: Score, last: Round, parameters: Mapping[str, Parameter]) -> str:
    """One sentence on a cause that the verdict does not name.

    Args:
        scored: its score.
        last: the last round.
        parameters: declarations by name.
    """
    if scored.cause.parameters and scored.p < level_of(scored.cause):
        return f"seen here (p {scored.p:.2g}) and not added: {_why_not(scored, last)}"
    if last.lost is not None and last.lost.along == scored.cause:
        return not_seen(scored, parameters, "seen with one finer mesh, not with the mean of two")
    return not_seen(scored, parameters)


def _why_not(scored: Score, last: Round) -> str:
    refit = next((r for r in last.refits if r.cause == scored.cause), None)
    if last.lost is not None and not last.lost.passed:
        return "the second mesh takes it away"
    if scored.cause == NOISE_NOT_UNIFORM:
        return "it is too small for other weights of the pixels to change an answer"
    if refit is not None and refit.log_evidence <= WORTH:
        return f"its refit has a log evidence of {refit.log_evidence:+.1f}, and {WORTH:g} is wanted"
    return "no more causes were added" if refit or not last.refits else "others were more likely"


def not_seen(scored: Score, parameters: Mapping[str, Parameter], how: str = "not seen here") -> str:
    """One sentence on a cause that was not found.

    Args:
        scored: its score.
        parameters: declarations by name.
        how: in which way it was not.
    """
    names = scored.cause.parameters
    if not names:
        return (
            f"tried: its first step promised a log evidence of {scored.log_evidence:+.1f} "
            "against the model of its round"
        )
    sizes = [
        f"{parameters[name].title} by {_size(float(visible), parameters[name])}"
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
    return f"{how}: it would have been seen from {' or '.join(sizes)} on"


def _size(scales: float, parameter: Parameter) -> str:
    if parameter.logarithmic:
        return f"a factor {np.exp(scales * parameter.scale):.3g}"
    unit = f" {parameter.unit}" if parameter.unit not in ("", "1") else ""
    return f"{scales * parameter.scale:.3g}{unit}"


def level_of(cause: Cause) -> float:
    """Return the level of the family at which a cause is named, or suspected first."""
    return FAMILY_LEVEL if cause == BOUNDARY_NOISE else NAMING_LEVEL
