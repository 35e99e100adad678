"""Limits of the voltages that a scenario gives its instances: what they leave, and whether they agree."""

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any

import numpy as np

from flexbeams.controller.reach import idle_voltages, voltages_within
from flexbeams.controller.voltage_limits import Violation, VoltageLimits
from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import InstanceDeclaration, element_names
from flexbeams.scenarios.definition.settings import StartValues

LIMIT, OWN = "voltage_limit", ("voltage_min", "voltage_max")


def voltage_limits_of(variables: Mapping[str, Any], starts: StartValues) -> VoltageLimits:
    """The limits that an instance starts with."""
    limit = _start(LIMIT, variables, starts)
    minimum, maximum = ([_start(n, variables, starts) for n in element_names(variables, name)] for name in OWN)
    return VoltageLimits.joined(limit, np.array(minimum or [-limit]), np.array(maximum or [limit]))


def broken_limit(violation: Violation, variables: Mapping[str, Any], starts: StartValues) -> str:
    """Which voltage a pair would need at rest, and the parameter that forbids it."""
    own = f"{OWN[0 if violation.is_below else 1]}[{violation.pair + 1}]"
    limit, need = _start(LIMIT, variables, starts), f"patch pair {violation.pair + 1} would need"
    if own in variables and abs(bound := _start(own, variables, starts)) < limit:
        return f"{need} {violation.voltage:.1f} V at rest, {own} is {bound:g} V"
    return f"{need} {abs(violation.voltage):.1f} V at rest, the limit is {limit:g} V"


def other_voltages(inverse: Array, voltages: Array, limits: VoltageLimits) -> str:
    """With redundant pairs, whether other voltages within the limits would hold what the feedforward's hold."""
    idle = idle_voltages(inverse)
    if not idle.shape[1]:
        return ""
    within = voltages_within(limits, voltages, idle)
    if within is None:
        return "; no other voltages within the limits hold it"
    listed = ", ".join(f"{u:.1f}" for u in within)
    return f"; [{listed}] V would hold it, but the feedforward takes the voltages with the least sum of squares"


def note_limits(
    declarations: Mapping[str, InstanceDeclaration],
    starts: Mapping[str, StartValues],
    notify: Callable[[str], None],
) -> None:
    """Notes limits that differ between two instances, and those of a pair that are wider than that of all."""
    limits = {name: _limits(declaration.variables) for name, declaration in declarations.items()}
    limited = [name for name, names in limits.items() if LIMIT in names]
    for name in limited:
        variables, own = declarations[name].variables, starts[name]
        for limit in (n for n in own if n in limits[name] and n != LIMIT):
            if abs(float(own[limit])) > _start(LIMIT, variables, own):
                notify(
                    f"{name}.{limit} = {float(own[limit]):g} V has no effect: {name}.{LIMIT} is "
                    f"{_start(LIMIT, variables, own):g} V"
                )
    for one, other in combinations(limited, 2):
        differing = []
        for limit in (n for n in limits[one] if n in limits[other]):
            values = [_start(limit, declarations[name].variables, starts[name]) for name in (one, other)]
            if values[0] != values[1]:
                differing.append(f"{one}.{limit} is {values[0]:g} V, {other}.{limit} {values[1]:g} V")
        if differing:
            more = f" (and {len(differing) - 1} more)" if len(differing) > 1 else ""
            key = differing[0].split(" ")[0].partition(".")[2].partition("[")[0]
            notify(f"{differing[0]}{more}: set one limit for both, or design.{key} for all units")


def _limits(variables: Mapping[str, Any]) -> list[str]:
    """The limits of voltages among the variables."""
    named = (n for n, v in variables.items() if v.type == "Real" and v.start is not None)
    return [n for n in named if n.partition("[")[0] in (LIMIT, *OWN)]


def _start(name: str, variables: Mapping[str, Any], starts: StartValues) -> float:
    return float(starts.get(name, variables[name].start))
