"""The verb `flexbeams identify`: parameters and static gains from measured data."""

import json
from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.identify_hysteresis import hysteresis
from flexbeams.scenarios.cli.identify_plan import plan
from flexbeams.scenarios.cli.options import BASIS, note, say, structure_option

FILES = click.Path(exists=True, dir_okay=False, path_type=Path)
map_option = click.option(
    "--map",
    "mapping",
    multiple=True,
    metavar="SIGNAL=COLUMN[*FACTOR]",
    help="Column of a signal (time, u[1], force[1], y_pi[1], y_pm[1]) and factor to SI. Repeatable.",
)


class ParametersByDefault(click.Group):
    """A group whose arguments, where they name no command, are those of `parameters`, or with --plan of `plan`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Puts the command in front."""
        if "--plan" in args and args[0] not in self.commands:
            args = ["plan", *(argument for argument in args if argument != "--plan")]
        elif args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["parameters", *args]
        return super().parse_args(ctx, args)


@click.group(cls=ParametersByDefault)
def identify() -> None:
    """Identify a structure's parameters from measured step responses, sweeps or blows.

    `flexbeams identify DATA.csv ... --structure START.toml --out RESULT.toml` is short for `identify parameters`;
    `flexbeams identify static DATA.csv ...` measures static gains, `flexbeams identify hysteresis DATA.csv` fits
    hysteresis and creep of the patches; `flexbeams identify --plan` proposes an experiment.
    """


identify.add_command(plan)
identify.add_command(hysteresis)


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
@click.option("--offset", multiple=True, metavar="SENSOR=VALUE", help="What a sensor shows at zero, in SI.")
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
@click.option(
    "--steps",
    type=click.Choice(["all", "paper"]),
    default="all",
    show_default=True,
    help="All at once, or the paper's two steps: uncoupled beams, then springs.",
)
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
    from flexbeams.scenarios.api.identifications import identify as run_identification
    from flexbeams.scenarios.cli.identify_options import call_options
    from flexbeams.scenarios.cli.identify_progress import StageDisplay
    from flexbeams.scenarios.cli.identify_tables import as_table, show_identification

    page = report or (out and out.parent / "identify.html")
    with StageDisplay() as display:
        result = run_identification(
            *files,
            structure=structure or "kiel",
            out=out,
            report=page,
            notify=display.stage,
            progress=display.evaluation,
            **call_options(options),
        )
    if out is not None:
        note(f"structure written to {out}")
    if page is not None:
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
    from flexbeams.plant.static_maps import write_static_maps
    from flexbeams.scenarios.api.identifications import static_maps
    from flexbeams.scenarios.cli.identify_options import columns_of, window_of

    maps = static_maps(*files, structure=structure or "kiel", columns=columns_of(mapping), window=window_of(window))
    write_static_maps(maps, out, "Measured static gains with half widths of 95 % intervals")
    say(out)
    return 0
