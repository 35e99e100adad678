"""The verb `flexbeams export`."""

from importlib import import_module
from os.path import exists, isfile
from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.options import BASES, COUPLINGS, POSITIVE, compiler_option, note
from flexbeams.scenarios.cli.run import assignment

# Format: function that writes it, suffix of its file or folder
KINDS = {
    "ssp": ("flexbeams.scenarios.exporting.ssp:export_ssp", ".ssp"),
    "ospsystem": ("flexbeams.scenarios.exporting.osp:export_osp", "_osp"),
    "closed-loop": ("flexbeams.scenarios.exporting.closed_loop:export_closed_loop", ".fmu"),
    "container": ("flexbeams.scenarios.exporting.container:export_container", ".fmu"),
}


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option(
    "--format",
    "kind",
    type=click.Choice(list(KINDS)),
    default="ssp",
    show_default=True,
    help="ssp: an SSP 1.0 package with units, connections, signals and start values. "
    "ospsystem: a folder (or .zip) with OspSystemStructure.xml and the units, for tools of the Open "
    "Simulation Platform. "
    "closed-loop: one FMU that holds all units and their wiring; the signals stay outside. "
    "container: the same made of the single units by FMUContainer (extra `containers`).",
)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The file, or folder, to write. [default: <scenario> with the format's suffix]",
)
@click.option(
    "--platform",
    "platforms",
    multiple=True,
    default=("host",),
    show_default=True,
    metavar="P",
    help="Binaries in the units: host, all, or names as for `flexbeams build`. Repeatable.",
)
@compiler_option
@click.option("--coupling", type=COUPLINGS, help="Override the scenario's coupling.")
@click.option("--basis", type=BASES, help="Override the basis of design and plant.")
@click.option("--structure", metavar="FILE", help="Override the scenario's structure.")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    callback=assignment,
    metavar="UNIT.VARIABLE=VALUE",
    help="Set a start value or parameter, as for `flexbeams run`; it is built into the unit. Repeatable.",
)
@click.option("--stop-time", type=POSITIVE, metavar="S", help="Simulated time in s.")
@click.option("--step", type=POSITIVE, metavar="S", help="Communication step in s.")
def export(scenario: str, kind: str, out: Path | None, platforms: tuple[str, ...], **options: Any) -> int:
    """Write a scenario for other tools: the closed loop, complete in one file or folder."""
    from flexbeams.scenarios.definition.settings import Settings

    place, suffix = KINDS[kind]
    module, _, function = place.partition(":")
    file = out or Path(f"{Path(scenario).stem}{suffix}")
    if suffix.startswith(".") and exists(file) and not isfile(file):
        raise click.BadParameter("must be a regular file or a new path", param_hint="--out")
    if kind == "ospsystem" and not file.name:
        raise click.BadParameter("must be a folder, or FILE.zip", param_hint="--out")
    write = getattr(import_module(module), function)
    click.echo(write(scenario, file, Settings(record_animation=False, **options), platforms, note))
    return 0
