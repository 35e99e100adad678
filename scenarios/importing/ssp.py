"""SSP packages of FMI 2.0 co-simulation units: one flat system of typed connectors, as all tools read them."""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, get_args

from flexbeams.fmus.documents.xml_documents import SSC, SSD
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.definition.dimensions import Dimension
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.package import Component, Connector, Package, PackageConnection
from flexbeams.scenarios.importing.parameter_bindings import bind_system, bound_parameters
from flexbeams.scenarios.importing.parameter_mappings import boolean, linear_transformation
from flexbeams.scenarios.importing.ssp_documents import NS, STRUCTURE, SspFolder

# Communication steps in annotations: this project's, the Open Simulation Platform's, OMSimulator's
_STEPS = (
    ("Run", "stepSize"),
    ("FixedStepAlgorithm", "baseStepSize"),
    ("FixedStepMaster", "stepSize"),
    ("SimulationInformation", "fixedStepSize"),
)
_UNSUPPORTED = {
    "ssd:Elements/ssd:System": "nested systems",
    "ssd:Connectors": "connectors of the system",
    "ssd:Elements/ssd:SignalDictionaryReference": "signal dictionaries",
    "ssd:SignalDictionaries": "signal dictionaries",
}


def open_package(file: Path, folder: Path, budget: ExtractionBudget) -> Package:
    """The package, extracted to `folder`; InputError in one line for an unsound package or an unsupported feature."""
    if not file.is_file():
        raise InputError("", "must be a file", source=str(file))
    budget.extract(file, folder)
    package = SspFolder(folder, str(file))
    return _package(package.document(STRUCTURE, SSD), package)


def _package(root: Any, package: SspFolder) -> Package:
    system = root.find("ssd:System", NS)
    for path, feature in _UNSUPPORTED.items():
        element = system.find(path, NS)
        if element is not None and (element.get("name") or len(element)):
            raise package.error("", f"{feature} are not supported", element.get("name"))
    components: dict[str, Component] = {}
    for element in system.iterfind("ssd:Elements/ssd:Component", NS):
        component = _component(element, package)
        if component.name in components:
            raise package.error("Component", "must have a name of its own", component.name)
        components[component.name] = component
    if not components:
        raise package.error("System", "must hold a component", system.get("name"))
    notes = bind_system(system, components, package)
    experiment = root.find("ssd:DefaultExperiment", NS)
    return Package(
        name=root.get("name"),
        description=system.get("description") or root.get("description") or "",
        components=components,
        connections=_connections(system, components, package),
        units={
            u.get("name"): Dimension.of_base(u.find("ssc:BaseUnit", NS).attrib)
            for u in root.iterfind("ssd:Units/ssc:Unit", NS)
        },
        notes=notes,
        tool=root.get("generationTool") or "",
        start_time=_time(experiment, "startTime", package) or 0.0,
        stop_time=_time(experiment, "stopTime", package),
        step=_step(root),
        coupling=_coupling(root),
    )


def _time(experiment: Any, attribute: str, package: SspFolder) -> float | None:
    """A time of the default experiment, s; None where it is not given."""
    text = None if experiment is None else experiment.get(attribute)
    if text is None:
        return None
    if not isfinite(time := float(text)):
        raise package.error(f"DefaultExperiment {attribute}", "must be finite", text)
    return time


def _component(element: Any, package: SspFolder) -> Component:
    name = element.get("name")
    if not name or not name.isprintable():
        raise package.error("Component", "must have a name of printable characters", name)
    kind = element.get("type", "application/x-fmu-sharedlibrary")
    if kind != "application/x-fmu-sharedlibrary" or element.get("implementation") == "ModelExchange":
        raise package.error(
            f"Component {name}",
            "must be an FMU for co-simulation",
            element.get("implementation") if kind.endswith("sharedlibrary") else kind,
        )
    connectors: dict[str, Connector] = {}
    for c in element.iterfind("ssd:Connectors/ssd:Connector", NS):
        typed = next((t for t in c if t.tag.startswith(f"{{{SSC}}}")), None)
        connector = Connector(
            name=c.get("name"),
            kind=c.get("kind"),
            type="" if typed is None else typed.tag.rpartition("}")[2],
            unit="" if typed is None else typed.get("unit") or "",
        )
        if connector.name in connectors:
            raise package.error(f"Component {name}", "must have each connector once", connector.name)
        connectors[connector.name] = connector
    return Component(
        name=name,
        connectors=connectors,
        parameters=bound_parameters(element, package),
        fmu=package.file(element.get("source"), f"Component {name} source"),
    )


def _connections(system: Any, components: Mapping[str, Component], package: SspFolder) -> list[PackageConnection]:
    connections: list[PackageConnection] = []
    driven: set[tuple[str, str]] = set()
    for c in system.iterfind("ssd:Connections/ssd:Connection", NS):
        factor, offset = linear_transformation(c, "Connection", c.get("endConnector"), package)
        ends = [(c.get(f"{e}Element"), c.get(f"{e}Connector")) for e in ("start", "end")]
        for owner, name in ends:
            if owner not in components or name not in components[owner].connectors:
                text = f"{owner}.{name}" if owner else name
                raise package.error("Connection", "must join connectors of components", text)
        kinds = [components[owner].connectors[name].kind for owner, name in ends]
        if kinds == ["input", "output"]:
            ends.reverse()
        elif kinds != ["output", "input"]:
            text = ", ".join(f"{owner}.{name}" for owner, name in ends)
            raise package.error("Connection", "must join an output and an input", text)
        if ends[1] in driven:
            raise package.error("Connection", "must not drive an input that is driven already", ".".join(ends[1]))
        driven.add(ends[1])
        converted = not boolean(c.get("suppressUnitConversion"))
        connections.append(
            PackageConnection(start=ends[0], end=ends[1], converted=converted, factor=factor, offset=offset)
        )
    return connections


def _step(root: Any) -> float | None:
    """The first communication step that an annotation gives, s."""
    for tag, attribute in _STEPS:
        for element in root.iterfind(f".//ssc:Annotation//{{*}}{tag}", NS):
            try:
                step = float(element.get(attribute, ""))
            except ValueError:
                continue
            if 0 < step < float("inf"):
                return step
    return None


def _coupling(root: Any) -> Coupling | None:
    for element in root.iterfind(".//ssc:Annotation[@type='flexbeams']//{*}Run", NS):
        if (coupling := element.get("coupling")) in get_args(Coupling):
            return coupling  # type: ignore[no-any-return]
    return None
