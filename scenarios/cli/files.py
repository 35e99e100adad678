"""The verbs about files that a user writes: `flexbeams schema`, `new`, `show` and `list`."""

import json
from os.path import lexists
from pathlib import Path

import click

from flexbeams.scenarios.cli.options import say

KINDS = click.Choice(["structure", "scenario", "study"])


@click.command()
@click.argument("kind", type=KINDS)
@click.option("--page", is_flag=True, help="A page with every key instead (Markdown).")
def schema(kind: str, page: bool) -> None:
    """Print the JSON Schema of structure, scenario or study files, for editors and other programs."""
    from flexbeams.scenarios.definition.schemas import json_schema, key_page

    click.echo(key_page(kind) if page else json.dumps(json_schema(kind), indent=2))


@click.command()
@click.argument("kind", type=KINDS)
@click.argument("name")
def new(kind: str, name: str) -> None:
    """Write NAME.toml, a commented file to begin with that runs as it is; an existing file is not replaced."""
    from flexbeams.plant.archive import write_whole
    from flexbeams.plant.errors import InputError
    from flexbeams.scenarios.definition.skeletons import SKELETONS

    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    if path.name == ".toml" or not path.stem.strip("."):
        raise InputError("NAME", "must end with the name of a file", name)
    if not path.stem.isprintable() or any(sign in path.stem for sign in '"\\{}'):
        raise InputError("NAME", "must be a name of printable characters without quotes, braces and backslashes", name)
    if lexists(path):
        raise InputError("NAME", "must be a new file", str(path))
    if not path.parent.is_dir():
        raise InputError("NAME", "must be in a folder that exists", str(path))
    write_whole(path, SKELETONS[kind].format(name=path.stem).encode())
    say(path)


@click.command()
@click.argument("name")
def show(name: str) -> None:
    """Print the file of a shipped scenario, study or structure."""
    from flexbeams.plant.errors import InputError, suggestion
    from flexbeams.scenarios.definition.scenario_file import scenario_files, structure_files
    from flexbeams.scenarios.definition.study_file import study_files

    shipped = {**{f"structure/{k}": path for k, path in structure_files().items()}, **structure_files()}
    shipped |= {**study_files(), **scenario_files()}
    if name not in shipped:
        raise InputError("NAME", "is not a shipped scenario, study or structure" + suggestion(name, shipped), name)
    click.echo(shipped[name].read_text(encoding="utf-8"), nl=False)


@click.command(name="list")
def list_files() -> None:
    """The scenarios, studies and structures that ship, one line each."""
    from flexbeams.scenarios.definition.scenario_file import (
        first_comment,
        load_scenario,
        scenario_files,
        structure_files,
    )
    from flexbeams.scenarios.definition.study_file import study_files

    scenarios, studies, structures = scenario_files(), study_files(), structure_files()
    width = max(map(len, [*scenarios, *studies, *structures]))
    for name in scenarios:
        say(f"{name:{width}}  {load_scenario(name).description}")
    for heading, files in (("Studies", studies), ("Structures", structures)):
        click.echo(f"\n{heading}:")
        for name, path in files.items():
            say(f"{name:{width}}  {first_comment(path.read_text(encoding='utf-8')).partition('. ')[0].rstrip('.')}.")
