from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from driver.common.errors import InputError
from driver.virtual.settings import Virtual, read_virtual

DOCS = Path(__file__).resolve().parents[3] / "docs" / "virtual.md"


def test_an_empty_file_is_the_default(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    path.write_text("", encoding="utf-8")
    assert read_virtual(path) == Virtual()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[face]\ndots = 3", "face.dots: found an unknown key with the value 3, expected one of"),
        ("[microscope]\nbits = 12", "microscope.bits: found 12, expected 8, 16 or 32"),
        ("[microscope]\nnoise_nm = -1.0", "microscope.noise_nm: found -1.0, expected a number ≥ 0"),
        ("[program]\ncycles = [[0, 1]]", "program.cycles"),
        ("[microscope\n", "expected a TOML file"),
    ],
)
def test_a_wrong_setting_is_one_sentence_about_its_key(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "settings.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_virtual(path)
    assert message in str(raised.value) and "\n" not in str(raised.value)


def test_an_absent_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found nothing, expected the settings"):
        read_virtual(tmp_path / "none.toml")


def test_every_setting_is_documented_with_its_default_and_no_other() -> None:
    text = DOCS.read_text(encoding="utf-8")
    found = {
        (table, key): default
        for table, key, default in re.findall(r"^\| `(\w+)` \| `(\w+)` \| (.*?) \|", text, re.M)
    }
    expected = {
        (table, key): "—" if value is None else json.dumps(value)
        for table, keys in Virtual().model_dump(mode="json", exclude={"truth"}).items()
        for key, value in keys.items()
    }
    assert found == expected
