"""Initialisation of connected instances in the order in which their outputs depend on their inputs.

An input is set once its source is known, an output is read once all inputs that it depends on are set: no unit is given
a value that no other unit or signal gave. Dependencies are those that the units declare in InitialUnknowns; an output
without declared ones depends on all inputs of its unit. Inputs of a loop begin with their own start values, and the
loop is repeated until its values settle.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import access_type
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.wiring import Wiring

MAX_ROUNDS = 100  # of a loop
_SETTLED = 1e-12  # relative change of a loop's values from round to round


class Initialisation:
    """Exchanges the values of initialisation mode between instances; `signals` is the array of all signals.

    `needs` is as from needed_inputs.
    """

    def __init__(
        self,
        instances: Mapping[str, UnitInstance],
        wiring: Wiring,
        signals: Array,
        needs: Mapping[str, Mapping[str, frozenset[str]]],
    ) -> None:
        self._instances, self._wiring, self._signals = instances, wiring, signals
        first_external = wiring.external[0][0].start if wiring.external else wiring.size
        self._known = set(range(first_external, wiring.size))  # signals with a value
        self._set: dict[str, set[str]] = {name: set() for name in instances}  # inputs with a value
        self._needs = needs

    def exchange(self, notify: Callable[[str], None]) -> None:
        """Sets and reads all values; loops are noted.

        Raises UnitFailure where a unit refuses a value or a loop does not settle.
        """
        while any(self._advance(name) for name in self._instances):
            pass
        if loop := self._loop():
            notify(f"initialisation: {' -> '.join(loop)} is a loop, which begins with the units' start values")
            self._settle(loop)

    def _advance(self, name: str) -> bool:
        """Sets the inputs of an instance whose sources are known, then reads the outputs that follow."""
        instance = self._instances[name]
        inputs = [(n, k) for n, k in self._wiring.inputs[name] if n not in self._set[name] and k in self._known]
        self._write(instance, inputs)
        self._set[name].update(n for n, _ in inputs)
        ready = [
            (n, k)
            for n, k in self._outputs(name)
            if k not in self._known and self._needs[name].get(n, frozenset()) <= self._set[name]
        ]
        self._read(instance, ready)
        self._known.update(k for _, k in ready)
        return bool(inputs or ready)

    def _outputs(self, name: str) -> list[tuple[str, int]]:
        """What is read of an instance, with indices in the array of signals."""
        return list(zip(self._wiring.reads[name], range(self._wiring.size)[self._wiring.spans[name]], strict=True))

    def _write(self, instance: UnitInstance, inputs: list[tuple[str, int]]) -> None:
        conversions = self._wiring.conversions.get(instance.name, {})
        by_type: dict[str, list[tuple[int, Any]]] = {}
        for name, index in inputs:
            variable, value = instance.variables[name], float(self._signals[index])
            if name in conversions:
                value = value * conversions[name].factor + conversions[name].offset
            kind = access_type(variable.type)
            by_type.setdefault(kind, []).append((variable.valueReference, value if kind == "Real" else int(value)))
        for kind, pairs in by_type.items():
            instance.call(f"set{kind}", *map(list, zip(*pairs, strict=True)))

    def _read(self, instance: UnitInstance, outputs: list[tuple[str, int]]) -> None:
        variables = instance.variables
        for kind in sorted({access_type(variables[n].type) for n, _ in outputs}):
            chosen = [(variables[n].valueReference, k) for n, k in outputs if access_type(variables[n].type) == kind]
            values = instance.call(f"get{kind}", [reference for reference, _ in chosen])
            self._signals[[k for _, k in chosen]] = [float(value) for value in values]

    def _loop(self) -> list[str]:
        """Variables that wait for one another, from an input around to itself; empty where all are known."""
        names = {index: name for name, index in self._wiring.sources.items()}
        waiting = {
            f"{owner}.{name}": names[index]
            for owner, inputs in self._wiring.inputs.items()
            for name, index in inputs
            if index not in self._known
        }
        if not waiting:
            return []
        path = [next(iter(waiting))]
        while True:
            source = waiting[path[-1]]
            owner = max((n for n in self._instances if source.startswith(f"{n}.")), key=len)
            needed = self._needs[owner][source.removeprefix(f"{owner}.")] - self._set[owner]
            step = f"{owner}.{sorted(needed)[0]}"
            path += [source, step]
            if step in path[:-2]:
                around = path[path.index(step) :]
                return around[::-1]  # in the direction in which values flow

    def _settle(self, loop: list[str]) -> None:
        """Repeats the exchange, the first time with the start values of inputs that wait."""
        for name, instance in self._instances.items():
            self._read(instance, [(n, k) for n, k in self._outputs(name) if k not in self._known])
        for _ in range(MAX_ROUNDS):
            before = self._signals.copy()
            for name, instance in self._instances.items():
                self._write(instance, self._wiring.inputs[name])
                self._read(instance, self._outputs(name))
            if np.all(np.abs(self._signals - before) <= _SETTLED * np.abs(before)):
                return
        reason = f"the loop {' -> '.join(loop)} does not settle in {MAX_ROUNDS} rounds"
        raise UnitFailure(loop[0].partition(".")[0], 0.0, "initialisation", reason)


def needed_inputs(instances: Mapping[str, UnitInstance], wiring: Wiring) -> dict[str, dict[str, frozenset[str]]]:
    """For each instance, the connected inputs that each output depends on during initialisation."""
    return {
        name: output_dependencies(instance.description, [n for n, _ in wiring.inputs[name]])
        for name, instance in instances.items()
    }


def output_dependencies(description: Any, connected: list[str]) -> dict[str, frozenset[str]]:
    """The connected inputs that each output depends on during initialisation, by output."""
    inputs = frozenset(connected)
    needs = {
        unknown.variable.name: inputs
        if unknown.dependencies is None
        else frozenset(v.name for v in unknown.dependencies) & inputs
        for unknown in description.initialUnknowns
    }
    for variable in description.modelVariables:
        if variable.initial == "exact" or variable.causality in ("parameter", "input"):
            needs[variable.name] = frozenset()
        else:
            needs.setdefault(variable.name, inputs)
    return needs
