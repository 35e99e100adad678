"""Options that several verbs have."""

import math
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click

from flexbeams.plant.text import is_decimal, printable
from flexbeams.scenarios.definition.choices import BASES, COUPLINGS
from flexbeams.scenarios.definition.values import TypedNumber

Command = TypeVar("Command", bound=Callable[..., Any])

BASIS = click.Choice(list(BASES))


class Positive(click.FloatRange):
    """A finite number > 0."""

    def __init__(self) -> None:
        super().__init__(min=0, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Converts as FloatRange, and refuses infinity and NaN."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} must be finite and > 0", param, ctx)
        return number


POSITIVE = Positive()


def assignments(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> dict[str, Any]:
    """INSTANCE.VARIABLE=VALUE options as a table; several numbers, separated by commas, are those of an array."""
    table: dict[str, Any] = {}
    for text in values:
        name, equals, value = text.rpartition("=")
        if not equals or "." not in name:
            raise click.BadParameter(f"must be INSTANCE.VARIABLE=VALUE, got {text!r}")
        table[name] = _value(name, value)
    return table


def _value(name: str, text: str) -> bool | float | str | list[float]:
    """A number, numbers separated by commas, a truth value; anything else is a text, of a String or Enumeration."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true" if text.islower() else text
    parts = text.removeprefix("[").removesuffix("]").split(",")
    if any(part.strip().lstrip("+-").lower() in ("nan", "inf", "infinity") for part in parts):
        raise click.BadParameter(f"{name} must be finite, got {text!r}")
    if not all(is_decimal(part.strip()) for part in parts):
        return text
    numbers = [TypedNumber(part.strip()) for part in parts]
    if not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"{name} must be finite, got {text!r}")
    return list[float](numbers) if "," in text or text.startswith("[") else numbers[0]


structure_option = click.option(
    "--structure", metavar="FILE", help="Structure file, or a shipped one by name (kiel, single_beam, five_beams)."
)

compiler_option = click.option(
    "--compiler",
    default="zig",
    show_default=True,
    metavar="NAME",
    help="C compiler of native units: zig (the ziglang wheel), or one of the system's, such as gcc or clang.",
)

cache_option = click.option(
    "--cache",
    "build_folder",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Folder where built units are kept. [default: $FLEXBEAMS_CACHE, else the user's cache]",
)

flags_option = click.option(
    "--flags-as-real", is_flag=True, help="Boolean outputs as Real, 0 or 1, for hosts that know only Real."
)


def _set_max_size(context: click.Context, parameter: click.Parameter, value: float | None) -> None:
    """For this call and the processes that it starts."""
    if value is None:
        return
    before = os.environ.get("FLEXBEAMS_MAX_SIZE")
    os.environ["FLEXBEAMS_MAX_SIZE"] = repr(value)
    restore = partial(os.environ.pop, "FLEXBEAMS_MAX_SIZE", None)
    context.call_on_close(restore if before is None else partial(os.environ.update, FLEXBEAMS_MAX_SIZE=before))


max_size_option = click.option(
    "--max-size",
    type=POSITIVE,
    metavar="GB",
    callback=_set_max_size,
    expose_value=False,
    help="Largest size of an FMU or a package when extracted. [default: 1.07]",
)


def scenario_options(set_help: str, step_help: str) -> Callable[[Command], Command]:
    """Options that override values of a scenario; their names are fields of Settings."""
    options = (
        click.option("--coupling", type=click.Choice(list(COUPLINGS)), help="Override the scenario's coupling."),
        click.option("--basis", type=BASIS, help="Override the basis of design and plant."),
        click.option("--structure", metavar="FILE", help="Override the scenario's structure."),
        click.option(
            "--set",
            "overrides",
            multiple=True,
            callback=assignments,
            metavar="UNIT.VARIABLE=VALUE",
            help=f"{set_help} Repeatable.",
        ),
        click.option("--stop-time", type=POSITIVE, metavar="S", help="Simulated time in s."),
        click.option("--step", type=POSITIVE, metavar="S", help=step_help),
    )

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def note(text: str) -> None:
    """Prints one line to stderr, apart from the data on stdout."""
    click.echo(printable(text), err=True)


def say(text: object) -> None:
    """Prints one line to stdout."""
    click.echo(printable(str(text)))


def chosen_structure(name: str | None) -> Any:
    """The structure of the option --structure, by default `kiel`; implausible values are noted."""
    from flexbeams.plant.errors import InputError
    from flexbeams.plant.plausibility import implausible_values
    from flexbeams.plant.structure import find_structure, read_structure

    try:
        path = find_structure(name or "kiel")
    except InputError as error:
        raise error.at("--structure") from None
    structure = read_structure(path)
    for line in implausible_values(structure):
        note(f"{path}: {line}")
    return structure
