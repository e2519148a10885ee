"""Refusals of a table of the case by itself, without a file."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from driver.case.values import Table


def refused(table: type[Table], **keys: Any) -> tuple[str, str]:
    """The one key that a table refuses, and what it expected there."""
    with pytest.raises(ValidationError) as error:
        table.model_validate(keys)
    (details,) = error.value.errors()
    context = details.get("ctx", {})
    place = ".".join(map(str, details["loc"])) or context["key"]
    return place, context.get("expected", details["type"])
