"""The parameters of the final model: the extended one where causes were added."""

from __future__ import annotations

from driver.common.formatting import joined
from driver.parameters.registry import label_of
from driver.report.figures import side_labels
from driver.report.findings import Findings
from driver.report.identified_tables import core
from driver.report.tables import measure


def final_columns(findings: Findings) -> dict[str, list[object]]:
    """Columns of `report_parameters.csv`: values beside those before the extension.

    What the final model frees and the one before did not, and all before where nothing was added,
    is left empty there.
    """
    rows = findings.fitted(findings.sides[-1]) | findings.diagnosis.get("added", {})
    before = findings.fitted("before") if findings.extended else {}
    return {
        "parameter": list(rows),
        "value": [row["value"] for row in rows.values()],
        "sigma": [row["sigma"] for row in rows.values()],
        "unit": [row["unit"] for row in rows.values()],
        **{
            f"{key}_before": [before[name][key] if name in before else "" for name in rows]
            for key in ("value", "sigma")
        },
        "model": ["extended" if findings.extended else "identified"] * len(rows),
    }


def final_told(findings: Findings) -> str:
    """Return the law of the final model, and what was added to it, in a line."""
    side, added = findings.sides[-1], findings.diagnosis.get("added", {})
    rows = findings.fitted(side) | added
    names = [n for n in core(tuple(rows)) if n in added or not n.startswith("lambda_")]
    values = [
        f"{label_of(n)} = {measure(n, rows[n]['unit'], rows[n]['value'], rows[n]['sigma'])}"
        for n in names
    ]
    return f"{side_labels(findings.sides)[side]}: {joined(values)}"
