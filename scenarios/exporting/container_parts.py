"""The units inside a container: built with their start values, or FMU files of the scenario."""

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flexbeams.controller.design import Design
from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.interface.variables import Variable
from flexbeams.fmus.packaging.build import native_unit
from flexbeams.fmus.packaging.compilers import Platform
from flexbeams.fmus.packaging.native import build_native_units
from flexbeams.fmus.units.catalogue import require_kind
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.runs.prepare import PreparedRun

# Platform that the tool has a binary for: the folder in which that binary looks for those of the units inside
FOLDERS = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "aarch64-darwin": "darwin64"}


@dataclass(frozen=True, kw_only=True)
class ContainerPlan:
    """A scenario, ready to be built."""

    path: Path
    scenario: Scenario
    design: Design
    draft: PreparedRun


@dataclass(frozen=True, kw_only=True)
class Part:
    """A unit inside a container."""

    unit: str  # its modelName
    variables: tuple[Variable, ...]  # that the container can expose
    description: Any = None  # FMPy's, of an FMU file of the scenario


def build_parts(
    plan: ContainerPlan, folder: Path, targets: Sequence[Platform], compiler: str, notify: Callable[[str], None]
) -> dict[str, Part]:
    """Units by instance, their files in `folder`."""
    path, draft = plan.path, plan.draft
    parts, units = {}, []
    for instance, declared in plan.scenario.instance.items():
        file = folder / f"{instance}.fmu"
        if declared.unit is None:
            description = draft.instances[instance].description
            file.write_bytes(_provided_fmu(plan, instance, str(declared.fmu), targets).read_bytes())
            parts[instance] = Part(
                unit=description.modelName,
                description=description,
                variables=_provided_variables(instance, description, draft.wiring.columns, path),
            )
            continue
        kind = require_kind(declared.unit, f"instance.{instance}.unit")
        units.append(native_unit(kind, plan.design, draft.models[instance], file, draft.starts[instance]))
        parts[instance] = Part(unit=declared.unit, variables=units[-1].interface.variables)
    if units:
        notify(f"building {', '.join(unit.interface.unit_name for unit in units)}")
        build_native_units(units, [target.name for target in targets], compiler, version=version("flexbeams"))
    return parts


def _provided_fmu(plan: ContainerPlan, instance: str, fmu: str, targets: Sequence[Platform]) -> Path:
    """An FMU file of the scenario. The tool's own start values cannot be used: they override the host's."""
    source, file = str(plan.path), plan.path.parent / fmu
    if plan.draft.starts[instance]:
        raise InputError(
            f"instance.{instance}",
            "must keep the start values of its FMU in a container",
            ", ".join(plan.draft.starts[instance]),
            source=source,
        )
    with zipfile.ZipFile(file) as archive:
        folders = {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}
    for target in targets:
        if not folders & {target.name, FOLDERS[target.name]}:
            raise InputError(f"instance.{instance}.fmu", f"must have a binary for {target.name}", fmu, source=source)
    return file


def _provided_variables(instance: str, description: Any, columns: Sequence[str], path: Path) -> tuple[Variable, ...]:
    """Inputs and parameters of an FMU file, and the variables that a run records."""
    read: dict[str, Callable[[str], float | int | bool]] = {
        "Real": float,
        "Integer": int,
        "Boolean": lambda text: text in ("true", "1"),
    }
    variables = []
    for v in description.modelVariables:
        settable = v.causality in ("input", "parameter")
        if v.type not in read or not (settable or f"{instance}.{v.name}" in columns):
            continue
        limits = [None if bound is None or v.type == "Boolean" else float(bound) for bound in (v.min, v.max)]
        starts = settable or v.variability == "constant"
        try:
            variables.append(
                Variable(
                    name=v.name,
                    type=v.type,
                    causality=v.causality,
                    variability=v.variability or "",
                    start=read[v.type](v.start or "0") if starts else None,
                    minimum=limits[0],
                    maximum=limits[1],
                    unit=v.unit if v.type == "Real" and v.unit in SI_UNITS else None,
                    nominal=float(v.nominal) if v.type == "Real" and v.nominal else None,
                    description=v.description or "",
                )
            )
        except InterfaceError as error:
            raise InputError("", f"cannot be a container: {error}", source=str(path)) from None
    return tuple(variables)
