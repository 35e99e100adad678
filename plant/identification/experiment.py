"""One measured experiment: what drove the structure, what was measured, and how it started."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.structure import Structure

Start = Literal["rest", "free"]


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Row k holds the values at time k step; the inputs of a row are held until the next one.

    A start from `rest` is the equilibrium under `rest_voltages`; a `free` start adds an unknown tip force that is
    released at the first row and an unknown impulse at each tip, as after pulling or hitting the beams.
    """

    name: str
    step: float  # s
    voltages: Array  # (rows, n_u), V
    outputs: Array  # (rows, n_s): the sensors' columns, m or 1
    sensors: tuple[int, ...]  # which sensor each column is: points of interest, then strain gauges, from 0
    forces: Array | None = None  # (rows, r), N, at the tips; None: no forces
    rest_voltages: Array | None = None  # (n_u,), V; None: 0
    start: Start = "rest"
    first_counted: int = 0  # row from which on the outputs count; the inputs before it drive the structure all the same
    uncoupled: bool = False  # recorded with the springs taken off
    held_back: bool = False  # for validation only

    @property
    def rows(self) -> int:
        """Number of samples."""
        return len(self.outputs)

    @property
    def time(self) -> Array:
        """Time of each row from the first one, s."""
        return self.step * np.arange(self.rows, dtype=np.float64)

    @property
    def duration(self) -> float:
        """From the first row to the last, s."""
        return self.step * (self.rows - 1)

    @property
    def rest(self) -> Array:
        """Voltages (n_u,) at rest, V."""
        return np.zeros(self.voltages.shape[1]) if self.rest_voltages is None else self.rest_voltages

    @property
    def onset(self) -> int:
        """The first row whose inputs differ from those at rest; 0 for a free start or where none does."""
        if self.start == "free":
            return 0
        moved = np.any(self.voltages != self.rest, axis=1)
        if self.forces is not None:
            moved |= np.any(self.forces != 0, axis=1)
        return int(np.argmax(moved))

    def first(self, rows: int) -> "Experiment":
        """The first `rows` rows as an experiment of its own."""
        return replace(
            self,
            voltages=self.voltages[:rows],
            outputs=self.outputs[:rows],
            forces=None if self.forces is None else self.forces[:rows],
        )


def sensor_names(structure: Structure) -> list[str]:
    """Names of all sensors: y_pi[1] ... of the points of interest, then y_pm[1] ... of the strain gauges."""
    return [
        *(f"y_pi[{k}]" for k in range(1, len(structure.point_of_interest) + 1)),
        *(f"y_pm[{k}]" for k in range(1, len(structure.strain_gauge) + 1)),
    ]
