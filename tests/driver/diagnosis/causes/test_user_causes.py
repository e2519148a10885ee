from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from driver.case.model import Case, load_case, write_case
from driver.check.command import check
from driver.common.errors import InputError
from driver.design.command import design
from driver.design.settings import Settings as DesignSettings
from driver.design.settings import read_change
from driver.design.variants import base_variant, variant
from driver.diagnosis.causes.all_causes import NAMES
from driver.diagnosis.causes.candidates import causes_of, not_examined
from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.diagnosis.causes.user_causes import asked_causes, read_causes, user_causes
from driver.parameters.registry import declared_parameters
from driver.workflow.pipeline import run
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

PAGE = Path(__file__).resolve().parents[4] / "docs" / "method" / "diagnosis.md"
TWISTED = Cause(
    name="twisted_grip",
    category="boundary",
    parameters=("end_rotation", "end_shear"),
    sentence="the grip is mounted askew",
    check="a photograph of the grip",
)


def written(path: Path, **changes: object) -> Path:
    """A file with the cause `TWISTED`, or with other values of its keys."""
    table = {
        "name": TWISTED.name, "category": TWISTED.category, "parameters": [*TWISTED.parameters],
        "sentence": TWISTED.sentence, "check": TWISTED.check,
    } | changes  # fmt: skip
    lines = [f"{key} = {_toml(value)}" for key, value in table.items() if value is not None]
    path.write_text("\n".join(["[[causes]]", *lines]), encoding="utf-8")
    return path


def _toml(value: object) -> str:
    return json.dumps(value)  # lists, texts and booleans are written alike in TOML


def case_with(folder: Path, *names: str) -> Case:
    case = closed_form.small_case()
    table = case.diagnosis.model_copy(
        update={"cause_files": tuple(str(folder / name) for name in names)}
    )
    return case.model_copy(update={"diagnosis": table})


def test_the_example_of_the_documentation_is_a_cause(tmp_path: Path) -> None:
    section = PAGE.read_text("utf-8").partition("\n## Causes of your own\n")[2]
    (example,) = re.findall(r"```toml\n(.*?)```", section.partition("\n## ")[0], re.S)
    (tmp_path / "my.toml").write_text(example, encoding="utf-8")
    (cause,) = read_causes(tmp_path / "my.toml")
    assert (cause.name, cause.category) == ("work_hardened_skin", "material")
    assert (cause.parameters, cause.companions) == (("skin_tau0", "x0"), ("skin_thickness",))
    assert not cause.one_sided and cause.sentence and cause.check
    # It is tried as those of the library are.
    every = frozenset(declared_parameters(5))
    assert causes_of(every, (), None, (cause,)) == (*LIBRARY, cause)


def test_causes_of_all_files_are_read(tmp_path: Path) -> None:
    written(tmp_path / "a.toml")
    written(tmp_path / "b.toml", name="other", parameters=["K"], one_sided=True)
    first, second = user_causes(case_with(tmp_path, "a.toml", "b.toml"))
    assert first == TWISTED
    assert (second.name, second.one_sided) == ("other", True)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"name": "load_gain"}, 'name: found "load_gain", expected a name that the library'),
        ({"name": "all"}, 'name: found "all", expected a name that the library'),
        ({"name": "Load_Gain"}, 'name: found "Load_Gain", expected a name that the library'),
        ({"name": "two words"}, 'name: found "two words", expected a name of letters'),
        ({"category": "numerics"}, 'category: found "numerics", expected "material"'),
        ({"parameters": []}, "parameters: found [], expected a list of names of parameters"),
        ({"parameters": ["tau1"]}, 'parameters: found the name "tau1", expected tau0 or'),
        ({"parameters": ["lambda_plus_Y"]}, 'found the name "lambda_plus_Y", expected'),
        ({"parameters": ["load_gain"]}, "expected other parameters than those of load_gain"),
        ({"parameters": ["K", "K"]}, 'parameters: found "K" twice, expected each name once'),
        ({"companions": ["end_shear"]}, 'companions: found "end_shear" twice, expected each'),
        ({"parameters": ["x0", "x0"]}, 'parameters: found "x0" twice, expected each name once'),
        ({"one_sided": "yes"}, 'one_sided: found "yes", expected true or false'),
        ({"sentence": "a \u0007 bell"}, "expected a text in quotes, with at least a word and no"),
        ({"one_sided": True}, "one_sided: found true with 2 parameters, expected true for"),
        ({"sentence": None}, "sentence: found nothing, expected a text in quotes"),
        ({"check": ""}, 'check: found "", expected a text in quotes'),
        ({"sentence": " . "}, 'sentence: found " . ", expected a text in quotes'),
        ({"unit": "MPa"}, "unit: found an unknown key"),
    ],
)
def test_a_bad_cause_is_told_in_one_sentence(
    changes: dict[str, object], told: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "my.toml", **changes)
    with pytest.raises(InputError) as refused:
        read_causes(path)
    (line,) = str(refused.value).splitlines()
    assert line.startswith(f"{path}: causes.1") and told in line


def test_sentence_and_check_are_taken_as_the_answer_says_them(tmp_path: Path) -> None:
    """In one line, and without the full stop that follows there."""
    path = written(tmp_path / "my.toml", sentence=f"{TWISTED.sentence}. ", check="a photograph\n"
                   "of the grip.")  # fmt: skip
    assert read_causes(path) == (TWISTED,)


def test_a_file_with_the_mark_of_windows_editors_is_read(tmp_path: Path) -> None:
    path = written(tmp_path / "my.toml")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert read_causes(path) == (TWISTED,)


def test_a_bad_file_is_told_in_one_sentence(tmp_path: Path) -> None:
    absent = tmp_path / "absent.toml"
    with pytest.raises(
        InputError, match="file: found nothing, expected the tables .* of diagnosis.cause_files"
    ):
        read_causes(absent)
    with pytest.raises(InputError, match="file: found “embedded null byte”, expected a TOML file"):
        read_causes(tmp_path / "a\0b")
    absent.write_text("causes = ", encoding="utf-8")
    with pytest.raises(InputError, match="expected a TOML file in UTF-8"):
        read_causes(absent)
    absent.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="found nothing, expected one or more tables"):
        read_causes(absent)


def test_one_name_in_two_files_is_refused(tmp_path: Path) -> None:
    written(tmp_path / "a.toml")
    written(tmp_path / "b.toml")
    with pytest.raises(InputError, match='found "twisted_grip" again, expected a name for each'):
        user_causes(case_with(tmp_path, "a.toml", "b.toml"))


def test_two_causes_of_the_same_parameters_are_refused(tmp_path: Path) -> None:
    written(tmp_path / "a.toml", parameters=["K", "a1"], companions=[])
    written(tmp_path / "b.toml", name="other", parameters=["a1", "K"], companions=[])
    with pytest.raises(InputError, match="other of a1, K, expected other parameters than those of"):
        user_causes(case_with(tmp_path, "a.toml", "b.toml"))


def asking(folder: Path, *causes: str) -> Path:
    """A case file that asks for causes, with the file of `TWISTED` beside it."""
    written(folder / "my.toml")
    case = case_with(folder, "my.toml")
    table = case.diagnosis.model_copy(update={"causes": causes})
    write_case(case.model_copy(update={"diagnosis": table}), folder / "case.toml")
    return folder / "case.toml"


def test_a_cause_of_the_files_can_be_asked_for_by_name(tmp_path: Path) -> None:
    path = asking(tmp_path, "load_gain", "twisted_grip")
    assert asked_causes(load_case(path)) == (TWISTED,)
    assert not [finding for finding in check(path) if finding.subject == "causes"]


def test_a_cause_of_neither_library_nor_files_is_refused_by_run_check_and_design(
    tmp_path: Path, lines: list[str]
) -> None:
    path = asking(tmp_path, "twisted_grip", "magic")
    known = ", ".join((*NAMES, TWISTED.name))
    told = f'{path}: diagnosis.causes: found "magic", expected one of {known}'
    with pytest.raises(InputError) as of_run:
        run(path, None, False)
    with pytest.raises(InputError) as of_design:
        design(path, None, [], True)
    of_check = [finding for finding in check(path) if finding.subject == "causes"]
    assert str(of_run.value) == str(of_design.value) == told
    assert [(finding.level, finding.message) for finding in of_check] == [("error", told)]
    assert not lines and not (tmp_path / "results").exists()


def test_every_cause_of_neither_is_told(tmp_path: Path) -> None:
    path = asking(tmp_path, "magic", "load_gain", "sorcery")
    with pytest.raises(InputError) as refused:
        asked_causes(load_case(path))
    first, second = str(refused.value).splitlines()
    assert 'found "magic"' in first and 'found "sorcery"' in second
    assert len([finding for finding in check(path) if finding.subject == "causes"]) == 2


def test_a_change_of_a_design_may_ask_for_causes_of_the_files_alone(tmp_path: Path) -> None:
    base = base_variant(load_case(asking(tmp_path, "load_gain")), DesignSettings())
    where = Path("--change")
    changed = variant(base, "it", read_change('diagnosis.causes=["twisted_grip"]'), where)
    assert changed.case.diagnosis.causes == ("twisted_grip",)
    with pytest.raises(InputError, match='^--change: diagnosis.causes: found "magic", expected'):
        variant(base, "it", read_change('diagnosis.causes=["magic"]'), where)


def test_an_own_cause_that_cannot_be_tried_is_listed_with_the_reason() -> None:
    every = frozenset(declared_parameters(5))
    (left,) = not_examined(every, every - {"end_shear"}, (), None, (TWISTED,))[-1:]
    assert (left.cause, left.why) == (
        "twisted_grip",
        "the solver cannot honour sideways motion of S⁺ / half elongation",
    )


def test_an_effect_of_two_parameters_is_named_by_the_own_cause_that_has_both() -> None:
    problem = closed_form.problem()
    made = closed_form.objective(problem, problem.truth | {"end_rotation": 0.4, "end_shear": 0.4})
    found = diagnosis_of(problem, identified(problem, made), replace(SETTINGS, own=(TWISTED,)))
    assert found.verdict.names[0] == "twisted_grip"
    assert found.verdict.text.startswith("The grip is mounted askew")
    assert TWISTED.check in found.verdict.next
    assert found.extended.values["end_rotation"] == pytest.approx(0.4, rel=0.3)
    assert found.extended.values["end_shear"] == pytest.approx(0.4, rel=0.3)
