"""Every public name has a docstring with an example, and the examples give what they print."""

import doctest
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest

import flexbeams as fb
from flexbeams.scenarios.api.comparisons import Comparison
from flexbeams.scenarios.api.design_view import ClosedLoop, DesignView, PlantModel
from flexbeams.scenarios.api.state_space import StateSpace
from flexbeams.scenarios.runs.run_view import RunView
from flexbeams.scenarios.runs.simulation import Simulation

pytestmark = [pytest.mark.native, pytest.mark.slow]

FUNCTIONS = [name for name in fb.__all__ if name not in ("__version__", "FlexbeamsError")]
CLASSES = (RunView, Simulation, DesignView, StateSpace, PlantModel, ClosedLoop, Comparison)


def examples() -> Iterator[doctest.DocTest]:
    finder = doctest.DocTestFinder(recurse=False)
    for name in FUNCTIONS:
        yield from finder.find(getattr(fb, name), name)
    for kind in CLASSES:
        yield from finder.find(kind, kind.__name__)


@pytest.mark.parametrize("example", [test for test in examples() if test.examples], ids=lambda test: test.name)
def test_example(example: doctest.DocTest, at_run_folder: Path) -> None:
    if "gymnasium" in example.examples[0].source:
        pytest.importorskip("gymnasium")
    lines: list[str] = []
    doctest.DocTestRunner().run(example, out=lines.append)
    assert not lines, "".join(lines)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_describe_what_they_take_and_raise(name: str) -> None:
    function = getattr(fb, name)
    text = inspect.getdoc(function) or ""
    assert ">>> import flexbeams as fb" in text
    parameters = inspect.signature(function).parameters
    for section in (*(["Parameters"] if parameters else []), "Raises", "Examples"):
        assert f"\n{section}\n---" in text, section
    for parameter in parameters:
        assert parameter in text.partition("Parameters")[2].partition("Raises")[0], parameter


@pytest.mark.parametrize("kind", CLASSES)
def test_public_methods_have_a_docstring(kind: type) -> None:
    for name, member in inspect.getmembers(kind):
        if not name.startswith("_") and (callable(member) or isinstance(member, property)):
            assert inspect.getdoc(member), name
