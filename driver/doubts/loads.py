"""What of the loads, and of an elongation that no image shows, is looked at before a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from driver.case.model import Case
from driver.doubts.finding import Finding
from driver.experiment.history import History
from meshes.arrays import FloatArray

_LARGEST_STRAIN = 0.3
_SEEN = 5.0  # standard deviations of a load from which a change is one


def strange_loads(case: Case, history: History, force: FloatArray) -> Iterator[Finding]:
    """Find loads that no specimen in tension has: of a wrong sign, or of an idle cell.

    Those that the case leaves out do not count.

    Args:
        case: the case.
        history: its history.
        force: load at the specimen [µN], shape (n_images,).
    """
    file = case.path(case.history.file)

    def told(found: str, expected: str) -> Finding:
        column = case.history.force.name
        return Finding("warning", "loads", f"{file}: {column}: found {found}, expected {expected}")

    kept = np.setdiff1d(np.arange(force.size), case.loads.left_out)
    force, cycle = force[kept], history.cycle[kept]
    span, noise = float(np.ptp(force)), case.loads.noise_uN
    if span < _SEEN * noise:
        yield told(
            f"loads within {span:.3g} µN at the specimen", f"more than their noise of {noise:g} µN"
        )
        return
    travel = history.stage[history.image_row][kept] - history.stage[0]
    first, loading = travel[cycle == 1], force[cycle == 1]
    if loading.size and loading[int(np.argmax(np.abs(first)))] < loading[0] - _SEEN * noise:
        yield told("loads that fall in the first loading", "tension positive")


def stated_motion(case: Case, history: History) -> Finding:
    """Return the elongation that the stage travel stands for, where no image shows it."""
    ratio, sigma = case.boundary.stage_ratio, case.boundary.stage_ratio_uncertainty
    assert ratio is not None and sigma is not None  # the case refuses itself without them
    elongation = ratio * float(np.ptp(history.stage))
    strain = elongation / case.specimen.length
    sentence = (
        f"boundary.stage_ratio: found {ratio:g} ± {sigma:g}, an elongation of "
        f"{1e3 * elongation:.3g} nm, {100 * strain:.2g} % of the length"
    )
    if strain > _LARGEST_STRAIN:
        expected = f"at most {100 * _LARGEST_STRAIN:g} %"
        return Finding("warning", "boundary", f"{sentence}, expected {expected}")
    if sigma > ratio:
        expected = "stage_ratio_uncertainty below the ratio"
        return Finding("warning", "boundary", f"{sentence}, expected {expected}")
    return Finding("ok", "boundary", sentence)
