"""A scenario as the Open Simulation Platform configures it: OspSystemStructure.xml with the FMUs beside it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import xml_bytes
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.bundle import ExportBundle, build_bundle, parameters_of
from flexbeams.scenarios.importing.osp import OSP_STRUCTURE

FILE = "OspSystemStructure.xml"


def export_osp(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
    *,
    flags_as_real: bool = False,
) -> Path:
    """Writes a scenario into a folder, or into FILE.zip; raises the same errors as `build_bundle`.

    Equal arguments give equal bytes. OSP's tools read the folder; the archive is to be extracted first.
    """
    archived = out.suffix.lower() == ".zip"
    if out.exists() and out.is_dir() == archived:
        raise InputError("--out", "must be a folder, or FILE.zip", str(out))
    with temporary_folder() as folder:
        bundle = build_bundle(name, folder, settings, platforms, notify, flags_as_real=flags_as_real)
        entries = {file.name: file.read_bytes() for file in bundle.files.values()}
    entries[FILE] = system_document(bundle)
    if archived:
        write_whole(out, zip_bytes(entries))
    else:
        for path, content in entries.items():
            write_whole(out / path, content)
    return out


def system_document(bundle: ExportBundle) -> bytes:
    """OspSystemStructure.xml."""
    root = ElementTree.Element("OspSystemStructure", xmlns=OSP_STRUCTURE, version="0.1")
    for key, value in (
        ("StartTime", "0.0"),
        ("EndTime", repr(float(bundle.stop_time))),
        ("BaseStepSize", repr(bundle.step)),
        ("Algorithm", "fixedStep"),
    ):
        ElementTree.SubElement(root, key).text = value
    simulators = ElementTree.SubElement(root, "Simulators")
    for name, unit in bundle.units.items():
        simulator = ElementTree.SubElement(simulators, "Simulator", name=name, source=bundle.files[name].name)
        _add_values(simulator, parameters_of(unit))
    if bundle.links:
        connections = ElementTree.SubElement(root, "Connections")
        for link in bundle.links:
            connection = ElementTree.SubElement(connections, "VariableConnection")
            ElementTree.SubElement(connection, "Variable", simulator=link.start, name=link.output)
            ElementTree.SubElement(connection, "Variable", simulator=link.end, name=link.input)
    return xml_bytes(root)


def _add_values(simulator: ElementTree.Element, parameters: list[Any]) -> None:
    """The units' own start values, for the user to edit."""
    if parameters:
        values = ElementTree.SubElement(simulator, "InitialValues")
        for variable in parameters:
            value = ElementTree.SubElement(values, "InitialValue", variable=variable.name)
            ElementTree.SubElement(value, variable.type, value=variable.start)
