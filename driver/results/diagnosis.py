"""A diagnosis as `diagnosis.json` holds it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from driver.diagnosis.answer.detection_limits import not_found
from driver.diagnosis.answer.residual_localisation import Excess, ResidualLocalisation, as_text
from driver.diagnosis.answer.result_types import Diagnosis, Round
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.diagnosis.statistics.goodness_of_fit import GoodnessOfFit
from driver.diagnosis.statistics.score_test import Score
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from driver.parameters.covariance import COVARIANCE_PARAMETERS
from driver.results.extended_case import added_parameters
from driver.results.json_files import json_number

Budget = dict[str, float]

# Entries of `goodness_of_fit` by name, and what each is of the tests.
OMNIBUS = {
    "load_slow_p": "load_slow",
    "load_serial_p": "load_serial",
    "image_slow_p": "image_slow",
    "image_outlier_p": "image_outlier",
    "together_p": "together",
    "smooth_p": "smooth",
    "accepted": "accepted",
}


def diagnosis_record(
    found: Diagnosis,
    objective: Objective,
    law: Sequence[str],
    budgets: tuple[Budget, Budget],
    decks: Mapping[str, str | None] | None,
    where: ResidualLocalisation,
) -> dict[str, Any]:
    """Return what `diagnosis.json` holds.

    Args:
        found: the diagnosis.
        objective: the data and the model that it was made with.
        law: names of the free parameters of law, section and extensions.
        budgets: the error budgets (`error_budget`) before and after.
        decks: of the extended model by solver: None where it was written, else why it was not.
            None where nothing was added.
        where: where and when the fits miss the data.
    """
    parameters = objective.parameters
    added = {
        name: {"value": level, "sigma": sigma, "unit": COVARIANCE_PARAMETERS[name].unit}
        for name, (level, sigma) in found.levels.items()
    }

    def fitted(fit_: Fit) -> dict[str, dict[str, Any]]:
        return {
            name: {
                "value": fit_.values[name],
                "sigma": fit_.sigma(name, parameters),
                "unit": parameters[name].unit,
            }
            for name in fit_.best.free
        }

    before, after = found.baseline, found.extended
    second = found.objective.second
    record = {
        "verdict": found.verdict.kind,
        "causes": list(found.verdict.names),
        "sets": [[cause.name for cause in group] for group in found.verdict.sets],
        "text": found.verdict.text,
        "next": found.verdict.next,
        "added": {n: fitted(after)[n] for n in added_parameters(found)} | added,
        "flips": [cause.name for cause in found.causes if cause in FLIPS],
        "whereabouts": {
            "text": as_text(where),
            "before": [_excess_record(excess) for excess in where.before],
            "after": [_excess_record(excess) for excess in where.after],
        },
        "gain": _gain_record(found, objective, law, budgets),
        "numerics": {
            "effect_sigma": found.numerics.effect,
            "on": found.numerics.along.name,
            "passed": found.numerics.passed,
            "needed": found.numerics.needed,
            "between_meshes": found.numerics.between_meshes,
            "fitted_anew": found.numerics.fitted_anew,
            "missing_share": found.numerics.missing and list(found.numerics.missing),
            "off_by_mesh": {n: found.off_by_mesh(n) for n in added_parameters(found)},
            "second_mesh_um": second and second.size,
        },
        "load_noise": {
            "stated_uN": objective.data.load_noise,
            "found_uN": found.objective.data.load_noise,
            "degrees": json_number(found.objective.data.load_degrees),
        },
        "bad_loads": [
            {"image": bad.frame, "off_uN": bad.off, "sigmas": bad.sigmas} for bad in found.bad_loads
        ],
        "not_found": _not_found(found, objective),
        "not_examined": {left.cause: left.why for left in found.not_examined},
        "baseline": {"values": fitted(before), **_end(before)},
        "extended": {"values": fitted(after), **_end(after)},
        "steps": [_round_record(round_, objective) for round_ in found.rounds],
    }
    if decks is not None:
        record["decks"] = dict(decks)
    return record


def _gain_record(
    found: Diagnosis, objective: Objective, law: Sequence[str], budgets: tuple[Budget, Budget]
) -> dict[str, Any]:
    parameters = objective.parameters
    before, after = found.baseline, found.extended
    shifts = {
        name: (after.values[name] - before.values[name]) / before.sigma(name, parameters)
        for name in law
    }
    gain: dict[str, Any] = {
        "share_of_excess_explained": json_number(found.explained),
        "log_bayes_factor": found.log_evidence,
        "budget_before": budgets[0],
        "budget_after": budgets[1],
        "shift_in_sigma": shifts,
    }
    if found.held_out is not None:
        gain["held_out"] = {
            "cycle": found.held_out[0].cycle,
            "chi_load_before": found.held_out[0].chi_load,
            "chi_load_after": found.held_out[1].chi_load,
            "chi_image_before": found.held_out[0].chi_image,
            "chi_image_after": found.held_out[1].chi_image,
        }
    return gain


def _excess_record(one: Excess) -> dict[str, Any]:
    return {"place": one.place, "phase": one.phase, "misfit_sigma": one.misfit, "p_family": one.p}


def _end(fit_: Fit) -> dict[str, Any]:
    return {"converged": fit_.converged, "reason": fit_.reason}


def _not_found(found: Diagnosis, objective: Objective) -> dict[str, str]:
    """Each cause that was tried and is not named: what the last round would have seen of it."""
    parameters = {**objective.parameters, **COVARIANCE_PARAMETERS}
    named = set(found.verdict.names)
    flips = [s for round_ in found.rounds for s in round_.scores if s.cause in FLIPS]
    return {
        s.cause.name: not_found(s, found.rounds[-1], parameters)
        for s in (*flips, *found.rounds[-1].scores)
        if s.cause.name not in named and s.cause.category != "numerics"
    }


def _round_record(round_: Round, objective: Objective) -> dict[str, Any]:
    refits = {refit.cause.name: refit for refit in round_.refits}
    parameters = {**objective.parameters, **COVARIANCE_PARAMETERS}

    def refitted(name: str) -> dict[str, Any] | None:
        if name not in refits:
            return None
        fit_, cause = refits[name].fit, refits[name].cause
        best: Evaluation = fit_.best
        levels = refits[name].levels or {
            n: (fit_.values[n], fit_.sigma(n, parameters))
            for n in (*cause.parameters, *cause.companions)
        }
        return {
            "log_evidence": refits[name].log_evidence,
            "corrected": refits[name].corrected,
            "chi_load": best.chi_load,
            "chi_image": best.chi_image,
            "values": {n: value for n, (value, _) in levels.items()},
            "sigma": {n: sigma for n, (_, sigma) in levels.items()},
        }

    def scored(s: Score) -> dict[str, Any]:
        scales = [parameters[n].scale for n in s.cause.parameters]
        units = [parameters[n].unit for n in s.cause.parameters]
        return {
            "cause": s.cause.name,
            "category": s.cause.category,
            "sentence": s.cause.sentence,
            "parameters": list(s.cause.parameters),
            "units": units,
            "statistic": s.statistic,
            "degrees": s.degrees,
            "p_family": json_number(s.p),
            "log_evidence": s.log_evidence,
            "estimate": [float(e * k) for e, k in zip(s.estimate, scales, strict=True)],
            "smallest_visible": [
                json_number(v * k) for v, k in zip(s.visible, scales, strict=True)
            ],
            "refit": refitted(s.cause.name),
        }

    return {
        "chi_load": round_.chi_load,
        "chi_image": round_.chi_image,
        "widened": round_.widened,
        "omnibus": _omnibus_record(round_.goodness_of_fit),
        "named": list(round_.named),
        "left_something": list(round_.left_something),
        "causes": [scored(s) for s in round_.scores],
    }


def _omnibus_record(tests: GoodnessOfFit) -> dict[str, Any]:
    return {name: getattr(tests, key) for name, key in OMNIBUS.items()}
