"""Execution of a prepared run: loads its units and steps them."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from fmpy import read_model_description

from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.runs.observer import Observer
from flexbeams.scenarios.runs.prepare import PreparedRun
from flexbeams.scenarios.runs.room import MAX_BYTES_IN_MEMORY
from flexbeams.scenarios.simulation.cosimulation import CoSimulation
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.native_stepper import NativeStepper, stepper_library
from flexbeams.scenarios.simulation.rates import hold
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.row_file import RowFile
from flexbeams.scenarios.simulation.sensors import measure
from flexbeams.scenarios.simulation.stepping import SignalBus, Stepper

LOADED_PARTS = ("modelDescription.xml", "binaries/", "resources/")  # of an FMU, that a run needs


def execute(
    prepared: PreparedRun, files: Mapping[str, Path], observer: Observer, budget: ExtractionBudget | None = None
) -> Recording:
    """Loads the FMU of each instance and steps them; `budget` limits what is extracted in all.

    Each instance has an extracted copy of its own: third-party units may keep state in global variables. Raises
    InputError for units that cannot be loaded or initialised; the failure of a later call is part of the recording.
    """
    with ExitStack() as stack:
        instances = loaded_instances(prepared, files, observer, stack, budget or ExtractionBudget())
        simulation = CoSimulation(
            instances,
            prepared.wiring,
            prepared.step,
            prepared.scenario.coupling,
            chosen_stepper(instances, prepared),
            prepared.start_time,
        )
        try:
            simulation.initialise(prepared.starts, prepared.scenario.stop_time, observer.notify)
        except UnitFailure as failure:
            raise InputError("", str(failure), source=prepared.source) from None
        recording = simulation.run(
            prepared.steps,
            lambda done: observer.progress(done, prepared.steps),
            prepared.settings.decimate,
            _row_file(prepared, observer),
        )
    measure(recording, prepared.scenario.sensor, prepared.step * prepared.settings.decimate)
    hold(recording, prepared.settings.record_every)
    recording.units = {column: prepared.unit_of(column) for column in recording.columns}
    recording.units_row = prepared.settings.units_row
    if recording.ended:
        observer.notify(recording.ended)
    return recording


def loaded_instances(
    prepared: PreparedRun,
    files: Mapping[str, Path],
    observer: Observer,
    stack: ExitStack,
    budget: ExtractionBudget,
    library: Path | None = None,
) -> dict[str, UnitInstance]:
    """An instance of each FMU; `stack` closes them and removes their folder.

    `library` is the stepping loop of native units, by default that of the cache. Raises InputError for units that
    cannot be loaded.
    """
    folder, settings = stack.enter_context(temporary_folder()), prepared.settings
    if library is None and settings.backend == "native":
        library = stepper_library(settings.build_folder, settings.compiler)
    instances: dict[str, UnitInstance] = {}
    for k, (name, file) in enumerate(files.items()):  # numbered folders: a package may have any names
        instances[name] = _loaded(name, file, folder / f"unit{k}", prepared, observer, budget, library)
        stack.callback(instances[name].close)
    return instances


def _row_file(prepared: PreparedRun, observer: Observer) -> RowFile | None:
    """The file of a long recording; None for one that is kept in memory."""
    if prepared.recorded_bytes <= MAX_BYTES_IN_MEMORY:
        return None
    return RowFile(prepared.wiring.columns, observer.row_path())


def _loaded(
    name: str,
    file: Path,
    folder: Path,
    prepared: PreparedRun,
    observer: Observer,
    budget: ExtractionBudget,
    library: Path | None,
) -> UnitInstance:
    """An instance of an FMU, extracted to a folder."""
    try:
        budget.extract(file, folder, LOADED_PARTS)
        description = prepared.declarations[name].description or _description(folder)
        return UnitInstance(name, folder, description, observer.notify, library)
    except (InputError, UnitFailure) as error:
        rule = f"cannot be loaded from {file}: {error}"
        raise InputError(f"instance.{name}", rule, source=prepared.source) from None


def _description(folder: Path) -> Any:
    """FMPy's description of an extracted FMU."""
    try:
        return read_model_description(str(folder), validate=False)
    except Exception as error:  # FMPy raises various errors on a damaged description
        raise InputError("", " ".join(str(error).split()) or type(error).__name__) from None


def chosen_stepper(
    instances: Mapping[str, UnitInstance], prepared: PreparedRun, library: Path | None = None
) -> Callable[[Mapping[str, UnitInstance], SignalBus], Stepper] | None:
    """The loop in C where all units are native; None for the loop in Python."""
    settings = prepared.settings
    if any(i.description.coSimulation.needsExecutionTool for i in instances.values()):
        if settings.real_time_factor is not None:
            raise InputError("--real-time", "needs native units")
        return None
    library = library or stepper_library(settings.build_folder, settings.compiler)
    pace = None if settings.real_time_factor is None else 1 / settings.real_time_factor
    return lambda connected, bus: NativeStepper(connected, bus, library, pace, prepared.steps)
