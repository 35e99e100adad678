"""terminalsAndIcons.xml: each array of Real inputs or outputs as one terminal, which tools can connect in one piece.

FMI 2.0.4 takes this file over from FMI 3.0, section 2.4.9, with its schema and version.
"""

from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import xml_bytes
from flexbeams.fmus.interface.variables import Interface

PATH = "terminalsAndIcons/terminalsAndIcons.xml"


def terminals_document(interface: Interface) -> bytes | None:
    """The file; None for a unit without arrays of inputs and outputs.

    Members are named by their index, so that arrays of one size fit each other whatever their names are.
    """
    arrays = {
        name: [interface.variables[k] for k in span]
        for name, span in interface.arrays.items()
        if interface.variables[span.start].causality in ("input", "output")
        and interface.variables[span.start].type == "Real"
        and interface.variables[span.start].name != name
    }
    if not arrays:
        return None
    root = ElementTree.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    terminals = ElementTree.SubElement(root, "Terminals")
    for name, variables in arrays.items():
        terminal = ElementTree.SubElement(terminals, "Terminal", name=name, matchingRule="plug")
        for v in variables:
            index = v.name[v.name.rindex("[") + 1 : -1]
            ElementTree.SubElement(
                terminal, "TerminalMemberVariable", variableName=v.name, memberName=index, variableKind="signal"
            )
    return xml_bytes(root)
