from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from driver.case.grains import Grain
from driver.case.model import Case, load_case
from driver.case.specimen import BoundaryPlane
from driver.common.errors import InputError
from driver.experiment.history import History, read_history, turning_points
from driver.experiment.reading import read_experiment
from driver.forward import build
from driver.forward.build import (
    adapter_of,
    build_model,
    geometry_of,
    integration_of,
    mesh_of,
    refuse_parameters,
    second_mesh_is_better,
    second_mesh_of,
    size_of_second_mesh,
    surface_images,
)
from driver.forward.mesh_extrapolation import lacking_share
from driver.forward.model import ForwardModel
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import bunge_angles, bunge_matrix
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.interface import Capabilities, UnsupportedError
from tests.driver.ebsd_files import FIRST, SECOND, grid, write_ctf
from tools import closed_form
from tools.closed_form import LENGTH, PIXEL, WIDTH


class SmallStrainSolver(closed_form.ClosedFormSolver):
    def capabilities(self) -> Capabilities:
        return Capabilities(frozenset({"tau0"}), frozenset({"small"}), derivatives=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("specimen")
    closed_form.write_files(folder, {})
    return folder


def changed(case: Case, table: str, **update: object) -> Case:
    return case.model_copy(update={table: getattr(case, table).model_copy(update=update)})


def test_the_geometry_is_that_of_the_case() -> None:
    geometry = geometry_of(closed_form.small_case())
    assert (geometry.length, geometry.width) == (LENGTH, WIDTH)
    assert geometry.depth == pytest.approx(WIDTH * np.sqrt(3) / 2)
    assert [boundary.point for boundary in geometry.boundaries] == [(0.0, 2.0, 0.0)]


def test_a_strain_measure_that_the_solver_lacks_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: SmallStrainSolver())
    case = closed_form.small_case()
    with pytest.raises(InputError) as error:
        adapter_of(case)
    assert str(error.value) == (
        'material.strain_measure: found "finite", expected one of small '
        "(what the solver bundled offers)"
    )
    assert adapter_of(changed(case, "material", strain_measure="small")).name == "closed form"


class Underived(SmallStrainSolver):
    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), derivatives=False)


def test_a_solver_without_derivatives_is_given_some(monkeypatch: pytest.MonkeyPatch) -> None:
    case = changed(closed_form.small_case(), "material", strain_measure="small")
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: Underived())
    adapter = adapter_of(changed(case, "execution", processes=3))
    assert isinstance(adapter, FiniteDifferences) and adapter.capabilities().derivatives
    # Not made for threads, for all that is known.
    assert adapter.processes == 1


def test_an_accuracy_is_finer_as_the_steps_of_the_finer_simulation() -> None:
    b = closed_form.problem()

    def accuracy(steps: int, **solver: object) -> float | None:
        stated = changed(b.case, "solver", steps_per_interval=2, **solver)
        adapter, pixels = b.model.adapter, closed_form.pixels()
        model = build_model(stated, b.mesh, b.history, pixels, adapter, steps)
        return model.simulation(b.truth).accuracy

    assert accuracy(2) is None
    assert accuracy(2, accuracy_uN=1.5) == 1.5 and accuracy(6, accuracy_uN=1.5) == 0.5


def test_an_unknown_solver_is_refused() -> None:
    with pytest.raises(UnsupportedError, match='solver.name: found "none"'):
        adapter_of(changed(closed_form.small_case(), "solver", name="none"))


def test_the_images_show_the_face_less_a_pixel_on_each_side(folder: Path) -> None:
    case = load_case(folder / "case.toml")
    images = surface_images(case, read_experiment(case))
    x, y = images.xy.T
    assert x.min() >= PIXEL - WIDTH / 2 and x.max() <= WIDTH / 2 - PIXEL
    assert y.min() >= PIXEL and y.max() <= LENGTH - PIXEL
    assert x.max() > WIDTH / 2 - 2.01 * PIXEL and y.max() > LENGTH - 2.01 * PIXEL
    assert images.sigma == pytest.approx(closed_form.SIGMA, rel=0.05)
    assert images.n_reference == closed_form.N_REPEATS


def test_without_repeats_image_0_is_the_reference_with_the_stated_noise(folder: Path) -> None:
    case = load_case(folder / "case.toml")
    experiment = replace(read_experiment(case), repeats=None, gamma_f=0.003)
    images = surface_images(case, experiment)
    assert (images.sigma, images.noise_dof, images.n_reference) == (0.003, 0, 1)
    np.testing.assert_array_equal(images.reference_image, experiment.frames[0])
    assert list(np.flatnonzero(images.is_reference)) == [0]
    # Some frames of the series have their reference among them or not.
    assert [images.only(np.array(part)).of_series for part in ([0, 1], [1, 2])] == [True, False]


def test_the_ends_of_the_mesh_are_where_the_motion_is_prescribed() -> None:
    b = closed_form.problem()
    motion, points = b.model.boundary, b.mesh.points
    at = points[motion.nodes]
    np.testing.assert_allclose(at[motion.side > 0, 1], LENGTH, atol=1e-12)
    np.testing.assert_allclose(at[motion.side < 0, 1], 0.0, atol=1e-12)
    for end in ("PLUS", "MINUS"):
        rows = {name: np.isin(motion.nodes, b.mesh.nodes[f"{name}_{end}"]) for name in "LP"}
        np.testing.assert_allclose(motion.zeta[rows["L"]], 0.0, atol=1e-12)
        np.testing.assert_allclose(motion.zeta[rows["P"]], 1.0, atol=1e-12)
        assert motion.across[rows["L"]].min() == pytest.approx(-1.0)
        assert motion.across[rows["L"]].max() == pytest.approx(1.0)


def test_the_instrument_knows_the_clock_and_the_middle_of_the_face() -> None:
    instrument = closed_form.problem().model.instrument
    assert instrument.progress[0] == 0.0 and instrument.progress[-1] == 1.0
    assert instrument.centre == (0.0, LENGTH / 2)


def test_the_scheme_is_the_one_named_or_the_best_that_the_solver_has() -> None:
    case, solver = closed_form.small_case(), SmallStrainSolver()
    assert integration_of(case, solver.capabilities()) == "backward_euler"
    assert integration_of(case, BundledAdapter().capabilities()) == "exponential"
    named = changed(case, "solver", integration="backward_euler")
    assert integration_of(named, BundledAdapter().capabilities()) == "backward_euler"


def test_a_scheme_that_the_solver_lacks_is_refused() -> None:
    case = changed(closed_form.small_case(), "solver", integration="exponential")
    with pytest.raises(InputError) as error:
        integration_of(case, SmallStrainSolver().capabilities())
    assert str(error.value) == (
        'solver.integration: found "exponential", expected backward_euler (what the solver '
        "bundled offers), or the key left out"
    )


@pytest.mark.parametrize(("length", "width", "size"), [(8.0, 6.0, 1.8), (8.0, 4.0, 1.2)])
def test_the_second_mesh_has_few_nodes_in_common_where_a_little_smaller_elements_give_the_same(
    length: float, width: float, size: float
) -> None:
    case = changed(
        closed_form.small_case(), "specimen", length_um=length, width_um=width,
        fine_mesh_size_um=size,
    )  # fmt: skip
    mesh = mesh_of(case, size)
    nodes = cKDTree(mesh.points)

    def common(other: PrismMesh) -> float:
        return float(np.mean(nodes.query(other.points)[0] < 0.02 * size))

    other = second_mesh_of(case, mesh.points)
    assert common(mesh_of(case, 0.93 * size)) > 0.5 and common(other) <= 0.2
    assert 1.0 < len(other.cells) / len(mesh.cells) < 2.4


def test_the_largest_of_the_meshes_with_few_nodes_in_common_is_taken() -> None:
    case = changed(closed_form.small_case(), "specimen", fine_mesh_size_um=1.0)
    other = second_mesh_of(case, mesh_of(case, 1.0).points)
    np.testing.assert_array_equal(other.points, mesh_of(case, 0.93).points)


@pytest.mark.parametrize(
    ("size", "smaller"), [(1.0, 0.5), (0.62, 1 / 3), (0.5, 1 / 3), (0.333, 0.25), (0.25, 1 / 6)]
)
def test_the_second_mesh_of_hexahedra_has_more_of_them_on_a_side_and_its_size_is_told(
    size: float, smaller: float
) -> None:
    """At most three quarters of the first ones, also where a size is rounded to whole cells."""
    case = changed(closed_form.small_case(), "specimen", cells="hex20", fine_mesh_size_um=size)
    mesh = mesh_of(case, size)
    assert mesh.cells.shape[1] == 20 and second_mesh_is_better(case)
    other = second_mesh_of(case, mesh.points)
    assert size_of_second_mesh(case) == pytest.approx(smaller)
    np.testing.assert_array_equal(other.points, mesh_of(case, smaller).points)
    assert lacking_share(mesh, other)


def test_a_second_mesh_of_tetrahedra_is_no_better() -> None:
    assert not second_mesh_is_better(closed_form.small_case())


@pytest.mark.parametrize(
    ("cells", "stated", "expected"),
    [("hex20", None, True), ("tet10", None, False), ("hex20", False, False), ("tet10", True, True)],
)
def test_mean_dilatation_comes_with_hexahedra_unless_the_case_states_it(
    folder: Path, cells: str, stated: bool | None, expected: bool
) -> None:
    case = changed(closed_form.small_case(), "specimen", cells=cells)
    case = changed(case, "solver", mean_dilatation=stated)
    history = read_history(folder / "history.csv")
    model = build_model(case, mesh_of(case, 2.0), history, np.zeros((0, 2)), BundledAdapter(), 1)
    assert model.simulation(model.null_values()).mean_dilatation is expected


@pytest.mark.parametrize(
    ("cells", "stated", "solver", "expected"),
    [
        ("hex20", None, Capabilities(frozenset({"tau0", "c", "d"}), frozenset(), True),
         'specimen.cells: found "hex20", expected "tet10", which bundled has'),
        ("hex20", None,
         Capabilities(frozenset({"tau0", "c", "d"}), frozenset(), True, cells=frozenset({10, 20})),
         "solver.mean_dilatation: found no value, which is true with hexahedra, expected false: "
         "bundled lacks it"),
        ("tet10", True, Capabilities(frozenset({"tau0", "c", "d"}), frozenset(), True),
         "solver.mean_dilatation: found true, expected false: bundled lacks it"),
    ],
)  # fmt: skip
def test_cells_that_the_solver_lacks_are_refused_by_key(
    cells: str, stated: bool | None, solver: Capabilities, expected: str
) -> None:
    case = changed(closed_form.small_case(), "specimen", cells=cells)
    case = changed(case, "solver", mean_dilatation=stated)
    with pytest.raises(InputError) as error:
        refuse_parameters(case, solver)
    assert str(error.value).endswith(expected)


@pytest.mark.parametrize(
    ("key", "update"),
    [
        ("boundary_normal", {"boundary_normal": (1.0, 0.0, 0.0)}),
        ("boundary_normal", {"boundary_normal": (1.0, 0.1, 0.0)}),
        ("boundaries.1", {
            "boundary_point_um": None, "boundary_normal": None,
            "boundaries": (BoundaryPlane(point_um=(0.0, 2.0, 0.0), normal=(1.0, 0.0, 0.0)),),
        }),
    ],
)  # fmt: skip
def test_a_boundary_that_meets_an_end_face_is_refused_by_key(
    key: str, update: dict[str, object]
) -> None:
    """Tetrahedra follow it, but it cannot be moved along the specimen."""
    with pytest.raises(InputError) as error:
        built(changed(closed_form.small_case(), "specimen", cells="tet10", **update))
    assert str(error.value).startswith(f"specimen.{key}: found the grain boundary through (0.0, 2")
    assert str(error.value).endswith("expected one that crosses it from side to side, or labels")


def bicrystal(folder: Path, *grains: Grain) -> ForwardModel:
    case = closed_form.small_case().model_copy(update={"grains": grains})
    case._file = folder / "case.toml"
    return built(case)


def built(case: Case) -> ForwardModel:
    mesh = mesh_of(case, 2.0)
    none = np.zeros((0, 2))
    stage = np.array([0.0, 20.0, 40.0])
    history = History(
        time=10.0 * np.arange(3.0), stage=stage, image_row=np.arange(3), force=np.zeros(3),
        turning=turning_points(stage), cycle=np.ones(3, dtype=np.int64),
    )  # fmt: skip
    return build_model(case, mesh, history, none, BundledAdapter(), 1)


def test_the_grains_of_a_map_and_their_spread_are_those_of_the_model(tmp_path: Path) -> None:
    x, y = grid(4, 6)
    along = np.array(FIRST) + np.outer(x / 0.5 - 2.5, [4.5, 0.0, 0.0])
    write_ctf(tmp_path / "a.ctf", x, y, along)
    write_ctf(tmp_path / "b.ctf", x, y, SECOND)
    picked = (Grain(name=name, ebsd=f"{name}.ctf", ebsd_point_um=(1.0, 0.5)) for name in ("a", "b"))
    mapped = bicrystal(tmp_path, *picked)
    angles = (Grain(name="a", euler_deg=FIRST), Grain(name="b", euler_deg=SECOND))
    stated = bicrystal(tmp_path, *angles)
    found = mapped.microstructure.orientations
    np.testing.assert_allclose(found, stated.microstructure.orientations, atol=1e-6)
    # rms of ±2.25, ±6.75 and ±11.25°, a third of its square for each axis.
    wide = np.deg2rad(np.sqrt(np.mean([2.25**2, 6.75**2, 11.25**2]) / 3))
    for name, usual in stated.parameters.items():
        scale = wide if name.startswith("rotation_grain1") else usual.scale
        assert mapped.parameters[name].scale == pytest.approx(scale, rel=1e-6)


def test_equivalent_angles_make_the_same_loads(tmp_path: Path) -> None:
    second = Grain(name="b", euler_deg=SECOND)
    loads = []
    # The same, Φ beyond its range, and turns of the crystal about ⟨001⟩ and about ⟨111⟩.
    crystal = bunge_matrix(*FIRST)
    cyclic = bunge_angles(crystal[:, [1, 2, 0]])
    for angles in (FIRST, (101.0, -8.0, 227.0), (281.0, 8.0, 137.0), cyclic):
        model = bicrystal(tmp_path, Grain(name="a", euler_deg=angles), second)
        loads.append(model.predict(model.null_values() | {"elongation_1": 0.03}).load)
    assert np.abs(loads[0]).max() > 100
    for load in loads[1:]:
        np.testing.assert_allclose(load, loads[0], rtol=1e-6)
