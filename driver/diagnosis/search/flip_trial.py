"""Trial of the EBSD flips: each is looked at from two starts, and refitted if it promises much."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.ebsd_flips import frame_turn
from driver.diagnosis.search.refit import MOST_FROM_AFAR, Executor, Start, nominal, refit_from
from driver.diagnosis.statistics.score_test import Score
from driver.forward.model import ForwardModel
from driver.identification.line_search import promised
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class FlipTrial:
    """What became of the flips of a round.

    Attributes:
        scores: those that were evaluated: what the first step promises, without degrees of freedom.
        refits: of those that promised something.
        untried: those that were not evaluated, and why.
    """

    scores: tuple[Score, ...] = ()
    refits: tuple[Refit, ...] = ()
    untried: tuple[NotExamined, ...] = ()


def not_warranted(flips: Sequence[Cause]) -> FlipTrial:
    """No flip is tried where no large effect and nothing unexplained calls for it."""
    why = "it is tried only where an effect is large, turns a lattice, or stays unexplained"
    return FlipTrial(untried=tuple(NotExamined(flip.name, why) for flip in flips))


def turned(model: ForwardModel, causes: Sequence[Cause]) -> ForwardModel:
    """Return the model with its measured orientations as the flips among these causes have them."""
    return model.with_orientations(frame_turn(causes) @ model.microstructure.orientations)


def try_flips(
    flips: Sequence[Cause],
    baseline: Evaluation,
    objective: Objective,
    executor: Executor,
    threshold: float,
) -> FlipTrial:
    """Evaluate each flip from two starts, and refit where a first step promises enough.

    The one start is the baseline: a half turn about an axis leaves the Schmid factors along Y as
    they are, and with them most of what the loads say of the law. The other one is the nominal
    model (means of the priors; knots, which have none, stay), for what the baseline has bent to
    imitate a flip, and for flips that exchange X and Y.

    Args:
        flips: the flips.
        baseline: the baseline at its optimum.
        objective: the objective of the baseline.
        executor: who tries them.
        threshold: cost which the first step has to promise.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    if not flips:
        return FlipTrial()
    logger.info(f"other frames of the EBSD: {', '.join(flip.name for flip in flips)}")
    starts = [
        Start(flip, _turned(objective, flip, baseline), values, None, baseline, threshold,
              MOST_FROM_AFAR)
        for flip in flips
        for values in (baseline.values, nominal(baseline, objective))
    ]  # fmt: skip
    scores: list[Score] = []
    hopeful: list[Start] = []
    failed: list[NotExamined] = []
    ends = side_by_side(_first_look, starts, executor.processes, executor.threads)
    looks = list(zip(starts, ends, strict=True))
    for flip in flips:
        mine = [(start, look) for start, look in looks if start.cause is flip]
        failures = [look for _, look in mine if isinstance(look, Failure)]
        seen = [replace(s, start=look) for s, look in mine if not isinstance(look, Failure)]
        if not seen:
            why = f"it cannot be simulated ({failures[0].why})"
            logger.info(f"  {flip.name}: {why}")
            failed.append(NotExamined(flip.name, why))
            continue
        promises = [_promise(start) for start in seen]
        promise = min(promises)
        scores.append(_score(flip, baseline.cost - promise))
        if promise > threshold:
            logger.info(
                f"  {flip.name}: given up, for its first step promises too little "
                f"(cost {promise:.0f}, {threshold:.0f} is asked for)"
            )
        else:
            hopeful.append(seen[promises.index(promise)])
    refits = refit_from(hopeful, executor)
    return FlipTrial(tuple(scores), tuple(refits), tuple(failed))


def _turned(objective: Objective, flip: Cause, baseline: Evaluation) -> Objective:
    """Return the objective with a flip; of the correction no derivative holds in it."""
    model, correction = turned(objective.model, (flip,)), objective.correction.at(baseline.values)
    return replace(objective, model=model, correction=correction)


def _first_look(start: Start) -> Evaluation | Failure:
    return attempt(lambda: start.objective.evaluate(start.values, start.baseline.free))


def _promise(start: Start) -> float:
    assert start.start is not None
    return promised(start.objective, start.start)


def _score(flip: Cause, gain: float) -> Score:
    """Return what a flip promises; it has no degrees of freedom, no p, and nothing to measure."""
    none = np.zeros(0)
    return Score(
        cause=flip,
        statistic=max(gain, 0.0),
        degrees=0,
        p=float("nan"),
        family=0,
        log_evidence=0.5 * gain + float(np.log(flip.odds)),
        estimate=none,
        sigma=none,
        visible=none,
        components=none,
        directions=np.zeros((0, 0)),
        strengths=none,
    )
