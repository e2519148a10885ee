"""The case of a blind trial: as its experiment truly is, and as its user states it."""

from __future__ import annotations

from benchmarks.blind_plan import ELASTIC, QUIET, Trial
from benchmarks.blind_specimen import known_case
from driver.case.model import Case
from driver.diagnosis.causes.noise_causes import NOISE_NOT_UNIFORM

HELD_OUT = 3  # one cause in so many has a cycle held out


def measured_with(trial: Trial) -> Case:
    """Return the case with the noise of the loads as it truly is."""
    case, change = known_case(), {}
    if trial.kind == "noise level":
        change = {"noise_uN": trial.level * case.loads.noise_uN}
    elif trial.kind == "large" or _is_elastic(trial):
        change = {"noise_uN": QUIET * case.loads.noise_uN}
    elif trial.kind == "AR(1)":
        change = {"autocorrelation": trial.level}
    return case.model_copy(update={"loads": case.loads.model_copy(update=change)})


def uneven(trial: Trial) -> float:
    """Noise of the images at the last column over that at the first."""
    return trial.level if trial.truths == (NOISE_NOT_UNIFORM.name,) else 1.0


def stated_by(trial: Trial, recorded: Case) -> Case:
    """Return case as its user states it: the noise of the loads as in every case, the jitter known.

    A quieter load cell and the b that is tried are told, too. In the elastic trials K is
    identified, too: known, it would tell a load gain from an elastic scale. A held-out cycle is
    predicted only where the trial has a figure of it: no answer hangs on it.
    """
    noise = measured_with(trial) if trial.kind in ("known", "large") else known_case()
    tables: dict[str, object] = {
        "loads": recorded.loads.model_copy(update={"noise_uN": noise.loads.noise_uN}),
        "material": recorded.material.model_copy(update=dict(trial.companions)),
    }
    if _is_elastic(trial):
        parameters = (*recorded.identification.parameters, "K")
        tables["identification"] = recorded.identification.model_copy(
            update={"parameters": parameters}
        )
    if trial.kind == "jitter":
        tables["boundary"] = recorded.boundary.model_copy(update={"jitter_nm": trial.level})
    if trial.kind != "cause" or trial.seed % HELD_OUT:
        tables["diagnosis"] = recorded.diagnosis.model_copy(update={"held_out_cycle": "none"})
    return recorded.model_copy(update=tables)


def _is_elastic(trial: Trial) -> bool:
    return trial.kind == "known" and trial.truths[0] in ELASTIC
