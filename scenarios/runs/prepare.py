"""Preparation of a run: everything is computed and checked that does not need a built unit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path
from typing import Any

from flexbeams.controller.design import Design
from flexbeams.fmus.packaging.designs import cached_design
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.plausibility import implausible_values
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.scenarios.definition.declaration import InstanceDeclaration, element_names, split_owner
from flexbeams.scenarios.definition.kinds import instance_kinds
from flexbeams.scenarios.definition.scenario_file import ScenarioFile
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings, StartValues, require_undriven, start_values
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.runs.observer import ignore_note
from flexbeams.scenarios.runs.requirements import (
    note_skipped_rows,
    reachable_checks,
    require_discrete_signals,
    require_figures,
    require_measurable,
    require_one_design,
    require_one_instance_each,
    require_reachable_targets,
    require_sampled_signals,
    require_sections,
    whole_steps,
)
from flexbeams.scenarios.runs.room import recorded_bytes, require_room, with_affordable_deflections
from flexbeams.scenarios.runs.voltage_limits import note_limits
from flexbeams.scenarios.simulation.frames import frame_layout
from flexbeams.scenarios.simulation.rates import require_rates
from flexbeams.scenarios.simulation.sensors import require_sensors
from flexbeams.scenarios.simulation.wiring import Wiring, plan_wiring


@dataclass(frozen=True, kw_only=True)
class PreparedRun:
    """A run whose names, sizes and values are checked, before its units are loaded."""

    source: str  # file that error messages name
    scenario: Scenario  # with the settings applied
    settings: Settings
    step: float  # s
    steps: int
    declarations: dict[str, InstanceDeclaration]
    starts: dict[str, StartValues]
    wiring: Wiring
    start_time: float = 0.0  # s

    @property
    def recorded_bytes(self) -> int:
        """Size of the recorded values with their times."""
        return recorded_bytes(len(self.wiring.columns), self.steps, self.settings.decimate)

    def unit_of(self, column: str) -> str:
        """The unit of measurement of <instance>.<variable>, empty where it has none."""
        owner, variable = split_owner(column, self.declarations)
        return self.declarations[owner].variables[variable].unit or ""

    def numeric_starts(self, instance: str) -> dict[str, float | bool]:
        """Start values of an instance but for Strings."""
        return {name: value for name, value in self.starts[instance].items() if not isinstance(value, str)}


@dataclass(frozen=True, kw_only=True)
class PreparedScenario(PreparedRun):
    """A prepared run of a scenario, with the checks that it reaches, and its design."""

    file: ScenarioFile
    design: Design
    kinds: dict[str, UnitKind]  # of the instances whose units are built
    models: dict[str, BeamModel]  # of the plant, for the same instances
    open_loop: "PreparedScenario | None"  # the run to compare with

    @property
    def folder(self) -> Path:
        """Folder that files of the scenario are relative to."""
        return self.file.path.parent

    def provided_fmu(self, instance: str) -> Path:
        """File of an instance that is an FMU of the scenario."""
        return self.folder / str(self.scenario.instance[instance].fmu)


def prepare_scenario(
    file: ScenarioFile,
    settings: Settings,
    notify: Callable[[str], None] = ignore_note,
    designs: Sequence[Design] = (),
) -> PreparedScenario:
    """Prepares the run of a scenario, and that of its open loop.

    A design among `designs` is used where it fits. Raises FlexbeamsError for whatever scenario or settings ask for that
    is not possible.
    """
    source = str(file.path)
    scenario = settings.applied_to(file.scenario)
    scenario = replace(scenario, design=scenario.design.relative_to(file.path.parent))
    kinds = instance_kinds(scenario, settings.kinds, source)
    design = _design(file, scenario, settings, notify, designs)
    for warning in design.summary["warnings"]:
        notify(f"design: {warning}")
    step = scenario.step or design.options.sample_time
    steps = whole_steps(scenario, step, settings, source)
    require_sampled_signals(scenario, step, source)
    models = _models(scenario, design, settings, source)
    declarations = _declarations(file, design, kinds, models)
    require_one_design(declarations, source)
    require_one_instance_each(declarations, source)
    starts = start_values(scenario, declarations, settings.overrides, source)
    require_reachable_targets(scenario, design, kinds, declarations, starts, source)
    note_limits(declarations, starts, notify)
    wiring = prepare_wiring(scenario, declarations, settings, source, starts, notify, step)
    require_discrete_signals(wiring, declarations, steps, step, source)
    note_skipped_rows(scenario, wiring, steps, step, notify)
    require_room(scenario, len(wiring.columns), steps, settings, source)
    require_sensors(scenario.sensor, wiring.columns, step * settings.decimate, source)
    scenario = reachable_checks(scenario, settings, source, notify)
    open_loop = None
    if file.open_loop is not None:
        compared = settings.of_open_loop(file.open_loop.scenario.instance)
        open_loop = prepare_scenario(file.open_loop, compared, notify, [design, *designs])
    require_measurable(scenario, wiring.columns, source)
    require_figures(scenario, wiring.columns, open_loop.wiring.columns if open_loop else None, source)
    return PreparedScenario(
        source=source,
        scenario=scenario,
        settings=settings,
        step=step,
        steps=steps,
        declarations=declarations,
        starts=starts,
        wiring=wiring,
        file=file,
        design=design,
        kinds=kinds,
        models=models,
        open_loop=open_loop,
    )


def prepare_wiring(
    scenario: Scenario,
    declarations: Mapping[str, InstanceDeclaration],
    settings: Settings,
    source: str,
    starts: Mapping[str, StartValues],
    notify: Callable[[str], None],
    step: float,
) -> Wiring:
    """The wiring of a run, with frames if its animation is recorded; no input that --set sets is driven."""
    hidden = _deflections(scenario, declarations) if settings.record_deflections else []
    recording = replace(scenario, record=[*(scenario.record or []), *hidden]) if hidden else scenario
    wiring = plan_wiring(recording, declarations, source, starts, notify, step, settings.open_inputs)
    require_undriven(settings.overrides, wiring.driven())
    require_rates(settings.record_every, wiring.columns, settings.decimate)
    if settings.record_animation:
        wiring = replace(wiring, frames=frame_layout(declarations, wiring.sources, wiring.inputs))
    if not hidden:
        return wiring
    return with_affordable_deflections(wiring.with_hidden(hidden), round(scenario.stop_time / step), settings.decimate)


def _deflections(scenario: Scenario, declarations: Mapping[str, InstanceDeclaration]) -> list[str]:
    """The deflections along the beams of the first plant; none where the scenario records some of them itself."""
    for name, declaration in declarations.items():
        if declaration.kind is not None and declaration.kind.animated is not None:
            array = f"{name}.{declaration.kind.animated[0]}"
            if any(text == array or text.startswith(f"{array}[") for text in scenario.record or []):
                return []
            return [f"{name}.{n}" for n in element_names(declaration.variables, declaration.kind.animated[0])]
    return []


def _design(
    file: ScenarioFile,
    scenario: Scenario,
    settings: Settings,
    notify: Callable[[str], None],
    designs: Sequence[Design],
) -> Design:
    source = str(file.path)
    try:
        structure_path = find_structure(settings.structure or scenario.structure, file.path.parent)
    except InputError as error:
        raise error.at("--structure" if settings.structure else source) from None
    structure = read_structure(structure_path)
    for line in implausible_values(structure):
        notify(f"{structure_path}: {line}")
    fitting = (d for d in designs if d.structure == structure and d.options == scenario.design)
    try:
        with _enough_memory("design", source):
            return next(fitting, None) or cached_design(structure, scenario.design, settings.build_folder)
    except DesignError as error:
        raise DesignError(f"{source}: design of {structure_path}: {error}") from None


def _declarations(
    file: ScenarioFile, design: Design, kinds: Mapping[str, UnitKind], models: Mapping[str, BeamModel]
) -> dict[str, InstanceDeclaration]:
    require_sections(kinds, design, str(file.path))
    return {
        name: InstanceDeclaration.of_interface(kinds[name], kinds[name].declare(design, models[name]))
        if name in kinds
        else _provided(name, file)
        for name in file.scenario.instance
    }


def _models(scenario: Scenario, design: Design, settings: Settings, source: str) -> dict[str, BeamModel]:
    """The plant's model for each instance whose unit is built; equal ones are computed once."""
    computed: dict[tuple[Any, Any], BeamModel] = {}
    models = {}
    for name, instance in scenario.instance.items():
        if instance.unit is None:
            continue
        key = (None if settings.basis else instance.basis, instance.order)
        try:
            with _enough_memory(f"instance.{name}", source):
                models[name] = computed[key] = computed.get(key) or design.model(*key)
        except InputError as error:
            raise error if error.source else error.at(source, f"instance.{name}.") from None
    return models


@contextmanager
def _enough_memory(key: str, source: str) -> Iterator[None]:
    """InputError where matrices do not fit into memory."""
    try:
        yield
    except MemoryError as error:
        raise InputError(key, f"needs too much memory, choose a lower order ({error})", source=source) from None


def _provided(name: str, file: ScenarioFile) -> InstanceDeclaration:
    """The declaration of an instance that is an FMU of the scenario."""
    key, fmu = f"instance.{name}.fmu", file.path.parent / str(file.scenario.instance[name].fmu)
    if not isfile(fmu):
        raise InputError(key, "must be a file", str(fmu), source=str(file.path))
    return InstanceDeclaration.of_description(unit_description(fmu, key, str(file.path)))
