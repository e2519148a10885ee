"""What mechanics demands of any solution, on boxes of a few tetrahedra."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled import adapter, equilibrium
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.equilibrium import NotConvergedError
from solver_adapters.bundled.fem.state import Instant
from solver_adapters.bundled.linear.split_matrix import RESIDUAL
from solver_adapters.bundled.restart import FILE
from solver_adapters.bundled.sensitivities import Differentiation
from solver_adapters.bundled.stepping import Stepper
from solver_adapters.crystal import BCC, rotation_vector_matrix, schmid_tensors
from solver_adapters.interface import (
    Direction,
    Integration,
    Progress,
    Response,
    Simulation,
    SolverError,
    UnfinishedError,
    UnsupportedError,
)
from solver_adapters.material import Material, StrainMeasure
from solver_adapters.time_steps import once_more
from tools.boxes import BOXES, ORIENTATIONS, box, moved, one_grain, pulled

HISTORY = (0.002, 0.004, 0.008, 0.007)


def solve(simulation: Simulation) -> Response:
    return BundledAdapter().solve(simulation)


def test_both_ends_carry_the_same_force(measure: StrainMeasure) -> None:
    simulation = pulled(box(), Material(strain_measure=measure), HISTORY)
    ends = simulation.mesh.nodes
    nodes = {"S_PLUS": ends["S_MINUS"], "S_MINUS": ends["S_PLUS"]}
    other = replace(simulation, mesh=replace(simulation.mesh, nodes=nodes))
    force, reaction = solve(simulation).force, solve(other).force
    assert abs(force).max() > 500
    np.testing.assert_allclose(reaction, -force, atol=1e-8 * abs(force).max())


def test_turning_the_specimen_while_it_is_pulled_changes_no_finite_strain_force() -> None:
    """Objectivity; the turn is about Y, so that the answered component stays the same."""
    plain = pulled(box(), Material(strain_measure="finite"), HISTORY, tolerance=1e-10)
    ends = plain.motion_nodes
    start = plain.mesh.points[ends]
    motion = plain.motion.copy()
    for row, time in enumerate(plain.times):
        turn = rotation_vector_matrix(np.array([0.0, 0.003 * time, 0.0]))
        motion[row] = (start + plain.motion[row]) @ turn.T - start
    # A cut would replace a part of the turn by a straight line.
    turned = solve(replace(plain, motion=motion))
    expected = solve(plain)
    assert turned.cuts == 0
    np.testing.assert_allclose(turned.force, expected.force, rtol=1e-7)


def test_a_rigid_turn_leaves_a_finite_strain_box_without_force() -> None:
    mesh = box()

    def displacement(time: float, points: FloatArray) -> FloatArray:
        return points @ (rotation_vector_matrix(time * np.array([0.02, 0.05, -0.03])) - np.eye(3)).T

    ends = np.concatenate([mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]])
    times = np.array([0.0, 0.5, 1.0])
    response = solve(moved(mesh, Material(), ends, displacement, times))
    assert abs(response.force).max() < 1e-6
    np.testing.assert_allclose(
        response.displacement[-1], displacement(1.0, mesh.points), atol=1e-10
    )


def test_a_box_at_rest_carries_no_force_and_does_not_move(measure: StrainMeasure) -> None:
    response = solve(pulled(box(), Material(strain_measure=measure), (0.0, 0.0)))
    assert abs(response.force).max() < 1e-8  # rounding of RᵀR alone
    assert abs(response.displacement).max() < 1e-12


def test_a_free_bar_yields_at_the_load_of_schmid() -> None:
    """Elastic below τ0/μ with μ the largest Schmid factor; without hardening it stays there."""
    material = Material(strain_measure="small", c=0.0, K=1e-3, tau0=40.0)
    plain = pulled(one_grain(box()), material, (0.0002, 0.0003, 0.004, 0.006))
    mesh, nodes = plain.mesh, plain.motion_nodes
    at = mesh.points[nodes]
    mask = np.zeros((len(nodes), 3), dtype=np.bool_)
    mask[:, 1] = True  # the ends slide freely but for one node, and one that stops the spin
    mask[np.flatnonzero((at == np.array([0, 0, 0])).all(axis=1)), :] = True
    mask[np.flatnonzero((at == np.array([2, 0, 0])).all(axis=1)), 2] = True
    response = solve(replace(plain, motion_mask=mask))
    axis = ORIENTATIONS[0].T @ [0.0, 1.0, 0.0]
    factor = abs(np.einsum("i,sij,j->s", axis, schmid_tensors(BCC), axis)).max()
    yield_force = 4.0 * material.tau0 / factor
    elastic, before, first, second = response.force[1:]
    np.testing.assert_allclose(before, elastic * 3 / 2, rtol=1e-6)
    assert before < yield_force
    # The faces stay plane, which holds the single-slip lattice a little: hence not exactly equal.
    np.testing.assert_allclose([first, second], yield_force, rtol=1e-3)


def test_a_step_that_is_too_long_is_cut_and_ends_near_the_answer_of_many(
    measure: StrainMeasure,
) -> None:
    material = Material(strain_measure=measure)
    coarse = solve(pulled(box(), material, (0.05,)))
    fine = solve(pulled(box(), material, (0.05,), steps=100))
    assert coarse.cuts > 0
    assert fine.cuts == 0
    assert fine.steps == 100
    assert coarse.steps < 20
    np.testing.assert_allclose(coarse.force[-1], fine.force[-1], rtol=0.03)


def test_steps_grow_back_after_a_cut() -> None:
    """Five cuts make steps of 1/32: without growth there would be 32 of them."""
    response = solve(pulled(box(), Material(strain_measure="small"), (0.5,)))
    assert response.cuts >= 4
    assert response.steps < 2 ** (response.cuts - 1)


def test_a_step_without_solution_names_time_element_and_grain(measure: StrainMeasure) -> None:
    simulation = pulled(box(), Material(strain_measure=measure), (-150.0,))
    with pytest.raises(SolverError, match=r"no solution at t = .* s .*element \d+, grain [12]"):
        solve(simulation)


def test_a_run_that_fails_keeps_what_it_had_reached() -> None:
    simulation = pulled(box(), Material(strain_measure="finite"), (0.002, 0.004, -150.0))
    with pytest.raises(UnfinishedError) as failure:
        solve(simulation)
    whole = solve(pulled(box(), Material(strain_measure="finite"), (0.002, 0.004)))
    assert failure.value.reached == 2
    np.testing.assert_array_equal(failure.value.response.force, whole.force)
    np.testing.assert_array_equal(failure.value.response.displacement, whole.displacement)


def test_a_run_that_is_interrupted_goes_on_from_its_last_instant(tmp_path: Path) -> None:
    direction = Direction("tau0", material={"tau0": 1.0})
    simulation = replace(
        pulled(box(), Material(Q=10.0), HISTORY), directions=(direction,), accuracy=20.0
    )

    def interrupt(progress: Progress) -> None:
        if progress.time > 2.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        BundledAdapter().solve(simulation, tmp_path, interrupt)
    told: list[Progress] = []
    resumed = BundledAdapter().solve(simulation, tmp_path, told.append)
    whole = solve(simulation)
    assert [p.time for p in told] == [4.0]
    assert resumed.steps == whole.steps
    np.testing.assert_array_equal(resumed.ends, whole.ends)
    assert resumed.trajectory is not None and whole.trajectory is not None
    np.testing.assert_array_equal(resumed.trajectory.times, whole.trajectory.times)
    np.testing.assert_allclose(
        resumed.trajectory.displacement, whole.trajectory.displacement, atol=1e-9
    )
    for name in ("force", "displacement", "d_force", "d_displacement"):
        expected = getattr(whole, name)
        np.testing.assert_allclose(
            getattr(resumed, name), expected, rtol=0, atol=1e-8 * abs(expected).max()
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("between", "index"), [(0.0, 1), (np.inf, 0)])
def test_an_interruption_within_an_interval_goes_back_to_the_kept_instant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, between: float, index: int
) -> None:
    """The second interval is interrupted; the derivatives are those of the kept instant, too."""
    direction = Direction("tau0", material={"tau0": 1.0})
    simulation = replace(pulled(box(), Material(), HISTORY, steps=4), directions=(direction,))
    whole = solve(simulation)
    accept, calls = Stepper._accept, []
    monkeypatch.setattr(adapter, "_BETWEEN_KEPT", between)

    def interrupted(self: Stepper, *arguments: Any) -> Instant:
        calls.append(1)
        if len(calls) == 7:
            raise KeyboardInterrupt
        return accept(self, *arguments)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Stepper, "_accept", interrupted)
        BundledAdapter().solve(simulation, tmp_path)
    with np.load(tmp_path / FILE) as stored:
        assert stored["index"] == index
    resumed = BundledAdapter().solve(simulation, tmp_path)
    np.testing.assert_array_equal(resumed.ends, whole.ends)
    assert resumed.steps == whole.steps == 16
    for name in ("force", "d_force", "d_displacement"):
        expected = getattr(whole, name)
        np.testing.assert_allclose(
            getattr(resumed, name), expected, rtol=0, atol=1e-8 * abs(expected).max()
        )


def test_a_run_that_fails_answers_all_directions_of_what_it_had_reached() -> None:
    axes = np.eye(6).reshape(-1, 2, 3)
    turns = [Direction(f"turn {k}", rotation=axis) for k, axis in enumerate(axes)]
    again = Direction("again", rotation=np.ones((2, 3)))
    idle = Direction("b", material={"b": 1.0})
    simulation = pulled(box(), Material(strain_measure="finite"), (0.002, -150.0))
    with pytest.raises(UnfinishedError) as failure:
        solve(replace(simulation, directions=(*turns, idle, again)))
    found = failure.value.response.d_force
    assert found.shape == (8, failure.value.reached + 1)
    assert not found[6].any()
    np.testing.assert_allclose(found[7], found[:6].sum(axis=0), rtol=1e-12)


def test_derivatives_that_cannot_be_solved_for_end_the_run_with_their_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(self: Differentiation, *arguments: Any) -> None:
        raise NotConvergedError("the matrix is singular")

    monkeypatch.setattr(Differentiation, "derive", fails)
    direction = Direction("tau0", material={"tau0": 1.0})
    simulation = replace(pulled(box(), Material(), HISTORY), directions=(direction,))
    with pytest.raises(UnfinishedError, match="no derivatives at t = 1 s: the matrix is singular"):
        solve(simulation)


@pytest.mark.parametrize("index", [99, -1])
def test_a_checkpoint_beyond_the_run_is_not_taken_for_a_finished_one(
    tmp_path: Path, index: int
) -> None:
    simulation = pulled(box(), Material(), HISTORY)

    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        BundledAdapter().solve(simulation, tmp_path, interrupt)
    with np.load(tmp_path / FILE) as stored:
        arrays = {**stored, "index": np.array(index)}
    np.savez(tmp_path / FILE, **arrays)
    found = BundledAdapter().solve(simulation, tmp_path)
    np.testing.assert_array_equal(found.force, solve(simulation).force)


def test_an_interrupted_run_does_not_serve_another_simulation(tmp_path: Path) -> None:
    simulation = pulled(box(), Material(), HISTORY)

    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        BundledAdapter().solve(simulation, tmp_path, interrupt)
    other = replace(simulation, material=Material(tau0=41.0))
    np.testing.assert_array_equal(BundledAdapter().solve(other, tmp_path).force, solve(other).force)


@pytest.mark.parametrize("integration", ["exponential", "backward_euler"])
def test_steps_at_yield_and_at_a_reversal_are_refined_to_the_asked_accuracy(
    integration: Integration,
) -> None:
    plain = replace(
        pulled(box(), Material(strain_measure="small"), HISTORY), integration=integration
    )
    exact = solve(replace(plain, steps_per_interval=400)).force
    refined = solve(replace(plain, accuracy=1.0))
    assert refined.refinements > 0
    assert refined.cuts == 0
    assert abs(refined.force - exact).max() < 0.5 * abs(solve(plain).force - exact).max()
    reversal = np.diff(refined.ends[refined.ends >= 3.0])
    assert reversal.min() < 0.1  # of an interval of 1 s


def test_recorded_steps_are_taken_again_as_they_were() -> None:
    refined = replace(pulled(box(), Material(strain_measure="small"), HISTORY), accuracy=2.0)
    first = solve(refined)
    again = solve(replace(refined, accuracy=None, steps=first.ends))
    np.testing.assert_array_equal(again.ends, first.ends)
    np.testing.assert_allclose(again.force, first.force, rtol=1e-9)


def test_the_way_of_a_run_holds_every_node_at_the_end_of_every_step() -> None:
    refined = replace(pulled(box(), Material(), HISTORY), accuracy=5.0)
    found = solve(refined)
    assert found.trajectory is not None
    np.testing.assert_array_equal(found.trajectory.times, [refined.times[0], *found.ends])
    assert found.trajectory.displacement.shape == (1 + found.steps, len(refined.mesh.points), 3)
    rows = np.searchsorted(found.trajectory.times, refined.times[refined.output])
    np.testing.assert_array_equal(
        found.trajectory.displacement[rows][:, refined.output_nodes], found.displacement
    )


def test_steps_that_begin_far_from_equilibrium_are_cut_no_more_often_for_rough_systems(
    measure: StrainMeasure, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    soft = Material(strain_measure=measure, tau0=10.0, c=0.0, d=0.0)
    simulation = pulled(BOXES[kind](), soft, (0.003, 0.003))
    rough = solve(simulation)
    monkeypatch.setattr(equilibrium, "_accuracy", lambda *_: RESIDUAL)
    exact = solve(simulation)
    assert rough.cuts <= exact.cuts and rough.iterations <= 1.1 * exact.iterations


def test_a_run_that_was_cut_takes_the_same_steps_once_more(measure: StrainMeasure) -> None:
    """Beside its own way a whole step may converge that was cut without it."""
    strain = {"small": 0.005, "finite": 0.02}[measure]
    history = tuple(strain * k for k in (1, 2, 3))
    simulation = pulled(box(), Material(tau0=40.0, strain_measure=measure), history)
    first = solve(simulation)
    assert first.cuts > 0
    again = solve(once_more(simulation, first))
    np.testing.assert_allclose(again.ends, first.ends, rtol=1e-12)
    np.testing.assert_allclose(again.force, first.force, rtol=1e-6)


def test_a_run_beside_a_known_one_answers_the_same_in_fewer_iterations(
    measure: StrainMeasure,
) -> None:
    """The way of a motion twice as large saves none, and changes no answer either."""
    direction = Direction("tau0", material={"tau0": 1.0})
    simulation = replace(
        pulled(box(), Material(strain_measure=measure), HISTORY), directions=(direction,)
    )
    cold = solve(simulation)
    assert solve(replace(simulation, warm_start=cold.trajectory)).iterations == 0
    weaker = replace(simulation, material=Material(tau0=39.5, strain_measure=measure))
    faster = replace(simulation, motion=2.0 * simulation.motion)
    beside, far = (
        solve(replace(simulation, warm_start=solve(s).trajectory)) for s in (weaker, faster)
    )
    assert beside.iterations < 0.7 * cold.iterations
    for near in (beside, far):
        for name in ("force", "displacement", "d_force", "d_displacement"):
            expected = getattr(cold, name)
            np.testing.assert_allclose(
                getattr(near, name), expected, rtol=0, atol=1e-5 * abs(expected).max()
            )


NULLS = Material(
    Q=0.0,
    tau0_112=1.0,
    tau0_grain2=1.0,
    tau0_antitwinning=1.0,
    a1=0.0,
    h_latent=0.7,  # without Q
    Q_latent=0.0,
    c2=0.0,
    d2=17.0,  # without c2
    x0=0.0,
    eigenstrain=0.0,
    skin_tau0=1.0,
    skin_thickness=0.01,  # without skin_tau0
    tau0_grain1_slope_Y=0.0,
    tau0_grain1_bend_Y=0.0,
    tau0_grain1_slope_X=0.0,
    tau0_grain2_slope_Y=0.0,
    tau0_grain2_bend_Y=0.0,
    tau0_grain2_slope_X=0.0,
    tau0_grain1_band=0.0,
    tau0_grain1_band_middle=-0.7,  # without a band, as its half width and those of grain 2
    tau0_grain1_band_half_width=0.1,
    tau0_grain2_band=0.0,
    tau0_grain2_band_middle=0.4,
    tau0_grain2_band_half_width=0.6,
    elastic_scale=1.0,
    C44_scale=1.0,
)


def test_extensions_at_their_null_give_the_baseline_bit_for_bit(measure: StrainMeasure) -> None:
    plain = solve(pulled(box(), Material(strain_measure=measure), HISTORY))
    general = replace(NULLS, strain_measure=measure)
    null = replace(
        pulled(box(), general, HISTORY),
        directions=tuple(Direction(name, material={name: 1.0}) for name in ("c2", "a1", "x0")),
    )
    np.testing.assert_array_equal(solve(replace(null, directions=())).force, plain.force)
    # Derivatives carry more of the state; the linear systems are solved from other factors.
    np.testing.assert_allclose(solve(null).force, plain.force, rtol=1e-9)


def test_an_eigenstrain_stresses_a_specimen_that_is_held(measure: StrainMeasure) -> None:
    """Displacements count from the first instant, forces from the specimen without stress.

    Clamped against a stretch of ±9e-4/(2√18/√12) from one side to the other the outer fibres
    carry some 54 MPa before loading: the specimen yields earlier, and by the same net force.
    """
    strains = (0.0, 2e-4, 4e-4, 6e-4, 0.01)
    material = Material(strain_measure=measure, c=0.0)
    plain = solve(pulled(box(), material, strains)).force
    response = solve(pulled(box(), replace(material, eigenstrain=9e-4), strains))
    assert not response.displacement[0].any()
    assert abs(response.force[0]) < 0.02 * plain[-1]
    early = plain - response.force
    assert early[3] > 10.0
    assert abs(early[-1]) < 0.1 * early[3]


def test_an_eigenstrain_without_equilibrium_is_said_in_one_sentence() -> None:
    with pytest.raises(SolverError, match="^no equilibrium with the eigenstrain before loading: "):
        solve(pulled(box(), Material(eigenstrain=3.0, tau0=1e7), (0.0, 1e-5)))


def test_hardening_that_has_saturated_long_ago_is_constant() -> None:
    """b p goes beyond what exp can hold."""
    strains = (0.005, 0.01, 0.015)
    forces = [
        solve(pulled(box(), Material(strain_measure="small", tau0=t, Q=q, b=1e6), strains)).force
        for t, q in ((40.0, 20.0), (60.0, 0.0))
    ]
    np.testing.assert_allclose(forces[0][1:], forces[1][1:], rtol=1e-3)


def test_prior_cold_work_lowers_the_first_yield_and_is_forgotten() -> None:
    strains = tuple(np.linspace(0.0005, 0.01, 20))
    plain = solve(pulled(box(), Material(strain_measure="small"), strains)).force
    worked = solve(pulled(box(), Material(strain_measure="small", x0=-1e-4), strains)).force
    difference = worked - plain
    assert difference.min() < -5.0
    assert abs(difference[-1]) < 0.02 * abs(difference).max()


@pytest.mark.parametrize("kind", BOXES)
def test_a_skin_strengthens_a_thin_bar_more_than_a_thick_one(kind: str) -> None:
    def gain(size: float) -> float:
        mesh = BOXES[kind]()
        scaled = replace(mesh, points=size * mesh.points)
        forces = [
            solve(pulled(scaled, Material(strain_measure="small", skin_tau0=ratio), (0.01,))).force
            for ratio in (1.0, 1.5)
        ]
        return float(forces[1][-1] / forces[0][-1])

    assert gain(0.2) > gain(1.0) > gain(5.0) > 1.0


def test_progress_is_told_at_every_instant() -> None:
    told: list[Progress] = []
    simulation = pulled(box(), Material(strain_measure="small"), HISTORY)
    response = BundledAdapter().solve(simulation, progress=told.append)
    assert [p.time for p in told] == [1.0, 2.0, 3.0, 4.0]
    assert told[-1].end == 4.0
    assert told[1].remaining > 0 and told[-1].remaining == 0
    # The first interval compiles kernels where none are kept: it tells nothing of the others.
    assert np.isnan(told[0].remaining)
    assert told[-1].steps == response.steps == 4


def test_only_the_wanted_instants_and_nodes_are_answered() -> None:
    simulation = pulled(box(), Material(strain_measure="small"), HISTORY)
    whole = solve(simulation)
    nodes = np.array([7, 3])
    part = solve(replace(simulation, output=np.array([1, 3]), output_nodes=nodes))
    np.testing.assert_array_equal(part.force, whole.force[[1, 3]])
    np.testing.assert_array_equal(
        part.displacement, whole.displacement[np.ix_(np.array([1, 3]), nodes)]
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, 0.0) for name in ("C44", "K", "n", "tau0", "tau0_112", "elastic_scale")]
    + [("tau0_grain2", -1.0), ("C44_scale", -0.1)]
    + [(name, -1.0) for name in ("c", "d", "Q", "b")]
    + [(name, float("nan")) for name in ("K", "Q", "C11")],
)
def test_a_constant_out_of_its_range_is_refused_in_one_sentence(name: str, value: Any) -> None:
    material = replace(Material(), **{name: value})
    with pytest.raises(UnsupportedError, match=f"^{name} .*; expected ") as error:
        solve(pulled(box(), material, HISTORY))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("C11", "C12"), [(100e3, 120e3), (100e3, -60e3)])
def test_a_stiffness_that_is_not_positive_definite_is_refused(C11: float, C12: float) -> None:
    with pytest.raises(UnsupportedError, match="positive definite"):
        solve(pulled(box(), Material(C11=C11, C12=C12), HISTORY))
