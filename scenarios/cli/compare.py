"""The verb `flexbeams compare`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from flexbeams.scenarios.cli.options import POSITIVE, note, say

if TYPE_CHECKING:
    from flexbeams.scenarios.api.comparisons import Comparison

WHOLE = 0.99  # of the longer recording; less is noted


def _pairs(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> dict[str, str]:
    """THEIR=VALUE options as a table."""
    table = {}
    for text in values:
        key, equals, value = text.partition("=")
        if not (key and equals and value):
            raise click.BadParameter(f"must be {parameter.metavar}, got {text!r}")
        table[key] = value
    return table


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN RUN...", type=click.Path(path_type=Path))
@click.option(
    "--map",
    "names",
    multiple=True,
    callback=_pairs,
    metavar="THEIR=OURS",
    help="Column or array in a file of another tool, and its name in the run: y=plant.y_pi. Repeatable.",
)
@click.option(
    "--unit",
    "units",
    multiple=True,
    callback=_pairs,
    metavar="THEIR=UNIT",
    help="Unit of measurement of a column in such a file that is not SI: y=mm, time=ms. Repeatable.",
)
@click.option(
    "--tolerance",
    type=POSITIVE,
    metavar="X",
    help="Exit status 1 where a signal differs by more than X of its largest value in the first run, or less than half "
    "of the longer recording is compared.",
)
@click.option("--json", "as_json", is_flag=True, help="Differences as JSON; writes no page.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("results/compare"),
    show_default=True,
    help="Folder of compare.html, compare.png and compare.svg.",
)
def compare(
    runs: tuple[Path, ...],
    names: dict[str, str],
    units: dict[str, str],
    tolerance: float | None,
    as_json: bool,
    out: Path,
) -> int:
    """Compare finished runs and recordings of other tools with the first RUN.

    Each RUN is a folder of results, such as results/tracking, or a file .csv, .parquet, .mat or .mf4 with a column
    `time`. Prints settings that differ, the difference of each signal, checks and metrics, and writes a page.
    """
    from flexbeams.scenarios.api.comparisons import compare as read_runs
    from flexbeams.scenarios.cli.comparison_tables import show_comparison, show_differences

    comparison = read_runs(*runs, names=names, units=units, tolerance=tolerance, notify=note)
    if comparison.left_out:
        note(f"not in every run, left out: {', '.join(comparison.left_out)}")
    for span in comparison.spans:
        if span.share < WHOLE:
            note(f"{span.run}: only {100 * span.share:.3g} % of the longer recording is compared, {span.text}")
    if as_json:
        click.echo(_as_json(comparison))
        return 0 if comparison.holds else 1
    from flexbeams.scenarios.report.comparison import write_comparison

    written = write_comparison(comparison, out, comparison.by_run)
    show_differences(comparison)
    show_comparison(comparison)
    for path in written:
        say(path)
    return 0 if comparison.holds else 1


def _as_json(comparison: "Comparison") -> str:
    from flexbeams.scenarios.results.files import json_values

    labels = [run.label for run in comparison.runs]
    record = {
        "runs": labels,
        "settings": {name: dict(zip(labels, cells, strict=True)) for name, cells in comparison.settings.items()},
        "spans": [span.record() for span in comparison.spans],
        "signals": [difference.record() for difference in comparison.differences],
        "left_out": comparison.left_out,
        "tolerance": comparison.tolerance,
        "holds": comparison.holds,
    }
    return json.dumps(json_values(record), indent=2, allow_nan=False)
