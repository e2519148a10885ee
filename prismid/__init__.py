"""The Python face of prismid: the verbs of the command line, and correlation of plain arrays."""

from driver.case.model import Case, default_case, load_case, write_case
from driver.check.check_result import Finding
from driver.check.command import check
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.dic.correlation import Correlation, correlate
from driver.export.command import export_case
from driver.results.files import results_of
from driver.results.hdf5 import read_hdf5
from driver.workflow.pipeline import report, run
from solver_adapters.interface import SolverError

__all__ = [
    "Case",
    "Correlation",
    "Finding",
    "InputError",
    "SolverError",
    "check",
    "correlate",
    "default_case",
    "export_case",
    "load_case",
    "progress_to",
    "read_hdf5",
    "report",
    "results_of",
    "run",
    "write_case",
]
