"""The order of the tests."""

from __future__ import annotations

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that have slow tests: one at the end would be alone at work."""
    slow = {
        item.path
        for item in items
        if any(item.get_closest_marker(name) for name in ("slow", "long"))
    }
    items.sort(key=lambda item: item.path not in slow)
