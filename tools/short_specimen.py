"""A short specimen of two grains: what its user knows of it, and what it truly is.

Nothing of the truth is shared with what identifies it: driver/virtual/microscope says how.
"""

from __future__ import annotations

from driver.case.grains import Grain
from driver.case.images import Images
from driver.case.inference import DiagnosisTable
from driver.case.loading import LambdaStart
from driver.case.material import MaterialTable
from driver.case.model import Case
from driver.case.solver import Solver
from driver.case.specimen import Specimen
from driver.experiment.history import History
from driver.parameters.boundary import elongation_names, tilt_names

CYCLES = ((8, 2), (8, 2))
"""Images during loading and during unloading of each cycle."""
_ELONGATION = (0.045, 0.039, 0.090, 0.083)  # at the turning points [µm]
_TILT_SHARE = 0.25
GRAINS = (
    Grain(name="grain 1", euler_deg=(281.0, 8.0, 47.0)),
    Grain(name="grain 2", euler_deg=(211.0, 45.0, 150.0)),
)


def short_prism(length: float, fine_mesh_size: float) -> Specimen:
    """Return a prism with an oblique grain boundary somewhat below its middle [µm]."""
    return Specimen(
        length_um=length,
        mesh_size_um=2.0,
        fine_mesh_size_um=fine_mesh_size,
        boundary_point_um=(0.0, 0.45 * length, 0.0),
        boundary_normal=(0.15, 1.0, 0.3),
    )


def small_case() -> Case:
    """Return a short prism of two grains on some hundred cells; starts as a user would."""
    return Case(
        specimen=short_prism(8.0, 1.0),
        grains=GRAINS,
        material=MaterialTable(strain_measure="small"),
        images=Images(frames="images.tif"),  # the microscope says the rest
        solver=Solver(steps_per_interval=1, fine_steps_per_interval=2),
        diagnosis=DiagnosisTable(refit=3, held_out_cycle="none"),
    )


def true_case(case: Case) -> Case:
    """Return the specimen of a case as it is: another law, other apex amplitudes; no hidden effect.

    Its working mesh and steps are those of the truth, finer than any that the case knows.
    """
    mesh = {"mesh_size_um": 0.9, "fine_mesh_size_um": 0.8}
    law = {"tau0_MPa": 25.0, "c_MPa": 44e3, "d": 1140.0}
    amplitudes = LambdaStart(plus_Y=0.81, plus_Z=1.02, minus_Y=0.98, minus_Z=1.02)
    return case.model_copy(
        update={
            "specimen": case.specimen.model_copy(update=mesh),
            "material": case.material.model_copy(update=law),
            "boundary": case.boundary.model_copy(update={"lambda_start": amplitudes}),
            "solver": Solver(steps_per_interval=3),
        }
    )


def true_knots(history: History) -> dict[str, float]:
    """Elongation and tilt at the turning points of a history of `CYCLES` [µm], by name."""
    stretch = dict(zip(elongation_names(history.n_knots), _ELONGATION, strict=True))
    tilts = (_TILT_SHARE * e for e in _ELONGATION)
    return stretch | dict(zip(tilt_names(history.n_knots), tilts, strict=True))
