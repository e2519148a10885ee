from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.case.model import default_case, load_case
from driver.forward.build import geometry_of
from driver.forward.cost import (
    ONE_FACTOR_FROM,
    nodes_of,
    simulation_memory,
    simulation_seconds,
    systems_of,
)
from meshes.prism import CellKind, generate
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.tangent_system import MOST_WITH_TWO
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from tools.three_grains import three_grains

ALPHA = Path(__file__).parents[3] / "examples" / "alpha"


def test_the_estimate_of_a_real_run_of_code_aster_is_right_within_a_factor_of_two() -> None:
    """The run of examples/alpha itself: 480 cells, 97 images, 223 steps, 1386 CPU-s."""
    case = load_case(ALPHA / "case.toml")
    told = simulation_seconds(case, CodeAsterAdapter().capabilities(), 480, 97)
    assert 0.5 < told / 1386.0 < 2.0
    # An empty job is no job without cost.
    assert simulation_seconds(case, CodeAsterAdapter().capabilities(), 1, 1) > 4.0


@pytest.mark.parametrize(
    ("kind", "strain", "n_cells", "directions", "measured"),
    [
        ("tet10", "small", 254, 0, 0.79),
        ("tet10", "small", 254, 70, 2.52),
        ("tet10", "small", 1560, 0, 6.30),
        ("tet10", "small", 1560, 70, 21.8),
        ("tet10", "finite", 254, 0, 1.32),
        ("tet10", "finite", 3582, 0, 26.6),
        ("hex20", "small", 1920, 0, 46.3),
        ("hex20", "finite", 240, 0, 4.17),
    ],
)
def test_the_estimate_of_the_bundled_solver_is_right_within_a_third(
    kind: CellKind, strain: str, n_cells: int, directions: int, measured: float
) -> None:
    """Measured on prisms of the default case, 30 images to 1.5 % [CPU-s]."""
    keys: dict[str, Any] = {"material.strain_measure": strain, "specimen.cells": kind}
    case = default_case("bcc", "prism").with_values_at(keys)
    told = simulation_seconds(case, BundledAdapter().capabilities(), n_cells, 30, directions)
    assert 0.75 < told / measured < 4 / 3


def test_more_slip_systems_take_more_time_and_memory() -> None:
    """At the points, 2.0 times the time in small strain; matrices take as long as before."""
    case, solver = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()
    other = case.with_values_at({"material.slip_systems": "bcc48"})
    assert (systems_of(case), systems_of(other)) == (24, 48)
    times = [simulation_seconds(of, solver, 20_000, 97) for of in (case, other)]
    assert 1.0 < times[1] / times[0] < 2.0
    memory = [simulation_memory("tet10", 574, 97, 20, systems=count) for count in (24, 48)]
    assert memory[1] > memory[0]


@pytest.mark.parametrize(("kind", "size"), [("hex20", 0.4), ("tet10", 0.35)])
def test_cells_from_which_one_factor_is_estimated_have_the_unknowns_at_which_it_is_kept(
    kind: CellKind, size: float
) -> None:
    mesh = generate(geometry_of(load_case(ALPHA / "case.toml")), size, kind)
    ends = np.union1d(mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"])
    unknowns = 3 * (len(mesh.points) - len(ends))
    at_change = unknowns * ONE_FACTOR_FROM[kind] / len(mesh.cells)
    assert at_change == pytest.approx(MOST_WITH_TWO, rel=0.1)


@pytest.mark.parametrize(("kind", "sizes"), [("hex20", (2.0, 1.0, 0.5)), ("tet10", (2.0, 0.8))])
def test_the_nodes_of_a_mesh_are_known_by_its_cells(
    kind: CellKind, sizes: tuple[float, ...]
) -> None:
    for geometry in (geometry_of(load_case(ALPHA / "case.toml")), geometry_of(three_grains())):
        for size in sizes:
            mesh = generate(geometry, size, kind)
            assert nodes_of(kind, len(mesh.cells)) == pytest.approx(len(mesh.points), rel=0.08)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the peak stands in /proc")
@pytest.mark.parametrize(("kind", "size"), [("hex20", 0.667), ("tet10", 0.6), ("tet10", 0.5)])
def test_the_memory_of_a_large_mesh_is_known_before(kind: CellKind, size: float) -> None:
    """Beside the libraries it is that of the matrix and its factor."""
    command = [sys.executable, "-m", "tests.driver.forward.peak_memory", kind, str(size)]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    n_cells, n_images, peak = map(int, found.stdout.split())
    assert n_cells > 1000 and peak > 600e6
    assert 0.9 < simulation_memory(kind, n_cells, n_images) / peak < 1.25
