"""Sizes of the elements of the correlation where no others are asked for."""

from __future__ import annotations

ELEMENT_UV = 16  # px
ELEMENT_W = 8  # px; slip steps and grains make the height vary faster than u, v
