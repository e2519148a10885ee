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
    Seen,
    Specimen,
    corrected,
    model_on,
    short_specimen,
)
from driver.forward.mesh_extrapolation import LackingShare, lacking_share
from driver.identification.correction import Correction
from driver.identification.mesh_error import share_left
from meshes.arrays import FloatArray
from tools import mesh_reference
from tools.converged_truth import SMALLEST

DRAWS = 10
SCATTER = 0.3  # of the logarithm of each parameter of the law
SMALL = Discretisation("hex20", 0.667, True)
PAIRS = ((WORKING, FINER), (FINER, SMALL))
"""Meshes by which the working prediction is corrected, the coarser ones first."""
POWERS = (1.0, 1.1, 1.2, 1.25, 1.3, 1.4, 1.5)
"""By which a load is extrapolated, to see by which one least is left."""


@dataclass(frozen=True)
class Left:
    """Of one draw and one pair of meshes.

    Attributes:
        beside: error of the corrected prediction beside the parameters [σ].
        images: mean square of its error over the stated one, of the images.
        loads: the same of the loads.
        of_correction: its error in the motion over the correction, root mean square.
        of_load: its error in the load over the load, root mean square.
        by_power: the same of the finer load extrapolated by each of `POWERS`.
    """

    beside: float
    images: float
    loads: float
    of_correction: float
    of_load: float
    by_power: FloatArray


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
        by_power = np.sqrt(np.mean([left.by_power**2 for left in of], axis=0))
        told = ", ".join(f"{p:g}: {k:.2%}" for p, k in zip(POWERS, by_power, strict=True))
        print(f"{name}: share of the load, extrapolated by the power {told}")


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
        pair = seen[coarser], seen[finer]
        by_power = [ruler.error(extrapolated(*pair, power)).load / loads_rms for power in POWERS]
        found[name] = Left(
            error.beside,
            images,
            loads,
            stated * float(np.sqrt(images)),
            error.load / loads_rms,
            np.array(by_power),
        )
    return found


def extrapolated(coarser: Seen, finer: Seen, power: float) -> Seen:
    """Return the finer prediction extrapolated by a power of the size of the cells."""
    fallen: float = (coarser.n_cells / finer.n_cells) ** (power / 3.0)
    share = fallen / (1.0 - fallen)
    return corrected(coarser, finer, LackingShare(share, share))


if __name__ == "__main__":
    main()
