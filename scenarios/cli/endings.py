"""How a command ends: its exit status, and one line for whatever went wrong."""

import errno
import os
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress

import click

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.plant.text import shortened
from flexbeams.scenarios.cli.options import note

MISUSE, INTERNAL_ERROR, INTERRUPTED, BROKEN_PIPE, TERMINATED = 2, 70, 130, 141, 143

# Conditions of the system that a user can change; any other error of the system is unexpected
_ENVIRONMENT = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EROFS,
    errno.EACCES,
    errno.EPERM,
    errno.EIO,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOMEM,
    errno.EFBIG,
)


def ended(command: Callable[[], object]) -> int:
    """Runs a command of click (standalone_mode=False) and returns its exit status.

    A traceback precedes the line of an error where the environment variable FLEXBEAMS_DEBUG is set.
    """
    try:
        status = command()
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.Abort:
        note("flexbeams: interrupted")
        return INTERRUPTED
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return MISUSE
    except click.UsageError as error:
        path = error.ctx.command_path if error.ctx else "flexbeams"
        text = " ".join(error.format_message().split())
        note(f"flexbeams: {text} (see `{path} --help`)")
        return MISUSE
    except click.ClickException as error:
        note(f"flexbeams: {error.format_message()}")
        return MISUSE
    except FlexbeamsError as error:
        if _debugging():
            traceback.print_exc()
        note(f"flexbeams: {error}")
        return MISUSE
    except (BrokenPipeError, SystemExit):  # click exits by itself where a pipe is closed, and in no other case
        return _broken_pipe()
    except Exception as error:
        return _unexpected(error)


def _unexpected(error: Exception) -> int:
    if _debugging():
        traceback.print_exc()
    if isinstance(error, MemoryError):
        note("flexbeams: there is not enough memory")
        return MISUSE
    if isinstance(error, OSError) and error.errno in _ENVIRONMENT:
        note(f"flexbeams: {error.filename or 'the output'}: cannot be read or written: {error.strerror}")
        return MISUSE
    where = _logged()
    text = shortened(" ".join(str(error).split()))
    note(f"flexbeams: unexpected {type(error).__name__}: {text} ({where}; please report it)")
    return INTERNAL_ERROR


def _logged() -> str:
    """The place of a file with the traceback."""
    from flexbeams.fmus.packaging.cache import cache_folder, keep

    root = cache_folder()
    file = root / "errors" / f"{time.strftime('%Y%m%dT%H%M%S')}-{os.getpid()}.log"
    try:
        keep(file, traceback.format_exc().encode("utf-8", "backslashreplace"), root)
    except FlexbeamsError:
        return "FLEXBEAMS_DEBUG=1 shows where"
    return f"see {file}"


def _broken_pipe() -> int:
    """The reader of the output has ended: nothing more is written, also when Python ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return BROKEN_PIPE


def _debugging() -> bool:
    return os.environ.get("FLEXBEAMS_DEBUG", "0") not in ("", "0")
