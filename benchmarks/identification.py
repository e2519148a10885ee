"""Identification against known truths, and beside what is done today.

    python -m benchmarks.identification            all of it: the demo, FEMU, coverage, if_steel
    python -m benchmarks.identification --quick    two draws of the coverage study, within 45 s
    python -m benchmarks.identification --only coverage --draws 200 --processes 2

Draws are kept in `benchmarks/results/coverage.jsonl` and never made twice, results of the cases in
`benchmarks/results` and `examples/if_steel`. The truth of the demo stands in its README.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import if_steel, interval_coverage
from benchmarks.diagnosis import ALPHA, TRUTH
from benchmarks.identified import Found, identify_case, variant
from benchmarks.measuring import show
from benchmarks.updating import Updated, update
from driver.parameters.boundary import LAMBDAS

RESULTS = Path(__file__).parent / "results"
DRAWS = RESULTS / "coverage.jsonl"
LAW = ("tau0", "c", "d")
RATIO = {"tau0_grain2": 1.0}
PARTS = ("alpha", "femu", "coverage", "if_steel")


def main() -> None:
    """Run the study and print a line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="two draws alone, within 45 s")
    parser.add_argument("--only", choices=PARTS, help="one part of the study")
    parser.add_argument("--draws", type=int, default=200, help="draws of the coverage study")
    parser.add_argument("--processes", type=int, default=2, help="draws side by side")
    choice = parser.parse_args()
    if choice.quick:
        with tempfile.TemporaryDirectory() as folder:
            covered(interval_coverage.run(Path(folder) / "coverage.jsonl", 2, 1))
        return
    parts = (choice.only,) if choice.only else PARTS
    if "alpha" in parts or "femu" in parts:
        case = variant(ALPHA / "case.toml", RESULTS / "alpha", {"extensions": RATIO})
        identified = identify_case(case)
        if "alpha" in parts:
            demo(identified)
        if "femu" in parts:
            beside_updating(identified, update(case, LAW, RATIO))
    if "coverage" in parts:
        covered(interval_coverage.run(DRAWS, choice.draws, choice.processes))
    if "if_steel" in parts:
        if_steel.study()


def demo(found: Found) -> None:
    """Identify the demo with the ratio of the grains free, against its truth."""
    off = found.deviations(TRUTH)
    for name, deviation in off.items():
        value, sigma = found.of(name)
        print(f"{name} = {value:.5g} ± {sigma:.2g} (truth {TRUTH[name]:g}, {deviation:+.2f} sigma)")
    show("alpha, largest deviation [sigma]", max(map(abs, off.values())), "<= 3")


def beside_updating(found: Found, updated: Updated) -> None:
    """Accuracy and cost of both on the same data."""
    print("parameter | truth | identified | error | FEMU | error")
    wrong: list[tuple[float, float]] = []
    for name in (*LAMBDAS, *LAW, *RATIO):
        (value, sigma), truth = found.of(name), TRUTH[name]
        other, other_sigma = updated.value[name], updated.sigma[name]
        wrong.append((value / truth - 1, other / truth - 1))
        print(
            f"{name} | {truth:g} | {value:.4g} ± {sigma:.2g} | {wrong[-1][0]:+.1%} | "
            f"{other:.4g} ± {other_sigma:.2g} | {wrong[-1][1]:+.1%}"
        )
    law = np.array(wrong)[len(LAMBDAS) :]
    ours, theirs = np.sqrt(np.mean(law**2, axis=0))
    show("law, rms error [%]", 100 * ours)
    show("law by FEMU, rms error [%]", 100 * theirs)
    show("chi_F", float(found.arrays["budget/load"]), "1")
    show("chi_F by FEMU", updated.chi_load)
    runs = sum(len(fit["iterations"]) for fit in found.history.values())
    show("runs with derivatives", runs)
    show("runs by FEMU", updated.runs)
    show("identification [CPU-s]", sum(found.seconds.values()))
    show("FEMU [CPU-s]", updated.cpu)
    print(f"FEMU ended: {updated.reason}")


def covered(draws: list[interval_coverage.Draw]) -> None:
    """Coverage of the stated 95 % intervals."""
    low, high = (100 * share for share in interval_coverage.GOAL)
    for name, interval in interval_coverage.coverage(draws).items():
        title, goal = f"coverage of {name} [%], {interval.n} intervals", f"{low:g} to {high:g}"
        show(title, 100 * interval.share, goal)
        show(f"spread of {name} [sigma]", interval.spread, "1")
    show("draws", len(draws), ">= 200")
    show("draws that did not converge", sum(not interval["converged"] for interval in draws))
    show("chi_F, median", float(np.median([interval["chi_load"] for interval in draws])))
    show("a draw [CPU-s]", float(np.median([sum(interval["cpu"]) for interval in draws])))


if __name__ == "__main__":
    main()
