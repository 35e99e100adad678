"""The verb `flexbeams build`."""

from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.options import (
    BASIS,
    chosen_structure,
    compiler_option,
    flags_option,
    note,
    say,
    structure_option,
)
from flexbeams.scenarios.definition.choices import BACKENDS


@click.command()
@click.argument("units", nargs=-1, metavar="[UNIT]...")
@structure_option
@click.option("--basis", type=BASIS, default="clamped_free", show_default=True, help="Basis of design and plant.")
@click.option(
    "--backend",
    type=click.Choice([*BACKENDS, "all"]),
    default="native",
    show_default=True,
    help="Kernel of the units: C, Python, or one of each.",
)
@click.option(
    "--platform",
    "platforms",
    multiple=True,
    default=("host",),
    show_default=True,
    metavar="P",
    help="Binaries in native units: host, all, x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, "
    "aarch64-darwin. Repeatable.",
)
@compiler_option
@flags_option
@click.option(
    "--out",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("build/fmus"),
    show_default=True,
    help="Folder; the units are written to OUT/<backend>/<Unit>.fmu.",
)
def build(units: tuple[str, ...], structure: str | None, basis: str, backend: str, **options: Any) -> None:
    """Build FMUs: BeamPlant, FlatnessFeedforward, TrackingController, MfcActuator, MfcCompensator, or those named.

    The last two need a section [actuator] in the structure file and are left out where there is none.
    Native units are C99 without dependencies. Units of one design belong together: build them in one go.
    """
    from flexbeams.fmus.units.catalogue import require_kind
    from flexbeams.scenarios.api.designs import design
    from flexbeams.scenarios.api.units import build as build_units

    for name in units:
        require_kind(name, "UNIT")
    computed = design(chosen_structure(structure), basis=basis)
    for kernel in (k for k in BACKENDS if backend in (k, "all")):
        for path in build_units(computed, units, backend=kernel, notify=note, **options):
            say(path)
