"""The content of a package in any format: units built with their start values, their links, their signals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.packaging.build import native_unit
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units
from flexbeams.fmus.units.signal_source import SIGNAL_SOURCE, source_data, source_interface
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.exportable import require_exportable
from flexbeams.scenarios.exporting.links import Link
from flexbeams.scenarios.exporting.source_signals import source_signals
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario

SOURCE = "source"  # component of the external signals, followed by _ where an instance has that name


@dataclass(frozen=True, kw_only=True)
class ExportBundle:
    """Units by component, in the order in which they step, and the links between them."""

    name: str
    description: str
    units: dict[str, Any]  # FMPy's descriptions
    files: dict[str, Path]  # their FMUs
    links: list[Link]
    stop_time: float  # s
    step: float  # s
    coupling: Coupling


def build_bundle(
    name: str,
    folder: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
    *,
    flags_as_real: bool = False,
) -> ExportBundle:
    """Builds a scenario's units into `folder`.

    Start values are built into the units, so that they hold in tools that ignore parameter sets. Raises the same errors
    as `run_scenario`, and BuildError where units cannot be compiled.
    """
    prepared = prepare_scenario(load_scenario(name), settings)
    require_exportable(prepared)
    scenario, design = prepared.scenario, prepared.design
    units, files = [], {}
    for instance, declared in scenario.instance.items():
        files[instance] = folder / f"{_file_name(scenario, instance)}.fmu"
        if declared.unit is None:
            files[instance].write_bytes(_provided_fmu(prepared, instance).read_bytes())
            continue
        kind = prepared.kinds[instance]
        unit = native_unit(kind, design, prepared.models[instance], files[instance], prepared.numeric_starts(instance))
        units.append(unit.with_real_flags() if flags_as_real else unit)
    source, driven = _source(prepared, folder / f"{SIGNAL_SOURCE.name}.fmu")
    if driven:
        units.append(source)
        files[source_name(scenario)] = source.out
    notify(f"building {', '.join(unit.interface.unit_name for unit in units)}")
    build_native_units(units, platforms, settings.compiler, cache=settings.build_folder, version=version("flexbeams"))
    return ExportBundle(
        name=prepared.file.name,
        description=prepared.file.description or scenario.title,
        units={n: unit_description(file, "FMU", prepared.source) for n, file in files.items()},
        files=files,
        links=_links(prepared, driven, source_name(scenario)),
        stop_time=scenario.stop_time,
        step=prepared.step,
        coupling=scenario.coupling,
    )


def parameters_of(unit: Any) -> list[Any]:
    """Variables of a unit whose start values a package repeats."""
    return [v for v in unit.modelVariables if v.causality == "parameter" and v.type in ("Real", "Integer", "Boolean")]


def _provided_fmu(prepared: PreparedScenario, instance: str) -> Path:
    """An FMU file of the scenario; start values cannot be built into it."""
    if prepared.starts[instance]:
        raise InputError(
            f"instance.{instance}",
            "must keep the start values of its FMU in a package: many tools ignore parameter sets",
            ", ".join(prepared.starts[instance]),
            source=prepared.source,
        )
    return prepared.provided_fmu(instance)


def _file_name(scenario: Scenario, instance: str) -> str:
    """The unit's name; followed by the instance's where the unit occurs more than once or is an FMU file."""
    kinds = [i.unit or "FMU" for i in scenario.instance.values()]
    unit = scenario.instance[instance].unit or "FMU"
    return unit if unit != "FMU" and kinds.count(unit) == 1 else f"{unit}_{instance}"


def source_name(scenario: Scenario) -> str:
    """The component of the external signals: a name that no instance has."""
    name = SOURCE
    while name in scenario.instance:
        name += "_"
    return name


def _source(prepared: PreparedScenario, out: Path) -> tuple[NativeUnit, dict[str, str]]:
    """The source of the external signals, and its output by <instance>.<input>."""
    signals, driven = source_signals(
        prepared.scenario,
        prepared.folder,
        {n: i.variables for n, i in prepared.declarations.items()},
        {n: prepared.numeric_starts(n) for n in prepared.starts},
        set(prepared.wiring.links()),
        step=prepared.step,
    )
    try:
        interface = source_interface(signals, prepared.step, prepared.scenario.stop_time)
    except InterfaceError as error:  # inputs of third-party units whose names cannot be those of outputs
        raise InputError("input", str(error), source=prepared.source) from None
    data = source_data(interface, signals)
    return NativeUnit(kind=SIGNAL_SOURCE, interface=interface, data=data, out=out), driven


def _links(prepared: PreparedScenario, driven: Mapping[str, str], source: str) -> list[Link]:
    """Links between the units, and from the source of signals, in the order of the inputs."""
    sources, links = prepared.wiring.links(), []
    for instance, declared in prepared.declarations.items():
        for name in (n for n, v in declared.variables.items() if v.causality == "input"):
            if f"{instance}.{name}" in driven:
                links.append(Link(source, driven[f"{instance}.{name}"], instance, name))
            elif f"{instance}.{name}" in sources:
                start, _, output = sources[f"{instance}.{name}"].partition(".")
                links.append(Link(start, output, instance, name))
    return links
