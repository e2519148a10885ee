"""Rounds of a diagnosis: one cause is added after the other, until none stands out."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial

from driver.common.outcomes import Failure, attempt
from driver.diagnosis.answer.result_types import Refit, Round, Settings
from driver.diagnosis.answer.verdict import MOST_ADDITIONS
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.search.baseline import Prepared
from driver.diagnosis.search.boundary_noise import BoundaryNoiseSensitivities
from driver.diagnosis.search.extension import Extension, extended
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

logger = logging.getLogger(__name__)

MOST_ROUNDS = 6  # rounds, where elimination keeps taking back what was added


@dataclass(frozen=True, eq=False)
class Selection:
    """Where the rounds ended.

    Attributes:
        begin: the model of the first round, to which nothing was added.
        end: the model at last.
        rounds: the rounds.
        doubts: what should have been added and could not be, in words.
    """

    begin: Extension
    end: Extension
    rounds: tuple[Round, ...]
    doubts: tuple[str, ...] = ()


def forward_selection(
    begin: Prepared,
    finer: FineModels,
    stops: BoundaryNoiseSensitivities,
    settings: Settings,
) -> Selection:
    """Add one cause after the other, until none stands out, or not on another mesh.

    Args:
        begin: what screening begins with.
        finer: the finer models behind the correction.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.

    Raises:
        SolverError: the simulation could not be finished.
    """
    fitted = begin.baseline.best.free
    extension = Extension(begin.baseline, begin.objective, finer, (), {}, 0.0, fitted, ())
    before, known = extension, begin.augmented
    first: Extension | None = None
    rounds: list[Round] = []
    doubts: dict[str, str] = {}

    def ended(end: Extension, *rounds_: Round) -> Selection:
        added = {cause.name for cause in end.causes}
        sentences = tuple(why for name, why in doubts.items() if name not in added)
        return Selection(first or end, end, rounds_, sentences)

    while True:
        at = extension.fit.best
        logger.info(f"screening at χ_F {at.chi_load:.2f}, χ of images {at.chi_image:.3f}")
        examined = examine(
            extension.fit,
            extension.objective,
            extension.causes,
            settings,
            stops,
            known,
            extension.finer,
        )
        known, round_, winner = None, examined.round_, examined.winner
        extension = replace(extension, fit=examined.fit, objective=examined.objective)
        first = first or extension
        if rounds and _leaves_something(examined, extension):
            better = _by_a_rival(before, rounds[-1], stops, settings)
            if better is not None:
                end, exchanged, last = better
                return ended(end, *rounds[:-1], exchanged, last)
        rounds.append(round_)
        if winner is None:
            return ended(extension, *rounds)
        if len(rounds) == MOST_ROUNDS:
            name = winner.cause.name
            doubts[name] = f"{winner.cause.title} is not added, for the rounds come to no end"
            logger.info(doubts[name])
            return ended(extension, *rounds[:-1], replace(round_, named=()))
        after, rounds[-1], failed = _with_the_best(extension, round_, settings)
        doubts |= failed
        if after is None:
            return ended(extension, *rounds)
        before, extension = extension, after


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

    What another mesh takes away is an error of the meshes, and asks for no other cause. Nor does
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
    left_something = [last.named[0]]
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
