"""The refinement that a diagnosis asks for: what it takes, and whether it is made.

Meshes of automatic sizes are refined as long as time and memory hold it; in any other case the
verdict names the keys to write.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from driver.case.model import Case
from driver.case.specimen import SIZES
from driver.common import machine
from driver.common.formatting import cost_told, duration, joined
from driver.diagnosis.answer.result_types import Refinement
from driver.experiment.reading import history_of
from driver.forward.build import capabilities_of, mesh_of
from driver.identification.correction_cost import cells_of_size
from driver.results.files import DIAGNOSIS, results_of
from driver.results.files import SIZES as SIZES_FILE
from driver.results.json_files import read_json
from driver.results.mesh_sizes import Refinements, read_refinements, refined, write_refinements
from driver.results.stage_record import read_record
from driver.workflow.cost import Cost, estimate
from driver.workflow.engine import Stage, finished
from solver_adapters.interface import NotRunError, SolverError

logger = logging.getLogger(__name__)

DIAGNOSE = "diagnose"
"""The stage whose verdict asks for a refinement."""
_BEFORE = ("mesh", "measure", "identify")
_MARGIN = 1.1  # of a budget that is named over the time that is foreseen


@dataclass(frozen=True)
class Finer:
    """A finer simulation.

    Attributes:
        case: the case with it.
        keys: what makes it, by key of the case.
        cost: wall-clock time of the stages that it makes stale, and their memory.
    """

    case: Case
    keys: Mapping[str, float]
    cost: Cost


def finer_simulation(case: Case, needed: Refinement, seconds: float) -> Finer:
    """Return the next finer simulation of a case, and what it takes.

    A run that was made tells the time better than the estimate, which is good to a factor of two:
    the estimate only tells by how much the finer one takes longer.

    Args:
        case: the case, with sizes in numbers.
        needed: what has to be refined.
        seconds: wall-clock time of the stages that become stale, as they were run [s].
    """
    keys: dict[str, float] = {}
    finer = case
    if needed != "steps":
        sizes = case.specimen.next_sizes
        keys |= {f"specimen.{key}": size for key, size in zip(SIZES, sizes, strict=True)}
        finer = case.with_values_at(keys)
    if needed != "mesh":
        steps = case.solver
        halved: dict[str, float] = {
            "solver.steps_per_interval": 2 * steps.steps_per_interval,
            "solver.fine_steps_per_interval": 2 * steps.fine_steps_per_interval,
        }
        finer = finer.with_values_at(halved)
        # Steps that are refined to an accuracy are as many as it asks for.
        accuracy = steps.accuracy_uN
        keys |= halved if accuracy is None else {"solver.accuracy_uN": accuracy / 2}
    solver, n_images = capabilities_of(case), history_of(case).n_images
    n_cells = len(mesh_of(case, case.specimen.mesh_size).cells)
    then_cells = cells_of_size(case, n_cells, finer.specimen.mesh_size)
    now = estimate(case, solver, n_cells, n_images)
    then = estimate(finer, solver, then_cells, n_images)
    taken = seconds * then.seconds / now.seconds
    if not solver.in_process:
        taken = max(taken, then.seconds)  # its jobs may have been run before
    return Finer(finer, keys, Cost(taken, then.memory, then.simulations))


def told_beforehand(case: Case, cost: Cost) -> str:
    """Say which sizes were chosen, and up to where they may be refined.

    Args:
        case: the case, with sizes in numbers.
        cost: of a run with them.
    """
    specimen = case.specimen
    sizes = (
        f"{specimen.cell_kind} of {specimen.mesh_size:g} and {specimen.fine_mesh_size:g} µm, "
        + ("of mesh_file in pieces" if specimen.of_mesh else "chosen by prismid")
    )
    if not case.with_images:
        return sizes
    finer = finer_simulation(case, "mesh", cost.seconds)
    return (
        f"{sizes}; where the mesh keeps the verdict open they are refined within "
        f"execution.budget_min = {case.execution.budget_min:g}, next {_of(finer)}"
    )


def to_refine(case: Case, needed: Refinement, seconds: float) -> str:
    """Say what to write into a case whose diagnosis asks for a refinement, and what that takes.

    Args:
        case: the case, with sizes in numbers.
        needed: what has to be refined.
        seconds: wall-clock time of the diagnosis so far, which is not in the record yet [s].
    """
    results, automatic = results_of(case), case.specimen.refined is not None
    # Of what is needed both, the mesh follows by itself where it may.
    needed = "steps" if automatic and needed == "mesh and steps" else needed
    again = seconds + _spent(results, ("mesh", "identify"))
    finer = finer_simulation(case, needed, again)
    if automatic and needed == "mesh":
        spent = seconds + _spent(results, _BEFORE) + read_refinements(results).seconds
        minutes = _MARGIN * (spent + finer.cost.seconds) / 60
        if finer.cost.memory <= machine.memory():
            if minutes <= case.execution.budget_min:
                return (
                    f"The run refines the meshes next: {_of(finer)}. "
                    "Where they cannot be simulated this verdict stands."
                )
            budget = f"execution.budget_min = {_rounded_up(minutes):g}"
            return f"Write {budget}, then run again: meshes of {_of(finer)}."
    text = joined([f"{key} = {value:g}" for key, value in finer.keys.items()])
    return f"Write {text}, then run again: {_takes(finer)}."


def refined_within_budget(case: Case, done: str, stages: Sequence[Stage]) -> Case | None:
    """Return the case with finer meshes where these are needed for a verdict and can be had.

    What it returns is kept in the results, so that every later look at the case has its sizes.

    Args:
        case: the case, with sizes in numbers.
        done: name of the stage that is done.
        stages: all its stages.
    """
    results = results_of(case)
    if done != DIAGNOSE or case.specimen.refined is None:
        return None
    diagnosis = read_json(results / DIAGNOSIS)
    check = diagnosis["numerics"]
    if check["needed"] != "mesh" or not (diagnosis["verdict"] == "numerics" or check["passed"]):
        return None
    before, finer_case = read_refinements(results), refined(case)
    if before.failed:
        logger.info(
            "not refined again: finer meshes could not be simulated; "
            f"without {results / SIZES_FILE} they are tried once more"
        )
        return None
    upto = (*_BEFORE, DIAGNOSE)
    kept = finished(finer_case, stages, ())
    again = _spent(results, [name for name in upto if name not in kept])
    finer = finer_simulation(case, "mesh", again)
    left = 60 * case.execution.budget_min - _spent(results, upto) - before.seconds
    if finer.cost.seconds > left or finer.cost.memory > machine.memory():
        why = "time" if finer.cost.seconds > left else "memory"
        logger.info(f"not refined, for lack of {why}: {_of(finer)}, {_left(left, case)}")
        return None
    what = (
        "the mesh keeps the verdict open and is refined"
        if diagnosis["verdict"] == "numerics"
        else "the answer is held against a finer mesh"
    )
    logger.info(f"{what}: {_of(finer)}, {_left(left, case)}")
    write_refinements(results, Refinements(before.level + 1, before.seconds + again))
    return finer_case


def coarser_again(case: Case, error: SolverError) -> Case | None:
    """Return a case on the meshes before the last refinement, where that cannot be simulated.

    What it returns is kept in the results, and the refinement is not tried again.

    Args:
        case: the case that was refined.
        error: why it could not be simulated.

    Returns:
        None where the meshes were not refined, their sizes are stated, or no simulation was run.
    """
    if not case.specimen.refined or isinstance(error, NotRunError):
        return None
    results = results_of(case)
    before, specimen = read_refinements(results), case.specimen
    logger.info(
        f"the refined meshes of {specimen.mesh_size:g} and {specimen.fine_mesh_size:g} µm could "
        f"not be simulated ({error}): back to those before"
    )
    write_refinements(results, replace(before, level=before.level - 1, failed=True))
    return refined(case, -1)


def _of(finer: Finer) -> str:
    """Return the sizes of a finer simulation and what it takes, in words."""
    specimen = finer.case.specimen
    sizes = f"{specimen.mesh_size:g} and {specimen.fine_mesh_size:g} µm"
    return f"{sizes} take {cost_told(finer.cost.seconds, finer.cost.memory)}"


def _takes(finer: Finer) -> str:
    return f"that takes {cost_told(finer.cost.seconds, finer.cost.memory)}"


def _left(seconds: float, case: Case) -> str:
    return (
        f"{duration(max(seconds, 0.0))} of execution.budget_min = "
        f"{case.execution.budget_min:g} are left"
    )


def _spent(results: Path, names: Collection[str]) -> float:
    """Wall-clock time of the last runs of stages [s]."""
    return sum(done["seconds"] for name, done in read_record(results).items() if name in names)


def _rounded_up(minutes: float) -> float:
    """Return minutes with two significant digits, no less than given."""
    digit = 10.0 ** max(0, len(str(int(minutes))) - 2)
    return float(-(-minutes // digit) * digit)
