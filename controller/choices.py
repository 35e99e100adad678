"""Values to choose from."""

from typing import Literal

OutputWeight = Literal["identity", "energy"]  # norm of the balanced truncation
PlannerName = Literal["paper", "multi_input"]  # transitions of the flat output (37), or a spline for each input
