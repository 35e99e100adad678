"""A scenario as an SSP 1.0 package that needs nothing else: units, connections, signals, start values, placement."""

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from fmus.build import native_unit
from fmus.errors import InterfaceError
from fmus.native_backend import NativeUnit, build_native_units
from fmus.signal_source import signal_source, source_data
from fmus.units import BASE_UNITS
from plant.archive import write_whole, zip_bytes
from plant.errors import InputError
from scenarios.diagram import Diagram, arrange
from scenarios.documents import SSC, SSD, SSV
from scenarios.draft import Draft, draft_run
from scenarios.extraction import unit_description
from scenarios.run import prepare
from scenarios.schema import Scenario, find_scenario, first_comment
from scenarios.settings import Settings
from scenarios.source_signals import source_signals

OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OWN = "urn:flexbeams:ssp"
SOURCE = "source"   # name of the unit that gives the external signals, with _ behind it where an instance has it


@dataclass(frozen=True, kw_only=True)
class Package:
    """What a SystemStructure.ssd is written from; units by component, in the order in which they step."""

    name: str
    about: str
    units: dict[str, Any]                              # FMPy's descriptions
    files: dict[str, str]                              # path of the FMU in the package
    connections: list[tuple[str, str, str, str]]       # component, output, component, input
    stop_time: float                                   # s
    step: float                                        # s
    coupling: str


def export_ssp(name: str, out: Path, settings: Settings, platforms: Sequence[str] = ("host",),
               report: Callable[[str], None] = lambda text: None) -> Path:
    """Writes a scenario as FILE.ssp; errors as of a run, and BuildError where units cannot be compiled.

    Equal arguments give equal bytes.
    """
    path = find_scenario(name)
    scenario, design = prepare(path, settings)
    scenario, draft = draft_run(path, scenario, design, settings, lambda text: None)
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as temporary:
        folder = Path(temporary)
        units, files = [], {}
        for instance, declared in scenario.instance.items():
            files[instance] = folder / f"{_file_name(scenario, instance)}.fmu"
            if declared.unit is None:
                files[instance].write_bytes(_given(path, instance, str(declared.fmu), draft).read_bytes())
                continue
            units.append(native_unit(declared.unit, design, draft.models[instance], files[instance],
                                     draft.starts[instance]))
        source, driven = _source(path, scenario, draft, folder / "SignalSource.fmu")
        if driven:
            units.append(source)
            files[_source_name(scenario)] = source.out
        report(f"building {', '.join(unit.interface.unit_name for unit in units)}")
        build_native_units(units, platforms, settings.compiler, version=version("flexbeams"))
        package = Package(
            name=path.stem, about=first_comment(path) or scenario.title,
            units={n: unit_description(file, "FMU", str(path)) for n, file in files.items()},
            files={n: f"resources/{file.name}" for n, file in files.items()},
            connections=_connections(draft, driven, _source_name(scenario)), stop_time=scenario.stop_time,
            step=draft.step, coupling=scenario.coupling)
        entries = {f"resources/{file.name}": file.read_bytes() for file in files.values()}
    entries |= package_documents(package)
    write_whole(out, zip_bytes(entries))
    return out


def package_documents(package: Package) -> dict[str, bytes]:
    """SystemStructure.ssd and the parameter set of each component, by path."""
    documents = {"SystemStructure.ssd": structure_document(package)}
    for name, unit in package.units.items():
        if parameters := _parameters(unit):
            documents[_set_path(name)] = _parameter_document(name, parameters)
    return documents


def structure_document(package: Package) -> bytes:
    """SystemStructure.ssd."""
    root = ElementTree.Element("ssd:SystemStructureDescription", {
        "xmlns:ssd": SSD, "xmlns:ssc": SSC, "xmlns:ssv": SSV, "xmlns:osp": OSP, "xmlns:oms": OMS,
        "xmlns:flexbeams": OWN, "version": "1.0", "name": package.name, "description": package.about,
        "generationTool": "flexbeams"})
    system = ElementTree.SubElement(root, "ssd:System", name=package.name, description=package.about)
    ports = {name: (_connectors(unit, "input"), _connectors(unit, "output")) for name, unit in package.units.items()}
    first = [n for n, unit in package.units.items() if unit.modelName == "SignalSource"]
    placed = arrange({name: tuple([v.name for v in part] for part in ports[name])  # type: ignore[misc]
                      for name in dict.fromkeys([*first, *package.units])})
    elements = ElementTree.SubElement(system, "ssd:Elements")
    for name, unit in package.units.items():
        _add_component(elements, package, name, unit, ports[name], placed)
    if package.connections:
        connections = ElementTree.SubElement(system, "ssd:Connections")
        for start, output, end, target in package.connections:
            ElementTree.SubElement(connections, "ssd:Connection", startElement=start, startConnector=output,
                                   endElement=end, endConnector=target)
    ElementTree.SubElement(system, "ssd:SystemGeometry", _corners(placed.corners))
    master = _annotated(system, "org.openmodelica", "oms:Annotations")
    information = ElementTree.SubElement(master, "oms:SimulationInformation")
    ElementTree.SubElement(information, "oms:FixedStepMaster", description="oms-ma", stepSize=repr(package.step),
                           absoluteTolerance="0.0001", relativeTolerance="0.0001")
    _add_units(root, {v.unit for both in ports.values() for part in both for v in part}, "ssd:Units")
    experiment = ElementTree.SubElement(root, "ssd:DefaultExperiment", startTime="0.0",
                                        stopTime=repr(float(package.stop_time)))
    algorithm = _annotated(experiment, "com.opensimulationplatform", "osp:Algorithm")
    ElementTree.SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=repr(package.step))
    own = _annotated(experiment, "flexbeams", "flexbeams:Run")
    own.attrib.update(stepSize=repr(package.step), coupling=package.coupling)
    return _document(root)


def _given(path: Path, instance: str, fmu: str, draft: Draft) -> Path:
    """An FMU that the scenario brings along; start values cannot be built into it."""
    if draft.starts[instance]:
        raise InputError(f"instance.{instance}", "must keep the start values of its FMU in a package: many tools "
                         "ignore parameter sets", ", ".join(draft.starts[instance]), source=str(path))
    return path.parent / fmu


def _file_name(scenario: Scenario, instance: str) -> str:
    """The unit's name; where several are of one unit, or the FMU was brought along, with the instance's."""
    kinds = [i.unit or "FMU" for i in scenario.instance.values()]
    unit = scenario.instance[instance].unit or "FMU"
    return unit if unit != "FMU" and kinds.count(unit) == 1 else f"{unit}_{instance}"


def _source_name(scenario: Scenario) -> str:
    name = SOURCE
    while name in scenario.instance:
        name += "_"
    return name


def _source(path: Path, scenario: Scenario, draft: Draft, out: Path) -> tuple[NativeUnit, dict[str, str]]:
    """The unit of the external signals, and its output by <instance>.<input>."""
    outputs = set(draft.plan.sources.values())
    connected = {f"{n}.{i}" for n, inputs in draft.plan.inputs.items() for i, place in inputs if place in outputs}
    signals, driven = source_signals(scenario, path.parent, {n: i.variables for n, i in draft.instances.items()},
                                     draft.starts, connected)
    try:
        interface = signal_source(signals, draft.step, scenario.stop_time)
    except InterfaceError as error:   # inputs of others whose names cannot be those of outputs
        raise InputError("input", str(error), source=str(path)) from None
    data, meta = source_data(interface, signals)
    return NativeUnit(interface=interface, data=data, meta=meta, out=out), driven


def _connections(draft: Draft, driven: Mapping[str, str], source: str) -> list[tuple[str, str, str, str]]:
    """By component and connector, in the order of the inputs."""
    origins = {place: name for name, place in draft.plan.sources.items()}
    found = []
    for instance, declared in draft.instances.items():
        places = dict(draft.plan.inputs[instance])
        for name in (n for n, v in declared.variables.items() if v.causality == "input"):
            if f"{instance}.{name}" in driven:
                found.append((source, driven[f"{instance}.{name}"], instance, name))
            elif name in places:
                start, _, output = origins[places[name]].partition(".")
                found.append((start, output, instance, name))
    return found


def _connectors(unit: Any, causality: str) -> list[Any]:
    """Real variables only: tools agree on no other type."""
    return [v for v in unit.modelVariables if v.causality == causality and v.type == "Real"]


def _parameters(unit: Any) -> list[Any]:
    return [v for v in unit.modelVariables if v.causality == "parameter" and v.type in ("Real", "Integer", "Boolean")]


def _add_component(elements: ElementTree.Element, package: Package, name: str, unit: Any,
                   ports: tuple[list[Any], list[Any]], placed: Diagram) -> None:
    component = ElementTree.SubElement(elements, "ssd:Component", name=name, type="application/x-fmu-sharedlibrary",
                                       source=package.files[name], implementation="CoSimulation",
                                       **({"description": unit.description} if unit.description else {}))
    block = placed.blocks[name]
    if ports[0] or ports[1]:
        connectors = ElementTree.SubElement(component, "ssd:Connectors")
        for variable in (*ports[0], *ports[1]):
            connector = ElementTree.SubElement(connectors, "ssd:Connector", name=variable.name,
                                               kind=variable.causality)
            ElementTree.SubElement(connector, "ssc:Real", _unit(variable))
            x, y = block.connectors[variable.name]
            ElementTree.SubElement(connector, "ssd:ConnectorGeometry", x=repr(x), y=f"{y:.6g}")
    ElementTree.SubElement(component, "ssd:ElementGeometry", _corners(block.corners))
    if _parameters(unit):
        bindings = ElementTree.SubElement(component, "ssd:ParameterBindings")
        ElementTree.SubElement(bindings, "ssd:ParameterBinding", type="application/x-ssp-parameter-set",
                               source=_set_path(name))


def _set_path(component: str) -> str:
    return f"resources/{component}.ssv"


def _parameter_document(name: str, parameters: list[Any]) -> bytes:
    root = ElementTree.Element("ssv:ParameterSet", {
        "xmlns:ssv": SSV, "xmlns:ssc": SSC, "version": "1.0", "name": name, "generationTool": "flexbeams"})
    table = ElementTree.SubElement(root, "ssv:Parameters")
    for variable in parameters:
        parameter = ElementTree.SubElement(table, "ssv:Parameter", name=variable.name)
        ElementTree.SubElement(parameter, f"ssv:{variable.type}", {"value": variable.start, **_unit(variable)})
    _add_units(root, {v.unit for v in parameters}, "ssv:Units")
    return _document(root)


def _unit(variable: Any) -> dict[str, str]:
    """The attribute of a connector or parameter; none for a unit that is not defined here."""
    return {"unit": variable.unit} if variable.unit in BASE_UNITS else {}


def _add_units(root: ElementTree.Element, used: Iterable[str | None], tag: str) -> None:
    known = [name for name in BASE_UNITS if name in set(used)]
    if known:
        units = ElementTree.SubElement(root, tag)
        for name in known:
            unit = ElementTree.SubElement(units, "ssc:Unit", name=name)
            ElementTree.SubElement(unit, "ssc:BaseUnit", {b: str(power) for b, power in BASE_UNITS[name].items()})


def _annotated(parent: ElementTree.Element, kind: str, tag: str) -> ElementTree.Element:
    annotations = parent.find("ssd:Annotations")
    if annotations is None:
        annotations = ElementTree.SubElement(parent, "ssd:Annotations")
    return ElementTree.SubElement(ElementTree.SubElement(annotations, "ssc:Annotation", type=kind), tag)


def _corners(corners: tuple[float, float, float, float]) -> dict[str, str]:
    return dict(zip(("x1", "y1", "x2", "y2"), map(repr, corners), strict=True))


def _document(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'.encode()
