"""Checks of a package against its FMUs: connectors, units of measurement, start values."""

import zipfile
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

from fmpy.validation import validate_fmu

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.compatibility import joined
from flexbeams.scenarios.definition.declaration import InstanceDeclaration
from flexbeams.scenarios.definition.dimensions import IDENTITY, Conversion, Dimension, conversion, declared_dimensions
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.importing.package import Connector, Package, PackageConnection
from flexbeams.scenarios.importing.ssp import open_package
from flexbeams.scenarios.validation.parameters import parameter_values
from flexbeams.scenarios.validation.rules import rule_problems, version_problem


def package_problems(file: Path, notify: Callable[[str], None] = lambda text: None) -> list[str]:
    """All problems of an SSP, one line each: schemas, structure, units, start values, its FMUs.

    Notes are no problems: what is ignored or converted, and start values that tools without parameter sets would miss.
    """
    with temporary_folder() as temporary:
        folder = temporary / "package"
        try:
            package = open_package(file, folder, ExtractionBudget())
            descriptions = unit_descriptions(package, str(file))
        except InputError as error:
            return [str(error).removeprefix(f"{file}: ").replace(f"{folder}/", "")]
        problems = structure_problems(package, descriptions)
        for text in (*package_notes(package, descriptions), *_differences(package, descriptions)):
            notify(text)
        for fmu in dict.fromkeys(c.fmu for c in package.components.values()):
            problems += [f"{fmu.relative_to(folder)}: {problem}" for problem in unit_problems(fmu)]
    return problems


def unit_problems(file: Path) -> list[str]:
    """Violations of FMI 2.0 by an FMU, one line each; one line for an FMU of another version."""
    try:
        ExtractionBudget().check(file)
        with zipfile.ZipFile(file) as archive:
            if damaged := archive.testzip():
                return [f"{damaged} is damaged: its checksum does not match"]
        if problem := version_problem(file):
            return [problem]
        return [*(" ".join(str(problem).split()) for problem in validate_fmu(str(file))), *rule_problems(file)]
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
        own = declared_dimensions(descriptions[name])
        for connector in component.connectors.values():
            problems += [
                f"{name}.{connector.name} {p}" for p in _connector(connector, variables, {**own, **package.units}, own)
            ]
        problems += parameter_values(component, descriptions[name], package.units, own).problems
    declarations = package_declarations(package, descriptions)
    for connection in package.connections:
        problems += _connection(declarations, connection)
    return problems


def package_notes(package: Package, descriptions: Mapping[str, Any]) -> list[str]:
    """What is ignored or converted, one line each."""
    notes = [*package.notes]
    for name, component in package.components.items():
        own = declared_dimensions(descriptions[name])
        notes += parameter_values(component, descriptions[name], package.units, own).notes
    return notes


def _differences(package: Package, descriptions: Mapping[str, Any]) -> list[str]:
    """Start values of the parameter sets that are not those of the FMUs."""
    differences = []
    for name, component in package.components.items():
        own = declared_dimensions(descriptions[name])
        differences += parameter_values(component, descriptions[name], package.units, own).differences
    return differences


def package_declarations(package: Package, descriptions: Mapping[str, Any]) -> dict[str, InstanceDeclaration]:
    """The components as their FMUs declare them, with the units of measurement that only the package states."""
    declarations = {}
    for name, component in package.components.items():
        declared = InstanceDeclaration.of_description(descriptions[name])
        variables = dict(declared.variables)
        for connector in component.connectors.values():
            variable = variables.get(connector.name)
            if variable is not None and connector.unit and not variable.unit:
                variables[connector.name] = copy(variable)
                variables[connector.name].unit = connector.unit
        declarations[name] = replace(declared, variables=variables, dimensions={**package.units, **declared.dimensions})
    return declarations


def _connector(
    connector: Connector,
    variables: Mapping[str, Any],
    dimensions: Mapping[str, Dimension],
    of_unit: Mapping[str, Dimension],
) -> Iterator[str]:
    variable = variables.get(connector.name)
    if variable is None:
        yield "is not a variable of its FMU" + suggestion(connector.name, variables)
        return
    if connector.kind in ("input", "output") and variable.causality != connector.kind:
        yield f"is an {connector.kind} in the package and {variable.causality} in its FMU"
    if connector.type and connector.type != variable.type:
        yield f"is {connector.type} in the package and {variable.type} in its FMU"
    if conversion(connector.unit, variable.unit or "", dimensions, of_unit) != IDENTITY:
        yield f"has the unit {connector.unit!r} in the package and {variable.unit!r} in its FMU"


def _connection(declarations: Mapping[str, InstanceDeclaration], connection: PackageConnection) -> Iterator[str]:
    found = connection_conversion(declarations, connection)
    if isinstance(found, str):
        yield f"connection {'.'.join(connection.start)} to {'.'.join(connection.end)} {found}"


def connection_conversion(
    declarations: Mapping[str, InstanceDeclaration], connection: PackageConnection
) -> Conversion | str:
    """What the input takes of the output's value: units of measurement first, then the transformation.

    A text is the reason why they cannot be joined.
    """
    (start, output), (end, target) = connection.start, connection.end
    one, other = declarations[start], declarations[end]
    if output not in one.variables or target not in other.variables:
        return IDENTITY  # refused as a connector
    variables = one.variables[output], other.variables[target]
    given = None if connection.converted else IDENTITY
    found = joined(*variables, one.dimensions, other.dimensions, given)
    if isinstance(found, str) or (connection.factor == 1.0 and connection.offset == 0.0):
        return found
    if variables[1].type != "Real":
        return f"has a linear transformation, which {variables[1].type} does not take"
    return Conversion(
        factor=found.factor * connection.factor, offset=found.offset * connection.factor + connection.offset
    )
