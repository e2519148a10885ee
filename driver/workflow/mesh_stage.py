"""Stage 1: the working mesh and the finer mesh."""

from __future__ import annotations

import logging

from driver.forward.build import mesh_of
from driver.results.files import FINE_MESH, MESH
from driver.workflow.engine import StageContext
from meshes.files import write_med, write_vtu

logger = logging.getLogger(__name__)


def run_mesh(context: StageContext) -> None:
    """Generate both meshes, and write them as MED and VTU."""
    specimen = context.case.specimen
    for name, size in ((MESH, specimen.mesh_size), (FINE_MESH, specimen.fine_mesh_size)):
        mesh = mesh_of(context.case, size)
        path = context.workdir / name
        write_med(mesh, path)
        write_vtu(mesh, path.with_suffix(".vtu"))
        logger.info(
            f"  {name}: {len(mesh.cells)} cells, {len(mesh.points)} nodes, "
            f"{mesh.n_grains} grain{'s' if mesh.n_grains > 1 else ''}"
        )
