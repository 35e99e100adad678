"""The verb `flexbeams export`."""

from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.options import compiler_option, flags_option, note, say, scenario_options
from flexbeams.scenarios.definition.choices import EXPORT_SUFFIXES, SSP_VERSIONS, WIRING_TOOLS


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option(
    "--format",
    type=click.Choice(list(EXPORT_SUFFIXES)),
    help="By default that of the suffix of FILE: .ssp, .fmu (closed-loop), a folder or .zip (ospsystem). "
    "ssp: an SSP package with units, connections, signals and start values. "
    "ospsystem: a folder (or .zip) with OspSystemStructure.xml and the units, for tools of the Open "
    "Simulation Platform. "
    "closed-loop: one FMU that holds all units and their connections; external signals become its inputs. "
    "container: the same, made of the single units by FMUContainer (extra `containers`). "
    "wiring: a folder (or .zip) with the units and the files of --wiring.",
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
@scenario_options(
    "Set a start value or parameter, as for `flexbeams run`; it is built into the unit.", "Communication step in s."
)
@click.option(
    "--ssp-version",
    type=click.Choice(list(SSP_VERSIONS)),
    help="For ssp: 1.0 (default), or 2.0 for tools that read nothing else (Xcos).",
)
@click.option(
    "--parts",
    callback=lambda context, parameter, text: tuple(p.strip() for p in text.split(",")) if text else (),
    metavar="A,B",
    help="For closed-loop: only these units of the scenario; what the others drive are inputs of the unit.",
)
@click.option(
    "--with-signals",
    is_flag=True,
    help="For closed-loop: the scenario's signals inside. Else they are in the CSV file <FILE>_in.csv.",
)
@click.option(
    "--wiring",
    multiple=True,
    type=click.Choice(WIRING_TOOLS),
    help="A folder with the units and their wiring for a tool without SSP. Repeatable.",
)
@flags_option
def export(scenario: str, out: Path | None, overrides: dict[str, Any], **options: Any) -> int:
    """Write a scenario for other tools: the closed loop, complete in one file or folder."""
    from flexbeams.scenarios.api.exports import export as write

    say(write(scenario, out, start=overrides, notify=note, **options))
    return 0
