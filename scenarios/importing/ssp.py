"""SSP 1.0 packages of FMI 2.0 co-simulation units: one flat system of typed connectors, as all tools read them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, get_args
from urllib.parse import unquote, urlsplit

from flexbeams.fmus.documents.xml_documents import SSC, SSD, SSV
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.schema import Coupling
from flexbeams.scenarios.importing.archives import Allowance
from flexbeams.scenarios.importing.documents import detached, read_document, schema_problems

STRUCTURE = "SystemStructure.ssd"
TYPES = ("Real", "Integer", "Boolean", "String")  # that a parameter set may give
_STEPS = (("Run", "stepSize"), ("FixedStepAlgorithm", "baseStepSize"), ("FixedStepMaster", "stepSize"))
_NS = {"ssd": SSD, "ssc": SSC, "ssv": SSV}


@dataclass(frozen=True, kw_only=True)
class Connector:
    """A variable of a component as the package declares it; type and unit are empty where it leaves them open."""

    name: str
    kind: str
    type: str = ""
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A start value."""

    name: str
    type: str
    value: str
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Component:
    """A unit with its FMU."""

    name: str
    fmu: Path
    connectors: dict[str, Connector]
    parameters: list[Parameter]


@dataclass(frozen=True, kw_only=True)
class Wire:
    """A connection from an output to an input."""

    start: tuple[str, str]  # component and connector
    end: tuple[str, str]
    converted: bool = True  # units that differ would be converted


@dataclass(frozen=True, kw_only=True)
class Package:
    """What a SystemStructure.ssd says; None where it is silent."""

    name: str
    about: str
    components: dict[str, Component]
    wires: list[Wire]
    units: dict[str, tuple[float, ...]] = field(default_factory=dict)  # exponents of SI's base units, factor, offset
    stop_time: float | None = None  # s
    step: float | None = None  # s
    coupling: Coupling | None = None


def is_package(name: str) -> bool:
    """Is this the name of an SSP rather than of a scenario?"""
    return name.lower().endswith(".ssp")


def open_package(file: Path, folder: Path, allowance: Allowance) -> Package:
    """The package, extracted to `folder`; InputError in one line for what is unsound or not supported."""
    if not file.is_file():
        raise InputError("", "must be a file", source=str(file))
    allowance.extract(file, folder)
    root = _document(folder, STRUCTURE, SSD, str(file))
    return _Reader(folder, str(file)).package(root)


def _document(folder: Path, where: str, namespace: str, source: str) -> Any:
    path = folder / where
    if not path.is_file():
        raise InputError(where, "must be in the package", source=source)
    try:
        root = read_document(path.read_bytes(), where)
    except InputError as error:
        raise InputError("", str(error), source=source) from None
    _require_version(root, where, source)
    _require_valid(root, namespace, where, source)
    return root


def _require_version(root: Any, where: str, source: str) -> None:
    if root.get("version", "1.0") != "1.0":
        raise InputError(where, "must be of SSP 1.0, its version", root.get("version"), source=source)


def _require_valid(root: Any, namespace: str, where: str, source: str) -> None:
    if problems := schema_problems(root, namespace):
        raise InputError(where, f"must be valid by the schema of SSP 1.0: {problems[0]}", source=source)


class _Reader:
    """Reads a document that is valid by its schema; `folder` is where the package is extracted."""

    def __init__(self, folder: Path, source: str) -> None:
        self._folder, self._source = folder, source

    def package(self, root: Any) -> Package:
        system = root.find("ssd:System", _NS)
        self._refuse(system, "ssd:Elements/ssd:System", "nested systems")
        self._refuse(system, "ssd:Connectors", "connectors of the system")
        self._refuse(system, "ssd:Elements/ssd:SignalDictionaryReference", "signal dictionaries")
        self._refuse(system, "ssd:SignalDictionaries", "signal dictionaries")
        components: dict[str, Component] = {}
        for element in system.iterfind("ssd:Elements/ssd:Component", _NS):
            component = self._component(element)
            if component.name in components:
                raise self._error("Component", "must have a name of its own", component.name)
            components[component.name] = component
        if not components:
            raise self._error("System", "must hold a component", system.get("name"))
        self._bind_system(system, components)
        units = {
            u.get("name"): _dimension(u.find("ssc:BaseUnit", _NS).attrib)
            for u in root.iterfind("ssd:Units/ssc:Unit", _NS)
        }
        experiment = root.find("ssd:DefaultExperiment", _NS)
        if experiment is not None and float(experiment.get("startTime", 0)) != 0:
            raise self._error("DefaultExperiment startTime", "must be 0", experiment.get("startTime"))
        stop = None if experiment is None else experiment.get("stopTime")
        return Package(
            name=root.get("name"),
            about=system.get("description") or root.get("description") or "",
            components=components,
            wires=self._wires(system, components),
            units=units,
            stop_time=None if stop is None else float(stop),
            step=_step(root),
            coupling=_coupling(root),
        )

    def _error(self, key: str, rule: str, value: object = None) -> InputError:
        return InputError(key, rule, value, source=f"{self._source}: {STRUCTURE}")

    def _refuse(self, element: Any, path: str, what: str) -> None:
        found = element.find(path, _NS)
        if found is not None and (found.get("name") or len(found)):
            raise self._error("", f"{what} are not supported", found.get("name"))

    def _component(self, element: Any) -> Component:
        name = element.get("name")
        if not re.fullmatch(r"\w+", name):
            raise self._error("Component", "must have a name of letters, digits and underscores", name)
        kind = element.get("type", "application/x-fmu-sharedlibrary")
        if kind != "application/x-fmu-sharedlibrary" or element.get("implementation") == "ModelExchange":
            raise self._error(
                f"Component {name}",
                "must be an FMU for co-simulation",
                element.get("implementation") if kind.endswith("sharedlibrary") else kind,
            )
        connectors: dict[str, Connector] = {}
        for c in element.iterfind("ssd:Connectors/ssd:Connector", _NS):
            typed = next((t for t in c if t.tag.startswith(f"{{{SSC}}}")), None)
            connector = Connector(
                name=c.get("name"),
                kind=c.get("kind"),
                type="" if typed is None else typed.tag.rpartition("}")[2],
                unit="" if typed is None else typed.get("unit") or "",
            )
            if connector.name in connectors:
                raise self._error(f"Component {name}", "must have each connector once", connector.name)
            connectors[connector.name] = connector
        return Component(
            name=name,
            connectors=connectors,
            parameters=self._bindings(element),
            fmu=self._file(element.get("source"), f"Component {name} source"),
        )

    def _file(self, uri: str, key: str) -> Path:
        """A file of the package; nothing else is opened."""
        parts = urlsplit(uri)
        where = PurePosixPath(unquote(parts.path))
        inside = not (
            parts.scheme
            or parts.netloc
            or where.is_absolute()
            or ".." in where.parts
            or "\\" in str(where)
            or "\0" in str(where)
        )
        path = self._folder.joinpath(*where.parts) if inside else self._folder
        if not inside or not path.resolve().is_relative_to(self._folder.resolve()):
            raise self._error(key, "must be a path inside the package", uri)
        if not path.is_file():
            raise self._error(key, "must be a file in the package", uri)
        return path

    def _bindings(self, element: Any) -> list[Parameter]:
        """Parameters of all bindings of a component or system, those of later ones last."""
        found: list[Parameter] = []
        for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", _NS):
            owner = element.get("name")
            if binding.find("ssd:ParameterMapping", _NS) is not None:
                raise self._error(owner, "parameter mappings are not supported")
            if (
                binding.get("type", "application/x-ssp-parameter-set") != "application/x-ssp-parameter-set"
                or binding.get("sourceBase", "SSD") != "SSD"
            ):
                raise self._error(owner, "must be bound to parameter sets of the package", binding.get("type"))
            if (uri := binding.get("source")) is not None:
                path = self._file(uri, f"{owner} ParameterBinding source")
                where = str(path.relative_to(self._folder))
                found += self._parameters(_document(self._folder, where, SSV, self._source), where, binding)
            values = binding.find("ssd:ParameterValues", _NS)
            for table in () if values is None else values:
                if table.tag != f"{{{SSV}}}ParameterSet":
                    raise self._error(owner, "must have a ParameterSet as ParameterValues", table.tag)
                _require_version(table, STRUCTURE, self._source)
                _require_valid(detached(table), SSV, STRUCTURE, self._source)
                found += self._parameters(table, STRUCTURE, binding)
        return found

    def _parameters(self, table: Any, where: str, binding: Any) -> list[Parameter]:
        found: dict[str, Parameter] = {}
        for element in table.iterfind("ssv:Parameters/ssv:Parameter", _NS):
            typed, name = element[0], binding.get("prefix", "") + element.get("name")
            kind = typed.tag.rpartition("}")[2]
            if kind not in TYPES:
                raise InputError(name, f"must be one of {', '.join(TYPES)}", kind, source=f"{self._source}: {where}")
            if name in found:
                raise InputError(name, "must be given once", source=f"{self._source}: {where}")
            found[name] = Parameter(name=name, type=kind, value=typed.get("value"), unit=typed.get("unit") or "")
        return list(found.values())

    def _bind_system(self, system: Any, components: Mapping[str, Component]) -> None:
        """Parameters of the system, named <component>.<variable>, win over the components' own."""
        for parameter in self._bindings(system):
            owner, _, name = parameter.name.partition(".")
            if owner not in components or not name:
                raise self._error(parameter.name, "names no component of the system", owner)
            components[owner].parameters.append(
                Parameter(name=name, type=parameter.type, value=parameter.value, unit=parameter.unit)
            )

    def _wires(self, system: Any, components: Mapping[str, Component]) -> list[Wire]:
        wires: list[Wire] = []
        driven: set[tuple[str, str]] = set()
        for c in system.iterfind("ssd:Connections/ssd:Connection", _NS):
            if any(child.tag.startswith(f"{{{SSC}}}") for child in c):
                raise self._error("Connection", "transformations are not supported", c.get("endConnector"))
            ends = [(c.get(f"{e}Element"), c.get(f"{e}Connector")) for e in ("start", "end")]
            for owner, name in ends:
                if owner not in components or name not in components[owner].connectors:
                    raise self._error(
                        "Connection", "must join connectors of components", f"{owner}.{name}" if owner else name
                    )
            kinds = [components[owner].connectors[name].kind for owner, name in ends]
            if kinds == ["input", "output"]:
                ends.reverse()
            elif kinds != ["output", "input"]:
                raise self._error(
                    "Connection",
                    "must join an output and an input",
                    ", ".join(f"{owner}.{name}" for owner, name in ends),
                )
            if ends[1] in driven:
                raise self._error("Connection", "must not drive an input that is driven already", ".".join(ends[1]))
            driven.add(ends[1])
            suppressed = c.get("suppressUnitConversion", "false") in ("true", "1")
            wires.append(Wire(start=ends[0], end=ends[1], converted=not suppressed))
        return wires


def _dimension(base: Mapping[str, str]) -> tuple[float, ...]:
    """Exponents of SI's base units, then factor and offset."""
    return (
        *(float(base.get(k, 0)) for k in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")),
        float(base.get("factor", 1)),
        float(base.get("offset", 0)),
    )


def _step(root: Any) -> float | None:
    """The communication step of an annotation: this project's, the Open Simulation Platform's, OMSimulator's."""
    for tag, attribute in _STEPS:
        for element in root.iterfind(f".//ssc:Annotation//{{*}}{tag}", _NS):
            try:
                step = float(element.get(attribute, ""))
            except ValueError:
                continue
            if 0 < step < float("inf"):
                return step
    return None


def _coupling(root: Any) -> Coupling | None:
    for element in root.iterfind(".//ssc:Annotation[@type='flexbeams']//{*}Run", _NS):
        if (coupling := element.get("coupling")) in get_args(Coupling):
            return coupling  # type: ignore[no-any-return]
    return None
