"""modelDescription.xml of a unit, the same for every backend and deterministic.

The attribute `guid` is a hash of the contents: write the description without a GUID, hash it
together with the kernel and its data (`content_guid`), then write it again with the GUID.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import xml_bytes
from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.interface.variables import Interface, Variable

AUTHOR = "flexbeams contributors"
TOLERANCE = 1e-6  # of the default experiment; some importers ask for one, the units have no use for it
LOG_CATEGORIES = {
    "logStatusWarning": "Messages with status fmi2Warning",
    "logStatusDiscard": "Messages with status fmi2Discard",
    "logStatusError": "Messages with status fmi2Error",
    "logStatusFatal": "Messages with status fmi2Fatal",
    "logAll": "All other messages",
}


def model_description(
    interface: Interface,
    *,
    guid: str = "",
    version: str = "",
    license: str = "BSD-2-Clause",
    source_files: Sequence[str] = (),
) -> bytes:
    """The complete modelDescription.xml (FMI 2.0, co-simulation) in UTF-8; same arguments, same bytes."""
    attributes = {
        "fmiVersion": "2.0",
        "modelName": interface.unit_name,
        "guid": guid,
        "description": interface.description,
        "author": AUTHOR,
        "version": version,
        "license": license,
        "generationTool": "flexbeams",
        "variableNamingConvention": "structured",
    }
    root = ElementTree.Element("fmiModelDescription", _present(attributes))
    root.set("guid", guid)  # required, even while empty
    _add_co_simulation(root, interface, source_files)
    _add_units(root, interface)
    categories = ElementTree.SubElement(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        ElementTree.SubElement(categories, "Category", name=name, description=meaning)
    ElementTree.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=_text(interface.stop_time),
        tolerance=_text(TOLERANCE),
        stepSize=_text(interface.step_size),
    )
    variables = ElementTree.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(interface):
        _add_variable(variables, reference, variable)
    _add_structure(root, interface)
    return xml_bytes(root)


def content_guid(*contents: bytes) -> str:
    """SHA-256 of the contents, each preceded by its length, as {8-4-4-4-12} hexadecimal digits."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    digits = digest.hexdigest()
    return f"{{{digits[:8]}-{digits[8:12]}-{digits[12:16]}-{digits[16:20]}-{digits[20:32]}}}"


def _add_co_simulation(root: ElementTree.Element, interface: Interface, source_files: Sequence[str]) -> None:
    attributes = {
        "modelIdentifier": interface.unit_name,
        "needsExecutionTool": _text(interface.needs_execution_tool),
        "canHandleVariableCommunicationStepSize": _text(interface.can_handle_variable_step),
        "canInterpolateInputs": _text(interface.can_interpolate_inputs),
        "maxOutputDerivativeOrder": "0",
        "canRunAsynchronuously": "false",
        "canBeInstantiatedOnlyOncePerProcess": _text(interface.can_be_instantiated_only_once),
        "canNotUseMemoryManagementFunctions": _text(interface.cannot_use_memory_management),
        "canGetAndSetFMUstate": _text(interface.can_get_and_set_state),
        "canSerializeFMUstate": _text(interface.can_serialize_state),
        "providesDirectionalDerivative": _text(interface.provides_directional_derivative),
    }
    element = ElementTree.SubElement(root, "CoSimulation", attributes)
    if source_files:
        files = ElementTree.SubElement(element, "SourceFiles")
        for name in source_files:
            ElementTree.SubElement(files, "File", name=name)


def _add_units(root: ElementTree.Element, interface: Interface) -> None:
    used = {variable.unit for variable in interface}
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name, powers in SI_UNITS.items():
        if name in used:
            unit = ElementTree.SubElement(definitions, "Unit", name=name)
            ElementTree.SubElement(unit, "BaseUnit", {base: str(power) for base, power in powers.items()})


def _add_variable(variables: ElementTree.Element, reference: int, variable: Variable) -> None:
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
        "initial": variable.initial or "",
    }
    scalar = ElementTree.SubElement(variables, "ScalarVariable", _present(attributes))
    numbers = {
        "unit": variable.unit,
        "min": variable.minimum,
        "max": variable.maximum,
        "nominal": variable.nominal,
        "start": variable.start,
    }
    given = {name: _text(value) for name, value in numbers.items() if value is not None}
    ElementTree.SubElement(scalar, variable.type, given)


def _add_structure(root: ElementTree.Element, interface: Interface) -> None:
    """Outputs change in doStep only, so they depend on no input.

    Their values after initialisation depend on the parameters, and on the inputs they name themselves.
    """
    structure = ElementTree.SubElement(root, "ModelStructure")
    indexed = list(enumerate(interface, start=1))
    outputs = [(i, v) for i, v in indexed if v.causality == "output"]
    if not outputs:
        return
    node = ElementTree.SubElement(structure, "Outputs")
    for i, _ in outputs:
        ElementTree.SubElement(node, "Unknown", index=str(i), dependencies="")
    initial = [(i, v) for i, v in outputs if v.initial == "calculated"]
    if not initial:
        return
    parameters = {i for i, v in indexed if v.causality == "parameter" and v.type != "String"}
    node = ElementTree.SubElement(structure, "InitialUnknowns")
    for i, variable in initial:
        inputs = {reference + 1 for name in variable.initial_inputs for reference in interface.references(name)}
        dependencies = " ".join(map(str, sorted(parameters | inputs)))
        ElementTree.SubElement(node, "Unknown", index=str(i), dependencies=dependencies)


def _present(attributes: Mapping[str, str]) -> dict[str, str]:
    """The attributes that are not empty."""
    return {name: value for name, value in attributes.items() if value}


def _text(value: float | int | bool | str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)
