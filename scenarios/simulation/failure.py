"""How a unit ends a run: it fails, or it wants to."""

import re

from flexbeams.plant.errors import FlexbeamsError


class UnitFailure(FlexbeamsError):
    """A unit refused a call; names instance, time, function and the message that the unit logged."""

    def __init__(self, instance: str, time: float, function: str, reason: str) -> None:
        text = re.sub(r"^fmi2\w+: ", "", reason)  # native units name the function themselves
        super().__init__(f"{instance} failed at {time:.6g} s in {function}: {text}")


class UnitEnded(FlexbeamsError):
    """A unit ended the run, a regular end: it discarded a step and reports fmi2Terminated.

    `time` is its last successful time; `completed` is whether that is the end of the step.
    """

    def __init__(self, instance: str, time: float, completed: bool = False) -> None:
        self.instance, self.completed = instance, completed
        super().__init__(f"{instance} ended the run at {time:.6g} s")
