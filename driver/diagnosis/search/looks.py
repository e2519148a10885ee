"""One look at a cause off its null: the prediction there, and what its change shows."""

from __future__ import annotations

from dataclasses import dataclass

from driver.common.distributions import chi2_sf
from driver.diagnosis.statistics.score_test import Score, score
from driver.diagnosis.statistics.screening import off_by_meshes
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective

PROMISING = 0.02  # probability of one look under the null, below which it is followed


@dataclass(frozen=True, eq=False)
class Task:
    """A cause to look at.

    Attributes:
        near: its score, to first order.
        here: the fit that is examined.
        objective: its objective.
        finer: the finer model behind its correction.
        family: number of tries.
        variance: of whitened numbers along the causes.
        least: log evidence that a side has to promise for a refit.
    """

    near: Score
    here: Fit
    objective: Objective
    finer: ForwardModel
    family: int
    variance: float
    least: float


@dataclass(frozen=True, eq=False)
class Side:
    """The fit with a cause off its null, and what that shows.

    Attributes:
        amount: how far off, in prior scales.
        at: evaluation there.
        score: of the cause, by the change from the fit to there.
        correction: that there, None where it was not taken.
    """

    amount: float
    at: Evaluation
    score: Score
    correction: Correction | None = None

    @property
    def is_corrected(self) -> bool:
        """Whether the correction was taken there."""
        return self.correction is not None


def seen_at(task: Task, at: Evaluation, amount: float) -> Side:
    """Return what a look at a cause shows.

    Args:
        task: the cause.
        at: evaluation off its null.
        amount: how far off, in prior scales.
    """
    fitted, degrees = task.here.inside(task.objective), task.objective.data.load_degrees
    change = (fitted.residual - at.residual)[None] / amount
    off = off_by_meshes(task.objective)
    scored = score(task.near.cause, change, fitted, task.family, degrees, task.variance, off)
    return Side(amount, at, scored)


def promises(side: Side) -> bool:
    """Whether what a look shows is hardly noise."""
    return bool(chi2_sf(side.score.statistic, side.score.degrees) < PROMISING)


def on_its_side(side: Side) -> bool:
    """Whether a look puts a cause on the side where it was looked at."""
    return bool(side.score.estimate[0] * side.amount > 0)
