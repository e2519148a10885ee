import errno
import json
import logging
import re
import shutil
import signal
import sys
from pathlib import Path
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import driver
import driver.export.command
import driver.workflow
from driver.case.model import CaseError, default_case, load_case
from driver.cli import app
from driver.common.errors import InputError
from driver.doubts.finding import Finding
from driver.doubts.magnitudes import youngs_modulus
from driver.terminal import exit_codes
from solver_adapters import kernels
from solver_adapters.crystal import BCC48, FCC
from solver_adapters.interface import PreparedError, SolverError
from tests.driver.ebsd_files import FIRST, grid, write_ang, write_ctf

logger = logging.getLogger("driver.workflow")


@pytest.fixture
def pipeline(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A pipeline that keeps what it was called with."""
    calls: list[tuple[object, ...]] = []

    def run(
        case_path: Path,
        until: str | None,
        force: bool,
        prepare_only: bool,
        processes: int | None,
        threads: int | None,
        store: Path | None,
        results: Path | None,
    ) -> None:
        load_case(case_path)
        calls.append(("run", case_path, until, force, processes, threads, store, results))
        if prepare_only:
            raise PreparedError([case_path.parent / "results" / "jobs" / "key"])
        logger.info("mesh: started")

    def export(
        case_path: Path, folder: Path, volume: bool, med: bool, results: Path | None
    ) -> None:
        calls.append(("export", case_path, folder, volume, med, results))

    fake = SimpleNamespace(
        calls=calls,
        run=run,
        report=lambda *arguments: calls.append(("report", *arguments)),
    )
    monkeypatch.setitem(sys.modules, "driver.workflow.pipeline", fake)
    monkeypatch.setattr(driver.workflow, "pipeline", fake, raising=False)
    monkeypatch.setattr("driver.export.command.export_case", export)
    return fake


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def case_path(tmp_path: Path) -> Path:
    assert invoke("init", tmp_path / "a").exit_code == 0
    return tmp_path / "a" / "case.toml"


def test_init_states_the_frame_of_the_map_and_asks_how_it_lies(tmp_path: Path) -> None:
    x, y = grid(4, 6)
    for write, ending, frame in ((write_ang, "ang", "edax"), (write_ctf, "ctf", "oxford")):
        folder = tmp_path / ending
        folder.mkdir()
        write(folder / f"map.{ending}", x, y, FIRST)
        assert invoke("init", folder, "--ebsd", f"map.{ending}").exit_code == 0
        orientation = load_case(folder / "case.toml").orientation
        assert orientation.ebsd_frame == frame and orientation.rotation[2, 2] == -1.0
        before = (folder / "case.toml").read_text("utf-8").split("ebsd_to_specimen = ")[0]
        assert "# State how the map lies: " in before.split("[orientation]")[1]
        assert "a map of the face with x along +Y and y along +X." in before
    assert invoke("init", tmp_path / "none", "--ebsd", "map.ang").exit_code == 0
    assert load_case(tmp_path / "none" / "case.toml").orientation.ebsd_frame is None
    assert invoke("init", tmp_path / "angles").exit_code == 0
    text = (tmp_path / "angles" / "case.toml").read_text("utf-8")
    assert "State how the map lies" not in text


def test_init_names_the_files_of_instruments_an_ebsd_map_and_a_log(tmp_path: Path) -> None:
    named = ("--frames", "scan_*.sur", "--repeats", "rest_*.sur", "--history", "log.csv")
    assert invoke("init", tmp_path, *named, "--ebsd", "map.ang").exit_code == 0
    case = load_case(tmp_path / "case.toml")
    assert (case.images.frames, case.images.repeats, case.images.flats) == (*named[1:4:2], None)
    # Heights of instruments are lengths.
    assert (case.images.height_per_level_nm, case.images.off_surface_level) == (1.0, "none")
    assert case.history.file == "log.csv" and [g.ebsd for g in case.grains] == ["map.ang"] * 2
    empty = invoke("init", tmp_path / "b", "--ebsd", "")
    assert empty.exit_code == 1 and not (tmp_path / "b").exists()
    assert empty.stderr.strip().endswith("--ebsd: found nothing, expected the name of a file")


def test_init_leaves_repeats_out_where_the_noise_is_stated(tmp_path: Path) -> None:
    assert invoke("init", tmp_path, "--frames", "scan_*.sur", "--noise-nm", "4.5").exit_code == 0
    images = load_case(tmp_path / "case.toml").images
    assert (images.frames, images.repeats, images.noise_nm) == ("scan_*.sur", None, 4.5)
    named = ("--repeats", "rest_*.sur", "--noise-nm", "4.5")
    assert invoke("init", tmp_path / "a", *named).exit_code == 0
    images = load_case(tmp_path / "a" / "case.toml").images
    assert (images.repeats, images.noise_nm) == ("rest_*.sur", 4.5)
    for bad in ("0", "inf", "nan"):
        refused = invoke("init", tmp_path / "b", "--noise-nm", bad)
        assert refused.exit_code == 1 and not (tmp_path / "b").exists()
        assert refused.stderr.strip().endswith(f"--noise-nm: found {bad}, expected a number > 0")


def test_init_writes_a_valid_case_and_its_schema_and_overwrites_nothing(case_path: Path) -> None:
    assert len(load_case(case_path).grains) == 2
    assert (case_path.parent / "case.schema.json").is_file()
    case_path.write_text("mine")
    again = invoke("init", case_path.parent)
    assert again.exit_code == 1 and "it is not overwritten" in again.stderr
    assert case_path.read_text() == "mine"


@pytest.mark.parametrize("before", [False, True])
def test_the_first_use_says_that_kernels_are_compiled(
    before: bool, pipeline: SimpleNamespace, case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernels, "compiled_before", lambda: before)
    result = invoke("run", case_path)
    assert ("kernels are compiled" in result.stdout) is not before


def test_run_takes_a_case_or_its_folder_and_hands_on_the_options(
    pipeline: SimpleNamespace, case_path: Path
) -> None:
    options = (
        "--until", "measure", "--force", "--processes", 3, "--threads", 2, "--store", "jobs",
        "--results", "there",
    )  # fmt: skip
    result = invoke("run", case_path.parent, *options)
    assert result.exit_code == 0 and result.stdout.rstrip().endswith("s  mesh: started")
    assert pipeline.calls == [
        ("run", case_path, "measure", True, 3, 2, Path("jobs"), Path("there"))
    ]


def test_a_bad_case_is_one_line_on_standard_error_and_the_others_are_run(
    pipeline: SimpleNamespace, case_path: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(case_path.read_text("utf-8").replace("refit = 5", "refit = 0"), "utf-8")
    result = invoke("run", bad, case_path)
    assert result.exit_code == 1
    assert result.stderr == (
        f"prismid: {bad}: diagnosis.refit: found 0, expected a number ≥ 1 "
        "(number of causes refitted nonlinearly)\n"
    )
    assert pipeline.calls == [("run", case_path, None, False, None, None, None, None)]
    assert f"{case_path}: mesh: started" in result.stdout


def test_control_characters_of_a_file_never_reach_the_terminal(tmp_path: Path) -> None:
    assert invoke("init", tmp_path).exit_code == 0
    case = tmp_path / "case.toml"
    keys = '\n[extensions]\n"\\u001b[2J" = 1.0\n'
    case.write_text(case.read_text("utf-8").replace("\n[extensions]\n", keys), "utf-8")
    found = invoke("run", tmp_path)
    assert found.exit_code == 1 and "\x1b" not in found.stderr and r"\x1b[2J" in found.stderr


def test_prepared_jobs_are_listed_and_are_no_failure_and_the_other_cases_are_run(
    pipeline: SimpleNamespace, case_path: Path, tmp_path: Path
) -> None:
    assert invoke("init", tmp_path / "b").exit_code == 0
    other = tmp_path / "b" / "case.toml"
    result = invoke("run", case_path, other, "--prepare-only")
    assert result.exit_code == 0 and result.stderr == ""
    for path in (case_path, other):
        assert f"{path}: 1 job(s) are ready to be computed elsewhere" in result.stdout
        assert f"\n  {path.parent / 'results' / 'jobs' / 'key'}\n" in result.stdout


def test_what_is_wrong_with_one_of_several_cases_is_told_with_its_name(
    pipeline: SimpleNamespace, case_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, *asked: object) -> None:
        if path == case_path:
            raise InputError("images: found none, expected some\nloads: found none, expected some")
        pipeline.calls.append(path)

    assert invoke("init", tmp_path / "b").exit_code == 0
    other = tmp_path / "b" / "case.toml"
    monkeypatch.setattr(pipeline, "run", refuse)
    result = invoke("run", case_path, other)
    assert result.exit_code == 1 and pipeline.calls == [other]
    assert result.stderr.splitlines() == [
        f"prismid: {case_path}: images: found none, expected some",
        f"prismid: {case_path}: loads: found none, expected some",
    ]


def test_what_the_system_refuses_is_a_sentence_with_the_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = invoke("init", tmp_path / "file" / "case")
    assert result.exit_code == 1
    assert result.stderr == (
        f"prismid: {tmp_path / 'file' / 'case'}: file: found “Not a directory” of the system, "
        "expected one that can be read and written here\n"
    )


@pytest.mark.parametrize(
    ("free", "where"),
    [(3e6, " and none left in {}"), (5e6, ""), (None, "")],
    ids=["full", "not full", "gone"],
)
def test_a_full_disk_that_names_no_file_is_a_sentence_with_the_folder_that_is_full(
    free: float | None, where: str, pipeline: SimpleNamespace, case_path: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def full(*asked: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def usage(folder: Path) -> SimpleNamespace:
        if folder == tmp_path / "cache" and free is None:
            raise FileNotFoundError(folder)
        return SimpleNamespace(free=free if folder == tmp_path / "cache" else 1e12)

    monkeypatch.setattr(pipeline, "run", full)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(shutil, "disk_usage", usage)
    found = invoke("run", case_path)
    told = "disk: found “No space left on device” of the system" + where.format(tmp_path / "cache")
    expected = f"prismid: {told}, expected free space: run again to go on\n"
    assert (found.exit_code, found.stderr) == (1, expected)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("ignored", [True, False])
def test_the_end_of_a_terminal_or_of_a_batch_job_stops_a_run_as_ctrl_c_does(
    pipeline: SimpleNamespace,
    case_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    how: signal.Signals,
    ignored: bool,
) -> None:
    """What ignores the end of its terminal (nohup) goes on."""
    monkeypatch.setattr(pipeline, "run", lambda *arguments: signal.raise_signal(how))
    usual = signal.default_int_handler if how == signal.SIGINT else signal.SIG_DFL
    before = signal.signal(how, signal.SIG_IGN if ignored else usual)
    try:
        found = invoke("run", case_path)
    finally:
        signal.signal(how, before)
    told = "prismid: stopped; finished stages are kept, run again to go on\n"
    assert (found.exit_code, found.stderr) == ((0, "") if ignored else (130, told))


@pytest.mark.parametrize("error", [SolverError, CaseError, FileNotFoundError])
def test_an_expected_error_shows_no_traceback(
    pipeline: SimpleNamespace, case_path: Path, error: type[Exception]
) -> None:
    def failing(*arguments: object) -> None:
        raise error("what went wrong")

    pipeline.report = failing
    result = invoke("report", case_path)
    assert (result.exit_code, result.stderr) == (1, "prismid: what went wrong\n")


def test_a_fault_in_one_case_is_told_and_kept_and_the_other_cases_are_run(
    pipeline: SimpleNamespace, case_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def faulty(path: Path, *asked: object) -> None:
        pipeline.calls.append(path)
        if path == case_path:
            raise KeyError("a bug")

    assert invoke("init", tmp_path / "b").exit_code == 0
    (case_path.parent / "results").mkdir()
    other = tmp_path / "b" / "case.toml"
    monkeypatch.setattr(pipeline, "run", faulty)
    result = invoke("run", case_path, other)
    assert result.exit_code == 3 and pipeline.calls == [case_path, other]
    kept = case_path.parent / "results" / "fault.log"
    assert result.stderr == (
        f"prismid: {case_path}: a fault of prismid has ended it (KeyError: 'a bug'); please report "
        f"it with the traceback in {kept}\n"
    )
    assert "Traceback" in kept.read_text() and "in faulty" in kept.read_text()
    assert result.stdout.splitlines()[-1] == f"{case_path} fault, {other} done"


def test_a_stop_that_a_callback_or_a_library_swallows_ends_the_run_all_the_same(
    pipeline: SimpleNamespace, case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Swallows:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGTERM)

    went_on: list[str] = []

    def in_a_callback(*asked: object) -> None:
        Swallows()
        sleep(30)
        went_on.append("callback")

    def in_a_library(*asked: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except BaseException:
            logger.info("a library goes on")
            went_on.append("library")

    def at_the_end(*asked: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except BaseException:
            pass

    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        for run in (in_a_callback, in_a_library, at_the_end):
            monkeypatch.setattr(pipeline, "run", run)
            found = invoke("run", case_path)
            assert (found.exit_code, found.stderr.count("\n")) == (130, 1), run
    finally:
        signal.signal(signal.SIGTERM, before)
    assert went_on == []


def test_a_mistake_of_the_program_is_not_hidden(pipeline: SimpleNamespace, case_path: Path) -> None:
    def failing(*arguments: object) -> None:
        raise KeyError("a bug")

    pipeline.report = failing
    assert isinstance(invoke("report", case_path).exception, KeyError)


def test_report_and_export_find_their_case(
    pipeline: SimpleNamespace, case_path: Path, tmp_path: Path
) -> None:
    assert invoke("report", case_path.parent).exit_code == 0
    assert invoke("report", case_path, "--figures", tmp_path / "drawn").exit_code == 0
    assert invoke("export", case_path).exit_code == 0
    there = tmp_path / "there"
    assert invoke("export", case_path, "--to", there, "--no-volume", "--med").exit_code == 0
    assert pipeline.calls == [
        ("report", case_path, None, None),
        ("report", case_path, None, tmp_path / "drawn"),
        ("export", case_path, case_path.parent / "results" / "export", True, False, None),
        ("export", case_path, there, False, True, None),
    ]


def test_virtual_and_noise_floor_hand_on_their_options(
    case_path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls = []
    monkeypatch.setattr("driver.virtual.command.virtual", lambda *given: calls.append(given[:4]))
    monkeypatch.setattr(
        "driver.noise_floor.command.noise_floor", lambda *given: calls.append(given[:1])
    )
    there, settings = tmp_path / "there", tmp_path / "settings.toml"
    assert invoke("virtual", case_path, "--to", there).exit_code == 0
    options = ("--to", there, "--settings", settings, "--seed", 7)
    assert invoke("virtual", case_path.parent, *options).exit_code == 0
    assert invoke("noise-floor", case_path.parent).exit_code == 0
    assert calls == [
        (case_path, None, there, 0),
        (case_path, settings, there, 7),
        (case_path,),
    ]


def test_check_prints_each_finding_and_fails_on_an_error(
    case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    findings = [Finding("ok", "case", "valid"), Finding("warning", "images", "no flats")]
    monkeypatch.setattr("driver.check.command.check", lambda path, results: findings)
    good = invoke("check", case_path)
    assert good.exit_code == 0
    assert good.stdout.splitlines() == ["ok      case: valid", "WARNING images: no flats"]
    findings.append(Finding("error", "solver", "none"))
    bad = invoke("check", case_path)
    assert bad.exit_code == 1 and bad.stdout.splitlines()[-1] == "ERROR   solver: none"


def test_answers_for_programs_are_one_object_and_all_else_is_on_standard_error(
    pipeline: SimpleNamespace, case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    findings = [Finding("ok", "case", "valid"), Finding("error", "solver", "none")]
    monkeypatch.setattr("driver.check.command.check", lambda path, results: findings)
    checked = invoke("check", case_path, "--json")
    assert checked.exit_code == 1
    answer = json.loads(checked.stdout)
    assert answer.keys() == {"prismid", "case", "good", "findings"} and not answer["good"]
    assert answer["findings"][1] == {"level": "error", "subject": "solver", "message": "none"}

    bad = case_path.with_name("bad.toml")
    bad.write_text("", "utf-8")
    ran = invoke("run", case_path, bad, "--json")
    assert ran.exit_code == 1 and "mesh: started" in ran.stderr
    good, refused = json.loads(ran.stdout)["cases"]
    results = str(case_path.parent / "results")
    assert good == {"case": str(case_path), "results": results, "status": "done", "messages": []}
    assert refused["status"] == "failed" and "grains" in refused["messages"][0]


def test_results_elsewhere_are_of_one_case(pipeline: SimpleNamespace, case_path: Path) -> None:
    found = invoke("run", case_path, case_path, "--results", "there")
    assert found.exit_code == 2 and pipeline.calls == []


@pytest.mark.parametrize("verb", ["run", "verify"])
def test_a_stage_that_there_is_not_is_no_value_of_an_option(
    pipeline: SimpleNamespace, case_path: Path, verb: str
) -> None:
    found = invoke(verb, case_path, "--until", "mash")
    assert found.exit_code == 2 and pipeline.calls == []
    assert 'found "mash", expected one of mesh, measure' in found.output


@pytest.mark.parametrize("verb", [(), ("run",), ("cache", "list")])
def test_help_has_a_short_name(verb: tuple[str, ...]) -> None:
    assert invoke(*verb, "-h").exit_code == 0
    assert invoke(*verb, "-h").stdout == invoke(*verb, "--help").stdout


def test_the_codes_are_those_of_the_documentation() -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "terminal.md"
    listed = re.findall(r"^\| (\d+) \|", page.read_text("utf-8"), re.MULTILINE)
    codes = (exit_codes.DONE, exit_codes.FAILED, exit_codes.USAGE, exit_codes.FAULT)
    assert [int(code) for code in listed] == [*codes, exit_codes.STOPPED]
    assert invoke("no-such-verb").exit_code == exit_codes.USAGE


def test_a_hint_quotes_a_path_with_spaces_and_umlauts(tmp_path: Path) -> None:
    folder = tmp_path / "zweiter Prüfling"
    found = invoke("init", folder)
    assert found.stdout.endswith(f"then `prismid check '{folder / 'case.toml'}'`\n")
    status = invoke("status", folder)
    assert status.exit_code == 0 and status.stdout.count("missing") == 6


def test_the_version_is_that_of_the_distribution(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("driver.cli.version", lambda name: {"prismid": "3.2.1"}[name])
    assert invoke("--version").stdout == "prismid 3.2.1\n"


def test_init_writes_a_case_of_the_crystal_and_shape_that_are_asked_for(tmp_path: Path) -> None:
    """Young's moduli of copper along ⟨100⟩ and ⟨111⟩: 67 and 191 GPa (Simmons and Wang, 1971)."""
    found = CliRunner().invoke(app, ["init", str(tmp_path), "--crystal", "fcc", "--shape", "bar"])
    assert found.exit_code == 0
    material = load_case(tmp_path / "case.toml").material.to_material()
    assert material.slip_systems == FCC
    assert load_case(tmp_path / "case.toml").specimen.area == 16.0
    stiffness = material.C11, material.C12, material.C44
    along = [np.array([1.0, 0.0, 0.0]), np.ones(3) / np.sqrt(3)]
    moduli = [youngs_modulus(direction, *stiffness) for direction in along]
    assert moduli == pytest.approx([66.7e3, 191.1e3], rel=3e-3)


def test_init_writes_a_bcc_steel_with_the_slip_planes_123(tmp_path: Path) -> None:
    found = CliRunner().invoke(app, ["init", str(tmp_path), "--crystal", "bcc48"])
    assert found.exit_code == 0
    case = load_case(tmp_path / "case.toml")
    assert case.material.to_material().slip_systems == BCC48
    without = case.with_values_at({"material.slip_systems": "bcc"})
    assert without.model_dump() == default_case().model_dump()


def test_init_overwrites_neither_a_case_nor_a_schema(tmp_path: Path) -> None:
    for name in ("case.toml", "case.schema.json"):
        folder = tmp_path / name.replace(".", "_")
        folder.mkdir()
        (folder / name).write_text("mine", encoding="utf-8")
        found = CliRunner().invoke(app, ["init", str(folder)])
        assert found.exit_code == 1 and name in found.output
        assert [file.name for file in folder.iterdir()] == [name]
        assert (folder / name).read_text(encoding="utf-8") == "mine"


def test_a_report_without_results_is_refused_and_simulates_nothing(tmp_path: Path) -> None:
    CliRunner().invoke(app, ["init", str(tmp_path / "new")])
    found = CliRunner().invoke(app, ["report", str(tmp_path / "new")])
    assert found.exit_code == 1 and "diagnosis.json" in found.output
    assert not (tmp_path / "new" / "results").exists()


def test_a_report_of_results_of_another_state_of_the_case_is_refused(tmp_path: Path) -> None:
    CliRunner().invoke(app, ["init", str(tmp_path)])
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "diagnosis.json").write_text("{}")
    found = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert found.exit_code == 1 and "stage mesh: found no results" in found.output
    assert found.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [("init", ""), ("check", ""), ("run", "a", ""), ("export", "a", "--to", ""),
     ("virtual", "a", "--to", "b", "--settings", "")],
)  # fmt: skip
def test_an_empty_path_is_not_the_folder_of_the_call(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = invoke(*arguments)
    assert found.exit_code == 2 and 'found "", expected the name of' in found.output
    assert not list(tmp_path.iterdir())
