"""A scenario's closed loop as one native unit that needs no co-simulation master inside."""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.packaging.closed_loop import ClosedLoop, Part, Wire, closed_loop_interface
from flexbeams.fmus.packaging.design_data import unit_data
from flexbeams.fmus.packaging.native import build_native_units
from flexbeams.fmus.units.shipped import interface_of
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.schema import Scenario, find_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.prepare import prepare_run
from flexbeams.scenarios.runs.scenario import prepare

MAX_NAME_LENGTH = 18  # of an instance: <instance>.<variable> must fit into the unit's tables


def export_closed_loop(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes a scenario's instances as one FMU. Equal arguments give equal bytes.

    Inputs that no connection drives become inputs of the unit: external signals stay outside. Start values are built
    in. Raises the same errors as `run_scenario`, and BuildError where the unit cannot be compiled.
    """
    path = find_scenario(name)
    scenario, design = prepare(path, settings)
    _check(scenario, str(path))
    scenario, draft = prepare_run(path, scenario, design, settings, lambda text: None)
    parts = []
    for instance, declared in scenario.instance.items():
        interface = interface_of(str(declared.unit), design, draft.models[instance])
        data, meta = unit_data(interface, design, draft.models[instance])
        parts.append(Part(name=instance, interface=interface.with_starts(draft.starts[instance]), data=data, meta=meta))
    wires = [Wire(source=source, to=to) for to, source in draft.wiring.links().items()]
    listed = ", ".join(f"{part.name} ({part.unit})" for part in parts)
    try:
        interface = closed_loop_interface(
            parts, wires, draft.step, scenario.stop_time, f"{scenario.title}: {listed} in one unit"
        )
    except InterfaceError as error:
        raise InputError("", str(error), source=str(path)) from None
    notify(f"building {interface.unit_name}")
    build_native_units(
        [ClosedLoop(interface=interface, parts=tuple(parts), wires=tuple(wires), coupling=scenario.coupling, out=out)],
        platforms,
        settings.compiler,
        version=version("flexbeams"),
    )
    return out


def _check(scenario: Scenario, source: str) -> None:
    for name, instance in scenario.instance.items():
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
