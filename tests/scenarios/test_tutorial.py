"""The notebook: clean as committed, and every cell runs."""

import ast
import json
from pathlib import Path
from typing import Any

import pytest

from tests.helpers import ROOT
from tests.native.workshop import needs_zig

NOTEBOOK: dict[str, Any] = json.loads((ROOT / "scenarios" / "tutorial.ipynb").read_text(encoding="utf-8"))
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_it_is_committed_without_outputs() -> None:
    assert (NOTEBOOK["nbformat"], NOTEBOOK["nbformat_minor"]) == (4, 5)
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in CELLS)
    assert len({cell["id"] for cell in NOTEBOOK["cells"]}) == len(NOTEBOOK["cells"])
    assert len(CELLS) >= 14


@pytest.mark.native
@pytest.mark.slow
@pytest.mark.timeout(600)
@needs_zig
def test_every_cell_runs(at_run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As Jupyter runs them, in one namespace; the value of a last expression is displayed."""
    pytest.importorskip("control")
    pytest.importorskip("pyarrow")
    monkeypatch.setenv("MPLBACKEND", "agg")
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(CELLS, 1):
        tree = ast.parse("".join(cell["source"]), f"cell {number}")
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"cell {number}", "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), namespace)
            assert value is None or (getattr(value, "_repr_html_", None) or value.__repr__)()
    assert namespace["difference"] < 1e-9
    assert namespace["own"].passed
    assert namespace["tracking"].passed
    assert namespace["study"].failed == {}
