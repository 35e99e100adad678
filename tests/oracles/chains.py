"""Chains of any number of beams in which no two parts are alike: the structure of the paper, continued."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from flexbeams.plant.structure import Beam, Patch, PointOfInterest, Spring, StrainGauge, Structure, find_structure
from flexbeams.plant.structure import read_structure as read

Part = TypeVar("Part", Beam, Patch)
SPREAD = {
    "density": 0.03,
    "youngs_modulus": 0.1,
    "tip_mass": 0.2,
    "viscous_damping": 0.2,
    "structural_damping": 0.2,
    "piezo_ratio": 0.05,
}


def chain_of_beams(beams: int) -> Structure:
    """`beams` beams with springs between neighbours, r + r // 3 patch pairs and points, 2 r gauges.

    Parameters vary by 3 to 20 %; every third beam, the middle one of the paper, has a second pair and a second point.
    """
    kiel, random = read(find_structure("kiel")), np.random.default_rng(beams)
    second = [patch for patch in kiel.patch if patch.beam == 2]
    patch, point, gauge = [], [], []
    for k in range(1, beams + 1):
        pairs = second if k % 3 == 2 else [p for p in kiel.patch if p.beam == 1]
        patch += [replace(p, beam=k) for p in pairs]
        length = kiel.beam[0].length
        point += [PointOfInterest(beam=k, position=z) for z in ((length / 2, length) if k % 3 == 2 else (length,))]
        gauge += [StrainGauge(beam=k, position=z, length=0.006) for z in (0.06, 0.2)]
    return Structure(
        beam=_varied([kiel.beam[k % 3] for k in range(beams)], random),
        patch=_varied(patch, random),
        spring=[
            Spring(between=(k, k + 1), stiffness=kiel.spring[k % 2].stiffness * random.uniform(0.8, 1.2))
            for k in range(1, beams)
        ],
        point_of_interest=point,
        strain_gauge=gauge,
    )


def _varied(parts: Sequence[Part], random: np.random.Generator) -> list[Part]:
    """The parts with physical parameters of their own."""
    varied = []
    for part in parts:
        names = [name for name in SPREAD if hasattr(part, name)]
        factors = {name: 1 + SPREAD[name] * random.uniform(-1, 1) for name in names}
        varied.append(replace(part, **{name: getattr(part, name) * factor for name, factor in factors.items()}))
    return varied
