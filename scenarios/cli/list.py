"""The verb `flexbeams list`."""

import click

from flexbeams.scenarios.cli.options import say


@click.command(name="list")
def list_scenarios() -> None:
    """The scenarios that ship, one line each."""
    from flexbeams.scenarios.definition.scenario_file import load_scenario, scenario_files

    names = list(scenario_files())
    width = max(map(len, names))
    for name in names:
        say(f"{name:{width}}  {load_scenario(name).description}")
