"""What is odd about a case is known without its images."""

from __future__ import annotations

from driver.case.grains import Grain
from driver.case.model import load_case
from driver.doubts.before_run import warnings_before_run
from driver.experiment.reading import history_of
from tests.driver.doubts.test_plausible import ALPHA


def test_the_example_is_not_doubted() -> None:
    case = load_case(ALPHA)
    assert warnings_before_run(case, history_of(case)) == []


def test_orientations_history_and_loads_are_looked_at() -> None:
    case = load_case(ALPHA)
    radians = Grain(name="a", euler_deg=(3.6826, 0.7854, 2.618))
    odd = case.model_copy(update={"grains": (radians, case.grains[1])})
    odd = odd.with_values_at({"sections.macroscopic_mm2": 1e-6, "loads.noise_uN": 1e12})
    found = [finding.subject for finding in warnings_before_run(odd, history_of(case))]
    assert found == ["orientation", "in figures", "loads"]
