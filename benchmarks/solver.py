"""Speed of the bundled solver, and its accuracy beside CalculiX and Code_Aster.

    python -m benchmarks.solver           the whole study
    python -m benchmarks.solver --quick   what can be measured in 45 s, kernels compiled before

Each measurement runs in a process of its own on one thread. Times are CPU time, the best of a few
repeats, unless stated otherwise. Without `ccx` on the PATH the figures beside CalculiX are left
out.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmarks import calculix_prism, code_aster_prism
from benchmarks.specimens import (
    CYCLES,
    EIGHT,
    SHORT_CYCLES,
    THIRTY,
    alpha_history,
    beginning,
    specimen,
    stops,
)
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.problem import build_problem
from solver_adapters.crystal import N_SYSTEMS, rotation_vector_matrix
from solver_adapters.interface import Direction, FloatArray, Integration, Simulation
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.boxes import ORIENTATIONS, box, pulled

T = TypeVar("T")
MEASURES: tuple[StrainMeasure, ...] = ("small", "finite")
SCHEMES: tuple[Integration, ...] = ("exponential", "backward_euler")
KERNEL_GOAL = {"small": 2.5, "finite": 6.0}  # µs
# CPU-s of Code_Aster 15.2 (sequential, MUMPS) on these cases.
CODE_ASTER_PRISM = 311.0
CODE_ASTER_ALPHA = 1386.0 / 223  # a step
ALPHA_SIZE, SMALL_SIZE, LARGE_SIZE = 1.2, 1.0, 0.64  # µm: 477, 683 and about 2160 cells
SCALING_SIZES = (1.2, 0.65, 0.42, 0.275)


@dataclass(frozen=True)
class Run:
    """Cost of one simulation.

    Attributes:
        cpu: CPU time [s].
        wall: wall-clock time [s].
        seconds: wall-clock time by component [s].
        cells, steps, iterations: size of the mesh, time steps, Newton iterations.
        memory: peak memory of the process [MB].
        force: the answered force [µN], shape (n_output,).
    """

    cpu: float
    wall: float
    seconds: dict[str, float]
    cells: int
    steps: int
    iterations: int
    memory: float
    force: FloatArray


def in_child(work: Callable[..., T], *arguments: Any, threads: int = 1, **variables: str) -> T:
    """Call a function in a fresh process with the given threads and environment variables."""
    limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    changes = {**limits, "NUMBA_NUM_THREADS": str(threads), **variables}
    before = dict(os.environ)
    os.environ.update(changes)
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(work, *arguments).result()
    finally:
        os.environ.clear()
        os.environ.update(before)


def show(name: str, value: float, goal: str | None = None) -> None:
    """Print one figure; the unit stands in its name."""
    print(f"{name} = {value:.3g}" + (f" (goal: {goal})" if goal else ""), flush=True)


def show_parts(run: Run) -> None:
    """Print where the time of a run went."""
    parts = ", ".join(f"{name} {100 * s / run.wall:.0f} %" for name, s in run.seconds.items())
    print(
        f"    {run.cells} cells, {run.steps} steps, {run.iterations} iterations, "
        f"{run.cpu:.2f} CPU-s: {parts}"
    )


def solve(simulation: Simulation) -> Run:
    """Run a simulation with compiled kernels."""
    start, cpu = time.perf_counter(), time.process_time()
    response = BundledAdapter().solve(simulation)
    return Run(
        cpu=time.process_time() - cpu,
        wall=time.perf_counter() - start,
        seconds=dict(response.seconds),
        cells=len(simulation.mesh.cells),
        steps=response.steps,
        iterations=response.iterations,
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        force=response.force,
    )


def warm(measure: StrainMeasure) -> float:
    """Have every kernel of a strain measure compiled or loaded; CPU time [s]."""
    start = time.process_time()
    simulation = pulled(box(), Material(strain_measure=measure), (0.004,))
    tangent = Direction("tau0", material={"tau0": 1.0})
    BundledAdapter().solve(replace(simulation, directions=(tangent,)))
    return time.process_time() - start


# 1: beside CalculiX


def own_run(times: FloatArray, integration: Integration) -> Run:
    """The prism of CalculiX at given instants, one step each."""
    warm("small")
    mesh = calculix_prism.read_reference().mesh
    simulation = calculix_prism.simulation(mesh, times, integration)
    return solve(replace(simulation, output_nodes=np.arange(0)))


def calculix_run(end: float) -> tuple[FloatArray, FloatArray, float]:
    """CalculiX on its prism up to an instant: instants, force, CPU time."""
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "prism.inp"
        calculix_prism.write_deck(calculix_prism.read_reference().mesh, deck, end)
        return calculix_prism.run_calculix(deck)


def force_errors(times: FloatArray, force: FloatArray, common: FloatArray) -> tuple[float, float]:
    """Rms and largest error [µN] at common instants against the limit of small steps."""
    reference = calculix_prism.read_reference()
    truth = np.interp(common, reference.fine_times, reference.fine_force)
    error = np.interp(common, times, force) - truth
    return float(np.sqrt(np.mean(error**2))), float(abs(error).max())


def beside_calculix(quick: bool) -> None:
    """CPU time of CalculiX over that of prismid, at equal or better accuracy of the force."""
    if shutil.which("ccx") is None:
        print("beside CalculiX: skipped, there is no ccx on the PATH (package calculix-ccx)")
        return
    if quick:
        times, _, cpu = calculix_run(7.0)
        own = in_child(own_run, times, "backward_euler")
        show("CPU time of CalculiX / prismid, same steps to 7 s", cpu / own.cpu, ">= 10")
        return
    runs = [calculix_run(28.0) for _ in range(2)]
    times, force, _ = runs[0]
    cpu = min(run[2] for run in runs)
    rms, largest = force_errors(times, force, times)
    show("CalculiX: CPU time [s]", cpu)
    show("CalculiX: rms force error [uN]", rms)
    show("CalculiX: largest force error [uN]", largest)
    for integration in SCHEMES:
        instants, own = as_accurate(integration, times, rms, largest)
        own_rms, own_largest = force_errors(instants, own.force, times)
        show(f"{integration} as accurate: rms force error [uN]", own_rms, f"<= {rms:.3g}")
        show(f"{integration} as accurate: largest error [uN]", own_largest, f"<= {largest:.3g}")
        show(f"CPU time of CalculiX / prismid, {integration}", cpu / own.cpu, ">= 10")
        show_parts(own)


def as_accurate(
    integration: Integration, common: FloatArray, rms: float, largest: float
) -> tuple[FloatArray, Run]:
    """The run of fewest steps with no larger errors: its instants, and the best of three.

    Raises:
        RuntimeError: not even the finest run is that accurate.
    """
    for steps in range(15, 66, 3):
        instants = calculix_prism.graded_times(steps)
        run = in_child(own_run, instants, integration)
        found = force_errors(instants, run.force, common)
        if found[0] <= rms and found[1] <= largest:
            again = [in_child(own_run, instants, integration) for _ in range(2)]
            return instants, min((run, *again), key=lambda run: run.cpu)
    raise RuntimeError(f"{integration}: {steps} steps are not as accurate as CalculiX")


# 2: kernels


def kernel_time(measure: StrainMeasure, integration: Integration, repeats: int) -> float:
    """µs a point and step, tangent included, over the strain path of the reference point.

    The path is turned by about a degree, differently for each of 480 points.
    """
    with np.load(code_aster_prism.DATA / "solver" / "crystal_point.npz") as data:
        t, e = data[measure][:, :2].T
    bricks = pulled(box((2, 5, 2)), Material(strain_measure=measure), (0.0,))
    problem = build_problem(replace(bricks, integration=integration))
    points = problem.points
    n = points.grain.size
    vectors = np.random.default_rng(0).normal(scale=0.012, size=(n, 3))
    turns = np.stack([rotation_vector_matrix(vector) for vector in vectors])
    crystals = ORIENTATIONS[points.grain]
    paths = [
        (turns.transpose(0, 2, 1) @ _gradient(measure, x) @ turns @ crystals).reshape(n, 9)
        for x in e
    ]
    best = np.inf
    for _ in range(repeats + 1):  # the first one loads or compiles
        state, slips, total = problem.state, np.zeros((n, N_SYSTEMS)), 0.0
        for row in range(1, len(t)):
            turned = row > 1 and (e[row] - e[row - 1]) * (e[row - 1] - e[row - 2]) < 0
            guess = np.zeros_like(slips) if turned else slips
            start = time.process_time()
            state, slips, _, _, count = points.update(
                paths[row], state, guess, float(t[row] - t[row - 1])
            )
            total += time.process_time() - start
            if count.min() < 0:
                raise RuntimeError(f"{measure} strain: a point did not converge in row {row}")
        best = min(best, total)
    return 1e6 * best / n / (len(t) - 1)


def kernel_times(repeats: int) -> dict[tuple[StrainMeasure, Integration], float]:
    """`kernel_time` of every strain measure and scheme."""
    return {(m, i): kernel_time(m, i, repeats) for i in SCHEMES for m in MEASURES}


def _gradient(measure: StrainMeasure, e: float) -> FloatArray:
    """Displacement gradient of the reference path."""
    if measure == "small":
        return e * np.diag([-0.5, -0.5, 1.0])
    stretch = np.exp(e)
    return np.diag([stretch**-0.5, stretch**-0.5, stretch]) - np.eye(3)


def kernels(quick: bool) -> None:
    """The crystal law alone."""
    for (measure, integration), value in in_child(kernel_times, 1 if quick else 6).items():
        goal = f"<= {KERNEL_GOAL[measure]:g}"
        show(f"kernel {measure} {integration} [us/point/step]", value, goal)


# 3: sensitivities


def sensitivity_runs(
    size: float, n_images: int, frees: Sequence[Sequence[str]], repeats: int
) -> list[Run]:
    """The best of a few runs with each set of free parameters."""
    warm("finite")
    simulations = [
        beginning(specimen(size, "finite", stops(SHORT_CYCLES), free), n_images) for free in frees
    ]
    rounds = [[solve(s) for s in simulations] for _ in range(repeats)]
    return [min(runs, key=lambda run: run.cpu) for runs in zip(*rounds, strict=True)]


def sensitivities(quick: bool) -> None:
    """What derivatives add to the forward run."""
    n_images, repeats = (5, 1) if quick else (15, 3)
    for size in (SMALL_SIZE,) if quick else (SMALL_SIZE, LARGE_SIZE):
        frees = ((), EIGHT, THIRTY)
        plain, *asked = in_child(sensitivity_runs, size, n_images, frees, repeats)
        show_parts(plain)
        for run, free, goal in zip(asked, frees[1:], ("<= 35", "<= 150"), strict=True):
            added = 100 * (run.cpu / plain.cpu - 1)
            show(f"{len(free)} sensitivities, {run.cells} cells, added cost [%]", added, goal)
            show_parts(run)


# 4: beside Code_Aster


def code_aster_run(repeats: int) -> Run:
    """The prism of Code_Aster at its own 45 steps."""
    warm("small")
    simulation = code_aster_prism.simulation(code_aster_prism.forces()[0])
    return min((solve(simulation) for _ in range(repeats)), key=lambda run: run.cpu)


def alpha_run() -> Run:
    """The demo's specimen and history."""
    warm("small")
    return solve(specimen(ALPHA_SIZE, "small", alpha_history()))


def beside_code_aster(quick: bool) -> None:
    """CPU time of Code_Aster over that of prismid."""
    run = in_child(code_aster_run, 1 if quick else 3)
    show("CPU time of Code_Aster / prismid, 669 cells", CODE_ASTER_PRISM / run.cpu, ">= 20")
    show_parts(run)
    if not quick:
        run = in_child(alpha_run)
        ratio = CODE_ASTER_ALPHA / (run.cpu / run.steps)
        show(f"CPU time a step of Code_Aster / prismid, {run.cells} cells", ratio, ">= 20")
        show_parts(run)


# 5 and 6: a whole test, threads


def specimen_run(
    size: float, phases: Sequence[int], n_images: int, free: Sequence[str] = ()
) -> Run:
    """The demo's prism in finite strain up to an image."""
    warm("finite")
    return solve(beginning(specimen(size, "finite", stops(phases), free), n_images))


def whole_test(quick: bool) -> None:
    """A test of 320 images in finite strain."""
    if not quick:
        run = in_child(specimen_run, LARGE_SIZE, CYCLES, sum(CYCLES))
        show(f"{run.cells} cells, {sum(CYCLES)} images [CPU-s]", run.cpu, "<= 150")
        show_parts(run)


def threads(quick: bool) -> None:
    """Wall-clock time on one and two threads."""
    if not quick:
        load = os.getloadavg()[0]
        runs = {
            count: [
                in_child(specimen_run, LARGE_SIZE, SHORT_CYCLES, 15, threads=count)
                for _ in range(3)
            ]
            for count in (1, 2)
        }
        one, two = (min(run.wall for run in runs[count]) for count in (1, 2))
        show("speed of two threads / one (wall clock)", one / two, ">= 1.6")
        print(f"    load of the machine before {load:.2f}, cores {os.cpu_count()}")


# 7: size


def scaling(quick: bool) -> None:
    """Time and memory against the number of cells, 10 plastic steps, 8 sensitivities."""
    if quick:
        return
    runs = [in_child(specimen_run, size, SHORT_CYCLES, 5, EIGHT) for size in SCALING_SIZES]
    for run in runs:
        show(f"{run.cells} cells, 10 steps [CPU-s]", run.cpu)
        show(f"{run.cells} cells, peak memory [MB]", run.memory)
        show_parts(run)
    cells = np.log([run.cells for run in runs])
    names = {name: [run.seconds[name] for run in runs] for name in runs[0].seconds}
    for name, values in {"CPU time": [run.cpu for run in runs], **names}.items():
        show(
            f"exponent of {name} in the number of cells",
            float(np.polyfit(cells, np.log(values), 1)[0]),
        )


# 8: compilation


def compilation(quick: bool) -> None:
    """The first run ever, in an empty cache."""
    if not quick:
        for measure in MEASURES:
            with tempfile.TemporaryDirectory() as folder:
                first = in_child(warm, measure, XDG_CACHE_HOME=folder)
                again = in_child(warm, measure, XDG_CACHE_HOME=folder)
            show(f"first compilation, {measure} strain [CPU-s]", first)
            show(f"loading the compiled kernels, {measure} strain [CPU-s]", again)


FIGURES = (
    kernels,
    beside_code_aster,
    beside_calculix,
    sensitivities,
    whole_test,
    threads,
    scaling,
    compilation,
)


def main() -> None:
    """Run the study and print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    parser.add_argument("--only", choices=[f.__name__ for f in FIGURES], help="one figure")
    arguments = parser.parse_args()
    for figure in FIGURES:
        if arguments.only in (None, figure.__name__):
            figure(arguments.quick)


if __name__ == "__main__":
    main()
