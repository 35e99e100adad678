"""Python in a separate process: with the modules of this package, and none of the current folder."""

import os
import sys
from pathlib import Path


def python_command(*arguments: str) -> list[str]:
    """The command line of this interpreter with arguments."""
    return [sys.executable, "-P", *arguments]


def python_environment() -> dict[str, str]:
    """The environment of such a process, wherever this package is located."""
    package = sys.modules[__name__.partition(".")[0]]
    paths = [str(Path(str(package.__file__)).parents[1]), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
