"""The cycle that is held out of a fit."""

from __future__ import annotations

import numpy as np

from driver.case.model import Case, CaseError
from driver.common.errors import sentence
from driver.experiment.history import History
from driver.experiment.reading import fitted_loads


def held_out_cycle(case: Case, history: History) -> int | None:
    """Return the cycle that is held out, if any.

    Args:
        case: the case.
        history: its history.

    Raises:
        CaseError: it asks for a cycle that there is not, or of which it leaves out all loads.
    """
    cycles = int(history.cycle.max())
    asked = case.diagnosis.held_out_cycle
    if isinstance(asked, int) and asked > cycles:
        raise CaseError(
            sentence(case.file, "diagnosis.held_out_cycle", str(asked),
                     f"one of the {cycles} cycle(s)")
        )  # fmt: skip
    if asked == "none" or cycles < 2:
        return None
    cycle = cycles if asked == "last" else asked
    if not np.isfinite(fitted_loads(case, history.force)[history.cycle == cycle]).any():
        raise CaseError(
            sentence(case.file, "loads.left_out", f"all loads of cycle {cycle}, which is held out",
                     "some that it can be predicted for, or another diagnosis.held_out_cycle")
        )  # fmt: skip
    return cycle
