"""Writes structures/kiel.toml: a structure that reproduces the paper's statements about its experiment.

The text leaves out the geometry and the 37 identified parameters. Geometry and patches are assumed or taken
from the data sheet of the MFC M-8525-P1; the four piezo ratios are solved exactly from the static relation
between (48) and the deflections of section 4.3; springs, tip masses, moduli and one damping pair are fitted by
differential evolution to the step response of Fig. 4. Repeat it with

    python -m flexbeams.plant.reconstruction [FILE]
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import differential_evolution

from flexbeams.plant.actuator.parameters import PatchPairActuator
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.measures import overshoots, settling_time
from flexbeams.plant.reconstructed_actuator import ACTUATOR
from flexbeams.plant.statespace import state_matrices
from flexbeams.plant.structure import (
    STRUCTURES_FOLDER,
    Beam,
    Patch,
    PointOfInterest,
    Spring,
    StrainGauge,
    Structure,
    read_structure,
)

# Section 4 of the paper
VOLTAGE = np.array([817.0, -770.0, -807.0, 781.0])  # V (48)
DEFLECTION = np.array([-8e-3, 1e-3, 4e-3, -6e-3])  # m
TIPS = [0, 2, 3]  # points of interest of Fig. 4
OVERSHOOT = 1.5  # of point 3, relative to its end value
OSCILLATION = (4e-3, 6e-3)  # m, range over the three tips
SETTLING = 18.0  # s

# Data sheet of the MFC M-8525-P1: d33 E; two patches double it, see Patch.moment_per_volt
PIEZO_RATIO = 2 * 4e-10 * 30.3e9  # C/m^2

FITTED = (
    "spring[1].stiffness",
    "spring[2].stiffness",
    "beam[1].tip_mass",
    "beam[2].tip_mass",
    "beam[3].tip_mass",
    "beam[1].youngs_modulus",
    "beam[2].youngs_modulus",
    "beam[3].youngs_modulus",
    "structural_damping",
    "viscous_damping",
)
BOUNDS = np.array(
    [
        (2, 15),
        (2, 15),
        (10e-3, 40e-3),
        (10e-3, 40e-3),
        (10e-3, 40e-3),
        (3e10, 8e10),
        (3e10, 8e10),
        (3e10, 8e10),
        (1e-4, 1e-2),
        (2e-3, 6e-2),
    ]
)


BEAM = Beam(
    length=0.40,
    width=0.045,
    thickness=0.8e-3,
    density=1500.0,
    youngs_modulus=5e10,
    tip_mass=0.03,
    viscous_damping=0.03,
    structural_damping=4e-3,
)
PATCH = Patch(
    beam=1,
    position=0.025,
    length=0.085,
    width=0.025,
    thickness=0.3e-3,
    density=5440.0,
    youngs_modulus=30.3e9,
    viscous_damping=0.03,
    structural_damping=4e-3,
    piezo_ratio=PIEZO_RATIO,
    electrode_distance=5e-4,
)
PATCH_POSITIONS = ((1, 0.025), (2, 0.025), (2, 0.16), (3, 0.025))  # beam, m
POINTS = ((1, 0.39), (2, 0.24), (2, 0.39), (3, 0.39))
# One beside each pair and two in the free spans of the outer beams: 4 moments and 2 spring forces are then determined
# by 6 strains. Outside the patches a resting beam is bent by the spring forces alone.
GAUGES = ((1, 0.0675), (1, 0.20), (2, 0.0675), (2, 0.2025), (3, 0.0675), (3, 0.20))


def template() -> Structure:
    """The assumed geometry with data sheet values; parameters that are fitted later hold a plausible value."""
    return Structure(
        beam=[BEAM, BEAM, BEAM],
        patch=[replace(PATCH, beam=beam, position=position) for beam, position in PATCH_POSITIONS],
        spring=[Spring(between=(1, 2), stiffness=6.0), Spring(between=(2, 3), stiffness=8.0)],
        point_of_interest=[PointOfInterest(beam=beam, position=position) for beam, position in POINTS],
        strain_gauge=[StrainGauge(beam=beam, position=position, length=0.006) for beam, position in GAUGES],
        actuator=ACTUATOR,
    )


def parameters_of(candidate: Array) -> dict[str, float]:
    """The structure's parameters that a candidate (len(FITTED),) fixes; one damping pair serves all parts."""
    values = dict(zip(FITTED, (float(v) for v in candidate), strict=True))
    damping = {name: values.pop(name) for name in ("structural_damping", "viscous_damping")}
    for part, count in (("beam", 3), ("patch", 4)):
        values |= {f"{part}[{k}].{name}": value for k in range(1, count + 1) for name, value in damping.items()}
    return values


def piezo_ratios(model: BeamModel, parameters: dict[str, float]) -> Array:
    """The four piezo ratios (C/m^2) with which VOLTAGE holds DEFLECTION at rest, exactly."""
    unit = {f"patch[{k}].piezo_ratio": 1.0 for k in range(1, len(VOLTAGE) + 1)}
    system = model.assemble({**parameters, **unit})
    columns = model.deflection @ cho_solve(cho_factor(system.K), system.L)  # m per V and C/m^2
    ratios: Array = np.linalg.solve(columns * VOLTAGE, DEFLECTION)
    return ratios


def step_response(model: BeamModel, parameters: dict[str, float], time: Array) -> Array:
    """Tip deflections (k, 3) after the step (48) at time 0, by modes slower than 400 rad/s."""
    system = model.assemble(parameters)
    A, B = state_matrices(system)
    rest = np.linalg.solve(A, B @ VOLTAGE)  # -x_end
    eigenvalues, vectors = np.linalg.eig(A)
    amplitudes = np.linalg.solve(vectors, rest.astype(complex))
    slow = (np.abs(eigenvalues) < 400.0) & (eigenvalues.imag >= 0)
    weight = np.where(eigenvalues[slow].imag > 0, 2.0, 1.0)
    output = np.hstack([model.deflection[TIPS], np.zeros((3, model.size))]) @ vectors[:, slow]
    deviation = np.exp(np.outer(time, eigenvalues[slow])) @ (output * (weight * amplitudes[slow])).T
    response: Array = DEFLECTION[TIPS] + deviation.real
    return response


def misfit(model: BeamModel) -> Callable[[Array], float]:
    """Sum of squared residuals of a candidate, each in units of its tolerance."""
    time = np.arange(0.0, 26.0, 4e-3)
    end = DEFLECTION[TIPS]

    def cost(candidate: Array) -> float:
        parameters = parameters_of(candidate)
        ratios = piezo_ratios(model, parameters)
        if np.any(ratios <= 0):
            return 1e6 + float(np.sum(np.abs(np.minimum(ratios, 0))))
        parameters |= {f"patch[{k}].piezo_ratio": float(p) for k, p in enumerate(ratios, 1)}
        y = step_response(model, parameters, time)
        overshoot = overshoots(y, end)
        low, high = OSCILLATION
        outer = overshoot[[0, 2]]
        outside = np.maximum(1.05 * low - outer, 0) + np.maximum(outer - 0.97 * high, 0)
        residuals = [
            (overshoot[1] / abs(end[1]) - OVERSHOOT) / 0.01,
            *(outside / 0.03e-3),
            (settling_time(time, y, end, 0.0) - SETTLING) / 0.2,
            *(np.log(ratios / PIEZO_RATIO) / 0.1),
        ]
        return float(np.sum(np.square(residuals)))

    return cost


def reconstruct(seed: int = 1, notify: Callable[[str], None] = lambda text: None) -> Structure:
    """The fitted structure; DesignError where the fit misses the facts."""
    structure = template()
    model = beam_model(structure, "clamped_free", 10)
    cost = misfit(model)
    result = differential_evolution(
        cost,
        BOUNDS,
        seed=seed,
        popsize=12,
        maxiter=120,
        tol=1e-6,
        polish=False,
        init="sobol",
        callback=lambda intermediate_result: notify(f"misfit {intermediate_result.fun:.3f}"),
    )
    if result.fun > 25.0:
        raise DesignError(f"the fit to the paper's facts ended at a misfit of {result.fun:.1f}; it must be <= 25")
    # Rounded to three digits, as a person would write them; the piezo ratios are solved for the rounded values.
    parameters = parameters_of(np.array([float(f"{v:.3g}") for v in result.x]))
    ratios = piezo_ratios(model, parameters)
    parameters |= {f"patch[{k}].piezo_ratio": float(p) for k, p in enumerate(ratios, 1)}
    return structure.with_parameters(parameters)


ORIGIN = {  # of every value in the file
    "beam": {"length": "assumed", "width": "assumed", "thickness": "assumed", "density": "assumed"},
    "patch": {
        "beam": "paper",
        "position": "assumed",
        "length": "datasheet",
        "width": "datasheet",
        "thickness": "datasheet",
        "density": "datasheet",
        "youngs_modulus": "datasheet",
        "electrode_distance": "paper",
    },
    "spring": {"between": "paper"},
    "point_of_interest": {"beam": "paper", "position": "assumed"},
    "strain_gauge": {"beam": "assumed", "position": "assumed", "length": "datasheet"},
    "actuator": {
        "face_minimum": "datasheet",
        "face_maximum": "datasheet",
        "supply": "paper",
        "lag": "assumed",
        "slew_rate": "assumed",
        "resolution": "assumed",
    },
    "actuator.pair": dict.fromkeys(PatchPairActuator.__dataclass_fields__, "assumed"),
}

HEADER = """Three elastically coupled beams with four piezoelectric patch pairs, after Kater and Meurer (2019).
A reconstruction: the text of the paper gives no geometry and none of the 37 identified parameters.
Written by `python -m flexbeams.plant.reconstruction`; the origin of each value stands behind it.
"""


def write_structure(structure: Structure, path: Path, origin: dict[str, dict[str, str]], header: str) -> None:
    """Writes the structure as TOML, each value with its origin; values that `origin` does not name are `fitted`."""
    document = tomlkit.document()
    for line in header.splitlines():
        document.add(tomlkit.comment(line))
    for part in ("beam", "patch", "spring", "point_of_interest", "strain_gauge"):
        if not getattr(structure, part):
            continue
        document.add(part, _tables(getattr(structure, part), origin.get(part, {})))
    if structure.actuator is not None:
        section = _table(structure.actuator, origin.get("actuator", {}), leave_out="pair")
        section.add("pair", _tables(structure.actuator.pair, origin.get("actuator.pair", {})))
        document.add("actuator", section)
    path.write_text(tomlkit.dumps(document), encoding="utf-8")


def _tables(items: Sequence[Any], origin: dict[str, str]) -> tomlkit.items.AoT:
    tables = tomlkit.aot()
    for item in items:
        tables.append(_table(item, origin))
    return tables


def _table(item: Any, origin: dict[str, str], leave_out: str = "") -> tomlkit.items.Table:
    table = tomlkit.table()
    for name in type(item).__dataclass_fields__:
        if name != leave_out:
            value = getattr(item, name)
            entry = tomlkit.item(list(value) if isinstance(value, tuple) else value)
            table.add(name, entry)
            entry.comment(origin.get(name, "fitted"))
    return table


def main(arguments: list[str]) -> int:
    """Reconstructs, writes and reads back; prints the misfit as it falls to stderr."""
    path = Path(arguments[0]) if arguments else STRUCTURES_FOLDER / "kiel.toml"
    structure = reconstruct(notify=lambda text: print(f"\r{text}      ", end="", file=sys.stderr, flush=True))
    print(file=sys.stderr)
    write_structure(structure, path, ORIGIN, HEADER)
    read_structure(path)
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
