"""The verb `flexbeams identify hysteresis`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexbeams.scenarios.cli.options import note, structure_option

if TYPE_CHECKING:
    from flexbeams.plant.identification.hysteresis import HysteresisFit

FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.argument("file", type=FILE, metavar="DATA.csv")
@structure_option
@click.option(
    "--map",
    "mapping",
    multiple=True,
    metavar="SIGNAL=COLUMN[*FACTOR]",
    help="Column of a signal (time, u[1], y_pi[1], y_pm[1]) and factor to SI. Repeatable.",
)
@click.option("--pair", type=click.IntRange(min=1), help="Patch pair. Default: the only one whose voltage changes.")
@click.option("--sensor", metavar="NAME", help="Response, such as y_pi[1]. Default: what follows the voltage best.")
@click.option("--plays", type=click.IntRange(1, 12), help="Number of play operators. Default: by cross-validation.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Structure file to write.")
@click.option(
    "--report",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Page to write. Default: hysteresis.html beside OUT.",
)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def hysteresis(
    file: Path,
    structure: str | None,
    mapping: tuple[str, ...],
    pair: int | None,
    sensor: str | None,
    plays: int | None,
    out: Path | None,
    report: Path | None,
    as_json: bool,
) -> int:
    """Fit hysteresis and creep of one patch pair to measured loops, for [actuator] of a structure.

    Drive the pair slowly, up and down through its whole range and back to zero in between, then through smaller loops;
    columns are time, u[k] in V, and y_pi[k] in m or y_pm[k].
    """
    from flexbeams.plant.identification.compensation import remaining_error
    from flexbeams.plant.identification.hysteresis import fit_hysteresis
    from flexbeams.plant.identification.loops import LoopColumns, read_loops
    from flexbeams.plant.identification.reading import Column
    from flexbeams.scenarios.cli.identify_options import columns_of

    columns = {
        signal: Column(name=column) if isinstance(column, str) else Column(name=column[0], factor=column[1])
        for signal, column in columns_of(mapping).items()
    }
    loops = read_loops(file, LoopColumns(pair=pair, sensor=sensor, mapping=columns))
    fit = fit_hysteresis(
        loops, plays, lambda count, error: note(f"{count} play operators: {100 * error:.3g} % on rows held back")
    )
    _, largest, rms = remaining_error(fit)
    page = report or (out and out.parent / "hysteresis.html")
    if out is not None:
        from flexbeams.plant.identification.actuator_file import write_pair
        from flexbeams.plant.structure import find_structure

        write_pair(find_structure(structure or "kiel"), pair or loops.pair, fit, out)
        note(f"structure written to {out}")
    if page is not None:
        from flexbeams.scenarios.report.hysteresis import write_hysteresis_page

        write_hysteresis_page(fit, page)
        note(f"page written to {page}")
    if as_json:
        click.echo(json.dumps(as_table(fit, largest, rms), indent=2))
    else:
        _show(fit, largest, rms)
    return 0


def as_table(fit: "HysteresisFit", largest: float, rms: float) -> dict[str, Any]:
    """Everything in SI units, errors as shares of the stroke."""
    from dataclasses import asdict

    return {
        "file": fit.loops.name,
        "sensor": fit.loops.sensor,
        "stroke": fit.loops.stroke,
        "gain": fit.gain,
        "line": fit.line,
        "largest_residual": fit.largest,
        "rms_residual": fit.rms,
        "explained": fit.explained,
        "compensator_largest": largest,
        "compensator_rms": rms,
        "trials": fit.trials,
        "pair": asdict(fit.pair),
    }


def _show(fit: "HysteresisFit", largest: float, rms: float) -> None:
    from flexbeams.plant.identification.actuator_file import pair_text

    click.echo(pair_text(fit), nl=False)
    note(
        f"{fit.loops.sensor}: {100 * fit.line:.3g} % of the stroke off a straight line, the model leaves "
        f"{100 * fit.largest:.3g} % ({100 * fit.rms:.3g} % rms), explains {100 * fit.explained:.4g} % of the variance"
    )
    note(f"a compensator made of it leaves {100 * largest:.3g} % ({100 * rms:.3g} % rms), predicted on these data")
