from __future__ import annotations

from pathlib import Path

from driver.case.model import load_case
from driver.forward.cost import simulation_seconds
from solver_adapters.code_aster.adapter import CodeAsterAdapter

ALPHA = Path(__file__).parents[3] / "examples" / "alpha"


def test_the_estimate_of_a_real_run_of_code_aster_is_right_within_a_factor_of_two() -> None:
    """The run of examples/alpha itself: 480 cells, 97 images, 223 steps, 1386 CPU-s."""
    case = load_case(ALPHA / "case.toml")
    told = simulation_seconds(case, CodeAsterAdapter().capabilities(), 480, 97)
    assert 0.5 < told / 1386.0 < 2.0
    # An empty job is no job without cost.
    assert simulation_seconds(case, CodeAsterAdapter().capabilities(), 1, 1) > 4.0
