"""Blind trial of the diagnosis: hidden effects, the whole chain from images to verdict, a score.

    python -m benchmarks.blind_trial                     all trials, on all cores; resumes
    python -m benchmarks.blind_trial --only cause pair   some kinds
    python -m benchmarks.blind_trial --figures           the figures of what is done
    python -m benchmarks.blind_trial --quick             some trials in closed form, 45 s

Each trial takes pictures, with noise, of a specimen whose truth is converged, and runs mesh,
measure, identify and diagnose of a case that knows nothing of it, as a user would who states no
sizes of meshes. A line of JSON for each stands in the results file.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from benchmarks.blind_cases import measured_with, stated_by, uneven
from benchmarks.blind_figures import SILENT, print_figures
from benchmarks.blind_misfit import Left, left_of
from benchmarks.blind_plan import KINDS, Trial, aims, plan
from benchmarks.blind_ruler import (
    MOST_SCALES,
    TooSmallError,
    Truth,
    ruler,
    truth_of_cause,
    truth_outside,
)
from benchmarks.blind_specimen import FINEST, flipped, jittered, known_case
from benchmarks.blind_store import Record, cache_folder, kept, of_programs, program, read
from driver.case.model import Case, load_case, write_case
from driver.common.errors import InputError
from driver.common.parallel import side_by_side
from driver.diagnosis.causes.all_causes import EVERY
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.causes.ebsd_flips import flips_of
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.experiment.orientations import orientations_of
from driver.virtual.settings import Microscope, Virtual
from driver.virtual.truth import Course
from driver.virtual.writing import record
from driver.workflow.engine import Stage, StageContext, run_stages
from driver.workflow.measure_stage import measure_numbers
from driver.workflow.pipeline import stages
from solver_adapters.kernels import use_threads
from tools.converged_truth import pulled, true_case

SECONDS = {"silent": 150.0, "loud": 250.0}
"""CPU-s of a trial without and with an effect, its truth included, until some are done."""
DENSE = 3  # times as many images where the noise itself is to be found
MEMORY = 0.9e9  # bytes of a process
BY_NAME = {cause.name: cause for cause in LIBRARY}


@dataclass(frozen=True)
class Task:
    """What a process is given."""

    trial: Trial
    cache: Path
    results: Path
    program: str


def main() -> None:
    """Run what is left of the plan and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=7, help="of the plan")
    parser.add_argument("--only", nargs="+", choices=KINDS, help="kinds of trials")
    parser.add_argument("--most", type=int, help="largest number of trials of this run")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--cache", type=Path, default=user_cache_path("prismid") / "blind_trial")
    parser.add_argument("--results", type=Path, help="default: results.jsonl in the cache")
    parser.add_argument("--figures", action="store_true", help="no new trials")
    parser.add_argument(
        "--also",
        nargs="+",
        default=[],
        metavar="HASH",
        help="programs whose trials count beside those of these sources, where no answer hangs on "
        "what they differ by",
    )
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    asked = parser.parse_args()
    if asked.quick:
        from benchmarks.blind_closed_form import quick

        quick()
        return
    cache = cache_folder(asked.cache)
    results: Path = asked.results or cache / f"results_{asked.seed}.jsonl"
    counted = (program(), *asked.also)
    if asked.figures and not results.is_file():
        raise SystemExit(f"--figures: found no file {results}, expected results of trials")
    if not asked.figures:
        try:
            carry_out(asked.seed, asked.only, asked.most, asked.processes, cache, results, counted)
        except InputError as error:
            raise SystemExit(str(error)) from None  # another run makes the ruler, or holds it
        except KeyboardInterrupt:
            print(f"stopped; the same command goes on with what {results} lacks")
    print_figures(of_programs(read(results), counted))


def carry_out(
    seed: int, only: Sequence[str] | None, most: int | None, processes: int, cache: Path,
    results: Path, programs: Sequence[str],
) -> None:  # fmt: skip
    """Run the trials of a plan that are not in the results file yet."""
    print("an experiment without an effect, by which effects are measured: about 30 CPU-s once")
    trials = planned(seed, cache)
    print(f"program {program()} (hash of its sources); truths in {cache}")
    known = of_programs(read(results), programs)
    done = [line["trial"] for line in known]
    # A trial of an earlier plan may have the name of another one.
    wanted = [t for t in trials if only is None or t.kind in only]
    left = [t for t in wanted if _as_told(t) not in done][:most]
    times = spent(known)
    seconds = sum(times[_loudness(t.kind)] for t in left)
    print(
        f"{len(left)} of {len(trials)} trials to run: about {seconds / 3600 / processes:.1f} h on "
        f"{processes} free core(s) and {MEMORY * processes / 1e9:.1f} GB of memory, into {results}",
        flush=True,
    )
    began, finished = time.monotonic(), 0

    def tell(index: int, line: Record) -> None:
        nonlocal finished
        finished += 1
        rest = (time.monotonic() - began) / finished * (len(left) - finished)
        print(
            f"  {finished}/{len(left)} {left[index].name}: {line['answer']} "
            f"({line['cpu']:.0f} CPU-s; {rest / 60:.0f} min left)",
            flush=True,
        )

    use_threads(1)
    tasks = [Task(t, cache, results, program()) for t in left]
    side_by_side(carried_out, tasks, processes, 1, tell)


def planned(seed: int, cache: Path) -> tuple[Trial, ...]:
    """All trials of a seed, sized by the ruler, which is made if it is not there."""
    measure = ruler(cache)
    shapes = {c.name: (len(c.parameters), c.one_sided) for c in measure.causes}
    towards = aims(seed, shapes)
    reach = {}
    for cause in measure.causes:
        aim = np.array(towards[cause.name])
        reach[cause.name] = (measure.reach(cause, aim), measure.reach(cause, -aim))
    tried, _ = flips_of(orientations_of(known_case()), None)
    d = true_case().material.d
    return plan(seed, shapes, measure.alike, reach, d, [flip.name for flip in tried])


def carried_out(task: Task) -> Record:
    """Run one trial and append its line to the results file."""
    trial, began = task.trial, time.process_time()
    line: Record = {"program": task.program, "trial": _as_told(trial)}
    try:
        truth = truth_of(trial, task.cache)
        line |= {"by_ruler": truth.misfit, "hidden": truth.hidden}
        line |= diagnosed(truth, trial, ruler(task.cache).unaffected)
    except TooSmallError as error:
        line |= {"answer": "no such truth", "why": str(error)}
    except Exception as error:
        # Whatever it is, it is a fault of the program in this trial, and no reason to stop others.
        line |= {"answer": "failed", "why": f"{type(error).__name__}: {error}"}
    line |= {"alike": {n: ruler(task.cache).alike[n] for n in trial.truths if n in BY_NAME}}
    line["cpu_of_truth"] = time.process_time() - began - line.setdefault("cpu", 0.0)
    # One write of one line: those of other processes do not mix with it.
    with task.results.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False) + "\n")
    return line


def truth_of(trial: Trial, cache: Path) -> Truth:
    """Return what happens in a trial."""
    dense = DENSE if trial.kind == "noise" else 1
    if trial.kind == "jitter" or trial.truths == (BOUNDARY_NOISE.name,):
        course = jittered(1e-3 * trial.level, trial.seed, dense)
        return Truth(course, 0.0, {"jitter_nm": trial.level})
    if trial.kind == "noise":
        course = kept(cache / "nothing_dense.pickle", lambda: pulled({}, dense=dense))
        return Truth(course, 0.0, {})
    if trial.kind == "flip":
        (flip,) = trial.truths
        return Truth(kept(cache / f"{flip}.pickle", lambda: flipped(flip)), 0.0, {flip: 1.0})
    if not trial.truths:
        return Truth(kept(cache / "nothing.pickle", lambda: pulled({})), 0.0, {})
    if trial.kind == "outside":
        return truth_outside(cache, trial.truths[0], trial.level)
    alongside = dict(trial.companions)
    most = np.inf if trial.kind in ("known", "large") else MOST_SCALES
    each = [
        truth_of_cause(cache, BY_NAME[name], np.array(aim), trial.level, alongside, most)
        for name, aim in zip(trial.truths, trial.directions, strict=True)
    ]
    if len(each) == 1:
        return each[0]
    hidden = each[0].hidden | each[1].hidden
    course = kept(cache / f"pair_{trial.seed}.pickle", lambda: pulled(hidden))
    return Truth(course, ruler(cache).misfit(course), hidden)


def diagnosed(truth: Truth, trial: Trial, unaffected: Course) -> Record:
    """Run the whole chain on one set of images; what its `diagnosis.json` says, in short."""
    known = tuple(BY_NAME[n] for n in trial.truths if n in BY_NAME)
    with tempfile.TemporaryDirectory() as folder:
        case, microscope = measured_with(trial), Microscope(noise_ratio=uneven(trial))
        settings = Virtual(microscope=microscope)
        path = record(Path(folder), case, truth.course, trial.seed, settings)
        stated, began = stated_by(trial, load_case(path)), time.process_time()
        for refined in range(FINEST + 1):
            write_case(stated.model_copy(update={"specimen": known_case(refined).specimen}), path)
            run_stages(load_case(path), _chain(stated), "diagnose")
            diagnosis = json.loads((path.parent / "results" / "diagnosis.json").read_text("utf-8"))
            check = diagnosis["numerics"]
            asked = diagnosis["verdict"] == "numerics" or check["passed"]
            if check["needed"] != "mesh" or not asked:
                break
        cpu, left = time.process_time() - began, Left(0.0, (), ())
        # Of a noise, in more images than others, no misfit is told.
        if trial.truths and trial.kind != "noise":
            left = left_of(path, truth.course, unaffected, known)
    owner = {p: c.name for c in EVERY for p in c.parameters}
    added = list(dict.fromkeys(owner[p] for p in diagnosis["added"] if p in owner))
    added += diagnosis["flips"]
    first, last = diagnosis["steps"][0], diagnosis["steps"][-1]
    scores = {s["cause"]: s["statistic"] for s in first["causes"]}
    return {
        "cpu": cpu,
        "misfit": left.whole,
        "like_itself": left.like_itself,
        "beside": left.beside,
        "answer": " ".join([diagnosis["verdict"], *diagnosis["causes"]]),
        "verdict": diagnosis["verdict"],
        "said": diagnosis["causes"],
        "added": added,
        "sets": diagnosis["sets"],
        "statistic": {n: scores.get(n) for n in trial.truths},
        "best": [[s["cause"], s["log_evidence"]] for s in first["causes"][:3]],
        "refits": [
            {s["cause"]: s["refit"]["log_evidence"] for s in step["causes"] if s["refit"]}
            for step in diagnosis["steps"]
        ],
        "chi_load": [first["chi_load"], last["chi_load"]],
        "chi_image": [first["chi_image"], last["chi_image"]],
        "omnibus": last["omnibus"],
        "discretisation": next(
            (s["p_family"] for s in last["causes"] if s["category"] == "numerics"), None
        ),
        "numerics": diagnosis["numerics"],
        "refined": refined,
        "held_out": diagnosis["gain"].get("held_out"),
        "baseline": diagnosis["baseline"]["reason"],
    }


def _chain(case: Case) -> tuple[Stage, ...]:
    """Return the stages of `prismid run`, without pictures of the measurement."""
    short: dict[str, Callable[[StageContext], None]] = {"measure": measure_numbers}
    return tuple(replace(stage, run=short.get(stage.name, stage.run)) for stage in stages(case))


def spent(lines: Sequence[Record]) -> dict[str, float]:
    """Mean CPU time of a trial without an effect and of one with an effect [s]."""
    seconds = dict(SECONDS)
    for key in seconds:
        times = [
            line["cpu"] + line.get("cpu_of_truth", 0.0)
            for line in lines
            if _loudness(line["trial"]["kind"]) == key
        ]
        if times:
            seconds[key] = sum(times) / len(times)
    return seconds


def _as_told(trial: Trial) -> Record:
    """Return a trial as a line of the results has it."""
    record: Record = json.loads(json.dumps(asdict(trial)))
    return record


def _loudness(kind: str) -> str:
    return "silent" if kind in SILENT else "loud"


if __name__ == "__main__":
    main()
