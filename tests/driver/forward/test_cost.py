from __future__ import annotations

from pathlib import Path

from driver.case.model import load_case
from driver.forward.cost import simulation_memory, simulation_seconds, systems_of
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter

ALPHA = Path(__file__).parents[3] / "examples" / "alpha"


def test_the_estimate_of_a_real_run_of_code_aster_is_right_within_a_factor_of_two() -> None:
    """The run of examples/alpha itself: 480 cells, 97 images, 223 steps, 1386 CPU-s."""
    case = load_case(ALPHA / "case.toml")
    told = simulation_seconds(case, CodeAsterAdapter().capabilities(), 480, 97)
    assert 0.5 < told / 1386.0 < 2.0
    # An empty job is no job without cost.
    assert simulation_seconds(case, CodeAsterAdapter().capabilities(), 1, 1) > 4.0


def test_more_slip_systems_take_more_time_and_memory() -> None:
    """At the points, 2.0 times the time in small strain; matrices take as long as before."""
    case, solver = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()
    other = case.with_values_at({"material.slip_systems": "bcc48"})
    assert (systems_of(case), systems_of(other)) == (24, 48)
    times = [simulation_seconds(of, solver, 20_000, 97) for of in (case, other)]
    assert 1.0 < times[1] / times[0] < 2.0
    memory = [simulation_memory("tet10", 574, 97, 20, systems=count) for count in (24, 48)]
    assert memory[1] > memory[0]
