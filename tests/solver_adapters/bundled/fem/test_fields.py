"""Crystal frames, skin and state at rest over a mesh, and how they move along directions."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.element import Element, element_of, gauss_positions
from solver_adapters.bundled.fem.fields import (
    AtRest,
    at_rest,
    at_rest_change,
    crystal_frames,
    frame_change,
)
from solver_adapters.bundled.law.law import STRAIN_MODES
from solver_adapters.bundled.law.state_layout import N_STATE, S_OVER, S_X, S_X2
from solver_adapters.interface import Direction, Simulation
from solver_adapters.material import Material, with_parameters
from tools.boxes import BOXES, ORIENTATIONS, one_grain, pulled

GRADIENT = np.array([[0.02, -0.01, 0.03], [-0.015, 0.04, 0.01]])  # rad/µm
SIZE = (2.0, 4.0, 3.0)
GENERAL = Material(
    strain_measure="small", x0=5e-5, eigenstrain=3e-4, skin_tau0=1.3, skin_thickness=0.4
)
VARYING = Material(
    strain_measure="small",
    tau0_grain1_slope_Y=0.3, tau0_grain1_bend_Y=-0.2, tau0_grain1_slope_X=0.1,
    tau0_grain2_slope_Y=-0.25, tau0_grain2_bend_Y=0.4, tau0_grain2_slope_X=-0.15,
)  # fmt: skip
GRAIN_2 = {"tau0_grain2_slope_Y": 0.3, "tau0_grain2_bend_Y": -1.0, "tau0_grain2_slope_X": 0.5}
BANDED = Material(
    strain_measure="small",
    tau0_grain1_band=-0.5, tau0_grain1_band_middle=-0.2, tau0_grain1_band_half_width=0.3,
    tau0_grain2_band=0.4, tau0_grain2_band_middle=0.6, tau0_grain2_band_half_width=0.5,
)  # fmt: skip


def _simulation(kind: str, material: Material = GENERAL, jitter: float = 0.0) -> Simulation:
    return pulled(BOXES[kind]((2, 4, 2), SIZE, jitter), material, (0.0,))


def _at(simulation: Simulation) -> FloatArray:
    """Gauss points, (n_points, 3)."""
    mesh = simulation.mesh
    return gauss_positions(mesh.points, mesh.cells, _element(simulation)).reshape(-1, 3)


def _element(simulation: Simulation) -> Element:
    return element_of(simulation.mesh.cells)


def _rest(simulation: Simulation) -> AtRest:
    element = _element(simulation)
    return at_rest(simulation, element, crystal_frames(simulation, element))


def _share(material: Material, state: FloatArray) -> FloatArray:
    """Plastic strain of states of small strain over the eigenstrain, (n_points, 3, 3)."""
    modes = state[:, :5]
    return np.asarray(np.einsum("pk,kij->pij", modes, STRAIN_MODES[:5]) / material.eigenstrain)


def test_a_lattice_gradient_turns_each_point_with_its_distance_from_the_centroid_of_its_grain(
    kind: str,
) -> None:
    """A rotation vector linear in Y, null at the mean of its grain: the halves meet at Y = 2."""
    simulation = replace(_simulation(kind), lattice_gradient=GRADIENT)
    frames = crystal_frames(simulation, _element(simulation))
    y = _at(simulation)[:, 1]
    np.testing.assert_array_equal(frames.of_point, np.arange(y.size))
    grain = (y > 2.0).astype(np.int64)
    vectors = GRADIENT[grain] * (y - np.array([1.0, 3.0])[grain])[:, None]
    expected = Rotation.from_rotvec(vectors).as_matrix() @ ORIENTATIONS[grain]
    np.testing.assert_allclose(frames.rotation, expected, atol=1e-13)


def test_without_a_gradient_a_grain_has_one_frame_and_a_null_gradient_the_same_one(
    kind: str,
) -> None:
    simulation = _simulation(kind)
    frames = crystal_frames(simulation, _element(simulation))
    np.testing.assert_array_equal(frames.rotation, ORIENTATIONS)
    grain = np.repeat(simulation.mesh.grain, len(_element(simulation).weights))
    np.testing.assert_array_equal(frames.of_point, grain)
    asked = Direction("gradient", lattice_gradient=GRADIENT)
    spread = crystal_frames(replace(simulation, directions=(asked,)), _element(simulation))
    assert len(spread.rotation) == grain.size
    np.testing.assert_allclose(spread.rotation, ORIENTATIONS[grain], atol=1e-15)


def _along(simulation: Simulation, direction: Direction, step: float) -> Simulation:
    """The simulation at a distance along a direction; its directions keep its frames."""
    s = simulation
    if direction.rotation is not None:
        turns = Rotation.from_rotvec(step * direction.rotation).as_matrix()
        s = replace(s, orientations=turns @ s.orientations)
    if direction.lattice_gradient is not None:
        start = np.zeros((2, 3)) if s.lattice_gradient is None else s.lattice_gradient
        s = replace(s, lattice_gradient=start + step * direction.lattice_gradient)
    if direction.points is not None:
        points = s.mesh.points + step * direction.points
        s = replace(s, mesh=replace(s.mesh, points=points))
    changes = {n: getattr(s.material, n) + step * v for n, v in direction.material.items()}
    return replace(s, material=replace(s.material, **changes))


def _directions(simulation: Simulation) -> dict[str, Direction]:
    bump = np.sin(simulation.mesh.points[:, [1, 2, 0]] + 0.4)
    turn = np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])
    gradient = np.array([[0.2, 0.1, -0.3], [0.1, -0.2, 0.3]])
    return {
        "rotation": Direction("rotation", rotation=turn),
        "gradient": Direction("gradient", lattice_gradient=gradient),
        "points": Direction("points", points=bump),
        "x0": Direction("x0", material={"x0": 1e-4}),
        "eigenstrain": Direction("eigenstrain", material={"eigenstrain": 1e-3}),
        "skin": Direction("skin", material={"skin_tau0": 1.0, "skin_thickness": 0.3}),
        "modes": Direction("modes", material={"tau0_grain1_bend_Y": 1.0, **GRAIN_2}),
        "band": Direction(
            "band",
            material={
                "tau0_grain1_band": 1.0,
                "tau0_grain1_band_middle": 0.5,
                "tau0_grain2_band_half_width": 0.7,
            },
        ),
        "mixed": Direction(
            "mixed",
            material={"x0": 1e-4, "eigenstrain": 1e-3, "skin_tau0": -0.5, **GRAIN_2},
            rotation=turn,
            lattice_gradient=gradient,
            points=bump,
        ),
    }


@pytest.mark.parametrize(
    "name",
    ["rotation", "gradient", "points", "x0", "eigenstrain", "skin", "modes", "band", "mixed"],
)
@pytest.mark.parametrize("material", [GENERAL, VARYING, BANDED], ids=["skin", "modes", "band"])
def test_changes_are_difference_quotients(name: str, kind: str, material: Material) -> None:
    material = replace(material, x0=5e-5, eigenstrain=3e-4)
    plain = replace(_simulation(kind, material, jitter=0.2), lattice_gradient=GRADIENT)
    direction = _directions(plain)[name]
    step = 1e-5
    high, low = (_along(plain, direction, sign * step) for sign in (1, -1))
    frames, above, below = (crystal_frames(s, _element(s)) for s in (plain, high, low))
    drotation = frame_change(plain, _element(plain), direction)
    expected = (above.rotation - below.rotation) / (2 * step)
    np.testing.assert_allclose(drotation, expected, atol=1e-9)
    change = at_rest_change(plain, _element(plain), direction, frames, drotation)
    assert change is not None
    up, down = at_rest(high, _element(high), above), at_rest(low, _element(low), below)
    for found, quotient in (
        (change.state, (up.state - down.state) / (2 * step)),
        (change.skin, (up.skin - down.skin) / (2 * step)),
    ):
        np.testing.assert_allclose(found, quotient, atol=1e-7 * max(abs(quotient).max(), 1e-5))


def test_a_direction_without_part_in_the_state_at_rest_has_no_change_of_it() -> None:
    simulation = _simulation("tet10", Material())
    frames = crystal_frames(simulation, _element(simulation))
    null = np.zeros_like(frames.rotation)
    assert (
        at_rest_change(
            simulation, _element(simulation), Direction("c", material={"c": 1.0}), frames, null
        )
        is None
    )
    felt = at_rest_change(
        simulation, _element(simulation), Direction("x0", material={"x0": 1.0}), frames, null
    )
    assert felt is not None and felt.state[:, S_X:S_OVER].any()


def test_an_eigenstrain_is_linear_in_depth_and_without_mean(kind: str) -> None:
    """Along Y of the specimen; the shape keeps its volume and the section stays plane."""
    simulation = replace(
        pulled(one_grain(BOXES[kind]((2, 4, 2), SIZE)), GENERAL, (0.0,)),
        orientations=np.eye(3)[None],
    )
    strain = _share(
        GENERAL,
        at_rest(
            simulation, _element(simulation), crystal_frames(simulation, _element(simulation))
        ).state,
    )
    axial, z = strain[:, 1, 1], _at(simulation)[:, 2]
    np.testing.assert_allclose(strain[:, 0, 0], -axial / 2, atol=1e-13)
    np.testing.assert_allclose(strain[:, 2, 2], -axial / 2, atol=1e-13)
    slope, offset = np.polyfit(z, axial, 1)
    np.testing.assert_allclose(axial, slope * z + offset, atol=1e-12)
    np.testing.assert_allclose(offset, -slope * SIZE[2] / 2, rtol=1e-12)
    assert abs(slope) > 0.1


def test_the_skin_counts_the_distance_from_the_free_sides_alone(kind: str) -> None:
    """The end faces at Y = 0 and 4 are held: no skin grows there."""
    simulation = _simulation(kind)
    x, _, z = _at(simulation).T
    distance = np.min([x, SIZE[0] - x, z, SIZE[2] - z], axis=0)
    expected = 1 + 0.3 * np.exp(-distance / 0.4)
    found = at_rest(
        simulation, _element(simulation), crystal_frames(simulation, _element(simulation))
    ).skin
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def _factor(simulation: Simulation) -> FloatArray:
    return _rest(simulation).skin


def test_inside_each_grain_tau0_follows_three_modes_along_y_and_x(kind: str) -> None:
    """In a uniform bar η and ξ run from −1 to 1: each grain is 2 µm long and 2 µm wide."""
    simulation = _simulation(kind, VARYING)
    x, y, _ = _at(simulation).T
    second = y > 2.0
    eta, xi = np.where(second, y - 3.0, y - 1.0), x - 1.0
    coefficients = (
        np.where(second, high, low) for low, high in ((0.3, -0.25), (-0.2, 0.4), (0.1, -0.15))
    )
    slope_y, bend_y, slope_x = coefficients
    expected = np.exp(slope_y * eta + bend_y * (1.5 * eta**2 - 0.5) + slope_x * xi)
    np.testing.assert_allclose(_factor(simulation), expected, rtol=1e-12)


def test_a_band_across_a_grain_has_its_height_in_its_middle_and_a_half_of_it_where_it_ends(
    kind: str,
) -> None:
    """Each grain is 2 µm long, so that η is the distance from its middle in µm."""
    simulation = _simulation(kind, BANDED)
    y = _at(simulation)[:, 1]
    second = y > 2.0
    height, middle, half_width = (
        np.where(second, high, low) for low, high in ((-0.5, 0.4), (0.8, 3.6), (0.3, 0.5))
    )
    found = _factor(simulation)
    shape = 0.5 ** (((y - middle) / half_width) ** 4)
    np.testing.assert_allclose(found, np.exp(height * shape), rtol=1e-12)
    within, share = abs(y - middle) < half_width, np.log(found) / height
    assert within.any() and (share[within] > 0.5).all() and (share[~within] < 0.5).all()


def test_a_band_multiplies_the_modes(kind: str) -> None:
    modes, band = (_factor(_simulation(kind, material)) for material in (VARYING, BANDED))
    names = [f.name for f in fields(Material) if "_band" in f.name]
    both = with_parameters(VARYING, {name: getattr(BANDED, name) for name in names})
    np.testing.assert_allclose(_factor(_simulation(kind, both)), modes * band, rtol=1e-14)


def test_modes_multiply_the_skin(kind: str) -> None:
    skin = _factor(_simulation(kind, GENERAL))
    modes = _factor(_simulation(kind, VARYING))
    both = replace(VARYING, skin_tau0=1.3, skin_thickness=0.4)
    np.testing.assert_allclose(_factor(_simulation(kind, both)), skin * modes, rtol=1e-14)


def test_in_a_single_grain_the_modes_of_the_second_act_on_nothing(kind: str) -> None:
    whole = replace(_simulation(kind, VARYING), mesh=one_grain(_simulation(kind).mesh))
    whole = replace(whole, orientations=whole.orientations[:1])
    _, y, _ = _at(whole).T
    first = replace(
        whole, material=Material(tau0_grain1_slope_Y=0.3, tau0_grain1_bend_Y=-0.2,
                                 tau0_grain1_slope_X=0.1),
    )  # fmt: skip
    np.testing.assert_array_equal(_factor(whole), _factor(first))
    only = replace(whole, material=with_parameters(Material(), dict.fromkeys(GRAIN_2, 0.3)))
    assert (_factor(only) == 1.0).all()
    slope = replace(whole, material=Material(tau0_grain1_slope_Y=0.3))
    np.testing.assert_allclose(_factor(slope), np.exp(0.3 * (y - 2.0) / 2.0), rtol=1e-12)


def test_without_modes_the_factor_is_one_to_the_last_bit(kind: str) -> None:
    assert (_factor(_simulation(kind, Material())) == 1.0).all()


def test_a_second_back_strain_is_carried_where_it_has_an_effect_or_a_derivative() -> None:
    plain = _simulation("tet10", Material())
    asked = replace(plain, directions=(Direction("c2", material={"c2": 1.0}),))
    for simulation, size in (
        (plain, S_X2),
        (_simulation("tet10", Material(c2=100.0)), N_STATE),
        (asked, N_STATE),
    ):
        assert (
            at_rest(
                simulation, _element(simulation), crystal_frames(simulation, _element(simulation))
            ).state.shape[1]
            == size
        )
