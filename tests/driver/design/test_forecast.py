"""Forecasts with the solver in closed form, against the fit of its virtual experiment."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.case.model import Case, load_case
from driver.design.comparison import gain, pairs
from driver.design.forecast import (
    Forecast,
    Plan,
    can_serve,
    forecast,
    prepare,
    simulate,
    whole_forecast,
)
from driver.design.settings import Settings, read_change
from driver.design.surface import expected_surface
from driver.design.variants import base_variant, variant
from driver.experiment.history import read_history
from driver.forward import build
from driver.results.files import IDENTIFY
from driver.workflow import pipeline
from driver.workflow.engine import run_stages
from tools import closed_form

PATH = Path("--change")


@pytest.fixture(scope="module", autouse=True)
def closed() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver(0.001)
        )
        yield


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an experiment that was made, and identified."""
    folder = tmp_path_factory.mktemp("made")
    closed_form.write_files(folder, {})
    path = folder / "case.toml"
    run_stages(load_case(path), pipeline.stages(load_case(path)), "identify")
    return folder


def plan_of(case: Case, settings: Settings) -> Plan:
    history = read_history(case.path("history.csv"), with_loads=False)
    surface = expected_surface(case, settings, history)
    return Plan(base_variant(case, settings), history, surface, settings, None)


def identified(folder: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard deviations of the fit."""
    with h5py.File(folder / "results" / IDENTIFY) as file:
        names, values = (json.loads(file.attrs[key]) for key in ("names", "all_values"))
        return {n: values[n] for n in names}, dict(zip(names, file["sigma"][()], strict=True))


@pytest.fixture(scope="module")
def base(fitted: Path) -> Plan:
    values, _ = identified(fitted)
    return plan_of(load_case(fitted / "case.toml"), Settings(truth=values))


@pytest.fixture(scope="module")
def before(base: Plan) -> Forecast:
    return whole_forecast(base)


def test_what_was_predicted_is_the_covariance_of_the_fit(before: Forecast, fitted: Path) -> None:
    """Images and loads were not looked at. The gradient is that of ten repeats, not of all."""
    _, sigma = identified(fitted)
    assert {p.name for p in before.parameters} == set(sigma)
    for p in before.parameters:
        assert p.sigma == pytest.approx(sigma[p.name], rel=0.07), p.name


def changed(base: Plan, text: str) -> Forecast:
    """The forecast of a change that needs no simulation."""
    plan = replace(base, variant=variant(base.variant, text, read_change(text), PATH))
    simulated, own = simulate(prepare(base)), prepare(plan)
    assert plan.variant.simulated_as(base.variant) and can_serve(simulated, own)
    return forecast(own, simulated)


def test_less_noise_and_more_images_never_know_less(base: Plan, before: Forecast) -> None:
    for text in (
        "test.images_per_stop=2", "loads.noise_uN=0.5", "images.noise_nm=4.5", "test.repeats=20",
        "test.exact_simulation=true",
    ):  # fmt: skip
        after = changed(base, text)
        won = gain(before, after)
        assert max(won.sigma.values()) <= 1.0 + 1e-9, text
        assert max(won.seen.values()) <= 1.0 + 1e-9, text
        assert min(won.sigma.values()) < 0.999, text


def test_what_hexahedra_leave_of_the_loads_counts_in_a_forecast(base: Plan) -> None:
    """Of tau0 an exact simulation would tell 2 % more, where motions alone count a hundredth."""
    case = base.variant.case
    hexahedra = {"cells": "hex20", "mesh_size_um": 1.0, "fine_mesh_size_um": 0.5}
    specimen = case.specimen.model_copy(update=hexahedra)
    coarse = replace(base.variant, case=case.model_copy(update={"specimen": specimen}))
    plan = replace(base, variant=coarse)
    won = gain(whole_forecast(plan), changed(plan, "test.exact_simulation=true"))
    assert won.sigma["tau0"] < 0.985 and won.seen["load_gain"] < 0.99


def test_a_planned_test_has_no_wrong_loads(base: Plan) -> None:
    case = base.variant.case
    loads = case.loads.model_copy(update={"left_out": (0, 1, 2, 999)})
    asked = replace(base.variant, case=case.model_copy(update={"loads": loads}))
    whole, less = (
        prepare(plan).problem.objective.data for plan in (base, replace(base, variant=asked))
    )
    assert less.n_load == whole.n_load > 0


def test_images_of_one_stop_count_as_a_lower_noise(base: Plan) -> None:
    """Where all else is nil: two images are one with √2 less noise, of the reference too."""
    pair = changed(base, "test.images_per_stop=2; test.exact_simulation=true")
    noise, load = (9.0 / np.sqrt(2)), 1.0 / np.sqrt(2)
    quiet = changed(
        base, f"images.noise_nm={noise}; loads.noise_uN={load}; test.exact_simulation=true; "
        "test.repeats=5",
    )  # fmt: skip
    for one, other in zip(pair.parameters, quiet.parameters, strict=True):
        assert one.theta == pytest.approx(other.theta, rel=1e-6)


def test_half_the_load_noise_halves_what_only_loads_limit(base: Plan) -> None:
    """Only loads see their offset; so noisy, they say nothing of what is fitted."""
    noisy = changed(base, "loads.noise_uN=100000.0")
    halved = changed(base, "loads.noise_uN=50000.0")
    assert gain(noisy, halved).seen["load_offset"] == pytest.approx(0.5, rel=0.01)
    offset = next(c for c in noisy.causes if c.cause.name == "load_offset").parameters[0]
    assert offset.loads == pytest.approx(1.0, abs=1e-3)


def test_what_has_no_effect_is_named_so(base: Plan) -> None:
    """Without isotropic hardening (Q = 0) its rate b moves nothing."""
    case = base.variant.case
    law = case.identification.model_copy(update={"parameters": ("tau0", "c", "d", "b")})
    more = case.model_copy(update={"identification": law})
    blind = replace(base, variant=replace(base.variant, case=more))
    found = {p.name: p for p in whole_forecast(blind).parameters}
    assert found["b"].limit.startswith("not seen")
    assert found["b"].theta == pytest.approx(found["b"].prior)
    assert not found["tau0"].limit.startswith("not seen")


def test_causes_that_scale_the_load_alike_are_not_told_apart(before: Forecast) -> None:
    """Gain, elastic scale and depth are parallel in this solver on purpose (closed_form)."""
    assert {("elastic_stiffness", "load_gain"), ("load_gain", "section_depth")} <= set(
        pairs(before)
    )


def test_a_longer_course_is_simulated_anew(base: Plan, before: Forecast) -> None:
    text = "test.compression=true"
    plan = replace(base, variant=variant(base.variant, text, read_change(text), PATH))
    assert not plan.variant.simulated_as(base.variant)
    after = whole_forecast(plan)
    assert after.n_images > before.n_images
    assert after.elongation[-1] < before.elongation[-1] and after.load[-1] < before.load[-1]
    assert set(gain(before, after).sigma) == {p.name for p in before.parameters}
