"""The stages that draw: what draws is imported as one of them begins.

Its import takes a second, with matplotlib, which processes of the other stages need not wait for.
"""

from __future__ import annotations

from pathlib import Path

from driver.workflow.engine import StageContext


def run_measure(context: StageContext) -> None:
    """Do what `measure_stage` does."""
    from driver.workflow import measure_stage

    measure_stage.run_measure(context)


def run_advise(context: StageContext) -> None:
    """Do what `advise_stage` does."""
    from driver.workflow import advise_stage

    advise_stage.run_advise(context)


def run_report(context: StageContext, vectors: Path | None = None) -> None:
    """Do what `report_stage` does for a case that is diagnosed."""
    from driver.workflow import report_stage

    report_stage.run_report(context, vectors)


def run_report_identified(context: StageContext, vectors: Path | None = None) -> None:
    """Do what `report_stage` does for a case that is identified and not diagnosed."""
    from driver.workflow import report_stage

    report_stage.run_report_identified(context, vectors)


def run_report_loads(context: StageContext, vectors: Path | None = None) -> None:
    """Do what `report_loads_stage` does."""
    from driver.workflow import report_loads_stage

    report_loads_stage.run_report_loads(context, vectors)
