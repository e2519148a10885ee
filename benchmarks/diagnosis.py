"""The demo as a study: what is found of the known truth of `examples/alpha`, and what it costs.

    python -m benchmarks.diagnosis           the whole run in a temporary folder
    python -m benchmarks.diagnosis --quick   mesh and measurement alone

The truth stands in `examples/alpha/README.md`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from driver.case.model import load_case
from driver.common.progress import progress_to
from driver.diagnosis.statistics.screening import screened
from driver.experiment.history import knot_weights, read_history
from driver.forward.model import ForwardModel, Values
from driver.parameters.boundary import LAMBDAS
from driver.results.files import RESULTS
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import load_problem

ALPHA = Path(__file__).parents[1] / "examples" / "alpha"
TRUTH = {
    "lambda_plus_Y": 0.81, "lambda_plus_Z": 1.02, "lambda_minus_Y": 0.98, "lambda_minus_Z": 1.02,
    "tau0": 21.0, "c": 44e3, "d": 1140.0, "tau0_grain2": 1.15,
    **{f"elongation_{k}": 1e-3 * e for k, e in enumerate((64, 56, 128, 120, 192, 184), start=1)},
    **{f"tilt_{k}": 2.5e-4 * e for k, e in enumerate((64, 56, 128, 120, 192, 184), start=1)},
}  # fmt: skip


def main() -> None:
    """Run the study and print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    quick = parser.parse_args().quick
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "alpha" / "case.toml"
        shutil.copytree(ALPHA, case.parent, ignore=shutil.ignore_patterns("results"))
        with progress_to(print):
            pipeline.run(case, "measure" if quick else "report", False)
        measured(case)
        screening(case, 2 if quick else 3)
        if not quick:
            found(case)


def measured(case: Path) -> None:
    """Elongation of the free correlation against the truth."""
    results = read_hdf5(case.parent / "results" / "measure.h5")
    history = read_history(case.parent / "history.csv")
    knots = [0.0, *(TRUTH[f"elongation_{k}"] for k in range(1, 7))]
    truth = knot_weights(history)[history.image_row] @ knots
    error = results["elongation"] - truth
    print(f"χ of free correlation = {np.sqrt(np.mean(results['chi'] ** 2)):.3f} (goal: 1)")
    print(
        f"elongation rms error [nm] = {1e3 * np.sqrt(np.mean(error**2)):.1f} "
        f"(goal: <= its sigma {1e3 * float(results['elongation_sigma']):.1f})"
    )


def screening(case: Path, repeats: int) -> None:
    """Time the sensitivities of all causes, in simulations without any, best of some repeats.

    The diagnosis repeats the simulation of the identification by the way that it took.
    """
    model, again, start, free, names = _screened(case)
    works = {
        "plain": lambda: model.predict(start),
        "fitted": lambda: again.predict(start, free),
        "every": lambda: again.predict(start, names),
    }
    # In turn, since the speed of a shared machine changes from second to second.
    times = [{name: cpu_of(work) for name, work in works.items()} for _ in range(repeats)]
    plain, fitted, every = (min(t[name] for t in times) for name in works)
    print(f"a simulation [CPU-s] = {plain:.2f}")
    print(f"once more with {len(free)} fitted parameters [simulations] = {fitted / plain:.2f}")
    print(
        f"screening among all causes, {len(names)} parameters [simulations] = "
        f"{every / plain:.2f} (goal: <= 2.5)"
    )


def screened_simulations(case: Path, numbers: Sequence[int]) -> dict[int, float]:
    """CPU time [s] of a simulation with so many of the parameters of the screening, best of three.

    The first are those of the fit; those of the causes follow.
    """
    _, again, start, _, names = _screened(case)
    times = [
        {n: cpu_of(partial(again.predict, start, names[:n])) for n in numbers} for _ in range(3)
    ]
    return {n: min(t[n] for t in times) for n in numbers}


def _screened(
    case: Path,
) -> tuple[ForwardModel, ForwardModel, Values, tuple[str, ...], tuple[str, ...]]:
    """Return the working model, the same with its way known, the start, fitted and all names."""
    results = case.parent / RESULTS
    context = StageContext(load_case(case), results, results)
    problem = load_problem(context)
    free = (*LAMBDAS, *problem.knots, *problem.law)
    _, names = screened(problem.working, free, None)
    model, start = problem.working, problem.start
    first = model.predict(start).response  # and kernels are loaded
    again = model.with_time_steps_of(first.ends, start).warm_started_from(first.trajectory, start)
    return model, again, start, free, tuple(names)


def cpu_of(work: Callable[[], object]) -> float:
    """CPU time of this process [s]."""
    begin = process_time()
    work()
    return process_time() - begin


def found(case: Path) -> None:
    """Verdict, parameters against the truth, gain and time."""
    record = json.loads((case.parent / "results" / "diagnosis.json").read_text("utf-8"))
    print(f"verdict = {record['verdict']}: {', '.join(record['causes'])} (goal: grain_contrast)")
    deviations = {}
    for name, truth in TRUTH.items():
        value, sigma = (record["extended"]["values"][name][key] for key in ("value", "sigma"))
        deviations[name] = (value - truth) / sigma
        print(
            f"{name} = {value:.5g} ± {sigma:.2g} (truth {truth:g}, {deviations[name]:+.1f} sigma)"
        )
    print(f"largest deviation [sigma] = {max(map(abs, deviations.values())):.1f} (goal: <= 3)")
    held = record["gain"]["held_out"]
    print(
        f"held-out cycle {held['cycle']} chi_F = {held['chi_load_before']:.2f} before, "
        f"{held['chi_load_after']:.2f} after"
    )
    print(
        f"own error of the simulation [sigma] = {record['numerics']['effect_sigma']:.2f} (goal: 1)"
    )
    stages = json.loads((case.parent / "results" / "stages.json").read_text("utf-8"))
    for name, stage in stages.items():
        print(f"time of {name} [s] = {stage['seconds']:.1f}")


if __name__ == "__main__":
    main()
