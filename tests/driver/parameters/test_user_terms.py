from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.case.model import Case, default_case, load_case, write_case
from driver.common.errors import InputError
from driver.diagnosis.causes.user_causes import read_causes
from driver.parameters.registry import declared_parameters
from driver.parameters.user_terms import GROUP, BoundaryTerm, ReadingTerm, installed_terms, terms_of
from driver.workflow.engine import stage_key
from driver.workflow.pipeline import stages
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

PAGE = Path(__file__).resolve().parents[3] / "docs" / "method" / "diagnosis.md"
SECTION = PAGE.read_text(encoding="utf-8").split("\n## Terms of your own")[1].split("\n## ")[0]


def install(folder: Path, module: str, entry_points: str) -> None:
    """A distribution of one module, as an installer leaves it in a folder of the path."""
    (folder / "my_terms.py").write_text(module, encoding="utf-8")
    info = folder / "my_terms-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-terms\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{entry_points}", encoding="utf-8")


def reading(parameter: str, formula: str) -> str:
    """A module with a term of the load reading."""
    return (
        "import numpy as np\n"
        "from driver.parameters.user_terms import ReadingTerm\n"
        "from solver_adapters.parameter import Parameter\n"
        f"TERM = ReadingTerm({parameter}, lambda force, progress: {formula})"
    )


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(str(tmp_path))
    installed_terms.cache_clear()
    yield tmp_path
    sys.modules.pop("my_terms", None)
    installed_terms.cache_clear()


@pytest.fixture
def documented(site: Path) -> Path:
    """The package of the documentation, and its file of causes."""
    (module,) = re.findall(r"```python\n(.*?)```", SECTION, re.S)
    project, causes = re.findall(r"```toml\n(.*?)```", SECTION, re.S)
    points = project.split(f'[project.entry-points."{GROUP}"]\n')[1].split("\n\n")[0]
    install(site, module, points.replace('"', ""))
    (site / "my_causes.toml").write_text(causes, encoding="utf-8")
    return site


@pytest.mark.usefixtures("documented")
def test_the_terms_of_an_installed_package_join_the_general_model() -> None:
    assert {term.parameter.name for term in installed_terms()} == {"swing", "cell_warming"}
    assert [t.parameter.name for t in terms_of(BoundaryTerm)] == ["swing"]
    assert [t.parameter.name for t in terms_of(ReadingTerm)] == ["cell_warming"]
    assert {"swing", "cell_warming"} <= set(declared_parameters(3))
    model = closed_form.problem().model
    assert model.simulated("swing") and not model.simulated("cell_warming")


@pytest.mark.usefixtures("documented")
def test_a_term_moves_the_ends_as_its_formula_says() -> None:
    problem = closed_form.problem()
    boundary = problem.model.boundary
    added = boundary.evaluate(problem.truth | {"swing": 0.2}) - boundary.evaluate(problem.truth)
    knots = np.array([0.0, *closed_form.KNOTS])
    stretch = boundary.weights @ knots
    plus = boundary.side > 0
    expected = 0.2 * np.outer(stretch, boundary.across[plus])
    np.testing.assert_allclose(added[:, plus, 2], expected, atol=1e-12)
    assert not added[..., :2].any() and not added[:, ~plus].any()
    along = boundary.derivative(problem.truth, "swing")
    np.testing.assert_allclose(along[:, plus, 2], expected / 0.2, atol=1e-12)
    # The formula of the term follows the knots, and so do their derivatives.
    with_term = boundary.derivative(problem.truth | {"swing": 0.2}, "elongation_2")
    change = with_term - boundary.derivative(problem.truth, "elongation_2")
    of_knot = 0.2 * np.outer(boundary.weights[:, 2], boundary.across[plus])
    np.testing.assert_allclose(change[:, plus, 2], of_knot, atol=1e-12)


@pytest.mark.usefixtures("documented")
@pytest.mark.parametrize("name", ["cell_warming", "elongation_2", "tau0", "load_lag"])
def test_derivatives_with_terms_are_those_of_differences(name: str) -> None:
    """Central differences of the whole prediction, with both terms off their null."""
    problem = closed_form.problem()
    # Without a lag derivatives at the corners of the history have two sides.
    values = problem.truth | {"swing": 0.2, "cell_warming": 0.5, "load_lag": 1.5}
    exact = problem.model.predict(values, (name,))
    h = 1e-4 * max(abs(values[name]), 1e-2)
    above, below = (problem.model.predict(values | {name: values[name] + s}) for s in (h, -h))
    for found, one, other in (
        (exact.d_load[0], above.load, below.load),
        (exact.d_surface[0], above.surface, below.surface),
    ):
        expected = (one - other) / (2 * h)
        size = max(float(np.abs(expected).max()), 1e-9)
        np.testing.assert_allclose(found / size, expected / size, atol=1e-4)


def test_an_effect_of_a_term_is_named_by_a_cause_of_ones_own(documented: Path) -> None:
    own = read_causes(documented / "my_causes.toml")
    problem = closed_form.problem()
    made = closed_form.objective(problem, problem.truth)
    progress = problem.model.instrument.progress
    read = made.data.load * (1 + 0.5 * np.exp(-8 * progress))
    made = replace(made, data=replace(made.data, load=read))
    cell = replace(own[0], name="cell", category="instrument", parameters=("cell_warming",))
    found = diagnosis_of(problem, identified(problem, made), replace(SETTINGS, own=(*own, cell)))
    assert found.verdict.names[0] == "cell"
    assert found.extended.values["cell_warming"] == pytest.approx(0.5, rel=0.3)
    scored = {score.cause.name for score in found.rounds[0].scores}
    assert {"cell", "swinging_grip"} <= scored


@pytest.mark.parametrize(
    ("module", "told"),
    [
        ("TERM = 3", "prismid.terms: mine: found int, expected a BoundaryTerm or a ReadingTerm"),
        (
            "from driver.parameters.user_terms import ReadingTerm\n"
            "from solver_adapters.parameter import Parameter\n"
            "TERM = ReadingTerm(Parameter('mine', '', 1.0, 0.1), lambda force, progress: force)",
            "prismid.terms: mine: found the null 1 of its parameter, expected 0",
        ),
        (
            "from driver.parameters.user_terms import ReadingTerm\n"
            "from solver_adapters.parameter import Parameter\n"
            "TERM = ReadingTerm(Parameter('Q', '', 0.0, 0.1), lambda force, progress: force)",
            'prismid.terms: found a second parameter "Q", expected a name that the general',
        ),
        ("1 / 0", "prismid.terms: mine: found “division by zero”, expected an entry point that"),
        ("other = 3", "prismid.terms: mine: found “module 'my_terms' has no attribute 'TERM'”"),
        (
            reading("Parameter('two words', '', 0.0, 0.1)", "force"),
            'prismid.terms: mine: found the name "two words" of its parameter, expected letters',
        ),
        (
            reading("Parameter('tilt_3', '', 0.0, 0.1)", "force"),
            'prismid.terms: mine: found the name "tilt_3" of its parameter, expected letters',
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.0)", "force"),
            "prismid.terms: mine: found the scale 0 of its parameter, expected a number > 0",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1, 0.2, 1.0)", "force"),
            "prismid.terms: mine: found the bounds 0.2 and 1 of its parameter, expected 0 between",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1, logarithmic=True)", "force"),
            "prismid.terms: mine: found a logarithmic parameter, expected one whose null is 0",
        ),
        (
            reading("'mine'", "force"),
            "prismid.terms: mine: found a parameter of the type str, expected a Parameter",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1)", "1.0"),
            "prismid.terms: mine: found a reading of shape () in place of (60,), expected one of",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1)", "force / 0"),
            "prismid.terms: mine: found a reading that is not finite, expected numbers",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1)", "force.nothing"),
            "prismid.terms: mine: found a reading that ends with “'numpy.ndarray' object has no",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1)", "force * 0 + 1 / progress"),
            "prismid.terms: mine: found a reading that is not finite, expected numbers",
        ),
        (
            reading("Parameter('mine', '', 0.0, '0.1')", "force"),
            "prismid.terms: mine: found the scale '0.1' of its parameter, expected a number",
        ),
        (
            reading("Parameter('mine', None, 0.0, 0.1)", "force"),
            "prismid.terms: mine: found the unit None of its parameter, expected a text",
        ),
        (
            reading("Parameter('mine', '', np.float32(1.0), np.float64(0.1))", "force"),
            "prismid.terms: mine: found the null 1 of its parameter, expected 0",
        ),
        ("raise SystemExit(0)", "prismid.terms: mine: found “0”, expected an entry point that"),
        (
            reading("Parameter('mine', '', 0.0, 0.1)", "abs(force)"),
            "prismid.terms: mine: found a reading whose derivative is lost with complex numbers",
        ),
        (  # others read the same loads
            reading("Parameter('mine', '', 0.0, 0.1)", "force.__imul__(2.0)"),
            "prismid.terms: mine: found a reading that ends with “output array is read-only”",
        ),
        (
            reading("Parameter('mine', '', 0.0, 0.1)", "force + progress.__ipow__(2)"),
            "prismid.terms: mine: found a reading that ends with “output array is read-only”",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:(divide by zero|invalid value):RuntimeWarning")
def test_a_bad_term_is_told_in_one_sentence(module: str, told: str, site: Path) -> None:
    install(site, module, "mine = my_terms:TERM")
    with pytest.raises(InputError) as refused:
        declared_parameters(3)
    (line,) = str(refused.value).splitlines()
    assert line.startswith(told)


def test_a_bad_term_is_told_where_a_case_is_read(site: Path, tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    write_case(default_case(), path)
    installed_terms.cache_clear()
    install(site, "TERM = 3", "mine = my_terms:TERM")
    told = "prismid.terms: mine: found int, expected a BoundaryTerm or a ReadingTerm"
    begins: list[Callable[[], Case]] = [lambda: load_case(path), default_case]
    for begin in begins:
        with pytest.raises(InputError) as refused:
            begin()
        assert str(refused.value) == told


def test_a_term_that_is_changed_makes_identification_and_diagnosis_stale(
    documented: Path, tmp_path: Path
) -> None:
    """An identification only where it frees the term: at its null it does nothing."""
    case = closed_form.small_case()
    freeing = case.model_copy(update={"extensions": {"swing": 0.0}})
    names = [stage.name for stage in stages(case)]

    def keys(of: Case) -> list[str]:
        return [stage_key(stage, of, "") for stage in stages(of)]

    before = keys(case), keys(freeing)
    module = documented / "my_terms.py"
    module.write_text(module.read_text("utf-8").replace("-8 *", "-4 *"), encoding="utf-8")
    for of, old, expected in (
        (case, before[0], {"diagnose"}),
        (freeing, before[1], {"identify", "diagnose"}),
    ):
        pairs = zip(names, old, keys(of), strict=True)
        assert {name for name, one, other in pairs if one != other} == expected


def test_without_such_packages_there_are_no_terms() -> None:
    assert installed_terms() == ()
