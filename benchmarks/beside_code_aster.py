"""CPU time of Code_Aster over that of prismid."""

from __future__ import annotations

from benchmarks.measuring import ALPHA_SIZE, Run, in_child, show, show_parts, solve, warm
from benchmarks.specimens import alpha_history, specimen
from tools import code_aster_prism

# CPU-s of Code_Aster 15.2 (sequential, MUMPS) on these cases.
CODE_ASTER_PRISM = 311.0
CODE_ASTER_ALPHA = 1386.0 / 223  # a step


def code_aster_run(repeats: int) -> Run:
    """Return the prism of Code_Aster at its own 45 steps."""
    warm("small")
    simulation = code_aster_prism.simulation(code_aster_prism.forces()[0])
    return min((solve(simulation) for _ in range(repeats)), key=lambda run: run.cpu)


def alpha_run() -> Run:
    """Return the demo's specimen and history."""
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
