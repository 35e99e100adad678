"""The verb `flexbeams identify`: parameters and static gains from measured data."""

import json
import math
import re
from pathlib import Path
from typing import Any

import click

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.options import BASIS, note, structure_option

FILES = click.Path(exists=True, dir_okay=False, path_type=Path)
map_option = click.option(
    "--map",
    "mapping",
    multiple=True,
    metavar="SIGNAL=COLUMN[*FACTOR]",
    help="Column of a signal (time, u[1], force[1], y_pi[1], y_pm[1]) and factor to SI. Repeatable.",
)


class ParametersByDefault(click.Group):
    """A group whose arguments, where they name no command, are those of `parameters`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Puts the default command in front."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["parameters", *args]
        return super().parse_args(ctx, args)


@click.group(cls=ParametersByDefault)
def identify() -> None:
    """Identify a structure's parameters from measured step responses, sweeps or blows.

    `flexbeams identify DATA.csv ... --structure START.toml --out RESULT.toml` is short for `identify parameters`;
    `flexbeams identify static DATA.csv ...` measures static gains.
    """


@identify.command()
@click.argument("files", nargs=-1, required=True, type=FILES, metavar="DATA.csv...")
@structure_option
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Structure file to write.")
@click.option(
    "--report",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Page to write. Default: identify.html beside OUT.",
)
@click.option("--known", multiple=True, metavar="NAME=VALUE", help="A parameter that is known, in SI. Repeatable.")
@click.option("--fix", multiple=True, metavar="NAME", help="Keep at the structure's value; patch[].density for all.")
@click.option("--free", multiple=True, metavar="NAME", help="Identify these only. Default: all.")
@click.option("--prior", multiple=True, metavar="NAME=PERCENT", help="How well a start value is known.")
@click.option("--bounds", multiple=True, metavar="NAME=LOW:HIGH", help="Limits of a parameter, in SI.")
@click.option("--weight", multiple=True, metavar="SENSOR=WEIGHT", help="Relative weight, such as y_pm[]=0.1.")
@click.option("--delay", multiple=True, metavar="SENSOR=SECONDS", help="Known delay of a sensor.")
@click.option("--fit-delays", is_flag=True, help="Fit a delay for each sensor.")
@click.option("--fit-offsets", is_flag=True, help="Fit an offset for each sensor and file.")
@map_option
@click.option("--hold-back", multiple=True, type=FILES, help="File for validation only. Repeatable.")
@click.option("--uncoupled", multiple=True, type=FILES, help="File recorded with the springs taken off. Repeatable.")
@click.option("--free-start", multiple=True, type=FILES, help="File that does not start at rest. Repeatable.")
@click.option("--window", metavar="BEGIN:END", help="Times that count, s, in the files' own time.")
@click.option("--basis", type=BASIS, default="clamped_free", show_default=True, help="Galerkin basis of the model.")
@click.option("--order", type=click.IntRange(min=1), help="Modes of a beam, or polynomial degree.")
@click.option("--loss", type=click.Choice(["soft_l1", "linear"]), default="soft_l1", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def parameters(
    files: tuple[Path, ...],
    structure: str | None,
    out: Path | None,
    report: Path | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Fit the structure's parameters to measured data and say what the data leave open.

    Undetermined parameters keep their start and are marked so. Interrupted, it keeps the best fit so far.
    """
    from flexbeams.plant.identification.writing import write_identified
    from flexbeams.plant.structure import find_structure
    from flexbeams.scenarios.cli.identify_tables import as_table, show_identification
    from flexbeams.scenarios.report.identification import write_identification

    start = find_structure(structure or "kiel")
    result = _identified(start, files, options)
    if out is not None:
        write_identified(start, result, out)
        note(f"structure written to {out}")
    if page := report or (out and out.parent / "identify.html"):
        write_identification(result, page)
        note(f"page written to {page}")
    if as_json:
        click.echo(json.dumps(as_table(result), indent=2))
    else:
        show_identification(result)
    return 1 if result.estimate.interrupted else 0


@identify.command()
@click.argument("files", nargs=-1, required=True, type=FILES, metavar="DATA.csv...")
@structure_option
@map_option
@click.option("--window", metavar="BEGIN:END", help="Times that count, s, in the files' own time.")
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("static_maps.csv"),
    show_default=True,
    help="File of the gains.",
)
def static(
    files: tuple[Path, ...], structure: str | None, mapping: tuple[str, ...], window: str | None, out: Path
) -> int:
    """Measure the static gains of each patch pair, with 95 % intervals, for `static_maps` of a design."""
    from flexbeams.plant.identification.reading import read_experiment
    from flexbeams.plant.identification.static import static_maps_of
    from flexbeams.plant.static_maps import write_static_maps
    from flexbeams.plant.structure import find_structure, read_structure

    beams = read_structure(find_structure(structure or "kiel"))
    experiments = [read_experiment(path, beams, _reading(mapping, window)) for path in files]
    maps = static_maps_of(
        experiments, pairs=len(beams.patch), points=len(beams.point_of_interest), gauges=len(beams.strain_gauge)
    )
    write_static_maps(maps, out, "Measured static gains with half widths of 95 % intervals")
    click.echo(out)
    return 0


def _identified(start: Path, files: tuple[Path, ...], options: dict[str, Any]) -> Any:
    """The identification that the options of `parameters` ask for."""
    from flexbeams.plant.identification.estimate import Settings
    from flexbeams.plant.identification.method import identify as run_identification
    from flexbeams.plant.identification.plausibility import require_plausible
    from flexbeams.plant.identification.reading import read_experiment
    from flexbeams.plant.structure import read_structure

    structure = read_structure(start)
    reading = _reading(options["mapping"], options["window"])
    every = dict.fromkeys([*files, *options["hold_back"], *options["uncoupled"], *options["free_start"]])
    experiments = [
        read_experiment(
            path,
            structure,
            reading,
            start="free" if path in options["free_start"] else "rest",
            uncoupled=path in options["uncoupled"],
            held_back=path in options["hold_back"],
        )
        for path in every
    ]
    if all(experiment.held_back for experiment in experiments):
        raise InputError("--hold-back", "must leave at least one file to fit")
    space = _space(structure, options)
    require_plausible(structure, experiments, space.names)
    settings = Settings(
        loss=options["loss"],
        weights=_of_sensors(structure, options["weight"], "--weight", 1.0) if options["weight"] else None,
        delays=_of_sensors(structure, options["delay"], "--delay", 0.0),
        fit_delays=options["fit_delays"],
        fit_offsets=options["fit_offsets"],
    )
    return run_identification(
        structure,
        experiments,
        space,
        basis=options["basis"],
        order=options["order"],
        settings=settings,
        notify=lambda stage: note(f"fitting {stage}"),
    )


def _space(structure: Any, options: dict[str, Any]) -> Any:
    from flexbeams.plant.identification.space import parameter_space, select

    values = structure.parameters()
    known: dict[str, float] = {}
    for text in options["known"]:
        name, value = _assignment(text, "--known")
        known |= dict.fromkeys(select(structure, name, "--known"), _number(value, text, "--known"))
    for pattern in options["fix"]:
        known |= {name: values[name] for name in select(structure, pattern, "--fix")}
    free = [name for pattern in options["free"] for name in select(structure, pattern, "--free")]
    priors: dict[str, float] = {}
    for text in options["prior"]:
        name, value = _assignment(text, "--prior")
        share = _number(value.rstrip("%"), text, "--prior") / 100
        if share <= 0:
            raise InputError("--prior", "must be > 0 percent", text)
        priors |= dict.fromkeys(select(structure, name, "--prior"), share)
    bounds: dict[str, tuple[float, float]] = {}
    for text in options["bounds"]:
        name, value = _assignment(text, "--bounds")
        low, _, high = value.partition(":")
        limits = (_number(low, text, "--bounds"), _number(high, text, "--bounds"))
        bounds |= dict.fromkeys(select(structure, name, "--bounds"), limits)
    checked = structure.with_parameters(known)
    return parameter_space(checked, free=free or None, known=known, bounds=bounds, priors=priors)


def _of_sensors(structure: Any, texts: tuple[str, ...], option: str, default: float) -> Any:
    """A value for each sensor; y_pm[] stands for all gauges."""
    import numpy as np

    from flexbeams.plant.errors import suggestion
    from flexbeams.plant.identification.experiment import sensor_names

    names = sensor_names(structure)
    values = np.full(len(names), default)
    for text in texts:
        name, value = _assignment(text, option)
        chosen = [k for k, sensor in enumerate(names) if sensor == name or re.sub(r"\d+", "", sensor) == name]
        if not chosen:
            raise InputError(option, f"{name} is not a sensor" + suggestion(name, names))
        number = _number(value, text, option)
        if number < 0 or (number == 0 and default == 1.0):
            raise InputError(option, "must be > 0" if default == 1.0 else "must be >= 0", text)
        values[chosen] = number
    return values


def _reading(mapping: tuple[str, ...], window: str | None) -> Any:
    from flexbeams.plant.identification.reading import Column, Reading

    columns = {}
    for text in mapping:
        signal, column = _assignment(text, "--map")
        name, star, factor = column.rpartition("*")
        columns[signal] = Column(name=name, factor=_number(factor, text, "--map")) if star else Column(name=column)
    begin, _, end = (window or ":").partition(":")
    return Reading(
        columns=columns,
        begin=_number(begin, window or "", "--window") if begin else None,
        end=_number(end, window or "", "--window") if end else None,
    )


def _assignment(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise InputError(option, "must read NAME=VALUE", text)
    return name.strip(), value.strip()


def _number(text: str, whole: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(option, "must have a finite number", whole)
    return value
