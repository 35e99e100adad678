"""What goes wrong at the boundary: bad input and designs that cannot be made."""

from collections.abc import Iterable
from difflib import get_close_matches


class FlexbeamsError(ValueError):
    """Base of every error that a user can mend; its text is one line."""


class InputError(FlexbeamsError):
    """A value that breaks a rule: which source (file or option), which key, which rule, which value."""

    def __init__(self, key: str, rule: str, value: object = None, *, source: str = "") -> None:
        self.key, self.rule, self.value, self.source = key, rule, value, source
        text = f"{key} {rule}" if key else rule
        if value is not None:
            text += f", got {value!r}"
        super().__init__(" ".join((f"{source}: {text}" if source else text).splitlines()))

    def at(self, source: str, prefix: str = "") -> "InputError":
        """The same error with its source and the place of its key within that source."""
        return InputError(prefix + self.key, self.rule, self.value, source=source)


class DesignError(FlexbeamsError):
    """A structure or an option set for which a step of the design has no acceptable result."""


def suggestion(name: str, valid: Iterable[str]) -> str:
    """Text that names the nearest valid name and the valid ones, for the end of a refusal."""
    names = list(dict.fromkeys(valid))
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    shown = names if len(names) <= 14 else [*names[:12], f"... {len(names)} in all"]
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} (valid: {', '.join(shown)})"
