from __future__ import annotations

import numpy as np
import pytest

from driver.dic.mean_strain import MeanStrains
from driver.identification.measured_slip import elastic_strain, measured_slip, strains_of_slip
from solver_adapters.crystal import BCC, FCC, bunge_matrix, slip_systems
from solver_adapters.material import Material

IRON = Material(slip_systems=BCC, C11=233.5e3, C12=135.5e3, C44=118e3)
TURN = bunge_matrix(211.0, 45.0, 150.0)
STRESS = 100.0


def compliances() -> tuple[float, float, float]:
    """S11, S12, S44 of a cubic crystal by its stiffness matrix [1/MPa]."""
    stiffness = np.diag([IRON.C44] * 6)
    stiffness[:3, :3] = IRON.C12
    stiffness[range(3), range(3)] = IRON.C11
    inverse = np.linalg.inv(stiffness)
    return float(inverse[0, 0]), float(inverse[0, 1]), float(inverse[3, 3])


def test_the_strain_of_slip_is_that_of_a_sheared_block() -> None:
    """Of points of the face before and after a slip of 1e-6 of each system, by differences."""
    directions, normals = (vectors @ TURN.T for vectors in slip_systems(BCC))
    found = strains_of_slip(TURN, IRON)
    for system in range(24):
        motion = np.array([directions[system] * (normals[system] @ edge) for edge in np.eye(3)[:2]])
        expected = [motion[0, 0], motion[1, 1], motion[0, 1] + motion[1, 0]]
        assert found[:, system] == pytest.approx(expected)


def test_tension_stretches_a_cubic_crystal_by_its_compliances() -> None:
    s11, s12, s44 = compliances()
    along_100 = elastic_strain(np.eye(3), IRON, STRESS)
    assert along_100 == pytest.approx([STRESS * s12, STRESS * s11, 0.0])
    y, x = np.ones(3) / np.sqrt(3.0), np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    along_111 = elastic_strain(np.array([x, y, np.cross(x, y)]), IRON, STRESS)
    # Young's modulus along 111 is 3/(S11 + 2 S12 + S44).
    assert along_111[1] == pytest.approx(STRESS * (s11 + 2 * s12 + s44) / 3)
    assert along_111[0] == pytest.approx(STRESS * (s11 + 2 * s12 - s44 / 2) / 3)


def test_the_elastic_strain_is_taken_off_before_slips_are_sought() -> None:
    elastic = elastic_strain(TURN, IRON, STRESS)
    strains = MeanStrains(elastic[None], 1e-12 * np.eye(3)[None])
    found = measured_slip(7, strains, TURN[None], IRON, STRESS)
    assert found.image == 7 and found.total[0, 0] == 0.0
    assert found.strain - found.elastic == pytest.approx(np.zeros((1, 3)), abs=1e-15)


def test_a_grain_off_the_face_has_no_slip_and_systems_that_do_not_exist_slip_by_0() -> None:
    copper = Material(slip_systems=FCC, C11=168.4e3, C12=121.4e3, C44=75.4e3)
    strain = 0.02 * strains_of_slip(TURN, copper)[:, :12].sum(axis=1)
    strains = MeanStrains(
        np.array([strain, [np.nan] * 3]), np.array([1e-8 * np.eye(3), np.full((3, 3), np.nan)])
    )
    found = measured_slip(3, strains, np.array([TURN, TURN]), copper, 0.0)
    assert found.total[0, 0] > found.total[0, 2] > 0.0
    assert (found.slip[0, 12:] == 0.0).all() and (found.sigma[0, 12:] == 0.0).all()
    assert np.isnan(found.slip[1]).all() and np.isnan(found.total[1]).all()
