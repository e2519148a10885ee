"""What a corrected prediction leaves wrong over what is stated for it, on draws of specimens.

    python -m benchmarks.mesh_calibration

Each draw is the blind trial's specimen with other orientations of both grains and another law. Its
converged prediction is the mean of hexahedra and tetrahedra, as of `benchmarks.numerics`, in the
same steps, so that the mesh is all that is wrong. Ten draws take 70 CPU-min.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.measuring import show
from benchmarks.numerics import (
    FINER,
    WORKING,
    Discretisation,
    Ruler,
    Specimen,
    corrected,
    model_on,
    short_specimen,
)
from driver.forward.mesh_extrapolation import lacking_share
from driver.identification.correction import Correction
from driver.identification.mesh_error import share_left
from tools import mesh_reference
from tools.converged_truth import SMALLEST

DRAWS = 10
SCATTER = 0.3  # of the logarithm of each parameter of the law
SMALL = Discretisation("hex20", 0.667, True)
PAIRS = ((WORKING, FINER), (FINER, SMALL))
"""Meshes by which the working prediction is corrected, the coarser ones first."""


@dataclass(frozen=True)
class Left:
    """Of one draw and one pair of meshes.

    Attributes:
        beside: error of the corrected prediction beside the parameters [σ].
        images: mean square of its error over the stated one, of the images.
        loads: the same of the loads.
        of_correction: its error in the motion over the correction, root mean square.
        of_load: its error in the load over the load, root mean square.
    """

    beside: float
    images: float
    loads: float
    of_correction: float
    of_load: float


def main() -> None:
    """Print a line for each draw and each pair, then their means over the draws."""
    found: dict[str, list[Left]] = {}
    with tempfile.TemporaryDirectory() as folder:
        specimen = short_specimen(Path(folder))
        for number in range(DRAWS):
            ruler = Ruler(drawn(specimen, number))
            print(f"draw {number}: both kinds of cells apart by {ruler.apart.beside:.1f} σ")
            for name, left in lefts(ruler).items():
                found.setdefault(name, []).append(left)
                print(
                    f"  {name}: {left.beside:.1f} σ beside the parameters; over the stated one "
                    f"{left.images:.2f} of the images, {left.loads:.2f} of the loads: "
                    f"{left.of_correction:.2f} of the correction, {left.of_load:.2%} of the load",
                    flush=True,
                )
    for name, of in found.items():
        for what in ("images", "loads"):
            ratios = np.array([getattr(left, what) for left in of])
            print(f"{name}, {what}: from {ratios.min():.2f} to {ratios.max():.2f}")
            title = f"{name}: mean square of the error over the stated one, {what}, mean of draws"
            show(title, float(ratios.mean()), "0.7 to 1.3")
        for what, title in (("of_correction", "correction"), ("of_load", "load")):
            shares = np.array([getattr(left, what) for left in of])
            print(f"{name}: share of the {title}, rms of draws = {np.sqrt(np.mean(shares**2)):.4f}")


def redrawn(specimen: Specimen, number: int) -> Specimen:
    """Return a specimen with orientations and a law of its own, without its reference."""
    rng = np.random.default_rng(number)
    turned = Rotation.random(len(specimen.case.grains), rng).as_euler("ZXZ", degrees=True)
    grains = tuple(
        grain.model_copy(update={"euler_deg": tuple(float(a) for a in angles)})
        for grain, angles in zip(specimen.case.grains, turned, strict=True)
    )
    case = specimen.case.model_copy(update={"grains": grains})
    law = {
        name: float(specimen.truth[name] * np.exp(SCATTER * rng.standard_normal()))
        for name in specimen.problem.law
    }
    problem = replace(specimen.problem, working=model_on(case, specimen.problem, WORKING))
    return replace(specimen, case=case, problem=problem, truth=dict(specimen.truth) | law)


def drawn(specimen: Specimen, number: int) -> Specimen:
    """Return a specimen with orientations and a law of its own, its converged loads measured."""
    other = redrawn(specimen, number)
    values = other.problem.working.null_values() | dict(other.truth)
    pairs = [
        (
            model_on(other.case, other.problem, Discretisation(kind, large, True)),
            model_on(other.case, other.problem, Discretisation(kind, small, True)),
        )
        for kind, (large, small) in SMALLEST
    ]
    reference = mesh_reference.made(pairs, values)
    objective = other.problem.objective
    data = replace(objective.data, load=reference.load.mean(axis=0))
    problem = replace(other.problem, objective=replace(objective, data=data))
    return replace(other, problem=problem, reference=reference)


def lefts(ruler: Ruler) -> dict[str, Left]:
    """Return what the correction by each pair leaves, by the name of the pair."""
    seen = {d: ruler.seen(d) for d in (WORKING, FINER, SMALL)}
    found = {}
    for coarser, finer in PAIRS:
        meshes = [ruler.model(d).microstructure.mesh for d in (coarser, finer)]
        best = corrected(seen[coarser], seen[finer], lacking_share(meshes[0], meshes[1]))
        change = Correction(best.motion - seen[WORKING].motion, best.load - seen[WORKING].load)
        images, loads = ruler.calibration(best, change, WORKING, finer)
        name = f"{WORKING.kind} {WORKING.size:g} µm by {coarser.size:g} → {finer.size:g} µm"
        stated = share_left(ruler.model(WORKING).microstructure.mesh, (WORKING.size, finer.size))
        error, loads_rms = ruler.error(best), float(np.sqrt(np.mean(best.load**2)))
        found[name] = Left(
            error.beside, images, loads, stated * float(np.sqrt(images)), error.load / loads_rms
        )
    return found


if __name__ == "__main__":
    main()
