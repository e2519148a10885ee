from __future__ import annotations

import csv
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver_adapters.crystal import (
    BCC,
    BCC48,
    FCC,
    N_110,
    SystemTable,
    bunge_angles,
    bunge_matrix,
    rotation_vector_matrix,
    schmid_tensors,
    slip_systems,
    system_count,
    table_fault,
)

CODE_ASTER = Path(__file__).parents[1] / "data" / "solver" / "bcc24_slip_systems.csv"


def test_the_systems_and_their_order_are_those_of_code_aster() -> None:
    with CODE_ASTER.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(BCC)
    directions, normals = slip_systems(BCC)
    for row, m, n in zip(rows, directions, normals, strict=True):
        for letter, found in (("m", m), ("n", n)):
            expected = np.array([float(row[f"{letter}{axis}"]) for axis in "123"])
            np.testing.assert_allclose(found, expected / np.linalg.norm(expected), atol=1e-15)
    families = [row["family"] for row in rows]
    assert families == ["{110}<111>"] * N_110 + ["{112}<111>"] * (len(BCC) - N_110)


def test_slip_is_isochoric_and_its_schmid_tensors_have_unit_norm() -> None:
    schmid = schmid_tensors(BCC)
    np.testing.assert_allclose(np.trace(schmid, axis1=1, axis2=2), 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(schmid, axis=(1, 2)), 1, rtol=1e-14)


def test_no_system_comes_twice() -> None:
    schmid = schmid_tensors(BCC).reshape(len(BCC), 9)
    alignment = abs(schmid @ schmid.T) - np.eye(len(BCC))
    assert alignment.max() < 0.99


def test_the_systems_of_fcc_are_all_directions_110_in_all_planes_111() -> None:
    planes = [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)]
    signs = [(1, 1), (1, -1)]
    lines = [(0, a, b) for a, b in signs] + [(a, 0, b) for a, b in signs]
    lines += [(a, b, 0) for a, b in signs]
    pairs = [(n, m) for n in planes for m in lines if np.dot(n, m) == 0]
    assert len(pairs) == len(FCC) == 12
    expected = np.array([np.outer(m, n) for n, m in pairs]).reshape(12, 9) / np.sqrt(6)
    found = schmid_tensors(FCC)[:12].reshape(12, 9)
    alike = abs(expected @ found.T) > 1 - 1e-12
    assert (alike.sum(axis=0) == 1).all() and (alike.sum(axis=1) == 1).all()
    assert not schmid_tensors(FCC)[12:].any()


def test_the_48_systems_of_bcc_are_all_directions_111_in_all_planes_110_112_123() -> None:
    lines = [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)]
    start = 0
    for a, b, c in ((0, 1, 1), (1, 1, 2), (1, 2, 3)):
        planes = {
            (i * x, j * y, k * z)
            for x, y, z in permutations((a, b, c))
            for i, j, k in product((1, -1), repeat=3)
        }
        half = [plane for plane in planes if plane > (0, 0, 0)]
        pairs: SystemTable = tuple((n, m) for n in half for m in lines if np.dot(n, m) == 0)
        end = start + len(pairs)
        expected, found = (
            schmid_tensors(table)[: len(pairs)].reshape(-1, 9)
            for table in (pairs, BCC48[start:end])
        )
        alike = abs(expected @ found.T) > 1 - 1e-12
        assert (alike.sum(axis=0) == 1).all() and (alike.sum(axis=1) == 1).all()
        start = end
    assert start == len(BCC48) == 48 and BCC48[:24] == BCC


@pytest.mark.parametrize("length", [1e300, 1e-300, 5e-324])
def test_planes_and_directions_have_any_length(length: float) -> None:
    table: Any = tuple(
        tuple(tuple(length * index for index in indices) for indices in system) for system in BCC
    )
    assert table_fault(table) is None
    for found, expected in zip(slip_systems(table), slip_systems(BCC), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=0.0)


def test_arrays_hold_24_systems_or_48() -> None:
    tables = (FCC, BCC, BCC48[:25], BCC48)
    assert [system_count(table) for table in tables] == [24, 24, 48, 48]
    assert [len(schmid_tensors(table)) for table in tables] == [24, 24, 48, 48]
    assert not schmid_tensors(BCC48[:25])[25:].any()


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        ((), "0 systems"),
        (3 * BCC, "72 systems"),
        ((((1, 1, 1), (1, 1, 0)),), "system 1 with a direction that does not lie in its plane"),
        ((((1, 1, 1), (0, 0, 0)),), "system 1 with a plane or a direction of length 0"),
        (
            (FCC[0], FCC[1], ((-2, -2, -2), (1, 0, -1))),
            "system 3 that is system 1 again",
        ),
        (BCC, None),
        (FCC, None),
        (BCC48, None),
    ],
    ids=str,
)
def test_a_table_that_is_none_of_slip_systems_is_told_why(
    table: SystemTable, fault: str | None
) -> None:
    assert table_fault(table) == fault


def test_the_columns_of_a_bunge_matrix_are_the_crystal_axes_in_the_sample() -> None:
    """φ1 = 30° turns [100] towards Y; Φ = 90° then stands [001] on −Y', φ2 turns about it."""
    np.testing.assert_allclose(bunge_matrix(30, 0, 0)[:, 0], [np.sqrt(3) / 2, 0.5, 0], atol=1e-15)
    np.testing.assert_allclose(bunge_matrix(0, 90, 0)[:, 2], [0, -1, 0], atol=1e-15)
    tilted = bunge_matrix(40, 60, 0)
    np.testing.assert_allclose(bunge_matrix(40, 60, 70)[:, 2], tilted[:, 2], atol=1e-15)
    # Against the closed form of Bunge (1982): g = R^T, g13 = sin φ2 sin Φ, g31 = sin φ1 sin Φ.
    a, b, c = np.deg2rad([281, 8, 47])
    g = bunge_matrix(281, 8, 47).T
    np.testing.assert_allclose(g[0, 2], np.sin(c) * np.sin(b), atol=1e-15)
    np.testing.assert_allclose(g[2, 0], np.sin(a) * np.sin(b), atol=1e-15)
    first = np.cos(a) * np.cos(c) - np.sin(a) * np.sin(c) * np.cos(b)
    np.testing.assert_allclose(g[0, 0], first, atol=1e-15)


@pytest.mark.parametrize("vector", [[0.3, -0.2, 0.5], [0, 0, np.pi], [1e-9, 2e-9, 0], [0, 0, 0]])
def test_a_rotation_vector_gives_the_rotation_about_itself_by_its_length(
    vector: list[float],
) -> None:
    axis = np.array(vector, dtype=np.float64)
    angle = np.linalg.norm(axis)
    rotation = rotation_vector_matrix(axis)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rotation @ axis, axis, atol=1e-15)
    np.testing.assert_allclose(np.trace(rotation), 1 + 2 * np.cos(angle), atol=1e-14)
    skew = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0]]
    np.testing.assert_allclose(skew, 2 * np.sinc(angle / np.pi) * axis[:2], atol=1e-15)
    assert rotation[1, 0] - rotation[0, 1] >= -1e-15


@pytest.mark.parametrize(
    "angles",
    [
        (281.0, 8.0, 47.0),
        (211.0, 45.0, 150.0),
        (0.0, 0.0, 0.0),
        (120.0, 0.0, 0.0),
        (30.0, 0.0, 50.0),
        (200.0, 180.0, 70.0),
        (17.0, 1e-9, 300.0),
        (17.0, 180.0 - 1e-9, 300.0),
        (90.0, 90.0, 90.0),
    ],
)
def test_bunge_angles_make_their_rotation_again(angles: tuple[float, float, float]) -> None:
    """Also where the first and the third axis are the same, or nearly."""
    rotation = bunge_matrix(*angles)
    found = bunge_angles(rotation)
    assert 0 <= found[1] <= 180
    np.testing.assert_allclose(bunge_matrix(*found), rotation, atol=2e-15)


def test_bunge_angles_of_a_rotation_are_the_ones_that_made_it() -> None:
    found = np.array(bunge_angles(bunge_matrix(211.0, 45.0, 150.0)))
    np.testing.assert_allclose(found % 360, [211.0, 45.0, 150.0], atol=1e-12)


def test_bunge_angles_turn_the_crystal_about_Z_then_X_then_Z() -> None:
    # φ1 turns the crystal about the sample normal: [100] from X to Y.
    np.testing.assert_allclose(bunge_matrix(90, 0, 0) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    # Cube on its corner: Φ = acos(1/√3), φ2 = 45° stands [111] along Z.
    corner = bunge_matrix(0, float(np.degrees(np.arccos(3**-0.5))), 45)
    np.testing.assert_allclose(corner @ np.full(3, 3**-0.5), [0, 0, 1], atol=1e-12)
