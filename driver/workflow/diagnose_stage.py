"""Stage 4: what the simulation gets wrong, written as numbers, words and an extended case."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import asdict, replace
from time import perf_counter
from typing import Any

import numpy as np

from driver.case.model import SCHEMA_FILE, Case, schema_text, write_case
from driver.diagnosis.answer.moved_by_second_mesh import moved_by_second_mesh, moved_told
from driver.diagnosis.answer.residual_localisation import (
    ResidualLocalisation,
    as_text,
    residual_localisation,
    still_missed,
)
from driver.diagnosis.answer.result_types import Diagnosis, Settings
from driver.diagnosis.answer.stress_along_grains import stress_along_grains
from driver.diagnosis.answer.turned_frame import turned_frame
from driver.diagnosis.answer.verdict import with_places, with_refinement, with_turned_frame
from driver.diagnosis.causes.user_causes import user_causes
from driver.diagnosis.search.diagnose import diagnose
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.statistics.screening import screened
from driver.experiment.held_out import held_out_cycle
from driver.forward.build import geometry_of, second_mesh_is_better, size_of_second_mesh
from driver.identification.fit import Fit, fit
from driver.identification.identifiability import far_off_told
from driver.identification.identify import corrected_with_derivatives
from driver.identification.objective import Evaluation
from driver.identification.problem import IdentificationProblem, on_second_mesh
from driver.identification.slip_activity import slip_activity
from driver.identification.travel_ratio import travel_ratio
from driver.parameters.boundary import LAMBDAS
from driver.parameters.covariance import COVARIANCE_PARAMETERS, NOISE_RATIO
from driver.results.diagnosis import diagnosis_record
from driver.results.extended_case import (
    added_parameters,
    extended_case,
    write_noise_map,
)
from driver.results.extended_decks import write_decks
from driver.results.files import (
    DECKS,
    DIAGNOSIS,
    DIAGNOSIS_H5,
    EXTENDED,
    IDENTIFY,
    IDENTIFY_CSV,
    MEASURE,
    NOISE_MAP,
    REPORT_CSV,
)
from driver.results.hdf5 import read_hdf5
from driver.results.identification import read_identification, value_told, write_fits
from driver.results.json_files import write_json
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import (
    error_budget,
    load_problem,
    same_simulation,
    saved_objective,
)
from driver.workflow.refinement import to_refine

logger = logging.getLogger(__name__)


def run_diagnose(context: StageContext) -> None:
    """Diagnose the identified model; write `diagnosis.json` and `extended.toml`."""
    start, case = perf_counter(), context.case
    own = user_causes(case)
    wanted = None if case.diagnosis.causes == "all" else case.diagnosis.causes
    problem = load_problem(context)
    identified = read_hdf5(context.result(IDENTIFY))
    measured = read_hdf5(context.result(MEASURE))
    free_chi = measured["chi"]
    identification = read_identification(context.result(IDENTIFY))
    # A term that was installed since is at its null.
    values = problem.objective.model.null_values() | identification.values
    free, converged, reason = identification.names, identification.converged, identification.reason
    if not converged:
        logger.info(f"  the baseline has not converged ({reason}): read the verdict with care")
    objective = saved_objective(problem, identified)
    # One simulation gives the baseline and the sensitivities of every cause: that of the
    # identification, once more.
    again = same_simulation(objective, identified, values)
    augmented = again.evaluate(values, screened(objective.model, free, wanted, own)[1])
    objective, augmented = objective.with_pattern_at(augmented)
    problem = replace(problem, finer=replace(problem.finer, pattern=objective.model.pattern))
    objective, augmented = corrected_with_derivatives(
        objective, problem.finer, augmented, problem.plan.sizes
    )
    baseline = Fit(objective.restrict(augmented, free), converged, reason, ())
    known: Evaluation | None = augmented
    if held := [name for name in problem.plan.every if name not in free]:
        # An error of a held knot would be found as one of the model.
        logger.info(f"fitted again with what the identification held: {', '.join(held)}")
        baseline = fit(objective, values, problem.plan.every, problem.plan.most)
        known = None
    cycles = problem.experiment.history.cycle
    settings = Settings(
        wanted=wanted,
        refit=case.diagnosis.refit,
        held_out=held_out_cycle(case, problem.experiment.history),
        processes=case.execution.processes,
        threads=case.execution.threads,
        free_chi=float(np.sqrt(np.mean(free_chi[measured["left_out"] == 0] ** 2))),
        sizes=problem.plan.sizes,
        own=own,
    )
    smaller = size_of_second_mesh(case) if second_mesh_is_better(case) else None
    finer = FineModels(problem.finer, lambda: on_second_mesh(case, problem), smaller)
    diagnosis = diagnose(baseline, objective, finer, cycles, settings, known)
    parted = case.specimen.boundaries_stay and len(case.grains) > 1
    where = residual_localisation(
        diagnosis,
        geometry_of(case),
        problem.experiment.history,
        problem.working.microstructure.mesh if parted else None,
    )
    turned = turned_frame(
        diagnosis.extended,
        diagnosis.objective.parameters,
        objective.model.microstructure.orientations,
    )
    verdict = with_turned_frame(with_places(diagnosis.verdict, still_missed(where)), turned)
    diagnosis = replace(diagnosis, verdict=verdict)
    if diagnosis.numerics.needed is not None:
        refinement = to_refine(case, diagnosis.numerics.needed, perf_counter() - start)
        diagnosis = replace(diagnosis, verdict=with_refinement(diagnosis.verdict, refinement))
    _tell(diagnosis, where, problem)
    decks = _decks(diagnosis, context) if diagnosis.causes else None
    budgets = (
        error_budget(problem, diagnosis.baseline.best, free_chi),
        error_budget(problem, diagnosis.extended.best, free_chi),
    )
    record = diagnosis_record(diagnosis, problem.objective, problem.law, budgets, decks, where)
    write_json(
        context.workdir / DIAGNOSIS,
        record
        | {"meshes": _meshes(case)}
        | _of_final(diagnosis.extended, problem, _moved(diagnosis, identification.values, problem)),
    )
    fits = {"before": diagnosis.baseline, "after": diagnosis.extended}
    slip = slip_activity(diagnosis.objective.model, diagnosis.extended)
    write_fits(context.workdir / DIAGNOSIS_H5, fits, problem, slip)
    if NOISE_RATIO.name in diagnosis.levels:
        write_noise_map(case, diagnosis, context.workdir / NOISE_MAP)
    write_case(extended_case(case, diagnosis), context.workdir / EXTENDED)
    (context.workdir / SCHEMA_FILE).write_text(schema_text(), encoding="utf-8")


def _meshes(case: Case) -> dict[str, Any]:
    """Return the cells and sizes behind a verdict; how often chosen ones were refined."""
    specimen = case.specimen
    return {
        "cells": specimen.cell_kind,
        "mesh_size_um": specimen.mesh_size,
        "fine_mesh_size_um": specimen.fine_mesh_size,
        "refined": specimen.refined,
    }


def _moved(
    found: Diagnosis, identified: Mapping[str, float], problem: IdentificationProblem
) -> tuple[str, ...]:
    """Return what a second finer mesh that judges moves of the identified values, in words."""
    second, parameters = found.baseline_objective.second, problem.objective.parameters
    if second is None or second.size is None:
        return ()
    moved = moved_by_second_mesh(identified, found.baseline, parameters, (*problem.law, *LAMBDAS))
    return moved_told(moved, (problem.plan.sizes[0], second.size))


def _of_final(final: Fit, problem: IdentificationProblem, moved: tuple[str, ...]) -> dict[str, Any]:
    """Tell and return what to look at of the parameters of the final model."""
    warnings = (*far_off_told(final), *moved)
    ratio = travel_ratio(final, problem.objective.parameters, problem.experiment.history)
    for warning in warnings:
        logger.info(f"  WARNING: {warning}")
    if ratio is not None:
        logger.info(f"  {ratio.sentence()}")
    mesh = problem.working.microstructure.moved_mesh(final.values)
    along = stress_along_grains(mesh, final, problem.objective.parameters)
    for grain in along:
        logger.info(f"  {grain.sentence()}")
    return {
        "warnings": list(warnings),
        "travel_ratio": None if ratio is None else asdict(ratio),
        "critical_stress": [grain.record() for grain in along],
    }


def _tell(found: Diagnosis, where: ResidualLocalisation, problem: IdentificationProblem) -> None:
    """Tell the verdict, where the model misses the data, what was added, what to do next."""
    logger.info(f"verdict: {found.verdict.kind}. {found.verdict.text}")
    logger.info(f"  {as_text(where)}")
    if found.causes:
        logger.info(
            f"  {IDENTIFY_CSV} holds the identified model, which this rejects; the parameters of "
            f"the extended one stand in {REPORT_CSV}, which the stage report writes"
        )
    for name in added_parameters(found):
        logger.info(f"  {value_told(name, found.extended, problem.objective.parameters)}")
        if (off := found.off_by_mesh(name)) is not None:
            unit = problem.objective.parameters[name].unit
            by = f"{off:.2g} {unit}" if unit else f"{off:.2g}"
            logger.info(
                f"    either of two finer meshes alone would put it off by {by}: not in its σ"
            )
    for name, (level, sigma) in found.levels.items():
        logger.info(f"  {name} = {level:.4g} ± {sigma:.2g} {COVARIANCE_PARAMETERS[name].unit}")
    if found.held_out is not None:
        before, after = found.held_out
        logger.info(
            f"  held-out cycle {before.cycle}: χ_F {before.chi_load:.2f} → {after.chi_load:.2f}"
        )
    logger.info(f"  next: {found.verdict.next}")


def _decks(found: Diagnosis, context: StageContext) -> dict[str, str | None]:
    """Write the extended model as decks; by solver, why there is none (`write_decks`)."""
    model, values = found.objective.model, found.extended.values
    decks = write_decks(context.workdir, context.case, model, values)
    written = [f"{DECKS}/{name}" for name, refused in decks.items() if refused is None]
    if written:
        # Why others cannot take it is in the record, and `check` says it before a run.
        logger.info(f"  the extended model as a deck: {', '.join(written)}")
    return decks
