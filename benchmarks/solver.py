"""Speed of the bundled solver, and its accuracy beside CalculiX and Code_Aster.

    python -m benchmarks.solver           the whole study
    python -m benchmarks.solver --quick   what can be measured in 45 s, kernels compiled before

Each measurement runs in a process of its own on one thread. Times are CPU time, the best of a few
repeats, unless stated otherwise. Without `ccx` on the PATH the figures beside CalculiX are left
out.
"""

from __future__ import annotations

import argparse
import tempfile

from benchmarks.beside_calculix import beside_calculix
from benchmarks.beside_code_aster import beside_code_aster
from benchmarks.derivatives import sensitivities
from benchmarks.kernels import kernels
from benchmarks.measuring import MEASURES, in_child, show, warm
from benchmarks.nearby import nearby
from benchmarks.sizes import scaling, threads, whole_test


def compilation(quick: bool) -> None:
    """Time the first run ever, in an empty cache."""
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
    nearby,
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
