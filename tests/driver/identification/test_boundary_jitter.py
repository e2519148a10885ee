from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.forward.model import ForwardModel
from driver.identification.boundary_jitter import (
    BoundaryJitter,
    boundary_jitter,
    stops_of,
    unit_elongation,
)
from driver.identification.data import Data
from driver.identification.fit import fit
from driver.identification.objective import Objective
from driver.parameters.boundary import elongation_names
from meshes.arrays import FloatArray
from solver_adapters.interface import Progress, Response, Simulation, Trajectory
from tools import closed_form
from tools.closed_form import KNOTS, LAW, ClosedFormSpecimen


def one_image_a_stop() -> ClosedFormSpecimen:
    """The small specimen with an image at the end of each hold only."""
    whole = closed_form.problem()
    stage = whole.history.stage
    rows = np.flatnonzero(np.append(np.diff(stage) != 0, True))
    history = replace(whole.history, image_row=rows, cycle=whole.history.cycle[rows])
    instrument = replace(whole.model.instrument, progress=whole.model.instrument.progress[rows])
    model = replace(whole.model, image_row=rows, instrument=instrument)
    return replace(whole, history=history, model=model)


BENCH = one_image_a_stop()
T = BENCH.history.n_images
SIGMA_E = 2e-4  # µm: 18 µN of elastic load, 18 times the noise of the loads
NAMES = elongation_names(len(KNOTS) + 1)


@cache
def plain() -> Objective:
    """Data without noise of the boundary, the image noise of one seed."""
    return closed_form.objective(BENCH, BENCH.truth)


@cache
def jitter() -> BoundaryJitter:
    return boundary_jitter(BENCH.model, plain().data.image, BENCH.truth, SIGMA_E)


def shaken(departures: FloatArray) -> Simulation:
    """The simulation of the truth with another elongation at each stop."""
    simulation = BENCH.model.simulation(BENCH.truth)
    unit = unit_elongation(BENCH.model, BENCH.truth)
    extra = departures @ stops_of(BENCH.model)
    return replace(simulation, motion=simulation.motion + extra[:, None, None] * unit)


def test_the_stop_of_an_image_is_the_hold_before_it() -> None:
    model = BENCH.model
    stops = stops_of(model)
    # Rows 10, 11 and 12 hold at the first peak.
    assert model.image_row[10] == 12 and list(np.flatnonzero(stops[10])) == [10, 11, 12]
    assert np.all(stops.sum(axis=0) == 1) and np.all(stops[np.arange(T), model.image_row])
    # Of two images in a hold each has its own part of it.
    twice = stops_of(replace(model, image_row=np.array([0, 11, 12])))
    assert list(np.flatnonzero(twice[1])) == [10, 11] and list(np.flatnonzero(twice[2])) == [12]


def test_at_unit_elongation_the_ends_are_one_apart() -> None:
    unit = unit_elongation(BENCH.model, BENCH.truth)
    edge = BENCH.model.boundary.zeta < 1e-9
    side = BENCH.model.boundary.side[edge]
    np.testing.assert_allclose(unit[edge, 1], 0.5 * side, atol=1e-12)
    assert np.all(unit[:, [0, 2]] == 0)


@pytest.mark.parametrize("stop", [3, 10, 13, 23, 36])
def test_the_answer_to_a_stop_is_the_derivative_of_the_simulation(stop: int) -> None:
    """In loading, at a peak, on unloading: against a simulation with that stop alone moved."""
    h = 1e-7
    unit = np.zeros(T)
    unit[stop] = h
    above, below = (BENCH.model.adapter.solve(shaken(s * unit)) for s in (1, -1))
    expected = (above.force - below.force) / (2 * h)
    found = jitter().load[stop] / SIGMA_E
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())
    motion = (above.displacement - below.displacement) / (2 * h)
    projection = BENCH.model.predict(BENCH.truth).projection
    z = plain().data.image.sensitivity(motion[None], projection.value, np.arange(len(motion)))[0]
    np.testing.assert_allclose(jitter().image[stop] / SIGMA_E, z, atol=2e-3 * np.abs(z).max())


def test_stops_beyond_the_first_ones_begin_by_the_simulation_of_those(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[Trajectory | None] = []

    class Telling(closed_form.ClosedFormSolver):
        """It tells a way, and remembers by which it was asked to begin."""

        def solve(
            self,
            simulation: Simulation,
            workspace: Path | None = None,
            progress: Callable[[Progress], None] | None = None,
        ) -> Response:
            begun.append(simulation.warm_start)
            still = np.zeros((len(simulation.times), len(simulation.mesh.points), 3))
            return replace(
                super().solve(simulation), trajectory=Trajectory(simulation.times, still)
            )

    monkeypatch.setattr("driver.identification.boundary_jitter._TOGETHER", 20)
    model = replace(BENCH.model, adapter=Telling())
    found = boundary_jitter(model, plain().data.image, BENCH.truth, SIGMA_E)
    assert begun[0] is None and len(begun) == -(-T // 20) > 1
    assert all(trajectory is not None for trajectory in begun[1:])
    np.testing.assert_allclose(found.load, jitter().load, rtol=1e-9)


def test_a_yielding_specimen_answers_with_less_than_its_elastic_stiffness() -> None:
    own = np.diag(jitter().load)
    loading, unloading = 24, 12
    assert own[loading] < 0.5 * own[unloading]


def with_jitter(left_out: tuple[int, ...] = ()) -> Data:
    """AR(1) loads and a shared reference beside the noise of the boundary."""
    return replace(plain().data, jitter=jitter(), autocorrelation=0.6, left_out=left_out)


@pytest.mark.parametrize("frames", [np.arange(T), np.arange(5, 30)], ids=["all", "some"])
def test_noise_of_images_loads_and_boundary_becomes_unit_noise(frames: NDArray[np.int64]) -> None:
    """Monte Carlo over residuals drawn with every part of the covariance."""
    data = with_jitter((7,)).frames(frames)
    bare = replace(data, jitter=None)
    load, image = jitter().load, jitter().image
    n_z, n = data.image.n_z, 4000
    seen = data.index[data.with_image]
    rng = np.random.default_rng(8)
    e = rng.standard_normal((n, T))
    own = rng.standard_normal((n, T, 3)) + rng.standard_normal((n, 1, 3)) / np.sqrt(
        data.image.images.n_reference
    )
    # Three of the whitened numbers of an image are enough to be followed.
    noise = np.zeros((T, T))
    for t in range(T):
        noise[t] = 0.6 ** np.abs(np.arange(T) - t)
    loads = data.load_noise * rng.standard_normal((n, T)) @ np.linalg.cholesky(noise).T
    loads += e @ load
    z = np.zeros((n, T, n_z))
    z[..., :3] = own
    z += np.einsum("nt,tsz->nsz", e, image)
    drawn = np.concatenate(
        [
            bare._whiten_loads(loads[:, frames]),
            bare._whiten_images(z[:, seen]).reshape(n, -1),
        ],
        axis=1,
    )
    white = data._whiten_patterns(drawn)
    # What was drawn: all loads, and three numbers of each image; the others carry G alone.
    known = np.concatenate([np.ones(frames.size, bool), np.tile(np.arange(n_z) < 3, seen.size)])
    covariance = white[:, known].T @ white[:, known] / n
    np.testing.assert_allclose(covariance, np.eye(known.sum()), atol=6 / np.sqrt(n))
    # Without it the loads of neighbouring stops stand out by many standard deviations.
    assert np.mean(drawn[:, : frames.size] ** 2) > 10


def test_the_root_is_that_of_the_whole_covariance() -> None:
    data = with_jitter().frames(np.arange(6))
    n = 6 + 6 * data.image.n_z
    units = np.eye(n)
    root = data._whiten_patterns(units)
    load, image = jitter().load, jitter().image
    F = np.concatenate(
        [data._whiten_loads(load[:, :6]), data._whiten_images(image[:, :6]).reshape(T, -1)], axis=1
    )
    np.testing.assert_allclose(root @ (units + F.T @ F) @ root.T, units, atol=1e-9)


def test_without_noise_of_the_boundary_nothing_changes() -> None:
    white = np.arange(5.0)
    assert plain().data._whiten_patterns(white) is white


@dataclass(frozen=True, eq=False)
class Shaken(ForwardModel):
    """A specimen whose elongation departs from its knots at each stop [µm], shape (T,)."""

    departures: FloatArray = field(kw_only=True)

    def simulation(self, values: Mapping[str, float], free: Sequence[str] = ()) -> Simulation:
        plain = super().simulation(values, free)
        extra = self.departures @ stops_of(self)
        unit = unit_elongation(self, values)
        return replace(plain, motion=plain.motion + extra[:, None, None] * unit)


DRAWS = 20


@cache
def fitted(known: bool) -> tuple[FloatArray, FloatArray]:
    """χ of the loads, and (found − true)/σ of the law, of fits to data from a shaken specimen.

    Shapes (DRAWS,) and (DRAWS, 3).
    """
    chi, deviations = [], []
    free = (*LAW, *NAMES, "lambda_plus_Y")
    for seed in range(DRAWS):
        departures = SIGMA_E * np.random.default_rng(1000 + seed).standard_normal(T)
        fields = {f.name: getattr(BENCH.model, f.name) for f in dataclasses.fields(ForwardModel)}
        made_with = replace(BENCH, model=Shaken(**fields, departures=departures))
        made = replace(closed_form.objective(made_with, BENCH.truth, seed), model=BENCH.model)
        covariance = jitter() if known else None
        objective = replace(made, data=replace(made.data, jitter=covariance))
        found = fit(objective, BENCH.truth, free, 8)
        chi.append(found.best.chi_load)
        deviations.append(
            [
                (found.values[name] - BENCH.truth[name]) / found.sigma(name, objective.parameters)
                for name in LAW
            ]
        )
    return np.array(chi), np.array(deviations)


def test_with_noise_of_the_boundary_known_chi_and_intervals_are_honest() -> None:
    chi, deviations = fitted(True)
    # T loads less seven parameters and knots that only loads see.
    expected = np.sqrt((T - 7) / T)
    assert np.mean(chi) == pytest.approx(expected, abs=4 / np.sqrt(2 * T * DRAWS))
    # Sixty deviations, three and three correlated: mean square 1 within three of its deviations.
    square = np.mean(deviations**2)
    assert square == pytest.approx(1.0, abs=3 * np.sqrt(2 / DRAWS))
    assert np.mean(np.abs(deviations) < 1.96) > 0.85


def test_noise_of_the_boundary_that_is_not_known_looks_like_a_wrong_model() -> None:
    chi, deviations = fitted(False)
    assert np.min(chi) > 3 and np.mean(deviations**2) > 4
