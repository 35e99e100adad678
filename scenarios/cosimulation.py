"""Connection plan and stepping of coupled instances, in integer steps, with one array for all signals."""

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from plant.basis import Array
from plant.errors import InputError, suggestion
from scenarios.instance import UnitFailure, UnitInstance, element_names
from scenarios.schema import Coupling, Input, Scenario
from scenarios.signals import sample, width

BLOCK = 500         # steps between looks at progress and external signals


@dataclass(kw_only=True)
class Recording:
    """What a run leaves: row k holds the values at time[k]."""

    time: Array                     # (rows,), s
    columns: list[str]              # <instance>.<variable>
    values: Array                   # (rows, len(columns))
    wall: float                     # s, of the stepping loop alone
    failure: UnitFailure | None = None
    interrupted: bool = False

    @property
    def complete(self) -> bool:
        """The run reached its stop time."""
        return self.failure is None and not self.interrupted


@dataclass(kw_only=True)
class Plan:
    """Where every value stands in the one array of signals: outputs by instance, then external signals."""

    size: int
    sources: dict[str, int]                            # <instance>.<variable> to place
    inputs: dict[str, list[tuple[str, int]]]           # instance to (input, place of its source)
    reads: dict[str, list[str]]                        # instance to variables read, Real ones first
    spans: dict[str, slice]                            # instance to its part of the array
    external: list[tuple[slice, Input | float]] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    recorded: list[int] = field(default_factory=list)


class Planner:
    """Builds a Plan from a scenario and the variables of its instances; InputError names file, key and value."""

    def __init__(self, scenario: Scenario, instances: dict[str, UnitInstance], source: str) -> None:
        self._scenario, self._instances, self._file = scenario, instances, source

    def plan(self) -> Plan:
        """The plan; every connection, input and record entry resolved."""
        extra = [self._signal(f"record[{k}]", name) for k, name in enumerate(self._scenario.record or [], 1)]
        plan = Plan(size=0, sources={}, inputs={name: [] for name in self._instances}, reads={}, spans={})
        for name, instance in self._instances.items():
            wanted = [n for owner, names in extra if owner == name for n in names]
            variables = [v for v in instance.variables.values() if v.type != "String" and v.causality != "input"]
            ordered = sorted((v for v in variables if v.causality == "output" or v.name in wanted),
                             key=lambda v: v.type != "Real")
            plan.reads[name] = [v.name for v in ordered]
            plan.spans[name] = slice(plan.size, plan.size + len(ordered))
            plan.sources |= {f"{name}.{v.name}": plan.size + k for k, v in enumerate(ordered)}
            plan.size += len(ordered)
        self._connect(plan)
        self._drive(plan)
        self._hold_open_inputs(plan, [f"{owner}.{n}" for owner, names in extra for n in names])
        self._choose_columns(plan, extra)
        return plan

    def _signal(self, key: str, text: str, causality: str | None = None) -> tuple[str, list[str]]:
        """The instance and the scalars that <instance>.<variable> means."""
        owner, _, variable = text.partition(".")
        if owner not in self._instances:
            raise InputError(key, f"names an unknown instance {owner!r}" + suggestion(owner, self._instances), text,
                             source=self._file)
        variables = self._instances[owner].variables
        names = element_names(variables, variable)
        allowed = [n for n in names if causality is None or variables[n].causality == causality]
        if not allowed:
            kind = causality or "variable"
            known = dict.fromkeys(v.name.split("[")[0] if "]." not in v.name else v.name for v in variables.values()
                                  if causality is None or v.causality == causality)
            hint = suggestion(variable.split("[")[0], known)
            raise InputError(key, f"names no {kind} {variable!r} of {owner}{hint}", text, source=self._file)
        return owner, allowed

    def _claim(self, plan: Plan, key: str, owner: str, names: list[str]) -> None:
        taken = {n for n, _ in plan.inputs[owner]}
        for name in names:
            if name in taken:
                raise InputError(key, "must not drive an input that is driven already", f"{owner}.{name}",
                                 source=self._file)

    def _connect(self, plan: Plan) -> None:
        for k, connection in enumerate(self._scenario.connection, 1):
            source, outputs = self._signal(f"connection[{k}].from", connection.source, "output")
            target, inputs = self._signal(f"connection[{k}].to", connection.to, "input")
            if len(outputs) != len(inputs):
                raise InputError(f"connection[{k}]", f"must join equal sizes: {connection.source} has {len(outputs)}, "
                                 f"{connection.to} has {len(inputs)}", source=self._file)
            self._claim(plan, f"connection[{k}].to", target, inputs)
            plan.inputs[target] += [(i, plan.sources[f"{source}.{o}"]) for i, o in zip(inputs, outputs, strict=True)]

    def _drive(self, plan: Plan) -> None:
        for k, signal in enumerate(self._scenario.input, 1):
            owner, names = self._signal(f"input[{k}].to", signal.to, "input")
            try:
                elements = width(signal)
            except InputError as error:
                raise error.at(self._file, f"input[{k}].") from None
            if elements not in (1, len(names)):
                raise InputError(f"input[{k}]", f"must give {len(names)} values for {signal.to}", elements,
                                 source=self._file)
            self._claim(plan, f"input[{k}].to", owner, names)
            self._add_external(plan, owner, names, signal)

    def _hold_open_inputs(self, plan: Plan, recorded: list[str]) -> None:
        """A plant's inputs that nothing drives keep their start values and are recorded all the same."""
        for owner, instance in self._instances.items():
            driven = {n for n, _ in plan.inputs[owner]}
            for v in instance.variables.values():
                shown = instance.description.modelName == "BeamPlant" or f"{owner}.{v.name}" in recorded
                if v.causality == "input" and v.type == "Real" and v.name not in driven and shown:
                    self._add_external(plan, owner, [v.name], float(v.start or 0.0))

    def _add_external(self, plan: Plan, owner: str, names: list[str], signal: Input | float) -> None:
        span = slice(plan.size, plan.size + len(names))
        plan.external.append((span, signal))
        plan.inputs[owner] += [(n, span.start + k) for k, n in enumerate(names)]
        plan.size = span.stop

    def _choose_columns(self, plan: Plan, extra: list[tuple[str, list[str]]]) -> None:
        """Every output but x_ref, a plant's inputs, and what the scenario adds; in the order of the variables."""
        wanted = {f"{owner}.{n}" for owner, names in extra for n in names}
        for owner, instance in self._instances.items():
            driven = dict(plan.inputs[owner])
            for v in instance.variables.values():
                full = f"{owner}.{v.name}"
                standard = ((v.causality == "output" and not v.name.startswith("x_ref["))
                            or (v.causality == "input" and instance.description.modelName == "BeamPlant"))
                place = plan.sources.get(full, driven.get(v.name))
                if place is not None and (standard or full in wanted):
                    plan.columns.append(full)
                    plan.recorded.append(place)


class CoSimulation:
    """Instances that step together by a plan."""

    def __init__(self, instances: dict[str, UnitInstance], plan: Plan, step: float) -> None:
        self._instances, self._plan, self._step = instances, plan, step
        self._signals = np.zeros(plan.size)
        self._gather: dict[str, NDArray[np.intp]] = {}
        for name, instance in instances.items():
            inputs = plan.inputs[name]
            instance.connect(plan.reads[name], self._signals[plan.spans[name]], [n for n, _ in inputs])
            self._gather[name] = np.array([place for _, place in inputs], dtype=np.intp)

    def initialise(self, stop_time: float) -> None:
        """Initialisation mode of every instance; values pass along the order of the instances, twice."""
        for instance in self._instances.values():
            instance.call("setupExperiment", None, 0.0, stop_time)
            instance.call("enterInitializationMode")
        self._signals[self._first_external():] = self._external(0, 1)[0]
        for _ in range(2):
            for name in self._instances:
                self._exchange(name)
                self._instances[name].read()
        for instance in self._instances.values():
            instance.call("exitInitializationMode")
        for instance in self._instances.values():
            instance.read()

    def run(self, steps: int, coupling: Coupling, progress: Callable[[int], None] = lambda done: None) -> Recording:
        """Steps from 0 to steps * step and records; a unit's failure or Ctrl-C ends the run, rows so far are kept."""
        advance = self._jacobi if coupling == "jacobi" else self._gauss_seidel
        recorded = np.array(self._plan.recorded, dtype=np.intp)
        values = np.empty((steps + 1, len(recorded)))
        signals, first = self._signals, self._first_external()
        recording = Recording(time=self._times(0, steps + 1), columns=self._plan.columns, values=values, wall=0.0)
        begin = clock.perf_counter()
        k = 0
        try:
            while k < steps:
                block = min(BLOCK, steps - k)
                external = self._external(k, block)
                for row in external:
                    signals[first:] = row
                    np.take(signals, recorded, out=values[k])
                    advance(k * self._step)
                    k += 1
                progress(k)
            signals[first:] = self._external(steps, 1)[0]
            np.take(signals, recorded, out=values[k])
            k += 1
        except UnitFailure as failure:
            recording.failure = failure
        except KeyboardInterrupt:
            recording.interrupted = True
        recording.wall = clock.perf_counter() - begin
        if not recording.complete:
            # The row of the step that failed was taken before it
            recording.time, recording.values = recording.time[:k + 1], values[:k + 1]
        return recording

    def _times(self, first: int, count: int) -> Array:
        return np.arange(first, first + count, dtype=np.float64) * self._step

    def _first_external(self) -> int:
        return self._plan.external[0][0].start if self._plan.external else self._plan.size

    def _external(self, first: int, count: int) -> Array:
        """External signals of steps first ... first + count - 1, (count, all external elements)."""
        time = self._times(first, count)
        rows = np.empty((count, self._plan.size - self._first_external()))
        offset = self._first_external()
        for span, signal in self._plan.external:
            part = rows[:, span.start - offset:span.stop - offset]
            part[:] = signal if isinstance(signal, float) else sample(signal, time)
        return rows

    def _exchange(self, name: str) -> None:
        instance = self._instances[name]
        np.take(self._signals, self._gather[name], out=instance.inputs)
        instance.write()

    def _jacobi(self, time: float) -> None:
        """All units read the values of t_k, then all step."""
        for name in self._instances:
            self._exchange(name)
        for instance in self._instances.values():
            instance.step(time, self._step)
        for instance in self._instances.values():
            instance.read()

    def _gauss_seidel(self, time: float) -> None:
        """Units step in their order and pass on new values at once."""
        for name, instance in self._instances.items():
            self._exchange(name)
            instance.step(time, self._step)
            instance.read()
