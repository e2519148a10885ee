from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tifffile

from driver.case.model import Case, load_case
from driver.experiment.reading import read_experiment
from driver.forward import build
from driver.identification.priors import LAMBDA_PRIOR
from driver.identification.problem import IdentificationProblem, build_problem, seen_by_correlation
from driver.parameters.boundary import LAMBDAS
from meshes.prism import generate
from tools import closed_form
from tools.closed_form import KNOTS, LAW, TILTS

BENCH = closed_form.problem()


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    folder = tmp_path_factory.mktemp("problem")
    closed_form.write_files(folder, {})
    return load_case(folder / "case.toml")


@pytest.fixture(autouse=True)
def solver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver())


def built(case: Case, **tables: dict[str, object]) -> IdentificationProblem:
    update = {name: getattr(case, name).model_copy(update=u) for name, u in tables.items()}
    weights = BENCH.model.boundary.weights
    changed = case.model_copy(update=update)
    motion = BENCH.model.predict(BENCH.truth).motion
    edges = (weights @ [0.0, *KNOTS], weights @ [0.0, *TILTS])
    experiment = read_experiment(changed)
    images = build.surface_images(changed, experiment)
    return build_problem(
        changed,
        BENCH.mesh,
        generate(build.geometry_of(case), 1.0),
        seen_by_correlation(experiment, images, motion, *edges),
    )


def test_knots_start_as_measured_and_all_else_at_its_null(case: Case) -> None:
    problem = built(case)
    assert problem.start == pytest.approx(BENCH.truth)
    assert problem.law == LAW and set(problem.knots) >= {"elongation_4", "tilt_4", "origin_X"}
    assert problem.finer.steps_per_interval == 2 and problem.working.steps_per_interval == 1
    assert problem.finer.surface_nodes.size > problem.working.surface_nodes.size


def test_at_the_truth_only_noise_is_left(case: Case) -> None:
    problem = built(case)
    found = problem.objective.evaluate(BENCH.truth, ())
    assert found.chi_load == pytest.approx(1.0, abs=0.3)
    assert found.chi_image == pytest.approx(1.0, abs=0.1)


def test_a_noise_map_weighs_the_pixels(case: Case) -> None:
    noise = np.random.default_rng(2).uniform(1.0, 3.0, closed_form.SHAPE).astype(np.float32)
    tifffile.imwrite(case.path("noise_map.tif"), noise)
    image = built(case, images={"noise_map": "noise_map.tif"}).objective.data.image
    variance = noise[image.images.rows, image.images.cols] ** 2
    assert image.variance is not None
    np.testing.assert_allclose(image.variance, variance / variance.mean(), rtol=1e-6)
    assert built(case).objective.data.image.variance is None


def test_flats_show_what_their_pattern_would_do(case: Case) -> None:
    rng = np.random.default_rng(4)
    pattern = rng.normal(0.0, 0.01, closed_form.SHAPE)
    flats = (pattern + rng.normal(0.0, 0.001, (3, *pattern.shape))).astype(np.float32)
    images: dict[str, object] = {"flats": "flats.tif"}
    levels = 1e3 * flats / case.images.height_per_level_nm
    tifffile.imwrite(case.path("flats.tif"), levels, photometric="minisblack")
    problem = built(case, images=images)
    rise = problem.working.pattern
    assert rise is not None and rise.shape == (BENCH.history.n_images, len(problem.images.xy))
    assert problem.finer.pattern is rise and problem.objective.model.pattern is rise
    assert np.abs(rise).max() > 1e-3 and built(case).working.pattern is None


def test_priors_have_the_widths_of_the_case(case: Case) -> None:
    prior = built(
        case,
        identification={"prior_width": {"tau0": 0.2}},
        boundary={"lambda_start": case.boundary.lambda_start.model_copy(update={"plus_Z": 1.1})},
        images={"origin_uncertainty_px": 0.25},
    ).objective.prior
    assert prior["tau0"] == (40.0, 0.2) and prior["c"] == (40e3, 1.0)
    parameters = BENCH.model.null_values()
    assert set(prior) == {name for name in parameters if name.startswith("lambda_")} | {
        *LAW, "origin_X", "origin_Y",
    }  # fmt: skip
    # Widths are in θ: λ has a scale of 0.1, the origin one of 0.05 µm.
    assert prior["lambda_plus_Z"] == pytest.approx((1.1, LAMBDA_PRIOR / 0.1))
    assert prior["origin_Y"] == pytest.approx((0.0, 0.25 * 0.11 / 0.05))


def test_a_poorly_known_section_is_a_free_gain_of_the_load(case: Case) -> None:
    problem = built(case, sections={"relative_uncertainty": 0.3})
    assert problem.law == (*LAW, "load_gain")
    # A gain has a scale of 0.03: 30 % are ten of them.
    assert problem.objective.prior["load_gain"] == pytest.approx((0.0, 10.0))


def test_what_is_stated_of_zero_and_clock_of_the_load_is_a_prior(case: Case) -> None:
    problem = built(case, loads={"offset_uncertainty_uN": 5.0, "clock_uncertainty_s": 1.5})
    assert problem.law == (*LAW, "load_offset", "load_lag")
    # Their scales are 10 µN and 3 s.
    assert problem.objective.prior["load_offset"] == pytest.approx((0.0, 0.5))
    assert problem.objective.prior["load_lag"] == pytest.approx((0.0, 0.5))


def test_extensions_are_freed_from_their_start_with_a_prior_about_their_null(case: Case) -> None:
    extended = case.model_copy(update={"extensions": {"tau0_112": 1.2, "tilt_drift": 1e-3}})
    problem = built(extended, material={"tau0_112": 1.05})
    assert problem.law == (*LAW, "tau0_112", "tilt_drift")
    assert problem.start["tau0_112"] == 1.2 and problem.start["tilt_drift"] == 1e-3
    prior = problem.objective.prior
    assert prior["tau0_112"][0] == 1.05 and prior["tau0_112"][1] == pytest.approx(3 * 0.10)
    assert prior["tilt_drift"] == (0.0, 3.0)


def test_in_the_rigid_gauge_there_is_no_tilt_to_find(case: Case) -> None:
    problem = built(case, boundary={"gauge": "rigid"})
    assert not [name for name in problem.knots if name.startswith("tilt")]
    assert all(problem.start[f"tilt_{k}"] == 0.0 for k in range(1, 5))
    assert problem.objective.data.image.rigid.shape[0] == 6
    turned = replace(problem.objective).evaluate(problem.start | {"tilt_2": 0.004}, ())
    still = problem.objective.evaluate(problem.start, ())
    assert np.abs(turned.residual - still.residual).max() < 0.1


def test_the_plan_is_that_of_the_case(case: Case) -> None:
    plan = built(
        case,
        identification={"order": "paper", "starts": 3, "max_iterations": 7},
        boundary={"jitter_nm": 0.4},
        execution={"processes": 5, "threads": 2},
    ).plan
    assert (plan.order, plan.starts, plan.most) == ("paper", 3, 7)
    assert plan.jitter == pytest.approx(4e-4) and (plan.processes, plan.threads) == (5, 2)
    assert plan.sizes == (case.specimen.mesh_size, case.specimen.fine_mesh_size)
    assert set(plan.spread) == {*LAMBDAS, *LAW}


def test_lambda_star_counts_the_images_that_are_fitted(case: Case) -> None:
    problem = built(case, identification={"prior": "tikhonov", "lambda_star": 1e-6})
    n_pixels = len(problem.images.xy)
    assert problem.objective.prior["c"][1] == pytest.approx(
        (2 * 44 * (1 + n_pixels) * 1e-6) ** -0.5
    )
    assert "origin_X" in problem.objective.prior
    assert set(built(case, identification={"prior": "none"}).objective.prior) == {
        "origin_X", "origin_Y",
    }  # fmt: skip
