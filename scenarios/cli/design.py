"""The verb `flexbeams design`."""

import json
from pathlib import Path

import click

from flexbeams.scenarios.cli.options import BASIS, chosen_structure, note, structure_option


@click.command()
@structure_option
@click.option(
    "--basis",
    type=BASIS,
    default="clamped_free",
    show_default=True,
    help="Galerkin basis: the paper's, or the high-fidelity one.",
)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Also write the design file here.")
def design(structure: str | None, basis: str, as_json: bool, out: Path | None) -> None:
    """Compute the design of a structure and show its figures.

    Frequencies and damping of every mode, Hankel singular values, static gains, closed-loop spectra.
    """
    from flexbeams.controller.design_file import write_design
    from flexbeams.scenarios.api.designs import design as compute
    from flexbeams.scenarios.cli.design_tables import show_design

    computed = compute(chosen_structure(structure), basis=basis)
    if out is not None:
        write_design(computed, out)
        note(f"design written to {out}")
    if as_json:
        click.echo(json.dumps({"design_id": computed.design_id, **computed.summary}, indent=2))
    else:
        show_design(computed)
