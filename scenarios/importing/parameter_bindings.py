"""Start values that an SSP binds to its components."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flexbeams.fmus.documents.xml_documents import SSV
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.package import Component, Parameter
from flexbeams.scenarios.importing.parameter_mappings import mapped
from flexbeams.scenarios.importing.ssp_documents import NS, STRUCTURE, SspFolder

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")  # of parameters
_SET = "application/x-ssp-parameter-set"


def bound_parameters(element: Any, package: SspFolder) -> list[Parameter]:
    """Parameters of all bindings of a component or system, those of later bindings last."""
    found: list[Parameter] = []
    for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NS):
        owner = element.get("name")
        if binding.get("type", _SET) != _SET or binding.get("sourceBase", "SSD") != "SSD":
            raise package.error(owner, "must be bound to parameter sets of the package", binding.get("type"))
        parameters: list[Parameter] = []
        if (uri := binding.get("source")) is not None:
            path = package.file(uri, f"{owner} ParameterBinding source")
            where = str(path.relative_to(package.folder))
            parameters += _parameters(package.document(where, SSV), where, binding, package)
        values = binding.find("ssd:ParameterValues", NS)
        for table in () if values is None else values:
            if table.tag != f"{{{SSV}}}ParameterSet":
                raise package.error(owner, "must have a ParameterSet as ParameterValues", table.tag)
            package.require_embedded(table, SSV)
            parameters += _parameters(table, STRUCTURE, binding, package)
        if (mapping := binding.find("ssd:ParameterMapping", NS)) is not None:
            if binding.get("prefix"):
                raise package.error(owner, "must have no prefix in a binding with a mapping", binding.get("prefix"))
            parameters = mapped(parameters, mapping, owner, package)
        found += parameters
    return found


def _parameters(table: Any, where: str, binding: Any, package: SspFolder) -> list[Parameter]:
    parameters: dict[str, Parameter] = {}
    source = f"{package.source}: {where}"
    for element in table.iterfind("ssv:Parameters/ssv:Parameter", NS):
        typed, name = element[0], binding.get("prefix", "") + element.get("name")
        kind = typed.tag.rpartition("}")[2]
        if kind not in TYPES:
            raise InputError(name, f"must be one of {', '.join(TYPES)}", kind, source=source)
        if name in parameters:
            raise InputError(name, "must be given once", source=source)
        parameters[name] = Parameter(name=name, type=kind, value=typed.get("value"), unit=typed.get("unit") or "")
    return list(parameters.values())


def bind_system(system: Any, components: Mapping[str, Component], package: SspFolder) -> list[str]:
    """Adds the parameters of the system, named <component>.<variable>, behind the components' own: the last holds.

    Returns a note for each that names no component and is ignored, as SSP 1.0.1 asks.
    """
    notes = []
    for parameter in bound_parameters(system, package):
        owner = max((n for n in components if parameter.name.startswith(f"{n}.")), key=len, default="")
        if not owner:
            notes.append(f"{parameter.name} is ignored, it names no component of the system")
            continue
        components[owner].parameters.append(replace(parameter, name=parameter.name.removeprefix(f"{owner}.")))
    return notes
