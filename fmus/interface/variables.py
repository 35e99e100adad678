"""The variables of a unit, declared once for every backend.

An `Interface` is an ordered table of `Variable`; a variable's index is its FMI value reference. The
first is always `time`: some importers take value reference 0 for it. Names follow FMI's structured
convention with indices from 1. The elements of an array are contiguous: a kernel sees an array
variable as one slice of its values.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, NoReturn

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.si import SI_UNITS

TYPE_NAMES = ("Real", "Integer", "Boolean", "String")
_IDENTIFIER = r"[A-Za-z_]\w*(\[[1-9]\d*(,[1-9]\d*)*\])?"
_STRUCTURED_NAME = re.compile(rf"{_IDENTIFIER}(\.{_IDENTIFIER})*", re.ASCII)
_INDICES = re.compile(r"\[[\d,]*\]")

# FMI 2.0.4, table of section 2.2.7: the first entry is the default of `initial`.
_LEGAL_INITIAL: dict[tuple[str, str], tuple[str | None, ...]] = {
    ("independent", "continuous"): (None,),
    ("parameter", "fixed"): ("exact",),
    ("parameter", "tunable"): ("exact",),
    ("input", "discrete"): (None,),
    ("input", "continuous"): (None,),
    ("output", "constant"): ("exact",),
    ("output", "discrete"): ("calculated", "exact"),
    ("output", "continuous"): ("calculated", "exact"),
    ("local", "constant"): ("exact",),
    ("local", "fixed"): ("calculated",),
    ("local", "tunable"): ("calculated",),
    ("local", "discrete"): ("calculated", "exact"),
    ("local", "continuous"): ("calculated", "exact"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One scalar variable. `variability` and `initial` default to those of FMI."""

    name: str
    type: str = "Real"
    causality: str = "local"
    variability: str = ""
    initial: str | None = None
    start: float | int | bool | str | None = None
    unit: str | None = None  # Real only, a key of SI_UNITS
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None  # Real only
    description: str = ""
    initial_inputs: tuple[str, ...] = ()  # arrays of inputs that the value after initialisation depends on

    def __post_init__(self) -> None:
        if not _STRUCTURED_NAME.fullmatch(self.name):
            raise InterfaceError(f"variable name must be structured, indices from 1, got {self.name!r}")
        if self.type not in TYPE_NAMES:
            self._refuse("type", f"one of {', '.join(TYPE_NAMES)}", self.type)
        if not self.variability:
            continuous = self.type == "Real" and self.causality != "parameter"
            default = "continuous" if continuous else "fixed" if self.causality == "parameter" else "discrete"
            object.__setattr__(self, "variability", default)
        if self.type != "Real" and self.variability == "continuous":
            self._refuse("variability", f"discrete, fixed or tunable for {self.type}", self.variability)
        legal = _LEGAL_INITIAL.get((self.causality, self.variability))
        if legal is None:
            self._refuse("causality and variability", "a pair FMI allows", (self.causality, self.variability))
        if self.initial is None:
            object.__setattr__(self, "initial", legal[0])
        elif self.initial not in legal:
            self._refuse("initial", f"one of {legal} here", self.initial)
        object.__setattr__(self, "initial_inputs", tuple(self.initial_inputs))
        if self.initial_inputs and self.initial != "calculated":
            self._refuse("initial_inputs", "absent unless calculated", self.initial_inputs)
        self._check_values()
        if self.type != "Real" and (self.unit is not None or self.nominal is not None):
            self._refuse("unit and nominal", f"absent for {self.type}", (self.unit, self.nominal))
        if self.unit is not None and self.unit not in SI_UNITS:
            self._refuse("unit", f"one of {', '.join(SI_UNITS)}", self.unit)

    @property
    def array(self) -> str:
        """Name of the array this is an element of: u for u[2], beam[].tip_mass for beam[2].tip_mass."""
        return _INDICES.sub("[]", self.name).removesuffix("[]")

    def _check_values(self) -> None:
        numbers = ("minimum", "maximum", "nominal")
        for name in numbers:
            value = getattr(self, name)
            if value is not None and self.type in ("Boolean", "String"):
                self._refuse(name, f"absent for {self.type}", value)
            if value is not None:
                object.__setattr__(self, name, self._number(name, value))
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        if low > high:
            self._refuse("minimum", f"<= maximum {high!r}", low)
        if self.nominal is not None and self.nominal <= 0.0:
            self._refuse("nominal", "> 0", self.nominal)
        required = self.initial == "exact" or self.causality == "input"
        if required != (self.start is not None):
            self._refuse("start", "given" if required else f"absent for this {self.causality}", self.start)
        if self.start is None:
            return
        if self.type in ("Boolean", "String"):
            if not isinstance(self.start, bool if self.type == "Boolean" else str):
                self._refuse("start", f"a {self.type}", self.start)
            return
        start = self._number("start", self.start)
        if not low <= start <= high:
            self._refuse("start", f"within [{low!r}, {high!r}]", start)
        object.__setattr__(self, "start", start)

    def _number(self, name: str, value: Any) -> float | int:
        if isinstance(value, (bool, str)) or not math.isfinite(value):
            self._refuse(name, "a finite number", value)
        if self.type == "Real":
            return float(value)
        if value != int(value) or not -(2**31) <= value < 2**31:
            self._refuse(name, "a 32-bit integer", value)
        return int(value)

    def _refuse(self, key: str, rule: str, value: object) -> NoReturn:
        raise InterfaceError(f"{self.name}: {key} must be {rule}, got {value!r}")


def bounds(variable: Variable) -> tuple[float, float]:
    """Minimum and maximum of a variable, infinite where there is none."""
    return (
        -math.inf if variable.minimum is None else variable.minimum,
        math.inf if variable.maximum is None else variable.maximum,
    )


def array(name: str, n: int, *, start: object = None, description: str = "", **common: Any) -> tuple[Variable, ...]:
    """The n elements name[1] .. name[n]; a name that contains [] takes the index there.

    `start` is one value for all elements or a sequence of n; {} in `description` stands for the index.
    """
    pattern = name.replace("[]", "[{}]") if "[]" in name else name + "[{}]"
    return tuple(
        Variable(name=pattern.format(i), start=value, description=description.replace("{}", str(i)), **common)
        for i, value in enumerate(_spread(name, start, n), start=1)
    )


def matrix(name: str, rows: int, columns: int, *, start: object = None, **common: Any) -> tuple[Variable, ...]:
    """The elements name[1,1], name[1,2] .. name[rows,columns], row by row; `start` likewise, flat or one."""
    starts = iter(_spread(name, start, rows * columns))
    return tuple(
        Variable(name=f"{name}[{i},{j}]", start=next(starts), **common)
        for i in range(1, rows + 1)
        for j in range(1, columns + 1)
    )


def _spread(name: str, start: object, n: int) -> list[Any]:
    if start is None or isinstance(start, (str, bool, int, float)):
        return [start] * n
    values = start.tolist() if hasattr(start, "tolist") else start
    if isinstance(values, (int, float)):
        return [values] * n
    if not isinstance(values, (list, tuple)) or len(values) != n:
        raise InterfaceError(f"{name}: start must be one value or {n} of them, got {start!r}")
    return list(values)


TIME = Variable(name="time", causality="independent", unit="s", description="Simulation time")


@dataclass(frozen=True, kw_only=True)
class Interface:
    """The declaration of a unit. A value reference is an index in `variables`."""

    unit_name: str  # modelName and modelIdentifier
    description: str
    variables: tuple[Variable, ...]
    step_size: float  # s
    stop_time: float  # s
    needs_execution_tool: bool = False
    can_handle_variable_step: bool = True
    can_interpolate_inputs: bool = False
    can_be_instantiated_only_once: bool = False
    cannot_use_memory_management: bool = False
    can_get_and_set_state: bool = True
    can_serialize_state: bool = True
    provides_directional_derivative: bool = False
    arrays: dict[str, range] = field(init=False, repr=False, compare=False)
    _references: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z_]\w*", self.unit_name, re.ASCII):
            raise InterfaceError(f"unit_name must be a C identifier, got {self.unit_name!r}")
        for name in ("step_size", "stop_time"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise InterfaceError(f"{name} must be finite and > 0, got {getattr(self, name)!r}")
        if not self.variables or self.variables[0] != TIME:
            raise InterfaceError(f"{self.unit_name}: the first variable must be time")
        object.__setattr__(self, "_references", {v.name: i for i, v in enumerate(self.variables)})
        if len(self._references) != len(self.variables):
            names = [v.name for v in self.variables]
            doubled = sorted({name for name in names if names.count(name) > 1})
            raise InterfaceError(f"{self.unit_name}: names must be unique, got {', '.join(doubled)} twice")
        object.__setattr__(self, "arrays", self._find_arrays())
        for variable in self.variables:
            for name in variable.initial_inputs:
                if name not in self.arrays or self.variables[self.arrays[name].start].causality != "input":
                    raise InterfaceError(f"{variable.name}: initial_inputs must name inputs, got {name!r}")

    def _find_arrays(self) -> dict[str, range]:
        arrays: dict[str, range] = {}
        for i, variable in enumerate(self.variables):
            span = arrays.setdefault(variable.array, range(i, i))
            if span.stop != i:
                raise InterfaceError(f"{self.unit_name}: the elements of {variable.array} must be contiguous")
            first = self.variables[span.start]
            if (variable.type, variable.causality) != (first.type, first.causality):
                raise InterfaceError(f"{self.unit_name}: {variable.name} and {first.name} must be of one kind")
            arrays[variable.array] = range(span.start, i + 1)
        return arrays

    def __getitem__(self, name: str) -> Variable:
        return self.variables[self.reference(name)]

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def reference(self, name: str) -> int:
        """Value reference of a scalar variable; KeyError where there is none of that name."""
        return self._references[name]

    def references(self, array: str) -> range:
        """Value references of an array (u, beam[].tip_mass) or of one scalar variable."""
        return self.arrays[array] if array in self.arrays else range(i := self.reference(array), i + 1)

    def with_starts(self, values: Mapping[str, float | int | bool]) -> Interface:
        """The same interface with other start values of parameters and inputs; InterfaceError for another variable."""
        for name in values:
            if name not in self._references or self[name].causality not in ("parameter", "input"):
                raise InterfaceError(f"{self.unit_name}: start must be of a parameter or an input, got {name!r}")
        return replace(
            self, variables=tuple(replace(v, start=values[v.name]) if v.name in values else v for v in self.variables)
        )

    def of(self, causality: str) -> tuple[Variable, ...]:
        """The variables of one causality, in order."""
        return tuple(v for v in self.variables if v.causality == causality)

    def to_json(self) -> str:
        """The table as JSON; defaults and absent values are left out."""
        entries = {f.name: getattr(self, f.name) for f in fields(self) if f.init and f.name != "variables"}
        entries["variables"] = [
            {f.name: value for f in fields(v) if (value := getattr(v, f.name)) not in (None, "", ())}
            for v in self.variables
        ]
        return json.dumps(entries, ensure_ascii=False, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> Interface:
        entries = json.loads(text)
        variables: Sequence[dict[str, Any]] = entries.pop("variables")
        return cls(variables=tuple(Variable(**v) for v in variables), **entries)
