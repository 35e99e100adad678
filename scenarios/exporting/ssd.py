"""SystemStructure.ssd of an exported scenario: components, connectors, connections, diagram, how to step it."""

from typing import Any
from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import SSC, SSD, SSV, add_units, unit_attribute, xml_bytes
from flexbeams.fmus.units.signal_source import SIGNAL_SOURCE
from flexbeams.scenarios.definition.choices import SspVersion
from flexbeams.scenarios.exporting.bundle import ExportBundle, parameters_of
from flexbeams.scenarios.exporting.diagram import Diagram, arrange

OSP_ANNOTATIONS = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS_ANNOTATIONS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OWN_ANNOTATIONS = "urn:flexbeams:ssp"

Ports = dict[str, tuple[list[Any], list[Any]]]  # inputs and outputs by component


def structure_document(bundle: ExportBundle, version: SspVersion = "1.0") -> bytes:
    """SystemStructure.ssd. SSP 2.0 has the namespaces of 1.0: the versions differ in the attribute alone."""
    root = ElementTree.Element(
        "ssd:SystemStructureDescription",
        {
            "xmlns:ssd": SSD,
            "xmlns:ssc": SSC,
            "xmlns:ssv": SSV,
            "xmlns:osp": OSP_ANNOTATIONS,
            "xmlns:oms": OMS_ANNOTATIONS,
            "xmlns:flexbeams": OWN_ANNOTATIONS,
            "version": version,
            "name": bundle.name,
            "description": bundle.description,
            "generationTool": "flexbeams",
        },
    )
    system = ElementTree.SubElement(root, "ssd:System", name=bundle.name, description=bundle.description)
    ports: Ports = {n: (_connectors(unit, "input"), _connectors(unit, "output")) for n, unit in bundle.units.items()}
    diagram = _diagram(bundle, ports)
    elements = ElementTree.SubElement(system, "ssd:Elements")
    for name in bundle.units:
        _add_component(elements, bundle, name, ports, diagram)
    if bundle.links:
        _add_connections(system, bundle, diagram)
    _add_oms_master(system, bundle.step)
    add_units(root, {v.unit for both in ports.values() for part in both for v in part}, "ssd:Units")
    _add_experiment(root, bundle)
    return xml_bytes(root)


def fmu_path(bundle: ExportBundle, component: str) -> str:
    """Path of a component's FMU in the package."""
    return f"resources/{bundle.files[component].name}"


def parameter_set_path(component: str) -> str:
    """Path of a component's parameter set in the package."""
    return f"resources/{component}.ssv"


def _connectors(unit: Any, causality: str) -> list[Any]:
    """Real variables only: tools agree on no other type."""
    return [v for v in unit.modelVariables if v.causality == causality and v.type == "Real"]


def _diagram(bundle: ExportBundle, ports: Ports) -> Diagram:
    """The source of signals on the left, then the units in the order in which they step."""
    first = [name for name, unit in bundle.units.items() if unit.modelName == SIGNAL_SOURCE.name]
    names = {
        name: ([v.name for v in ports[name][0]], [v.name for v in ports[name][1]])
        for name in dict.fromkeys([*first, *bundle.units])
    }
    return arrange(names, bundle.links)


def _add_component(
    elements: ElementTree.Element, bundle: ExportBundle, name: str, ports: Ports, diagram: Diagram
) -> None:
    """A component; without annotations, which OMSimulator 2 refuses there."""
    unit, block, (inputs, outputs) = bundle.units[name], diagram.blocks[name], ports[name]
    component = ElementTree.SubElement(
        elements,
        "ssd:Component",
        name=name,
        type="application/x-fmu-sharedlibrary",
        source=fmu_path(bundle, name),
        implementation="CoSimulation",
        **({"description": unit.description} if unit.description else {}),
    )
    if inputs or outputs:
        connectors = ElementTree.SubElement(component, "ssd:Connectors")
        for variable in (*inputs, *outputs):
            connector = ElementTree.SubElement(connectors, "ssd:Connector", name=variable.name, kind=variable.causality)
            ElementTree.SubElement(connector, "ssc:Real", unit_attribute(variable.unit))
            x, y = block.connectors[variable.name]
            ElementTree.SubElement(connector, "ssd:ConnectorGeometry", x=repr(x), y=f"{y:.6g}")
    corners = dict(zip(("x1", "y1", "x2", "y2"), map(repr, block.corners), strict=True))
    ElementTree.SubElement(component, "ssd:ElementGeometry", corners)
    if parameters_of(unit):
        bindings = ElementTree.SubElement(component, "ssd:ParameterBindings")
        ElementTree.SubElement(
            bindings, "ssd:ParameterBinding", type="application/x-ssp-parameter-set", source=parameter_set_path(name)
        )


def _add_connections(system: ElementTree.Element, bundle: ExportBundle, diagram: Diagram) -> None:
    connections = ElementTree.SubElement(system, "ssd:Connections")
    for link in bundle.links:
        connection = ElementTree.SubElement(
            connections,
            "ssd:Connection",
            startElement=link.start,
            startConnector=link.output,
            endElement=link.end,
            endConnector=link.input,
        )
        if points := diagram.routes.get(link):
            ElementTree.SubElement(
                connection,
                "ssd:ConnectionGeometry",
                pointsX=" ".join(f"{x:.6g}" for x, _ in points),
                pointsY=" ".join(f"{y:.6g}" for _, y in points),
            )


def _add_oms_master(system: ElementTree.Element, step: float) -> None:
    """The step for OMSimulator: version 2 reads FixedStepMaster, version 3 the attributes around it."""
    master = _annotated(system, "org.openmodelica", "oms:Annotations")
    information = ElementTree.SubElement(
        master, "oms:SimulationInformation", name="oms_ma_default", method="oms_ma", fixedStepSize=repr(step)
    )
    ElementTree.SubElement(
        information,
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=repr(step),
        absoluteTolerance="0.0001",
        relativeTolerance="0.0001",
    )


def _add_experiment(root: ElementTree.Element, bundle: ExportBundle) -> None:
    """Start and stop time; the step for tools of the Open Simulation Platform and for this project's runner."""
    experiment = ElementTree.SubElement(
        root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(float(bundle.stop_time))
    )
    algorithm = _annotated(experiment, "com.opensimulationplatform", "osp:Algorithm")
    ElementTree.SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=repr(bundle.step))
    own = _annotated(experiment, "flexbeams", "flexbeams:Run")
    own.attrib.update(stepSize=repr(bundle.step), coupling=bundle.coupling)


def _annotated(parent: ElementTree.Element, kind: str, tag: str) -> ElementTree.Element:
    annotations = parent.find("ssd:Annotations")
    if annotations is None:
        annotations = ElementTree.SubElement(parent, "ssd:Annotations")
    return ElementTree.SubElement(ElementTree.SubElement(annotations, "ssc:Annotation", type=kind), tag)
