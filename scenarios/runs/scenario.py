"""Runs of scenarios: design, units, co-simulation, checks."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.packaging.kept_units import ensure_units
from flexbeams.scenarios.definition.scenario_file import ScenarioFile, load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.variants import changed_settings
from flexbeams.scenarios.results.checks import Measurement
from flexbeams.scenarios.results.run import Run, run_summary
from flexbeams.scenarios.runs.execution import execute
from flexbeams.scenarios.runs.observer import SILENT, Observer, no_path
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario
from flexbeams.scenarios.runs.requirements import reachable_checks
from flexbeams.scenarios.simulation.recording import Recording


def run_scenario(
    scenario: str | Path | ScenarioFile,
    settings: Settings,
    observer: Observer = SILENT,
    designs: Sequence[Design] = (),
) -> Run:
    """Runs a scenario given as a shipped name, as a file, or as loaded; finished `designs` are used where they fit.

    Raises FlexbeamsError where the run cannot start.
    """
    file = scenario if isinstance(scenario, ScenarioFile) else load_scenario(scenario)
    return run_prepared(prepare_scenario(file, settings, observer.notify, designs), observer)


def run_prepared(prepared: PreparedScenario, observer: Observer = SILENT) -> Run:
    """Runs a prepared scenario, after the open loop that it is compared with."""
    open_loop = None if prepared.open_loop is None else _run_open_loop(prepared.open_loop, observer)
    recording = execute(prepared, unit_files(prepared, observer.notify), observer)
    return _finished(prepared, recording, open_loop, observer)


def finished_run(prepared: PreparedScenario, recording: Recording, observer: Observer = SILENT) -> Run:
    """The run of a prepared scenario that was recorded elsewhere, with the checks that the recording reaches.

    The open loop that it is compared with runs now.
    """
    open_loop = None if prepared.open_loop is None else _run_open_loop(prepared.open_loop, observer)
    return _finished(prepared, recording, open_loop, observer)


def _finished(prepared: PreparedScenario, recording: Recording, open_loop: Recording | None, observer: Observer) -> Run:
    scenario, design, name = prepared.scenario, prepared.design, prepared.file.name
    begin, end = float(recording.time[0]), float(recording.time[-1])
    if end < scenario.stop_time:
        shorter = replace(scenario, stop_time=end), replace(prepared.settings, stop_time=end)
        scenario = reachable_checks(*shorter, prepared.source, observer.notify)
    if begin > prepared.start_time:
        scenario = replace(scenario, check=[check for check in scenario.check if check.after >= begin])
    changed = changed_settings(prepared.settings, prepared.file.scenario)
    outcomes = Measurement(scenario, prepared.source, recording, open_loop).outcomes() if recording.complete else []
    return Run(
        name=name,
        description=prepared.file.description,
        scenario=scenario,
        settings=prepared.settings,
        design=design,
        recording=recording,
        open_loop=open_loop,
        outcomes=outcomes,
        summary=run_summary(
            name,
            scenario,
            design.design_id,
            prepared.settings,
            recording,
            outcomes,
            step=prepared.step,
            changed=changed,
            declarations=prepared.declarations,
        ),
    )


def unit_files(prepared: PreparedScenario, notify: Callable[[str], None]) -> dict[str, Path]:
    """The FMU of every instance, in the order of the scenario; missing ones are built."""
    instances, settings = prepared.scenario.instance, prepared.settings
    built = ensure_units(
        {name: (kind, prepared.models[name]) for name, kind in prepared.kinds.items()},
        prepared.design,
        settings.build_folder,
        notify,
        backend=settings.backend,
        compiler=settings.compiler,
    )
    return {name: built[name] if name in built else prepared.provided_fmu(name) for name in instances}


def _run_open_loop(prepared: PreparedScenario, observer: Observer) -> Recording:
    """The run to compare with; KeyboardInterrupt or UnitFailure where it is not complete."""
    observer.notify(f"running {prepared.file.name} to compare with")
    own = replace(observer, row_path=no_path)
    recording = execute(prepared, unit_files(prepared, observer.notify), own)
    if recording.interrupted:
        raise KeyboardInterrupt
    if recording.failure is not None:
        raise recording.failure
    return recording
