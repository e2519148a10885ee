"""What a reader sees first: the answer, what it rests on, what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from driver.common.formatting import chi
from driver.diagnosis.answer.result_types import IMAGING
from driver.identification.identifiability import FAR_OFF
from driver.report.findings import Findings
from driver.report.identified_texts import law_tiles

Row = dict[str, Any]


@dataclass(frozen=True)
class FirstScreen:
    """The head of the page, every number already a text.

    Attributes:
        kind: of the answer, in a few words.
        tone: how it is coloured: settled, between or open.
        headline: the answer in a sentence.
        tiles: what decides: "title", "value", "note", and whether it is an "added" parameter.
        next: what to do next.
        paragraphs: the answer at more length.
        law: the parameters of the law, as tiles.
        checks: what had to hold: "what", whether it "passed", "text".
    """

    kind: str
    tone: str
    headline: str
    tiles: Sequence[Row]
    next: str
    paragraphs: Sequence[str]
    law: Sequence[Row]
    checks: Sequence[Row]

    @property
    def failed(self) -> list[str]:
        """Names of the checks that were not passed."""
        return [check["what"] for check in self.checks if not check["passed"]]


def tile(title: str, value: str, note: str, added: bool = False) -> Row:
    """Return a number with what it is and how to read it."""
    return {"title": title, "value": value, "note": note, "added": added}


def check_row(what: str, passed: bool, text: str) -> Row:
    """Return something that had to hold, and whether it did."""
    return {"what": what, "passed": passed, "text": text}


def first_screen_identified(findings: Findings, reason: str, converged: bool) -> FirstScreen:
    """Return the head of the page of a case that is not diagnosed yet.

    Args:
        findings: the results.
        reason: why the fit ended.
        converged: whether it converged.
    """
    budget = findings.budgets["before"]
    misfit = max(budget["basis"], budget["load"])
    far = [warning for warning in findings.warnings if warning.startswith(FAR_OFF)]
    return FirstScreen(
        kind="not diagnosed",
        tone="between",
        headline="The law is identified; whether the model is right has not been examined.",
        tiles=[
            tile("images: χ", chi(budget["basis"]),
                 "on the correlation mesh, 1 where only noise is left"),
            tile("loads: χ_F", chi(budget["load"]),
                 "1 where no more is left than noise and the error of the mesh"),
        ],
        next="prismid run CASE goes on with the diagnosis: it tells what the model misses, where, "
        "and how surely.",
        paragraphs=[
            "χ and χ_F are averages over all images and loads. A misfit in one place or phase of "
            "the test can hide in them, and one that the parameters have taken up is in none of "
            "them.",
            *(f"To be looked at: {warning}." for warning in findings.warnings),
        ],
        law=law_tiles(findings),
        checks=[
            check_row("images", budget["free"] <= IMAGING,
                      f"free correlation leaves χ = {chi(budget['free'])}"),
            check_row("fit of the identified model", converged, f"ended: {reason}"),
            check_row("misfit of the identified model", misfit <= IMAGING,
                      f"images χ = {chi(budget['basis'])}, loads χ_F = {chi(budget['load'])}; "
                      f"above {IMAGING:g} the model misses what the data show, and its values "
                      "make up for that"),
            check_row("priors", not far,
                      far[0] if far else "no parameter is more than three widths off its prior"),
        ],
    )  # fmt: skip
