"""The verb `flexbeams design`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.options import BASIS, chosen_structure, note, structure_option

FILE = click.Path(dir_okay=False, path_type=Path)


def option_values(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> dict[str, Any]:
    """KEY=VALUE options as a table; values are TOML, or words without quotes."""
    import tomllib

    table: dict[str, Any] = {}
    for text in values:
        key, equals, value = text.partition("=")
        if not equals or not key:
            raise click.BadParameter(f"must be KEY=VALUE, got {text!r}")
        try:
            parsed = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            parsed = value
        table[key.strip()] = parsed
    return table


@click.command()
@click.option("--scenario", metavar="NAME", help="Take structure, [design] and targets of a scenario, name or file.")
@structure_option
@click.option("--basis", type=BASIS, help="Galerkin basis: clamped_free, the paper's, or segment, the exact one.")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    callback=option_values,
    metavar="KEY=VALUE",
    help="An option of [design], such as observer=offset_free, weights.kalman_q_total=1500 or "
    "uncertainty.patch[].piezo_ratio=0.1. Repeatable.",
)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON, with units.")
@click.option("--report", type=FILE, metavar="FILE.html", help="Also write a page with all curves.")
@click.option("--out", type=FILE, help="Also write the design file here.")
def design(
    scenario: str | None,
    structure: str | None,
    basis: str | None,
    overrides: dict[str, Any],
    as_json: bool,
    report: Path | None,
    out: Path | None,
) -> None:
    """Compute the design of a structure and show what it is worth.

    Modes, Hankel singular values, static gains; closed-loop poles, margins and noise gains on the design's own plant
    and on the exact one; expected static errors; how well pairs and gauges are placed.
    """
    import orjson

    from flexbeams.controller.analysis import analyse
    from flexbeams.controller.design import compute_design
    from flexbeams.controller.design_file import write_design
    from flexbeams.scenarios.cli.design_tables import show_design
    from flexbeams.scenarios.runs.designs import design_task

    task = design_task(scenario, None if scenario and not structure else chosen_structure(structure), basis, overrides)
    analysis = analyse(compute_design(task.structure, task.options), task.targets)
    computed = analysis.design
    if out is not None:
        write_design(computed, out)
        note(f"design written to {out}")
    if report is not None:
        from flexbeams.scenarios.report.design import write_design_page

        write_design_page(analysis, report, scenario or structure or "kiel")
        note(f"report written to {report}")
    if as_json:
        everything = {"design_id": computed.design_id, **computed.summary, **analysis.figures()}
        click.echo(orjson.dumps(everything, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE), nl=False)
    else:
        show_design(analysis)
