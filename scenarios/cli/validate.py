"""The verb `flexbeams validate`."""

from pathlib import Path

import click

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.options import POSITIVE, max_size_option, note, say


@click.command()
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
@click.option(
    "--patience",
    type=POSITIVE,
    default=600.0,
    show_default=True,
    metavar="S",
    help="Seconds after which the code of a unit, which runs in a process of its own, is ended.",
)
@max_size_option
def validate(files: tuple[Path, ...], runs: bool, patience: float) -> int:
    """Check FMUs and SSP packages; prints every problem.

    FMUs: the FMI 2.0 schema and its rules; the reference results inside (FMI-LS-REF), which fail where they
    cannot be checked. Packages: the SSP 1.0 schemas, connectors, units, start values, and the FMUs inside.
    """
    from flexbeams.plant.errors import FlexbeamsError

    status = 0
    for path in files:
        try:
            failures = _checked(path, runs, patience)
        except FlexbeamsError as error:  # of a unit's code, or a file that cannot be read: the others are still checked
            note(f"flexbeams: {error}")
            failures = 0
            status = 2
        status = max(status, 1 if failures else 0)
    return status


def _checked(path: Path, runs: bool, patience: float) -> int:
    """Prints what is found in a file; returns the number of failures."""
    from flexbeams.scenarios.importing.package import is_package
    from flexbeams.scenarios.validation.guarded_checks import guarded_checks
    from flexbeams.scenarios.validation.package import package_problems, unit_problems
    from flexbeams.scenarios.validation.rules import platform_note

    package = is_package(path.name)
    notes: list[str] = []
    problems = package_problems(path, notes.append) if package else unit_problems(path)
    if package and not problems:
        problems = _run_problems(path, notes)
    elif not package and not problems and (text := platform_note(path)):
        notes.append(text)
    checks = [] if package or problems or not runs else guarded_checks(path, patience)
    for problem in problems:
        say(f"{path}: {problem}")
    if not problems:
        say(f"{path}: valid")
    for check in checks:
        say(f"{path}: {check.message}")
    for text in notes:
        say(f"{path}: note: {text}")
    return len(problems) + sum(not check.passed for check in checks)


def _run_problems(path: Path, notes: list[str]) -> list[str]:
    """Why `flexbeams run` refuses a valid package, such as a stop time between two steps; a note where options help."""
    from flexbeams.scenarios.definition.settings import Settings
    from flexbeams.scenarios.runs.package import extracted_package, prepare_package

    try:
        with extracted_package(path) as extracted:
            prepare_package(extracted, Settings())
    except InputError as error:
        text = str(error).removeprefix(f"{path}: ")
        if not error.key.startswith("--"):
            return [text]
        notes.append(text)
    return []
