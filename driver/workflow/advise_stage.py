"""Stage 5: which change of the experiment would part causes that its data cannot tell apart."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from driver.common.errors import InputError
from driver.common.outcomes import first_line
from driver.design.model_discrimination import Discrimination, advice, discriminating_changes
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.experiment.reading import history_of
from driver.forward.build import parameters_of
from driver.results.advice import Advice, write_advice
from driver.results.extended_case import with_frame_turns
from driver.results.files import DIAGNOSIS, job_store
from driver.results.json_files import read_json
from driver.workflow.engine import StageContext
from solver_adapters.interface import SolverError
from solver_adapters.parameter import Parameter

logger = logging.getLogger(__name__)

Record = dict[str, Any]


def run_advise(context: StageContext) -> None:
    """Simulate the usual changes of the experiment where they may help; write `advice.json`."""
    diagnosis = read_json(context.result(DIAGNOSIS))
    causes = _inseparable(diagnosis)
    changes = _changes(context, diagnosis, causes) if causes else ()
    text = advice(changes) if changes else ""
    if text:
        logger.info(f"  {text}")
    apart = tuple((change.name, change.apart) for change in changes)
    write_advice(context.workdir, Advice(causes, apart, text))


def _inseparable(diagnosis: Record) -> tuple[str, ...]:
    """Return the first set of causes that a diagnosis ends with; empty where it ends otherwise."""
    group = next((names for names in diagnosis["sets"] if len(names) > 1), ())
    if diagnosis["verdict"] != "one of this set":
        return ()
    if set(group) & {flip.name for flip in FLIPS}:
        return ()  # a flip has no size to be parted by
    return tuple(group)


def _changes(
    context: StageContext, diagnosis: Record, causes: Sequence[str]
) -> tuple[Discrimination, ...]:
    """How far changes of the experiment would part these causes; empty if that fails.

    Sizes are those of the scores, in the prior scales of each cause.
    """
    logger.info(f"  which added measurement would part {', '.join(causes)}")
    flips = [flip for flip in FLIPS if flip.name in diagnosis["flips"]]
    case = with_frame_turns(context.case, flips)
    history = history_of(case)
    declared = parameters_of(case, history.n_knots)
    # What was dropped and added again stands in two rounds.
    last = next(s for s in reversed(diagnosis["steps"]) if s["named"][:1] == list(causes[:1]))
    scores = {score["cause"]: score for score in last["causes"]}
    sizes = {name: _size(scores[name], declared) for name in causes}
    values = {name: entry["value"] for name, entry in diagnosis["baseline"]["values"].items()}
    if context.prepare_only:
        logger.info("  not found out: no jobs are prepared for it")
        return ()
    jobs = job_store(context.case)
    try:
        return discriminating_changes(case, history, sizes, values, jobs)
    except (SolverError, InputError) as error:
        # Whatever kept it from being simulated: the diagnosis stands without it.
        logger.info(f"  not found out: {first_line(error)}")
        return ()


def _size(score: Record, declared: Mapping[str, Parameter]) -> float:
    """Largest estimate of the parameters of a cause [prior scales]."""
    # Parameters of noise are told in their own scale.
    scales = [declared[n].scale if n in declared else 1.0 for n in score["parameters"]]
    return float(np.max(np.abs(score["estimate"]) / scales))
