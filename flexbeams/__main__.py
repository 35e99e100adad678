"""`python -m flexbeams` and the script: the command `flexbeams`."""

import sys


def main() -> int:
    """Runs the command; returns its exit status. Older versions of Python read this module, too."""
    if sys.version_info < (3, 11):  # noqa: UP036
        sys.stderr.write("flexbeams: needs Python 3.11 or newer, this is {}.{}\n".format(*sys.version_info))
        return 2
    try:
        from flexbeams.scenarios.cli.main import main as command
    except KeyboardInterrupt:
        sys.stderr.write("flexbeams: interrupted\n")
        return 130
    return command()


if __name__ == "__main__":
    sys.exit(main())
