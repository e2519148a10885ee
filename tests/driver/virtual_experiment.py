"""Virtual experiments of a short specimen, as `prismid virtual` makes them.

Nothing of the analysis is shared with what identifies it: driver/microscope says how.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from driver.boundary import elongation_names, tilt_names
from driver.case import Case
from driver.case_tables.images import Images
from driver.case_tables.inference import DiagnosisTable
from driver.case_tables.loading import LambdaStart
from driver.case_tables.material import MaterialTable
from driver.case_tables.solver import Solver
from driver.case_tables.specimen import Grain, Specimen
from driver.virtual_course import Course, stage_program
from driver.virtual_course import pull as pull_case


def small_case() -> Case:
    """A short prism of two grains on a mesh of some hundred cells; starts as a user would."""
    return Case(
        specimen=Specimen(
            length_um=8.0,
            mesh_size_um=2.0,
            fine_mesh_size_um=1.0,
            boundary_point_um=(0.0, 3.6, 0.0),
            boundary_normal=(0.15, 1.0, 0.3),
        ),
        grains=(
            Grain(name="grain 1", euler_deg=(281.0, 8.0, 47.0)),
            Grain(name="grain 2", euler_deg=(211.0, 45.0, 150.0)),
        ),
        material=MaterialTable(strain_measure="small"),
        images=Images(frames="images.tif"),  # the microscope says the rest
        solver=Solver(steps_per_interval=1, fine_steps_per_interval=2),
        diagnosis=DiagnosisTable(refit=3, held_out_cycle="none"),
    )


def true_case(case: Case) -> Case:
    """The specimen of a case as it is: another law, other apex amplitudes; no hidden effect.

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


def pull(
    truth: Case,
    cycles: Sequence[tuple[int, int]],
    elongation: Sequence[float],
    effect: Mapping[str, float],
) -> Course:
    """Simulate a test.

    Args:
        truth: the specimen as it is, on the mesh and with the steps of its working model.
        cycles: images during loading and during unloading of each cycle.
        elongation: elongation at the turning points after the start [µm], two for each cycle;
            the ends tilt by a quarter of it.
        effect: parameters of the general model that are not at their null.
    """
    history = stage_program(cycles)
    stretch = dict(zip(elongation_names(history.n_knots), elongation, strict=True))
    tilt = dict(zip(tilt_names(history.n_knots), (e / 4 for e in elongation), strict=True))
    return pull_case(truth, history, {**stretch, **tilt, **effect})
