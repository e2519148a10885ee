from __future__ import annotations

import os
from pathlib import Path

import pytest

from driver.case.model import Case, load_case
from driver.common.errors import InputError
from driver.experiment.reading import Experiment, read_experiment
from driver.forward import build
from driver.results.files import RESULTS
from driver.workflow.engine import StageContext, run_stages
from driver.workflow.pipeline import stages
from driver.workflow.prepared_images import prepared_images
from tools import closed_form


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A case file with its images."""
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver())
    closed_form.write_files(tmp_path, {})
    return tmp_path / "case.toml"


def test_images_are_read_and_corrected_once_a_run(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[Case] = []

    def counted(case: Case) -> Experiment:
        reads.append(case)
        return read_experiment(case)

    monkeypatch.setattr("driver.workflow.prepared_images.read_experiment", counted)
    case = load_case(path)
    run_stages(case, stages(case), "identify")
    assert len(reads) == 1


def test_files_that_changed_between_two_stages_of_a_run_end_it(path: Path) -> None:
    case, results = load_case(path), path.parent / RESULTS
    context = StageContext(case, results, results)
    first = prepared_images(context)
    assert prepared_images(context) is first
    history = case.path(case.history.file)
    os.utime(history, ns=(1, 1))
    with pytest.raises(InputError, match="history.csv: file: found another content than this run"):
        prepared_images(context)
