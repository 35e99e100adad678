"""The inputs of a study: parameters of the file resolved to variables of units and options of the design."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flexbeams.controller.options import DesignOptions
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.validation import validate
from flexbeams.scenarios.definition.declaration import access_type, split_owner
from flexbeams.scenarios.definition.settings import chosen_variables
from flexbeams.scenarios.definition.study import Parameter
from flexbeams.scenarios.definition.values import own_start, require_bounds
from flexbeams.scenarios.runs.prepare import PreparedScenario

DESIGN = "design"  # in place of an instance: an option of the design


@dataclass(frozen=True, kw_only=True)
class Target:
    """A variable that an axis sets, to the axis's value times `factor`."""

    instance: str
    variable: str
    factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One input of the runs: a column of the data set."""

    name: str
    unit: str  # of measurement
    nominal: float  # the scenario's own value
    group: str  # axes of one group are one input of the sensitivity
    targets: tuple[Target, ...] = ()  # none of an option of the design
    option: str = ""  # of the design, such as weights.kalman_q_total
    quantiles: Callable[[Array], Array]  # values from uniform numbers within (0, 1)
    support: tuple[float, float]
    levels: Array | None = None  # on a grid


def resolve_axes(parameters: list[Parameter], prepared: PreparedScenario, source: str) -> list[Axis]:
    """The axes of all parameters, in their order.

    Raises InputError for an unknown name or distribution, and for values that a variable cannot take.
    """
    axes: list[Axis] = []
    for k, parameter in enumerate(parameters, 1):
        try:
            resolved = list(_resolved(parameter, prepared))
        except InputError as error:
            raise error.at(source, f"parameter[{k}].") from None
        for axis in resolved:
            if any(axis.name == other.name for other in axes):
                raise InputError(f"parameter[{k}].name", "varies what another one varies", axis.name, source=source)
            axes.append(axis)
    return axes


def _resolved(parameter: Parameter, prepared: PreparedScenario) -> Iterator[Axis]:
    spread = _Spread.of(parameter)
    owner, name = split_owner(parameter.name, [*prepared.declarations, DESIGN])
    if owner == DESIGN and DESIGN not in prepared.declarations:
        yield _option_axis(parameter, spread, name, prepared.scenario.design)
        return
    if owner not in prepared.declarations:
        hint = suggestion(owner, [*prepared.declarations, DESIGN])
        raise InputError("name", f"names an unknown instance {owner!r}{hint}", parameter.name)
    variables = prepared.declarations[owner].variables
    names = chosen_variables("name", name, variables, "")
    for n in names:
        if variables[n].causality == "input":
            raise InputError("name", "must be a parameter, not an input", f"{owner}.{n}")
        if variables[n].type == "String":
            raise InputError("name", "must not be a String", f"{owner}.{n}")
    nominal = {n: float(prepared.starts[owner].get(n, own_start(variables[n]))) for n in names}
    if parameter.relative:
        for n, value in nominal.items():
            if value == 0:
                raise InputError("relative", f"cannot be: the scenario's value of {owner}.{n} is 0")
    groups = [names] if parameter.together else [[n] for n in names]
    for members in groups:
        yield _axis(parameter, spread, owner, {n: nominal[n] for n in members}, variables)


def _axis(
    parameter: Parameter, spread: "_Spread", owner: str, nominal: dict[str, float], variables: Mapping[str, Any]
) -> Axis:
    """The axis of variables that take one value, or one factor on their own values."""
    alone = len(nominal) == 1
    first = next(iter(nominal))
    name = f"{owner}.{first}" if alone else parameter.name
    scales = [value if parameter.relative else 1.0 for value in nominal.values()]
    scale = scales[0] if alone else 1.0
    spread = spread.scaled(scale)
    targets = []
    for (variable, _), own in zip(nominal.items(), scales, strict=True):
        factor = 1.0 if alone else own
        targets.append(Target(instance=owner, variable=variable, factor=factor))
        spread.scaled(factor).require(variables[variable], parameter.relative)
    unit = variables[first].unit or ""
    return Axis(
        name=name,
        unit="1" if parameter.relative and not alone else unit,
        nominal=1.0 if parameter.relative and not alone else nominal[first],
        group=parameter.group or name,
        targets=tuple(targets),
        quantiles=spread.quantiles,
        support=spread.support,
        levels=spread.levels,
    )


def _option_axis(parameter: Parameter, spread: "_Spread", name: str, options: DesignOptions) -> Axis:
    """The axis of an option of the design."""
    table = asdict(options)
    known = [*(k for k, v in table.items() if _is_number(v)), *(f"weights.{k}" for k in table["weights"])]
    if name not in known:
        raise InputError("name", "is not a number among the options" + suggestion(name, known), parameter.name)
    part, _, key = name.rpartition(".")
    nominal = float(table[part][key] if part else table[key])
    spread = spread.scaled(nominal if parameter.relative else 1.0)
    for end in spread.support:
        with_option(options, name, end)
    return Axis(
        name=parameter.name,
        unit="",
        nominal=nominal,
        group=parameter.group or parameter.name,
        option=name,
        quantiles=spread.quantiles,
        support=spread.support,
        levels=spread.levels,
    )


def with_option(options: DesignOptions, name: str, value: float) -> DesignOptions:
    """The options with another value of one of them; InputError for a value that it cannot take."""
    table = {key: v for key, v in asdict(options).items() if v is not None}
    part, _, key = name.rpartition(".")
    place = table[part] if part else table
    place[key] = int(value) if isinstance(place[key], int) and value == int(value) else value
    return validate(DesignOptions, table, "design")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclass(frozen=True, kw_only=True)
class _Spread:
    """How the values of a parameter are distributed."""

    quantiles: Callable[[Array], Array]
    support: tuple[float, float]
    levels: Array | None
    whole: bool = False  # all values are integers

    @classmethod
    def of(cls, parameter: Parameter) -> "_Spread":
        if parameter.values is not None:
            return cls._of_values(np.array(parameter.values, dtype=float))
        count = parameter.levels
        if parameter.range is not None:
            low, high = parameter.range
            levels = None if count is None else np.linspace(low, high, count) if count > 1 else np.array([low])
            return cls(quantiles=lambda u: low + (high - low) * u, support=(low, high), levels=levels)
        return cls._of_distribution(parameter)

    @classmethod
    def _of_values(cls, values: Array) -> "_Spread":
        if len(np.unique(values)) < len(values):
            raise InputError("values", "must be different", values.tolist())
        return cls(
            quantiles=lambda u: values[np.minimum((u * len(values)).astype(int), len(values) - 1)],
            support=(float(values.min()), float(values.max())),
            levels=values,
            whole=bool(np.all(values == np.rint(values))),
        )

    @classmethod
    def _of_distribution(cls, parameter: Parameter) -> "_Spread":
        from scipy import stats  # takes longer to import than all the rest of a worker

        name = str(parameter.distribution)
        known = [n for n in dir(stats) if isinstance(getattr(stats, n), stats.rv_continuous | stats.rv_discrete)]
        if name not in known:
            raise InputError("distribution", "is not one of scipy.stats" + suggestion(name, known), name)
        family = getattr(stats, name)
        shapes = [s.strip() for s in (family.shapes or "").split(",") if s.strip()]
        takes = [*shapes, "loc", *([] if isinstance(family, stats.rv_discrete) else ["scale"])]
        for key in parameter.arguments:
            if key not in takes:
                raise InputError(f"arguments.{key}", f"is not an argument of {name}: {', '.join(takes)}")
        if missing := [s for s in shapes if s not in parameter.arguments]:
            raise InputError("arguments", f"must have {', '.join(missing)} of {name}")
        frozen = family(**parameter.arguments)
        low, high = (float(end) for end in frozen.support())
        if np.isnan(low) or np.isnan(high) or not np.isfinite(frozen.ppf(0.5)):
            raise InputError("arguments", f"are not possible for {name}", str(dict(parameter.arguments)))
        count = parameter.levels
        levels = None if count is None else np.asarray(frozen.ppf((np.arange(count) + 0.5) / count), dtype=float)
        return cls(
            quantiles=lambda u: np.asarray(frozen.ppf(u), dtype=float),
            support=(low, high),
            levels=levels,
            whole=isinstance(family, stats.rv_discrete),
        )

    def scaled(self, factor: float) -> "_Spread":
        """The spread of all values times a factor."""
        if factor == 1.0:
            return self
        ends = sorted(factor * end for end in self.support)
        return _Spread(
            quantiles=lambda u: factor * self.quantiles(u),
            support=(ends[0], ends[1]),
            levels=None if self.levels is None else factor * self.levels,
        )

    def require(self, variable: Any, relative: bool) -> None:
        """InputError for values that a variable cannot take."""
        if access_type(variable.type) != "Real" and (not self.whole or relative):
            raise InputError(
                "name", f"is of type {variable.type} and takes integers: values or a discrete distribution"
            )
        for end in self.support:
            if np.isfinite(end):
                require_bounds("name", variable, end)
                continue
            side = variable.min if end < 0 else variable.max
            if side is not None and np.isfinite(float(side)):
                rule = f"reaches beyond the bounds of {variable.name} ({variable.min} to {variable.max})"
                raise InputError("distribution", f"{rule}; truncate it, as truncnorm does", str(end))
