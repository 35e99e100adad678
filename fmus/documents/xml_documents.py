"""Writing XML documents, and the shared parts of those of SSP 1.0."""

from collections.abc import Iterable
from xml.etree import ElementTree

from flexbeams.fmus.interface.si import SI_UNITS

SSP = "http://ssp-standard.org/SSP1/SystemStructure"
SSC, SSD, SSV = f"{SSP}Common", f"{SSP}Description", f"{SSP}ParameterValues"
SSM = f"{SSP}ParameterMapping"

Entry = tuple[str, str, str, str | None]  # name, type and value of a parameter, and its unit of measurement


def xml_bytes(root: ElementTree.Element) -> bytes:
    """A document as files hold it, a line an element."""
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'.encode()


def parameter_set(name: str, entries: Iterable[Entry], version: str = "1.0") -> bytes:
    """A parameter set (SSV) of SSP 1.0 or 2.0, which differ in the attribute alone."""
    root = ElementTree.Element(
        "ssv:ParameterSet",
        {"xmlns:ssv": SSV, "xmlns:ssc": SSC, "version": version, "name": name, "generationTool": "flexbeams"},
    )
    table, used = ElementTree.SubElement(root, "ssv:Parameters"), set()
    for parameter_name, kind, value, unit in entries:
        parameter = ElementTree.SubElement(table, "ssv:Parameter", name=parameter_name)
        ElementTree.SubElement(parameter, f"ssv:{kind}", {"value": value, **unit_attribute(unit)})
        used.add(unit)
    add_units(root, used, "ssv:Units")
    return xml_bytes(root)


def unit_attribute(unit: str | None) -> dict[str, str]:
    """The attribute of a connector or parameter; none for a unit that is not defined here."""
    return {"unit": unit} if unit is not None and unit in SI_UNITS else {}


def add_units(root: ElementTree.Element, used: Iterable[str | None], tag: str) -> None:
    """Definitions of the units that are used and known here."""
    wanted = set(used)
    if known := [name for name in SI_UNITS if name in wanted]:
        units = ElementTree.SubElement(root, tag)
        for name in known:
            unit = ElementTree.SubElement(units, "ssc:Unit", name=name)
            ElementTree.SubElement(unit, "ssc:BaseUnit", {b: str(power) for b, power in SI_UNITS[name].items()})
