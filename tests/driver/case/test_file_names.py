from __future__ import annotations

from pathlib import Path

from driver.case.file_names import with_file_names
from driver.case.grains import Grain
from driver.case.history import HistoryTable
from driver.case.images import Dic, Images
from driver.case.inference import DiagnosisTable
from driver.case.model import load_case, write_case
from driver.case.solver import Execution, ProfileTable, Solver
from tools import closed_form


def test_every_file_that_a_case_names_is_renamed_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "tool.py").touch()
    profile = ProfileTable(command=("python", "tool.py", "--fast"))
    case = closed_form.small_case().model_copy(
        update={
            "images": Images(frames="a.tif", flats="b.tif", repeats="c.tif", mask="d.png"),
            "history": HistoryTable(file="e.csv"),
            "dic": Dic(mesh="f.msh", height_mesh="trace"),
            "diagnosis": DiagnosisTable(cause_files=("g.toml",)),
            "solver": Solver(profiles={"calculix": profile}),
            "execution": Execution(store="jobs"),
            "grains": (
                Grain(name="h", ebsd="h.ang", ebsd_grain=1),
                closed_form.small_case().grains[1],
            ),
        }
    )
    write_case(case, tmp_path / "case.toml")
    moved = with_file_names(load_case(tmp_path / "case.toml"), lambda name: f"../{name}")
    images = moved.images
    assert [images.frames, images.flats, images.repeats, images.mask] == [
        "../a.tif", "../b.tif", "../c.tif", "../d.png",
    ]  # fmt: skip
    assert images.noise_map is None and moved.history.file == "../e.csv"
    assert moved.dic.mesh == "../f.msh" and moved.dic.height_mesh == "trace"
    assert moved.diagnosis.cause_files == ("../g.toml",)
    assert moved.solver.profiles["calculix"].command == ("python", "../tool.py", "--fast")
    assert moved.execution.store == "../jobs"
    assert moved.grains == (Grain(name="h", ebsd="../h.ang", ebsd_grain=1), case.grains[1])
    assert moved.specimen == case.specimen and moved.images.pixel_size_nm == 110.0
