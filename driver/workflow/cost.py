"""What a run will cost: a coarse model of its time and memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from driver.case.model import Case
from driver.diagnosis.causes.all_causes import every, names
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.looks_in_places import SEEN_FINER, SIDES
from driver.experiment.image_sizes import stack_size
from driver.forward.build import size_of_second_mesh
from driver.forward.cost import PROCESS_BYTES, simulation_memory, steps_seconds, systems_of
from driver.identification.correction_cost import cells_of_size, correction_seconds
from solver_adapters.finite_differences import RUNS_PER_DIRECTION
from solver_adapters.interface import Capabilities

# Simulations of a run: the Gauss–Newton iterations of stages B and C, and with images of A, use
# this share of their limit each. Each refit of a cause needs this many, those under its own
# correction and those of its rivals among them; the sides and places from which causes are looked
# at from afar are simulated without derivatives, in about two rounds. A finer mesh is run this
# often where something is found, and once for the places that promise most and for the side of
# each cause that bends.
_ITERATION_SHARE = 0.5
_PER_REFIT = 20
_SIDES = 2
_ROUNDS = 2
_FINE_RUNS = 8
# So many of them belong to an identification.
_CORRECTIONS = 2
# The second mesh is simulated at the baseline, at the ends of two or three refits that lead, twice
# at some, and at the extended model.
_SECOND_RUNS = 6
# Seconds of one core of the correlation for one pixel of one image, all iterations.
_PIXEL_SECONDS = 8e-6
# That of the comparison of images with a prediction, for one pixel of one image and a direction.
_COMPARED_SECONDS = 1.7e-7
# Bytes of the images that correlation has at work together, whatever their number: the block of
# `driver.dic.surface_images`, and that of `driver.dic.covariance` at most.
_BLOCK_BYTES, _LARGEST_BAND = 60e6, 8.0 * 2**24
# Copies of the nodal values of all images, and of covariances between all of them.
_NODAL_COPIES, _COVARIANCES = 6, 10
# Numbers at a pixel of the face in an image that an identification holds: with 40 images of
# 76 000 such pixels it took 3.3 GB.
_FACE_NUMBERS = 100
# Fits whose derivatives a diagnosis keeps beside those of its refits: the demo keeps eight in all.
_OTHER_FITS = 3
# Directions of the boundary motion: 4 λ's and the knots of three cycles (6 for each of 4 motions).
_BOUNDARY_DIRECTIONS = 4 + 4 * 6


@dataclass(frozen=True)
class Cost:
    """What a run will cost.

    Attributes:
        seconds: wall-clock time of all stages [s], to a factor of two or so.
        memory: largest resident memory of all processes together [bytes].
        simulations: number of simulations on the working mesh.
        of_stages: the seconds by stage, of those that take some.
    """

    seconds: float
    memory: float
    simulations: int
    of_stages: Mapping[str, float] = field(default_factory=dict)

    def of(self, stages: Iterable[str]) -> float:
        """Wall-clock time of some stages [s]."""
        return sum(self.of_stages.get(name, 0.0) for name in stages)


def estimate(case: Case, solver: Capabilities, n_cells: int, n_images: int) -> Cost:
    """Time and memory of a run; the images are as large as the headers of their files say.

    Args:
        case: the case.
        solver: what its solver can.
        n_cells: cells of the working mesh.
        n_images: images of the history, each after one move and one hold of the stage.
    """
    directions = len(case.identification.parameters) + _BOUNDARY_DIRECTIONS
    intervals = 2 * n_images
    working, plain = (
        steps_seconds(case, solver, n_cells, intervals * case.solver.steps_per_interval, n)
        for n in (directions, 0)
    )
    if case.with_images:
        working += _COMPARED_SECONDS * _face(case) * n_images * directions
    finer = cells_of_size(case, n_cells, case.specimen.fine_mesh_size)
    causes = _cause_directions(len(case.grains)) if case.with_images else 0
    # The finer simulation tells its derivatives for all that is fitted, as a rule twice, and then
    # for all causes.
    exact = not solver.runs_per_direction
    told = (directions, directions, directions + causes) if exact and case.with_images else ()

    runs = (*told, *(0,) * (_FINE_RUNS + _finer_looks(case) - len(told)))
    size = case.specimen.fine_mesh_size
    fine, second = correction_seconds(case, solver, n_cells, n_images, size, runs), 0.0
    first = correction_seconds(case, solver, n_cells, n_images, size, runs[:_CORRECTIONS])
    if case.with_images:
        size = size_of_second_mesh(case)
        second = correction_seconds(case, solver, n_cells, n_images, size, (0,) * _SECOND_RUNS)
    fit = _ITERATION_SHARE * case.identification.max_iterations
    # Further starts end before stage C.
    stages_of_start = 2 if case.with_images else 1
    of_start = round(stages_of_start * fit)
    fits = round((stages_of_start + 1) * fit)
    refits = min(case.diagnosis.refit, _causes(case)) * _PER_REFIT if case.with_images else 0
    looks = _ROUNDS * _looks(case) if case.with_images else 0
    # Only further starts, refits and looks are independent of each other and run side by side.
    starts = working * of_start * (case.identification.starts - 1) / case.execution.processes
    tried = (working * refits + plain * looks) / case.execution.processes
    identify = working * fits + starts + first
    if case.boundary.jitter_nm:
        # A direction for the stop of each image, before stage B and at its result.
        identify += 2 * steps_seconds(
            case, solver, n_cells, intervals * case.solver.steps_per_interval, n_images
        )
    diagnose = tried + second + fine - first
    if not case.with_images:  # which diagnoses nothing
        identify, diagnose = identify + diagnose, 0.0
    correlation = _PIXEL_SECONDS * _face(case) * n_images if case.with_images else 0.0
    at_once = case.solver.steps_per_interval
    kind, systems = case.specimen.cell_kind, systems_of(case)
    memory = simulation_memory(kind, n_cells, n_images, directions + causes, at_once, systems)
    each = simulation_memory(kind, n_cells, n_images, directions, at_once, systems)
    if told:
        fitted, all_causes = (
            simulation_memory(kind, finer, n_images, n, at_once, systems)
            for n in (directions, max(told))
        )
        # Finer simulations run side by side as well, but for those of all causes.
        memory, each = max(memory, all_causes), max(each, fitted)
    if case.with_images:
        smallest = cells_of_size(case, n_cells, size_of_second_mesh(case))
        each = max(each, simulation_memory(kind, smallest, n_images, 0, at_once, systems))
        memory = max(memory, each)
    if case.execution.processes > 1 and case.execution.scheduler is None:
        memory += case.execution.processes * each
    if case.with_images:
        memory += identified_images(case, n_images)
        kept = _OTHER_FITS + min(case.diagnosis.refit, _causes(case))
        memory += kept * directions * 8.0 * _face(case) * n_images
        memory = max(memory, measuring_memory(case, n_images))
    each_time = 1 if solver.derivatives else 1 + RUNS_PER_DIRECTION * directions
    evaluations = fits + of_start * (case.identification.starts - 1) + refits
    of_stages = {"measure": correlation, "identify": identify, "diagnose": diagnose}
    seconds = sum(of_stages.values())
    return Cost(seconds, memory, each_time * evaluations + looks, of_stages)


def measuring_memory(case: Case, n_images: int) -> float:
    """Largest resident memory of the stages up to the measurement [bytes].

    Args:
        case: the case.
        n_images: images of the history.
    """
    face, dic = _face(case), case.dic
    nodes = face * (2 / dic.element_px**2 + 1 / dic.height_element_px**2)
    flats = stack_size(case, "flats")
    # The stage begins with the flats as numbers, and ends with what it found of each image.
    first = 0.0 if flats is None else 8.0 * flats.n * flats.pixels
    of_image = face + 8.0 * nodes * _NODAL_COPIES
    band = min(8.0 * face * n_images, _LARGEST_BAND)
    last = n_images * of_image + 8.0 * _COVARIANCES * n_images**2 + band
    return PROCESS_BYTES + _BLOCK_BYTES + max(first, last)


def identified_images(case: Case, n_images: int) -> float:
    """Memory of the images in an identification, which holds their splines [bytes].

    Args:
        case: the case.
        n_images: images of the history.
    """
    frames = stack_size(case, "frames")
    of_image = 0.0 if frames is None else 8.0 * frames.pixels
    return n_images * (of_image + 8.0 * _FACE_NUMBERS * _face(case))


def _face(case: Case) -> float:
    """Pixels of the measured face."""
    return case.specimen.length * case.specimen.width / case.images.pixel_um**2


def _cause_directions(n_grains: int) -> int:
    """Parameters of all causes, which are differentiated together."""
    return len({name for cause in every(n_grains) for name in cause.parameters})


def _causes(case: Case) -> int:
    """How many causes a case asks for, of its own files one each."""
    asked = case.diagnosis.causes
    return (
        len(names(len(case.grains))) + len(case.diagnosis.cause_files)
        if asked == "all"
        else len(asked)
    )


def _looks_in_places(case: Case) -> int:
    """How many looks there may be at causes that lie somewhere."""
    return sum(len(SIDES) * len(cause.places) for cause in _of_library(case))


def _finer_looks(case: Case) -> int:
    """How many looks at causes a finer mesh is run for: what is read otherwise needs none."""
    bent = [c for c in _of_library(case) if c.strongly_nonlinear and not c.kinked]
    return len(bent) + sum(min(len(c.places), SEEN_FINER) for c in _of_library(case))


def _looks(case: Case) -> int:
    """How many looks from afar a round may have."""
    bent = [cause for cause in _of_library(case) if cause.strongly_nonlinear]
    # Of what is read otherwise one simulation has both sides.
    return _looks_in_places(case) + sum(1 if cause.kinked else _SIDES for cause in bent)


def _of_library(case: Case) -> list[Cause]:
    """Those causes of the library that a case asks for."""
    n_grains, stated = len(case.grains), case.diagnosis.causes
    asked = names(n_grains) if stated == "all" else stated
    return [cause for cause in every(n_grains) if cause.name in asked]
