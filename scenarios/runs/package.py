"""Runs of SSP packages: the same stepping as a scenario's, with the units and connections of the package."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.declaration import InstanceDeclaration
from flexbeams.scenarios.definition.dimensions import declared_dimensions
from flexbeams.scenarios.definition.schema import Connection, Instance, Scenario
from flexbeams.scenarios.definition.settings import Settings, start_values
from flexbeams.scenarios.definition.variants import changed_settings
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.package import Package, PackageConnection
from flexbeams.scenarios.importing.ssp import open_package
from flexbeams.scenarios.results.run import Run, run_summary
from flexbeams.scenarios.runs.execution import execute
from flexbeams.scenarios.runs.observer import SILENT, Observer, ignore_note
from flexbeams.scenarios.runs.prepare import PreparedRun, prepare_wiring
from flexbeams.scenarios.runs.requirements import (
    require_one_design,
    require_one_instance_each,
    whole_steps,
)
from flexbeams.scenarios.runs.room import require_room
from flexbeams.scenarios.validation.package import (
    connection_conversion,
    package_declarations,
    package_notes,
    structure_problems,
    unit_descriptions,
)
from flexbeams.scenarios.validation.parameters import parameter_values


@dataclass(frozen=True, kw_only=True)
class ExtractedPackage:
    """A package that is extracted and checked."""

    file: Path
    package: Package
    descriptions: dict[str, Any]  # FMPy's, by component
    budget: ExtractionBudget  # what is left of it for the units

    @property
    def name(self) -> str:
        """The package's name, which its results carry."""
        return os.fsencode(self.file.stem).decode("utf-8", "replace")

    @property
    def folder_name(self) -> str:
        """Name of the default folder for results: not that of a scenario with the package's name."""
        return f"{self.name}-ssp"


@contextmanager
def extracted_package(file: Path) -> Iterator[ExtractedPackage]:
    """A package in a temporary folder; InputError for one that cannot be run."""
    with temporary_folder() as folder:
        budget = ExtractionBudget()
        package = open_package(file, folder / "package", budget)
        descriptions = unit_descriptions(package, str(file))
        if problems := structure_problems(package, descriptions):
            raise InputError("", problems[0], source=str(file))
        yield ExtractedPackage(file=file, package=package, descriptions=descriptions, budget=budget)


def run_package(file: Path | ExtractedPackage, settings: Settings, observer: Observer = SILENT) -> Run:
    """Runs an SSP package of FMI 2.0 co-simulation units; InputError in one line for what cannot be run."""
    if isinstance(file, Path):
        with extracted_package(file) as extracted:
            return run_package(extracted, settings, observer)
    prepared = prepare_package(file, settings, observer.notify)
    files = {name: component.fmu for name, component in file.package.components.items()}
    recording = execute(prepared, files, observer, replace(file.budget))
    ids = {str(v.start) for d in file.descriptions.values() for v in d.modelVariables if v.name == "design_id"}
    changed = changed_settings(prepared.settings)
    return Run(
        name=file.name,
        description=file.package.description,
        scenario=prepared.scenario,
        settings=prepared.settings,
        design=None,
        recording=recording,
        outcomes=[],
        summary=run_summary(
            file.name,
            prepared.scenario,
            "".join(ids),
            prepared.settings,
            recording,
            [],
            step=prepared.step,
            changed=changed,
            declarations=prepared.declarations,
            kind="package",
        ),
    )


def prepare_package(
    extracted: ExtractedPackage, settings: Settings, notify: Callable[[str], None] = ignore_note
) -> PreparedRun:
    """Prepares the run of a package: names, sizes and values are checked."""
    given = {"--structure": settings.structure, "--basis": settings.basis, "design": settings.design or None}
    for option, value in given.items():
        if value is not None:
            raise InputError(option, "belongs to scenarios, the units of a package are built", value)
    package, descriptions, source = extracted.package, extracted.descriptions, str(extracted.file)
    tools = any(d.coSimulation.needsExecutionTool for d in descriptions.values())
    settings = replace(settings, record_animation=False, backend="python" if tools else "native")
    step = _step(package, descriptions, settings, source)
    declarations = package_declarations(package, descriptions)
    scenario = _scenario(package, declarations, step, settings, source)
    for text in package_notes(package, descriptions):
        notify(text)
    require_one_design(declarations, source)
    require_one_instance_each(declarations, source)
    sets = {
        name: parameter_values(
            component, descriptions[name], package.units, declared_dimensions(descriptions[name])
        ).values
        for name, component in package.components.items()
    }
    starts = start_values(scenario, declarations, settings.overrides, source, sets)
    wiring = prepare_wiring(scenario, declarations, settings, source, starts, notify, step)
    steps = whole_steps(scenario, step, settings, source)
    require_room(scenario, len(wiring.columns), steps, settings, source)
    return PreparedRun(
        source=source,
        scenario=scenario,
        settings=settings,
        step=step,
        steps=steps,
        start_time=package.start_time,
        declarations=declarations,
        starts=starts,
        wiring=wiring,
    )


def _step(package: Package, descriptions: Mapping[str, Any], settings: Settings, source: str) -> float:
    """The communication step, s: that of the settings, else of the package, else the one of all units."""
    experiments = [d.defaultExperiment for d in descriptions.values() if d.defaultExperiment is not None]
    steps = {float(e.stepSize) for e in experiments if e.stepSize}
    step = settings.step or package.step or (steps.pop() if len(steps) == 1 else None)
    if step is None:
        raise InputError("--step", "must be given: neither the package nor its units agree on a step", source=source)
    return step


def _scenario(
    package: Package,
    declarations: Mapping[str, InstanceDeclaration],
    step: float,
    settings: Settings,
    source: str,
) -> Scenario:
    """The package as a scenario, with the settings in place of the package's own values."""
    stop = settings.stop_time or package.stop_time
    if stop is None:
        raise InputError("--stop-time", "must be given: the package has no stop time", source=source)
    if not package.start_time < stop < float("inf"):
        rule = f"must be finite and > {package.start_time:g}, the start time"
        raise InputError("stop_time", rule, stop, source=source)
    return Scenario(
        title=package.description or package.name,
        structure="",
        stop_time=stop - package.start_time,
        step=step,
        coupling=settings.coupling or package.coupling or "jacobi",
        instance={name: Instance(fmu=c.fmu.name) for name, c in package.components.items()},
        connection=[_connection(c, declarations) for c in package.connections],
    )


def _connection(c: PackageConnection, declarations: Mapping[str, InstanceDeclaration]) -> Connection:
    """A connection as a scenario has it; with a transformation, or without conversion, its factor and offset."""
    ends: Any = {"from": ".".join(c.start), "to": ".".join(c.end)}
    found = connection_conversion(declarations, c)
    if isinstance(found, str) or (c.converted and c.factor == 1.0 and c.offset == 0.0):
        return Connection(**ends)
    return Connection(**ends, factor=found.factor, offset=found.offset)
