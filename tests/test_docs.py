from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest

from driver.case.model import default_case, schema
from driver.diagnosis.answer.verdict import Kind
from driver.diagnosis.causes.all_causes import EVERY
from driver.diagnosis.causes.causes import NUMERICS
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.parameters.registry import declared_parameters
from driver.report.findings import FILES
from solver_adapters.jobs.status import CACHED, Status
from solver_adapters.material import MATERIAL_PARAMETERS
from solver_adapters.parameter import Parameter

DOCS = Path(__file__).resolve().parents[1] / "docs"
CASE_FILE, DIAGNOSIS, VERDICTS, RESULTS, ADAPTERS = (
    (DOCS / f"{name}.md").read_text(encoding="utf-8")
    for name in ("case-file", "method/diagnosis", "method/verdicts", "results", "solver-adapters")
)
README = DOCS.parent / "README.md"
METHOD = sorted((DOCS / "method").glob("*.md"))
DOCUMENTS = (*sorted(DOCS.rglob("*.md")), README, DOCS.parent / "CHANGELOG.md")
# Open tables: their keys are names of parameters.
OPEN = {"extensions", "identification.prior_width"}


def schema_keys() -> dict[str, Any]:
    """Every key of the schema as "table.key", with its default (None where there is none)."""
    whole = schema()
    keys: dict[str, Any] = {}

    def follow(node: dict[str, Any], table: str) -> None:
        for key, field in node["properties"].items():
            name = f"{table}.{key}".lstrip(".")
            many = field.get("additionalProperties")
            reference = field.get("$ref") or field.get("items", {}).get("$ref")
            if isinstance(many, dict) and "$ref" in many:
                follow(whole["$defs"][many["$ref"].split("/")[-1]], f"{name}.NAME")
            elif reference:
                follow(whole["$defs"][reference.split("/")[-1]], name)
            elif name not in OPEN:
                required = key in node.get("required", ())
                keys[name] = "required" if required else field["default"]

    follow(whole, "")
    return keys


def documented() -> dict[str, str]:
    """Every key of the tables of docs/case-file.md with its default."""
    keys: dict[str, str] = {}
    for section in CASE_FILE.split("\n## ")[1:]:
        heading = re.match(r"`\[+([\w.]+)\]+`", section)
        if heading:
            for key, default in re.findall(r"^\| `(\w+)` \| (.*?) \|", section, re.MULTILINE):
                keys[f"{heading[1]}.{key}"] = default
    return keys


def test_every_key_of_the_schema_is_documented_with_its_default_and_no_other() -> None:
    expected = {}
    for key, default in schema_keys().items():
        text = default if default == "required" else json.dumps(default, ensure_ascii=False)
        expected[key] = "—" if default is None else text
    found = documented()
    found.pop("identification.prior_width")
    assert found == expected


def test_the_open_tables_of_the_case_are_documented() -> None:
    written = default_case().model_dump()
    assert "extensions" in written and "prior_width" in written["identification"]
    assert "profiles" in written["solver"]
    assert all(f"`[{name}]`" in CASE_FILE for name in OPEN)


@pytest.mark.parametrize(
    "parameter",
    [p for p in declared_parameters(2).values() if not p.name.endswith("_1")],
    ids=lambda p: p.name,
)
def test_every_parameter_is_documented_with_unit_null_and_scale(parameter: Parameter) -> None:
    (row,) = re.findall(rf"^\| `{parameter.name}` \|(.*)\|$", CASE_FILE.split("## Param")[1], re.M)
    unit, null, scale, _ = (cell.strip() for cell in row.split("|"))
    assert unit == parameter.unit
    assert null == ("case" if parameter.name in MATERIAL_PARAMETERS else f"{parameter.null:g}")
    number, *log = scale.split()
    assert float(number) == pytest.approx(parameter.scale, rel=1e-3)
    assert log == (["log"] if parameter.logarithmic else [])


@pytest.mark.parametrize("cause", EVERY, ids=lambda cause: cause.name)
def test_every_cause_is_listed_with_its_parameters(cause: Any) -> None:
    (row,) = re.findall(rf"^\| \w+ \| `{cause.name}` \|(.*)\|$", DIAGNOSIS, re.M)
    if cause is not NUMERICS:
        names = re.findall(r"`(\w+)`", row)
        assert names[: 1 if cause in COVARIANCE else None] == [*cause.parameters, *cause.companions]


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_verdict_is_explained(kind: str) -> None:
    assert f"**{kind}**" in VERDICTS


@pytest.mark.parametrize("name", FILES)
def test_every_result_file_is_described(name: str) -> None:
    assert f"`{name}`" in RESULTS


@pytest.mark.parametrize("status", Status)
def test_every_end_of_a_job_is_explained_with_whether_it_is_kept(status: Status) -> None:
    (kept,) = re.findall(rf"^\| {status} \| (\w+) \|", ADAPTERS, re.M)
    assert kept == ("yes" if status in CACHED else "no")


def anchors(text: str) -> set[str]:
    """Anchors of the headings of a document."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\s-]", "", h).strip().lower().replace(" ", "-") for h in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_links_between_the_documents_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = document.parent / name if name else document
        assert target.exists(), link
        assert not anchor or anchor in anchors(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("page", METHOD, ids=lambda path: path.name)
def test_every_module_that_a_page_of_the_method_names_exists(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for module in re.findall(r"`([\w/]+(?:\.py|/))`", text):
        assert module == "my_terms.py" or (DOCS.parent / module).exists(), module


@pytest.mark.parametrize("page", METHOD, ids=lambda path: path.name)
def test_the_equations_of_a_page_are_numbered_from_one_on(page: Path) -> None:
    numbers = re.findall(r"\\tag\{(\d+)\}", page.read_text(encoding="utf-8"))
    assert numbers == [str(k) for k in range(1, len(numbers) + 1)]
    assert numbers or page.name == "README.md"


def test_the_readme_names_every_solver_that_ships_with_its_document() -> None:
    section = README.read_text(encoding="utf-8").split("## Another solver")[1].split("\n## ")[0]
    shipped = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))
    for name in shipped["project"]["entry-points"]["prismid.solvers"].keys() - {"bundled"}:
        assert f'name = "{name}"' in section and f"(docs/{name}.md)" in section
    assert "(docs/solver-adapters.md)" in section
