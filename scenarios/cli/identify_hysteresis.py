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
    from flexbeams.scenarios.api.hysteresis import identify_hysteresis
    from flexbeams.scenarios.cli.identify_options import columns_of

    page = report or (out and out.parent / "hysteresis.html")
    fit = identify_hysteresis(
        file,
        structure=structure or "kiel",
        pair=pair,
        sensor=sensor,
        plays=plays,
        columns=columns_of(mapping),
        out=out,
        report=page,
        notify=note,
    )
    if out is not None:
        note(f"structure written to {out}")
    if page is not None:
        note(f"page written to {page}")
    if as_json:
        click.echo(json.dumps(as_table(fit), indent=2))
    else:
        _show(fit)
    return 0


def as_table(fit: "HysteresisFit") -> dict[str, Any]:
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
        "compensator_largest": fit.largest_remaining,
        "compensator_rms": fit.rms_remaining,
        "trials": fit.trials,
        "pair": asdict(fit.pair),
    }


def _show(fit: "HysteresisFit") -> None:
    from flexbeams.plant.identification.actuator_file import pair_text

    click.echo(pair_text(fit), nl=False)
    note(
        f"{fit.loops.sensor}: {100 * fit.line:.3g} % of the stroke off a straight line, the model leaves "
        f"{100 * fit.largest:.3g} % ({100 * fit.rms:.3g} % rms), explains {100 * fit.explained:.4g} % of the variance"
    )
    note(
        f"a compensator made of it leaves {100 * fit.largest_remaining:.3g} % ({100 * fit.rms_remaining:.3g} % rms), "
        "predicted on these data"
    )
