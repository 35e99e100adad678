"""BeamPlant: elastically coupled beams with piezoelectric patch pairs."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.documents.chapter import PAPER, Chapter
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array
from flexbeams.fmus.references.beam_plant import plant_experiments
from flexbeams.fmus.units.kind import STOP_TIME, UnitKind, design_id_variable
from flexbeams.fmus.units.native_kernel import NATIVE, NativeKernel, UnitData
from flexbeams.fmus.units.plant_tables import native_data
from flexbeams.fmus.units.ranges import Range, force_range, voltage_range
from flexbeams.plant.galerkin import STATIONS, BeamModel
from flexbeams.plant.parameters import PARAMETERS, in_unit_order
from flexbeams.plant.structure import Structure


def declare(design: Design, model: BeamModel) -> Interface:
    """Voltages and tip forces in, deflections and strains out, every physical parameter settable."""
    structure, limit = model.structure, design.options.voltage_limit
    r, n_u = len(structure.beam), len(structure.patch)
    voltages = voltage_range(design)
    return Interface(
        unit_name=BEAM_PLANT.name,
        variables=(
            TIME,
            *array(
                "u",
                n_u,
                causality="input",
                unit="V",
                start=0.0,
                nominal=limit,
                description="Voltage of patch pair {}",
                **voltages,
            ),
            *array(
                "force",
                r,
                causality="input",
                unit="N",
                start=0.0,
                description="Force on the tip of beam {}",
                **force_range(model),
            ),
            *_outputs(structure),
            *_locals(r),
            *_physical_parameters(structure),
            *_start_parameters(n_u, limit, voltages),
            design_id_variable(design),
        ),
        step_size=design.options.sample_time,
        stop_time=STOP_TIME,
        description="Elastically coupled Euler-Bernoulli beams with piezoelectric "
        f"patch pairs: {r} beams, {n_u} pairs, Galerkin model of {2 * model.size} states, exact for "
        "inputs held over any step",
    )


def _outputs(structure: Structure) -> Iterator[Variable]:
    for k, point in enumerate(structure.point_of_interest, 1):
        yield Variable(
            name=f"y_pi[{k}]",
            causality="output",
            unit="m",
            nominal=1e-3,
            description=f"Deflection at point of interest {k}: beam {point.beam}, {point.position:g} m from the clamp",
        )
    for k, gauge in enumerate(structure.strain_gauge, 1):
        yield Variable(
            name=f"y_pm[{k}]",
            causality="output",
            unit="1",
            nominal=1e-4,
            description=f"Strain at gauge {k}: beam {gauge.beam}, {gauge.position:g} m from the clamp",
        )


def _locals(beams: int) -> Iterator[Variable]:
    for j in range(1, beams + 1):
        for i in range(1, STATIONS + 1):
            yield Variable(
                name=f"w[{j},{i}]",
                causality="local",
                unit="m",
                nominal=1e-3,
                description=f"Deflection of beam {j} at station {i} of {STATIONS} from the clamp to the tip",
            )
    yield Variable(
        name="energy",
        causality="local",
        unit="J",
        nominal=1e-3,
        description="Kinetic and elastic energy of the structure",
    )


def _physical_parameters(structure: Structure) -> Iterator[Variable]:
    values = structure.parameters()
    for entry in PARAMETERS:
        starts = [values[name] for name, other in in_unit_order(values) if other is entry]
        yield from array(
            f"{entry.part}[].{entry.name}",
            len(starts),
            causality="parameter",
            unit=entry.unit,
            start=starts,
            minimum=min([entry.minimum, *starts]),
            maximum=max([entry.maximum, *starts]),
            nominal=max(starts, default=0.0) or 1.0,
            description=entry.meaning,
        )


def _start_parameters(n_u: int, limit: float, voltages: Range) -> Iterator[Variable]:
    yield from array(
        "start_at_rest_under",
        n_u,
        causality="parameter",
        unit="V",
        start=0.0,
        nominal=limit,
        description="Voltage of patch pair {} under which the structure rests at the start",
        **voltages,
    )
    yield Variable(
        name="strain_noise_std",
        causality="parameter",
        unit="1",
        start=0.0,
        minimum=0.0,
        maximum=1.0,
        nominal=1e-6,
        description="Standard deviation of white noise on the strains, a new value each sample time",
    )
    yield Variable(
        name="noise_seed",
        type="Integer",
        causality="parameter",
        start=1,
        minimum=0,
        description="Seed of the noise; equal seeds give equal noise",
    )


def unit_data(interface: Interface, design: Design, model: BeamModel) -> UnitData:
    """Terms of the matrices, and what is observed.

    Arrays: term_<k>, the blocks of BeamModel.terms, listed in `terms` as parameter, matrix, start, column; tips (r, n);
    outputs (n_pi + n_pm + r STATIONS, n) for y_pi, y_pm and w. `parameters` maps the physical parameters to value
    references, `may_vanish` lists those that can be 0.
    """
    parameters = dict(in_unit_order(model.structure.parameters()))
    return UnitData(
        arrays={
            **{f"term_{k}": term.block for k, term in enumerate(model.terms)},
            "tips": model.tips,
            "outputs": np.vstack([model.deflection, model.strain, model.stations.reshape(-1, model.size)]),
        },
        meta={
            "sample_time": design.options.sample_time,
            "design_id": design.design_id,
            "size": model.size,
            "basis": model.basis,
            "order": model.order,
            "terms": [[t.parameter, t.matrix, t.start, t.column] for t in model.terms],
            "parameters": {name: interface.reference(name) for name in parameters},
            "may_vanish": [name for name, entry in parameters.items() if entry.may_vanish],
        },
    )


BEAM_PLANT = UnitKind(
    name="BeamPlant",
    interface=declare,
    data=unit_data,
    chapter=Chapter(
        equations="""
Euler-Bernoulli beams, clamped at one end, with tip masses, springs between adjacent tips and pairs of piezoelectric
patches; a Galerkin approximation of their weak form, equations (13) to (15) of the paper:
= M ddot q + D dot q + K q = L u + F f
q are the generalised coordinates, u the voltages of the patch pairs and f the forces on the tips. Each matrix is a sum
of physical parameters times constant matrices of the geometry, so every parameter can be set before the
initialisation ends. With the factors of K and M the state's norm is the mechanical energy E:
= K = R_K R_K^T ; M = R_M R_M^T ; x = (R_K^T q , R_M^T dot q) ; E = x^T x / 2
= dot x = A x + B v ; v = (u , f)
A step of any length h is exact, for inputs that are held and for inputs with a constant derivative:
= x(t+h) = e^{A h} x(t) + (∫_0^h e^{A s} d s) B v(t) + (∫_0^h (h−s) e^{A s} d s) B dot v(t)
Outputs are the deflections y_pi at the points of interest, and the strains y_pm at the gauges: half the thickness
times the curvature, averaged over the gauge:
= y_pi = C_pi q ; y_pm = C_pm q + σ n_k
nₖ is white noise of variance 1, new at each sample time, a function of seed, sample and gauge only; σ is
strain_noise_std.
""",
        timing="""
The step size is free and does not change the result. A step is made in modal coordinates, the eigenvectors of A,
and one of a new length takes at most three times as long. Where an eigenvalue's condition number is above 100, near
critical damping of a mode, the matrix exponential takes their place and each new length costs one.
Outputs after a step are those at its end. Derivatives set with fmi2SetRealInputDerivatives (order 1) hold for the next
step.
""",
        literature=PAPER,
    ),
    native=NativeKernel(
        source=NATIVE / "units" / "beam_plant.c",
        data_type="BeamPlantData",
        hooks="beam_plant_hooks",
        data=native_data,
        deferred=("w", "energy"),
        interpolates_inputs=True,
        provides_derivatives=True,
    ),
    python=Path(__file__).parents[1] / "python" / "beam_plant.py",
    experiments=plant_experiments,
    takes_basis=True,
    records_inputs=True,
    animated=("w", "u"),
)
