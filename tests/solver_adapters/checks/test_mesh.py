from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import (
    BadSimulationError,
    Simulation,
)
from tests.solver_adapters.simulations import (
    GOOD,
    MESH,
    NAN,
    N,
    of_mesh,
    refused,
    with_value,
)

S_PLUS = MESH.nodes["S_PLUS"]


def twice(mesh: PrismMesh) -> PrismMesh:
    """The mesh and, far away, a copy of it."""
    return replace(
        mesh,
        points=np.concatenate([mesh.points, mesh.points + [50.0, 0.0, 0.0]]),
        cells=np.concatenate([mesh.cells, mesh.cells + N]),
        grain=np.tile(mesh.grain, 2),
    )


BROKEN: list[tuple[Simulation, str]] = [
    (
        of_mesh(nodes={**MESH.nodes, "S_PLUS": np.append(S_PLUS, S_PLUS[2])}),
        f"the group S_PLUS of mesh.nodes holds node {S_PLUS[2]} twice; expected each node once",
    ),
    (
        of_mesh(nodes={**MESH.nodes, "S_PLUS": S_PLUS.tolist()}),
        "mesh.nodes['S_PLUS'] is a list; expected an array",
    ),
    (
        of_mesh(points=MESH.points[:, :2]),
        f"mesh.points has shape ({N}, 2); expected (n, 3)",
    ),
    (
        of_mesh(points=with_value(MESH.points, (3, 1), NAN)),
        "mesh.points holds 1 values that are not finite; expected finite numbers",
    ),
    (
        of_mesh(cells=with_value(MESH.cells, (2, 3), N)),
        f"mesh.cells holds {N}, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (
        of_mesh(cells=with_value(MESH.cells, (2, 3), -1)),
        f"mesh.cells holds -1, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (of_mesh(cells=MESH.cells * 1.0), "mesh.cells holds float64; expected integers"),
    (
        of_mesh(
            cells=with_value(
                MESH.cells, slice(7, 9), MESH.cells[7:9][:, [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]]
            )
        ),
        "2 of 12 cells are inverted, the first is cell 7 in grain 2; expected positive Jacobians",
    ),
    (of_mesh(grain=MESH.grain[:5]), "mesh.grain has shape (5,); expected (12,)"),
    (of_mesh(grain=MESH.grain * 1.0), "mesh.grain holds float64; expected integers"),
    (
        of_mesh(grain=with_value(MESH.grain, slice(4, 7), -1)),
        "3 of 12 cells have no grain, the first is cell 4 with grain -1; expected a grain index",
    ),
    (
        of_mesh(grain=2 * MESH.grain),
        "grain index 1 has no cell though the largest is 2; expected grain indices without a hole",
    ),
    (
        of_mesh(nodes={"S_MINUS": MESH.nodes["S_MINUS"]}),
        "mesh.nodes has no group S_PLUS (it has S_MINUS); expected S_PLUS and S_MINUS",
    ),
    (
        of_mesh(nodes={"S_PLUS": MESH.nodes["S_PLUS"]}),
        "mesh.nodes has no group S_MINUS (it has S_PLUS); expected S_PLUS and S_MINUS",
    ),
    (
        of_mesh(nodes={}),
        "mesh.nodes has no group S_PLUS (it has none); expected S_PLUS and S_MINUS",
    ),
    (
        of_mesh(nodes={**MESH.nodes, "S_MINUS": np.zeros(0, dtype=np.int64)}),
        "the group S_MINUS of mesh.nodes is empty; expected one node or more",
    ),
    (
        of_mesh(nodes={**MESH.nodes, "S_PLUS": np.array([N])}),
        f"mesh.nodes['S_PLUS'] holds {N}, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (
        of_mesh(points=np.concatenate([MESH.points, np.ones((2, 3))])),
        f"2 of {N + 2} nodes belong to no cell, the first is node {N}; expected every node in a",
    ),
    (
        replace(GOOD, mesh=twice(MESH)),
        "the mesh falls into 2 pieces that share no node, of 12, 12 cells; expected one connected",
    ),
    (of_mesh(points=MESH.points.tolist()), "mesh.points is a list; expected an array"),
    (of_mesh(cells=MESH.cells.tolist()), "mesh.cells is a list; expected an array"),
]


@pytest.mark.parametrize(("simulation", "sentence"), BROKEN, ids=[s for _, s in BROKEN])
def test_a_broken_mesh_is_named_in_one_sentence(simulation: Simulation, sentence: str) -> None:
    refused(simulation, BadSimulationError, sentence)
