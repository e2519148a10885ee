"""The files of a job: what they hold, and that the command file does in Python what it says."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import jinja2
import medcoupling as mc
import numpy as np
import pytest

import templates
from meshes.tet10 import MIRRORED
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.code_aster.deck import render_files
from solver_adapters.code_aster.limits import FINITE_CAUTION
from solver_adapters.crystal import FCC
from solver_adapters.external import Profile
from solver_adapters.interface import Simulation
from tools.code_aster_cases import small_case

ADAPTER = CodeAsterAdapter()


def texts(simulation: Simulation, profile: Profile | None = None) -> dict[str, str]:
    files = CodeAsterAdapter(profile).write(simulation)
    return {name: data.decode("ascii") for name, data in files.items() if name != "job.med"}


class Commands(dict[str, Any]):
    """Names of a command file: those that it does not set itself are commands that are noted."""

    def __init__(self) -> None:
        super().__init__(_F=dict)
        self.calls: list[tuple[str, dict[str, Any]]] = []

    def __missing__(self, name: str) -> Any:
        if name.startswith("__") or not name.isupper():
            raise KeyError(name)

        def command(**keywords: Any) -> str:
            self.calls.append((name, keywords))
            return f"{name} {len(self.calls)}"

        return command

    def keywords(self, name: str) -> list[dict[str, Any]]:
        return [keywords for called, keywords in self.calls if called == name]


def executed(simulation: Simulation, folder: Path, patch: pytest.MonkeyPatch) -> Commands:
    """The command file run with commands that only note how they are called."""
    files = texts(simulation)
    (folder / "motion.csv").write_text(files["motion.csv"], encoding="ascii")
    patch.chdir(folder)
    names = Commands()
    exec(compile(files["job.comm"], "job.comm", "exec"), names)
    return names


def test_every_number_of_the_case_lands_exactly_once() -> None:
    law = {
        "C11": 231001.5, "C12": 131002.5, "C44": 111003.5, "K": 12.25, "n": 9.75, "tau0": 41.125,
        "c": 41004.5, "d": 1505.5, "Q": 7.10375, "b": 31.625, "h_latent": 0.410375,
        "tau0_grain2": 0.890625, "elastic_scale": 1.015625, "C44_scale": 0.98410375,
    }  # fmt: skip
    case = replace(small_case(**law), tolerance=3.5e-7, steps_per_interval=1037)
    case = replace(case, times=np.array([0.0, 2.71828, 3.14159, 5.77216]))
    whole = "\n".join(texts(case, Profile(memory=5120.5, cpu_time=777.5)).values())
    words = Counter(
        word.strip(",()[]") for word in whole.replace("=", " ").replace(",", " ").split()
    )
    wanted = [*law.values(), case.tolerance, 1037, *case.times[1:].tolist(), 5120.5, 777.5]
    # The orientations of the case are those of these Bunge angles.
    wanted += [281.0, 8.0, 47.0, 211.0, 45.0, 150.0]
    assert {number: words[repr(number)] for number in wanted} == dict.fromkeys(wanted, 1)


def test_the_ratio_of_the_families_lands_once_for_all_grains() -> None:
    comm = texts(small_case(tau0_112=1.171875))["job.comm"]
    assert comm.count("1.171875") == 1


def test_fcc_is_the_octahedral_family_with_a_table_of_its_twelve_systems(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    matrix = np.full((12, 12), 0.5) + 0.5 * np.eye(12)
    matrix[0, 5] = matrix[5, 0] = 2.0
    rows = tuple(map(tuple, matrix.tolist()))
    case = small_case(slip_systems=FCC, Q=3.0, interaction=rows)
    commands = executed(case, tmp_path, monkeypatch)
    laws = [law["MONOCRISTAL"] for law in commands.keywords("DEFI_COMPOR")]
    assert [law["FAMI_SYST_GLIS"] for law in laws] == ["OCTAEDRIQUE"] * 2
    (table,) = commands.keywords("CREA_TABLE")
    assert [row["PARA"] for row in table["LISTE"]] == [f"H{n + 1}" for n in range(12)]
    np.testing.assert_array_equal([row["LISTE_R"] for row in table["LISTE"]], matrix)
    comm = texts(case)["job.comm"]
    assert "BCC24" not in comm
    assert "CAUTION: No run of Code_Aster has judged this deck" in comm
    assert "CAUTION" not in texts(small_case())["job.comm"]


def test_recorded_steps_and_wanted_instants_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = small_case()
    steps = np.array([0.7, 2.0, 3.1, 3.3, 4.0, 6.0])
    case = replace(case, steps=steps, output=np.array([1, 3]))
    lists = executed(case, tmp_path, monkeypatch).keywords("DEFI_LIST_REEL")
    assert lists == [{"VALE": [0.0, *steps.tolist()]}, {"VALE": [2.0, 6.0]}]


def test_intervals_are_divided_and_keep_their_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = replace(small_case(), steps_per_interval=3)
    times = executed(case, tmp_path, monkeypatch).keywords("DEFI_LIST_REEL")[0]["VALE"]
    np.testing.assert_allclose(times, np.linspace(0.0, 6.0, 10), rtol=1e-15)
    assert times[::3] == [0.0, 2.0, 4.0, 6.0]


def test_the_motion_is_that_of_the_simulation_at_every_node_and_between_instants(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = small_case()
    motion = np.random.default_rng(5).normal(size=case.motion.shape)
    motion[0] = 0.0
    case = replace(case, motion=motion)
    commands = executed(case, tmp_path, monkeypatch)
    formulas = commands.keywords("FORMULE")
    assert [formula["NOM_PARA"] for formula in formulas] == [("X", "Y", "Z", "INST")] * 3
    for place, node in enumerate(case.motion_nodes):
        X, Y, Z = case.mesh.points[node].tolist()
        for column, formula in enumerate(formulas):
            # At 5 s, in the middle of the last interval.
            names = {"X": X, "Y": Y, "Z": Z, "INST": 5.0, "moved": formula["moved"]}
            expected = motion[2:4, place, column].mean()
            assert eval(formula["VALE"], names) == pytest.approx(expected, rel=1e-12)


def test_free_components_are_left_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = small_case()
    mask = case.motion_mask.copy()
    mask[1:, 0] = False
    mask[:, 2] = [True, True] + [False] * (len(mask) - 2)
    case = replace(case, motion_mask=mask)
    (load,) = executed(case, tmp_path, monkeypatch).keywords("AFFE_CHAR_CINE_F")
    assert [sorted(group) for group in load["MECA_IMPO"]] == [
        ["DX", "GROUP_NO"], ["DY", "GROUP_NO"], ["DZ", "GROUP_NO"],
    ]  # fmt: skip
    file = mesh_of(case, tmp_path)
    for column, name in enumerate(("MOVED_X", "MOVED_Y", "MOVED_Z")):
        found = file.getGroupArr(1, name).toNumPyArray()
        np.testing.assert_array_equal(np.sort(case.motion_nodes[mask[:, column]]), found)
    rows = texts(case)["motion.csv"].splitlines()
    assert len(rows) == 3 + np.count_nonzero(mask)


def mesh_of(case: Simulation, folder: Path) -> Any:
    path = folder / "job.med"
    path.write_bytes(ADAPTER.write(case)["job.med"])
    with h5py.File(path) as file:
        assert list(file["ENS_MAA"]) == ["prism"]
    return mc.MEDFileUMesh(str(path))


def test_the_mesh_has_the_nodes_cells_and_grains_of_the_simulation(tmp_path: Path) -> None:
    case = small_case()
    file = mesh_of(case, tmp_path)
    np.testing.assert_array_equal(file.getCoords().toNumPyArray(), case.mesh.points)
    cells = file.getMeshAtLevel(0).getNodalConnectivity().toNumPyArray().reshape(-1, 11)
    np.testing.assert_array_equal(cells[:, 1:], case.mesh.cells[:, MIRRORED])
    for grain in (0, 1):
        members = file.getGroupArr(0, f"GRAIN{grain + 1}").toNumPyArray()
        np.testing.assert_array_equal(members, np.flatnonzero(case.mesh.grain == grain))
    for name in ("S_PLUS", "S_MINUS"):
        np.testing.assert_array_equal(
            file.getGroupArr(1, name).toNumPyArray(), case.mesh.nodes[name]
        )


def test_the_constants_are_those_of_the_reference_deck(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """E, ν, G of Code_Aster's run on the prism: 133986 MPa, 0.36721, 118 GPa."""
    commands = executed(small_case(Q=3.0, tau0_grain2=1.5), tmp_path, monkeypatch)
    first, second = commands.keywords("DEFI_MATERIAU")
    assert first["ELAS_ORTH"]["E_L"] == pytest.approx(133986, abs=1)
    assert first["ELAS_ORTH"]["NU_TN"] == pytest.approx(0.36721, abs=1e-5)
    assert first["ELAS_ORTH"]["G_LN"] == 118e3
    assert first["MONO_VISC1"] == {"N": 10.0, "K": 12.0, "C": 40e3}
    assert first["MONO_ISOT1"] == {"R_0": 40.0, "Q": 3.0, "B": 30.0, "H": 0.0}
    assert first["MONO_CINE1"] == {"D": 1500.0}
    assert second["MONO_ISOT1"]["R_0"] == 60.0
    grains = [law["GROUP_MA"] for law in commands.keywords("STAT_NON_LINE")[0]["COMPORTEMENT"]]
    assert grains == ["GRAIN1", "GRAIN2"]


def test_two_families_say_the_elasticity_once_and_have_both_materials_on_the_grain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = executed(small_case(tau0_112=1.25), tmp_path, monkeypatch)
    first, second, *_ = commands.keywords("DEFI_MATERIAU")
    assert "ELAS_ORTH" in first and "ELAS_ORTH" not in second
    assert (first["MONO_ISOT1"]["R_0"], second["MONO_ISOT1"]["R_0"]) == (40.0, 50.0)
    law = commands.keywords("DEFI_COMPOR")[0]
    assert [family["FAMI_SYST_GLIS"] for family in law["MONOCRISTAL"]] == ["CUBIQUE1", "CUBIQUE2"]
    assert [family.get("ELAS") for family in law["MONOCRISTAL"]] == ["ELAS_ORTH", None]
    (table,) = commands.keywords("CREA_TABLE")
    assert [column["PARA"] for column in table["LISTE"]] == [f"H{i}" for i in range(1, 25)]
    np.testing.assert_array_equal([column["LISTE_R"] for column in table["LISTE"]], np.eye(24))
    grains = commands.keywords("AFFE_MATERIAU")[0]["AFFE"]
    assert [len(grain["MATER"]) for grain in grains] == [2, 2]


def test_finite_strain_comes_with_its_caution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = small_case()
    finite = replace(case, material=replace(case.material, strain_measure="finite"))
    comm = texts(finite)["job.comm"]
    words = " ".join(comm.replace("\n# ", " ").split())
    assert f"CAUTION: {FINITE_CAUTION}" in words
    assert "CAUTION" not in texts(case)["job.comm"]
    (run,) = executed(finite, tmp_path, monkeypatch).keywords("STAT_NON_LINE")
    assert run["NEWTON"]["PREDICTION"] == "ELASTIQUE"
    law = run["COMPORTEMENT"][0]
    assert (law["DEFORMATION"], law["ALGO_INTE"]) == ("SIMO_MIEHE", "NEWTON_PERT")


def test_fields_at_the_gauss_points_are_written_only_when_wanted() -> None:
    case = small_case()
    plain, wanted = texts(case), texts(replace(case, cell_fields=True))
    assert "VARI_ELGA" not in plain["job.comm"] and "cells.rmed" not in plain["job.export"]
    assert "VARI_ELGA" in wanted["job.comm"] and "F rmed cells.rmed R 81" in wanted["job.export"]


def test_limits_and_processes_are_lines_of_the_export_file() -> None:
    profile = Profile(processes=4, threads=2, memory=9000.0, wall_time=600.0, cpu_time=400.0)
    lines = texts(small_case(), profile)["job.export"].splitlines()
    for line in ("time_limit 400.0", "memory_limit 9000.0", "mpi_nbcpu 4", "ncpus 2"):
        assert f"P {line}" in lines


def test_a_value_that_the_template_lacks_fails(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "code_aster").mkdir()
    (tmp_path / "code_aster" / "job.comm.j2").write_text("TAU0 = {{ material.tau_0 }}")
    monkeypatch.setattr(templates._ENVIRONMENT, "loader", jinja2.FileSystemLoader(tmp_path))
    with pytest.raises(jinja2.UndefinedError, match="tau_0"):
        render_files(small_case(), Profile())
