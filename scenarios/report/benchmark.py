"""The page of a benchmark: a table for each case, a row for each controller."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexbeams.plant.archive import write_whole
from flexbeams.scenarios.report.page import render
from flexbeams.scenarios.results.display import number


def benchmark_tables(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """For each case its title and rows of texts: the controller, then its measures, or one text where it failed."""
    units, tables = record["units"], []
    for case, candidates in record["results"].items():
        rows = []
        for name, values in candidates.items():
            failure = values if isinstance(values, str) else ""
            cells = [] if failure else [number(values[measure], units[measure]) for measure in units]
            rows.append({"name": name, "cells": cells, "failure": failure})
        about = record["cases"][case]
        start = ", ".join(f"{key} = {value:g}" for key, value in about["start"].items())
        tables.append({"title": case, "about": f"{about['scenario']}{': ' if start else ''}{start}", "rows": rows})
    return tables


def write_benchmark_page(record: Mapping[str, Any], path: Path) -> None:
    """Writes the page; it needs no other file."""
    page = render(
        "benchmark.html.j2",
        title="Benchmark of controllers",
        controller=record["controller"],
        version=f"flexbeams {record['flexbeams']}, benchmark {record['benchmark']}",
        measures=list(record["units"]),
        tables=benchmark_tables(record),
        data={},
    )
    write_whole(path, page.encode("utf-8", "replace"))
