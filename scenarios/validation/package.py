"""Checks of a package against its FMUs: connectors, units of measurement, start values."""

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fmpy.validation import validate_fmu

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.importing.package import Component, Connector, Package, PackageConnection, Parameter
from flexbeams.scenarios.importing.ssp import open_package

Value = float | bool | str


def package_problems(file: Path) -> list[str]:
    """All problems of an SSP, one line each: schemas, structure, units, start values, its FMUs."""
    with temporary_folder() as temporary:
        folder = temporary / "package"
        try:
            package = open_package(file, folder, ExtractionBudget())
            descriptions = unit_descriptions(package, str(file))
        except InputError as error:
            return [str(error).removeprefix(f"{file}: ").replace(f"{folder}/", "")]
        problems = [*structure_problems(package, descriptions), *start_problems(package, descriptions)]
        for fmu in dict.fromkeys(c.fmu for c in package.components.values()):
            problems += [f"{fmu.relative_to(folder)}: {problem}" for problem in unit_problems(fmu)]
    return problems


def unit_problems(file: Path) -> list[str]:
    """Violations of FMI by an FMU of any version, one line each."""
    try:
        ExtractionBudget().check(file)
        with zipfile.ZipFile(file) as archive:
            if damaged := archive.testzip():
                return [f"{damaged} is damaged: its checksum does not match"]
        return [" ".join(str(problem).split()) for problem in validate_fmu(str(file))]
    except InputError as error:
        return [str(error).removeprefix(f"{file}: ")]
    except Exception as error:  # FMPy raises various errors on a damaged file
        return [" ".join(str(error).split()) or type(error).__name__]


def unit_descriptions(package: Package, source: str) -> dict[str, Any]:
    """FMPy's description of each component's FMU; InputError where one is not an FMI 2.0 co-simulation unit."""
    by_file: dict[Path, Any] = {}
    for name, component in package.components.items():
        if component.fmu not in by_file:
            by_file[component.fmu] = unit_description(component.fmu, f"Component {name} source", source)
    return {name: by_file[component.fmu] for name, component in package.components.items()}


def structure_problems(package: Package, descriptions: Mapping[str, Any]) -> list[str]:
    """Connectors and start values that disagree with the FMUs, and inconsistent units of measurement."""
    problems = []
    for name, component in package.components.items():
        variables = {v.name: v for v in descriptions[name].modelVariables}
        dimensions = _dimensions(package, descriptions[name])
        for connector in component.connectors.values():
            problems += [f"{name}.{connector.name} {p}" for p in _connector(connector, variables, dimensions)]
        for parameter in component.parameters:
            problems += [f"{name}.{parameter.name} {p}" for p in _parameter(parameter, variables, dimensions)]
    for connection in package.connections:
        problems += _connection(package, descriptions, connection)
    return problems


def start_problems(package: Package, descriptions: Mapping[str, Any]) -> list[str]:
    """Start values that differ from the FMU's own: tools that ignore parameter sets would run another system."""
    problems = []
    for name, component in package.components.items():
        variables = {v.name: v for v in descriptions[name].modelVariables}
        for variable, value in start_table(component).items():
            own = variables[variable].start if variable in variables else None
            if own is None or _value(variables[variable].type, own) != value:
                problems.append(f"{name}.{variable} is {value!r} in the parameter set and {own} in its FMU")
    return problems


def start_table(component: Component) -> dict[str, Value]:
    """Start values of a component by variable; the last one counts."""
    return {p.name: _value(p.type, p.value) for p in component.parameters}


def _value(kind: str, text: str) -> Value:
    if kind == "Boolean":
        return text in ("true", "1")
    return text if kind == "String" else float(text)


def _connector(connector: Connector, variables: Mapping[str, Any], dimensions: Mapping[str, Any]) -> Iterator[str]:
    variable = variables.get(connector.name)
    if variable is None:
        yield "is not a variable of its FMU" + suggestion(connector.name, variables)
        return
    if connector.kind in ("input", "output") and variable.causality != connector.kind:
        yield f"is an {connector.kind} in the package and {variable.causality} in its FMU"
    if connector.type and connector.type != variable.type:
        yield f"is {connector.type} in the package and {variable.type} in its FMU"
    if not _same_unit(connector.unit, variable.unit or "", dimensions):
        yield f"has the unit {connector.unit!r} in the package and {variable.unit!r} in its FMU"


def _parameter(parameter: Parameter, variables: Mapping[str, Any], dimensions: Mapping[str, Any]) -> Iterator[str]:
    variable = variables.get(parameter.name)
    if variable is None:
        yield "is not a variable of its FMU" + suggestion(parameter.name, variables)
        return
    if variable.causality not in ("parameter", "input"):
        yield f"is {variable.causality} in its FMU and cannot take a start value"
    elif parameter.type != variable.type:
        yield f"is {parameter.type} in the parameter set and {variable.type} in its FMU"
    elif parameter.type in ("Real", "Integer"):
        low, high = (float(variable.min or "-inf"), float(variable.max or "inf"))
        if not low <= float(parameter.value) <= high or abs(float(parameter.value)) == float("inf"):
            yield f"must be finite and from {low:g} to {high:g}, got {parameter.value}"
    if not _same_unit(parameter.unit, variable.unit or "", dimensions):
        yield f"has the unit {parameter.unit!r} in the parameter set and {variable.unit!r} in its FMU"


def _connection(package: Package, descriptions: Mapping[str, Any], connection: PackageConnection) -> Iterator[str]:
    start, end = connection.start, connection.end
    text = f"connection {'.'.join(start)} to {'.'.join(end)}"
    kinds, units = [], []
    for owner, name in (start, end):
        variable = next((v for v in descriptions[owner].modelVariables if v.name == name), None)
        if variable is None:
            return
        kinds.append(variable.type)
        units.append(package.components[owner].connectors[name].unit or variable.unit or "")
    if kinds != ["Real", "Real"]:
        yield f"{text} joins {kinds[0]} and {kinds[1]}, only connections between Real are supported"
    dimensions = _dimensions(package, descriptions[start[0]]) | _dimensions(package, descriptions[end[0]])
    if connection.converted and not _same_unit(units[0], units[1], dimensions):
        yield f"{text} joins the units {units[0]!r} and {units[1]!r}, conversions are not supported"


def _same_unit(one: str, other: str, dimensions: Mapping[str, Any]) -> bool:
    """Whether names or definitions are equal, or one of them is unknown."""
    if not one or not other or one == other:
        return True
    return one in dimensions and dimensions[one] == dimensions.get(other)


def _dimensions(package: Package, description: Any) -> dict[str, tuple[float, ...]]:
    """Units of the package and of an FMU by name: exponents of SI's base units, factor and offset."""
    own = {}
    for unit in description.unitDefinitions or []:
        if (base := unit.baseUnit) is not None:
            own[unit.name] = (
                *(float(getattr(base, k) or 0) for k in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")),
                float(base.factor),
                float(base.offset),
            )
    return {**own, **package.units}
