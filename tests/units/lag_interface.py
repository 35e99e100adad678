"""Interface and builder of the test unit in lag.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array, matrix
from flexbeams.fmus.packaging.python import PythonUnit
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.fmus.units.native_kernel import UnitData

KERNEL = Path(__file__).with_name("lag.py")
step_size = 1e-3
gain = (1.0, 0.1 + 0.2)
x_start = (0.1, -1e-300)
a = np.array([0.9, -0.8])
b = np.array([[1.0, 2.0, 3.0], [-0.5, 0.25, 1e-3]])


def lag_interface() -> Interface:
    return Interface(
        unit_name="LagUnit",
        description='Two lags & three inputs, "quoted" <text>',
        step_size=step_size,
        stop_time=1.0,
        variables=(
            TIME,
            *array("u", 3, causality="input", start=0.0, unit="V", minimum=-1e7, maximum=1e7, nominal=100.0),
            *array("y", 2, causality="output", unit="m", initial_inputs=("u",), description="Deflection"),
            *array("gain", 2, causality="parameter", start=gain, minimum=0.0, maximum=10.0, unit="1"),
            *array("x_start", 2, causality="parameter", start=x_start, unit="m"),
            Variable(name="trim", causality="parameter", variability="tunable", start=0.0, maximum=1.0),
            Variable(name="substeps", type="Integer", causality="parameter", start=2, minimum=1, maximum=9),
            Variable(name="sluggish", type="Boolean", causality="parameter", start=False),
            Variable(name="label", type="String", causality="parameter", start="a<b & ü"),
            Variable(name="ticks", type="Integer", causality="output"),
            Variable(name="positive", type="Boolean", causality="output"),
            Variable(name="design_id", type="String", variability="constant", start="0123abcd"),
            *matrix("w", 2, 3, unit="m"),
        ),
    )


def lag_kind(kernel: Path = KERNEL) -> UnitKind:
    """The kind of unit with a kernel in this file."""
    return UnitKind(name="LagUnit", chapter=Chapter(equations="", timing=""), python=kernel)


def lag_unit(out: Path, scale: float = 2.0) -> PythonUnit:
    return PythonUnit(
        kind=lag_kind(),
        interface=lag_interface(),
        data=UnitData(arrays={"a": a, "b": b}, meta={"scale": scale}),
        out=out,
    )
