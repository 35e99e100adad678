"""Tables for the terminal."""

from rich.console import Console


def console(width: int = 100) -> Console:
    """Standard output; of the given width where it is not a terminal."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=width)
