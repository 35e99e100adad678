"""Native units alone or in a loop, stepped in C with or without the runner."""

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from fmpy import read_model_description

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.signals import Signal
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.simulation.cosimulation import CoSimulation
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.native_stepper import NativeStepper
from flexbeams.scenarios.simulation.wiring import Wiring

Starts = Mapping[str, float | bool]  # start values of a unit by variable


class Loop:
    """Native units wired by a plan and stepped in C, by the loop alone or by the runner.

    `folder` takes the extracted units, `library` is the stepper's.
    """

    def __init__(
        self,
        folder: Path,
        files: Mapping[str, Path],
        plan: Wiring,
        starts: Mapping[str, Starts],
        library: Path,
        step: float,
    ) -> None:
        self._starts, self._step = starts, step
        self.plan = plan
        self.instances: dict[str, UnitInstance] = {}
        for name, file in files.items():
            extracted = folder / file.stem
            if not extracted.exists():
                ExtractionBudget().extract(file, extracted)
            self.instances[name] = UnitInstance(
                name, extracted, read_model_description(str(extracted), validate=False), lambda text: None
            )
        self._simulation = CoSimulation(
            self.instances, plan, step, "jacobi", lambda connected, wiring: NativeStepper(connected, wiring, library)
        )

    @property
    def stepper(self) -> NativeStepper:
        """The loop in C."""
        assert isinstance(self._simulation.stepper, NativeStepper)
        return self._simulation.stepper

    def start(self, **values: float) -> None:
        """Resets and initialises all units; further start values go to the instances that have them."""
        for name, instance in self.instances.items():
            instance.call("reset")
            for variable, value in {**self._starts.get(name, {}), **values}.items():
                if variable in instance.variables:
                    instance.set_start(variable, value)
        self._simulation.initialise({}, 1e6)

    def advance(self, rows: Array, first: int = 0) -> float:
        """Seconds that the steps of these external rows take, nothing recorded."""
        nothing = np.zeros((1, 1))
        begin = clock.perf_counter()
        self.stepper.advance(first, rows, len(rows) + first, nothing)
        return clock.perf_counter() - begin

    def run(self, steps: int) -> float:
        """Seconds of the runner's stepping loop, recording included."""
        return self._simulation.run(steps).wall_seconds

    def advance_from_start(self, rows: Array) -> float:
        """`start`, then `advance`."""
        self.start()
        return self.advance(rows)

    def run_from_start(self, steps: int) -> float:
        """`start`, then `run`."""
        self.start()
        return self.run(steps)

    def record(self, steps: int) -> dict[str, Array]:
        """A run's columns by name."""
        recording = self._simulation.run(steps)
        return dict(zip(recording.columns, recording.values.T, strict=True))

    def close(self) -> None:
        """Frees the instances."""
        for instance in self.instances.values():
            instance.close()


def replay(rows: Array, step: float) -> Signal:
    """A signal with row k at k * step that keeps the last row."""
    return Signal(
        width=rows.shape[1], sample=lambda time: rows[np.minimum(np.rint(time / step).astype(int), len(rows) - 1)]
    )


def unit_plan(file: Path, folder: Path, arrays: Sequence[str], rows: Array, step: float, recorded: bool) -> Wiring:
    """A unit alone, its inputs `arrays` driven by rows (steps, all their elements), every output read."""
    if not (folder / file.stem).exists():
        ExtractionBudget().extract(file, folder / file.stem)
    variables = read_model_description(str(folder / file.stem), validate=False).modelVariables
    inputs = [
        v.name for array in arrays for v in variables if v.causality == "input" and v.name.startswith(f"{array}[")
    ]
    outputs = [
        v.name
        for kind in ("Real", "Integer", "Boolean")
        for v in variables
        if v.causality == "output" and v.type == kind
    ]
    n = len(outputs)
    return Wiring(
        size=n + len(inputs),
        sources={f"unit.{name}": k for k, name in enumerate(outputs)},
        inputs={"unit": [(name, n + k) for k, name in enumerate(inputs)]},
        reads={"unit": outputs},
        spans={"unit": slice(0, n)},
        external=[(slice(n, n + len(inputs)), replay(rows, step))],
        columns=[f"unit.{name}" for name in outputs] if recorded else [],
        recorded=list(range(n)) if recorded else [],
    )


def without_recording(plan: Wiring) -> Wiring:
    """The plan with nothing recorded, and each unit's outputs read up to the last one that is connected."""
    used = {place for inputs in plan.inputs.values() for _, place in inputs}
    reads = {}
    for name, outputs in plan.reads.items():
        first = plan.spans[name].start
        reads[name] = outputs[: 1 + max((k for k in range(len(outputs)) if first + k in used), default=-1)]
    spans = {name: slice(span.start, span.start + len(reads[name])) for name, span in plan.spans.items()}
    return replace(plan, columns=[], recorded=[], reads=reads, spans=spans)
