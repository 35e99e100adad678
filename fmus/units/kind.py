"""The record of a kind of unit: all that the project knows of it.

Builders, documents, scenarios and exports look everything up in the record, so that a new kind is one record and its
kernels, in this project or outside it.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.errors import BuildError, InterfaceError
from flexbeams.fmus.interface.variables import Interface, Variable
from flexbeams.fmus.references.experiments import Experiment
from flexbeams.fmus.units.native_kernel import NativeKernel, UnitData
from flexbeams.plant.galerkin import BeamModel

STOP_TIME = 6.0  # s, of the default experiment of the units of a design


def no_experiments(design: Design, model: BeamModel) -> Sequence[Experiment]:
    """A unit without reference results."""
    return ()


@dataclass(frozen=True, kw_only=True)
class UnitKind:
    """A kind of unit, with a kernel in C, in Python, or both.

    `interface` declares the variables for a design and the plant's model, of any basis, and `data` gives the numbers
    for the kernels; None for a unit that no design makes. `experiments` are with the design's start values.
    """

    name: str  # modelName and modelIdentifier
    chapter: Chapter  # of the page inside the unit
    interface: Callable[[Design, BeamModel], Interface] | None = None
    data: Callable[[Interface, Design, BeamModel], UnitData] | None = None
    native: NativeKernel | None = None
    python: Path | None = None  # a module with one class derived from fmus.python.slave.Unit
    experiments: Callable[[Design, BeamModel], Sequence[Experiment]] = no_experiments

    # For scenarios, runs and exports; arrays by name
    takes_basis: bool = False  # an instance chooses basis and order of the plant's model
    records_inputs: bool = False  # its inputs are recorded like outputs
    internal_outputs: tuple[str, ...] = ()  # for other units only: not recorded, and hidden once connected in a loop
    animated: tuple[str, str] | None = None  # deflections at stations along the beams, and voltages, for an animation
    reference: tuple[str, str] | None = None  # reduced states and voltages of the shape that an animation compares with
    targets: str = ""  # an input that starts transitions where it changes
    loops: tuple[str, str] | None = None  # input and output that a report draws over each other
    section: str = ""  # of the structure file, without which there is no such unit

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z_]\w*", self.name, re.ASCII):
            raise InterfaceError(f"the name of a unit must be a C identifier, got {self.name!r}")
        if self.native is None and self.python is None:
            raise InterfaceError(f"{self.name}: a unit must have a native kernel, a Python kernel or both")

    def require_native(self) -> NativeKernel:
        """The kernel in C; BuildError where there is none."""
        if self.native is None:
            raise BuildError(f"{self.name}: there is no native unit of this kind")
        return self.native

    def require_python(self) -> Path:
        """The module of the Python kernel; BuildError where there is none."""
        if self.python is None:
            raise BuildError(f"{self.name}: there is no Python unit of this kind")
        return self.python

    def is_made_by(self, design: Design) -> bool:
        """Whether the design's structure has the section that the unit needs."""
        return not self.section or getattr(design.structure, self.section) is not None

    def declare(self, design: Design, model: BeamModel) -> Interface:
        """The interface for a design; InterfaceError where none makes such a unit or the name differs."""
        if self.interface is None:
            raise InterfaceError(f"{self.name}: no design makes a unit of this kind")
        if not self.is_made_by(design):
            raise InterfaceError(f"{self.name}: the structure file must have a section [{self.section}]")
        interface = self.interface(design, model)
        if interface.unit_name != self.name:
            raise InterfaceError(f"{self.name}: unit_name must be that of the kind, got {interface.unit_name!r}")
        return interface

    def contents(self, design: Design, model: BeamModel) -> tuple[Interface, UnitData]:
        """Interface and data for a design; raises the same errors as `declare`."""
        interface = self.declare(design, model)
        return interface, self.data(interface, design, model) if self.data else UnitData()


def with_real_flags(interface: Interface) -> Interface:
    """The interface with Boolean outputs and locals declared as Real, 0 or 1: some hosts read all as Real."""
    return replace(
        interface,
        variables=tuple(
            replace(v, type="Real", variability="discrete", minimum=0.0, maximum=1.0)
            if v.type == "Boolean" and v.causality in ("output", "local")
            else v
            for v in interface
        ),
    )


def design_id_variable(design: Design) -> Variable:
    """The variable by which units of one design know each other."""
    return Variable(
        name="design_id",
        type="String",
        causality="local",
        variability="constant",
        start=design.design_id,
        description="Hash of the design; units of different designs do not fit",
    )
