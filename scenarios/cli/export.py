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
    "wiring": ("flexbeams.scenarios.exporting.wiring:export_wiring", "_units"),
}
TOOLS = ("veos", "simulink", "dymola", "mastersim", "te1420")

# Options of single formats
FORMATS_OF = {
    "ssp_version": ("ssp",),
    "parts": ("closed-loop",),
    "with_signals": ("closed-loop",),
    "wiring": ("wiring",),
    "flags_as_real": ("ssp", "ospsystem", "closed-loop", "wiring"),
}


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option(
    "--format",
    "kind",
    type=click.Choice(list(KINDS)),
    help="By default the format of the suffix of FILE, else ssp. "
    "ssp: an SSP package with units, connections, signals and start values. "
    "ospsystem: a folder (or .zip) with OspSystemStructure.xml and the units, for tools of the Open "
    "Simulation Platform. "
    "closed-loop: one FMU that holds all units and their wiring; the signals stay outside. "
    "container: the same made of the single units by FMUContainer (extra `containers`). "
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
@click.option(
    "--ssp-version",
    type=click.Choice(["1.0", "2.0"]),
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
    type=click.Choice(TOOLS),
    help="A folder with the units and their wiring for a tool without SSP. Repeatable.",
)
@click.option("--flags-as-real", is_flag=True, help="Boolean outputs as Real, 0 or 1, for hosts that know only Real.")
@click.option("--stop-time", type=POSITIVE, metavar="S", help="Simulated time in s.")
@click.option("--step", type=POSITIVE, metavar="S", help="Communication step in s.")
def export(scenario: str, kind: str | None, out: Path | None, platforms: tuple[str, ...], **options: Any) -> int:
    """Write a scenario for other tools: the closed loop, complete in one file or folder."""
    from flexbeams.scenarios.definition.settings import Settings

    kind = kind or _format_of(out, options)
    extra = _own_options(kind, options)
    path, suffix = KINDS[kind]
    module, _, function = path.partition(":")
    file = out or Path(f"{Path(scenario).stem}{suffix}")
    if suffix.startswith(".") and exists(file) and not isfile(file):
        raise click.BadParameter("must be a regular file or a new path", param_hint="--out")
    if kind == "wiring" and "wiring" not in extra:
        raise click.BadParameter(f"must be given with --format wiring: {', '.join(TOOLS)}", param_hint="--wiring")
    if not suffix.startswith(".") and not file.name:
        raise click.BadParameter("must be a folder, or FILE.zip", param_hint="--out")
    write = getattr(import_module(module), function)
    click.echo(write(scenario, file, Settings(record_animation=False, **options), platforms, note, **extra))
    return 0


def _format_of(out: Path | None, options: dict[str, Any]) -> str:
    """By an option that only one format has, else by the suffix of the file; ssp where neither tells."""
    for name, formats in FORMATS_OF.items():
        if options[name] and len(formats) == 1:
            return formats[0]
    return {".fmu": "closed-loop"}.get(out.suffix.lower() if out else "", "ssp")


def _own_options(kind: str, options: dict[str, Any]) -> dict[str, Any]:
    """Takes the options of single formats out of `options`; those given must be of this format."""
    extra = {}
    for name, formats in FORMATS_OF.items():
        if not (value := options.pop(name)):
            continue
        if kind not in formats:
            raise click.BadParameter(
                f"belongs to --format {' or '.join(formats)}, not {kind}", param_hint=f"--{name.replace('_', '-')}"
            )
        extra[name] = value
    return extra
