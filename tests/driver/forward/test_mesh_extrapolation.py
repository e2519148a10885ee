"""What two meshes of one family tell of cells of no size."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from driver.forward.build import adapter_of, build_finer_model, build_model, mesh_of
from driver.forward.mesh_extrapolation import lacking_share
from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.virtual.truth import history_of_rows
from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from meshes.surface import trace
from solver_adapters.crystal import rotation_vector_matrix
from tools.converged_truth import known_case
from tools.mesh_reference import on_face

PRISM = PrismGeometry(length=6.0, boundaries=(GrainBoundary((0.0, 3.2, 0.0), (0.15, 1.0, 0.3)),))
FREE = ("tau0", "origin_X", "boundary_shift", "load_gain")


@cache
def mesh(kind: CellKind, size: float) -> PrismMesh:
    return generate(PRISM, size, kind)


def test_of_half_the_size_errors_of_these_orders_are_left_of_hexahedra() -> None:
    """2^(−3/2) and 2^(−1.25) of the working mesh's error, of which the difference is the rest."""
    working, finer = mesh("hex20", 2.0), mesh("hex20", 1.0)
    assert len(finer.cells) == 8 * len(working.cells)
    share = lacking_share(working, finer)
    assert share.motion == pytest.approx(0.54692, abs=1e-5)
    assert share.load == pytest.approx(0.72547, abs=1e-5)


@pytest.mark.parametrize(
    ("kinds", "sizes"),
    [
        (("tet10", "tet10"), (2.0, 1.2)),
        (("hex20", "tet10"), (2.0, 1.2)),
        (("hex20", "hex20"), (2.0, 2.0)),
        (("hex20", "hex20"), (1.0, 2.0)),
    ],
)
def test_meshes_of_no_family_or_no_finer_one_tell_nothing(
    kinds: tuple[CellKind, CellKind], sizes: tuple[float, float]
) -> None:
    working, finer = (mesh(kind, size) for kind, size in zip(kinds, sizes, strict=True))
    assert not lacking_share(working, finer)


@cache
def models() -> tuple[ForwardModel, ForwardModel, ForwardModel]:
    """On 1 and on 0.667 µm, and what a case of 2 and 0.667 µm makes of both."""
    known = known_case().with_values_at(
        {
            "specimen.length_um": 3.0,
            "specimen.boundary_point_um": (0.0, 1.4, 0.0),
            "solver.fine_steps_per_interval": 1,
        }
    )
    history = history_of_rows([(0.0, 0.0, True), (15.0, 40.0, True), (30.0, 30.0, True)])
    pixels = np.array([[0.1, 1.7], [0.87, 2.23]])
    adapter = adapter_of(known)
    coarser, finer = (
        build_model(known, mesh_of(known, size), history, pixels, adapter, 1)
        for size in (1.0, 0.667)
    )
    both = build_finer_model(known, mesh_of(known, 0.667), history, pixels, adapter)
    return coarser, finer, both


def values_of(model: ForwardModel) -> dict[str, float]:
    return model.null_values() | {"elongation_1": 0.02, "elongation_2": 0.018}


def predicted(model: ForwardModel, free: tuple[str, ...] = ()) -> Prediction:
    return model.predict(values_of(model), free)


@cache
def predictions() -> tuple[Prediction, Prediction, Prediction]:
    coarser, finer, both = (predicted(model, FREE) for model in models())
    return coarser, finer, both


def test_a_finer_mesh_far_from_the_working_one_is_extrapolated_with_one_between() -> None:
    coarser, finer, both = models()
    assert both.extrapolation is not None
    between = both.extrapolation.coarser.microstructure.mesh
    assert len(between.cells) == len(coarser.microstructure.mesh.cells)
    share = lacking_share(between, finer.microstructure.mesh)
    assert both.extrapolation.share == share and share.motion > 1.0
    near = known_case().with_values_at({"specimen.fine_mesh_size_um": 1.0})
    history = history_of_rows([(0.0, 0.0, True), (15.0, 40.0, True)])
    no_pixels = np.zeros((0, 2))
    alone = build_finer_model(near, mesh_of(near, 1.0), history, no_pixels, adapter_of(near))
    assert alone.extrapolation is None


def test_what_both_meshes_differ_by_is_added_in_its_share() -> None:
    coarser, finer, both = predictions()
    meshes = [model.microstructure.mesh for model in models()[:2]]
    share, faces = lacking_share(*meshes), [trace(mesh) for mesh in meshes]
    read = on_face(faces[0], coarser.surface, faces[1].points)
    for of_it, one, other, extrapolated in (
        (share.load, coarser.load, finer.load, both.load),
        (share.load, coarser.d_load, finer.d_load, both.d_load),
        (share.motion, read, finer.surface, both.surface),
    ):
        difference = of_it * (other - one)
        off = np.abs(extrapolated - other - difference).max()
        assert off < 1e-4 * np.abs(difference).max()


@pytest.mark.parametrize("name", FREE)
def test_derivatives_are_those_of_the_extrapolated_prediction(name: str) -> None:
    model, row = models()[2], FREE.index(name)
    step = 1e-3 * model.parameters[name].change(values_of(model)[name])
    above, below = (
        model.predict(values_of(model) | {name: values_of(model)[name] + side * step})
        for side in (1.0, -1.0)
    )
    both = predictions()[2]
    change = np.zeros(len(FREE))
    change[row] = 2 * step
    motion, load = both.along(change)
    np.testing.assert_allclose(
        above.load - below.load, load, rtol=2e-3, atol=1e-6 * np.abs(both.load).max() * step
    )
    moved = above.motion - below.motion
    np.testing.assert_allclose(moved, motion, rtol=0, atol=5e-3 * np.abs(moved).max())


def test_other_orientations_and_time_steps_reach_both_meshes() -> None:
    coarser, finer, both = models()
    turn = rotation_vector_matrix(np.array([0.2, 0.0, 0.1])) @ both.microstructure.orientations
    ends = np.linspace(0.0, 30.0, 9)[1:]
    loads = [
        predicted(m.with_orientations(turn).with_time_steps_of(ends, values_of(m))).load
        for m in (coarser, finer, both)
    ]
    share = lacking_share(*(m.microstructure.mesh for m in (coarser, finer))).load
    np.testing.assert_allclose(loads[2], loads[1] + share * (loads[1] - loads[0]), rtol=1e-9)
    assert np.abs(loads[2] - predictions()[2].load).max() > 1.0
