"""Names of the kernels that a unit can have, in a module that imports nothing heavy."""

from typing import Literal

Backend = Literal["native", "python"]
BACKENDS: tuple[Backend, ...] = ("native", "python")
