"""A run of an SSP: the same loop as a scenario's, with the units and connections of the package."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.declaration import InstanceDeclaration
from flexbeams.scenarios.definition.schema import Connection, Instance, Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.package import Package
from flexbeams.scenarios.importing.ssp import open_package
from flexbeams.scenarios.runs.prepare import PreparedRun, require_one_design, require_room, whole_steps
from flexbeams.scenarios.runs.scenario import run_summary, step_units
from flexbeams.scenarios.runs.start_values import require_open, start_values
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.wiring import WiringBuilder
from flexbeams.scenarios.validation.package import start_table, structure_problems, unit_descriptions


@dataclass(frozen=True, kw_only=True)
class PackageRun:
    """A finished run of a package."""

    title: str
    recording: Recording
    summary: dict[str, Any]


def run_package(
    file: Path,
    settings: Settings,
    *,
    notify: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, steps: None,
) -> PackageRun:
    """Runs an SSP 1.0 of FMI 2.0 co-simulation units; InputError in one line for what cannot be run."""
    for option, value in (("--structure", settings.structure), ("--basis", settings.basis)):
        if value is not None:
            raise InputError(option, "belongs to scenarios, the units of a package are built", value)
    source, budget, settings = str(file), ExtractionBudget(), replace(settings, record_animation=False)
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as folder:
        package, descriptions = _opened(file, Path(folder) / "package", budget)
        scenario = _scenario(package, descriptions, settings, source)
        draft = _draft(package, scenario, descriptions, settings, source)
        recording = step_units(
            {n: c.fmu for n, c in package.components.items()},
            draft,
            scenario,
            settings,
            source,
            notify,
            progress,
            budget,
        )
    ids = {str(v.start) for d in descriptions.values() for v in d.modelVariables if v.name == "design_id"}
    summary = run_summary(
        file.stem, scenario, "".join(ids), replace(settings, backend=_backend(descriptions)), recording, []
    )
    return PackageRun(title=scenario.title, recording=recording, summary=summary)


def require_package(file: Path) -> None:
    """InputError for a package that cannot be run, before there is a folder for its results."""
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as folder:
        _opened(file, Path(folder) / "package", ExtractionBudget())


def _opened(file: Path, folder: Path, budget: ExtractionBudget) -> tuple[Package, dict[str, Any]]:
    package = open_package(file, folder, budget)
    descriptions = unit_descriptions(package, str(file))
    if problems := structure_problems(package, descriptions):
        raise InputError("", problems[0], source=str(file))
    return package, descriptions


def _backend(descriptions: dict[str, Any]) -> Any:
    tools = any(d.coSimulation.needsExecutionTool for d in descriptions.values())
    return "python" if tools else "native"


def _scenario(package: Package, descriptions: dict[str, Any], settings: Settings, source: str) -> Scenario:
    """The package as a scenario, with what the command line says in place of the package's own."""
    experiments = [d.defaultExperiment for d in descriptions.values() if d.defaultExperiment is not None]
    steps = {float(e.stepSize) for e in experiments if e.stepSize}
    step = settings.step or package.step or (steps.pop() if len(steps) == 1 else None)
    if step is None:
        raise InputError("--step", "must be given: neither the package nor its units agree on a step", source=source)
    stop = settings.stop_time or package.stop_time
    if stop is None:
        raise InputError("--stop-time", "must be given: the package has no stop time", source=source)
    if not 0 < stop < float("inf"):
        raise InputError("stop_time", "must be finite and > 0", stop, source=source)
    return Scenario(
        title=package.description or package.name,
        structure="",
        stop_time=stop,
        step=step,
        coupling=settings.coupling or package.coupling or "jacobi",
        instance={name: Instance(fmu=c.fmu.name) for name, c in package.components.items()},
        connection=[Connection(**{"from": ".".join(c.start), "to": ".".join(c.end)}) for c in package.connections],
    )


def _draft(
    package: Package, scenario: Scenario, descriptions: dict[str, Any], settings: Settings, source: str
) -> PreparedRun:
    assert scenario.step is not None
    instances = {
        name: InstanceDeclaration(description=d, variables={v.name: v for v in d.modelVariables})
        for name, d in descriptions.items()
    }
    require_one_design(instances, source)
    starts: dict[str, Any] = {name: start_table(c) for name, c in package.components.items()}
    for name, values in start_values(scenario, instances, settings.overrides, source).items():
        starts[name] |= values
    wiring = WiringBuilder(scenario, instances, source, starts).build()
    require_open(wiring, settings.overrides)
    steps = whole_steps(scenario.stop_time, scenario.step, settings, source)
    require_room(wiring, steps, scenario.stop_time, settings, source)
    return PreparedRun(step=scenario.step, steps=steps, models={}, starts=starts, wiring=wiring, instances=instances)
