"""The stages of a run by name, in their order."""

from __future__ import annotations

from typing import Literal, get_args

StageName = Literal["mesh", "measure", "identify", "diagnose", "advise", "report"]
STAGE_NAMES: tuple[StageName, ...] = get_args(StageName)
