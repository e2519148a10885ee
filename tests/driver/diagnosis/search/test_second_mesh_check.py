from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.common.progress import progress_to
from driver.diagnosis.answer.detection_limits import not_found
from driver.diagnosis.answer.result_types import Diagnosis, Settings
from driver.diagnosis.answer.verdict import REFINE
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.search.diagnose import diagnose
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.search.second_mesh_check import OnBoth, held_against_both, with_both
from driver.diagnosis.statistics.score_test import Score, effects_of
from driver.diagnosis.statistics.screening import screen, screened
from driver.forward.build import build_model, geometry_of
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, SecondMesh, correction
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from meshes.arrays import FloatArray
from meshes.prism import generate
from solver_adapters.interface import PreparedError, Simulation, SolverError
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, finer, identified

DRIFT = 4e-4
WANTED = replace(SETTINGS, wanted=("tilt_drift",))
BENCH = closed_form.problem()
FINE = finer(BENCH)


class ErringMesh(closed_form.ClosedFormSolver):
    """A mesh whose error is a tilt that grows during the test; the mean of both has half of it."""

    drift = 2 * DRIFT

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, load = super().answer(simulation)
        grown = np.linspace(0.0, self.drift, len(motion))
        x = simulation.mesh.points[simulation.output_nodes, 0]
        motion[..., 2] += grown[:, None] * (x - x.mean())
        return motion, load


ERRING = replace(BENCH.model, adapter=ErringMesh(0.001))


def diagnosed(
    drift: float, another: ForwardModel, settings: Settings = WANTED
) -> tuple[Diagnosis, list[str]]:
    """The diagnosis of a test with so much drift."""
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": drift})
    objective, baseline = identified(BENCH, made)
    lines: list[str] = []
    with progress_to(lines.append):
        found = diagnose(
            baseline, objective, FineModels(FINE, lambda: another), BENCH.history.cycle, settings,
            )  # fmt: skip
    return found, lines


def test_what_is_there_on_the_second_mesh_as_well_is_named() -> None:
    found, _ = diagnosed(DRIFT, FINE)
    assert found.verdict.kind == "named" and found.verdict.names == ("tilt_drift",)


class LittleErringMesh(ErringMesh):
    """The same with a quarter of the effect that is there."""

    drift = 0.5 * DRIFT


def test_what_is_named_has_the_mean_of_both_meshes_and_what_either_is_off_is_told() -> None:
    little = replace(BENCH.model, adapter=LittleErringMesh(0.001))
    (one, _), (both, lines) = (diagnosed(DRIFT, mesh) for mesh in (FINE, little))
    assert one.verdict.names == both.verdict.names == ("tilt_drift",)
    half = 0.25 * DRIFT
    moved = both.extended.values["tilt_drift"] - one.extended.values["tilt_drift"]
    assert moved == pytest.approx(-half, rel=0.05)
    assert both.off_by_mesh("tilt_drift") == pytest.approx(half, rel=0.05)
    assert both.numerics.effect < 0.1 and any("moved by" in line for line in lines)


@pytest.mark.parametrize("size", [DRIFT, 3 * DRIFT])
def test_where_both_meshes_agree_neither_is_off(size: float) -> None:
    found, _ = diagnosed(size, FINE)
    assert found.off_by_mesh("tilt_drift") == 0.0


def test_what_a_second_mesh_takes_away_is_not_named_and_a_finer_one_is_asked_for() -> None:
    found, lines = diagnosed(DRIFT, ERRING)
    assert found.verdict.kind == "numerics" and not found.causes
    told = "what looks like tilt drift is gone with the mean of two finer meshes"
    assert told in found.verdict.text
    assert "a mesh half as large is needed" in found.verdict.text
    assert found.numerics.between_meshes and found.numerics.needed == "mesh"
    first = found.rounds[0].scores[0]
    assert found.numerics.effect == pytest.approx(2 * np.linalg.norm(first.components), rel=0.3)
    assert not found.rounds[0].refits
    assert any("moved by" in line for line in lines)


class BrokenMesh(closed_form.ClosedFormSolver):
    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise SolverError("no step is short enough")


def test_where_the_second_mesh_cannot_be_simulated_one_has_to_do() -> None:
    found, lines = diagnosed(DRIFT, replace(BENCH.model, adapter=BrokenMesh()))
    assert found.verdict.kind == "named" and found.off_by_mesh("tilt_drift") is None
    assert any("no step is short enough" in line for line in lines)


class Elsewhere(closed_form.ClosedFormSolver):
    """A solver on another machine."""

    folder = Path("jobs/one")

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise PreparedError([self.folder])


class ElsewhereToo(Elsewhere):
    folder = Path("jobs/another")


def test_the_jobs_of_both_meshes_are_prepared_at_once() -> None:
    one, another = (
        replace(BENCH.model, adapter=solver(0.001)) for solver in (Elsewhere, ElsewhereToo)
    )
    objective, baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    with pytest.raises(PreparedError) as error:
        FineModels(one, lambda: another).corrections(objective, baseline, True, Executor(1, 1))
    assert error.value.folders == (Elsewhere.folder, ElsewhereToo.folder)


def test_without_a_finding_no_second_mesh_is_tried() -> None:
    found, lines = diagnosed(0.0, ERRING)
    assert found.verdict.kind == "nothing wrong"
    assert not any("second mesh" in line for line in lines)


def test_what_the_derivatives_show_is_held_against_a_second_mesh_before_looks_from_afar() -> None:
    """Looks at a fit that the second mesh changes would be made twice."""
    wanted = replace(WANTED, wanted=("tilt_drift", "non_schmid"))
    look, other = "looking from afar", "the same on a second mesh"
    for drift, expected in ((DRIFT, [other, look]), (0.0, [look])):
        _, lines = diagnosed(drift, FINE, wanted)
        added = [k for k, line in enumerate(lines) if line.startswith("adding")]
        first = lines[: added[0]] if added else lines
        assert [t for line in first for t in (look, other) if line.startswith(t)] == expected


def drifting() -> tuple[Objective, Fit, list[Score], float]:
    """A fit to data whose tilt drifts, the scores of its causes, and the variance of these."""
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": DRIFT})
    objective, here = identified(BENCH, made)
    candidates, names = screened(objective.model, here.best.free, WANTED.wanted)
    augmented = objective.evaluate(here.values, names)
    effects = effects_of(candidates, augmented, objective.parameters)
    return objective, here, *screen(here, objective, candidates, effects, SETTINGS.sizes)


def test_what_no_mesh_moves_is_as_significant_as_before(
    lines: list[str],
) -> None:
    """By the number of tries that its own p counts: looks from afar have more than causes."""
    objective, here, (one, *rest), widened = drifting()
    looked = replace(one, family=4 * one.family, p=4 * one.p)
    found = held_against_both(
        FineModels(FINE, lambda: FINE), here, objective, [looked, *rest], True, widened,
        Executor(1, 1),
    )  # fmt: skip
    assert found is not None and found.lost is None
    (told,) = (line for line in lines if "moved by" in line)
    assert told.endswith(f"moved by 0.0 σ, p {looked.p:.2g} → {looked.p:.2g}")


class FarErringMesh(ErringMesh):
    """The same, of which half is more than twice what is there."""

    drift = 5 * DRIFT


def test_a_one_sided_cause_that_the_second_mesh_moves_below_its_null_is_gone(
    lines: list[str],
) -> None:
    objective, here, (one, *_), widened = drifting()
    sign = np.sign(one.components)
    rising = replace(
        one, cause=replace(one.cause, one_sided=True),
        components=sign * one.components, directions=sign[:, None] * one.directions,
    )  # fmt: skip
    far = replace(BENCH.model, adapter=FarErringMesh(0.001))
    for score, gone in ((rising, True), (one, False)):
        found = held_against_both(
            FineModels(FINE, lambda: far), here, objective, [score], True, widened, Executor(1, 1)
        )
        assert found is not None and (found.lost is not None) == gone
        assert lines[-1].endswith("→ 1") == gone


def test_the_correction_of_both_meshes_keeps_derivatives_that_it_lacks_itself() -> None:
    """Causes that were added have derivatives that the correction at a fit does not take."""
    objective, here = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))

    def taken(*free: str) -> Correction:
        at = objective.model.predict(here.values, free)
        return correction(objective.model, FINE, at, here.values, free=free)

    objective = replace(objective, correction=taken("tau0", "K"))
    second = SecondMesh(Correction(0.0 * here.best.motion, 0.0 * here.best.load))
    both = OnBoth(None, taken("tau0"), second)
    known = with_both(objective, here, both, SETTINGS.sizes)[0].correction.derivatives
    assert known is not None and [p.name for p in known.parameters] == ["tau0", "K"]


def test_what_no_mesh_takes_away_is_named_with_the_mean_of_both_as_well() -> None:
    found, _ = diagnosed(4 * DRIFT, ERRING)
    assert found.verdict.kind == "named"
    # Of the two finer meshes one sees all of it, and the other one half of it.
    assert found.extended.values["tilt_drift"] == pytest.approx(3 * DRIFT, rel=0.1)
    assert found.off_by_mesh("tilt_drift") == pytest.approx(DRIFT, rel=0.1)


def test_what_the_meshes_differ_by_is_taken_at_the_extended_model() -> None:
    """A mesh that errs as long as the cause is not in the model, and no more when it is."""
    meshes = [replace(BENCH.model, adapter=LittleErringMesh(0.001)), FINE]
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": DRIFT})
    objective, baseline = identified(BENCH, made)
    both = FineModels(FINE, lambda: meshes.pop(0))
    found = diagnose(baseline, objective, both, BENCH.history.cycle, WANTED)
    assert found.verdict.names == ("tilt_drift",) and not meshes
    assert found.off_by_mesh("tilt_drift") == pytest.approx(0.0, abs=1e-5 * DRIFT)
    agreeing, _ = diagnosed(DRIFT, FINE)
    value = agreeing.extended.values["tilt_drift"]
    assert found.extended.values["tilt_drift"] == pytest.approx(value, rel=1e-3)


class SlightlyErringMesh(ErringMesh):
    """The same, of which half moves the score by less than two standard deviations."""

    drift = 0.65 * DRIFT


def test_what_the_mean_of_two_near_meshes_takes_away_is_nothing_and_less_is_visible() -> None:
    slightly = replace(BENCH.model, adapter=SlightlyErringMesh(0.001))
    found, lines = diagnosed(0.5 * DRIFT, slightly)
    assert any("moved by 3.7 σ" in line for line in lines)
    same, _ = diagnosed(0.5 * DRIFT, FINE)
    assert same.verdict.names == ("tilt_drift",)
    near, alone = (
        next(s for s in one.rounds[0].scores if s.cause.name == "tilt_drift")
        for one in (found, same)
    )
    wider = float(np.hypot(1.0, 0.5 * 3.7))
    assert near.visible == pytest.approx(wider * alone.visible, rel=0.02)
    assert near.estimate < alone.estimate < near.visible
    # It is told, and what would decide.
    assert found.verdict.kind == "nothing wrong" and found.numerics.passed
    assert found.numerics.between_meshes and found.numerics.needed == "mesh"
    shown = (
        "One of two finer meshes shows tilt drift, the mean of both does not: they differ by 3.7 σ"
    )
    assert shown in found.verdict.text and REFINE in found.verdict.next
    told = not_found(near, found.rounds[0], found.objective.parameters)
    assert told.startswith("seen with one finer mesh, not with the mean of two: it would have been")


def test_of_what_two_meshes_take_away_the_one_that_they_move_most_is_told() -> None:
    objective, here, (one, *_), widened = drifting()
    (drift,) = (cause for cause in LIBRARY if cause.name == "load_drift")
    little = replace(
        one, cause=drift, components=0.3 * one.components, directions=0.3 * one.directions, p=1e-4
    )
    found = held_against_both(
        FineModels(FINE, lambda: ERRING), here, objective, [little, one], True, widened,
        Executor(1, 1),
    )  # fmt: skip
    assert found is not None and found.lost is not None and not found.lost.passed
    assert found.lost.along == one.cause
    assert found.lost.effect == pytest.approx(11.5, rel=0.1)


def on_hexahedra(size: float, solver: closed_form.ClosedFormSolver) -> ForwardModel:
    case, history = BENCH.case, BENCH.history
    mesh = generate(geometry_of(case), size, "hex20")
    return build_model(case, mesh, history, closed_form.pixels(), solver, 1)


class AsMuch(ErringMesh):
    """A simulation that has all of the drift."""

    drift = DRIFT


class HalfAsMuch(ErringMesh):
    """A simulation that has half of it."""

    drift = 0.5 * DRIFT


def by_smaller_cells(
    drift: float,
    solver: closed_form.ClosedFormSolver,
    wanted: tuple[str, ...] = ("tilt_drift",),
    beside: dict[str, float] | None = None,
    fails: bool = False,
) -> tuple[Diagnosis, list[str]]:
    """The diagnosis of a test whose second finer mesh is of smaller cells of the same family.

    Args:
        drift: of the tilt.
        solver: of the second mesh.
        wanted: the causes that are tried.
        beside: what else is hidden.
        fails: whether the second mesh can be simulated but once.
    """
    working = on_hexahedra(1.0, closed_form.ClosedFormSolver())
    bench = replace(BENCH, model=working, mesh=working.microstructure.mesh)
    first = on_hexahedra(0.5, closed_form.ClosedFormSolver(0.001))
    seconds = [on_hexahedra(1 / 3, solver)]
    if fails:
        seconds.append(on_hexahedra(1 / 3, BrokenMesh()))
    made = closed_form.objective(bench, BENCH.truth | {"tilt_drift": drift} | (beside or {}))
    objective, baseline = identified(bench, made, (1.0, 0.5))
    lines: list[str] = []

    def next_of() -> ForwardModel:
        return seconds.pop(0) if len(seconds) > 1 else seconds[0]

    with progress_to(lines.append):
        found = diagnose(
            baseline, objective, FineModels(first, next_of, 1 / 3), BENCH.history.cycle,
            replace(SETTINGS, wanted=wanted, sizes=(1.0, 0.5)),
        )  # fmt: skip
    return found, lines


@pytest.mark.parametrize("wanted", ["tilt_drift", "height_scale"])
def test_what_smaller_hexahedra_take_away_is_nothing_and_no_finer_mesh_is_asked_for(
    wanted: str,
) -> None:
    """Seen as a cause, or by the tests alone where the cause is none of those that are tried."""
    found, lines = by_smaller_cells(DRIFT, AsMuch(0.001), (wanted,))
    assert "the same on a second mesh" in lines and "  with the smaller cells:" in lines
    assert found.verdict.kind == "nothing wrong" and "finer mesh" not in found.verdict.text
    assert found.numerics.passed and found.numerics.needed is None
    assert found.rounds[0].scores[0].p > 0.05
    agreed, _ = by_smaller_cells(DRIFT, closed_form.ClosedFormSolver(0.001), (wanted,))
    assert agreed.verdict.kind == ("named" if wanted == "tilt_drift" else "unexplained")


def test_a_value_is_that_of_the_smaller_hexahedra_alone() -> None:
    found, _ = by_smaller_cells(2 * DRIFT, HalfAsMuch(0.001))
    assert found.verdict.names == ("tilt_drift",)
    assert found.extended.values["tilt_drift"] == pytest.approx(1.5 * DRIFT, rel=0.05)
    assert found.off_by_mesh("tilt_drift") is None
    assert found.objective.sizes_behind((1.0, 0.5)) == (1.0, 1 / 3)


def test_what_the_tests_of_tetrahedra_reject_is_not_held_against_a_second_mesh() -> None:
    """Of meshes as good as each other the mean would hide what no cause describes."""
    wanted = replace(SETTINGS, wanted=("height_scale",))
    found, lines = diagnosed(DRIFT, replace(BENCH.model, adapter=AsMuch(0.001)), wanted)
    assert found.verdict.kind == "unexplained" and "the same on a second mesh" not in lines


def test_what_smaller_cells_took_away_stays_away_where_they_cannot_be_simulated_again() -> None:
    """The second mesh shows all of the tilt; at the model with the drift of the load it fails."""
    found, lines = by_smaller_cells(
        DRIFT, AsMuch(0.001), ("tilt_drift", "load_drift"), {"load_drift": 80.0}, fails=True
    )
    assert found.verdict.names == ("load_drift",)
    assert "  what the second mesh adds is that at the fit before" in lines
    assert found.objective.second is not None and found.objective.second.size == 1 / 3
