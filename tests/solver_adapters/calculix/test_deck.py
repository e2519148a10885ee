"""Decks of CalculiX: where each number of a case lands (golden decks: tests/templates)."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import jinja2
import numpy as np
import pytest

import templates
from solver_adapters.calculix import deck
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Simulation
from tests.solver_adapters.calculix.runs import OCTAHEDRAL, simulation
from tools.boxes import box, hex_box, pulled


def texts(asked: Simulation) -> dict[str, str]:
    return {name: content.decode() for name, content in deck.render_files(asked).items()}


def test_the_deck_says_what_wrote_it() -> None:
    head = texts(simulation())["job.inp"].split("** prismid provenance: end")[0]
    assert head.startswith("** prismid provenance: begin\n")
    assert f"** prismid {version('prismid')}, adapter calculix\n" in head


def test_each_constant_of_the_law_lands_exactly_once() -> None:
    values: dict[str, Any] = {
        "C11": 211111.0, "C12": 122222.0, "C44": 133333.0, "K": 14.4, "n": 15.5, "c": 46666.0,
        "d": 1777.0, "tau0": 48.8, "Q": 19.9, "b": 31.1,
    }  # fmt: skip
    numbers = re.split(r"[,\n]", texts(simulation(h_latent=-0.1, **values))["job.inp"])
    for name, value in values.items():
        assert numbers.count(f"{value:g}") == 1, name


def test_each_number_of_the_motion_and_of_the_mesh_lands_exactly_once() -> None:
    asked = simulation((0.001, 0.002))
    rng = np.random.default_rng(1)
    motion = np.zeros_like(asked.motion)
    motion[1:] = rng.uniform(1e-3, 1e-2, motion[1:].shape)
    mesh = replace(asked.mesh, points=rng.uniform(0.0, 4.0, asked.mesh.points.shape))
    files = texts(replace(asked, motion=motion, mesh=mesh))
    for name, values in (("steps", motion[1:]), ("mesh", mesh.points)):
        numbers = re.split(r"[,\n]", files[f"{name}.inp"])
        assert all(numbers.count(f"{value:.13g}") == 1 for value in values.ravel())


def test_no_field_is_longer_than_what_calculix_reads() -> None:
    """CalculiX reads 20 characters of a number, and drops an exponent that stands after them."""
    asked = simulation((-1.2345678901234567e-5, 1.2345678901234567e-3))
    for text in texts(asked).values():
        rows = [row for row in text.splitlines() if re.match(r"[-\d]", row)]
        assert max(len(field) for row in rows for field in row.split(",")) <= 20
    assert len(deck.number(-1.2345678901234567e-105)) <= 20


def test_a_grain_with_a_tau0_of_its_own_gets_a_crystal_of_its_own() -> None:
    text = texts(simulation(tau0_grain2=1.25))["job.inp"]
    assert text.count("*USER MATERIAL") == 2
    assert "ELSET=GRAIN1,MATERIAL=SINGLE_CRYSTAL1" in text
    assert "ELSET=GRAIN2,MATERIAL=SINGLE_CRYSTAL2" in text
    assert re.search(r"^0\.,50,", text, re.M)


def test_the_orientation_is_the_first_two_rows_of_the_bunge_matrix() -> None:
    """Bunge (1982): g for (30°, 0, 0) turns the sample axes by 30° about Z."""
    crystals = np.stack([bunge_matrix(30, 0, 0)] * 2)
    text = texts(replace(simulation(), orientations=crystals))["job.inp"]
    (row,) = re.findall(r"NAME=CRYSTAL1,.*\n(.*)", text)
    found = np.array(row.split(","), dtype=float)
    np.testing.assert_allclose(found, [3**0.5 / 2, 0.5, 0, -0.5, 3**0.5 / 2, 0], atol=1e-12)


def test_a_hold_moves_nothing_and_a_step_moves_only_what_changes() -> None:
    blocks = texts(simulation((0.001, 0.001, 0.002)))["steps.inp"].split("*STEP,")[1:]
    rows = [len(re.findall(r"^\d+,\d,\d,", block, re.M)) for block in blocks]
    moved = len(box().nodes["S_PLUS"])
    assert rows == [moved, 0, moved]


def test_given_steps_become_steps_of_the_deck_with_the_motion_between_the_instants() -> None:
    asked = replace(simulation((0.001, 0.002)), steps=np.array([0.25, 1.0, 2.0]))
    text = texts(asked)["steps.inp"]
    assert re.findall(r"^\*\* (\S+) s to (\S+) s$", text, re.M) == [
        ("0", "0.25"), ("0.25", "1"), ("1", "2"),
    ]  # fmt: skip
    node = asked.mesh.nodes["S_PLUS"][0] + 1
    pulled_by = re.findall(rf"^{node},2,2,(\S+)$", text, re.M)
    np.testing.assert_allclose(np.array(pulled_by[1:], dtype=float), [1e-3, 4e-3, 8e-3])


@pytest.mark.parametrize(("make", "name"), [(box, "C3D10"), (hex_box, "C3D20R")])
def test_the_kind_of_cell_is_named(make: Any, name: str) -> None:
    assert texts(simulation(mesh=make()))["mesh.inp"].count(f"TYPE={name},") == 2


def test_a_cell_with_more_numbers_than_a_line_holds_goes_on_in_the_next() -> None:
    """CalculiX reads 16 of a line, and the next one where a comma ends it."""
    mesh = hex_box()
    text = texts(simulation(mesh=mesh))["mesh.inp"]
    assert max(len(row.rstrip(",").split(",")) for row in text.splitlines()) == 16
    cells = {}
    for block in re.findall(r"^\*ELEMENT.*\n((?:\d.*\n)+)", text, re.M):
        for row in block.replace(",\n", ",").splitlines():
            number, *nodes = map(int, row.split(","))
            cells[number - 1] = np.array(nodes) - 1
    np.testing.assert_array_equal([cells[k] for k in range(len(mesh.cells))], mesh.cells)


def test_a_template_that_names_an_unknown_value_fails() -> None:
    for name in ("job", "mesh", "steps"):
        with pytest.raises(jinja2.UndefinedError):
            templates.render(f"calculix/{name}.inp.j2")


def test_writing_twice_writes_the_same() -> None:
    assert deck.render_files(simulation()) == deck.render_files(
        replace(
            pulled(box(), OCTAHEDRAL, (0.001, 0.002)),
            integration="backward_euler",
        )
    )
