"""Connection plan and stepping of coupled instances, in integer steps, with one array for all signals."""

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.schema import Coupling, Scenario
from flexbeams.scenarios.definition.signals import Signal, signal_of
from flexbeams.scenarios.processes.interrupt import held_interrupt
from flexbeams.scenarios.simulation.frames import FramePlan, FrameRecorder, Frames
from flexbeams.scenarios.simulation.instance import READ_ORDER, Declared, UnitFailure, UnitInstance, element_names
from flexbeams.scenarios.simulation.stepping import PythonStepper, Stepper, Wiring

BLOCK = 500  # steps between looks at progress and external signals


@dataclass(kw_only=True)
class Recording:
    """What a run leaves: row k holds the values at time[k], every `decimate`-th step and the last one."""

    time: Array  # (rows,), s
    columns: list[str]  # <instance>.<variable>
    values: Array  # (rows, len(columns))
    wall: float  # s, of the stepping loop alone
    steps: int = 0  # done
    decimate: int = 1
    failure: UnitFailure | None = None
    interrupted: bool = False
    frames: Frames | None = None  # shapes for an animation, where the plan asked for them
    lateness: Array | None = None  # s, of each step of a paced run against the wall clock

    @property
    def complete(self) -> bool:
        """The run reached its stop time."""
        return self.failure is None and not self.interrupted


@dataclass(kw_only=True)
class Plan:
    """Where every value stands in the one array of signals: outputs by instance, then external signals."""

    size: int
    sources: dict[str, int]  # <instance>.<variable> to place
    inputs: dict[str, list[tuple[str, int]]]  # instance to (input, place of its source)
    reads: dict[str, list[str]]  # instance to variables read, Real ones first
    spans: dict[str, slice]  # instance to its part of the array
    external: list[tuple[slice, Signal | float]] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    recorded: list[int] = field(default_factory=list)
    frames: FramePlan | None = None

    def links(self) -> dict[str, str]:
        """<instance>.<output> by the <instance>.<input> that takes its value, in the order of the inputs."""
        origins = {place: name for name, place in self.sources.items()}
        return {
            f"{instance}.{name}": origins[place]
            for instance, inputs in self.inputs.items()
            for name, place in inputs
            if place in origins
        }


class Planner:
    """Builds a Plan from a scenario and what its instances declare; InputError names file, key and value.

    `starts` has the start values set by instance; inputs that nothing drives hold theirs.
    """

    def __init__(
        self,
        scenario: Scenario,
        instances: Mapping[str, Declared],
        source: str,
        starts: Mapping[str, Mapping[str, float | bool]] | None = None,
    ) -> None:
        self._scenario, self._instances, self._file, self._starts = scenario, instances, source, starts or {}

    def plan(self) -> Plan:
        """The plan; every connection, input and record entry resolved."""
        extra = [self._signal(f"record[{k}]", name) for k, name in enumerate(self._scenario.record or [], 1)]
        plan = Plan(size=0, sources={}, inputs={name: [] for name in self._instances}, reads={}, spans={})
        for name, instance in self._instances.items():
            wanted = [n for owner, names in extra if owner == name for n in names]
            variables = [v for v in instance.variables.values() if v.type in READ_ORDER and v.causality != "input"]
            ordered = sorted(
                (v for v in variables if v.causality == "output" or v.name in wanted),
                key=lambda v: READ_ORDER.index(v.type),
            )
            plan.reads[name] = [v.name for v in ordered]
            plan.spans[name] = slice(plan.size, plan.size + len(ordered))
            plan.sources |= {f"{name}.{v.name}": plan.size + k for k, v in enumerate(ordered)}
            plan.size += len(ordered)
        self._connect(plan)
        self._drive(plan)
        self._hold_open_inputs(plan, [f"{owner}.{n}" for owner, names in extra for n in names])
        for name, instance in self._instances.items():  # inputs in the unit's own order, which it takes in one piece
            places = dict(plan.inputs[name])
            plan.inputs[name] = [(variable, places[variable]) for variable in instance.variables if variable in places]
        self._choose_columns(plan, extra)
        return plan

    def _signal(self, key: str, text: str, causality: str | None = None) -> tuple[str, list[str]]:
        """The instance and the scalars that <instance>.<variable> means."""
        owner, _, variable = text.partition(".")
        if owner not in self._instances:
            raise InputError(
                key,
                f"names an unknown instance {owner!r}" + suggestion(owner, self._instances),
                text,
                source=self._file,
            )
        variables = self._instances[owner].variables
        names = element_names(variables, variable)
        allowed = [n for n in names if variables[n].type != "String" and causality in (None, variables[n].causality)]
        if not allowed:
            kind = causality or "variable"
            known = dict.fromkeys(
                v.name.split("[")[0] if "]." not in v.name else v.name
                for v in variables.values()
                if v.type != "String" and causality in (None, v.causality)
            )
            hint = suggestion(variable.split("[")[0], known)
            raise InputError(key, f"names no {kind} {variable!r} of {owner}{hint}", text, source=self._file)
        return owner, allowed

    def _claim(self, plan: Plan, key: str, owner: str, names: list[str]) -> None:
        taken = {n for n, _ in plan.inputs[owner]}
        for name in names:
            if name in taken:
                raise InputError(
                    key, "must not drive an input that is driven already", f"{owner}.{name}", source=self._file
                )

    def _connect(self, plan: Plan) -> None:
        for k, connection in enumerate(self._scenario.connection, 1):
            source, outputs = self._signal(f"connection[{k}].from", connection.source, "output")
            target, inputs = self._signal(f"connection[{k}].to", connection.to, "input")
            if len(outputs) != len(inputs):
                raise InputError(
                    f"connection[{k}]",
                    f"must join equal sizes: {connection.source} has {len(outputs)}, {connection.to} has {len(inputs)}",
                    source=self._file,
                )
            self._claim(plan, f"connection[{k}].to", target, inputs)
            plan.inputs[target] += [(i, plan.sources[f"{source}.{o}"]) for i, o in zip(inputs, outputs, strict=True)]

    def _drive(self, plan: Plan) -> None:
        for k, drive in enumerate(self._scenario.input, 1):
            owner, names = self._signal(f"input[{k}].to", drive.to, "input")
            try:
                signal = signal_of(drive, Path(self._file).parent)
            except InputError as error:
                raise error if error.source else error.at(self._file, f"input[{k}].") from None
            if signal.width not in (1, len(names)):
                raise InputError(
                    f"input[{k}]", f"must give {len(names)} values for {drive.to}", signal.width, source=self._file
                )
            self._claim(plan, f"input[{k}].to", owner, names)
            self._add_external(plan, owner, names, signal)

    def _hold_open_inputs(self, plan: Plan, recorded: list[str]) -> None:
        """A plant's inputs that nothing drives keep their start values and are recorded all the same."""
        for owner, instance in self._instances.items():
            driven = {n for n, _ in plan.inputs[owner]}
            for v in instance.variables.values():
                shown = instance.description.modelName == "BeamPlant" or f"{owner}.{v.name}" in recorded
                if v.causality == "input" and v.type == "Real" and v.name not in driven and shown:
                    start = self._starts.get(owner, {}).get(v.name, v.start)
                    self._add_external(plan, owner, [v.name], float(start or 0.0))

    def _add_external(self, plan: Plan, owner: str, names: list[str], signal: Signal | float) -> None:
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
                standard = (v.causality == "output" and not v.name.startswith("x_ref[")) or (
                    v.causality == "input" and instance.description.modelName == "BeamPlant"
                )
                place = plan.sources.get(full, driven.get(v.name))
                if place is not None and (standard or full in wanted):
                    plan.columns.append(full)
                    plan.recorded.append(place)


class CoSimulation:
    """Instances that step together by a plan; `stepper` chooses the loop, by default the one in Python."""

    def __init__(
        self,
        instances: dict[str, UnitInstance],
        plan: Plan,
        step: float,
        coupling: Coupling,
        stepper: Callable[[Mapping[str, UnitInstance], Wiring], Stepper] | None = None,
    ) -> None:
        self._instances, self._plan, self._step = instances, plan, step
        signals = np.zeros(plan.size)
        sources = {name: np.array([place for _, place in plan.inputs[name]], dtype=np.int64) for name in instances}
        first = plan.external[0][0].start if plan.external else plan.size
        self._wiring = Wiring(
            signals=signals,
            first_external=first,
            spans=plan.spans,
            sources=sources,
            recorded=np.array(plan.recorded, dtype=np.int64),
            coupling=coupling,
            step=step,
        )
        for name, instance in instances.items():
            instance.connect(plan.reads[name], signals[plan.spans[name]], [n for n, _ in plan.inputs[name]])
        self._first = PythonStepper(instances, self._wiring)
        self.stepper: Stepper = stepper(instances, self._wiring) if stepper else self._first

    def initialise(self, stop_time: float) -> None:
        """Initialisation mode of every instance; values pass through them as often as the longest chain needs."""
        for instance in self._instances.values():
            instance.call("setupExperiment", None, 0.0, stop_time)
            instance.call("enterInitializationMode")
        self._wiring.signals[self._wiring.first_external :] = self._external(0, 1)[0]
        for _ in self._instances:
            for name in self._instances:
                self._first.exchange(name)
                self._instances[name].read()
        for instance in self._instances.values():
            instance.call("exitInitializationMode")
        for instance in self._instances.values():
            instance.read()

    def run(self, steps: int, progress: Callable[[int], None] = lambda done: None, decimate: int = 1) -> Recording:
        """Steps from 0 to steps * step and records; a unit's failure or Ctrl-C ends the run, rows so far are kept.

        Every `decimate`-th step is recorded, and the last one. Ctrl-C, or a KeyboardInterrupt of `progress`, is looked
        at after each block of steps, so that it meets no unit at work; a second Ctrl-C is raised at once.
        """
        wiring, stepper = self._wiring, self.stepper
        rows = np.empty((-(-steps // decimate) + 1, len(wiring.recorded)))
        recording = Recording(time=np.zeros(1), columns=self._plan.columns, values=rows, wall=0.0, decimate=decimate)
        np.take(wiring.signals, wiring.recorded, out=rows[0])
        frames = FrameRecorder(self._plan.frames, self._instances, steps, self._step)
        k, shown = 0, 0
        begin = clock.perf_counter()
        with held_interrupt() as interrupted:
            try:
                while k < steps and not interrupted():
                    if k == frames.due:
                        self._drive(k)
                        frames.take(wiring.signals)
                    count = min(BLOCK, steps - k, frames.due - k if frames.due > k else BLOCK)
                    k += stepper.advance(k, self._external(k, count), decimate, rows)
                    if k - shown >= BLOCK or k == steps:
                        try:
                            progress(shown := k)
                        except KeyboardInterrupt:
                            break
                self._drive(k)
                np.take(wiring.signals, wiring.recorded, out=rows[-(-k // decimate)])
                if k == frames.due:
                    frames.take(wiring.signals)
                recording.interrupted = k < steps
            except UnitFailure as failure:
                recording.failure, k = failure, stepper.done
        recording.wall = clock.perf_counter() - begin
        recording.steps, recording.frames = k, frames.taken()
        recording.lateness = None if stepper.lateness is None else stepper.lateness[:k]
        count = -(-k // decimate) + 1
        recording.time = np.minimum(np.arange(count) * decimate, k) * self._step
        recording.values = rows[:count]
        return recording

    def _drive(self, number: int) -> None:
        """External signals of one step into the array."""
        self._wiring.signals[self._wiring.first_external :] = self._external(number, 1)[0]

    def _external(self, first: int, count: int) -> Array:
        """External signals of steps first ... first + count - 1, (count, all external elements)."""
        time = np.arange(first, first + count, dtype=np.float64) * self._step
        offset = self._wiring.first_external
        rows = np.empty((count, self._plan.size - offset))
        for span, signal in self._plan.external:
            part = rows[:, span.start - offset : span.stop - offset]
            part[:] = signal if isinstance(signal, float) else signal.sample(time)
        return rows
