"""The names of the stages."""

from __future__ import annotations

from driver.case.model import default_case
from driver.common.stage_names import STAGE_NAMES
from driver.workflow.pipeline import stages


def test_the_names_are_those_of_the_stages_of_a_run_in_their_order() -> None:
    assert tuple(stage.name for stage in stages(default_case())) == STAGE_NAMES
