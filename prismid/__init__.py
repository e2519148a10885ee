"""The Python face of prismid: the verbs of the command line, and correlation of plain arrays.

What it offers is loaded when it is asked for: the command line begins here, too.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_MODULES = {
    "Case": "driver.case.model",
    "Correlation": "driver.dic.correlation",
    "Finding": "driver.check.check_result",
    "InputError": "driver.common.errors",
    "SolverError": "solver_adapters.interface",
    "check": "driver.check.command",
    "correlate": "driver.dic.correlation",
    "default_case": "driver.case.model",
    "export_case": "driver.export.command",
    "load_case": "driver.case.model",
    "progress_to": "driver.common.progress",
    "read_hdf5": "driver.results.hdf5",
    "report": "driver.workflow.pipeline",
    "results_of": "driver.results.files",
    "run": "driver.workflow.pipeline",
    "write_case": "driver.case.model",
}


def __getattr__(name: str) -> Any:
    """Load the module of a name that is offered."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
