from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.identification.fit import Fit
from driver.identification.slip_activity import slip_activity
from solver_adapters.interface import (
    Capabilities,
    CellFields,
    Progress,
    Response,
    Simulation,
    SolverError,
)
from tests.driver.analytic import evaluation
from tools import closed_form

MODEL = closed_form.problem().model
TRUTH = closed_form.problem().truth


class Slipping(closed_form.ClosedFormSolver):
    """The closed form, with slips in proportion to time: of system s by s, of a cell by its X."""

    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), cell_fields=True)

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        response = super().solve(simulation, workspace, progress)
        times, mesh = simulation.times[simulation.output], simulation.mesh
        cell = 1.0 + mesh.points[mesh.cells].mean(axis=1)[:, 1]
        slip = times[:, None, None] * cell[:, None] * np.arange(24.0)
        none = np.zeros((*slip.shape[:2], 6))
        fields = CellFields(none, slip, slip, none[..., :3])
        return replace(response, cells=fields)


def fitted() -> Fit:
    here = evaluation(np.zeros(3), np.zeros((0, 3)), values=TRUTH)
    return Fit(here, True, "", ())


def test_a_solver_that_tells_no_slips_is_not_asked() -> None:
    assert slip_activity(MODEL, fitted()) is None


def test_a_simulation_that_cannot_be_finished_leaves_no_slips_and_a_line(
    monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    def stop(*arguments: object) -> Response:
        raise SolverError("step 3 does not converge")

    monkeypatch.setattr(Slipping, "solve", stop)
    assert slip_activity(replace(MODEL, adapter=Slipping()), fitted()) is None
    assert lines == ["  no slips are told: step 3 does not converge"]


def test_slips_are_means_over_the_volume_of_each_grain_at_the_images() -> None:
    found = slip_activity(replace(MODEL, adapter=Slipping()), fitted())
    mesh, image_row = MODEL.microstructure.mesh, MODEL.image_row
    assert found is not None and found.images[-1] == image_row.size - 1
    times = MODEL.times[image_row[found.images]]
    corners = mesh.points[mesh.cells[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    along = 1.0 + mesh.points[mesh.cells].mean(axis=1)[:, 1]
    for grain in range(mesh.n_grains):
        mean = np.average(along[mesh.grain == grain], weights=volume[mesh.grain == grain])
        expected = times[:, None] * mean * np.arange(24.0)
        np.testing.assert_allclose(found.of_grains[:, grain], expected, rtol=1e-9)
    np.testing.assert_allclose(found.of_cells, times[-1] * along * 276.0, rtol=1e-12)
