"""Decks stay as they are, or a line of CHANGES says why they changed."""

from __future__ import annotations

import pytest

from tests.templates.golden_decks import (
    CASES,
    DECKS,
    GOLDEN,
    digest,
    last_change,
    rendered,
    stored,
)

PAIRS = [(name, case) for name, (_, cases) in GOLDEN.items() for case in cases]


@pytest.mark.parametrize(("name", "case"), PAIRS)
def test_a_deck_is_its_golden_one(name: str, case: str) -> None:
    assert rendered(GOLDEN[name][0], case) == stored(name, case)


@pytest.mark.parametrize("name", GOLDEN)
def test_every_golden_deck_belongs_to_a_case(name: str) -> None:
    folders = {path.name for path in (DECKS / name).iterdir() if path.is_dir()}
    assert folders == set(GOLDEN[name][1])


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_decks_change_only_together_with_a_line_that_says_why(name: str) -> None:
    found, sentence = last_change(name)
    assert found == digest(name), f"add to CHANGES: {digest(name)} and a sentence"
    assert len(sentence.split()) > 2


@pytest.mark.parametrize("name", GOLDEN)
def test_every_case_has_a_deck_of_its_own(name: str) -> None:
    decks = [tuple(stored(name, case).items()) for case in GOLDEN[name][1]]
    assert len(set(decks)) == len(decks)


def test_no_golden_deck_holds_a_header_of_provenance() -> None:
    for name, case in PAIRS:
        assert all("provenance" not in text for text in stored(name, case).values())
        assert any(b"provenance" in text for text in GOLDEN[name][0].write(CASES[case]).values())
