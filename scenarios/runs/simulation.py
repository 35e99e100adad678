"""A scenario that the caller steps: its own inputs, snapshots, and new parameters without a new process."""

import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

from numpy.typing import ArrayLike

from flexbeams.controller.design import Design
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.arguments import integer
from flexbeams.scenarios.definition.declaration import by_index, split_owner
from flexbeams.scenarios.definition.reduction import without_parts
from flexbeams.scenarios.definition.scenario_file import ScenarioFile
from flexbeams.scenarios.definition.schema import Value
from flexbeams.scenarios.definition.settings import Settings, StartValues, require_undriven, start_values
from flexbeams.scenarios.definition.values import require_value
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.results.curves import array_name
from flexbeams.scenarios.runs.execution import chosen_stepper, loaded_instances
from flexbeams.scenarios.runs.observer import SILENT, Observer
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario
from flexbeams.scenarios.runs.run_view import RunView
from flexbeams.scenarios.runs.scenario import finished_run, unit_files
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.sensors import measure
from flexbeams.scenarios.simulation.stepwise import Snapshot, Stepwise

SEED = "noise_seed"  # name of the parameter of every unit with noise


class Simulation:
    """A scenario whose units are loaded once and stepped by the caller.

    Attributes
    ----------
    inputs, outputs
        Names of the arrays that may be set, since nothing drives them, and of those that the units compute.
    step_size, stop_time
        Communication step and last time, s.
    """

    def __init__(
        self,
        file: ScenarioFile,
        settings: Settings,
        *,
        without: Sequence[str] = (),
        record: bool = True,
        observer: Observer = SILENT,
        designs: Sequence[Design] = (),
    ) -> None:
        if without:
            file = replace(file, scenario=without_parts(file.scenario, without, str(file.path)))
        settings = replace(settings, open_inputs=True)
        if not record:
            settings = replace(settings, decimate=2**40, record_animation=False)
        self.prepared: PreparedScenario = prepare_scenario(file, settings, observer.notify, designs)
        self._observer, self._recorded = observer, record
        prepared = self.prepared
        with ExitStack() as stack:
            files = unit_files(prepared, observer.notify)
            self._instances = loaded_instances(prepared, files, observer, stack, ExtractionBudget())
            self._stepwise = Stepwise(
                self._instances,
                prepared.wiring,
                prepared.step,
                prepared.scenario.coupling,
                chosen_stepper(self._instances, prepared),
                prepared.start_time,
                prepared.steps,
                settings.decimate,
            )
            stack.callback(self._stepwise.close)
            self._begin(self._stepwise.begin, prepared.starts)
            self._finalizer = weakref.finalize(self, stack.pop_all().close)
        self._index_signals()

    def _index_signals(self) -> None:
        """Views of the arrays by name, and the elements."""
        wiring, signals = self.prepared.wiring, self._stepwise.signals
        inputs = {f"{owner}.{name}": index for owner, pairs in wiring.inputs.items() for name, index in pairs}
        held = {name: index for name, index in inputs.items() if index >= wiring.changing.stop}
        self._elements = {**inputs, **wiring.sources}
        self._held_elements = held
        self._arrays = {name: signals[span] for name, span in _spans(self._elements).items()}
        self._open = {name: signals[span] for name, span in _spans(held).items()}
        self.inputs = tuple(self._open)
        self.outputs = tuple(_spans(wiring.sources))
        self.step_size, self.stop_time = self.prepared.step, self.prepared.scenario.stop_time

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._stepwise.time

    @property
    def steps(self) -> int:
        """Communication steps done."""
        return self._stepwise.done

    def __getitem__(self, name: str) -> Any:
        """A copy of an array (n,), or the value of an element or scalar, in SI units.

        Outputs and inputs cost less than a microsecond; other variables are asked of their unit. Raises InputError for
        an unknown name.
        """
        view = self._arrays.get(name)
        if view is not None:
            return view.copy()
        if name in self._elements:
            return float(self._stepwise.signals[self._elements[name]])
        owner, variable = self._variable(name)
        return self._instances[owner].get(variable)

    def __setitem__(self, name: str, value: ArrayLike) -> None:
        """Sets an open input, which holds until it is set again, or a tunable parameter of a unit.

        Raises InputError for another name or a wrong number of values; a value beyond the unit's bounds is refused by
        the next step.
        """
        view = self._open.get(name)
        if view is None:
            self._set_scalar(name, value)
            return
        try:
            view[:] = value
        except (ValueError, TypeError):
            raise InputError(name, f"must have {len(view)} numbers", value) from None

    def _set_scalar(self, name: str, value: ArrayLike) -> None:
        if name in self._held_elements:
            try:
                self._stepwise.signals[self._held_elements[name]] = float(value)  # type: ignore[arg-type]
            except (ValueError, TypeError):
                raise InputError(name, "must have one number", value) from None
            return
        owner, variable = self._variable(name)
        instance = self._instances[owner]
        declared = instance.variables[variable]
        if declared.variability != "tunable" or declared.causality != "parameter":
            rule = f"is neither an open input ({', '.join(self.inputs) or 'there is none'}) nor a tunable parameter"
            raise InputError(name, rule)
        instance.set_values({variable: require_value(name, declared, value)})

    def _variable(self, name: str) -> tuple[str, str]:
        owner, variable = split_owner(name, self._instances)
        if owner in self._instances and variable in self._instances[owner].variables:
            return owner, variable
        known = [*self._arrays, *(f"{o}.{v}" for o, i in self._instances.items() for v in i.variables)]
        if name in self._arrays:
            raise InputError(name, f"is not open: {', '.join(self.inputs) or 'no inputs'} can be set")
        raise InputError(name, "is not a variable of this simulation" + suggestion(name, known))

    def view(self, name: str) -> Array:
        """The values of an array themselves (n,), which change with every step; those of an open input can be set.

        For loops in which a copy would take too long. Raises InputError for what is neither an input nor an output.
        """
        if name in self._open:
            return self._open[name]
        if name not in self._arrays:
            raise InputError(name, "is not an array of inputs or outputs" + suggestion(name, self._arrays))
        view = self._arrays[name].view()
        view.setflags(write=False)
        return view

    def step(self, count: int = 1, *, until: float | None = None) -> None:
        """Steps once, `count` times, or as often as it takes to reach the time `until`, s.

        Raises InputError beyond the stop time, UnitFailure where a unit fails, UnitEnded where it ends the run.
        """
        if until is not None:
            count = max(0, -(-round((until - self.time) / self.step_size * 1e6) // 1_000_000))
        elif type(count) is not int or count < 0:
            count = integer("step", count, 0)
        self._stepwise.advance(count)

    def snapshot(self) -> Snapshot:
        """The complete state; `bytes()` of it can be restored in any process that simulates the same scenario.

        Raises InputError where a unit cannot save its state.
        """
        return self._stepwise.snapshot()

    def restore(self, snapshot: Snapshot | bytes) -> None:
        """Goes back, or on, to a snapshot; inputs have its values again.

        Rows recorded before it stay where they are its past; else the recording begins at its time. Raises InputError
        for a snapshot of another simulation.
        """
        self._stepwise.restore(snapshot)

    def reset(self, start: Mapping[str, Value] | None = None, *, seed: int | None = None) -> None:
        """Starts anew at time zero, with values in place of those that the simulation was made with.

        `seed` is that of the noise; a second unit with noise gets the next one. Raises InputError for a name or value
        that is not valid, and then changes nothing.
        """
        starts = self.starts(start or {}, seed)
        self._begin(self._stepwise.reset, starts)

    def starts(self, start: Mapping[str, Value], seed: int | None = None) -> dict[str, StartValues]:
        """Start values by instance; InputError as in `reset`."""
        prepared = self.prepared
        if not start and seed is None:
            return prepared.starts
        overrides = {**prepared.settings.overrides, **start}
        require_undriven(start, prepared.wiring.driven())
        starts = start_values(prepared.scenario, prepared.declarations, overrides, prepared.source)
        if seed is not None:
            seed = integer("seed", seed, 0)
            noisy = [name for name, declaration in prepared.declarations.items() if SEED in declaration.variables]
            if not noisy:
                raise InputError("seed", f"needs a unit with the parameter {SEED}", seed)
            for k, name in enumerate(noisy):
                starts[name][SEED] = require_value("seed", prepared.declarations[name].variables[SEED], seed + k)
        return starts

    def _begin(self, begin: Callable[..., None], starts: Mapping[str, StartValues]) -> None:
        try:
            begin(starts, self.prepared.scenario.stop_time, self._observer.notify)
        except UnitFailure as failure:
            raise InputError("", str(failure), source=self.prepared.source) from None

    def result(self) -> RunView:
        """What is recorded so far as a finished run, with the checks whose windows it covers."""
        if self.steps == 0:
            raise InputError("time", "must be > 0 for a result", 0.0)
        prepared, recording = self.prepared, self._stepwise.recording()
        if self._recorded:
            measure(recording, prepared.scenario.sensor, prepared.step * prepared.settings.decimate)
        return RunView.of(finished_run(prepared, recording, self._observer))

    def close(self) -> None:
        """Ends the units and removes their files; arrays, time and result stay, all else raises InputError."""
        self._finalizer()
        self._instances = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _spans(elements: Mapping[str, int]) -> dict[str, slice]:
    """The arrays of elements that follow one another, in the order of their indices."""
    arrays: dict[str, list[str]] = {}
    for name in elements:
        arrays.setdefault(array_name(name), []).append(name)
    spans = {}
    for array, names in arrays.items():
        indices = [elements[name] for name in by_index(names)]
        if indices == list(range(indices[0], indices[0] + len(indices))):
            spans[array] = slice(indices[0], indices[0] + len(indices))
    return spans
