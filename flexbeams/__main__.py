"""`python -m flexbeams` and the script: the command `flexbeams`."""

import gc
import sys


def main() -> int:
    """Runs the command; returns its exit status. Older versions of Python read this module, too."""
    if sys.version_info < (3, 11):  # noqa: UP036
        sys.stderr.write("flexbeams: needs Python 3.11 or newer, this is {}.{}\n".format(*sys.version_info))
        return 2
    gc.set_threshold(50_000)  # loading modules makes many objects and no garbage, which takes long to find out
    try:
        from flexbeams.scenarios.cli.main import main as command
    except KeyboardInterrupt:
        sys.stderr.write("flexbeams: interrupted\n")
        return 130
    status = command()
    gc.freeze()  # else Python looks twice for garbage in all that there is before it ends
    return status


if __name__ == "__main__":
    sys.exit(main())
