"""The verb `flexbeams tune`."""

from pathlib import Path

import click

from flexbeams.scenarios.cli.options import POSITIVE, note


@click.command()
@click.argument("scenario")
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Folder of the results. Default: tuning/SCENARIO."
)
@click.option(
    "--uncertainty", type=POSITIVE, default=10.0, show_default=True, metavar="PERCENT", help="Of every parameter."
)
@click.option("--plants", type=click.IntRange(1, 200), default=6, show_default=True, help="Random plants.")
@click.option(
    "--noise", type=POSITIVE, default=2e-7, show_default=True, metavar="STRAIN", help="Strain noise, rms a sample."
)
@click.option("--disk-margin", type=POSITIVE, default=0.8, show_default=True, help="Smallest one of all pairs at once.")
@click.option(
    "--evaluations", type=click.IntRange(1), default=1200, show_default=True, help="Choices of weights to try."
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Of the search and the random plants."
)
@click.option("--choose", type=click.IntRange(1), metavar="N", help="Write this point of the front. Default: its knee.")
def tune(
    scenario: str,
    out: Path | None,
    uncertainty: float,
    plants: int,
    noise: float,
    disk_margin: float,
    evaluations: int,
    seed: int,
    choose: int | None,
) -> None:
    """Search weights of filter and regulator for a scenario with a disturbance.

    Fast decay, also on uncertain plants, against little noise voltage; stable on the design's own plant and the exact
    one, within the voltage limit and with a disk margin. Writes OUT/design.toml, a [design] section for the
    scenario, and OUT/tune.html with the Pareto front, where every point shows its response. The same command
    continues a search that was interrupted.
    """
    from flexbeams.controller.tuning import Requirements
    from flexbeams.plant.archive import write_whole
    from flexbeams.scenarios.cli.tune_tables import show_tuning, tuning_progress
    from flexbeams.scenarios.definition.scenario_file import load_scenario
    from flexbeams.scenarios.report.tuning import PagePoint, write_tuning_page
    from flexbeams.scenarios.studies.tuning import design_section
    from flexbeams.scenarios.studies.tuning import tune as search

    file = load_scenario(scenario)
    folder = out or Path("tuning") / file.name
    requirements = Requirements(
        uncertainty=uncertainty / 100, plants=plants, seed=seed, strain_noise=noise, disk_margin=disk_margin
    )
    with tuning_progress() as progress:
        found = search(
            file,
            folder,
            requirements=requirements,
            evaluations=evaluations,
            choose=choose,
            notify=note,
            progress=progress,
        )
    write_whole(folder / "design.toml", design_section(found.front[found.chosen]).encode())
    points = [PagePoint(candidate=p.candidate, design=p.design, toml=design_section(p)) for p in found.front]
    write_tuning_page(found.scenario, found.problem, found.published, points, found.chosen, folder / "tune.html")
    show_tuning(found)
    note(f"{folder / 'design.toml'} and {folder / 'tune.html'} written")
