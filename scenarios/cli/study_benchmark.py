"""`flexbeams study benchmark`: one's own controller beside those of this project."""

import json
from pathlib import Path

import click
from rich.table import Table

from flexbeams.scenarios.cli.options import note
from flexbeams.scenarios.cli.tables import cell, console
from flexbeams.scenarios.definition.settings import Settings


def show_benchmark(controller: str, settings: Settings, folder: Path, as_json: bool) -> int:
    """Runs the benchmark; writes benchmark.json and benchmark.html, and prints tables or JSON."""
    from flexbeams.plant.archive import write_whole
    from flexbeams.scenarios.report.benchmark import benchmark_tables, write_benchmark_page
    from flexbeams.scenarios.studies.benchmark import run_benchmark

    def progress(text: str, done: int, total: int) -> None:
        note(f"{done} of {total} runs" + (f": {text}" if text else ""))

    record = run_benchmark(controller, settings, progress, settings.stop_time).record()
    text = json.dumps(record, indent=2)
    write_whole(folder / "benchmark.json", f"{text}\n".encode())
    write_benchmark_page(record, folder / "benchmark.html")
    if as_json:
        click.echo(text)
    else:
        out = console()
        for table in benchmark_tables(record):
            shown = Table(title=cell(table["title"]), title_justify="left")
            shown.add_column("controller")
            for measure in record["units"]:
                shown.add_column(measure, justify="right")
            for row in table["rows"]:
                shown.add_row(row["name"], *([cell(row["failure"])] if row["failure"] else map(cell, row["cells"])))
            out.print(shown)
    note(f"{folder / 'benchmark.json'} and {folder / 'benchmark.html'} written")
    return 0
