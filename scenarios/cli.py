"""The command `flexbeams`."""

import json
import sys
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from plant.errors import FlexbeamsError, InputError

BASES = click.Choice(["clamped_free", "segment"])
COUPLINGS = click.Choice(["jacobi", "gauss-seidel"])
BACKENDS = click.Choice(["python"])
UNIT_NAMES = ("BeamPlant", "FlatnessFeedforward", "TrackingController")

structure_option = click.option("--structure", metavar="FILE", help="Structure file, or a shipped one by name "
                                "(kiel, single_beam, five_beams).")


def note(text: str) -> None:
    """One line for the person at the terminal, apart from the data on stdout."""
    click.echo(text, err=True)


def _assignment(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> dict[str, float | bool]:
    """UNIT.VARIABLE=VALUE options as a table."""
    table: dict[str, float | bool] = {}
    for text in values:
        name, equals, value = text.rpartition("=")
        if not equals or "." not in name:
            raise click.BadParameter(f"must be INSTANCE.VARIABLE=VALUE, got {text!r}")
        if value.lower() in ("true", "false"):
            table[name] = value.lower() == "true"
            continue
        try:
            table[name] = float(value)
        except ValueError:
            raise click.BadParameter(f"{name} must be a number, true or false, got {value!r}") from None
        if not float("-inf") < table[name] < float("inf"):
            raise click.BadParameter(f"{name} must be finite, got {value!r}")
    return table


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="flexbeams")
def commands() -> None:
    """Co-simulation units (FMI 2.0) of elastically coupled piezoelectric beams and their control.

    Begin with `flexbeams run tracking`. Exit status: 0 done and all checks hold, 1 a check failed, 2 misuse or
    bad input.
    """


@commands.command()
@structure_option
@click.option("--basis", type=BASES, default="clamped_free", show_default=True,
              help="Galerkin basis: the paper's, or the high-fidelity one.")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Also write the design file here.")
def design(structure: str | None, basis: str, as_json: bool, out: Path | None) -> None:
    """Compute the design of a structure and show its figures.

    Frequencies and damping of every mode, Hankel singular values, static gains, closed-loop spectra.
    """
    from controller.design import DesignOptions, compute_design, write_design
    from plant.structure import find_structure, read_structure
    from scenarios.tables import show_design

    finished = compute_design(read_structure(_structure_path(find_structure, structure)),
                              DesignOptions(basis=basis))  # type: ignore[arg-type]
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
@click.option("--backend", type=BACKENDS, default="python", show_default=True, help="Kernel of the units.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("build/fmus"), show_default=True,
              help="Folder; the units go to OUT/<backend>/<Unit>.fmu.")
def build(units: tuple[str, ...], structure: str | None, basis: str, backend: str, out: Path) -> None:
    """Build FMUs: BeamPlant, FlatnessFeedforward, TrackingController, or those named.

    Units of one design belong together: build them in one go.
    """
    from controller.design import DesignOptions, compute_design
    from fmus.build import build_units
    from plant.errors import suggestion
    from plant.structure import find_structure, read_structure

    for name in units:
        if name not in UNIT_NAMES:
            raise InputError("UNIT", "is not a unit" + suggestion(name, UNIT_NAMES), name)
    finished = compute_design(read_structure(_structure_path(find_structure, structure)),
                              DesignOptions(basis=basis))  # type: ignore[arg-type]
    for path in build_units(list(dict.fromkeys(units)) or list(UNIT_NAMES), finished, finished.model(), out):
        click.echo(path)


@commands.command()
@click.argument("scenarios", nargs=-1, required=True, metavar="SCENARIO...")
@click.option("--backend", type=BACKENDS, default="python", show_default=True, help="Kernel of the units.")
@click.option("--coupling", type=COUPLINGS, help="Override the scenario's coupling.")
@click.option("--basis", type=BASES, help="Override the basis of design and plant.")
@click.option("--structure", metavar="FILE", help="Override the scenario's structure.")
@click.option("--set", "values", multiple=True, callback=_assignment, metavar="UNIT.VARIABLE=VALUE",
              help="Set a start value or parameter, such as plant.beam[1].tip_mass=0.03. Repeatable.")
@click.option("--stop-time", type=click.FloatRange(min=0, min_open=True), metavar="S", help="Simulated time in s.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path),
              help="Folder of the results; with several scenarios a folder for each inside it. "
                   "[default: results/<scenario>]")
@click.option("--no-figures", is_flag=True, help="Write no figures.")
def run(scenarios: tuple[str, ...], backend: str, coupling: str | None, basis: str | None, structure: str | None,
        values: dict[str, float | bool], stop_time: float | None, out: Path | None, no_figures: bool) -> int:
    """Run scenarios (names from `flexbeams list`, or files) and check the results.

    Builds the units that are missing, runs them, writes results.csv, summary.json and figures, and prints each
    check beside the paper's figure.
    """
    from scenarios.run import Settings, run_scenario, write_run
    from scenarios.schema import find_scenario
    from scenarios.tables import show_checks

    for name in scenarios:
        find_scenario(name)
    settings = Settings(backend=backend, coupling=coupling, basis=basis, structure=structure,  # type: ignore[arg-type]
                        stop_time=stop_time, values=values)
    status = 0
    for name in scenarios:
        folder = out or Path("results") / Path(name).stem
        if out is not None and len(scenarios) > 1:
            folder = out / Path(name).stem
        _require_folder(folder)
        with _progress(Path(name).stem) as progress:
            finished = run_scenario(name, settings, report=note, progress=progress)
        write_run(finished, folder, figures=not no_figures)
        show_checks(finished, folder)
        if finished.recording.interrupted:
            note(f"interrupted at {finished.recording.time[-1]:.6g} s; what was recorded is marked incomplete")
            return 130
        if finished.recording.failure is not None:
            note(f"flexbeams: {finished.recording.failure}; what was recorded up to then is in {folder}")
            status = 2
        elif not finished.passed:
            status = max(status, 1)
    return status


@commands.command(name="list")
def list_scenarios() -> None:
    """The scenarios that ship, one line each."""
    from scenarios.schema import first_comment, scenario_files

    files = scenario_files()
    width = max(map(len, files))
    for name, path in files.items():
        click.echo(f"{name:{width}}  {first_comment(path)}")


@commands.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False, path_type=Path),
                metavar="FMU...")
def validate(files: tuple[Path, ...]) -> int:
    """Check FMUs against the FMI 2.0 schema and its rules; prints every complaint."""
    from fmpy.validation import validate_fmu

    complaints = 0
    for path in files:
        try:
            problems = validate_fmu(str(path))
        except Exception as error:
            problems = [str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__]
        complaints += len(problems)
        for problem in problems:
            click.echo(f"{path}: {problem}")
        if not problems:
            click.echo(f"{path}: valid")
    return 1 if complaints else 0


def _structure_path(find: Callable[[str], Path], name: str | None) -> Path:
    try:
        return find(name or "kiel")
    except InputError as error:
        raise error.at("--structure") from None


def _require_folder(folder: Path) -> None:
    """A folder for results, made here so that a run is not lost for want of one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("", f"cannot be made a folder for results: {error.strerror}", source=str(folder)) from None


@contextmanager
def _progress(name: str) -> Any:
    """A progress bar on stderr where that is a terminal; yields progress(done, steps)."""
    if not sys.stderr.isatty():
        yield lambda done, steps: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    with Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("steps"),
                  TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(name, total=None)
        yield lambda done, steps: bars.update(task, completed=done, total=steps)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status; errors that a user can mend take one line."""
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
        note(f"flexbeams: {error.format_message()} (see `flexbeams --help`)")
        return 2
    except click.ClickException as error:
        note(f"flexbeams: {error.format_message()}")
        return 2
    except FlexbeamsError as error:
        note(f"flexbeams: {error}")
        return 2
    except (RuntimeError, OSError) as error:
        note(f"flexbeams: {error}")
        return 2


if __name__ == "__main__":
    sys.exit(main())
