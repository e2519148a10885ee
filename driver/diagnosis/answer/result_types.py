"""What a diagnosis is asked, and all that it found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from driver.diagnosis.answer.verdict import Verdict
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.goodness_of_fit import GoodnessOfFit
from driver.diagnosis.statistics.score_test import Score
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from solver_adapters.parameter import Parameter

GATE = 1.0  # effect of the change of the correction on a score [σ]
MOST_OFF = 2.0
"""Error of the mean of two meshes along a cause with which it judges [σ].

With it what is visible of the cause is about twice as large as for noise alone.
"""
Refinement = Literal["mesh", "steps", "mesh and steps"]
Corrected = Literal["at the baseline", "at a look", "at its end", "at its end, on the second mesh"]
"""Where the correction was taken under which a refit was made, the nearest to its end last."""
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
class Round:
    """One round of screening, and the cause that it added, if any.

    Attributes:
        scores: every cause that was tried, best log evidence first.
        refits: the nonlinear refits, best first.
        named: the cause that was added and those that cannot be told from it, or empty.
        goodness_of_fit: tests of the baseline of this round.
        chi_load, chi_image: of that baseline.
        widened: by how much the simulation's own error widens the scores.
        untried: flips of the EBSD frame that were not tried in it, and why.
        lost: what the mean of two finer meshes takes away of what one shows, None where nothing.
        left_something: causes that cannot be told from the one added by their evidence, but that
            leave what is no noise, where it does not.
    """

    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]
    named: tuple[str, ...]
    goodness_of_fit: GoodnessOfFit
    chi_load: float
    chi_image: float
    widened: float = 1.0
    untried: tuple[NotExamined, ...] = ()
    lost: DiscretisationCheck | None = None
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
        rounds: the rounds.
        causes: the causes that were added.
        numerics: the test of the simulation's own error.
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
    rounds: tuple[Round, ...]
    causes: tuple[Cause, ...]
    numerics: DiscretisationCheck
    held_out: tuple[HeldOut, HeldOut] | None
    explained: float
    log_evidence: float
    not_examined: tuple[NotExamined, ...]
    verdict: Verdict
    levels: Mapping[str, tuple[float, float]]

    def off_by_mesh(self, name: str) -> float | None:
        """By how much either of two finer meshes puts a fitted value off that of their mean.

        To first order, in the unit of the value; None where there is one finer mesh, and where the
        second is the better one. It is no part of the standard deviation, which is that of the
        measurements.
        """
        second, fit_ = self.objective.second, self.extended
        if second is None or second.off is None:
            return None
        off = second.off
        change = self.objective.data.change(np.asarray(off.motion), np.asarray(off.load))
        row = fit_.covariance[fit_.best.free.index(name)]
        slope = self.objective.parameters[name].slope(fit_.values[name])
        return float(abs(row @ (fit_.best.jacobian @ change) * slope))


@dataclass(frozen=True, eq=False)
class DiscretisationCheck:
    """Change of the finer-minus-working difference from where it was taken to the result.

    Attributes:
        effect: largest effect on the score of any cause [σ], root mean square over its degrees of
            freedom; between two meshes that along its most affected direction.
        along: the cause whose score it would change most, or the added parameter.
        needed: what a refinement has to refine, for the effect or for the missing share, None where
            none is asked for or that is not known yet.
        between_meshes: whether it is the change from one finer mesh to another.
        fitted_anew: how often the result was fitted with the correction at its own end before.
        missing: share of the correction that the data show beside it and its standard deviation,
            None where none is significant.
    """

    effect: float
    along: Cause | Parameter
    needed: Refinement | None = None
    between_meshes: bool = False
    fitted_anew: int = 0
    missing: tuple[float, float] | None = None

    @property
    def passed(self) -> bool:
        """Whether no score could have been moved too far: by one σ, or off the mean of meshes."""
        return self.effect <= (2.0 * MOST_OFF if self.between_meshes else GATE)

    @property
    def words(self) -> str | None:
        """What is wrong and what is needed, None where the check is passed."""
        if self.passed:
            return None
        assert self.needed is not None, "asked before it was simulated"
        finer = {
            "mesh": "a mesh half as large is needed",
            "steps": "time steps half as long are needed",
            "mesh and steps": "a mesh and time steps half as large are needed",
        }[self.needed]
        if self.between_meshes:
            return (
                f"what looks like {self.along.title} is gone with the mean of two finer meshes, "
                f"which differ by {self.effect:.1f} σ along it; {finer}"
            )
        return (
            f"close to the result its own error still changes by {self.effect:.1f} σ "
            f"along {self.along.title}; {finer}"
        )


@dataclass(frozen=True)
class HeldOut:
    """Residual of a held-out cycle.

    Attributes:
        cycle: its number.
        chi_load: χ_F of its loads, degrees of freedom of its knots counted.
        chi_image: χ of its images on the correlation basis.
    """

    cycle: int
    chi_load: float
    chi_image: float


@dataclass(frozen=True)
class BadLoad:
    """A load that belongs to no smooth course.

    Attributes:
        frame: its image.
        off: by how much it is off [µN].
        sigmas: the same over its standard deviation, by the noise of the other loads.
    """

    frame: int
    off: float
    sigmas: float


@dataclass(frozen=True, eq=False)
class Refit:
    """A cause freed and everything fitted again.

    Attributes:
        cause: the cause.
        objective: the objective with the cause's prior, as wide as its effect or wider.
        fit: the fit, with the prior of a refit.
        log_evidence: natural log of the Bayes factor against the baseline, and of the prior odds
            of the cause.
        levels: of a covariance cause its level and the standard deviation of it by name.
        corrected: where its correction was taken.
    """

    cause: Cause
    objective: Objective
    fit: Fit
    log_evidence: float
    levels: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    corrected: Corrected = "at the baseline"

    @property
    def has_own_correction(self) -> bool:
        """Whether its correction is another one than that of the baseline."""
        return self.corrected != "at the baseline"

    @property
    def own_misfit(self) -> float:
        """‖r‖² with the prior as wide as the effect, to first order from where the fit ended."""
        at = self.fit.inside(self.objective)
        rest = at.residual - np.linalg.solve(at.hessian, at.gradient) @ at.jacobian
        return float(rest @ rest)
