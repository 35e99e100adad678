"""One run from a scenario to its files: design, units, co-simulation, checks, figures."""

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import read_model_description

from controller.design import Design, DesignOptions, compute_design
from fmus.build import Backend, ensure_units
from plant.basis import Array
from plant.errors import InputError, suggestion
from plant.galerkin import BasisName, BeamModel
from plant.structure import Structure, find_structure, read_structure
from scenarios.cosimulation import CoSimulation, Plan, Planner, Recording
from scenarios.formats import Format
from scenarios.frames import plan_frames
from scenarios.instance import UnitInstance, element_names
from scenarios.metrics import Measurement, Outcome, standard_metrics
from scenarios.results import write_results
from scenarios.schema import Coupling, Scenario, Value, find_scenario, first_comment, read_scenario
from scenarios.signals import require_sampled
from scenarios.stepping import NativeStepper, Stepper, Wiring, stepper_library

BUILD_FOLDER = Path("build/fmus")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the command line changes of a scenario; None keeps what the scenario says."""

    backend: Backend = "native"
    compiler: str = "zig"
    speed: float | None = None       # simulated seconds a second of the wall clock; None: as fast as it goes
    coupling: Coupling | None = None
    basis: BasisName | None = None
    structure: str | None = None
    stop_time: float | None = None
    values: dict[str, Value] = field(default_factory=dict)   # <instance>.<variable>, or array, to value
    decimate: int = 1                # every which step is recorded
    build_folder: Path = BUILD_FOLDER
    frames: bool = True              # shapes for the animation are recorded


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run."""

    name: str
    scenario: Scenario
    design: Design
    recording: Recording
    open_loop: Recording | None      # of the scenario that this one is compared with
    outcomes: list[Outcome]
    summary: dict[str, Any]
    settings: Settings
    about: str                       # what the scenario shows, its first comment

    @property
    def passed(self) -> bool:
        """Complete, with every check held."""
        return self.recording.complete and all(o.passed for o in self.outcomes)


def run_scenario(name: str, settings: Settings, *, report: Callable[[str], None] = lambda text: None,
                 progress: Callable[[int, int], None] = lambda done, steps: None,
                 designs: Sequence[Design] = ()) -> Run:
    """Runs a shipped scenario or a file; raises FlexbeamsError where it cannot start.

    `report` gets notes in one line each; `progress` gets steps done and steps in all. `designs` are finished ones
    to take where they fit.
    """
    path = find_scenario(name)
    scenario, design = prepare(path, settings, designs)
    open_loop = None
    if scenario.open_loop is not None:
        report(f"running {scenario.open_loop} to compare with")
        others = {key: value for key, value in settings.values.items() if key.startswith("plant.")}
        open_loop = run_scenario(scenario.open_loop, replace(settings, values=others, frames=False, speed=None),
                                 report=report, progress=progress, designs=[design]).recording
        if open_loop.interrupted:
            raise KeyboardInterrupt
        if open_loop.failure is not None:
            raise open_loop.failure
    recording = co_simulate(path, scenario, design, settings, report, progress)
    outcomes = Measurement(scenario, str(path), recording, open_loop).outcomes() if recording.complete else []
    return Run(name=path.stem, scenario=scenario, design=design, recording=recording, open_loop=open_loop,
               outcomes=outcomes, summary=_summary(path.stem, scenario, design, settings, recording, outcomes),
               settings=settings, about=first_comment(path))


def prepare(path: Path, settings: Settings, designs: Sequence[Design] = ()) -> tuple[Scenario, Design]:
    """The scenario with the settings applied, and its design; targets out of reach are refused here."""
    scenario = read_scenario(path)
    if settings.coupling:
        scenario = replace(scenario, coupling=settings.coupling)
    if settings.stop_time:
        scenario = replace(scenario, stop_time=settings.stop_time)
    if settings.basis:
        scenario = replace(scenario, design=_on_basis(scenario.design, settings.basis))
    source = str(path)
    try:
        structure_path = find_structure(settings.structure or scenario.structure, path.parent)
    except InputError as error:
        raise error.at("--structure" if settings.structure else source) from None
    structure = read_structure(structure_path)
    fitting = (d for d in designs if d.structure == structure and d.options == scenario.design)
    design = next(fitting, None) or compute_design(structure, scenario.design)
    _check_targets(scenario, structure, design, source)
    return scenario, design


def _on_basis(options: DesignOptions, basis: BasisName) -> DesignOptions:
    """The options on another basis; order and norm then take that basis's defaults."""
    return options if options.basis == basis else replace(options, basis=basis, order=None, output_weight=None)


def _check_targets(scenario: Scenario, structure: Structure, design: Design, source: str) -> None:
    """InputError for a target that the voltage limit does not allow at rest."""
    inverse = design.arrays["static_inverse"]
    for k, signal in enumerate(scenario.input, 1):
        owner, _, variable = signal.to.partition(".")
        instance = scenario.instance.get(owner)
        if instance is None or instance.unit != "FlatnessFeedforward" or variable != "y_target":
            continue
        limit = float(np.max(np.atleast_1d(instance.start.get("voltage_limit", design.options.voltage_limit))))
        for t, target in enumerate(signal.targets or [], 1):
            if len(target.value) != inverse.shape[1]:
                raise InputError(f"input[{k}].targets[{t}].value", f"must have {inverse.shape[1]} values, one for each "
                                 "point of interest", target.value, source=source)
            voltage = inverse @ np.array(target.value)
            if (peak := float(np.max(np.abs(voltage)))) > limit:
                raise InputError(f"input[{k}].targets[{t}].value", f"is out of reach: patch pair "
                                 f"{int(np.argmax(np.abs(voltage))) + 1} would need {peak:.1f} V at rest, the limit is "
                                 f"{limit:g} V", target.value, source=source)


def co_simulate(path: Path, scenario: Scenario, design: Design, settings: Settings, report: Callable[[str], None],
                progress: Callable[[int, int], None]) -> Recording:
    """Builds what is missing, wires the instances and steps them."""
    step = scenario.step or design.options.sample_time
    steps = round(scenario.stop_time / step)
    if steps < 1 or abs(steps * step - scenario.stop_time) > 1e-6 * step:
        raise InputError("stop_time", f"must be a whole number of steps of {step:g} s", scenario.stop_time,
                         source="--stop-time" if settings.stop_time else str(path))
    for k, drive in enumerate(scenario.input, 1):
        try:
            require_sampled(drive, step)
        except InputError as error:
            raise error.at(str(path), f"input[{k}].") from None
    files = unit_files(path, scenario, design, settings, report)
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as folder:
        instances: dict[str, UnitInstance] = {}
        try:
            for name, file in files.items():
                unzipped = fmpy.extract(str(file), unzipdir=str(Path(folder) / name))
                description = read_model_description(unzipped, validate=False)
                if description.coSimulation is None or description.fmiVersion != "2.0":
                    raise InputError(f"instance.{name}.fmu", "must be an FMI 2.0 co-simulation unit", str(file),
                                     source=str(path))
                instances[name] = UnitInstance(name, Path(unzipped), description, report)
            _require_one_design(instances, str(path))
            starts = start_values(scenario, instances, settings, str(path))
            plan = Planner(scenario, instances, str(path), starts).plan()
            _require_open(plan, settings)
            if settings.frames:
                plan.frames = plan_frames(instances, plan.sources, plan.inputs)
            for name, values in starts.items():
                for variable, value in values.items():
                    instances[name].set_start(variable, value)
            simulation = CoSimulation(instances, plan, step, scenario.coupling, _stepper(instances, settings, steps))
            simulation.initialise(scenario.stop_time)
            return simulation.run(steps, lambda done: progress(done, steps), settings.decimate)
        finally:
            for instance in instances.values():
                instance.close()


def _stepper(instances: Mapping[str, UnitInstance], settings: Settings,
             steps: int) -> Callable[[Mapping[str, UnitInstance], Wiring], Stepper] | None:
    """The loop in C where every unit is C; None stands for the one in Python."""
    if any(i.description.coSimulation.needsExecutionTool for i in instances.values()):
        if settings.speed is not None:
            raise InputError("--real-time", "needs native units")
        return None
    library = stepper_library(settings.build_folder, settings.compiler)
    pace = None if settings.speed is None else 1 / settings.speed
    return lambda connected, wiring: NativeStepper(connected, wiring, library, pace, steps)


def unit_files(path: Path, scenario: Scenario, design: Design, settings: Settings,
               report: Callable[[str], None]) -> dict[str, Path]:
    """The FMU of every instance, in the order of the scenario; missing ones are built."""
    given: dict[str, Path] = {}
    wanted: dict[str, tuple[str, BeamModel]] = {}
    for name, instance in scenario.instance.items():
        if instance.unit is None:
            given[name] = path.parent / str(instance.fmu)
            if not given[name].is_file():
                raise InputError(f"instance.{name}.fmu", "must be a file", str(given[name]), source=str(path))
            continue
        try:
            wanted[name] = instance.unit, design.model(None if settings.basis else instance.basis, instance.order)
        except ValueError as error:
            raise InputError(f"instance.{name}", str(error), source=str(path)) from None
    built = ensure_units(wanted, design, settings.build_folder, report, backend=settings.backend,
                         compiler=settings.compiler)
    return {name: given.get(name) or built[name] for name in scenario.instance}


def _require_one_design(instances: dict[str, UnitInstance], source: str) -> None:
    designs = {name: str(i.get("design_id")) for name, i in instances.items() if "design_id" in i.variables}
    if len(set(designs.values())) > 1:
        listed = ", ".join(f"{name} has {value[:12]}" for name, value in designs.items())
        raise InputError("instance", f"units must be of one design (design_id): {listed}; build them together",
                         source=source)


def start_values(scenario: Scenario, instances: dict[str, UnitInstance], settings: Settings,
                 source: str) -> dict[str, dict[str, float | bool]]:
    """Start values of each instance: its scale factors, then its start table, then --set."""
    values: dict[str, dict[str, float | bool]] = {name: {} for name in instances}
    for name, instance in scenario.instance.items():
        variables = instances[name].variables
        for key, factor in instance.scale.items():
            where = f"instance.{name}.scale.{key}"
            for variable, f in _spread(where, key, factor, variables, source):
                values[name][variable] = float(variables[variable].start) * float(f)
        for key, value in instance.start.items():
            values[name] |= dict(_spread(f"instance.{name}.start.{key}", key, value, variables, source))
    for key, value in settings.values.items():
        owner, _, variable = key.partition(".")
        if owner not in instances:
            raise InputError("--set", f"names an unknown instance {owner!r}" + suggestion(owner, instances), key)
        values[owner] |= dict(_spread("--set", variable, value, instances[owner].variables, ""))
    return values


def _require_open(plan: Plan, settings: Settings) -> None:
    """InputError for a --set of an input that a connection or a signal drives: it would never be seen."""
    external = {place for span, signal in plan.external if isinstance(signal, float)
                for place in range(span.start, span.stop)}
    for key in settings.values:
        owner, _, variable = key.removesuffix("[]").partition(".")
        driven = [n for n, place in plan.inputs[owner] if place not in external]
        if any(n == variable or n.startswith(f"{variable}[") for n in driven):
            raise InputError("--set", "must not set an input that the scenario drives", key)


def _spread(where: str, key: str, value: Any, variables: dict[str, Any], source: str) -> list[tuple[str, Any]]:
    """A value for a scalar, an array (name) or all numbers of a family (name with []), as pairs by scalar."""
    if "[]" in key:
        head, tail = key.split("[]", 1)
        names = [n for n in variables if n.startswith(f"{head}[") and n.endswith(f"]{tail}")]
    else:
        names = element_names(variables, key)
    settable = [n for n in names if variables[n].causality in ("parameter", "input")]
    if not settable:
        known = [re.sub(r"\[[0-9,]+\]$", "", re.sub(r"\[[0-9,]+\]\.", "[].", n)) for n, v in variables.items()
                 if v.causality in ("parameter", "input")]   # arrays and families, not each of their numbers
        rule = "is not settable" if names else "is not a variable" + suggestion(key, known)
        raise InputError(where, rule, key, source=source)
    listed = value if isinstance(value, list) else [value] * len(settable)
    if len(listed) != len(settable):
        raise InputError(where, f"must have {len(settable)} values", value, source=source)
    for name, v in zip(settable, listed, strict=True):
        kind, low, high = variables[name].type, variables[name].min, variables[name].max
        if isinstance(v, bool) != (kind == "Boolean") or (kind == "Integer" and v != int(v)):
            raise InputError(where, f"must be of type {kind}", v, source=source)
        if (low is not None and v < float(low)) or (high is not None and v > float(high)):
            raise InputError(where, f"must be from {low or '-inf'} to {high or 'inf'}", v, source=source)
    return list(zip(settable, listed, strict=True))


def _summary(name: str, scenario: Scenario, design: Design, settings: Settings, recording: Recording,
             outcomes: list[Outcome]) -> dict[str, Any]:
    simulated = float(recording.time[-1])
    summary: dict[str, Any] = {
        "scenario": name, "title": scenario.title, "design_id": design.design_id, "coupling": scenario.coupling,
        "backend": settings.backend, "complete": recording.complete,
        "decimate": recording.decimate, "set": settings.values,
        "checks": [o.record() for o in outcomes],
        "metrics": {**{o.name: o.value for o in outcomes}, **standard_metrics(recording)},
        "timing": {"steps": recording.steps, "wall_s": recording.wall,
                   "real_time_factor": simulated / recording.wall if recording.wall else None},
    }
    if recording.lateness is not None and settings.speed is not None and recording.steps > 1:
        period = simulated / recording.steps / settings.speed
        summary["timing"]["lateness"] = lateness_figures(recording.lateness, period)
    if recording.failure is not None:
        summary["error"] = str(recording.failure)
    return summary


def lateness_figures(lateness: Array, period: float) -> dict[str, float]:
    """How a paced run kept to the clock: seconds late at the start of a step, and steps late by more than `period` (s).

    `rate_error` is how much longer than asked the run took from its first step to its last, relative.
    """
    quantiles = np.quantile(lateness, [0.5, 0.99, 0.9999])
    return {"median": float(quantiles[0]), "p99": float(quantiles[1]), "p99.99": float(quantiles[2]),
            "max": float(lateness.max()), "overruns": int(np.count_nonzero(lateness > period)),
            "rate_error": float(lateness[-1] - lateness[0]) / (period * (len(lateness) - 1))}


def write_run(run: Run, folder: Path, figures: bool = True, report: bool = True,
              formats: Sequence[Format] = ("csv",)) -> None:
    """results.csv (or other formats), summary.json, the scenario's figures and report.html.

    A report, or results in other formats, of an earlier run go.
    """
    (folder / "report.html").unlink(missing_ok=True)
    write_results(folder, run.recording, run.summary, formats)
    if figures and run.recording.complete:
        from scenarios.figures import draw_figures

        draw_figures(run.scenario, run.recording, folder, run.open_loop)
    if report and run.recording.complete:
        from scenarios.report import write_report

        write_report(run, folder)


