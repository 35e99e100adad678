"""The command `flexbeams`."""

import io
import os
import sys
import traceback
from collections.abc import Sequence

import click

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.plant.temporary import sweep_temporary_folders
from flexbeams.scenarios.cli.bench import bench
from flexbeams.scenarios.cli.build import build
from flexbeams.scenarios.cli.cache import cache
from flexbeams.scenarios.cli.compare import compare
from flexbeams.scenarios.cli.design import design
from flexbeams.scenarios.cli.export import export
from flexbeams.scenarios.cli.identify import identify
from flexbeams.scenarios.cli.list import list_scenarios
from flexbeams.scenarios.cli.options import note
from flexbeams.scenarios.cli.run import run
from flexbeams.scenarios.cli.validate import validate


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="flexbeams")
def commands() -> None:
    """Co-simulation units (FMI 2.0) of elastically coupled piezoelectric beams and their control.

    Begin with `flexbeams run tracking`. Exit status: 0 done and all checks hold, 1 a check failed, 2 misuse or
    bad input.
    """


for verb in (run, compare, export, bench, design, build, list_scenarios, validate, identify, cache):
    commands.add_command(verb)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status.

    A FlexbeamsError, which a user can fix, is one line on stderr, after its traceback where the environment variable
    FLEXBEAMS_DEBUG is set. Whatever else escapes is a bug and shows as one.
    """
    _replace_unencodable()
    os.environ["MPLBACKEND"] = "agg"  # figures are written to files, whatever the user's default
    sweep_temporary_folders()
    try:
        status = commands.main(args=None if argv is None else list(argv), prog_name="flexbeams", standalone_mode=False)
        return status if isinstance(status, int) else 0
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.Abort:
        note("flexbeams: interrupted")
        return 130
    except click.UsageError as error:
        if isinstance(error, click.exceptions.NoArgsIsHelpError):
            click.echo(error.format_message())
            return 2
        command = error.ctx.command_path if error.ctx else "flexbeams"
        note(f"flexbeams: {error.format_message()} (see `{command} --help`)")
        return 2
    except click.ClickException as error:
        note(f"flexbeams: {error.format_message()}")
        return 2
    except FlexbeamsError as error:
        if os.environ.get("FLEXBEAMS_DEBUG", "0") not in ("", "0"):
            traceback.print_exc()
        note(f"flexbeams: {error}")
        return 2


def _replace_unencodable() -> None:
    """Replaces characters, such as µ and ±, that the terminal cannot encode."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors="replace")


if __name__ == "__main__":
    sys.exit(main())
