"""Settings of a run, and the precedence of everything that can be given in more than one place.

Options of the command line come before the scenario's keys, and those before the defaults. A start value is that of
--set; else of the scenario's table `start`; else the unit's own value times the scenario's factor in `scale`; else the
unit's own, which comes from the design or the FMU. In a package, the parameter sets take the place of the scenario's
tables.
"""

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.validation import validate
from flexbeams.scenarios.definition.choices import Backend, BasisName, Coupling, Format
from flexbeams.scenarios.definition.declaration import (
    InstanceDeclaration,
    by_index,
    element_names,
    is_settable,
    split_owner,
)
from flexbeams.scenarios.definition.schema import Instance, Scenario, Value
from flexbeams.scenarios.definition.values import TypedValue, require_bounds, require_value

StartValues = dict[str, TypedValue]  # by variable


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Options of a run; None keeps the scenario's value."""

    backend: Backend = "native"
    compiler: str = "zig"
    real_time_factor: float | None = None  # simulated seconds for each second of the wall clock; None: unpaced
    coupling: Coupling | None = None
    basis: BasisName | None = None
    structure: str | None = None
    stop_time: float | None = None  # s
    step: float | None = None  # s, between communication points
    overrides: Mapping[str, Value] = field(default_factory=dict)  # <instance>.<variable>, or array, to start value
    decimate: int = 1  # every which step is recorded
    record_every: Mapping[str, int] = field(default_factory=dict)  # signal or array: every which step it is recorded
    build_folder: Path = field(default_factory=cache_folder)  # where built units are kept, see fmus.packaging.cache
    units_row: bool = False  # units of measurement in the second row of results.csv
    record_animation: bool = True  # record the deflected beams for the animation
    record_deflections: bool = False  # record the plant's w in every row, beside the columns
    open_inputs: bool = False  # inputs that nothing drives are signals, which the caller sets
    design: Mapping[str, Any] = field(default_factory=dict)  # keys of [design], in place of the scenario's
    formats: tuple[Format, ...] = ()  # of the result files that are to be written
    results_folder: Path | None = None  # where they are written
    kinds: tuple[UnitKind, ...] = ()  # of units that scenarios may name beside those of the catalogue

    def __post_init__(self) -> None:
        for name in ("stop_time", "step", "real_time_factor"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise InputError(f"--{name.replace('_', '-')}", "must be finite and > 0", value)
        if self.decimate < 1:
            raise InputError("--decimate", "must be >= 1", self.decimate)

    def applied_to(self, scenario: Scenario) -> Scenario:
        """The scenario with these settings in place of its own values."""
        return replace(
            scenario,
            coupling=self.coupling or scenario.coupling,
            stop_time=self.stop_time or scenario.stop_time,
            step=self.step or scenario.step,
            design=_on_basis(_with_options(scenario.design, self.design), self.basis),
        )

    def stop_time_source(self, source: str) -> str:
        """The option or the file that the stop time comes from, for messages."""
        return "--stop-time" if self.stop_time else source

    def of_open_loop(self, instances: Collection[str]) -> "Settings":
        """Settings of the run to compare with: start values of the instances that it has, no animation, unpaced."""
        overrides = {key: value for key, value in self.overrides.items() if key.partition(".")[0] in instances}
        rates = {key: every for key, every in self.record_every.items() if key.partition(".")[0] in instances}
        return replace(
            self,
            overrides=overrides,
            record_every=rates,
            record_animation=False,
            record_deflections=False,
            open_inputs=False,
            real_time_factor=None,
        )


def _with_options(options: DesignOptions, given: Mapping[str, Any]) -> DesignOptions:
    """The options with keys of the table [design] in place of their own; InputError for one that breaks a rule."""
    if not given:
        return options
    basis = given.get("basis", options.basis)
    table = {**asdict(options if basis == options.basis else replace(options, order=None, output_weight=None)), **given}
    if isinstance(weights := given.get("weights"), Mapping):
        table["weights"] = {**asdict(options.weights), **weights}
    if given.get("static_maps") not in (None, "basis", "segment"):
        table["static_maps"] = str(Path(given["static_maps"]).absolute())
    return validate(DesignOptions, table, "design")


def _on_basis(options: DesignOptions, basis: BasisName | None) -> DesignOptions:
    """The options on another basis; order and norm then take that basis's defaults."""
    if basis is None or options.basis == basis:
        return options
    return replace(options, basis=basis, order=None, output_weight=None)


def start_values(
    scenario: Scenario,
    declarations: Mapping[str, InstanceDeclaration],
    overrides: Mapping[str, Value],
    source: str,
    parameter_sets: Mapping[str, StartValues] | None = None,
) -> dict[str, StartValues]:
    """Start values of each instance that differ from its unit's own, by the precedence above.

    `overrides` are those of --set, `parameter_sets` those of a package. Raises InputError for an unknown name and for a
    value that does not fit its variable.
    """
    values = {name: dict((parameter_sets or {}).get(name, {})) for name in declarations}
    for name, instance in scenario.instance.items():
        variables = declarations[name].variables
        values[name] |= dict(_scaled(name, instance, variables, source))
        for key, value in instance.start.items():
            values[name] |= _assigned(f"instance.{name}.start.{key}", key, value, variables, source)
    for key, value in overrides.items():
        owner, variable = split_owner(key, declarations)
        if owner not in declarations:
            raise InputError("--set", f"names an unknown instance {owner!r}" + suggestion(owner, declarations), key)
        values[owner] |= _assigned(f"--set {key}", variable, value, declarations[owner].variables, "")
    return values


def require_undriven(overrides: Mapping[str, Value], driven: Mapping[str, Collection[str]]) -> None:
    """InputError for a --set of an input that a connection or a signal drives, where it would have no effect.

    `driven` has these inputs by instance.
    """
    for key in overrides:
        owner, variable = split_owner(key.removesuffix("[]"), driven)
        if any(name == variable or name.startswith(f"{variable}[") for name in driven[owner]):
            raise InputError("--set", "must not set an input that the scenario drives", key)


def _scaled(name: str, instance: Instance, variables: Mapping[str, Any], source: str) -> Iterator[tuple[str, float]]:
    """Start values of the unit times the factors of the table `scale`."""
    for key, factor in instance.scale.items():
        where = f"instance.{name}.scale.{key}"
        for variable, f in _pairs(where, key, factor, variables, source):
            if variables[variable].type != "Real":
                raise InputError(where, "must be of a Real variable", variables[variable].type, source=source)
            scaled = float(variables[variable].start) * float(f)
            require_bounds(where, variables[variable], scaled, source)
            yield variable, scaled


def _assigned(where: str, key: str, value: Any, variables: Mapping[str, Any], source: str) -> StartValues:
    pairs = _pairs(where, key, value, variables, source)
    return {name: require_value(where, variables[name], v, source) for name, v in pairs}


def _pairs(where: str, key: str, value: Any, variables: Mapping[str, Any], source: str) -> list[tuple[str, Any]]:
    """Scalars with their values, for a scalar, an array (by its name) or a family (a name with [])."""
    settable = chosen_variables(where, key, variables, source)
    if isinstance(value, str) and "," in value and (key not in variables or "[]" in key):
        value = [part.strip() for part in value.removeprefix("[").removesuffix("]").split(",")]
    listed = value if isinstance(value, list) else [value] * len(settable)
    if len(listed) != len(settable):
        raise InputError(where, f"must have {len(settable)} values", value, source=source)
    return list(zip(settable, listed, strict=True))


def chosen_variables(where: str, key: str, variables: Mapping[str, Any], source: str) -> list[str]:
    """The settable scalars that a scalar's name, an array's name or a family (a name with []) stands for.

    Raises InputError where there are none.
    """
    if "[]" in key:
        head, tail = key.split("[]", 1)
        names = by_index(n for n in variables if n.startswith(f"{head}[") and n.endswith(f"]{tail}"))
    else:
        names = element_names(variables, key)
    settable = [n for n in names if is_settable(variables[n])]
    if not settable:
        known = [
            re.sub(r"\[[0-9,]+\]$", "", re.sub(r"\[[0-9,]+\]\.", "[].", n))
            for n, v in variables.items()
            if v.causality in ("parameter", "input")
        ]  # arrays and families, not each of their elements
        rule = "is not settable" if names else _why_unknown(key, variables) + suggestion(key, known)
        raise InputError(where, rule, key, source=source)
    return settable


_GEOMETRY = re.compile(
    r"(beam|patch)\[\d*\]\.(length|width|thickness|position|electrode_distance|beam)"
    r"|(point_of_interest|strain_gauge)\b.*|spring\[\d*\]\.between"
)


def _why_unknown(key: str, variables: Collection[str]) -> str:
    """The rule that the name of no variable breaks: a range of indices, or that geometry cannot be set."""
    if _GEOMETRY.fullmatch(key):
        return "is geometry, which the design fixes: change it in the structure file"
    if indexed := re.fullmatch(r"(.*)\[(\d+)\](.*)", key):
        head, _, tail = indexed.groups()
        form = re.compile(rf"{re.escape(head)}\[(\d+)\]{re.escape(tail)}")
        if others := [int(match[1]) for name in variables if (match := form.fullmatch(name))]:
            return f"must have an index from {min(others)} to {max(others)}"
    return "is not a variable"
