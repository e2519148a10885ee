"""Stage 1: the working mesh and the finer mesh."""

from __future__ import annotations

import logging

from driver.forward.build import mesh_of
from driver.results.files import FINE_MESH, FINE_MESH_VTU, MESH, MESH_VTU
from driver.workflow.engine import StageContext
from meshes.files import write_med, write_vtu

logger = logging.getLogger(__name__)


def run_mesh(context: StageContext) -> None:
    """Generate both meshes, and write them as MED and VTU."""
    specimen = context.case.specimen
    for name, for_eyes, size in (
        (MESH, MESH_VTU, specimen.mesh_size),
        (FINE_MESH, FINE_MESH_VTU, specimen.fine_mesh_size),
    ):
        mesh = mesh_of(context.case, size)
        write_med(mesh, context.workdir / name)
        write_vtu(mesh, context.workdir / for_eyes)
        logger.info(
            f"  {name}: {len(mesh.cells)} cells, {len(mesh.points)} nodes, "
            f"{mesh.n_grains} grain{'s' if mesh.n_grains > 1 else ''}"
        )
