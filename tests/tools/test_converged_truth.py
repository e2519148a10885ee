from __future__ import annotations

import numpy as np

from tools import mesh_reference
from tools.converged_truth import DENSEST, REFERENCE, known_case, pulled, stage_history, true_case

STORED = mesh_reference.read(REFERENCE)


def test_without_an_effect_the_truth_is_the_mean_of_two_kinds_of_cells() -> None:
    truth = pulled({})
    assert len(STORED.load[0]) == stage_history(DENSEST).n_images
    np.testing.assert_allclose(truth.load, STORED.load.mean(axis=0)[::DENSEST], rtol=1e-12)
    np.testing.assert_allclose(
        truth.motion, STORED.motion.mean(axis=0)[::DENSEST], rtol=0, atol=1e-12
    )


def test_the_images_of_the_dense_test_hold_those_of_the_other() -> None:
    sparse, dense = stage_history(), stage_history(DENSEST)
    images = slice(None, None, DENSEST)
    for name in ("time", "stage"):
        few, many = (getattr(h, name)[h.image_row] for h in (sparse, dense))
        np.testing.assert_allclose(few, many[images], rtol=1e-12)


def test_an_effect_of_the_load_cell_adds_to_the_converged_load() -> None:
    bare, offset = pulled({}), pulled({"load_offset": 60.0})
    np.testing.assert_allclose(offset.load - bare.load, 60.0, rtol=1e-6)
    np.testing.assert_allclose(offset.motion, bare.motion, rtol=0, atol=1e-9)


def test_the_cells_of_the_truth_are_not_those_that_identify_it() -> None:
    known, truth = known_case(), true_case()
    assert known.specimen.cells != truth.specimen.cells
    assert truth.specimen.mesh_size < known.specimen.fine_mesh_size
    assert truth.solver.steps_per_interval > known.solver.fine_steps_per_interval
