"""Error of meshes beside converged references, in standard deviations of the data.

    python -m benchmarks.numerics           every mesh of `MESHES`, and corrections by two of them
    python -m benchmarks.numerics --quick   the working prediction of the demo alone
    python -m benchmarks.numerics --make alpha   its reference anew, 87 CPU-min and 5.4 GB
    python -m benchmarks.numerics --make short   that of the blind trial's specimen, a quarter
    python -m benchmarks.numerics --make if_steel   that of the paper's in finite strain, 15 CPU-min

The data, history and truth of the demo, of the blind trial's specimen and of the paper's. The
difference of a prediction from the reference is whitened as the data are; the part that the fitted
parameters take up is projected out.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import ALPHA, TRUTH
from benchmarks.measuring import show
from driver.case.model import Case, load_case
from driver.forward.build import adapter_of, build_model, geometry_of
from driver.forward.mesh_extrapolation import LackingShare, lacking_share
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction
from driver.identification.identify import with_correction
from driver.identification.problem import IdentificationProblem
from driver.parameters.boundary import LAMBDAS
from driver.virtual.writing import record
from driver.workflow import pipeline
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import load_problem
from meshes.arrays import FloatArray
from meshes.prism import CellKind, generate
from tools import converged_truth, mesh_reference, paper_specimen
from tools.mesh_reference import Reference


@dataclass(frozen=True)
class Discretisation:
    """A mesh of a specimen, and whether its dilatation is projected."""

    kind: CellKind
    size: float
    mean_dilatation: bool

    def __str__(self) -> str:
        projected = ", mean dilatation" if self.mean_dilatation else ""
        return f"{self.kind} {self.size:g} µm{projected}"


WORKING = Discretisation("hex20", 2.0, True)
FINER = Discretisation("hex20", 1.0, True)
MESHES = (
    Discretisation("tet10", 2.0, False),
    Discretisation("tet10", 1.1, False),
    Discretisation("tet10", 0.8, False),
    Discretisation("tet10", 2.0, True),
    Discretisation("tet10", 1.1, True),
    Discretisation("tet10", 0.8, True),
    Discretisation("tet10", 0.5, True),
    Discretisation("hex20", 2.0, False),
    Discretisation("hex20", 1.0, False),
    Discretisation("hex20", 0.667, False),
    WORKING,
    FINER,
    Discretisation("hex20", 0.667, True),
    Discretisation("hex20", 0.5, True),
)
_SMALL, _SMALLER = Discretisation("hex20", 0.667, True), Discretisation("hex20", 0.5, True)
CORRECTED = (
    (MESHES[0], MESHES[0], MESHES[1]),
    (WORKING, WORKING, FINER),
    (WORKING, FINER, _SMALL),
    (WORKING, _SMALL, _SMALLER),
    (FINER, _SMALL, _SMALLER),
)
"""Working meshes whose corrected prediction is judged, each with two meshes for its correction."""
SMALLEST = (
    (Discretisation("hex20", 0.4, True), Discretisation("hex20", 0.333, True)),
    (Discretisation("tet10", 0.27, True), Discretisation("tet10", 0.2, True)),
)
"""The reference of the demo: each kind of cells is extrapolated from two sizes."""

_INSET = 1e-6  # µm, by which pixels beyond the face are drawn onto it


@dataclass(frozen=True, eq=False)
class Seen:
    """A prediction at the pixels, and what it took: motion (T, n_pix, 3), load (T,), CPU-s."""

    motion: FloatArray
    load: FloatArray
    seconds: float
    n_cells: int


@dataclass(frozen=True)
class Error:
    """Error of a prediction: whole, and beside the parameters [σ]; rms of the load [µN]."""

    whole: float
    beside: float
    load: float


@dataclass(frozen=True, eq=False)
class Specimen:
    """A specimen whose images are measured, its true parameters, and its converged prediction."""

    case: Case
    problem: IdentificationProblem
    truth: Mapping[str, float]
    reference: Reference


class Ruler:
    """The data of a specimen, and the reference on its pixels."""

    def __init__(self, specimen: Specimen) -> None:
        case, problem, reference = specimen.case, specimen.problem, specimen.reference
        self.case, self.problem = case, problem
        self.values = problem.working.null_values() | dict(specimen.truth)
        free = (*LAMBDAS, *problem.law, *problem.knots)
        model = replace(problem.working, integration="exponential")
        best = replace(problem.objective, model=model).evaluate(self.values, free)
        self._jacobian, self._hessian = best.jacobian, best.hessian
        x0, x1, y0, y1 = model.projection.bounds
        low, high = np.array([x0, y0]) + _INSET, np.array([x1, y1]) - _INSET
        origin = np.array([self.values["origin_X"], self.values["origin_Y"]])
        both = reference.at(np.clip(model.projection.pixels + origin, low, high))
        self._motion, self._load = both.mean(axis=0), reference.load.mean(axis=0)
        self.apart = self.difference(both[0] - both[1], reference.load[0] - reference.load[1])

    def difference(self, motion: FloatArray, load: FloatArray) -> Error:
        """Size of a difference of two predictions."""
        change = self.problem.objective.data.change(motion, load)
        shift = np.linalg.solve(self._hessian, self._jacobian @ change)
        rest = change - self._jacobian.T @ shift
        return Error(
            float(np.linalg.norm(change)),
            float(np.linalg.norm(rest)),
            float(np.sqrt(np.mean(load**2))),
        )

    def error(self, seen: Seen) -> Error:
        """Error of a prediction."""
        return self.difference(seen.motion - self._motion, seen.load - self._load)

    def calibration(
        self, seen: Seen, change: Correction, working: Discretisation, finer: Discretisation
    ) -> tuple[float, float]:
        """Mean square of the error of a corrected prediction over that which is stated for it.

        Args:
            seen: the corrected prediction.
            change: its correction.
            working: the mesh that it corrects.
            finer: the finer mesh.

        Returns:
            of the whitened images, and of the loads.
        """
        objective = replace(self.problem.objective, model=self.model(working))
        data = with_correction(objective, 1.0, change, (working.size, finer.size)).data
        stated = data.simulation_error
        assert stated is not None
        off = data.image.pixel_sensitivity(seen.motion - self._motion)
        load = seen.load - self._load
        return (
            float(np.sum(off**2) / np.sum(stated.shapes**2)),
            float(np.sum(load**2) / np.sum(stated.load**2)),
        )

    def model(self, discretisation: Discretisation) -> ForwardModel:
        """Return the forward model on a mesh, exponential, one step an interval."""
        return model_on(self.case, self.problem, discretisation)

    def seen(self, discretisation: Discretisation) -> Seen:
        """Predict on a mesh."""
        model = self.model(discretisation)
        begin = time.process_time()
        prediction = model.predict(self.values)
        seconds = time.process_time() - begin
        mesh = model.microstructure.mesh
        return Seen(prediction.motion, prediction.load, seconds, len(mesh.cells))


def model_on(
    case: Case, problem: IdentificationProblem, discretisation: Discretisation
) -> ForwardModel:
    """Return the forward model of a case on another mesh."""
    d = discretisation
    mesh = generate(geometry_of(case), d.size, d.kind)
    history, pixels = problem.experiment.history, problem.images.xy
    model = build_model(case, mesh, history, pixels, adapter_of(case), 1)
    return replace(model, integration="exponential", mean_dilatation=d.mean_dilatation)


def corrected(coarser: Seen, finer: Seen, share: LackingShare) -> Seen:
    """Return the finer prediction extrapolated by a share of what both differ by."""
    return Seen(
        finer.motion + share.motion * (finer.motion - coarser.motion),
        finer.load + share.load * (finer.load - coarser.load),
        coarser.seconds + finer.seconds,
        finer.n_cells,
    )


def demo(folder: Path) -> Specimen:
    """Run the demo to its measurement in a folder."""
    path = folder / "alpha" / "case.toml"
    shutil.copytree(ALPHA, path.parent, ignore=shutil.ignore_patterns("results"))
    return Specimen(*_measured(path), TRUTH, mesh_reference.read("alpha"))


def short_specimen(folder: Path) -> Specimen:
    """Photograph the short specimen of the blind trial and measure it in a folder."""
    truth, reference = converged_truth.pulled({}), mesh_reference.read(converged_truth.REFERENCE)
    path = record(folder, converged_truth.known_case(), truth, 1)
    of_images = slice(None, None, converged_truth.DENSEST)
    at_images = replace(
        reference, motion=reference.motion[:, of_images], load=reference.load[:, of_images]
    )
    return Specimen(*_measured(path), truth.values, at_images)


def paper(folder: Path) -> Specimen:
    """Photograph the specimen of the paper and measure it in a folder."""
    course = paper_specimen.pulled()
    path = record(folder, paper_specimen.known_case(), course, 1, paper_specimen.settings())
    reference = mesh_reference.read(paper_specimen.REFERENCE)
    return Specimen(*_measured(path), course.values, reference)


def _measured(path: Path) -> tuple[Case, IdentificationProblem]:
    pipeline.run(path, "measure", False)
    results = path.parent / "results"
    case = load_case(path)
    return case, load_problem(StageContext(case, results, results))


def line(name: str, seen: Seen, error: Error) -> None:
    """Print a line of the table."""
    print(
        f"{name:<34} {seen.n_cells:5d} cells {seen.seconds:7.1f} CPU-s: whole {error.whole:6.1f} "
        f"σ, beside the parameters {error.beside:6.1f} σ, load {error.load:6.2f} µN rms",
        flush=True,
    )


def study(ruler: Ruler) -> None:
    """Print a line for each mesh and each pair."""
    for first in (WORKING, MESHES[0]):
        ruler.seen(first)  # kernels are compiled
    predictions = {}
    for discretisation in MESHES:
        seen = predictions[discretisation] = ruler.seen(discretisation)
        line(str(discretisation), seen, ruler.error(seen))
    for working, coarser, finer in CORRECTED:
        meshes = [ruler.model(d).microstructure.mesh for d in (coarser, finer)]
        share = lacking_share(meshes[0], meshes[1])
        seen = corrected(predictions[coarser], predictions[finer], share)
        name = f"{working.kind} {working.size:g} µm by {coarser.size:g} → {finer.size:g} µm"
        line(name, seen, ruler.error(seen))
        change = Correction(
            seen.motion - predictions[working].motion, seen.load - predictions[working].load
        )
        images, loads = ruler.calibration(seen, change, working, finer)
        show(f"{name}: mean square of the error over the stated one, images", images, "0.7 to 1.3")
        show(f"{name}: mean square of the error over the stated one, loads", loads, "0.7 to 1.3")


def make(name: str) -> None:
    """Make a reference anew."""
    elsewhere = {
        converged_truth.REFERENCE: converged_truth.make,
        paper_specimen.REFERENCE: paper_specimen.make,
    }
    if name in elsewhere:
        elsewhere[name]()
        return
    with tempfile.TemporaryDirectory() as folder:
        specimen = demo(Path(folder))
        models = [
            (
                model_on(specimen.case, specimen.problem, large),
                model_on(specimen.case, specimen.problem, small),
            )
            for large, small in SMALLEST
        ]
        values = specimen.problem.working.null_values() | TRUTH
        mesh_reference.write(mesh_reference.made(models, values), name)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    names = ("alpha", converged_truth.REFERENCE, paper_specimen.REFERENCE)
    parser.add_argument("--make", choices=names, help="make a reference anew")
    asked = parser.parse_args()
    if asked.make:
        make(asked.make)
        return
    specimens = {"alpha": demo}
    if not asked.quick:
        specimens = {"short": short_specimen, "if_steel": paper, "alpha": demo}
    for name, specimen in specimens.items():
        with tempfile.TemporaryDirectory() as folder:
            ruler = Ruler(specimen(Path(folder)))
            apart = ruler.apart.beside
            show(
                f"{name}: both predictions of the reference apart, beside parameters [sigma]", apart
            )
            show(f"{name}: standard error of their mean [sigma]", apart / 2, "<= 3")
            if not asked.quick:
                study(ruler)
            working = ruler.error(ruler.seen(WORKING)).beside
    show("error of the working prediction, beside parameters [sigma]", working, "<= 17")


if __name__ == "__main__":
    main()
