"""What the cases of a campaign came to: a table, and a page that compares them."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from driver.batch.jobs import Job, results_at, stages_done
from driver.batch.progress import State
from driver.case.model import load_case
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError
from driver.common.formatting import chi, duration, number, with_sigma
from driver.parameters.registry import label_of
from driver.report.labels import cause_label
from driver.report.style import TONES
from driver.results.files import (
    DIAGNOSIS,
    IDENTIFY,
    REPORT,
    SUMMARY_CSV,
    SUMMARY_HTML,
    TRUTH,
)
from driver.results.hdf5 import prismid_version, read_hdf5, write_csv
from driver.results.identification import read_identification
from driver.results.json_files import read_json
from driver.results.stage_record import read_record
from driver.workflow.pipeline import stages
from templates import render

TEMPLATE = "campaign.html.j2"
_WIDTH, _ROW, _MARGIN = 640.0, 22.0, 12.0  # of a picture [px]


@dataclass(frozen=True)
class Estimate:
    """A parameter of a case: value, standard deviation, unit, and the truth where it is known."""

    value: float
    sigma: float
    unit: str
    truth: float | None = None

    @property
    def known(self) -> bool:
        """Whether there is an uncertainty, and a finite one."""
        return isfinite(self.value) and isfinite(self.sigma) and self.sigma > 0

    @property
    def off(self) -> float | None:
        """By how many standard deviations it is off the truth, None where that is not known."""
        if self.truth is None or not self.known:
            return None
        return (self.value - self.truth) / self.sigma


@dataclass(frozen=True)
class Answer:
    """What a case came to.

    Attributes:
        name: of the job.
        status: how the job ended.
        why: why it has not been done, or an empty text.
        seconds: wall-clock time of all its stages, as they were run last [s].
        page: path of its report, or else of its log, from the page of the summary.
        verdict: of the diagnosis, or an empty text.
        causes: that it names.
        chi: of images and loads of the final model, or nothing.
        estimates: of the law and of what was added, by parameter.
    """

    name: str
    status: str
    why: str
    seconds: float
    page: str = ""
    verdict: str = ""
    causes: tuple[str, ...] = ()
    chi: tuple[float, ...] = ()
    estimates: Mapping[str, Estimate] = field(default_factory=dict)


def write_summary(folder: Path, title: str, states: Sequence[State]) -> None:
    """Write `summary.csv` and `summary.html`.

    Args:
        folder: where they go.
        title: name of the campaign.
        states: of all jobs.
    """
    answers = [_answer(state, folder) for state in states]
    _write_table(folder / SUMMARY_CSV, answers)
    write_whole(folder / SUMMARY_HTML, summary_page(title, answers))


def _answer(state: State, folder: Path) -> Answer:
    """Return what a case came to; results that cannot be read are why it has not been done."""
    job, results = state.job, results_at(state.job.case)
    log = os.path.relpath(job.log, folder)
    status = "stopped" if state.status == "running" else state.status
    if status != "done":
        return Answer(job.name, status, state.words if status == "failed" else "", 0.0, log)
    done = stages_done(job.case)
    try:
        seconds = sum(one["seconds"] for name, one in read_record(results).items() if name in done)
        told = _told(job, results, done)
    except (InputError, OSError, LookupError, TypeError, ValueError) as error:
        why = str(error) if isinstance(error, InputError) else f"results: {error!r}"
        return Answer(job.name, "failed", why, 0.0, log)
    page = os.path.relpath(results / REPORT, folder) if "report" in done else log
    return Answer(job.name, status, "", seconds, page, **told)


def _told(job: Job, results: Path, done: Collection[str]) -> dict[str, Any]:
    """Return verdict, causes, χ and estimates, as far as they are asked for and there.

    Results of an earlier state of the case count no more than none.
    """
    case = load_case(job.case)
    names = [stage.name for stage in stages(case)]
    wanted = [name for name in names[: names.index(job.until) + 1] if name in done]
    law = [*case.identification.parameters, *case.extensions]
    truth = job.case.parent / TRUTH
    true: dict[str, Any] = read_json(truth)["values"] if truth.is_file() else {}
    said: dict[str, Any] = {}
    if "diagnose" in wanted:
        record = read_json(results / DIAGNOSIS)
        values, budget = record["extended"]["values"], record["gain"]["budget_after"]
        free = dict.fromkeys([*law, *record["added"]])
        found = {n: (values[n]["value"], values[n]["sigma"], values[n]["unit"]) for n in free}
        said = {
            "verdict": record["verdict"],
            "causes": tuple(record["causes"]),
            "chi": (budget["model"], budget["load"]),
        }
    elif "identify" in wanted:
        texts = read_identification(results / IDENTIFY)
        sigma = read_hdf5(results / IDENTIFY)["sigma"].tolist()
        of = dict(zip(texts.names, zip(sigma, texts.units, strict=True), strict=True))
        found = {n: (texts.values[n], *of[n]) for n in law if n in of}
    else:
        return {}
    estimates = {
        name: Estimate(
            _number(value), _number(sigma), unit, true[name]["value"] if name in true else None
        )
        for name, (value, sigma, unit) in found.items()
    }
    return {**said, "estimates": estimates}


def _number(value: float | None) -> float:
    """Return what JSON, which knows no NaN, has of a number."""
    return float("nan") if value is None else float(value)


def _write_table(path: Path, answers: Sequence[Answer]) -> None:
    columns: dict[str, list[Any]] = {
        "case": [a.name for a in answers],
        "status": [a.status for a in answers],
        "verdict": [a.verdict for a in answers],
        "causes": [" ".join(a.causes) for a in answers],
        "chi_images": [a.chi[0] if a.chi else "" for a in answers],
        "chi_loads": [a.chi[1] if a.chi else "" for a in answers],
        "seconds": [a.seconds for a in answers],
    }
    for name in _parameters(answers):
        each = [a.estimates.get(name) for a in answers]
        unit = next(e.unit for e in each if e is not None)
        column = f"{name} [{unit}]" if unit else name
        columns[column] = ["" if e is None else e.value for e in each]
        columns[f"sigma of {column}"] = ["" if e is None else e.sigma for e in each]
        if any(e is not None and e.truth is not None for e in each):
            truths = [None if e is None else e.truth for e in each]
            columns[f"truth of {column}"] = ["" if t is None else t for t in truths]
    columns["why"] = [a.why.replace("\n", " ") for a in answers]
    write_csv(path, columns)


def _parameters(answers: Sequence[Answer]) -> list[str]:
    """Names of all parameters that any case has, in the order in which they come."""
    return list(dict.fromkeys(name for answer in answers for name in answer.estimates))


def summary_page(title: str, answers: Sequence[Answer]) -> str:
    """Return the page that compares cases.

    Args:
        title: name of the campaign.
        answers: what they came to.
    """
    rows = [
        {
            "name": a.name, "status": a.status, "why": a.why, "page": a.page,
            "verdict": a.verdict, "tone": TONES.get(a.verdict, "open"),
            "causes": [cause_label(cause) for cause in a.causes],
            "values": [
                f"{label_of(name)} {with_sigma(e.value, e.sigma)} {e.unit}".rstrip()
                for name, e in a.estimates.items()
            ],
            "chi": [chi(value) for value in a.chi],
            "time": duration(a.seconds),
        }
        for a in answers
    ]  # fmt: skip
    counted = [a.verdict or a.status for a in answers]
    return render(
        TEMPLATE,
        title=title,
        version=prismid_version(),
        rows=rows,
        counts={said: counted.count(said) for said in dict.fromkeys(counted)},
        comparisons=list(_comparisons(answers)),
    )


def _comparisons(answers: Sequence[Answer]) -> Iterator[dict[str, Any]]:
    """Compare the cases by each parameter that more than one of them has."""
    for name in _parameters(answers):
        each = {a.name: a.estimates[name] for a in answers if name in a.estimates}
        if len(each) > 1:
            yield comparison(name, each)


def comparison(name: str, each: Mapping[str, Estimate]) -> dict[str, Any]:
    """Return mean, scatter and picture of a parameter over cases.

    The mean is weighted by 1/σ², of those with a finite σ above 0. The scatter about it is told in
    units of σ: about 1 where cases differ by their uncertainty alone.

    Args:
        name: of the parameter.
        each: estimates by case.
    """
    good = [e for e in each.values() if e.known]
    values, sigmas = np.array([e.value for e in good]), np.array([e.sigma for e in good])
    weights = sigmas**-2.0
    mean = float(weights @ values / weights.sum()) if good else float("nan")
    scatter = float("nan")
    if len(good) > 1:
        scatter = float(np.sqrt(np.sum(((values - mean) / sigmas) ** 2) / (len(good) - 1)))
    ends = [x for e in each.values() for x in (*_interval(e), e.truth) if x is not None]
    shown = [x for x in ends if isfinite(x)]
    low, high = min(shown, default=0.0), max(shown, default=0.0)

    def at(value: float | None) -> float | None:
        if value is None or not isfinite(value):
            return None
        share = (value - low) / (high - low) if high > low else 0.5
        return round(_MARGIN + share * (_WIDTH - 2 * _MARGIN), 1)

    unit = next(iter(each.values())).unit
    off = [e.off for e in each.values() if e.off is not None]
    return {
        "label": label_of(name), "unit": unit,
        "mean": with_sigma(mean, float(weights.sum()) ** -0.5 if good else None),
        "scatter": number(scatter, 2),
        "off": number(float(np.sqrt(np.mean(np.square(off)))), 2) if off else "",
        "width": _WIDTH, "height": _ROW * len(each) + _ROW, "at_mean": at(mean),
        "low": number(low), "high": number(high), "margin": _MARGIN,
        "lines": [
            {
                "name": case, "told": with_sigma(e.value, e.sigma), "y": _ROW * (k + 0.5),
                "from": at(_interval(e)[0]), "to": at(_interval(e)[1]),
                "at": at(e.value), "truth": at(e.truth),
            }
            for k, (case, e) in enumerate(each.items())
        ],
    }  # fmt: skip


def _interval(estimate: Estimate) -> tuple[float, float]:
    """Return the ends of the 95 % interval, the value itself where there is no uncertainty."""
    half = 2 * estimate.sigma if estimate.known else 0.0
    return estimate.value - half, estimate.value + half
