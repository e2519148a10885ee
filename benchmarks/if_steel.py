"""The paper-size study: `examples/if_steel` identified, with the analogues of tables 4 and 5.

The data are made first where they are not there (`examples/if_steel/README.md`). Beside the case as
it stands: without a prior, and in the paper's order with the knots held.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.identified import Found, identify_case, read_truth, variant
from benchmarks.measuring import show
from driver.case.model import load_case
from driver.common.progress import progress_to
from driver.identification.fit import fit
from driver.parameters.boundary import LAMBDAS
from driver.parameters.pose import POSE_DECLARATIONS
from driver.results.files import RESULTS
from driver.results.hdf5 import read_hdf5
from driver.virtual.command import virtual
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import load_problem, saved_objective

FOLDER = Path(__file__).parents[1] / "examples" / "if_steel"
DATA = FOLDER / "data"
VARIANTS = Path(__file__).parent / "results" / "if_steel"
SEED = 320
LAW = ("tau0", "c", "d")


def study() -> None:
    """Make the data, identify in three ways, and print a line for each figure."""
    if not (DATA / "truth.json").is_file():
        with progress_to(print):
            virtual(FOLDER / "case.toml", FOLDER / "virtual.toml", DATA, SEED)
    truth = read_truth(DATA / "truth.json")
    identified = identify_case(DATA / "case.toml")
    against(identified, truth, "")
    tables(identified)
    cost(identified)
    without_prior(identified, truth)
    held = variant(
        DATA / "case.toml", VARIANTS / "paper_order", {"identification": {"order": "paper"}}
    )
    in_the_papers_order(identify_case(held), truth)


def against(found: Found, truth: dict[str, float], title: str) -> None:
    """Deviations from the truth."""
    off = found.deviations(truth)
    for name, deviation in off.items():
        value, sigma = found.of(name)
        print(f"{title}{name} = {value:.5g} ± {sigma:.2g} (truth {truth[name]:.5g}, "
              f"{deviation:+.2f} sigma)")  # fmt: skip
    show(f"{title}largest deviation [sigma]", max(map(abs, off.values())), "<= 3")


def tables(found: Found) -> None:
    """Show the analogues of tables 4 and 5 of the paper, the budget, and its figure 12b."""
    measured = read_hdf5(DATA / RESULTS / "measure.h5")
    n = float(measured["n_reference"])
    noise = np.sqrt((1 + 1 / n) / 2)
    free = np.sqrt(np.nanmean(measured["residual"] ** 2) / 2) / float(measured["sigma"])
    show("table 4: chi_f of noise alone", noise)
    show("table 4: chi_f of DIC", free)
    show("table 4: chi_f of IDIC", found.history["A"]["iterations"][-1]["paper_chi_f"])
    for key in ("chi", "chi_f", "chi_F"):
        first, last = found.arrays[f"paper/{key}"]
        show(f"table 5: {key} at the start", first)
        show(f"table 5: {key} at the end", last)
    for key in ("noise", "free", "model", "basis", "load"):
        show(f"budget: {key}", float(found.arrays[f"budget/{key}"]))
    c, d = (found.names.index(name) for name in ("c", "d"))
    show("correlation of c and d, covariance", found.correlation[c, d])
    names = [name.decode() for name in found.arrays["hessian_names"]]
    c, d = (names.index(name) for name in ("c", "d"))
    hessian = found.arrays["kinematic_hessian"]
    show(
        "correlation of c and d, kinematic Hessian (fig. 12b)",
        hessian[c, d] / np.sqrt(hessian[c, c] * hessian[d, d]),
        "negative",
    )


def cost(found: Found) -> None:
    """Show iterations, and CPU time by stage."""
    for stage, goal in (("A", "<= 10"), ("B", "<= 6"), ("C", None)):
        show(f"iterations of {stage}", len(found.history[stage]["iterations"]) - 1, goal)
    for stage, seconds in found.seconds.items():
        show(f"time of {stage} [CPU-s]", seconds)
    show("measure to C [CPU-min]", sum(found.seconds.values()) / 60, "<= 20 on 2 cores")


def without_prior(found: Found, truth: dict[str, float]) -> None:
    """Stage C once more from its end, with no prior of law and λ's."""
    path = DATA / "case.toml"
    context = StageContext(load_case(path), DATA / RESULTS, DATA / RESULTS)
    problem = load_problem(context)
    objective = saved_objective(problem, dict(found.arrays))
    nuisances = {p.name for p in POSE_DECLARATIONS}
    prior = {name: known for name, known in objective.prior.items() if name in nuisances}
    with progress_to(print):
        free = fit(replace(objective, prior=prior), found.values, found.names, 4)
    show("without a prior: chi_F", free.best.chi_load)
    for name in (*LAMBDAS, *LAW):
        value, sigma = free.values[name], free.sigma(name, objective.parameters)
        before, before_sigma = found.of(name)
        print(
            f"without a prior: {name} = {value:.5g} ± {sigma:.2g} "
            f"({(value - truth[name]) / sigma:+.2f} sigma), "
            f"with it {before:.5g} ± {before_sigma:.2g}"
        )


def in_the_papers_order(found: Found, truth: dict[str, float]) -> None:
    """Show what it costs to hold the knots where correlation found them."""
    against(found, truth, "knots held, ")
    for name in LAW:
        bias = found.of(name)[0] / truth[name] - 1
        show(f"knots held, {name} off by [%]", 100 * bias)
    for name in LAMBDAS:
        show(f"knots held, {name} off by", found.values[name] - truth[name])
    for stage, point, told in (("B", 0, "at the start"), ("C", -1, "at the end")):
        record = found.history[stage]["iterations"][point]
        for key in ("chi", "chi_f", "chi_F"):
            show(f"knots held, table 5: {key} {told}", record[f"paper_{key}"])
