"""The table of faults in the documentation says what its tests try, and no more."""

from __future__ import annotations

from tests.reliability.test_faults import ONE_AFTER_THE_OTHER
from tools.fault_table import DOCS, FAULTS, LEFT_OUT, PHASES, pairs, table, written


def test_the_documented_table_is_that_of_the_pairs_that_are_tested() -> None:
    tested = [*ONE_AFTER_THE_OTHER, ("kill solver", "identify")]
    assert sorted(tested) == sorted(pairs())
    assert written(DOCS.read_text("utf-8")) == table(tested)


def test_what_is_not_tested_has_a_dash_and_a_reason() -> None:
    rows = table(pairs()).splitlines()
    assert len(rows) == len(FAULTS) + 4
    for row, fault in zip(rows[2:], FAULTS, strict=False):
        left = len(LEFT_OUT.get(fault, (frozenset[str](), ""))[0])
        assert row.count("—") == left and row.count("yes") == len(PHASES) - left
    assert all(reason in rows[-1] for _, reason in LEFT_OUT.values())


def test_a_pair_that_did_not_hold_is_told() -> None:
    held = [pair for pair in pairs() if pair != ("kill", "mesh")]
    assert table(held).count("**no**") == 1
