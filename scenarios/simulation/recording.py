"""Recorded signals of a run."""

from dataclasses import dataclass

from flexbeams.plant.basis import Array
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.frames import Frames


@dataclass(kw_only=True)
class Recording:
    """What a run leaves: row k holds the values at time[k], every `decimate`-th step and the last one."""

    time: Array  # (rows,), s
    columns: list[str]  # <instance>.<variable>
    values: Array  # (rows, len(columns))
    wall_seconds: float  # s, of the stepping loop alone
    steps: int = 0  # done
    decimate: int = 1
    failure: UnitFailure | None = None
    interrupted: bool = False
    frames: Frames | None = None  # shapes for an animation, where the wiring asked for them
    lateness: Array | None = None  # s, of each step of a paced run against the wall clock

    @property
    def complete(self) -> bool:
        """The run reached its stop time."""
        return self.failure is None and not self.interrupted
