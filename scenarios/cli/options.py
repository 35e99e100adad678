"""What the verbs of the command line share."""

import math
from typing import Any

import click

BASES = click.Choice(["clamped_free", "segment"])
COUPLINGS = click.Choice(["jacobi", "gauss-seidel"])
BACKENDS = click.Choice(["native", "python"])


class Positive(click.FloatRange):
    """A finite number > 0."""

    def __init__(self) -> None:
        super().__init__(min=0, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As FloatRange, which takes infinity and NaN."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} must be finite and > 0", param, ctx)
        return number


POSITIVE = Positive()

structure_option = click.option(
    "--structure", metavar="FILE", help="Structure file, or a shipped one by name (kiel, single_beam, five_beams)."
)

compiler_option = click.option(
    "--compiler",
    default="zig",
    show_default=True,
    metavar="NAME",
    help="C compiler of native units: zig (the ziglang wheel), or one of the system's, such as gcc or clang.",
)


def note(text: str) -> None:
    """One line for the person at the terminal, apart from the data on stdout."""
    click.echo(text, err=True)
