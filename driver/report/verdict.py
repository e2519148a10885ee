"""The verdict on the page: its sentence, what decides it, and whether it can be trusted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from driver.common.formatting import chi, joined, number, probability, signed
from driver.diagnosis.answer.result_types import GATE, IMAGING, MOST_OFF
from driver.diagnosis.answer.verdict import LEAST_EXPLAINED
from driver.diagnosis.search.selection_round import WITHIN
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.parameters.registry import label_of
from driver.report.evidence_figures import signed_evidence
from driver.report.findings import Findings
from driver.report.first_screen import FirstScreen, Row, check_row, tile
from driver.report.identified_texts import law_tiles
from driver.report.labels import cause_label
from driver.report.style import TONES
from driver.report.tables import added_rows, evidence_of, measure

_HARDLY = 0.1  # of a χ above noise, which averages of a local misfit do not reach
_LARGEST_ODDS = 200.0  # log evidence beyond which odds say nothing more


def first_screen(findings: Findings) -> FirstScreen:
    """Return the head of the page of a diagnosed case."""
    diagnosis = findings.diagnosis
    sentences = verdict_texts(diagnosis)
    if findings.extended:
        sentences.append(gain_text(diagnosis))
    sentences += [grain["text"] for grain in diagnosis["critical_stress"]]
    sentences += [f"To be looked at: {warning}." for warning in diagnosis["warnings"]]
    return FirstScreen(
        kind=diagnosis["verdict"],
        tone=TONES[diagnosis["verdict"]],
        headline=sentences[0],
        tiles=tiles(findings),
        next=" ".join(filter(None, (diagnosis["next"], findings.advice))),
        paragraphs=sentences[1:],
        law=law_tiles(findings),
        checks=checks(findings),
    )


def verdict_texts(diagnosis: Row) -> list[str]:
    """Return the verdict in one sentence, and the paragraph below it."""
    share = diagnosis["gain"]["share_of_excess_explained"]
    summary = headline(diagnosis["verdict"], diagnosis["sets"], share)
    if diagnosis["verdict"] == "named":
        return [diagnosis["text"], summary]
    return [summary, diagnosis["text"]]


def headline(kind: str, sets: Sequence[Sequence[str]], share: float | None = 1.0) -> str:
    """Return the kind of a verdict as a sentence.

    Args:
        kind: the answer.
        sets: for each effect that it names the causes that cannot be told apart.
        share: of the misfit above noise that is gone; None where the averages over everything are
            not above noise.
    """
    names = ", and ".join(_one_of(group) for group in sets)
    several = len(sets) > 1
    either = joined([cause_label(name) for name in sets[0]]) if sets else ""
    found = {
        "named": f"{'Together these causes explain' if several else 'One cause explains'} "
        f"the misfit: {names}.",
        "one of this set": f"Together these explain the misfit: {names}."
        if several
        else f"One of these explains the misfit, and these data cannot say which: {either}.",
    }
    if kind in found and (share is None or share < LEAST_EXPLAINED):
        of_misfit = (
            "too small or too local for the averages over loads and images" if share is None
            else f"which takes {number(100.0 * share, 2)} % of the misfit above noise"
        )  # fmt: skip
        return f"Found: {names}; {of_misfit}."
    sentences = found | {
        "nothing wrong": "Nothing wrong: the model leaves only noise.",
        "named, but something is left": f"Found: {names}; but something is left that is not noise.",
        "unexplained": "Unexplained: the model misses something that no cause that was tried "
        "accounts for.",
        "imaging-limited": "The images are the limit: their errors outweigh those of the model.",
        "numerics": "The simulation is not exact enough to judge the model.",
    }
    return sentences[kind]


def gain_text(diagnosis: Row) -> str:
    """Return what the extension has gained, in words: what decides first, averages last."""
    gain = diagnosis["gain"]
    added = joined(
        [
            f"{label_of(name)} = {measure(name, entry['unit'], entry['value'], entry['sigma'])}"
            for name, entry in diagnosis["added"].items()
        ]
        + [cause_label(name) for name in diagnosis["flips"]]
    )
    share, worst = gain["share_of_excess_explained"], worst_place(diagnosis["whereabouts"])
    gone = [] if share is None else [f"{number(100.0 * share)} % of the misfit above noise is gone"]
    if worst is not None:
        gone.append(
            f"at {worst.where}, where it is worst, {worst.before:.1f} σ beyond noise become "
            f"{worst.after:.1f} σ"
        )
    sentences = [f"With {added}, {joined(gone)}."] if gone else [f"Added: {added}."]
    if "held_out" in gain:
        held = gain["held_out"]
        sentences.append(
            f"Cycle {held['cycle']}, predicted from the other cycles and not fitted, goes from "
            f"χ = {chi(held['chi_image_before'])} to {chi(held['chi_image_after'])} in the images "
            f"and from χ_F = {chi(held['chi_load_before'])} to {chi(held['chi_load_after'])} in "
            f"the loads."
        )
    before, after = gain["budget_before"], gain["budget_after"]
    images = f"χ = {chi(before['basis'])} → {chi(after['basis'])}"
    loads = f"χ_F = {chi(before['load'])} → {chi(after['load'])}"
    if max(before["basis"], before["load"]) < 1.0 + _HARDLY:
        sentences.append(
            f"So local a misfit hardly moves the averages over everything: images {images}, loads "
            f"{loads}, where noise alone makes 1."
        )
    else:
        sentences.append(
            f"Over everything the images go {images}, the loads {loads}, where noise alone makes 1."
        )
    return " ".join(sentences)


@dataclass(frozen=True)
class Place:
    """Where and when a model misses the data most.

    Attributes:
        where: place and phase, in words.
        before: misfit beyond noise there before [σ].
        after: the same after, of what was added.
        seen: whether it was no noise before.
    """

    where: str
    before: float
    after: float
    seen: bool


def worst_place(where: Mapping[str, Any]) -> Place | None:
    """Return where the model of the case misses the data most, None where nothing was looked at.

    Args:
        where: `whereabouts` of `diagnosis.json`.
    """
    if not where["before"]:
        return None
    worst = max(where["before"], key=lambda one: one["misfit_sigma"])
    key = worst["place"], worst["phase"]
    after = [one["misfit_sigma"] for one in where["after"] if (one["place"], one["phase"]) == key]
    phase = worst["phase"]
    over = f"over {phase}" if phase.startswith("the whole") else f"in {phase}"
    return Place(
        f"{worst['place']} {over}",
        worst["misfit_sigma"],
        after[0] if after else math.nan,
        worst["p_family"] < FAMILY_LEVEL,
    )


@dataclass(frozen=True)
class Lead:
    """How far an added cause is ahead of the next one.

    Attributes:
        cause: the added cause, with those that cannot be told from it.
        evidence: its log evidence.
        next: the best of the others.
        next_evidence: its log evidence.
    """

    cause: tuple[str, ...]
    evidence: float
    next: str
    next_evidence: float

    @property
    def ahead(self) -> float:
        """Difference of both."""
        return self.evidence - self.next_evidence


def smallest_lead(steps: Sequence[Row]) -> Lead | None:
    """Return the lead of the round that decides least, None where nothing was added.

    Causes that leave what is no noise do not count, for none of them would have been added.

    Args:
        steps: rounds of `diagnosis.json`.
    """
    leads = []
    for step in steps:
        of_cause = {cause["cause"]: evidence_of(cause) for cause in step["causes"]}
        named = tuple(step["named"])
        out = {*named, *step["left_something"]}
        others = {name: evidence for name, evidence in of_cause.items() if name not in out}
        if named and others:
            best = max(others, key=lambda name: others[name])
            leads.append(Lead(named, of_cause[named[0]], best, others[best]))
    return min(leads, key=lambda lead: lead.ahead, default=None)


def tiles(findings: Findings) -> list[Row]:
    """Return what decides the verdict, as numbers with words."""
    diagnosis, extended = findings.diagnosis, findings.extended
    gain = diagnosis["gain"]
    rows = [
        tile(row["label"], row["value"], _added_note(row), added=True)
        for row in added_rows(findings)
    ]
    lead, worst = smallest_lead(diagnosis["steps"]), worst_place(diagnosis["whereabouts"])
    if lead is not None:
        rows.append(tile("ahead of the next cause", signed(lead.ahead), _lead_note(lead)))
    if "held_out" in gain:
        rows.append(_held_out_tile(gain["held_out"], extended))
    if worst is not None:
        rows.append(_place_tile(worst, extended))
    if not extended:
        before = gain["budget_before"]
        rows += [
            tile("loads: χ_F", chi(before["load"]),
                 "1 where no more is left than noise and the error of the mesh"),
            tile("images: χ", chi(before["basis"]),
                 "on the correlation mesh, 1 where only noise is left"),
        ]  # fmt: skip
    return rows


def _added_note(row: Row) -> str:
    note = f"{row['null']} in the model of the case, {row['sigmas']} σ away"
    if row["off_by_mesh"]:
        note += f"; either of two finer meshes alone would put it off by {row['off_by_mesh']}"
    return note


def _lead_note(lead: Lead) -> str:
    names = joined([cause_label(name) for name in lead.cause])
    note = (
        f"in log evidence: {names} {signed_evidence(lead.evidence)}, {cause_label(lead.next)} "
        f"{signed_evidence(lead.next_evidence)}"
    )
    if WITHIN < lead.ahead < _LARGEST_ODDS:
        note += f"; odds of {number(math.exp(lead.ahead), 1)} : 1"
    return note


def _held_out_tile(held: Row, extended: bool) -> Row:
    """Return the tile of the held-out cycle, in front what the extension has changed more."""
    load = held["chi_load_before"], held["chi_load_after"]
    image = held["chi_image_before"], held["chi_image_after"]
    by_loads = load[0] - load[1] >= image[0] - image[1]
    title, value = ("χ_F of loads", load) if by_loads else ("χ of images", image)
    other = f"χ of images {_change(image, extended)}"
    if not by_loads:
        other = f"χ_F of loads {_change(load, extended)}"
    return tile(
        f"held-out cycle {held['cycle']}: {title}",
        _change(value, extended),
        f"predicted, not fitted; noise alone makes 1; {other}",
    )


def _place_tile(worst: Place, extended: bool) -> Row:
    value = f"{worst.before:.1f} σ"
    if extended and math.isfinite(worst.after):
        value = f"{worst.before:.1f} → {worst.after:.1f} σ"
    fate = "beyond noise" if worst.seen else "beyond the mean of noise, which can be chance,"
    return tile("where it misses most", value, f"{fate} at {worst.where}")


def checks(findings: Findings) -> list[Row]:
    """Return what had to hold for the verdict to be trusted, and whether it did."""
    diagnosis = findings.diagnosis
    discretisation_check, last = diagnosis["numerics"], diagnosis["steps"][-1]["omnibus"]
    free = diagnosis["gain"]["budget_before"]["free"]
    rows = [
        check_row("mesh and time steps", discretisation_check["passed"], _own_error(diagnosis)),
        check_row("images", free <= IMAGING, f"free correlation leaves χ = {chi(free)}"),
        check_row(
            "what is left", last["accepted"],
            f"{tests_told(last)} (rejected below a family-wise 1 %)",
        ),
    ]  # fmt: skip
    for name, key in (("identified model", "baseline"), ("extended model", "extended")):
        if key == "baseline" or findings.extended:
            end = diagnosis[key]
            rows.append(
                check_row(f"fit of the {name}", end["converged"], f"ended: {end['reason']}")
            )
    return rows


def _own_error(diagnosis: Row) -> str:
    """Return what the simulation's own error does to scores, in words."""
    check = diagnosis["numerics"]
    effect, times = number(check["effect_sigma"], 2), check["fitted_anew"]
    more = ""
    if check["second_mesh_um"] is not None:
        size = number(check["second_mesh_um"], 3)
        more = f"; their correction is that of a second finer mesh, of {size} µm"
    if check["missing_share"] is not None:
        share, sigma = (number(value, 2) for value in check["missing_share"])
        more += f"; beside their correction the data show {share} ± {sigma} of it"
    if check["between_meshes"]:
        return (
            f"two finer meshes differ by {effect} σ along {cause_label(check['on'])} "
            f"(at most {2 * MOST_OFF:g} σ is tolerated){more}"
        )
    anew = f", fitted anew with it {times} time{'s' * (times > 1)} before" if times else ""
    return (
        f"their error changes by {effect} σ from the identified to the extended model{anew} "
        f"(at most {GATE:g} σ is tolerated){more}"
    )


def tests_told(tests: Row) -> str:
    """Return the tests of a round for goodness of fit, in words."""
    return (
        f"slow part of the load p = {probability(tests['load_slow_p'])}, "
        f"its serial correlation p = {probability(tests['load_serial_p'])}, "
        f"slow part of the images p = {probability(tests['image_slow_p'])}, "
        f"single images p = {probability(tests['image_outlier_p'])}, "
        f"all causes together p = {probability(tests['together_p'])}, "
        f"smooth motions that grow with the stretch p = {probability(tests['smooth_p'])}"
    )


def _one_of(group: Sequence[str]) -> str:
    labels = joined([cause_label(name) for name in group])
    return labels if len(group) == 1 else f"one of {labels} (these data cannot say which)"


def _change(pair: tuple[float, float], changed: bool) -> str:
    before, after = (chi(value) for value in pair)
    return f"{before} → {after}" if changed else before
