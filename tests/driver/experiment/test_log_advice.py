"""Units that the names of columns state."""

from __future__ import annotations

import pytest

from driver.experiment.log_advice import unit_in


@pytest.mark.parametrize(
    ("name", "kind", "unit"),
    [
        ("Time [min]", "time", "min"), ("t/s", "time", "s"), ("time_s", "time", "s"),
        ("Time (Sec)", "time", "s"), ("Time <h> ", "time", "h"), ("Time", "time", None),
        ("Travel [μm]", "stage", "µm"), ("Displ., mm", "stage", "mm"), ("stage", "stage", None),
        ("Stage [V]", "stage", None), ("Load 1 kN", "force", "kN"), ("F_mN", "force", "mN"),
        ("Load cell (MN)", "force", None), ("image_s", "image", None),
    ],
)  # fmt: skip
def test_a_unit_stands_in_brackets_or_as_the_last_word(
    name: str, kind: str, unit: str | None
) -> None:
    assert unit_in(name, kind) == unit
