"""Schema of a scenario file: instances, connections, inputs, sensors and checks of one experiment."""

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from flexbeams.controller.options import DesignOptions
from flexbeams.plant.errors import InputError
from flexbeams.plant.validation import STRICT, Finite, Index, NonNegative, Positive
from flexbeams.scenarios.definition.choices import BasisName, Coupling

Value = Finite | bool | str | list[Finite | bool | str]
Measure = Literal[
    "largest",
    "end_deviation",
    "largest_change",
    "overshoot",
    "overshoot_percent",
    "settling_time",
    "motion_settling_time",
    "decay_time",
    "decay_ratio",
    "open_loop_peak",
    "saturation_share",
]
Row = Annotated[list[str], Field(min_length=1)]  # of a figure: overlaid signals
SIGNALS = ("constant", "step", "pulse", "chirp", "pseudo_random", "table", "targets")  # of an input


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Instance:
    """One unit: a kind that is built from the design, or an FMU file. Instances step in the order of the file."""

    unit: str | None = None  # name of a kind
    fmu: str | None = None  # a file, relative to the scenario's folder
    basis: BasisName | None = None  # of the plant's model; default: the design's
    order: Index | None = None  # modes or degree of that basis
    start: dict[str, Value] = field(default_factory=dict)  # variable, or whole array, to value
    scale: dict[str, Finite | list[Finite]] = field(default_factory=dict)  # factor on start values, [] for all

    def __post_init__(self) -> None:
        if (self.unit is None) == (self.fmu is None):
            raise InputError("", "must have exactly one of unit and fmu")


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Connection:
    """An output array (or element) that feeds an input array (or element) of the same size.

    The input takes factor * output + offset; without them, units of measurement that differ are converted.
    """

    source: str = Field(alias="from")
    to: str
    factor: Finite | None = None
    offset: Finite | None = None


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Step:
    """`value` from `time` on; zero before."""

    time: NonNegative  # s
    value: Finite | list[Finite]


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Pulse:
    """Half a sine from `time` on, as from an impact hammer, given by its integral."""

    time: NonNegative  # s
    duration: Positive  # s
    impulse: Finite  # unit of the input times s


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Target:
    """A value from `time` on."""

    time: NonNegative  # s
    value: list[Finite]


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Chirp:
    """A sine whose frequency runs from one value to another, zero before and after.

    linear: f = f_0 + (f_1 - f_0) tau / T; logarithmic: f = f_0 (f_1 / f_0)^(tau / T); tau from `time`, T the duration.
    """

    time: NonNegative  # s
    duration: Positive  # s
    amplitude: Finite | list[Finite]  # unit of the input
    start_frequency: NonNegative  # Hz
    stop_frequency: NonNegative  # Hz
    sweep: Literal["linear", "logarithmic"] = "linear"

    def __post_init__(self) -> None:
        for key in ("start_frequency", "stop_frequency"):
            if self.sweep == "logarithmic" and getattr(self, key) == 0:
                raise InputError(key, "must be finite and > 0 for a logarithmic sweep", getattr(self, key))


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class PseudoRandom:
    """Levels that each hold for `hold`, the same in every run; zero before `time` and after the duration.

    binary: +-amplitude by a maximum-length sequence, which repeats after 2^register - 1 levels; levels: uniformly
    distributed within +-amplitude. An amplitude for each element gives each a sequence of its own.
    """

    time: NonNegative = 0.0  # s
    duration: Positive | None = None  # s, default: to the end of the run
    amplitude: Finite | list[Finite]  # unit of the input
    hold: Positive  # s
    kind: Literal["binary", "levels"] = "binary"
    register: Annotated[int, Field(ge=2, le=20, strict=True)] = 10  # bits of the shift register of `binary`
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 1


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Table:
    """Columns of a CSV file over its first one, the time; the first and the last row hold beyond the file's ends."""

    file: str  # relative to the scenario's folder
    columns: Annotated[list[str], Field(min_length=1)] | None = None  # names in the header; a stands for a[1], a[2] ...
    hold: Literal["zero", "linear"] = "zero"  # hold each row up to the next, or interpolate


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Input:
    """An external input: exactly one signal."""

    to: str
    constant: Finite | list[Finite] | None = None
    step: Step | None = None
    pulse: Pulse | None = None
    chirp: Chirp | None = None
    pseudo_random: PseudoRandom | None = None
    table: Table | None = None
    targets: Annotated[list[Target], Field(min_length=1)] | None = None

    def __post_init__(self) -> None:
        present = [s for s in SIGNALS if getattr(self, s) is not None]
        if len(present) != 1:
            raise InputError(
                "",
                f"must have exactly one of {', '.join(SIGNALS[:-1])} and {SIGNALS[-1]}",
                ", ".join(present) or "none",
            )
        times = [t.time for t in self.targets or []]
        if sorted(set(times)) != times:
            raise InputError("targets", "must have ascending times", times)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Sensor:
    """What an instrument records of a signal: delayed, then with white noise, then rounded; units get the true one."""

    of: str  # a recorded signal, array or element
    delay: NonNegative = 0.0  # s
    noise: NonNegative = 0.0  # standard deviation, unit of the signal
    resolution: NonNegative = 0.0  # unit of the signal; 0: not rounded
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 1


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Check:
    """A measured figure of the run, with its limits and the paper's value."""

    name: str
    measure: Measure
    of: str  # a recorded signal, array or element
    after: NonNegative = 0.0  # s, start of the window
    before: Positive | None = None  # s, end of the window, default the end of the run
    reference: Literal["zero", "target", "end", "start"] | list[Finite] = "zero"
    points: Annotated[list[Index], Field(min_length=1)] | None = None  # elements of the array that are measured
    share: Positive = 0.02  # band of a settling or decay time
    relative: bool = False  # in % of the largest |target|
    unit: str = ""
    min: Finite | None = None
    max: Finite | None = None
    paper: Finite | str | None = None

    def __post_init__(self) -> None:
        if self.min is not None and self.max is not None and self.min > self.max:
            raise InputError("min", f"must be <= max ({self.max:g})", self.min)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Figure:
    """Rows of plots over time, with a column for each element."""

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
    title: str = ""
    rows: Annotated[list[Row], Field(min_length=1)]  # open_loop.<signal>: of that run
    points: Annotated[list[Index], Field(min_length=1)] | None = None  # columns
    start: NonNegative = 0.0  # s
    stop: Positive | None = None  # s


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Scenario:
    """One experiment."""

    title: str
    paper: str = ""  # figure or section of the paper that it reproduces
    structure: str  # a shipped name, or a file relative to the scenario's folder
    stop_time: Positive  # s
    step: Positive | None = None  # s, default: the design's sample time
    coupling: Coupling = "jacobi"
    design: DesignOptions = field(default_factory=DesignOptions)
    instance: dict[str, Instance]
    connection: list[Connection] = field(default_factory=list)
    input: list[Input] = field(default_factory=list)
    record: list[str] | None = None  # further signals, or locals, to record
    sensor: list[Sensor] = field(default_factory=list)  # of recorded signals
    open_loop: str | None = None  # scenario to compare with
    check: list[Check] = field(default_factory=list)
    figure: list[Figure] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.instance:
            raise InputError("instance", "must hold at least one instance")
