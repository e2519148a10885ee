"""Blind trials of a specimen with a solver in closed form: some seconds, and no guarantee.

Diagnosis and fits are the real ones; mesh, time steps and correlation have no part in it.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from benchmarks.blind_figures import show_share
from driver.diagnosis.diagnose import diagnose
from driver.diagnosis.outcome import Settings
from tests.driver import closed_form

BUDGET = 25.0  # s of wall clock, after which no further trial starts
EFFECTS = {
    "tau0_grain2": ("grain_contrast", 0.15),
    "stretch_curvature": ("stretch_not_proportional", 0.10),
    "load_offset": ("load_offset", 10.0),
    "tilt_drift": ("tilt_drift", 4e-3),
}  # by parameter the cause, and the size of its effect


def quick(seed: int = 7) -> None:
    """Trials in turn without and with an effect, until the time is over."""
    rng = np.random.default_rng(seed)
    bench = closed_form.bench()
    fine = replace(bench.model, adapter=closed_form.ClosedFormSolver(0.001))
    settings = Settings(None, 5, None, 1, 1, 1.0, closed_form.SIZES)
    silent: list[bool] = []
    named: list[bool] = []
    right: list[bool] = []
    cpu, began = time.process_time(), time.monotonic()
    names = [None, *EFFECTS]
    while time.monotonic() - began < BUDGET or not right:
        name = names[(len(silent) + len(right)) % len(names)]
        hidden: dict[str, float] = {}
        if name is not None:
            null, size = bench.truth[name], EFFECTS[name][1]
            hidden = {name: null + float(rng.choice([-1, 1])) * size}
        made = closed_form.objective(bench, bench.truth | hidden, int(rng.integers(2**31)))
        objective, baseline = closed_form.identified(bench, made, fine)
        cycles = bench.history.cycle
        found = diagnose(baseline, objective, fine, cycles, settings, lambda line: None)
        if name is None:
            silent.append(found.verdict.kind == "nothing wrong")
            named.append(bool(found.verdict.causes))
        else:
            right.append(EFFECTS[name][0] in found.verdict.causes)
            if not right[-1]:
                print(
                    f"miss: {name} = {hidden[name]:g}: {found.verdict.kind}, "
                    f"{', '.join(found.verdict.causes) or 'no cause'}"
                )
    n = len(silent) + len(right)
    show_share("closed form, null: something named [%]", named, "<= 1")
    show_share("closed form, null: anything said [%]", [not quiet for quiet in silent], "<= 2.5")
    show_share("closed form, hidden effect: the answer holds it [%]", right, ">= 98")
    print(f"closed form: CPU time of a trial [s] = {(time.process_time() - cpu) / n:.2f}")
