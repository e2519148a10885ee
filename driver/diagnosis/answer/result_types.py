"""What a diagnosis is asked, and all that it found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from driver.diagnosis.answer.verdict import Verdict
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.discretisation_check import Gate
from driver.diagnosis.search.held_out import HeldOut
from driver.diagnosis.search.load_outliers import BadLoad
from driver.diagnosis.search.refit import Refit
from driver.diagnosis.statistics.goodness_of_fit import Omnibus
from driver.diagnosis.statistics.score_test import Score
from driver.identification.fit import Fit
from driver.identification.objective import Objective

IMAGING = 1.2  # χ of free correlation beyond which imaging errors dominate


@dataclass(frozen=True, eq=False)
class Settings:
    """How a diagnosis is run.

    Attributes:
        wanted: names of the causes to try, None for all.
        refit: how many causes are refitted in a round.
        held_out: number of the cycle to hold out, None for none.
        processes: processes side by side.
        threads: threads of each.
        free_chi: χ of free correlation.
        sizes: element sizes of the working and of the finer mesh [µm].
        own: causes beside the library.
    """

    wanted: tuple[str, ...] | None
    refit: int
    held_out: int | None
    processes: int
    threads: int
    free_chi: float
    sizes: tuple[float, float]
    own: tuple[Cause, ...] = ()

    @property
    def imaging_limited(self) -> bool:
        """Whether errors of the imaging dominate what free correlation leaves."""
        return self.free_chi > IMAGING


@dataclass(frozen=True, eq=False)
class Step:
    """One round of screening, and the cause that it added, if any.

    Attributes:
        scores: every cause that was tried, best log evidence first.
        refits: the nonlinear refits, best first.
        named: the cause that was added and those that cannot be told from it, or empty.
        omnibus: tests of the baseline of this round.
        chi_load, chi_image: of that baseline.
        widened: by how much the simulation's own error widens the scores.
        untried: flips of the EBSD frame that were not tried in it, and why.
        lost: what another mesh takes away of what was seen, None where nothing.
        left_something: causes that cannot be told from the one added by their evidence, but that
            leave what is no noise, where it does not.
    """

    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]
    named: tuple[str, ...]
    omnibus: Omnibus
    chi_load: float
    chi_image: float
    widened: float = 1.0
    untried: tuple[NotExamined, ...] = ()
    lost: Gate | None = None
    left_something: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All that was found.

    Attributes:
        baseline: the fit that was examined: the one given, refitted without the loads that are
            wrong one by one and with the noise that the others have.
        baseline_objective: its objective.
        extended: the fit with the causes that were added (the baseline where there are none).
        objective: the objective of the extended fit.
        bad_loads: the loads that were left out.
        steps: the rounds.
        causes: the causes that were added.
        gate: the test of the simulation's own error.
        held_out: score of the held-out cycle before and after, None where none is held out.
        explained: share of the excess misfit that the extension explains (NaN where the
            excess is within the scatter of noise).
        log_evidence: log Bayes factor of the extended model against the baseline.
        not_examined: the causes that were not tried, and why.
        verdict: the answer.
        levels: of each noise that was named its level and the standard deviation of it, by the
            name of its parameter.
    """

    baseline: Fit
    baseline_objective: Objective
    extended: Fit
    objective: Objective
    bad_loads: tuple[BadLoad, ...]
    steps: tuple[Step, ...]
    causes: tuple[Cause, ...]
    gate: Gate
    held_out: tuple[HeldOut, HeldOut] | None
    explained: float
    log_evidence: float
    not_examined: tuple[NotExamined, ...]
    verdict: Verdict
    levels: Mapping[str, tuple[float, float]]

    def off_by_mesh(self, name: str) -> float | None:
        """By how much either of two finer meshes puts a fitted value off that of their mean.

        To first order, in the unit of the value; None where there is one finer mesh. It is no
        part of the standard deviation, which is that of the measurements.
        """
        spread, fit_ = self.objective.spread, self.extended
        if spread is None:
            return None
        change = self.objective.data.change(np.asarray(spread.motion), np.asarray(spread.load))
        row = fit_.covariance[fit_.best.free.index(name)]
        slope = self.objective.parameters[name].slope(fit_.values[name])
        return float(abs(row @ (fit_.best.jacobian @ change) * slope))
