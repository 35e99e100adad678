"""The verb `flexbeams compare`."""

from pathlib import Path

import click

from flexbeams.scenarios.cli.options import note, say


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN RUN...", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("results/compare"),
    show_default=True,
    help="Folder of compare.html, compare.png and compare.svg.",
)
def compare(runs: tuple[Path, ...], out: Path) -> int:
    """Overlay finished runs; each RUN is a folder of results, such as results/tracking.

    Prints checks and metrics side by side and writes the signals that all runs recorded as a page and a figure.
    """
    from flexbeams.scenarios.api.comparisons import compare as read_runs
    from flexbeams.scenarios.cli.comparison_tables import show_comparison
    from flexbeams.scenarios.report.comparison import write_comparison

    comparison = read_runs(*runs)
    if comparison.left_out:
        note(f"not in every run, left out: {', '.join(comparison.left_out)}")
    written = write_comparison(comparison, out)
    show_comparison(comparison)
    for path in written:
        say(path)
    return 0
