"""The verb `flexbeams cache`."""

from pathlib import Path

import click

from flexbeams.scenarios.cli.options import cache_option, say


@click.command()
@click.argument("action", type=click.Choice(["show", "clear"]), default="show")
@cache_option
def cache(action: str, build_folder: Path | None) -> None:
    """Show the folder where built units are kept and its size, or clear it.

    Only files that flexbeams wrote there are removed.
    """
    from flexbeams.fmus.packaging.cache import cache_folder, cached_files, clear_cache

    root = cache_folder(build_folder)
    if action == "clear":
        say(f"{root}: {clear_cache(root)} files removed")
        return
    sizes = [file.stat().st_size for file in cached_files(root)]
    say(f"{root}: {len(sizes)} files, {sum(sizes) / 1e6:.1f} MB")
