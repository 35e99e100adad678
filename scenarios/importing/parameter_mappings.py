"""Parameter mappings of an SSP: names of a parameter set to names of a component, with linear transformations."""

from dataclasses import replace
from typing import Any

from flexbeams.fmus.documents.xml_documents import SSC, SSM
from flexbeams.scenarios.importing.package import Parameter
from flexbeams.scenarios.importing.ssp_documents import NS, STRUCTURE, SspFolder

_TYPE = "application/x-ssp-parameter-mapping"


def mapped(parameters: list[Parameter], element: Any, owner: str, package: SspFolder) -> list[Parameter]:
    """The parameters by the names of the component; those that the mapping of a binding does not name are left out."""
    if element.get("type", _TYPE) != _TYPE or element.get("sourceBase", "SSD") != "SSD":
        raise package.error(owner, "must be mapped by a parameter mapping of the package", element.get("type"))
    by_name = {parameter.name: parameter for parameter in parameters}
    chosen = []
    for entry in _mapping(element, owner, package).iterfind("ssm:MappingEntry", NS):
        if (parameter := by_name.get(entry.get("source"))) is None:
            continue
        factor, offset = linear_transformation(entry, f"{owner} ParameterMapping", entry.get("target"), package)
        converted = not boolean(entry.get("suppressUnitConversion"))
        chosen.append(replace(parameter, name=entry.get("target"), factor=factor, offset=offset, converted=converted))
    return chosen


def _mapping(element: Any, owner: str, package: SspFolder) -> Any:
    """The mapping's document, in a file of its own or inside the structure."""
    if (uri := element.get("source")) is not None:
        path = package.file(uri, f"{owner} ParameterMapping source")
        return package.document(str(path.relative_to(package.folder)), SSM)
    if (inside := element.find("ssm:ParameterMapping", NS)) is None:
        raise package.error(owner, "must have a ParameterMapping with a source or entries", STRUCTURE)
    package.require_embedded(inside, SSM)
    return inside


def linear_transformation(element: Any, key: str, name: str, package: SspFolder) -> tuple[float, float]:
    """Factor and offset of an element's LinearTransformation; InputError for transformations of other kinds."""
    factor, offset = 1.0, 0.0
    for child in element:
        kind = child.tag.rpartition("}")[2]
        if child.tag == f"{{{SSC}}}LinearTransformation":
            factor, offset = float(child.get("factor", 1)), float(child.get("offset", 0))
        elif kind.endswith("Transformation"):
            raise package.error(key, f"a {kind} is not supported", name)
    return factor, offset


def boolean(text: str | None) -> bool:
    """An attribute of the type xs:boolean, by default false."""
    return text is not None and text.strip() in ("true", "1")
