"""A mesh of the user's own in the forward model, held against meshes that the program makes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.case.model import Case, default_case
from driver.diagnosis.causes.grain_causes import library
from driver.diagnosis.statistics.screening import screened
from driver.experiment.orientations import orientations_of
from driver.forward.build import (
    adapter_of,
    build_finer_model,
    build_model,
    geometry_of,
    mesh_of,
    refuse_size,
    second_mesh_is_better,
    second_mesh_of,
)
from driver.forward.geometry import boundary_traces, grain_places
from driver.forward.mesh_extrapolation import lacking_share
from driver.forward.model import ForwardModel
from driver.results.mesh_sizes import sized
from driver.virtual.truth import stage_program
from meshes.files import write_med
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Capabilities
from solver_adapters.material import Material
from tests.meshes.gmsh_files import BOUNDARY, gmsh_prism
from tests.meshes.user_files import gmsh_bar
from tests.solver_adapters.bundled.bars import STRAINS, TIMES, flat_ended
from tests.solver_adapters.calculix.runs import OCTAHEDRAL, needs_ccx
from tools.boxes import pulled, uniaxial

PIXELS = np.stack(np.meshgrid([-1.5, 0.0, 1.5], [2.0, 6.0, 10.0]), axis=-1).reshape(-1, 2)
SOLVER: Capabilities = BundledAdapter().capabilities()


def case_of(path: Path, grains: int = 2, **specimen: Any) -> Case:
    """A case on the mesh of a file."""
    data = default_case(shape="mesh").model_dump(mode="json")
    data["specimen"] |= {"mesh_file": path.name} | specimen
    data["grains"] = [
        {"name": f"grain {k + 1}", "euler_deg": angles}
        for k, angles in enumerate(((281.0, 8.0, 47.0), (211.0, 45.0, 150.0))[:grains])
    ]
    data["material"]["strain_measure"] = "small"
    case = Case.model_validate(data, context={"file": path.parent / "case.toml"})
    return sized(case, SOLVER)


def drawn(boundary: float) -> Case:
    """The same specimen as the program draws it."""
    case = default_case()
    plane = {"boundary_point_um": (0.0, boundary, 0.0), "boundary_normal": (0.0, 1.0, 0.0)}
    return case.model_copy(update={"specimen": case.specimen.model_copy(update=plane)})


def model_on(case: Case, mesh: PrismMesh) -> ForwardModel:
    return build_model(case, mesh, stage_program([(2, 1)]), PIXELS, adapter_of(case), 1)


def seen(model: ForwardModel) -> tuple[Any, Any]:
    motion = {"elongation_1": 0.05, "elongation_2": 0.04, "tilt_1": 0.01, "lambda_plus_Y": 0.8}
    prediction = model.predict(model.null_values() | motion)
    look = model.projection.at(model.projection.surface.points, model.null_values())
    surface = np.stack([look.value @ at for at in prediction.surface])
    return prediction.load, surface


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_the_mesh_of_the_program_as_a_file_gives_the_same_response(
    tmp_path: Path, kind: CellKind
) -> None:
    mesh = generate(geometry_of(drawn(BOUNDARY)), 3.0, kind)
    write_med(mesh, tmp_path / "specimen.med")
    case = case_of(tmp_path / "specimen.med")
    load, surface = seen(model_on(case, mesh))
    found, found_surface = seen(model_on(case, mesh_of(case, case.specimen.mesh_size)))
    assert abs(load).max() > 100
    np.testing.assert_allclose(found, load, rtol=0, atol=1e-9 * abs(load).max())
    np.testing.assert_allclose(found_surface, surface, rtol=0, atol=1e-9 * abs(surface).max())


def test_a_prism_by_gmsh_responds_as_that_of_the_program_within_the_error_of_both(
    tmp_path: Path,
) -> None:
    """Of the same section, length and grains, with other cells of like size."""
    gmsh_prism(tmp_path / "specimen.msh")
    case = case_of(tmp_path / "specimen.msh")
    loads = {}
    for name, mesh in (
        ("file", mesh_of(case, case.specimen.mesh_size)),
        ("in two", mesh_of(case, case.specimen.fine_mesh_size)),
        ("own", generate(geometry_of(drawn(BOUNDARY)), 3.0)),
    ):
        loads[name] = seen(model_on(case, mesh))[0]
    error = abs(loads["file"] - loads["in two"]).max()
    assert 0 < error < 0.05 * abs(loads["file"]).max()
    assert abs(loads["file"] - loads["own"]).max() < 1.5 * error


@pytest.mark.parametrize("hexahedra", [False, True])
def test_a_bar_by_gmsh_in_uniform_tension_carries_its_section_times_the_stress_of_a_point(
    tmp_path: Path, hexahedra: bool
) -> None:
    gmsh_bar(tmp_path / "specimen.msh", 1, hexahedra)
    case = case_of(tmp_path / "specimen.msh", length_um=8.0, depth_um=3.0)
    mesh = mesh_of(case, case.specimen.mesh_size)
    rotation, material = bunge_matrix(281, 8, 47), Material(strain_measure="small")
    simulation = flat_ended(mesh, np.stack([rotation] * 2), material)
    force = BundledAdapter().solve(simulation).force
    of_one = BundledAdapter().solve(uniaxial(material, rotation, TIMES, STRAINS)).force
    assert case.section == pytest.approx(12.0)
    np.testing.assert_allclose(force, 12.0 * of_one, rtol=1e-6, atol=1e-5)


@needs_ccx
@pytest.mark.parametrize("kind", ["tet10", pytest.param("hex20", marks=pytest.mark.slow)])
def test_calculix_answers_on_a_mesh_of_the_users_own_as_the_bundled_solver(
    tmp_path: Path, kind: CellKind
) -> None:
    """A prism of tetrahedra and a bar of hexahedra by gmsh, at the steps that CalculiX took."""
    if kind == "tet10":
        gmsh_prism(tmp_path / "specimen.msh")
    else:
        gmsh_bar(tmp_path / "specimen.msh", 1, hexahedra=True)
    length = default_case().specimen.length if kind == "tet10" else 8.0
    case = case_of(tmp_path / "specimen.msh", length_um=length)
    mesh = mesh_of(case, case.specimen.mesh_size)
    assert mesh.cells.shape[1] == int(kind[3:]) and set(mesh.grain) == {0, 1}
    asked = pulled(mesh, OCTAHEDRAL, tuple(np.linspace(0.0, 0.002, 21)[1:]), 0.25)
    asked = replace(
        asked,
        orientations=orientations_of(case),
        integration="backward_euler",
    )
    found = CalculixAdapter().solve(asked, tmp_path / "jobs")
    expected = BundledAdapter().solve(replace(asked, steps=found.ends))
    flowed = abs(np.diff(found.force[-2:]) / np.diff(found.force[:2]))
    assert found.cuts == 0 and flowed < 0.5
    assert abs(found.force - expected.force).max() < 1e-4 * abs(expected.force).max()
    assert abs(found.displacement - expected.displacement).max() < 1e-5  # µm


@cache
def bar(folder: Path) -> Case:
    gmsh_bar(folder / "specimen.msh", 1, True)
    return case_of(folder / "specimen.msh", length_um=8.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bar")


def test_meshes_of_a_file_are_one_family_of_which_finer_ones_are_extrapolated(folder: Path) -> None:
    case = bar(folder)
    working, finer = (
        mesh_of(case, size) for size in (case.specimen.mesh_size, case.specimen.fine_mesh_size)
    )
    other = second_mesh_of(case, finer.points)
    assert not second_mesh_is_better(case)
    assert [len(mesh.cells) // len(working.cells) for mesh in (working, finer, other)] == [1, 8, 27]
    share = lacking_share(working, finer)
    assert share.motion == pytest.approx(0.5**1.5 / (1 - 0.5**1.5))
    assert share.load == pytest.approx(0.5**1.25 / (1 - 0.5**1.25))
    history, adapter = stage_program([(2, 1)]), adapter_of(case)
    models = [build_finer_model(case, mesh, history, PIXELS, adapter) for mesh in (finer, other)]
    assert models[0].extrapolation is None
    assert models[1].extrapolation is not None
    coarser = models[1].extrapolation.coarser.microstructure.mesh
    assert len(coarser.cells) == 8 * len(working.cells)


def test_the_sizes_of_a_file_are_refined_by_one_piece_of_each_edge(folder: Path) -> None:
    case = bar(folder)
    specimen, size = case.specimen, case.specimen.measures.size
    np.testing.assert_allclose(
        (*specimen.next_sizes, specimen.mesh_size), (size, size / 3, size), rtol=5e-3
    )
    thrice = specimen.at_level("hex20", 3)
    assert [thrice.divisions(s) for s in (thrice.mesh_size, thrice.fine_mesh_size)] == [2, 5]
    with pytest.raises(ValueError, match="edges in 60 pieces, expected at most 200000, a coarser"):
        refuse_size(case, "mesh_size_um", size / 60)


def test_a_mesh_of_the_users_own_has_every_parameter_but_those_of_its_boundaries(
    folder: Path,
) -> None:
    case = bar(folder)
    model = model_on(case, mesh_of(case, case.specimen.mesh_size))
    candidates, names = screened(model, ("tau0", "c", "d"), None)
    left = {cause.name for cause in library(2)} - {cause.name for cause in candidates}
    of_boundary = {"boundary_position", "boundary_tilt", "boundary_bow"}
    assert left == of_boundary | {"fixed_pattern", "family_123"}
    assert {"depth_scale", "apex_shift", "rotation_grain2_y", "tau0_grain2"} < set(names)


def test_lines_between_grains_and_places_of_their_names_are_read_from_the_face(
    folder: Path,
) -> None:
    case = bar(folder)
    (line,) = boundary_traces(case)
    np.testing.assert_allclose(sorted(line.tolist()), [[-2.0, 4.0], [2.0, 4.0]], atol=1e-12)
    places = grain_places(case)
    assert [grain for grain, _ in places] == [0, 1]
    assert places[0][1][1] < 4.0 < places[1][1][1]


def test_the_far_side_moves_by_its_amplitude_and_what_lies_between_linearly(folder: Path) -> None:
    case = bar(folder)
    model = model_on(case, mesh_of(case, case.specimen.mesh_size))
    boundary, points = model.boundary, model.microstructure.mesh.points
    values = model.null_values() | {"elongation_1": 0.2, "lambda_plus_Y": 0.5}
    motion = boundary.evaluate(values)[:, boundary.side > 0, 1].max(axis=0)
    depth = -points[boundary.nodes[boundary.side > 0], 2] / 3.0
    np.testing.assert_allclose(motion, 0.1 * (1 - 0.5 * depth), atol=1e-12)
    assert (depth.min(), depth.max()) == (0.0, 1.0)


def test_a_geometry_of_a_mesh_is_the_bar_about_it(folder: Path) -> None:
    geometry = geometry_of(bar(folder))
    assert geometry == PrismGeometry(8.0, 4.0, geometry.depth, (), 4.0)
    assert geometry.depth == pytest.approx(3.0, rel=1e-12)
