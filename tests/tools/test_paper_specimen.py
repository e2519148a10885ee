from __future__ import annotations

import numpy as np

from tools import mesh_reference
from tools.paper_specimen import REFERENCE, SMALLEST, history, known_case, settings, true_values

STORED = mesh_reference.read(REFERENCE)


def test_the_test_ends_and_turns_where_that_of_the_paper_does() -> None:
    """320, 640 and 960 µm of stage travel, 1, 2 and 3 % between the grips, in moves of 40 µm."""
    test = history()
    peaks = test.stage[test.turning][1::2]
    np.testing.assert_array_equal(peaks, [320.0, 640.0, 960.0])
    assert STORED.load.shape == (2, test.n_images)


def test_hexahedra_and_tetrahedra_of_no_size_agree_in_finite_strain() -> None:
    """Each is extrapolated from two sizes: 0.2 µN of 850, 0.3 nm at the nodes of the face."""
    load, motion = (np.diff(both, axis=0) for both in (STORED.load, STORED.motion))
    assert np.sqrt(np.mean(load**2)) < 0.2
    assert np.sqrt(np.mean(motion**2)) < 3e-4
    assert np.max(STORED.load) > 500.0


def test_the_truth_is_finer_than_what_identifies_it_and_of_another_law() -> None:
    known = known_case()
    assert known.material.strain_measure == "finite"
    assert {kind for kind, _ in SMALLEST} == {"hex20", "tet10"}
    assert max(size for _, sizes in SMALLEST for size in sizes) < known.specimen.fine_mesh_size
    assert true_values()["tau0"] == 21.0 != known.material.tau0_MPa
    assert sum(up for up, _ in settings().program.cycles) == 30
