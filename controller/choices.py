"""Values to choose from."""

from typing import Literal

OutputWeight = Literal["identity", "energy"]  # norm of the balanced truncation
