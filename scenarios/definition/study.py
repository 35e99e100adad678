"""Schema of a study file: a scenario, what varies in it, and what is kept of each run."""

from dataclasses import field
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from flexbeams.plant.errors import InputError
from flexbeams.plant.validation import STRICT, Finite, Index, Positive
from flexbeams.scenarios.definition.choices import Method
from flexbeams.scenarios.definition.schema import Check, Value

RANGES = ("range", "distribution", "values")  # what a parameter has one of


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Parameter:
    """What varies: a start value of a unit, or an option of the design."""

    name: str  # <instance>.<variable>, [] stands for every index; or design.<option>
    range: Annotated[list[Finite], Field(min_length=2, max_length=2)] | None = None  # uniform between
    distribution: str | None = None  # name in scipy.stats
    arguments: dict[str, Finite] = field(default_factory=dict)  # of the distribution: shapes, loc and scale
    values: Annotated[list[Finite], Field(min_length=1)] | None = None  # equally likely ones, or those of a grid
    levels: Index | None = None  # on a grid, of a range or a distribution
    relative: bool = False  # all of these are factors on the scenario's own value
    together: bool = False  # all elements that the name stands for take one value
    group: str = ""  # one input of the sensitivity together with others of this group; default: each one alone

    def __post_init__(self) -> None:
        present = [key for key in RANGES if getattr(self, key) is not None]
        if len(present) != 1:
            raise InputError("", "must have exactly one of range, distribution and values", ", ".join(present))
        if self.range is not None and not self.range[0] < self.range[1]:
            raise InputError("range", "must have its smaller end first", self.range)
        if self.arguments and self.distribution is None:
            raise InputError("arguments", "belong to a distribution")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Signals:
    """Signals that are kept of each run, at a reduced rate."""

    record: Annotated[list[str], Field(min_length=1)]  # arrays or elements, <instance>.<variable>
    interval: Positive  # s, a whole number of steps


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Study:
    """Many runs of one scenario."""

    title: str
    scenario: str  # a shipped name, or a file relative to the study's folder
    method: Method = "lhs"
    runs: Index = 256
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 1
    start: dict[str, Value] = field(default_factory=dict)  # <instance>.<variable> to value, in every run
    stop_time: Positive | None = None  # s, default: the scenario's
    parameter: Annotated[list[Parameter], Field(min_length=1)]
    checks: list[str] | None = None  # of the scenario, by name; default: all, or none where there are measures
    measure: list[Check] = field(default_factory=list)  # further ones, with limits of the study's own
    signals: Signals | None = None

    def __post_init__(self) -> None:
        names = [p.name for p in self.parameter]
        for k, name in enumerate(names):
            if name in names[:k]:
                raise InputError(f"parameter[{k + 1}].name", "must be given once", name)
