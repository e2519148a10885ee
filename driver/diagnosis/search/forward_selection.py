"""Rounds of a diagnosis: one cause is added after the other, until none stands out."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from driver.common.outcomes import Failure, attempt
from driver.diagnosis.answer.result_types import Refit, Round, Settings
from driver.diagnosis.answer.verdict import MOST_ADDITIONS
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.search.baseline import Prepared
from driver.diagnosis.search.boundary_noise import BoundaryNoiseSensitivities
from driver.diagnosis.search.extension import Extension, corrected_anew, extended
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.selection_round import (
    WITHIN,
    ExaminedRound,
    at_first_sight,
    examine,
    is_settled,
    set_of,
)
from driver.diagnosis.statistics.score_test import WORTH
from driver.identification.objective import Evaluation

logger = logging.getLogger(__name__)

MOST_ROUNDS = 6  # rounds, where elimination keeps taking back what was added


@dataclass(frozen=True, eq=False)
class Selection:
    """How far the rounds have come.

    Attributes:
        begin: the model of the first round, to which nothing was added.
        end: the model at last.
        before: the model before the last addition.
        rounds: the rounds.
        failed: why a cause that should have been added could not be, in words, by its name.
    """

    begin: Extension
    end: Extension
    before: Extension
    rounds: tuple[Round, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What should have been added and never was, in words."""
        added = {cause.name for cause in self.end.causes}
        return tuple(why for name, why in self.failed.items() if name not in added)


def forward_selection(
    begin: Prepared,
    finer: FineModels,
    stops: BoundaryNoiseSensitivities,
    settings: Settings,
) -> Selection:
    """Add one cause after the other, until none stands out, or not on a second mesh.

    Args:
        begin: what screening begins with.
        finer: the finer models behind the correction.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.

    Raises:
        SolverError: the simulation could not be finished.
    """
    fitted = begin.baseline.best.free
    model = Extension(begin.baseline, begin.objective, finer, (), {}, 0.0, fitted, ())
    return _continued(Selection(model, model, model), begin.augmented, stops, settings)


def with_correction_anew(
    found: Selection, stops: BoundaryNoiseSensitivities, settings: Settings
) -> Selection:
    """Return what is found where the last model is fitted with the correction at its own end.

    Its last round is examined again, and others follow where a cause stands out. What could not be
    added is tried again.

    Args:
        found: where the rounds ended.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.

    Raises:
        SolverError: the simulation could not be finished.
    """
    *rounds, last = found.rounds
    end = corrected_anew(found.end, settings)
    again = replace(found, end=end, rounds=tuple(rounds), failed={})
    # Where the tests have rejected before, the rivals of the last addition were tried.
    return _continued(again, None, stops, settings, not last.goodness_of_fit.accepted)


def _continued(
    found: Selection,
    known: Evaluation | None,
    stops: BoundaryNoiseSensitivities,
    settings: Settings,
    rivals_tried: bool = False,
) -> Selection:
    """Go on with rounds from the last model.

    Args:
        found: what was found so far.
        known: evaluation at the last model with the parameters of every cause free, if known.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.
        rivals_tried: whether the rivals of the last addition were tried in its place.
    """
    while True:
        here = found.end
        at = here.fit.best
        logger.info(f"screening at χ_F {at.chi_load:.2f}, χ of images {at.chi_image:.3f}")
        examined = examine(
            here.fit, here.objective, here.causes, settings, stops, known, here.finer
        )
        known, round_, winner = None, examined.round_, examined.winner
        here = replace(here, fit=examined.fit, objective=examined.objective)
        rounds = found.rounds
        if rounds and not rivals_tried and _leaves_something(examined, here):
            better = _by_a_rival(found.before, rounds[-1], stops, settings)
            if better is not None:
                end, exchanged, last = better
                return replace(found, end=end, rounds=(*rounds[:-1], exchanged, last))
        first = found.begin if rounds else here
        found = replace(found, begin=first, end=here, rounds=(*rounds, round_))
        if winner is None:
            return found
        if len(found.rounds) == MOST_ROUNDS:
            name = winner.cause.name
            why = f"{winner.cause.title} is not added, for the rounds come to no end"
            logger.info(why)
            unnamed = (*rounds, replace(round_, named=()))
            return replace(found, rounds=unnamed, failed={**found.failed, name: why})
        after, round_, failed = _with_the_best(here, round_, settings)
        found = replace(found, rounds=(*rounds, round_), failed={**found.failed, **failed})
        if after is None:
            return found
        found, rivals_tried = replace(found, end=after, before=here), False


def _with_the_best(
    here: Extension, round_: Round, settings: Settings
) -> tuple[Extension | None, Round, dict[str, str]]:
    """Return the model with the best cause of a round that can be simulated finer.

    Returns:
        The model, None where there is no such cause; the round, its set that of this cause; those
        before it that cannot be simulated, by name, in words.
    """
    refits, failed = round_.refits, dict[str, str]()
    while refits and refits[0].log_evidence > WORTH:
        best = refits[0]
        name = best.cause.name
        logger.info(f"adding {name}, log evidence {best.log_evidence:+.1f}")
        after = attempt(partial(extended, here, best, settings))
        if isinstance(after, Failure):
            failed[name] = (
                f"{best.cause.title} is not added, for its model cannot be simulated ({after.why})"
            )
            logger.info(failed[name])
            refits = refits[1:]
            continue
        named = set_of(refits, round_.scores) if failed else round_.named
        return after, replace(round_, named=named), failed
    return None, replace(round_, named=()), failed


def _leaves_something(found: ExaminedRound, here: Extension) -> bool:
    """Whether the last addition leaves what is no noise, and what hardly anything can be added to.

    What a second mesh takes away is an error of the meshes, and asks for no other cause. Nor does
    another one help where as many were added as there may be.
    """
    little = found.winner is None or found.winner.log_evidence < WITHIN
    effects = [cause for cause in here.causes if cause not in COVARIANCE]
    few = len(effects) < MOST_ADDITIONS
    round_ = found.round_
    return little and few and round_.lost is None and not round_.goodness_of_fit.accepted


def _by_a_rival(
    before: Extension, last: Round, stops: BoundaryNoiseSensitivities, settings: Settings
) -> tuple[Extension, Round, Round] | None:
    """Exchange the last addition for one that cannot be told from it, if that leaves nothing.

    A refit is judged by its evidence alone, and of large effects that do much the same the wrong
    one may have a little more of it. What it leaves then tells them apart.

    Args:
        before: the model before the last addition.
        last: the round of that addition.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.

    Returns:
        The model, the round of the addition and the one after it; None where each of the set
        leaves something.
    """
    rivals = [r for r in last.refits if r.cause.name in last.named[1:] and r.log_evidence > WORTH]
    exchanged: list[tuple[Refit, Extension, Round]] = []
    left_something = [*last.left_something, last.named[0]]
    for rival in rivals:
        logger.info(f"{last.named[0]} leaves something: {rival.cause.name} is tried in its place")
        end = attempt(partial(_exchanged, before, rival, stops, settings))
        if isinstance(end, Failure):
            logger.info(f"  it cannot be simulated ({end.why})")
            continue
        tried, seen = end
        if is_settled(seen):
            logger.info("  nothing is left")
            exchanged.append((rival, tried, seen))
        else:
            logger.info("  something is left as well")
            left_something.append(rival.cause.name)
    if not exchanged:
        return None
    stand = [rival for rival, _, _ in exchanged]
    left = {r.cause.name for r in last.refits} - {r.cause.name for r in stand}
    scores = [score for score in last.scores if score.cause.name not in left]
    round_ = replace(last, named=set_of(stand, scores), left_something=tuple(left_something))
    return exchanged[0][1], round_, exchanged[0][2]


def _exchanged(
    before: Extension, rival: Refit, stops: BoundaryNoiseSensitivities, settings: Settings
) -> tuple[Extension, Round]:
    """Return the model with a rival, and what is left there at first sight."""
    tried = extended(before, rival, settings)
    return tried, at_first_sight(tried.fit, tried.objective, settings, stops)
