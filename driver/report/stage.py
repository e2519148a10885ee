"""Stage 5: the report page."""

from driver.stages import StageContext


def run_report(context: StageContext) -> None:
    """Write the page."""
    raise FileNotFoundError(context.results)
