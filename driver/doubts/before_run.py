"""What is odd about a case, and known before hours of computing, without images and solver."""

from __future__ import annotations

from driver.case.model import Case
from driver.doubts.finding import Finding
from driver.doubts.loads import strange_loads
from driver.doubts.orientations import look_at_orientations
from driver.doubts.plausible import in_figures
from driver.experiment.history import History


def warnings_before_run(case: Case, history: History) -> list[Finding]:
    """Return the warnings that `check` would tell of orientations, history and loads.

    Args:
        case: a case that can run.
        history: its history.
    """
    force = history.force * case.force_scale
    found = [
        *look_at_orientations(case),
        *in_figures(case, history, force),
        *strange_loads(case, history, force),
    ]
    return [finding for finding in found if finding.level == "warning"]
