"""What a kind of unit says about itself on its documentation page."""

from collections.abc import Callable
from dataclasses import dataclass

from flexbeams.fmus.interface.variables import Interface

PAPER = (
    "Paper: A. Kater, T. Meurer, Motion planning and tracking control for coupled flexible beam structures, "
    "Control Engineering Practice 84 (2019)."
)


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """Text about a unit: paragraphs, formulas where a line starts with =, headings where it starts with #."""

    equations: str
    timing: str
    wiring: str = ""  # HTML, of a unit with parts
    figure: Callable[[Interface], str] | None = None  # HTML behind the equations
    clock: str = "The design's sample time is {:g} s."
    literature: str = ""
