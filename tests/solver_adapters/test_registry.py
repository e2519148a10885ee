from __future__ import annotations

from importlib.metadata import EntryPoint
from typing import Any

import pytest

from solver_adapters import registry
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Capabilities, UnsupportedError
from solver_adapters.registry import GROUP, adapter_names, find_adapter, installed_capabilities

POINTS = (
    EntryPoint("second", "solver_adapters.bundled.adapter:BundledAdapter", GROUP),
    EntryPoint("bundled", "solver_adapters.bundled.adapter:BundledAdapter", GROUP),
)


class Outdated(BundledAdapter):
    """A solver in the words of another interface."""

    def capabilities(self) -> Capabilities:
        words: dict[str, Any] = {"materials": frozenset()}
        return Capabilities(**words)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {GROUP: POINTS}
    monkeypatch.setattr(registry, "entry_points", lambda group: asked.get(group, ()))


@pytest.mark.usefixtures("installed")
def test_a_solver_is_found_by_the_name_of_its_entry_point() -> None:
    assert adapter_names() == ("bundled", "second")
    assert find_adapter("bundled").name == "bundled"
    assert find_adapter("second").capabilities().derivatives


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        ("no_such_package:Solver", "ModuleNotFoundError"),
        ("solver_adapters.external:ExternalAdapter", "TypeError"),
        ("tests.solver_adapters.test_registry:Outdated", "TypeError"),
    ],
)
def test_a_solver_that_cannot_be_used_is_told_and_stands_in_the_way_of_no_other(
    monkeypatch: pytest.MonkeyPatch, value: str, fault: str
) -> None:
    points = (*POINTS, EntryPoint("broken", value, GROUP))
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    with pytest.raises(UnsupportedError, match=f"solver broken: found no usable {value} .{fault}:"):
        find_adapter("broken")
    assert set(installed_capabilities()) == {"bundled", "second"}


@pytest.mark.usefixtures("installed")
def test_an_unknown_solver_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(UnsupportedError) as error:
        find_adapter("abaqus")
    assert str(error.value) == 'solver.name: found "abaqus", expected one of bundled, second'


def test_without_any_solver_the_installation_is_questioned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "entry_points", lambda group: ())
    with pytest.raises(UnsupportedError, match="is prismid installed"):
        find_adapter("bundled")
