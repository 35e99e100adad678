"""The command `flexbeams`."""

import io
import os
import sys
from collections.abc import Sequence

import click

from flexbeams.plant.temporary import sweep_temporary_folders
from flexbeams.plant.threads import default_to_one_thread
from flexbeams.scenarios.cli.bench import bench
from flexbeams.scenarios.cli.build import build
from flexbeams.scenarios.cli.cache import cache
from flexbeams.scenarios.cli.compare import compare
from flexbeams.scenarios.cli.design import design
from flexbeams.scenarios.cli.endings import INTERRUPTED, TERMINATED, ended
from flexbeams.scenarios.cli.export import export
from flexbeams.scenarios.cli.files import list_files, new, schema, show
from flexbeams.scenarios.cli.identify import identify
from flexbeams.scenarios.cli.run import run
from flexbeams.scenarios.cli.study import study
from flexbeams.scenarios.cli.tune import tune
from flexbeams.scenarios.cli.validate import validate
from flexbeams.scenarios.processes.interrupt import termination_as_interrupt


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="flexbeams")
def commands() -> None:
    """Co-simulation units (FMI 2.0) of elastically coupled piezoelectric beams and their control.

    Begin with `flexbeams run tracking`. Exit status: 0 done and all checks hold, 1 a check failed, 2 misuse or
    bad input, 70 an error of this program, 130 interrupted, 143 terminated.
    """


verbs = (
    run,
    study,
    compare,
    export,
    bench,
    design,
    tune,
    build,
    list_files,
    show,
    new,
    schema,
    validate,
    identify,
    cache,
)
for verb in verbs:
    commands.add_command(verb)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status.

    Whatever goes wrong is one line on stderr. An error that is not a user's to fix has status 70, and its traceback is
    in the file that the line names.
    """
    _replace_unencodable()
    os.environ["MPLBACKEND"] = "agg"  # figures are written to files, whatever the user's default
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # else it searches all installed packages for some
    default_to_one_thread()
    sweep_temporary_folders()
    arguments = None if argv is None else list(argv)
    with termination_as_interrupt() as terminated:
        status = ended(lambda: commands.main(args=arguments, prog_name="flexbeams", standalone_mode=False))
    return TERMINATED if status == INTERRUPTED and terminated() else status


def _replace_unencodable() -> None:
    """Replaces characters that the terminal cannot encode: µ and ±, or bytes of a name that are not UTF-8."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


if __name__ == "__main__":
    sys.exit(main())
