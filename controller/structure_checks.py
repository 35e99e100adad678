"""Parts of a structure that a controller cannot use: blind gauges, and beams that no gauge sees or no pair moves."""

import numpy as np
from scipy.linalg import eigh

from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel, beam_bases
from flexbeams.plant.structure import Structure

BLIND = 0.05  # a gauge that sees less than this fraction of the largest strain of its beam
MODES_OF_A_BEAM = 3  # lowest modes that strains are compared in
_GRID = 101


def structure_warnings(model: BeamModel, system: SecondOrderSystem) -> list[str]:
    """One line for each blind gauge, each beam that no gauge sees and each beam that no patch pair moves."""
    blind = blind_gauges(model, system)
    structure = model.structure
    warnings = [
        f"strain_gauge[{k}] is blind: where it is, the strain is below {100 * BLIND:g} % of the largest of beam "
        f"{structure.strain_gauge[k - 1].beam} in every one of the lowest modes"
        for k in blind
    ]
    seeing = {g.beam for k, g in enumerate(structure.strain_gauge, 1) if k not in blind}
    moving = {p.beam for p in structure.patch}
    warnings += [f"beam {j} is seen by no gauge, also not through springs" for j in _apart(structure, seeing)]
    warnings += [f"beam {j} is moved by no patch pair, also not through springs" for j in _apart(structure, moving)]
    return warnings


def blind_gauges(model: BeamModel, system: SecondOrderSystem) -> list[int]:
    """Gauges, counted from 1, whose strain is small beside the largest of their beam in each of the lowest modes."""
    structure = model.structure
    _, shapes = eigh(system.M, system.K)
    shapes = shapes[:, ::-1][:, : MODES_OF_A_BEAM * len(structure.beam)]
    largest = [np.max(np.abs(rows @ shapes), axis=0) for rows in _strain_rows(model)]
    blind = []
    for k, gauge in enumerate(structure.strain_gauge, 1):
        ratio = np.abs(model.strain[k - 1] @ shapes) / np.maximum(largest[gauge.beam - 1], np.finfo(float).tiny)
        moved = largest[gauge.beam - 1] > 1e-3 * max(np.max(strain) for strain in largest)
        if np.all(ratio[moved] < BLIND):
            blind.append(k)
    return blind


def _strain_rows(model: BeamModel) -> list[Array]:
    """For each beam, strains (_GRID, n) at points along it."""
    bases = beam_bases(model.structure, model.basis, model.order)
    rows, start = [], 0
    for beam, basis in zip(model.structure.beam, bases, strict=True):
        wide = np.zeros((_GRID, model.size))
        points = np.linspace(0, beam.length * (1 - 1e-9), _GRID)
        wide[:, start : start + basis.size] = beam.thickness / 2 * basis.evaluate(points, 2)
        rows.append(wide)
        start += basis.size
    return rows


def _apart(structure: Structure, sources: set[int]) -> list[int]:
    """Beams, counted from 1, that no chain of springs joins to one of `sources`."""
    reached = set(sources)
    springs = [s.between for s in structure.spring if s.stiffness > 0]
    for _ in structure.beam:
        reached |= {b for pair in springs for b in pair if reached & set(pair)}
    return [j for j in range(1, len(structure.beam) + 1) if j not in reached]
