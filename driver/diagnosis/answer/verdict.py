"""The answer in one word and one paragraph, with what to do next."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE

Kind = Literal[
    "nothing wrong",
    "named",
    "one of this set",
    "named, but something is left",
    "unexplained",
    "imaging-limited",
    "numerics",
]

MOST_ADDITIONS = 3
REFINE = "Refine as said, then run again."
"""What to do next where nothing more is known of the refinement."""
LEAST_EXPLAINED = 0.9
"""Share of what is no noise without which a name explains nothing."""


@dataclass(frozen=True)
class Verdict:
    """The answer of a diagnosis.

    Attributes:
        kind: the answer.
        sets: for each effect that it names the causes that cannot be told apart, the best first.
        text: a paragraph for a person.
        next: what to do next.
    """

    kind: Kind
    sets: tuple[tuple[Cause, ...], ...]
    text: str
    next: str

    @property
    def causes(self) -> tuple[Cause, ...]:
        """All causes of the sets, each once."""
        return tuple(dict.fromkeys(cause for group in self.sets for cause in group))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of these causes."""
        return tuple(cause.name for cause in self.causes)


def decide(
    added: Sequence[Sequence[Cause]],
    left: Sequence[str],
    imaging_limited: bool,
    numerics: str | None,
    explained: float,
    tried: bool,
) -> Verdict:
    """Put the outcome of the steps into words.

    Args:
        added: for each addition the set of causes that cannot be told apart, the best first.
        left: what the tests see in what is left, in words; nothing where it is noise.
        imaging_limited: whether the images carry errors that no motion explains.
        numerics: the refinement that the simulation needs, or None if it is fine enough.
        explained: share of the misfit that is no noise, as far as tests see it, that the
            additions explain.
        tried: whether any cause could be tried.
    """
    if numerics is not None:
        return Verdict(
            "numerics", ((NUMERICS,),),
            f"The simulation itself is not exact enough to judge: {numerics}.",
            REFINE,
        )  # fmt: skip
    if not added:
        return _without_a_name(left, imaging_limited, tried)
    sets = _beside_each_other(added)
    best = [group[0] for group in sets]
    answer = _capital("; and ".join(_said(group) for group in sets))
    # A noise is no effect that others could be the shadow of.
    effects = [cause for cause in best if cause != BOUNDARY_NOISE]
    if len(effects) >= MOST_ADDITIONS:
        together = (
            f"even their sum leaves what is not noise ({_list(left)}), and"
            if left
            else "their sum describes the data, but"
        )
        return Verdict(
            "unexplained", sets,
            f"Three or more causes were needed ({_titles(effects)}): {together} so many at once "
            "are more likely the shadow of one that was not tried.",
            "Look at the maps of what is left, and think of a cause of your own.",
        )  # fmt: skip
    if left and explained < LEAST_EXPLAINED:
        return Verdict(
            "unexplained", sets,
            f"The best that was tried ({_titles(best)}) explains {explained:.0%} of the "
            f"misfit that is no noise, and what is left is structured as well: {_list(left)}.",
            "Look at the maps of what is left: where and when it stands tells what to think of.",
        )  # fmt: skip
    do_next = " ".join(_to_do(group) for group in sets)
    if left:
        return Verdict(
            "named, but something is left", sets,
            f"{answer}. This explains a part; what is left is still not noise: {_list(left)}.",
            do_next + " Then look at the maps of what is left.",
        )  # fmt: skip
    several = any(len(group) > 1 for group in sets)
    return Verdict("one of this set" if several else "named", sets, f"{answer}.", do_next)


def with_own_error_counted(verdict: Verdict) -> Verdict:
    """Return a verdict on what no finer simulation takes away, although this one is not exact.

    Args:
        verdict: the answer, *unexplained*.
    """
    text = (
        f"{verdict.text} The simulation's own error is another one there, yet with it taken anew "
        "something is left as well: a finer mesh is no remedy."
    )
    return replace(verdict, text=text)


def with_what_one_mesh_shows(verdict: Verdict, title: str, apart: float) -> Verdict:
    """Return a verdict without a name that tells what one of two finer meshes alone shows.

    Args:
        verdict: the answer with the mean of both.
        title: of the cause that one of them shows.
        apart: by how much both differ along it [σ].
    """
    if verdict.kind not in ("nothing wrong", "unexplained"):
        return verdict
    shown = (
        f"One of two finer meshes shows {title}, the mean of both does not: they differ by "
        f"{apart:.1f} σ along it, half of which the sizes that would have been seen count."
    )
    return replace(verdict, text=f"{verdict.text} {shown}", next=f"{verdict.next} {REFINE}")


def with_share_of_correction(verdict: Verdict, share: float, sigma: float) -> Verdict:
    """Return a verdict that tells that what is left resembles the correction of the simulation.

    Args:
        verdict: the answer.
        share: of the correction that the data show beside it, negative where they take it back.
        sigma: its standard deviation.
    """
    size = f"{abs(share):.2f} ± {sigma:.2f}"
    wanted = f"ask for another {size} of it" if share > 0 else f"take back {size} of it"
    shown = (
        f"Yet beside the correction by finer cells and time steps the data {wanted}: a finer "
        "simulation would tell."
    )
    return replace(verdict, text=f"{verdict.text} {shown}", next=f"{verdict.next} {REFINE}")


def with_bounds(verdict: Verdict, held: Collection[str]) -> Verdict:
    """Return a verdict that names no cause alone whose every parameter stands at such a bound.

    Such a value is no size: beyond it the cause is none that occurs. Others are named beside it.

    Args:
        verdict: the answer.
        held: the parameters that stand at a bound beyond which nothing occurs.
    """
    at_bound = [
        group[0]
        for group in verdict.sets
        if len(group) == 1 and group[0].parameters and set(group[0].parameters) <= set(held)
    ]
    if not at_bound or verdict.kind == "unexplained":
        return verdict
    shadow = (
        f"{_titles(at_bound)} would describe the data only beyond what occurs: more likely that is "
        "the shadow of a cause that was not tried."
    )
    look = "Look at the maps of what is left, and think of a cause of your own."
    if len(at_bound) == len(verdict.sets):
        return replace(verdict, kind="unexplained", text=_capital(shadow), next=look)
    return replace(
        verdict,
        kind="named, but something is left",
        text=f"{verdict.text} Yet {shadow}",
        next=f"{verdict.next} {look}",
    )


def with_places(verdict: Verdict, missed: str) -> Verdict:
    """Make a verdict that leaves nothing say where a single place or phase shows more.

    A test of all places at once dilutes what one of them shows.

    Args:
        verdict: the answer.
        missed: what the last model misses, as a sentence; empty where nothing is seen.
    """
    if not missed or verdict.kind not in ("nothing wrong", "named", "one of this set"):
        return verdict
    return replace(
        verdict,
        text=f"{verdict.text} Yet {missed}",
        next=f"Look at the maps of what is left there. {verdict.next}",
    )


def with_turned_frame(verdict: Verdict, turned: str) -> Verdict:
    """Return a verdict without a name that tells of rotations which are a turn of the EBSD frame.

    Args:
        verdict: the answer.
        turned: the turn, as a sentence; empty where there is none.
    """
    if not turned or verdict.kind != "unexplained":
        return verdict
    return replace(
        verdict,
        text=f"{verdict.text} {turned}",
        next="Look first at orientation.ebsd_frame and orientation.ebsd_to_specimen, with a mark "
        f"that EBSD map and images both show. {verdict.next}",
    )


def with_refinement(verdict: Verdict, refinement: str) -> Verdict:
    """Return a verdict that names the refinement in place of asking for one.

    Args:
        verdict: the answer.
        refinement: what to write, and what it takes, as sentences.
    """
    return replace(verdict, next=verdict.next.replace(REFINE, refinement))


MORE_ITERATIONS = "Let the fit converge: more identification.max_iterations."
"""What to do where the identified model ended at that limit."""
BETTER_STARTS = (
    "Let the fit converge: starting values in the case nearer to what is found, or more "
    "identification.starts."
)
"""The same where it stopped before."""
BEGIN_AT_END = "Let the extended fit converge: run extended.toml, which begins where it ended."
"""The same where the identified model has converged, and the extended one has not."""


def with_doubts(
    verdict: Verdict, unsettled: Sequence[str], limits: Sequence[str], remedy: str = ""
) -> Verdict:
    """Return a verdict that says what makes it doubtful.

    Args:
        verdict: the answer.
        unsettled: each fit behind it that has not converged, and why it ended.
        limits: causes that could not be added, and values that stand at a bound.
        remedy: what lets the fits converge.
    """
    if not (unsettled or limits):
        return verdict
    return replace(
        verdict,
        text=f"{verdict.text} Read this with care: {_list([*limits, *unsettled])}.",
        next=f"{remedy} {verdict.next}".strip() if unsettled else verdict.next,
    )


def _beside_each_other(added: Sequence[Sequence[Cause]]) -> tuple[tuple[Cause, ...], ...]:
    """Return sets without what was added beside them: a cause needed as well is no rival."""
    winners = {group[0] for group in added}
    return tuple(
        (group[0], *(cause for cause in group[1:] if cause not in winners)) for group in added
    )


def _without_a_name(left: Sequence[str], imaging_limited: bool, tried: bool) -> Verdict:
    if imaging_limited:
        return Verdict(
            "imaging-limited", (),
            "Even free correlation leaves more than noise in the images: errors of the imaging "
            "dominate, and with them counted no cause stands out.",
            "Look at the residual maps of the free correlation: focus, dust, scan lines, drift.",
        )  # fmt: skip
    if not left and not tried:
        return Verdict(
            "nothing wrong", (),
            "What is left is noise: no structure remains in loads or images. No cause was tried.",
            "Read why each of the causes was not examined, and ask for others.",
        )  # fmt: skip
    if not left:
        return Verdict(
            "nothing wrong", (),
            "What is left is noise: no cause that was tried is needed, and no structure remains "
            "in loads or images.",
            "Read the table of the smallest magnitudes that would have been seen: a cause "
            "smaller than that can still be there.",
        )  # fmt: skip
    return Verdict(
        "unexplained", (),
        f"The residual is not noise, yet no cause that was tried explains it: {_list(left)}.",
        "Look at the maps of what is left: where and when it stands tells what to think of.",
    )  # fmt: skip


def to_confirm(cause: Cause) -> str:
    """Return the physical check of a cause as a sentence."""
    return f"Confirm {cause.title}: {cause.check}."


def _said(group: Sequence[Cause]) -> str:
    if len(group) == 1:
        return group[0].sentence
    return f"either {', or '.join(cause.sentence for cause in group)}"


def _to_do(group: Sequence[Cause]) -> str:
    if len(group) == 1:
        return to_confirm(group[0])
    each = " ".join(f"Check {cause.title}: {cause.check}." for cause in group)
    return f"These data cannot tell {' or '.join(cause.title for cause in group)}. {each}"


def _titles(causes: Sequence[Cause]) -> str:
    return ", ".join(cause.title for cause in causes)


def _list(texts: Sequence[str]) -> str:
    return ", and ".join(texts)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
