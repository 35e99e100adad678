"""A scenario as an SSP 1.0 package that needs nothing else: units, connections, signals, start values, placement."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import SSC, SSD, SSV, add_units, parameter_set, unit_attribute, xml_bytes
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.bundle import Bundle, build_bundle, parameters_of
from flexbeams.scenarios.exporting.diagram import Diagram, arrange

OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OWN = "urn:flexbeams:ssp"


def export_ssp(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    report: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes a scenario as FILE.ssp; errors as of `build_bundle`. Equal arguments give equal bytes."""
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as folder:
        bundle = build_bundle(name, Path(folder), settings, platforms, report)
        entries = {_fmu_path(file): file.read_bytes() for file in bundle.files.values()}
    write_whole(out, zip_bytes(entries | package_documents(bundle)))
    return out


def package_documents(bundle: Bundle) -> dict[str, bytes]:
    """SystemStructure.ssd and the parameter set of each component, by path."""
    documents = {"SystemStructure.ssd": structure_document(bundle)}
    for name, unit in bundle.units.items():
        if parameters := parameters_of(unit):
            documents[_set_path(name)] = parameter_set(name, [(v.name, v.type, v.start, v.unit) for v in parameters])
    return documents


def structure_document(bundle: Bundle) -> bytes:
    """SystemStructure.ssd."""
    root = ElementTree.Element(
        "ssd:SystemStructureDescription",
        {
            "xmlns:ssd": SSD,
            "xmlns:ssc": SSC,
            "xmlns:ssv": SSV,
            "xmlns:osp": OSP,
            "xmlns:oms": OMS,
            "xmlns:flexbeams": OWN,
            "version": "1.0",
            "name": bundle.name,
            "description": bundle.about,
            "generationTool": "flexbeams",
        },
    )
    system = ElementTree.SubElement(root, "ssd:System", name=bundle.name, description=bundle.about)
    ports = {name: (_connectors(unit, "input"), _connectors(unit, "output")) for name, unit in bundle.units.items()}
    first = [n for n, unit in bundle.units.items() if unit.modelName == "SignalSource"]
    placed = arrange(
        {
            name: ([v.name for v in ports[name][0]], [v.name for v in ports[name][1]])
            for name in dict.fromkeys([*first, *bundle.units])
        },
        bundle.connections,
    )
    elements = ElementTree.SubElement(system, "ssd:Elements")
    for name, unit in bundle.units.items():
        _add_component(elements, bundle, name, unit, ports[name], placed)
    if bundle.connections:
        connections = ElementTree.SubElement(system, "ssd:Connections")
        for wire in bundle.connections:
            connection = ElementTree.SubElement(
                connections,
                "ssd:Connection",
                startElement=wire[0],
                startConnector=wire[1],
                endElement=wire[2],
                endConnector=wire[3],
            )
            if points := placed.ways.get(wire):
                ElementTree.SubElement(
                    connection,
                    "ssd:ConnectionGeometry",
                    pointsX=" ".join(f"{x:.6g}" for x, _ in points),
                    pointsY=" ".join(f"{y:.6g}" for _, y in points),
                )
    ElementTree.SubElement(system, "ssd:SystemGeometry", _corners(placed.corners))
    master = _annotated(system, "org.openmodelica", "oms:Annotations")
    information = ElementTree.SubElement(master, "oms:SimulationInformation")
    ElementTree.SubElement(
        information,
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=repr(bundle.step),
        absoluteTolerance="0.0001",
        relativeTolerance="0.0001",
    )
    add_units(root, {v.unit for both in ports.values() for part in both for v in part}, "ssd:Units")
    experiment = ElementTree.SubElement(
        root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(float(bundle.stop_time))
    )
    algorithm = _annotated(experiment, "com.opensimulationplatform", "osp:Algorithm")
    ElementTree.SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=repr(bundle.step))
    own = _annotated(experiment, "flexbeams", "flexbeams:Run")
    own.attrib.update(stepSize=repr(bundle.step), coupling=bundle.coupling)
    return xml_bytes(root)


def _connectors(unit: Any, causality: str) -> list[Any]:
    """Real variables only: tools agree on no other type."""
    return [v for v in unit.modelVariables if v.causality == causality and v.type == "Real"]


def _add_component(
    elements: ElementTree.Element,
    bundle: Bundle,
    name: str,
    unit: Any,
    ports: tuple[list[Any], list[Any]],
    placed: Diagram,
) -> None:
    component = ElementTree.SubElement(
        elements,
        "ssd:Component",
        name=name,
        type="application/x-fmu-sharedlibrary",
        source=_fmu_path(bundle.files[name]),
        implementation="CoSimulation",
        **({"description": unit.description} if unit.description else {}),
    )
    block = placed.blocks[name]
    if ports[0] or ports[1]:
        connectors = ElementTree.SubElement(component, "ssd:Connectors")
        for variable in (*ports[0], *ports[1]):
            connector = ElementTree.SubElement(connectors, "ssd:Connector", name=variable.name, kind=variable.causality)
            ElementTree.SubElement(connector, "ssc:Real", unit_attribute(variable.unit))
            x, y = block.connectors[variable.name]
            ElementTree.SubElement(connector, "ssd:ConnectorGeometry", x=repr(x), y=f"{y:.6g}")
    ElementTree.SubElement(component, "ssd:ElementGeometry", _corners(block.corners))
    if parameters_of(unit):
        bindings = ElementTree.SubElement(component, "ssd:ParameterBindings")
        ElementTree.SubElement(
            bindings, "ssd:ParameterBinding", type="application/x-ssp-parameter-set", source=_set_path(name)
        )


def _fmu_path(file: Path) -> str:
    return f"resources/{file.name}"


def _set_path(component: str) -> str:
    return f"resources/{component}.ssv"


def _annotated(parent: ElementTree.Element, kind: str, tag: str) -> ElementTree.Element:
    annotations = parent.find("ssd:Annotations")
    if annotations is None:
        annotations = ElementTree.SubElement(parent, "ssd:Annotations")
    return ElementTree.SubElement(ElementTree.SubElement(annotations, "ssc:Annotation", type=kind), tag)


def _corners(corners: tuple[float, float, float, float]) -> dict[str, str]:
    return dict(zip(("x1", "y1", "x2", "y2"), map(repr, corners), strict=True))
