"""What an identification refuses before it begins."""

from __future__ import annotations

import numpy as np
import pytest

from driver.case.model import CaseError, default_case
from driver.experiment.history import History
from driver.parameters.boundary import elongation_names
from driver.workflow.identify_stage import refuse_large_jitter


def test_noise_of_the_boundary_beyond_the_travel_between_stops_is_refused() -> None:
    stage = np.array([0.0, 5.0, 10.0, 5.0, 0.0])
    history = History(
        time=np.arange(5.0), stage=stage, image_row=np.arange(5), force=np.zeros(5),
        turning=np.array([0, 2, 4]), cycle=np.ones(5, dtype=np.int64),
    )  # fmt: skip
    # 20 nm up and 4 nm down in four steps.
    start = dict(zip(elongation_names(3), (0.020, 0.016), strict=True))
    refuse_large_jitter(default_case(), 0.0059, start, history)
    with pytest.raises(CaseError) as error:
        refuse_large_jitter(default_case(), 0.02, start, history)
    assert str(error.value) == (
        "case.toml: boundary.jitter_nm: found 20, expected well below 6, the mean elongation from "
        "one stop to the next"
    )
