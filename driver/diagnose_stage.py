"""Stage 4: what the simulation gets wrong, written as numbers, words and an extended case."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tifffile

from driver.boundary import LAMBDAS
from driver.case import Case, CaseError, schema_text, write_case
from driver.case_tables.solver import ProfileTable
from driver.design.telling import Telling, advice, most_telling
from driver.diagnosis.diagnose import diagnose
from driver.diagnosis.ebsd_flips import FLIPS, half_turn
from driver.diagnosis.noise_causes import COVARIANCE, COVARIANCE_PARAMETERS, NOISE_RATIO, SIGMA_E
from driver.diagnosis.omnibus import Omnibus
from driver.diagnosis.outcome import Diagnosis, Settings, Step
from driver.diagnosis.own_causes import own_causes
from driver.diagnosis.score import Score
from driver.diagnosis.screening import screened
from driver.diagnosis.visible import not_seen
from driver.errors import InputError, sentence
from driver.experiment import as_in_files
from driver.extended_decks import DECKS, write_decks
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation
from driver.identified_record import IDENTIFY, value_told
from driver.identify_stage import (
    error_budget,
    fit_arrays,
    load_workbench,
    saved_objective,
)
from driver.measure_stage import MEASURE
from driver.results import read_hdf5, write_hdf5
from driver.specimen import TRACE
from driver.stages import StageContext
from driver.workbench import Workbench, on_another_mesh
from solver_adapters.interface import SolverError
from solver_adapters.material import MATERIAL_PARAMETERS

DIAGNOSIS, DIAGNOSIS_H5, EXTENDED = "diagnosis.json", "diagnosis.h5", "extended.toml"
NOISE_MAP = "noise_map.tif"
SCHEMA = "case.schema.json"  # the name by which every case file knows its schema
# Entries of `omnibus` by name, and what each is of the tests.
OMNIBUS = {
    "load_slow_p": "load_slow",
    "load_serial_p": "load_serial",
    "image_slow_p": "image_slow",
    "image_outlier_p": "image_outlier",
    "together_p": "together",
    "accepted": "accepted",
}


def run_diagnose(context: StageContext) -> None:
    """Diagnose the identified model; write `diagnosis.json` and `extended.toml`."""
    case = context.case
    own = own_causes(case)
    wanted = None if case.diagnosis.causes == "all" else case.diagnosis.causes
    bench = load_workbench(context)
    identified = read_hdf5(context.result(IDENTIFY))
    measured = read_hdf5(context.result(MEASURE))
    free_chi = measured["chi"]
    with h5py.File(context.result(IDENTIFY), "r") as file:
        # A term that was installed since is at its null.
        values = bench.objective.model.null_values() | json.loads(file.attrs["all_values"])
        free = tuple(json.loads(file.attrs["names"]))
        converged, reason = bool(file.attrs["converged"]), str(file.attrs["reason"])
    if not converged:
        context.log(f"  the baseline has not converged ({reason}): read the verdict with care")
    objective = saved_objective(bench, identified)
    # One simulation gives the baseline and the sensitivities of every cause.
    wide = objective.evaluate(values, screened(objective.model, free, wanted, own)[1])
    baseline = Fit(objective.restrict(wide, free), converged, reason, ())
    cycles = bench.experiment.history.cycle
    settings = Settings(
        wanted=wanted,
        refit=case.diagnosis.refit,
        held_out=held_out_cycle(case, context.case_path, int(cycles.max())),
        processes=case.execution.processes,
        threads=case.execution.threads,
        free_chi=float(np.sqrt(np.mean(free_chi[measured["left_out"] == 0] ** 2))),
        sizes=bench.plan.sizes,
        own=own,
    )
    found = diagnose(
        baseline, objective, bench.finer, cycles, settings, context.log, wide,
        lambda: on_another_mesh(case, bench),
    )  # fmt: skip
    telling = _telling(found, context, bench)
    if telling:
        advised = f"{found.verdict.next} {advice(telling)}"
        found = replace(found, verdict=replace(found.verdict, next=advised))
    context.log(f"verdict: {found.verdict.kind}. {found.verdict.text}")
    for name in added_parameters(found):
        context.log(f"  {value_told(name, found.extended, objective.parameters)}")
    for name, (level, sigma) in found.levels.items():
        context.log(f"  {name} = {level:.4g} ± {sigma:.2g} {COVARIANCE_PARAMETERS[name].unit}")
    if found.held_out is not None:
        before, after = found.held_out
        context.log(
            f"  held-out cycle {before.cycle}: χ_F {before.chi_load:.2f} → {after.chi_load:.2f}"
        )
    context.log(f"  next: {found.verdict.next}")
    budgets = (
        error_budget(bench, found.baseline.best, free_chi),
        error_budget(bench, found.extended.best, free_chi),
    )
    record = diagnosis_record(found, bench, budgets)
    if found.causes:
        decks = write_decks(context.workdir, case, found.objective.model, found.extended.values)
        for name, refused in decks.items():
            context.log(f"  deck for {name}: " + (refused or f"in {DECKS}/{name}"))
        record["decks"] = decks
    record["telling"] = [{"change": one.name, "apart_sigma": one.apart} for one in telling]
    (context.workdir / DIAGNOSIS).write_text(
        json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    arrays = fit_arrays(found.baseline, bench, "before") | fit_arrays(
        found.extended, bench, "after"
    )
    write_hdf5(context.workdir / DIAGNOSIS_H5, arrays)
    if NOISE_RATIO.name in found.levels:
        write_noise_map(case, found, context.workdir / NOISE_MAP)
    write_case(extended_case(case, found), context.workdir / EXTENDED)
    (context.workdir / SCHEMA).write_text(schema_text(), encoding="utf-8")


def _telling(found: Diagnosis, context: StageContext, bench: Workbench) -> tuple[Telling, ...]:
    """Which change of the experiment would part the causes of a set; empty if there is none.

    Sizes are those of the scores, in the prior scales of each cause.
    """
    group = next((step.named for step in found.steps if len(step.named) > 1), ())
    if found.verdict.kind != "one of this set" or not group:
        return ()
    if set(group) & {flip.name for flip in FLIPS}:
        return ()  # a flip has no size to be parted by
    context.log(f"which added measurement would part {', '.join(group)}")
    scores = {s.cause.name: s for s in next(s for s in found.steps if s.named == group).scores}
    sizes = {name: float(np.max(np.abs(scores[name].estimate))) for name in group}
    law = {name: found.baseline.values[name] for name in found.baseline.best.free}
    try:
        case = _with_flips(context.case, found)
        return most_telling(case, bench.experiment.history, sizes, law, context.log)
    except (InputError, SolverError, ValueError) as error:
        context.log(f"  not found out: {str(error).partition(chr(10))[0]}")
        return ()


def added_parameters(found: Diagnosis) -> tuple[str, ...]:
    """Names of the parameters of the general model that the extension freed."""
    freed = [cause for cause in found.causes if cause not in COVARIANCE]
    every = (n for cause in freed for n in (*cause.parameters, *cause.companions))
    return tuple(dict.fromkeys(every))


def _with_flips(case: Case, found: Diagnosis) -> Case:
    """The case with the EBSD frame turned as the flips that were named turn it."""
    given = np.array(case.orientation.ebsd_to_specimen)
    rows = tuple(map(tuple, (half_turn(found.causes) @ given + 0.0).tolist()))
    return case.model_copy(
        update={"orientation": case.orientation.model_copy(update={"ebsd_to_specimen": rows})}
    )


def extended_case(case: Case, found: Diagnosis) -> Case:
    """The case with the fitted values as starts and the added causes freed.

    It stands in `results/`: its paths lead one folder up.
    """
    values = found.extended.values
    names = {
        "tau0": "tau0_MPa", "c": "c_MPa", "Q": "Q_MPa", "Q_latent": "Q_latent_MPa",
        "c2": "c2_MPa",
        "skin_thickness": "skin_thickness_um",
    }  # fmt: skip
    constants = {
        names.get(name, name): values[name]
        for name in MATERIAL_PARAMETERS
        if name in case.identification.parameters
    }
    lambdas = dict(
        zip(("plus_Y", "plus_Z", "minus_Y", "minus_Z"), (values[n] for n in LAMBDAS), strict=True)
    )
    freed = {name: values[name] for name in (*case.extensions, *added_parameters(found))}
    images = case.images
    moved = {
        key: _from_results(getattr(images, key))
        for key in ("frames", "flats", "repeats", "mask", "noise_map")
        if getattr(images, key) is not None
    }
    if NOISE_RATIO.name in found.levels:
        moved["noise_map"] = NOISE_MAP
    history = case.history.model_copy(update={"file": _from_results(case.history.file)})
    boundary: dict[str, Any] = {
        "lambda_start": case.boundary.lambda_start.model_copy(update=lambdas)
    }
    if SIGMA_E.name in found.levels:
        boundary["jitter_nm"] = 1e3 * found.levels[SIGMA_E.name][0]
    files = tuple(_from_results(name) for name in case.diagnosis.cause_files)
    meshes = {
        key: _from_results(name)
        for key in ("mesh", "height_mesh")
        if (name := getattr(case.dic, key)) not in (None, TRACE)
    }
    return _with_flips(case, found).model_copy(
        update={
            "material": case.material.model_copy(update=constants),
            "boundary": case.boundary.model_copy(update=boundary),
            "extensions": freed,
            "images": images.model_copy(update=moved),
            "history": history,
            "dic": case.dic.model_copy(update=meshes),
            "solver": case.solver.model_copy(update={"profiles": _profiles_from_results(case)}),
            "diagnosis": case.diagnosis.model_copy(update={"cause_files": files}),
        }
    )


def write_noise_map(case: Case, found: Diagnosis, path: Path) -> None:
    """The noise that was found at each pixel, over its mean, as an image like those of the case."""
    image = found.objective.data.image
    noise = np.ones((1, *image.images.shape))
    if image.variance is not None:
        noise[0, image.images.rows, image.images.cols] = np.sqrt(image.variance)
    tifffile.imwrite(path, as_in_files(case.images, noise)[0].astype(np.float32))


def _from_results(name: str) -> str:
    return name if Path(name).is_absolute() else f"../{name}"


def _profiles_from_results(case: Case) -> dict[str, ProfileTable]:
    """The profiles of the case; files in their calls are those that they were."""
    found = {}
    for name, profile in case.solver.profiles.items():
        words = [
            # A program without a slash is one of PATH.
            _from_results(word) if case.path(word).is_file() and (k or "/" in word) else word
            for k, word in enumerate(profile.command or ())
        ]
        found[name] = profile.model_copy(update={"command": tuple(words) or None})
    return found


def diagnosis_record(
    found: Diagnosis, bench: Workbench, budgets: tuple[dict[str, float], dict[str, float]]
) -> dict[str, Any]:
    """What `diagnosis.json` holds."""
    parameters = bench.objective.parameters
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
    shifts = {
        name: (after.values[name] - before.values[name]) / before.sigma(name, parameters)
        for name in bench.law
    }
    gain: dict[str, Any] = {
        "share_of_excess_explained": _number(found.explained),
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
    return {
        "verdict": found.verdict.kind,
        "causes": list(found.verdict.causes),
        "text": found.verdict.text,
        "next": found.verdict.next,
        "added": {n: fitted(after)[n] for n in added_parameters(found)} | added,
        "flips": [cause.name for cause in found.causes if cause in FLIPS],
        "gain": gain,
        "numerics": {
            "effect_sigma": found.gate.effect,
            "on": found.gate.cause,
            "passed": found.gate.passed,
            "needed": found.gate.needed,
            "between_meshes": found.gate.between_meshes,
        },
        "load_noise": {
            "stated_uN": bench.objective.data.load_noise,
            "found_uN": found.objective.data.load_noise,
            "degrees": _number(found.objective.data.load_degrees),
        },
        "bad_loads": [
            {"image": bad.frame, "off_uN": bad.off, "sigmas": bad.sigmas} for bad in found.bad_loads
        ],
        "not_found": _not_found(found, bench),
        "not_examined": {left.cause: left.why for left in found.not_examined},
        "baseline": fitted(before) | {"reason": before.reason},
        "extended": fitted(after) | {"reason": after.reason},
        "steps": [_step_record(step, bench) for step in found.steps],
    }


def _not_found(found: Diagnosis, bench: Workbench) -> dict[str, str]:
    """Each cause that was tried and not found: what the last round would have seen of it."""
    parameters = {**bench.objective.parameters, **COVARIANCE_PARAMETERS}
    named = set(found.verdict.causes)
    flips = [s for step in found.steps for s in step.scores if s.cause in FLIPS]
    return {
        s.cause.name: not_seen(s, parameters)
        for s in (*flips, *found.steps[-1].scores)
        if s.cause.name not in named and s.cause.category != "numerics"
    }


def _step_record(step: Step, bench: Workbench) -> dict[str, Any]:
    refits = {refit.cause.name: refit for refit in step.refits}
    parameters = {**bench.objective.parameters, **COVARIANCE_PARAMETERS}

    def refitted(name: str) -> dict[str, Any] | None:
        if name not in refits:
            return None
        fit_, cause = refits[name].fit, refits[name].cause
        best: Evaluation = fit_.best
        found = refits[name].levels or {
            n: (fit_.values[n], fit_.sigma(n, parameters))
            for n in (*cause.parameters, *cause.companions)
        }
        return {
            "log_evidence": refits[name].log_evidence,
            "chi_load": best.chi_load,
            "chi_image": best.chi_image,
            "values": {n: value for n, (value, _) in found.items()},
            "sigma": {n: sigma for n, (_, sigma) in found.items()},
        }

    def scored(s: Score) -> dict[str, Any]:
        scales = [parameters[n].scale if n in parameters else 1.0 for n in s.cause.parameters]
        units = [parameters[n].unit if n in parameters else "" for n in s.cause.parameters]
        return {
            "cause": s.cause.name,
            "category": s.cause.category,
            "sentence": s.cause.sentence,
            "parameters": list(s.cause.parameters),
            "units": units,
            "statistic": s.statistic,
            "degrees": s.degrees,
            "p_family": _number(s.p),
            "log_evidence": s.log_evidence,
            "estimate": [float(e * k) for e, k in zip(s.estimate, scales, strict=True)],
            "smallest_visible": [_number(v * k) for v, k in zip(s.visible, scales, strict=True)],
            "refit": refitted(s.cause.name),
        }

    return {
        "chi_load": step.chi_load,
        "chi_image": step.chi_image,
        "widened": step.widened,
        "omnibus": _omnibus_record(step.omnibus),
        "named": list(step.named),
        "causes": [scored(s) for s in step.scores],
    }


def _omnibus_record(tests: Omnibus) -> dict[str, Any]:
    return {name: getattr(tests, key) for name, key in OMNIBUS.items()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def held_out_cycle(case: Case, case_path: Path, cycles: int) -> int | None:
    """The cycle that is held out, if any.

    Args:
        case: the case.
        case_path: its file.
        cycles: how many cycles its history has.

    Raises:
        CaseError: it asks for a cycle that there is not.
    """
    asked = case.diagnosis.held_out_cycle
    if isinstance(asked, int) and asked > cycles:
        raise CaseError(
            sentence(case_path, "diagnosis.held_out_cycle", str(asked),
                     f"one of the {cycles} cycle(s)")
        )  # fmt: skip
    if asked == "none" or cycles < 2:
        return None
    return cycles if asked == "last" else asked
