"""The record of Gain, a unit that no module of the project knows: y = gain weights u."""

from pathlib import Path

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array
from flexbeams.fmus.references.experiments import Experiment, Series, names_of
from flexbeams.fmus.units.kind import UnitKind, design_id_variable
from flexbeams.fmus.units.native_kernel import Fields, NativeKernel, Table, UnitData, first_references
from flexbeams.plant.galerkin import BeamModel

FOLDER = Path(__file__).parent


def declare(design: Design, model: BeamModel) -> Interface:
    """As many inputs and outputs as there are patch pairs."""
    n = len(model.structure.patch)
    return Interface(
        unit_name="Gain",
        description="Outputs are inputs times a gain",
        variables=(
            TIME,
            *array("u", n, causality="input", unit="V", start=0.0, description="Input {}"),
            *array("y", n, causality="output", unit="V", initial_inputs=("u",), description="Output {}"),
            Variable(name="gain", causality="parameter", variability="tunable", unit="1", start=2.0, minimum=0.0),
            design_id_variable(design),
        ),
        step_size=design.options.sample_time,
        stop_time=1.0,
    )


def weights(n: int) -> np.ndarray:
    """1, 2, 3 ..."""
    return np.arange(1.0, n + 1)


def unit_data(interface: Interface, design: Design, model: BeamModel) -> UnitData:
    return UnitData(arrays={"weights": weights(len(interface.references("u")))})


def native_data(interface: Interface, data: UnitData) -> Fields:
    return {
        "width": len(interface.references("u")),
        **first_references(interface, "u", "y", "gain"),
        "weights": Table(values=data.arrays["weights"], comment="weight of each element, 1"),
    }


def experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """A jump of the inputs under another gain."""
    step, n = design.options.sample_time, len(model.structure.patch)
    time, high = step * np.array([0.0, 2.0, 2.0, 4.0]), 5.0 * weights(n)
    inputs = np.array([0 * high, 0 * high, high, high])
    outputs = 3.0 * weights(n) * np.array([0 * high, 0 * high, 0 * high, high, high])
    return [
        Experiment(
            name="jump",
            description="The inputs jump",
            step=step,
            steps=4,
            parameters={"gain": 3.0},
            stimuli=Series(names=tuple(names_of("u", n)), time=time, values=inputs),
            references=Series(names=tuple(names_of("y", n)), time=step * np.arange(5.0), values=outputs),
        )
    ]


GAIN = UnitKind(
    name="Gain",
    interface=declare,
    data=unit_data,
    chapter=Chapter(
        equations="Each output is a multiple of its input:\n= y_k = g w_k u_k", timing="Outputs follow at once."
    ),
    native=NativeKernel(source=FOLDER / "gain.c", data_type="GainData", hooks="gain_hooks", data=native_data),
    python=FOLDER / "gain_kernel.py",
    experiments=experiments,
    records_inputs=True,
)
