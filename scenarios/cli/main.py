"""The command `flexbeams`."""

import io
import json
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

import click

from flexbeams.plant.errors import FlexbeamsError, InputError
from flexbeams.scenarios.cli.bench import bench
from flexbeams.scenarios.cli.compare import compare
from flexbeams.scenarios.cli.export import export
from flexbeams.scenarios.cli.identify import identify
from flexbeams.scenarios.cli.options import BASES, compiler_option, note, structure_option
from flexbeams.scenarios.cli.run import run


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="flexbeams")
def commands() -> None:
    """Co-simulation units (FMI 2.0) of elastically coupled piezoelectric beams and their control.

    Begin with `flexbeams run tracking`. Exit status: 0 done and all checks hold, 1 a check failed, 2 misuse or
    bad input.
    """


commands.add_command(run)
commands.add_command(compare)
commands.add_command(export)
commands.add_command(bench)
commands.add_command(identify)


@commands.command()
@structure_option
@click.option(
    "--basis",
    type=BASES,
    default="clamped_free",
    show_default=True,
    help="Galerkin basis: the paper's, or the high-fidelity one.",
)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Also write the design file here.")
def design(structure: str | None, basis: str, as_json: bool, out: Path | None) -> None:
    """Compute the design of a structure and show its figures.

    Frequencies and damping of every mode, Hankel singular values, static gains, closed-loop spectra.
    """
    from flexbeams.controller.design import compute_design
    from flexbeams.controller.design_file import write_design
    from flexbeams.controller.options import DesignOptions
    from flexbeams.plant.structure import find_structure, read_structure
    from flexbeams.scenarios.cli.tables import show_design

    finished = compute_design(read_structure(_structure_path(find_structure, structure)), DesignOptions(basis=basis))  # type: ignore[arg-type]
    if out is not None:
        write_design(finished, out)
        note(f"design written to {out}")
    if as_json:
        click.echo(json.dumps({"design_id": finished.design_id, **finished.summary}, indent=2))
    else:
        show_design(finished)


@commands.command()
@click.argument("units", nargs=-1, metavar="[UNIT]...")
@structure_option
@click.option("--basis", type=BASES, default="clamped_free", show_default=True, help="Basis of design and plant.")
@click.option(
    "--backend",
    type=click.Choice(["native", "python", "all"]),
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
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("build/fmus"),
    show_default=True,
    help="Folder; the units go to OUT/<backend>/<Unit>.fmu.",
)
def build(
    units: tuple[str, ...],
    structure: str | None,
    basis: str,
    backend: str,
    platforms: tuple[str, ...],
    compiler: str,
    out: Path,
) -> None:
    """Build FMUs: BeamPlant, FlatnessFeedforward, TrackingController, or those named.

    Native units are C99 and need nothing but themselves. Units of one design belong together: build them in one go.
    """
    from flexbeams.controller.design import compute_design
    from flexbeams.controller.options import DesignOptions
    from flexbeams.fmus.packaging.build import BACKENDS, build_units
    from flexbeams.fmus.units.catalogue import CATALOGUE, require_kind
    from flexbeams.plant.structure import find_structure, read_structure

    kinds = [require_kind(name, "UNIT") for name in dict.fromkeys(units)] or CATALOGUE
    finished = compute_design(read_structure(_structure_path(find_structure, structure)), DesignOptions(basis=basis))  # type: ignore[arg-type]
    for kernel in (k for k in BACKENDS if backend in (k, "all")):
        for path in build_units(
            kinds, finished, finished.model(), out, backend=kernel, platforms=platforms, compiler=compiler
        ):
            click.echo(path)


@commands.command(name="list")
def list_scenarios() -> None:
    """The scenarios that ship, one line each."""
    from flexbeams.scenarios.definition.schema import first_comment, scenario_files

    files = scenario_files()
    width = max(map(len, files))
    for name, path in files.items():
        click.echo(f"{name:{width}}  {first_comment(path)}")


@commands.command()
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FMU|SSP..."
)
@click.option(
    "--run/--no-run",
    "runs",
    default=True,
    show_default=True,
    help="Simulate FMUs that carry reference results, and compare.",
)
def validate(files: tuple[Path, ...], runs: bool) -> int:
    """Check FMUs and SSP packages; prints every complaint.

    FMUs: the FMI 2.0 schema and its rules; the reference results inside (FMI-LS-REF). Packages: the SSP 1.0 schemas,
    connectors, units, start values, and the FMUs inside.
    """
    from flexbeams.scenarios.importing.package import is_package
    from flexbeams.scenarios.validation.package import package_problems, unit_problems
    from flexbeams.scenarios.validation.references import reference_checks

    complaints = 0
    for path in files:
        package = is_package(path.name)
        problems = package_problems(path) if package else unit_problems(path)
        checks = [] if package or problems or not runs else reference_checks(path)
        complaints += len(problems) + sum(not agrees for agrees, _ in checks)
        for problem in problems:
            click.echo(f"{path}: {problem}")
        if not problems:
            click.echo(f"{path}: valid")
        for _, line in checks:
            click.echo(f"{path}: {line}")
    return 1 if complaints else 0


def _structure_path(find: Callable[[str], Path], name: str | None) -> Path:
    try:
        return find(name or "kiel")
    except InputError as error:
        raise error.at("--structure") from None


def _take_any_text() -> None:
    """Characters that the terminal's encoding lacks, µ and ± perhaps, are replaced instead of ending the run."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors="replace")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status; errors that a user can mend take one line."""
    _take_any_text()
    os.environ["MPLBACKEND"] = "agg"  # figures go to files, whatever the user draws with
    try:
        status = commands.main(args=None if argv is None else list(argv), prog_name="flexbeams", standalone_mode=False)
        return status if isinstance(status, int) else 0
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.Abort:
        note("flexbeams: interrupted")
        return 130
    except click.UsageError as error:
        if isinstance(error, click.exceptions.NoArgsIsHelpError):
            click.echo(error.format_message())
            return 2
        place = error.ctx.command_path if error.ctx else "flexbeams"
        note(f"flexbeams: {error.format_message()} (see `{place} --help`)")
        return 2
    except click.ClickException as error:
        note(f"flexbeams: {error.format_message()}")
        return 2
    except FlexbeamsError as error:
        if os.environ.get("FLEXBEAMS_DEBUG", "0") not in ("", "0"):
            traceback.print_exc()
        note(f"flexbeams: {error}")
        return 2


if __name__ == "__main__":
    sys.exit(main())
