from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile

from driver.case.model import load_case, write_case
from driver.diagnosis.causes.all_causes import NAMES
from driver.diagnosis.causes.causes import LIBRARY
from driver.experiment.image_sizes import StackSize, stack_size
from driver.forward.cost import steps_seconds
from driver.identification.correction_cost import correction_seconds
from driver.results.mesh_sizes import sized_case
from driver.workflow import cost
from driver.workflow.cost import Cost, estimate, identified_images, measuring_memory
from solver_adapters.bundled.adapter import BundledAdapter

ALPHA = Path(__file__).parents[3] / "examples" / "alpha"


def test_the_estimate_grows_with_the_work() -> None:
    case, bundled = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()
    base = estimate(case, bundled, 264, 97)
    assert estimate(case, bundled, 528, 97).seconds > 1.9 * base.seconds
    assert estimate(case, bundled, 264, 194).seconds == pytest.approx(2 * base.seconds)
    fewer = case.model_copy(update={"diagnosis": case.diagnosis.model_copy(update={"refit": 1})})
    assert estimate(fewer, bundled, 264, 97).seconds < base.seconds
    more = case.model_copy(
        update={"identification": case.identification.model_copy(update={"starts": 3})}
    )
    assert estimate(more, bundled, 264, 97).seconds > base.seconds
    assert estimate(more, bundled, 264, 97).simulations > base.simulations
    shaken = case.model_copy(
        update={"boundary": case.boundary.model_copy(update={"jitter_nm": 0.1})}
    )
    assert estimate(shaken, bundled, 264, 97).seconds > base.seconds


def test_the_estimate_of_the_demo_is_right_within_a_third() -> None:
    """On two cores of a Xeon: 157 s of identification, about 650 s of diagnosis.

    On another one they took 102 and 511 s.
    """
    case = sized_case(ALPHA / "case.toml")
    told = estimate(case, BundledAdapter().capabilities(), 181, 97)
    assert 0.75 < told.of_stages["identify"] / 157.0 < 4 / 3
    assert 0.75 < told.of_stages["diagnose"] / 650.0 < 4 / 3


def test_the_estimate_counts_no_more_refits_than_causes_that_are_asked_for() -> None:
    default, bundled = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()

    def simulations(**asked: Any) -> int:
        table = default.diagnosis.model_copy(update=asked)
        case = default.model_copy(update={"diagnosis": table})
        return estimate(case, bundled, 264, 97).simulations

    assert simulations(refit=10000) == simulations(refit=len(NAMES))
    of_one, looked_at = simulations(causes=("cold_work",)), simulations(causes=("load_lag",))
    assert of_one < looked_at < simulations(refit=1) < simulations()


def test_an_identification_counts_the_iterations_of_each_of_its_stages() -> None:
    """The demo, of at most 12 each, took 5 in A, 3 in B and 10 in C; a start ends before C."""
    one, three = ({"starts": n, "max_iterations": 12} for n in (1, 3))
    none = {"starts": 1, "max_iterations": 0}
    refits = with_tables(identification=none).simulations
    assert with_tables(identification=one).simulations - refits == 18
    assert with_tables(identification=three).simulations - refits == 18 + 2 * 12
    stage = {"motion": "stage", "stage_ratio": 4e-4, "stage_ratio_uncertainty": 1e-4}
    assert with_tables(boundary=stage, identification=one).simulations == 12


def test_the_estimate_counts_the_simulations_that_derivatives_cost() -> None:
    """Two for each of 31 directions, and the one that is asked for."""
    case, bundled = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()
    base = estimate(case, bundled, 264, 97)
    without = estimate(case, replace(bundled, derivatives=False), 264, 97)
    # Both sides of each bent cause are looked at in two rounds, for the motion alone; those of a
    # band in each of its places.
    bent = [cause for cause in LIBRARY if cause.strongly_nonlinear]
    sides = sum(1 if cause.kinked else 2 for cause in bent)
    looks = 2 * (sides + sum(2 * len(cause.places) for cause in LIBRARY))
    assert without.simulations - looks == 63 * (base.simulations - looks)
    # Of 264 cells the law takes 2.4 of the 7.3 ms of an iteration.
    slower = estimate(case, replace(bundled, cost=500.0), 264, 97)
    assert slower.seconds > 100 * base.seconds


def with_tables(**tables: dict[str, Any]) -> Cost:
    """The estimate of the example, with some keys of some tables changed."""
    case, bundled = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()
    changed = {name: getattr(case, name).model_copy(update=keys) for name, keys in tables.items()}
    return estimate(case.model_copy(update=changed), bundled, 264, 97)


def test_only_starts_and_refits_run_side_by_side() -> None:
    """Twice the processes halve what is independent; one fit after the other takes its time."""
    alone = {"starts": 1}, {"refit": 1, "causes": ("load_gain",)}
    seconds = [
        [
            with_tables(
                execution={"processes": n}, identification=alone[0] | {"starts": starts},
                diagnosis=alone[1],
            ).seconds
            for n in (1, 2, 4)
        ]
        for starts in (1, 4)
    ]  # fmt: skip
    for one, two, four in seconds:
        assert one - two == pytest.approx(2 * (two - four)) and two > 0.5 * one
    # Three starts more, all of them independent.
    more = [after - before for before, after in zip(*seconds, strict=True)]
    assert more[0] == pytest.approx(2 * more[1]) == pytest.approx(4 * more[2])


def test_each_process_beside_the_first_has_a_memory_of_its_own() -> None:
    one, two, three = (with_tables(execution={"processes": n}).memory for n in (1, 2, 3))
    # Who hands out holds what one process alone would.
    assert three - two == pytest.approx((two - one) / 2) and two > one


def test_the_finer_mesh_is_simulated_in_each_process() -> None:
    """Of two refits that lead both are corrected at a time."""
    size = load_case(ALPHA / "case.toml").specimen.mesh_size

    def of_a_process(fine_mesh_size: float) -> float:
        sizes = {"fine_mesh_size_um": fine_mesh_size}
        two, three = (
            with_tables(execution={"processes": n}, specimen=sizes).memory for n in (2, 3)
        )
        return three - two

    coarse, fine, finest = (of_a_process(size / n) for n in (1, 2, 3))
    # Cells grow with the square.
    assert finest - coarse == pytest.approx(8 / 3 * (fine - coarse), rel=0.02)
    assert fine > 1.5 * coarse


def test_the_second_mesh_is_simulated_in_each_process_and_without_derivatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def of_a_process(size: float) -> float:
        monkeypatch.setattr(cost, "size_of_second_mesh", lambda case: size)
        two, three = (with_tables(execution={"processes": n}).memory for n in (2, 3))
        return three - two

    coarse, fine, finest = (of_a_process(size) for size in (1.0, 0.25, 0.125))
    # The finer mesh with its derivatives takes more than a second one of its size.
    assert coarse == of_a_process(1.1) < fine < finest


def test_the_second_mesh_is_simulated_half_a_dozen_times(monkeypatch: pytest.MonkeyPatch) -> None:
    costs = []
    for size in (1.0, 0.125):
        monkeypatch.setattr(cost, "size_of_second_mesh", lambda case, size=size: size)
        costs.append(with_tables(execution={"processes": 1}))
    case, n = load_case(ALPHA / "case.toml"), 264
    solver = BundledAdapter().capabilities()
    large, small = (
        correction_seconds(case, solver, n, 97, size, (0,) * 6) for size in (0.125, 1.0)
    )
    assert costs[1].seconds - costs[0].seconds == pytest.approx(large - small)
    # One process alone holds it, too.
    assert costs[1].memory > 1.2 * costs[0].memory


@pytest.mark.parametrize(
    ("cause", "sides_and_places", "finer"),
    [("boundary_bow", 2, 1), ("band_grain2", 8, 2), ("load_lag", 1, 0), ("cold_work", 0, 0)],
)
def test_looks_that_promise_most_are_simulated_finer(
    cause: str, sides_and_places: int, finer: int
) -> None:
    case, solver = load_case(ALPHA / "case.toml"), BundledAdapter().capabilities()
    size = 0.5 * case.specimen.mesh_size

    def seconds(*causes: str) -> float:
        return with_tables(
            diagnosis={"causes": causes, "refit": 1},
            execution={"processes": 1},
            specimen={"fine_mesh_size_um": size},
        ).seconds

    intervals = 2 * 97 * case.solver.steps_per_interval
    look = steps_seconds(case, solver, 264, intervals, 0)
    one = correction_seconds(case, solver, 264, 97, size, (0,))
    more = seconds("cold_work", cause) - seconds("cold_work", "height_scale")
    assert more == pytest.approx(2 * sides_and_places * look + finer * one)


def test_each_refit_keeps_its_derivatives_at_the_pixels_of_the_face() -> None:
    case = load_case(ALPHA / "case.toml")
    one, two, every = (with_tables(diagnosis={"refit": n}).memory for n in (1, 2, len(NAMES)))
    pixels = case.specimen.length * case.specimen.width / case.images.pixel_um**2
    directions = len(case.identification.parameters) + 28  # 4 λ's, 6 knots of each of 4 motions
    assert two - one == pytest.approx(8 * directions * pixels * 97, rel=1e-6)
    assert with_tables(diagnosis={"refit": 10000}).memory == every


def test_the_finer_mesh_costs_with_the_square_of_the_ratio_of_the_sizes() -> None:
    case = load_case(ALPHA / "case.toml")
    size = case.specimen.mesh_size
    fine = [with_tables(specimen={"fine_mesh_size_um": size / n}).seconds for n in (2, 3, 4)]
    # Points grow with 4, 9, 16, factorisations with the power 1.5 of them.
    assert 7 / 5 < (fine[2] - fine[1]) / (fine[1] - fine[0]) < (64 - 27) / (27 - 8)


def test_without_images_nothing_is_refitted_looked_at_or_correlated() -> None:
    stage = {"motion": "stage", "stage_ratio": 4e-4, "stage_ratio_uncertainty": 1e-4}
    alone = with_tables(boundary=stage)
    assert alone.simulations == with_tables(boundary=stage, diagnosis={"refit": 50}).simulations
    finer_pixels = {"pixel_size_nm": 1.0}
    assert with_tables(boundary=stage, images=finer_pixels).seconds == alone.seconds
    assert with_tables(images=finer_pixels).seconds > with_tables().seconds
    assert alone.memory < with_tables().memory


@pytest.mark.parametrize("name", ["images.tif", "images", "images.npy", "images.h5:/frames"])
def test_the_memory_of_images_is_told_from_the_headers_of_their_files(
    tmp_path: Path, name: str
) -> None:
    levels = np.random.default_rng(0).integers(1, 200, size=(7, 300, 400), dtype=np.uint8)
    if name == "images":
        (tmp_path / name).mkdir()
        for t, frame in enumerate(levels):
            tifffile.imwrite(tmp_path / name / f"{t}.tif", frame)
    elif name == "images.npy":
        np.save(tmp_path / name, levels)
    elif name == "images.tif":
        tifffile.imwrite(tmp_path / name, levels, photometric="minisblack")
    else:
        with h5py.File(tmp_path / "images.h5", "w") as file:
            file["frames"] = levels
    write_case(load_case(ALPHA / "case.toml"), tmp_path / "case.toml")
    case = load_case(tmp_path / "case.toml").with_values_at({"images.frames": name})
    assert stack_size(case, "frames") == StackSize(7, 300 * 400, 1)
    without = case.with_values_at({"images.frames": "absent.tif"})
    assert stack_size(without, "frames") is None and stack_size(case, "flats") is None
    # An image more stays in its file; identified, its spline is kept.
    for told, each in ((measuring_memory, 0), (identified_images, 8)):
        more = [told(case, n) - told(without, n) for n in (1000, 2000)]
        assert more[1] - more[0] == pytest.approx(1000 * each * 300 * 400)
