from __future__ import annotations

from typing import Any

import pytest

from driver.case.model import Case
from driver.forward.build import mesh_of
from driver.forward.cost import steps_seconds
from driver.identification.correction_cost import cells_of_size, correction_seconds
from solver_adapters.bundled.adapter import BundledAdapter
from tools.converged_truth import known_case
from tools.three_grains import three_grains

SOLVER = BundledAdapter().capabilities()


def case_with(**solver: Any) -> Case:
    case = known_case()
    return case.model_copy(update={"solver": case.solver.model_copy(update=solver)})


def seconds(case: Case, size: float = 0.667, runs: tuple[int, ...] = (0,)) -> float:
    return correction_seconds(case, SOLVER, 18, 21, size, runs)


def test_finer_steps_count_on_the_working_mesh_alone() -> None:
    more = case_with(steps_per_interval=1, fine_steps_per_interval=4)
    added = seconds(more) - seconds(case_with(steps_per_interval=1, fine_steps_per_interval=2))
    assert added == pytest.approx(steps_seconds(more, SOLVER, 18, 42 * 2, 0), rel=1e-3)


def test_steps_are_told_by_two_parts_of_each_at_least() -> None:
    many = case_with(steps_per_interval=20, fine_steps_per_interval=2)
    of_mesh = steps_seconds(many, SOLVER, 18 * 8, 42 * 20, 0)
    of_steps = steps_seconds(many, SOLVER, 18, 42 * 40, 0)
    assert seconds(many, 1.0) == pytest.approx(of_mesh + of_steps, rel=1e-3)


def test_a_correction_takes_both_meshes_that_are_extrapolated_and_finer_steps_on_the_working() -> (
    None
):
    case = known_case()
    meshes = [steps_seconds(case, SOLVER, n, 42, 0) for n in (18 * 8, round(18 * (2 / 0.667) ** 3))]
    steps = steps_seconds(case, SOLVER, 18, 84, 0)
    assert seconds(case) == pytest.approx(sum(meshes) + steps, rel=1e-3)
    # Hexahedra of twice the size of the working mesh are extrapolated with that.
    assert seconds(case, 1.0) == pytest.approx(meshes[0] + steps, rel=1e-3)


def test_each_correction_counts_with_its_derivatives() -> None:
    """On 56 and 1080 hexahedra 84 of them were measured to take 3.5 and 3.0 times as long."""
    case = known_case()
    one, two = seconds(case), seconds(case, runs=(0, 84))
    assert 3.5 * one < two < 5 * one


def test_cells_grow_with_the_third_power_of_hexahedra_and_the_second_of_tetrahedra() -> None:
    case = known_case()
    assert cells_of_size(case, 18, 1.0) == 144
    tetrahedra = case.model_copy(
        update={"specimen": case.specimen.model_copy(update={"cells": "tet10"})}
    )
    assert cells_of_size(tetrahedra, 100, 1.0) == 400


def test_hexahedra_of_a_size_that_does_not_fit_the_section_are_counted_as_they_are_made() -> None:
    case = three_grains(specimen={"mesh_size_um": 1.34, "fine_mesh_size_um": 0.667})
    working, finer = (len(mesh_of(case, size).cells) for size in (1.34, 0.667))
    assert cells_of_size(case, working, 0.667) == pytest.approx(finer, rel=0.1)
