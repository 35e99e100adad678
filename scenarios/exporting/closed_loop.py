"""Units of a scenario, wired, as one native unit that needs no co-simulation master inside."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.packaging.closed_loop import ClosedLoop, closed_loop_unit
from flexbeams.fmus.packaging.native import build_native_units
from flexbeams.fmus.units.closed_loop import CLOSED_LOOP, LoopPart, LoopWire, part_references
from flexbeams.fmus.units.kind import with_real_flags
from flexbeams.fmus.units.signal_source import SIGNAL_SOURCE, source_data, source_interface
from flexbeams.plant.archive import write_whole
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.bundle import source_name
from flexbeams.scenarios.exporting.exportable import require_exportable
from flexbeams.scenarios.exporting.input_file import input_table
from flexbeams.scenarios.exporting.source_signals import source_signals
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario

MAX_NAME_LENGTH = 18  # of an instance: <instance>.<variable> must fit into the unit's tables


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """What goes into the unit."""

    parts: Sequence[str] = ()  # instances; all where none are named
    with_signals: bool = False  # the scenario's inputs inside, else in a file beside the unit
    flags_as_real: bool = False


def export_closed_loop(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
    *,
    parts: Sequence[str] = (),
    with_signals: bool = False,
    flags_as_real: bool = False,
) -> Path:
    """Writes a scenario's instances, or those named as `parts`, as one FMU. Equal arguments give equal bytes.

    Inputs of the parts that none of them drives are inputs of the unit. Start values are built in. The scenario's
    signals are inside (`with_signals`), or in the CSV file <stem>_in.csv beside `out`. Raises the same errors as
    `run_scenario`, InputError for an unknown part, and BuildError where the unit cannot be compiled.
    """
    loaded = load_scenario(name)
    chosen = _chosen(loaded.scenario, parts, str(loaded.path))
    _check(loaded.scenario, chosen, str(loaded.path))
    prepared = prepare_scenario(loaded, settings)
    require_exportable(prepared)
    options = LoopOptions(parts=chosen, with_signals=with_signals, flags_as_real=flags_as_real)
    try:
        unit = _unit(prepared, options, out)
    except InterfaceError as error:
        raise InputError("", str(error), source=prepared.source) from None
    notify(f"building {unit.interface.unit_name}")
    build_native_units(
        [unit], platforms, settings.compiler, cache=settings.build_folder, notify=notify, version=version("flexbeams")
    )
    if not with_signals:
        references = part_references(unit.parts)
        inputs = {name: unit.interface.variables[k].name for name, k in references.items()}
        if table := input_table(prepared, inputs):
            file = out.with_name(f"{out.stem}_in.csv")
            write_whole(file, table)
            notify(f"the host drives the inputs: {file} has the scenario's signals (--with-signals puts them inside)")
    return out


def _chosen(scenario: Scenario, parts: Sequence[str], source: str) -> list[str]:
    """The instances of the unit in the scenario's order."""
    for part in parts:
        if part not in scenario.instance:
            rule = "must name instances of the scenario" + suggestion(part, scenario.instance)
            raise InputError("--parts", rule, part, source=source)
    return [name for name in scenario.instance if not parts or name in parts]


def _check(scenario: Scenario, chosen: Sequence[str], source: str) -> None:
    for name in chosen:
        instance = scenario.instance[name]
        if instance.unit is None:
            raise InputError(
                f"instance.{name}.fmu",
                "must be a unit of this project in a closed loop, not an FMU file",
                instance.fmu,
                source=source,
            )
        if len(name) > MAX_NAME_LENGTH or not name.isascii():
            raise InputError(
                f"instance.{name}",
                f"must have at most {MAX_NAME_LENGTH} letters, digits and underscores of ASCII in a closed loop",
                name,
                source=source,
            )


def _unit(prepared: PreparedScenario, options: LoopOptions, out: Path) -> ClosedLoop:
    scenario = prepared.scenario
    parts = [_part(prepared, name, options.flags_as_real) for name in options.parts]
    wires = [
        LoopWire(source=source, to=to)
        for to, source in prepared.wiring.links().items()
        if {source.partition(".")[0], to.partition(".")[0]} <= set(options.parts)
    ]
    if options.with_signals:
        source, driven = _source(prepared, options.parts)
        parts += source
        wires += driven
    listed = ", ".join(f"{part.name} ({part.kind.name})" for part in parts)
    whole = len(options.parts) == len(scenario.instance)
    return closed_loop_unit(
        parts,
        wires,
        scenario.coupling,
        step=prepared.step,
        stop_time=scenario.stop_time,
        description=f"{scenario.title}: {listed} in one unit",
        out=out,
        name=CLOSED_LOOP.name if whole else unit_name(options.parts),
    )


def unit_name(parts: Sequence[str]) -> str:
    """The modelIdentifier of a unit of some parts: feedforward and controller make BeamFeedforwardController."""
    return "Beam" + "".join(part[:1].upper() + part[1:] for part in parts)


def _part(prepared: PreparedScenario, name: str, flags_as_real: bool) -> LoopPart:
    kind = prepared.kinds[name]
    interface, data = kind.contents(prepared.design, prepared.models[name])
    if flags_as_real:
        interface = with_real_flags(interface)
    return LoopPart(name=name, kind=kind, interface=interface.with_starts(prepared.numeric_starts(name)), data=data)


def _source(prepared: PreparedScenario, chosen: Sequence[str]) -> tuple[list[LoopPart], list[LoopWire]]:
    """The source of the scenario's signals for the chosen parts, stepped last, and its wires; none without signals.

    Inputs that the scenario leaves open stay inputs of the unit, but for elements of arrays that a signal drives.
    """
    scenario = prepared.scenario
    inputs = [drive for drive in scenario.input if drive.to.partition(".")[0] in chosen]
    if not inputs:
        return [], []
    signals, driven = source_signals(
        replace(scenario, input=inputs),
        prepared.folder,
        {name: prepared.declarations[name].variables for name in chosen},
        {n: prepared.numeric_starts(n) for n in prepared.starts},
        set(prepared.wiring.links()),
        open_arrays=False,
        step=prepared.step,
    )
    name = source_name(scenario)
    interface = source_interface(signals, prepared.step, scenario.stop_time)
    part = LoopPart(name=name, kind=SIGNAL_SOURCE, interface=interface, data=source_data(interface, signals))
    return [part], [LoopWire(source=f"{name}.{output}", to=to) for to, output in driven.items()]
