"""The common factor of mass, stiffness, damping and piezo ratio, which voltages and deflections cannot show.

All parameters of beams that are joined may be multiplied by one factor and every response stays the same. One of them
must be known, or a force must be measured.
"""

from collections.abc import Sequence

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.residuals import Residuals
from flexbeams.plant.structure import Structure

LARGEST = 0.25  # relative deviation of the common factor that is accepted


def joined_beams(structure: Structure, experiments: Sequence[Experiment]) -> list[list[int]]:
    """Beams (from 1) that springs join in at least one experiment, group by group."""
    coupled = any(not experiment.uncoupled for experiment in experiments)
    groups = [{j} for j in range(1, len(structure.beam) + 1)]
    for spring in structure.spring if coupled else []:
        i, j = spring.between
        joined = [g for g in groups if i in g or j in g]
        groups = [g for g in groups if g not in joined] + [set().union(*joined)]
    return sorted(sorted(group) for group in groups)


def members(structure: Structure, beams: Sequence[int]) -> list[str]:
    """Parameters of a group of beams: their own, those of their patch pairs and of the springs between them."""
    names = []
    for name in structure.parameters():
        part, number = name.split(".")[0].rstrip("]").split("[")
        k = int(number)
        beam = {"beam": k, "patch": structure.patch[k - 1].beam if part == "patch" else 0}.get(part, 0)
        if part == "spring":
            beam = structure.spring[k - 1].between[0]
        if beam in beams:
            names.append(name)
    return names


def require_scale(structure: Structure, residuals: Residuals, x: Array) -> None:
    """InputError where the common factor of a group of beams stays open.

    What is fixed and not 0, a declared prior or a measured force settle it.
    """
    jacobian = residuals.jacobian(x)[: residuals.data_rows, : len(residuals.space.names)]
    slopes = residuals.space.slopes(x[: len(residuals.space.names)])
    experiments = [drive.experiment for drive in residuals.drives]
    for beams in joined_beams(structure, experiments):
        names = members(structure, beams)
        free = [k for k, name in enumerate(residuals.space.names) if name in names]
        values = residuals.space.values(x[: len(residuals.space.names)])
        direction = np.zeros(len(residuals.space.names))
        direction[free] = [values[residuals.space.names[k]] / slopes[k] if slopes[k] else 0.0 for k in free]
        declared = residuals.space.declared & (direction != 0)
        known = float(np.sum((direction / residuals.space.deviation)[declared] ** 2))
        if float(np.sum((jacobian @ direction) ** 2)) + known < 1 / LARGEST**2:
            raise _open_scale(structure, beams, values)


def _open_scale(structure: Structure, beams: list[int], values: dict[str, float]) -> InputError:
    named = "beam " if len(beams) == 1 else "beams "
    named += ", ".join(str(j) for j in beams)
    first = next((j for j in beams if values[f"beam[{j}].tip_mass"] > 0), None)
    example = (
        f"beam[{first}].tip_mass={values[f'beam[{first}].tip_mass']:g}"
        if first
        else f"beam[{beams[0]}].density={values[f'beam[{beams[0]}].density']:g}"
    )
    return InputError(
        "",
        f"masses, stiffnesses, dampings and piezo ratios of {named} are known up to a common factor only, which "
        f"voltages and deflections cannot show; weigh one part and give it, for example --known {example}, or give a "
        f"prior of the densities or the column of a measured force",
    )
