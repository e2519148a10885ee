"""One round of a diagnosis: all causes scored, the likely ones refitted, one of them named."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.diagnosis.answer.detection_limits import level_of
from driver.diagnosis.answer.result_types import DiscretisationCheck, Refit, Round, Settings
from driver.diagnosis.answer.verdict import MOST_ADDITIONS
from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.causes.ebsd_flips import FLIPS, flips_of
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE, COVARIANCE
from driver.diagnosis.search.boundary_noise import (
    BoundaryNoiseSensitivities,
    refit_boundary_noise,
    score_boundary_noise,
)
from driver.diagnosis.search.candidate_correction import with_candidate_corrections
from driver.diagnosis.search.candidate_second_mesh import with_second_mesh_at_ends
from driver.diagnosis.search.candidate_selection import (
    LARGE,
    best_of_each,
    cost_to_promise,
    leaves_unexplained,
    refits_of_likely,
)
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.finite_step_score import finite_step_scores
from driver.diagnosis.search.flip_trial import FlipTrial, not_warranted, try_flips
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.search.second_mesh_check import OnBoth, held_against_both, with_both
from driver.diagnosis.statistics.goodness_of_fit import GoodnessOfFit, goodness_of_fit
from driver.diagnosis.statistics.score_test import (
    NAMING_LEVEL,
    PARALLEL,
    WORTH,
    Score,
    effects_of,
    subspace_similarity,
)
from driver.diagnosis.statistics.screening import own_error_shapes, screen, screened
from driver.diagnosis.statistics.smooth_motion_test import smooth_fields
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray

logger = logging.getLogger(__name__)


WITHIN = 3.0  # log evidence within which causes are not told apart


@dataclass(frozen=True, eq=False)
class ExaminedRound:
    """A round, and what was examined in it.

    Attributes:
        round_: what was found.
        winner: the refit of the cause to add, None where none stands out.
        fit: the fit that was examined, with both meshes where they were asked for.
        objective: its objective.
    """

    round_: Round
    winner: Refit | None
    fit: Fit
    objective: Objective


def examine(
    here: Fit,
    objective: Objective,
    added: Sequence[Cause],
    settings: Settings,
    stops: BoundaryNoiseSensitivities,
    augmented: Evaluation | None,
    finer: FineModels,
) -> ExaminedRound:
    """Screen all causes, refit the best, and pick the one to add.

    Noise of the boundary is the first suspect: where it is worth adding, no other cause is
    refitted before it is counted.

    Args:
        here: the fit that is examined.
        objective: its objective.
        added: causes that were added before.
        settings: how the diagnosis is run.
        stops: the answers to a noise of the boundary, if they were computed.
        augmented: evaluation at the fit with the parameters of every cause free, if known.
        finer: the finer models behind the correction.

    Raises:
        SolverError: the simulation could not be finished.
    """
    candidates, names = screened(objective.model, here.best.free, settings.wanted, settings.own)
    screening = augmented if augmented is not None else objective.with_free(here.best, names)
    seen = _first_order(here, objective, candidates, screening, settings, stops)
    refits: list[Refit] = []
    trial = FlipTrial()
    lost: DiscretisationCheck | None = None
    noise = seen.noise
    if noise is not None and noise.p < level_of(BOUNDARY_NOISE) and stops.effect is not None:
        refits = [refit_boundary_noise(stops.effect, here.best, objective)]
    counted_first = bool(refits) and refits[0].log_evidence > WORTH
    room = len([cause for cause in added if cause not in COVARIANCE]) < MOST_ADDITIONS
    if room and not counted_first:
        executor = Executor(settings.processes, settings.threads)
        both = held_against_both(
            finer, here, objective, seen.scores, seen.tests.accepted, seen.widened, executor
        )
        # Where both meshes agree on a finding, looks follow at the fit with both alone.
        if both is None or _beyond(both):
            near = _significant(seen.scores)
            seen = _looked(seen, here, objective, finer, executor)
            if _significant(seen.scores) - near:
                both = held_against_both(
                    finer, here, objective, seen.scores, seen.tests.accepted, seen.widened,
                    executor,
                )  # fmt: skip
        if both is not None:
            lost = both.lost
            if not _beyond(both):
                objective, here = with_both(objective, here, both, settings.sizes)
                # The sensitivities stay those at the fit before, a fraction of a σ away.
                screening = objective.compare(
                    screening.prediction, screening.values, screening.free
                )
                better = both.second.is_better
                logger.info(f"  with the {'smaller cells' if better else 'mean of both meshes'}:")
                seen = _first_order(here, objective, candidates, screening, settings, stops)
                seen = _looked(seen, here, objective, finer, executor)
        if lost is None or lost.passed:
            likely = refits_of_likely(
                seen.scores, seen.afar, screening, here.best, objective, settings.refit, executor
            )  # fmt: skip
            trial = _flips(
                likely, seen.tests, here.best, objective, added, settings.wanted, executor
            )
            likely = best_of_each([*likely, *trial.refits])
            likely = with_candidate_corrections(likely, here.best, finer, executor)
            refits = with_second_mesh_at_ends(likely, here.best, finer, executor) or refits
    scores = sorted([*seen.scores, *trial.scores], key=lambda s: -s.log_evidence)
    winner = refits[0] if refits and refits[0].log_evidence > WORTH else None
    named = set_of(refits, scores) if winner is not None else ()
    chi = here.best.chi_load, here.best.chi_image
    round_ = Round(
        tuple(scores), tuple(refits), named, seen.tests, *chi, seen.widened, trial.untried, lost
    )  # fmt: skip
    return ExaminedRound(round_, winner, here, objective)


def _beyond(both: OnBoth) -> bool:
    """Whether two meshes take everything away and differ by too much for their mean to judge."""
    return both.lost is not None and not both.lost.passed


def at_first_sight(
    here: Fit, objective: Objective, settings: Settings, stops: BoundaryNoiseSensitivities
) -> Round:
    """Screen all causes, and refit none.

    Args:
        here: the fit that is examined.
        objective: its objective.
        settings: how the diagnosis is run.
        stops: the answers to a noise of the boundary, if they were computed.

    Raises:
        SolverError: a simulation could not be finished.
    """
    candidates, names = screened(objective.model, here.best.free, settings.wanted, settings.own)
    screening = objective.with_free(here.best, names)
    seen = _first_order(here, objective, candidates, screening, settings, stops)
    chi = here.best.chi_load, here.best.chi_image
    return Round(tuple(seen.scores), (), (), seen.tests, *chi, seen.widened)


def is_settled(round_: Round) -> bool:
    """Whether nothing is left: the tests accept, and no cause is significant."""
    causes = [s for s in round_.scores if s.degrees and s.cause != NUMERICS]
    return round_.goodness_of_fit.accepted and all(s.p >= level_of(s.cause) for s in causes)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is seen before anything is refitted, but for causes that show from afar.

    Attributes:
        scores: of all causes, best log evidence first.
        afar: refits from afar of causes that bend, none to first order.
        widened: by how much the simulation's own error widens them.
        tests: of the residual against no particular cause.
        noise: the score of the noise of the boundary, None where it was not looked for.
    """

    scores: list[Score]
    afar: tuple[Refit, ...]
    widened: float
    tests: GoodnessOfFit
    noise: Score | None


def _first_order(
    here: Fit,
    objective: Objective,
    candidates: Sequence[Cause],
    screening: Evaluation,
    settings: Settings,
    stops: BoundaryNoiseSensitivities,
) -> _Seen:
    """Scores and tests of a fit; the best five are told."""
    here = replace(here, best=here.inside(objective))
    effects = effects_of(candidates, screening, objective.parameters)
    scores, variance = screen(here, objective, candidates, effects, settings.sizes)
    if variance > 1.0:
        logger.info(f"  the simulation's own error widens scores by {np.sqrt(variance):.2f}")
    fields = smooth_fields(objective.data, here.best.motion)
    own = own_error_shapes(objective)
    tests = goodness_of_fit(here.best, objective.data, effects, fields, own, variance)
    noise = _noise_of_boundary(here, objective, effects, stops)
    if noise is not None:
        scores = sorted([*scores, noise], key=lambda s: -s.log_evidence)
    for s in scores[:5]:
        logger.info(f"  {s.cause.name}: log evidence {s.log_evidence:+.1f}, p {s.p:.2g}")
    return _Seen(scores, (), float(np.sqrt(variance)), tests, noise)


def _looked(
    seen: _Seen, here: Fit, objective: Objective, finer: FineModels, executor: Executor
) -> _Seen:
    """Return what is seen, from afar as well."""
    finite = finite_step_scores(
        seen.scores, here, objective, finer.one, seen.widened**2, seen.tests.accepted, executor
    )
    return replace(seen, scores=finite.scores, afar=tuple(finite.refits))


def _significant(scores: Sequence[Score]) -> set[str]:
    return {s.cause.name for s in scores if s.p < NAMING_LEVEL}


def _flips(
    refits: Sequence[Refit],
    tests: GoodnessOfFit,
    baseline: Evaluation,
    objective: Objective,
    added: Sequence[Cause],
    wanted: tuple[str, ...] | None,
    executor: Executor,
) -> FlipTrial:
    """Trial of the EBSD flips where it is warranted: each costs a simulation, or a refit."""
    if set(added) & set(FLIPS):  # two of them make another one, or none
        return FlipTrial()
    flips, _ = flips_of(objective.model.microstructure.orientations, wanted)
    nothing = not refits or refits[0].log_evidence <= WORTH
    unexplained = not tests.accepted if nothing else leaves_unexplained(baseline, refits[0])
    turns = not nothing and _turns_a_lattice(refits[0])
    if not (baseline.chi_load > LARGE or unexplained or turns):
        return not_warranted(flips)
    threshold = cost_to_promise([r for r in refits if not r.has_own_correction], baseline)
    return try_flips(flips, baseline, objective, executor, threshold)


def _turns_a_lattice(best: Refit) -> bool:
    """Whether the best cause turns a lattice, so that its frame is suspect.

    A half turn about an axis of the specimen leaves the Schmid factors along Y as they are: it may
    hide from the loads, and look like a turn of a few degrees.
    """
    return any(name.startswith("rotation_") for name in best.cause.parameters)


def _noise_of_boundary(
    here: Fit,
    objective: Objective,
    effects: Sequence[FloatArray],
    stops: BoundaryNoiseSensitivities,
) -> Score | None:
    """Its score, None where the answers to it are not known or it is counted already."""
    if stops.effect is None or objective.data.jitter is not None:
        return None
    family = len(effects) + 2
    return score_boundary_noise(stops.effect, here.best, objective.data, effects, family)


def set_of(refits: Sequence[Refit], scores: Sequence[Score]) -> tuple[str, ...]:
    """Return the best cause, and those that cannot be told from it, best first.

    A refitted cause belongs to it by its evidence; or, if its linearised effect is parallel to that
    of one which does, by a misfit as low as that one's where no prior draws either to its null. Of
    causes that were not refitted the likeness alone is known.

    Args:
        refits: the best of each cause, best evidence first.
        scores: of all causes.
    """
    by_name = {s.cause.name: s for s in scores}
    close = [r for r in refits if refits[0].log_evidence - r.log_evidence < WITHIN]

    def parallel(member: Refit, name: str) -> bool:
        return subspace_similarity(by_name[member.cause.name], by_name[name]) > PARALLEL

    def does_as_well(other: Refit) -> bool:
        return any(
            parallel(member, other.cause.name) and other.own_misfit - member.own_misfit < 2 * WITHIN
            for member in close
        )

    names = [r.cause.name for r in refits if r in close or does_as_well(r)]
    known = {r.cause.name for r in refits} | {NUMERICS.name}
    unknown = [s.cause.name for s in scores if s.cause.name not in known]
    return (*names, *(name for name in unknown if any(parallel(m, name) for m in close)))
