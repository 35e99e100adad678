"""Tables for the terminal."""

from rich.console import Console
from rich.markup import escape

from flexbeams.plant.text import printable


def console(width: int = 100) -> Console:
    """Standard output; of the given width where it is not a terminal."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=width)


def cell(text: str) -> str:
    """Text for a table: nothing in it is markup or controls the terminal."""
    return escape(printable(text))
