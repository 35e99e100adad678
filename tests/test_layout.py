"""The layout of the code: imports point down the floors, no circles, short modules and functions.

Everything is read from the sources with `ast`; imports inside functions count like those at the top of a module.
"""

import ast
import re
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import pytest

from tests.order import LONGEST, TESTS

ROOT = Path(__file__).parents[1]
FOLDERS = ("flexbeams", "plant", "controller", "fmus", "scenarios")

# From the lowest floor to the highest; a module may import from its own floor and from lower ones
FLOORS = {
    "": ("errors", "plant", "controller", "fmus", "scenarios", "api", "__init__", "__main__"),
    "fmus": ("choices", "errors", "__init__", "python", "interface", "documents", "references", "units", "packaging"),
    "scenarios": (
        "__init__",
        "library",
        "processes",
        "definition",
        "importing",
        "simulation",
        "validation",
        "results",
        "report",
        "runs",
        "learning",
        "masters",
        "exporting",
        "bench",
        "studies",
        "api",
        "cli",
    ),
}
KERNELS_MAY_IMPORT = {"numpy", "scipy", "pythonfmu", "flexbeams.plant", "flexbeams.controller", "flexbeams.fmus.python"}

MAX_MODULE_LINES = 300
MAX_FUNCTION_LINES = 50
# Modules and functions that are longer, imports from a higher floor and circles, each with the reason
LONG_MODULES: dict[str, str] = {}
LONG_FUNCTIONS: dict[str, str] = {}
RISING_IMPORTS: dict[tuple[str, str], str] = {}
CIRCLES: dict[tuple[str, ...], str] = {}


@cache
def modules() -> dict[str, Path]:
    """Files of the package by the name under which they are imported."""
    found = {}
    for folder in FOLDERS:
        base = ROOT if folder != "flexbeams" else ROOT / "flexbeams"
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(base).with_suffix("").parts
            found[".".join(("flexbeams", *parts)).removesuffix(".__init__")] = path
    return found


def syntax_tree(module: str) -> ast.Module:
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


def imported_names(tree: ast.AST) -> Iterator[tuple[str, str | None]]:
    """Modules of import statements, and the name that is taken from each."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            yield from ((node.module or "", alias.name) for alias in node.names)


@cache
def has_imports(package: str) -> bool:
    return package in modules() and any(imported_names(syntax_tree(package)))


@cache
def imports() -> dict[str, frozenset[str]]:
    """For each module, those of ours that it imports, and the packages around them whose own file imports something."""
    graph = {}
    for module in modules():
        found = set()
        for name, taken in imported_names(syntax_tree(module)):
            if name.split(".")[0] != "flexbeams":
                continue
            inner = f"{name}.{taken}"
            target = inner if inner in modules() else name
            assert target in modules(), f"{module} imports {target}, which does not exist"
            parts = target.split(".")
            packages = (".".join(parts[:k]) for k in range(1, len(parts)))
            found |= {target, *(p for p in packages if has_imports(p) and not f"{module}.".startswith(f"{p}."))}
        graph[module] = frozenset(found - {module})
    return graph


def floor(module: str, folder: str = "") -> int:
    """Place of a module among the floors of a folder, from the lowest."""
    name = module.split(".")[2 if folder else 1 :]
    if not name:
        name = ["__init__"]
    floors = FLOORS[folder]
    assert name[0] in floors, f"{module}: give {name[0]} a floor in FLOORS[{folder!r}]"
    return floors.index(name[0])


def rises(module: str, target: str) -> bool:
    """Whether an import goes to a higher floor."""
    own, other = floor(module), floor(target)
    if own != other:
        return other > own
    folder = module.split(".")[1] if "." in module else ""
    if folder not in FLOORS:
        return False
    return floor(target, folder) > floor(module, folder)


def circles(graph: dict[str, frozenset[str]]) -> Iterator[tuple[str, ...]]:
    """One circle after another, each opened at its first module before the next is looked for."""
    left = {module: set(targets) for module, targets in graph.items()}
    while True:
        try:
            TopologicalSorter(left).prepare()
            return
        except CycleError as error:
            ring = error.args[1][:-1]
            yield tuple(sorted(ring))
            left[ring[1]].discard(ring[0])


def lines(module: str) -> int:
    return len(modules()[module].read_text(encoding="utf-8").splitlines())


def functions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, int]]:
    """Names and lengths of functions, from `def` to the last line without the docstring; nested ones as well."""
    for node in ast.iter_child_nodes(tree):
        name = prefix
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            name = f"{prefix}.{node.name}"
            if not isinstance(node, ast.ClassDef):
                first = node.body[0]
                described = ast.get_docstring(node) is not None
                docstring = (first.end_lineno or first.lineno) - first.lineno + 1 if described else 0
                yield name, (node.end_lineno or node.lineno) - node.lineno + 1 - docstring
        yield from functions(node, name)


def test_there_are_modules_in_every_folder() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in modules().values()} == set(FOLDERS)
    assert len(modules()) > 50


def assert_only(found: Collection[object], allowed: Mapping[Any, str]) -> None:
    """What is found stands in a list of exceptions, and the list has no entry that is found no longer."""
    assert not set(found) - allowed.keys()
    assert not allowed.keys() - set(found), "exceptions that are needed no longer"


def test_imports_point_down() -> None:
    rising = {(module, target) for module, targets in imports().items() for target in targets if rises(module, target)}
    assert_only(rising, RISING_IMPORTS)


def test_imports_form_no_circle() -> None:
    assert_only(set(circles(imports())), CIRCLES)


def test_kernels_import_what_the_packager_can_join() -> None:
    """The modules of `fmus/python`: numpy, scipy, the base class of pythonfmu, and modules of physics and control."""
    for module in modules():
        if module.startswith("flexbeams.fmus.python."):
            for name, _ in imported_names(syntax_tree(module)):
                first = name.split(".")[0]
                allowed = any(f"{name}.".startswith(f"{own}.") for own in KERNELS_MAY_IMPORT)
                assert allowed or first in sys.stdlib_module_names, f"{module} imports {name}"


def test_modules_are_short() -> None:
    assert_only({module for module in modules() if lines(module) > MAX_MODULE_LINES}, LONG_MODULES)


def test_functions_are_short() -> None:
    found = (function for module in modules() for function in functions(syntax_tree(module), module))
    assert_only({name for name, length in found if length > MAX_FUNCTION_LINES}, LONG_FUNCTIONS)


def test_the_guide_for_contributors_names_what_exists() -> None:
    """Paths of the project in code spans."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    words = {word.rstrip("/") for span in re.findall(r"`([^`\n]+)`", text) for word in span.split()}
    paths = {
        word for word in words if re.fullmatch(r"(\.ci|tests|flexbeams|plant|controller|fmus|scenarios)/[\w./]+", word)
    }
    assert len(paths) > 20
    assert {path for path in paths if not (ROOT / path).exists()} == set()


def edges(*pairs: tuple[str, Iterable[str]]) -> dict[str, frozenset[str]]:
    return {module: frozenset(targets) for module, targets in pairs}


def test_circles_are_found() -> None:
    """The check itself: none, one of three modules, two that share a module."""
    assert list(circles(edges(("a", "bc"), ("b", "c"), ("c", "")))) == []
    assert list(circles(edges(("a", "b"), ("b", "c"), ("c", "ad"), ("d", "")))) == [("a", "b", "c")]
    assert sorted(circles(edges(("a", "bc"), ("b", "a"), ("c", "a")))) == [("a", "b"), ("a", "c")]


@pytest.mark.parametrize(
    ("module", "target", "higher"),
    [
        ("plant.beam", "controller.design", True),
        ("controller.design", "plant.beam", False),
        ("scenarios.report.page", "scenarios.runs.prepare", True),
        ("scenarios.runs.prepare", "scenarios.report.page", False),
        ("scenarios.runs.prepare", "scenarios.runs.files", False),
        ("fmus.interface.si", "scenarios.api", True),
        ("fmus.units.catalogue", "fmus.packaging.build", True),
    ],
)
def test_rising_imports_are_found(module: str, target: str, higher: bool) -> None:
    assert rises(f"flexbeams.{module}", f"flexbeams.{target}") is higher


def test_lengths_of_functions_are_counted() -> None:
    lines = [
        "class A:",
        "    def f(self):",
        '        """Text',
        '        of two lines."""',
        "        def g():",
        "            pass",
        "",
        "        return g",
    ]
    tree = ast.parse("\n".join(lines))
    assert list(functions(tree, "m")) == [("m.A.f", 5), ("m.A.f.g", 2)]


def test_the_longest_test_files_are_there() -> None:
    assert [name for name in LONGEST if not (TESTS / name).is_file()] == []
