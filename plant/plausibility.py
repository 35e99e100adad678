"""Values of a structure that look like those of another unit of measurement, such as 400 for a length of 0.4 m.

They are named, not refused: ranges are wide enough for any structure that the model can describe.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from flexbeams.plant.structure import Beam, Patch, Structure

MAX_MASS_RATIO = 100.0  # of tip mass and beam
MAX_THICKNESS_RATIO = 0.5  # of thickness and length; theory of slender beams
FREQUENCIES = (1e-2, 3e3)  # Hz, of the first mode of a beam
GAINS = (1e-12, 1e-2)  # m/V, static deflection of the tip


@dataclass(frozen=True, kw_only=True)
class Range:
    """Plausible values of a key, and the units that a value outside may be in."""

    low: float
    high: float
    unit: str  # SI
    others: tuple[tuple[str, float], ...]  # unit and its size in SI

    def guess(self, value: float) -> str:
        """The likely unit of a value outside, and the value in SI; empty for one inside."""
        if self.low <= value <= self.high:
            return ""
        for name, size in self.others:
            if self.low <= value * size <= self.high:
                return f"looks like {name}, {value * size:.4g} {self.unit}"
        return f"values from {self.low:g} to {self.high:g} are usual"


_LENGTHS = (("mm", 1e-3), ("µm", 1e-6), ("cm", 1e-2))
_DENSITY = Range(low=20.0, high=3e4, unit="kg/m3", others=(("g/cm3", 1e3),))
_MODULUS = Range(low=1e6, high=2e12, unit="Pa", others=(("GPa", 1e9), ("MPa", 1e6)))
RANGES = {
    "beam": {
        "length": Range(low=1e-3, high=60.0, unit="m", others=_LENGTHS),
        "width": Range(low=1e-5, high=5.0, unit="m", others=_LENGTHS),
        "thickness": Range(low=1e-7, high=0.5, unit="m", others=_LENGTHS),
        "density": _DENSITY,
        "youngs_modulus": _MODULUS,
    },
    "patch": {
        "length": Range(low=1e-4, high=10.0, unit="m", others=_LENGTHS),
        "width": Range(low=1e-5, high=5.0, unit="m", others=_LENGTHS),
        "thickness": Range(low=1e-7, high=0.05, unit="m", others=_LENGTHS),
        "density": _DENSITY,
        "youngs_modulus": _MODULUS,
        "piezo_ratio": Range(low=1e-3, high=300.0, unit="C/m2", others=()),
        "electrode_distance": Range(low=1e-7, high=0.05, unit="m", others=_LENGTHS),
    },
}


def implausible_values(structure: Structure) -> list[str]:
    """A line for each key whose value is likely in another unit; by consequence where no single key is to blame."""
    lines = list(_by_key(structure))
    return lines or list(_by_consequence(structure))


def _by_key(structure: Structure) -> Iterator[str]:
    for part, ranges in RANGES.items():
        for name, plausible in ranges.items():
            found = [(k, getattr(item, name)) for k, item in enumerate(getattr(structure, part), 1)]
            outside = [(k, value) for k, value in found if not plausible.low <= value <= plausible.high]
            if outside:
                k, value = outside[0]
                guess = _piezo_guess(structure.patch[k - 1]) if name == "piezo_ratio" else plausible.guess(value)
                yield _line(f"{part}[{k}].{name}", value, plausible.unit, guess, len(outside) - 1)
    heavy = [k for k, b in enumerate(structure.beam, 1) if b.tip_mass > MAX_MASS_RATIO * _mass(b)]
    if heavy and not any(RANGES["beam"]["density"].guess(b.density) for b in structure.beam):
        beam = structure.beam[heavy[0] - 1]
        guess = f"the beam itself has {_mass(beam):.3g} kg: looks like g, {beam.tip_mass / 1e3:.4g} kg"
        yield _line(f"beam[{heavy[0]}].tip_mass", beam.tip_mass, "kg", guess, len(heavy) - 1)
    thick = [
        k
        for k, b in enumerate(structure.beam, 1)
        if b.thickness <= RANGES["beam"]["thickness"].high and b.thickness > MAX_THICKNESS_RATIO * b.length
    ]
    if thick:
        beam = structure.beam[thick[0] - 1]
        guess = f"the beam is {beam.length:g} m long: looks like mm, {beam.thickness / 1e3:.4g} m"
        yield _line(f"beam[{thick[0]}].thickness", beam.thickness, "m", guess, len(thick) - 1)


def _by_consequence(structure: Structure) -> Iterator[str]:
    for k, beam in enumerate(structure.beam, 1):
        stiffness = 3 * beam.youngs_modulus * beam.second_moment / beam.length**3
        frequency = math.sqrt(stiffness / (beam.tip_mass + 0.2357 * _mass(beam))) / (2 * math.pi)
        if not FREQUENCIES[0] <= frequency <= FREQUENCIES[1]:
            text = f"alone has its first frequency at {frequency:.3g} Hz"
            yield f"beam[{k}] {text}: are length, thickness, youngs_modulus (SI: m, m, Pa) in other units?"
    for k, patch in enumerate(structure.patch, 1):
        beam = structure.beam[patch.beam - 1]
        bending = beam.youngs_modulus * beam.second_moment
        bending += 2 * patch.youngs_modulus * patch.second_moment(beam)
        gain = patch.moment_per_volt(beam) * patch.length * beam.length / bending
        if not GAINS[0] <= gain <= GAINS[1]:
            keys = "piezo_ratio, electrode_distance, thickness (SI: C/m2, m, m)"
            yield f"patch[{k}] moves the tip by about {gain:.3g} m/V: are {keys} in other units?"


def _line(key: str, value: float, unit: str, guess: str, more: int) -> str:
    also = f" (and {more} more)" if more else ""
    return f"{key} = {value:g}{also} is unusual: SI: {unit}; {guess}"


def _piezo_guess(patch: Patch) -> str:
    """d33 is of the order 1e-10 m/V, or 100 pm/V; wanted is 2 d33 E."""
    for name, size in (("m/V", 1.0), ("pm/V", 1e-12)):
        if 1e-12 <= patch.piezo_ratio * size <= 1e-8:
            wanted = 2 * patch.piezo_ratio * size * patch.youngs_modulus
            return f"looks like d33 in {name}, 2 d33 E = {wanted:.4g} C/m2"
    plausible = RANGES["patch"]["piezo_ratio"]
    return plausible.guess(patch.piezo_ratio)


def _mass(beam: Beam) -> float:
    return beam.density * beam.area * beam.length
