"""Errors caused by invalid input, infeasible designs and units that cannot be built or run.

Whatever else escapes is a bug, and the command line shows it as one.
"""

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from os.path import isfile, islink
from pathlib import Path
from typing import Any

from flexbeams.plant.text import printable, quoted, shortened


class FlexbeamsError(Exception):
    """Base of all errors that a user can fix; the text is one line of printable characters."""

    def __str__(self) -> str:
        return printable(" ".join(Exception.__str__(self).splitlines()))

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]:
        """To pass to another process: made of its text and attributes, whatever the arguments of its class."""
        return _rebuilt, (type(self), self.args), self.__dict__


def _rebuilt(kind: type[FlexbeamsError], arguments: tuple[Any, ...]) -> FlexbeamsError:
    return kind.__new__(kind, *arguments)


class InputError(FlexbeamsError, ValueError):
    """A value that breaks a rule: names the source (file or option), the key, the rule and the value.

    A ValueError as well, so that pydantic adds where in a table it was raised.
    """

    def __init__(self, key: str, rule: str, value: object = None, *, source: str = "") -> None:
        self.key, self.rule, self.value, self.source = key, rule, value, source
        text = f"{shortened(key)} {rule}" if key else rule
        if value is not None:
            text += f", got {quoted(value)}"
        super().__init__(f"{source}: {text}" if source else text)

    def at(self, source: str, prefix: str = "") -> "InputError":
        """The same error with its source and the location of its key within that source."""
        return InputError(prefix + self.key, self.rule, self.value, source=source)


class DesignError(FlexbeamsError):
    """A structure and options for which a step of the design has no acceptable result."""


def missing_file_hint(name: str, folder: Path | None = None) -> str:
    """Text for the end of a message about a missing file: <name>.toml, where a link leads, the folder searched."""
    for path in [Path(name), *([folder / name] if folder else [])]:
        if isfile(f"{path}.toml"):
            return f"; did you mean {f'{path}.toml'!r}?"
        if islink(path):
            return f"; it is a link to {str(path.resolve())!r}, which does not exist"
    if folder and name.endswith(".toml"):
        return f"; there is none in {str(folder.absolute())!r}"
    return ""


def suggestion(name: str, valid: Iterable[str]) -> str:
    """Text for the end of a message: the nearest valid name, then the valid ones."""
    names = list(dict.fromkeys(valid))
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    listed = names if len(names) <= 14 else [*names[:12], f"... {len(names)} in all"]
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} (valid: {', '.join(listed)})"
