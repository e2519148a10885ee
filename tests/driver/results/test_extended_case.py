from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tifffile

from driver.case.images import Axis
from driver.case.model import Case, load_case, write_case
from driver.case.solver import ProfileTable
from driver.diagnosis.answer.result_types import BadLoad
from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.diagnosis.causes.ebsd_flips import FLIPS, frame_turn
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE, NOISE_NOT_UNIFORM
from driver.experiment.orientations import orientations_of
from driver.experiment.reading import arrange
from driver.identification.image_data import reweighted
from driver.parameters.registry import declared_parameters
from driver.results.extended_case import added_parameters, extended_case, write_noise_map
from driver.results.files import NOISE_MAP
from solver_adapters.material import MATERIAL_DECLARATIONS, declarations_at
from tools import closed_form

LAW = [p.name for p in MATERIAL_DECLARATIONS]
BY_NAME = {cause.name: cause for cause in LIBRARY}


def ended(values: dict[str, float], *causes: Cause, **more: Any) -> Any:
    """A diagnosis that ended at these values, of a baseline in which the law is fitted."""
    null = {name: p.null for name, p in declared_parameters(5).items()}
    free = SimpleNamespace(free=("tau0", "c", "d", *more.pop("fitted", ())))
    return SimpleNamespace(
        extended=SimpleNamespace(values=null | values), baseline=SimpleNamespace(best=free),
        causes=causes, levels=more.pop("levels", {}), bad_loads=more.pop("bad_loads", ()), **more,
    )  # fmt: skip


def extended(case: Case, values: dict[str, float], *causes: Cause) -> Case:
    """The extended case of a diagnosis that ended at these values."""
    return extended_case(case, ended(values, *causes))


def fitting(*names: str) -> Case:
    case = closed_form.small_case()
    table = case.identification.model_copy(update={"parameters": names})
    return case.model_copy(update={"identification": table})


def with_123(case: Case) -> Case:
    """The case with slip systems {123}, which some parameters are of."""
    return case.with_values_at({"material.slip_systems": "bcc48"})


@pytest.mark.parametrize("name", LAW)
def test_a_fitted_constant_stands_in_the_extended_case_in_the_unit_of_its_key(
    name: str, tmp_path: Path
) -> None:
    parameter = declared_parameters(5)[name]
    value = parameter.value(0.1, getattr(fitting(name).material.to_material(), name))
    path = tmp_path / "extended.toml"
    write_case(extended(with_123(fitting(name)), {name: value}), path)
    material = load_case(path).material.to_material()
    assert getattr(material, name) == pytest.approx(value)
    default = closed_form.small_case().material.to_material()
    for other in set(LAW) - {name}:
        assert getattr(material, other) == getattr(default, other)


def test_the_apex_amplitudes_start_where_they_were_found() -> None:
    case = extended(fitting("tau0"), {"lambda_plus_Y": 0.81, "lambda_minus_Z": 1.02})
    start = case.boundary.lambda_start
    assert (start.plus_Y, start.plus_Z, start.minus_Y, start.minus_Z) == (0.81, 1.0, 1.0, 1.02)


def test_added_causes_and_earlier_extensions_start_where_they_were_found(tmp_path: Path) -> None:
    earlier = fitting("tau0").model_copy(update={"extensions": {"load_gain": 0.01}})
    values = {"load_gain": 0.04, "Q": 12.0, "b": 25.0, "rotation_grain1_x": 0.03,
              "rotation_grain1_y": 0.0, "rotation_grain1_z": -0.02}  # fmt: skip
    causes = (BY_NAME["isotropic_hardening"], BY_NAME["misorientation_grain1"])
    path = tmp_path / "extended.toml"
    write_case(extended(earlier, values, *causes), path)
    assert load_case(path).extensions == values


def test_a_noise_of_the_boundary_is_stated_by_the_extended_case(tmp_path: Path) -> None:
    found = ended({}, BOUNDARY_NOISE, levels={"sigma_e": (4.2e-4, 3e-5)})
    path = tmp_path / "extended.toml"
    write_case(extended_case(fitting("tau0"), found), path)
    case = load_case(path)
    assert case.boundary.jitter_nm == pytest.approx(0.42) and not case.extensions
    assert added_parameters(found) == ()


@pytest.mark.parametrize(("rows", "columns"), [("+X", "+Y"), ("-Y", "+X"), ("+Y", "-X")])
def test_uneven_noise_is_stated_by_the_extended_case_as_its_images_lie(
    rows: Axis, columns: Axis, tmp_path: Path
) -> None:
    problem = closed_form.problem()
    image = closed_form.objective(problem, problem.truth).data.image
    variance = np.random.default_rng(3).uniform(0.5, 2.0, len(image.images.xy))
    seen = SimpleNamespace(data=SimpleNamespace(image=reweighted(image, variance)))
    levels = {"noise_ratio": (1.8, 0.1)}
    found = ended({}, NOISE_NOT_UNIFORM, objective=seen, levels=levels)
    case = fitting("tau0")
    lie = {"rows_along": rows, "columns_along": columns}
    case = case.model_copy(update={"images": case.images.model_copy(update=lie)})
    write_noise_map(case, found, tmp_path / NOISE_MAP)
    assert extended_case(case, found).images.noise_map == NOISE_MAP
    read = arrange(case.images, tifffile.imread(tmp_path / NOISE_MAP)[None])[0]
    assert read.shape == closed_form.SHAPE
    noise = read[image.images.rows, image.images.cols] ** 2
    np.testing.assert_allclose(noise, variance / variance.mean(), rtol=1e-5)


def test_loads_that_were_found_wrong_stay_left_out_of_the_extended_case(tmp_path: Path) -> None:
    stated = fitting("tau0")
    stated = stated.model_copy(
        update={"loads": stated.loads.model_copy(update={"left_out": (2, 9)})}
    )
    wrong = (BadLoad(5, 61.0, 9.8), BadLoad(3, -40.0, -6.4))
    path = tmp_path / "extended.toml"
    write_case(extended_case(stated, ended({}, bad_loads=wrong)), path)
    assert load_case(path).loads.left_out == (2, 3, 5, 9)


def test_what_a_cause_frees_includes_its_companions() -> None:
    found = ended({}, BY_NAME["isotropic_hardening"], BY_NAME["load_gain"])
    assert added_parameters(found) == ("Q", "b", "load_gain")


def test_a_companion_of_two_causes_is_freed_once() -> None:
    found = ended({}, BY_NAME["isotropic_hardening"], BY_NAME["latent_hardening"])
    assert added_parameters(found) == ("Q", "b", "Q_latent")


def test_a_companion_that_is_fitted_already_is_no_extension(tmp_path: Path) -> None:
    """The extended case is read again: it was refused, for b is identified."""
    found = ended({"Q_latent": 6.0, "b": 31.0}, BY_NAME["latent_hardening"], fitted=("b",))
    assert added_parameters(found) == ("Q_latent",)
    path = tmp_path / "extended.toml"
    write_case(extended_case(fitting("tau0", "b"), found), path)
    case = load_case(path)
    assert case.extensions == {"Q_latent": 6.0} and case.material.b == pytest.approx(31.0)


@pytest.mark.parametrize("flip", FLIPS, ids=lambda flip: flip.name)
def test_a_named_flip_turns_the_frame_of_the_extended_case(flip: Cause, tmp_path: Path) -> None:
    given = fitting("tau0")
    rows = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    orientation = given.orientation.model_copy(update={"ebsd_to_specimen": rows})
    case = given.model_copy(update={"orientation": orientation})
    path = tmp_path / "extended.toml"
    write_case(extended(case, {"tau0": 30.0}, flip), path)
    turned = load_case(path)
    assert turned.extensions == {}
    np.testing.assert_allclose(orientations_of(turned), frame_turn((flip,)) @ orientations_of(case))
    assert extended(case, {"tau0": 30.0}).orientation == case.orientation


def test_paths_lead_from_the_results_to_the_files_and_absolute_ones_stay() -> None:
    case = fitting("tau0")
    images = case.images.model_copy(
        update={"frames": "raw/frame_*.tif", "flats": "/data/flats.tif", "mask": "mask.tif"}
    )
    found = extended(case.model_copy(update={"images": images}), {})
    assert found.images.frames == "../raw/frame_*.tif"
    assert found.images.flats == "/data/flats.tif"
    assert (found.images.repeats, found.images.mask) == ("../repeats.tif", "../mask.tif")
    assert found.history.file == "../history.csv"


def test_meshes_of_correlation_and_files_of_a_call_are_found_from_the_results(
    tmp_path: Path,
) -> None:
    for name in ("image.sif", "run"):
        (tmp_path / name).touch()
    call = ("run", "image.sif", "--quiet")
    profile = ProfileTable(command=call, processes=2)
    write_case(fitting("tau0"), tmp_path / "case.toml")
    case = load_case(tmp_path / "case.toml")
    case = case.model_copy(
        update={
            "dic": case.dic.model_copy(update={"mesh": "mine.msh", "height_mesh": "trace"}),
            "solver": case.solver.model_copy(
                update={"profiles": {"code_aster": profile, "calculix": ProfileTable(threads=2)}}
            ),
        }
    )
    found = extended(case, {})
    assert (found.dic.mesh, found.dic.height_mesh) == ("../mine.msh", "trace")
    # `run` has no slash: a program of PATH.
    words = ("run", "../image.sif", "--quiet")
    assert found.solver.profiles["code_aster"] == profile.model_copy(update={"command": words})
    assert found.solver.profiles["calculix"] == ProfileTable(threads=2)


@pytest.mark.parametrize("cause", LIBRARY, ids=list(BY_NAME))
def test_every_cause_can_be_an_extension_of_a_case(cause: Cause, tmp_path: Path) -> None:
    declared = declared_parameters(5)
    freed = (*cause.parameters, *cause.companions)
    values = {name: declared[name].value(0.01, declared[name].null) for name in freed}
    path = tmp_path / "extended.toml"
    write_case(extended(with_123(fitting("tau0")), values, cause), path)
    assert load_case(path).extensions == pytest.approx(values)


@pytest.mark.parametrize("linked", [False, True])
def test_the_extended_case_finds_its_files_where_the_results_are_a_link(
    linked: bool, tmp_path: Path
) -> None:
    here, scratch = tmp_path / "case", tmp_path / "disk" / "scratch"
    here.mkdir()
    scratch.mkdir(parents=True)
    results = here / "results"
    if linked:
        results.symlink_to(scratch)
    else:
        results.mkdir()
    (here / "history.csv").write_text("time_s,load_uN\n")
    write_case(fitting("tau0"), here / "case.toml")
    write_case(extended(load_case(here / "case.toml"), {}), results / "extended.toml")
    found = load_case(results / "extended.toml")
    assert found.path(found.history.file).samefile(here / "history.csv")


@pytest.mark.parametrize(
    ("cause", "values"),
    [
        ("cold_work", {"x0": 2e-4, "d": 3200.0}),
        ("second_back_stress", {"c2": 3e3, "d2": 200.0, "d": 1100.0}),
    ],
)
def test_a_start_whose_bounds_hang_on_the_d_that_was_found_is_accepted(
    cause: str, values: dict[str, float], tmp_path: Path
) -> None:
    path = tmp_path / "extended.toml"
    case = fitting("tau0", "c", "d")
    write_case(extended(case, values, BY_NAME[cause]), path)
    found = load_case(path)
    bounds = {p.name: p for p in declarations_at(found.material.to_material())}
    for name, value in found.extensions.items():
        assert value == min(values[name], bounds[name].upper)


def test_a_file_beside_the_folder_of_a_linked_case_is_found_from_linked_results(
    tmp_path: Path,
) -> None:
    """`../data` of a case that is reached by a link is beside what the link leads to."""
    there, scratch = tmp_path / "deep" / "case", tmp_path / "scratch"
    there.mkdir(parents=True)
    scratch.mkdir()
    (tmp_path / "deep" / "data").mkdir()
    (tmp_path / "deep" / "data" / "history.csv").write_text("time_s,load_uN\n")
    (there / "results").symlink_to(scratch)
    (tmp_path / "short").symlink_to(there)
    case = fitting("tau0")
    history = case.history.model_copy(update={"file": "../data/history.csv"})
    write_case(case.model_copy(update={"history": history}), there / "case.toml")
    path = tmp_path / "short" / "results" / "extended.toml"
    write_case(extended(load_case(tmp_path / "short" / "case.toml"), {}), path)
    found = load_case(path)
    assert found.path(found.history.file).is_file()
