"""What stands in the tables of the report."""

from __future__ import annotations

from driver.diagnosis.answer.result_types import Corrected
from driver.report.tables import Row, less_corrected


def refitted(corrected: Corrected | None) -> Row:
    return {"refit": None if corrected is None else {"corrected": corrected}}


def test_those_are_less_corrected_whose_correction_is_farther_off_than_that_of_the_winner() -> None:
    causes = [
        refitted("at its end"),
        refitted("at its end, on the second mesh"),
        refitted("at a look"),
        refitted("at the baseline"),
        refitted(None),
    ]
    assert less_corrected(causes, causes[0]) == [2, 3]
    assert less_corrected(causes, causes[1]) == [0, 2, 3]
    assert less_corrected(causes, causes[3]) == less_corrected(causes, causes[4]) == []
