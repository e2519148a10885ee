"""Virtual experiments of the short specimen, as `prismid virtual` makes them."""

from __future__ import annotations

from collections.abc import Mapping

from driver.case.model import Case
from driver.virtual.truth import Course, stage_program
from driver.virtual.truth import pull as pull_case
from tools.short_specimen import CYCLES, true_knots


def pull(truth: Case, hidden: Mapping[str, float]) -> Course:
    """Simulate a test.

    Args:
        truth: the specimen as it is, on the mesh and with the steps of its working model.
        hidden: parameters of the general model that are not at their null.
    """
    history = stage_program(CYCLES)
    return pull_case(truth, history, {**true_knots(history), **hidden})
