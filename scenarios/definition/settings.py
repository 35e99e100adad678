"""What the command line changes of a scenario."""

from dataclasses import dataclass, field
from pathlib import Path

from flexbeams.fmus.packaging.build import Backend
from flexbeams.plant.galerkin import BasisName
from flexbeams.scenarios.definition.schema import Coupling, Value

BUILD_FOLDER = Path("build/fmus")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the command line changes of a scenario; None keeps what the scenario says."""

    backend: Backend = "native"
    compiler: str = "zig"
    real_time_factor: float | None = None  # simulated seconds a second of the wall clock; None: as fast as it goes
    coupling: Coupling | None = None
    basis: BasisName | None = None
    structure: str | None = None
    stop_time: float | None = None
    step: float | None = None  # s, between communication points
    overrides: dict[str, Value] = field(default_factory=dict)  # <instance>.<variable>, or array, to value
    decimate: int = 1  # every which step is recorded
    build_folder: Path = BUILD_FOLDER
    record_animation: bool = True  # shapes for the animation are recorded
