"""Names of the Galerkin bases, in a module that imports nothing heavy."""

from typing import Literal

BasisName = Literal["clamped_free", "segment"]
BASES: tuple[BasisName, ...] = ("clamped_free", "segment")
