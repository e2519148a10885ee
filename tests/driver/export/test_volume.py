"""The volume of a model is the simulation that was fitted, seen inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from driver.case.model import Case
from driver.experiment.history import History, read_history
from driver.export.volume import Volume, simulate_volume
from driver.forward.build import adapter_of, build_model, mesh_of
from driver.forward.model import ForwardModel
from meshes.surface import trace
from solver_adapters.bundled.fem.element import element_of, shape_gradients
from solver_adapters.interface import Progress
from tests.driver.stated_sizes import stated_case

CASE = stated_case()
MESH = mesh_of(CASE, 3.0)


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> History:
    path: Path = tmp_path_factory.mktemp("history") / "history.csv"
    rows = ((0.0, 0, 0), (40.0, 10, 1), (80.0, 4, 2))
    lines = [f"{time},{stage},{image},0" for time, stage, image in rows]
    path.write_text("\n".join(["time_s,stage_um,image,force_N", *lines, ""]))
    return read_history(path)


def forward(case: Case, history: History) -> tuple[ForwardModel, dict[str, float]]:
    pixels = np.array([[0.0, 3.0], [0.5, 6.0]])
    model = build_model(
        case, MESH, history, pixels, adapter_of(case), case.solver.steps_per_interval
    )
    return model, model.null_values() | {"elongation_1": 0.06, "elongation_2": 0.05, "tau0": 30.0}


def test_the_face_moves_as_it_did_in_the_fit_and_the_stress_carries_the_load(
    history: History,
) -> None:
    model, values = forward(CASE, history)
    told: list[Progress] = []
    volume: Volume = simulate_volume(CASE, MESH, history, values, told.append)
    fitted = model.predict(values).response
    face = trace(MESH).nodes
    np.testing.assert_array_equal(volume.displacement[:, face], fitted.displacement)
    np.testing.assert_array_equal(volume.times, history.time[history.image_row])
    assert told[-1].time == history.time[-1]
    # Cauchy stress times section, to the few 0.1 % by which strain changes volume and section.
    weights = shape_gradients(MESH.points, MESH.cells, element_of(MESH.cells))[1]
    volumes = weights.sum(axis=1)
    force = volume.cell_data["stress_MPa"][:, :, 1] @ volumes / CASE.specimen.length
    assert abs(fitted.force).max() > 300
    np.testing.assert_allclose(force, fitted.force, atol=0.01 * abs(fitted.force).max())
    slip = volume.cell_data["accumulated_slip_sum"]
    assert slip[1].max() > 1e-3
    assert (slip[2] >= slip[1]).all()
