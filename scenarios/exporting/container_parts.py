"""The units inside a container: built with their start values, or FMU files of the scenario."""

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.interface.variables import Variable
from flexbeams.fmus.packaging.build import native_unit
from flexbeams.fmus.packaging.compilers import Platform
from flexbeams.fmus.packaging.native import build_native_units
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.prepare import PreparedScenario

# Platform that the tool has a binary for: the folder in which that binary looks for those of the units inside
FOLDERS = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "aarch64-darwin": "darwin64"}


@dataclass(frozen=True, kw_only=True)
class Part:
    """A unit inside a container."""

    unit: str  # its modelName
    variables: tuple[Variable, ...]  # that the container can expose
    description: Any = None  # FMPy's, of an FMU file of the scenario


def build_parts(
    prepared: PreparedScenario,
    folder: Path,
    targets: Sequence[Platform],
    settings: Settings,
    notify: Callable[[str], None],
) -> dict[str, Part]:
    """Units by instance, their files in `folder`."""
    parts, units = {}, []
    for instance, declared in prepared.scenario.instance.items():
        file = folder / f"{instance}.fmu"
        if declared.unit is None:
            description = prepared.declarations[instance].description
            file.write_bytes(_provided_fmu(prepared, instance, targets).read_bytes())
            parts[instance] = Part(
                unit=description.modelName,
                description=description,
                variables=_provided_variables(instance, description, prepared.wiring.columns, prepared.source),
            )
            continue
        kind, model = prepared.kinds[instance], prepared.models[instance]
        units.append(native_unit(kind, prepared.design, model, file, prepared.numeric_starts(instance)))
        parts[instance] = Part(unit=declared.unit, variables=units[-1].interface.variables)
    if units:
        notify(f"building {', '.join(unit.interface.unit_name for unit in units)}")
        names, cache = [target.name for target in targets], settings.build_folder
        build_native_units(units, names, settings.compiler, cache=cache, version=version("flexbeams"))
    return parts


def _provided_fmu(prepared: PreparedScenario, instance: str, targets: Sequence[Platform]) -> Path:
    """An FMU file of the scenario. The tool's own start values cannot be used: they override the host's."""
    source, file = prepared.source, prepared.provided_fmu(instance)
    if prepared.starts[instance]:
        raise InputError(
            f"instance.{instance}",
            "must keep the start values of its FMU in a container",
            ", ".join(prepared.starts[instance]),
            source=source,
        )
    with zipfile.ZipFile(file) as archive:
        folders = {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}
    for target in targets:
        if not folders & {target.name, FOLDERS[target.name]}:
            raise InputError(
                f"instance.{instance}.fmu", f"must have a binary for {target.name}", file.name, source=source
            )
    return file


def _provided_variables(instance: str, description: Any, columns: Sequence[str], source: str) -> tuple[Variable, ...]:
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
            raise InputError("", f"cannot be a container: {error}", source=source) from None
    return tuple(variables)
