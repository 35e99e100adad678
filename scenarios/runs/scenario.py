"""One run from a scenario to its files: design, units, co-simulation, checks, figures."""

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import read_model_description

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.build import ensure_units
from flexbeams.fmus.units.catalogue import require_kind
from flexbeams.plant.archive import remove_file
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import BasisName, BeamModel
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.scenarios.definition.schema import Scenario, find_scenario, first_comment, read_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.report.figure_plots import figure_plots
from flexbeams.scenarios.report.figure_process import FigureProcess
from flexbeams.scenarios.results.checks import Measurement, Outcome, standard_metrics
from flexbeams.scenarios.results.files import write_results
from flexbeams.scenarios.results.formats import Format
from flexbeams.scenarios.runs.prepare import PreparedRun, prepare_run, require_figures, unit_models, with_open_loop
from flexbeams.scenarios.simulation.cosimulation import CoSimulation
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.frames import frame_layout
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.stepping import NativeStepper, SignalBus, Stepper, stepper_library

_LOADED = ("modelDescription.xml", "binaries/", "resources/")  # what of an FMU a run needs


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run."""

    name: str
    scenario: Scenario
    design: Design
    recording: Recording
    open_loop: Recording | None  # of the scenario that this one is compared with
    outcomes: list[Outcome]
    summary: dict[str, Any]
    settings: Settings
    about: str  # what the scenario shows, its first comment

    @property
    def passed(self) -> bool:
        """Complete, with every check held."""
        return self.recording.complete and all(o.passed for o in self.outcomes)


def run_scenario(
    name: str,
    settings: Settings,
    *,
    notify: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, steps: None,
    designs: Sequence[Design] = (),
) -> Run:
    """Runs a shipped scenario or a file; raises FlexbeamsError where it cannot start.

    `notify` gets notes in one line each; `progress` gets steps done and steps in all. `designs` are finished ones
    to take where they fit.
    """
    path = find_scenario(name)
    scenario, design = prepare(path, settings, designs)
    for warning in design.summary["warnings"]:
        notify(f"design: {warning}")
    scenario, draft = prepare_run(path, scenario, design, settings, notify)
    open_loop = None
    if scenario.open_loop is not None:
        notify(f"running {Path(scenario.open_loop).stem} to compare with")
        others = {key: value for key, value in settings.overrides.items() if key.startswith("plant.")}
        open_loop = run_scenario(
            scenario.open_loop,
            replace(settings, overrides=others, record_animation=False, real_time_factor=None),
            notify=notify,
            progress=progress,
            designs=[design],
        ).recording
        if open_loop.interrupted:
            raise KeyboardInterrupt
        if open_loop.failure is not None:
            raise open_loop.failure
        require_figures(scenario, draft.wiring.columns, open_loop.columns, str(path))
    recording = co_simulate(path, scenario, design, settings, draft, notify, progress)
    outcomes = Measurement(scenario, str(path), recording, open_loop).outcomes() if recording.complete else []
    summary = run_summary(path.stem, scenario, design.design_id, settings, recording, outcomes)
    return Run(
        name=path.stem,
        scenario=scenario,
        design=design,
        recording=recording,
        open_loop=open_loop,
        outcomes=outcomes,
        summary=summary,
        settings=settings,
        about=first_comment(path),
    )


def prepare(path: Path, settings: Settings, designs: Sequence[Design] = ()) -> tuple[Scenario, Design]:
    """The scenario with the settings applied, and its design; targets out of reach are refused here."""
    scenario = with_open_loop(read_scenario(path), path)
    if settings.coupling:
        scenario = replace(scenario, coupling=settings.coupling)
    if settings.stop_time:
        if not math.isfinite(settings.stop_time):
            raise InputError("", "must be finite and > 0", settings.stop_time, source="--stop-time")
        scenario = replace(scenario, stop_time=settings.stop_time)
    if settings.step:
        scenario = replace(scenario, step=settings.step)
    if settings.basis:
        scenario = replace(scenario, design=_on_basis(scenario.design, settings.basis))
    source = str(path)
    scenario = replace(scenario, design=scenario.design.relative_to(path.parent))
    try:
        structure_path = find_structure(settings.structure or scenario.structure, path.parent)
    except InputError as error:
        raise error.at("--structure" if settings.structure else source) from None
    structure = read_structure(structure_path)
    fitting = (d for d in designs if d.structure == structure and d.options == scenario.design)
    try:
        design = next(fitting, None) or compute_design(structure, scenario.design)
    except DesignError as error:
        raise DesignError(f"{source}: design of {structure_path}: {error}") from None
    _check_targets(scenario, design, settings, source)
    return scenario, design


def _on_basis(options: DesignOptions, basis: BasisName) -> DesignOptions:
    """The options on another basis; order and norm then take that basis's defaults."""
    return options if options.basis == basis else replace(options, basis=basis, order=None, output_weight=None)


def _check_targets(scenario: Scenario, design: Design, settings: Settings, source: str) -> None:
    """InputError for a target that the voltage limit does not allow at rest."""
    inverse = design.arrays["static_inverse"]
    for k, signal in enumerate(scenario.input, 1):
        owner, _, variable = signal.to.partition(".")
        instance = scenario.instance.get(owner)
        if instance is None or instance.unit != "FlatnessFeedforward" or variable != "y_target":
            continue
        limit = settings.overrides.get(f"{owner}.voltage_limit", instance.start.get("voltage_limit"))
        if isinstance(limit, bool) or not isinstance(limit, (int, float)):
            limit = design.options.voltage_limit  # a value of another type is refused where start values are
        for t, target in enumerate(signal.targets or [], 1):
            if len(target.value) != inverse.shape[1]:
                raise InputError(
                    f"input[{k}].targets[{t}].value",
                    f"must have {inverse.shape[1]} values, one for each point of interest",
                    target.value,
                    source=source,
                )
            voltage = inverse @ np.array(target.value)
            if (peak := float(np.max(np.abs(voltage)))) > limit:
                raise InputError(
                    f"input[{k}].targets[{t}].value",
                    f"is out of reach: patch pair "
                    f"{int(np.argmax(np.abs(voltage))) + 1} would need {peak:.1f} V at rest, the limit is "
                    f"{limit:g} V",
                    target.value,
                    source=source,
                )


def co_simulate(
    path: Path,
    scenario: Scenario,
    design: Design,
    settings: Settings,
    draft: PreparedRun,
    notify: Callable[[str], None],
    progress: Callable[[int, int], None],
) -> Recording:
    """Builds what is missing, wires the instances and steps them."""
    files = unit_files(path, scenario, design, settings, notify, draft.models)
    return step_units(files, draft, scenario, settings, str(path), notify, progress)


def step_units(
    files: Mapping[str, Path],
    draft: PreparedRun,
    scenario: Scenario,
    settings: Settings,
    source: str,
    notify: Callable[[str], None],
    progress: Callable[[int, int], None],
    budget: ExtractionBudget | None = None,
) -> Recording:
    """Loads the units of the instances and steps them by the wiring; `budget` bounds what is extracted in all."""
    wiring, steps = draft.wiring, draft.steps
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as folder:
        instances: dict[str, UnitInstance] = {}
        try:
            for name, file in files.items():
                instances[name] = _instance(
                    name, file, Path(folder) / name, source, notify, budget or ExtractionBudget()
                )
            if settings.record_animation:
                wiring.frames = frame_layout(instances, wiring.sources, wiring.inputs)
            simulation = CoSimulation(
                instances, wiring, draft.step, scenario.coupling, _stepper(instances, settings, steps)
            )
            try:
                for name, values in draft.starts.items():
                    for variable, value in values.items():
                        instances[name].set_start(variable, value)
                simulation.initialise(scenario.stop_time)
            except UnitFailure as failure:
                raise InputError("", str(failure), source=source) from None
            return simulation.run(steps, lambda done: progress(done, steps), settings.decimate)
        finally:
            for instance in instances.values():
                instance.close()


def _instance(
    name: str, file: Path, folder: Path, source: str, notify: Callable[[str], None], budget: ExtractionBudget
) -> UnitInstance:
    """An instance of an FMU's file, extracted to a folder."""
    try:
        budget.extract(file, folder, _LOADED)
        return UnitInstance(name, folder, read_model_description(str(folder), validate=False), notify)
    except Exception as error:
        reason = " ".join((str(error).strip() or type(error).__name__).splitlines())
        raise InputError(f"instance.{name}", f"cannot be loaded from {file}: {reason}", source=source) from None


def _stepper(
    instances: Mapping[str, UnitInstance], settings: Settings, steps: int
) -> Callable[[Mapping[str, UnitInstance], SignalBus], Stepper] | None:
    """The loop in C where every unit is C; None stands for the one in Python."""
    if any(i.description.coSimulation.needsExecutionTool for i in instances.values()):
        if settings.real_time_factor is not None:
            raise InputError("--real-time", "needs native units")
        return None
    library = stepper_library(settings.build_folder, settings.compiler)
    pace = None if settings.real_time_factor is None else 1 / settings.real_time_factor
    return lambda connected, wiring: NativeStepper(connected, wiring, library, pace, steps)


def unit_files(
    path: Path,
    scenario: Scenario,
    design: Design,
    settings: Settings,
    notify: Callable[[str], None],
    models: Mapping[str, BeamModel] | None = None,
) -> dict[str, Path]:
    """The FMU of every instance, in the order of the scenario; missing ones are built, with `models` where given."""
    models = models or unit_models(path, scenario, design, settings)
    wanted = {
        name: (require_kind(str(scenario.instance[name].unit), f"instance.{name}.unit"), model)
        for name, model in models.items()
    }
    built = ensure_units(
        wanted, design, settings.build_folder, notify, backend=settings.backend, compiler=settings.compiler
    )
    return {
        name: built[name] if name in built else path.parent / str(instance.fmu)
        for name, instance in scenario.instance.items()
    }


def run_summary(
    name: str, scenario: Scenario, design_id: str, settings: Settings, recording: Recording, outcomes: list[Outcome]
) -> dict[str, Any]:
    """What summary.json holds; design_id is empty where the units are of no design."""
    simulated = float(recording.time[-1])
    summary: dict[str, Any] = {
        "scenario": name,
        "title": scenario.title,
        "design_id": design_id,
        "coupling": scenario.coupling,
        "backend": settings.backend,
        "complete": recording.complete,
        "decimate": recording.decimate,
        "set": settings.overrides,
        "checks": [o.record() for o in outcomes],
        "metrics": {**{o.name: o.value for o in outcomes}, **standard_metrics(recording)},
        "timing": {
            "steps": recording.steps,
            "wall_s": recording.wall_seconds,
            "real_time_factor": simulated / recording.wall_seconds if recording.wall_seconds else None,
        },
    }
    if recording.lateness is not None and settings.real_time_factor is not None and recording.steps > 1:
        period = simulated / recording.steps / settings.real_time_factor
        summary["timing"]["lateness"] = lateness_figures(recording.lateness, period)
    if recording.failure is not None:
        summary["error"] = str(recording.failure)
    return summary


def lateness_figures(lateness: Array, period: float) -> dict[str, float]:
    """How a paced run kept to the clock: seconds late at the start of a step, and steps late by more than `period` (s).

    `rate_error` is how much longer than asked the run took from its first step to its last, relative.
    """
    quantiles = np.quantile(lateness, [0.5, 0.99, 0.9999])
    return {
        "median": float(quantiles[0]),
        "p99": float(quantiles[1]),
        "p99.99": float(quantiles[2]),
        "max": float(lateness.max()),
        "overruns": int(np.count_nonzero(lateness > period)),
        "rate_error": float(lateness[-1] - lateness[0]) / (period * (len(lateness) - 1)),
    }


def write_run(
    run: Run,
    folder: Path,
    figures: bool = True,
    report: bool = True,
    formats: Sequence[Format] = ("csv",),
    beside: FigureProcess | None = None,
) -> None:
    """results.csv (or other formats), summary.json, the scenario's figures and report.html.

    A report, figures, or results in other formats, of an earlier run go. Figures are drawn `beside` where given.
    """
    drawn = [f"{figure.file}.{kind}" for figure in run.scenario.figure for kind in ("png", "svg")]
    for name in ("report.html", *drawn):
        remove_file(folder / name)
    plots = (
        figure_plots(run.scenario, run.recording, folder, run.open_loop) if figures and run.recording.complete else []
    )
    if plots and beside:
        beside.start(plots)
    write_results(folder, run.recording, run.summary, formats)
    if report and run.recording.complete:
        from flexbeams.scenarios.report.report import write_report

        write_report(run, folder)
    if plots and beside:
        beside.wait()
    elif plots:
        from flexbeams.scenarios.report.figures import write_figures

        write_figures(plots)
