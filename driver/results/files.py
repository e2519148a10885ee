"""Names of the files of a run's results."""

from __future__ import annotations

from pathlib import Path

from driver.case.model import Case
from driver.common.errors import InputError, sentence, why

RESULTS = "results"
"""The folder of the results, beside the case."""
STAGES = "stages.json"
MESH, FINE_MESH = "mesh.med", "mesh_fine.med"
MEASURE, MEASURE_CSV = "measure.h5", "measure.csv"
IDENTIFY, IDENTIFY_CSV, HISTORY_JSON = "identify.h5", "identify.csv", "identify_history.json"
DIAGNOSIS, DIAGNOSIS_H5 = "diagnosis.json", "diagnosis.h5"
ADVICE = "advice.json"
EXTENDED, NOISE_MAP = "extended.toml", "noise_map.tif"
DECKS, JOBS = "extended_decks", "jobs"
REPORT = "report.html"


def results_of(case: Case) -> Path:
    """Return the folder of the results of a case, which stands beside its file."""
    return case.file.parent / RESULTS


def make_folder(results: Path) -> None:
    """Make the folder of the results, where there is none yet.

    Raises:
        InputError: there is something else, or it cannot be made.
    """
    if results.is_symlink() and not results.exists():
        target = f"a link to {results.readlink()}, which is not there"
        raise InputError(sentence(results, "folder", target, "a folder, or a link to one"))
    try:
        results.mkdir(exist_ok=True)
    except OSError as error:
        expected = "a folder that can be made and written"
        raise InputError(sentence(results, "folder", why(error), expected)) from None


class AbsentError(InputError):
    """A result of an earlier stage that is not there."""


def present(results: Path, name: str) -> Path:
    """Return the file of a result of an earlier stage.

    Raises:
        AbsentError: there is no such file.
    """
    path = results / name
    if not path.is_file():
        raise AbsentError(f"{path}: found nothing, expected the result of an earlier stage")
    return path
