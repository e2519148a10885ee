"""CPU time of CalculiX over that of prismid, at equal or better accuracy of the force."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.measuring import SCHEMES, Run, in_child, show, show_parts, solve, warm
from meshes.arrays import FloatArray
from solver_adapters.interface import Integration
from tools import calculix_prism


def own_run(times: FloatArray, integration: Integration) -> Run:
    """Return the prism of CalculiX at given instants, one step each."""
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
    """Return the run of fewest steps with no larger errors: its instants, and the best of three.

    Raises:
        RuntimeError: not even the finest run is that accurate.
    """
    for steps in range(15, 66, 3):
        instants = calculix_prism.graded_times(steps)
        run = in_child(own_run, instants, integration)
        errors = force_errors(instants, run.force, common)
        if errors[0] <= rms and errors[1] <= largest:
            again = [in_child(own_run, instants, integration) for _ in range(2)]
            return instants, min((run, *again), key=lambda run: run.cpu)
    raise RuntimeError(f"{integration}: {steps} steps are not as accurate as CalculiX")
