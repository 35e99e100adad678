"""The benchmark's scenario, built and loaded: loops of its units, and the bare loops with the same inputs."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.fmus.packaging.kept_units import ensure_units
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.bench.arithmetic import Matrices, TransitionSequence, matrices_of
from flexbeams.scenarios.bench.bare_loops import BareLoops, bare_library, step_lengths
from flexbeams.scenarios.bench.numpy_loops import NumpyLoops
from flexbeams.scenarios.bench.unit_loops import Loop, Starts, unit_plan, without_recording
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.signals import Signal
from flexbeams.scenarios.runs.prepare import prepare_scenario
from flexbeams.scenarios.runs.scenario import unit_files
from flexbeams.scenarios.simulation.native_stepper import stepper_library
from flexbeams.scenarios.simulation.wiring import Wiring

SCENARIO = "tracking"


class Workbench:
    """Design, units and loops of the benchmark's scenario; a context manager that frees the instances.

    `notify` gets a line when units are built.
    """

    def __init__(
        self,
        steps: int,
        compiler: str = "zig",
        build_folder: Path | None = None,
        notify: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.steps, self.compiler, self.build_folder, self._notify = steps, compiler, cache_folder(build_folder), notify
        settings = Settings(compiler=compiler, build_folder=self.build_folder, record_animation=False)
        prepared = prepare_scenario(load_scenario(SCENARIO), settings, notify)
        scenario, self.design = prepared.scenario, prepared.design
        self._plan, self.step = prepared.wiring, prepared.step
        self._starts = {name: prepared.numeric_starts(name) for name in prepared.starts}
        self.model = prepared.models["plant"]
        self._files = unit_files(prepared, notify)
        self._stepper = stepper_library(self.build_folder, compiler)
        self._library = bare_library(self.build_folder, compiler, self._files["feedforward"])
        self.matrices = matrices_of(self.design, self.model)
        self._stack = ExitStack()
        self._folder = self._stack.enter_context(temporary_folder())
        self.preview = float(self._starts.get("feedforward", {}).get("preview", 0.0))  # s
        self.target = np.array(scenario.input[0].targets[0].value) if scenario.input[0].targets else np.zeros(4)  # m

    def __enter__(self) -> "Workbench":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def units(self, units: Mapping[str, tuple[UnitKind, BeamModel]], design: Design) -> dict[str, Path]:
        """FMUs by instance, for kind and model of each; missing ones are built."""
        return ensure_units(units, design, self.build_folder, self._notify, compiler=self.compiler)

    @property
    def plant_file(self) -> Path:
        """The scenario's plant."""
        return self._files["plant"]

    def step_lengths(self, loop: Loop, time: float, lengths: Array) -> None:
        """Steps in C of a unit alone from `time`, each of its own length (k,), s."""
        unit = loop.instances["unit"]
        step_lengths(self._library, unit.address("fmi2DoStep"), unit.component, time, lengths)

    def bare(self, transitions: TransitionSequence | None = None, matrices: Matrices | None = None) -> BareLoops:
        """The bare loops, of the scenario's design unless other matrices are given."""
        return BareLoops(self._library, matrices or self.matrices, self.step, transitions)

    def numpy(self, transitions: TransitionSequence | None = None) -> NumpyLoops:
        """The recursions in numpy, of the scenario's design."""
        return NumpyLoops(self.design, self.matrices, transitions)

    def unit_loop(
        self, name: str, arrays: Sequence[str], rows: Array, starts: Starts | None = None, recorded: bool = False
    ) -> Loop:
        """The unit of an instance alone, its inputs `arrays` driven by rows (steps, their elements)."""
        return self.file_loop(self._files[name], arrays, rows, starts, recorded=recorded)

    def file_loop(
        self,
        file: Path,
        arrays: Sequence[str],
        rows: Array,
        starts: Starts | None = None,
        *,
        folder: str = "",
        recorded: bool = False,
    ) -> Loop:
        """The same for any native FMU; `folder` keeps units of one name apart."""
        place = self._folder / folder
        plan = unit_plan(file, place, arrays, rows, self.step, recorded)
        return self._loop({"unit": file}, plan, {"unit": starts or {}}, place)

    def closed_loop(self, recorded: bool) -> Loop:
        """The scenario's loop, with what a run records or nothing."""
        return self._loop(self._files, self._plan if recorded else without_recording(self._plan), self._starts)

    def closed_run(self) -> dict[str, Array]:
        """Every signal of the closed loop, (steps + 1,) each."""
        plan = replace(self._plan, columns=list(self._plan.sources), recorded=list(self._plan.sources.values()))
        loop = self._loop(self._files, plan, self._starts)
        loop.start()
        return loop.record(self.steps)

    def closed_rows(self, targets: Array) -> Array:
        """External signals of the closed loop that change, with these targets (steps, points); the others are zero."""
        changing = self._plan.changing
        rows = np.zeros((len(targets), changing.stop - changing.start))
        rows[:, : targets.shape[1]] = targets
        return rows

    def targets(self) -> Array:
        """The scenario's targets at each step, (steps, points)."""
        signal = self._plan.external[0][1]
        assert isinstance(signal, Signal)
        return signal.sample(np.arange(self.steps, dtype=np.float64) * self.step)

    def closed_transitions(self) -> TransitionSequence:
        """The transitions of the closed loop's feedforward."""
        return self.transitions(self.targets(), dict(self._starts["feedforward"]))

    def transitions(self, rows: Array, starts: Starts) -> TransitionSequence:
        """The transitions that targets (steps, points) cause, with the durations that the unit plans.

        A target during a motion takes effect when its plan is done; the next one may come after that.
        """
        loop = self.unit_loop("feedforward", ("y_target",), rows, starts)
        loop.start()
        targets = [k for k in range(1, len(rows)) if not np.array_equal(rows[k], rows[k - 1])]
        changes = [self.design.arrays["static_inverse"] @ (rows[k] - rows[k - 1]) for k in targets]
        unit, begins, durations, done = loop.instances["unit"], [], [], 0
        for k in targets:
            loop.advance(rows[done:k], done)
            begins.append(k + (PLANNING_TICKS if unit.get("moving") else 0))
            loop.advance(rows[k : begins[-1] + 1], k)
            durations.append(float(unit.get("planned_time")))
            done = begins[-1] + 1
        return TransitionSequence(
            begins=np.array(begins, np.int64),
            durations=np.array(durations),
            changes=np.array(changes).reshape(len(begins), len(self.design.arrays["static_inverse"])),
            preview=float(starts.get("preview", 0.0)),
        )

    def _loop(
        self, files: Mapping[str, Path], plan: Wiring, starts: Mapping[str, Starts], folder: Path | None = None
    ) -> Loop:
        loop = Loop(folder or self._folder, files, plan, starts, self._stepper, self.step)
        self._stack.callback(loop.close)
        return loop
