from __future__ import annotations

import numpy as np
import pytest

from tools import mesh_reference
from tools.converged_truth import (
    DENSEST,
    REFERENCE,
    SMALLEST,
    known_case,
    pulled,
    stage_history,
    true_case,
)

STORED = mesh_reference.read(REFERENCE)


def test_without_an_effect_the_truth_is_the_mean_of_two_kinds_of_cells() -> None:
    truth = pulled({})
    assert len(STORED.load[0]) == stage_history(DENSEST).n_images
    np.testing.assert_allclose(truth.load, STORED.load.mean(axis=0)[::DENSEST], rtol=1e-12)
    np.testing.assert_allclose(
        truth.motion, STORED.motion.mean(axis=0)[::DENSEST], rtol=0, atol=1e-12
    )


def test_hexahedra_and_tetrahedra_of_no_size_agree() -> None:
    """Each is extrapolated from two sizes: 0.8 µN of 970, 0.5 nm at the nodes of the face."""
    load, motion = (np.diff(both, axis=0) for both in (STORED.load, STORED.motion))
    assert np.sqrt(np.mean(load**2)) < 1.0
    assert np.sqrt(np.mean(motion**2)) < 6e-4


def test_the_images_of_the_dense_test_hold_those_of_the_other() -> None:
    sparse, dense = stage_history(), stage_history(DENSEST)
    images = slice(None, None, DENSEST)
    for name in ("time", "stage"):
        few, many = (getattr(h, name)[h.image_row] for h in (sparse, dense))
        np.testing.assert_allclose(few, many[images], rtol=1e-12)


@pytest.mark.slow
def test_an_effect_of_the_load_cell_adds_to_the_converged_load() -> None:
    """Motions of 0.09 µm that it is told from are stored in single precision, to 4e-9 µm."""
    bare, offset = pulled({}), pulled({"load_offset": 60.0})
    np.testing.assert_allclose(offset.load - bare.load, 60.0, rtol=1e-6)
    np.testing.assert_allclose(offset.motion, bare.motion, rtol=0, atol=2e-8)


def test_cells_and_steps_of_the_truth_are_finer_than_all_that_identify_it() -> None:
    known, finest = known_case(), known_case().specimen.fine_mesh_size
    assert {kind for kind, _ in SMALLEST} == {"hex20", "tet10"}
    assert max(size for _, sizes in SMALLEST for size in sizes) < 0.8 * finest
    assert max(min(sizes) for _, sizes in SMALLEST) <= 0.6 * finest
    assert true_case().specimen.fine_mesh_size < 0.8 * finest
    assert DENSEST > known.solver.fine_steps_per_interval
