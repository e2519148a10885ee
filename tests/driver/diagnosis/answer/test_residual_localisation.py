from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.diagnosis.answer.residual_localisation import (
    LOADS,
    WHOLE,
    Excess,
    ResidualLocalisation,
    as_text,
    excess,
    phases_of,
    places_on,
    residual_localisation,
    still_missed,
)
from driver.experiment.history import History, turning_points
from driver.forward.build import geometry_of
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from meshes.grain_boundary import GrainBoundary
from meshes.prism import generate
from tools import closed_form
from tools.closed_form_diagnosis import diagnosis_of, identified

BENCH = closed_form.problem()
GEOMETRY = geometry_of(BENCH.case)
XY = closed_form.pixels()
PLACES, PHASES = places_on(GEOMETRY, XY), phases_of(BENCH.history)


@cache
def clean() -> tuple[Objective, Fit]:
    return identified(BENCH, closed_form.objective(BENCH, BENCH.truth))


def found(at: Evaluation) -> tuple[Excess, ...]:
    return excess(at, clean()[0], PLACES, PHASES, 1.0)


def with_motion(there: NDArray[np.bool_], then: NDArray[np.bool_], size: float) -> Evaluation:
    """The fit to data whose face moved along Y in a place and a phase, as no model has it [µm]."""
    objective, fitted = clean()
    motion = np.zeros((BENCH.history.n_images, len(XY), 3))
    motion[..., 1] = size * np.outer(then, there)
    change = objective.data.change(motion, np.zeros(len(motion)))
    return replace(fitted.best, residual=fitted.best.residual + change)


def test_the_places_of_the_face_are_where_their_names_say() -> None:
    geometry = replace(GEOMETRY, boundaries=(GrainBoundary((0.0, 2.0, 0.0), (0.0, 1.0, 1.0)),))
    places = places_on(geometry, XY)
    y = XY[:, 1]
    assert set(places) == {"grain 1", "grain 2", "the grain boundary", "the end S−", "the end S+",
                           "the long edges"}  # fmt: skip
    assert y[places["grain 1"]].max() < 1.5 and y[places["grain 2"]].min() > 2.5
    assert np.abs(y[places["the grain boundary"]] - 2.0).max() <= 0.5
    assert y[places["the end S−"]].max() < 0.5 and y[places["the end S+"]].min() > 3.5
    assert np.abs(XY[places["the long edges"], 0]).min() > 0.75
    single = places_on(replace(geometry, boundaries=()), XY)
    assert single["the face"].all() and "grain 1" not in single


def test_each_of_three_grains_and_of_their_boundaries_is_a_place() -> None:
    planes = tuple(GrainBoundary((0.0, y, 0.0), (0.0, 1.0, 0.0)) for y in (1.4, 2.7))
    places, y = places_on(replace(GEOMETRY, boundaries=planes), XY), XY[:, 1]
    assert {"grain 1", "grain 2", "grain 3", "grain boundary 1", "grain boundary 2"} < set(places)
    assert y[places["grain 1"]].max() < 0.9
    assert 1.9 < y[places["grain 2"]].min() and y[places["grain 2"]].max() < 2.2
    assert y[places["grain 3"]].min() > 3.2
    assert np.abs(y[places["grain boundary 2"]] - 2.7).max() <= 0.5


def test_grains_that_no_planes_part_are_places_by_their_mesh() -> None:
    planes = tuple(GrainBoundary((0.0, y, 0.0), (0.1, 1.0, 0.0)) for y in (1.4, 2.7))
    parted = replace(GEOMETRY, boundaries=planes)
    expected = places_on(parted, XY)
    found = places_on(replace(GEOMETRY, boundaries=()), XY, generate(parted, 1.0))
    either = expected["grain boundary 1"] | expected["grain boundary 2"]
    assert "the face" not in found
    for name, there in found.items():
        # A line ends at the rim of the face, where a plane goes on.
        same = either if name == "the grain boundaries" else expected[name]
        assert (there != same).mean() < 0.01, name


def test_the_phases_of_a_test_are_those_of_its_stage() -> None:
    stage = np.array([0.0, 5, 10, 10, 10, 10, 6, 4, 2, 8, 12, 16.0])
    rows = np.arange(stage.size)
    history = History(
        time=rows.astype(np.float64), stage=stage, image_row=rows, force=np.zeros(stage.size),
        turning=turning_points(stage), cycle=np.ones(stage.size, dtype=np.int64),
    )  # fmt: skip
    phases = {name: np.flatnonzero(then).tolist() for name, then in phases_of(history).items()}
    assert phases == {
        "the first loading": [0, 1, 2],
        "unloading": [6, 7, 8],
        "loading again": [9, 10, 11],
        "holds": [3, 4, 5],
    }


@pytest.mark.parametrize("place", ["the grain boundary", "the end S+", "grain 1"])
def test_a_motion_that_no_model_has_is_found_where_and_when_it_was(place: str) -> None:
    at = with_motion(PLACES[place], PHASES["loading again"], 0.004)
    worst = max((one for one in found(at) if one.phase != WHOLE), key=lambda one: one.misfit)
    assert (worst.place, worst.phase) == (place, "loading again") and worst.seen
    loads = [one for one in found(at) if one.place == LOADS]
    assert not any(one.seen for one in loads)
    text = as_text(ResidualLocalisation(found(at), ()))
    assert f"the images show most at {place} in loading again" in text
    assert text.endswith("the loads show nothing beyond noise.")


def test_an_offset_of_some_loads_is_found_in_the_loads_of_their_phase() -> None:
    objective, fitted = clean()
    load = np.where(PHASES["unloading"], 8.0 * closed_form.LOAD_NOISE, 0.0)
    still = np.zeros((load.size, len(XY), 3))
    change = objective.data.change(still, load)
    at = replace(fitted.best, residual=fitted.best.residual + change)
    worst = max(found(at), key=lambda one: one.misfit)
    assert worst.place == LOADS and worst.phase == "unloading" and worst.seen
    assert not any(one.seen for one in found(at) if one.place != LOADS)


def test_of_noise_alone_hardly_anything_is_seen_and_the_misfit_is_that_of_none() -> None:
    _, fitted = clean()
    rng, seen, misfits = np.random.default_rng(31), [], []
    for _ in range(40):
        drawn = found(replace(fitted.best, residual=rng.standard_normal(fitted.best.residual.size)))
        seen.append(any(one.seen for one in drawn))
        misfits += [one.misfit**2 for one in drawn]
    assert np.mean(seen) <= 0.05
    assert np.mean(misfits) < 3.0  # of nine directions, negative ones counted as none


def test_the_misfit_is_that_of_the_motion_less_what_the_fit_takes_of_it() -> None:
    """Twice the motion has twice the misfit, for large ones."""
    one, two = (
        next(
            e.misfit
            for e in found(with_motion(PLACES["grain 2"], PHASES["loading again"], size))
            if (e.place, e.phase) == ("grain 2", "loading again")
        )
        for size in (0.01, 0.02)
    )
    assert one > 10 and two == pytest.approx(2 * one, rel=0.25)


def test_what_the_extension_explains_is_gone_afterwards() -> None:
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 2e-3})
    answer = diagnosis_of(BENCH, identified(BENCH, made))
    assert answer.verdict.names == ("tilt_drift",)
    where = residual_localisation(answer, GEOMETRY, BENCH.history)
    assert any(one.seen for one in where.before) and not any(one.seen for one in where.after)
    assert as_text(where).endswith("The extended model leaves none of it.")
    quiet = residual_localisation(diagnosis_of(BENCH, clean()), GEOMETRY, BENCH.history)
    assert quiet.after == () and as_text(quiet).startswith(
        "The identified model leaves no more than"
    )


def test_what_is_still_missed_is_that_of_the_last_model() -> None:
    seen, silent = Excess(LOADS, "a hold", 6.0, 1e-6), Excess(LOADS, "a hold", 0.4, 0.6)
    told_of = "the loads show most in a hold (6.0 σ beyond noise)"
    cases = (
        ((seen,), (), f"the identified model misses what {told_of}."),
        ((seen,), (silent,), ""),
        ((silent,), (seen,), f"the extended model misses what {told_of}."),
        ((silent,), (), ""),
    )
    for before, after, words in cases:
        assert still_missed(ResidualLocalisation(before, after)) == words
