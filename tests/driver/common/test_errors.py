from __future__ import annotations

from driver.common.errors import one_of, why


def test_a_misspelt_name_is_told_what_it_may_have_meant() -> None:
    known = ("grain_contrast", "load_gain", "load_lag")
    told = one_of("graincontrast", known)
    assert told == "grain_contrast, or another of the 3 names in the documentation"


def test_a_name_like_none_is_told_all() -> None:
    assert one_of("magic", ("load_gain", "load_lag")) == "one of load_gain, load_lag"


def test_what_a_library_said_stands_in_one_line() -> None:
    assert why(ValueError("two\n lines")) == "“two lines”"
    assert why(FileNotFoundError(2, "No such file", "a.toml")) == "“No such file”"
    assert why(SystemExit()) == "“SystemExit”"
