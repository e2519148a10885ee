"""Rounds of a diagnosis: one cause is added after the other, until none stands out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from driver.diagnosis.boundary_noise import Stops
from driver.diagnosis.extension import Extension, extended
from driver.diagnosis.flip_trial import turned
from driver.diagnosis.outcome import Log, Settings, Step
from driver.diagnosis.preparation import Prepared
from driver.diagnosis.round import at_first_sight, examine, is_settled, set_of
from driver.model import ForwardModel

MOST_STEPS = 5  # rounds, where elimination keeps taking back what was added


@dataclass(frozen=True, eq=False)
class Rounds:
    """Where the rounds ended.

    Attributes:
        end: the model at last.
        steps: the rounds.
    """

    end: Extension
    steps: tuple[Step, ...]


def rounds(
    begin: Prepared,
    finer: ForwardModel,
    another: Callable[[], ForwardModel] | None,
    stops: Stops,
    settings: Settings,
    log: Log,
) -> Rounds:
    """Add one cause after the other, until none stands out, or not on another mesh.

    Args:
        begin: what screening begins with.
        finer: the finer model behind the correction.
        another: makes the finer model on another mesh; None for a simulation without a mesh.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.
        log: takes one line of progress.

    Raises:
        SolverError: the simulation could not be finished.
    """
    here = Extension(begin.baseline, begin.objective, finer, (), {}, 0.0)
    before, known, steps = here, begin.wide, list[Step]()
    while True:
        at = here.fit.best
        log(f"screening at χ_F {at.chi_load:.2f}, χ of images {at.chi_image:.3f}")
        other = None if another is None else partial(_turned, another, here)
        step, winner = examine(
            here.fit, here.objective, here.causes, settings, stops, known, other, log
        )
        known = None
        if winner is None and steps and not step.omnibus.accepted:
            ended = Rounds(here, (*steps, step))
            return _by_a_rival(before, ended, another, stops, settings, log)
        steps.append(step)
        if winner is None or len(steps) > MOST_STEPS:
            return Rounds(here, tuple(steps))
        before, here = here, extended(here, winner, another, settings, log)


def _turned(another: Callable[[], ForwardModel], here: Extension) -> ForwardModel:
    return turned(another(), here.causes)


def _by_a_rival(
    before: Extension,
    ended: Rounds,
    another: Callable[[], ForwardModel] | None,
    stops: Stops,
    settings: Settings,
    log: Log,
) -> Rounds:
    """The last addition exchanged for one that cannot be told from it, where that leaves nothing.

    A refit is judged by its evidence alone, and of large effects that do much the same the wrong
    one may have a little more of it. What it leaves then tells them apart.

    Args:
        before: the model before the last addition.
        ended: the rounds, the last of which finds that something is left, and nothing to add.
        another: makes the finer model on another mesh; None for a simulation without a mesh.
        stops: the answers to a noise of the boundary, if they were computed.
        settings: how the diagnosis is run.
        log: takes one line of progress.
    """
    *earlier, last, _ = ended.steps
    found: list[tuple[Extension, Step]] = []
    left = list(last.named[:1])
    for rival in last.refits[1:]:
        name = rival.cause.name
        if name not in last.named:
            continue
        log(f"something is left by {last.named[0]}: {name} in its place")
        tried = extended(before, rival, another, settings, log)
        seen = at_first_sight(tried.fit, tried.objective, settings, stops, log)
        if is_settled(seen):
            found.append((tried, seen))
        else:
            left.append(name)
    if not found:
        return ended
    end, step = found[0]
    stand = [refit for refit in last.refits if refit.cause.name not in left]
    scores = [score for score in last.scores if score.cause.name not in left]
    named = set_of(stand[0], stand, scores)
    log(f"nothing is left by {named[0]}")
    last = replace(last, named=named, left_something=tuple(left))
    return Rounds(end, (*earlier, last, step))
