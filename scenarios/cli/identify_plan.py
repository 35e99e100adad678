"""`flexbeams identify --plan`: voltages that determine the parameters best, as a scenario that records them."""

import json
from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.options import BASIS, note, structure_option


@click.command()
@structure_option
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("experiment.toml"),
    show_default=True,
    help="Scenario to write; the voltages go into a CSV file beside it.",
)
@click.option("--known", multiple=True, metavar="NAME=VALUE", help="A parameter that is known, in SI. Repeatable.")
@click.option("--fix", "fixed", multiple=True, metavar="NAME", help="A parameter that stays at the structure's value.")
@click.option("--free", multiple=True, metavar="NAME", help="Parameters of interest only. Default: all.")
@click.option("--prior", multiple=True, metavar="NAME=PERCENT", help="How well a start value is known.")
@click.option("--noise", multiple=True, metavar="SENSOR=DEVIATION", help="Standard deviation, such as y_pi[]=1e-5.")
@click.option("--signals", type=click.Choice(["steps", "sweeps", "both"]), default="both", show_default=True)
@click.option(
    "--criterion",
    type=click.Choice(["D", "A"]),
    default="D",
    show_default=True,
    help="D: volume of the confidence region; A: mean square deviation of the parameters.",
)
@click.option("--segments", type=click.IntRange(min=1), help="Number of segments. Default: one for each patch pair.")
@click.option("--segment-time", "duration", type=float, metavar="S", help="Default: ten periods of the slowest mode.")
@click.option("--step", type=float, default=1e-3, show_default=True, metavar="S", help="From row to row.")
@click.option("--limit", type=float, default=1000.0, show_default=True, metavar="V", help="Of the voltages.")
@click.option("--deflection-limit", type=float, metavar="M", help="Default: a tenth of the shortest beam.")
@click.option("--basis", type=BASIS, default="clamped_free", show_default=True, help="Galerkin basis of the model.")
@click.option("--order", type=click.IntRange(min=1), help="Modes of a beam, or polynomial degree.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search.")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def plan(structure: str | None, out: Path, as_json: bool, **options: Any) -> int:
    """Propose steps or sweeps that determine the parameters best, and write the scenario that records them.

    `flexbeams identify --plan` is short for it. `flexbeams run` records the scenario, and `flexbeams identify` takes
    the results; on a rig, the CSV file has the voltages.
    """
    from flexbeams.scenarios.api.plans import plan_experiment
    from flexbeams.scenarios.cli.identify_options import values_of
    from flexbeams.scenarios.cli.identify_plan_tables import plan_table, show_plan

    result = plan_experiment(
        structure or "kiel",
        known=values_of(options.pop("known"), "--known"),
        priors=values_of(options.pop("prior"), "--prior", 0.01),
        noise=values_of(options.pop("noise"), "--noise"),
        out=out,
        progress=lambda done, most: note(f"trial {done + 1} of {most}") if done < most else None,
        **options,
    )
    note(f"scenario written to {out}")
    if as_json:
        click.echo(json.dumps(plan_table(result), indent=2))
    else:
        show_plan(result)
    return 0
