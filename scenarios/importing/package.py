"""Content of an SSP package: components with connectors and start values, and the connections between them."""

from dataclasses import dataclass, field
from pathlib import Path

from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.definition.dimensions import Dimension


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
    converted: bool = True  # between units of measurement that differ
    factor: float = 1.0  # of a mapping's transformation, after that conversion
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Component:
    """A unit with its FMU."""

    name: str
    fmu: Path
    connectors: dict[str, Connector]
    parameters: list[Parameter]


@dataclass(frozen=True, kw_only=True)
class PackageConnection:
    """A connection from an output to an input."""

    start: tuple[str, str]  # component and connector
    end: tuple[str, str]
    converted: bool = True  # between units of measurement that differ
    factor: float = 1.0  # of a transformation, after that conversion
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Package:
    """A system as SystemStructure.ssd describes it; None where it is silent."""

    name: str
    description: str
    components: dict[str, Component]
    connections: list[PackageConnection]
    units: dict[str, Dimension] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)  # on what is ignored, one line each
    tool: str = ""  # that wrote the package
    start_time: float = 0.0  # s
    stop_time: float | None = None  # s
    step: float | None = None  # s
    coupling: Coupling | None = None


def is_package(name: str) -> bool:
    """Whether a name is that of an SSP rather than of a scenario."""
    return name.lower().endswith(".ssp")
